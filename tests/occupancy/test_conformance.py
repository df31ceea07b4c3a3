"""Which later measurements contradict what a row of the people block said."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.conformance import LaterSamples, Outside, later_outside
from occupancy.measurement import Gate
from tests.occupancy.moving_people import Known, Sensor, Trial, unit
from tests.occupancy.people import clip, clips, only, report, settings, standing

ISO = load_profile("iso")
Array = np.ndarray


def samples(t: Array, xyz: Array, e_p: float | Array = 0.01) -> LaterSamples:
    return LaterSamples(np.asarray(t, float), xyz, np.broadcast_to(e_p, xyz.shape[:2]))


def first(gate: Gate, later: LaterSamples, after: float = 0.0, until: float = math.inf) -> Outside | None:
    return later_outside(gate.people, 0, later, ISO, after=after, until=until)


def gate_with(xyz: Array, stamp: float = 0.0, **changes: object) -> Gate:
    gate = Gate(ISO, settings(**changes))
    gate.admit(report(stamp, ("a", xyz)), stamp)
    return gate


@pytest.mark.parametrize(
    ("t", "shape", "said"),
    [
        (np.array([0.0, 0.0]), (2, 20, 3), "strictly increasing"),
        (np.array([0.0, math.nan]), (2, 20, 3), "finite"),
        (np.array([0.0, 1.0]), (3, 20, 3), "2 stamps need points"),
        (np.array([0.0, 1.0]), (2, 19, 3), "2 stamps need points"),
    ],
)
def test_samples_refuse(t: Array, shape: tuple[int, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        LaterSamples(t, np.zeros(shape), np.zeros(shape[:2]))


def test_hand_faster_than_the_profile_is_outside_from_the_moment_that_errors_cannot_explain() -> None:
    """3.4 m/s against 2.0 m/s with 0.01 m on both sides: from 0.02 / 1.4 s = 14.3 ms on."""
    t = 0.001 * np.arange(1, 101)
    xyz = np.repeat(standing()[None], len(t), axis=0)
    xyz[:, Point.R_WRIST, 0] += 3.4 * t
    found = first(gate_with(standing()), samples(t, xyz))
    assert found is not None
    assert (found.point, found.earlier) == (Point.R_WRIST, Point.R_WRIST)
    assert t[found.sample] == pytest.approx(0.015)
    assert found.distance_m == pytest.approx(3.4 * 0.015)
    assert found.allowed_m == pytest.approx(2.0 * 0.015 + 0.02)


def test_clock_and_stamp_errors_are_granted_to_both_measurements() -> None:
    xyz = standing()[None].copy()
    gate = gate_with(standing(), clock_error_s=0.003, stamp_error_s=0.002)
    xyz[0, Point.HEAD, 0] += 2.0 * (0.1 + 2 * 0.005) + 0.02 - 1e-6
    assert first(gate, samples(np.array([0.1]), xyz)) is None
    xyz[0, Point.HEAD, 0] += 2e-6
    assert first(gate, samples(np.array([0.1]), xyz)) is not None


def test_only_samples_of_the_window_count() -> None:
    t = np.array([0.1, 0.2, 0.3])
    xyz = np.repeat(standing()[None], 3, axis=0)
    xyz[1, Point.HEAD, 0] += 5.0
    gate = gate_with(standing())
    assert first(gate, samples(t, xyz), 0.0, 0.19) is None
    assert first(gate, samples(t, xyz), 0.2, 0.3) is None
    for after, until in ((0.1, 0.2), (0.0, 1.0), (-1.0, 0.25)):
        found = first(gate, samples(t, xyz), after, until)
        assert found is not None and found.sample == 1


def test_missing_points_say_nothing() -> None:
    gate = gate_with(standing())
    xyz = np.full((3, MAX_POINTS, 3), np.nan)
    assert first(gate, samples(np.array([0.1, 0.2, 0.3]), xyz, np.nan)) is None


def test_point_that_the_row_inferred_must_be_within_the_chain() -> None:
    """The row had no wrist: it was assumed within a forearm of the elbow, 0.146 of 1.90 m."""
    known = only(standing(), *[p for p in Point if p.name not in ("L_WRIST", "L_HAND", "L_FINGERTIP")])
    gate = gate_with(known)
    for length, contradicts in (
        (0.146 * 1.9 + 0.2 + 0.02 - 1e-6, False),
        (0.146 * 1.9 + 0.2 + 0.02 + 1e-6, True),
    ):
        xyz = only(standing(), Point.L_WRIST)[None].copy()
        xyz[0, Point.L_WRIST] = standing()[Point.L_ELBOW] + (0.0, length, 0.0)
        found = first(gate, samples(np.array([0.1]), xyz))
        assert (found is not None) is contradicts
        if found is not None:
            assert (found.point, found.earlier) == (Point.L_WRIST, Point.L_ELBOW)


def test_person_within_the_profile_is_never_outside(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """And at its bounds comes close: errors and motion all the same way."""
    tightest = -math.inf
    for trial_number in range(count(5_000)):
        sensor = Sensor(float(rng.uniform(0.0, 0.03)), 0.002, 0.001)
        aligned = trial_number % 2 == 0
        trial = Trial(rng, ISO, sensor, unit(rng, 1)[0] if aligned else None)
        true = trial.admissible()
        xyz, instant = trial.report(true, 0.0)
        gate = gate_with(
            xyz,
            position_error_m=sensor.e_p,
            clock_error_s=sensor.clock_error,
            stamp_error_s=sensor.stamp_error,
        )
        known = Known(true, np.full(MAX_POINTS, instant), np.ones(MAX_POINTS, bool))
        t = np.cumsum(rng.uniform(0.01, 0.1, 5))
        seen = np.full((5, MAX_POINTS, 3), np.nan)
        for i, stamp in enumerate(t):
            when = stamp + rng.choice([-1.0, 1.0]) * (sensor.stamp_error + sensor.clock_error)
            points = trial.later(known, when)
            if points is not None:
                seen[i] = points + sensor.e_p * trial.directions(MAX_POINTS)
        later = samples(t, seen, sensor.e_p)
        assert first(gate, later) is None
        allowed = 2.0 * (t[:, None] + 2.0 * (sensor.stamp_error + sensor.clock_error)) + 2.0 * sensor.e_p
        tightest = max(tightest, float(np.nanmax(np.linalg.norm(seen - xyz, axis=2) - allowed)))
    assert tightest > -1e-6


def test_first_outside_equals_a_plain_search(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    found_some = 0
    for _ in range(count(5_000)):
        gate = gate_with(standing(), clock_error_s=0.001, stamp_error_s=0.001)
        n = int(rng.integers(1, 30))
        t = np.cumsum(rng.uniform(0.001, 0.05, n))
        xyz = standing()[None] + rng.normal(scale=rng.choice([0.05, 0.3]), size=(n, MAX_POINTS, 3))
        xyz[rng.random((n, MAX_POINTS)) < 0.3] = np.nan
        e_p = rng.uniform(0.0, 0.1, (n, MAX_POINTS))
        after, until = sorted(rng.uniform(0.0, 1.0, 2))
        expected = None
        for i, p in np.ndindex(n, MAX_POINTS):
            if not after < t[i] <= until or np.isnan(xyz[i, p, 0]):
                continue
            far = float(np.linalg.norm(xyz[i, p] - standing()[p]))
            if far > 0.01 + e_p[i, p] + 2.0 * (t[i] + 2.0 * 0.002):
                expected = (i, p)
                break
        found = first(gate, LaterSamples(t, xyz, e_p), after, until)
        assert (None if found is None else (found.sample, found.point)) == expected
        found_some += found is not None
    assert found_some > 0


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_numbers_that_are_not_usable_never_raise(value: float) -> None:
    xyz = np.repeat(standing()[None], 2, axis=0)
    xyz[0, Point.HEAD] = value
    first(gate_with(standing()), samples(np.array([0.1, 0.2]), xyz))
    first(gate_with(standing()), samples(np.array([0.1, 0.2]), np.repeat(standing()[None], 2, axis=0), value))
    gate = gate_with(standing())
    gate.people["xyz"][0, 0, Point.HEAD] = value
    first(gate, samples(np.array([0.1, 0.2]), xyz))


# ------------------------------------------------------------------------------------------- real recordings


def share_outside(path: Path, horizon: float) -> float:
    """Share of the frames after which someone is outside of what that frame said, within the horizon [s]."""
    t, xyz = clip(path)
    gate = Gate(ISO, settings())
    later = samples(t, xyz)
    outside = []
    for stamp, points in zip(t, xyz, strict=True):
        gate.admit(report(float(stamp), ("a", points)), float(stamp))
        outside.append(first(gate, later, float(stamp), float(stamp) + horizon) is not None)
    return float(np.mean(outside))


@pytest.mark.real_data
def test_two_metres_a_second_do_not_cover_fast_arms_and_the_data_say_so(real_data: Path) -> None:
    share = {path.name: share_outside(path, 0.3) for path in clips(real_data / "human")}
    for name, value in share.items():
        if any(word in name for word in ("punch", "swordplay", "jump", "glitch")):
            assert value > 0.0, name
        if any(word in name for word in ("slow", "handover", "icl")):
            assert value == 0.0, name
