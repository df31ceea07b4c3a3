"""Verify recordings as arrays, many cycles in one call, on several cores.

The answers are those of :func:`verifier.verify`, cycle by cycle: neighbouring cycles are proven together
where that succeeds (:mod:`verifier.quick_proof`), and every other cycle is judged by the same code as there.
Only ``gap_m`` of a cycle that was proven together with others is a lower bound of what
:func:`verifier.verify` reports; ``bounded`` tells which ones these are.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import LATEST_S
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.judge import Checks, Judge, build_checks
from verifier.locked_motion import locked_motion
from verifier.opened import open_recording
from verifier.quick_proof import MOST_CYCLES, QuickProof
from verifier.recordings import Reading, Recording
from verifier.recordings.arrays import ArraySource, JointSamples, PeoplePoints
from verifier.recordings.windowed import Windowed
from verifier.replay import MAX_CYCLES
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Section, Sections
from verifier.setup import build_robot
from verifier.verdict import Status

Array = NDArray[np.float64]

CHUNK = 1024
"""Cycles are never proven together across multiples of this, so that answers do not depend on the stretches
into which processes divide a recording."""


@dataclass(frozen=True, eq=False)
class BatchResult:
    """Answers of N cycles.

    Attributes
    ----------
    t:
        (N,) s, since the start of the overlap of joints and people.
    status, reason:
        (N,) numbers of :class:`verifier.verdict.Status` and :class:`verifier.verdict.Reason`.
    gap_m:
        (N,) m, as in ``per_cycle.gap_m`` of a report; where ``bounded``, a lower bound of it.
    stop_time_s:
        (N,) s, NaN without a stop.
    bounded:
        (N,) whether the cycle was proven together with others.
    """

    t: Array
    status: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    gap_m: NDArray[np.float32]
    stop_time_s: NDArray[np.float32]
    bounded: NDArray[np.bool_]

    def count(self, status: Status) -> int:
        """Return how many cycles have a status."""
        return int(np.count_nonzero(self.status == int(status)))


def verify_batch(
    joints: JointSamples, people: PeoplePoints, cell: Cell, *, jobs: int = 1, cache_dir: Path | None = None
) -> BatchResult:
    """Verify one motion against the people who were reported during it.

    Parameters
    ----------
    joints, people:
        The recording.
    cell:
        Robot, clocks, people, criteria; it must name the robot.
    jobs:
        Processes; each takes a stretch of the recording.
    cache_dir:
        Where enclosures are kept; ``None``: the user's cache folder.

    Raises
    ------
    SetupError
        Arrays, cell or robot cannot be used, or ``jobs`` is below 1.
    """
    return BatchVerifier(cell, cache_dir=cache_dir).verify(joints, people, jobs=jobs)


class BatchVerifier:
    """Verifies many motions in one cell; what does not depend on them is made once.

    Raises
    ------
    SetupError
        The cell or its robot cannot be used.
    """

    def __init__(self, cell: Cell, *, recorded: str | None = None, cache_dir: Path | None = None) -> None:
        self._cell = cell
        self._robot = build_robot(cell, recorded, cache_dir)
        self._checks = build_checks(cell, self._robot, assume_nobody=False)
        self._quick = QuickProof(cell, self._robot, self._checks[0])

    @property
    def robot(self) -> RobotModel:
        """The arm."""
        return self._robot

    def verify(self, joints: JointSamples, people: PeoplePoints, *, jobs: int = 1) -> BatchResult:
        """Verify one motion, as :func:`verify_batch`."""
        return self._on_cores(ArraySource(joints, people, self._robot.joints), jobs)

    def verify_recording(self, recording: Recording | str | Path, *, jobs: int = 1) -> BatchResult:
        """Verify a recorded motion; decoding the file is not divided among the processes.

        Raises
        ------
        SetupError
            As :func:`verifier.verify`.
        """
        source = recording if isinstance(recording, Recording) else open_recording(recording, self._cell)
        names = self._cell.people.point_names
        return self._on_cores(Reading(source, self._robot.joints, point_names=names), jobs)

    def verify_each(
        self, motions: Iterable[JointSamples], people: PeoplePoints, *, jobs: int = 1
    ) -> Iterator[BatchResult]:
        """Verify many motions against the same people, each for itself, in their order.

        Raises
        ------
        SetupError
            As :func:`verify_batch`, when the motion's turn comes.
        """
        _check_jobs(jobs)
        if jobs == 1:
            yield from (self.verify(joints, people) for joints in motions)
            return
        every = tuple(motions)
        with _pool(min(jobs, len(every) or 1), (self, people)) as pool:
            yield from pool.map(_verify_one, every, chunksize=max(1, len(every) // (8 * jobs)))

    def _on_cores(self, source: Windowed, jobs: int) -> BatchResult:
        _check_jobs(jobs)
        run = _Run(source, self._cell, self._robot, self._checks, self._quick)
        parts_of = stretches(run.cycles, jobs)
        if len(parts_of) == 1:
            return run.go(0, run.cycles)
        with _pool(len(parts_of), (self, source)) as pool:
            parts = list(pool.map(_verify_stretch, parts_of))
        t = np.arange(run.cycles, dtype=np.float64) * self._cell.cycle_s
        names = ("status", "reason", "gap_m", "stop_time_s", "bounded")
        return BatchResult(t, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def stretch(self, source: Windowed, first: int, end: int) -> BatchResult:
        """Verify cycles ``first`` to ``end - 1`` of a recording, knowing the reports before them as well."""
        return _Run(source, self._cell, self._robot, self._checks, self._quick).go(first, end)


def stretches(cycles: int, jobs: int) -> list[tuple[int, int]]:
    """Return the stretches, at most ``jobs``, that processes take: first cycle, and the first one behind."""
    chunks = math.ceil(cycles / CHUNK)
    bounds = [min(cycles, CHUNK * (chunks * job // jobs)) for job in range(jobs + 1)]
    return [(first, end) for first, end in pairwise(bounds) if first < end]


class _Run:
    """One pass over a recording, or over a stretch of it."""

    def __init__(
        self, source: Windowed, cell: Cell, robot: RobotModel, checks: Checks, quick: QuickProof
    ) -> None:
        self._source, self._cell = source, cell
        self._start, end = source.overlap
        self.cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        if not 0 < self.cycles <= MAX_CYCLES or end > LATEST_S:
            raise SetupError(
                f"{source.path}: {end - self._start:.6g} s of overlap are {self.cycles} cycles of "
                f"{cell.cycle_s} s; there should be 1 to {MAX_CYCLES}, and at most {LATEST_S:g} s"
            )
        self._judge = Judge(
            cell,
            robot,
            self._start,
            self.cycles,
            assume_nobody=False,
            checks=checks,
            locked=locked_motion(source, robot),
        )
        self._quick = quick
        self._sections = Sections(source.path, cell, robot, self._judge.gate)
        self._bounded = np.zeros(self.cycles, dtype=np.bool_)

    def go(self, first: int, end: int) -> BatchResult:
        """Answer cycles ``first`` to ``end - 1``."""
        k = 0
        for window in self._source.windows(WINDOW_S, LEAD_S, TAIL_S):
            if k == end:
                break
            self._judge.arrivals.expect(window.people)
            behind = end if window.last else min(end, self._cycles_before(window.end, k))
            if behind <= first:
                self._sections.skip(window)
                if behind > k:
                    self._judge.admit_until(self._judge.instant(behind - 1))
                k = behind
                continue
            section = self._sections.next(window)
            self._quick.begin(section)
            k = max(k, first)
            while k < behind:
                k = self._answer(k, behind, section)
        log, some = self._judge.log, slice(first, end)
        return BatchResult(
            np.arange(first, end, dtype=np.float64) * self._cell.cycle_s,
            log.status[some],
            log.reason[some],
            log.gap_m[some],
            log.stop_time_s[some],
            self._bounded[some],
        )

    def _cycles_before(self, t: float, k: int) -> int:
        """Number of the first cycle from ``k`` on that is not judged before ``t`` [s]."""
        found = max(k, int((t - self._start) / self._cell.cycle_s) - 1)
        while found < self.cycles and self._judge.instant(found) < t:
            found += 1
        return min(found, self.cycles)

    def _answer(self, k: int, end: int, section: Section) -> int:
        """Answer cycle k and those after it that know the same; return the first one that is left."""
        judge = self._judge
        judge.admit_until(judge.instant(k))
        most = min(end, k + MOST_CYCLES, (k // CHUNK + 1) * CHUNK)
        behind = k + 1
        while behind < most and judge.arrivals.next > judge.instant(behind):
            behind += 1
        if self._quick.possible:
            self._prove(np.array([judge.instant(each) for each in range(k, behind)]), k, section)
        for each in range(k, behind):
            if not self._bounded[each]:
                judge.judge(each, section)
        return behind

    def _prove(self, t: Array, first: int, section: Section) -> None:
        """Answer what can be proven together of the cycles at ``t`` (N,) [s], the first of them ``first``."""
        known = self._judge.known()
        plans = self._quick.plan(t)
        if not len(plans.which):
            return
        until = float((plans.begins + plans.blocks["duration"]).max())
        until += self._cell.robot.tracking.delay_max_s
        if not section.follows(until):
            return
        if not self._judge.nothing_against(section, float(t[plans.which[0]]), until):
            return
        for found in self._quick.proven(plans, known):
            cycles = first + found.plans.which
            stop_time = found.plans.blocks["duration"] - self._cell.cycle_s
            self._judge.log.keep_separated(cycles, found.gap_m, stop_time)
            self._bounded[cycles] = True


_POOLED: list[tuple[BatchVerifier, PeoplePoints | Windowed]] = []
"""In a process of a pool: what its tasks are about."""


def _pool(processes: int, about: tuple[BatchVerifier, PeoplePoints | Windowed]) -> ProcessPoolExecutor:
    """Return a pool whose processes begin with all that is already there, where the system can do that."""
    start = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    return ProcessPoolExecutor(processes, multiprocessing.get_context(start), _POOLED.append, (about,))


def _verify_one(joints: JointSamples) -> BatchResult:
    verifier, people = _POOLED[-1]
    assert isinstance(people, PeoplePoints)
    return verifier.verify(joints, people)


def _verify_stretch(stretch: tuple[int, int]) -> BatchResult:
    verifier, source = _POOLED[-1]
    assert not isinstance(source, PeoplePoints)
    return verifier.stretch(source, *stretch)


def _check_jobs(jobs: int) -> None:
    if not jobs >= 1:
        raise SetupError(f"jobs = {jobs} should be at least 1")
