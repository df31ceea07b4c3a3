"""Compiled arm reach (docs/method.md, section 4.2); :mod:`occupancy.humans.arm_reach` says why it holds.

What no slice changes is computed once for each arm. Angles of the sound face are never computed: from the
tangent of half of them follow order, sums, sines and cosines by arithmetic alone.

Every test is written so that NaN fails it: a number that is not finite gives no row.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.humans.arm_joint_kernels import JOINTS, SMALLEST_M, dot, length, published_hull, read_joints
from occupancy.humans.kernels import LARGEST_M, ROUNDING_M
from robots.motion import Block

Array = NDArray[np.float64]
Record = Any
"""One record of a block: its fields are attributes in compiled code."""
Half = tuple[float, float]
"""An angle from 0 to π: a vector (x, y) of any length at half of it, so that x >= 0 and y >= 0."""

WIDEST_CONE = float(np.tan(np.pi / 6.0))
"""Tangent of half of 60°: a wider cone of directions is taken as the whole ball."""
TOUCH = float(np.tan(np.pi / 12.0))
"""Tangent of half of 30°: the polygon of a wider cone has another edge, which touches there."""
AROUND = 10
"""Corners of each ring about the axis of a cone."""
BEYOND = 1.0 / np.cos(np.pi / AROUND)
"""A regular polygon whose corners are farther out by this factor contains the circle."""
WHOLE_BALL = 1.0623
"""No corner of a cone lies farther from the shoulder than this times the extension, which a cone of
``WIDEST_CONE`` attains in its second ring (1.06225); the ball has this radius so that it contains them."""
RING: Array = BEYOND * np.array([f(2.0 * np.pi * np.arange(AROUND) / AROUND) for f in (np.cos, np.sin)])
"""Coordinates (2, 10) of the corners of the polygon about a circle of radius 1."""

ARM: Final = np.dtype(
    [
        ("t_obs", np.float64),
        ("e_p", np.float64),
        ("e_v", np.float64),
        ("e_shoulder", np.float64),
        ("shoulder", np.float64, (3,)),
        ("offset", np.float64, (3,)),
        ("velocity", np.float64, (3,)),
        ("extension", np.float64),
        ("sweep", np.float64),
        ("blur", np.float64, (2,)),
        ("centre", np.float64, (3 * AROUND,)),
        ("axis", np.float64, (3 * AROUND,)),
        ("ring", np.float64, (3 * AROUND,)),
    ]
)
"""An arm as it was seen at ``t_obs`` [s]: shoulder, offset d of the forearm's middle from it [m], velocity v
of that [m/s], and their errors: of d [m, NaN: the arm is not usable], of v [m/s, inf: unknown], of the
shoulder [m]. ``extension`` |d| [m]; ``sweep`` |d x v| [m²/s]; ``blur``: asin(e / |d|) as a ``Half``. For ten
corners, x, y, z of one after another as in a row of points: shoulder [m], unit vector along d, and a ring of
radius 1 about it."""


@njit(cache=True, error_model="numpy")
def occupy_arms(people: Block, slices: Block, table: Block, published: bool, out: Block) -> None:
    """Write two rows per slice, people row and arm, one for the arm and one for its hand.

    Blocks: PEOPLE, SLICES, ARMS and REACH_SETS. Instants as in :func:`occupancy.humans.kernels.occupy_speed`.
    """
    seen, plan, limits, written = people[0], slices[0], table[0], out[0]
    flat, width = written.points.reshape(written.points.size), 3 * written.points.shape[1]
    arms = np.empty((seen.n, 2), ARM)
    joints = np.empty((seen.n, 2) if published else (0, 2), JOINTS)
    for k in range(seen.n):
        for side in range(2):
            read_arm(seen, k, limits.point[side], arms[k, side])
            if published:
                read_joints(seen, k, side, arms[k, side], limits, joints[k, side])
    n = 0
    for i in range(plan.n):
        written.first[i] = n
        begin = plan.t[i] + plan.delay[0] - 2.0 * seen.stamp_error - seen.clock_error
        end = plan.t[i + 1] + plan.delay[1] + seen.clock_error
        for k in range(seen.n):
            for side in range(2):
                if n + 2 > written.radius.shape[0]:
                    break
                arm = arms[k, side]
                span = (begin - arm.t_obs, end - arm.t_obs)
                longest = max(abs(span[0]), abs(span[1]))
                if not (arm.e_p >= 0.0 and span[0] <= span[1] and longest < LARGEST_M):
                    continue
                if published:
                    count, growth = published_hull(joints[k, side], longest, limits, written.points[n])
                else:
                    row = flat[n * width : (n + 1) * width]
                    count, growth = sound_hull(arm, span, limits, row)
                    growth += arm.e_shoulder + limits.shoulder_speed[side] * longest
                if count == 0 or not growth + max(limits.radius[0], limits.radius[1]) < LARGEST_M:
                    continue
                _copy(flat[n * width : n * width + 3 * count], flat[(n + 1) * width :])
                _write_rows(written, n, count, growth, (i, k, side), limits)
                n += 2
    for i in range(plan.n, written.first.shape[0]):
        written.first[i] = n
    written.n = n


@njit(cache=True, error_model="numpy")
def _write_rows(
    written: Record, n: int, count: int, growth: float, of: tuple[int, int, int], limits: Record
) -> None:
    """Complete rows n and n + 1, whose ``count`` points are there; ``of``: slice, people row and arm."""
    i, k, side = of
    for row in range(2):
        written.n_points[n + row] = count
        written.radius[n + row] = limits.radius[row] + growth
        written.slice[n + row], written.owner[n + row] = i, k
        written.covers[n + row] = limits.covers[side, row]
        written.model[n + row] = limits.model
        written.speed_max[n + row] = limits.speed_max


@njit(cache=True, error_model="numpy")
def read_arm(seen: Record, k: int, points: Array, arm: Record) -> None:
    """Write ``arm`` (ARM) of people row k; ``points`` (3,): columns of shoulder, elbow, wrist.

    ``e_p`` is NaN unless all three points were seen at one instant and all numbers are usable.
    """
    shoulder = points[0]
    arm.t_obs, arm.e_p, arm.e_v = seen.t_obs[k, shoulder], np.nan, 0.0
    e_p = 0.0
    for axis in range(3):
        arm.shoulder[axis] = seen.xyz[k, shoulder, axis]
        arm.offset[axis] = arm.velocity[axis] = 0.0
    for j in range(3):
        p, share = points[j], -1.0 if j == 0 else 0.5
        if not ((int(seen.present[k]) >> p) & 1 and seen.t_obs[k, p] == arm.t_obs):
            return
        if not (0.0 <= seen.e_p[k, p] < LARGEST_M and seen.e_v[k, p] >= 0.0):
            return
        e_p += abs(share) * seen.e_p[k, p]
        arm.e_v += abs(share) * seen.e_v[k, p]
        for axis in range(3):
            x, v = seen.xyz[k, p, axis], seen.v[k, p, axis]
            if not (abs(x) < LARGEST_M and abs(v) < LARGEST_M):
                return
            arm.offset[axis] += share * x
            arm.velocity[axis] += share * v
    arm.e_p, arm.e_shoulder = e_p, seen.e_p[k, shoulder]
    arm.extension = length(arm.offset)
    square = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        square += (arm.offset[b] * arm.velocity[c] - arm.offset[c] * arm.velocity[b]) ** 2
    arm.sweep = np.sqrt(square)
    arm.blur[0], arm.blur[1] = seen_half(e_p, arm.extension)
    _write_axes(arm)


@njit(cache=True, error_model="numpy")
def _write_axes(arm: Record) -> None:
    """Write the unit vector u along the offset and a ring about it; NaN without an offset.

    Corners lie along e - (e · u) u and u x e. With e upwards they turn with the arm about the vertical,
    unless it hangs or stands within about 26° of it.
    """
    r = arm.extension
    u = (arm.offset[0] / r, arm.offset[1] / r, arm.offset[2] / r)
    e = 2 if abs(u[2]) < 0.9 else 0
    scale = 1.0 / np.sqrt(1.0 - u[e] * u[e])
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        x = (1.0 if a == e else 0.0) - u[e] * u[a]
        y = (u[b] if c == e else 0.0) - (u[c] if b == e else 0.0)
        for j in range(AROUND):
            arm.centre[3 * j + a], arm.axis[3 * j + a] = arm.shoulder[a], u[a]
            arm.ring[3 * j + a] = scale * (RING[0, j] * x + RING[1, j] * y)


@njit(cache=True, error_model="numpy")
def _copy(source: Array, target: Array) -> None:
    """Write all of ``source`` over the beginning of ``target``: loops over one axis become vector code."""
    for j in range(source.shape[0]):
        target[j] = source[j]


@njit(cache=True, error_model="numpy")
def seen_half(radius: float, distance: float) -> Half:
    """Half-angle of the cone that contains a ball of ``radius`` at ``distance`` [m]; π around its apex."""
    if not radius < distance:
        return 0.0, 1.0
    return distance + np.sqrt((distance - radius) * (distance + radius)), radius


@njit(cache=True, error_model="numpy")
def tangent_of_sum(a: Half, b: Half) -> float:
    """Tangent of half the sum of two angles; inf from π on."""
    x, y = a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]
    return float(y / x) if x > 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def reach_cone(arm: Record, span: tuple[float, float], limits: Record) -> tuple[float, float]:
    """Longest extension [m] and tan ψ/2 of the half-angle ψ about the offset; NaN when they contradict.

    ``span``: least and greatest time since the arm was seen [s].
    """
    r, e_p = arm.extension, arm.e_p
    longest = max(abs(span[0]), abs(span[1]))
    stretched = e_p + min(limits.extension_speed, limits.speed) * longest
    least, most = max(limits.extension[0], r - stretched), min(limits.extension[1], r + stretched)
    along, across = seen_half(e_p + limits.speed * longest, r)
    half = across / along
    blur, turned = (arm.blur[0], arm.blur[1]), 0.5 * limits.angular_speed * longest
    if tangent_of_sum(blur, (1.0, turned)) < half:  # tan x >= x: else the other bound is the smaller one
        turn = (np.cos(turned), np.sin(turned)) if turned < 0.5 * np.pi else (0.0, 1.0)
        half = min(half, tangent_of_sum(blur, turn))
    if arm.e_v < np.inf:
        farthest, widest = _moved_on(arm, span[0], limits)
        far, wide = _moved_on(arm, span[1], limits)
        most, half = min(most, max(farthest, far)), min(half, max(widest, wide))
    if not (least <= most and half >= 0.0):
        return np.nan, np.nan
    return most, half


@njit(cache=True, error_model="numpy")
def _moved_on(arm: Record, t: float, limits: Record) -> tuple[float, float]:
    """Farthest distance [m], and tangent of half the largest angle from the axis, of the ball to which
    velocity and acceleration take the offset in t [s]."""
    square = along = 0.0
    for axis in range(3):
        centre = arm.offset[axis] + arm.velocity[axis] * t
        square, along = square + centre * centre, along + arm.offset[axis] * centre
    away, across = np.sqrt(square), arm.sweep * abs(t)
    product = arm.extension * away
    tilt = (product + along, across) if along > 0.0 else (across, product - along)
    grown = arm.e_p + abs(t) * (arm.e_v + 0.5 * limits.acceleration * abs(t))
    return away + grown, tangent_of_sum(tilt, seen_half(grown, away))


@njit(cache=True, error_model="numpy")
def sound_hull(arm: Record, span: tuple[float, float], limits: Record, row: Array) -> tuple[int, float]:
    """Write the points of the sound face; return their number (0: none) and what the radius grows by [m].

    ``row``: room for x, y, z of one point after another.
    """
    most, half = reach_cone(arm, span, limits)
    if not most >= 0.0:
        return 0, np.nan
    for axis in range(3):
        row[axis] = arm.shoulder[axis]
    if not (half <= WIDEST_CONE and arm.extension > SMALLEST_M):
        return 1, WHOLE_BALL * most
    rings, at = 3 if half > TOUCH else 2, 0.0
    for ring in range(rings):
        then = TOUCH if ring == 0 and rings == 3 else half
        begin = 3 * (1 + ring * AROUND)
        _write_ring(row[begin : begin + 3 * AROUND], arm, most, (at, then))
        at = then
    return 1 + rings * AROUND, 0.0


@njit(cache=True, error_model="numpy")
def _write_ring(corners: Array, arm: Record, most: float, touch: tuple[float, float]) -> None:
    """Write the ``corners`` (30,) [m] that two edges make about the axis.

    ``touch``: tangents of half the angles from the axis at which they touch the circle of radius ``most``
    [m].
    """
    a, b = touch
    scale = most / (1.0 + a * b)
    along, across = scale * (1.0 - a * b), scale * (a + b)
    for j in range(corners.shape[0]):
        corners[j] = arm.centre[j] + along * arm.axis[j] + across * arm.ring[j]


@njit(cache=True, error_model="numpy")
def first_arm_outside(
    people: Block, row: int, samples: tuple[Array, Array, Array], window: tuple[float, float], table: Block
) -> tuple[int, int, float]:
    """Find the first later arm whose forearm's middle is not in the sector of the sound face.

    ``samples`` and ``window`` as for :func:`occupancy.humans.kernels.first_outside`. A sample whose offset is
    known within e lies outside if no offset within e of it lies in the sector. Returns (sample, side, excess)
    [m]; sample = -1: none. Arms that have no rows claim nothing.
    """
    seen, limits = people[0], table[0]
    stamps, xyz, e_p = samples
    slack = 2.0 * (seen.stamp_error + seen.clock_error)
    arms = np.empty(2, ARM)
    for side in range(2):
        read_arm(seen, row, limits.point[side], arms[side])
    for i in range(np.searchsorted(stamps, window[0], side="right"), stamps.shape[0]):
        if not stamps[i] <= window[1]:
            break
        for side in range(2):
            arm, s, e, w = arms[side], limits.point[side, 0], limits.point[side, 1], limits.point[side, 2]
            if not arm.e_p >= 0.0:
                continue
            elapsed = stamps[i] - seen.stamp_error - arm.t_obs
            most, half = reach_cone(arm, (elapsed - slack, elapsed + slack), limits)
            offset = 0.5 * (xyz[i, e] + xyz[i, w]) - xyz[i, s]
            error = e_p[i, s] + 0.5 * (e_p[i, e] + e_p[i, w])
            if not (most >= 0.0 and np.isfinite(offset.sum())):
                continue
            far = length(offset)
            turned = np.arctan2(length(np.cross(arm.offset, offset)), dot(arm.offset, offset))
            across = far * np.sin(min(max(turned - 2.0 * np.arctan(half), 0.0), 0.5 * np.pi))
            excess = max(far - most, across) - error - ROUNDING_M
            if not excess <= 0.0:
                return i, side, excess
    return -1, -1, 0.0
