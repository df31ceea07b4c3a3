"""Sections of a recording: a window of it with everything that its cycles are judged by."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanResult, PlanSettings
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import Fit, FitSettings, IntendedTrajectory, TrajectoryError, fit_samples
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.arrivals import arrival
from verifier.cell import Cell
from verifier.cell_tables import PeopleTable
from verifier.hindsight import RobotHindsight, Sightings, seen_by, sightings
from verifier.recordings import Window
from verifier.recordings.likely_units import DEGREES_ABOVE
from verifier.recordings.people_stream import MAX_CLOCK_OFFSET_S
from verifier.setup import build_braking, build_silence

Array = NDArray[np.float64]
PathSpeed = Callable[[float], float]
"""Path speed, from the instant of a cycle [s]."""

WINDOW_S = 30.0
"""Length of the stretch that is fitted and held in memory at a time [s]."""
LEAD_S = 0.5
"""Samples before the first cycle of a stretch, so that its fit is not judged at its edge [s]."""
TAIL_S = 4.0
"""Samples after the last cycle of a stretch: the longest plan that can be followed to its end [s]."""
FEWEST_SAMPLES = FitSettings().degree + 1
"""A fit needs this many."""
FARTHEST = 1e3
"""No joint is so far from its zero [rad or m]: such values are no positions, and a path would lose digits."""
_ROUNDING_S = 1e-6
_TURN = 2.0 * math.pi
_ABOUT_RAD = 0.1
"""A jump of a whole turn may differ from it by this, beyond what the joint can move meanwhile."""
MAX_MEASURED_ERROR_RAD = 0.05
"""A fit that misses samples by more than this must be declared as a tracking error in the cell."""
NO_PATH = (
    "look at the samples there; if the arm moved so, declare a smaller robot.knot_spacing_s in the cell, or "
    "robot.tracking.position_error_rad"
)
"""What to do about it."""


def as_recorded(_t: float) -> float:
    """Path speed at which the robot moves as it was recorded."""
    return 1.0


@dataclass(frozen=True, slots=True)
class Section:
    """One window ready to be judged: path, planner, and what the future will bring.

    Attributes
    ----------
    window, trajectories, planner:
        Samples, the paths through them in order of time, one between each two pauses, and what plans on them.
    robot:
        The samples held against the path.
    people:
        Who was seen when, by their ids.
    stamps:
        Instants (M,) [s] by which the people of the reports had been seen, increasing.
    speed:
        How fast the path is followed, cycle by cycle.
    """

    window: Window
    trajectories: tuple[IntendedTrajectory, ...]
    planner: ShortTermPlanner
    robot: RobotHindsight
    people: dict[str, Sightings]
    stamps: Array
    speed: PathSpeed = as_recorded

    def plan(self, t: float) -> PlanResult:
        """Plan for the cycle at ``t`` [s]: the piece from one cycle later on, and its stop.

        In a pause of the samples and across it nothing is known: such a plan is beyond the end of its path.
        """
        begin = t + self.planner.settings.cycle_s
        path = self._path(begin)
        if path < 0:
            self.planner.slices["n"] = 0
            return PlanResult(PlanOutcome.BEYOND_END)
        return self.planner.plan(self.trajectories[path], begin, begin, self.speed(t))

    def reaches_the_end(self, t: float) -> bool:
        """Whether no sample follows the path of the cycle at ``t`` [s], here or in another window."""
        path = self._path(t + self.planner.settings.cycle_s)
        last = len(self.trajectories) - 1
        return self.window.last and 0 <= path == last and self.trajectories[path].s_end >= self.window.t[-1]

    def follows(self, until: float) -> bool:
        """Whether data up to ``until`` [s] are at hand, as far as the recording has any.

        ``until``: when the robot has come to rest, its largest delay included; what was seen by then may
        contradict the cycle.
        """
        return self.window.last or until <= self.window.end + TAIL_S

    def _path(self, t: float) -> int:
        """Index of the last path that has begun by ``t`` [s]; -1: none."""
        return bisect_right(self.trajectories, t, key=attrgetter("s_begin")) - 1


def require_joint_positions(path: Path, robot: RobotModel, t: Array, q: Array) -> None:
    """Refuse samples at ``t`` (T,) [s] whose values ``q`` (T, J) [rad or m] no joint can have.

    Raises
    ------
    SetupError
        One is NaN, or farther than ``FARTHEST`` from zero.
    """
    absurd = np.argwhere(~(np.abs(q) <= FARTHEST))
    if not len(absurd):
        return
    row, joint = (int(i) for i in absurd[0])
    unit, lower, upper = joint_unit(robot, joint), robot.limits.position_lower, robot.limits.position_upper
    where = f"{robot.joints[joint]} at {q[row, joint]:.4g} {unit} at {t[row]:.3f} s"
    limits = f"position limits are {lower[joint]:.4g} and {upper[joint]:.4g} {unit}"
    if math.isinf(lower[joint]) and math.isinf(upper[joint]):
        limits = (
            f"position is not limited, but so far from zero a path loses digits: {FARTHEST:g} is the most"
        )
    raise SetupError(f"{path}: {where}: no joint is there (its {limits}); positions must be in {unit}")


def require_one_clock(path: Path, window: Window, people: PeopleTable) -> None:
    """Refuse joint samples that are stamped after they were recorded, by more than is declared.

    Nothing is recorded before it was there: the stamps are of another clock, and nobody knows by how much.

    Raises
    ------
    SetupError
        One is.
    """
    allowed = people.clock_error_s + people.stamp_error_s + _ROUNDING_S
    if window.ahead_s > allowed:
        raise SetupError(
            f"{path}: the joint sample stamped {window.ahead_at:.3f} s after the first was recorded "
            f"{window.ahead_s:.4g} s before that: the robot's clock differs from the recorder's; state "
            "joints_time_offset_s in [recording] of the cell with people.clock_error_s (`stopproof inspect` "
            "bounds it), or people.clock_error_s alone where they differ by no more"
        )


def require_unwrapped(path: Path, robot: RobotModel, t: Array, q: Array, gap_s: float) -> None:
    """Refuse samples at ``t`` (T,) [s] of an angle in ``q`` (T, J) [rad or m] that jumps by a whole turn.

    Between two samples at most ``gap_s`` [s] apart a turning joint has moved by 2π, give or take what it can
    move in that time, and both are within a turn of zero: a writer has wrapped the angle from π to -π.

    Raises
    ------
    SetupError
        There is such a jump.
    """
    step, dt = np.diff(q, axis=0), np.diff(t)[:, None]
    turning = ~np.asarray(robot.kinematics["prismatic"][0, : q.shape[1]], dtype=bool)
    by_a_turn = np.abs(np.abs(step) - _TURN) <= _ABOUT_RAD + np.minimum(robot.limits.velocity * dt, 1.0)
    faster = np.abs(step) > robot.limits.velocity * dt
    within = np.maximum(np.abs(q[1:]), np.abs(q[:-1])) <= _TURN + _ABOUT_RAD
    wrapped = np.argwhere(by_a_turn & faster & within & turning & (dt <= gap_s))
    if len(wrapped):
        row, joint = (int(i) for i in wrapped[0])
        raise SetupError(
            f"{path}: {robot.joints[joint]} jumps from {q[row, joint]:.4g} to {q[row + 1, joint]:.4g} rad at "
            f"{t[row + 1]:.3f} s: an angle that wraps after a turn; angles must go on beyond ±π where the "
            "joint does, so unwrap them (numpy.unwrap) before they are recorded"
        )


def joint_unit(robot: RobotModel, joint: int) -> str:
    """Unit of the position of the commanded joint with this number."""
    return "m" if robot.kinematics["prismatic"][0, joint] else "rad"


class Sections:
    """Makes sections from the windows of one recording, in their order.

    Attributes
    ----------
    residual:
        Largest residual (J,) of the fits so far [rad or m]; ``None`` where the tracking error is declared.
    largest:
        Largest value of a turning joint so far [rad].
    """

    def __init__(
        self, path: Path, cell: Cell, robot: RobotModel, gate: Gate, speed: PathSpeed = as_recorded
    ) -> None:
        self._path = path
        self._speed = speed
        self._cell = cell
        self._robot = robot
        self._gate = gate
        self._recent: list[RawMeasurement] = []
        self._stamps: Array = np.zeros(0)
        self._begun = False
        self.residual: Array | None = None
        self.largest = 0.0
        self._turning = ~np.asarray(robot.kinematics["prismatic"][0, : len(robot.joints)], dtype=bool)

    @property
    def like_degrees(self) -> bool:
        """Whether the largest joint value so far is more likely in degrees than in rad."""
        return self.largest > DEGREES_ABOVE

    def next(self, window: Window) -> Section:
        """Fit the paths through a window and read the reports around it.

        Raises
        ------
        SetupError
            The samples are no positions, are on another clock, cannot be fitted, or are farther from the path
            than may go undeclared.
        """
        before = self._begun
        require_joint_positions(self._path, self._robot, window.t, window.q)
        gap_s = self._cell.robot.max_sample_gap_s
        require_unwrapped(self._path, self._robot, window.t, window.q, gap_s)
        self.largest = float(np.abs(window.q[:, self._turning]).max(initial=self.largest))
        reports = (*self._recent, *window.people, *window.people_ahead)
        parts, stamps = self._parts(window), self._stamps
        self.skip(window)
        fits = [(part, self._fit(window, part)) for part in parts]
        residual = np.zeros(window.q.shape)
        for part, fit in fits:
            residual[part] = fit.residual_samples
        q_error = self._q_error(residual)
        covers = (
            window.start - LEAD_S if before else -math.inf,
            math.inf if window.last else window.end + TAIL_S,
        )
        return Section(
            window,
            tuple(fit.trajectory for _part, fit in fits),
            self._planner(q_error),
            RobotHindsight(window.t, covers, residual, q_error, self._robot.joints, gap_s),
            sightings(self._gate, reports),
            np.union1d(stamps, [seen_by(report) for report in reports if math.isfinite(report.stamp)]),
            self._speed,
        )

    def skip(self, window: Window) -> None:
        """Go on behind a window without making a section of it.

        Raises
        ------
        SetupError
            Joint samples are stamped after they were recorded, by more than is declared.
        """
        require_one_clock(self._path, window, self._cell.people)
        table, latency_s = self._cell.people, self._cell.people.latency_s
        latest_s = MAX_CLOCK_OFFSET_S + table.clock_error_s + table.stamp_error_s
        since = window.end - max(TAIL_S, latest_s)  # what comes later still was seen no earlier
        self._recent = [
            report
            for report in (*self._recent, *window.people)
            if arrival(report, latency_s, self._gate.is_ahead) > since
        ]
        seen = [seen_by(report) for report in window.people if math.isfinite(report.stamp)]
        self._stamps = np.union1d(self._stamps, seen)
        self._begun = True

    def _planner(self, q_error: Array) -> ShortTermPlanner:
        table = self._cell.robot.tracking
        return ShortTermPlanner(
            self._robot.limits,
            PlanSettings(
                cycle_s=self._cell.cycle_s,
                delay=(table.delay_min_s, table.delay_max_s),
                q_error=q_error,
                dq_error=np.full(len(q_error), table.velocity_error_rad_s),
                slice_s=self._cell.stop.slice_s,
                allow_joint_space=self._cell.stop.allow_joint_space,
                silence=build_silence(self._cell, self._robot),
                braking=build_braking(self._cell, self._robot),
            ),
        )

    def _parts(self, window: Window) -> list[slice]:
        """What lies between pauses, as far as a path can be laid through it.

        Each part is fitted on its own: a path across a pause would be made up, and bend beside it.
        """
        pauses = ~(np.diff(window.t) <= self._cell.robot.max_sample_gap_s)
        bounds = [0, *(np.flatnonzero(pauses) + 1).tolist(), len(window.t)]
        parts = [slice(*pair) for pair in pairwise(bounds)]
        long_enough = [part for part in parts if part.stop - part.start >= FEWEST_SAMPLES]
        if not long_enough and not self._begun and len(parts) == 1:
            raise SetupError(
                f"{self._path}: {len(window.t)} joint samples between {window.t[0]:.2f} s and "
                f"{window.t[-1]:.2f} s are too few: a path needs {FEWEST_SAMPLES}"
            )
        return long_enough

    def _fit(self, window: Window, part: slice) -> Fit:
        t, q = window.t[part], window.q[part]
        spacing = self._cell.robot.knot_spacing_s
        where = f"between {t[0]:.2f} s and {t[-1]:.2f} s"
        try:
            fit = fit_samples(t, q, FitSettings() if spacing is None else FitSettings(knot_spacing_s=spacing))
        except TrajectoryError as error:
            raise SetupError(f"{self._path}: joint samples {where}: {error}{self._large(q)}") from error
        worst = int(np.argmax(fit.residual))
        if not (self._declared_error is not None or fit.residual[worst] <= MAX_MEASURED_ERROR_RAD):
            at = t[int(np.argmax(np.abs(fit.residual_samples[:, worst])))]
            raise SetupError(
                f"{self._path}: {self._robot.joints[worst]} leaves the fitted path by "
                f"{fit.residual[worst]:.4g} {joint_unit(self._robot, worst)} at {at:.3f} s ({where}): "
                + NO_PATH
                + (" (values this large look like degrees)" if np.abs(q).max() > DEGREES_ABOVE else "")
            )
        return fit

    def _large(self, q: Array) -> str:
        """Return which joint has values so large that they may be why a fit was refused; empty: none has."""
        joint = int(np.argmax(np.abs(q).max(axis=0)))
        largest, unit = float(np.abs(q[:, joint]).max()), joint_unit(self._robot, joint)
        return (
            f" ({self._robot.joints[joint]}: up to {largest:.4g} {unit})" if largest > DEGREES_ABOVE else ""
        )

    @property
    def _declared_error(self) -> float | None:
        declared = self._cell.robot.tracking.position_error_rad
        return None if isinstance(declared, str) else declared

    def _q_error(self, residual: Array) -> Array:
        """Bound of the tracking error (J,): declared, or the largest residual of the fits."""
        if self._declared_error is not None:
            return np.full(residual.shape[1], self._declared_error)
        largest: Array = np.abs(residual).max(axis=0, initial=0.0)
        self.residual = largest if self.residual is None else np.maximum(self.residual, largest)
        return largest
