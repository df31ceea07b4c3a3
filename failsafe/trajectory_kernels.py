"""Compiled piecewise polynomials: normal equations of their fit, derivatives, bounds of these over stretches.

Notation as in docs/method.md, section 2: s is the path parameter [s], ' = d/ds, a dot is d/dt.
A trajectory is ``breaks (M+1,)`` and ``coefficients (M, 6, n)``: powers of (s - break), lowest first.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

EPS = 2.220446049250313e-16
"""Distance from 1 to the next larger double."""
_SPAN_SLACK = 1e-8
"""How far before its span [s] a stretch may begin: more than the roundings of a path parameter up to 1e6
s."""


@njit(cache=True, error_model="numpy")
def accumulate_normal_equations(
    basis: Array, first: NDArray[np.int64], q: Array, band: Array, right: Array
) -> None:
    """Add BᵀB to ``band (k+1, N)`` (lower form) and Bᵀq to ``right (N, J)``.

    Row i of the design matrix B has ``basis[i] (k+1,)`` in the columns from ``first[i]`` on.
    """
    for i in range(basis.shape[0]):
        column = first[i]
        for r in range(basis.shape[1]):
            b = basis[i, r]
            for c in range(r + 1):
                band[r - c, column + c] += b * basis[i, c]
            for j in range(q.shape[1]):
                right[column + r, j] += b * q[i, j]


@njit(cache=True, error_model="numpy")
def locate(breaks: Array, s: float) -> int:
    """Return the span that holds ``s``; the first or last one outside."""
    low = 0
    high = breaks.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if s >= breaks[middle]:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, error_model="numpy")
def evaluate(breaks: Array, coefficients: Array, s: float, out: Array) -> None:
    """Write q, q', q'', q''' at ``s`` into the rows of ``out (>= 4, >= n)``."""
    m = locate(breaks, s)
    x = s - breaks[m]
    for i in range(coefficients.shape[2]):
        c0, c1, c2 = coefficients[m, 0, i], coefficients[m, 1, i], coefficients[m, 2, i]
        c3, c4, c5 = coefficients[m, 3, i], coefficients[m, 4, i], coefficients[m, 5, i]
        out[0, i] = c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
        out[1, i] = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
        out[2, i] = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))
        out[3, i] = 6.0 * c3 + x * (24.0 * c4 + x * 60.0 * c5)


@njit(cache=True, error_model="numpy")
def _span_bounds(c: Array, x0: float, x1: float, join: bool, lo: Array, hi: Array) -> None:
    """Bound q … q''' of one span with coefficients ``c (6, n)`` over x in [x0, x1]; ``join``: take the union.

    Taylor form about the centre; even powers of the offset are one-sided. Widened by 32 roundings of the sum
    of all terms' magnitudes, more than the operations below can lose.
    """
    middle = 0.5 * (x0 + x1)
    far = max(abs(x0), abs(x1))
    w = 0.5 * (x1 - x0) + 4.0 * EPS * far
    w2 = w * w
    for i in range(c.shape[1]):
        c0, c1, c2, c3, c4, c5 = c[0, i], c[1, i], c[2, i], c[3, i], c[4, i], c[5, i]
        # Taylor coefficients about the centre
        t0 = c0 + middle * (c1 + middle * (c2 + middle * (c3 + middle * (c4 + middle * c5))))
        t1 = c1 + middle * (2.0 * c2 + middle * (3.0 * c3 + middle * (4.0 * c4 + middle * 5.0 * c5)))
        t2 = c2 + middle * (3.0 * c3 + middle * (6.0 * c4 + middle * 10.0 * c5))
        t3 = c3 + middle * (4.0 * c4 + middle * 10.0 * c5)
        t4 = c4 + middle * 5.0 * c5
        t5 = c5
        b1, b2, b3, b4, b5 = abs(c1), abs(c2), abs(c3), abs(c4), abs(c5)
        s0 = abs(c0) + far * (b1 + far * (b2 + far * (b3 + far * (b4 + far * b5))))
        s1 = b1 + far * (2.0 * b2 + far * (3.0 * b3 + far * (4.0 * b4 + far * 5.0 * b5)))
        s2 = 2.0 * b2 + far * (6.0 * b3 + far * (12.0 * b4 + far * 20.0 * b5))
        s3 = 6.0 * b3 + far * (24.0 * b4 + far * 60.0 * b5)

        odd = w * (abs(t1) + w2 * (abs(t3) + w2 * abs(t5))) + 32.0 * EPS * s0
        up = w2 * (max(t2, 0.0) + w2 * max(t4, 0.0))
        down = w2 * (min(t2, 0.0) + w2 * min(t4, 0.0))
        lo0, hi0 = t0 + down - odd, t0 + up + odd
        odd = w * (2.0 * abs(t2) + w2 * 4.0 * abs(t4)) + 32.0 * EPS * s1
        up = w2 * (3.0 * max(t3, 0.0) + w2 * 5.0 * max(t5, 0.0))
        down = w2 * (3.0 * min(t3, 0.0) + w2 * 5.0 * min(t5, 0.0))
        lo1, hi1 = t1 + down - odd, t1 + up + odd
        odd = w * (6.0 * abs(t3) + w2 * 20.0 * abs(t5)) + 32.0 * EPS * s2
        up, down = w2 * 12.0 * max(t4, 0.0), w2 * 12.0 * min(t4, 0.0)
        lo2, hi2 = 2.0 * t2 + down - odd, 2.0 * t2 + up + odd
        odd = w * 24.0 * abs(t4) + 32.0 * EPS * s3
        up, down = w2 * 60.0 * max(t5, 0.0), w2 * 60.0 * min(t5, 0.0)
        lo3, hi3 = 6.0 * t3 + down - odd, 6.0 * t3 + up + odd
        if join:
            # np.minimum keeps NaN, min() may lose it
            lo[0, i], hi[0, i] = np.minimum(lo[0, i], lo0), np.maximum(hi[0, i], hi0)
            lo[1, i], hi[1, i] = np.minimum(lo[1, i], lo1), np.maximum(hi[1, i], hi1)
            lo[2, i], hi[2, i] = np.minimum(lo[2, i], lo2), np.maximum(hi[2, i], hi2)
            lo[3, i], hi[3, i] = np.minimum(lo[3, i], lo3), np.maximum(hi[3, i], hi3)
        else:
            lo[0, i], hi[0, i], lo[1, i], hi[1, i] = lo0, hi0, lo1, hi1
            lo[2, i], hi[2, i], lo[3, i], hi[3, i] = lo2, hi2, lo3, hi3


@njit(cache=True, error_model="numpy")
def derivative_bounds(
    breaks: Array, coefficients: Array, first: int, s0: float, s1: float, lo: Array, hi: Array
) -> int:
    """Enclose q, q', q'', q''' over [s0, s1] in the rows of ``lo, hi (>= 4, >= n)``; return the span of s1.

    ``first`` is the span that holds ``s0``. Outside the first and last break the end polynomials go on. NaN
    if ``first`` is another span, or a break is not a number.
    """
    last = breaks.shape[0] - 2
    m = first
    known = (first == 0 or breaks[first] <= s0 + _SPAN_SLACK) and (first == last or s0 <= breaks[first + 1])
    end = s1 if m == last else min(s1, breaks[m + 1])
    _span_bounds(coefficients[m], s0 - breaks[m], end - breaks[m], False, lo, hi)
    while m < last and s1 > breaks[m + 1]:
        m += 1
        end = s1 if m == last else min(s1, breaks[m + 1])
        _span_bounds(coefficients[m], 0.0, end - breaks[m], True, lo, hi)
    if not (known and (m == last or s1 <= breaks[m + 1])):
        lo[:] = np.nan
        hi[:] = np.nan
    return m


@njit(cache=True, error_model="numpy")
def bounds_of_stretches(
    breaks: Array, coefficients: Array, begin: Array, end: Array, lo: Array, hi: Array
) -> None:
    """Enclose q and three derivatives over each stretch ``begin, end (C,)`` in ``lo, hi (C, 4, n)``."""
    for c in range(begin.shape[0]):
        derivative_bounds(breaks, coefficients, locate(breaks, begin[c]), begin[c], end[c], lo[c], hi[c])
