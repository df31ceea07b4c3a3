"""The robot's own reaction to silence: every one that is admitted stays within the slices of the plan."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.short_term_plan import PlanError, PlanOutcome, PlanSettings, ShortTermPlanner, StopKind
from failsafe.silence import Silence
from failsafe.silence_kernels import AFTER_REST, travel
from robots.errors import SetupError
from robots.motion import MAX_SLICES, new_slices
from tests.failsafe.motions import KINDS, executed, random_cases
from tests.failsafe.test_follow import planner_of as planner

CYCLE = 0.008
STEPS = 400


def planner_of(limits, silence: Silence | None, **changes: object) -> ShortTermPlanner:
    return planner(limits, **({"cycle_s": CYCLE, "silence": silence, "allow_joint_space": True} | changes))


def silence_of(rng: np.random.Generator, limits) -> Silence:
    share = 10.0 ** rng.uniform(-1.0, 0.3)
    return Silence(
        float(rng.choice([0.0, 0.004, 0.05])), bool(rng.random() < 0.5), share * limits.acceleration
    )


def reaction(
    rng: np.random.Generator, silence: Silence, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One admissible reaction from a state: q, dq at the times ``x`` after the silence began, exactly.

    Each joint goes on for some time that is allowed, then brakes with some deceleration that is.
    """
    hold = silence.hold_s * rng.choice([0.0, 1.0, rng.random()], q.shape)
    brake = silence.deceleration * rng.choice([1.0, 1.0, 1.5, 100.0], q.shape)
    a = ddq if silence.extrapolates else np.zeros_like(ddq)
    u = np.minimum(x[:, None], hold)
    speed, place = dq + a * u, q + dq * u + a * u**2 / 2
    y = np.minimum(np.maximum(x[:, None] - hold, 0.0), np.abs(dq + a * hold) / brake)
    sign = np.sign(dq + a * hold)
    place = place + speed * y - sign * brake * y**2 / 2
    return place, speed - sign * brake * y


def rows_at(slices, t: np.ndarray) -> np.ndarray:
    n = int(slices["n"])
    return np.clip(np.searchsorted(slices["t"][: n + 1], t, side="right") - 1, 0, n - 1)


@pytest.mark.parametrize("kind", KINDS)
def test_every_reaction_stays_within_the_slices_until_it_has_ended(kind, rng, count):
    """Brute force: silence at any instant, each joint with a reaction of its own."""
    closest = 0.0
    reactions = 0
    for case in random_cases(rng, kind, count(4_000)):
        silence = silence_of(rng, case.limits)
        planner = planner_of(case.limits, silence, allow_joint_space=False)
        t = float(rng.uniform(-10.0, 10.0))
        plan = planner.plan(case.motion.trajectory, t, case.state.s, case.state.sdot, case.state.sddot)
        if plan.outcome is not PlanOutcome.READY:
            assert planner.slices["n"][0] == 0
            continue
        record, slices = planner.path[0], planner.slices[0]
        duration = float(record["t"][record["n"]])
        n = int(slices["n"])
        assert plan.t_rest == slices["t"][n] >= t + duration
        for begin in (CYCLE, float(rng.uniform(CYCLE, duration))):
            tau = np.array([begin])
            q, dq, ddq, _ = (row[0] for row in executed(case.motion, record, tau))
            x = np.linspace(0.0, plan.t_rest - t - begin + 0.1, STEPS)
            place, speed = reaction(rng, silence, q, dq, ddq, x)
            moving = (np.abs(speed) > 1e-9).any(axis=1)
            assert not moving[x > plan.t_rest - t - begin].any(), "it goes on after the last slice"
            x, place, speed = x[moving], place[moving], speed[moving]
            at = np.minimum(begin + x, duration)
            planned, planned_speed, _, _ = executed(case.motion, record, at)
            planned_speed[begin + x >= duration] = 0.0
            row = rows_at(slices, t + begin + x)
            room = slices["q_spread"][row, : q.size] - np.abs(place - planned)
            assert room.min(initial=math.inf) >= -1e-9
            faster = slices["dq_spread"][row, : q.size] - np.abs(speed - planned_speed)
            assert faster.min(initial=math.inf) >= -1e-8
            reactions += len(x) > 0
            used = np.abs(place - planned) / np.maximum(slices["q_spread"][row, : q.size], 1e-9)
            closest = max(closest, float(used.max(initial=0.0)))
    assert reactions > 0.5 * count(4_000)
    assert closest > 0.5, "vacuous: no reaction comes near to the bound"


def test_a_joint_space_stop_stands_for_reactions_too(rng, count):
    """Where each joint stops by itself: reactions from the ends of slices, looked at there."""
    reactions = 0
    for case in random_cases(rng, "curved", count(4_000)):
        silence = silence_of(rng, case.limits)
        planners = [planner_of(case.limits, each) for each in (None, silence)]
        for each in planners:
            each._manoeuvre.search = lambda *_: False  # as if there were no stop on the path
        plans = [
            each.plan(case.motion.trajectory, 1.0, case.state.s, case.state.sdot, case.state.sddot)
            for each in planners
        ]
        assert plans[0]._replace(t_rest=0.0) == pytest.approx(plans[1]._replace(t_rest=0.0), nan_ok=True)
        if plans[1].stop is not StopKind.JOINT_SPACE:
            continue
        plain, record = (each.slices[0] for each in planners)
        rows, n = int(plain["n"]), int(record["n_joints"])
        for name in ("t", "q", "dq", "ddq"):
            assert (record[name][: rows + 1] == plain[name][: rows + 1]).all()
        rows, t = int(record["n"]), record["t"]
        for source in range(int(np.argmax(t >= 1.0 + CYCLE - 1e-12)), int(plain["n"])):
            state = (record[name][source, :n] for name in ("q", "dq", "ddq"))
            place, speed = reaction(rng, silence, *state, np.maximum(t[: rows + 1] - t[source], 0.0))
            away = np.abs(place - record["q"][: rows + 1, :n])
            for node in range(source, rows + 1):
                if (np.abs(speed[node]) > 1e-9).any():
                    assert node < rows, "it goes on after the last slice"
                    for row in {max(node - 1, source), node}:
                        assert (away[node] <= record["q_spread"][row, :n] + 1e-9).all()
                    reactions += 1
    assert reactions > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_piece_is_as_without_and_nothing_stands_for_more_without(kind, rng, count):
    for case in random_cases(rng, kind, count(1_000)):
        planner, plain = planner_of(case.limits, silence_of(rng, case.limits)), planner_of(case.limits, None)
        given = (case.motion.trajectory, 0.0, case.state.s, case.state.sdot, case.state.sddot)
        plan, without = planner.plan(*given), plain.plan(*given)
        assert plan.outcome is without.outcome
        if plan.outcome is not PlanOutcome.READY:
            continue
        record, slices = planner.slices[0], plain.slices[0]
        assert not slices["q_spread"].any() and not slices["dq_spread"].any()
        piece = record["t"][1 : int(record["n"]) + 1] <= CYCLE
        assert piece.any() and not record["q_spread"][: record["n"]][piece].any()
        assert record["q_spread"][: record["n"]][~piece].any()


@pytest.mark.parametrize("longer", ["hold", "extrapolates", "deceleration"])
def test_more_of_a_reaction_never_makes_a_slice_stand_for_less(longer, rng, count):
    for case in random_cases(rng, "curved", count(1_000)):
        one = silence_of(rng, case.limits)
        one = Silence(one.hold_s, False, one.deceleration)
        other = {
            "hold": Silence(one.hold_s + 0.01, False, one.deceleration),
            "extrapolates": Silence(one.hold_s, True, one.deceleration),
            "deceleration": Silence(one.hold_s, False, 0.7 * one.deceleration),
        }[longer]
        planners = [planner_of(case.limits, each) for each in (one, other)]
        plans = [
            each.plan(case.motion.trajectory, 0.0, case.state.s, case.state.sdot, case.state.sddot)
            for each in planners
        ]
        assert plans[0].outcome is plans[1].outcome
        if plans[0].outcome is not PlanOutcome.READY:
            continue
        less, more = (each.slices[0] for each in planners)
        rows = int(np.argmax(less["t"] >= plans[0].t_stop_begin + plans[0].stop_time_s - 1e-12))
        assert plans[1].t_rest >= plans[0].t_rest - 1e-9
        for name in ("q_spread", "dq_spread"):
            assert (more[name][:rows] >= less[name][:rows] - 1e-12).all()


def test_travel_in_closed_form():
    assert travel(2.0, 0.1, 4.0, 0.05) == pytest.approx(0.1)
    assert travel(2.0, 0.1, 4.0, 0.2) == pytest.approx(0.2 + 2.0 * 0.1 - 0.5 * 4.0 * 0.01)
    assert travel(2.0, 0.1, 4.0, 0.6) == travel(2.0, 0.1, 4.0, 9.0) == pytest.approx(0.2 + 0.5)
    assert travel(0.0, 0.1, 4.0, 1.0) == 0.0
    assert math.isnan(travel(math.nan, 0.1, 4.0, 1.0))


def plan_by_hand(rows: int) -> np.ndarray:
    """One joint that brakes from 1 rad/s within a second; silence from the second slice on."""
    block = new_slices()
    record = block[0]
    record["n"], record["n_joints"] = rows, 1
    t = np.linspace(0.0, 1.0, rows + 1)
    record["t"][: rows + 1] = t
    record["q"][: rows + 1, 0], record["dq"][: rows + 1, 0] = t - t**2 / 2, 1.0 - t
    record["ddq"][: rows + 1, 0] = -1.0
    record["dq_max"][:rows, 0], record["ddq_max"][:rows, 0] = 1.0, 1.0
    return block


@pytest.mark.parametrize("rows", [2, MAX_SLICES - 3, MAX_SLICES])
def test_a_slow_reaction_is_looked_at_to_its_end_however_many_slices_there_are(rows):
    block = plan_by_hand(rows)
    record = block[0]
    for name in ("q", "dq", "ddq", "dq_max", "ddq_max"):  # of the plan before
        record[name][rows + (name in ("q", "dq", "ddq")) :] = 9.0
    assert Silence(0.2, False, np.array([0.5])).widen(block, 1.0 / rows)
    n = int(record["n"])
    assert (record["q"][rows + 1 : n + 1, 0] == 0.5).all()
    for name in ("dq", "ddq", "dq_max", "ddq_max"):
        assert not record[name][rows + (name in ("dq", "ddq")) : n + (name in ("dq", "ddq")), 0].any()
    assert n == min(MAX_SLICES, rows + AFTER_REST)
    v = 1.0 - 1.0 / rows  # where silence may begin, and the slice on which it does
    assert record["t"][n] == pytest.approx(2.0 / rows + 0.2 + (v + 0.5 / rows) / 0.5, abs=1e-6)
    assert (np.diff(record["t"][: n + 1]) > 0.0).all()
    # from there on 0.2 s and then v²/(2 a), instead of v²/2
    farther = v * 0.2 + v**2 / (2 * 0.5) - v**2 / 2
    assert farther <= record["q_spread"][n - 1, 0] <= farther + 6.0 / rows


def test_silence_may_have_begun_at_the_begin_of_a_slice():
    """Just after the plan rests, a joint that was held since then is farther than one held since later."""
    block = plan_by_hand(2)
    assert Silence(1.0, False, np.array([0.5])).widen(block, 0.5)
    t = block["t"][0, 3]
    assert block["q_spread"][0, 2, 0] >= 0.5 * (t - 0.5) - 0.125


@pytest.mark.parametrize("name", ["t", "q", "dq", "ddq_max"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_a_number_leaves_no_slice(name, bad):
    block = plan_by_hand(8)
    block[name][0][5] = bad
    assert not Silence(0.2, True, np.array([0.5])).widen(block, 0.125)
    assert block["n"][0] == 0


def test_settings_that_cannot_be_used():
    one = np.array([1.0])
    for hold in (-0.1, math.nan, math.inf, 2.0):
        with pytest.raises(SetupError, match="hold"):
            Silence(hold, False, one)
    for deceleration in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(SetupError, match="deceleration"):
            Silence(0.1, False, np.array([deceleration]))
    with pytest.raises(SetupError, match="deceleration"):
        Silence(0.1, False, np.array(1.0))
    zero = np.zeros(2)
    with pytest.raises(PlanError, match="1 decelerations should be 2"):
        PlanSettings(0.01, (0.0, 0.0), zero, zero, silence=Silence(0.1, False, one))
