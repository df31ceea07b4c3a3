"""A camera's reports: when they come, how far they are off, what they lack."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from modes.twin.camera import Camera, CameraSettings
from modes.twin.people import Stance, Standing, Walking
from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

WALKING = Walking((1.0, -2.0), (1.0, 2.0))
SETTINGS = CameraSettings(rate_hz=25.0, latency_s=0.03, latency_max_s=0.07, dropped=0.2, seed=3)


def test_every_report_comes_once_in_time_and_some_are_lost() -> None:
    camera, found = Camera([WALKING], SETTINGS), []
    for k in range(2000):
        t = 0.01 * k
        here = camera.arrived(t)
        assert all(t - 0.01 < each.arrived <= t for each in here)
        found += here
    stamps = [each.stamp for each in found]
    assert len(set(stamps)) == len(stamps)
    assert np.allclose(np.array(stamps) * 25.0, np.round(np.array(stamps) * 25.0))
    late = np.array([each.arrived - each.stamp for each in found])
    assert (late >= 0.03).all() and (late <= 0.07).all() and np.ptp(late) > 0.03
    assert 0.7 * 500 < len(found) < 0.9 * 500


def test_reports_come_in_the_order_of_their_arrival_though_later_ones_overtake() -> None:
    camera = Camera([WALKING], CameraSettings(rate_hz=100.0, latency_s=0.0, latency_max_s=0.2, dropped=0.0))
    found = [each for k in range(40) for each in camera.arrived(0.1 * k)]
    arrivals, stamps = [each.arrived for each in found], [each.stamp for each in found]
    assert arrivals == sorted(arrivals) and stamps != sorted(stamps)


def test_a_clock_that_jumps_or_goes_back_neither_hangs_it_nor_brings_a_report_twice() -> None:
    camera = Camera([WALKING], CameraSettings(dropped=0.0))
    first = camera.arrived(1.0)
    for t in (math.nan, math.inf, -math.inf, -1e9, 0.5):
        assert camera.arrived(t) == []
    later = camera.arrived(1e9)
    stamps = [each.stamp for each in (*first, *later, *camera.arrived(1e9 + 1.0))]
    assert len(set(stamps)) == len(stamps) and all(np.diff(stamps) > 0.0)
    assert [each for each in stamps if 2.0 < each < 1e9 - 60.1] == []
    assert len([each for each in stamps if each > 1e9 - 30.0]) == pytest.approx(31 * 30, abs=4)


def test_a_point_without_all_three_coordinates_is_not_seen() -> None:
    class Half:
        def at(self, t: float) -> NDArray[np.float64]:
            points = WALKING.at(t)
            points[Point.HEAD, 1], points[Point.PELVIS, 2] = math.nan, math.inf
            return points

    (report, *_rest) = Camera([Half()], CameraSettings(dropped=0.0)).arrived(1.0)
    (person,) = report.people
    for point in (Point.HEAD, Point.PELVIS):
        assert not person.measured >> point & 1 and np.isnan(np.asarray(person.xyz)[point]).all()


def test_points_are_off_as_stated_and_no_farther_than_their_error() -> None:
    settings = CameraSettings(noise_m=0.01, error_m=0.02, dropped=0.0)
    camera = Camera([WALKING], settings)
    off = np.array([np.asarray(each.people[0].xyz) - WALKING.at(each.stamp) for each in camera.arrived(10.0)])
    far = np.linalg.norm(off, axis=2)
    assert (far <= 0.02 + 1e-12).all() and far.max() == pytest.approx(0.02)
    within = math.sqrt(chi2.cdf(4.0, 5) / chi2.cdf(4.0, 3))  # of a normal in a ball of two deviations
    assert off[far < 0.0199].std() == pytest.approx(0.01 * within, rel=0.05)
    assert np.abs(off.mean(axis=(0, 1))).max() < 1e-3


def test_what_is_hidden_is_not_measured() -> None:
    def hidden(t: float, person: int) -> NDArray[np.bool_]:
        mask = np.zeros(MAX_POINTS, dtype=bool)
        mask[Point.L_WRIST] = person == 0 and 1.0 <= t < 2.0
        return mask

    standing = Standing(Stance(1.0, 0.0))
    camera = Camera([WALKING, standing], CameraSettings(dropped=0.0), hidden)
    for report in camera.arrived(3.0):
        first, second = report.people
        within = 1.0 <= report.stamp < 2.0
        assert np.isnan(np.asarray(first.xyz)[Point.L_WRIST]).all() == within
        assert bool(first.measured >> Point.L_WRIST & 1) != within
        assert second.measured == (1 << MAX_POINTS) - 1 and (first.id, second.id) == ("p1", "p2")
        assert report.complete and report.frame == "world"


def test_the_same_seed_gives_the_same_reports() -> None:
    one, other = (Camera([WALKING], SETTINGS).arrived(2.0) for _ in range(2))
    assert all(
        a.arrived == b.arrived and np.array_equal(a.people[0].xyz, b.people[0].xyz)
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"rate_hz": 0.0}, "camera: rate_hz"),
        ({"latency_s": 0.06}, "latency_max_s = 0.05 should be at least latency_s, 0.06"),
        ({"noise_m": -1.0}, "noise_m"),
        ({"dropped": 1.5}, "dropped"),
        ({"seed": 0.5}, "seed"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change: dict[str, float], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        CameraSettings(**change)  # type: ignore[arg-type]  # numbers of other kinds are to be refused
