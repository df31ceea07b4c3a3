"""Compiled path motion of a plan: segments of constant path jerk, states on them, and their acceptance test.

Notation as in docs/method.md, section 2. Every comparison is written so that NaN proves nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.trajectory_kernels import evaluate
from robots.motion import Block

Array = NDArray[np.float64]

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

SHORTEST = 1e-12
"""Segments shorter than this [s] are dropped, what that leaves open is held against ``END_TOLERANCE``;
path speeds above minus this count as 0."""
END_TOLERANCE = 1e-9
"""Relative difference between the end of the integrated segments and the target that the anchor may close."""


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
    if -SHORTEST <= speed < 0.0:  # rounding: the acceptance test admits no more
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
    while n > 1 and rec.t[n - 1] >= duration - SHORTEST:
        n -= 1
    whole = n == rec.n
    met = whole and n > 0 and abs(duration - rec.t[n]) <= SHORTEST
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
        if d <= SHORTEST:
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
        abs(v - target) <= END_TOLERANCE * max(1.0, highest) and abs(a) <= END_TOLERANCE * max(1.0, a_limit)
    ):
        return NOT_AT_TARGET
    rec.s_end, rec.v_end = s, target
    if k > first:
        _anchor(path, k - 1)
    for i in range(first, k):
        low, high = speed_range(path, i, rec.t[i], rec.t[i + 1])
        if not low >= -SHORTEST:
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
def speed_range(path: Block, k: int, tau0: float, tau1: float) -> tuple[float, float]:
    """Return the smallest and largest ṡ of segment ``k`` over [tau0, tau1]."""
    rec = path[0]
    _, v0, a0, j = path_state(path, k, tau0)
    _, v1, a1, _ = path_state(path, k, tau1)
    low, high = np.minimum(v0, v1), np.maximum(v0, v1)
    if k != rec.anchored and a0 * a1 < 0.0:
        turn = rec.v[k] - 0.5 * rec.a[k] * rec.a[k] / j
        low, high = np.minimum(low, turn), np.maximum(high, turn)
    return low, high
