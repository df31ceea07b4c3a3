"""Compiled parts that several modes share."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots import kernels

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def jacobian(
    kinematics: NDArray[np.void],
    q: Array,
    local: Array,
    rotations: Array,
    positions: Array,
    place: Array,
    out: Array,
) -> None:
    """Write the Jacobian ``out`` (6, n), linear then angular, of ``local`` (3,) [m] in the last frame.

    ``place`` (3,) [m] is that of the point; ``rotations`` (n, 3, 3) and ``positions`` (n, 3) [m] are written
    too, for ``q`` (n,).
    """
    n = len(positions)
    kernels.forward(kinematics, q, rotations, positions)
    arm = np.zeros(3)
    for r in range(3):
        for c in range(3):
            arm[r] += rotations[n - 1, r, c] * local[c]
        place[r] = positions[n - 1, r] + arm[r]
    unit, angular, linear = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
    for j in range(n):
        unit[:] = 0.0
        unit[j] = 1.0
        kernels.velocities(kinematics, unit, rotations, positions, angular, linear)
        w = angular[n - 1]
        out[0, j] = linear[n - 1, 0] + w[1] * arm[2] - w[2] * arm[1]
        out[1, j] = linear[n - 1, 1] + w[2] * arm[0] - w[0] * arm[2]
        out[2, j] = linear[n - 1, 2] + w[0] * arm[1] - w[1] * arm[0]
        for r in range(3):
            out[3 + r, j] = w[r]
