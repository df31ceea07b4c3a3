"""Compiled search for the path acceleration and jerk of a stop.

What it finds are predictions: :func:`failsafe.limit_kernels.proven` decides.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.limit_kernels import ACCELERATION_LIMIT, JERK_LIMIT, VELOCITY_LIMIT
from failsafe.trajectory_kernels import derivative_bounds, locate
from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]
Record = Any
"""The one element of a block."""

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

_BELOW = 1.0 - 1e-6
"""Keeps a budget that touches a limit below it in spite of rounding."""


@njit(cache=True, error_model="numpy")
def _derivatives(breaks: Array, coefficients: Array, m: int, s: float, out: Array) -> int:
    """Write q', q'', q''' at ``s`` into the rows 1 to 3 of ``out (>= 4, >= n)``; return the span of ``s``.

    As :func:`failsafe.trajectory_kernels.evaluate`, where ``m`` is the span of ``s`` or one before it.
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
