"""The robot's own reaction to silence: every one that is admitted stays within the slices of the plan."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.plan import (
    PlanError,
    PlanOutcome,
    PlanSettings,
    StopKind,
)
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.silence import Silence
from failsafe.silence_kernels import AFTER_REST, _lasts, _speeds, _widen_row, travel
from robots.errors import SetupError
from robots.motion import MAX_SLICES, new_slices
from tests.failsafe.motions import KINDS, executed, random_cases
from tests.failsafe.test_follow import planner_of as planner

CYCLE = 0.008
STEPS = 400
NAN = math.nan


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


@pytest.mark.parametrize("extrapolates", [False, True])
def test_speeds_on_a_slice_and_of_a_reaction_that_begins_there(extrapolates):
    """dq from 1 to 3 in 0.2 s, ddq at most 12: by hand, and what a hold of 0.1 s adds."""
    block, out = new_slices(), np.zeros((4, 3))
    record = block[0]
    record["n"], record["n_joints"], record["t"][:5] = 3, 3, (0.0, 0.5, 0.7, 1.7, 9.0)
    record["dq"][:4, 0] = 50.0, 1.0, 3.0, -50.0
    record["dq"][:4, 1] = 50.0, -3.0, -1.0, -50.0
    record["dq"][:4, 2] = 50.0, 4.0, -5.0, -50.0
    record["ddq_max"][:3] = 99.0
    record["ddq_max"][1, :3] = 12.0, 12.0, 0.0
    _speeds(block, 1, 0.1, extrapolates, out)
    # within half the slice, 0.1 s, dq leaves the nearer end by 1.2 at most
    assert out[0] == pytest.approx([1.0 - 1.2, -3.0 - 1.2, -5.0])
    assert out[1] == pytest.approx([3.0 + 1.2, -1.0 + 1.2, 4.0])
    more = np.array([1.2, 1.2, 0.0]) if extrapolates else 0.0
    assert out[2] == pytest.approx(np.maximum(more - out[0], 0.0))
    assert out[3] == pytest.approx(np.maximum(more + out[1], 0.0))


def test_a_reaction_lasts_as_long_as_its_slowest_joint():
    """Rounded outwards, by what roundings may be and no more."""
    speeds = np.zeros((4, 3))
    speeds[2], speeds[3] = (1.0, 0.5, 9.0), (0.5, 3.0, 9.0)
    speeds[:2] = 99.0
    brakes = np.array([2.0, 4.0, 0.1])
    for hold in (0.0, 0.25, 1.0):
        longest = _lasts(speeds, hold, brakes, 2)
        assert hold + 0.75 < longest < hold + 0.75 + 1e-8
    speeds[2, 0], speeds[3, 1] = 2.0, 1.0
    assert 1.0 < _lasts(speeds, 0.0, brakes, 2) < 1.0 + 1e-8
    for hold in (0.0, 0.25):
        assert hold < _lasts(np.zeros((4, 3)), hold, brakes, 3) < hold + 1e-8
    speeds[3, 0] = NAN
    assert math.isnan(_lasts(speeds, 0.0, brakes, 2))


def spreads(source: int, own, silent, deceleration: float, hold: float = 0.1) -> tuple[float, float]:
    """q_spread and dq_spread of the fourth of five slices, 0.5 s long but for the source, 0.2 s."""
    block = new_slices()
    record = block[0]
    record["n"], record["n_joints"] = 5, 1
    record["t"][:6] = (0.0, 0.2, 0.7, 1.2, 1.7, 2.2) if source == 0 else (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
    record["q"][:6, 0] = 7.0, 2.0, 7.0, 2.25, -7.0, -9.0
    given = (np.array(each, dtype=float).reshape(4, 1) for each in (own, silent))
    _widen_row(block, 3, source, *given, hold, np.array([deceleration]))
    assert not np.delete(record["q_spread"][:, 0], 3).any()
    assert not np.delete(record["dq_spread"][:, 0], 3).any()
    return float(record["q_spread"][3, 0]), float(record["dq_spread"][3, 0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("least", [(-0.2, -0.5), (0.2, 0.5), (-0.2, 0.5), (0.2, -0.5)])
def test_a_reaction_from_an_earlier_slice_in_closed_form(sign, least):
    """From q = 2 at the end of the source, 1 s before the slice, to 2.25 at its begin."""

    def turned(low, high, down, up):
        return (low, high, down, up) if sign > 0.0 else (-high, -low, up, down)

    own, silent = turned(least[0], 0.3, 99.0, 99.0), turned(least[1], 1.0, 0.75, 1.5)
    away, faster = spreads(0, own, silent, 0.5)
    # the plan itself, over what is left of the source (0.2 s), from 2 to 2.25, and the slice (0.5 s)
    low = 0.25 + 0.2 * min(silent[0], 0.0) + 0.5 * min(own[0], 0.0)
    high = 0.25 + 0.2 * max(silent[1], 0.0) + 0.5 * max(own[1], 0.0)
    # the reaction, 1.7 s from the begin of the source to the end of the slice: 0.1 s on, then braking
    down, up = (0.1 * v + (v * v if v < 0.8 else 1.6 * v - 0.25 * 1.6**2) for v in silent[2:])
    assert away == pytest.approx(max(up - low, down + high), rel=1e-8)
    assert away >= max(up - low, down + high)
    # at least 1 s from the end of the source on, of which 0.9 s brake
    down, up = (max(v - 0.5 * 0.9, 0.0) for v in silent[2:])
    assert faster == pytest.approx(max(up - own[0], down + own[1]), rel=1e-8)
    assert faster >= max(up - own[0], down + own[1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_reaction_from_the_same_slice_in_closed_form(sign):
    """Less than a slice for both of them, and nothing may have braked yet."""
    own = (0.5, 1.0, 0.0, 2.5) if sign > 0.0 else (-1.0, -0.5, 2.5, 0.0)
    away, faster = spreads(3, own, own, 2.0)
    # 0.1 s on at 2.5 and 0.4 s braking, while the plan stays; at once 2 quicker than the plan
    far = 2.5 * 0.5 - 0.4**2
    assert far <= away <= far * (1.0 + 1e-8) and 2.0 <= faster <= 2.0 * (1.0 + 1e-8)
    quick = spreads(3, own, own, 1e6, hold=0.0)[0]
    assert 0.5 <= quick <= 0.5 + 1e-5, "it stands at once, the plan goes on for half a second"
    assert spreads(3, own, own, 2.0, hold=0.2)[0] > away
    assert spreads(2, own, own, 2.0)[1] == faster, "it may have begun just before the slice"


def test_what_roundings_may_take_off_is_added():
    for speed in (1e-4, 1e-15, 0.0):
        away, faster = spreads(3, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, speed), 1e-9)
        assert 0.5 * speed * (1.0 - 1e-5) < away < 0.5 * speed + 1e-11 and speed < faster < speed + 1e-11


def test_of_reactions_from_several_slices_the_farthest_counts():
    block = plan_by_hand(4)
    record = block[0]
    strong, weak = (np.array([0.0, 1.0, 0.0, v]).reshape(4, 1) for v in (2.0, 1.0))
    for order in ((strong, weak), (weak, strong)):
        record["q_spread"][:], record["dq_spread"][:] = 0.0, 0.0
        for each in order:
            _widen_row(block, 2, 1, each, each, 0.5, np.array([1.0]))
        found = float(record["q_spread"][2, 0]), float(record["dq_spread"][2, 0])
        record["q_spread"][:], record["dq_spread"][:] = 0.0, 0.0
        _widen_row(block, 2, 1, strong, strong, 0.5, np.array([1.0]))
        alone = float(record["q_spread"][2, 0]), float(record["dq_spread"][2, 0])
        assert found[0] == alone[0] and found[1] >= alone[1]


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


@pytest.mark.parametrize(
    ("name", "values", "brake"),
    [("q", (-1e308, -1e308, 1.2e308, 0.0, 0.0), 0.5), ("dq", (1.2e308, -1.2e308, 0.0, 0.0, 0.0), 1e308)],
)
def test_a_spread_beyond_all_numbers_leaves_no_slice(name, values, brake):
    """Where everything that it is made of is finite still."""
    block = plan_by_hand(4)
    block[name][0, :5, 0] = values
    block["ddq_max"][0, :4, 0] = 0.0
    assert not Silence(0.0, False, np.array([brake])).widen(block, 0.0)
    assert block["n"][0] == 0


@pytest.mark.parametrize("since", [-0.1, -9.0])
def test_silence_from_before_the_begin_is_silence_from_the_begin(since):
    blocks = [plan_by_hand(4) for _ in range(2)]
    assert Silence(0.1, True, np.array([0.7])).widen(blocks[0], 0.0)
    assert Silence(0.1, True, np.array([0.7])).widen(blocks[1], since)
    assert blocks[0].tobytes() == blocks[1].tobytes()
    assert (blocks[0]["q_spread"][0, : int(blocks[0]["n"][0]), 0] > 0.0).all()


def test_no_reaction_that_begins_later_belongs_to_a_slice():
    """What may happen on the last slice changes nothing before it."""
    blocks = [plan_by_hand(4) for _ in range(2)]
    blocks[1]["ddq_max"][0, 3] = 80.0
    assert all(Silence(0.1, True, np.array([0.7])).widen(each, 0.25) for each in blocks)
    for name in ("q_spread", "dq_spread"):
        before, last = (blocks[k][name][0] for k in (0, 1))
        assert (before[:3] == last[:3]).all() and last[3, 0] > before[3, 0] > 0.0
        assert before[0, 0] == 0.0, "the piece, before any silence"


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
