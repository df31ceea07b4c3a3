"""Distance of convex hulls of any number of points by a solver of scipy, never taken without its proof.

The nearest point x to 0 of the hull of the differences is a solution of non-negative least squares, and
x·d >= |x|² for every difference d says that none is nearer. scipy's solution does not always meet this,
without a word; then the differences are put into another order and solved again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

ORDERS = 20
PROVEN_M = 1e-7


def hull_distance(a: Array, b: Array) -> float:
    """Distance [m] of the hulls of a (P, 3) and b (Q, 3): attained, and at most ``PROVEN_M`` above the exact
    one."""
    difference = (b[None, :, :] - a[:, None, :]).reshape(-1, 3)
    order = np.random.default_rng(0)
    for _ in range(ORDERS):
        distance, bound = solved(difference)
        if distance - bound <= PROVEN_M:
            return distance
        difference = order.permutation(difference)
    raise AssertionError(f"none of {ORDERS} solutions is proven to be the nearest")


def solved(points: Array) -> tuple[float, float]:
    """Distance from 0 that scipy finds in the hull of points (P, 3), and what its solution proves."""
    size = float(np.abs(points).max()) or 1.0
    weights, _ = nnls(np.vstack([points.T / size, np.ones(len(points))]), np.array([0.0, 0.0, 0.0, 1.0]))
    nearest = weights / weights.sum() @ points
    distance = float(np.linalg.norm(nearest))
    return distance, max(0.0, float((points @ nearest).min()) / distance) if distance > 0.0 else 0.0
