"""The way to joint velocities: begins as asked, keeps limits, reaches, holds, and rests in time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.joint_velocity import to_joint_velocity
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from tests.failsafe.motions import limits_of

NAN = math.nan
ROBOT = limits_of(
    np.array([2.0, 3.0]), np.array([10.0, 12.0]), np.array([400.0, 300.0]), [-3.0, -3.0], [3.0, 3.0]
)
ENDLESS = limits_of(
    np.array([2.0, 3.0]), np.array([10.0, 12.0]), np.array([400.0, 300.0]), [-math.inf] * 2, [math.inf] * 2
)
STILL = (np.zeros(2), np.zeros(2), np.zeros(2))


@pytest.mark.parametrize("horizon", [NAN, -0.001, math.inf, -math.inf])
def test_a_horizon_that_is_none_is_refused(horizon):
    with pytest.raises(TrajectoryError, match="horizon"):
        to_joint_velocity(STILL, np.ones(2), horizon, ROBOT)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("value", [NAN, math.inf])
def test_a_start_that_is_none_is_refused(place, value):
    start = [each.copy() for each in STILL]
    start[place][1] = value
    with pytest.raises(TrajectoryError):
        to_joint_velocity(tuple(start), np.ones(2), 0.1, ROBOT)


@pytest.mark.parametrize("value", [NAN])
def test_a_velocity_that_is_none_is_refused(value):
    with pytest.raises(TrajectoryError):
        to_joint_velocity(STILL, np.array([0.5, value]), 0.1, ROBOT)


def dense(trajectory: IntendedTrajectory) -> tuple[np.ndarray, ...]:
    """Instants, and q by adding up the third derivative on them: no polynomial is believed."""
    s = np.unique(
        np.concatenate([np.linspace(trajectory.s_begin, trajectory.s_end, 4001), trajectory.breaks])
    )
    jerk = trajectory.sample(0.5 * (s[1:] + s[:-1]))[3]
    h = np.diff(s)[:, None]
    q, v, a, _ = trajectory.sample(s[0])
    rows = [(q, v, a)]
    for step, j in zip(h, jerk, strict=True):
        q, v, a = q + step * (v + step * (a / 2 + step * j / 6)), v + step * (a + step * j / 2), a + step * j
        rows.append((q, v, a))
    return s, *(np.array(each) for each in zip(*rows, strict=True)), jerk


def random_start(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a = rng.uniform(-0.9, 0.9, 2) * ROBOT.acceleration
    room = ROBOT.velocity - a**2 / (2.0 * 0.5 * ROBOT.jerk)
    return rng.uniform(-1.0, 1.0, 2), rng.uniform(-1.0, 1.0, 2) * room, a


def test_limits_are_kept_the_velocity_is_held_and_it_rests_at_the_end(rng, count):
    for _ in range(max(20, count(500))):
        start, begin = random_start(rng), float(rng.choice([0.0, 123.4, -7.0]))
        wanted = rng.uniform(-0.999, 0.999, 2) * ROBOT.velocity * rng.choice([0.0, 0.1, 1.0])
        horizon = float(rng.choice([0.0, 0.05, 0.4, 1.0]))
        found = to_joint_velocity(start, wanted, horizon, ENDLESS, begin)
        s, q, v, a, jerk = dense(found)
        assert found.s_begin == begin and found.end == "rest"
        for mine, its in zip(start, found.sample(begin)[:3], strict=True):
            assert np.abs(mine - its).max() <= 1e-12
        assert (np.abs(v) <= ROBOT.velocity * (1.0 + 1e-9)).all()
        assert (np.abs(a) <= ROBOT.acceleration * (1.0 + 1e-9)).all()
        assert (np.abs(jerk) <= ROBOT.jerk * (1.0 + 1e-9)).all()
        assert np.abs(v[-1]).max() <= 1e-9 and np.abs(a[-1]).max() <= 1e-7
        assert np.abs(q[-1] - found.sample(found.s_end)[0]).max() <= 1e-9
        held = (s >= begin + slowest(start, wanted)) & (s <= begin + horizon)
        assert np.abs(v[held] - wanted).max(initial=0.0) <= 1e-8


def slowest(start: tuple[np.ndarray, np.ndarray, np.ndarray], wanted: np.ndarray) -> float:
    """More than the quickest change takes: lose the acceleration, then change at a trapezoid."""
    _, v, a = start
    limit, j = 0.95 * ROBOT.acceleration, 0.5 * ROBOT.jerk
    lost = np.abs(a) / j
    left = np.abs(wanted - v) + a**2 / (2.0 * j)
    return float((lost + left / limit + 2.0 * limit / j).max()) + 1e-9


def test_it_is_as_quick_as_the_limits_allow():
    found = to_joint_velocity(STILL, np.array([1.0, 0.0]), 0.5, ENDLESS)
    assert found.s_end - 0.5 == pytest.approx(1.0 / 9.5 + 9.5 / 200.0, abs=1e-9)
    _, v, _, _ = found.sample(found.s_end - 0.5)
    assert v[0] == pytest.approx(1.0, abs=1e-9)


def test_it_rests_before_a_position_limit(rng, count):
    for _ in range(max(20, count(500))):
        q = rng.uniform(2.0, 2.99, 2) * rng.choice([-1.0, 1.0], 2)
        wanted = np.sign(q) * rng.uniform(0.2, 1.0, 2) * ROBOT.velocity
        found = to_joint_velocity((q, np.zeros(2), np.zeros(2)), wanted, 5.0, ROBOT)
        _, places, v, _, _ = dense(found)
        assert (np.abs(places) <= 3.0).all()
        assert (3.0 - np.abs(places[-1]) <= 2e-5).all(), "it could have gone on"
        assert (np.abs(v).max(axis=0) > 0.0).all()


def test_a_motion_that_is_there_already_goes_on():
    velocity = np.array([0.5, -0.5])
    found = to_joint_velocity((np.zeros(2), velocity, np.zeros(2)), velocity, 0.3, ROBOT, 2.0)
    assert np.abs(found.sample(2.3)[0] - 0.3 * velocity).max() <= 1e-12


def test_nothing_wanted_at_rest_is_a_trajectory_that_rests():
    found = to_joint_velocity(STILL, np.zeros(2), 0.0, ROBOT)
    assert found.s_end > found.s_begin and not found.sample(0.0005)[0].any()
