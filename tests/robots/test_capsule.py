"""Fitted capsules contain what they were fitted around, and are small."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.capsule import SLACK, Capsule, extreme_balls, fit_capsule
from robots.errors import SetupError

Array = NDArray[np.float64]


@pytest.mark.parametrize(
    "balls",
    [
        np.empty((0, 4)),
        np.zeros((3, 3)),
        np.zeros(4),
        np.array([[0, 0, np.nan, 0.0]]),
        np.array([[0, 0, np.inf, 0.0]]),
        np.array([[0, 0, 0, -0.1]]),
        np.array([[0, 0, 0, np.nan]]),
    ],
)
def test_what_is_no_set_of_balls_is_refused(balls: Array) -> None:
    with pytest.raises(SetupError):
        fit_capsule(balls)


def points(*rows: object) -> Array:
    array = np.atleast_2d(np.array(rows, dtype=np.float64).reshape(-1, 3))
    return np.column_stack([array, np.zeros(len(array))])


def distance_to_segment(a: Array, b: Array, x: Array) -> float:
    """By golden-section search along the segment, without projecting."""
    low, high = 0.0, 1.0
    for _ in range(80):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        if np.linalg.norm(a + left * (b - a) - x) < np.linalg.norm(a + right * (b - a) - x):
            high = right
        else:
            low = left
    return float(np.linalg.norm(a + 0.5 * (low + high) * (b - a) - x))


def test_excess_is_the_largest_distance_minus_the_radius(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(20_000)):
        a, b = rng.normal(size=(2, 3))
        if rng.random() < 0.2:
            b = a.copy()
        balls = np.column_stack([rng.normal(size=(4, 3)), rng.uniform(0, 0.3, 4)])
        capsule = Capsule(a, b, 0.5)
        expected = max(distance_to_segment(a, b, ball[:3]) + ball[3] for ball in balls) - 0.5
        assert capsule.excess(balls) == pytest.approx(expected, abs=1e-7)
        assert capsule.contains(balls) == (expected <= -0.5 * SLACK)


def test_nothing_is_contained_where_a_number_is_missing() -> None:
    good = points((0, 0, 0))
    assert Capsule(np.zeros(3), np.ones(3), 1.0).contains(good)
    assert not Capsule(np.zeros(3), np.array([np.nan, 1, 1]), 1.0).contains(good)
    assert not Capsule(np.zeros(3), np.ones(3), np.nan).contains(good)
    assert not Capsule(np.zeros(3), np.ones(3), 1.0).contains(points((np.nan, 0, 0)))


def test_volume_of_a_ball_and_of_a_capsule() -> None:
    ball = Capsule(np.ones(3), np.ones(3), 0.5)
    assert ball.volume == pytest.approx(np.pi / 6)
    long = Capsule(np.zeros(3), np.array([0, 0, 2.0]), 0.5)
    assert long.volume == pytest.approx(np.pi / 6 + np.pi * 0.25 * 2.0)


def random_cloud(rng: np.random.Generator) -> Array:
    """Points, plane or line pieces, repeated points, balls of several radii."""
    n = int(rng.integers(1, 60))
    cloud = rng.normal(size=(n, 3)) * rng.choice([0.0, 1e-6, 0.01, 0.1, 1.0], 3) + rng.normal(size=3)
    if rng.random() < 0.2:
        cloud = np.repeat(cloud, 3, axis=0)
    radii = rng.choice([0.0, 0.0, 0.05, 0.2]) * np.ones(len(cloud))
    if rng.random() < 0.3:
        radii = rng.uniform(0, 0.3, len(cloud))
    return np.column_stack([cloud, radii])


def test_every_fitted_capsule_contains_its_balls(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(3_000)):
        balls = random_cloud(rng)
        capsule = fit_capsule(balls)
        assert capsule.contains(balls)
        assert max(distance_to_segment(capsule.a, capsule.b, x[:3]) + x[3] for x in balls) <= capsule.radius
        assert not Capsule(capsule.a, capsule.b, capsule.radius - 3 * SLACK).contains(balls)


def test_points_on_a_capsule_give_that_capsule_back(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(1_000)):
        a, b = rng.uniform(-0.5, 0.5, (2, 3))
        radius = rng.uniform(0.03, 0.3)
        around = rng.normal(size=(600, 3))
        around *= radius / np.linalg.norm(around, axis=1)[:, None]
        truth = Capsule(a, b, radius)
        fitted = fit_capsule(points(np.vstack([a + around, b + around])))
        assert fitted.volume <= 1.001 * truth.volume
        assert fitted.volume >= 0.9 * truth.volume, "600 points a cap cannot leave that much room"


def test_a_long_box_gets_the_capsule_through_its_corners() -> None:
    """1 x 0.1 x 0.1 m: by symmetry the axis is the long one; the best radius is found by a fine scan."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    lever = np.hypot(0.05, 0.05)
    radius = np.linspace(lever, 3 * lever, 200_001)
    half = np.maximum(0.5 - np.sqrt(radius**2 - lever**2), 0.0)
    best = (np.pi * radius**2 * (2 * half + 4 / 3 * radius)).min()
    assert fit_capsule(points(corners)).volume == pytest.approx(best, rel=1e-4)


def test_a_ball_needs_no_more_than_itself() -> None:
    fitted = fit_capsule(np.array([[1.0, 2.0, 3.0, 0.4]]))
    assert fitted.radius == pytest.approx(0.4, abs=2e-9)
    np.testing.assert_allclose([fitted.a, fitted.b], [[1, 2, 3]] * 2, atol=1e-9)


def test_extreme_balls_keep_the_hull(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    for _ in range(count(2_000)):
        balls = random_cloud(rng)
        kept = extreme_balls(balls)
        assert {tuple(row) for row in kept} <= {tuple(row) for row in balls}
        directions = rng.normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        support, less = ((b[:, :3] @ directions.T + b[:, 3:]).max(axis=0) for b in (balls, kept))
        np.testing.assert_allclose(less, support, atol=1e-9)


def test_fits_are_repeatable() -> None:
    balls = points(np.random.default_rng(5).normal(size=(200, 3)))
    first, second = fit_capsule(balls), fit_capsule(balls)
    assert all((x == y).all() for x, y in pairwise([first.a, second.a]))
    assert first.radius == second.radius


@pytest.mark.parametrize("huge", [1e4, 1e153, np.inf, np.nan])
def test_nothing_is_proven_by_huge_numbers(huge: float) -> None:
    """Distances to an axis of 1e153 m round to anything."""
    balls = np.array([[0.0, 0.0, 0.0, 0.1], [0.3, 0.0, 0.0, 0.1]])
    end = np.array([huge, 0.0, 0.0])
    assert not Capsule(-end, end, 1.0).contains(balls)
    assert not Capsule(np.zeros(3), np.zeros(3), huge).contains(balls)
    assert not Capsule(np.zeros(3), np.zeros(3), 1.0).contains(np.vstack([balls, [huge, 0.0, 0.0, 0.0]]))
