"""Compiled joint-space stop: every axis on a profile of its own, held against its limits, cut into slices.

Every comparison is written so that NaN proves nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.limit_kernels import (
    ACCELERATION,
    ACCELERATION_LIMIT,
    JERK,
    JERK_LIMIT,
    LOWER,
    POSITION,
    UPPER,
    VELOCITY,
    VELOCITY_LIMIT,
    leave_witness,
)
from failsafe.path_kernels import END_TOLERANCE, MAX_SEGMENTS, SHORTEST
from failsafe.trajectory_kernels import EPS
from robots.motion import MAX_JOINTS, MAX_SLICES, Block

Array = NDArray[np.float64]

AXES = np.dtype(
    [
        ("n", np.int64),
        ("segments", np.int64, (MAX_JOINTS,)),
        ("t", np.float64, (MAX_SEGMENTS + 1, MAX_JOINTS)),
        ("q", np.float64, (MAX_SEGMENTS, MAX_JOINTS)),
        ("v", np.float64, (MAX_SEGMENTS, MAX_JOINTS)),
        ("a", np.float64, (MAX_SEGMENTS, MAX_JOINTS)),
        ("j", np.float64, (MAX_SEGMENTS, MAX_JOINTS)),
        ("q_end", np.float64, (MAX_JOINTS,)),
    ]
)
"""Joint-space stop: as ``path_kernels.PATH``, one column per joint, each ending at rest at ``q_end``
[rad; m]."""


@njit(cache=True, error_model="numpy")
def axis_state(axes: Block, i: int, tau: float) -> tuple[float, float, float]:
    """Return q, dq, ddq of axis ``i`` at ``tau`` [s] after the begin of the stop; at rest beyond its end."""
    rec = axes[0]
    n = rec.segments[i]
    if n == 0 or tau >= rec.t[n, i]:
        return rec.q_end[i], 0.0, 0.0
    k = 0
    while k < n - 1 and tau >= rec.t[k + 1, i]:
        k += 1
    return _axis_at(axes, i, k, tau)


@njit(cache=True, error_model="numpy")
def axes_at(axes: Block, n: int, tau: float, out: Array) -> None:
    """Write q, dq, ddq at ``tau`` [s] after the begin of the stop into the rows of ``out (>= 3, >= n)``."""
    for i in range(n):
        out[0, i], out[1, i], out[2, i] = axis_state(axes, i, tau)


@njit(cache=True, error_model="numpy")
def _axis_at(axes: Block, i: int, k: int, tau: float) -> tuple[float, float, float]:
    rec = axes[0]
    j = rec.j[k, i]
    if k == rec.segments[i] - 1:
        r = rec.t[k + 1, i] - tau
        return rec.q_end[i] - r * r * r * j / 6.0, 0.5 * j * r * r, -j * r
    x = tau - rec.t[k, i]
    v, a = rec.v[k, i], rec.a[k, i]
    return rec.q[k, i] + x * (v + x * (0.5 * a + x * j / 6.0)), v + x * (a + 0.5 * j * x), a + j * x


@njit(cache=True, error_model="numpy")
def append_axis(
    axes: Block,
    i: int,
    start: Array,
    durations: Array,
    jerks: Array,
    limits: Array,
    positions: bool,
    work: Block,
) -> bool:
    """Write the stop of axis ``i`` from ``start`` = (q, dq, ddq); tell whether it is accepted.

    Accepted: every segment, the first instant included, within velocity, acceleration and jerk limit,
    positions at the extrema within the limits, at rest at the end. Else ``work`` has the witness: a jerk
    without bound, where there are more segments than room for them.
    """
    rec = axes[0]
    slack = 1.0 + 1e-9
    q, v, a, t = start[0], start[1], start[2], 0.0
    v_limit, a_limit, j_limit = (
        limits[VELOCITY_LIMIT, i],
        limits[ACCELERATION_LIMIT, i],
        limits[JERK_LIMIT, i],
    )
    n = 0
    rec.t[0, i] = 0.0
    for index in range(durations.shape[0]):
        d, j = durations[index], jerks[index]
        if not (d >= 0.0 and abs(j) <= j_limit * slack):
            leave_witness(work, i, JERK, j, j_limit)
            return False
        if d <= SHORTEST:
            continue
        if n == MAX_SEGMENTS:
            leave_witness(work, i, JERK, np.inf, j_limit)
            return False
        rec.q[n, i], rec.v[n, i], rec.a[n, i], rec.j[n, i] = q, v, a, j
        rec.t[n + 1, i] = t + d
        d = rec.t[n + 1, i] - t
        q, v, a, t = q + d * (v + d * (0.5 * a + d * j / 6.0)), v + d * (a + 0.5 * j * d), a + j * d, t + d
        n += 1
    if not abs(v) <= END_TOLERANCE * max(1.0, v_limit):
        leave_witness(work, i, VELOCITY, v, 0.0)
        return False
    if not abs(a) <= END_TOLERANCE * max(1.0, a_limit):
        leave_witness(work, i, ACCELERATION, a, 0.0)
        return False
    rec.segments[i], rec.q_end[i] = n, q
    if n > 0:
        d, j = rec.t[n, i] - rec.t[n - 1, i], rec.j[n - 1, i]
        rec.v[n - 1, i], rec.a[n - 1, i] = 0.5 * j * d * d, -j * d
        rec.q_end[i] = rec.q[n - 1, i] + d * d * d * j / 6.0
    for k in range(n):
        q_lo, q_hi, v_max, a_max = _axis_range(axes, i, k, rec.t[k, i], rec.t[k + 1, i])
        if not v_max <= v_limit * slack:
            leave_witness(work, i, VELOCITY, v_max, v_limit)
            return False
        if not a_max <= a_limit * slack:
            leave_witness(work, i, ACCELERATION, a_max, a_limit)
            return False
        if positions and not q_lo >= limits[LOWER, i]:
            leave_witness(work, i, POSITION, q_lo, limits[LOWER, i])
            return False
        if positions and not q_hi <= limits[UPPER, i]:
            leave_witness(work, i, POSITION, q_hi, limits[UPPER, i])
            return False
    return True


@njit(cache=True, error_model="numpy")
def _axis_range(axes: Block, i: int, k: int, tau0: float, tau1: float) -> tuple[float, float, float, float]:
    """Return min q, max q, max |dq|, max |ddq| of segment ``k`` of axis ``i`` over [tau0, tau1]."""
    rec = axes[0]
    q0, v0, a0 = _axis_at(axes, i, k, tau0)
    q1, v1, a1 = _axis_at(axes, i, k, tau1)
    j = rec.j[k, i]
    v_max = np.maximum(abs(v0), abs(v1))
    if a0 * a1 < 0.0:
        v_max = np.maximum(v_max, abs(v0 - 0.5 * a0 * a0 / j))
    q_lo, q_hi = np.minimum(q0, q1), np.maximum(q0, q1)
    # q is monotone where dq keeps its sign; dq changes it at most twice
    root = a0 * a0 - 2.0 * j * v0
    if root >= 0.0:
        w = -(a0 + (np.sqrt(root) if a0 >= 0.0 else -np.sqrt(root)))
        for x in (2.0 * v0 / w if w != 0.0 else -1.0, w / j if j != 0.0 else -1.0):
            if 0.0 < x < tau1 - tau0:
                turn = q0 + x * (v0 + x * (0.5 * a0 + x * j / 6.0))
                q_lo, q_hi = np.minimum(q_lo, turn), np.maximum(q_hi, turn)
    wide = 16.0 * EPS * (abs(q_lo) + abs(q_hi)) + 1e-15
    return q_lo - wide, q_hi + wide, v_max * (1.0 + 16.0 * EPS) + 1e-15, np.maximum(abs(a0), abs(a1))


@njit(cache=True, error_model="numpy")
def write_axes_slices(axes: Block, n: int, begin: float, length: float, slices: Block) -> None:
    """Append the joint-space stop of ``n`` axes to the slices, in equal slices of about ``length`` [s].

    ``begin`` [s] is the begin of the stop on the slices' clock. Bounds hold over switches inside a slice.
    """
    rec, out = axes[0], slices[0]
    end = 0.0
    for i in range(n):
        end = max(end, rec.t[rec.segments[i], i])
    row = out.n
    parts = int(np.ceil(end / length * (1.0 - 1e-12)))
    parts = max(1, min(parts, MAX_SLICES - row)) if end > 0.0 else 0
    for part in range(parts):
        tau0 = end * part / parts
        tau1 = end if part == parts - 1 else end * (part + 1) / parts
        for i in range(n):
            _, v, a = axis_state(axes, i, tau0)
            _, v1, a1 = axis_state(axes, i, tau1)
            v_max, a_max = np.maximum(abs(v), abs(v1)), np.maximum(abs(a), abs(a1))
            for k in range(rec.segments[i]):
                low, high = max(tau0, rec.t[k, i]), min(tau1, rec.t[k + 1, i])
                if low < high:
                    _, _, v, a = _axis_range(axes, i, k, low, high)
                    v_max, a_max = np.maximum(v_max, v), np.maximum(a_max, a)
            out.dq_max[row + part, i], out.ddq_max[row + part, i] = v_max, a_max
    for part in range(parts + 1):
        tau = end if part == parts else end * part / parts
        out.t[row + part] = begin + tau
        for i in range(n):
            out.q[row + part, i], out.dq[row + part, i], out.ddq[row + part, i] = axis_state(axes, i, tau)
    out.n = row + parts
