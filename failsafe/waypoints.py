"""Trajectories through waypoints, at rest in each of them: connectors, examples, tests."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits

Array = NDArray[np.float64]

# Largest derivatives of x(τ) = 10 τ³ - 15 τ⁴ + 6 τ⁵ on [0, 1]: at τ = 1/2, at τ = 1/2 ± √3/6, at both ends.
_PEAK_VELOCITY, _PEAK_ACCELERATION, _PEAK_JERK = 15.0 / 8.0, 10.0 / np.sqrt(3.0), 60.0
_SHORTEST_S = 1e-3


def rest_to_rest(
    waypoints: ArrayLike, limits: JointLimits, *, share: float = 0.75, begin: float = 0.0
) -> IntendedTrajectory:
    """Return straight lines in joint space through ``waypoints (W, n)`` [rad; m], at rest in each of them.

    Minimum-jerk quintics (Flash and Hogan 1985), each as quick as ``share`` of the limits of velocity,
    acceleration and jerk allows. ``begin`` [s]: path parameter of the first waypoint.

    Raises
    ------
    TrajectoryError
        Fewer than two waypoints, another number of joints, values that are not finite or outside the position
        limits, or a share that is not above 0 and at most 1.
    """
    q = np.array(waypoints, dtype=np.float64)
    n = len(limits.joints)
    if q.ndim != 2 or q.shape[0] < 2 or q.shape[1] != n:
        raise TrajectoryError(f"waypoints have shape {q.shape}, should be (W, {n}) with W >= 2")
    if not 0.0 < share <= 1.0:
        raise TrajectoryError(f"share {share} of the limits should be above 0 and at most 1")
    outside = ~((q >= limits.position_lower) & (q <= limits.position_upper))
    if outside.any():
        row, joint = (int(i) for i in np.argwhere(outside)[0])
        raise TrajectoryError(
            f"waypoint {row}: joint {limits.joints[joint]} at {q[row, joint]} is outside its position limits"
        )
    way = np.diff(q, axis=0)
    far = np.abs(way)
    durations = np.maximum.reduce(
        [
            (_PEAK_VELOCITY * far / (share * limits.velocity)).max(axis=1),
            np.sqrt(_PEAK_ACCELERATION * far / (share * limits.acceleration)).max(axis=1),
            np.cbrt(_PEAK_JERK * far / (share * limits.jerk)).max(axis=1),
            np.full(len(way), _SHORTEST_S),
        ]
    )
    coefficients = np.zeros((len(way), 6, n))
    coefficients[:, 0] = q[:-1]
    for power, factor in ((3, 10.0), (4, -15.0), (5, 6.0)):
        coefficients[:, power] = factor * way / durations[:, None] ** power
    breaks = begin + np.concatenate([[0.0], np.cumsum(durations)])
    return IntendedTrajectory(breaks, coefficients, "rest")


def from_motion(
    start: tuple[ArrayLike, ArrayLike, ArrayLike], goal: ArrayLike, duration: float, begin: float = 0.0
) -> IntendedTrajectory:
    """Return one quintic from a state in motion to rest at ``goal (n,)`` [rad; m], in ``duration`` [s].

    ``start``: q, q', q'' ``(n,)``, as :meth:`~failsafe.trajectory.IntendedTrajectory.sample` has them at the
    place of a trajectory where this one is to join; ``begin`` [s]: path parameter of the first point. Whether
    limits are kept depends on ``duration``, and is seen when it is proposed.

    Raises
    ------
    TrajectoryError
        Shapes that do not belong together, values that are not finite, a duration that is not positive.
    """
    q, v, a = (np.array(each, dtype=np.float64) for each in start)
    end = np.array(goal, dtype=np.float64)
    if q.ndim != 1 or not q.shape == v.shape == a.shape == end.shape:
        shapes = ", ".join(str(each.shape) for each in (q, v, a, end))
        raise TrajectoryError(f"q, q', q'' and goal have shapes {shapes}, should be (n,) each")
    if not 0.0 < duration < math.inf:
        raise TrajectoryError(f"duration of {duration} s should be positive and finite")
    T = float(duration)
    way = end - q - T * (v + 0.5 * T * a)
    speed, acceleration = -(v + T * a), -a
    coefficients = [
        q,
        v,
        0.5 * a,
        (10.0 * way - 4.0 * T * speed + 0.5 * T**2 * acceleration) / T**3,
        (-15.0 * way + 7.0 * T * speed - T**2 * acceleration) / T**4,
        (6.0 * way - 3.0 * T * speed + 0.5 * T**2 * acceleration) / T**5,
    ]
    return IntendedTrajectory([begin, begin + T], [coefficients], "rest")
