"""Before a trajectory is taken over: limits with a reserve, a stop everywhere, rest at its end, and joins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.manoeuvre import come_to_rest
from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.preparation import Objection, Preparation, Refusal, Reserve, splice
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits
from tests.failsafe.motions import limits_of, random_limits, random_motion

NAN = math.nan


def preparation(limits: JointLimits, reserve: Reserve | None = None, **changes: object) -> Preparation:
    n = len(limits.joints)
    values = {"cycle_s": 0.004, "delay": (0.0, 0.0), "q_error": np.zeros(n), "dq_error": np.zeros(n)}
    return Preparation(limits, PlanSettings(**(values | changes)), reserve or Reserve())


def one_joint(v: float = 2.0, a: float = 10.0, j: float = 400.0, **position: list[float]) -> JointLimits:
    return limits_of(np.array([v]), np.array([a]), np.array([j]), **position)


def rest_to_rest(d: np.ndarray, T: float, q0: np.ndarray | float = 0.0) -> IntendedTrajectory:
    """A quintic from standstill to standstill, ``d`` (n,) [rad] in ``T`` [s]."""
    d = np.atleast_1d(np.asarray(d, dtype=float))
    c = np.zeros((1, 6, len(d)))
    c[0, 0] = q0
    c[0, 3], c[0, 4], c[0, 5] = 10 * d / T**3, -15 * d / T**4, 6 * d / T**5
    return IntendedTrajectory([0.0, T], c, "rest")


def brute_force_speed(prepared: Preparation, motion, points: int = 20_000) -> float:
    """Largest constant ṡ from samples of the derivatives."""
    s = np.linspace(motion.trajectory.s_begin, motion.trajectory.s_end, points)
    limits, share = prepared.limits, prepared.reserve.dynamic
    d = [np.abs(each).max(axis=0) for each in motion.derivatives(s)]
    with np.errstate(divide="ignore"):
        return min(
            (limits.velocity / d[1]).min(),
            np.sqrt(share * limits.acceleration / d[2]).min(),
            np.cbrt(share * limits.jerk / d[3]).min(),
        )


# Bad input


@pytest.mark.parametrize("dynamic", [0.0, -0.1, 1.1, NAN, math.inf])
def test_unusable_reserves_are_refused(dynamic):
    with pytest.raises(TrajectoryError, match="dynamic"):
        Reserve(dynamic=dynamic)


@pytest.mark.parametrize("step", [0.0, -0.1, NAN, math.inf])
def test_unusable_steps_are_refused(step):
    with pytest.raises(TrajectoryError, match="step"):
        Reserve(step_s=step)


def test_a_trajectory_of_another_robot_is_refused():
    refusal = preparation(one_joint()).prepare(rest_to_rest(np.ones(2), 3.0))
    assert refusal.objection is Objection.OTHER_JOINTS
    assert "2 joints, the robot 1" in refusal.text


# Limits


def test_path_speed_is_that_of_brute_force(rng, count):
    for _ in range(count(1_000)):
        limits = random_limits(rng, int(rng.integers(1, 8)))
        motion = random_motion(rng, limits, rng.uniform(0.3, 2.0))
        prepared = preparation(limits, Reserve(dynamic=rng.uniform(0.3, 1.0)))
        speed, where, joint = prepared.path_speed(motion.trajectory)
        truth = brute_force_speed(prepared, motion)
        assert speed <= truth * (1.0 + 1e-9)
        assert speed >= 0.9 * truth
        assert motion.trajectory.s_begin <= where <= motion.trajectory.s_end
        assert 0 <= joint < len(limits.joints)


def test_what_is_accepted_keeps_limits_and_reserve(rng, count):
    accepted = refused = 0
    for _ in range(count(2_000)):
        limits = random_limits(rng, int(rng.integers(1, 8)))
        motion = random_motion(rng, limits, rng.uniform(0.4, 1.2))
        prepared = preparation(limits, Reserve(step_s=0.1))
        answer = prepared.prepare(motion.trajectory)
        truth = brute_force_speed(prepared, motion)
        if isinstance(answer, IntendedTrajectory):
            accepted += 1
            assert truth >= 1.0 - 1e-9
            assert answer.end == "rest"
        elif answer.objection is Objection.BEYOND_LIMITS:
            refused += 1
            assert truth <= 1.12
            assert answer.path_speed < 1.0 and f"{answer.path_speed:.3f}" in answer.text
            if math.isfinite(answer.path_speed):
                slower = prepared.prepare(motion.trajectory.stretched(1.0 / answer.path_speed))
                assert getattr(slower, "objection", None) is not Objection.BEYOND_LIMITS
    assert accepted > 0 and refused > 0


def test_the_path_speed_of_a_refusal_is_one_that_is_accepted():
    limits = one_joint()
    prepared = preparation(limits)
    refusal = prepared.prepare(rest_to_rest(np.array([3.0]), 2.0))
    assert refusal.objection is Objection.BEYOND_LIMITS and refusal.joint == 0
    slower = rest_to_rest(np.array([3.0]), 2.0 / refusal.path_speed * 1.0001)
    assert isinstance(prepared.prepare(slower), IntendedTrajectory)


@pytest.mark.parametrize(
    ("limits", "accepted"),
    [
        (one_joint(v=1.877), True),
        (one_joint(v=1.87), False),  # velocity has no reserve: 1.875 rad/s at most
        (one_joint(v=9.0, a=5.78 / 0.8), True),
        (one_joint(v=9.0, a=5.76 / 0.8), False),  # 10/√3 = 5.774 rad/s² at most
        (one_joint(v=9.0, a=90.0, j=60.1 / 0.8), True),
        (one_joint(v=9.0, a=90.0, j=59.9 / 0.8), False),  # 60 rad/s³ at most
        (one_joint(upper=[1.0001], lower=[-1.0], v=9.0), True),
        (one_joint(upper=[0.9999], lower=[-1.0], v=9.0), False),
        (one_joint(upper=[2.0], lower=[0.0001], v=9.0), False),
    ],
)
def test_limits_of_a_quintic_known_in_closed_form(limits, accepted):
    answer = preparation(limits).prepare(rest_to_rest(np.ones(1), 1.0))
    assert isinstance(answer, IntendedTrajectory) is accepted
    if not accepted:
        assert answer.objection is Objection.BEYOND_LIMITS and answer.joint == 0


def test_a_trajectory_that_stands_still_is_accepted():
    still = IntendedTrajectory([0.0, 1.0], np.full((1, 1, 1), 0.5), "rest")
    prepared = preparation(one_joint())
    assert prepared.path_speed(still)[0] == math.inf
    assert isinstance(prepared.prepare(still), IntendedTrajectory)


# Rest and stop


def test_a_trajectory_that_is_cut_gets_a_rest():
    cut = IntendedTrajectory([0.0, 1.0], [[[0.0], [1.0]]])
    whole = preparation(one_joint()).prepare(cut)
    assert isinstance(whole, IntendedTrajectory) and whole.end == "rest"
    assert np.allclose(whole.sample(1.0)[:2], [[1.0], [1.0]])
    assert np.allclose(whole.sample(whole.s_end)[1:3], 0.0, atol=1e-9)


def test_a_cut_end_from_which_no_rest_is_possible_is_refused():
    cut = IntendedTrajectory([0.0, 1.0], [[[0.0], [1.0]]])
    refusal = preparation(one_joint(lower=[-1.0], upper=[1.01])).prepare(cut)
    assert refusal.objection is Objection.NO_REST and refusal.s == 1.0 and refusal.joint == 0


def hard_turn(a: float) -> IntendedTrajectory:
    """One joint that slows down by ``a`` for half a second: with its full limit no stop is possible there."""
    # q'' from 0 to -a, constant, back to 0, each by a cubic with q''' = 0 at its ends
    T, v = 0.5, 3.0
    pieces, state = [], np.array([0.0, v])
    for shape in ((0.0, 1.0), (1.0, 0.0), (1.0, -1.0)):
        level, change = -a * shape[0], -a * shape[1]
        c = np.array([state[0], state[1], level / 2, 0.0, change / (4 * T**2), -change / (10 * T**3)])
        pieces.append(c)
        powers = T ** np.arange(6)
        state = np.array([c @ powers, c[1:] @ (np.arange(1, 6) * powers[:5])])
    return IntendedTrajectory(np.arange(4) * T, np.array(pieces)[:, :, None])


def test_where_no_stop_is_possible_a_trajectory_is_refused():
    limits = one_joint(v=4.0, a=1.9905, j=100.0)
    tight = preparation(limits, Reserve(dynamic=1.0, step_s=0.002)).prepare(hard_turn(1.99))
    assert tight.objection is Objection.NO_STOP
    assert 0.0 <= tight.s < 1.0 and "acceleration of joint" in tight.text
    planner = ShortTermPlanner(
        limits, PlanSettings(0.004, (0.0, 0.0), np.zeros(1), np.zeros(1), allow_joint_space=False)
    )
    whole = come_to_rest(hard_turn(1.99), limits)
    assert planner.plan(whole, 0.0, tight.s).outcome is PlanOutcome.NO_STOP
    assert isinstance(preparation(limits).prepare(hard_turn(1.5)), IntendedTrajectory)


def test_a_stop_that_leaves_the_path_does_not_count():
    limits = one_joint(v=4.0, a=1.9905, j=100.0)
    answer = preparation(limits, Reserve(dynamic=1.0, step_s=0.002), allow_joint_space=True).prepare(
        hard_turn(1.99)
    )
    assert answer.objection is Objection.NO_STOP


# Joins


def going_on(old: IntendedTrajectory, join: float, T: float = 2.0) -> IntendedTrajectory:
    """A quintic from where ``old`` is at ``join``, with its q, q', q'', to rest a little further on."""
    q, v, a, _ = old.sample(join)
    rows = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
    right = np.stack([0.3 - v * T - a * T**2 / 2, -v - a * T, -a])
    c = np.concatenate([np.stack([q, v, a / 2]), np.linalg.solve(rows, right)])
    return IntendedTrajectory([7.0, 7.0 + T], c[None], "rest")


def test_joins_are_continuous_and_keep_both_parts(rng, count):
    for _ in range(count(2_000)):
        limits = random_limits(rng, int(rng.integers(1, 8)))
        old = random_motion(rng, limits, 0.5).trajectory
        join = rng.uniform(old.s_begin, old.s_end)
        new = going_on(old, join)
        both = splice(old, new, join)
        assert both.end == "rest" and both.s_begin == old.s_begin
        assert both.s_end == pytest.approx(join + 2.0, abs=1e-9)
        for s in rng.uniform(old.s_begin, join, 5):
            assert np.array_equal(both.sample(s), old.sample(s))
        for x in rng.uniform(0.0, 2.0, 5):
            assert np.allclose(both.sample(join + x)[:3], new.sample(7.0 + x)[:3], rtol=1e-7, atol=1e-7)
        left, right = both.sample(join - 1e-7), both.sample(join + 1e-7)
        for d in range(3):
            steep = 1.0 + np.abs(old.sample(join)[d + 1]).max() if d < 2 else 1.0 + limits.jerk.max()
            assert np.abs(left[d] - right[d]).max() <= 1e-6 * steep


@pytest.mark.parametrize("end", ["begin", "end", "break"])
def test_joins_at_begin_end_and_break(end):
    old = IntendedTrajectory([0.0, 1.0, 2.0], [[[0.0], [1.0]], [[1.0], [1.0]]])
    join = {"begin": 0.0, "end": 2.0, "break": 1.0}[end]
    both = splice(old, going_on(old, join), join)
    assert both.sample(join)[0] == pytest.approx([join])
    assert both.spans == {"begin": 1, "end": 3, "break": 2}[end]
    assert (np.diff(both.breaks) > 0.0).all()


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("size", [1e-6, -1e-6, 0.1])
def test_jumps_are_refused(order, size):
    old = IntendedTrajectory([0.0, 2.0], [[[0.0], [1.0]]])
    new = going_on(old, 1.0)
    c = new.coefficients.copy()
    c[0, order, 0] += size
    with pytest.raises(TrajectoryError, match="jumps"):
        splice(old, IntendedTrajectory(new.breaks, c, "cut"), 1.0)
    assert splice(old, new, 1.0).s_end == 3.0


@pytest.mark.parametrize("join", [-0.001, 2.001, NAN, math.inf, -math.inf])
def test_joins_outside_are_refused(join):
    old = IntendedTrajectory([0.0, 2.0], [[[0.0], [1.0]]])
    with pytest.raises(TrajectoryError, match="cannot be joined"):
        splice(old, going_on(old, 1.0), join)


def test_a_join_with_another_robots_trajectory_is_refused():
    old = IntendedTrajectory([0.0, 2.0], [[[0.0], [1.0]]])
    with pytest.raises(TrajectoryError, match="2 joints"):
        splice(old, rest_to_rest(np.ones(2), 1.0), 1.0)


def test_refusals_are_constraints():
    refusal = Refusal(Objection.JUMP, "text")
    assert math.isnan(refusal.s) and refusal.joint == -1 and math.isnan(refusal.path_speed)
