"""Sources, sinks and planners that raise, block or die beside the loop, on a clock that a test moves."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.report import RawMeasurement
from tests.verifier.fault_rig import CYCLE, Moment, Rig
from tests.verifier.supervised import EPOCH, PANDA_AWAY, PANDA_HOME, quintic, report
from tests.verifier.test_faults import PlantedError, dice
from tests.verifier.test_loop import ToldClock
from verifier.command import Cause, Command, State
from verifier.loop import Loop, LoopReport, LoopSettings
from verifier.mode_runner import ModeRunner, Proposals
from verifier.proposal import NewTrajectory
from verifier.tracking import JointReading

Fault = Callable[["Room"], object]
_STOPS_WITHIN = 30
"""Cycles."""


class Room:
    """Source and sink of one robot; from cycle ``begin`` to ``end`` one of its calls does something else."""

    def __init__(self, where: str, fault: Fault, begin: int, end: int, moment: Moment) -> None:
        self.rig, self.clock = Rig(), ToldClock(EPOCH)
        self.where, self.fault, self.begin, self.end = where, fault, begin, end
        self.refused_from = begin - {Moment.STOPPED: _STOPS_WITHIN, Moment.FAILSAFE: 2}.get(moment, 0)
        self.number, self.struck = 0, 0
        self.states: list[tuple[int, State]] = []
        self.rested_in_fault = False

    def answer(self, where: str, sound: object) -> object:
        """What a call returns: what is sound, or what the fault makes of it."""
        if where != self.where or not self.begin <= self.number < self.end:
            return sound
        self.struck += 1
        return self.fault(self)

    def block(self, cycles: float) -> None:
        self.clock.t += cycles * CYCLE
        self.go_on()

    def go_on(self) -> None:
        """The robot drives what it holds meanwhile."""
        self.rig.robot.go_to(self.clock.t - EPOCH)
        if self.begin < self.number < self.end:
            self.rested_in_fault |= self.rig.robot.rests

    def measurements(self) -> list[RawMeasurement]:
        self.number += 1
        self.rig.recorder.refuse = self.refused_from <= self.number < self.begin
        self.go_on()
        found = self.answer("source", [report(self.clock.t - 0.02, 2.8, arrived=self.clock.t)])
        return found

    def joints(self) -> JointReading | None:
        here = JointReading(self.clock.t, self.rig.robot.motion(self.clock.t - EPOCH)[0])
        return self.answer("joints", here)

    def send(self, command: Command) -> bool:
        self.states.append((self.number, command.outcome))
        found = self.answer("sink", True)
        if found is True:
            self.rig.robot.take(command)
        return found


def run(room: Room, cycles: int) -> LoopReport:
    loop = Loop(room.rig.supervisor, room, room, LoopSettings(longest_stop_s=3.0, collect_s=1.0), room.clock)
    done = loop.run(cycles)
    assert done.at_rest and room.struck > 0
    room.rig.robot.go_to(room.clock.t - EPOCH + 1.0)
    assert room.rig.robot.rests
    room.rig.robot.moved_within(room.rig.limits)
    return done


def raises(_room: Room) -> None:
    raise PlantedError("planted")


def blocks(cycles: float, then: object = False) -> Fault:
    def fault(room: Room) -> object:
        room.block(cycles)
        if then is PlantedError:
            raise PlantedError("planted")
        return then

    return fault


FAULTS: dict[tuple[str, str], Fault] = {
    ("source", "raises"): raises,
    ("source", "gives nothing"): lambda _room: [],
    ("source", "gives none"): lambda _room: None,
    ("source", "blocks"): blocks(1.4, ()),
    ("source", "blocks for long"): blocks(80.0, ()),
    ("source", "blocks and raises"): blocks(3.3, PlantedError),
    ("joints", "raises"): raises,
    ("joints", "blocks"): blocks(2.2, None),
    ("joints", "NaN"): lambda room: JointReading(room.clock.t, np.full(7, math.nan)),
    ("sink", "raises"): raises,
    ("sink", "refuses"): lambda _room: False,
    ("sink", "answers none"): lambda _room: None,
    ("sink", "answers 1"): lambda _room: 1,
    ("sink", "blocks"): blocks(1.4),
    ("sink", "blocks for long"): blocks(80.0),
    ("sink", "blocks and raises"): blocks(3.3, PlantedError),
}


MOMENTS = [Moment.EXECUTING, Moment.FAILSAFE, Moment.STOPPED]


@pytest.mark.parametrize("number", range(len(FAULTS)), ids=[" ".join(each) for each in FAULTS])
def test_whatever_source_and_sink_do_the_robot_drives_a_verified_plan(number, seed, count):
    """At the share of counts of a usual run each fault strikes at one moment, in turn; else at all."""
    for k in range(number, number + min(len(MOMENTS), count(100))):
        strike(*list(FAULTS)[number], MOMENTS[k % len(MOMENTS)], seed)


def strike(where: str, how: str, moment: Moment, seed: int) -> None:
    rng = dice(seed, where, how, moment.name)
    begin = 45 + int(rng.integers(0, 30))
    lasts = int(rng.choice([2, 5])) if "long" in how else int(rng.choice([1, 5, 90]))
    room = Room(where, FAULTS[where, how], begin, begin + lasts, moment)
    done = run(room, begin + lasts + 70)
    raised = how in ("raises", "blocks and raises", "gives none")
    assert (done.source_faults == lasts) is (raised and where != "sink")
    assert (done.fault is not None) is raised
    assert done.not_taken == (lasts if where == "sink" else 0)
    assert done.causes[Cause.LATCHED] == done.causes[Cause.FAULT] == 0
    if lasts == 90 or "long" in how:
        assert room.rested_in_fault
    after = [state for number, state in room.states if number >= begin + lasts]
    assert State.EXECUTING in after


def test_a_sink_that_takes_nothing_is_never_left_with_two_plans():
    """Every second command is refused: the robot goes on with the plan before, and so does the supervisor."""
    room = Room("sink", lambda room: bool(room.number % 2), 20, 200, Moment.EXECUTING)
    run(room, 200)
    assert room.rig.supervisor.fault is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_planner_whose_thread_is_dead_leaves_the_robot_at_the_end_of_its_path():
    rig = Rig()
    path = quintic([PANDA_HOME, PANDA_AWAY, PANDA_HOME], rig.limits)

    class Dies:
        name = "dies"
        calls = 0

        def propose(self, _view: object) -> NewTrajectory:
            self.calls += 1
            if self.calls == 2:
                raise SystemExit
            return NewTrajectory(path)

    mode = Dies()
    runner = ModeRunner(Proposals(rig.supervisor), mode, 1e-4)
    runner.start()
    runner._thread.join(30.0)
    assert not runner._thread.is_alive() and mode.calls == 2
    commands = rig.steps(300)
    assert commands[-1].outcome is State.STOPPED and commands[-1].cause is Cause.RESTING
    assert max(np.abs(command.dq).max() for command in commands) > 0.5
    assert np.allclose(commands[-1].q, PANDA_HOME, atol=1e-9) and rig.robot.rests
    rig.robot.moved_within(rig.limits)
    assert runner.report.fault is None and runner.stop()


def test_a_planner_that_dies_between_two_proposals_changes_no_command():
    """Of a trajectory that was prepared, but never handed over, nothing is seen."""
    rig, twin = Rig(), Rig()
    new = quintic([PANDA_HOME, PANDA_AWAY], rig.limits, 0.3)
    prepare = rig.supervisor._proposals._preparation.prepare

    def dies(*given: object) -> object:
        prepare(*given)
        raise SystemExit

    rig.supervisor._proposals._preparation.prepare = dies
    with pytest.raises(SystemExit):
        rig.supervisor.propose(NewTrajectory(new))
    for a, b in zip(rig.steps(60), twin.steps(60), strict=True):
        assert np.array_equal(a.q, b.q) and a.cause is b.cause
