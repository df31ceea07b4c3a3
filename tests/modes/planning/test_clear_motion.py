"""Motion that is said to keep the clearance, looked at densely by other means."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.arrt import Planner, PlannerSettings
from modes.planning.clear_motion import NoMotion, plan_motion
from modes.planning.motion import motion_along
from modes.planning.polynomials import control_values, speed_bounds
from modes.planning.potential_field import Bodies, Field, FieldSettings
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.gaps import least_gaps
from tests.modes.planning.test_arrt import GOAL, START, narrow
from tests.modes.planning.test_potential_field import configurations, somebody

Array = NDArray[np.float64]
FAR = somebody(np.array([3.0, 0.0, 1.0]))


@pytest.fixture
def field(arm: Callable[[str], RobotModel]) -> Field:
    return Field(arm("ur16e"), FieldSettings(clearance_m=0.1))


def sampled(motion: IntendedTrajectory, count: int = 600) -> tuple[Array, Array, Array, Array]:
    return motion.sample(np.linspace(0.0, motion.s_end, count))


def test_other_means_find_the_same_gaps(field: Field, rng: np.random.Generator) -> None:
    bodies = somebody(np.array([0.6, 0.1, 0.7]), 2)
    q = configurations(field.robot, rng, 60)
    found = [field.clearance(each, bodies) for each in q]
    np.testing.assert_allclose(least_gaps(field.robot, q, bodies), found, atol=1e-9)


def test_curves_stay_between_their_control_values_and_their_speeds_below_their_bounds(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    tight = 0.0
    for _ in range(count(500)):
        c, h = rng.normal(size=(3, 6, 2)), rng.uniform(0.1, 3.0, 3)
        between, speeds = control_values(h, c), speed_bounds(h, c)
        for m in range(3):
            x = np.linspace(0.0, h[m], 300)[:, None]
            q = sum(c[m, k] * x**k for k in range(6))
            dq = sum(k * c[m, k] * x ** (k - 1) for k in range(1, 6))
            assert (q >= between[m].min(axis=0) - 1e-9).all() and (q <= between[m].max(axis=0) + 1e-9).all()
            assert (np.abs(dq) <= speeds[m] * (1.0 + 1e-12)).all()
            tight = max(tight, float((np.abs(dq).max(axis=0) / speeds[m]).max()))
    assert tight > 0.9


def test_motion_that_is_said_to_be_clear_is(
    field: Field, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Samples never come nearer than the clearance less the slack; what keeps it all along is not refused."""
    told = set()
    for _ in range(count(1000)):
        points = configurations(field.robot, rng, 1) + np.cumsum(0.2 * rng.normal(size=(4, 6)), axis=0)
        bodies = somebody(rng.uniform([-1.0, -1.0, 0.2], [1.0, 1.0, 1.2]), 2)
        motion = motion_along(points, field.robot.limits)
        gap = least_gaps(field.robot, sampled(motion, 300)[0], bodies).min()
        said = field.is_clear_along(motion, bodies, 0.01)
        told.add(said)
        assert gap >= 0.09 if said else gap < 0.1
    assert told == {True, False}


@pytest.mark.parametrize("variant", ["connect", "rewired"])
def test_a_path_that_was_found_gives_motion_that_is_clear(
    variant: str, field: Field, count: Callable[[int], int]
) -> None:
    limits, bodies = field.robot.limits, narrow()
    for seed in range(count(400)):
        settings = PlannerSettings(variant=variant, seed=seed, nodes=500)  # type: ignore[arg-type]  # variants are plain texts here
        path = Planner(field, settings).plan(START, GOAL, bodies).path
        assert path is not None
        found = plan_motion(field, path, bodies)
        assert found.trajectory is not None and found.reason is None
        q, dq, ddq, dddq = sampled(found.trajectory, 2000)
        assert least_gaps(field.robot, q, bodies).min() >= 0.09
        np.testing.assert_allclose(q[[0, -1]], path[[0, -1]], atol=1e-9)
        np.testing.assert_allclose(np.concatenate((dq[[0, -1]], ddq[[0, -1]])), 0.0, atol=1e-6)
        assert (np.abs(dq) <= 0.78 * limits.velocity).all()
        assert (np.abs(ddq) <= 0.78 * limits.acceleration).all() and (
            np.abs(dddq) <= 0.78 * limits.jerk
        ).all()


def test_a_corner_is_rounded_less_where_rounding_would_come_too_near(
    arm: Callable[[str], RobotModel],
) -> None:
    """A stretched arm goes aside, then up, past a ball: 10 mm away on the lines, and through it off them."""
    robot = arm("ur16e")
    corner = np.array([0.0, -0.5, 0.1, 0.0, -1.57, 0.0])
    path = np.array([corner, corner, corner])
    path[0, 0], path[2, 1] = -1.2, -1.5
    place = np.array([[[0.6496, -0.1046, 0.6783]]])
    ball, shares = Bodies(place, place, np.array([0.02])), np.linspace(0.0, 1.0, 500)[:, None]
    lines = np.concatenate([a + shares * (b - a) for a, b in itertools.pairwise(path)])
    on_lines = float(least_gaps(robot, lines, ball).min())
    rounded = motion_along(path, robot.limits, 0.5)
    assert least_gaps(robot, sampled(rounded)[0], ball).min() < 0.0 < 0.009 < on_lines
    field = Field(robot, FieldSettings(clearance_m=on_lines - 0.001))
    assert not field.is_clear_along(rounded, ball, 0.005)
    found = plan_motion(field, path, ball, 0.5, 0.005)
    assert found.trajectory is not None and found.rounding[0] < 0.45
    assert least_gaps(robot, sampled(found.trajectory)[0], ball).min() >= on_lines - 0.006


def test_the_arm_rests_at_a_corner_that_cannot_be_rounded(field: Field) -> None:
    """Between two corners that are near each other, there is no room for rounding."""
    path = np.array([START, START + 0.02, START + np.array([0.8, 0.2, 0.0, 0.0, 0.4, 0.0]), START + 0.7])
    found = plan_motion(field, path, FAR)
    assert found.trajectory is not None and found.rounding[0] == 0.0 and found.rounding[1] > 0.1
    q, dq, _ddq, _dddq = sampled(found.trajectory, 20_001)
    k = int(np.argmin(np.linalg.norm(q - path[1], axis=1)))
    assert np.abs(dq[k]).max() < 1e-3 and np.linalg.norm(q[k] - path[1]) < 1e-6
    assert np.abs(dq[k - 200 : k + 200]).max() > 0.01
    np.testing.assert_allclose(q[-1], path[-1], atol=1e-9)


def test_a_path_through_somebody_has_no_motion(field: Field) -> None:
    found = plan_motion(field, np.array([START, GOAL]), narrow())
    assert found.trajectory is None and found.reason is NoMotion.NOT_PROVEN


def test_motion_along_a_position_limit_does_not_leave_it(field: Field, rng: np.random.Generator) -> None:
    top = field.robot.limits.position_upper
    for _ in range(5):
        path = START + 0.5 * rng.normal(size=(5, 6))
        path[1:4, 2] = top[2]
        found = plan_motion(field, path, FAR)
        assert found.trajectory is not None
        assert sampled(found.trajectory, 5000)[0][:, 2].max() <= top[2] + 1e-9
    path[2, 2] = top[2] + 0.01
    assert plan_motion(field, path, FAR).reason is NoMotion.NOT_PROVEN


def test_where_the_arm_is_it_stays(field: Field) -> None:
    for path in (np.array([START, START]), START[None], np.array([START, START + 1e-14, START])):
        found = plan_motion(field, path, FAR)
        assert found.trajectory is not None
        np.testing.assert_allclose(sampled(found.trajectory)[0], np.tile(START, (600, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("look", "named"),
    [
        (lambda field: plan_motion(field, np.zeros((3, 5)), FAR), "motion: path"),
        (lambda field: plan_motion(field, np.full((3, 6), np.nan), FAR), "motion: path"),
        (lambda field: plan_motion(field, np.zeros((0, 6)), FAR), "motion: path"),
        (lambda field: plan_motion(field, np.zeros((3, 6)), FAR, 0.0), "motion: rounding_rad"),
        (lambda field: plan_motion(field, np.zeros((3, 6)), FAR, slack_m=0.0), "slack_m"),
        (
            lambda field: field.is_clear_along(
                IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 7)), "rest"), FAR
            ),
            "a curve of 7 joints does not fit ur16e, 6 joints",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(
    look: Callable[[Field], object], named: str, field: Field
) -> None:
    with pytest.raises(SetupError, match=named):
        look(field)
