"""A path of straight lines as motion: corners are rounded, and it takes its time within the limits."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.quintics import quintics, rest_to_rest
from robots.limits import JointLimits

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]
"""q, q', q'' (n,)."""

_KNOT_S, _PER_PIECE = 0.04, 21
_SHARE = 0.75
"""Of velocities, accelerations and jerks: the rest is for the stops that follow."""
_RAMP_S = 0.4


class RoundedPath:
    """Straight lines from configuration to configuration, with corners that are rounded by quintics.

    Parameters
    ----------
    points:
        ``(k, n)`` configurations, no two neighbours equal.
    rounding_rad:
        From so far before a corner to so far after it the path leaves the lines [rad]; less on short lines.

    Attributes
    ----------
    length:
        Of the parameter: about the length of the path [rad].
    """

    def __init__(self, points: Array, rounding_rad: float) -> None:
        ways = np.diff(points, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        units = ways / lengths[:, None]
        corners = itertools.pairwise(lengths.tolist())
        near = [0.0, *(min(rounding_rad, 0.45 * a, 0.45 * b) for a, b in corners), 0.0]
        self._pieces: list[tuple[float, float, Array]] = []
        begin = 0.0
        for k, length in enumerate(lengths.tolist()):
            straight = length - near[k] - near[k + 1]
            first = points[k] + near[k] * units[k]
            line = np.zeros((6, points.shape[1]))
            line[0], line[1] = first, units[k]
            self._pieces.append((begin, begin + straight, line))
            begin += straight
            if k + 1 < len(lengths):
                r = near[k + 1]
                end = points[k + 1] + r * units[k + 1]
                corner = _corner(first + straight * units[k], units[k], end, units[k + 1], 2.0 * r)
                self._pieces.append((begin, begin + 2.0 * r, corner))
                begin += 2.0 * r
        self.length = begin
        self._ends = np.array([piece[1] for piece in self._pieces])

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Return place and its first two derivatives (n,) by the parameter ``s`` in 0 to ``length``."""
        k = min(int(np.searchsorted(self._ends, s)), len(self._pieces) - 1)
        begin, _end, c = self._pieces[k]
        x = s - begin
        powers = x ** np.arange(6)
        first = np.arange(1, 6)[:, None] * c[1:]
        second = np.arange(1, 5)[:, None] * first[1:]
        return powers @ c, powers[:5] @ first, powers[:4] @ second


def _corner(a: Array, u: Array, b: Array, v: Array, h: float) -> Array:
    """Return the quintic (6, n) from ``a`` along ``u`` to ``b`` along ``v``, straight at both ends."""
    d, w = b - a - u * h, v - u
    return np.array([
        a, u, np.zeros_like(a), (10.0 * d - 4.0 * w * h) / h**3, (-15.0 * d + 7.0 * w * h) / h**4,
        (6.0 * d - 3.0 * w * h) / h**5,
    ])  # fmt: skip


def motion_along(points: Array, limits: JointLimits, rounding_rad: float = 0.3) -> IntendedTrajectory:
    """Return motion from rest to rest along ``points`` (k, n) within three quarters of the limits.

    It is as fast as one speed for the whole path allows, slower at both ends; not time-optimal.
    """
    path = RoundedPath(points, rounding_rad)
    ramp = min(_RAMP_S, path.length)
    found = _timed(path, path.length + ramp, ramp)
    return found.stretched(_slower(found, limits))


def _timed(path: RoundedPath, duration: float, ramp: float) -> IntendedTrajectory:
    knots = np.linspace(0.0, duration, max(8, math.ceil(duration / _KNOT_S)) + 1)
    values: list[State] = []
    for t in knots.tolist():
        s, ds, dds = rest_to_rest(t, path.length, duration, ramp)
        q, dq, ddq = path.at(s)
        values.append((q, ds * dq, ds * ds * ddq + dds * dq))
    return quintics(knots, values)


def _slower(motion: IntendedTrajectory, limits: JointLimits) -> float:
    """Return by how much time must be stretched for the share of the limits to be kept; below 1: may be."""
    c, h = motion.coefficients, np.diff(motion.breaks)
    x = h[:, None] * np.linspace(0.0, 1.0, _PER_PIECE)  # with both ends: q''' jumps from piece to piece
    found = []
    for d in (1, 2, 3):
        powers = np.stack([math.perm(k, d) * x ** (k - d) for k in range(d, 6)], axis=2)
        found.append(np.abs(powers @ c[:, d:]))
    dq, ddq, dddq = found
    speed = float((dq / limits.velocity).max()) / _SHARE
    acceleration = float((ddq / limits.acceleration).max()) / _SHARE
    jerk = float((dddq / limits.jerk).max()) / _SHARE
    return 1.01 * max(speed, math.sqrt(acceleration), math.cbrt(jerk))
