"""Braking as it was measured: what follows from the bound of the speed, against integration and by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from failsafe.braking import Braking
from failsafe.manoeuvre import Quantity
from failsafe.plan import PlanError, PlanOutcome, StopKind
from failsafe.scaling import PathState
from failsafe.silence import Silence
from failsafe.trajectory import IntendedTrajectory
from robots.errors import SetupError
from robots.motion import MAX_SLICES, new_slices
from tests.failsafe.motions import KINDS, limits_of, random_cases
from tests.failsafe.test_follow import planner_of

ONE = np.array([1.0])


def random_braking(rng: np.random.Generator, n: int) -> Braking:
    fastest = rng.uniform(0.5, 3.0, n)
    return Braking(
        float(rng.choice([0.0, rng.uniform(0.0, 0.3)])),
        float(rng.choice([0.0, rng.uniform(0.0, 0.5)])),
        rng.uniform(1.0, 20.0, n),
        fastest,
    )


def test_way_and_time_are_what_the_speed_adds_up_to(rng, count):
    for _ in range(count(1_000)):
        braking = random_braking(rng, 4)
        speed = braking.fastest * rng.uniform(0.0, 1.0, 4)
        end = float(braking.time(speed).max())
        x = np.linspace(0.0, end, 4001)
        v = np.array([braking.speed(speed, float(each)) for each in x])
        assert (np.diff(v, axis=0) <= 1e-12).all() and (v >= 0.0).all()
        way = np.trapezoid(v, x, axis=0)
        assert way == pytest.approx(braking.way(speed), abs=1e-5 + 1e-3 * end / 4)
        assert v[-1] == pytest.approx(np.zeros(4), abs=1e-9)
        early = 0.9 * braking.time(speed)
        for j in np.flatnonzero((speed > 0.01) & (braking.brakes_for(speed) > 1e-3)):
            assert braking.speed(speed, float(early[j]))[j] > 0.0


def test_by_hand():
    braking = Braking(0.1, 0.5, np.array([2.0, 2.0]), np.array([9.0, 9.0]))
    speed = np.array([0.5, 2.0])  # the slow one takes the braking time, the fast one its deceleration
    assert braking.time(speed) == pytest.approx([0.6, 1.1])
    assert braking.way(speed) == pytest.approx([0.05 + 0.125, 0.2 + 1.0])
    assert braking.speed(speed, 0.1) == pytest.approx(speed)
    assert braking.speed(speed, 0.35) == pytest.approx([0.25, 1.5])
    assert not braking.speed(np.zeros(2), 0.2).any()
    slower = braking.slower(0.5)
    assert slower.time(speed) == pytest.approx(1.5 * braking.time(speed))
    assert slower.way(speed) == pytest.approx(1.5 * braking.way(speed))
    assert slower.fastest.tolist() == [9.0, 9.0], "a margin measures nothing faster"
    at_once = Braking(0.0, 0.0, ONE, ONE)
    assert not at_once.speed(np.zeros(1), 0.1).any()


@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf, 11.0])
def test_times_that_cannot_be_used(bad):
    for given in ((bad, 0.1), (0.1, bad)):
        with pytest.raises(SetupError, match="braking"):
            Braking(*given, ONE, ONE)
    with pytest.raises(SetupError, match="margin"):
        Braking(0.1, 0.1, ONE, ONE).slower(bad)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_numbers_of_joints_that_cannot_be_used(bad):
    wrong = np.array([1.0, bad])
    with pytest.raises(SetupError, match="deceleration"):
        Braking(0.1, 0.1, wrong, np.ones(2))
    with pytest.raises(SetupError, match="fastest"):
        Braking(0.1, 0.1, np.ones(2), wrong)
    with pytest.raises(SetupError, match="1 decelerations and 2 speeds"):
        Braking(0.1, 0.1, ONE, np.ones(2))


CYCLE = 0.01


def planned(case, braking: Braking, **changes):
    planner = planner_of(case.limits, cycle_s=CYCLE, braking=braking, **changes)
    return planner, planner.plan(case.motion.trajectory, 2.0, case.state.s)


def middle(record, x: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, q and dq of the motion that the slices follow, at times ``x``: dq is linear between the nodes."""
    rows = int(record["n"])
    t = record["t"][: rows + 1]
    row = np.clip(np.searchsorted(t, x, side="right") - 1, 0, rows - 1)
    h, tau = (t[row + 1] - t[row])[:, None], (x - t[row])[:, None]
    v0, v1 = record["dq"][row, :n], record["dq"][row + 1, :n]
    q = record["q"][row, :n] + v0 * tau + 0.5 * (v1 - v0) * tau**2 / h
    return row, q, v0 + (v1 - v0) * tau / h


def stops_of(rng, motion, braking: Braking, s: float, x: np.ndarray):
    """Stops that the bound admits: as intended for a while, then steady braking, or the bound itself."""
    dense = np.linspace(0.0, braking.delay_s, 400)
    q0 = motion.derivatives(np.array([s]))[0][0]
    speeds = motion.derivatives(s + dense)[1]
    up, down = np.maximum(speeds.max(axis=0), 0.0), np.maximum(-speeds.min(axis=0), 0.0)
    for goes_on in (braking.delay_s, rng.uniform(0.0, braking.delay_s), 0.0):
        q, dq = (motion.derivatives(s + np.minimum(x, goes_on))[d] for d in (0, 1))
        last = dq[-1]
        top = np.where(last > 0.0, up, down)
        brake = rng.choice([1.0, 1.0, 3.0], len(last)) * top / np.maximum(braking.brakes_for(top), 1e-9)
        y = np.clip(x[:, None] - goes_on, 0.0, np.abs(last) / np.maximum(brake, 1e-300))
        late = x > goes_on
        q, dq = q.copy(), dq.copy()
        q[late] += (np.sign(last) * (np.abs(last) * y - 0.5 * brake * y**2))[late]
        dq[late] = (np.sign(last) * (np.abs(last) - brake * y))[late]
        yield q, dq
    for top, sign in ((up, 1.0), (down, -1.0)):
        v = np.array([braking.speed(top, float(each)) for each in x])
        brakes = braking.brakes_for(top)
        y = np.clip(x[:, None] - braking.delay_s, 0.0, brakes)
        share = np.divide(y, brakes, out=np.zeros_like(y), where=brakes > 0.0)
        yield q0 + sign * top * (np.minimum(x[:, None], braking.delay_s) + y * (1.0 - 0.5 * share)), sign * v


@pytest.mark.parametrize("kind", KINDS)
def test_every_stop_that_the_bound_admits_stays_within_the_slices(kind, rng, count):
    """Brute force."""
    plans, closest = 0, 0.0
    for case in random_cases(rng, kind, count(3_000)):
        n = len(case.limits.joints)
        braking = replace(random_braking(rng, n), fastest=2.0 * case.limits.velocity)
        planner, plan = planned(case, braking)
        record = planner.slices[0]
        if plan.outcome is not PlanOutcome.READY:
            assert record["n"] == 0
            continue
        plans += 1
        assert plan.stop is StopKind.MEASURED and plan.t_stop_begin == 2.0 + CYCLE
        rows = int(record["n"])
        assert plan.t_rest == record["t"][rows] == pytest.approx(2.0 + CYCLE + plan.stop_time_s)
        assert (np.diff(record["t"][: rows + 1]) > 0.0).all() and not record["dq"][rows, :n].any()
        x = np.linspace(0.0, plan.stop_time_s, 300)
        row, q, dq = middle(record, plan.t_stop_begin + x, n)
        assert (np.abs(dq) <= record["dq_max"][row, :n] + 1e-12).all()
        for true, speed in stops_of(rng, case.motion, braking, case.state.s + CYCLE, x):
            assert (np.abs(true - q) <= record["q_spread"][row, :n] + 1e-9).all()
            assert (np.abs(speed - dq) <= record["dq_spread"][row, :n] + 1e-8).all()
            used = np.abs(true - q) / np.maximum(record["q_spread"][row, :n], 1e-6)
            closest = max(closest, float(used.max()))
        piece = record["t"][1 : rows + 1] <= 2.0 + CYCLE + 1e-12
        assert piece.any() and not record["q_spread"][:rows][piece].any()
    assert plans > 0.2 * count(3_000) and closest > 0.8


def test_slices_follow_a_motion_that_they_bound(rng, count):
    for case in random_cases(rng, "curved", count(500)):
        n = len(case.limits.joints)
        planner, plan = planned(case, replace(random_braking(rng, n), fastest=2.0 * case.limits.velocity))
        if plan.outcome is not PlanOutcome.READY:
            continue
        record = planner.slices[0]
        rows = int(record["n"])
        first = int(np.searchsorted(record["t"][: rows + 1], plan.t_stop_begin - 1e-12))
        h = np.diff(record["t"][first : rows + 1])[:, None]
        dq, q = record["dq"][first : rows + 1, :n], record["q"][first : rows + 1, :n]
        assert np.diff(q, axis=0) == pytest.approx(0.5 * h * (dq[:-1] + dq[1:]), abs=1e-12)
        assert (np.abs(np.diff(dq, axis=0)) / h <= record["ddq_max"][first:rows, :n] + 1e-9).all()


def test_slower_braking_never_stands_for_less(rng, count):
    for case in random_cases(rng, "curved", count(500)):
        n = len(case.limits.joints)
        braking = replace(random_braking(rng, n), fastest=3.0 * case.limits.velocity)
        (one, quick), (other, slow) = planned(case, braking), planned(case, braking.slower(0.3))
        if PlanOutcome.READY not in (quick.outcome,) or slow.outcome is not PlanOutcome.READY:
            continue
        assert slow.stop_time_s >= quick.stop_time_s
        x = quick.t_stop_begin + np.linspace(0.0, quick.stop_time_s, 50)
        (row, q, _), (slow_row, slow_q, _) = (middle(each.slices[0], x, n) for each in (one, other))
        for sign in (1.0, -1.0):
            reach = sign * q + one.slices[0]["q_spread"][row, :n]
            wider = sign * slow_q + other.slices[0]["q_spread"][slow_row, :n]
            assert (wider >= reach - 0.02).all()  # slices of another length are cut elsewhere


def test_what_was_not_measured_or_leaves_the_limits_is_no_stop():
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]), [-9.0], [1.3])
    trajectory = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
    model = Braking(0.1, 0.2, np.array([5.0]), np.array([1.5]))

    def plan(s: float, braking: Braking = model, **changes):
        return planner_of(limits, cycle_s=CYCLE, braking=braking, **changes).plan(trajectory, 0.0, s)

    assert plan(1.0).outcome is PlanOutcome.READY
    slow = plan(1.0, replace(model, fastest=np.array([0.9])))
    assert (slow.outcome, slow.joint, slow.quantity) == (PlanOutcome.NO_STOP, 0, Quantity.VELOCITY)
    assert (slow.value, slow.limit) == pytest.approx((1.0, 0.9))
    far = plan(1.15)  # 1.16 + 0.1 + 0.1 at the most
    assert (far.outcome, far.quantity, far.limit) == (PlanOutcome.NO_STOP, Quantity.POSITION, 1.3)
    assert far.value == pytest.approx(1.36)
    assert plan(1.15, check_position_limits=False).outcome is PlanOutcome.READY
    assert plan(4.95).outcome is PlanOutcome.BEYOND_END
    error = planner_of(limits, cycle_s=CYCLE, braking=model, dq_error=np.array([0.6]))
    assert error.plan(trajectory, 0.0, 1.0).outcome is PlanOutcome.NO_STOP, "1.6 rad/s were not measured"
    loop = planner_of(limits, cycle_s=CYCLE, braking=model)
    assert loop.follow(trajectory, 0.0, PathState(1.0, 1.0, 0.0), 1.0).outcome is PlanOutcome.INVALID_STATE


def test_the_way_until_it_brakes_is_part_of_what_must_be_known():
    """With s̈ = 5 and for 0.11 s: from 4.85 to 4.99025, where 5.0 is known."""
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))
    trajectory = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
    planner = planner_of(limits, cycle_s=CYCLE, braking=Braking(0.1, 0.2, 5.0 * ONE, 2.0 * ONE))
    assert planner.plan(trajectory, 0.0, 4.85, 1.0, 5.0).outcome is PlanOutcome.READY
    late = planner.plan(trajectory, 0.0, 4.87, 1.0, 5.0)
    assert (late.outcome, late.limit) == (PlanOutcome.BEYOND_END, 5.0)
    assert late.value == pytest.approx(5.01025)


def test_settings_that_do_not_go_together():
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))
    model = Braking(0.1, 0.2, np.array([5.0]), np.array([1.5]))
    with pytest.raises(PlanError, match="no delay and no silence"):
        planner_of(limits, braking=model, delay=(0.0, 0.1))
    with pytest.raises(PlanError, match="no delay and no silence"):
        planner_of(limits, braking=model, silence=Silence(0.0, False, np.array([5.0])))
    with pytest.raises(PlanError, match="2 joints should be 1"):
        planner_of(limits, braking=Braking(0.1, 0.2, np.ones(2), np.ones(2)))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_a_number_leaves_no_slice(bad):
    model = Braking(0.1, 0.2, np.array([5.0]), np.array([1.5]))
    for up, down in ((np.array([bad]), np.zeros(1)), (np.zeros(1), np.array([bad]))):
        block = new_slices()
        record = block[0]
        record["n"], record["n_joints"], record["t"][1] = 1, 1, 0.01
        assert math.isnan(model.append(block, up, down, 0.01)) and record["n"] == 0
    block = new_slices()
    block[0]["n"], block[0]["n_joints"], block[0]["t"][1] = 1, 1, 0.01
    block[0]["q"][1, 0] = bad
    assert math.isnan(model.append(block, np.ones(1), np.zeros(1), 0.01)) and block[0]["n"] == 0
    full = new_slices()
    full[0]["n"], full[0]["n_joints"] = MAX_SLICES, 1
    assert math.isnan(model.append(full, np.ones(1), np.zeros(1), 0.01))


def twin(record, up: np.ndarray, down: np.ndarray, braking: Braking, end: float, rows: int):
    """q_spread, dq_spread, and q and dq at the nodes, of one joint told at its first node (plain NumPy)."""
    x = np.linspace(0.0, end, rows + 1)
    u, w = (np.array([braking.speed(top, float(each))[0] for each in x]) for top in (up, down))
    c = np.append([record["dq"][1, 0]], 0.5 * (u - w)[1:])
    c[-1] = 0.0
    q = record["q"][1, 0] + np.append([0.0], np.cumsum(0.5 * np.diff(x) * (c[:-1] + c[1:])))
    ways = []
    for top in (up, down):
        brakes = float(braking.brakes_for(top)[0])
        y = np.clip(x - braking.delay_s, 0.0, brakes)
        ways.append(top[0] * (np.minimum(x, braking.delay_s) + y * (1.0 - 0.5 * y / max(brakes, 1e-300))))
    moved = q - q[0]
    away = np.maximum(ways[0] - moved, moved + ways[1])
    slope = np.maximum(u[:-1] - np.minimum(c[:-1], c[1:]), np.maximum(c[:-1], c[1:]) + w[:-1])
    return np.maximum(away[:-1], away[1:]) + 0.5 * np.diff(x) * slope, slope, q, c


def test_the_kernel_against_its_twin(rng, count):
    for _ in range(count(2_000)):
        braking = random_braking(rng, 1)
        up, down = (rng.choice([0.0, 1.0]) * rng.uniform(0.0, 1.0, 1) for _ in range(2))
        block = new_slices()
        record = block[0]
        record["n"], record["n_joints"], record["t"][1] = 1, 1, 0.01
        record["q"][1, 0], record["dq"][1, 0] = rng.uniform(-2.0, 2.0), rng.uniform(-down[0], up[0])
        record["q_spread"], record["dq_spread"] = 9.0, 9.0  # left there by the plan before
        lasts = braking.append(block, up, down, 0.02)
        rows = int(record["n"]) - 1
        assert not record["q_spread"][0].any() and not record["dq_spread"][0].any()
        assert abs(rows - lasts / 0.02) <= 1.0
        true = max((float(braking.time(v)[0]) for v in (up, down) if v[0] > 0.0), default=0.0)
        assert lasts == pytest.approx(true, rel=1e-8)
        if rows == 0:
            continue
        spread, faster, q, dq = twin(record, up, down, braking, lasts, rows)
        assert record["q_spread"][1 : rows + 1, 0] == pytest.approx(spread, rel=1e-6, abs=1e-9)
        assert record["dq_spread"][1 : rows + 1, 0] == pytest.approx(faster, rel=1e-6, abs=1e-9)
        assert record["q"][1 : rows + 2, 0] == pytest.approx(q, abs=1e-9)
        assert record["dq"][1 : rows + 2, 0] == pytest.approx(dq, abs=1e-9)


@pytest.mark.parametrize("late", [0.0, 1e6])
def test_a_stop_ends_at_rest_however_coarse_the_clock(late, rng, count):
    """Instants around 1e6 s are 1e-10 s apart, of a stop that takes milliseconds."""
    for _ in range(count(5_000)):
        braking = Braking(0.0, float(rng.uniform(1e-3, 1e-2)), ONE, ONE)
        block = new_slices()
        record = block[0]
        record["n"], record["n_joints"], record["t"][:2] = 1, 1, (late, late + 0.01)
        record["dq"][1, 0] = 1e-3
        braking.append(block, np.array([1e-3]), np.zeros(1), 0.01)
        assert record["n"] == 2 and record["dq"][2, 0] == 0.0


def test_speeds_between_the_ends_of_slices_count_too():
    """From when the stop is told on: at most half a slice of acceleration above both ends, and the error."""
    limits = limits_of(ONE, ONE, ONE)
    planner = planner_of(limits, braking=Braking(0.1, 0.1, ONE, ONE), dq_error=np.array([0.125]))
    record = planner.slices[0]
    record["n"], record["t"][:3], record["dq"][:3, 0] = 2, (0.0, 1.0, 2.0), (0.5, -0.25, 0.0)
    record["ddq_max"][:2, 0] = 2.0, 0.5
    for told, up, down in ((1.0, 1.5, 1.25), (1.5, 0.25, 0.5)):
        assert [float(each[0]) for each in planner._speeds_from(told)] == [up + 0.125, down + 0.125]


def test_the_end_of_the_range_that_a_measured_stop_may_pass_is_named():
    two = np.array([9.0, 9.0])
    limits = limits_of(two, two, two, np.array([-1.0, -2.0]), np.array([1.0, 2.0]))
    planner = planner_of(limits, braking=Braking(0.1, 0.1, np.ones(2), np.ones(2)))
    inside = np.array([[-1.0, -2.0], [1.0, 2.0]])
    assert planner._beyond_positions(inside) is None
    for side, joint, value in ((0, 0, -1.25), (1, 0, 1.25), (0, 1, -2.25), (1, 1, 2.25)):
        ends = inside.copy()
        ends[side, joint] = value
        found = planner._beyond_positions(ends)
        assert found == (joint, Quantity.POSITION, value, math.copysign(1.0 + joint, value))
