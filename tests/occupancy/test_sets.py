"""Sets as values: invalid input first, then inclusion against sampled points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from occupancy.sets import (
    Ball,
    Capsule,
    SetError,
    SphereSweptVolume,
    distance_to_hull,
    enclose,
    nearest_weights,
)
from tests.oracles.hulls import exact_point_distance, pad, point_distance
from tests.oracles.optimal import hull_distance

Array = NDArray[np.float64]
Count = Callable[[int], int]


@pytest.mark.parametrize(
    ("points", "radius", "message"),
    [
        ([[np.nan, 0, 0]], 0.1, "finite"),
        ([[np.inf, 0, 0]], 0.1, "finite"),
        ([[0, 0, 0]], -0.1, "radius"),
        ([[0, 0, 0]], np.nan, "radius"),
        ([[0, 0, 0]], np.inf, "radius"),
        (np.zeros((0, 3)), 0.1, "points of shape"),
        ([[0, 0]], 0.1, "points of shape"),
        ([0, 0, 0], 0.1, "points of shape"),
    ],
)
def test_sets_that_are_refused(points: object, radius: float, message: str) -> None:
    with pytest.raises(SetError, match=message):
        SphereSweptVolume(points, radius)


def test_other_refusals() -> None:
    with pytest.raises(SetError, match="ball has 1 point"):
        Ball(np.zeros((2, 3)), 0.1)
    with pytest.raises(SetError, match="capsule has 2 points"):
        Capsule(np.zeros((3, 3)), 0.1)
    with pytest.raises(SetError, match="nothing to enclose"):
        enclose()
    for by in (-0.1, np.nan, np.inf):
        with pytest.raises(SetError, match="inflated"):
            Ball.at([0, 0, 0], 0.1).inflate(by)


def test_values_cannot_be_changed() -> None:
    points = np.zeros((1, 3))
    ball = Ball(points, 0.1)
    points[:] = 5.0
    assert not ball.points.any()
    with pytest.raises(ValueError, match="read-only"):
        ball.points[0, 0] = 1.0


def test_distance_to_hull(rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(20_000)):
        points = rng.normal(size=(int(rng.integers(1, 5)), 3))
        p = rng.normal(size=3) * rng.choice([0.1, 1.0, 10.0])
        assert distance_to_hull(points, p) == pytest.approx(float(point_distance(p, pad(points))), abs=1e-9)


def cloud(rng: np.random.Generator, n: int, kind: str) -> Array:
    points = rng.normal(size=(n, 3))
    if kind == "flat":
        points[:, 2] = 0.0
    elif kind == "line":
        points[:, 1:] = 0.0
    elif kind == "repeated":
        points = points[rng.integers(0, 3, n) % n]
    elif kind == "thin":
        points *= [1.0, 1e-6, 1e-9]
    elif kind == "far":
        points += 1e3
    return points


@pytest.mark.parametrize("kind", ["random", "flat", "line", "repeated", "thin", "far"])
def test_distance_to_hulls_of_many_points(kind: str, rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(4_000)):
        points = cloud(rng, int(rng.integers(1, 121)), kind)
        beside = rng.normal(size=3) * rng.choice([0.0, 1e-9, 0.1, 1.0, 10.0])
        p = points[rng.integers(len(points))] + beside
        exact = hull_distance(p[None], points)
        assert distance_to_hull(points, p) == pytest.approx(exact, abs=2e-9)


@pytest.mark.parametrize("kind", ["random", "flat", "line", "repeated", "thin"])
def test_distance_to_hulls_in_rational_numbers(kind: str, rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(300)):
        points = cloud(rng, int(rng.integers(1, 10)), kind)
        p = rng.normal(size=3) * rng.choice([0.1, 1.0, 10.0])
        assert distance_to_hull(points, p) == pytest.approx(
            exact_point_distance(p, points), abs=1e-14, rel=1e-13
        )


@pytest.mark.parametrize("seed", [554, 1179, 2862])
def test_distance_to_hulls_for_which_least_squares_are_wrong(seed: int) -> None:
    """Off a corner along the normal of its facet, the corner is nearest. ``nnls`` of scipy 1.17 says 0.639,
    0.152 and 0.111 m for one such point of each of these hulls."""
    points = np.random.default_rng(seed).normal(size=(32, 3))
    hull = ConvexHull(points)
    for corners, plane in zip(hull.simplices, hull.equations, strict=True):
        for corner in corners:
            assert distance_to_hull(points, points[corner] + 0.1 * plane[:3]) == pytest.approx(0.1, abs=1e-13)


@pytest.mark.parametrize("n", [1, 2, 5, 32, 1_000])
def test_weights_make_a_point_of_the_hull_that_none_beats(
    n: int, rng: np.random.Generator, count: Count
) -> None:
    for _ in range(count(1_000)):
        points = rng.normal(size=(n, 3)) + rng.normal(size=3) * rng.choice([0.0, 1.0, 10.0])
        weights = nearest_weights(points)
        nearest = weights @ points
        assert (weights >= 0.0).all() and weights.sum() == pytest.approx(1.0, abs=1e-15)
        assert np.count_nonzero(weights) <= 4
        assert (points @ nearest).min() >= nearest @ nearest - 1e-13 * np.abs(points).max() ** 2


def test_differences_that_are_not_finite_are_infinitely_far() -> None:
    points = np.array([[1.5e308, 0.0, 0.0], [1.5e308, 1.0, 0.0]])
    assert distance_to_hull(points, [-1.5e308, 0.0, 0.0]) == np.inf
    assert not SphereSweptVolume(points, 0.1).contains([-1.5e308, 0.0, 0.0])


def test_a_point_of_the_hull_has_no_distance() -> None:
    assert distance_to_hull(np.array([[1.0, 2, 3]]), [1, 2, 3]) == 0.0
    assert distance_to_hull(np.array([[0.0, 0, 0], [2, 0, 0]]), [1, 0, 0]) < 1e-15


@pytest.mark.parametrize("p", [[np.nan, 0, 0], [np.inf, 0, 0]])
def test_no_set_contains_what_is_not_a_number(p: list[float]) -> None:
    ball = Ball.at([0, 0, 0], 1e9)
    assert not ball.contains(p) and ball.excess(p) == np.inf


def random_set(rng: np.random.Generator) -> SphereSweptVolume:
    return SphereSweptVolume(rng.normal(size=(int(rng.integers(1, 6)), 3)), float(rng.uniform(0, 0.5)))


def sample(volume: SphereSweptVolume, rng: np.random.Generator, n: int) -> Array:
    weights = rng.dirichlet(np.full(len(volume.points), 0.3), n)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points: Array = weights @ volume.points + volume.radius * direction
    return points


def test_inclusion_is_never_claimed_wrongly(rng: np.random.Generator, count: Count) -> None:
    claimed = 0
    for _ in range(count(20_000)):
        outer, inner = random_set(rng), random_set(rng)
        if rng.random() < 0.5:
            inner = SphereSweptVolume(inner.points * 0.1, inner.radius * 0.3)
        if outer.contains(inner):
            claimed += 1
            for p in sample(inner, rng, 20):
                assert outer.contains(p)
    assert claimed > 0


def test_inclusion_is_found_where_the_larger_ball_is_outside(rng: np.random.Generator, count: Count) -> None:
    """Exact for r <= R: growing a subset of the hull to just under and just over the room left."""
    for _ in range(count(10_000)):
        outer = random_set(rng)
        weights = rng.dirichlet(np.ones(len(outer.points)), 3)
        radius = outer.radius * float(rng.uniform())
        inner = SphereSweptVolume(weights @ outer.points, radius)
        assert outer.contains(inner)
        far = outer.points[np.argmax(outer.points[:, 0])] + [outer.radius - radius + 1e-6, 0, 0]
        assert not outer.contains(Ball.at(far, radius))


def test_enclose_and_inflate(rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(5_000)):
        a, b = random_set(rng), random_set(rng)
        both = enclose(a, b)
        assert both.contains(a) and both.contains(b)
        for p in sample(a, rng, 5):
            assert both.contains(p)
        assert a.inflate(0.1).contains(a) and not a.contains(a.inflate(0.1))
    assert isinstance(Ball.at([0, 0, 0], 0.1).inflate(0.2), Ball)


def test_balls_and_capsules() -> None:
    ball, capsule = Ball.at([1, 2, 3], 0.5), Capsule.between([0, 0, 0], [1, 0, 0], 0.2)
    np.testing.assert_array_equal(ball.centre, [1, 2, 3])
    assert capsule.contains([0.5, 0.2, 0.0]) and not capsule.contains([0.5, 0.21, 0.0])
    assert capsule.excess([0.5, 0.5, 0.0]) == pytest.approx(0.3)
    assert capsule.contains(Ball.at([0.3, 0, 0], 0.2)) and not capsule.contains(Ball.at([0.3, 0, 0], 0.21))


def test_a_set_without_room_contains_itself_and_nothing_more() -> None:
    point = Ball.at([1, 2, 3], 0.0)
    assert point.inflate(0.0).radius == 0.0
    assert point.contains(point, 0.0) and point.contains([1, 2, 3], 0.0)
    assert not point.contains(Ball.at([1, 2, 3], 1e-12), 0.0) and not point.contains([1, 2, 3.001], 0.0)
    ball = Ball.at([0, 0, 0], 0.5)
    assert ball.contains([0.5, 0, 0], 0.0) and ball.contains(Ball.at([0.25, 0, 0], 0.25), 0.0)
    assert ball.contains([0.625, 0, 0], 0.125) and not ball.contains([0.625, 0, 0], 0.12)
