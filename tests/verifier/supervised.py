"""A supervisor whose check answers what a test wants, and one of a real arm with people around it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.preparation import Reserve
from failsafe.silence import Silence
from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point
from occupancy.measurement import PEOPLE
from occupancy.report import RawMeasurement, RawPerson
from robots.limits import JointLimits
from tests.failsafe.motions import limits_of
from tests.verifier.scenes import ALL_POINTS, person_at
from verifier.cell import Cell
from verifier.command import Command
from verifier.cycle import Known
from verifier.known import PeopleWatch
from verifier.setup import build_check, build_gate, build_profile, build_robot
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.verdict import CriterionKind, Reason, Verdict, verdict

Array = NDArray[np.float64]

CYCLE = 0.01
LIMITS = limits_of(
    np.array([2.0, 3.0]), np.array([10.0, 12.0]), np.array([400.0, 300.0]), [-3.0, -3.0], [3.0, 3.0]
)
HOME = np.array([0.5, -0.5])
EPOCH = 1_700_000_000.0


def quintic(points: Sequence[Array], limits: JointLimits, load: float = 0.6) -> IntendedTrajectory:
    """Through points (n,) with a standstill at each, at ``load`` times what the limits allow."""
    breaks, pieces = [0.0], []
    for a, b in itertools.pairwise(points):
        d = np.abs(np.asarray(b) - a)
        T = max(
            (1.875 * d / (load * limits.velocity)).max(),
            np.sqrt((10.0 / math.sqrt(3.0) * d / (load * limits.acceleration)).max()),
            np.cbrt((60.0 * d / (load * limits.jerk)).max()),
            0.01,
        )
        c = np.zeros((6, len(d)))
        c[0], rise = a, np.asarray(b) - a
        c[3], c[4], c[5] = 10 * rise / T**3, -15 * rise / T**4, 6 * rise / T**5
        breaks.append(breaks[-1] + T)
        pieces.append(c)
    return IntendedTrajectory(breaks, np.array(pieces), "rest")


AWAY = quintic([HOME, HOME + np.array([1.5, 1.0])], LIMITS)
AWAY_AND_BACK = quintic([HOME, HOME + np.array([1.5, 1.0]), HOME], LIMITS)


class ScriptedCheck:
    """In the place of a check: finds a plan that is ready to have what ``reason`` says."""

    def __init__(self, limits: JointLimits = LIMITS) -> None:
        self.robot = SimpleNamespace(limits=limits, joints=limits.joints)
        self.not_checked = 0
        self.reason: Callable[[], Reason] = lambda: Reason.SEPARATED
        self.plans = 0

    def check(self, t: float, plan, slices, known) -> Verdict:
        self.plans += 1
        ready = plan.outcome is PlanOutcome.READY
        reason = self.reason() if ready else Reason.NO_STOP_WITHIN_LIMITS
        return verdict(
            reason, t, gap_m=1.0, stop_time_s=plan.stop_time_s, criterion=CriterionKind.SEPARATION,
            not_checked=0,
        )  # fmt: skip

    check_moving = check
    at_rest = False


class ScriptedWatch:
    """In the place of the gate: takes in anything; a report that is an exception is raised."""

    def __init__(self) -> None:
        self.admitted: list[object] = []
        self.gate = SimpleNamespace(person_ids=())

    def admit(self, report, now: float) -> None:
        if report.frame == "raise":
            raise RuntimeError("planted")
        self.admitted.append((report, now))

    def known(self) -> Known:
        return Known(np.zeros(1, dtype=PEOPLE), False, 0.0, False, False)


def scripted(
    q: Array = HOME,
    cycle: float = CYCLE,
    delay: tuple[float, float] = (0.0, 0.0),
    q_error: float = 1e-3,
    limits: JointLimits = LIMITS,
    *,
    joint_space: bool = False,
    silence: Silence | None = None,
) -> Supervisor:
    n = len(limits.joints)
    plans = PlanSettings(
        cycle, delay, np.full(n, q_error), np.zeros(n), allow_joint_space=joint_space, silence=silence
    )
    settings = SupervisorSettings(0.25 * cycle, Reserve(step_s=0.1))
    return Supervisor(ScriptedCheck(limits), ScriptedWatch(), plans, settings, q)


def steps(supervisor: Supervisor, count: int, t: float = 0.0, first: int = 0) -> list[Command]:
    """Steps number ``first`` and on, each at its instant."""
    return [supervisor.step(t + k * CYCLE) for k in range(first, first + count)]


# A real arm


PANDA = {
    "cycle_s": CYCLE,
    "robot": {
        "name": "panda", "bare_flange": True,
        "tracking": {"position_error_rad": 0.001, "delay_max_s": 0.004},
    },
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}  # fmt: skip
PANDA_HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
PANDA_AWAY = np.array([1.2, 0.4, -0.3, -1.1, 0.4, 1.8, 0.5])


@cache
def panda():
    """Check, profile and cell of a Panda; the check is shared, the gate is not."""
    cell = Cell.from_table(PANDA)
    profile = build_profile(cell)
    robot = build_robot(cell)
    return build_check(cell, robot, profile, assume_nobody=False, gjk_limit=8), profile, cell


def panda_supervisor(q: Array = PANDA_HOME) -> Supervisor:
    check, profile, cell = panda()
    tracking = cell.robot.tracking
    plans = PlanSettings(
        CYCLE, (0.0, tracking.delay_max_s), np.full(7, tracking.position_error_rad), np.zeros(7),
        slice_s=cell.stop.slice_s, allow_joint_space=False,
    )  # fmt: skip
    watch = PeopleWatch(build_gate(cell, profile), 0.0)
    return Supervisor(check, watch, plans, SupervisorSettings(0.25 * CYCLE), q)


def report(
    stamp: float, x: float, y: float = 0.0, *, arrived: float | None = None, complete: bool = True
) -> RawMeasurement:
    """A report with one standing person."""
    points = person_at(x, y, 0.0)
    who = RawPerson("p1", points, np.full(len(Point), 0.01), ALL_POINTS)
    return RawMeasurement(stamp, stamp if arrived is None else arrived, "world", complete, (who,))
