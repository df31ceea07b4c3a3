"""Compiled proof that a path motion keeps the joint limits, by the chain rule in intervals.

Every comparison is written so that NaN proves nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.path_kernels import ACCEPTED, append_profile, begin_path, path_state, speed_range
from failsafe.trajectory_kernels import EPS, derivative_bounds, evaluate, locate
from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]

WORK = np.dtype(
    [
        ("lo", np.float64, (4, MAX_JOINTS)),
        ("hi", np.float64, (4, MAX_JOINTS)),
        ("dq", np.float64, (2, MAX_JOINTS)),
        ("ddq", np.float64, (2, MAX_JOINTS)),
        ("dddq", np.float64, (2, MAX_JOINTS)),
        ("joint", np.int64),
        ("quantity", np.int64),
        ("value", np.float64),
        ("limit", np.float64),
        ("time", np.float64),
    ]
)
"""Scratch of the checks: bounds of q, q', q'', q''' over a stretch of path, of dq, ddq, dddq over a stretch
of time (row 0 lower, row 1 upper), and the witness of the last check that failed."""

# Quantities of a witness, in the order of manoeuvre.Quantity.
POSITION, VELOCITY, ACCELERATION, JERK, PATH_END, PATH_SPEED = 0, 1, 2, 3, 4, 5

NOT_PROVEN = 8
"""Of append_and_prove: accepted, but not shown to keep the joint limits. (7 is Acceptance.NO_PROFILE.)"""

LOWER, UPPER, VELOCITY_LIMIT, ACCELERATION_LIMIT, JERK_LIMIT = 0, 1, 2, 3, 4
"""Rows of the array of joint limits ``(5, n)``."""

_FINEST = 1.0 / 256.0
"""A stretch of time that cannot be proven is halved down to this share of the slice."""


@njit(cache=True, error_model="numpy")
def bound_motion(
    path: Block, k: int, tau0: float, tau1: float, breaks: Array, coefficients: Array, first: int, work: Block
) -> int:
    """Enclose q, dq, ddq, dddq of segment ``k`` over [tau0, tau1] in ``work``; return the span of its end.

    The chain rule in intervals: dq = q'ṡ, ddq = q''ṡ² + q's̈, dddq = q'''ṡ³ + 3q''ṡs̈ + q's⃛.
    """
    rec = work[0]
    lo, hi = rec.lo, rec.hi
    s0, v0, a0, j = path_state(path, k, tau0)
    s1, v1, a1, _ = path_state(path, k, tau1)
    poison = 0.0 * (s0 + s1 + v0 + v1 + a0 + a1 + j)  # NaN as soon as one of them is not finite
    wide = 4.0 * EPS * max(abs(s0), abs(s1)) + poison
    m = derivative_bounds(breaks, coefficients, first, s0 - wide, max(s0, s1) + wide, lo, hi)
    v_lo, v_hi = speed_range(path, k, tau0, tau1)
    v_lo, v_hi = max(v_lo * (1.0 - 8.0 * EPS) - 1e-15, 0.0), v_hi * (1.0 + 8.0 * EPS) + 1e-15
    a_abs = max(abs(a0), abs(a1)) * 8.0 * EPS + 1e-15
    a_lo, a_hi = min(a0, a1) - a_abs, max(a0, a1) + a_abs
    v2_lo, v2_hi = v_lo * v_lo, v_hi * v_hi
    v3_lo, v3_hi = v2_lo * v_lo, v2_hi * v_hi
    va_lo = 3.0 * (a_lo * v_hi if a_lo < 0.0 else a_lo * v_lo)
    va_hi = 3.0 * (a_hi * v_lo if a_hi < 0.0 else a_hi * v_hi)
    va_abs, a_abs = max(abs(va_lo), abs(va_hi)), max(abs(a_lo), abs(a_hi))
    for i in range(coefficients.shape[2]):
        p, P = lo[1, i], hi[1, i]
        r, R = lo[2, i], hi[2, i]
        u, U = lo[3, i], hi[3, i]
        p_abs, r_abs, u_abs = max(abs(p), abs(P)), max(abs(r), abs(R)), max(abs(u), abs(U))
        e = 16.0 * EPS * p_abs * v_hi + poison
        rec.dq[0, i] = p * (v_hi if p < 0.0 else v_lo) - e
        rec.dq[1, i] = P * (v_lo if P < 0.0 else v_hi) + e
        e = 16.0 * EPS * (r_abs * v2_hi + p_abs * a_abs) + poison
        w, x, y, z = p * a_lo, p * a_hi, P * a_lo, P * a_hi
        rec.ddq[0, i] = r * (v2_hi if r < 0.0 else v2_lo) + min(w, x, y, z) - e
        rec.ddq[1, i] = R * (v2_lo if R < 0.0 else v2_hi) + max(w, x, y, z) + e
        e = 16.0 * EPS * (u_abs * v3_hi + r_abs * va_abs + p_abs * abs(j)) + poison
        w, x, y, z = r * va_lo, r * va_hi, R * va_lo, R * va_hi
        g, h = p * j, P * j
        rec.dddq[0, i] = u * (v3_hi if u < 0.0 else v3_lo) + min(w, x, y, z) + min(g, h) - e
        rec.dddq[1, i] = U * (v3_lo if U < 0.0 else v3_hi) + max(w, x, y, z) + max(g, h) + e
    return m


@njit(cache=True, error_model="numpy")
def chain_rule(derivatives: Array, v: float, a: float, j: float, n: int, out: Array) -> None:
    """Write q, dq, ddq, dddq into the rows of ``out`` from q, q', q'', q''' in those of ``derivatives``."""
    for i in range(n):
        d1, d2, d3 = derivatives[1, i], derivatives[2, i], derivatives[3, i]
        out[0, i] = derivatives[0, i]
        out[1, i] = d1 * v
        out[2, i] = d2 * v * v + d1 * a
        out[3, i] = d3 * v * v * v + 3.0 * d2 * v * a + d1 * j


@njit(cache=True, error_model="numpy")
def leave_witness(work: Block, joint: int, quantity: int, value: float, limit: float) -> None:
    """Note joint, quantity, value and limit of what has failed in ``work``."""
    rec = work[0]
    rec.joint, rec.quantity, rec.value, rec.limit = joint, quantity, value, limit


@njit(cache=True, error_model="numpy")
def _within(lo: Array, hi: Array, limit: Array, quantity: int, work: Block) -> bool:
    """Tell whether [lo, hi] lies within ±limit for every joint; the first that does not is the witness."""
    for i in range(limit.shape[0]):
        if not (hi[i] <= limit[i] and lo[i] >= -limit[i]):
            leave_witness(work, i, quantity, hi[i] if hi[i] >= -lo[i] else lo[i], limit[i])
            return False
    return True


@njit(cache=True, error_model="numpy")
def within_limits(limits: Array, positions: bool, work: Block) -> bool:
    """Tell whether the enclosures in ``work`` lie within the limits ``(5, n)``; leave a witness if not."""
    rec = work[0]
    if positions:
        for i in range(limits.shape[1]):
            if not rec.lo[0, i] >= limits[LOWER, i]:
                leave_witness(work, i, POSITION, rec.lo[0, i], limits[LOWER, i])
                return False
            if not rec.hi[0, i] <= limits[UPPER, i]:
                leave_witness(work, i, POSITION, rec.hi[0, i], limits[UPPER, i])
                return False
    return (
        _within(rec.dq[0], rec.dq[1], limits[VELOCITY_LIMIT], VELOCITY, work)
        and _within(rec.ddq[0], rec.ddq[1], limits[ACCELERATION_LIMIT], ACCELERATION, work)
        and _within(rec.dddq[0], rec.dddq[1], limits[JERK_LIMIT], JERK, work)
    )


@njit(cache=True, error_model="numpy")
def _beyond_at(
    path: Block,
    k: int,
    tau: float,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    positions: bool,
    work: Block,
) -> bool:
    """Tell whether a limit is exceeded at one instant, then there is no use in halving; leave the witness."""
    rec = work[0]
    s, v, a, j = path_state(path, k, tau)
    evaluate(breaks, coefficients, s, rec.lo)
    chain_rule(rec.lo, v, a, j, coefficients.shape[2], rec.hi)
    for i in range(limits.shape[1]):
        if positions and (rec.hi[0, i] < limits[LOWER, i] or rec.hi[0, i] > limits[UPPER, i]):
            beyond = LOWER if rec.hi[0, i] < limits[LOWER, i] else UPPER
            leave_witness(work, i, POSITION, rec.hi[0, i], limits[beyond, i])
            return True
        for quantity in range(1, 4):
            if abs(rec.hi[quantity, i]) > limits[quantity + 1, i]:
                leave_witness(work, i, quantity, rec.hi[quantity, i], limits[quantity + 1, i])
                return True
    return False


@njit(cache=True, error_model="numpy")
def proven(
    path: Block,
    first: int,
    end: int,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    step: float,
    positions: bool,
    work: Block,
) -> bool:
    """Tell whether segments ``first … end-1`` are proven to keep the joint limits ``(5, n)``.

    Walks through time with stretches of ``step`` [s], halved where the enclosures are too wide. If not
    proven, ``work`` holds joint, quantity, value (of the enclosure, or at an instant that exceeds the limit),
    limit and time.
    """
    rec = path[0]
    left = 2048
    for k in range(first, end):
        tau, last = rec.t[k], rec.t[k + 1]
        if not (tau <= last < np.inf and step > 0.0):
            return False
        m = locate(breaks, path_state(path, k, tau)[0])
        h = 2.0 * step
        while tau < last:
            stop = last if not tau + 1.01 * h < last else tau + h
            ahead = bound_motion(path, k, tau, stop, breaks, coefficients, m, work)
            if within_limits(limits, positions, work):
                tau, m, h = stop, ahead, 2.0 * h
                continue
            work[0].time = tau
            left -= 1
            h = 0.5 * (stop - tau)
            middle = tau + h
            if not h > _FINEST * step or left <= 0:
                return False
            if _beyond_at(path, k, middle, breaks, coefficients, limits, positions, work):
                work[0].time = middle
                return False
    return True


@njit(cache=True, error_model="numpy")
def append_and_prove(
    path: Block,
    first: int,
    start: tuple[float, float, float],
    change: tuple[float, float, float, float],
    profile: tuple[Array, Array],
    breaks: Array,
    coefficients: Array,
    limits: Array,
    step: float,
    positions: bool,
    work: Block,
) -> int:
    """Append a profile and hold it against the joint limits; return the verdict, or ``NOT_PROVEN``.

    ``start`` = (s, ṡ, s̈), ``change`` = (target, a_s, j_s, s_max), ``profile`` = durations and jerks, as in
    append_profile.
    """
    s, v, a = start
    target, a_limit, j_limit, s_max = change
    verdict = append_profile(path, first, s, v, a, profile[0], profile[1], target, a_limit, j_limit, s_max)
    if verdict != ACCEPTED:
        return verdict
    if proven(path, first, path[0].n, breaks, coefficients, limits, step, positions, work):
        return ACCEPTED
    return NOT_PROVEN


@njit(cache=True, error_model="numpy")
def prove_steady(
    path: Block,
    s: float,
    v: float,
    duration: float,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    step: float,
    positions: bool,
    work: Block,
    out: Array,
) -> bool:
    """Start a plan with ``duration`` [s] of constant ṡ; tell whether it is proven. ``out`` as in cut_path."""
    begin_path(path, s, v, 0.0, duration)
    out[0], out[1], out[2] = path[0].s_end, v, 0.0
    return proven(path, 0, 1, breaks, coefficients, limits, step, positions, work)
