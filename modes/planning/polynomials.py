"""What pieces of polynomials stay between."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def control_values(spans: Array, coefficients: Array) -> Array:
    """Return the Bernstein coefficients (M, d+1, n) of pieces; each stays between its least and largest.

    ``spans`` (M,) are lengths of the pieces, ``coefficients`` (M, d+1, n) powers of what goes beyond their
    begin, lowest first.
    """
    d = coefficients.shape[1] - 1
    ratios = [[math.comb(i, k) / math.comb(d, k) for k in range(d + 1)] for i in range(d + 1)]
    powers = spans[:, None] ** np.arange(d + 1)
    return np.asarray(np.array(ratios) @ (powers[:, :, None] * coefficients))


def speed_bounds(spans: Array, coefficients: Array) -> Array:
    """Return bounds (M, n) on the speeds of pieces, as in :func:`control_values`."""
    speeds = coefficients[:, 1:] * np.arange(1.0, coefficients.shape[1])[:, None]
    return np.asarray(np.abs(control_values(spans, speeds)).max(axis=1))
