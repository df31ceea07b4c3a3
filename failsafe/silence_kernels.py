"""Compiled widening of a plan by the robot's own reaction to silence; derivation: :mod:`failsafe.silence`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]

AFTER_REST = 8
"""Slices that are added for the time in which the reaction may go on after the plan rests."""
_OUTWARD = 1.0 + 1e-9
_TINY = 1e-12
"""What roundings may take off a bound, relative and absolute [rad, rad/s; m, m/s]."""


@njit(cache=True, error_model="numpy")
def travel(speed: float, hold: float, deceleration: float, elapsed: float) -> float:
    """Farthest [rad; m] that a joint gets in ``elapsed`` [s]: ``hold`` [s] at ``speed``, then it brakes."""
    braking = min(max(elapsed - hold, 0.0), speed / deceleration)
    return speed * min(elapsed, hold) + braking * (speed - 0.5 * deceleration * braking)


@njit(cache=True, error_model="numpy")
def _speeds(slices: Block, row: int, hold: float, extrapolates: bool, out: Array) -> None:
    """Write bounds of dq on a slice into ``out[0], out[1]``, and how fast the reaction may get, down and up.

    ``out (4, n)``; NaN where a bound of the slice is.
    """
    plan = slices[0]
    h = plan.t[row + 1] - plan.t[row]
    for j in range(plan.n_joints):
        change = 0.5 * h * plan.ddq_max[row, j]
        low = np.minimum(plan.dq[row, j], plan.dq[row + 1, j]) - change
        high = np.maximum(plan.dq[row, j], plan.dq[row + 1, j]) + change
        more = hold * plan.ddq_max[row, j] if extrapolates else 0.0
        out[0, j], out[1, j] = low, high
        out[2, j] = np.maximum(more - low, 0.0)
        out[3, j] = np.maximum(more + high, 0.0)


@njit(cache=True, error_model="numpy")
def _widen_row(
    slices: Block,
    row: int,
    source: int,
    own: Array,
    silent: Array,
    hold: float,
    deceleration: Array,
) -> None:
    """Let slice ``row`` contain every reaction that begins on slice ``source``, at or before it.

    ``own, silent (4, n)``: speeds on the two slices, see :func:`_speeds`.
    """
    plan = slices[0]
    h, h_source = plan.t[row + 1] - plan.t[row], plan.t[source + 1] - plan.t[source]
    longest = plan.t[row + 1] - plan.t[source]
    shortest = max(plan.t[row] - plan.t[source + 1], 0.0)
    for j in range(plan.n_joints):
        # what the plan itself moves from the begin of silence to any instant of the slice
        low, high = h * np.minimum(own[0, j], 0.0), h * np.maximum(own[1, j], 0.0)
        if source < row:
            between = plan.q[row, j] - plan.q[source + 1, j]
            low += between + h_source * np.minimum(silent[0, j], 0.0)
            high += between + h_source * np.maximum(silent[1, j], 0.0)
        down = travel(silent[2, j], hold, deceleration[j], longest)
        up = travel(silent[3, j], hold, deceleration[j], longest)
        away = np.maximum(up - low, down + high) * _OUTWARD + _TINY
        plan.q_spread[row, j] = np.maximum(plan.q_spread[row, j], away)
        braked = deceleration[j] * max(shortest - hold, 0.0)
        down, up = np.maximum(silent[2, j] - braked, 0.0), np.maximum(silent[3, j] - braked, 0.0)
        faster = np.maximum(up - own[0, j], down + own[1, j]) * _OUTWARD + _TINY
        plan.dq_spread[row, j] = np.maximum(plan.dq_spread[row, j], faster)


@njit(cache=True, error_model="numpy")
def _lasts(silent: Array, hold: float, deceleration: Array, n: int) -> float:
    """How long [s] a reaction may last: until the last joint rests."""
    longest = 0.0
    for j in range(n):
        longest = np.maximum(longest, np.maximum(silent[2, j], silent[3, j]) / deceleration[j])
    return float((hold + longest) * _OUTWARD + _TINY)


@njit(cache=True, error_model="numpy")
def _rest_until(slices: Block, end: float) -> None:
    """Let the plan rest where it ends until ``end`` [s], in slices of its own as far as there is room."""
    plan = slices[0]
    n = plan.n
    begin = plan.t[n]
    rows = min(AFTER_REST, MAX_SLICES - n)
    if rows == 0:
        plan.t[n] = end
        return
    for k in range(rows):
        row = n + k
        plan.t[row + 1] = end if k == rows - 1 else begin + (end - begin) * (k + 1) / rows
        for j in range(plan.n_joints):
            plan.q[row + 1, j] = plan.q[n, j]
            plan.dq[row + 1, j] = plan.ddq[row + 1, j] = 0.0
            plan.dq_max[row, j] = plan.ddq_max[row, j] = 0.0
    plan.n = n + rows


@njit(cache=True, error_model="numpy")
def widen(slices: Block, since: float, hold: float, extrapolates: bool, deceleration: Array) -> bool:
    """Let a plan stand for every reaction to a silence that begins at ``since`` [s] or later, as well.

    Writes ``q_spread`` and ``dq_spread``, and adds slices until every reaction has ended. Returns False, with
    no slice left, where a bound is not finite.
    """
    plan = slices[0]
    n, n_joints = plan.n, plan.n_joints
    plan.q_spread[:] = 0.0
    plan.dq_spread[:] = 0.0
    first = 0
    while first < n and plan.t[first + 1] <= since:
        first += 1
    speeds = np.zeros((n, 4, n_joints))
    ends = np.zeros(n)
    end = plan.t[n]
    for source in range(first, n):
        _speeds(slices, source, hold, extrapolates, speeds[source])
        ends[source] = plan.t[source + 1] + _lasts(speeds[source], hold, deceleration, n_joints)
        end = np.maximum(end, ends[source])
    plan.n = 0
    if not end < np.inf:
        return False
    plan.n = n
    if end > plan.t[n]:
        _rest_until(slices, end)
    rest = np.zeros((4, n_joints))
    for row in range(first, plan.n):
        own = speeds[row] if row < n else rest
        for source in range(first, min(row + 1, n)):
            if ends[source] >= plan.t[row]:
                _widen_row(slices, row, source, own, speeds[source], hold, deceleration)
    for row in range(first, plan.n):
        for j in range(n_joints):
            if not (plan.q_spread[row, j] < np.inf and plan.dq_spread[row, j] < np.inf):
                plan.n = 0
                return False
    return True
