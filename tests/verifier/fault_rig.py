"""A Panda, on request under everything that can be checked at once, driven to where a fault is to strike."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from enum import Enum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from failsafe.preparation import Reserve
from occupancy.humans.catalog import MODEL_NAMES
from occupancy.report import RawMeasurement
from tests.verifier.robot_side import Recorder, RobotSide
from tests.verifier.supervised import EPOCH, PANDA, PANDA_AWAY, PANDA_HOME, quintic, report
from verifier.cell import Cell
from verifier.command import Cause, Command, State
from verifier.cycle import CycleCheck
from verifier.known import PeopleWatch
from verifier.proposal import NewTrajectory, PathSpeed
from verifier.setup import Supervised, build_gate, build_profile, build_supervised
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.tracking import JointReading

Array = NDArray[np.float64]

CYCLE = 0.02
_ROBOT = PANDA["robot"]
FULL = {
    **PANDA,
    "cycle_s": CYCLE,
    "robot": {**_ROBOT, "tracking": {**_ROBOT["tracking"], "velocity_error_rad_s": 0.01}},
    "people": {
        "profile": "tum", "models": list(MODEL_NAMES), "repeated_points": "measured",
        "monitored": {
            "room": {
                "kind": "box", "min_m": [-7.0, -7.0, -3.0], "max_m": [7.0, 7.0, 5.0],
                "detection_time_s": 0.1,
            },
        },
    },
    "workspace": {
        "floor_z_m": -1.0,
        "fixtures": {
            "post": {"kind": "capsule", "a_m": [-1.5, 0.0, 0.0], "b_m": [-1.5, 0.0, 1.0], "radius_m": 0.05},
        },
    },
    "criteria": {
        "self_collision": True, "accept_unverified": True,
        "contact": [{"links": ["panda_link7"], "parts": ["r_hand"], "person_speed": "neglected"}],
    },
}  # fmt: skip


PLAIN = {**PANDA, "cycle_s": CYCLE}


@cache
def parts_of(full: bool) -> tuple[Supervised, Cell]:
    """The parts; the check is shared, the gate is not."""
    cell = Cell.from_table(FULL if full else PLAIN)
    return build_supervised(cell), cell


class Moment(Enum):
    """When a fault strikes."""

    EXECUTING = State.EXECUTING
    FAILSAFE = State.FAILSAFE
    RECOVERING = State.RECOVERING
    STOPPED = State.STOPPED


class Rig:
    """A supervisor that goes to and fro beside somebody 2.8 m away, and the robot that holds its plans."""

    def __init__(self, *, full: bool = False) -> None:
        parts, cell = parts_of(full)
        self.check: CycleCheck = parts.check
        self.limits = parts.check.robot.limits
        self.recorder = Recorder(parts.check)
        watch = PeopleWatch(build_gate(cell, build_profile(cell)), 0.0)
        settings = SupervisorSettings(0.25 * CYCLE, Reserve(step_s=0.25))
        self.supervisor = Supervisor(self.recorder, watch, parts.plans, settings, PANDA_HOME)
        self.recorder.supervisor = self.supervisor
        self.robot = RobotSide(self.recorder, PANDA_HOME)
        self.k = -1
        self.x = 2.8
        self.spoil: Callable[[RawMeasurement], RawMeasurement] | None = lambda sound: sound
        path = quintic([*[PANDA_HOME, PANDA_AWAY] * 4, PANDA_HOME], self.limits)
        assert self.supervisor.propose(NewTrajectory(path)) is None

    @property
    def now(self) -> float:
        return EPOCH + self.k * CYCLE

    def seen(self) -> list[RawMeasurement]:
        """What the sensor reports now; nothing without ``spoil``."""
        sound = report(self.now - 0.02, self.x, arrived=self.now)
        return [] if self.spoil is None else [self.spoil(sound)]

    def step(
        self,
        now: float | None = None,
        seen: Iterable[RawMeasurement] | None = None,
        joints: JointReading | None = None,
    ) -> Command:
        """Go on by a cycle; ``now``: what the clock says, if that is wrong."""
        self.k += 1
        self.robot.go_to(self.k * CYCLE)
        seen = self.seen() if seen is None else seen
        return self.take(self.supervisor.step(self.now if now is None else now, seen, joints))

    def take(self, command: Command) -> Command:
        """Hand a command over, and hold it against what the robot will do by itself."""
        self.robot.take(command)
        if command.t - EPOCH >= self.k * CYCLE - 1e-6:
            q, dq, ddq = self.robot.motion(command.t - EPOCH)
            # a double since 1970 is 2.4e-7 s coarse
            assert np.abs(command.q - q).max() <= 1e-9 + 5e-7 * np.abs(dq).max()
            assert np.abs(command.dq - dq).max() <= 1e-6 * (1.0 + np.abs(ddq).max())
        return command

    def miss(self, cycles: int) -> None:
        """Let time go on without a step."""
        self.k += cycles
        self.robot.go_to(self.k * CYCLE)

    def steps(self, count: int) -> list[Command]:
        return [self.step() for _ in range(count)]

    def until(self, state: State, most: int = 150) -> None:
        for _ in itertools.repeat(None, most):
            if self.step().outcome is state:
                return
        raise AssertionError(f"{state.name} was not reached: {self.supervisor.fault}")

    def go_to(self, moment: Moment, wait: int) -> None:
        """Bring it to a state, ``wait`` cycles after it first executes."""
        self.until(State.EXECUTING)
        self.steps(wait)
        while not np.abs(self.step().dq).max() > 0.4:  # in full motion, not beside a rest on the path
            assert self.k < 400
        if moment is Moment.EXECUTING:
            return
        self.recorder.refuse = True
        self.until(State.FAILSAFE)
        if moment is Moment.STOPPED:
            self.until(State.STOPPED)
        self.steps(1)
        self.recorder.refuse = False
        if moment is Moment.RECOVERING:
            self.until(State.RECOVERING)

    def goes_on(self) -> None:
        """Assert that it executes again, along its path and without a jump."""
        self.until(State.EXECUTING)
        self.robot.moved_within(self.limits)

    def rests(self, most: int = 60) -> None:
        """Assert that the robot comes to rest within ``most`` cycles whatever is called meanwhile."""
        for _ in itertools.repeat(None, most):
            self.step()
            if self.robot.rests:
                break
        assert self.robot.rests
        self.robot.moved_within(self.limits)

    def latched(self) -> None:
        """Assert that the robot rests and nothing is verified any more, whatever is proposed."""
        self.rests()
        place = self.robot.trace[-1][1]
        self.supervisor.propose(PathSpeed(1.0))
        for command in self.steps(10):
            assert command.cause is Cause.LATCHED and command.outcome is State.STOPPED
        assert np.array_equal(self.robot.trace[-1][1], place) and math.isfinite(place.sum())
