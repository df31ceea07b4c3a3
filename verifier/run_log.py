"""What is kept of a run over a recording, and the report that it becomes."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanResult, StopKind
from occupancy.report import Refusal
from robots.assumption import Assumption
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.hindsight import Finding
from verifier.inputs import InputFile
from verifier.recordings.reading import NotTaken
from verifier.reports.verification import Contradicted, LimitExcess, PerCycle, Refused, VerifyReport
from verifier.still import Still
from verifier.verdict import STATUS_OF_REASON, Reason, Status, Verdict, Witness, criterion_names

Array = NDArray[np.float64]

MAX_LISTED = 1000
"""Refused measurements that are kept for the list; all are counted."""


class RunLog:
    """Eleven bytes for every cycle, and the evidence that the report shows."""

    def __init__(self, cycles: int) -> None:
        self.status = np.full(cycles, int(Status.NOT_CHECKED), np.uint8)
        self.reason = np.full(cycles, int(Reason.BEYOND_END), np.uint8)
        self.gap_m = np.full(cycles, np.nan, np.float32)
        self.stop_time_s = np.full(cycles, np.nan, np.float32)
        self.joint_space = np.zeros(cycles, np.bool_)
        self.first_witness: Witness | None = None
        self.deepest: Witness | None = None
        self.tightest: Witness | None = None
        self.stills: dict[str, Still] = {}
        self.first_excess: LimitExcess | None = None
        self._findings: dict[tuple[str, Reason], tuple[Finding, int]] = {}
        self._refused: list[Refused] = []
        self._refused_total = 0
        self._refused_for: Counter[str] = Counter()

    def keep(self, k: int, answer: Verdict, plan: PlanResult, finding: Finding | None) -> None:
        """Note cycle k; what the data contradict takes precedence over what the check answered."""
        reason = answer.reason if finding is None else finding.reason
        self.reason[k] = int(reason)
        self.status[k] = int(STATUS_OF_REASON[reason])
        self.gap_m[k] = answer.gap_m
        self.stop_time_s[k] = answer.stop_time_s
        self.joint_space[k] = plan.stop is StopKind.JOINT_SPACE
        if finding is not None:
            key = (finding.assumption, finding.reason)
            first, n = self._findings.get(key, (finding, 0))
            self._findings[key] = (first, n + 1)

    def keep_separated(self, cycles: NDArray[np.intp], gap_m: float, stop_time_s: Array) -> None:
        """Note cycles (N,) that are verified because everybody is at least ``gap_m`` [m] away."""
        self.reason[cycles] = int(Reason.SEPARATED)
        self.status[cycles] = int(STATUS_OF_REASON[Reason.SEPARATED])
        self.gap_m[cycles] = np.nextafter(np.float32(gap_m), np.float32(-np.inf))
        self.stop_time_s[cycles] = stop_time_s
        self.joint_space[cycles] = False

    def refuse(self, refusals: tuple[Refusal, ...]) -> None:
        """Note measurements that were not used."""
        self._refused_total += len(refusals)
        self._refused_for.update(str(r.reason) for r in refusals)
        room = max(0, MAX_LISTED - len(self._refused))
        self._refused += [
            Refused(r.stamp, r.person, None if r.point is None else r.point.name.lower(), str(r.reason))
            for r in refusals[:room]
        ]

    def refuse_unreadable(self, items: tuple[NotTaken, ...], total: int) -> None:
        """Note what of the reports could not even be decoded: the first ``items`` of ``total``."""
        self._refused_total += total
        self._refused_for.update(item.reason for item in items)
        room = max(0, MAX_LISTED - len(self._refused))
        self._refused += [Refused(item.stamp, item.person, item.point, item.reason) for item in items[:room]]

    def note_excess(self, t: float, plan: PlanResult, joints: tuple[str, ...]) -> None:
        """Note the first joint limit that stood in the way of a plan."""
        if self.first_excess is None:
            joint = joints[plan.joint] if 0 <= plan.joint < len(joints) else ""
            quantity = plan.quantity.name.lower()
            self.first_excess = LimitExcess(t, joint, quantity, plan.value, plan.limit, "")

    def keep_still(self, name: str, still: Still | None) -> None:
        """Keep what a picture of a witness shows, by the name of the witness in the report."""
        if still is not None:
            self.stills[name] = still

    def report(self, context: RunContext) -> VerifyReport:
        """Return what was found."""
        cell, robot, start = context.cell, context.robot, context.start_s
        excess = self.first_excess
        t = np.arange(len(self.status), dtype=np.float64) * cell.cycle_s
        return VerifyReport(
            recording=context.recording,
            robot=robot.name,
            stop_model=cell.stop.model,
            profile=context.profile,
            cell_hash=cell.content_hash(robot.content_hash, context.content),
            version=version("stopproof"),
            per_cycle=PerCycle(t, self.status, self.reason, self.gap_m, self.stop_time_s),
            stops_in_joint_space=int(np.count_nonzero(self.joint_space)),
            real_time_factor=len(t) * cell.cycle_s / context.seconds if context.seconds > 0.0 else math.nan,
            waived=context.waived,
            refused=tuple(replace(item, stamp=item.stamp - start) for item in self._refused),
            refused_total=self._refused_total,
            refused_for=tuple(self._refused_for.most_common()),
            contradicted=tuple(
                Contradicted(first.reason, first.assumption, first.text, first.t - start, n)
                for first, n in self._findings.values()
            ),
            first_witness=_since(start, self.first_witness),
            deepest=_since(start, self.deepest),
            tightest=_since(start, self.tightest),
            first_excess=None
            if excess is None
            else replace(excess, t=excess.t - start, unit=_unit(excess, robot)),
            assumptions=context.assumptions,
            checked_criteria=criterion_names(~context.not_checked),
            not_checked_criteria=criterion_names(context.not_checked),
            start_ns=context.start_ns,
            notes=context.notes,
            inputs=context.inputs,
            stills=dict(self.stills),
        )


@dataclass(frozen=True, slots=True)
class RunContext:
    """What a report says besides what happened cycle by cycle."""

    recording: str
    cell: Cell
    robot: RobotModel
    profile: str
    waived: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    not_checked: int
    content: str
    """Hash of what the cell's files say: meshes of fixtures, limits of contact."""
    start_s: float
    """Start of the overlap on the clock of the cycles [s]; a report counts from there."""
    start_ns: int
    notes: tuple[str, ...]
    seconds: float
    inputs: tuple[InputFile, ...]


def _since(start: float, found: Witness | None) -> Witness | None:
    """Return a witness whose times count from ``start`` [s]."""
    if found is None:
        return None
    begin, end = found.slice
    return replace(found, cycle_t=found.cycle_t - start, slice=(begin - start, end - start))


_PER_QUANTITY = {"position": "", "velocity": "/s", "acceleration": "/s²", "jerk": "/s³"}


def _unit(excess: LimitExcess, robot: RobotModel) -> str:
    """Unit of a joint limit; none for limits of the path."""
    if excess.joint not in robot.joints or excess.quantity not in _PER_QUANTITY:
        return ""
    slides = robot.kinematics["prismatic"][0, robot.joints.index(excess.joint)]
    return ("m" if slides else "rad") + _PER_QUANTITY[excess.quantity]
