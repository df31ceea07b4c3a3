"""Before a robot goes on: in that plan nothing that moves may count as standing still.

A link that is no faster than the standstill speed on a slice counts as standing still, whoever is there. That
is right for the end of a stop. It is wrong for plans to go on: each of them may be as slow as that, in the
whole or in one link, and all of them are a way, on which an arm would creep into somebody or through the
floor. So in a plan to go on every link that it moves, however slowly, must be proven apart.

One more thing for plans that are a rest by their speeds, as the first ones of a start are at short cycles:
the robot sets out only where a plan that goes on for ``LOOK_AHEAD_S`` is verified too. Else it would set out
and stop in turn, at the border of where it may be. That longer plan is never executed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from failsafe.plan import PlanOutcome, PlanResult, PlanSettings
from failsafe.scaling import PathState
from failsafe.short_term_plan import PlanMemory, ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from verifier.cycle import CycleCheck, Known
from verifier.verdict import Status, Verdict

LOOK_AHEAD_S = 0.1
"""Length of the piece that must be verified before a robot sets out, or goes on hardly moving [s]."""


class Start(NamedTuple):
    """The plan that is to be made: on which path, from when on [s], from which state, to which path speed."""

    trajectory: IntendedTrajectory
    begin: float
    state: PathState
    target: float


class Decided(NamedTuple):
    """A verdict, the plan that it is about, and the planner that made it."""

    answer: Verdict
    plan: PlanResult
    planner: ShortTermPlanner


class SettingOut:
    """Judges the next plan, by what the robot is to do; ``check`` is that of the cycle."""

    def __init__(self, check: CycleCheck, plans: PlanSettings) -> None:
        self._check = check
        self._planner: ShortTermPlanner | None = None
        if plans.cycle_s < LOOK_AHEAD_S:
            self._planner = ShortTermPlanner(check.robot.limits, replace(plans, cycle_s=LOOK_AHEAD_S))

    def decide(
        self, now: float, start: Start, plan: PlanResult, planner: ShortTermPlanner, known: Known
    ) -> Decided:
        """Judge ``plan``, which ``planner`` made last from ``start``; a longer one where it decides."""
        check = self._check
        if not start.target > 0.0:
            return Decided(check.check(now, plan, planner.slices, known), plan, planner)
        answer = check.check_moving(now, plan, planner.slices, known)
        found = Decided(answer, plan, planner)
        longer = self._longer(start) if answer.status is Status.VERIFIED and check.at_rest else None
        if longer is None:
            return found
        plan, planner = longer
        answer = check.check_moving(now, plan, planner.slices, known)
        return found if answer.status is Status.VERIFIED else Decided(answer, plan, planner)

    def _longer(self, start: Start) -> tuple[PlanResult, ShortTermPlanner] | None:
        """Plan to go on for longer; ``None``: no such plan can be made, or it would be no longer."""
        planner = self._planner
        if planner is None:
            return None
        planner.memory = PlanMemory()
        plan = planner.follow(*start)
        return (plan, planner) if plan.outcome is PlanOutcome.READY else None
