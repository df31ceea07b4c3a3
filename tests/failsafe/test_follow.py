"""Plans of a loop: one after the other, with what succeeded before tried first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.plan import PlanOutcome, PlanSettings, StopKind
from failsafe.running_plan import RunningPlan
from failsafe.scaling import PathState
from failsafe.short_term_plan import PlanMemory, ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import rest_to_rest
from robots.motion import MAX_SLICES
from tests.failsafe.motions import (
    KINDS,
    Case,
    excess,
    executed,
    instants,
    limits_of,
    path_of,
    random_cases,
)
from tests.failsafe.test_short_term_plan import check_slices

CYCLE = 0.004
STEADY = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
ONE = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))


def planner_of(limits, **changes: object) -> ShortTermPlanner:
    n = len(limits.joints)
    values = {
        "cycle_s": CYCLE, "delay": (0.0, 0.0), "q_error": np.zeros(n), "dq_error": np.zeros(n),
        "allow_joint_space": False,
    }  # fmt: skip
    return ShortTermPlanner(limits, PlanSettings(**(values | changes)))


def check_plan(case: Case, planner: ShortTermPlanner, result, start: PathState, target: float, t: float):
    """The whole plan, against its segments integrated from the first state on."""
    record, slices = planner.path[0], planner.slices[0]
    tau = instants(record)
    q, dq, ddq, dddq = executed(case.motion, record, tau)
    assert np.isfinite(q).all()
    assert excess(case.limits, dq, ddq, dddq) <= 1.0 + 1e-6
    s, v, a, _ = path_of(record, np.append(tau, record["t"][record["n"]]))
    slack = 1e-9 * (1.0 + abs(start.sddot))
    assert np.allclose((s[0], v[0], a[0]), start, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(a).max()))
    assert v.min() >= -1e-9 and np.diff(s).min() >= -1e-9
    assert abs(v[-1]) <= 1e-8 and abs(a[-1]) <= 1e-6 * (1.0 + np.abs(a).max())
    assert s[-1] == pytest.approx(result.s_rest, abs=1e-8)
    # the piece goes to its target and not beyond, what was begun of s̈ taken into account
    piece = tau <= CYCLE + 1e-12
    rise = 0.5 * start.sddot**2 / result_jerk(record)
    low, high = min(start.sdot, target), max(start.sdot, target)
    assert v[:-1][piece].max() <= high + (rise if start.sddot > 0 else 0.0) + slack
    assert v[:-1][piece].min() >= low - (rise if start.sddot < 0 else 0.0) - slack
    # the slices hold the same motion
    rows = int(slices["n"])
    nodes = slices["t"][: rows + 1]
    assert 1 <= rows <= MAX_SLICES and nodes[0] == t and (np.diff(nodes) > 0.0).all()
    assert nodes[-1] == pytest.approx(result.t_rest, abs=1e-9)
    check_slices(slices, len(case.limits.joints), lambda x: executed(case.motion, record, x)[:3], t)
    assert any(abs(nodes - (t + CYCLE)) < 1e-9)


def result_jerk(record) -> float:
    """Smallest path jerk that differs from 0 in the piece."""
    inside = np.asarray(record["t"][: record["n"]]) < CYCLE
    jerks = np.abs(np.asarray(record["j"][: record["n"]])[inside])
    return float(jerks[jerks > 0.0].min(initial=math.inf))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("warm", [False, True])
def test_piece_and_stop_keep_all_limits(kind, warm, rng, count):
    ready = 0
    for case in random_cases(rng, kind, count(4_000)):
        planner = planner_of(case.limits)
        if warm:  # as if another state had been planned in the cycle before
            planner._last_stop = tuple(10.0 ** rng.uniform(-2, 4, 2))
            planner._change = tuple(10.0 ** rng.uniform(-2, 4, 2))
            planner._pause = planner._left = int(rng.integers(1, 4))
        target = float(rng.choice([0.0, 1.0, rng.uniform(0.0, 1.0)]))
        t = rng.uniform(-100.0, 100.0)
        result = planner.follow(case.motion.trajectory, t, case.state, target)
        if result.outcome is not PlanOutcome.READY:
            assert planner.slices["n"][0] == 0
            continue
        ready += 1
        check_plan(case, planner, result, case.state, target, t)
    assert ready > 0.4 * count(4_000)


@pytest.mark.parametrize("kind", ["curved", "near_limits", "rough"])
def test_a_loop_stays_within_the_limits(kind, rng, count):
    """Cycle after cycle, from standstill, with targets that change: adopt, or let the stop go on."""
    moved = 0
    for case in random_cases(rng, kind, max(2, count(200))):
        planner, trajectory = planner_of(case.limits), case.motion.trajectory
        state, target, stopping = PathState(case.state.s, 0.0, 0.0), 1.0, 0.0
        record = None
        for k in range(120):
            if rng.random() < 0.1:
                target = float(rng.choice([0.0, 1.0, rng.uniform(0.0, 1.0)]))
            plan = planner.follow(trajectory, k * CYCLE, state, target)
            if plan.outcome is PlanOutcome.READY and rng.random() < 0.9:
                record, stopping = planner.path[0].copy(), 0.0
                check_plan(case, planner, plan, state, target, k * CYCLE)
            if record is None:
                break
            stopping += CYCLE
            if stopping >= record["t"][record["n"]]:
                state = PathState(float(path_of(record, record["t"][[record["n"]]])[0][0]), 0.0, 0.0)
            else:
                s, v, a, _ = path_of(record, np.array([stopping]))
                state = PathState(float(s[0]), max(0.0, float(v[0])), float(a[0]))
            moved = max(moved, state.s - case.state.s)
    assert moved > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_a_steady_plan_in_one_call_is_the_plan_of_single_steps(kind, rng, count):
    """Constant path speed with a stop that is remembered: one compiled call, or one after the other."""
    quick = 0
    for case in random_cases(rng, kind, count(2_000)):
        state = PathState(case.state.s, case.state.sdot, 0.0)
        planners = [planner_of(case.limits) for _ in range(2)]
        found = [each.follow(case.motion.trajectory, 0.5, state, state.sdot) for each in planners]
        assert found[0] == found[1] or found[0].outcome is not PlanOutcome.READY
        if found[0].outcome is not PlanOutcome.READY:
            continue
        factor, pause = rng.choice([0.5, 0.9, 1.0, 1.02, 1.2]), int(rng.integers(1, 4))
        for each in planners:
            assert each._last_stop is not None
            each._last_stop = (factor * each._last_stop[0], factor * each._last_stop[1])
            each._pause = each._left = pause
        one, many = planners
        many._manoeuvre.steady_then = lambda *_: False
        later = PathState(state.s + CYCLE * state.sdot, state.sdot, 0.0)
        first = one.follow(case.motion.trajectory, 0.504, later, later.sdot)
        second = many.follow(case.motion.trajectory, 0.504, later, later.sdot)
        assert first.outcome is second.outcome
        if first.outcome is PlanOutcome.READY:
            assert first == second
            assert one.slices.tobytes() == many.slices.tobytes() or same_rows(one.slices, many.slices)
            quick += one._manoeuvre.candidates == 0 or one._manoeuvre.a_s == one._last_stop[0]
    assert quick > 0.3 * count(2_000)


def same_rows(a, b) -> bool:
    """Whether two blocks of slices say the same in the rows that they use."""
    n = int(a["n"][0])
    ends = all((a[name][0, : n + 1] == b[name][0, : n + 1]).all() for name in ("t", "q", "dq", "ddq"))
    inside = all((a[name][0, :n] == b[name][0, :n]).all() for name in ("dq_max", "ddq_max"))
    return n == int(b["n"][0]) and ends and inside


def test_a_quicker_stop_is_tried_less_often_while_it_does_not_succeed():
    planner, tried = planner_of(ONE, cycle_s=0.01), []
    for k in range(150):
        assert planner.follow(STEADY, 0.01 * k, PathState(1.0 + 0.01 * k, 1.0, 0.0), 1.0).stop
        tried.append(planner._left == planner._pause and planner._pause > 1)
    assert sum(tried[:10]) >= 2, "at first"
    assert 1 <= sum(tried[80:]) <= 4, "later on"


BAD = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-320, 1e300)


@pytest.mark.parametrize("first", BAD)
@pytest.mark.parametrize("second", BAD)
def test_a_spoilt_memory_never_spoils_a_plan(first, second, rng):
    for case in random_cases(rng, "accelerated", 5):
        planner = planner_of(case.limits)
        planner._last_stop = planner._change = (first, second)
        for _ in range(3):
            result = planner.follow(case.motion.trajectory, 0.0, case.state, 1.0)
            if result.outcome is PlanOutcome.READY:
                check_plan(case, planner, result, case.state, 1.0, 0.0)
                assert math.isfinite(result.a_s) and math.isfinite(result.j_s)


def test_reaching_the_target_is_kept_for_the_rest_of_the_cycle():
    planner = planner_of(ONE, cycle_s=0.1)
    result = planner.follow(STEADY, 0.0, PathState(1.0, 0.999, 0.0), 1.0)
    assert result.outcome is PlanOutcome.READY
    _s, v, a, _ = path_of(planner.path[0], np.array([0.05, 0.0999]))
    assert v == pytest.approx([1.0, 1.0]) and a == pytest.approx([0.0, 0.0], abs=1e-6)
    steady = planner.follow(STEADY, 0.0, PathState(1.0, 1.0, 0.0), 1.0)
    assert steady.stop is StopKind.PATH_CONSISTENT
    assert steady.s_rest == pytest.approx(1.1 + steady.stop_time_s / 2, abs=1e-6)


@pytest.mark.parametrize("spoilt", ["t", "s", "sdot", "sddot", "target"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_plan_from_numbers_that_are_none(spoilt, value):
    planner = planner_of(ONE)
    values = {"t": 0.0, "s": 1.0, "sdot": 0.5, "sddot": 0.0, "target": 1.0} | {spoilt: value}
    state = PathState(values["s"], values["sdot"], values["sddot"])
    result = planner.follow(STEADY, values["t"], state, values["target"])
    assert result.outcome is not PlanOutcome.READY and planner.slices["n"][0] == 0


@pytest.mark.parametrize("target", [-0.1, -1e-300])
def test_no_plan_backwards_or_for_another_robot(target):
    planner = planner_of(ONE)
    assert planner.follow(STEADY, 0.0, PathState(1.0, 0.5), target).outcome is PlanOutcome.INVALID_STATE
    assert planner.follow(STEADY, 0.0, PathState(1.0, -0.5), 1.0).outcome is PlanOutcome.INVALID_STATE
    other = IntendedTrajectory([0.0, 5.0], np.zeros((1, 2, 2)))
    assert planner.follow(other, 0.0, PathState(1.0, 0.5), 1.0).outcome is PlanOutcome.INVALID_STATE


def test_a_state_beyond_the_limits_is_said_with_when_its_stop_would_begin():
    too_fast = planner_of(ONE).follow(STEADY, 1.0, PathState(1.0, 2.5, 0.0), 2.5)
    assert too_fast.outcome is PlanOutcome.STATE_BEYOND_LIMITS
    assert too_fast.t_stop_begin == pytest.approx(1.0 + CYCLE)


@pytest.mark.parametrize("start", [PathState(1.0, 0.0), PathState(1.0, 0.5), PathState(1.0, 0.5, -1.0)])
def test_a_first_cycle_that_is_not_proven_by_itself_is_no_plan(start, monkeypatch):
    """However many gentler changes are tried in its place."""
    planner = planner_of(ONE)
    assert planner.follow(STEADY, 0.0, start, 1.0).outcome is PlanOutcome.READY
    monkeypatch.setattr(planner, "_cut_to_cycle", lambda trajectory: False)
    assert planner.follow(STEADY, 0.0, start, 1.0).outcome is not PlanOutcome.READY
    assert planner.slices["n"][0] == 0


def test_no_plan_past_what_is_known():
    planner = planner_of(ONE)
    for s in (4.95, 4.999, 5.0, 5.001, -0.001):
        assert planner.follow(STEADY, 0.0, PathState(s, 1.0), 1.0).outcome is PlanOutcome.BEYOND_END
        assert planner.slices["n"][0] == 0
    assert planner.follow(STEADY, 0.0, PathState(4.8, 1.0), 1.0).outcome is PlanOutcome.READY


def test_at_rest_where_what_is_known_ends():
    planner = planner_of(ONE)
    result = planner.follow(STEADY, 0.0, PathState(5.0, 0.0), 0.0)
    assert (result.outcome, result.s_rest) == (PlanOutcome.READY, 5.0)
    assert planner.follow(STEADY, 0.0, PathState(5.0, 0.0), 1.0).outcome is not PlanOutcome.READY


def test_the_last_stop_is_tried_first_now_and_then_a_quicker_one_and_else_a_slower_one():
    planner, tried = planner_of(ONE), []
    steady_then = planner._manoeuvre.steady_then
    planner._manoeuvre.steady_then = lambda *given: tried.append(given[2].stop) or steady_then(*given)
    last, quicker = None, 0
    for cycle in range(12):
        tried.clear()
        result = planner.follow(STEADY, CYCLE * cycle, PathState(1.0 + CYCLE * cycle, 1.0), 1.0)
        if last is None:
            assert tried == []
        else:
            shares = [(a / last.a_s, j / last.j_s) for a, j in tried]
            assert all(a == pytest.approx(j) for a, j in shares)
            if shares[0][0] != 1.0:
                quicker += 1
                assert shares[0][0] > 1.0
            assert 1.0 in [a for a, _ in shares] or len(shares) == 1
        last = result
    assert 2 <= quicker < 11
    planner._manoeuvre.steady_then = lambda *given: tried.append(given[2].stop)
    tried.clear()
    planner.follow(STEADY, 0.1, PathState(1.1, 1.0), 1.0)
    assert tried[-1][0] < last.a_s and tried[-1][1] < last.j_s


def test_a_robot_at_rest_sets_out_from_every_place_of_its_path(rng, count):
    """Also just beyond a waypoint, where after a cycle of the quickest change of path speed nothing stops."""
    limits = limits_of(np.full(6, 3.0), np.full(6, 10.0), np.full(6, 100.0))
    low, high = np.full(6, -2.0), np.full(6, 2.0)
    gentle = 0
    for _ in range(max(4, count(200))):
        path = rest_to_rest(rng.uniform(low, high, (3, 6)), limits, share=0.7)
        planner = planner_of(limits, cycle_s=0.008)
        for s in np.linspace(path.s_begin, path.s_end, 200, endpoint=False):
            planner.memory = PlanMemory()
            start = PathState(float(s), 0.0, 0.0)
            assert planner.follow(path, 0.0, start, 1.0).outcome is PlanOutcome.READY, s
            gentle += planner.memory.gentle
    assert gentle > 0, "vacuous: the quickest change of path speed would always do"


def cycles_lost(rng: np.random.Generator, planner: ShortTermPlanner, limits) -> int:
    """Drive a path with a stop in the middle of it; in how many cycles after that no plan was found."""
    cycle = planner.settings.cycle_s
    path = rest_to_rest(rng.uniform(-2.0, 2.0, (3, 6)), limits)
    running, state, begun, lost, k = RunningPlan(path, 0.0), PathState(0.0, 0.0, 0.0), 0, 0, 0
    first = int(rng.integers(40, 200))
    after = first + int(rng.integers(3, 15))
    while state.s < path.s_end - 1e-3 and k < 3_000:
        plan = planner.follow(path, cycle * k, state, 1.0)
        if plan.outcome is PlanOutcome.READY and not first <= k < after:
            running.take(path, planner, plan)
            begun = k
        lost += plan.outcome is not PlanOutcome.READY and k >= after
        k += 1
        state = running.path_state(cycle * (k - begun))
    assert k < 3_000, "it does not arrive"
    return lost


def test_out_of_the_middle_of_a_stop_it_goes_on(rng, count):
    """Where the wanted speed cannot be aimed at yet, the deceleration is let go first."""
    limits = limits_of(np.full(6, 3.14), np.full(6, 10.0), np.full(6, 400.0))
    with_it = without = 0
    for _ in range(max(30, count(600))):
        seed = int(rng.integers(2**32))
        planners = [planner_of(limits, cycle_s=0.01) for _ in range(2)]
        planners[1]._released = lambda *_: None
        with_it += cycles_lost(np.random.default_rng(seed), planners[0], limits)
        without += cycles_lost(np.random.default_rng(seed), planners[1], limits)
    assert with_it < 0.5 * without, f"{with_it} cycles without a plan, {without} without letting go"


def test_a_gentle_change_becomes_quicker_and_arrives(rng):
    """From where only a gentle change of path speed has a stop the target is reached like from elsewhere."""
    limits = limits_of(np.full(6, 3.0), np.full(6, 10.0), np.full(6, 100.0))
    found = 0
    for _ in range(40):
        path = rest_to_rest(rng.uniform(-2.0, 2.0, (3, 6)), limits, share=0.7)
        planner = planner_of(limits, cycle_s=0.008)
        for s in np.linspace(path.breaks[1], path.breaks[1] + 0.15, 12):
            planner.memory = PlanMemory()
            state, running, begun = PathState(float(s), 0.0, 0.0), RunningPlan(path, float(s)), 0
            planner.follow(path, 0.0, state, 1.0)
            if not planner.memory.gentle:
                continue
            found += 1
            for k in range(400):
                plan = planner.follow(path, 0.008 * k, state, 1.0)
                if plan.outcome is PlanOutcome.READY:
                    running.take(path, planner, plan)
                    begun = k
                state = running.path_state(0.008 * (k + 1 - begun))
                if state.sdot == 1.0:
                    break
            assert state.sdot == pytest.approx(1.0), f"from {s} it came to {state}"
    assert found > 0


def test_a_new_planner_remembers_nothing():
    assert planner_of(ONE).memory == PlanMemory() == (None, False, None, 1, 1)


def test_a_planner_with_the_memory_of_another_makes_the_same_plan(rng, count):
    """And one without it, in general, another one: what was tried before is tried first."""
    different = 0
    for case in random_cases(rng, "curved", count(1_000)):
        one, other, third = (planner_of(case.limits) for _ in range(3))
        for target in (1.0, 0.3, 1.0):
            other.memory = one.memory
            plans = [
                planner.follow(case.motion.trajectory, 0.0, case.state, target)
                for planner in (one, other, third)
            ]
            assert str(plans[0]) == str(plans[1]) and one.memory == other.memory
            assert np.array_equal(one.path, other.path) and np.array_equal(one.slices["q"], other.slices["q"])
            third.memory = PlanMemory()
            different += str(plans[0]) != str(plans[2])
    assert different > 0


def test_a_change_within_the_cycle_may_end_where_what_is_known_ends():
    """To rest exactly at the end of the path, or a rounding beyond it."""
    start = PathState(1.0, 1e-4, 0.0)
    result = planner_of(ONE, cycle_s=0.1).follow(STEADY, 0.0, start, 0.0)
    assert result.outcome is PlanOutcome.READY and 1.0 < result.s_rest < 1.001
    assert result.stop_time_s == pytest.approx(0.0, abs=1e-9), "it rests before the cycle ends"
    for end, outcome in (
        (result.s_rest, PlanOutcome.READY),
        (math.nextafter(result.s_rest, 0.0), PlanOutcome.BEYOND_END),
    ):
        cut = IntendedTrajectory([0.0, end], [[[0.0], [1.0]]])
        assert planner_of(ONE, cycle_s=0.1).follow(cut, 0.0, start, 0.0).outcome is outcome
