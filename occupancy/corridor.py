"""What links occupy along a path, at whatever path speed between 0 and 1 it is driven.

Offline, neighbouring cycles drive nearly the same stretch of one path. What a link occupies there is a matter
of the path alone: the cells of a *corridor* are swept once, with the path parameter s in the place of time
(:mod:`occupancy.swept`), and contain the rows of every plan on that path:

A row of a plan is the hull of the axis' ends a, b at s_i and s_i+1, grown by radius, tracking and h²/8·A.
A point of that hull has weights w on these four ends. With λ its share on b and μ that at s_i+1 it differs
from the point λ, μ of the chords by (w_b,i+1 - λ μ) times the change of b - a over the slice, and the factor
is at most 1/4. That point of the chords is within h²/8·A of where the axis is at some instant of the slice,
and that is in the cells between s_i and s_i+1. So the row lies in these cells, grown by 2·h²/8·A and by a
quarter of the change of b - a. With A from the joint limits and h the longest slice the first holds for every
plan within the limits; so does, for the second, h times the largest |b' - a'| on the cells that such a slice
can reach. When a plan is in a cell at the latest is the end of the last of its slices that reaches into the
cell, and people only grow with time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from occupancy import corridor_kernels as kernels
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy, chains_and_strokes
from robots.model import RobotModel
from robots.motion import Block, new_slices

Array = NDArray[np.float64]
Tracking = tuple[Array, Array]
"""Bounds (J,) of the tracking error of positions and of velocities."""
_SLACK = 1e-5
"""Slices count as the longest one up to this share, and roundings are smaller."""


class Cells(Protocol):
    """A path cut into ``count`` cells of ``length`` [s] from s = ``begin`` on."""

    begin: float
    length: float
    count: int

    def write(self, first: int, out: Block) -> int:
        """Write cells from ``first`` on into a slice block, with s for time; return how many."""
        ...


class Corridor:
    """The cells of one path, swept.

    Attributes
    ----------
    begin, length:
        s of the first cell, length of each [s].
    points, radius:
        Rows of the links, (M, L, 4, 3) and (M, L) [m].
    speed:
        (M,) [m/s]: at ṡ = 1 some point of the arm is nowhere in the cell slower.
    """

    def __init__(self, cells: Cells, n_links: int) -> None:
        self.begin, self.length = cells.begin, cells.length
        self.points: Array = np.full((cells.count, n_links, 4, 3), np.nan)
        self.radius: Array = np.full((cells.count, n_links), np.nan)
        self.speed: Array = np.zeros(cells.count)


class CorridorSweep:
    """Sweeps the corridors of one arm.

    Parameters
    ----------
    model:
        The arm.
    slice_s:
        Longest slice of a plan [s].
    """

    def __init__(self, model: RobotModel, slice_s: float) -> None:
        self._model = model
        self._sweep = LinkOccupancy(model)
        self._fixed = chains_and_strokes(model)
        self._slices: Block = new_slices()
        self._links: Block = new_link_sets()
        self._slice_s = slice_s
        self._bulge: Array = np.zeros(int(model.enclosure["n"][0]))
        limits, record, n = model.limits, self._slices[0], len(model.joints)
        record["n"], record["n_joints"] = 1, n
        record["t"][1] = slice_s
        record["dq_max"][0, :n], record["ddq_max"][0, :n] = limits.velocity, limits.acceleration
        arm = (model.kinematics, model.enclosure, self._fixed)
        kernels.longest_bulge(*arm, self._slices, self._bulge)

    @property
    def possible(self) -> bool:
        """Whether every joint turns: what a joint that slides adds to a plan's rows is not in the cells."""
        return not np.any(self._model.kinematics["prismatic"][0, : len(self._model.joints)])

    def sweep(self, cells: Cells, tracking: Tracking) -> Corridor:
        """Sweep all cells of a path."""
        n_links = len(self._bulge)
        found = Corridor(cells, n_links)
        record = self._slices[0]
        for name, error in zip(("q_error", "dq_error"), tracking, strict=True):
            record[name][: len(error)] = error
        arm = (self._model.kinematics, self._model.enclosure, self._fixed)
        twist: Array = np.zeros((cells.count, n_links))
        first = 0
        while first < cells.count:
            n = cells.write(first, self._slices)
            if n == 0:
                break
            self._sweep.occupy(self._slices, self._links)
            rows = (found.points, found.radius, found.speed, twist)
            kernels.keep_cells(self._links, self._slices, *arm, self._bulge, first, *rows)
            first += n
        found.radius += self._room_to_twist(twist, cells.length)
        return found

    def _room_to_twist(self, twist: Array, length: float) -> Array:
        """Return by how much cells (M, L) are to be grown [m] for what axes turn within a slice of a plan.

        ``twist`` (M, L): bounds of |b' - a'| [m/s]. A slice that reaches into a cell reaches no farther than
        its own length beyond it.
        """
        reach = math.ceil(self._slice_s / length)
        around = np.pad(twist, ((reach, reach), (0, 0)))
        widest = sliding_window_view(around, 2 * reach + 1, axis=0).max(axis=-1)
        return np.asarray(0.25 * self._slice_s * (1.0 + _SLACK) * widest, dtype=np.float64)

    def forbid(self, corridor: Corridor, proven: Callable[[Block, Block], bool]) -> None:
        """Make those cells unusable that are not ``proven(links, slices)``, one by one."""
        slices = new_slices()
        slices["n"] = 1
        for cell in range(len(corridor.speed)):
            kernels.place_cells(cell, 1, corridor.points, corridor.radius, self._links)
            if not proven(self._links, slices):
                corridor.radius[cell] = np.nan
