"""The running plan: what is commanded is what was planned, evaluated by other means."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.plan import (
    PlanOutcome,
    PlanResult,
    PlanSettings,
    StopKind,
)
from failsafe.running_plan import RunningPlan
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from tests.failsafe.motions import KINDS, Case, executed, instants, limits_of, path_of, random_cases

CYCLE = 0.004
RAMP = IntendedTrajectory([0.0, 1.0], np.array([0.0, 0, 0, 10, -15, 6]).reshape(1, 6, 1), "rest")
"""One joint from 0 to 1 rad in 1 s, from rest to rest."""


def planner_of(case: Case, **changes: object) -> ShortTermPlanner:
    n = len(case.limits.joints)
    values = {"cycle_s": CYCLE, "delay": (0.0, 0.0), "q_error": np.zeros(n), "dq_error": np.zeros(n)}
    return ShortTermPlanner(case.limits, PlanSettings(**(values | changes)))


def taken(case: Case, planner: ShortTermPlanner, t: float = 0.0) -> tuple[RunningPlan, PlanResult] | None:
    """The running plan that takes over the plan of a case; ``None`` if there is none."""
    plan = planner.plan(case.motion.trajectory, t, *case.state)
    if plan.outcome is not PlanOutcome.READY:
        return None
    running = RunningPlan(case.motion.trajectory, 0.0)
    running.take(case.motion.trajectory, planner, plan)
    return running, plan


# Bad input


@pytest.mark.parametrize("s", [-0.001, 1.001, math.nan, -math.inf])
def test_rests_only_where_the_trajectory_is_known(s):
    cut = IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 2)))
    with pytest.raises(TrajectoryError, match="outside the trajectory"):
        RunningPlan(cut, s)
    running = RunningPlan(cut, 0.5)
    with pytest.raises(TrajectoryError):
        running.rest_at(cut, s)
    assert running.s_rest == 0.5


@pytest.mark.parametrize("outcome", [each for each in PlanOutcome if each is not PlanOutcome.READY])
def test_takes_no_plan_that_is_none(outcome):
    limits = limits_of(np.ones(1), np.ones(1), np.ones(1))
    settings = PlanSettings(0.01, (0.0, 0.0), np.zeros(1), np.zeros(1))
    running = RunningPlan(RAMP, 0.25)
    with pytest.raises(TrajectoryError, match=outcome.name):
        running.take(RAMP, ShortTermPlanner(limits, settings), PlanResult(outcome))
    assert running.s_rest == 0.25 and running.duration_s == 0.0


# Rest


@pytest.mark.parametrize("s", [0.0, 0.3, 1.0, 5.0])
def test_at_rest_it_stays_where_it_is(s):
    running = RunningPlan(RAMP, s)
    place = RAMP.sample(s)[0]
    for tau in (0.0, 1e-9, 0.5, 1e6):
        motion = running.motion(tau)
        assert np.allclose(motion.q, place, rtol=0.0, atol=1e-15)
        assert motion.dq == 0.0 and motion.ddq == 0.0
        assert running.path_state(tau) == (s, 0.0, 0.0)


@pytest.mark.parametrize("tau", [-1e-12, -1.0, -math.inf, math.nan])
def test_nothing_is_known_before_the_begin(tau, rng):
    for running in (RunningPlan(RAMP, 0.3), *some_plans(rng)):
        assert all(np.isnan(each).all() for each in running.motion(tau))
        assert np.isnan(running.path_state(tau)).all()


def some_plans(rng) -> list[RunningPlan]:
    found = []
    for case in random_cases(rng, "curved", 3):
        for leave in (False, True):
            planner = planner_of(case)
            if leave:
                planner._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
            pair = taken(case, planner)
            found += [pair[0]] if pair else []
    assert found
    return found


def test_what_is_returned_belongs_to_the_caller(rng):
    """A later call must not write into what an earlier one gave out."""
    running = some_plans(rng)[0]
    first = running.motion(0.001)
    kept = [each.copy() for each in first]
    running.motion(0.01)
    assert all(np.array_equal(a, b) for a, b in zip(first, kept, strict=True))


# Piece and stop on the path


@pytest.mark.parametrize("kind", KINDS)
def test_commands_are_the_planned_motion(kind, rng, count):
    ready = 0
    for case in random_cases(rng, kind, count(4_000)):
        planner = planner_of(case, allow_joint_space=False)
        pair = taken(case, planner, rng.uniform(-10.0, 10.0))
        if pair is None:
            continue
        ready += 1
        running, plan = pair
        record = planner.path[0]
        assert running.duration_s == pytest.approx(CYCLE + plan.stop_time_s, abs=1e-12)
        tau = instants(record, 6)
        q, dq, ddq, _ = executed(case.motion, record, tau)
        s, v, a, _ = path_of(record, tau)
        for i, instant in enumerate(tau.tolist()):
            motion, path = running.motion(instant), running.path_state(instant)
            assert np.allclose(motion.q, q[i], rtol=1e-9, atol=1e-9)
            assert np.allclose(motion.dq, dq[i], rtol=1e-7, atol=1e-7)
            assert np.allclose(motion.ddq, ddq[i], rtol=1e-6, atol=1e-5)
            assert np.allclose(path, (s[i], v[i], a[i]), rtol=1e-7, atol=1e-7)
        begin = running.path_state(0.0)
        assert np.allclose(begin, case.state, rtol=1e-12, atol=1e-9)
        for later in (running.duration_s, running.duration_s + 1e-9, running.duration_s + 100.0):
            motion = running.motion(later)
            assert np.allclose(motion.q, case.motion.derivatives(np.array([plan.s_rest]))[0][0], atol=1e-9)
            assert (motion.dq == 0.0).all() and (motion.ddq == 0.0).all()
            assert running.path_state(later).s == pytest.approx(running.s_rest, abs=1e-12)
    assert ready > 0.7 * count(4_000)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_jumps_where_segments_meet(kind, rng, count):
    for case in random_cases(rng, kind, count(4_000)):
        planner = planner_of(case, allow_joint_space=False)
        pair = taken(case, planner)
        if pair is None:
            continue
        running, record = pair[0], planner.path[0]
        for joint in np.asarray(record["t"][1 : record["n"] + 1]).tolist():
            before = running.motion(math.nextafter(joint, -math.inf))
            after = running.motion(math.nextafter(joint, math.inf))
            steep = np.abs(after.ddq).max() + np.abs(before.ddq).max()
            assert np.abs(after.q - before.q).max() <= 1e-10
            assert np.abs(after.dq - before.dq).max() <= 1e-9 * (1.0 + steep)
            assert np.abs(after.ddq - before.ddq).max() <= 1e-6 * (1.0 + steep)


def test_a_plan_that_is_taken_does_not_change_with_the_planner(rng):
    case = next(random_cases(rng, "curved", 1))
    planner = planner_of(case)
    running, _ = taken(case, planner)
    before = running.motion(0.02)
    planner.plan(case.motion.trajectory, 0.0, 0.3 * case.state.s, 0.4)
    after = running.motion(0.02)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


# A stop that leaves the path


def test_commands_of_a_joint_space_stop_are_the_planned_ones(rng, count):
    checked = 0
    for case in random_cases(rng, "curved", count(4_000)):
        planner = planner_of(case, search_steps=1)
        planner._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
        pair = taken(case, planner)
        if pair is None:
            continue
        checked += 1
        running, plan = pair
        assert plan.stop is StopKind.JOINT_SPACE and math.isnan(running.s_rest)
        piece = running.motion(0.5 * CYCLE)
        q, dq, _, _ = executed(case.motion, planner.path[0], np.array([0.5 * CYCLE]))
        assert np.allclose([piece.q, piece.dq], [q[0], dq[0]], rtol=1e-7, atol=1e-7)
        start = [x[0] for x in executed(case.motion, planner.path[0], np.array([CYCLE]))[:3]]
        axes = planner.axes[0]
        for tau in rng.uniform(0.0, 1.1 * plan.stop_time_s, 8).tolist():
            motion = running.motion(CYCLE + tau)
            for i in range(len(case.limits.joints)):
                n = int(axes["segments"][i])
                own = integrated([x[i] for x in start], axes["t"][: n + 1, i], axes["j"][:n, i], tau)
                got = motion.q[i], motion.dq[i], motion.ddq[i]
                scale = 1.0 + abs(start[2][i])
                assert np.allclose(got, own, rtol=1e-7, atol=1e-7 * scale)
        end = running.motion(running.duration_s + 1e-9)
        assert (end.dq == 0.0).all() and (end.ddq == 0.0).all()
        assert np.isnan(running.path_state(CYCLE + 1e-9)).all()
    assert checked > 0


def integrated(start: list[float], t: np.ndarray, j: np.ndarray, tau: float) -> tuple[float, float, float]:
    """q, dq, ddq after ``tau`` of constant jerks, step by step."""
    q, v, a = start
    for k, jerk in enumerate(j):
        d = min(tau, t[k + 1]) - t[k]
        if d > 0.0:
            q, v, a = q + d * v + d**2 / 2 * a + d**3 / 6 * jerk, v + d * a + d**2 / 2 * jerk, a + d * jerk
    return (q, 0.0, 0.0) if tau >= t[-1] else (q, v, a)


def test_after_a_joint_space_stop_a_rest_is_a_rest_again(rng):
    for running in some_plans(rng):
        running.rest_at(RAMP, 0.5)
        assert running.motion(3.0).q == pytest.approx([0.5])
        assert running.path_state(3.0) == (0.5, 0.0, 0.0)


def stop_off_the_path() -> tuple[RunningPlan, PlanResult]:
    """One joint at 1 rad/s that leaves its path 0.5 s after the begin of the plan, at s = 1.5."""
    steady = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))
    planner = ShortTermPlanner(limits, PlanSettings(0.5, (0.0, 0.0), np.zeros(1), np.zeros(1)))
    planner._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
    plan = planner.plan(steady, 7.0, 1.0)
    assert plan.stop is StopKind.JOINT_SPACE
    running = RunningPlan(steady, 0.0)
    running.take(steady, planner, plan)
    return running, plan


def test_where_a_plan_leaves_its_path_and_when_it_rests_there():
    running, plan = stop_off_the_path()
    # v/a + a/j for one joint
    assert running.duration_s == pytest.approx(0.5 + 0.125, abs=1e-9) and plan.stop_time_s < 0.126
    assert running.s_left == pytest.approx(1.5, abs=1e-12)
    assert running.path_state(0.5) == pytest.approx((1.5, 1.0, 0.0), abs=1e-12)
    assert math.isnan(running.path_state(math.nextafter(0.5, 1.0)).s)
    for tau, rests in ((0.0, False), (0.55, False), (running.duration_s, True), (9.0, True)):
        assert running.rests_off_path(tau) is rests
    assert not running.rests_off_path(math.nextafter(running.duration_s, 0.0))
    # leaving it nothing jumps, and half of the stop is symmetric: half a radian per second in the middle
    assert running.motion(0.5).q == pytest.approx([1.5], abs=1e-12)
    assert running.motion(0.5).dq == pytest.approx([1.0], abs=1e-12)
    assert running.motion(0.5 + 0.0625).dq == pytest.approx([0.5], abs=1e-9)
    assert running.motion(running.duration_s).q == pytest.approx([1.5625], abs=1e-9)


def test_on_its_path_a_plan_rests_nowhere_else(rng):
    running = RunningPlan(RAMP, 0.25)
    case = next(random_cases(rng, "curved", 1))
    for each in (running, taken(case, planner_of(case))[0]):
        assert math.isnan(each.s_left)
        assert not any(each.rests_off_path(tau) for tau in (0.0, 1.0, each.duration_s, 1e9, math.inf))
    off = stop_off_the_path()[0]
    off.rest_at(RAMP, 0.25)
    assert math.isnan(off.s_left) and not off.rests_off_path(9.0)
    assert (off.trajectory, off.duration_s, off.s_rest) == (RAMP, 0.0, 0.25)


def test_what_is_commanded_cannot_be_written(rng):
    """It is compared with what is commanded later."""
    for running in some_plans(rng):
        for each in running.motion(0.001):
            with pytest.raises(ValueError, match="read-only"):
                each[0] = 0.0


@pytest.mark.parametrize("s", [0.0, 1.0])
def test_it_may_rest_at_both_ends_of_a_trajectory(s):
    cut = IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 2)))
    assert RunningPlan(cut, s).path_state(0.0) == (s, 0.0, 0.0)
