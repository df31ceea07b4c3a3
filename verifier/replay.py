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
from numpy.typing import NDArray

from failsafe.short_term_plan import PlanOutcome, PlanResult, PlanSettings, ShortTermPlanner
from failsafe.trajectory import FitSettings, IntendedTrajectory, fit_samples
from occupancy.conformance import LaterSamples
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement, RefusalReason
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.model import RobotModel
from robots.motion import Block
from verifier.arrivals import Arrivals
from verifier.cell import Cell
from verifier.cycle import CycleCheck, Known
from verifier.evidence import Judged, deepest, witness
from verifier.hindsight import Finding, PeopleHindsight, RobotHindsight, tracks, with_newcomers
from verifier.recordings import Reading, Recording, Window
from verifier.reports.verification import VerifyReport
from verifier.run_log import RunContext, RunLog
from verifier.setup import (
    DEFAULT_POSITION_ERROR_M,
    build_check,
    build_gate,
    build_profile,
    build_robot,
    waivers,
)
from verifier.verdict import (
    Reason,
    Status,
    Verdict,
    Witness,
)

Array = NDArray[np.float64]

WINDOW_S = 30.0
"""Length of the stretch that is fitted and held in memory at a time [s]."""
LEAD_S = 0.5
"""Samples before the first cycle of a stretch, so that its fit is not judged at its edge [s]."""
TAIL_S = 4.0
"""Samples after the last cycle of a stretch: the longest plan that can be followed to its end [s]."""
DEGREES_ABOVE = 20.0
"""Joint values beyond this are more likely degrees than rad: real wrists were seen at 12.6 rad."""
MAX_MEASURED_ERROR_RAD = 0.05
"""A fit that misses samples by more than this must be declared as a tracking error in the cell."""

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
class _Stretch:
    """One window ready to be judged: path, planner, and what the future will bring."""

    window: Window
    trajectory: IntendedTrajectory
    planner: ShortTermPlanner
    robot: RobotHindsight
    tracks: dict[str, LaterSamples]
    stamps: Array


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
        self._people_hindsight = PeopleHindsight(profile, cell.people.max_report_gap_s)
        self._profile_text = f"{profile.name} ({cell.people.approach_speed_m_s:g} m/s)"
        self._start, end = reading.overlap
        self._cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        if self._cycles == 0:
            raise SetupError(
                f"{reading.recording.path}: {end - self._start:.3f} s of overlap is shorter than a cycle of "
                f"{cell.cycle_s} s"
            )
        self._log = RunLog(self._cycles)
        self._failed_before = False
        self._nobody_since = -math.inf
        self._unknown_frames: set[str] = set()
        self._reported = False
        self._arrivals = Arrivals(cell.people.latency_s)
        self._tightest: _Tightest | None = None
        self._recent: list[RawMeasurement] = []
        self._seconds = 0.0

    def run(self, progress: Progress) -> None:
        """Judge every cycle, window by window."""
        k = 0
        for window in self._reading.windows(WINDOW_S, LEAD_S, TAIL_S):
            began = time.perf_counter()
            stretch = self._prepare(window)
            self._arrivals.expect(window.people)
            while k < self._cycles and (window.last or self._instant(k) < window.end):
                self._judge(k, stretch)
                k += 1
                if k % 256 == 0:
                    progress(k / self._cycles)
            self._seconds += time.perf_counter() - began
        progress(1.0)
        self._log.refuse_unreadable(self._reading.not_taken, self._reading.not_taken_count)

    def _instant(self, k: int) -> float:
        return self._start + k * self._cell.cycle_s

    def _prepare(self, window: Window) -> _Stretch:
        fit = fit_samples(window.t, window.q, self._fit_settings())
        q_error = self._q_error(fit.residual, window)
        table = self._cell.robot.tracking
        planner = ShortTermPlanner(
            self._robot.limits,
            PlanSettings(
                cycle_s=self._cell.cycle_s,
                delay=(table.delay_min_s, table.delay_max_s),
                q_error=q_error,
                dq_error=np.full(len(q_error), table.velocity_error_rad_s),
                slice_s=self._cell.stop.slice_s,
                allow_joint_space=self._cell.stop.allow_joint_space,
            ),
        )
        reports = (*self._recent, *window.people, *window.people_ahead)
        self._recent = [r for r in (*self._recent, *window.people) if r.arrived > window.end - TAIL_S]
        return _Stretch(
            window,
            fit.trajectory,
            planner,
            RobotHindsight(
                window.t, fit.residual_samples, q_error, self._robot.joints, self._cell.robot.max_sample_gap_s
            ),
            tracks(self._gate, reports),
            np.unique([report.stamp for report in reports if math.isfinite(report.stamp)]),
        )

    def _fit_settings(self) -> FitSettings:
        spacing = self._cell.robot.knot_spacing_s
        return FitSettings() if spacing is None else FitSettings(knot_spacing_s=spacing)

    def _q_error(self, residual: Array, window: Window) -> Array:
        """Bound of the tracking error (J,): declared, or the largest residual of the fit."""
        declared = self._cell.robot.tracking.position_error_rad
        if not isinstance(declared, str):
            return np.full(len(residual), declared)
        worst = int(np.argmax(residual))
        if not residual[worst] <= MAX_MEASURED_ERROR_RAD:
            raise SetupError(
                f"{self._reading.recording.path}: {self._robot.joints[worst]} leaves the fitted path by "
                f"{residual[worst]:.3f} rad between {window.start:.2f} s and {window.end:.2f} s; "
                "declare robot.tracking.position_error_rad or a smaller robot.knot_spacing_s in the cell"
                + (" (values this large look like degrees)" if np.abs(window.q).max() > DEGREES_ABOVE else "")
            )
        self._log.widen_tracking(residual)
        return residual

    def _judge(self, k: int, stretch: _Stretch) -> None:
        t, cycle = self._instant(k), self._cell.cycle_s
        self._admit_until(t)
        plan = stretch.planner.plan(stretch.trajectory, t + cycle, t + cycle)
        slices, people = stretch.planner.slices, self._gate.people
        known = Known(
            people, self._reported, self._nobody_since, self._gate.contradicted, self._gate.overflow
        )
        answer = self._check.check(t, plan, slices, known)
        ready = plan.outcome is PlanOutcome.READY
        until = (plan.t_rest if ready else t + 2.0 * cycle) + self._cell.robot.tracking.delay_max_s
        finding = self._contradiction(t, until, stretch, answer)
        if finding is None and ready:
            finding = self._unreported(stretch, self._judged(k, slices, people), plan, known, answer)
        self._log.keep(k, answer, plan, finding)
        if answer.reason in (Reason.STATE_BEYOND_LIMITS, Reason.NO_STOP_WITHIN_LIMITS):
            self._log.note_excess(t, plan, self._robot.joints)
        if finding is None:
            self._keep_evidence(k, answer, plan, slices, known)

    def _admit_until(self, t: float) -> None:
        """Admit the reports that have arrived by t, in the order of their arrival."""
        for report in self._arrivals.until(t):
            admission = self._gate.admit(report, t)
            self._log.refuse(admission.refusals)
            whole = any(refusal.person == "" for refusal in admission.refusals)
            if any(refusal.reason is RefusalReason.UNKNOWN_FRAME for refusal in admission.refusals):
                self._unknown_frames.add(report.frame)
            self._reported = self._reported or not whole
            if report.complete and not report.people and not whole:
                errors = self._cell.people.stamp_error_s + self._cell.people.clock_error_s
                self._nobody_since = max(self._nobody_since, report.stamp - errors)

    def _contradiction(self, t: float, until: float, stretch: _Stretch, answer: Verdict) -> Finding | None:
        """Return what the recording contradicts of what this cycle assumed, if anything."""
        found = stretch.robot.check(t, until)
        if found is None and not self._check.settings.assume_nobody:
            found = self._people_hindsight.check(
                self._gate.people, self._gate.person_ids, stretch.tracks, stretch.stamps, until
            )
        if found is None and answer.reason is Reason.INCONSISTENT_REPORTS:
            found = Finding(answer.reason, "A1 people", "reports about one person contradict each other", t)
        return found

    def _unreported(
        self, stretch: _Stretch, judged: Judged, plan: PlanResult, known: Known, answer: Verdict
    ) -> Finding | None:
        """Judge the plan once more with everybody who was first seen before it had ended."""
        if self._check.settings.assume_nobody or not known.reported:
            return None
        until = plan.t_rest + self._cell.robot.tracking.delay_max_s
        wider = with_newcomers(known.people, judged.ids, stretch.tracks, until)
        if wider is None:
            return None
        again = replace(known, people=wider.people, overflow=known.overflow or wider.overflow)
        check = self._second_look
        if check.check(judged.t, plan, judged.slices, again).status is Status.VERIFIED:
            return None
        found = witness(check, replace(judged, people=wider.people, ids=wider.ids), check.nearest)
        if found is not None and found.person not in judged.ids:
            seen = float(stretch.tracks[found.person].t[0])
            who = f"{found.person}, first seen then,"
            text = f"{who} could have reached {found.link}: gap {found.gap_m:+.3f} m"
            return Finding(Reason.UNREPORTED_PERSON, "A5 reports", text, seen)
        if answer.status is not Status.VERIFIED:
            return None
        text = "with those who are first seen during the stop there are more people than one check can hold"
        return Finding(Reason.UNREPORTED_PERSON, "A5 reports", text, judged.t)

    def _keep_evidence(self, k: int, answer: Verdict, plan: PlanResult, slices: Block, known: Known) -> None:
        """Describe the first failure at once, and keep what describes the tightest pair at the end."""
        if answer.status is Status.NOT_VERIFIED and not self._failed_before:
            cycle = self._judged(k, slices, known.people)
            self._log.first_witness = witness(self._check, cycle, self._check.nearest)
            if answer.reason is Reason.REACHABLE:
                self._log.deepest = witness(self._check, cycle, deepest(self._check, cycle))
            self._failed_before = True
        smallest = math.inf if self._tightest is None else self._tightest.gap_m
        if answer.status is Status.VERIFIED and answer.gap_m < smallest:
            known = replace(known, people=known.people.copy())
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
        if self._log.q_error is not None:
            items += [
                Assumption(
                    f"robot.tracking.{joint}",
                    float(error),
                    "rad",
                    "largest residual of the fit",
                    Certainty.MEASURED,
                )
                for joint, error in zip(self._robot.joints, self._log.q_error, strict=True)
            ]
        return tuple(items)

    def _notes(self) -> Iterator[str]:
        reading = self._reading
        if self._robot.fixed_links:
            yield f"links that do not move are not checked: {', '.join(self._robot.fixed_links)}"
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
