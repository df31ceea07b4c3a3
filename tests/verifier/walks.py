"""Somebody walks up to a Panda at work, and back again: the same scene as often as a test needs it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from occupancy.report import RawMeasurement
from tests.verifier.supervised import CYCLE, PANDA, PANDA_HOME, panda, panda_supervisor, quintic, report
from verifier.cell import Cell
from verifier.known import PeopleWatch
from verifier.outlook import Outlook
from verifier.proposal import NewTrajectory
from verifier.safety_state import ProbeSettings, SafetyProbe, look
from verifier.setup import build_check, build_gate, build_profile, build_supervised
from verifier.supervisor import Supervisor, SupervisorSettings

Array = NDArray[np.float64]

LATENCY_S = 0.02
EVERY = 3
"""A report arrives in every third step."""
MODELS = ("iso13855", "articulated_velocity", "articulated_acceleration", "arm_reach", "articulated_position")


@dataclass(frozen=True)
class Walk:
    """A path of the arm, and somebody who comes from ``far`` [m] in the direction ``angle`` at ``speed``."""

    path: IntendedTrajectory
    angle: float
    far: float
    speed: float
    models: bool = False

    @classmethod
    def random(cls, rng: np.random.Generator, *, models: bool = False) -> Walk:
        limits = panda()[0].robot.limits
        step = rng.uniform(-1.0, 1.0, 7) * np.array([1.5, 0.5, 0.4, 0.4, 0.4, 0.4, 0.4])
        path = quintic([PANDA_HOME, PANDA_HOME + step, PANDA_HOME], limits, rng.uniform(0.3, 0.75))
        return cls(path, rng.uniform(-1.2, 1.2), rng.uniform(1.1, 1.6), rng.uniform(0.3, 0.9), models)

    def place(self, k: int) -> tuple[float, float]:
        distance = max(0.75, self.far - self.speed * k * CYCLE)
        return distance * math.cos(self.angle), distance * math.sin(self.angle)

    def reports(self, k: int, shift: float = 0.0) -> list[RawMeasurement]:
        """What arrives in step k; ``shift``: all of it was seen so much earlier [s]."""
        if k % EVERY:
            return []
        now = k * CYCLE
        return [report(now - LATENCY_S - shift, *self.place(k), arrived=now)]

    def new_supervisor(self) -> Supervisor:
        supervisor = panda_supervisor() if not self.models else modelled_supervisor()
        assert supervisor.propose(NewTrajectory(self.path)) is None
        return supervisor

    def after(self, count: int, shift: float = 0.0) -> Supervisor:
        """A supervisor after so many steps."""
        supervisor = self.new_supervisor()
        for k in range(count):
            supervisor.step(k * CYCLE, self.reports(k, shift))
        assert supervisor.fault is None
        return supervisor

    def outlooks(self, count: int = 120, each: int = 4) -> Iterator[tuple[int, Outlook]]:
        """After how many steps, and what the next one would begin with."""
        supervisor = self.new_supervisor()
        for k in range(count):
            supervisor.step(k * CYCLE, self.reports(k))
            if k % each == each - 1:
                yield k + 1, look(supervisor)


def modelled() -> Cell:
    """The cell of :data:`PANDA` with several models of people."""
    return Cell.from_table(PANDA | {"people": PANDA["people"] | {"profile": "tum", "models": MODELS}})


def modelled_supervisor() -> Supervisor:
    cell, robot = modelled(), panda()[0].robot
    parts = build_supervised(cell, robot)
    watch = PeopleWatch(build_gate(cell, build_profile(cell)), 0.0)
    return Supervisor(parts.check, watch, parts.plans, SupervisorSettings(0.25 * CYCLE), PANDA_HOME)


def cell_of(walk: Walk) -> Cell:
    return modelled() if walk.models else panda()[2]


def fresh_check(walk: Walk):
    """A check like the supervisor's that nobody has used."""
    cell = cell_of(walk)
    return build_check(cell, panda()[0].robot, build_profile(cell), assume_nobody=False, gjk_limit=8)


def plans_of(walk: Walk):
    return build_supervised(cell_of(walk), panda()[0].robot).plans


@cache
def probe_of(models: bool, settings: ProbeSettings) -> SafetyProbe:
    cell = modelled() if models else panda()[2]
    return SafetyProbe.from_cell(cell, settings, panda()[0].robot)
