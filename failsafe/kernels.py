"""Compiled time scaling: bounds of a piecewise polynomial, path motion of a plan, chain rule in intervals.

Notation as in docs/method.md, section 2: s is the path parameter [s], ' = d/ds, a dot is d/dt.
A trajectory is ``breaks (M+1,)`` and ``coefficients (M, 6, n)``: powers of (s - break), lowest first.
Every comparison is written so that NaN proves nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots.motion import MAX_JOINTS, MAX_SLICES, Block

Array = NDArray[np.float64]
Record = Any
"""The one element of a block."""

MAX_SEGMENTS = 20
"""Segments of constant path jerk in a plan. A change of speed has nine (two to brake into the limits, seven
of a profile); the piece is one or such a change and what is left of the cycle, the stop another change."""

PATH = np.dtype(
    [
        ("n", np.int64),
        ("anchored", np.int64),
        ("t", np.float64, (MAX_SEGMENTS + 1,)),
        ("s", np.float64, (MAX_SEGMENTS,)),
        ("v", np.float64, (MAX_SEGMENTS,)),
        ("a", np.float64, (MAX_SEGMENTS,)),
        ("j", np.float64, (MAX_SEGMENTS,)),
        ("s_end", np.float64),
        ("v_end", np.float64),
    ]
)
"""Path motion of a plan: segment k runs over ``[t[k], t[k+1]]`` [s, 0 = begin of the plan] with constant
path jerk ``j[k]`` and starts at ``s[k], v[k], a[k]`` (s, ṡ, s̈). Segment ``anchored`` (-1: none) is
evaluated backwards from ``s_end, v_end`` and s̈ = 0, so that the end state is met exactly and not up to
rounding."""

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
"""Joint-space stop: as ``PATH``, one column per joint, each ending at rest at ``q_end`` [rad; m]."""

# Quantities of a witness, in the order of short_term_plan.Quantity.
POSITION, VELOCITY, ACCELERATION, JERK, PATH_END, PATH_SPEED = 0, 1, 2, 3, 4, 5

# Verdicts of the acceptance test, in the order of manoeuvre.Acceptance.
ACCEPTED, BAD_LIMIT, PATH_ACCELERATION, NEGATIVE_SPEED, SPEED_OVERSHOOT, NOT_AT_TARGET, BEYOND_PATH = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
)

NOT_PROVEN = 8
"""Of append_and_prove: accepted, but not shown to keep the joint limits. (7 is Acceptance.NO_PROFILE.)"""

LOWER, UPPER, VELOCITY_LIMIT, ACCELERATION_LIMIT, JERK_LIMIT = 0, 1, 2, 3, 4
"""Rows of the array of joint limits ``(5, n)``."""

_EPS = 2.220446049250313e-16
_SHORTEST = 1e-12
"""Segments shorter than this [s] are dropped, what that leaves open is held against ``_END_TOLERANCE``;
path speeds above minus this count as 0."""
_END_TOLERANCE = 1e-9
"""Relative difference between the end of the integrated segments and the target that the anchor may close."""
_SPAN_SLACK = 1e-8
"""How far before its span [s] a stretch may begin: more than the roundings of a path parameter up to 1e6
s."""
_FINEST = 1.0 / 256.0
"""A stretch of time that cannot be proven is halved down to this share of the slice."""


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
    w = 0.5 * (x1 - x0) + 4.0 * _EPS * far
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

        odd = w * (abs(t1) + w2 * (abs(t3) + w2 * abs(t5))) + 32.0 * _EPS * s0
        up = w2 * (max(t2, 0.0) + w2 * max(t4, 0.0))
        down = w2 * (min(t2, 0.0) + w2 * min(t4, 0.0))
        lo0, hi0 = t0 + down - odd, t0 + up + odd
        odd = w * (2.0 * abs(t2) + w2 * 4.0 * abs(t4)) + 32.0 * _EPS * s1
        up = w2 * (3.0 * max(t3, 0.0) + w2 * 5.0 * max(t5, 0.0))
        down = w2 * (3.0 * min(t3, 0.0) + w2 * 5.0 * min(t5, 0.0))
        lo1, hi1 = t1 + down - odd, t1 + up + odd
        odd = w * (6.0 * abs(t3) + w2 * 20.0 * abs(t5)) + 32.0 * _EPS * s2
        up, down = w2 * 12.0 * max(t4, 0.0), w2 * 12.0 * min(t4, 0.0)
        lo2, hi2 = 2.0 * t2 + down - odd, 2.0 * t2 + up + odd
        odd = w * 24.0 * abs(t4) + 32.0 * _EPS * s3
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


@njit(cache=True, error_model="numpy")
def path_state(path: Block, k: int, tau: float) -> tuple[float, float, float, float]:
    """Return s, ṡ, s̈, s⃛ of segment ``k`` at the time ``tau`` [s, 0 = begin of the plan]."""
    rec = path[0]
    j = rec.j[k]
    if k == rec.anchored:
        r = rec.t[k + 1] - tau
        return rec.s_end - r * (rec.v_end + r * r * j / 6.0), rec.v_end + 0.5 * j * r * r, -j * r, j
    x = tau - rec.t[k]
    v, a = rec.v[k], rec.a[k]
    speed = v + x * (a + 0.5 * j * x)
    if -_SHORTEST <= speed < 0.0:  # rounding: the acceptance test admits no more
        speed = 0.0
    return rec.s[k] + x * (v + x * (0.5 * a + x * j / 6.0)), speed, a + j * x, j


@njit(cache=True, error_model="numpy")
def begin_path(path: Block, s: float, v: float, a: float, duration: float) -> None:
    """Start a plan with a piece of constant s̈ over ``duration`` [s]."""
    rec = path[0]
    rec.n = 1
    rec.anchored = -1
    rec.t[0], rec.t[1] = 0.0, duration
    rec.s[0], rec.v[0], rec.a[0], rec.j[0] = s, v, a, 0.0
    rec.s_end = s + duration * (v + 0.5 * a * duration)
    rec.v_end = v + a * duration


@njit(cache=True, error_model="numpy")
def cut_path(path: Block, duration: float, out: Array) -> None:
    """Let the plan end after ``duration`` [s], going on at constant ṡ where its segments end before.

    Writes s, ṡ, s̈ of its end into ``out (3,)``. Nothing is left of the anchor: the end state of a change of
    speed is met by the segment that follows it, or by ``out``. No segment remains that is too short to be
    one: the one before it is longer by that much.
    """
    rec = path[0]
    n = rec.n
    s_end, v_end = rec.s_end, rec.v_end
    rec.anchored = -1
    while n > 1 and rec.t[n - 1] >= duration - _SHORTEST:
        n -= 1
    whole = n == rec.n
    met = whole and n > 0 and abs(duration - rec.t[n]) <= _SHORTEST
    if n == 0 or (whole and rec.t[n] < duration and not met):
        rec.t[n + 1] = duration
        if n == 0:
            rec.t[0] = 0.0
        rec.s[n], rec.v[n], rec.a[n], rec.j[n] = s_end, v_end, 0.0, 0.0
        n += 1
    rec.n = n
    rec.t[n] = duration
    out[0], out[1], out[2], _ = path_state(path, n - 1, duration)
    if met:
        out[1], out[2] = v_end, 0.0
    rec.s_end, rec.v_end = out[0], out[1]


@njit(cache=True, error_model="numpy")
def path_at(path: Block, tau: float, out: Array) -> None:
    """Write s, ṡ, s̈ at ``tau`` [s, 0 = begin of the plan] into ``out (3,)``; at rest beyond its end.

    NaN if there is no segment or ``tau`` is before the begin or not a number.
    """
    rec = path[0]
    n = rec.n
    if not (n > 0 and tau >= rec.t[0]):
        out[:] = np.nan
    elif tau > rec.t[n] or (tau == rec.t[n] and rec.v_end == 0.0):
        out[0], out[1], out[2] = rec.s_end, 0.0, 0.0
    else:
        k = n - 1
        while k > 0 and tau < rec.t[k]:
            k -= 1
        out[0], out[1], out[2], _ = path_state(path, k, tau)


@njit(cache=True, error_model="numpy")
def motion_at(path: Block, breaks: Array, coefficients: Array, tau: float, state: Array, out: Array) -> None:
    """Write s, ṡ, s̈ at ``tau`` into ``state (3,)`` and q, dq, ddq into the rows of ``out (>= 4, >= n)``."""
    path_at(path, tau, state)
    n = coefficients.shape[2]
    for i in range(n):
        out[0, i] = out[1, i] = out[2, i] = out[3, i] = np.nan
    if state[0] == state[0]:
        evaluate(breaks, coefficients, state[0], out)
        for i in range(n):
            d1 = out[1, i]
            out[1, i] = d1 * state[1]
            out[2, i] = out[2, i] * state[1] * state[1] + d1 * state[2]


@njit(cache=True, error_model="numpy")
def append_profile(
    path: Block,
    first: int,
    s: float,
    v: float,
    a: float,
    durations: Array,
    jerks: Array,
    target: float,
    a_limit: float,
    j_limit: float,
    s_max: float,
) -> int:
    """Write the segments of a profile behind the ``first`` ones; return the verdict of the acceptance test.

    The profile begins at ``s, v, a`` (s, ṡ, s̈); the target is ṡ = ``target``, s̈ = 0. The test is that
    of docs/method.md, section 2, on the segments themselves: nothing that the generator reports is relied
    upon.
    """
    rec = path[0]
    rec.n, rec.anchored = first, -1
    if not (0.0 < a_limit < np.inf and 0.0 < j_limit < np.inf):
        return BAD_LIMIT
    slack = 1.0 + 1e-9
    if not abs(a) <= a_limit * slack:
        return PATH_ACCELERATION
    highest = max(target, v + max(a, 0.0) ** 2 / (2.0 * j_limit)) * slack + 1e-12
    t = rec.t[first] if first > 0 else 0.0
    rec.t[first] = t
    k = first
    for i in range(durations.shape[0]):
        d, j = durations[i], jerks[i]
        if not (d >= 0.0 and abs(j) <= j_limit * slack):
            return BAD_LIMIT
        if d <= _SHORTEST:
            continue
        if k == MAX_SEGMENTS:
            return NOT_AT_TARGET
        rec.t[k], rec.t[k + 1] = t, t + d
        rec.s[k], rec.v[k], rec.a[k], rec.j[k] = s, v, a, j
        d = rec.t[k + 1] - t
        s, v, a, t = s + d * (v + d * (0.5 * a + d * j / 6.0)), v + d * (a + 0.5 * j * d), a + j * d, t + d
        if not abs(a) <= a_limit * slack:
            return PATH_ACCELERATION
        k += 1
    if not (
        abs(v - target) <= _END_TOLERANCE * max(1.0, highest) and abs(a) <= _END_TOLERANCE * max(1.0, a_limit)
    ):
        return NOT_AT_TARGET
    rec.s_end, rec.v_end = s, target
    if k > first:
        _anchor(path, k - 1)
    for i in range(first, k):
        low, high = _speed_range(path, i, rec.t[i], rec.t[i + 1])
        if not low >= -_SHORTEST:
            return NEGATIVE_SPEED
        if not high <= highest:
            return SPEED_OVERSHOOT
    if not (s <= s_max and rec.s_end <= s_max):
        return BEYOND_PATH
    rec.n = k
    return ACCEPTED


@njit(cache=True, error_model="numpy")
def _anchor(path: Block, last: int) -> None:
    """Let segment ``last`` be evaluated from its end, so that the target is met exactly."""
    rec = path[0]
    d, j = rec.t[last + 1] - rec.t[last], rec.j[last]
    rec.v[last], rec.a[last] = rec.v_end + 0.5 * j * d * d, -j * d
    rec.s_end = rec.s[last] + d * (rec.v_end + d * d * j / 6.0)
    rec.anchored = last


@njit(cache=True, error_model="numpy")
def _speed_range(path: Block, k: int, tau0: float, tau1: float) -> tuple[float, float]:
    """Return the smallest and largest ṡ of segment ``k`` over [tau0, tau1]."""
    rec = path[0]
    _, v0, a0, j = path_state(path, k, tau0)
    _, v1, a1, _ = path_state(path, k, tau1)
    low, high = np.minimum(v0, v1), np.maximum(v0, v1)
    if k != rec.anchored and a0 * a1 < 0.0:
        turn = rec.v[k] - 0.5 * rec.a[k] * rec.a[k] / j
        low, high = np.minimum(low, turn), np.maximum(high, turn)
    return low, high


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
    wide = 4.0 * _EPS * max(abs(s0), abs(s1)) + poison
    m = derivative_bounds(breaks, coefficients, first, s0 - wide, max(s0, s1) + wide, lo, hi)
    v_lo, v_hi = _speed_range(path, k, tau0, tau1)
    v_lo, v_hi = max(v_lo * (1.0 - 8.0 * _EPS) - 1e-15, 0.0), v_hi * (1.0 + 8.0 * _EPS) + 1e-15
    a_abs = max(abs(a0), abs(a1)) * 8.0 * _EPS + 1e-15
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
        e = 16.0 * _EPS * p_abs * v_hi + poison
        rec.dq[0, i] = p * (v_hi if p < 0.0 else v_lo) - e
        rec.dq[1, i] = P * (v_lo if P < 0.0 else v_hi) + e
        e = 16.0 * _EPS * (r_abs * v2_hi + p_abs * a_abs) + poison
        w, x, y, z = p * a_lo, p * a_hi, P * a_lo, P * a_hi
        rec.ddq[0, i] = r * (v2_hi if r < 0.0 else v2_lo) + min(w, x, y, z) - e
        rec.ddq[1, i] = R * (v2_lo if R < 0.0 else v2_hi) + max(w, x, y, z) + e
        e = 16.0 * _EPS * (u_abs * v3_hi + r_abs * va_abs + p_abs * abs(j)) + poison
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
def _witness(work: Block, joint: int, quantity: int, value: float, limit: float) -> None:
    rec = work[0]
    rec.joint, rec.quantity, rec.value, rec.limit = joint, quantity, value, limit


@njit(cache=True, error_model="numpy")
def _within(lo: Array, hi: Array, limit: Array, quantity: int, work: Block) -> bool:
    """Tell whether [lo, hi] lies within ±limit for every joint; the first that does not is the witness."""
    for i in range(limit.shape[0]):
        if not (hi[i] <= limit[i] and lo[i] >= -limit[i]):
            _witness(work, i, quantity, hi[i] if hi[i] >= -lo[i] else lo[i], limit[i])
            return False
    return True


@njit(cache=True, error_model="numpy")
def within_limits(limits: Array, positions: bool, work: Block) -> bool:
    """Tell whether the enclosures in ``work`` lie within the limits ``(5, n)``; leave a witness if not."""
    rec = work[0]
    if positions:
        for i in range(limits.shape[1]):
            if not rec.lo[0, i] >= limits[LOWER, i]:
                _witness(work, i, POSITION, rec.lo[0, i], limits[LOWER, i])
                return False
            if not rec.hi[0, i] <= limits[UPPER, i]:
                _witness(work, i, POSITION, rec.hi[0, i], limits[UPPER, i])
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
            _witness(work, i, POSITION, rec.hi[0, i], limits[beyond, i])
            return True
        for quantity in range(1, 4):
            if abs(rec.hi[quantity, i]) > limits[quantity + 1, i]:
                _witness(work, i, quantity, rec.hi[quantity, i], limits[quantity + 1, i])
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


@njit(cache=True, error_model="numpy")
def slice_length(times: Array, segments: int, most: int, length: float) -> float:
    """Return the slice length >= ``length`` [s] for which ``segments`` fill no more than ``most`` slices."""
    total = times[segments] - times[0]
    if not 0.0 <= total < np.inf:
        return length
    needed = 0
    for k in range(segments):
        needed += max(1, int(np.ceil((times[k + 1] - times[k]) / length)))
    if needed <= most:
        return length
    return float(max(length, total / (most - segments)))


@njit(cache=True, error_model="numpy")
def slices_of(duration: float, length: float) -> int:
    """Return how many slices of about ``length`` [s] a segment makes; more than there may be: too many."""
    if not duration / length <= MAX_SLICES:
        return MAX_SLICES + 1
    return max(1, int(np.ceil(duration / length * (1.0 - 1e-12))))


@njit(cache=True, error_model="numpy")
def write_path_slices(
    path: Block,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    begin: float,
    length: float,
    slices: Block,
    work: Block,
) -> None:
    """Cut a proven path motion into slices of about ``length`` [s] that straddle no switch of the path jerk.

    ``begin`` [s] is the begin of the plan on the slices' clock. The bounds are those of the enclosures, or
    the joint limits ``(5, n)`` where these are smaller: ``proven`` has shown that they hold. No slices if
    there would be more than the block holds, or a bound is not finite.
    """
    rec, out = path[0], slices[0]
    n = coefficients.shape[2]
    row = 0
    out.n = 0
    for k in range(rec.n):
        t0, t1 = rec.t[k], rec.t[k + 1]
        parts = slices_of(t1 - t0, length)
        if row + parts > MAX_SLICES:
            return
        m = locate(breaks, path_state(path, k, t0)[0])
        for part in range(parts):
            tau0 = t0 + (t1 - t0) * part / parts
            tau1 = t1 if part == parts - 1 else t0 + (t1 - t0) * (part + 1) / parts
            m = bound_motion(path, k, tau0, tau1, breaks, coefficients, m, work)
            out.t[row] = begin + tau0
            for i in range(n):
                out.dq_max[row, i] = np.minimum(
                    np.maximum(-work[0].dq[0, i], work[0].dq[1, i]), limits[VELOCITY_LIMIT, i]
                )
                out.ddq_max[row, i] = np.minimum(
                    np.maximum(-work[0].ddq[0, i], work[0].ddq[1, i]), limits[ACCELERATION_LIMIT, i]
                )
                if not (out.dq_max[row, i] < np.inf and out.ddq_max[row, i] < np.inf):
                    return
            _write_node(path, k, tau0, breaks, coefficients, row, slices, work)
            row += 1
    out.n = row
    out.t[row] = begin + rec.t[rec.n]
    _write_node(path, rec.n - 1, rec.t[rec.n], breaks, coefficients, row, slices, work)


@njit(cache=True, error_model="numpy")
def slice_path(
    path: Block,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    begin: float,
    wanted: float,
    slices: Block,
    work: Block,
    out: Array,
) -> int:
    """Cut a proven path motion into slices of ``wanted`` [s], longer where there would be too many.

    Returns how many there are, 0 if it cannot be done; ``out`` = duration of the plan [s], s at its end.
    """
    rec = path[0]
    length = slice_length(rec.t, rec.n, MAX_SLICES, wanted)
    write_path_slices(path, breaks, coefficients, limits, begin, length, slices, work)
    out[0], out[1] = rec.t[rec.n], rec.s_end
    return int(slices[0].n)


@njit(cache=True, error_model="numpy")
def steady_plan(
    path: Block,
    piece: tuple[float, float, float, float],
    stop: tuple[float, float, float, float],
    profile: tuple[Array, Array],
    breaks: Array,
    coefficients: Array,
    limits: Array,
    step: float,
    positions: bool,
    slices: Block,
    work: Block,
    out: Array,
) -> bool:
    """Make a plan of constant ṡ and a stop; tell whether it is accepted, proven and in ``slices``.

    ``piece`` = (s, ṡ, duration, s_max), ``stop`` = (a_s, j_s, begin of the plan, slice length), ``profile``
    as in append_profile. ``out`` = duration of the plan, s at its end. If any of it fails, no slice is left.
    """
    s, v, duration, s_max = piece
    a_s, j_s, begin, wanted = stop
    slices[0].n = 0
    if not prove_steady(path, s, v, duration, breaks, coefficients, limits, step, positions, work, out):
        return False
    if not out[0] <= s_max:
        return False
    first, start, change = path[0].n, (out[0], v, 0.0), (0.0, a_s, j_s, s_max)
    verdict = append_and_prove(
        path, first, start, change, profile, breaks, coefficients, limits, step, positions, work
    )
    if verdict != ACCEPTED:
        return False
    return slice_path(path, breaks, coefficients, limits, begin, wanted, slices, work, out) > 0


@njit(cache=True, error_model="numpy")
def _write_node(
    path: Block, k: int, tau: float, breaks: Array, coefficients: Array, row: int, slices: Block, work: Block
) -> None:
    out, rec = slices[0], work[0]
    s, v, a, j = path_state(path, k, tau)
    evaluate(breaks, coefficients, s, rec.lo)
    chain_rule(rec.lo, max(v, 0.0), a, j, coefficients.shape[2], rec.hi)
    for i in range(coefficients.shape[2]):
        out.q[row, i], out.dq[row, i], out.ddq[row, i] = rec.hi[0, i], rec.hi[1, i], rec.hi[2, i]


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


# Search for the path acceleration and jerk of a stop. These are predictions: `proven` decides.

HIGHEST_PATH_ACCELERATION = 1e3
HIGHEST_PATH_JERK = 1e6
"""Caps [1/s, 1/s²] where the joints hardly move and would allow any."""
LEAST_PATH_ACCELERATION = 1e-3
"""Smallest path acceleration that is tried [1/s]."""

AHEAD = np.dtype(
    [
        ("hard", np.int64),
        ("length", np.float64),
        ("a", np.float64),
        ("j", np.float64),
        ("d", np.float64, (65, 3, MAX_JOINTS)),
    ]
)
"""The path ahead: q', q'', q''' at 65 points of the next ``length`` [s] of path, denser at the begin; path
acceleration and jerk that are worth trying at most. ``hard``: which instant of a change of speed forbade the
last one that was not predicted to keep the limits."""


@njit(cache=True, error_model="numpy")
def _derivatives(breaks: Array, coefficients: Array, m: int, s: float, out: Array) -> int:
    """Write q', q'', q''' at ``s`` into the rows 1 to 3 of ``out (>= 4, >= n)``; return the span of ``s``.

    As :func:`evaluate`, where ``m`` is the span of ``s`` or one before it.
    """
    while m < breaks.shape[0] - 2 and s >= breaks[m + 1]:
        m += 1
    x = s - breaks[m]
    for i in range(coefficients.shape[2]):
        c1, c2, c3 = coefficients[m, 1, i], coefficients[m, 2, i], coefficients[m, 3, i]
        c4, c5 = coefficients[m, 4, i], coefficients[m, 5, i]
        out[1, i] = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
        out[2, i] = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))
        out[3, i] = 6.0 * c3 + x * (24.0 * c4 + x * 60.0 * c5)
    return m


@njit(cache=True, error_model="numpy")
def look_ahead(
    breaks: Array,
    coefficients: Array,
    s: float,
    v: float,
    a: float,
    target: float,
    limits: Array,
    ahead: Block,
    work: Block,
) -> None:
    """Fill ``ahead`` for a change of ṡ from ``v`` to ``target`` that begins at ``s`` with s̈ = ``a``."""
    rec, out = work[0], ahead[0]
    n = limits.shape[1]
    jerk = HIGHEST_PATH_JERK
    begin = locate(breaks, s)
    _derivatives(breaks, coefficients, begin, s, rec.lo)
    for i in range(n):
        jerk = min(jerk, limits[JERK_LIMIT, i] / abs(rec.lo[1, i]))
    v = v + a * abs(a) / jerk  # twice what s̈ alone changes until it is gone
    change = abs(v * v - target * target)
    most, gentle = HIGHEST_PATH_ACCELERATION, HIGHEST_PATH_ACCELERATION
    jerk, gentle_jerk = 0.0, HIGHEST_PATH_JERK
    m = begin
    for point in range(17):
        # over the distance that is needed with what was seen so far
        way = change / (2.0 * gentle) + (abs(v) + target) * np.sqrt(abs(v - target) / gentle_jerk)
        x = point / 16.0 * way
        m = _derivatives(breaks, coefficients, m, min(s + x, breaks[-1]), rec.lo)
        local, local_jerk = HIGHEST_PATH_ACCELERATION, HIGHEST_PATH_JERK
        for i in range(n):
            p = abs(rec.lo[1, i])
            local = min(local, limits[ACCELERATION_LIMIT, i] / p)
            local_jerk = min(local_jerk, limits[JERK_LIMIT, i] / p)
        gentle, gentle_jerk, jerk = min(gentle, local), min(gentle_jerk, local_jerk), max(jerk, local_jerk)
        most = max(most, local) if point > 0 else local
    out.a, out.j = min(4.0 * most, HIGHEST_PATH_ACCELERATION), min(2.0 * jerk, HIGHEST_PATH_JERK)
    last = out.d.shape[0] - 1
    fast = max(abs(v) + target, 1e-3)
    out.length = 6.0 * change / gentle + fast * (3.0 * np.sqrt(abs(v - target) / gentle_jerk) + 1e-3)
    m = begin
    for k in range(last + 1):
        share = k / last
        m = _derivatives(breaks, coefficients, m, min(s + share * share * out.length, breaks[-1]), rec.lo)
        for i in range(n):
            out.d[k, 0, i], out.d[k, 1, i], out.d[k, 2, i] = rec.lo[1, i], rec.lo[2, i], rec.lo[3, i]


@njit(cache=True, error_model="numpy")
def _phases(
    v: float, a: float, target: float, a_s: float, j_s: float
) -> tuple[float, float, float, float, float]:
    """Return direction, peak of |s̈| and the durations of build-up, hold and release of a change of speed."""
    direction = 1.0 if target >= v + a * abs(a) / (2.0 * j_s) else -1.0
    change, along = direction * (target - v), direction * a
    peak, hold = np.sqrt(max(j_s * change + 0.5 * a * a, 0.0)), 0.0
    if peak > a_s:
        peak = a_s
        hold = (change + 0.5 * a * a / j_s) / a_s - a_s / j_s
    return direction, peak, max(peak - along, 0.0) / j_s, hold, peak / j_s


@njit(cache=True, error_model="numpy")
def _keeps(
    rec: Record, x: float, v: float, a: float, j: float, tau: float, limits: Array, margin: float
) -> bool:
    """Tell whether ``margin`` times the joint limits are kept ``tau`` after s, ṡ, s̈ = ``x, v, a``."""
    last = rec.d.shape[0] - 1
    at = x + tau * (v + tau * (0.5 * a + tau * j / 6.0))
    speed, acceleration = v + tau * (a + 0.5 * tau * j), a + tau * j
    if not 0.0 <= at <= rec.length:
        return False
    place = last * np.sqrt(at / rec.length)
    k = min(int(place), last - 1)
    w = place - k
    for i in range(limits.shape[1]):
        d1 = rec.d[k, 0, i] + w * (rec.d[k + 1, 0, i] - rec.d[k, 0, i])
        d2 = rec.d[k, 1, i] + w * (rec.d[k + 1, 1, i] - rec.d[k, 1, i])
        d3 = rec.d[k, 2, i] + w * (rec.d[k + 1, 2, i] - rec.d[k, 2, i])
        if not (
            abs(d2 * speed * speed + d1 * acceleration) <= margin * limits[ACCELERATION_LIMIT, i]
            and abs(speed * (d3 * speed * speed + 3.0 * d2 * acceleration) + d1 * j)
            <= margin * limits[JERK_LIMIT, i]
            and abs(d1 * speed) <= margin * limits[VELOCITY_LIMIT, i]
        ):
            return False
    return True


@njit(cache=True, error_model="numpy")
def _predicted(
    v: float, a: float, target: float, a_s: float, j_s: float, limits: Array, margin: float, ahead: Block
) -> bool:
    """Tell whether 17 instants of the change of speed keep ``margin`` times the joint limits.

    The instant that forbade another change of speed is looked at first: it is likely to forbid this one.
    """
    rec = ahead[0]
    direction, _, build, hold, release = _phases(v, a, target, a_s, j_s)
    j1, x1 = direction * j_s, build * (v + build * (0.5 * a + build * (direction * j_s) / 6.0))
    v1, a1 = v + build * (a + 0.5 * build * j1), a + build * j1
    x2 = x1 + hold * (v1 + hold * (0.5 * a1))
    v2, j2 = v1 + hold * a1, -j1
    hard = rec.hard
    for turn in range(18):
        point = hard if turn == 0 else turn - 1
        if turn > 0 and point == hard:
            continue
        if point < 5:
            kept = _keeps(rec, 0.0, v, a, j1, build * point / 4.0, limits, margin)
        elif point < 12:
            kept = _keeps(rec, x1, v1, a1, 0.0, hold * (point - 5) / 6.0, limits, margin)
        else:
            kept = _keeps(rec, x2, v2, a1, j2, release * (point - 12) / 4.0, limits, margin)
        if not kept:
            rec.hard = point
            return False
    return True


@njit(cache=True, error_model="numpy")
def predict_quickest(
    v: float, a: float, target: float, limits: Array, margin: float, ahead: Block, out: Array
) -> bool:
    """Write path acceleration and jerk of the quickest change of speed that is predicted to keep the limits.

    Logarithmic grid in both, then finer steps about the best; False: none found. ``a`` is s̈ at the begin.
    """
    rec = ahead[0]
    best = np.inf
    a_best, j_best = 0.0, 0.0
    least = max(abs(a), LEAST_PATH_ACCELERATION)
    j_s = rec.j
    for _ in range(12):
        a_s = min(rec.a, np.sqrt(j_s * abs(target - v) + a * a))
        for _ in range(12):
            a_s = max(a_s, least)
            _, _, build, hold, release = _phases(v, a, target, a_s, j_s)
            if not build + hold + release < best:
                break
            if _predicted(v, a, target, a_s, j_s, limits, margin, ahead):
                best, a_best, j_best = build + hold + release, a_s, j_s
                break
            if a_s == least or rec.hard == 0:  # at its first instant nothing depends on a_s
                break
            a_s *= 0.65
        j_s *= 0.5
    if not best < np.inf:
        return False
    for step in (1.4, 1.2, 1.09, 1.04):
        improved = True
        tries = 0
        while improved and tries < 4:
            improved = False
            tries += 1
            for move in range(5):
                a_s = a_best * (1.0 if move == 1 else (1.0 / step if move == 4 else step))
                j_s = j_best * (1.0 if move == 0 else (1.0 / step if move == 3 else step))
                a_s = max(min(a_s, HIGHEST_PATH_ACCELERATION), least)
                j_s = min(j_s, HIGHEST_PATH_JERK)
                _, _, build, hold, release = _phases(v, a, target, a_s, j_s)
                if build + hold + release < 0.999 * best and _predicted(
                    v, a, target, a_s, j_s, limits, margin, ahead
                ):
                    best, a_best, j_best = build + hold + release, a_s, j_s
                    improved = True
    out[0], out[1] = a_best, j_best
    return True


_BELOW = 1.0 - 1e-6
"""Keeps a budget that touches a limit below it in spite of rounding."""


@njit(cache=True, error_model="numpy")
def conservative_budget(
    breaks: Array,
    coefficients: Array,
    s: float,
    v: float,
    a: float,
    s_max: float,
    limits: Array,
    work: Block,
    out: Array,
) -> bool:
    """Write path acceleration and jerk of a stop that the largest q', q'', q''' over its stretch allow.

    a_s = min_j (a_j - max|q''| σ²) / max|q'|, j_s = min_j (j_j - max|q'''| σ³ - 3 max|q''| σ a_s) / max|q'|,
    over the stretch that the stop needs: it is widened until it holds it. ``out`` = (a_s, j_s); False: none.
    """
    rec = work[0]
    stretch = 0.05 * max(v, 0.1)
    first = locate(breaks, s)
    speed = v
    for _ in range(24):
        if not s + stretch <= s_max:
            stretch = s_max - s
        derivative_bounds(breaks, coefficients, first, s, s + stretch, rec.lo, rec.hi)
        path_a, path_j = HIGHEST_PATH_ACCELERATION, HIGHEST_PATH_JERK
        for i in range(limits.shape[1]):
            d1 = max(abs(rec.lo[1, i]), abs(rec.hi[1, i]))
            d2 = max(abs(rec.lo[2, i]), abs(rec.hi[2, i]))
            path_a = min(path_a, (limits[ACCELERATION_LIMIT, i] - d2 * speed * speed) / d1)
        for i in range(limits.shape[1]):
            d1 = max(abs(rec.lo[1, i]), abs(rec.hi[1, i]))
            d2 = max(abs(rec.lo[2, i]), abs(rec.hi[2, i]))
            d3 = max(abs(rec.lo[3, i]), abs(rec.hi[3, i]))
            room = limits[JERK_LIMIT, i] - d3 * speed * speed * speed - 3.0 * d2 * speed * path_a
            path_j = min(path_j, room / d1)
        if not (path_a > 0.0 and path_j > 0.0 and abs(a) <= path_a * _BELOW):
            return False
        faster = v + max(a, 0.0) ** 2 / (2.0 * path_j)
        # time: lose a first, then the speed with a ramp at both ends
        needed = faster * (max(a, 0.0) / path_j + faster / path_a + path_a / path_j)
        out[0], out[1] = path_a * _BELOW, path_j * _BELOW
        if needed <= stretch and faster <= speed:
            return True
        if s + stretch >= s_max:
            return False
        stretch, speed = max(stretch, 1.05 * needed), max(speed, faster * 1.01)
    return False


# Joint-space stop.


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
    positions at the extrema within the limits, at rest at the end. Else ``work`` has the witness.
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
            _witness(work, i, JERK, j, j_limit)
            return False
        if d <= _SHORTEST or n == MAX_SEGMENTS:
            continue
        rec.q[n, i], rec.v[n, i], rec.a[n, i], rec.j[n, i] = q, v, a, j
        rec.t[n + 1, i] = t + d
        d = rec.t[n + 1, i] - t
        q, v, a, t = q + d * (v + d * (0.5 * a + d * j / 6.0)), v + d * (a + 0.5 * j * d), a + j * d, t + d
        n += 1
    if not abs(v) <= _END_TOLERANCE * max(1.0, v_limit):
        _witness(work, i, VELOCITY, v, 0.0)
        return False
    if not abs(a) <= _END_TOLERANCE * max(1.0, a_limit):
        _witness(work, i, ACCELERATION, a, 0.0)
        return False
    rec.segments[i], rec.q_end[i] = n, q
    if n > 0:
        d, j = rec.t[n, i] - rec.t[n - 1, i], rec.j[n - 1, i]
        rec.v[n - 1, i], rec.a[n - 1, i] = 0.5 * j * d * d, -j * d
        rec.q_end[i] = rec.q[n - 1, i] + d * d * d * j / 6.0
    for k in range(n):
        q_lo, q_hi, v_max, a_max = _axis_range(axes, i, k, rec.t[k, i], rec.t[k + 1, i])
        if not v_max <= v_limit * slack:
            _witness(work, i, VELOCITY, v_max, v_limit)
            return False
        if not a_max <= a_limit * slack:
            _witness(work, i, ACCELERATION, a_max, a_limit)
            return False
        if positions and not q_lo >= limits[LOWER, i]:
            _witness(work, i, POSITION, q_lo, limits[LOWER, i])
            return False
        if positions and not q_hi <= limits[UPPER, i]:
            _witness(work, i, POSITION, q_hi, limits[UPPER, i])
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
    wide = 16.0 * _EPS * (abs(q_lo) + abs(q_hi)) + 1e-15
    return q_lo - wide, q_hi + wide, v_max * (1.0 + 16.0 * _EPS) + 1e-15, np.maximum(abs(a0), abs(a1))


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
