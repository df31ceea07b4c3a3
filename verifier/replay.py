"""Verify a recording offline: every cycle on its own, with what had arrived by then.

Cycle k is judged at t_k from ṡ = 1 on the recorded path: the piece [t_k+1, t_k+2] and the failsafe manoeuvre
after it, against the people reported by t_k (docs/method.md, sections 2 and 6). Afterwards the later samples
of the same recording are held against what the cycle assumed (:mod:`verifier.hindsight`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from failsafe.short_term_plan import PlanOutcome, PlanResult
from failsafe.trajectory import LATEST_S
from occupancy.measurement import Gate
from occupancy.report import RefusalReason
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.files import printed
from robots.identity import stated_hash
from robots.model import RobotModel
from robots.motion import Block
from verifier.arrivals import Arrivals
from verifier.cell import Cell
from verifier.cycle import CycleCheck, Known
from verifier.evidence import Judged, deepest, robot_witness, witness
from verifier.hindsight import Finding, PeopleHindsight, with_newcomers
from verifier.plausibility import Whereabouts
from verifier.recordings import Reading, Recording
from verifier.reports.verification import VerifyReport
from verifier.run_log import RunContext, RunLog
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Section, Sections
from verifier.setup import (
    DEFAULT_POSITION_ERROR_M,
    build_check,
    build_gate,
    build_profile,
    build_robot,
    content_hash,
    waivers,
)
from verifier.verdict import Reason, Status, Verdict, Witness, not_followed

MAX_CYCLES = 100_000_000
"""Eleven days at 10 ms; each takes memory."""

Progress = Callable[[float], None]
"""Called with the share of the recording that is done, 0 … 1."""


def verify(
    recording: Recording | str | Path,
    cell: Cell,
    *,
    assume_nobody: bool = False,
    progress: Progress | None = None,
    cache_dir: Path | None = None,
) -> VerifyReport:
    """Verify a recorded trajectory against the people of the same recording.

    Parameters
    ----------
    recording:
        A recording in the format of docs/recordings.md.
    cell:
        Robot, clocks, people, criteria.
    assume_nobody:
        Waive the check against people; listed in the report.
    progress:
        Told the share that is done.
    cache_dir:
        Where enclosures are kept; ``None``: the user's cache folder.

    Raises
    ------
    SetupError
        Recording, cell or robot cannot be used; one line that says what is wrong and what would be right.
    """
    source = recording if isinstance(recording, Recording) else Recording(recording)
    robot = build_robot(cell, source.robot, cache_dir)
    reading = Reading(source, robot.joints, people=not assume_nobody, point_names=cell.people.point_names)
    replay = _Replay(reading, cell, robot, assume_nobody=assume_nobody)
    replay.run(progress or _ignore)
    return replay.report()


def _ignore(_share: float) -> None:
    """Nobody wants to know."""


@dataclass(frozen=True, slots=True)
class _Tightest:
    """The verified cycle with the smallest gap so far: what is needed to judge it once more."""

    gap_m: float
    k: int
    plan: PlanResult
    slices: Block
    known: Known


class _Replay:
    """One run over one recording."""

    def __init__(self, reading: Reading, cell: Cell, robot: RobotModel, *, assume_nobody: bool) -> None:
        self._reading = reading
        self._cell = cell
        self._robot = robot
        profile = build_profile(cell)
        self._waived = waivers(cell, robot, assume_nobody=assume_nobody)
        self._gate: Gate = build_gate(cell, profile)
        self._check: CycleCheck = build_check(cell, robot, profile, assume_nobody=assume_nobody)
        self._second_look: CycleCheck = build_check(cell, robot, profile, assume_nobody=assume_nobody)
        self._people_hindsight = PeopleHindsight(
            profile,
            cell.people.max_report_gap_s,
            [occupancy.model for occupancy in self._check.occupancies],
        )
        self._profile_text = f"{profile.name} ({profile.speed.max():g} m/s)"
        self._start, end = reading.overlap
        self._cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        if self._cycles == 0:
            raise SetupError(
                f"{reading.recording.path}: {end - self._start:.3f} s of overlap is shorter than a cycle of "
                f"{cell.cycle_s} s"
            )
        if self._cycles > MAX_CYCLES or end > LATEST_S:
            raise self._too_long(end)
        self._log = RunLog(self._cycles)
        self._failed_before = False
        self._nobody_since = -math.inf
        self._unknown_frames: set[str] = set()
        self._reported = False
        self._sections = Sections(reading.recording.path, cell, robot, self._gate)
        self._whereabouts = Whereabouts()
        self._arrivals = Arrivals(cell.people.latency_s, self._gate.is_ahead)
        self._tightest: _Tightest | None = None
        self._seconds = 0.0

    def _too_long(self, end: float) -> SetupError:
        """Return what refuses a recording that nobody made on purpose: as a rule a clock was set in it."""
        begin, step = self._reading.longest_step()
        return SetupError(
            f"{self._reading.recording.path}: {end:.6g} s, or {self._cycles} cycles, are more than "
            f"{LATEST_S:g} s or {MAX_CYCLES} cycles; time jumps by {step:.6g} s at {begin:.3f} s after the "
            "first joint sample: if a clock was set there, cut the recording in two"
        )

    def run(self, progress: Progress) -> None:
        """Judge every cycle, window by window."""
        k = 0
        for window in self._reading.windows(WINDOW_S, LEAD_S, TAIL_S):
            began = time.perf_counter()
            section = self._sections.next(window)
            self._arrivals.expect(window.people)
            self._look_where_people_are(section)
            while k < self._cycles and (window.last or self._instant(k) < window.end):
                self._judge(k, section)
                k += 1
                if k % 256 == 0:
                    progress(k / self._cycles)
            self._seconds += time.perf_counter() - began
        progress(1.0)
        self._log.refuse_unreadable(self._reading.not_taken, self._reading.not_taken_count)

    def _look_where_people_are(self, section: Section) -> None:
        base = np.array(self._cell.robot.mount.xyz_m)
        for person, seen in section.people.items():
            for samples in seen.samples:
                self._whereabouts.add(person, samples, base)

    def _instant(self, k: int) -> float:
        return self._start + k * self._cell.cycle_s

    def _judge(self, k: int, section: Section) -> None:
        t = self._instant(k)
        self._admit_until(t)
        plan = section.plan(t)
        slices, people = section.planner.slices, self._gate.people
        known = Known(
            people, self._reported, self._nobody_since, self._gate.contradicted, self._gate.overflow
        )
        answer = self._check.check(t, plan, slices, known)
        if answer.reason is Reason.BEYOND_END and not section.reaches_the_end(t):
            answer = not_followed(answer)
        ready = plan.outcome is PlanOutcome.READY
        until = self._ends(t, plan, answer)
        finding = self._contradiction(t, until, section, answer)
        if finding is None and ready:
            finding = self._unreported(section, self._judged(k, slices, people), plan, known, answer)
        self._log.keep(k, answer, plan, finding)
        if answer.reason in (Reason.STATE_BEYOND_LIMITS, Reason.NO_STOP_WITHIN_LIMITS):
            self._log.note_excess(t, plan, self._robot.joints)
        if finding is None:
            self._keep_evidence(k, answer, plan, slices, known)

    def _ends(self, t: float, plan: PlanResult, answer: Verdict) -> float:
        """Instant [s] up to which data are held against what cycle t assumed."""
        if plan.outcome is PlanOutcome.READY:
            return plan.t_rest + self._cell.robot.tracking.delay_max_s
        if answer.reason is Reason.STOP_NOT_FOLLOWED:
            return t + TAIL_S
        return t + 2.0 * self._cell.cycle_s + self._cell.robot.tracking.delay_max_s

    def _admit_until(self, t: float) -> None:
        """Admit the reports that have arrived by t, in the order of their arrival."""
        for report in self._arrivals.until(t):
            admission = self._gate.admit(report, t)
            self._log.refuse(admission.refusals)
            self._whereabouts.add_repeats(admission.refusals)
            self._reported = True
            whole = any(refusal.person == "" for refusal in admission.refusals)
            if any(refusal.reason is RefusalReason.UNKNOWN_FRAME for refusal in admission.refusals):
                self._unknown_frames.add(report.frame)
            if report.complete and not report.people and not whole:
                errors = self._cell.people.stamp_error_s + self._cell.people.clock_error_s
                self._nobody_since = max(self._nobody_since, report.stamp - errors)

    def _contradiction(self, t: float, until: float, section: Section, answer: Verdict) -> Finding | None:
        """Return what the recording contradicts of what this cycle assumed, if anything."""
        found = section.robot.check(t, until)
        if found is None and not self._check.settings.assume_nobody:
            found = self._people_hindsight.check(
                self._gate.people, self._gate.person_ids, section.people, section.stamps, until
            )
        if found is None and answer.reason is Reason.INCONSISTENT_REPORTS:
            found = Finding(answer.reason, "A1 people", "reports about one person contradict each other", t)
            if self._gate.vanished:
                who = ", ".join(self._gate.vanished)
                text = f"{who} must be in the monitored region, but a complete report does not list them"
                found = Finding(answer.reason, "A5 reports", text, t)
        return found

    def _unreported(
        self, section: Section, judged: Judged, plan: PlanResult, known: Known, answer: Verdict
    ) -> Finding | None:
        """Judge the plan once more with everybody who was first seen before it had ended."""
        if self._check.settings.assume_nobody or not known.reported:
            return None
        until = plan.t_rest + self._cell.robot.tracking.delay_max_s
        left = self._gate.left
        wider = with_newcomers(known.people, judged.ids, section.people, until, left)
        if wider is None:
            return None
        found = self._people_hindsight.check(wider.people, wider.ids, section.people, section.stamps, until)
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
            self._log.first_witness = robot_witness(self._check, cycle) or witness(
                self._check, cycle, self._check.nearest
            )
            if answer.reason is Reason.REACHABLE:
                self._log.deepest = witness(self._check, cycle, deepest(self._check, cycle))
            self._failed_before = True
        smallest = math.inf if self._tightest is None else self._tightest.gap_m
        if answer.status is Status.VERIFIED and answer.gap_m < smallest:
            known = known._replace(people=known.people.copy())
            self._tightest = _Tightest(answer.gap_m, k, plan, slices.copy(), known)

    def _judged(self, k: int, slices: Block, people: Block) -> Judged:
        return Judged(self._instant(k), slices, people, self._gate.person_ids, self._cell.check.margin_m)

    def _tightest_witness(self) -> Witness | None:
        """Judge the tightest cycle once more, so that its evidence is at hand."""
        kept = self._tightest
        if kept is None:
            return None
        self._check.check(self._instant(kept.k), kept.plan, kept.slices, kept.known)
        cycle = self._judged(kept.k, kept.slices, kept.known.people)
        return witness(self._check, cycle, self._check.nearest)

    def report(self) -> VerifyReport:
        """Return what was found."""
        self._log.tightest = self._tightest_witness()
        return self._log.report(
            RunContext(
                recording=self._reading.recording.path.name,
                cell=self._cell,
                robot=self._robot,
                profile=self._profile_text,
                waived=self._waived.texts,
                assumptions=self._assumptions(),
                not_checked=self._check.not_checked,
                content=content_hash(self._check),
                start_s=self._start,
                start_ns=self._reading.epoch_ns + round(self._start * 1e9),
                notes=tuple(self._notes()),
                seconds=self._seconds,
            )
        )

    def _assumptions(self) -> tuple[Assumption, ...]:
        stated = self._cell.assumptions()
        names = {item.name.removeprefix("cell.") for item in stated}
        items = [*stated, *self._reading.recording.assumptions]
        items += [item for item in self._check.assumptions() if item.name not in names]
        if self._cell.people.position_error_m is None:
            items.append(
                Assumption(
                    "people.position_error",
                    DEFAULT_POSITION_ERROR_M,
                    "m",
                    "used where the recording states none",
                    Certainty.DEFAULT,
                )
            )
        if self._sections.residual is not None:
            items += [
                Assumption(
                    f"robot.tracking.{joint}",
                    float(error),
                    "rad",
                    "largest residual of the fit",
                    Certainty.MEASURED,
                )
                for joint, error in zip(self._robot.joints, self._sections.residual, strict=True)
            ]
        return tuple(items)

    def _notes(self) -> Iterator[str]:
        reading = self._reading
        yield from self._whereabouts.lines()
        if self._sections.like_degrees:
            largest = f"joint values up to {self._sections.largest:.4g}"
            yield f"{largest}: positions are in rad, these look like degrees"
        if self._start > 0.0005:
            yield f"not looked at: the first {self._start:.3f} s of motion, before the first report"
        if self._arrivals:
            yield f"reports that had not arrived by the last cycle: {len(self._arrivals)}"
        if self._robot.fixed_links:
            yield f"links that do not move are not checked: {', '.join(self._robot.fixed_links)}"
        if self._check.contact is not None:
            yield (
                "contact: pressure, edges and points are not checked, nor clamping between neighbouring "
                "links or against what is not declared in [workspace]"
            )
        recorded, urdf = reading.recording.robot, self._cell.robot.urdf
        if recorded is not None and urdf is not None and stated_hash(recorded) is None:
            judged = f"the arm of {Path(urdf).name}, {self._robot.name}"
            yield f"the recording says it is of {printed(recorded)}; judged was {judged}"
        if reading.extra_joints:
            yield f"joints of the recording that are not used: {', '.join(reading.extra_joints)}"
        if reading.assumed_order:
            yield f"the recording does not name its joints; assumed: {', '.join(self._robot.joints)}"
        for frame in sorted(self._unknown_frames):
            pose = f"[people.frames.{frame}] of the cell"
            yield f"reports in frame {frame!r} were refused: declare its pose in {pose}"
        if reading.unknown_points:
            names = ", ".join(sorted(reading.unknown_points))
            yield f"point names that are not known and were ignored: {names}"
