"""Compiled arm reach as published: intervals of joint values (docs/method.md, section 4.2).

Every test is written so that NaN fails it: a number that is not finite gives no row.
"""

from __future__ import annotations

from typing import Any, Final

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

JOINTS: Final = np.dtype(
    [
        ("usable", np.int64),
        ("with_rates", np.int64),
        ("e_p", np.float64),
        ("shoulder", np.float64, (3,)),
        ("frame", np.float64, (3, 3)),
        ("q", np.float64, (3,)),
        ("e_q", np.float64, (3,)),
        ("dq", np.float64, (3,)),
        ("e_dq", np.float64, (3,)),
        ("box", np.float64, (3, 2)),
    ]
)
"""Joint values of an arm as it was seen: largest error of its points [m], shoulder [m], unit vectors of the
torso down, forward and outward; azimuth and elevation [rad] and extension [m] with errors; their rates with
errors, if ``with_rates``. ``box``: intervals on one slice."""


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
def read_joints(seen: Record, k: int, side: int, arm: Record, limits: Record, joints: Record) -> None:
    """Write ``joints`` (JOINTS) of an arm (ARM) as it was seen; ``usable``: 1 if it and its torso were."""
    joints.usable, joints.e_p = 0, 0.0
    if not arm.e_p >= 0.0:
        return
    for p in limits.point[side]:
        joints.e_p = max(joints.e_p, seen.e_p[k, p])
    for axis in range(3):
        joints.shoulder[axis] = arm.shoulder[axis]
    if _torso_frame(seen, k, side, limits, joints.frame) and arm.extension > SMALLEST_M:
        joints.usable = 1
        write_joints(arm, limits, joints)


@njit(cache=True, error_model="numpy")
def write_joints(arm: Record, limits: Record, joints: Record) -> None:
    """Write joint values, their rates and the errors of both; ``joints.frame`` is known."""
    d, v, r, frame = arm.offset, arm.velocity, arm.extension, joints.frame
    down, forward, outward = dot(frame[0], d), dot(frame[1], d), dot(frame[2], d)
    flat = np.sqrt(down * down + forward * forward)
    middle = 0.5 * (limits.low[0] + limits.high[0])
    q1 = np.arctan2(forward, down)
    if abs(q1 - middle) > np.pi:
        q1 += 2.0 * np.pi if q1 < middle else -2.0 * np.pi
    e_q = seen_angle(arm.e_p, r)
    joints.q[0], joints.q[1], joints.q[2] = q1, np.arctan2(outward, flat), r
    joints.e_q[0] = seen_angle(np.sin(e_q), flat / r) if e_q < 0.5 * np.pi else np.pi
    joints.e_q[1], joints.e_q[2] = e_q, arm.e_p
    along, across = dot(v, d), dot(frame[2], v)
    joints.dq[0] = (dot(frame[1], v) * down - dot(frame[0], v) * forward) / (flat * flat)
    joints.dq[1], joints.dq[2] = (across * r - outward * along / r) / (r * flat), along / r
    joints.e_dq[0], joints.e_dq[1], joints.e_dq[2] = arm.e_v / flat, arm.e_v / r, arm.e_v
    joints.with_rates = 1 if arm.e_v < np.inf and flat > SMALLEST_M else 0


@njit(cache=True, error_model="numpy")
def published_hull(joints: Record, elapsed: float, limits: Record, points: Array) -> tuple[int, float]:
    """Write the points of the published face; return their number (0: none) and what the radius grows by [m].

    ``elapsed``: greatest time since the arm was seen [s].
    """
    if joints.usable == 0 or not joint_box(joints, elapsed, limits):
        return 0, np.nan
    for axis in range(3):
        points[0, axis] = joints.shoulder[axis]
    n, sagitta = write_grid(points, joints.frame, joints.box)
    return n, sagitta + joints.e_p + limits.base_speed * elapsed


@njit(cache=True, error_model="numpy")
def joint_box(joints: Record, elapsed: float, limits: Record) -> bool:
    """Write the intervals of both angles [rad] and the extension [m] into ``joints.box``; False: empty.

    Pereira and Althoff, Online formal verification, III-B: R1, R2 and R3 intersected, the angles then widened
    by the turning of the base.
    """
    box = joints.box
    for j in range(3):
        below, above = joints.q[j] - joints.e_q[j], joints.q[j] + joints.e_q[j]
        reach = limits.rate[j] * elapsed
        low, high = max(limits.low[j], below - reach), min(limits.high[j], above + reach)
        if joints.with_rates != 0:
            change = joints.dq[j] * elapsed
            spread = elapsed * (joints.e_dq[j] + 0.5 * limits.change[j] * elapsed)
            low = max(low, below + min(0.0, change - spread))
            high = min(high, above + max(0.0, change + spread))
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
        error = _sagitta(width / (columns - 1))
        if not error < best - ALIKE:
            break  # more rows leave fewer columns, whose error alone is no less than this
        error += _sagitta(height / (n - 1))
        if error < best - ALIKE:
            best, rows = error, n
    columns = MOST_NODES // rows
    for j in range(columns):
        q1 = box[0, 0] + width * j / (columns - 1)
        c1, s1 = np.cos(q1), np.sin(q1)
        for axis in range(3):
            points[1 + j, axis] = c1 * frame[0, axis] + s1 * frame[1, axis]
    for i in range(rows - 1, -1, -1):  # the directions above are overwritten last
        q2 = box[1, 0] + height * i / (rows - 1)
        across, along = most * np.cos(q2), most * np.sin(q2)
        for axis in range(3):
            centre = points[0, axis] + along * frame[2, axis]
            for j in range(columns):
                points[1 + i * columns + j, axis] = centre + across * points[1 + j, axis]
    return 1 + rows * columns, most * best


@njit(cache=True, error_model="numpy")
def _sagitta(step: float) -> float:
    """Greatest distance of a unit arc of ``step`` [rad] from its chord; infinite beyond half a circle."""
    return float(1.0 - np.cos(0.5 * step)) if step <= np.pi else np.inf
