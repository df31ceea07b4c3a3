"""Hot loops of the mode: filters that run."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def advance(b: Array, a: Array, state: Array, x: Array, y: Array) -> None:
    """Take a sample ``x`` (channels,) into ``state`` (order, channels), write ``y``; a[0] is 1.

    Transposed direct form II.
    """
    last = len(state) - 1
    for c in range(len(x)):
        y[c] = b[0] * x[c] + state[0, c]
        for i in range(last):
            state[i, c] = b[i + 1] * x[c] + state[i + 1, c] - a[i + 1] * y[c]
        state[last, c] = b[last + 1] * x[c] - a[last + 1] * y[c]


@njit(cache=True, error_model="numpy")
def least_change(jacobian: Array, velocity: Array, wanted: Array, out: Array) -> None:
    """Write ``wanted + J' (J J' + δ I)⁻¹ (velocity - J wanted)``, J (3, n); δ is 0 away from singularities.

    δ rises to 1e-3 as the determinant of J J' falls below 1e-6.
    """
    n = len(wanted)
    gram = np.zeros((3, 3))
    missing = velocity.copy()
    for r in range(3):
        for j in range(n):
            missing[r] -= jacobian[r, j] * wanted[j]
        for c in range(3):
            for j in range(n):
                gram[r, c] += jacobian[r, j] * jacobian[c, j]
    share = np.linalg.det(gram) / 1e-6
    if share < 1.0:
        for r in range(3):
            gram[r, r] += 1e-3 * (1.0 - max(share, 0.0)) ** 2
    weights = np.linalg.solve(gram, missing)
    for j in range(n):
        out[j] = wanted[j]
        for r in range(3):
            out[j] += jacobian[r, j] * weights[r]
