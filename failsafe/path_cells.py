"""A path cut into cells of equal length: slices in which the path parameter takes the place of time."""

from __future__ import annotations

import math

import numpy as np

from failsafe import limit_kernels, path_kernels, slice_kernels
from failsafe.trajectory import IntendedTrajectory
from robots.motion import MAX_SLICES, Block


class PathCells:
    """Writes stretches of a path into a slice block, ``t`` being s [s] and ṡ = 1.

    Parameters
    ----------
    trajectory:
        The path.
    length:
        Of a cell [s].

    Attributes
    ----------
    count:
        Cells from the begin of the path to its end; the last one goes beyond it.
    """

    def __init__(self, trajectory: IntendedTrajectory, length: float) -> None:
        self.trajectory = trajectory
        self.length = length
        self.begin = float(trajectory.s_begin)
        self.count = max(1, math.ceil((float(trajectory.s_end) - self.begin) / length))
        self._path: Block = np.zeros(1, dtype=path_kernels.PATH)
        self._work: Block = np.zeros(1, dtype=limit_kernels.WORK)
        self._unlimited = np.full((5, trajectory.n_joints), np.inf)

    def write(self, first: int, out: Block) -> int:
        """Write cells from ``first`` on into ``out``, at most 64; return how many."""
        path, trajectory = self._path, self.trajectory
        n = min(MAX_SLICES, self.count - first)
        begin = self.begin + first * self.length
        path_kernels.begin_path(path, begin, 1.0, 0.0, n * self.length)
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        slice_kernels.write_path_slices(path, b, c, self._unlimited, begin, self.length, out, self._work)
        return int(out["n"][0])
