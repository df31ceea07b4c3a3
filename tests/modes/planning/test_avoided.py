"""Avoided balls against dense samples of lines, and paths that keep out of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.arrt import NoPath, Planner, PlannerSettings
from modes.planning.avoided import Avoided
from modes.planning.potential_field import Field, FieldSettings
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.test_arrt import GOAL, START, narrow
from tests.modes.planning.test_potential_field import somebody

Array = NDArray[np.float64]
FAR = somebody(np.array([3.0, 0.0, 1.0]))


@pytest.fixture
def field(arm: Callable[[str], RobotModel]) -> Field:
    return Field(arm("ur16e"), FieldSettings(clearance_m=0.1))


def least(begin: Array, end: Array, avoided: Avoided) -> float:
    """How much farther than its radius dense samples of a line are from any centre."""
    q = begin + np.linspace(0.0, 1.0, 2001)[:, None] * (end - begin)
    away = np.linalg.norm(q[:, None] - avoided.centre, axis=2)
    return float((away - avoided.radius).min(initial=np.inf))


def test_lines_enter_a_ball_where_their_samples_do(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    told = set()
    for _ in range(count(10000)):
        balls = Avoided(rng.normal(size=(3, 6)), rng.uniform(0.0, 1.5, 3))
        begin, end = rng.normal(size=(2, 6))
        nearest = least(begin, end, balls)
        if abs(nearest) > 1e-4:  # samples tell it
            told.add(nearest < 0.0)
            assert balls.is_entered(begin, end) == (nearest < 0.0)
        assert balls.contains(begin) == bool(
            (np.linalg.norm(balls.centre - begin, axis=1) < balls.radius).any()
        )
    assert told == {False, True}


def turns() -> Array:
    """Whole turns of the joints but the elbow, which has no other one within its limits."""
    ways = itertools.product((-1, 0, 1), (-1, 0, 1), (0,), (-1, 0, 1), (-1, 0, 1), (-1, 0, 1))
    return 2.0 * np.pi * np.array(list(ways), dtype=float)


def test_a_path_keeps_out(field: Field, rng: np.random.Generator, count: Callable[[int], int]) -> None:
    straight = START + np.linspace(0.1, 0.9, 4)[:, None] * (GOAL - START)
    for seed in range(count(300)):
        balls = Avoided(straight + rng.normal(scale=0.1, size=straight.shape), np.full(4, 0.3))
        for variant in ("connect", "rewired"):
            settings = PlannerSettings(variant=variant, seed=seed, nodes=500)  # type: ignore[arg-type]  # variants are plain texts here
            for bodies in (FAR, narrow()):
                found = Planner(field, settings).plan(START, GOAL, bodies, balls)
                assert found.path is not None
                for a, b in zip(found.path[:-1], found.path[1:], strict=True):
                    assert least(a, b, balls.without(START)) >= -1e-9
        assert found.nodes > 2


def test_the_arm_can_leave_a_ball_and_not_go_into_one(field: Field) -> None:
    around = Avoided(START[None] + 0.05, np.array([0.5]))
    found = Planner(field).plan(START, GOAL, FAR, around)
    assert found.path is not None
    shrunk = around.without(START)
    assert shrunk.radius[0] == pytest.approx(0.05 * np.sqrt(6.0)) and not shrunk.contains(START)
    for a, b in zip(found.path[:-1], found.path[1:], strict=True):
        assert least(a, b, shrunk) >= -1e-9
    gone = Planner(field).plan(START, GOAL, FAR, Avoided(GOAL + turns(), np.full(243, 0.3)))
    assert gone.path is None and gone.reason is NoPath.GOAL_AVOIDED


def test_another_turn_of_a_goal_is_taken_where_one_is_avoided(field: Field) -> None:
    turned = Planner(field).plan(START, GOAL, FAR, Avoided(GOAL[None], np.array([0.3])))
    assert turned.path is not None
    np.testing.assert_allclose(np.abs(turned.path[-1] - GOAL).max(), 2.0 * np.pi)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Avoided(np.zeros((2, 6)), np.zeros(3)), "avoided: centre"),
        (lambda: Avoided(np.full((1, 6), np.nan), np.zeros(1)), "avoided: centre"),
        (lambda: Avoided(np.zeros((1, 6)), np.array([-0.1])), "radius -0.1 rad"),
        (lambda: Avoided(np.zeros((1, 6)), np.array([np.inf])), "avoided: radius"),
    ],
)
def test_balls_that_cannot_be_used_are_refused_by_name(make: Callable[[], object], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        make()


def test_balls_of_another_arm_are_refused(field: Field) -> None:
    with pytest.raises(SetupError, match="avoided balls have 7 coordinates, not 6"):
        Planner(field).plan(START, GOAL, FAR, Avoided(np.zeros((1, 7)), np.ones(1)))
