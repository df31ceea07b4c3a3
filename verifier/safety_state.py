"""The safety state: what the supervisor is going to say, for planners that ask (docs/supervisor.md).

It is advice. It is computed from copies, in the thread or process of whoever asks, by a planner and a check
of its own; nothing of it reaches the supervisor, and nothing is verified by it. Where nothing newer arrives,
the next step makes the very plan that was looked at here, and says the same about it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from failsafe.plan import PlanOutcome, PlanResult, PlanSettings
from failsafe.preparation import Preparation, Refusal, Reserve
from failsafe.running_plan import RunningPlan
from failsafe.scaling import PathState
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.constraint import Constraint, Pair, PairFinder
from verifier.cycle import CycleCheck, Known
from verifier.outlook import Made, Outlook
from verifier.setting_out import Decided, SettingOut, Start
from verifier.setup import build_check, build_profile, build_robot, build_supervised
from verifier.supervisor import Supervisor
from verifier.verdict import Reason, Status, Verdict, verdict

_LEVELS = 8
"""Path speeds that are tried first, from the largest down."""
_MOST_PLACES = 20_000
"""A trajectory is looked at in no more places than this."""


@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """What is looked at, and how finely.

    Attributes
    ----------
    horizon_s:
        For how much longer than a cycle a change of path speed must be verified for the speed to be allowed
        [s]; ``None``: one cycle, 0: the next plan alone.
    speed_step:
        Resolution of the allowed path speed.
    latency_bound_s, latency_step_s:
        No more extra latency than this is tried, and its resolution [s].
    """

    horizon_s: float | None = None
    speed_step: float = 1.0 / 64.0
    latency_bound_s: float = 0.5
    latency_step_s: float = 0.001

    def __post_init__(self) -> None:
        if self.horizon_s is not None and not 0.0 <= self.horizon_s < math.inf:
            raise SetupError(f"horizon of {self.horizon_s} s should be finite and not negative")
        for name in ("speed_step", "latency_step_s", "latency_bound_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise SetupError(f"{name} = {getattr(self, name)} should be positive and finite")


@dataclass(frozen=True, slots=True, eq=False)
class SafetyState:
    """What would be verified if nothing newer arrived.

    N(σ, h) is the plan that the next step makes when path speed σ is wanted, but with h more of the change
    before its stop begins: the change from the present path state towards σ for a cycle and h, then the stop.

    Attributes
    ----------
    t, s, sdot:
        When the next plan begins [s, caller's clock], and the path state there [s; 1]; NaN before the first
        step, and off the path.
    verdict:
        On the next plan, N(σ, 0) with the path speed σ that is wanted.
    allowed_path_speed:
        A σ in [0, 1] for which N(σ, 0) and N(σ, horizon) are both verified, found by trying 1, 7/8, … 0 and
        then by bisection up to the level above: neither that σ is which lies one step of the resolution
        above it, nor any larger one of the levels. 0: none is; what is being executed was verified with
        what was known before. Not claimed: that no other larger σ is verified (there are gaps where the
        search for a stop fails, and where an arm leaves somebody's way quickly), nor that a later plan is.
    nearest:
        The pair that decides the next plan; ``None``: no two things were compared (nobody is known, nothing
        moves).
    tolerable_latency_s:
        By how much older each of the measurements might be [s], some more and others less, for the next plan
        still to be verified; found by bisection, at most ``ProbeSettings.latency_bound_s``. NaN: it is not
        verified as it is.
    refused:
        Why the plan of the last step was not verified; ``None``: it was, or there was none.
    """

    t: float
    s: float
    sdot: float
    verdict: Verdict
    allowed_path_speed: float
    nearest: Pair | None
    tolerable_latency_s: float
    refused: Constraint | None

    def reports_to_spare(self, period_s: float) -> int:
        """Return how many reports that come every ``period_s`` [s] may fail to come before the next plan."""
        if not (self.tolerable_latency_s >= 0.0 and period_s > 0.0):
            return 0
        return math.floor(self.tolerable_latency_s / period_s)


@dataclass(frozen=True, slots=True, eq=False)
class DryRun:
    """What would be said about a trajectory if the robot were on it now, with people as they are known now.

    At each place the plan is looked at that begins there with the path speed asked for: a cycle at that
    speed, then the stop. People are where they are, and their measurements as old, at every place: it says
    where a trajectory is too close, not where people will be by then.

    Attributes
    ----------
    verified:
        Every plan is; the places are ``step_s`` apart, and nothing is claimed between them.
    places:
        How many were looked at.
    s:
        First place whose plan is not verified [s, path parameter]; NaN if there is none.
    constraint:
        Why it is not; its ``path_speed`` is one at which the plan that begins there would be, found by
        bisection, 0 if none was found.
    refusal:
        Why the trajectory would not be taken over at all, whoever is there.

    Neither constraint nor refusal: the supervisor verifies nothing any more, and no place was looked at.
    """

    verified: bool
    places: int
    s: float
    constraint: Constraint | None
    refusal: Refusal | None


def look(supervisor: Supervisor, patience_s: float = 0.1) -> Outlook:
    """Return copies of what the next step begins with, from any thread.

    Raises
    ------
    TimeoutError
        No moment between two steps was met within ``patience_s`` [s]: a step hangs.
    """
    until = time.monotonic() + patience_s
    while True:
        found = supervisor.outlook()
        if found is not None:
            return found
        if not time.monotonic() < until:
            raise TimeoutError(f"no moment between two steps within {patience_s} s")
        time.sleep(0.0)


class SafetyProbe:
    """Computes safety states, for one thread at a time.

    Parameters
    ----------
    check, plans:
        As the supervisor's, but not shared with it.
    finder:
        Looks for the pair that decides.
    settings, reserve:
        What is looked at; what trajectories must leave to manoeuvres.
    """

    def __init__(
        self,
        check: CycleCheck,
        plans: PlanSettings,
        finder: PairFinder,
        settings: ProbeSettings | None = None,
        reserve: Reserve | None = None,
    ) -> None:
        limits = check.robot.limits
        self.settings = settings or ProbeSettings()
        self._check, self._finder, self._cycle = check, finder, plans.cycle_s
        horizon = plans.cycle_s if self.settings.horizon_s is None else self.settings.horizon_s
        self._next = ShortTermPlanner(limits, plans)
        self._later = ShortTermPlanner(limits, replace(plans, cycle_s=plans.cycle_s + horizon))
        self._setting_out = SettingOut(check, plans)
        self._preparation = Preparation(limits, plans, reserve or Reserve())

    @classmethod
    def from_cell(
        cls, cell: Cell, settings: ProbeSettings | None = None, robot: RobotModel | None = None
    ) -> Self:
        """Set up what a cell names; ``robot``: the supervisor's, to save reading it again.

        Raises
        ------
        SetupError
            The cell cannot be used.
        """
        robot = build_robot(cell) if robot is None else robot
        parts = build_supervised(cell, robot)
        measure = build_check(cell, robot, build_profile(cell), assume_nobody=False)
        return cls(parts.check, parts.plans, PairFinder(measure, cell.check.margin_m), settings)

    def state(self, outlook: Outlook) -> SafetyState:
        """Return the safety state of a moment between two steps."""
        t, command = outlook.begin + outlook.epoch, outlook.command
        start = _where(outlook)
        outside = command.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING
        if outlook.latched or outside or not math.isfinite(t):
            return SafetyState(t, start.s, start.sdot, command.verdict, 0.0, None, math.nan, None)
        decided, answer = self._judged(outlook, outlook.target)
        pair = latency = None
        if decided is not None:
            made = self._made(outlook.trajectory, decided.plan, outlook.begin, decided.planner)
            latency = self._tolerable(outlook, decided)
            pair = self._finder.find(outlook, made) if made.motion is not None else None
        allowed = self._allowed(outlook)
        refused = None
        if outlook.made is not None:
            before = outlook._replace(now=outlook.now - self._cycle)
            refused = self._finder.constraint(before, outlook.made, command.verdict, allowed)
        bound = self.settings.latency_bound_s
        return SafetyState(
            t, start.s, start.sdot, answer._replace(t=answer.t + outlook.epoch), allowed, pair,
            bound if latency is None else latency, refused,
        )  # fmt: skip

    def would_verify(
        self, outlook: Outlook, trajectory: IntendedTrajectory, sdot: float = 1.0, step_s: float = 0.02
    ) -> DryRun:
        """Hold a trajectory, as it would be proposed, against people as they are known now.

        ``sdot``: path speed with which it is followed, above 0 and at most 1; ``step_s``: distance of the
        places [s].

        Raises
        ------
        SetupError
            ``sdot`` or ``step_s`` cannot be used.
        """
        if not 0.0 < sdot <= 1.0:
            raise SetupError(f"path speed {sdot} should be above 0 and at most 1")
        if not 0.0 < step_s < math.inf:
            raise SetupError(f"step of {step_s} s should be positive and finite")
        whole = self._preparation.prepare(trajectory)
        if isinstance(whole, Refusal):
            return DryRun(False, 0, whole.s, None, whole)
        if outlook.latched:
            return DryRun(False, 0, whole.s_begin, None, None)
        step = max(step_s, (whole.s_end - whole.s_begin) / _MOST_PLACES)
        places = np.arange(whole.s_begin, whole.s_end, step).tolist()
        there = outlook._replace(trajectory=whole, target=sdot)
        for count, s in enumerate(places, 1):
            plan, answer = self._there(there, s, sdot)
            if answer.status is not Status.VERIFIED:
                made = self._made(whole, plan, outlook.begin, self._next)
                speed = self._slower(there, s, sdot)
                return DryRun(False, count, s, self._finder.constraint(there, made, answer, speed), None)
        return DryRun(True, len(places), math.nan, None, None)

    def _judged(
        self, outlook: Outlook, target: float, planner: ShortTermPlanner | None = None
    ) -> tuple[Decided | None, Verdict]:
        """Make and check the next plan with another wanted path speed; no plan where nothing is to move."""
        planner = planner or self._next
        start, path = _where(outlook), outlook.trajectory
        if start.sdot == 0.0 == start.sddot and (target == 0.0 or start.s >= path.s_end):
            rest = verdict(
                Reason.AT_REST, outlook.now, gap_m=math.nan, stop_time_s=math.nan,
                not_checked=self._check.not_checked,
            )  # fmt: skip
            return None, rest
        planner.memory = outlook.memory
        wanted = Start(path, outlook.begin, start, target)
        plan = planner.follow(*wanted)
        decided = self._setting_out.decide(outlook.now, wanted, plan, planner, outlook.known)
        return decided, decided.answer

    def _there(self, outlook: Outlook, s: float, sdot: float) -> tuple[PlanResult, Verdict]:
        """Make and check the plan of a robot that moves steadily at ``s``."""
        plan = self._next.plan(outlook.trajectory, outlook.begin, s, sdot)
        return plan, self._check.check_moving(outlook.now, plan, self._next.slices, outlook.known)

    def _slower(self, outlook: Outlook, s: float, sdot: float) -> float:
        """Return a path speed below ``sdot`` at which the plan that begins at ``s`` is verified."""

        def holds(speed: float) -> bool:
            return self._there(outlook, s, speed)[1].status is Status.VERIFIED

        return _largest(holds, 0.0, sdot, self.settings.speed_step)

    def _made(
        self, trajectory: IntendedTrajectory, plan: PlanResult, begin: float, planner: ShortTermPlanner
    ) -> Made:
        """Copy the plan that ``planner`` made last."""
        made = Made(plan, planner.slices.copy(), None, begin)
        if plan.outcome is not PlanOutcome.READY:
            return made
        motion = RunningPlan(trajectory, trajectory.s_begin)
        motion.take(trajectory, planner, plan)
        return made._replace(motion=motion)

    def _allowed(self, outlook: Outlook) -> float:
        def holds(sdot: float) -> bool:
            return all(
                self._judged(outlook, sdot, planner)[1].status is Status.VERIFIED
                for planner in (self._next, self._later)
            )

        levels = np.linspace(1.0, 0.0, _LEVELS + 1).tolist()
        found = next((number for number, level in enumerate(levels) if holds(level)), None)
        if found is None or found == 0:
            return 0.0 if found is None else 1.0
        return _largest(holds, levels[found], levels[found - 1], self.settings.speed_step)

    def _tolerable(self, outlook: Outlook, decided: Decided) -> float:
        """Return the tolerable latency of a plan that was made last."""
        answer, plan, planner = decided
        wanted = Start(outlook.trajectory, outlook.begin, _where(outlook), outlook.target)

        def holds(age: float) -> bool:
            known = older(outlook.known, age)
            again = self._setting_out.decide(outlook.now, wanted, plan, planner, known)
            return again.answer.status is Status.VERIFIED

        if answer.status is not Status.VERIFIED:
            return math.nan
        bound = self.settings.latency_bound_s
        return bound if holds(bound) else _largest(holds, 0.0, bound, self.settings.latency_step_s)


def older(known: Known, age: float) -> Known:
    """Return what would be known if each measurement were older by anything from 0 to ``age`` [s].

    The interval in which a point was seen begins earlier and ends where it did, so that every model's sets
    contain those of all ages in between.
    """
    people = known.people.copy()
    people["t_obs"] -= age
    people["t_complete"] -= age
    people["stamp_error"] += 0.5 * age
    return known._replace(people=people, nobody_since=known.nobody_since - age)


def _where(outlook: Outlook) -> PathState:
    """Return the path state in which the next plan begins."""
    end = outlook.trajectory.s_end
    return PathState(end, 0.0, 0.0) if outlook.start.s >= end else outlook.start


def _largest(holds: Callable[[float], bool], low: float, high: float, step: float) -> float:
    """Return a value that holds, one not more than ``step`` above which one does not; ``low`` holds."""
    while high - low > step:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
