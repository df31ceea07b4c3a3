"""The plan that is being executed: where the robot is commanded to be at every instant, until it rests."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe import axis_kernels, path_kernels
from failsafe.plan import PlanOutcome, PlanResult, StopKind
from failsafe.scaling import PathState
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from robots.motion import Block

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """q, dq, ddq ``(n,)`` [rad, rad/s, rad/s²; m for prismatic joints]."""

    q: Array
    dq: Array
    ddq: Array


class RunningPlan:
    """Piece and stop of the plan that was adopted last; after its end the robot rests where it ends.

    Times are counted from the begin of the plan, so that no large clock value costs digits.

    Attributes
    ----------
    trajectory:
        What the plan moves along.
    duration_s:
        Time from the begin of the plan until rest [s].
    s_rest:
        Path parameter at rest [s]; NaN where the stop leaves the path.
    """

    def __init__(self, trajectory: IntendedTrajectory, s: float) -> None:
        self.trajectory = trajectory
        self._path: Block = np.zeros(1, dtype=path_kernels.PATH)
        self._path_bytes = self._path.view(np.uint8)
        self._axes: Block = np.zeros(1, dtype=axis_kernels.AXES)
        self._state = np.zeros(3)
        self._leaves_at = math.inf
        self.duration_s = 0.0
        self.s_rest = math.nan
        self.rest_at(trajectory, s)

    def rest_at(self, trajectory: IntendedTrajectory, s: float) -> None:
        """Rest at ``s`` [s] of a trajectory from now on.

        Raises
        ------
        TrajectoryError
            The trajectory is not known there.
        """
        if not trajectory.s_begin <= s <= trajectory.s_max:
            raise TrajectoryError(
                f"path parameter {s} s is outside the trajectory, "
                f"{trajectory.s_begin:g} s to {trajectory.s_max:g} s"
            )
        self.trajectory = trajectory
        path_kernels.begin_path(self._path, s, 0.0, 0.0, 0.0)
        self._leaves_at, self.duration_s, self.s_rest = math.inf, 0.0, s

    def take(self, trajectory: IntendedTrajectory, planner: ShortTermPlanner, plan: PlanResult) -> None:
        """Execute the plan that ``planner`` made last, from its begin on.

        Raises
        ------
        TrajectoryError
            There is no such plan.
        """
        if plan.outcome is not PlanOutcome.READY:
            raise TrajectoryError(f"a plan that is {plan.outcome.name} cannot be executed")
        self.trajectory = trajectory
        np.copyto(self._path_bytes, planner.path_bytes)  # field by field takes ten times as long
        off_path = plan.stop is StopKind.JOINT_SPACE
        if off_path:
            np.copyto(self._axes, planner.axes)
        cycle = planner.settings.cycle_s
        self._leaves_at = cycle if off_path else math.inf
        # not from instants, which have fewer digits
        end = float(self._path["t"][0, self._path["n"][0]])
        self.duration_s = cycle + plan.stop_time_s if off_path else end
        self.s_rest = plan.s_rest

    def rests_off_path(self, tau: float) -> bool:
        """Tell whether it has ended by ``tau`` [s after its begin], away from its path."""
        return math.isfinite(self._leaves_at) and tau >= self.duration_s

    @property
    def s_left(self) -> float:
        """Return where it leaves its path [s]; NaN: nowhere."""
        return self.path_state(self._leaves_at).s if math.isfinite(self._leaves_at) else math.nan

    def path_state(self, tau: float) -> PathState:
        """Return s, ṡ, s̈ at ``tau`` [s after its begin]; NaN before it, and once it leaves the path."""
        if not tau <= self._leaves_at:
            return PathState(math.nan, math.nan, math.nan)
        state = np.empty(3)  # others may look while the cycle runs
        path_kernels.path_at(self._path, tau, state)
        return PathState(*state.tolist())

    def motion(self, tau: float) -> Motion:
        """Return what is commanded at ``tau`` [s after its begin]; NaN before it, and if that is NaN."""
        n = self.trajectory.n_joints
        out = np.empty((4, n))
        if not tau >= self._leaves_at:
            b, c = self.trajectory.kernel_breaks, self.trajectory.kernel_coefficients
            path_kernels.motion_at(self._path, b, c, tau, self._state, out)
        else:
            axis_kernels.axes_at(self._axes, n, tau - self._leaves_at, out)
        out.flags.writeable = False  # it is compared with what is commanded later
        q, dq, ddq, _ = out
        return Motion(q, dq, ddq)
