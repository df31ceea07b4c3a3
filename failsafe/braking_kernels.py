"""Compiled slices of a measured stop; what they stand for: :mod:`failsafe.braking`.

On each slice a joint is somewhere between what its bounds of speed allow, forwards and backwards from where
it was told to stop. The slices follow a motion in the middle, whose velocity changes linearly from node to
node; ``q_spread`` and ``dq_spread`` reach from it to both ends.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]

_OUTWARD = 1.0 + 1e-9
_TINY = 1e-12
"""What roundings may take off a bound, relative and absolute [rad, rad/s; m, m/s]."""


@njit(cache=True, error_model="numpy")
def speed_after(speed: float, delay: float, brakes: float, elapsed: float) -> float:
    """Largest speed ``elapsed`` [s] after the arm was told, of ``speed`` that it brakes in ``brakes`` [s]."""
    braking = elapsed - delay
    if braking <= 0.0 or speed == 0.0:
        return speed
    if braking >= brakes:
        return 0.0
    return speed * (1.0 - braking / brakes)


@njit(cache=True, error_model="numpy")
def way_after(speed: float, delay: float, brakes: float, elapsed: float) -> float:
    """How far a joint may get in ``elapsed`` [s]; see :func:`speed_after`."""
    if speed == 0.0:
        return 0.0
    braking = min(max(elapsed - delay, 0.0), brakes)
    share = 0.5 * braking / brakes if braking > 0.0 else 0.0
    return speed * (min(elapsed, delay) + braking * (1.0 - share))


@njit(cache=True, error_model="numpy")
def _lasts(up: Array, down: Array, delay: float, brakes: Array, n: int) -> float:
    """How long [s] until every joint rests; ``brakes (2, n)``: how long each may brake, up and down."""
    end = 0.0
    for j in range(n):
        if up[j] != 0.0:
            end = np.maximum(end, delay + brakes[0, j] + 0.0 * up[j])  # not finite if the speed is not
        if down[j] != 0.0:
            end = np.maximum(end, delay + brakes[1, j] + 0.0 * down[j])
    return float(end)


@njit(cache=True, error_model="numpy")
def _write_row(
    slices: Block, row: int, first: int, up: Array, down: Array, delay: float, brakes: Array, last: bool
) -> bool:
    """Write slice ``row`` and the node at its end, of which ``t`` is there; tell whether it is finite."""
    plan = slices[0]
    begin = plan.t[first]
    x0, x1 = plan.t[row] - begin, plan.t[row + 1] - begin
    h = x1 - x0
    ok = h > 0.0
    for j in range(plan.n_joints):
        u0, w0 = speed_after(up[j], delay, brakes[0, j], x0), speed_after(down[j], delay, brakes[1, j], x0)
        u1, w1 = speed_after(up[j], delay, brakes[0, j], x1), speed_after(down[j], delay, brakes[1, j], x1)
        c0, c1 = plan.dq[row, j], 0.0 if last else 0.5 * (u1 - w1)
        slowest, fastest = np.minimum(c0, c1), np.maximum(c0, c1)
        faster = np.maximum(u0 - slowest, fastest + w0)
        q0 = plan.q[row, j]
        q1 = q0 + 0.5 * h * (c0 + c1)
        away = 0.0
        for x, q in ((x0, q0), (x1, q1)):
            moved = q - plan.q[first, j]
            away = np.maximum(away, way_after(up[j], delay, brakes[0, j], x) - moved)
            away = np.maximum(away, moved + way_after(down[j], delay, brakes[1, j], x))
        plan.q_spread[row, j] = (away + 0.5 * h * faster) * _OUTWARD + _TINY * (1.0 + abs(q0))
        plan.dq_spread[row, j] = faster * _OUTWARD + _TINY
        plan.dq_max[row, j] = np.maximum(abs(c0), abs(c1)) * _OUTWARD
        plan.ddq_max[row, j] = abs(c1 - c0) / h * _OUTWARD
        plan.q[row + 1, j], plan.dq[row + 1, j], plan.ddq[row + 1, j] = q1, c1, (c1 - c0) / h
        ok = ok and plan.q_spread[row, j] < np.inf and plan.ddq_max[row, j] < np.inf
    return bool(ok)


@njit(cache=True, error_model="numpy")
def append_braking(
    slices: Block, up: Array, down: Array, delay: float, brakes: Array, length: float
) -> float:
    """Append a measured stop from the last node on, in slices of about ``length`` [s].

    ``up, down (n,)``: largest speeds while it goes on, forwards and backwards, ≥ 0 and not below that of the
    last node; ``brakes (2, n)`` [s]. Returns how long it lasts [s]; NaN, with no slice left, where there is
    no room or a bound is not finite.
    """
    plan = slices[0]
    first = plan.n
    plan.q_spread[:] = 0.0
    plan.dq_spread[:] = 0.0
    plan.n = 0
    end = _lasts(up, down, delay, brakes, plan.n_joints) * _OUTWARD
    rows = MAX_SLICES - first
    if not (end < np.inf and first >= 0 and rows > 0):
        return np.nan
    if end > 0.0:
        rows = min(rows, max(1, int(np.ceil(end / length))))
        for k in range(rows):
            row = first + k
            plan.t[row + 1] = plan.t[first] + end * (k + 1) / rows
            if not _write_row(slices, row, first, up, down, delay, brakes, k == rows - 1):
                return np.nan
        plan.n = first + rows
    else:
        plan.n = first
    return end
