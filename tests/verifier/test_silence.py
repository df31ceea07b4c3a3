"""A robot that stops by itself when no command comes: cell, verdicts, and what the supervisor does then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.preparation import Objection
from failsafe.silence import Silence
from robots.errors import SetupError
from tests.verifier.scenes import Scene, person_at
from tests.verifier.supervised import (
    AWAY_AND_BACK,
    CYCLE,
    HOME,
    PANDA,
    PANDA_AWAY,
    PANDA_HOME,
    quintic,
    report,
    scripted,
    steps,
)
from verifier.batch import BatchVerifier
from verifier.cell import Cell
from verifier.command import Cause, State
from verifier.proposal import NewTrajectory, PathSpeed, Stop
from verifier.replay import verify
from verifier.safety_state import SafetyProbe, look
from verifier.setup import build_robot, build_silence
from verifier.stated import silence_assumptions
from verifier.supervisor import Supervisor
from verifier.verdict import Reason, Status

REACTION = Silence(0.02, False, np.array([5.0, 5.0]))
NEAR = 2.2
SLOW = {"hold_s": 0.1, "deceleration_rad_s2": 1.0}


def with_silence(table: dict[str, object] | None) -> Cell:
    robot = dict(PANDA["robot"])
    return Cell.from_table(PANDA | {"robot": robot if table is None else robot | {"silence": table}})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"hold_s": 0.1}, "deceleration_rad_s2"),
        ({"deceleration_rad_s2": 1.0}, "hold_s"),
        ({"hold_s": -0.1, "deceleration_rad_s2": 1.0}, "hold_s"),
        ({"hold_s": 1.1, "deceleration_rad_s2": 1.0}, "hold_s"),
        ({"hold_s": 0.1, "deceleration_rad_s2": 0.0}, "deceleration_rad_s2"),
        ({"hold_s": 0.1, "deceleration_rad_s2": [1.0, -1.0]}, "deceleration_rad_s2"),
        ({"hold_s": 0.1, "deceleration_rad_s2": []}, "deceleration_rad_s2"),
        (SLOW | {"goes_on_with": "jerk"}, "goes_on_with"),
        (SLOW | {"stops": True}, "stops"),
        (SLOW | {"deceleration_source": " "}, "deceleration_source must say how"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(table, message):
    with pytest.raises(SetupError, match=message):
        with_silence(table)


def test_one_deceleration_or_one_for_each_joint():
    cell = with_silence(SLOW | {"goes_on_with": "acceleration"})
    robot = build_robot(cell)
    silence = build_silence(cell, robot)
    assert silence.extrapolates and silence.hold_s == 0.1 and (silence.deceleration == 1.0).all()
    each = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    silence = build_silence(with_silence(SLOW | {"deceleration_rad_s2": each}), robot)
    assert silence.deceleration.tolist() == each and not silence.extrapolates
    assert build_silence(with_silence(None), robot) is None
    with pytest.raises(
        SetupError, match="has 2 values, should be one number, or 7: one for each of panda_joint1"
    ):
        build_silence(with_silence(SLOW | {"deceleration_rad_s2": [1.0, 2.0]}), robot)


def test_a_deceleration_above_the_acceleration_limit_needs_a_source():
    """Too large a number is the unsound side: it shortens what every plan is checked with."""
    robot = build_robot(with_silence(None))
    limits = robot.limits.acceleration.tolist()
    each = [*limits[:6], math.nextafter(limits[6], math.inf)]
    for bad, words in (
        (
            [*limits[:2], 50.0, *limits[3:]],
            f"of panda_joint3 is 50 rad/s², above .* of {limits[2]:g} rad/s²: ",
        ),
        (each, "of panda_joint7 is "),
        (1e6, "of panda_joint1 is 1e[+]06 rad/s²"),
    ):
        table = SLOW | {"deceleration_rad_s2": bad}
        with pytest.raises(SetupError, match=words + ".*robot.silence.deceleration_source"):
            build_silence(with_silence(table), robot)
        with pytest.raises(SetupError, match=words):
            Supervisor.from_cell(with_silence(table), PANDA_HOME)
        sourced = with_silence(table | {"deceleration_source": "brake test"})
        assert (build_silence(sourced, robot).deceleration == bad).all()
        (named, *_more) = silence_assumptions(sourced, robot)
        joint = robot.joints.index(named.name.removeprefix("robot.silence.beyond_acceleration_limit."))
        assert (named.value, named.unit) == (bad if isinstance(bad, float) else bad[joint], "rad/s²")
        assert named.source == f"brake test; its limit is {limits[joint]:g}"
    exactly = with_silence(SLOW | {"deceleration_rad_s2": limits})
    assert build_silence(exactly, robot).deceleration.tolist() == limits
    assert silence_assumptions(exactly, robot) == silence_assumptions(with_silence(None), robot) == ()


def test_a_harder_brake_is_refused_or_named_by_verify(tmp_path):
    path = Scene(duration=0.5, people={"p1": lambda _t: person_at(NEAR, 0.0)}).write(tmp_path / "r.mcap")
    base = {"bare_flange": True, "accept_assumed": ["limits"]}
    hard = {"hold_s": 0.0, "deceleration_rad_s2": 50.0}
    with pytest.raises(SetupError, match=r"robot\.silence\.deceleration_source"):
        verify(path, Cell.from_table({"robot": base | {"silence": hard}}))
    hard["deceleration_source"] = "brake test"
    report = verify(path, Cell.from_table({"robot": base | {"silence": hard}}))
    named = [each for each in report.assumptions if "beyond_acceleration_limit" in each.name]
    assert len(named) == 6 and {each.value for each in named} == {50.0}
    assert all(each.source.startswith("brake test") for each in named)


def test_it_is_listed_with_what_a_result_rests_on():
    found = {each.name: each.value for each in with_silence(SLOW).assumptions()}
    assert found["cell.robot.silence.hold_s"] == 0.1
    assert found["cell.robot.silence.deceleration_rad_s2"] == 1.0
    assert not any("silence" in each.name for each in with_silence(None).assumptions())


# Verdicts


def test_who_is_reached_only_by_the_robots_own_stop_is_in_the_way(tmp_path):
    """Offline: what is verified with the stop of the plan is not always with a slower one, and never more."""
    path = Scene(duration=1.0, people={"p1": lambda _t: person_at(NEAR, 0.0)}).write(tmp_path / "r.mcap")
    base = {"robot": {"bare_flange": True, "accept_assumed": ["limits"]}}
    plain = verify(path, Cell.from_table(base)).per_cycle
    quick, slow = (
        verify(path, Cell.from_table({"robot": base["robot"] | {"silence": each}})).per_cycle
        for each in ({"hold_s": 0.0, "deceleration_rad_s2": 50.0, "deceleration_source": "brakes"}, SLOW)
    )
    kept = [(rows.status == Status.VERIFIED) for rows in (plain, quick, slow)]
    assert kept[0].sum() >= kept[1].sum() > kept[2].sum()
    assert not (kept[1] & ~kept[0]).any() and not (kept[2] & ~kept[1]).any()
    assert (slow.reason[kept[0] & ~kept[2]] == Reason.REACHABLE).all()
    assert np.array_equal(slow.stop_time_s, plain.stop_time_s, equal_nan=True)


def test_a_reaction_that_lasts_longer_than_is_looked_ahead_is_not_followed(tmp_path, monkeypatch):
    """What contradicts a cycle is not lost beyond the end of a stretch."""
    people = {"p1": lambda t: person_at(40.0 if t < 8.0 else 80.0, 0.0)}
    path = Scene(duration=10.0, people=people).write(tmp_path / "r.mcap")
    robot = {"bare_flange": True, "accept_assumed": ["limits"]}
    slow = {"silence": {"hold_s": 0.0, "deceleration_rad_s2": 0.08}}
    cell = Cell.from_table(
        {"cycle_s": 0.05, "people": {"repeated_points": "measured"}, "robot": robot | slow}
    )
    found = []
    for window_s in (2.0, 100.0):
        monkeypatch.setattr("verifier.replay.WINDOW_S", window_s)
        report = verify(path, cell)
        assert report.first_witness is None, "no pair is why it is not followed"
        found.append(report.per_cycle)
    cut, whole = found
    contradicted = whole.reason == Reason.PERSON_OUTSIDE_PREDICTION
    assert contradicted.any() and (cut.reason[contradicted] == Reason.STOP_NOT_FOLLOWED).any()
    assert not (cut.status[contradicted] == Status.VERIFIED).any()
    assert (cut.status == Status.VERIFIED).any()


@pytest.mark.parametrize("delay", [0.0, 3.99])
def test_a_delay_that_lasts_longer_than_is_looked_ahead_is_not_followed(tmp_path, monkeypatch, delay):
    """What is seen until the robot rests, as late as it may, counts: also beyond the end of a stretch."""
    people = {"p1": lambda t: person_at(60.0 if t < 8.005 else 90.0, 0.0)}
    path = Scene(duration=10.0, people=people).write(tmp_path / "r.mcap")
    robot = {"bare_flange": True, "accept_assumed": ["limits"], "tracking": {"delay_max_s": delay}}
    cell = Cell.from_table({"cycle_s": 0.05, "people": {"repeated_points": "measured"}, "robot": robot})
    found = {}
    for window_s in (2.0, 100.0):
        for module in ("replay", "batch"):
            monkeypatch.setattr(f"verifier.{module}.WINDOW_S", window_s)
        found[window_s] = verify(path, cell).per_cycle
        batch = BatchVerifier(cell, recorded="ur5").verify_recording(path)
        assert (batch.reason == found[window_s].reason).all()
    cut, whole = found[2.0], found[100.0]
    contradicted = whole.reason == Reason.PERSON_OUTSIDE_PREDICTION
    assert contradicted.any() and (cut.status == Status.VERIFIED).any()
    assert not (cut.status[contradicted] == Status.VERIFIED).any()
    assert (cut.reason[contradicted] == Reason.STOP_NOT_FOLLOWED).any() == (delay > 0.0)


def approach(cell: Cell, x: float) -> tuple[list, Supervisor]:
    """A Panda that is to go away, and somebody ``x`` [m] in front of it."""
    supervisor = Supervisor.from_cell(cell, PANDA_HOME)
    way = quintic([PANDA_HOME, PANDA_AWAY], supervisor.check.robot.limits, load=0.3)
    supervisor.propose(NewTrajectory(way))
    commands = []
    for k in range(60):
        t = k * CYCLE
        commands.append(supervisor.step(t, [report(t - 0.005, x, arrived=t)]))
    return commands, supervisor


def test_supervisor_and_safety_state_say_the_same_with_a_reaction_as_without():
    """Nobody near: executed with both. Somebody near: slower with it. The safety state looks at the same."""
    found, moved = {}, {}
    for x in (9.0, 1.3):
        for name, table in (("held", None), ("slow", SLOW)):
            commands, supervisor = approach(with_silence(table), x)
            found[x, name] = {command.outcome for command in commands[1:]}
            moved[x, name] = float(np.abs(commands[-1].q - PANDA_HOME).max())
            probe = SafetyProbe.from_cell(with_silence(table), robot=supervisor.check.robot)
            before = look(supervisor)
            said = probe.state(before).verdict
            answer = supervisor.step(60 * CYCLE).verdict
            assert said.reason is answer.reason
    assert found[9.0, "held"] == found[9.0, "slow"] == found[1.3, "held"] == {State.EXECUTING}
    assert State.STOPPED in found[1.3, "slow"]
    assert moved[1.3, "held"] > 2.0 * moved[1.3, "slow"] > 0.0


# What the supervisor does after a command that the robot did not get


def moving(silence: Silence | None = REACTION):
    supervisor = scripted(silence=silence)
    assert supervisor.propose(NewTrajectory(AWAY_AND_BACK)) is None
    assert steps(supervisor, 30)[-1].outcome is State.EXECUTING
    return supervisor


def stays_silent(supervisor, first: int) -> None:
    """Nothing is verified any more; what it says ends at rest, whatever is proposed."""
    supervisor.propose(PathSpeed(1.0))
    commands = steps(supervisor, 120, first=first)
    assert {command.cause for command in commands} == {Cause.LATCHED}
    assert {command.verdict.reason for command in commands} == {Reason.SILENCE}
    assert {command.verdict.status for command in commands} == {Status.NOT_CHECKED}
    assert commands[0].outcome is State.FAILSAFE and commands[-1].outcome is State.STOPPED
    for proposal in (PathSpeed(1.0), NewTrajectory(AWAY_AND_BACK), Stop()):
        assert supervisor.propose(proposal).objection is Objection.LATCHED


def test_a_command_that_was_not_handed_over_ends_it():
    supervisor = moving()
    supervisor.step(30 * CYCLE)
    assert supervisor.withdraw().cause is Cause.WITHDRAWN
    stays_silent(supervisor, 31)


@pytest.mark.parametrize("where", ["check_moving", "_answer"])
@pytest.mark.parametrize("silence", [None, REACTION], ids=["holds its plan", "stops by itself"])
def test_what_ends_a_process_goes_through_as_if_the_command_had_been_withdrawn(where, silence, monkeypatch):
    """Ctrl-C in the middle of a step: nobody got its command, and the plan before is the one that is held."""
    supervisor = moving(silence)
    held, begin = supervisor._running, supervisor._begin
    with monkeypatch.context() as planted:
        of = supervisor.check if where == "check_moving" else supervisor
        planted.setattr(of, where, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            supervisor.step(30 * CYCLE)
    assert supervisor._running is held and supervisor._begin == begin
    assert supervisor._turns % 2 == 0, "no step goes on"
    assert supervisor.stops_by_itself == (silence is not None)
    if silence is not None:
        stays_silent(supervisor, 31)
        return
    after = supervisor.step(31 * CYCLE)  # the robot goes on with the plan that it holds
    wanted = held.motion((33 - begin) * CYCLE)
    if after.cause is not Cause.ADOPTED:
        np.testing.assert_array_equal(after.q, wanted.q)
    assert np.abs(after.q - wanted.q).max() < 0.02 and steps(supervisor, 30, first=32)[-1].missed == 0


def test_a_last_command_that_was_asked_for_twice_and_not_handed_over_ends_it():
    """Who was told to move last, and not that it is to rest, stops by itself."""
    supervisor, k = moving(), 30
    while supervisor.step(k * CYCLE).outcome is not State.STOPPED:
        k += 1
    assert supervisor.step(k * CYCLE).outcome is State.STOPPED and not supervisor.stops_by_itself
    supervisor.withdraw()
    assert supervisor.stops_by_itself


def test_a_command_that_cannot_even_be_said_ends_it_too(monkeypatch):
    """The robot is given one for an instant that it has had: it gets none for the next."""
    supervisor = moving()
    with monkeypatch.context() as planted:
        planted.setattr(supervisor, "_answer", lambda *_: (_ for _ in ()).throw(RuntimeError("planted")))
        assert supervisor.step(30 * CYCLE).cause is Cause.FAULT
    assert supervisor.stops_by_itself
    stays_silent(supervisor, 31)


def test_a_step_too_early_after_that_says_so_too():
    supervisor = moving()
    supervisor.step(30 * CYCLE)
    withdrawn = supervisor.withdraw()
    again = supervisor.step(30 * CYCLE)
    assert (again.cause, again.verdict.reason) == (Cause.LATCHED, Reason.SILENCE)
    assert (again.q == withdrawn.q).all() and again.missed == 0
    stays_silent(supervisor, 31)


def test_a_command_of_a_stop_that_was_not_handed_over_ends_it_too():
    supervisor = moving()
    supervisor.check.reason = lambda: Reason.REACHABLE
    assert supervisor.step(30 * CYCLE).outcome is State.FAILSAFE
    assert supervisor.step(31 * CYCLE).outcome is State.FAILSAFE
    supervisor.withdraw()
    supervisor.check.reason = lambda: Reason.SEPARATED
    stays_silent(supervisor, 32)


def test_a_step_that_is_missed_ends_it():
    supervisor = moving()
    stays_silent(supervisor, 31)


def test_a_clock_that_went_back_ends_it():
    """How long the robot has been without a command is not known then."""
    supervisor = moving()
    assert supervisor.step(29.0 * CYCLE).cause is Cause.CLOCK  # the same again is no harm
    back = supervisor.step(12 * CYCLE)
    assert (back.cause, back.verdict.reason) == (Cause.LATCHED, Reason.SILENCE)
    stays_silent(supervisor, 30)


def test_without_a_reaction_the_plan_is_held_and_the_robot_goes_on():
    for missed in (False, True):
        supervisor = moving(None)
        if not missed:
            supervisor.step(30 * CYCLE)
            supervisor.withdraw()
        commands = steps(supervisor, 60, first=31)
        assert commands[-1].outcome is State.EXECUTING


def test_at_rest_silence_changes_nothing():
    supervisor = scripted(silence=REACTION)
    steps(supervisor, 3)
    supervisor.withdraw()
    supervisor.step(1 * CYCLE)
    supervisor.step(9 * CYCLE)
    assert supervisor.propose(NewTrajectory(AWAY_AND_BACK)) is None
    first = supervisor.step(10 * CYCLE)
    assert first.cause is Cause.ADOPTED
    # it was to set out, but the robot does not know of that
    assert (supervisor.withdraw().q == HOME).all()
    assert steps(supervisor, 30, first=11)[-1].outcome is State.EXECUTING


def test_a_planner_without_as_many_decelerations_as_joints_is_refused():
    with pytest.raises(SetupError, match="1 decelerations should be 2"):
        scripted(silence=Silence(0.0, False, np.array([5.0])))


def test_missed_steps_at_the_end_of_the_path_are_no_silence():
    supervisor = scripted(silence=REACTION)
    supervisor.propose(NewTrajectory(quintic([HOME, HOME + 0.01], supervisor.check.robot.limits)))
    assert steps(supervisor, 80)[-1].outcome is State.STOPPED
    assert supervisor.step(95 * CYCLE).cause is Cause.RESTING
