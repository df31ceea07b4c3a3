"""Verify a recording offline: every cycle on its own, with what had arrived by then.

Cycle k is judged at t_k from ṡ = 1 on the recorded path: the piece [t_k+1, t_k+2] and the failsafe manoeuvre
after it, against the people reported by t_k (docs/method.md, sections 2 and 6). Afterwards the later samples
of the same recording are held against what the cycle assumed (:mod:`verifier.hindsight`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from failsafe.trajectory import LATEST_S
from occupancy.body import profile_names
from robots.assumption import Assumption
from robots.errors import SetupError
from robots.files import printed
from robots.identity import stated_hash
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.enclosure_size import sizes_of, too_long
from verifier.inputs import input_files
from verifier.judge import Judge
from verifier.locked_motion import locked_motion
from verifier.onlooker import Onlooker
from verifier.opened import open_placed
from verifier.recordings import Reading, Recording
from verifier.reported import Reported, late_joints, moving_frames, not_looked_at, not_read
from verifier.reports.verification import VerifyReport
from verifier.run_log import RunContext
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Section, Sections
from verifier.setup import build_robot, content_hash
from verifier.shown import shown
from verifier.stated import measured_tracking, stated_assumptions, waivers

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
    onlooker: Onlooker | None = None,
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
    onlooker:
        Is shown every cycle after it was judged; ``None``: nobody looks.

    Raises
    ------
    SetupError
        Recording, cell or robot cannot be used; one line that says what is wrong and what would be right.
    """
    source, cell = open_placed(recording, cell, assume_nobody=assume_nobody)
    robot = build_robot(cell, source.robot, cache_dir)
    reading = Reading(source, robot.joints, people=not assume_nobody, point_names=cell.people.point_names)
    replay = _Replay(reading, cell, robot, assume_nobody=assume_nobody, onlooker=onlooker)
    replay.run(progress or _ignore)
    return replay.report()


def _ignore(_share: float) -> None:
    """Nobody wants to know."""


class _Replay:
    """One run over one recording."""

    def __init__(
        self,
        reading: Reading,
        cell: Cell,
        robot: RobotModel,
        *,
        assume_nobody: bool,
        onlooker: Onlooker | None,
    ) -> None:
        self._reading = reading
        self._cell = cell
        self._robot = robot
        self._inputs = input_files(reading.path, cell)
        self._waived = waivers(cell, robot, assume_nobody=assume_nobody)
        self._start, end = reading.overlap
        self._cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        if self._cycles == 0:
            raise SetupError(
                f"{reading.path}: {end - self._start:.3f} s of overlap is shorter than a cycle of "
                f"{cell.cycle_s} s"
            )
        if self._cycles > MAX_CYCLES or end > LATEST_S:
            raise self._too_long(end)
        self._start_ns = reading.epoch_ns + round(self._start * 1e9)
        if onlooker is not None:
            onlooker.begin(self._start_ns)
        self._judge = Judge(
            cell,
            robot,
            self._start,
            self._cycles,
            assume_nobody=assume_nobody,
            onlooker=onlooker,
            locked=locked_motion(reading, robot),
        )
        self._sections = Sections(reading.path, cell, robot, self._judge.gate)
        self._reported = Reported(self._judge.gate, monitored=bool(cell.people.monitored))
        self._seconds = 0.0

    def _too_long(self, end: float) -> SetupError:
        """Return what refuses a recording that nobody made on purpose: as a rule a clock was set in it."""
        begin, step = self._reading.longest_step()
        return SetupError(
            f"{self._reading.path}: {end:.6g} s, or {self._cycles} cycles, are more than "
            f"{LATEST_S:g} s or {MAX_CYCLES} cycles; time jumps by {step:.6g} s at {begin:.3f} s after the "
            "first joint sample: if a clock was set there, cut the recording in two"
        )

    def run(self, progress: Progress) -> None:
        """Judge every cycle, window by window."""
        k = 0
        for window in self._reading.windows(WINDOW_S, LEAD_S, TAIL_S):
            began = time.perf_counter()
            section = self._sections.next(window)
            self._judge.arrivals.expect(window.people)
            self._reported.add(window.people)
            self._look_where_people_are(section)
            while k < self._cycles and (window.last or self._judge.instant(k) < window.end):
                self._judge.judge(k, section)
                k += 1
                if k % 256 == 0:
                    progress(k / self._cycles)
            self._seconds += time.perf_counter() - began
        progress(1.0)
        self._judge.log.refuse_unreadable(self._reading.not_taken, self._reading.not_taken_count)

    def _look_where_people_are(self, section: Section) -> None:
        base = np.array(self._cell.robot.mount.xyz_m)
        for person, seen in section.people.items():
            for samples in seen.samples:
                self._judge.whereabouts.add(person, samples, base)

    def report(self) -> VerifyReport:
        """Return what was found."""
        self._judge.log.tightest = self._judge.tightest_witness()
        return self._judge.log.report(
            RunContext(
                recording=self._reading.path.name,
                cell=self._cell,
                robot=self._robot,
                profile=self._judge.profile_text,
                waived=self._waived.texts,
                assumptions=self._assumptions(),
                not_checked=self._judge.check.not_checked,
                content=content_hash(self._judge.check, self._cell),
                start_s=self._start,
                start_ns=self._start_ns,
                notes=tuple(self._notes()),
                seconds=self._seconds,
                inputs=self._inputs,
            )
        )

    def _assumptions(self) -> tuple[Assumption, ...]:
        used = self._reported.default_error
        stated = stated_assumptions(self._cell, self._judge.check, default_error=used)
        items = [*stated, *self._reading.recording.assumptions]
        if self._sections.residual is not None:
            items += measured_tracking(self._robot, self._sections.residual)
        return tuple(items)

    def _notes(self) -> Iterator[str]:
        reading = self._reading
        if self._waived.assume_nobody:
            yield from not_looked_at(reading.recording, self._cell.people.point_names)
        else:
            yield from self._reported.lines(reading.not_taken_count)
            yield from not_read(reading.recording)
            yield from moving_frames(reading.recording)
            yield from late_joints(reading.joints_behind_s, self._cell.people.clock_error_s)
        yield from self._judge.whereabouts.lines()
        if self._cell.people.profile not in profile_names():
            yield f"people.profile is a file of its own: {printed(self._judge.profile_title)}"
        if self._sections.like_degrees:
            largest = f"joint values up to {self._sections.largest:.4g}"
            yield f"{largest}: positions are in rad, these look like degrees"
        if self._start > 0.0005:
            yield f"not looked at: the first {self._start:.3f} s of motion, before the first report"
        if self._judge.arrivals:
            yield f"reports that had not arrived by the last cycle: {len(self._judge.arrivals)}"
        yield from too_long(sizes_of(self._robot))
        if self._robot.fixed_links:
            yield f"links that do not move are not checked: {', '.join(self._robot.fixed_links)}"
        if self._judge.check.contact is not None:
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
        for frame in sorted(self._judge.unknown_frames):
            pose = f"[people.frames.{frame}] of the cell"
            yield f"reports in frame {frame!r} were refused: declare its pose in {pose}"
        if reading.unknown_points:
            names = ", ".join(sorted(reading.unknown_points))
            yield f"point names that are not known and were ignored: {names}"
        for name in reading.unused_point_names:
            yield (
                f"people.point_names.{shown(name)}: no report has a point of that name (an import leaves out "
                "names that it does not know: import --point-name)"
            )
