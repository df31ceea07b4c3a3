"""Compiled arm reach as published: intervals of joint values (docs/method.md, section 4.2).

Every test is written so that NaN fails it: a number that is not finite gives no row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.humans.kernels import LARGEST_M

Array = NDArray[np.float64]
Record = Any
"""One record of a block: its fields are attributes in compiled code."""

MOST_NODES = 31
"""Directions of a hull that has room for the shoulder too."""
ALIKE = 1e-9
"""Grids whose errors differ by less are as good as each other: rounding does not choose between them."""
SMALLEST_M = 1e-6
"""Lengths below this give no direction [m]."""


@njit(cache=True, error_model="numpy")
def dot(a: Array, b: Array) -> float:
    """Scalar product of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True, error_model="numpy")
def length(a: Array) -> float:
    """Length of a vector (3,)."""
    return float(np.sqrt(dot(a, a)))


@njit(cache=True, error_model="numpy")
def seen_angle(radius: float, distance: float) -> float:
    """Half-angle [rad] of the cone that contains a ball of ``radius`` at ``distance``; π around its apex."""
    return float(np.arcsin(radius / distance)) if radius < distance else np.pi


@njit(cache=True, error_model="numpy")
def _torso_frame(seen: Record, k: int, side: int, limits: Record, frame: Array) -> bool:
    """Write unit vectors down, forward and outward from arm ``side`` into ``frame`` (3, 3).

    From both shoulders and two points of the trunk, all seen when that arm was; False if there are none.
    """
    own = limits.point[side, 0]
    other = limits.point[1 - side, 0]
    for j in range(limits.trunk.shape[0]):
        low, high = limits.trunk[j, 0], limits.trunk[j, 1]
        usable = True
        for p in (other, low, high):
            usable = (
                usable and (int(seen.present[k]) >> p) & 1 != 0 and seen.t_obs[k, p] == seen.t_obs[k, own]
            )
            for axis in range(3):
                usable = usable and abs(seen.xyz[k, p, axis]) < LARGEST_M
        if not usable:
            continue
        outward = seen.xyz[k, own] - seen.xyz[k, other]
        down = seen.xyz[k, low] - seen.xyz[k, high]
        if not length(outward) > SMALLEST_M:
            continue
        outward /= length(outward)
        down -= dot(down, outward) * outward
        if not length(down) > SMALLEST_M:
            continue
        down /= length(down)
        frame[0], frame[2] = down, outward
        frame[1] = np.cross(down, outward) if side == 0 else np.cross(outward, down)
        return True
    return False


@njit(cache=True, error_model="numpy")
def published_hull(
    seen: Record,
    at: tuple[int, int],
    known: Array,
    errors: tuple[float, float, float],
    elapsed: float,
    limits: Record,
    points: Array,
) -> tuple[int, float]:
    """Write the points of the published face; return their number (0: none) and what the radius grows by [m].

    ``at``: people row and arm; ``elapsed``: greatest time since the arm was seen [s].
    """
    k, side = at
    frame = np.empty((3, 3))
    if not _torso_frame(seen, k, side, limits, frame):
        return 0, np.nan
    box = np.empty((3, 2))
    if not joint_box(known, frame, errors, elapsed, limits, box):
        return 0, np.nan
    points[0] = known[0]
    n, sagitta = write_grid(points, frame, box)
    e_p = 0.0
    for p in limits.point[side]:
        e_p = max(e_p, seen.e_p[k, p])
    return n, sagitta + e_p + limits.base_speed * elapsed


@njit(cache=True, error_model="numpy")
def joint_box(
    known: Array,
    frame: Array,
    errors: tuple[float, float, float],
    elapsed: float,
    limits: Record,
    box: Array,
) -> bool:
    """Write the intervals of both angles [rad] and the extension [m] into ``box`` (3, 2); False: empty.

    Pereira and Althoff, Online formal verification, III-B: R1, R2 and R3 intersected, the angles then widened
    by the turning of the base.
    """
    d, v = known[1], known[2]
    e_p, e_v = errors[0], errors[1]
    r = length(d)
    if not r > SMALLEST_M:
        return False
    down, forward, outward = dot(frame[0], d), dot(frame[1], d), dot(frame[2], d)
    flat = np.sqrt(down * down + forward * forward)
    middle = 0.5 * (limits.low[0] + limits.high[0])
    q1, q2 = np.arctan2(forward, down), np.arctan2(outward, flat)
    if abs(q1 - middle) > np.pi:
        q1 += 2.0 * np.pi if q1 < middle else -2.0 * np.pi
    e_q = seen_angle(e_p, r)
    room = flat / r
    e_q1 = seen_angle(np.sin(e_q), room) if e_q < 0.5 * np.pi else np.pi
    q, e = (q1, q2, r), (e_q1, e_q, e_p)
    along, across = dot(v, d), dot(frame[2], v)
    turning = (dot(frame[1], v) * down - dot(frame[0], v) * forward) / (flat * flat)
    dq = (turning, (across * r - outward * along / r) / (r * flat), along / r)
    e_dq = (e_v / flat, e_v / r, e_v)
    with_acceleration = e_v < np.inf and flat > SMALLEST_M
    for j in range(3):
        reach = limits.rate[j] * elapsed
        low, high = max(limits.low[j], q[j] - e[j] - reach), min(limits.high[j], q[j] + e[j] + reach)
        if with_acceleration:
            change, spread = dq[j] * elapsed, elapsed * (e_dq[j] + 0.5 * limits.change[j] * elapsed)
            low = max(low, q[j] - e[j] + min(0.0, change - spread))
            high = min(high, q[j] + e[j] + max(0.0, change + spread))
        if not low <= high:
            return False
        drift = limits.drift * elapsed if j < 2 else 0.0
        box[j, 0], box[j, 1] = low - drift, high + drift
    box[0, 1] = min(box[0, 1], box[0, 0] + 2.0 * np.pi)
    box[1, 0], box[1, 1] = max(box[1, 0], -0.5 * np.pi), min(box[1, 1], 0.5 * np.pi)
    return True


@njit(cache=True, error_model="numpy")
def write_grid(points: Array, frame: Array, box: Array) -> tuple[int, float]:
    """Write directions of ``box`` at its longest extension about ``points[0]`` from row 1 on.

    Returns the number of points and the radius [m] by which their hull must grow to contain all others.
    """
    width, height, most = box[0, 1] - box[0, 0], box[1, 1] - box[1, 0], box[2, 1]
    best, rows = np.inf, 2
    for n in range(2, MOST_NODES // 2 + 1):
        columns = MOST_NODES // n
        error = _sagitta(width / (columns - 1)) + _sagitta(height / (n - 1))
        if error < best - ALIKE:
            best, rows = error, n
    columns = MOST_NODES // rows
    n = 1
    for i in range(rows):
        q2 = box[1, 0] + height * i / (rows - 1)
        for j in range(columns):
            q1 = box[0, 0] + width * j / (columns - 1)
            across = np.cos(q2)
            for axis in range(3):
                flat = np.cos(q1) * frame[0, axis] + np.sin(q1) * frame[1, axis]
                points[n, axis] = points[0, axis] + most * (across * flat + np.sin(q2) * frame[2, axis])
            n += 1
    return n, most * best


@njit(cache=True, error_model="numpy")
def _sagitta(step: float) -> float:
    """Greatest distance of a unit arc of ``step`` [rad] from its chord; infinite beyond half a circle."""
    return float(1.0 - np.cos(0.5 * step)) if step <= np.pi else np.inf
