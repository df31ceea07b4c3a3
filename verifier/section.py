"""Sections of a recording: a window of it with everything that its cycles are judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from failsafe.short_term_plan import PlanSettings, ShortTermPlanner
from failsafe.trajectory import FitSettings, IntendedTrajectory, fit_samples
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.hindsight import RobotHindsight, Sightings, seen_by, sightings
from verifier.recordings import Window

Array = NDArray[np.float64]

WINDOW_S = 30.0
"""Length of the stretch that is fitted and held in memory at a time [s]."""
LEAD_S = 0.5
"""Samples before the first cycle of a stretch, so that its fit is not judged at its edge [s]."""
TAIL_S = 4.0
"""Samples after the last cycle of a stretch: the longest plan that can be followed to its end [s]."""
FEWEST_SAMPLES = FitSettings().degree + 1
"""A fit needs this many."""
DEGREES_ABOVE = 20.0
"""Joint values beyond this are more likely degrees than rad: real wrists were seen at 12.6 rad."""
MAX_MEASURED_ERROR_RAD = 0.05
"""A fit that misses samples by more than this must be declared as a tracking error in the cell."""


@dataclass(frozen=True, slots=True)
class Section:
    """One window ready to be judged: path, planner, and what the future will bring.

    Attributes
    ----------
    window, trajectory, planner:
        Samples, the path through them, and what plans on it.
    robot:
        The samples held against the path.
    people:
        Who was seen when, by their ids.
    stamps:
        Instants (M,) [s] by which the people of the reports had been seen, increasing.
    """

    window: Window
    trajectory: IntendedTrajectory
    planner: ShortTermPlanner
    robot: RobotHindsight
    people: dict[str, Sightings]
    stamps: Array


class Sections:
    """Makes sections from the windows of one recording, in their order.

    Attributes
    ----------
    residual:
        Largest residual (J,) of the fits so far [rad or m]; ``None`` where the tracking error is declared.
    """

    def __init__(self, path: Path, cell: Cell, robot: RobotModel, gate: Gate) -> None:
        self._path = path
        self._cell = cell
        self._robot = robot
        self._gate = gate
        self._recent: list[RawMeasurement] = []
        self._last: Section | None = None
        self.residual: Array | None = None

    def next(self, window: Window) -> Section:
        """Fit the path through a window and read the reports around it.

        Raises
        ------
        SetupError
            The samples cannot be fitted, or are farther from the path than may go undeclared.
        """
        before = self._last
        reports = (*self._recent, *window.people, *window.people_ahead)
        self._recent = [r for r in (*self._recent, *window.people) if r.arrived > window.end - TAIL_S]
        if len(window.t) < FEWEST_SAMPLES and before is not None:
            # so long a gap is longer than any cell may allow: every cycle in it will be contradicted
            trajectory, planner = before.trajectory, before.planner
            residual, q_error = np.zeros(window.q.shape), before.planner.settings.q_error
        else:
            spacing = self._cell.robot.knot_spacing_s
            settings = FitSettings() if spacing is None else FitSettings(knot_spacing_s=spacing)
            fit = fit_samples(window.t, window.q, settings)
            trajectory, residual = fit.trajectory, fit.residual_samples
            q_error = self._q_error(fit.residual, window)
            planner = self._planner(q_error)
        covers = (
            -math.inf if before is None else window.start - LEAD_S,
            math.inf if window.last else window.end + TAIL_S,
        )
        gap_s = self._cell.robot.max_sample_gap_s
        self._last = Section(
            window,
            trajectory,
            planner,
            RobotHindsight(window.t, covers, residual, q_error, self._robot.joints, gap_s),
            sightings(self._gate, reports),
            np.unique([seen_by(report) for report in reports if math.isfinite(report.stamp)]),
        )
        return self._last

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
            ),
        )

    def _q_error(self, residual: Array, window: Window) -> Array:
        """Bound of the tracking error (J,): declared, or the largest residual of the fit."""
        declared = self._cell.robot.tracking.position_error_rad
        if not isinstance(declared, str):
            return np.full(len(residual), declared)
        worst = int(np.argmax(residual))
        if not residual[worst] <= MAX_MEASURED_ERROR_RAD:
            raise SetupError(
                f"{self._path}: {self._robot.joints[worst]} leaves the fitted path by "
                f"{residual[worst]:.3f} rad between {window.start:.2f} s and {window.end:.2f} s; "
                "declare robot.tracking.position_error_rad or a smaller robot.knot_spacing_s in the cell"
                + (" (values this large look like degrees)" if np.abs(window.q).max() > DEGREES_ABOVE else "")
            )
        self.residual = residual if self.residual is None else np.maximum(self.residual, residual)
        return residual
