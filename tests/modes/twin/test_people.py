"""Scripted people: limbs keep their lengths, feet and hands their speeds, and a recording is what it was."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.twin.people import Person, Recorded, Stance, Standing, Walking
from occupancy.body import LIMBS, MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]

WALKING = Walking((1.0, -2.0), (1.4, 2.0), speed_m_s=1.0, start_s=0.5, floor_z_m=-0.8, stature_m=1.8)
WORKING = Standing(
    Stance(1.0, 0.2, 2.8, -0.8, 1.65),
    ((0.0, (0.8, 0.15, 0.25)), (1.5, (0.75, 0.3, 0.5)), (3.0, (-3.0, 0.0, 0.0)), (4.0, (1.0, 0.2, 0.6))),
)


def course(person: Person, end: float = 7.0, step: float = 0.01) -> Array:
    return np.array([person.at(t) for t in np.arange(0.0, end, step)])


@pytest.mark.parametrize("person", [WALKING, WORKING], ids=["walking", "working"])
def test_limbs_keep_their_lengths(person: Person) -> None:
    xyz = course(person)
    assert np.isfinite(xyz).all()
    for name, limbs in LIMBS.items():
        if name == "lower_trunk" or name == "upper_trunk":
            continue
        for a, b in limbs:
            length = np.linalg.norm(xyz[:, a] - xyz[:, b], axis=1)
            assert np.ptp(length) < 1e-9, (name, np.ptp(length))


def test_who_walks_at_a_metre_per_second_has_no_point_faster_than_two() -> None:
    xyz = course(WALKING)
    speed = np.linalg.norm(np.diff(xyz, axis=0), axis=2) / 0.01
    assert 1.3 < speed.max() < 2.0 * 1.8 / 1.75
    assert speed[:, Point.PELVIS].max() == pytest.approx(1.0, abs=1e-3)


def test_who_walks_rests_at_both_ends_and_faces_along_the_way() -> None:
    begin, end = WALKING.at(-1.0), WALKING.at(60.0)
    assert begin[Point.PELVIS, :2] == pytest.approx([1.0, -2.0])
    assert end[Point.PELVIS, :2] == pytest.approx([1.4, 2.0])
    assert np.allclose(WALKING.at(WALKING.start_s + WALKING.duration_s), end)
    way = np.array([0.4, 4.0, 0.0]) / np.hypot(0.4, 4.0)
    left = end[Point.L_SHOULDER] - end[Point.R_SHOULDER]
    assert left @ way == pytest.approx(0.0, abs=1e-9) and np.cross(way, left)[2] > 0.0
    assert end[Point.HEAD, 2] - (-0.8) == pytest.approx(1.62 * 1.8 / 1.75)


def test_feet_are_never_below_the_floor() -> None:
    for person in (WALKING, WORKING):
        assert (course(person)[:, [Point.L_ANKLE, Point.R_ANKLE], 2] > -0.8).all()


def test_a_hand_is_where_it_was_told_to_be_or_reaches_for_it() -> None:
    assert WORKING.at(0.0)[Point.R_WRIST] == pytest.approx([0.8, 0.15, 0.25], abs=1e-9)
    assert WORKING.at(1.5)[Point.R_WRIST] == pytest.approx([0.75, 0.3, 0.5], abs=1e-9)
    far = WORKING.at(3.0)
    away = np.array([-3.0, 0.0, 0.0]) - far[Point.R_SHOULDER]
    reached = far[Point.R_WRIST] - far[Point.R_SHOULDER]
    assert np.linalg.norm(np.cross(away, reached)) < 1e-9 and away @ reached > 0.0
    assert np.array_equal(WORKING.at(9.0), WORKING.at(4.0))


def test_a_hand_rests_where_it_is_told_to_be_and_moves_smoothly() -> None:
    t = np.arange(0.0, 1.5, 1e-3)
    hand = np.array([WORKING.at(each)[Point.R_WRIST] for each in t])
    speed = np.linalg.norm(np.diff(hand, axis=0), axis=1) / 1e-3
    assert speed[0] < 1e-2 and speed[-1] < 1e-2
    length = float(np.linalg.norm(np.array([0.05, 0.15, 0.25])))
    assert speed.max() == pytest.approx(15.0 / 8.0 * length / 1.5, rel=1e-3)  # of a minimum-jerk motion


def test_a_recording_is_straight_between_its_samples(rng: np.random.Generator) -> None:
    t, xyz = np.array([0.0, 0.5, 2.0]), rng.normal(size=(3, MAX_POINTS, 3))
    xyz[1, Point.HEAD] = np.nan
    person = Recorded(t, xyz, (1.0, 2.0, 3.0))
    for k in range(3):
        assert np.allclose(person.at(t[k]), xyz[k] + (1.0, 2.0, 3.0), equal_nan=True)
    middle = person.at(1.25)
    assert np.allclose(middle[1:], 0.5 * (xyz[1, 1:] + xyz[2, 1:]) + (1.0, 2.0, 3.0))
    assert np.isnan(middle[Point.HEAD]).all()
    assert np.allclose(person.at(-5.0), person.at(0.0)) and np.allclose(person.at(9.0), person.at(2.0))
    assert np.allclose(Recorded(t[:1], xyz[:1]).at(7.0), xyz[0])


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Stance(float("nan"), 0.0), "stance: x_m"),
        (lambda: Stance(0.0, 0.0, stature_m=3.0), "stature_m"),
        (lambda: Standing(Stance(0.0, 0.0), ((1.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 0.0)))), "increase"),
        (lambda: Standing(Stance(0.0, 0.0), ((1.0, (0.0, 0.0)),)), "standing: place 0"),  # type: ignore[arg-type]  # what is to be refused
        (lambda: Walking((0.0, 0.0), (0.1, 0.0)), "0.10 m are too short for 1 m/s: at least 0.60 m"),
        (lambda: Walking((0.0, 0.0), (5.0, 0.0), speed_m_s=0.0), "speed_m_s"),
        (lambda: Recorded(np.array([0.0, 0.0]), np.zeros((2, 20, 3))), "increase"),
        (
            lambda: Recorded(np.array([0.0, 1.0]), np.zeros((2, 14, 3))),
            r"\(2, 14, 3\) should be \(T, 20, 3\)",
        ),
        (lambda: Walking((2000.0, 0.0), (0.0, 0.0)), "stance: x_m = 2000"),
        (lambda: Walking((0.0, 0.0), (5.0, 0.0), stature_m=3.0), "stature_m"),
        (lambda: Walking((0.0, 0.0), (5.0, 0.0), floor_z_m=float("nan")), "floor_z_m"),
        (lambda: Standing((0.0, 0.0)), "standing: stance"),  # type: ignore[arg-type]  # what is to be refused
        (lambda: Recorded(np.array([0.0]), np.zeros((1, 20, 3)), (0.0, float("nan"), 0.0)), "place"),
        (lambda: Recorded([0.0], [[0.0]]), r"\(1, 1\) should be"),  # type: ignore[arg-type]  # what is to be refused
        (lambda: Recorded(np.zeros(0), np.zeros((0, 20, 3))), "at least one"),
    ],
)
def test_what_is_nobody_is_refused_by_name(make: object, named: str) -> None:
    assert callable(make)
    with pytest.raises(SetupError, match=named):
        make()
