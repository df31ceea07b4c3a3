"""How far link points can come from each joint's axis, over all configurations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError
from robots.limits import Array
from robots.motion import MAX_JOINTS

_ROUNDING = 1e-9
_SKEW = 1e-3


@dataclass(frozen=True)
class _Drum:
    """Points within ``radius`` [m] of the line origin + z·axis, z in [low, high], and in a ball."""

    origin: Array
    axis: Array
    radius: float
    low: float
    high: float
    centre: Array
    ball: float


def reach(
    kinematics: NDArray[np.void], lower: Array, upper: Array, joint: int, points: Array
) -> NDArray[np.float64]:
    """Bound the distance of ``points`` (P, 3) [m], fixed in the frame of ``joint``, from every joint's axis.

    Returns (16,) [m]: for each revolute joint that moves the points an upper bound over all configurations;
    1 for prismatic joints, whose stroke ``[lower, upper]`` widens the bounds of the joints before them; 0 for
    joints that do not move the points.

    The positions that a point can take relative to joint k, turned about k's axis, fill a drum around it and
    lie in a ball around its origin. Seen from the joint before, they lie in a drum about its axis and a ball
    around its origin, and so on to the base. Exact where axes are parallel, or orthogonal and meet; an
    over-estimate otherwise, never above the sum of lengths and strokes between joint and point.
    """
    bound = np.zeros(MAX_JOINTS)
    for point in points:
        bound = np.maximum(bound, _reach_of_point(kinematics, lower, upper, joint, point))
    return bound


def _reach_of_point(
    kinematics: NDArray[np.void], lower: Array, upper: Array, joint: int, point: Array
) -> Array:
    tree = kinematics[0]
    bound = np.zeros(MAX_JOINTS)
    place = np.asarray(point, dtype=np.float64)
    drum = _Drum(place, tree["axis"][joint], 0.0, 0.0, 0.0, place, 0.0)
    k = joint
    while k >= 0:
        drum = _about_axis(drum, tree["axis"][k])
        if tree["prismatic"][k]:
            drum = _slid(drum, float(lower[k]), float(upper[k]))
            bound[k] = 1.0
        else:
            bound[k] = drum.radius + _ROUNDING
        rotation, translation = tree["rotation"][k], tree["translation"][k]
        origin, centre = (rotation @ place + translation for place in (drum.origin, drum.centre))
        drum = replace(drum, origin=origin, axis=rotation @ drum.axis, centre=centre)
        k = int(tree["parent"][k])
    return bound


def _slid(drum: _Drum, lower: float, upper: float) -> _Drum:
    """Let a drum about a sliding joint's axis move along it."""
    if not (np.isfinite(lower) and np.isfinite(upper)):
        raise SetupError("a prismatic joint needs finite position limits: its stroke is part of the reach")
    stroke = max(abs(lower), abs(upper))
    return replace(drum, low=drum.low + lower, high=drum.high + upper, ball=drum.ball + stroke)


def _about_axis(drum: _Drum, axis: Array) -> _Drum:
    """Enclose a drum in a drum about the line through 0 along the unit vector ``axis`` and a ball around 0.

    Radial: the distance from the line is convex, so its maximum lies on one of the two rims c + radius·e with
    e ⊥ the drum's axis u. Seen along ``axis`` a rim is an ellipse, half-axes radius along u × axis and
    radius·|u·axis| across; bounded by its circle and by its box, the smaller one counts. Axial: exact. What
    the ball allows cuts all three down.
    """
    cosine = min(1.0, abs(float(drum.axis @ axis)))
    sine = float(np.linalg.norm(np.cross(drum.axis, axis)))
    side = np.cross(drum.axis, axis) / sine if sine > _SKEW else np.zeros(3)
    radius, low, high, farthest = 0.0, np.inf, -np.inf, 0.0
    for z in (drum.low, drum.high):
        rim_centre = drum.origin + z * drum.axis
        height = float(rim_centre @ axis)
        across = rim_centre - height * axis
        rim = float(np.linalg.norm(across)) + drum.radius
        if sine > _SKEW:
            x = float(across @ side)
            y = float(np.linalg.norm(across - x * side))
            rim = min(rim, float(np.hypot(abs(x) + drum.radius, y + cosine * drum.radius)))
        radius = max(radius, rim)
        low, high = min(low, height - sine * drum.radius), max(high, height + sine * drum.radius)
        along = float(rim_centre @ drum.axis)
        beside = float(np.linalg.norm(rim_centre - along * drum.axis)) + drum.radius
        farthest = max(farthest, float(np.hypot(along, beside)))
    height = float(drum.centre @ axis)
    ball = min(farthest, float(np.linalg.norm(drum.centre)) + drum.ball)
    radius = min(radius, ball, float(np.linalg.norm(drum.centre - height * axis)) + drum.ball)
    low = max(low, -ball, height - drum.ball)
    high = min(high, ball, height + drum.ball)
    return _Drum(np.zeros(3), axis, radius, low, max(low, high), np.zeros(3), ball)
