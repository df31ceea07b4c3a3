"""Before a robot goes on at a speed that counts as standing still: a plan must be verified in which it moves.

A plan in which no link is faster than the standstill speed counts as standing still, whoever is there. At
short cycles the first plans of a start are like that, and so are those that would turn the end of a stop into
a start, and all of a path that is followed slowly enough: an arm that wants to go on beside somebody in
reach, or towards the floor, would creep, in plan after plan, instead of resting. So it sets out, or goes on
so slowly, only where a plan that goes on for ``LOOK_AHEAD_S`` is verified with every link that it moves
counted as moving. That plan is never executed. Where there is none, it is the short one that must be.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from failsafe.scaling import PathState
from failsafe.short_term_plan import PlanMemory, PlanOutcome, PlanResult, PlanSettings, ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from verifier.cycle import CycleCheck, Known
from verifier.verdict import Reason, Status, Verdict

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
    """Looks at the longer plan; ``check`` is that of the cycle."""

    def __init__(self, check: CycleCheck, plans: PlanSettings) -> None:
        self._check = check
        self._planner: ShortTermPlanner | None = None
        if plans.cycle_s < LOOK_AHEAD_S:
            self._planner = ShortTermPlanner(check.robot.limits, replace(plans, cycle_s=LOOK_AHEAD_S))

    def decide(self, now: float, start: Start, found: Decided, known: Known) -> Decided:
        """Return what was found, or why the robot does not go on.

        Only a plan that is verified because nothing moves in it is looked at further, and not where the robot
        is to rest.
        """
        if not (start.target > 0.0 and found.answer.reason is Reason.AT_REST):
            return found
        plan, planner = self._longer(start) or (found.plan, found.planner)
        answer = self._check.check_moving(now, plan, planner.slices, known)
        return found if answer.status is Status.VERIFIED else Decided(answer, plan, planner)

    def _longer(self, start: Start) -> tuple[PlanResult, ShortTermPlanner] | None:
        """Plan to go on for longer; ``None``: no such plan can be made, or it would be no longer."""
        planner = self._planner
        if planner is None:
            return None
        planner.memory = PlanMemory()
        plan = planner.follow(*start)
        return (plan, planner) if plan.outcome is PlanOutcome.READY else None
