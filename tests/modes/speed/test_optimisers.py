"""The exact optimiser against a dense search; the genetic algorithm against the exact optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.speed.exact import exact_speed
from modes.speed.genetic import GeneticSettings, evolve
from modes.speed.objective import Goal, Weights
from modes.speed.simulations import Choice, run, simulation
from robots.errors import SetupError

Array = NDArray[np.float64]
Count = Callable[[int], int]


def some_goal(rng: np.random.Generator) -> Goal:
    programmed = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.3))
    weights = Weights(*(10.0 ** rng.uniform(-1, 2, 3)))
    cap = float(rng.uniform(0.1, 0.5))
    return Goal(programmed, float(rng.uniform(-cap, cap)), cap, weights)


def some_pairs(rng: np.random.Generator, n: int) -> Array:
    """Quadratics of centres at ``d - v t`` in the metric of balls: F is never below 0."""
    d, t = rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(-0.5, 0.5, (n, 3))
    t[rng.random(n) < 0.1] = 0.0
    radius = rng.uniform(0.05, 0.25, n)
    return np.column_stack(((d * d).sum(1), -2 * (d * t).sum(1), (t * t).sum(1))) / radius[:, None] ** 2


def value(pairs: Array, goal: Goal, v: Array) -> Array:
    """(12) in NumPy, of speeds (N,)."""
    w = goal.weights
    bare = w.closeness * (v - goal.programmed) ** 2 + w.smoothness * (v - goal.previous) ** 2
    bare /= goal.programmed**2
    if not len(pairs):
        return bare
    f = np.maximum(pairs[:, 0, None] + v * (pairs[:, 1, None] + v * pairs[:, 2, None]), 0.0).min(axis=0)
    with np.errstate(divide="ignore"):
        return bare + np.where(f > 1.0, 0.0, w.penalty / f**2)


def test_no_speed_is_better_than_the_exact_one(rng: np.random.Generator, count: Count) -> None:
    touching = 0
    for _ in range(count(20_000)):
        goal, pairs = some_goal(rng), some_pairs(rng, int(rng.integers(1, 24)))
        v = exact_speed(pairs, goal)
        assert -goal.cap <= v <= goal.cap
        best = float(value(pairs, goal, np.array([v]))[0])
        grid = value(pairs, goal, np.linspace(-goal.cap, goal.cap, 4001))
        assert best <= grid.min() + 1e-9 * max(1.0, grid.min())
        touching += best >= goal.weights.penalty
    assert touching > 0


def test_centres_that_go_through_each_other_at_one_speed(rng: np.random.Generator, count: Count) -> None:
    """All F are 0 at one speed and cross nowhere else: rounding must not decide which is the lowest."""
    for _ in range(max(300, count(5_000))):
        goal, n = some_goal(rng), int(rng.integers(10, 40))
        t, radius, at = rng.uniform(-0.5, 0.5, (n, 3)), rng.uniform(0.02, 0.4, n), rng.uniform(-0.2, 0.2)
        c2 = (t * t).sum(1) / radius**2
        pairs = np.column_stack((c2 * at * at, -2.0 * c2 * at, c2))
        v = exact_speed(pairs, goal)
        grid = value(pairs, goal, np.linspace(-goal.cap, goal.cap, 401)).min()
        assert goal.value(pairs, v) <= grid * (1.0 + 1e-7)


def test_without_anybody_the_exact_speed_is_the_closed_form(rng: np.random.Generator) -> None:
    for _ in range(100):
        goal = some_goal(rng)
        w = goal.weights
        middle = w.closeness * goal.programmed + w.smoothness * goal.previous
        middle /= w.closeness + w.smoothness
        expected = min(max(middle, -goal.cap), goal.cap)
        assert exact_speed(np.empty((0, 3)), goal) == pytest.approx(expected, abs=1e-15)


def test_the_end_of_a_free_interval_is_hit_from_outside() -> None:
    """One ball in the way: F = ((0.2 - v) / 0.1)², touched from v = 0.1 on."""
    pairs = np.array([[4.0, -40.0, 100.0]])
    v = exact_speed(pairs, Goal(0.2, 0.2, 0.25))
    assert v == pytest.approx(0.1, abs=1e-9) and value(pairs, Goal(0.2, 0.2), np.array([v]))[0] < 10.0
    assert (4.0 + v * (-40.0 + v * 100.0)) > 1.0


def test_without_a_penalty_nobody_counts() -> None:
    """R = 0 where F is 0: 0 / 0 is no reason to go anywhere."""
    goal = Goal(0.05, 0.05, weights=Weights(penalty=0.0))
    for pairs in ([[0.0, 0.0, 0.0]], [[0.0625, 0.5, 1.0]]):
        assert exact_speed(np.array(pairs), goal) == pytest.approx(0.05)


def test_who_cannot_be_passed_by_is_weighed(rng: np.random.Generator) -> None:
    """Somebody touches whatever the robot does: F does not depend on v, so the penalty does not either."""
    pairs, goal = np.array([[0.5, 0.0, 0.0]]), Goal(0.05, 0.03)
    assert exact_speed(pairs, goal) == pytest.approx(0.04)
    assert exact_speed(np.array([[0.0, 0.0, 0.0]]), goal) in (-0.25, 0.25)  # infinite everywhere


def papers_decisions() -> list[tuple[Array, Goal]]:
    """The decisions of the paper's first simulation, as the exact optimiser meets them."""
    met: list[tuple[Array, Goal]] = []

    def noted(pairs: Array, goal: Goal) -> float:
        met.append((pairs, goal))
        return exact_speed(pairs, goal)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("modes.speed.simulations.exact_speed", noted)
        run(simulation(1), Choice("proposed"))
    return met


def test_in_the_papers_scene_the_genetic_algorithm_is_near_the_exact_optimum(count: Count) -> None:
    """Objective within 1 % above the exact one, speed within 2 mm/s, at every decision and for every seed.

    Where the optimum is 0, of 0.01: to touch costs 10.
    """
    decisions = papers_decisions()
    assert len(decisions) == 28
    for seed in range(count(200)):
        for pairs, goal in decisions:
            exact, found = exact_speed(pairs, goal), evolve(pairs, goal, np.random.default_rng(seed)).speed
            least = goal.value(pairs, exact)
            assert least - 1e-9 <= goal.value(pairs, found) <= 1.01 * max(least, 0.01)
            assert abs(found - exact) < 2e-3


def test_elsewhere_it_is_near_the_least_objective(rng: np.random.Generator, count: Count) -> None:
    """A hand anywhere in the way; of two ways that are nearly as good it may take either."""
    for k in range(count(2_000)):
        programmed = float(rng.choice([-0.05, 0.05, 0.1, -0.1]))
        goal = Goal(programmed, float(rng.uniform(-1, 1) * abs(programmed)))
        d = np.append(rng.uniform(-0.03, 0.03, 2), rng.uniform(0.05, 0.12))
        pairs = np.array([[(d * d).sum(), -2 * d[0] * 0.1, 0.01]]) / 0.1**2
        least = goal.value(pairs, exact_speed(pairs, goal))
        found = goal.value(pairs, evolve(pairs, goal, np.random.default_rng(k)).speed)
        assert least - 1e-9 <= found <= 1.02 * max(least, 0.01)


def test_the_best_of_a_generation_never_gets_worse(rng: np.random.Generator, count: Count) -> None:
    for k in range(count(2_000)):
        goal, pairs = some_goal(rng), some_pairs(rng, 3)
        found = evolve(pairs, goal, np.random.default_rng(k), GeneticSettings(population=10, generations=30))
        assert (np.diff(found.track[:, 1]) <= 0.0).all()
        assert found.track[-1].tolist() == [found.speed, goal.value(pairs, found.speed)]
        np.testing.assert_allclose(found.track[:, 1], value(pairs, goal, found.track[:, 0]), rtol=1e-9)


def test_the_genetic_algorithm_is_its_plain_twin(rng: np.random.Generator) -> None:
    """The same draws in NumPy: what is drawn decides, so both must agree to rounding."""
    settings = GeneticSettings(population=12, generations=25)
    for k in range(10):
        goal, pairs = some_goal(rng), some_pairs(rng, 2)
        draws = np.random.default_rng(k).random((26, 12, 6))
        people = goal.cap * (2.0 * draws[0, :, 0] - 1.0)
        for u in draws[1:]:
            order = people[np.argsort(value(pairs, goal, people), kind="stable")]
            rank = np.minimum((12 * (1.0 - np.sqrt(1.0 - u[:, 0]))).astype(int), 11)
            first, second = order[rank], order[(12 * u[:, 1]).astype(int)]
            child = np.where(u[:, 2] < 0.8, u[:, 3] * first + (1.0 - u[:, 3]) * second, first)
            child = np.where(u[:, 4] < 0.1, goal.cap * (2.0 * u[:, 5] - 1.0), child)
            people = np.append(order[:2], child[2:])
        best = people[np.argmin(value(pairs, goal, people))]
        assert evolve(pairs, goal, np.random.default_rng(k), settings).speed == pytest.approx(best, abs=1e-12)


def test_one_seed_gives_one_speed() -> None:
    pairs, goal = np.array([[4.0, -40.0, 100.0]]), Goal(0.2, 0.2)
    one, again, other = (evolve(pairs, goal, np.random.default_rng(s)).speed for s in (1, 1, 2))
    assert one == again != other


def test_polish_is_at_the_exact_minimum_where_that_is_smooth(rng: np.random.Generator) -> None:
    far = np.array([[400.0, 0.0, 0.0]])
    goal = Goal(0.05, 0.02)
    found = evolve(far, goal, np.random.default_rng(0), GeneticSettings(generations=5, polish=True))
    assert found.speed == pytest.approx(0.035, abs=1e-6)
    plain = evolve(far, goal, np.random.default_rng(0), GeneticSettings(generations=5))
    assert plain.speed != found.speed and goal.value(far, found.speed) <= goal.value(far, plain.speed)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Weights(closeness=-1.0), "weight closeness = -1.0 should be a number at least 1e-06"),
        (lambda: Weights(smoothness=math.nan), "weight smoothness = nan should be a number at least 0"),
        (lambda: Weights(penalty=math.inf), "weight penalty = inf should be .* at most 1e\\+06"),
        (lambda: Weights(penalty=-0.1), "weight penalty = -0.1"),
        (lambda: Weights(penalty=True), "weight penalty = True"),
        (lambda: Weights(closeness=0.0), "closeness = 0 should be above 0"),
        (lambda: Goal(0.0, 0.0), "programmed speed of 0 m/s: the objective"),
        (lambda: Goal(math.nan, 0.0), r"programmed speed \[m/s\] = nan"),
        (lambda: Goal(-1e-300, 0.0), r"size of the programmed speed \[m/s\] = 1e-300"),
        (lambda: Goal(0.1, math.inf), r"previous speed \[m/s\] = inf"),
        (lambda: Goal(0.1, 0.0, cap=0.0), r"cap \[m/s\] = 0.0 should be a number at least 1e-06"),
        (
            lambda: GeneticSettings(population=2),
            r"population .* = 2 should be .* from 3 to 100000",
        ),
        (
            lambda: GeneticSettings(population=3.5),
            "population .* = 3.5 should be a whole number",
        ),
        (lambda: GeneticSettings(generations=0), "generations = 0"),
        (lambda: GeneticSettings(crossover=1.5), "probability crossover = 1.5 should be a number at least 0"),
        (lambda: GeneticSettings(mutation=math.nan), "probability mutation = nan"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_name(make: Callable[[], object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        make()
