"""Faults at every stage of a step and at every moment: at rest on a verified plan, named, nothing jumps.

What the robot does is measured on the robot side, which holds verified plans and integrates them by itself.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

import verifier.cycle
import verifier.supervisor
from failsafe import limit_kernels, manoeuvre, slice_kernels
from failsafe.running_plan import RunningPlan
from failsafe.trajectory import IntendedTrajectory
from occupancy.humans.catalog import MODEL_NAMES
from occupancy.report import RawMeasurement
from tests.verifier.fault_rig import CYCLE, Moment, Rig
from tests.verifier.supervised import EPOCH, PANDA_HOME
from verifier.command import Cause, State
from verifier.proposal import NewTrajectory
from verifier.tracking import JointReading
from verifier.verdict import Reason, Status

NAN = math.nan


class PlantedError(RuntimeError):
    """What a test raises where nothing is wrong."""


class Stage(NamedTuple):
    """Where an exception is planted: attribute ``name`` of ``owner(rig)``.

    ``latches``: nothing is verified afterwards. ``first``: model of people that must be asked.
    """

    owner: Callable[[Rig], Any]
    name: str
    latches: bool = False
    first: int = 0


MODELS = (*MODEL_NAMES, "unobserved")
STAGES: dict[str, Stage] = {
    "clock": Stage(lambda rig: rig.supervisor, "_since_epoch"),
    "grid": Stage(lambda rig: rig.supervisor._grid, "advance"),
    "notes of what was commanded": Stage(lambda rig: rig.supervisor, "_note_until"),
    "watch": Stage(lambda rig: rig.supervisor.watch, "admit", latches=True),
    "gate": Stage(lambda rig: rig.supervisor.watch.gate, "admit", latches=True),
    "what is known": Stage(lambda rig: rig.supervisor.watch, "known"),
    "tracking": Stage(lambda rig: rig.supervisor._tracking, "check"),
    "proposals": Stage(lambda rig: rig.supervisor, "_take_proposals"),
    "state on the path": Stage(lambda _rig: RunningPlan, "path_state"),
    "planner": Stage(lambda rig: rig.supervisor._planner, "follow"),
    "change of speed": Stage(lambda rig: rig.supervisor._planner, "_change_speed"),
    "stop": Stage(lambda rig: rig.supervisor._planner, "_stop"),
    "ruckig": Stage(lambda _rig: manoeuvre.VelocityProfile, "calculate"),
    "proof of limits": Stage(lambda _rig: limit_kernels, "append_and_prove"),
    "slices": Stage(lambda _rig: slice_kernels, "slice_path"),
    "sweep of links": Stage(lambda rig: rig.check._sweep, "occupy"),
    "which links move": Stage(lambda _rig: verifier.cycle, "mark_moving"),
    "links that are commanded": Stage(lambda _rig: verifier.cycle, "mark_commanded"),
    "workspace": Stage(lambda rig: rig.check.robot_criteria[0], "check"),
    "self-collision": Stage(lambda rig: rig.check.robot_criteria[1], "check"),
    "obligations": Stage(lambda _rig: verifier.cycle, "open_moving"),
    **{
        f"model {name}": Stage(lambda rig, i=i: rig.check.occupancies[i].model, "occupy", first=i)
        for i, name in enumerate(MODELS)
    },
    "boxes": Stage(lambda rig: rig.check.criteria[0]._separation, "_prove_by_boxes"),
    "separation": Stage(lambda rig: rig.check.criteria[0]._separation, "_check_pairs"),
    "distance engine": Stage(lambda rig: rig.check.criteria[0]._separation.engine, "propose"),
    "power and force limiting": Stage(lambda rig: rig.check.contact, "clear"),
    "verdict": Stage(lambda _rig: verifier.cycle, "verdict"),
    "verdict of the supervisor": Stage(lambda _rig: verifier.supervisor, "verdict"),
    "adoption": Stage(lambda rig: rig.supervisor, "_adopt"),
    "taking of the plan": Stage(lambda _rig: RunningPlan, "take"),
    "command": Stage(lambda _rig: RunningPlan, "motion"),
    "note of the command": Stage(lambda rig: rig.supervisor._tracking, "note"),
    "answer": Stage(lambda rig: rig.supervisor, "_answer"),
}


class Strike:
    """An exception planted in a stage, and the detours that make sure that the stage is reached."""

    def __init__(self, rig: Rig, name: str, patch: pytest.MonkeyPatch) -> None:
        self.name, self.times = name, 0
        stage = STAGES[name]
        owner, check = stage.owner(rig), rig.check
        order = (check.occupancies[stage.first], *check.occupancies)
        patch.setattr(check, "occupancies", tuple(dict.fromkeys(order)))
        if name == "power and force limiting":
            patch.setattr(check, "criteria", ())  # what they leave open is all that it looks at
        if name in ("separation", "distance engine"):
            patch.setattr(check.criteria[0]._separation, "_boxes_first", False)
        if name == "distance engine":
            patch.setattr(check.criteria[0]._separation, "_check_pairs", lambda *_: owner.propose(None, None))
        if name in ("change of speed", "stop", "proof of limits", "slices"):  # else only while ṡ changes
            patch.setattr(rig.supervisor._planner._manoeuvre, "steady_then", lambda *_: False)
        if name == "stop":  # out of the middle of one there may be a plan without it
            patch.setattr(rig.supervisor._planner, "_released", lambda *_: None)
        patch.setattr(owner, stage.name, self.raises)

    def raises(self, *_arguments: object, **_more: object) -> None:
        self.times += 1
        raise PlantedError(f"planted in {self.name}")


def dice(seed: int, *names: object) -> np.random.Generator:
    """A generator for one case."""
    return np.random.default_rng([seed, zlib.crc32(" ".join(map(str, names)).encode())])


def reading(rig: Rig, by: float = 0.0) -> JointReading:
    """Where the robot is at the next step; off ``by``."""
    return JointReading(rig.now + CYCLE, rig.robot.motion((rig.k + 1) * CYCLE)[0] + by)


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("name", STAGES)
def test_an_exception_at_any_stage_ends_at_rest_on_a_verified_plan(name, moment, seed):
    rng = dice(seed, name, moment.name)
    rig = Rig(full=True)
    rig.go_to(moment, int(rng.integers(0, 25)))
    lasts = int(rng.choice([1, 2, 5, 60]))
    with pytest.MonkeyPatch.context() as patch:
        strike, k = Strike(rig, name, patch), 0
        while k < lasts or strike.times == 0:
            struck, k = strike.times, k + 1
            # the supervisor itself has something to say where the robot is not where it should be
            command = rig.step(joints=reading(rig, 0.5 if name == "verdict of the supervisor" else 0.0))
            assert command.cause is not Cause.ADOPTED
            if strike.times > struck:
                assert command.cause is Cause.FAULT
                assert command.verdict.reason is Reason.FAULT
                assert command.verdict.status is Status.NOT_CHECKED
                assert name in str(rig.supervisor.fault)
            assert k <= 100, "the stage is not reached"
        assert lasts < 60 or rig.robot.rests
        # without a clock no state can be told, and the last command stands
        assert lasts < 60 or name in ("clock", "grid") or command.outcome is State.STOPPED
    if STAGES[name].latches:
        rig.latched()
    else:
        rig.goes_on()


def test_an_exception_in_the_one_call_for_a_steady_plan_ends_in_the_stop_of_the_plan_before(seed):
    """This call is made only at constant path speed: while ṡ changes other code makes the plans."""
    rig = Rig(full=True)
    rig.go_to(Moment.EXECUTING, 20)
    struck = 0
    for _ in range(400):
        with pytest.MonkeyPatch.context() as patch:
            calls: list[int] = []

            def raises(*_given: object, calls: list[int] = calls) -> None:
                calls.append(1)
                raise PlantedError("planted")

            patch.setattr(rig.supervisor._planner._manoeuvre, "steady_then", raises)
            command = rig.step()
        if calls:
            struck += 1
            assert command.cause is Cause.FAULT and command.outcome in (State.FAILSAFE, State.STOPPED)
            rig.goes_on()
            if struck == 3:
                return
    pytest.fail("the call is not made: the loop never has a constant path speed")


@pytest.mark.parametrize("name", ["command", "note of the command", "answer"])
@pytest.mark.parametrize("moment", [Moment.EXECUTING, Moment.RECOVERING], ids=lambda m: m.name)
def test_an_exception_while_a_plan_is_withdrawn_leaves_the_one_before(name, moment, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, name, moment).integers(0, 25)))
    while rig.step().cause is not Cause.ADOPTED:
        pass
    rig.k += 1
    rig.robot.go_to(rig.k * CYCLE)
    last = rig.supervisor._last
    adopted = rig.supervisor.step(rig.now, rig.seen())
    assert adopted.cause is Cause.ADOPTED
    rig.recorder.found = None  # the robot side did not take it
    with pytest.MonkeyPatch.context() as patch:
        strike = Strike(rig, name, patch)
        command = rig.take(rig.supervisor.withdraw())
    assert strike.times > 0 and name in str(rig.supervisor.fault)
    assert command.cause is Cause.FAULT and command.t == last.t and np.array_equal(command.q, last.q)
    again = rig.supervisor.step(rig.now)
    assert again.cause is Cause.CLOCK and np.array_equal(again.q, last.q), "what was withdrawn is given out"
    rig.goes_on()


# Exceptions beside a proposal


@pytest.mark.parametrize("name", ["_why_not", "_adopt", "_answer"])
@pytest.mark.parametrize("lasts", [1, 60])
def test_an_exception_while_a_trajectory_is_joined_jumps_nowhere(name, lasts, seed):
    rig = Rig()
    rig.go_to(Moment.EXECUTING, int(dice(seed, name, lasts).integers(0, 25)))
    old = rig.supervisor._running.trajectory
    join = rig.supervisor.view().s_rest + 0.1
    assert rig.supervisor.propose(NewTrajectory(branch(old, join), join)) is None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rig.supervisor, name, raise_planted)
        commands = rig.steps(lasts)
    assert commands[0].cause is Cause.FAULT
    if name != "_why_not":  # which is asked once for each proposal
        assert all(command.cause is not Cause.ADOPTED for command in commands)
        assert lasts == 1 or rig.robot.rests
    rig.goes_on()


def branch(old: IntendedTrajectory, s: float) -> IntendedTrajectory:
    """From where ``old`` is at ``s``, with its q, q', q'', to a rest not far ahead."""
    q, v, a, _ = old.sample(s)
    T = 4.0
    rows = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
    right = np.stack([0.1 - v * T / 2 - a * T**2 / 2, -v - a * T, -a])
    c = np.concatenate([np.stack([q, v, a / 2]), np.linalg.solve(rows, right)])
    return IntendedTrajectory([0.0, T], c[None], "rest")


def raise_planted(*_arguments: object, **_more: object) -> None:
    raise PlantedError("planted")


# What is reported


def without_points(report: RawMeasurement) -> RawMeasurement:
    people = tuple(who._replace(xyz=np.full_like(who.xyz, NAN)) for who in report.people)
    return report._replace(people=people)


def elsewhere(report: RawMeasurement) -> RawMeasurement:
    """Two metres aside: nobody gets there in a cycle."""
    return report._replace(
        people=tuple(who._replace(xyz=who.xyz + np.array([0.0, 2.0, 0.0])) for who in report.people)
    )


Spoil = Callable[[RawMeasurement], RawMeasurement]
REPORTS: dict[str, Spoil | None] = {
    "the sensor stops": None,
    "NaN": without_points,
    "future stamps": lambda r: r._replace(stamp=r.stamp + 1.0),
    "stamps that stand still": lambda r: r._replace(stamp=EPOCH),
    "stamps that are none": lambda r: r._replace(stamp=NAN),
    "arrivals that are none": lambda r: r._replace(arrived=math.inf),
    "an unknown frame": lambda r: r._replace(frame="elsewhere"),
    "nobody, and not complete": lambda r: r._replace(people=(), complete=False),
    "a person who jumps": elsewhere,
    "in millimetres": lambda r: r._replace(
        people=tuple(who._replace(xyz=1000.0 * who.xyz) for who in r.people)
    ),
}


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("name", REPORTS)
def test_reports_that_are_none_end_at_rest_until_they_are_again(name, moment, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, name, moment.name).integers(0, 25)))
    sound, rig.spoil = rig.spoil, REPORTS[name]
    reasons = set()
    for k in itertools.count():
        command = rig.step()
        reasons.add(command.verdict.reason)
        assert command.verdict.status is Status.VERIFIED or command.cause is not Cause.ADOPTED
        if command.cause is Cause.NOT_VERIFIED and rig.robot.rests:
            break
        assert k < 200, f"it does not come to rest: {reasons}"
    for command in rig.steps(10):
        assert command.cause is Cause.NOT_VERIFIED and command.outcome is State.STOPPED
        assert command.verdict.status is not Status.VERIFIED
    assert rig.supervisor.fault is None
    rig.spoil = sound
    rig.goes_on()


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("sound_ones", [0, 1])
def test_reports_that_raise_half_way_latch(moment, sound_ones, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, sound_ones, moment.name).integers(0, 25)))

    def raising() -> Iterator[RawMeasurement]:
        yield from rig.seen()[:sound_ones]
        raise PlantedError("planted in a report")

    command = rig.step(seen=raising())
    assert command.cause is Cause.FAULT and "planted in a report" in str(rig.supervisor.fault)
    rig.latched()


# What the joints say

JOINTS: dict[str, Callable[[Rig], JointReading]] = {
    "elsewhere": lambda rig: reading(rig, 0.02),
    "NaN": lambda rig: reading(rig, NAN),
    "infinite": lambda rig: reading(rig, math.inf),
    "too few": lambda rig: JointReading(rig.now, np.zeros(3)),
    "no stamp": lambda rig: reading(rig)._replace(t=NAN),
    "no numbers": lambda rig: JointReading(rig.now, None),
    "text": lambda rig: JointReading("now", PANDA_HOME),
}


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("name", JOINTS)
def test_joints_that_do_not_follow_end_at_rest_until_they_do(name, moment, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, name, moment.name).integers(0, 25)))
    for _ in range(60):
        command = rig.step(joints=JOINTS[name](rig))
        assert command.cause in (Cause.NOT_VERIFIED, Cause.FAULT)
        if command.cause is Cause.NOT_VERIFIED:
            assert command.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING
            assert rig.supervisor.deviation is not None
        else:
            assert rig.supervisor.fault is not None
    assert rig.robot.rests and command.outcome is State.STOPPED
    assert rig.step(joints=reading(rig)).cause is not Cause.FAULT
    rig.goes_on()


# Clocks


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("name", ["it stands still", "it goes back", "NaN", "infinite", "text", "an object"])
def test_a_clock_that_does_not_advance_leaves_the_robot_to_its_plan(name, moment, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, name, moment.name).integers(0, 25)))
    last, begin = rig.supervisor._last, rig.now
    clock: dict[str, Any] = {
        "it stands still": begin, "it goes back": begin - 3.0, "NaN": NAN, "infinite": math.inf,
        "text": "now", "an object": object(),
    }  # fmt: skip
    for _ in range(60):
        command = rig.step(clock[name])
        assert command.cause in (Cause.CLOCK, Cause.FAULT) and command.missed == 0
        assert command.verdict.status is Status.NOT_CHECKED
        assert command.t == last.t and np.array_equal(command.q, last.q)
    assert rig.robot.rests
    assert rig.step().missed == 60
    rig.goes_on()


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("missed", [1, 2, 3, 7, 60])
def test_after_missed_steps_it_goes_on_from_where_the_robot_is(missed, moment, seed):
    rig = Rig()
    rig.go_to(moment, int(dice(seed, missed, moment.name).integers(0, 25)))
    for _ in range(5):
        rig.miss(missed)
        command = rig.step(joints=reading(rig))
        assert command.missed == missed and rig.supervisor.deviation is None
        rig.steps(2)
    rig.goes_on()


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
@pytest.mark.parametrize("late", [0.3, 0.74, 0.99, 1.6])
def test_a_step_whose_command_comes_too_late_is_withdrawn(late, moment, seed):
    """The robot side has gone on with its plan before the command of the step could reach it."""
    rig = Rig()
    rig.go_to(moment, int(dice(seed, late, moment.name).integers(0, 25)))
    for _ in range(40):
        rig.k += 1
        seen = rig.seen()
        command = rig.supervisor.step(rig.now, seen)
        rig.robot.go_to((rig.k + late) * CYCLE)
        if (rig.k + late) * CYCLE > command.deadline - EPOCH:
            rig.recorder.found = None
            rig.take(rig.supervisor.withdraw())
            rig.k += 1
        else:
            rig.take(command)
    assert late < 1.0 or rig.robot.rests
    rig.goes_on()


@pytest.mark.parametrize("moment", Moment, ids=lambda m: m.name)
def test_a_step_that_is_called_twice_changes_nothing(moment, seed):
    rig, twin = Rig(), Rig()
    wait = int(dice(seed, moment.name).integers(0, 25))
    rig.go_to(moment, wait)
    twin.go_to(moment, wait)
    for _ in range(60):
        a, b = rig.step(), twin.step()
        for more in (0.0, 0.1 * CYCLE, -0.1 * CYCLE):
            again = rig.take(rig.supervisor.step(rig.now + more))
            assert again.cause is Cause.CLOCK and np.array_equal(again.q, a.q) and again.t == a.t
        assert np.array_equal(a.q, b.q) and a.outcome is b.outcome and a.cause is b.cause
    rig.goes_on()
