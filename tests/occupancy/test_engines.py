"""Engines on large sets: from 33 points on a fan of faces leads coal astray, and this is worked around."""

from __future__ import annotations

from collections.abc import Callable

import coal
import fcl
import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy import kernels
from occupancy.engines import MOST_POINTS, CoalEngine, Engine, FclEngine, _coal_convex, _fcl_convex
from tests.oracles.optimal import hull_distance

Array = NDArray[np.float64]
Count = Callable[[int], int]
ENGINES = [CoalEngine(), FclEngine()]


def cloud(rng: np.random.Generator, n: int, kind: str) -> Array:
    points = rng.normal(size=(n, 3))
    if kind == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    elif kind == "flat":
        points[:, 2] = 0.0
    elif kind == "line":
        points[:, 1:] = 0.0
    elif kind == "repeated":
        points = points[rng.integers(0, 3, n)]
    return points


def fan_distance_of_coal(a: Array, b: Array) -> float:
    """What coal says about sets that are given whole, with faces as a fan."""
    identity, result = coal.Transform3s.Identity(), coal.DistanceResult()
    request = coal.DistanceRequest()
    return float(coal.distance(_coal_convex(a), identity, _coal_convex(b), identity, request, result))


def fan_distance_of_fcl(a: Array, b: Array) -> float:
    return float(fcl.distance(_fcl_convex(a), _fcl_convex(b), fcl.DistanceRequest(), fcl.DistanceResult()))


def worst_fan_error(rng: np.random.Generator, n: int, ask: Callable[[Array, Array], float]) -> float:
    worst = 0.0
    for _ in range(60):
        a = cloud(rng, n, "sphere") @ np.diag([1.0, 0.5, 0.2])
        b = cloud(rng, 4, "random") * 0.1 + [2.5, 0.5, 0.3]
        worst = max(worst, abs(ask(a, b) - hull_distance(a, b)))
    return worst


def test_the_trap_is_still_there(rng: np.random.Generator) -> None:
    """If this fails, coal has changed, and ``MOST_POINTS`` can go."""
    assert worst_fan_error(rng, 32, fan_distance_of_coal) < 1e-4
    assert worst_fan_error(rng, 33, fan_distance_of_coal) > 1e-2
    assert MOST_POINTS == 32


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
@pytest.mark.parametrize("kind", ["random", "sphere", "flat", "line", "repeated"])
def test_large_sets(engine: Engine, kind: str, rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(1_000)):
        n, m = (int(x) for x in rng.integers(33, 120, 2))
        a, b = cloud(rng, n, kind), cloud(rng, m, str(rng.choice([kind, "sphere"])))
        b = b + rng.normal(size=3) * 4
        exact = hull_distance(a, b)
        direction, distance = engine.propose(a, b)
        assert max(0.0, distance) == pytest.approx(exact, abs=1e-3 * (1 + exact))
        if exact > 1e-3:
            certified = kernels.certificate(a, n, b, m, *(direction / np.linalg.norm(direction)))[0]
            assert certified <= exact + 1e-12
            assert certified >= exact - 5e-3 * (1 + exact)


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_direction_points_from_the_first_to_the_second(engine: Engine) -> None:
    for n, m in ((1, 1), (1, 2), (2, 1), (2, 2), (3, 4), (4, 4), (33, 40)):
        a, b = np.zeros((n, 3)), np.zeros((m, 3))
        a[:, 1], b[:, 1] = np.linspace(0, 1, n), np.linspace(0, 1, m)
        direction, distance = engine.propose(a, b + np.array([2.0, 0.0, 0.0]))
        assert distance == pytest.approx(2.0, abs=1e-6)
        np.testing.assert_allclose(direction / np.linalg.norm(direction), [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_sets_that_meet_have_no_positive_distance(engine: Engine, rng: np.random.Generator) -> None:
    for n in (1, 2, 3, 4, 40):
        a = cloud(rng, n, "sphere")
        weights = rng.dirichlet(np.ones(n))
        assert engine.propose(a, np.vstack([weights @ a, rng.normal(size=(3, 3)) + 5]))[1] <= 1e-6
