"""Motion along a path whose rounded corners are proven to keep the clearance, too.

Rounded corners leave the lines that were proven clear. Each is rounded less until it is proven, and the arm
rests at a corner where that does not help: then it does not leave the lines.
"""

from __future__ import annotations

import itertools
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.motion import MOST_OF_LINE, ROUNDING_RAD, RoundedPath, apart, motion_along
from modes.planning.polynomials import control_values
from modes.planning.potential_field import MOTION_SLACK_M, Bodies, Field
from modes.settings import require_number, require_numbers

Array = NDArray[np.float64]

_LEAST_ROUNDING_RAD = 0.05
"""At a corner that would be rounded less, the arm rests: it would creep around it."""
_ROUNDING = 1e-9


class NoMotion(Enum):
    """Why there is no motion."""

    NOT_PROVEN = "lines of the path are not proven to keep the clearance"


class Motion(NamedTuple):
    """What came of it.

    Attributes
    ----------
    trajectory:
        From rest to rest; ``None``: none.
    reason:
        Why not.
    rounding:
        ``(k - 2,)`` how much each corner is rounded [rad]; 0: the arm rests there.
    """

    trajectory: IntendedTrajectory | None
    reason: NoMotion | None
    rounding: Array


def plan_motion(
    field: Field,
    path: Array,
    bodies: Bodies,
    rounding_rad: float = ROUNDING_RAD,
    slack_m: float = MOTION_SLACK_M,
) -> Motion:
    """Return motion along ``path`` (k, n) that is proven to keep the clearance less ``slack_m`` [m].

    It also stays within the position limits. For a path of a :class:`~modes.planning.arrt.Planner` among the
    same bodies there is one, as long as the slack is twice that of its edges, which is the default. Balls
    that the path avoids are not looked at: rounded corners may enter them by less than their rounding.

    Raises
    ------
    SetupError
        The path does not fit the arm, or a number is out of its range.
    """
    require_number("motion: rounding_rad", rounding_rad, 0.0, 10.0, above=True)
    points = apart(require_numbers("motion: path", path, (-1, len(field.robot.joints))), "motion: path")
    lines = MOST_OF_LINE * np.linalg.norm(np.diff(points, axis=0), axis=1)
    rounding = _rounded(np.minimum(rounding_rad, np.minimum(lines[:-1], lines[1:])))
    for k in range(len(rounding)):
        while rounding[k] > 0.0 and not _corner_is_clear(
            field, points[k : k + 3], rounding[k], bodies, slack_m
        ):
            rounding[k] = _rounded(0.5 * rounding[k])
    while True:
        found = _with_rests(points, field, rounding)
        if _is_within(found, field) and field.is_clear_along(found, bodies, slack_m):
            return Motion(found, None, rounding)
        if not rounding.any():
            return Motion(None, NoMotion.NOT_PROVEN, rounding)
        rounding = _rounded(0.5 * rounding)


def _rounded(wanted: Array) -> Array:
    """Return roundings [rad], 0 where they are too small to be driven."""
    return np.where(wanted < _LEAST_ROUNDING_RAD, 0.0, wanted)


def _corner_is_clear(field: Field, points: Array, rounding: float, bodies: Bodies, slack_m: float) -> bool:
    """Whether the rounded corner at the second of three points is proven, less half of the slack."""
    path = RoundedPath(points, rounding)
    begin, end = path.breaks[1:3].tolist()
    ends = np.array([0.0, end - begin])
    return field.clear_up_to(ends, path.coefficients[1:2], bodies, 0.5 * slack_m) >= float(ends[1])


def _with_rests(points: Array, field: Field, rounding: Array) -> IntendedTrajectory:
    """Return motion that rests at both ends, and at corners that are not rounded."""
    limits = field.robot.limits
    stops = [0, *(np.flatnonzero(rounding == 0.0) + 1).tolist(), max(len(points) - 1, 1)]
    parts = [
        motion_along(points[a : b + 1], limits, rounding[a : b - 1]) for a, b in itertools.pairwise(stops)
    ]
    if len(parts) == 1:
        return parts[0]
    begins = np.cumsum([0.0, *(each.s_end for each in parts)])
    breaks = [each.breaks[:-1] + begin for each, begin in zip(parts, begins.tolist(), strict=False)]
    return IntendedTrajectory(
        np.append(np.concatenate(breaks), begins[-1]),
        np.concatenate([each.coefficients for each in parts]),
        "rest",
    )


def _is_within(motion: IntendedTrajectory, field: Field) -> bool:
    """Whether a motion stays within the position limits, but for rounding."""
    between = control_values(np.diff(motion.breaks), motion.coefficients)
    low, high = field.robot.limits.position_lower - _ROUNDING, field.robot.limits.position_upper + _ROUNDING
    return bool((between >= low).all() and (between <= high).all())
