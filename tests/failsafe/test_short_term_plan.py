"""The short-term plan: settings, outcomes, and slices that contain the executed motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from failsafe import axis_kernels
from failsafe.manoeuvre import Quantity
from failsafe.plan import (
    PlanError,
    PlanOutcome,
    PlanSettings,
    StopKind,
)
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from robots.motion import MAX_JOINTS, MAX_SLICES
from tests.failsafe.motions import (
    KINDS,
    executed,
    limits_of,
    path_of,
    random_cases,
    random_limits,
    random_motion,
)

NAN = math.nan


def settings(n: int, **changes: object) -> PlanSettings:
    values = {"cycle_s": 0.01, "delay": (0.0, 0.01), "q_error": np.zeros(n), "dq_error": np.zeros(n)}
    return PlanSettings(**(values | changes))


def one_joint(v: float = 2.0, a: float = 10.0, j: float = 400.0, **position: list[float]):
    return limits_of(np.array([v]), np.array([a]), np.array([j]), **position)


STEADY = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
"""One joint at 1 rad/s for 5 s."""


# Bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cycle_s": 0.0}, "cycle of 0.0 s"),
        ({"cycle_s": NAN}, "cycle of nan s"),
        ({"slice_s": -0.1}, "slice of -0.1 s"),
        ({"slice_s": math.inf}, "slice of inf s"),
        ({"delay": (0.02, 0.01)}, "delay"),
        ({"delay": (-0.01, 0.01)}, "delay"),
        ({"delay": (0.0, NAN)}, "delay"),
        ({"q_error": np.array([NAN])}, "q_error"),
        ({"q_error": np.array([-1e-3])}, "q_error"),
        ({"dq_error": np.array([math.inf])}, "dq_error"),
        ({"dq_error": np.zeros((1, 1))}, "dq_error"),
        ({"search_steps": 0}, "search steps"),
    ],
)
def test_unusable_settings_are_refused_in_one_line(changes, message):
    with pytest.raises(PlanError, match=message) as caught:
        settings(1, **changes)
    assert "\n" not in str(caught.value)


def test_settings_must_fit_the_robot():
    with pytest.raises(PlanError, match=r"q_error has shape \(2,\), should be \(1,\)"):
        ShortTermPlanner(one_joint(), settings(2))
    many = np.ones(MAX_JOINTS + 1)
    with pytest.raises(PlanError, match="17 joints are more than 16"):
        ShortTermPlanner(limits_of(many, many, many), settings(MAX_JOINTS + 1))


@pytest.mark.parametrize("spoilt", range(4))
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf])
def test_no_plan_from_numbers_that_are_none(spoilt, value):
    planner = ShortTermPlanner(one_joint(), settings(1))
    state = [0.0, 1.0, 1.0, 0.0]
    assert planner.plan(STEADY, *state).outcome is PlanOutcome.READY
    state[spoilt] = value
    result = planner.plan(STEADY, *state)
    assert result.outcome in (PlanOutcome.INVALID_STATE, PlanOutcome.BEYOND_END)
    assert planner.slices["n"][0] == 0


def test_no_plan_where_the_clock_does_not_resolve_a_slice():
    planner = ShortTermPlanner(one_joint(), settings(1))
    assert planner.plan(STEADY, 1e16, 1.0).outcome is PlanOutcome.INVALID_STATE
    assert planner.plan(STEADY, -1e8, 1.0).outcome is PlanOutcome.READY
    rows = int(planner.slices["n"][0])
    assert (np.diff(planner.slices["t"][0, : rows + 1]) > 0).all()


def test_no_plan_backwards_or_for_another_robot():
    planner = ShortTermPlanner(one_joint(), settings(1))
    assert planner.plan(STEADY, 0.0, 1.0, -0.1).outcome is PlanOutcome.INVALID_STATE
    for sdot, sddot, slowest in ((0.1, -11.0, -0.01), (-0.1, 11.0, -0.1)):
        result = planner.plan(STEADY, 0.0, 1.0, sdot, sddot)
        assert (result.outcome, result.quantity) == (PlanOutcome.INVALID_STATE, Quantity.PATH_SPEED)
        assert (result.value, result.limit) == (pytest.approx(slowest), 0.0)
    other = IntendedTrajectory([0.0, 5.0], np.zeros((1, 2, 2)))
    assert planner.plan(other, 0.0, 1.0).outcome is PlanOutcome.INVALID_STATE


# Outcomes


def test_plan_of_one_joint_at_constant_speed():
    planner = ShortTermPlanner(one_joint(), settings(1, q_error=np.array([2e-3]), delay=(0.001, 0.02)))
    result = planner.plan(STEADY, 100.0, 1.0)
    assert result.outcome is PlanOutcome.READY and result.stop is StopKind.PATH_CONSISTENT
    assert result.t_stop_begin == pytest.approx(100.01)
    # closed form v/a + a/j, and half of it in distance
    assert 0.125 <= result.stop_time_s < 0.1275
    assert result.t_rest == pytest.approx(result.t_stop_begin + result.stop_time_s)
    assert result.s_rest == pytest.approx(1.01 + result.stop_time_s / 2, abs=1e-6)
    slices = planner.slices[0]
    assert slices["t"][0] == 100.0 and slices["q"][0, 0] == 1.0 and slices["dq"][0, 0] == 1.0
    assert (
        slices["n_joints"] == 1 and slices["q_error"][0] == 2e-3 and slices["delay"].tolist() == [0.001, 0.02]
    )


def test_plans_past_the_end_of_what_is_known():
    planner = ShortTermPlanner(one_joint(), settings(1))
    assert planner.plan(STEADY, 0.0, 4.95).outcome is PlanOutcome.BEYOND_END
    assert planner.plan(STEADY, 0.0, 4.995).outcome is PlanOutcome.BEYOND_END
    assert planner.plan(STEADY, 0.0, -0.001).outcome is PlanOutcome.BEYOND_END
    assert planner.plan(STEADY, 0.0, 4.8).outcome is PlanOutcome.READY


def test_at_rest_beyond_the_end_of_a_trajectory_that_ends_at_rest():
    trajectory = IntendedTrajectory([0.0, 1.0], np.array([0.0, 0, 0, 10, -15, 6]).reshape(1, 6, 1), "rest")
    planner = ShortTermPlanner(one_joint(4.0, 20.0, 2000.0), settings(1))
    for s, sdot in ((0.995, 1.0), (1.0, 1.0), (7.0, 1.0), (0.5, 0.0), (1e5, 1.0)):
        result = planner.plan(trajectory, 0.0, s, sdot)
        assert result.outcome is PlanOutcome.READY
        rows = int(planner.slices["n"][0])
        assert rows >= 1 and planner.slices["dq"][0, rows, 0] == 0.0


@pytest.mark.parametrize(
    ("limits", "quantity", "limit"),
    [
        (one_joint(v=0.9), Quantity.VELOCITY, 0.9),
        (one_joint(lower=[-9.0], upper=[0.995]), Quantity.POSITION, 0.995),
        (one_joint(lower=[1.002], upper=[9.0]), Quantity.POSITION, 1.002),
    ],
)
def test_a_piece_beyond_a_limit_names_it(limits, quantity, limit):
    planner = ShortTermPlanner(limits, settings(1))
    result = planner.plan(STEADY, 0.0, 1.0)
    assert result.outcome is PlanOutcome.STATE_BEYOND_LIMITS and result.stop is StopKind.NONE
    assert (result.joint, result.quantity, result.limit) == (0, quantity, limit)
    assert planner.slices["n"][0] == 0
    relaxed = ShortTermPlanner(limits, settings(1, check_position_limits=False))
    ready = relaxed.plan(STEADY, 0.0, 1.0).outcome is PlanOutcome.READY
    assert ready == (quantity is Quantity.POSITION)


def test_a_joint_about_to_hit_its_stop_has_no_stop():
    planner = ShortTermPlanner(one_joint(lower=[-9.0], upper=[1.05]), settings(1))
    result = planner.plan(STEADY, 0.0, 1.0)
    assert result.outcome is PlanOutcome.NO_STOP
    assert (result.joint, result.quantity, result.limit) == (0, Quantity.POSITION, 1.05)
    assert result.value > 1.05


def late_turn() -> IntendedTrajectory:
    """One joint that turns harder than its limit just ahead."""
    # constant speed, then an acceleration of 40 rad/s² that grows from 0: far beyond 10 rad/s²
    first = np.array([0.0, 1.0, 0.0, 0.0])
    second = np.array([1.0, 1.0, 0.0, 400.0])
    return IntendedTrajectory([0.0, 1.0, 1.2], np.stack([first, second])[:, :, None])


def test_leaves_the_path_where_no_stop_on_it_keeps_the_limits():
    trajectory = late_turn()
    planner = ShortTermPlanner(one_joint(a=10.0, j=300.0), settings(1))
    result = planner.plan(trajectory, 0.0, 0.98)
    assert result.outcome is PlanOutcome.READY and result.stop is StopKind.JOINT_SPACE
    assert math.isnan(result.s_rest)
    stay = ShortTermPlanner(one_joint(a=10.0, j=300.0), settings(1, allow_joint_space=False))
    refused = stay.plan(trajectory, 0.0, 0.98)
    assert refused.outcome is PlanOutcome.NO_STOP
    assert refused.joint == 0 and refused.quantity in (
        Quantity.ACCELERATION,
        Quantity.JERK,
        Quantity.VELOCITY,
    )
    assert abs(refused.value) > refused.limit


def test_slices_are_lengthened_where_64_would_not_do():
    planner = ShortTermPlanner(one_joint(), settings(1, slice_s=1e-4))
    assert planner.plan(STEADY, 0.0, 1.0).outcome is PlanOutcome.READY
    assert 50 <= planner.slices["n"][0] <= MAX_SLICES
    slow = ShortTermPlanner(one_joint(a=0.3, j=3.0), settings(1, slice_s=0.01, cycle_s=0.1))
    assert slow.plan(STEADY, 0.0, 0.1).outcome is PlanOutcome.READY
    assert 50 <= slow.slices["n"][0] <= MAX_SLICES


def test_same_state_same_plan(rng):
    """A cycle is planned on its own: nothing is remembered from the one before."""
    case = next(random_cases(rng, "curved", 1))
    planner = ShortTermPlanner(case.limits, settings(len(case.limits.joints)))
    first = planner.plan(case.motion.trajectory, 0.0, case.state.s)
    block = planner.slices.copy()
    planner.plan(case.motion.trajectory, 0.0, 0.5 * case.state.s)
    assert planner.plan(case.motion.trajectory, 0.0, case.state.s) == first
    rows = int(block["n"][0])
    for name in ("t", "q", "dq", "ddq"):
        assert np.array_equal(block[name][0, : rows + 1], planner.slices[name][0, : rows + 1])


# Slices


@pytest.mark.parametrize("kind", KINDS)
def test_slices_contain_the_executed_motion(kind, rng, count):
    ready = 0
    for case in random_cases(rng, kind, count(10_000)):
        n = len(case.limits.joints)
        planner = ShortTermPlanner(case.limits, settings(n, allow_joint_space=False, cycle_s=0.004))
        t = rng.uniform(-100.0, 100.0)
        result = planner.plan(case.motion.trajectory, t, *case.state)
        if result.outcome is not PlanOutcome.READY:
            assert planner.slices["n"][0] == 0
            continue
        ready += 1
        slices, record = planner.slices[0], planner._manoeuvre.path[0]
        rows = int(slices["n"])
        assert 1 <= rows <= MAX_SLICES
        nodes = slices["t"][: rows + 1]
        assert (
            nodes[0] == t
            and nodes[-1] == pytest.approx(result.t_rest, abs=1e-9)
            and (np.diff(nodes) > 0).all()
        )
        # no slice straddles a switch of the path jerk
        switches = t + np.asarray(record["t"][: record["n"] + 1])
        assert all(np.abs(nodes - switch).min() < 1e-9 for switch in switches)
        check_slices(slices, n, lambda tau, r=record, m=case.motion: executed(m, r, tau)[:3], t)
        assert (slices["dq"][rows, :n] == 0.0).all() and (slices["ddq"][rows, :n] == 0.0).all()
        assert path_of(record, np.array([nodes[-1] - t]))[0][0] == pytest.approx(result.s_rest, abs=1e-9)
        assert (slices["dq_max"][:rows, :n] <= case.limits.velocity).all()
        assert (slices["ddq_max"][:rows, :n] <= case.limits.acceleration).all()
    assert ready > 0.7 * count(10_000)


def check_slices(slices: np.void, n: int, motion, begin: float) -> None:
    rows = int(slices["n"])
    inner = np.linspace(1e-6, 1.0 - 1e-6, 10)
    nodes = slices["t"][: rows + 1] - begin
    tau = nodes[:-1, None] + np.diff(nodes)[:, None] * inner
    _, dq, ddq = (x.reshape(rows, 10, n) for x in motion(tau.ravel()))
    slack = 1e-7
    assert (np.abs(dq) <= slices["dq_max"][:rows, None, :n] * (1 + slack) + 1e-8).all()
    assert (np.abs(ddq) <= slices["ddq_max"][:rows, None, :n] * (1 + slack) + 1e-6).all()
    q, dq, ddq = motion(nodes)
    assert np.allclose(q, slices["q"][: rows + 1, :n], rtol=1e-9, atol=1e-8)
    assert np.allclose(dq, slices["dq"][: rows + 1, :n], rtol=1e-7, atol=1e-7)
    jump = np.abs(ddq - slices["ddq"][: rows + 1, :n])
    assert (jump[1:-1] <= 1e-5 * (1 + np.abs(ddq[1:-1]))).all()


def test_slices_of_joint_space_stops_contain_the_executed_motion(rng, count):
    checked = 0
    for case in random_cases(rng, "curved", count(10_000)):
        n = len(case.limits.joints)
        planner = ShortTermPlanner(case.limits, settings(n, search_steps=1))
        planner._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
        result = planner.plan(case.motion.trajectory, 5.0, *case.state)
        if result.outcome is not PlanOutcome.READY:
            continue
        assert result.stop is StopKind.JOINT_SPACE
        checked += 1
        slices = planner.slices[0]
        rows = int(slices["n"])
        axes = planner._joint_space.axes
        begin = result.t_stop_begin
        piece = int(np.searchsorted(slices["t"][: rows + 1], begin - 1e-9))

        def motion(tau, axes=axes, n=n):
            return np.array([[axis_kernels.axis_state(axes, i, x) for i in range(n)] for x in tau]).transpose(
                2, 0, 1
            )

        stop = {name: slices[name][piece:] for name in ("t", "q", "dq", "ddq", "dq_max", "ddq_max")}
        check_slices(stop | {"n": rows - piece}, n, motion, begin)
        assert (slices["dq"][rows, :n] == 0.0).all() and (slices["ddq"][rows, :n] == 0.0).all()
        s_join = np.array([case.state.s + case.state.sdot * 0.01])
        q, d1, d2, *_ = (x[0] for x in case.motion.derivatives(s_join))
        assert np.allclose(slices["q"][piece, :n], q, atol=1e-9)
        assert np.allclose(slices["dq"][piece, :n], d1 * case.state.sdot, atol=1e-7)
        assert np.allclose(slices["ddq"][piece, :n], d2 * case.state.sdot**2, atol=1e-6)
    assert checked > 0


@pytest.mark.parametrize("slice_s", [0.01, 1e-3, 1e-4])
@pytest.mark.parametrize("cycle_s", [0.004, 0.1])
def test_a_stop_off_the_path_fills_the_slices_that_there_are(slice_s, cycle_s):
    """As long as is wanted, or just so long that there are enough of them for piece and stop."""
    planner = ShortTermPlanner(one_joint(), settings(1, slice_s=slice_s, cycle_s=cycle_s))
    planner._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
    result = planner.plan(STEADY, 3.0, 1.0)
    assert result.outcome is PlanOutcome.READY and result.stop is StopKind.JOINT_SPACE
    record = planner.slices[0]
    n, total = int(record["n"]), cycle_s + result.stop_time_s
    ends = record["t"][: n + 1]
    assert (ends[0], ends[n]) == (3.0, pytest.approx(3.0 + total))
    assert np.abs(ends - result.t_stop_begin).min() < 1e-12
    assert np.diff(ends).max() <= max(slice_s, total / (MAX_SLICES - 2)) * (1.0 + 1e-9)
    assert n >= MAX_SLICES - 4 or slice_s == 0.01


def test_tighter_limits_never_give_a_quicker_plan_of_one_joint(rng, count):
    for _ in range(count(2_000)):
        limits = random_limits(rng, 1)
        motion = random_motion(rng, limits, 0.5)
        s = rng.uniform(0.0, 0.5 * motion.trajectory.s_end)
        quick = ShortTermPlanner(limits, settings(1)).plan(motion.trajectory, 0.0, s)
        halved = replace(limits, acceleration=limits.acceleration / 3, jerk=limits.jerk / 3)
        slow = ShortTermPlanner(halved, settings(1)).plan(motion.trajectory, 0.0, s)
        if PlanOutcome.READY is quick.outcome is slow.outcome and quick.stop is slow.stop:
            assert slow.stop_time_s >= quick.stop_time_s


EXTREMES = (0.0, -0.0, 5e-324, 1e-300, 1e-16, 1e-9, 0.3, 1.0, 1.0 + 1e-15, 4.99, 5.0, 1e6, 1e16, 1e150, 1e308)


def test_planning_never_raises_nor_hangs_on_extreme_numbers(rng, count):
    planner = ShortTermPlanner(one_joint(), settings(1))
    resting = IntendedTrajectory([0.0, 1.0], np.array([0.0, 0, 0, 10, -15, 6]).reshape(1, 6, 1), "rest")
    for _ in range(count(50_000)):
        t, s, sdot, sddot = (float(rng.choice(EXTREMES) * rng.choice([1, 1, 1, -1])) for _ in range(4))
        for trajectory in (STEADY, resting):
            result = planner.plan(trajectory, t, s, sdot, sddot)
            assert isinstance(result.outcome, PlanOutcome)
            rows = int(planner.slices["n"][0])
            assert (rows > 0) == (result.outcome is PlanOutcome.READY)
            if rows:
                assert np.isfinite(planner.slices["q"][0, : rows + 1]).all()
                assert np.isfinite(planner.slices["dq_max"][0, :rows]).all()
