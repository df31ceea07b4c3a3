"""Danger indices against a direct search for the touching scale, GJK, and the definition in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from modes.speed.danger_index import (
    Ellipsoids,
    danger_index,
    index_of,
    pair_quadratics,
    spheroid,
    surface_gap,
)
from robots.errors import SetupError

Array = NDArray[np.float64]
Count = Callable[[int], int]


def some_ellipsoids(rng: np.random.Generator, n: int, spread: float = 0.5) -> Ellipsoids:
    turns = Rotation.random(n, random_state=int(rng.integers(2**31))).as_matrix()
    return Ellipsoids(rng.uniform(-spread, spread, (n, 3)), rng.uniform(0.03, 0.3, (n, 3)), turns)


def on_surface(those: Ellipsoids, i: int, n: int, rng: np.random.Generator, scale: float = 1.0) -> Array:
    """Points (n, 3) of the surface of an ellipsoid that is scaled about its centre."""
    ball = rng.normal(size=(n, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    return those.centre[i] + scale * (ball * those.semi_axes[i]) @ those.rotation[i].T


def inverse_shape(those: Ellipsoids, i: int) -> Array:
    turn = those.rotation[i]
    return turn @ np.diag(those.semi_axes[i] ** -2.0) @ turn.T


def touching_scale(robot: Ellipsoids, body: Ellipsoids) -> float:
    """The factor by which both must grow to touch: the least of the larger of two gauges over all points."""
    shapes = inverse_shape(robot, 0), inverse_shape(body, 0)
    centres = robot.centre[0], body.centre[0]

    def gauge(x: Array, k: int) -> float:
        return float((x - centres[k]) @ shapes[k] @ (x - centres[k]))

    constraints = [
        {
            "type": "ineq",
            "fun": lambda x, k=k: x[3] - gauge(x[:3], k),
            "jac": lambda x, k=k: np.append(-2.0 * shapes[k] @ (x[:3] - centres[k]), 1.0),
        }
        for k in (0, 1)
    ]
    middle = 0.5 * (centres[0] + centres[1])
    start = np.append(middle, max(gauge(middle, 0), gauge(middle, 1)))
    found = minimize(
        lambda x: x[3], start, jac=lambda x: np.array([0.0, 0.0, 0.0, 1.0]), constraints=constraints,
        method="SLSQP", options={"ftol": 1e-14, "maxiter": 500},
    )  # fmt: skip
    return float(np.sqrt(found.x[3]))


def test_the_exact_index_is_that_of_the_touching_scale(rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(2_000)):
        robot, body = some_ellipsoids(rng, 1), some_ellipsoids(rng, 1)
        assert danger_index(robot, body, "exact")[0, 0] == pytest.approx(
            touching_scale(robot, body) ** -2.0, rel=2e-5
        )


def test_the_exact_index_is_below_one_just_where_gjk_finds_a_gap(
    rng: np.random.Generator, count: Count
) -> None:
    seen = {True: 0, False: 0}
    for _ in range(count(5_000)):
        robot, body = some_ellipsoids(rng, 3), some_ellipsoids(rng, 4)
        index, gap = danger_index(robot, body, "exact"), surface_gap(robot, body)
        told = np.abs(gap) > 1e-3
        assert ((index < 1.0) == (gap > 0.0))[told].all()
        for apart in (True, False):
            seen[apart] += int(((gap > 0.0) == apart)[told].sum())
    assert min(seen.values()) > 10


def test_for_balls_both_indices_are_the_papers_quotient(rng: np.random.Generator) -> None:
    """F = |d|² / (r + r')², (5) to (7)."""
    a, b = rng.uniform(-1, 1, (5, 3)), rng.uniform(-1, 1, (4, 3))
    expected = (0.07 + 0.05) ** 2 / ((a[:, None] - b[None]) ** 2).sum(axis=2)
    for index in ("transformed", "exact"):
        found = danger_index(Ellipsoids.balls(a, 0.07), Ellipsoids.balls(b, 0.05), index)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def by_definition(robot: Ellipsoids, body: Ellipsoids) -> Array:
    """The transformed index in NumPy: singular values of the image of the robot's ellipsoid, each plus 1."""
    out = np.empty((len(robot), len(body)))
    for i in range(len(robot)):
        for j in range(len(body)):
            turn = body.rotation[j]
            to_ball = turn @ np.diag(1.0 / body.semi_axes[j]) @ turn.T
            u, s, _ = np.linalg.svd(to_ball @ robot.rotation[i] @ np.diag(robot.semi_axes[i]))
            away = u.T @ to_ball @ (body.centre[j] - robot.centre[i])
            out[i, j] = 1.0 / ((away / (s + 1.0)) ** 2).sum()
    return out


def test_the_transformed_index_is_its_definition(rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(2_000)):
        robot, body = some_ellipsoids(rng, 2), some_ellipsoids(rng, 3)
        np.testing.assert_allclose(danger_index(robot, body), by_definition(robot, body), rtol=1e-9)


def test_the_transformed_index_misses_contacts_and_invents_none(
    rng: np.random.Generator, count: Count
) -> None:
    """The lengthened ellipsoid lies inside the sum: √Σ(σ+1)²n² is at most √Σσ²n² + 1."""
    missed = 0
    for _ in range(count(10_000)):
        robot, body = some_ellipsoids(rng, 8), some_ellipsoids(rng, 8)
        index, exact = danger_index(robot, body), danger_index(robot, body, "exact")
        assert not ((index > 1.0 + 1e-9) & (exact < 1.0 - 1e-9)).any()
        missed += int(((index < 1.0) & (exact > 1.0)).sum())
    assert missed > 0


@pytest.mark.parametrize("index", ["transformed", "exact"])
def test_quadratics_are_the_index_at_each_speed(index: str, rng: np.random.Generator, count: Count) -> None:
    """The transformed one everywhere; the exact one where it was asked for, and nowhere above the true F."""
    for _ in range(count(500)):
        robot, body = some_ellipsoids(rng, 2), some_ellipsoids(rng, 2)
        per_speed, at = rng.uniform(-1, 1, (2, 3)), float(rng.uniform(-0.5, 0.5))
        pairs = pair_quadratics(robot, per_speed, body, at, index)
        for v in (at, *rng.uniform(-0.5, 0.5, 3)):
            true = danger_index(robot.moved(v * per_speed), body, index).ravel()
            found = index_of(pairs, v)
            if index == "transformed" or v == at:
                np.testing.assert_allclose(found, true, rtol=1e-6)
            else:
                assert (found >= true * (1.0 - 1e-9)).all()


def test_centres_that_coincide_at_a_speed_are_apart_at_others() -> None:
    ball = Ellipsoids.balls(np.zeros((1, 3)), 0.05)
    pairs = pair_quadratics(ball, np.array([[0.1, 0.0, 0.0]]), ball, 0.0, "exact")
    assert index_of(pairs, 10.0)[0] == pytest.approx(0.01) and index_of(pairs, 0.0)[0] == np.inf


def test_spheroids_contain_their_capsules(rng: np.random.Generator) -> None:
    n = 20
    a, b, radius = rng.uniform(-1, 1, (n, 3)), rng.uniform(-1, 1, (n, 3)), rng.uniform(0.02, 0.4, n)
    b[0] = a[0]
    those = Ellipsoids.around_capsules(a, b, radius)
    for i in range(n):
        ball = rng.normal(size=(2000, 3))
        ball *= radius[i] / np.linalg.norm(ball, axis=1)[:, None]
        points = a[i] + rng.choice([0.0, 1.0], (2000, 1)) * (b[i] - a[i]) + ball - those.centre[i]
        gauge = np.einsum("ni,ij,nj->n", points, inverse_shape(those, i), points)
        assert gauge.max() <= 1.0 + 1e-9
    assert those.semi_axes[0] == pytest.approx(np.full(3, radius[0]))


def test_spheroids_are_near_the_smallest_that_contain(rng: np.random.Generator) -> None:
    """Against the exact volume over u, minimised by a fine grid."""
    half, radius = rng.uniform(0.01, 0.5, 50), rng.uniform(0.02, 0.3, 50)
    along, across = spheroid(half, radius)
    u = np.geomspace(1e-5, 1.0, 20_000)[:, None]
    b2 = radius**2 + u * radius * half
    best = ((b2 + half**2 + radius * half / u) ** 0.5 * b2).min(axis=0)
    assert (along * across**2 <= 1.01 * best).all() and (along * across**2 >= best * (1 - 1e-9)).all()


def test_gaps_are_distances_between_surfaces(rng: np.random.Generator, count: Count) -> None:
    """Against points of both surfaces: none nearer, and some nearly as near."""
    for _ in range(count(500)):
        robot = some_ellipsoids(rng, 1)
        body = some_ellipsoids(rng, 1).moved(np.array([[1.5, 0.0, 0.0]]))
        gap = float(surface_gap(robot, body)[0, 0])
        x, y = on_surface(robot, 0, 1500, rng), on_surface(body, 0, 1500, rng)
        nearest = np.linalg.norm(x[:, None] - y, axis=2).min()
        assert -1e-6 <= nearest - gap < 0.05


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"centre": np.zeros((2, 3))}, "shapes"),
        ({"centre": np.full((1, 3), np.nan)}, "centre has a number that is not finite"),
        ({"semi_axes": np.array([[0.1, 0.0, 0.1]])}, "a semi-axis of 0 m should be above 0"),
        ({"rotation": 2.0 * np.eye(3)[None]}, "no rotation matrix"),
    ],
)
def test_bad_ellipsoids_are_refused(change: dict[str, Array], text: str) -> None:
    good = {"centre": np.zeros((1, 3)), "semi_axes": np.full((1, 3), 0.1), "rotation": np.eye(3)[None]}
    with pytest.raises(SetupError, match=text):
        Ellipsoids(**(good | change))


def test_an_unknown_index_is_refused() -> None:
    ball = Ellipsoids.balls(np.zeros((1, 3)), 0.1)
    with pytest.raises(SetupError, match="danger index 'euclid': known are transformed, exact"):
        danger_index(ball, ball, "euclid")


def test_centres_that_coincide_are_infinitely_dangerous() -> None:
    ball = Ellipsoids.balls(np.zeros((1, 3)), 0.1)
    assert danger_index(ball, ball)[0, 0] == np.inf == danger_index(ball, ball, "exact")[0, 0]
