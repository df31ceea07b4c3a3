"""A path of straight lines as motion: corners are rounded, and it takes its time within the limits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.timing import in_time
from modes.settings import require_numbers
from robots.errors import SetupError
from robots.limits import JointLimits

Array = NDArray[np.float64]
ROUNDING_RAD = 0.3

MOST_OF_LINE = 0.45
"""Of a line that a corner at one end of it may take."""
_TIMES = np.arange(1.0, 6.0)[:, None]
_SHARE, _SHARE_OF_JERK = 0.75, 0.5
"""Of velocities and accelerations, and of jerks: the rest is for the stops that follow. With three quarters
of the jerk throughout a ramp, a supervisor finds no stop for the first cycle from rest."""
_APART_RAD, _STILL_S = 1e-9, 0.1


class RoundedPath:
    """Straight lines from configuration to configuration, with corners that are rounded by quartics.

    Parameters
    ----------
    points:
        ``(k, n)`` configurations, no two neighbours equal.
    rounding_rad:
        From so far before a corner to so far after it the path leaves the lines [rad]; one for all, or one
        for each corner ``(k - 2,)``. Less on short lines.

    Attributes
    ----------
    length:
        Of the parameter: about the length of the path [rad].
    breaks, coefficients:
        ``(2k - 2,)`` and ``(2k - 3, 6, n)``: lines and corners in turn, powers of what is beyond each break.

    Raises
    ------
    SetupError
        A rounding is no number above 0.
    """

    def __init__(self, points: Array, rounding_rad: float | Array) -> None:
        ways = np.diff(points, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        units = ways / lengths[:, None]
        wanted = np.broadcast_to(np.asarray(rounding_rad, dtype=float), (len(points) - 2,))
        if not (wanted > 0.0).all():
            raise SetupError(f"motion: rounding_rad = {np.min(wanted):g} should be a number above 0")
        corners = zip(wanted.tolist(), itertools.pairwise(lengths.tolist()), strict=True)
        near = [0.0, *(min(r, MOST_OF_LINE * a, MOST_OF_LINE * b) for r, (a, b) in corners), 0.0]
        breaks, pieces = [0.0], []
        for k, length in enumerate(lengths.tolist()):
            straight = length - near[k] - near[k + 1]
            line = np.zeros((6, points.shape[1]))
            line[0], line[1] = points[k] + near[k] * units[k], units[k]
            pieces.append(line)
            breaks.append(breaks[-1] + straight)
            if k + 1 < len(lengths):
                end = breaks[-1] + 2.0 * near[k + 1]
                begin, h = line[0] + straight * units[k], end - breaks[-1]  # as it is between the breaks
                pieces.append(_corner(begin, units[k], units[k + 1], h))
                breaks.append(end)
        self.breaks, self.coefficients = np.array(breaks), np.array(pieces)
        self.length = breaks[-1]

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Return place and its first two derivatives (n,) by the parameter ``s`` in 0 to ``length``."""
        k = min(int(np.searchsorted(self.breaks[1:], s)), len(self.coefficients) - 1)
        c, x = self.coefficients[k], s - self.breaks[k]
        powers = x ** np.arange(6)
        first = _TIMES[:5] * c[1:]
        second = _TIMES[:4] * first[1:]
        return powers @ c, powers[:5] @ first, powers[:4] @ second


def _corner(a: Array, u: Array, v: Array, h: float) -> Array:
    """Return the curve (6, n) from ``a`` along ``u`` to along ``v``, straight at both ends.

    Both ends are half of ``h`` from where the lines meet; so the quintic through them has no fifth power.
    """
    w, zero = v - u, np.zeros_like(a)
    return np.array([a, u, zero, w / h**2, -0.5 * w / h**3, zero])


def motion_along(
    points: Array, limits: JointLimits, rounding_rad: float | Array = ROUNDING_RAD
) -> IntendedTrajectory:
    """Return motion from rest to rest along ``points`` (k, n) (:func:`modes.planning.timing.in_time`).

    Within three quarters of the limits of velocity and acceleration, and half of those of jerk. Of points
    that are the same but for rounding, one is kept; where none is left but one, it stays there for 0.1 s.

    Raises
    ------
    SetupError
        Points or roundings are no finite numbers, or do not fit the limits.
    """
    kept = apart(require_numbers("motion: points", points, (-1, len(limits.velocity))), "motion: points")
    if len(kept) < 2:
        still = np.zeros((1, 6, kept.shape[1]))
        still[0, 0] = kept[0]
        return IntendedTrajectory([0.0, _STILL_S], still, "rest")
    path = RoundedPath(kept, rounding_rad)
    within = replace(
        limits,
        velocity=_SHARE * limits.velocity,
        acceleration=_SHARE * limits.acceleration,
        jerk=_SHARE_OF_JERK * limits.jerk,
    )
    return in_time(path.breaks, path.coefficients, within)


def apart(points: Array, name: str) -> Array:
    """Return ``points`` (k, n) without those that are the one before but for rounding; both ends stay.

    Raises
    ------
    SetupError
        There is none.
    """
    if not len(points):
        raise SetupError(f"{name} should be at least one")
    kept = [points[0]]
    for q in points[1:]:
        if np.linalg.norm(q - kept[-1]) > _APART_RAD:
            kept.append(q)
    if len(kept) > 1:
        kept[-1] = points[-1]
    return np.array(kept)
