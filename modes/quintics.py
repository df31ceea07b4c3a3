"""Motion from rest to rest, and joint motion as quintics through instants at which all of it is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory

Array = NDArray[np.float64]


def rest_to_rest(t: float, length: float, duration: float, ramp: float) -> tuple[float, float, float]:
    """Return where one is at ``t`` [s] of a way of ``length`` from rest to rest, and two derivatives.

    The speed rises and falls smoothly within ``ramp`` [s] at both ends, and is constant between them;
    ``duration`` [s] is at least two ramps.
    """
    rate = length / (duration - ramp)
    if t > duration - ramp:
        s, ds, dds = rest_to_rest(duration - t, length, duration, ramp)
        return length - s, ds, -dds
    if t >= ramp:
        return rate * (t - 0.5 * ramp), rate, 0.0
    x = max(t, 0.0) / ramp
    return (
        rate * ramp * (2.5 * x**4 - 3.0 * x**5 + x**6),
        rate * (10.0 * x**3 - 15.0 * x**4 + 6.0 * x**5),
        rate / ramp * (30.0 * x**2 - 60.0 * x**3 + 30.0 * x**4),
    )


def quintics(t: Array, values: Sequence[tuple[Array, Array, Array]]) -> IntendedTrajectory:
    """Return a trajectory whose q, q', q'' (n,) at instants ``t`` (k,) [s] are ``values``; C² everywhere."""
    pieces = []
    for k, h in enumerate(np.diff(t).tolist()):
        (q0, v0, a0), (q1, v1, a1) = values[k], values[k + 1]
        d, v, a = q1 - q0 - v0 * h - 0.5 * a0 * h * h, v1 - v0 - a0 * h, a1 - a0
        pieces.append([
            q0, v0, 0.5 * a0,
            (10.0 * d - 4.0 * v * h + 0.5 * a * h * h) / h**3,
            (-15.0 * d + 7.0 * v * h - a * h * h) / h**4,
            (6.0 * d - 3.0 * v * h + 0.5 * a * h * h) / h**5,
        ])  # fmt: skip
    return IntendedTrajectory(t, np.array(pieces), "rest")
