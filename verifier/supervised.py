"""A recorded intention under the supervisor: what would it have cost, and whom would the arm have touched?

People do in the recording what they did beside the arm that moved as recorded, not what they would have done
beside a supervised one. That is said with every result.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from failsafe.manoeuvre import come_to_rest
from failsafe.preparation import Objection, Reserve
from failsafe.trajectory import FitSettings, IntendedTrajectory, TrajectoryError, fit_samples
from occupancy.report import RawMeasurement
from robots.assumption import Assumption
from robots.errors import SetupError
from robots.limits import JointLimits
from robots.model import RobotModel
from verifier.arrivals import Arrivals
from verifier.cell import Cell
from verifier.command import Cause
from verifier.comparison import beliefs
from verifier.contacts import RecordedContacts
from verifier.locked_motion import locked_motion
from verifier.opened import open_placed
from verifier.proposal import NewTrajectory
from verifier.recordings import Reading, Recording
from verifier.reported import lacks_errors
from verifier.reports.supervised import Contact, SupervisedReport
from verifier.section import (
    FEWEST_SAMPLES,
    MAX_MEASURED_ERROR_RAD,
    NO_PATH,
    joint_unit,
    require_joint_positions,
    require_one_clock,
    require_unwrapped,
)
from verifier.setup import Supervised, build_gate, build_profile, build_robot, build_supervised
from verifier.stated import measured_tracking, stated_assumptions, waivers
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.verdict import Reason, criterion_names

Array = NDArray[np.float64]
Progress = Callable[[float], None]

MOST_SAMPLES = 2_000_000
"""Joint samples that are held in memory at once."""
_GENTLE = 0.5
"""Share of the acceleration with which a recording that ends in motion is brought to rest."""
_SLOWER = 1.02
_TRIES = 40
"""A path beyond the limits is slowed by 2 % at least, and so often at most."""


def supervise(
    recording: Recording | str | Path,
    cell: Cell,
    *,
    progress: Progress | None = None,
    cache_dir: Path | None = None,
) -> SupervisedReport:
    """Run the recorded motion as an intention under the supervisor, with the recorded people.

    Raises
    ------
    SetupError
        Recording, cell or robot cannot be used; one line that says what is wrong and what would be right.
    """
    source, cell = open_placed(recording, cell)
    robot = build_robot(cell, source.robot, cache_dir)
    reading = Reading(source, robot.joints, point_names=cell.people.point_names)
    moved = locked_motion(reading, robot).check(*reading.overlap)
    if moved is not None:
        raise SetupError(
            f"{source.path}: {moved.text}, at {moved.t:.3f} s; a supervised replay moves the arm at other "
            "times than it was: name the joint in robot.joints, or cut the recording"
        )
    intention = _intention(reading, cell, robot)
    tracking = cell.robot.tracking.model_copy(update={"position_error_rad": intention.error})
    table = cell.robot.model_copy(update={"tracking": tracking})
    run = _Run(cell.model_copy(update={"robot": table}), robot, intention)
    run.go(progress or _ignore)
    return run.report(source, cell)


def supervise_beliefs(recording: str | Path, cell: Cell, progress: Progress) -> list[SupervisedReport]:
    """Supervise a recording under every belief about people; the first report is that of the cell itself.

    Raises
    ------
    SetupError
        As :func:`supervise`.
    """
    source, cell = open_placed(recording, cell)
    cells = list(beliefs(cell))
    reports = []
    for number, each in enumerate(cells):
        reports.append(supervise(source, each))
        progress((number + 1) / len(cells))
    return reports


def _ignore(_share: float) -> None:
    """Nobody wants to know."""


@dataclass(frozen=True, slots=True)
class _Intention:
    """The recorded motion as a path, who was reported when, and the time in which both are known.

    ``residual`` ``(n,)``: how far the joints leave the path, where the cell leaves that to the recording.
    """

    trajectory: IntendedTrajectory
    reports: tuple[RawMeasurement, ...]
    overlap: tuple[float, float]
    error: float
    residual: Array | None


def _intention(reading: Reading, cell: Cell, robot: RobotModel) -> _Intention:
    """Fit one path through all joint samples of the overlap."""
    path = reading.recording.path
    start, end = reading.overlap
    parts = list(reading.windows(end - start + 1.0, 0.0, 0.0))
    for part in parts:
        require_one_clock(path, part, cell.people)
    t, q = np.concatenate([part.t for part in parts]), np.concatenate([part.q for part in parts])
    first = max(0, int(np.searchsorted(t, start, side="right")) - 1)
    t, q = t[first:], q[first:]
    require_joint_positions(path, robot, t, q)
    require_unwrapped(path, robot, t, q, cell.robot.max_sample_gap_s)
    if not FEWEST_SAMPLES <= len(t) <= MOST_SAMPLES:
        raise SetupError(
            f"{path}: {len(t)} joint samples while people are reported; a supervised replay takes "
            f"{FEWEST_SAMPLES} to {MOST_SAMPLES}: cut the recording"
        )
    pause = int(np.argmax(np.diff(t)))
    if not t[pause + 1] - t[pause] <= cell.robot.max_sample_gap_s:
        raise SetupError(
            f"{path}: joint samples pause for {t[pause + 1] - t[pause]:.3f} s at {t[pause]:.3f} s; what was "
            "intended there is not known: cut the recording, or declare a longer robot.max_sample_gap_s"
        )
    spacing = cell.robot.knot_spacing_s
    try:
        fit = fit_samples(t, q, FitSettings() if spacing is None else FitSettings(knot_spacing_s=spacing))
    except TrajectoryError as error:
        raise SetupError(f"{path}: {error}") from error
    declared = cell.robot.tracking.position_error_rad
    residual = fit.residual if isinstance(declared, str) else None
    error_rad = float(fit.residual.max()) if isinstance(declared, str) else declared
    if residual is not None and not error_rad <= MAX_MEASURED_ERROR_RAD:
        worst = int(np.argmax(fit.residual))
        at = t[int(np.argmax(np.abs(fit.residual_samples[:, worst])))]
        raise SetupError(
            f"{path}: {robot.joints[worst]} leaves the fitted path by {error_rad:.4g} "
            f"{joint_unit(robot, worst)} at {at:.3f} s: {NO_PATH}"
        )
    reports = tuple(report for part in parts for report in part.people)
    return _Intention(fit.trajectory, reports, (start, end), error_rad, residual)


@dataclass(frozen=True, slots=True)
class _Start:
    """A supervisor that is about to follow the recorded path, slowed by ``stretch`` (1: as recorded)."""

    supervisor: Supervisor
    path: IntendedTrajectory
    stretch: float
    why: str


def _start(parts: Supervised, trajectory: IntendedTrajectory, cycle_s: float) -> _Start:
    """Slow a recorded motion down as a whole until it keeps the limits and can be stopped."""
    limits = parts.check.robot.limits
    settings = SupervisorSettings(0.25 * cycle_s, Reserve(dynamic=1.0))
    path, stretch, why, last = _ending(trajectory, limits), 1.0, "", ""
    for _ in range(_TRIES):
        supervisor = Supervisor(parts.check, parts.watch, parts.plans, settings, path.sample(path.s_begin)[0])
        refusal = supervisor.propose(NewTrajectory(path))
        if refusal is None:
            return _Start(supervisor, path, stretch, why)
        last = refusal.text
        if refusal.objection not in (Objection.BEYOND_LIMITS, Objection.NO_STOP, Objection.NO_REST):
            break
        why = why or last
        stretch *= max(_SLOWER, 1.0 / refusal.path_speed if refusal.path_speed > 0.0 else 1.0)
        path = _ending(trajectory.stretched(stretch), limits)
    raise SetupError(f"the recorded motion cannot be followed, however slowly: {last}")


def _ending(trajectory: IntendedTrajectory, limits: JointLimits) -> IntendedTrajectory:
    """Return the trajectory with a gentle end at rest, where there is room for one."""
    gentle = replace(limits, acceleration=_GENTLE * limits.acceleration, jerk=_GENTLE * _GENTLE * limits.jerk)
    try:
        return come_to_rest(trajectory, gentle)
    except TrajectoryError:
        return trajectory


class _Run:
    """One run of a recording under a supervisor."""

    def __init__(self, cell: Cell, robot: RobotModel, intention: _Intention) -> None:
        parts = build_supervised(cell, robot)
        profile = build_profile(cell)
        self._cell, self._robot, self._intention = cell, robot, intention
        self._check = parts.check
        self._profile = f"{profile.name} ({profile.speed.max():g} m/s)"
        self._started = _start(parts, intention.trajectory, cell.cycle_s)
        self._contacts = RecordedContacts(
            robot, build_gate(cell, profile), profile, parts.check.settings.standstill
        )
        self._arrivals = Arrivals(cell.people.latency_s, parts.watch.gate.is_ahead)
        self._arrivals.expect(intention.reports)
        start, end = intention.overlap
        cycles = math.floor((end - start) / cell.cycle_s + 1e-9)
        if cycles < 1:
            raise SetupError(f"{end - start:.3f} s of overlap is shorter than a cycle of {cell.cycle_s} s")
        self._t = start + cell.cycle_s * np.arange(cycles)
        n = len(robot.joints)
        self._at = np.zeros(cycles)
        self._q, self._dq = np.zeros((cycles, n)), np.zeros((cycles, n))
        self._states, self._status = np.zeros(cycles, np.uint8), np.zeros(cycles, np.uint8)
        self._reasons: Counter[Reason] = Counter()
        self._adopted = -1
        self._seconds = 0.0

    def go(self, progress: Progress) -> None:
        """Step through the overlap."""
        supervisor, began = self._started.supervisor, time.perf_counter()
        for k, t in enumerate(self._t.tolist()):
            command = supervisor.step(t, self._arrivals.until(t))
            if supervisor.fault is not None:
                raise supervisor.fault
            self._at[k], self._q[k], self._dq[k] = command.t, command.q, command.dq
            self._states[k], self._status[k] = command.outcome, command.verdict.status
            self._reasons[command.verdict.reason] += 1
            if self._adopted < 0 and command.cause is Cause.ADOPTED:
                self._adopted = k
            if k % 256 == 0:
                progress(k / len(self._t))
        self._seconds = time.perf_counter() - began
        progress(1.0)

    def report(self, recording: Recording, stated: Cell) -> SupervisedReport:
        """Return what was found; ``stated`` is the cell before the recording filled in what it left open."""
        path, stretch = self._started.path, self._started.stretch
        elapsed = math.nan if self._adopted < 0 else float(self._t[-1] - self._t[self._adopted])
        reached = min(self._started.supervisor.view().s, path.s_end) - path.s_begin
        return SupervisedReport(
            recording=recording.path.name,
            robot=self._robot.name,
            profile=self._profile,
            models=self._cell.people.models,
            waived=waivers(stated, self._robot, assume_nobody=False).texts,
            assumptions=self._assumptions(recording, stated),
            not_checked_criteria=criterion_names(self._check.not_checked),
            cycles=len(self._t),
            status=self._status,
            states=self._states,
            reasons=self._reasons,
            cycle_s=self._cell.cycle_s,
            time_lost_s=elapsed - reached / stretch,
            reached_s=reached / stretch,
            path_s=(path.s_end - path.s_begin) / stretch,
            contacts=tuple(self._touches()),
            slowed=(stretch, self._started.why),
            real_time_factor=len(self._t) * self._cell.cycle_s / max(self._seconds, 1e-9),
        )

    def _assumptions(self, recording: Recording, stated: Cell) -> tuple[Assumption, ...]:
        residual = self._intention.residual
        measured = () if residual is None else measured_tracking(self._robot, residual)
        numbers = stated_assumptions(stated, self._check, default_error=lacks_errors(self._intention.reports))
        return (*numbers, *recording.assumptions, *measured)

    def _touches(self) -> list[Contact]:
        """Who touched a moving link: one entry for each unbroken series of reports of a person."""
        found: dict[str, Contact] = {}
        done: list[Contact] = []
        for report in sorted(self._intention.reports, key=lambda each: each.stamp):
            if not self._at[0] <= report.stamp <= self._at[-1]:
                continue
            q, dq = (self._between(report.stamp, rows) for rows in (self._q, self._dq))
            touching = dict(self._contacts.touching(report, q, dq))
            for person in [person for person in found if person not in touching]:
                done.append(found.pop(person))
            for person, depth in touching.items():
                start = self._intention.overlap[0]
                before = found.get(person, Contact(person, report.stamp - start, 0.0))
                found[person] = before._replace(depth_m=max(before.depth_m, depth))
        return sorted([*done, *found.values()], key=lambda each: each.t)

    def _between(self, t: float, rows: Array) -> Array:
        """Interpolate commands linearly."""
        k = int(np.clip(np.searchsorted(self._at, t) - 1, 0, max(0, len(self._at) - 2)))
        if k + 1 >= len(self._at) or not self._at[k + 1] > self._at[k]:
            k_row: Array = rows[k]
            return k_row
        w = (t - self._at[k]) / (self._at[k + 1] - self._at[k])
        mixed: Array = rows[k] + w * (rows[k + 1] - rows[k])
        return mixed
