"""How far link points can come from each joint's axis, over all configurations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError
from robots.limits import Array
from robots.motion import MAX_JOINTS

_ROUNDING = 1e-9
_SKEW = 1e-3


@dataclass(frozen=True)
class _Drum:
    """Points within ``radius`` [m] of the line origin + z·axis, with z in [low, high] [m]."""

    origin: Array
    axis: Array
    radius: float
    low: float
    high: float


def reach(
    kinematics: NDArray[np.void], lower: Array, upper: Array, joint: int, points: Array
) -> NDArray[np.float64]:
    """Bound the distance of ``points`` (P, 3) [m], fixed in the frame of ``joint``, from every joint's axis.

    Returns (16,) [m]: for each revolute joint that moves the points an upper bound over all configurations;
    1 for prismatic joints, whose stroke ``[lower, upper]`` widens the bounds of the joints before them; 0 for
    joints that do not move the points.

    The positions that a point can take relative to joint k, turned about k's axis, fill a drum. Seen from the
    joint before, that drum is enclosed in a drum about its axis, and so on to the base; exact where
    consecutive axes are parallel or orthogonal, an over-estimate otherwise.
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
    drum = _Drum(np.asarray(point, dtype=np.float64), tree["axis"][joint], 0.0, 0.0, 0.0)
    k = joint
    while k >= 0:
        axis = tree["axis"][k]
        drum = _about_axis(drum, axis)
        if tree["prismatic"][k]:
            if not (np.isfinite(lower[k]) and np.isfinite(upper[k])):
                raise SetupError(
                    "a prismatic joint needs finite position limits: its stroke is part of the reach"
                )
            drum = _Drum(drum.origin, drum.axis, drum.radius, drum.low + lower[k], drum.high + upper[k])
            bound[k] = 1.0
        else:
            bound[k] = drum.radius + _ROUNDING
        rotation, translation = tree["rotation"][k], tree["translation"][k]
        drum = _Drum(
            rotation @ drum.origin + translation, rotation @ drum.axis, drum.radius, drum.low, drum.high
        )
        k = int(tree["parent"][k])
    return bound


def _about_axis(drum: _Drum, axis: Array) -> _Drum:
    """Enclose a drum in a drum about the line through 0 along the unit vector ``axis``.

    Radial: the distance from the line is convex, so its maximum lies on one of the two rims c + radius·e with
    e ⊥ the drum's axis u. Seen along ``axis`` a rim is an ellipse, half-axes radius along u × axis and
    radius·|u·axis| across; bounded by its circle and by its box, the smaller one counts. Axial: exact.
    """
    cosine = min(1.0, abs(float(drum.axis @ axis)))
    sine = float(np.linalg.norm(np.cross(drum.axis, axis)))
    side = np.cross(drum.axis, axis) / sine if sine > _SKEW else np.zeros(3)
    radius, low, high = 0.0, np.inf, -np.inf
    for z in (drum.low, drum.high):
        centre = drum.origin + z * drum.axis
        height = float(centre @ axis)
        across = centre - height * axis
        distance = float(np.linalg.norm(across))
        rim = distance + drum.radius
        if sine > _SKEW:
            x = float(across @ side)
            y = float(np.linalg.norm(across - x * side))
            rim = min(rim, float(np.hypot(abs(x) + drum.radius, y + cosine * drum.radius)))
        radius = max(radius, rim)
        low, high = min(low, height - sine * drum.radius), max(high, height + sine * drum.radius)
    return _Drum(np.zeros(3), axis, radius, low, high)
