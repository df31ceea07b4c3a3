"""One plan against the people known at one instant: the check that replay and supervisor share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanResult
from occupancy.humans.model import HumanModel, Occupancy
from occupancy.humans.unobserved import ARENA_M
from occupancy.ledger_kernels import anything_open, count_people, open_moving
from occupancy.separation import LEDGER, Nearest
from occupancy.sets import LINK_SETS, MAX_PEOPLE
from occupancy.swept import LinkOccupancy
from occupancy.workspace import Blocked
from occupancy.workspace_kernels import mark_commanded, mark_moving
from robots.assumption import Assumption, Certainty
from robots.enclosure import MAX_LINKS
from robots.errors import SetupError
from robots.model import RobotModel
from robots.motion import MAX_SLICES, Block
from robots.rounding import require_rounding_to_nearest
from verifier.criteria import ContactCriterion, Criterion, RobotCriterion, Scene, Standstill
from verifier.verdict import CriterionKind, Reason, Verdict, verdict

_REASON_OF_OUTCOME: dict[PlanOutcome, Reason] = {
    PlanOutcome.BEYOND_END: Reason.BEYOND_END,
    PlanOutcome.STATE_BEYOND_LIMITS: Reason.STATE_BEYOND_LIMITS,
}
"""What a plan that is not ready means; every other outcome is "no stop within the limits"."""
_REASON_OF_BLOCKED: dict[CriterionKind, Reason] = {
    CriterionKind.WORKSPACE: Reason.FIXTURE_IN_REACH,
    CriterionKind.SELF_COLLISION: Reason.LINKS_IN_REACH,
}


@dataclass(frozen=True, slots=True)
class CycleSettings:
    """Which obligations a cycle has.

    Attributes
    ----------
    parts:
        Bit mask of the body parts that must be proven.
    standstill:
        When a link counts as at rest on a slice.
    empty_report_valid_s:
        A complete report that lists nobody counts for this long [s].
    assume_nobody:
        The user waives the check against people.
    """

    parts: int
    standstill: Standstill
    empty_report_valid_s: float
    assume_nobody: bool


class Known(NamedTuple):
    """What is known about people when a cycle is judged.

    Attributes
    ----------
    people:
        People block of the gate.
    reported:
        At least one report was admitted.
    nobody_since:
        Stamp of the last complete report that listed nobody [s]; ``-inf`` if there is none.
    inconsistent:
        Reports contradict each other, or the profile: see ``Gate.contradicted``.
    overflow:
        There are more people, or more hypotheses about them, than the block has rows.
    """

    people: Block
    reported: bool
    nobody_since: float
    inconsistent: bool
    overflow: bool


class CycleCheck:
    """Holds the blocks of one robot and judges plans; allocates only on construction.

    Attributes
    ----------
    at_rest:
        Whether no link of the plan that was judged last is faster than the standstill speed, or errs by more.
    """

    def __init__(
        self,
        robot: RobotModel,
        models: Sequence[HumanModel],
        criteria: Sequence[Criterion],
        settings: CycleSettings,
        robot_criteria: Sequence[RobotCriterion] = (),
        contact: ContactCriterion | None = None,
    ) -> None:
        require_rounding_to_nearest()
        self.robot = robot
        if not models:
            raise SetupError("a check needs at least one model of people")
        self.occupancies = tuple(Occupancy(model) for model in models)
        self.criteria = tuple(criteria)
        self.robot_criteria = tuple(robot_criteria)
        self.contact = contact
        self.settings = settings
        self.links: Block = np.zeros(1, dtype=LINK_SETS)
        self.ledger: Block = np.zeros(1, dtype=LEDGER)
        self._sweep = LinkOccupancy(robot)
        self._reach = robot.enclosure["reach"][0]
        self._n_links = int(robot.enclosure["n"][0])
        self._n_rows = self.links["n"]
        self._active: NDArray[np.uint8] = np.zeros(MAX_LINKS, dtype=np.uint8)
        self._commanded: NDArray[np.uint8] = np.zeros(MAX_LINKS, dtype=np.uint8)
        self.at_rest = False
        self.nearest: Nearest | None = None
        self.blocked: Blocked | None = None
        self.blocked_by: RobotCriterion | None = None
        enabled = {CriterionKind.JOINT_LIMITS}
        enabled |= {criterion.kind for criterion in self.criteria}
        enabled |= {criterion.kind for criterion in self.robot_criteria}
        if contact is not None:
            enabled.add(contact.kind)
        self.not_checked = sum(1 << kind for kind in CriterionKind if kind not in enabled)

    def assumptions(self) -> tuple[Assumption, ...]:
        """List what robot, models and criteria rest on."""
        parts = [self.robot.assumptions]
        parts += [occupancy.model.assumptions() for occupancy in self.occupancies]
        parts += [criterion.assumptions() for criterion in self.criteria]
        parts += [criterion.assumptions() for criterion in self.robot_criteria]
        if self.contact is not None:
            parts.append(self.contact.assumptions())
        source = "a link that neither moves nor errs by more on a slice counts as at rest and may be touched"
        rest = self.settings.standstill
        return (
            *(item for group in parts for item in group),
            Assumption("check.standstill_speed_m_s", rest.speed_m_s, "m/s", source, Certainty.DECLARED),
            Assumption("check.standstill_error_m", rest.error_m, "m", source, Certainty.DECLARED),
        )

    def check(self, t: float, plan: PlanResult, slices: Block, known: Known) -> Verdict:
        """Judge the plan in ``slices`` at the instant ``t`` with what is known about people.

        A link that hardly moves on a slice counts as standing still there: for stops, and for what was
        recorded. Never raises; whatever is missing or not finite leaves an obligation open.
        """
        return self._judge(t, plan, slices, known, going_on=False)

    def check_moving(self, t: float, plan: PlanResult, slices: Block, known: Known) -> Verdict:
        """Judge as :meth:`check`, but let no link that the plan moves count as standing still.

        For plans to go on: each may be below the standstill speed, and all of them are a way.
        """
        return self._judge(t, plan, slices, known, going_on=True)

    def _judge(self, t: float, plan: PlanResult, slices: Block, known: Known, *, going_on: bool) -> Verdict:
        self.nearest = self.blocked = self.blocked_by = None
        self.at_rest = False
        if known.inconsistent and not self.settings.assume_nobody:
            return self._verdict(Reason.INCONSISTENT_REPORTS, t, plan, math.nan)
        if plan.outcome is not PlanOutcome.READY:
            reason = _REASON_OF_OUTCOME.get(plan.outcome, Reason.NO_STOP_WITHIN_LIMITS)
            return self._verdict(reason, t, plan, math.nan)
        self._sweep.occupy(slices, self.links)
        if not self._every_link_swept(slices):
            return self._verdict(Reason.EMPTY_PLAN, t, plan, math.nan)
        self._mark_active(slices, going_on)
        if self._robot_is_blocked(slices) and self.blocked is not None and self.blocked_by is not None:
            return self._verdict(_REASON_OF_BLOCKED[self.blocked_by.kind], t, plan, self.blocked.gap_m)
        if self.settings.assume_nobody:
            return self._verdict(Reason.NOBODY_ASSUMED, t, plan, math.nan)
        listed, to_prove = count_people(known.people)
        if known.overflow or to_prove > MAX_PEOPLE:
            return self._verdict(Reason.NO_ROOM, t, plan, math.nan)
        if not known.reported:
            return self._verdict(Reason.NO_REPORT_YET, t, plan, math.nan)
        if listed == 0:
            age = t - known.nobody_since
            if not age <= self.settings.empty_report_valid_s:
                return self._verdict(Reason.STALE_EMPTY_REPORT, t, plan, math.nan)
            if to_prove == 0:
                return self._verdict(Reason.NOBODY_REPORTED, t, plan, math.nan)
        if to_prove > listed and not self._in_arena():
            return self._verdict(Reason.NOT_OBSERVED, t, plan, math.nan)
        return self._against_people(t, plan, slices, known.people, to_prove)

    def _mark_active(self, slices: Block, going_on: bool) -> None:
        """Find the links that count as moving, and whether the plan as a whole is a rest."""
        self._commanded[:] = 0
        if going_on:
            mark_commanded(slices, self._sweep.chain, self._commanded)
        rest, enclosure = self.settings.standstill, self.robot.enclosure
        moving = mark_moving(self.links, slices, enclosure, rest.speed_m_s, rest.error_m, self._active)
        self.at_rest = moving == 0
        self._active |= self._commanded

    def _robot_is_blocked(self, slices: Block) -> bool:
        """Hold the sweep against what needs no people; keep the first pair that is not proven apart."""
        for criterion in self.robot_criteria:
            self.blocked = criterion.check(self.links, slices, self._active)
            if self.blocked is not None:
                self.blocked_by = criterion
                return True
        return False

    def _against_people(
        self, t: float, plan: PlanResult, slices: Block, people: Block, to_prove: int
    ) -> Verdict:
        scene = self.scene(slices, people)
        if self.open_obligations(slices, to_prove) == 0:
            return self._verdict(Reason.AT_REST, t, plan, math.nan)
        gap, left = self._check_open(scene), anything_open(self.ledger)
        if left and self.contact is not None and self.contact.clear(scene, self.ledger):
            if not anything_open(self.ledger):
                self.nearest = None
                return self._verdict(Reason.CONTACT_WITHIN_LIMITS, t, plan, math.nan)
            gap, left = self._check_open(scene), anything_open(self.ledger)
        if not left:
            reason = Reason.SEPARATED if people["n"][0] else Reason.NOBODY_REPORTED
            return self._verdict(reason, t, plan, gap)
        if self.nearest is not None and self.nearest.unresolved > 0:
            return self._verdict(Reason.UNRESOLVED, t, plan, gap)
        if self.nearest is not None and self.nearest.people_row >= 0:
            return self._verdict(Reason.REACHABLE, t, plan, gap)
        known = self.nearest is None or self.nearest.person < people["n"][0]
        return self._verdict(Reason.PERSON_WITHOUT_BOUND if known else Reason.NOT_OBSERVED, t, plan, gap)

    def _check_open(self, scene: Scene) -> float:
        """Let every criterion look at what is open; return the gap [m] of the pair that decided."""
        gap = math.nan
        for criterion in self.criteria:
            self.nearest = criterion.check(scene, self.ledger)
            gap = self.nearest.gap_m
        return gap

    def scene(self, slices: Block, people: Block) -> Scene:
        """Return what criteria look at for the plan that was swept last."""
        for occupancy in self.occupancies:
            occupancy.begin(people, slices)
        return Scene(slices, self.links, people, self.occupancies)

    def open_obligations(self, slices: Block, to_prove: int) -> int:
        """Open what must be proven for the plan that was swept last; return how many pairs were opened.

        ``to_prove``: rows of the people block, and one more where people may be there whom nobody lists.
        """
        rest, parts, reach = self.settings.standstill, self.settings.parts, self._reach
        arguments = (rest.speed_m_s, rest.error_m, to_prove, parts, self._commanded)
        return int(open_moving(self.ledger, self.links, slices, reach, *arguments))

    def _every_link_swept(self, slices: Block) -> bool:
        """Whether there is at least one slice, one link, and a row for each pair of them."""
        n_slices, n_links = slices["n"].item(), self._n_links
        return 0 < n_slices <= MAX_SLICES and n_links > 0 and self._n_rows.item() == n_slices * n_links

    def _in_arena(self) -> bool:
        """Whether the links stay where rows of the unobserved space hold."""
        record, n = self.links[0], int(self.links["n"][0])
        farthest = float(np.abs(record["points"][:n]).max()) * math.sqrt(3.0)
        return farthest + float(record["radius"][:n].max()) <= ARENA_M

    def _verdict(self, reason: Reason, t: float, plan: PlanResult, gap: float) -> Verdict:
        return verdict(
            reason,
            t,
            gap_m=gap,
            stop_time_s=plan.stop_time_s if plan.outcome is PlanOutcome.READY else math.nan,
            not_checked=self.not_checked,
        )
