"""Trees among people: what is found is clear, within the limits, and jumps nowhere."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.arrt import _GOALS, Found, NoPath, Planner, PlannerSettings
from modes.planning.motion import RoundedPath, motion_along
from modes.planning.potential_field import Bodies, Field, FieldSettings
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.test_potential_field import somebody

Array = NDArray[np.float64]
START = np.array([-1.2, -1.3, 1.6, -1.8, -1.57, 0.0])
GOAL = np.array([1.2, -1.3, 1.6, -1.8, -1.57, 0.0])


def wall(x: float, y: float, low: float, high: float, radius: float = 0.05) -> Bodies:
    """An upright capsule."""
    a, b = np.array([[[x, y, low]]]), np.array([[[x, y, high]]])
    return Bodies(a, b, np.array([radius]))


def both(first: Bodies, second: Bodies) -> Bodies:
    return Bodies(
        np.concatenate((first.a, second.a), axis=1), np.concatenate((first.b, second.b), axis=1),
        np.concatenate((first.radius, second.radius)),
    )  # fmt: skip


@pytest.fixture
def field(arm: Callable[[str], RobotModel]) -> Field:
    return Field(arm("ur16e"), FieldSettings(clearance_m=0.1))


def narrow() -> Bodies:
    """Bars before and behind the arm, so that neither way round is straight."""
    return both(wall(0.6, 0.0, 0.0, 0.75), wall(-0.6, 0.0, 0.0, 0.75))


def checked(found: Found, field: Field, bodies: Bodies, start: Array, goal: Array) -> Array:
    """The path, looked at densely."""
    assert found.path is not None and found.reason is None
    limits = field.robot.limits
    np.testing.assert_array_equal(found.path[0], start)
    turns = (found.path[-1] - goal) / (2.0 * math.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    for a, b in zip(found.path[:-1], found.path[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 60):
            q = a + share * (b - a)
            assert field.clearance(q, bodies) >= field.settings.clearance_m - 0.005 - 1e-9
            assert (limits.position_lower <= q).all() and (q <= limits.position_upper).all()
    return found.path


@pytest.mark.parametrize("variant", ["connect", "rewired"])
def test_a_way_is_found_between_bars_and_is_clear(
    variant: str, field: Field, count: Callable[[int], int]
) -> None:
    bodies = narrow()
    assert not field.is_clear_between(START, GOAL, bodies)
    for seed in range(count(50)):
        settings = PlannerSettings(variant=variant, seed=seed, nodes=600)  # type: ignore[arg-type]  # variants are plain texts here
        found = Planner(field, settings).plan(START, GOAL, bodies)
        checked(found, field, bodies, START, GOAL)
        assert found.length >= np.linalg.norm(found.path[-1] - START) - 1e-9  # type: ignore[index]  # checked just above that there is one


def test_with_a_free_way_the_path_is_straight(field: Field) -> None:
    found = Planner(field).plan(START, GOAL, somebody(np.array([3.0, 0.0, 1.0])))
    assert found.nodes == 2 and found.length == pytest.approx(2.4)


def test_a_joint_with_limits_of_a_turn_is_not_turned_through_them(field: Field) -> None:
    """From 3.0 to -3.0 rad: through π is the short way, which is within ±2π, and its end is 2π - 3."""
    start, goal = START.copy(), START.copy()
    start[0], goal[0] = 3.0, -3.0
    found = Planner(field).plan(start, goal, somebody(np.array([3.0, 0.0, 1.0])))
    assert found.path is not None and found.path[-1][0] == pytest.approx(2.0 * math.pi - 3.0)
    start[0], goal[0] = 6.2, -6.2 + 0.01
    found = Planner(field).plan(start, goal, somebody(np.array([3.0, 0.0, 1.0])))
    assert found.path is not None and abs(found.path[-1][0]) <= 2.0 * math.pi
    assert found.path[-1][0] == pytest.approx(2.0 * math.pi - 6.19)


def test_the_same_seed_gives_the_same_path(field: Field) -> None:
    paths = [
        Planner(field, PlannerSettings(seed=seed)).plan(START, GOAL, narrow()).path for seed in (3, 3, 4)
    ]
    assert paths[0] is not None and paths[1] is not None and paths[2] is not None
    np.testing.assert_array_equal(paths[0], paths[1])
    assert paths[0].shape != paths[2].shape or (paths[0] != paths[2]).any()


def test_why_there_is_no_path_is_said(field: Field) -> None:
    place = np.array([0.37, -0.48, 0.41])
    near_start = somebody(place)
    assert Planner(field).plan(START, GOAL, near_start).reason is NoPath.START_NEAR
    assert Planner(field).plan(GOAL, START, near_start).reason is NoPath.GOAL_NEAR
    few = Planner(field, PlannerSettings(nodes=3)).plan(START, GOAL, narrow())
    assert few.reason is NoPath.NODES_USED_UP and few.path is None and few.length == math.inf


@pytest.mark.parametrize("q", [np.zeros(5), np.full(6, np.nan), np.array([0, 0, 0, 0, 0, np.inf])])
def test_what_is_no_configuration_is_refused(q: Array, field: Field) -> None:
    with pytest.raises(SetupError, match=r"planner: start = .* should be 6 finite numbers"):
        Planner(field).plan(q, GOAL, narrow())
    with pytest.raises(SetupError, match=r"planner: goal = .* should be 6 finite numbers"):
        Planner(field).plan(START, q, narrow())


@pytest.mark.parametrize(
    ("change", "value"),
    [("step_rad", 0), ("spread_rad", 0), ("nodes", 0), ("nodes", 10.5), ("shortcuts", 3.0), ("seed", -1)],
)
def test_settings_out_of_range_are_refused_by_name(change: str, value: float) -> None:
    with pytest.raises(SetupError, match=f"planner: {change}"):
        PlannerSettings(**{change: value})  # type: ignore[arg-type]  # what is to be refused


def test_a_start_beyond_the_limits_is_said_to_be(field: Field) -> None:
    """What edges are proven by holds within them."""
    start = START.copy()
    start[0] = 7.0
    found = Planner(field).plan(start, GOAL, somebody(np.array([3.0, 0.0, 1.0])))
    assert found.path is None and found.reason is NoPath.START_BEYOND_LIMITS


def test_where_the_arm_is_is_a_path(field: Field) -> None:
    found = Planner(field).plan(START, START, somebody(np.array([3.0, 0.0, 1.0])))
    np.testing.assert_array_equal(checked(found, field, narrow(), START, START), [START, START])


@pytest.mark.parametrize("name", ["ur16e", "panda", "ur3e"])
def test_goals_are_the_nearest_of_all_that_are_whole_turns_away(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Against all combinations of -4 to 4 turns of each joint."""
    robot = arm(name)
    low = np.maximum(robot.limits.position_lower, -9.0)
    high = np.minimum(robot.limits.position_upper, 9.0)
    for _ in range(count(100)):
        start, goal = rng.uniform(low, high, (2, len(low)))
        turns = goal[:, None] + 2.0 * math.pi * np.arange(-4, 5)
        bounds = zip(robot.limits.position_lower, robot.limits.position_upper, strict=True)
        near = [[q for q in each if a <= q <= b] for each, (a, b) in zip(turns, bounds, strict=True)]
        ways = sorted(float(np.linalg.norm(np.array(q) - start)) for q in itertools.product(*near))
        found = [float(np.linalg.norm(q - start)) for q in Planner(Field(robot)).goals(start, goal)]
        assert len(found) == min(_GOALS, len(ways))
        np.testing.assert_allclose(found, ways[: len(found)], atol=1e-9)


def test_a_rounded_path_is_smooth_and_near_its_lines(rng: np.random.Generator) -> None:
    for _ in range(30):
        points = np.cumsum(rng.normal(size=(5, 6)), axis=0)
        path = RoundedPath(points, 0.3)
        s = np.linspace(0.0, path.length, 400)
        q = np.array([path.at(each)[0] for each in s])
        np.testing.assert_allclose(q[[0, -1]], points[[0, -1]], atol=1e-9)
        h = 1e-5
        for each in rng.uniform(h, path.length - h, 40):
            before, now, after = (path.at(each + k * h) for k in (-1, 0, 1))
            np.testing.assert_allclose((after[0] - before[0]) / (2 * h), now[1], atol=1e-4)
            np.testing.assert_allclose((after[1] - before[1]) / (2 * h), now[2], atol=0.5)
        away = min(_from_lines(each, points) for each in q[::5])
        assert away < 0.3


def _from_lines(q: Array, points: Array) -> float:
    found = []
    for a, b in itertools.pairwise(points):
        share = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        found.append(float(np.linalg.norm(q - a - share * (b - a))))
    return min(found)


def test_motion_rests_at_both_ends_and_keeps_the_limits(
    arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    limits = arm("ur16e").limits
    for _ in range(count(200)):
        size = 10.0 ** rng.uniform(-3.0, 0.0)
        points = np.cumsum(size * rng.normal(size=(int(rng.integers(2, 6)), 6)), axis=0)
        motion = motion_along(points, limits)
        q, dq, ddq, dddq = motion.sample(np.linspace(0.0, motion.s_end, 3000))
        np.testing.assert_allclose(q[[0, -1]], points[[0, -1]], atol=1e-9)
        np.testing.assert_allclose(np.concatenate((dq[[0, -1]], ddq[[0, -1]])), 0.0, atol=1e-6)
        shares = [
            np.abs(x / y).max()
            for x, y in ((dq, limits.velocity), (ddq, limits.acceleration), (dddq, limits.jerk))
        ]
        assert max(shares) <= 0.78 and max(shares) > 0.6


def test_motion_between_two_places_stays_on_their_line(
    arm: Callable[[str], RobotModel], rng: np.random.Generator
) -> None:
    """At rest at every corner, motion along a path does not leave what was proven."""
    for _ in range(5):
        points = rng.normal(size=(2, 6))
        motion = motion_along(points, arm("ur16e").limits)
        for q in motion.sample(np.linspace(0.0, motion.s_end, 300))[0]:
            assert _from_lines(q, points) < 1e-9


def test_points_that_are_the_same_are_one(arm: Callable[[str], RobotModel]) -> None:
    limits = arm("ur16e").limits
    twice = motion_along(np.array([START, START, START + 0.5, START + 0.5 + 1e-13, GOAL, GOAL]), limits)
    once = motion_along(np.array([START, START + 0.5, GOAL]), limits)
    assert twice.s_end == pytest.approx(once.s_end)
    still = motion_along(np.array([START, START]), limits)
    q, dq, _ddq, _dddq = still.sample(np.linspace(0.0, 1.0, 20))
    np.testing.assert_array_equal(q, np.tile(START, (20, 1)))
    np.testing.assert_array_equal(dq, 0.0)


@pytest.mark.parametrize(
    ("points", "rounding", "named"),
    [
        (np.full((2, 6), np.nan), 0.3, "motion: points"),
        (np.zeros((2, 5)), 0.3, "motion: points"),
        (np.zeros((0, 6)), 0.3, "motion: points"),
        (np.array([START, GOAL, START]), 0.0, "motion: rounding_rad"),
        (np.array([START, GOAL, START]), np.nan, "motion: rounding_rad"),
    ],
)
def test_points_that_cannot_be_followed_are_refused_by_name(
    points: Array, rounding: float, named: str, arm: Callable[[str], RobotModel]
) -> None:
    with pytest.raises(SetupError, match=named):
        motion_along(points, arm("ur16e").limits, rounding)


def test_a_goal_beyond_the_limits_is_said_to_be(arm: Callable[[str], RobotModel]) -> None:
    """Joint 4 of a Panda goes from -3.07 to -0.07 rad: neither 0.5 nor that less a turn is within."""
    panda = Field(arm("panda"))
    start = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.5, 0.0])
    goal = start.copy()
    goal[3] = 0.5
    found = Planner(panda).plan(start, goal, somebody(np.array([3.0, 0.0, 1.0])))
    assert found.reason is NoPath.GOAL_BEYOND_LIMITS and found.path is None
