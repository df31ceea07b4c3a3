"""The supervisor: states, refusals, faults, clocks; what is commanded is held against the path itself."""

from __future__ import annotations

import itertools
import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from failsafe.preparation import Objection, Refusal
from failsafe.running_plan import RunningPlan
from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import from_motion
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from tests.failsafe.motions import limits_of
from tests.verifier.supervised import (
    AWAY,
    AWAY_AND_BACK,
    CYCLE,
    EPOCH,
    HOME,
    LIMITS,
    PANDA,
    PANDA_AWAY,
    PANDA_HOME,
    panda,
    panda_supervisor,
    quintic,
    report,
    scripted,
    steps,
)
from verifier.cell import Cell
from verifier.command import Cause, State
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Stop
from verifier.supervisor import Supervisor, SupervisorSettings, _standing_at
from verifier.tracking import JointReading
from verifier.verdict import STATUS_OF_REASON, Reason, Status

NAN = math.nan
NOTHING = RawMeasurement(0.0, 0.0, "world", True, ())


def moving(count: int = 30, t: float = 0.0) -> Supervisor:
    """A supervisor that executes, after ``count`` steps."""
    supervisor = scripted()
    assert supervisor.propose(NewTrajectory(AWAY_AND_BACK)) is None
    last = steps(supervisor, count, t)[-1]
    assert last.outcome is State.EXECUTING or count < 30
    return supervisor


def verified(answer: bool):
    return lambda: Reason.SEPARATED if answer else Reason.REACHABLE


# Bad input


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros(3), r"shape \(3,\), should be \(2,\)"),
        (np.array([0.0, NAN]), "q of joint joint_1 is nan"),
        (np.array([3.1, 0.0]), "q of joint joint_0 is 3.1"),
        (np.array([0.0, -math.inf]), "q of joint joint_1 is -inf"),
        ("ab", "q should be 2 numbers, one per joint: could not convert"),
        ([object()] * 2, "q should be 2 numbers, one per joint: float"),
        (np.zeros(2) + 1j, "q should be 2 numbers, one per joint: complex"),
    ],
)
def test_it_begins_only_where_a_robot_can_stand(q, message):
    with pytest.raises(SetupError, match=message):
        scripted(q)


def test_an_endless_joint_does_not_stand_at_infinity():
    limits = replace(LIMITS, position_lower=np.full(2, -math.inf), position_upper=np.full(2, math.inf))
    with pytest.raises(SetupError):
        scripted(np.array([math.inf, 0.0]), limits=limits)


@pytest.mark.parametrize("early", [-0.001, NAN, math.inf])
def test_unusable_settings_are_refused(early):
    with pytest.raises(SetupError, match="early_s"):
        SupervisorSettings(early)


def test_a_cell_without_a_tracking_error_is_refused():
    table = PANDA | {"robot": {"name": "panda", "bare_flange": True}}
    with pytest.raises(SetupError, match="position_error_rad"):
        Supervisor.from_cell(Cell.from_table(table), PANDA_HOME)


@pytest.mark.parametrize("sdot", [NAN, math.inf, -math.inf])
def test_path_speeds_that_are_no_numbers_are_refused(sdot):
    refusal = moving().propose(PathSpeed(sdot))
    assert refusal.objection is Objection.NOT_A_NUMBER and str(sdot) in refusal.text


@pytest.mark.parametrize("sdot", ["1", None, (1.0,)])
def test_path_speeds_that_are_no_numbers_at_all_are_refused_too(sdot):
    assert moving().propose(PathSpeed(sdot)).objection is Objection.NOT_A_NUMBER


@pytest.mark.parametrize("proposal", [None, "go", 1.0, AWAY])
def test_what_is_no_proposal_is_said_to_be_none(proposal):
    with pytest.raises(TypeError, match="is no proposal: give NewTrajectory, PathSpeed"):
        moving().propose(proposal)


@pytest.mark.parametrize("trajectory", [None, [[0.0, 1.0]], "path"])
def test_what_is_no_trajectory_is_said_to_be_none(trajectory):
    with pytest.raises(TypeError, match="is no trajectory: give an IntendedTrajectory"):
        moving().propose(NewTrajectory(trajectory))


@pytest.mark.parametrize(
    "proposal",
    [
        NewTrajectory(AWAY, "1"), NewTrajectory(AWAY, (1.0,)),
        JointVelocity(np.zeros(2), "1"), JointVelocity(np.zeros(2), None),
    ],
)  # fmt: skip
def test_instants_that_are_no_numbers_at_all_are_refused(proposal):
    assert moving().propose(proposal).objection is Objection.NOT_A_NUMBER


def test_a_jump_is_refused_with_its_place():
    refusal = moving().propose(NewTrajectory(AWAY, 1e6))
    assert refusal.objection is Objection.JUMP and refusal.s == 1e6


def test_what_is_commanded_cannot_be_changed_by_who_gets_it():
    supervisor = moving()
    command = supervisor.step(30 * CYCLE)
    for each in (command.q, command.dq, command.ddq):
        with pytest.raises(ValueError, match="read-only"):
            each[0] = 9.0


# Induction start


def test_at_first_it_stands_still():
    supervisor = scripted()
    for k, command in enumerate(steps(supervisor, 5, EPOCH)):
        assert command.outcome is State.STOPPED and command.cause is Cause.RESTING
        assert command.verdict.reason is Reason.AT_REST
        assert command.t == pytest.approx(EPOCH + (k + 2) * CYCLE, abs=1e-6)
        assert command.deadline == pytest.approx(EPOCH + (k + 1) * CYCLE, abs=1e-6)
        assert (command.q == HOME).all() and not command.dq.any() and not command.ddq.any()
    assert supervisor.check.plans == 0


# The way along the path


def test_it_goes_along_the_path_and_ends_at_its_end():
    supervisor = scripted()
    assert supervisor.propose(NewTrajectory(AWAY)) is None
    commands = steps(supervisor, 400)
    states = [command.outcome for command in commands]
    order = [states[0], *(b for a, b in itertools.pairwise(states) if a is not b)]
    assert order == [State.RECOVERING, State.EXECUTING, State.STOPPED]
    assert np.allclose(commands[-1].q, HOME + np.array([1.5, 1.0]), atol=1e-9)
    assert commands[-1].cause is Cause.RESTING and not commands[-1].dq.any()
    on_path(commands)


def on_path(commands) -> None:
    """Every command lies on the straight line of AWAY, and q, dq, ddq of neighbours belong together."""
    for command in commands:
        share = (command.q - HOME) / [1.5, 1.0]
        assert share[0] == pytest.approx(share[1], abs=1e-9) and -1e-12 <= share[0] <= 1.0 + 1e-12
    for a, b in itertools.pairwise(commands):
        h = b.t - a.t
        if h <= 1.5 * CYCLE:
            middle = a.q + h * (a.dq + b.dq) / 2 + h**2 * (a.ddq - b.ddq) / 12
            assert np.abs(b.q - middle).max() <= LIMITS.jerk.max() * h**3 / 20


def test_what_is_not_verified_is_not_executed():
    supervisor = moving()
    before = steps(supervisor, 1, first=30)[0]
    supervisor.check.reason = verified(False)
    after = steps(supervisor, 200, first=31)
    assert {c.cause for c in after} == {Cause.NOT_VERIFIED}
    assert after[0].verdict.reason is after[-1].verdict.reason is Reason.REACHABLE
    assert after[0].outcome is State.FAILSAFE and after[-1].outcome is State.STOPPED
    assert not after[-1].dq.any()
    # the stop is the one of the plan that was adopted before: it begins where that plan's piece ended
    assert np.abs(after[0].q - before.q).max() <= LIMITS.velocity.max() * CYCLE
    rest = supervisor.view()
    assert rest.sdot == 0.0 and rest.s == pytest.approx(rest.s_rest)
    supervisor.check.reason = verified(True)
    again = steps(supervisor, 300, first=231)
    assert [c.outcome for c in again[:2]] == [State.RECOVERING] * 2
    assert State.EXECUTING in {c.outcome for c in again}
    on_path([before, *after, *again])


@pytest.mark.parametrize("reason", Reason)
def test_only_what_is_verified_is_adopted(reason):
    supervisor = moving()
    supervisor.check.reason = lambda: reason
    command = supervisor.step(30 * CYCLE)
    assert (command.cause is Cause.ADOPTED) is (STATUS_OF_REASON[reason] is Status.VERIFIED)
    assert command.verdict.reason is reason


def test_at_the_end_of_its_path_it_rests_at_once():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY))
    commands = steps(supervisor, 400)
    there = [k for k, c in enumerate(commands) if np.abs(c.q - HOME - [1.5, 1.0]).max() < 1e-12]
    resting = [k for k, c in enumerate(commands) if c.outcome is State.STOPPED]
    assert resting[0] <= there[0] + 3
    assert commands[resting[0] + 1].cause is Cause.RESTING


def test_a_stop_that_was_begun_can_be_left():
    supervisor = moving()
    supervisor.check.reason = verified(False)
    assert steps(supervisor, 3, first=30)[-1].outcome is State.FAILSAFE
    supervisor.check.reason = verified(True)
    commands = steps(supervisor, 60, first=33)
    assert commands[0].outcome is State.RECOVERING and commands[-1].outcome is State.EXECUTING
    assert min(np.abs(c.dq).max() for c in commands) > 0.01


@pytest.mark.parametrize("sdot", [1e9, -1e9])
def test_a_path_speed_beyond_measure_is_refused_before_there_is_a_path(sdot):
    refusal = scripted().propose(PathSpeed(sdot))
    assert refusal is not None and "nan" not in refusal.text and "inf" not in refusal.text


def test_path_speed_and_stop_are_followed():
    supervisor = moving()
    assert supervisor.propose(PathSpeed(0.5)) is None
    commands = steps(supervisor, 60, first=30)
    assert supervisor.view().sdot == 0.5 and commands[-1].outcome is State.EXECUTING
    assert supervisor.propose(Stop()) is None
    commands = steps(supervisor, 100, first=90)
    assert commands[-1].outcome is State.STOPPED and commands[-1].cause is Cause.RESTING
    assert {c.verdict.status for c in commands[10:]} == {Status.VERIFIED}
    assert supervisor.view().sdot == 0.0
    assert supervisor.propose(PathSpeed(1.0)) is None
    assert steps(supervisor, 60, first=190)[-1].outcome is State.EXECUTING


# Proposals in every state


def test_a_trajectory_from_standstill_must_begin_where_the_robot_rests():
    supervisor = scripted()
    elsewhere = quintic([HOME + np.array([0.0, 1e-6]), HOME], LIMITS)
    assert supervisor.propose(NewTrajectory(elsewhere)) is None
    assert steps(supervisor, 1)[0].cause is Cause.RESTING
    assert supervisor.refusal.objection is Objection.JUMP and supervisor.refusal.joint == 1
    assert "rests at -0.5, 1e-06 from where" in supervisor.refusal.text
    assert supervisor.propose(NewTrajectory(AWAY)) is None
    assert steps(supervisor, 1, first=1)[0].cause is Cause.ADOPTED
    assert supervisor.refusal is None


@pytest.mark.parametrize("failing", [False, True])
def test_a_trajectory_from_standstill_is_refused_while_the_robot_moves(failing):
    supervisor = moving()
    supervisor.check.reason = verified(not failing)
    steps(supervisor, 2, first=30)
    assert supervisor.propose(NewTrajectory(AWAY)) is None
    command = steps(supervisor, 1, first=32)[0]
    assert command.outcome is (State.FAILSAFE if failing else State.EXECUTING)
    assert supervisor.refusal.objection is Objection.NOT_AT_REST


def branch(old: IntendedTrajectory, s: float) -> IntendedTrajectory:
    """From where ``old`` is at ``s``, with its q, q', q'', to a rest 0.3 rad away."""
    q, v, a, _ = old.sample(s)
    T = 1.5
    rows = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
    right = np.stack([0.3 - v * T - a * T**2 / 2, -v - a * T, -a])
    c = np.concatenate([np.stack([q, v, a / 2]), np.linalg.solve(rows, right)])
    return IntendedTrajectory([0.0, T], c[None], "rest")


@pytest.mark.parametrize("failing", [False, True])
def test_a_trajectory_that_joins_after_the_running_stop_is_taken_over(failing):
    supervisor = moving()
    supervisor.check.reason = verified(not failing)
    before = steps(supervisor, 3, first=30)
    join = supervisor.view().s_rest + 0.1
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    supervisor.check.reason = verified(True)
    commands = steps(supervisor, 400, first=33)
    assert supervisor.refusal is None and commands[0].cause is Cause.ADOPTED
    assert commands[-1].outcome is State.STOPPED
    assert np.allclose(commands[-1].q, AWAY_AND_BACK.sample(join)[0] + 0.3, atol=1e-8)
    for a, b in itertools.pairwise([*before, *commands]):
        assert np.abs(b.q - a.q).max() <= LIMITS.velocity.max() * CYCLE * 1.001
        assert np.abs(b.dq - a.dq).max() <= LIMITS.acceleration.max() * CYCLE * 1.001


@pytest.mark.parametrize(("lead", "taken"), [(-1e-6, False), (-1e-3, False), (0.0, True), (1e-6, True)])
def test_it_may_join_where_the_running_stop_ends_and_not_a_microsecond_before(lead, taken):
    """While nothing is verified, the stop that runs when it is taken over is the one that was seen."""
    supervisor = moving()
    supervisor.check.reason = verified(False)
    steps(supervisor, 1, first=30)
    join = supervisor.view().s_rest + lead
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    steps(supervisor, 1, first=31)
    if taken:
        assert supervisor.refusal is None
    else:
        assert supervisor.refusal.objection is Objection.JOINS_TOO_EARLY
        assert supervisor.refusal.s == pytest.approx(join - lead, abs=1e-12)


def test_who_joins_again_and_again_does_not_make_the_path_longer_and_longer():
    """Ten seconds of path are kept behind the robot."""
    supervisor, k = moving(), 30
    for i in range(60):
        join, path = supervisor.view().s_rest + 0.05, supervisor._running.trajectory
        way = from_motion(path.sample(join)[:3], HOME + 0.2 * (-1) ** i, 1.5, join)
        assert supervisor.propose(NewTrajectory(way, join)) is None
        steps(supervisor, round(0.3 / CYCLE), first=k)
        k += round(0.3 / CYCLE)
        assert supervisor.refusal is None
    path = supervisor._running.trajectory
    assert 10.0 < supervisor.view().s - path.s_begin < 12.0
    assert path.spans < 60


def test_a_robot_that_rests_is_not_moved_by_what_it_is_offered():
    """Each may begin a rounding beside the place; all of them are held against where it came to rest."""
    supervisor = scripted()
    supervisor.check.reason = verified(False)
    place, refused = HOME.copy(), 0
    for k in range(20):
        place = place + 0.9e-9
        offer = quintic([place, place + 0.5], LIMITS)
        supervisor.propose(NewTrajectory(offer))
        command = steps(supervisor, 1, first=k)[0]
        refused += supervisor.refusal is not None
    assert refused == 19 and np.abs(command.q - HOME).max() <= 1e-9


def test_a_trajectory_that_joins_within_the_running_stop_is_refused_with_the_earliest_join():
    supervisor = moving()
    view = supervisor.view()
    join = 0.5 * (view.s + view.s_rest)
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    steps(supervisor, 1, first=30)
    refusal = supervisor.refusal
    assert refusal.objection is Objection.JOINS_TOO_EARLY
    join = refusal.s + 0.05
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    steps(supervisor, 1, first=31)
    assert supervisor.refusal is None


def test_a_trajectory_that_was_prepared_for_another_one_is_outdated():
    supervisor = moving()
    join = supervisor.view().s_rest + 0.3
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    (waiting,) = supervisor._proposals._trajectories
    steps(supervisor, 1, first=30)
    # as if it had been handed over while the other one was taken over
    supervisor._proposals._trajectories.append(waiting)
    steps(supervisor, 1, first=31)
    assert supervisor.refusal.objection is Objection.OUTDATED


def test_a_trajectory_that_was_taken_over_during_the_preparation_of_another_one_outdates_it():
    supervisor = moving()
    join = supervisor.view().s_rest + 0.3
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    prepare = supervisor._proposals._preparation.prepare

    def meanwhile(*given):
        steps(supervisor, 1, first=30)
        return prepare(*given)

    supervisor._proposals._preparation.prepare = meanwhile
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    steps(supervisor, 1, first=31)
    assert supervisor.refusal.objection is Objection.OUTDATED
    assert supervisor.view().refusal is supervisor.refusal


@pytest.mark.parametrize(
    ("trajectory", "join", "objection", "joints"),
    [
        (quintic([HOME, HOME + np.array([1.5, 1.0])], LIMITS, 1.3), None, Objection.BEYOND_LIMITS, {0, 1}),
        (quintic([HOME, HOME + np.array([2.6, 0.0])], LIMITS), None, Objection.BEYOND_LIMITS, {0}),
        (IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 3))), None, Objection.OTHER_JOINTS, {-1}),
        (IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 3))), 0.2, Objection.JUMP, {-1}),
        (AWAY, 0.2, Objection.JUMP, {0, 1}),
        (AWAY, 99.0, Objection.JUMP, {-1}),
        (AWAY, NAN, Objection.JUMP, {-1}),
    ],
)
def test_what_can_be_refused_at_once_is(trajectory, join, objection, joints):
    supervisor = moving()
    refusal = supervisor.propose(NewTrajectory(trajectory, join))
    assert isinstance(refusal, Refusal) and refusal.objection is objection and refusal.text
    assert refusal.joint in joints
    command = steps(supervisor, 1, first=30)[0]
    assert command.outcome is State.EXECUTING


def test_the_last_of_several_proposals_counts():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    supervisor.propose(NewTrajectory(AWAY))
    supervisor.propose(PathSpeed(0.2))
    supervisor.propose(PathSpeed(0.4))
    commands = steps(supervisor, 80)
    assert supervisor.view().sdot == 0.4
    on_path(commands)


def test_a_stop_outlasts_a_trajectory_of_the_same_cycle():
    supervisor = scripted()
    supervisor.propose(Stop())
    supervisor.propose(NewTrajectory(AWAY))
    assert {c.outcome for c in steps(supervisor, 10)} == {State.STOPPED}
    supervisor.propose(PathSpeed(1.0))
    assert steps(supervisor, 1, first=10)[0].outcome is State.RECOVERING


def test_a_trajectory_alone_is_followed_at_its_own_speed():
    """A path speed counts for the path that there was."""
    supervisor = moving()
    supervisor.propose(PathSpeed(0.5))
    steps(supervisor, 40, first=30)
    join = supervisor.view().s_rest + 0.05
    assert supervisor.view().sdot == 0.5
    assert supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join)) is None
    steps(supervisor, 30, first=70)
    assert supervisor.refusal is None and supervisor.view().sdot == 1.0


def test_a_view_is_of_the_instant_of_the_last_command():
    supervisor = moving()
    for k in range(30, 60):
        command = supervisor.step(k * CYCLE)
        view = supervisor.view()
        assert view.t == command.t
        assert np.allclose(AWAY_AND_BACK.sample(view.s)[0], command.q, atol=1e-12)
        assert np.allclose(AWAY_AND_BACK.sample(view.s)[1] * view.sdot, command.dq, atol=1e-9)


def test_recovering_ends_when_the_wanted_speed_is_reached_and_not_before():
    """What executes goes on executing while its speed is changed."""
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    for k in range(60):
        speed = supervisor.view().sdot
        command = supervisor.step(k * CYCLE)
        if command.outcome is State.EXECUTING:
            break
        assert speed < 1.0 or k < 2
    assert supervisor.view().sdot == 1.0
    supervisor.propose(PathSpeed(0.4))
    assert {c.outcome for c in steps(supervisor, 40, first=k + 1)} == {State.EXECUTING}


def test_who_proposed_a_trajectory_cannot_change_it_any_more():
    supervisor, twin = scripted(), scripted()
    mine = quintic([HOME, HOME + np.array([1.5, 1.0])], LIMITS)
    supervisor.propose(NewTrajectory(mine))
    twin.propose(NewTrajectory(quintic([HOME, HOME + np.array([1.5, 1.0])], LIMITS)))
    first, second = steps(supervisor, 20), steps(twin, 20)
    mine.kernel_coefficients.setflags(write=True)
    mine.kernel_coefficients[:] += 0.1
    mine.s_end = 0.0
    first += steps(supervisor, 20, first=20)
    second += steps(twin, 20, first=20)
    assert all(np.array_equal(a.q, b.q) for a, b in zip(first, second, strict=True))


# Late, missed and withdrawn


def test_missed_steps_are_counted_and_the_stop_is_where_it_is_by_then():
    supervisor, twin = moving(), moving()
    twin.check.reason = verified(False)
    going_on = steps(twin, 4, first=30)
    late = supervisor.step(33 * CYCLE)
    assert late.missed == 3 and late.cause is Cause.ADOPTED
    # at t_34 the new plan begins where the old one's stop is: it hardly differs one cycle later
    assert 0.0 < np.abs(late.q - going_on[-1].q).max() <= LIMITS.jerk.max() * CYCLE**3
    assert late.t == pytest.approx(35 * CYCLE)
    assert supervisor.step(33 * CYCLE).missed == 0, "no cycle was missed since"


def test_after_long_silence_the_robot_rests_where_its_plan_ended():
    supervisor = moving()
    rest = supervisor.view().s_rest
    supervisor.check.reason = verified(False)
    command = supervisor.step(3600.0)
    assert command.outcome is State.STOPPED and command.missed > 300_000
    assert np.allclose(command.q, AWAY_AND_BACK.sample(rest)[0], atol=1e-9)


def test_what_is_withdrawn_is_not_adopted():
    supervisor, twin = moving(), moving()
    adopted = supervisor.step(30 * CYCLE)
    assert adopted.cause is Cause.ADOPTED
    withdrawn = supervisor.withdraw()
    twin.check.reason = verified(False)
    stopping = twin.step(30 * CYCLE)
    assert np.array_equal(withdrawn.q, stopping.q) and withdrawn.t == stopping.t == adopted.t
    assert withdrawn.outcome is State.FAILSAFE and withdrawn.cause is Cause.WITHDRAWN
    assert supervisor.withdraw() is withdrawn
    supervisor.check.reason = verified(False)
    for k in range(31, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, twin.step(k * CYCLE).q)


def test_what_is_withdrawn_is_not_given_out_again():
    """Not even where the clock stands still afterwards."""
    supervisor = moving()
    supervisor.step(30 * CYCLE)
    withdrawn = supervisor.withdraw()
    again = supervisor.step(30 * CYCLE)
    assert again.cause is Cause.CLOCK and np.array_equal(again.q, withdrawn.q)


@pytest.mark.parametrize("reports", [(), (None,)], ids=["nothing", "a fault"])
def test_after_a_step_in_vain_nothing_is_withdrawn_that_the_robot_holds(reports):
    """What was adopted before it was handed over: taken back, the robot would drive another plan."""
    supervisor, twin = moving(), moving()
    adopted = supervisor.step(30 * CYCLE)
    twin.step(30 * CYCLE)
    assert supervisor.step(30 * CYCLE, reports).cause in (Cause.CLOCK, Cause.FAULT)
    again = supervisor.withdraw()
    assert np.array_equal(again.q, adopted.q) and np.array_equal(again.ddq, adopted.ddq)
    if reports:
        twin.check.reason = verified(False)
    for k in range(31, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, twin.step(k * CYCLE).q)


def test_nothing_is_withdrawn_where_nothing_was_adopted():
    supervisor = scripted()
    assert supervisor.withdraw().outcome is State.STOPPED
    supervisor = moving()
    supervisor.check.reason = verified(False)
    command = supervisor.step(30 * CYCLE)
    assert supervisor.withdraw() is command


def test_a_fault_while_the_clock_stands_takes_nothing_back():
    """What was adopted, and handed over, in the step before is the plan of the robot."""
    supervisor, twin = moving(), moving()
    assert supervisor.step(30 * CYCLE).cause is twin.step(30 * CYCLE).cause is Cause.ADOPTED
    assert supervisor.step(30 * CYCLE, (1 / 0 for _ in range(1))).cause is Cause.FAULT
    twin.check.reason = verified(False)
    for k in range(31, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, twin.step(k * CYCLE).q)


def test_a_withdrawn_beginning_leaves_the_robot_where_it_rests():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY))
    assert supervisor.step(0.0).outcome is State.RECOVERING
    assert supervisor.withdraw().outcome is State.STOPPED
    command = supervisor.step(CYCLE)
    assert command.outcome is State.RECOVERING and command.cause is Cause.ADOPTED


# Clocks


@pytest.mark.parametrize("now", [NAN, math.inf, -math.inf, 29 * CYCLE, -5.0, 0.29999 - CYCLE, 1e300])
def test_a_clock_that_does_not_advance_changes_nothing(now):
    supervisor = moving()
    last = supervisor.step(30 * CYCLE)
    command = supervisor.step(now)
    assert command.cause is Cause.CLOCK and command.verdict.status is Status.NOT_CHECKED
    assert command.t == last.t and np.array_equal(command.q, last.q)
    assert command.outcome is last.outcome
    following = supervisor.step(31 * CYCLE)
    assert following.cause is Cause.ADOPTED and following.missed == 0


def test_a_first_step_without_a_clock_is_none():
    supervisor = scripted()
    for now in (NAN, math.inf):
        command = supervisor.step(now, [NOTHING])
        assert command.cause is Cause.CLOCK and math.isnan(command.t) and (command.q == HOME).all()
    assert supervisor.step(EPOCH).t == pytest.approx(EPOCH + 2 * CYCLE, abs=1e-6)


@pytest.mark.parametrize("now", [None, "now", 10**400, object()], ids=["None", "text", "huge", "object"])
def test_a_clock_that_is_no_number_is_a_fault(now):
    supervisor = moving()
    last = supervisor.step(30 * CYCLE)
    command = supervisor.step(now)
    assert command.cause in (Cause.FAULT, Cause.CLOCK)
    assert np.array_equal(command.q, last.q) and command.missed == 0
    assert supervisor.step(31 * CYCLE).cause is Cause.ADOPTED


@pytest.mark.parametrize("early", [0.0, 0.24 * CYCLE, -0.7 * CYCLE])
def test_a_step_may_be_a_little_early_or_late(early):
    supervisor = moving()
    for k in range(30, 60):
        command = supervisor.step(k * CYCLE - early)
        assert command.missed == 0 and command.t == pytest.approx((k + 2) * CYCLE)


@pytest.mark.parametrize("epoch", [0.0, EPOCH, -EPOCH, 4e9])
def test_the_clock_may_begin_anywhere(epoch):
    near, far = moving(60), moving(60, epoch)
    for k in range(60, 90):
        a, b = near.step(k * CYCLE), far.step(epoch + k * CYCLE)
        assert np.allclose(a.q, b.q, rtol=0.0, atol=1e-12)
        assert b.t == pytest.approx(epoch + a.t, abs=1e-5)
        assert b.verdict.t == pytest.approx(epoch + a.verdict.t, abs=1e-5)


# Faults


def broken(*_args, **_more):
    raise RuntimeError("planted")


@pytest.mark.parametrize("place", ["check.check_moving", "_planner.follow", "_take_proposals", "watch.known"])
def test_an_exception_stops_the_robot_and_is_named(place, monkeypatch):
    supervisor, twin = moving(), moving()
    owner, _, name = place.rpartition(".")
    monkeypatch.setattr(getattr(supervisor, owner) if owner else supervisor, name, broken)
    twin.check.reason = verified(False)
    for k in range(30, 120):
        command, stopping = supervisor.step(k * CYCLE), twin.step(k * CYCLE)
        assert command.cause is Cause.FAULT and command.verdict.reason is Reason.FAULT
        assert np.array_equal(command.q, stopping.q) and command.outcome is stopping.outcome
    assert "planted" in str(supervisor.fault)
    monkeypatch.undo()
    assert supervisor.step(120 * CYCLE).cause is Cause.ADOPTED


def test_an_exception_while_a_plan_is_taken_leaves_the_running_one(monkeypatch):
    supervisor, twin = moving(), moving()
    monkeypatch.setattr(RunningPlan, "take", broken)
    twin.check.reason = verified(False)
    for k in range(30, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, twin.step(k * CYCLE).q)


def test_where_no_command_can_be_said_the_state_is_that_of_the_plan(monkeypatch):
    supervisor, twin = moving(), moving()
    last = supervisor._last
    twin.check.reason = verified(False)
    monkeypatch.setattr(supervisor._tracking, "note", broken)
    for k in range(30, 90):
        command, stopping = supervisor.step(k * CYCLE), twin.step(k * CYCLE)
        assert command.cause is Cause.FAULT and np.array_equal(command.q, last.q) and command.t == last.t
        assert command.outcome is stopping.outcome
    assert command.outcome is State.STOPPED
    monkeypatch.undo()
    again = supervisor.step(90 * CYCLE)
    assert again.cause is Cause.ADOPTED and again.outcome is State.RECOVERING


def test_a_fault_while_reports_are_taken_in_latches():
    supervisor = moving()
    command = supervisor.step(30 * CYCLE, [NOTHING._replace(frame="raise")])
    assert command.cause is Cause.FAULT and command.outcome is State.FAILSAFE
    commands = steps(supervisor, 100, first=31)
    assert {c.cause for c in commands} == {Cause.LATCHED}
    assert {c.verdict.status for c in commands} == {Status.NOT_CHECKED}
    assert commands[-1].outcome is State.STOPPED
    supervisor.propose(PathSpeed(1.0))
    assert steps(supervisor, 5, first=131)[-1].outcome is State.STOPPED


def test_a_fault_in_a_late_step_still_counts_what_was_missed():
    supervisor = moving()
    supervisor.step(30 * CYCLE)
    command = supervisor.step(34 * CYCLE, [NOTHING._replace(frame="raise")])
    assert command.cause is Cause.FAULT and command.missed == 3
    assert supervisor.step(35 * CYCLE).missed == 0


def test_reports_that_raise_latch_even_while_the_clock_stands():
    supervisor = moving()
    last = supervisor.step(30 * CYCLE)
    command = supervisor.step(30 * CYCLE, (1 / 0 for _ in range(1)))
    assert command.cause is Cause.FAULT and command.missed == 0 and np.array_equal(command.q, last.q)
    assert supervisor.step(31 * CYCLE).cause is Cause.LATCHED


def test_reports_are_handed_on_with_the_epoch_taken_off():
    supervisor = scripted()
    supervisor.step(EPOCH + 0.5, [NOTHING._replace(stamp=EPOCH + 0.4, arrived=EPOCH + 0.45)])
    ((admitted, now),) = supervisor.watch.admitted
    assert (admitted.stamp, admitted.arrived, now) == pytest.approx((0.4, 0.45, 0.5), abs=1e-6)


# Joints


def test_a_robot_that_does_not_follow_stops_and_is_named():
    supervisor = moving(60)
    commands = steps(supervisor, 1, first=60)
    t = commands[0].t
    supervisor.step(61 * CYCLE)
    command = supervisor.step(62 * CYCLE, joints=JointReading(t, commands[0].q + np.array([0.0, 0.01])))
    assert command.outcome is State.FAILSAFE and command.cause is Cause.NOT_VERIFIED
    assert command.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING
    assert supervisor.deviation.joint == 1 and supervisor.deviation.by == pytest.approx(0.009, abs=1e-4)
    assert supervisor.deviation.t == t
    assert supervisor.step(63 * CYCLE).cause is Cause.ADOPTED


def test_a_robot_that_is_elsewhere_from_the_first_step_on_does_not_begin():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY))
    for k in range(5):
        command = supervisor.step(k * CYCLE, joints=JointReading(k * CYCLE, HOME + 0.1))
        assert command.outcome is State.STOPPED
        assert command.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING
    assert supervisor.step(5 * CYCLE, joints=JointReading(5 * CYCLE, HOME)).cause is Cause.ADOPTED


def test_a_robot_that_goes_on_through_missed_steps_is_one_that_follows():
    supervisor, twin = moving(), moving()
    twin.check.reason = verified(False)
    stopping = {round(c.t / CYCLE): c for c in steps(twin, 60, first=30)}
    for k in range(34, 54):
        after = moving()
        command = after.step(k * CYCLE, joints=JointReading((k - 1) * CYCLE, stopping[k - 1].q))
        assert after.deviation is None and command.missed == k - 30
    assert supervisor.step(45 * CYCLE, joints=JointReading(44 * CYCLE, stopping[44].q + 2e-3)).cause is (
        Cause.NOT_VERIFIED
    )


@pytest.mark.parametrize("epoch", [0.0, EPOCH])
def test_a_robot_that_follows_exactly_is_one_that_follows(epoch):
    """With next to no error allowed, steps missed or not: what was commanded is known at every instant."""
    supervisor = scripted(q_error=1e-7)
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    planned: dict[float, np.ndarray] = {}
    k = 0
    for number, missed in enumerate([0] * 30 + [1, 0, 2, 0, 0, 3, 0, 1, 1, 0, 0, 5, 0, 0] * 5):
        back = 0.5 * (number % 2)  # at an instant of the grid, or between two
        joints = JointReading(epoch + (k - back) * CYCLE, planned[k - back]) if k - back in planned else None
        command = supervisor.step(epoch + k * CYCLE, joints=joints)
        assert supervisor.deviation is None, k
        running = supervisor.running
        for ahead in np.arange(0.5, 9.0, 0.5):
            at = epoch + (k + ahead) * CYCLE - running.begin
            if at >= -1e-6:
                planned[k + ahead] = running.plan.motion(max(at, 0.0)).q
        assert command.missed >= 0
        k += 1 + missed
    off = JointReading(epoch + k * CYCLE, planned[k] + 1e-3)
    assert supervisor.step(epoch + k * CYCLE, joints=off).verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING


def test_after_a_withdrawal_the_robot_follows_the_plan_that_it_holds():
    supervisor = moving()
    steps(supervisor, 20, first=30)
    for k in range(50, 80, 2):
        supervisor.step(k * CYCLE)
        held = supervisor.withdraw()
        reading = JointReading(held.t, held.q + 1e-3)
        supervisor.step((k + 1) * CYCLE)
        assert supervisor._tracking.check(reading) is None


@pytest.mark.parametrize("q", [np.array([NAN, 0.0]), np.zeros(3), np.array([math.inf, 0.0])])
def test_readings_that_are_none_stop_the_robot(q):
    supervisor = moving()
    command = supervisor.step(30 * CYCLE, joints=JointReading(30 * CYCLE, q))
    assert command.outcome is State.FAILSAFE
    assert command.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING and supervisor.deviation.joint == -1


# Looking on from elsewhere


def test_a_view_is_a_copy():
    supervisor = moving()
    view = supervisor.view()
    last = supervisor.step(30 * CYCLE)
    view.q[:] = 99.0
    assert last.q.max() < 3.0
    assert view.outcome == "EXECUTING" and view.s < view.s_rest


def test_looking_on_from_another_thread_does_not_disturb_the_cycle():
    """View and proposals share no memory with the step that is written to."""
    alone, watched = moving(), moving()
    done = threading.Event()

    def look() -> None:
        while not done.is_set():
            watched.view()
            watched.propose(PathSpeed(1.0))

    thread = threading.Thread(target=look)
    thread.start()
    try:
        pairs = [(alone.step(k * CYCLE), watched.step(k * CYCLE)) for k in range(30, 330)]
    finally:
        done.set()
        thread.join()
    assert all(np.array_equal(a.q, b.q) and a.outcome is b.outcome for a, b in pairs)


def test_a_path_state_does_not_share_its_memory():
    """Two threads ask at the same time: a switch between evaluation and reading must not mix them."""
    running = RunningPlan(AWAY, 0.25)
    before = set(vars(running))
    scratch = running._state.copy()
    running.path_state(0.0)
    assert set(vars(running)) == before and np.array_equal(running._state, scratch)


# A real arm


def test_a_real_arm_stops_for_a_person_and_goes_on_when_nobody_is_near():
    supervisor = panda_supervisor()
    limits = panda()[0].robot.limits
    path = quintic([*[PANDA_HOME, PANDA_AWAY] * 3, PANDA_HOME], limits)
    assert supervisor.propose(NewTrajectory(path)) is None
    seen = []
    for k in range(540):
        now = EPOCH + k * CYCLE
        x = 3.0 - 2.2 * math.sin(math.pi * min(1.0, k / 500)) ** 2
        command = supervisor.step(now, [report(now - 0.02, x, arrived=now)] if k % 2 == 0 else [])
        assert supervisor.fault is None
        seen.append((command.outcome, command.cause, command.verdict.reason))
    assert (State.EXECUTING, Cause.ADOPTED, Reason.SEPARATED) in seen
    assert (State.FAILSAFE, Cause.NOT_VERIFIED, Reason.REACHABLE) in seen
    first_stop = next(i for i, each in enumerate(seen) if each[:2] == (State.STOPPED, Cause.NOT_VERIFIED))
    assert any(each[0] is State.EXECUTING for each in seen[:first_stop])
    assert seen[-1][0] in (State.EXECUTING, State.RECOVERING)


def test_a_real_arm_does_not_begin_before_anybody_was_reported():
    supervisor = panda_supervisor()
    path = quintic([PANDA_HOME, PANDA_AWAY], panda()[0].robot.limits)
    assert supervisor.propose(NewTrajectory(path)) is None
    for k in range(10):
        command = supervisor.step(k * CYCLE)
        assert command.outcome is State.STOPPED and command.verdict.reason is Reason.NO_REPORT_YET


def test_lists_in_a_report_latch_nothing():
    """What could not be read at all would: an exception half way through a report may have lost somebody."""
    supervisor = panda_supervisor()
    one, short = report(0.0, 9.0), report(CYCLE, 9.0)
    (person,) = one.people
    supervisor.step(0.0, [one._replace(people=[person._replace(xyz=person.xyz.tolist())])])
    assert supervisor.fault is None and supervisor.admission.refusals == ()
    after = supervisor.step(CYCLE, [short._replace(people=(person._replace(xyz=person.xyz[:5]),))])
    assert supervisor.fault is None and after.cause is Cause.RESTING
    assert supervisor.admission.refusals[0].person == person.id


@pytest.mark.parametrize("end", ["position_lower", "position_upper"])
def test_an_arm_may_stand_at_the_end_of_its_range_and_not_beyond(end):
    limits = limits_of([1.0, 1.0], [2.0, 2.0], [9.0, 9.0], [-0.5, -1.5], [0.5, 1.5])
    at_end = np.array(getattr(limits, end))
    assert np.array_equal(_standing_at(at_end, limits).sample(0.0)[0], at_end)
    for joint in range(2):
        beyond = at_end.copy()
        beyond[joint] = np.nextafter(beyond[joint], 9.0 * beyond[joint])
        with pytest.raises(SetupError, match="should be within"):
            _standing_at(beyond, limits)
