"""Looking over the shoulder of a run: what a cycle was judged with, before the next one replaces it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from failsafe.plan import PlanOutcome, PlanResult
from verifier.cycle import CycleCheck
from verifier.evidence import Judged
from verifier.section import Section
from verifier.verdict import Reason, Status, Verdict

_NOT_SWEPT = (Reason.INCONSISTENT_REPORTS, Reason.EMPTY_PLAN)
"""A check that ends with these has not written where the links go."""


class SeenCycle(NamedTuple):
    """A cycle just after it was judged; its blocks are those of the check and change with the next one.

    Attributes
    ----------
    k:
        Number of the cycle.
    judged:
        What it was judged with.
    check:
        The check, as it was left.
    section, plan:
        The window of the recording, and the plan of the cycle.
    answer:
        What the check answered.
    status, reason:
        What the run found, later data included.
    """

    k: int
    judged: Judged
    check: CycleCheck
    section: Section
    plan: PlanResult
    answer: Verdict
    status: Status
    reason: Reason

    @property
    def swept(self) -> bool:
        """Whether the check holds what the links of this plan occupy."""
        return self.plan.outcome is PlanOutcome.READY and self.answer.reason not in _NOT_SWEPT


class Onlooker(Protocol):
    """Is shown every cycle of a run, in their order."""

    def begin(self, start_ns: int) -> None:
        """Learn when cycle 0 is, on the recording's clock [ns]."""

    def look(self, seen: SeenCycle) -> None:
        """Look at a cycle; it must leave everything as it is."""
