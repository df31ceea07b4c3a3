"""Joint motion as quintics through instants at which place, velocity and acceleration are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory

Array = NDArray[np.float64]


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
