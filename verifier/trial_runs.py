"""Runs of the verifier over one recording, again and again, each with something changed.

Every cycle is judged by :mod:`verifier.judge`, as `verify` does it. What may be changed: the cell, the path
speed of each stretch, and who is there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import LATEST_S
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.bracket import Failure
from verifier.cell import Cell
from verifier.judge import Checks, Judge, build_checks
from verifier.locked_motion import locked_motion
from verifier.program_segments import STILL, Stretch
from verifier.recordings import Window
from verifier.recordings.windowed import JointPosition, Windowed
from verifier.replay import MAX_CYCLES
from verifier.reported import lacks_errors
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Section, Sections
from verifier.setup import build_watch
from verifier.verdict import Reason, Status

Array = NDArray[np.float64]


class Nobody:
    """A recording whose people are replaced by complete reports that list nobody, one for each cycle.

    Parameters
    ----------
    source:
        Where the motion is read from.
    overlap:
        First and last instant [s] that is looked at.
    cell:
        A report is seen each of its cycles, and arrives its latency later.
    """

    def __init__(self, source: Windowed, overlap: tuple[float, float], cell: Cell) -> None:
        self._source, self._cycle, self._latency = source, cell.cycle_s, cell.people.latency_s
        self.path, self.overlap = source.path, overlap

    def windows(self, length_s: float, before_s: float, after_s: float) -> Iterator[Window]:
        """Yield the windows of the source; the reports are ours."""
        given, first = 0, math.ceil(self._latency / self._cycle)
        for window in self._source.windows(length_s, before_s, after_s):
            end = math.inf if window.last else window.end
            reports: list[RawMeasurement] = []
            while (stamp := self._stamp(given - first)) + self._latency < end and stamp <= window.end:
                reports.append(RawMeasurement(stamp, stamp + self._latency, "world", True, ()))
                given += 1
            yield replace(window, people=tuple(reports), people_ahead=())

    def positions_of(self, joints: Collection[str]) -> Iterator[JointPosition]:
        """Yield what the source says of joints that its windows leave out."""
        return self._source.positions_of(joints)

    def _stamp(self, number: int) -> float:
        return self.overlap[0] + number * self._cycle


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run answers about one stretch: cycles that are verified, and the first that is not."""

    verified: int
    failure: Failure | None


@dataclass(frozen=True, slots=True)
class Asked:
    """One stretch of cycles, and the path speed with which it is to be judged."""

    stretch: Stretch
    speed: float


class TrialRuns:
    """Judges stretches of one recording.

    Parameters
    ----------
    source:
        The recording.
    cell, robot:
        What is judged, and what the length of a cycle is.

    Attributes
    ----------
    cycles:
        How many there are.
    residual:
        Largest residual (J,) of the fits of the last run [rad; m]; ``None``: declared, or no run yet.
    default_error:
        Whether a point came without an error of its own in some run, so that the cell's may have been used.

    Raises
    ------
    SetupError
        The recording is shorter than a cycle, or longer than time can be counted.
    """

    def __init__(self, source: Windowed, cell: Cell, robot: RobotModel) -> None:
        self._source, self._robot = source, robot
        self._locked = locked_motion(source, robot)
        self.cycle_s = cell.cycle_s
        self._start, end = source.overlap
        self.cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        self.residual: Array | None = None
        self.default_error = False
        if not 0 < self.cycles <= MAX_CYCLES or end > LATEST_S:
            raise SetupError(
                f"{source.path}: {end - self._start:.6g} s of overlap are {self.cycles} cycles of "
                f"{cell.cycle_s} s; there should be 1 to {MAX_CYCLES}, and at most {LATEST_S:g} s"
            )

    def run(self, cell: Cell, asked: Sequence[Asked], checks: Checks | None = None) -> list[Outcome]:
        """Judge some stretches, in their order of time, with another cell.

        A stretch is left at its first cycle that is not verified or contradicted. ``checks``: of the same
        robot and cell but for what does not concern checks, as the latency; ``None``: made anew.
        """
        source = self._source
        checks = checks or build_checks(cell, self._robot, assume_nobody=False)
        judge = Judge(
            cell,
            self._robot,
            self._start,
            self.cycles,
            assume_nobody=False,
            checks=checks,
            locked=self._locked,
        )
        speeds = np.ones(self.cycles)
        for each in asked:
            speeds[each.stretch.first : each.stretch.end] = each.speed
        sections = Sections(
            source.path, cell, self._robot, judge.gate, lambda t: float(speeds[self._number(t)])
        )
        tally = _Tally(judge, asked)
        k = 0
        for window in source.windows(WINDOW_S, LEAD_S, TAIL_S):
            if tally.over:
                break
            section = sections.next(window)
            judge.arrivals.expect(window.people)
            self.default_error = self.default_error or lacks_errors(window.people)
            while not tally.over and k < self.cycles and (window.last or judge.instant(k) < window.end):
                tally.take(k, section)
                k += 1
        self.residual = sections.residual
        return tally.outcomes(self._start)

    def rests(self, cell: Cell) -> NDArray[np.bool_]:
        """Return whether the recorded arm rests (cycles,)."""
        sections = Sections(self._source.path, cell, self._robot, build_watch(cell).gate)
        still, rests = STILL * self._robot.limits.velocity, np.ones(self.cycles, np.bool_)
        t = self._start + self.cycle_s * np.arange(self.cycles)
        for window in self._source.windows(WINDOW_S, LEAD_S, TAIL_S):
            section = sections.next(window)
            for path in section.trajectories:
                here = (t >= max(window.start, path.s_begin)) & (t <= min(window.end, path.s_end))
                rests[here] = (np.abs(path.sample(t[here])[1]) <= still).all(axis=1)
        return rests

    def _number(self, t: float) -> int:
        """Return the number of the cycle at an instant."""
        return min(self.cycles - 1, max(0, round((t - self._start) / self.cycle_s)))


class _Tally:
    """Judges the cycles that somebody asked for and counts."""

    def __init__(self, judge: Judge, asked: Sequence[Asked]) -> None:
        self._judge = judge
        self._stretches = [each.stretch for each in asked]
        self._verified = [0] * len(asked)
        self._failed: list[int | None] = [None] * len(asked)
        self._at = 0

    @property
    def over(self) -> bool:
        """Whether nothing is left to be judged."""
        return all(
            failed is not None for failed in self._failed[self._at :]
        )  # also where the last stretch lies behind

    def take(self, k: int, section: Section) -> None:
        """Judge cycle ``k``, or only take in what arrives until then."""
        while self._at < len(self._stretches) and k >= self._stretches[self._at].end:
            self._at += 1
        here = self._at
        if here == len(self._stretches) or k < self._stretches[here].first or self._failed[here] is not None:
            self._judge.admit_until(self._judge.instant(k))
            return
        self._judge.judge(k, section)
        status = int(self._judge.log.status[k])
        if status == Status.VERIFIED:
            self._verified[here] += 1
        elif status != Status.NOT_CHECKED:
            self._failed[here] = k

    def outcomes(self, start: float) -> list[Outcome]:
        """Return what was found; times count from ``start`` [s]."""
        found = []
        for verified, failed in zip(self._verified, self._failed, strict=True):
            failure = None
            if failed is not None:
                reason = Reason(int(self._judge.log.reason[failed]))
                failure = Failure(self._judge.instant(failed) - start, reason)
            found.append(Outcome(verified, failure))
        return found
