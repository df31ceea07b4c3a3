"""Capsules around the parts of people, from points that were seen; for modes, which advise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Part, Point, Profile
from occupancy.humans.options import HANDS, SEGMENTS
from robots.errors import SetupError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Capsules:
    """Axes from ``a`` to ``b`` ``(k, 3)`` [m] and radii ``(k,)`` [m]."""

    a: Array
    b: Array
    radius: Array


def around_parts(xyz: Array, parts: tuple[Part, ...], profile: Profile) -> Capsules:
    """Return capsules around the parts of people, points ``xyz (people, 20, 3)`` [m], NaN: not seen.

    A part of which one end is seen is a ball there; one of which none is, is left out: this is advice.

    Raises
    ------
    SetupError
        ``xyz`` has another shape.
    """
    if xyz.ndim != 3 or xyz.shape[1:] != (MAX_POINTS, 3):
        raise SetupError(f"points of shape {xyz.shape} should be (people, 20, 3)")
    a, b, radius = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)]
    for part in parts:
        begin, end = _ends(part, xyz)
        seen = np.isfinite(begin).all(axis=1)
        a.append(begin[seen])
        b.append(end[seen])
        radius.append(np.full(int(seen.sum()), profile.radius[part]))
    return Capsules(np.concatenate(a), np.concatenate(b), np.concatenate(radius))


def _ends(part: Part, xyz: Array) -> tuple[Array, Array]:
    """Return both ends (people, 3) of a part; where one is not seen the other one twice."""
    points: tuple[Point, ...] = HANDS.get(part, SEGMENTS[part])
    first = xyz[:, points[0]]
    for point in points[1:]:
        first = np.where(np.isfinite(first), first, xyz[:, point])
    last = xyz[:, points[-1]]
    return first, np.where(np.isfinite(last), last, first)
