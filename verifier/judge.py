"""Judging the cycles of a recording, each on its own: what was known, the plan, the check, and hindsight."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from failsafe.plan import PlanOutcome, PlanResult
from occupancy.body import POINT_NAMES
from occupancy.measurement import Gate
from occupancy.report import RefusalReason
from robots.model import RobotModel
from robots.motion import Block
from verifier.arrivals import Arrivals
from verifier.cell import Cell
from verifier.cycle import CycleCheck, Known
from verifier.evidence import Judged, deepest, robot_witness, witness
from verifier.hindsight import Finding, PeopleHindsight, with_newcomers
from verifier.locked_motion import LockedMotion
from verifier.onlooker import Onlooker, SeenCycle
from verifier.plausibility import Whereabouts
from verifier.run_log import RunLog
from verifier.section import TAIL_S, Section
from verifier.setup import build_check, build_profile, build_watch
from verifier.still import take_still
from verifier.verdict import Reason, Status, Verdict, Witness, not_followed


@dataclass(frozen=True, slots=True)
class _Tightest:
    """The verified cycle with the smallest gap so far: what is needed to judge it once more."""

    gap_m: float
    k: int
    plan: PlanResult
    slices: Block
    known: Known


Checks = tuple[CycleCheck, CycleCheck]
"""The check of a cycle, and the one that judges it once more with people who were first seen later."""


def build_checks(cell: Cell, robot: RobotModel, *, assume_nobody: bool) -> Checks:
    """Make the checks of a run; they keep nothing of what they have judged."""
    profile = build_profile(cell)
    first, second = (build_check(cell, robot, profile, assume_nobody=assume_nobody) for _ in range(2))
    return first, second


class Judge:
    """Judges the cycles of one recording in their order.

    Parameters
    ----------
    cell, robot:
        What is judged.
    start:
        Instant of cycle 0 [s].
    cycles:
        How many there are.
    assume_nobody:
        The user waives the check against people.
    checks:
        Of an earlier run for the same cell and robot, to be used again; ``None``: made anew.
    onlooker:
        Is shown every cycle after it was judged; ``None``: nobody looks.
    locked:
        What was recorded of joints that are not commanded; ``None``: nothing.

    Attributes
    ----------
    gate, check, log, arrivals:
        What is known about people, the check, what was answered, and reports that are still to come.
    whereabouts:
        Where people were in the world.
    unknown_frames:
        Frames of refused reports that the cell does not declare.
    profile_text:
        The profile in one line.
    profile_title:
        What the profile is, as its file says.
    """

    def __init__(
        self,
        cell: Cell,
        robot: RobotModel,
        start: float,
        cycles: int,
        *,
        assume_nobody: bool,
        checks: Checks | None = None,
        onlooker: Onlooker | None = None,
        locked: LockedMotion | None = None,
    ) -> None:
        self._onlooker = onlooker
        self._locked = locked or LockedMotion()
        self._cell = cell
        self._robot = robot
        self._start = start
        profile = build_profile(cell)
        self.profile_text = f"{profile.name} ({profile.speed.max():g} m/s)"
        self.profile_title = profile.title
        self._watch = build_watch(cell)
        self.gate: Gate = self._watch.gate
        self.check, self._second_look = checks or build_checks(cell, robot, assume_nobody=assume_nobody)
        self._people_hindsight = PeopleHindsight(
            profile,
            cell.people.max_report_gap_s,
            [occupancy.model for occupancy in self.check.occupancies],
        )
        self.log = RunLog(cycles)
        self.arrivals = Arrivals(cell.people.latency_s, self.gate.is_ahead)
        self.whereabouts = Whereabouts()
        self.unknown_frames: set[str] = set()
        self._failed_before = False
        self._tightest: _Tightest | None = None

    def instant(self, k: int) -> float:
        """Return when cycle k is judged [s]."""
        return self._start + k * self._cell.cycle_s

    def known(self) -> Known:
        """Return what is known about people now; the block in it is the gate's own."""
        return self._watch.known()

    def judge(self, k: int, section: Section) -> None:
        """Judge cycle k with what had arrived by then, and note what was found."""
        t = self.instant(k)
        self.admit_until(t)
        plan = section.plan(t)
        slices, people = section.planner.slices, self.gate.people
        known = self.known()
        answer = self.check.check(t, plan, slices, known)
        if answer.reason is Reason.BEYOND_END and not section.reaches_the_end(t):
            answer = not_followed(answer)
        ready = plan.outcome is PlanOutcome.READY
        until = self._ends(t, plan, answer)
        if answer.status is Status.VERIFIED and not section.follows(until):
            answer = not_followed(answer)  # a delay or the robot's own reaction may last longer than its path
        finding = self._contradiction(t, until, section, answer)
        if finding is None and ready:
            finding = self._unreported(section, self._judged(k, slices, people), plan, known, answer)
        self.log.keep(k, answer, plan, finding)
        if answer.reason in (Reason.STATE_BEYOND_LIMITS, Reason.NO_STOP_WITHIN_LIMITS):
            self.log.note_excess(t, plan, self._robot.joints)
        if self._onlooker is not None:
            found = Status(int(self.log.status[k])), Reason(int(self.log.reason[k]))
            judged = self._judged(k, slices, people)
            self._onlooker.look(SeenCycle(k, judged, self.check, section, plan, answer, *found))
        if finding is None:
            self._keep_evidence(k, answer, plan, slices, known)

    def nothing_against(self, section: Section, since: float, until: float) -> bool:
        """Whether the data contradict nothing of what is known now, for all cycles with a plan in a time.

        The cycles are judged from ``since`` on and have stopped by ``until`` [s]. What contradicts one of
        them is found here too, because a longer time only holds more data.
        """
        gate = self.gate
        return (
            section.robot.check(since, until) is None
            and self._locked.check(since, until) is None
            and self._people_hindsight.check(
                gate.people, gate.person_ids, section.people, section.stamps, (since, until)
            )
            is None
            and with_newcomers(gate.people, gate.person_ids, section.people, until, gate.left) is None
        )

    def _ends(self, t: float, plan: PlanResult, answer: Verdict) -> float:
        """Instant [s] up to which data are held against what cycle t assumed."""
        if plan.outcome is PlanOutcome.READY:
            return plan.t_rest + self._cell.robot.tracking.delay_max_s
        if answer.reason is Reason.STOP_NOT_FOLLOWED:
            return t + TAIL_S
        return t + 2.0 * self._cell.cycle_s + self._cell.robot.tracking.delay_max_s

    def admit_until(self, t: float) -> None:
        """Admit the reports that have arrived by t, in the order of their arrival."""
        for report in self.arrivals.until(t):
            admission = self._watch.admit(report, t)
            self.log.refuse(admission.refusals)
            self.whereabouts.add_repeats(admission.refusals)
            if any(refusal.reason is RefusalReason.UNKNOWN_FRAME for refusal in admission.refusals):
                self.unknown_frames.add(report.frame)

    def _contradiction(self, t: float, until: float, section: Section, answer: Verdict) -> Finding | None:
        """Return what the recording contradicts of what this cycle assumed, if anything."""
        found = section.robot.check(t, until) or self._locked.check(t, until)
        if found is None and not self.check.settings.assume_nobody:
            found = self._people_hindsight.check(
                self.gate.people, self.gate.person_ids, section.people, section.stamps, (t, until)
            )
        if found is None and answer.reason is Reason.INCONSISTENT_REPORTS:
            found = Finding(answer.reason, "A1 people", "reports about one person contradict each other", t)
            if self.gate.outsized:
                who, (p, q) = next(iter(self.gate.outsized.items()))
                points = f"{POINT_NAMES[p]} and {POINT_NAMES[q]}"
                text = f"{who}: {points} were farther apart than the profile's sizes and errors allow"
                found = Finding(answer.reason, "A1 people", text, t)
            if self.gate.vanished:
                who = ", ".join(self.gate.vanished)
                text = f"{who} must be in the monitored region, but a complete report does not list them"
                found = Finding(answer.reason, "A5 reports", text, t)
        return found

    def _unreported(
        self, section: Section, judged: Judged, plan: PlanResult, known: Known, answer: Verdict
    ) -> Finding | None:
        """Judge the plan once more with everybody who was first seen before it had ended."""
        if self.check.settings.assume_nobody or not known.reported:
            return None
        until = plan.t_rest + self._cell.robot.tracking.delay_max_s
        left = self.gate.left
        wider = with_newcomers(known.people, judged.ids, section.people, until, left)
        if wider is None:
            return None
        new = wider.ids[len(judged.ids) :]
        found = self._people_hindsight.too_large(new, section.people, left, until)
        found = found or self._people_hindsight.check(
            wider.people, wider.ids, section.people, section.stamps, (judged.t, until)
        )
        if found is not None:
            return found
        again = known._replace(people=wider.people, overflow=known.overflow or wider.overflow)
        check = self._second_look
        if check.check(judged.t, plan, judged.slices, again).status is Status.VERIFIED:
            return None
        pair = witness(check, replace(judged, people=wider.people, ids=wider.ids), check.nearest)
        row = -1 if check.nearest is None else check.nearest.person
        if pair is not None and int(known.people["n"][0]) <= row < int(wider.people["n"][0]):
            gap = f": gap {pair.gap_m:+.3f} m" if math.isfinite(pair.gap_m) else ", wherever they were"
            text = f"{pair.person}, first seen then, could have reached {pair.link}{gap}"
            seen = section.people[pair.person]
            since = (seen.after(left.get(pair.person, -math.inf)) or seen).since
            return Finding(Reason.UNREPORTED_PERSON, "A5 reports", text, since)
        if answer.status is not Status.VERIFIED:
            return None
        text = "with those who are first seen during the stop there are more people than one check can hold"
        return Finding(Reason.UNREPORTED_PERSON, "A5 reports", text, judged.t)

    def _keep_evidence(self, k: int, answer: Verdict, plan: PlanResult, slices: Block, known: Known) -> None:
        """Describe the first failure at once, and keep what describes the tightest pair at the end."""
        if answer.status is Status.NOT_VERIFIED and not self._failed_before:
            cycle = self._judged(k, slices, known.people)
            nearest = None if answer.reason is Reason.STOP_NOT_FOLLOWED else self.check.nearest
            first = robot_witness(self.check, cycle) or witness(self.check, cycle, nearest)
            self.log.first_witness = first
            self.log.keep_still("first_witness", take_still(self.check, cycle, first))
            if answer.reason is Reason.REACHABLE:
                self.log.deepest = witness(self.check, cycle, deepest(self.check, cycle))
                self.log.keep_still("deepest", take_still(self.check, cycle, self.log.deepest))
            self._failed_before = True
        smallest = math.inf if self._tightest is None else self._tightest.gap_m
        if answer.status is Status.VERIFIED and answer.gap_m < smallest:
            known = known._replace(people=known.people.copy())
            self._tightest = _Tightest(answer.gap_m, k, plan, slices.copy(), known)

    def _judged(self, k: int, slices: Block, people: Block) -> Judged:
        return Judged(self.instant(k), slices, people, self.gate.person_ids, self._cell.check.margin_m)

    def tightest_witness(self) -> Witness | None:
        """Judge the tightest cycle once more, so that its evidence is at hand."""
        kept = self._tightest
        if kept is None:
            return None
        self.check.check(self.instant(kept.k), kept.plan, kept.slices, kept.known)
        cycle = self._judged(kept.k, kept.slices, kept.known.people)
        found = witness(self.check, cycle, self.check.nearest)
        self.log.keep_still("tightest", take_still(self.check, cycle, found))
        return found
