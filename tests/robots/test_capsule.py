"""Fitted capsules contain what they were fitted around, and are small."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.capsule import (
    SLACK,
    Capsule,
    _along,
    _directions,
    _farthest,
    _is_near,
    _margin,
    _margin_gradient,
    _optimise,
    _solve,
    _volume,
    _volume_gradient,
    extreme_balls,
    fit_capsule,
    rough_volume,
)
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
        np.array([[0, 0, 0, 0.1], [0, 1, 0, -0.1]]),
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
    for _ in range(count(10_000)):
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
    for _ in range(count(1_000)):
        balls = random_cloud(rng)
        capsule = fit_capsule(balls)
        assert capsule.contains(balls)
        assert max(distance_to_segment(capsule.a, capsule.b, x[:3]) + x[3] for x in balls) <= capsule.radius
        assert not Capsule(capsule.a, capsule.b, capsule.radius - 3 * SLACK).contains(balls)


def test_points_on_a_capsule_give_that_capsule_back(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(300)):
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


# What the fit is made of


def test_half_of_the_slack_is_left_for_rounding() -> None:
    balls = points((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    for slack, contained in ((0.4, False), (0.6, True), (-0.6, False), (1.0, True)):
        assert Capsule(np.zeros(3), np.zeros(3), 1.0 + slack * SLACK).contains(balls) is contained
    assert Capsule(np.zeros(3), np.zeros(3), 0.5 * SLACK).contains(points((0.0, 0.0, 0.0)))


def test_the_largest_coordinate_that_proves_something_is_a_thousand_metres() -> None:
    inside, zero = points((0.0, 0.0, 0.0)), np.zeros(3)
    for size, contained in ((1000.0, True), (-1000.0, True), (1000.001, False), (-1000.001, False)):
        end = np.array([0.0, size, 0.0])
        assert Capsule(zero, end, 1.0).contains(inside) is contained
        assert Capsule(end, zero, 1.0).contains(inside) is contained
        assert Capsule(zero, end, 2.0).contains(points(end)) is contained
    assert Capsule(zero, zero, 1000.0).contains(inside)
    assert not Capsule(zero, zero, 1000.001).contains(inside)


def one_shape_many_ways(rng: np.random.Generator) -> tuple[Array, Array]:
    """Balls, and a candidate (a, b, radius) that may or may not hold them."""
    balls = np.column_stack([rng.normal(size=(30, 3)), rng.uniform(0, 0.3, 30)])
    return balls, np.concatenate([rng.normal(size=6), rng.uniform(0.1, 2.0, 1)])


def slope(function: Callable[[Array], Array], x: Array) -> Array:
    """(values, 7) by central differences."""
    step = 1e-6
    columns = [(function(x + step * e) - function(x - step * e)) / (2.0 * step) for e in np.eye(7)]
    return np.column_stack([np.atleast_1d(column) for column in columns])


def test_volume_and_margins_of_a_candidate_and_their_gradients(rng: np.random.Generator) -> None:
    for _ in range(20):
        balls, x = one_shape_many_ways(rng)
        candidate = Capsule(x[:3], x[3:6], x[6])
        assert _volume(x) == pytest.approx(candidate.volume, rel=1e-14)
        margins = [x[6] - distance_to_segment(x[:3], x[3:6], ball[:3]) - ball[3] for ball in balls]
        np.testing.assert_allclose(_margin(x, balls), margins, atol=1e-7)
        np.testing.assert_allclose(
            _volume_gradient(x), slope(lambda y: np.array(_volume(y)), x)[0], rtol=1e-5, atol=1e-6
        )
        np.testing.assert_allclose(
            _margin_gradient(x, balls), slope(lambda y, balls=balls: _margin(y, balls), x), atol=1e-4
        )
        number = int(rng.integers(1, 30))
        farthest = _farthest(x, balls, number)
        assert set(farthest) == set(np.argsort(margins)[:number])


def test_where_a_capsule_is_a_ball_gradients_are_finite() -> None:
    """Its axis has no direction, and a ball in its centre none either: no slope is claimed there."""
    x = np.array([0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0.5])
    expected = np.array([0, 0, 0, 0, 0, 0, 2.0 * np.pi * 0.5 * 2.0 * 0.5])
    np.testing.assert_allclose(_volume_gradient(x), expected)
    there = _margin_gradient(x, points((0.1, 0.2, 0.3), (0.1, 0.2, 0.8)))
    np.testing.assert_allclose(there, [[0, 0, 0, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0, 1]])
    tiny = x + np.array([0, 0, 0, 1e-9, 0, 0, 0])
    np.testing.assert_allclose(_volume_gradient(tiny)[[0, 3]], [-np.pi * 0.25, np.pi * 0.25], rtol=1e-6)


def test_a_capsule_along_a_direction_has_the_smallest_radius_around_the_middle_and_no_needless_length(
    rng: np.random.Generator,
) -> None:
    for _ in range(40):
        balls = random_cloud(rng)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        x = _along(direction, balls)
        a, b, radius = x[:3], x[3:6], x[6]
        capsule = Capsule(a, b, radius)
        assert capsule.excess(balls) == pytest.approx(0.0, abs=1e-12)
        assert np.linalg.norm(np.cross(b - a, direction)) < 1e-9, "the axis has the direction"
        off = balls[:, :3] - a
        off_axis = np.linalg.norm(off - (off @ direction)[:, None] * direction, axis=1)
        assert (off_axis + balls[:, 3]).max() <= radius + 1e-12
        length = np.linalg.norm(b - a)
        if length > 1e-6:
            assert radius == pytest.approx((off_axis + balls[:, 3]).max(), abs=1e-9)
            for end, inward in ((a, b - a), (b, a - b)):
                shorter = end + 1e-4 * inward / length
                assert Capsule(shorter, b if end is a else a, radius).excess(balls) > 1e-9


def test_the_middle_across_a_direction_is_that_of_the_box_around_the_centres() -> None:
    balls = points((0.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 4.0, 2.0), (0.0, 3.0, 1.0))
    x = _along(np.array([1.0, 0.0, 0.0]), balls)
    np.testing.assert_allclose(x, [0.0, 2.0, 1.0, 0.0, 2.0, 1.0, np.hypot(2.0, 1.0)], atol=1e-12)
    assert (0.1 + 0.2) - 0.2 > 0.1, "both of these seem to leave room for the other end"
    x = _along(np.array([1.0, 0.0, 0.0]), np.array([[5.0, 0.1, 0.0, 0.2], [5.0, -0.1, 0.0, 0.2]]))
    np.testing.assert_allclose(x, [5.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.3], atol=1e-12)


def test_starts_are_along_edges_diagonals_and_principal_axes(rng: np.random.Generator) -> None:
    cloud = rng.normal(size=(200, 3)) * [3.0, 2.0, 1.0] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = _directions(points(cloud + 5.0))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-14)
    covariance = np.cov(cloud.T)
    diagonals = [np.eye(3)[i] + sign * np.eye(3)[j] for i, j in ((0, 1), (0, 2), (1, 2)) for sign in (1, -1)]
    expected = [*np.linalg.eigh(covariance)[1].T, *np.eye(3), *(each / np.sqrt(2) for each in diagonals)]
    assert len(found) == len(expected) == 12
    np.testing.assert_allclose(np.abs(found @ np.array(expected).T).max(axis=0), 1.0, atol=1e-12)
    assert len(_directions(points((1.0, 2.0, 3.0)))) == 12
    two = _directions(points((1.0, 0.0, 0.0), (1.0, 3.0, 4.0)))
    np.testing.assert_allclose(np.abs(two[0]), [0.0, 0.6, 0.8], atol=1e-12)
    assert len(two) == 2 + 9, "as many principal axes as there are balls, at most three"


def test_the_rough_volume_is_that_of_the_best_start(rng: np.random.Generator) -> None:
    for _ in range(10):
        balls = random_cloud(rng)
        volumes = [_volume(_along(each, balls)) for each in _directions(balls)]
        assert rough_volume(balls) == pytest.approx(min(volumes), rel=1e-12)


def test_ends_within_twice_the_extent_of_the_balls_are_near() -> None:
    balls = np.array([[1.0, 0.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.25], [0.0, 0.0, 0.0, 0.0]])
    there = np.array([7.0, -8.0, 9.0])
    balls[:, :3] += there
    for y, near in ((0.0, True), (2.99, True), (3.0, True), (3.01, False), (-3.01, False), (np.nan, False)):
        end, other = there + np.array([0.0, y, 0.0]), there + np.array([0.0, 0.1, 0.0])
        assert _is_near(np.array([*end, *other, 1.0]), balls) is near
        assert _is_near(np.array([*other, *end, 1.0]), balls) is near


def test_an_improved_start_holds_all_balls_and_only_just_and_is_no_larger(rng: np.random.Generator) -> None:
    """Also those that were not in the first working set."""
    for number in (5, 40, 200):
        balls = np.column_stack([rng.normal(size=(number, 3)) * [1.0, 0.5, 0.2], rng.uniform(0, 0.1, number)])
        start = min((_along(each, balls) for each in _directions(balls)), key=_volume)
        found = _optimise(start.copy(), balls)
        assert _margin(found, balls).min() == pytest.approx(0.0, abs=1e-12)
        assert _volume(found) <= _volume(start)


def test_few_balls_at_a_time_give_what_all_of_them_together_give(rng: np.random.Generator) -> None:
    around = rng.normal(size=(400, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    balls = points(around * [0.6, 0.25, 0.2])
    start = _along(np.array([1.0, 0.0, 0.0]), balls)
    together = _solve(start.copy(), balls)
    assert _volume(_optimise(start.copy(), balls)) == pytest.approx(_volume(together), rel=1e-4)


@pytest.mark.parametrize(
    "lost",
    [
        [1e6, 0, 0, 1e6, 0.1, 0, 1e-9],
        [0.1, 0.1, 0.1, 1e6, 0, 0, 1e-9],
        [0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0.0],
        [0.1, 0.2, 0.3, 0.1, 0.2, 0.3, -0.1],
        [np.nan] * 7,
    ],
)
def test_where_the_optimiser_runs_away_the_best_start_is_taken(
    lost: list[float], rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    balls = np.column_stack([rng.normal(size=(40, 3)) * [0.5, 0.2, 0.1], rng.uniform(0, 0.05, 40)])
    monkeypatch.setattr("robots.capsule._optimise", lambda *_: np.array(lost, dtype=np.float64))
    fitted = fit_capsule(balls)
    assert fitted.contains(balls) and fitted.volume == pytest.approx(rough_volume(balls), rel=1e-6)


def test_one_of_five_starts_that_is_improved_is_enough(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    balls = np.column_stack([rng.normal(size=(40, 3)) * [0.5, 0.2, 0.1], rng.uniform(0, 0.05, 40)])
    best, answers = fit_capsule(balls), [np.full(7, np.nan)] * 4
    answers.insert(0, np.concatenate([best.a, best.b, [best.radius]]))
    monkeypatch.setattr("robots.capsule._optimise", lambda *_: answers.pop())
    assert fit_capsule(balls).volume == pytest.approx(best.volume, rel=1e-6)


def test_groups_of_up_to_eight_balls_are_kept_and_larger_ones_lose_what_is_inside() -> None:
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    assert len(extreme_balls(points(cube))) == 8
    middle = points(*cube[1:], (0.5, 0.5, 0.5))
    assert {tuple(x) for x in extreme_balls(middle)} == {tuple(x) for x in middle}
    full = extreme_balls(points(*cube, (0.5, 0.5, 0.5)))
    assert {tuple(x) for x in full} == {tuple(x) for x in points(*cube)}
    small = np.vstack([points(*cube, (0.5, 0.5, 0.5)), [[0.4, 0.5, 0.5, 0.1]]])
    assert {x[3] for x in extreme_balls(small)} == {0.0, 0.1}, "each radius for itself"
    twice = extreme_balls(points(*cube, *cube))
    assert len(twice) == 8
    flat = points(*(np.array([x, y, 0.0]) for x in range(3) for y in range(4)))
    assert len(extreme_balls(flat)) == 12
