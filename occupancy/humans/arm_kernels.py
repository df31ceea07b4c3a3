"""Compiled arm reach (docs/method.md, section 4.2); :mod:`occupancy.humans.arm_reach` says why it holds.

Every test is written so that NaN fails it: a number that is not finite gives no row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.humans.arm_joint_kernels import SMALLEST_M, length, published_hull, seen_angle
from occupancy.humans.kernels import LARGEST_M, ROUNDING_M
from robots.motion import Block

Array = NDArray[np.float64]
Record = Any
"""One record of a block: its fields are attributes in compiled code."""

WIDEST_CONE = np.pi / 3.0
"""A wider cone of directions is taken as the whole ball [rad]."""
AROUND = 10
"""Corners of each ring about the axis of a cone."""
BEYOND = 1.0 / np.cos(np.pi / AROUND)
"""A regular polygon whose corners are farther out by this factor contains the circle."""
WHOLE_BALL = 1.0623
"""No corner of a cone lies farther from the shoulder than this times the extension, which a cone of
``WIDEST_CONE`` attains in its second ring (1.06225); the ball has this radius so that it contains them."""


@njit(cache=True, error_model="numpy")
def occupy_arms(people: Block, slices: Block, table: Block, published: bool, out: Block) -> None:
    """Write two rows per slice, people row and arm, one for the arm and one for its hand.

    Blocks: PEOPLE, SLICES, ARMS and REACH_SETS. Instants as in :func:`occupancy.humans.kernels.occupy_speed`.
    """
    seen, plan, limits, written = people[0], slices[0], table[0], out[0]
    known = np.empty((3, 3))
    n = 0
    for i in range(plan.n):
        written.first[i] = n
        begin = plan.t[i] + plan.delay[0] - 2.0 * seen.stamp_error - seen.clock_error
        end = plan.t[i + 1] + plan.delay[1] + seen.clock_error
        for k in range(seen.n):
            for side in range(2):
                if n + 2 > written.radius.shape[0]:
                    break
                arm = limits.point[side]
                errors = read_arm(seen, k, arm, known)
                first, last = begin - seen.t_obs[k, arm[0]], end - seen.t_obs[k, arm[0]]
                longest = max(abs(first), abs(last))
                if not (errors[0] >= 0.0 and first <= last and longest < LARGEST_M):
                    continue
                if published:
                    at = (k, side)
                    count, growth = published_hull(
                        seen, at, known, errors, longest, limits, written.points[n]
                    )
                else:
                    speed = limits.shoulder_speed[side]
                    growth = errors[2] + speed * longest
                    count, more = _sound(known, errors, (first, last), limits, written.points[n])
                    growth += more
                if count == 0 or not growth + max(limits.radius[0], limits.radius[1]) < LARGEST_M:
                    continue
                written.points[n + 1, :count] = written.points[n, :count]
                for row in range(2):
                    written.n_points[n] = count
                    written.radius[n] = limits.radius[row] + growth
                    written.slice[n], written.owner[n] = i, k
                    written.covers[n] = limits.covers[side, row]
                    written.model[n] = limits.model
                    written.speed_max[n] = limits.speed_max
                    n += 1
    for i in range(plan.n, written.first.shape[0]):
        written.first[i] = n
    written.n = n


@njit(cache=True, error_model="numpy")
def read_arm(seen: Record, k: int, arm: Array, known: Array) -> tuple[float, float, float]:
    """Write shoulder, offset of the forearm's middle from it [m], and velocity of that [m/s] into ``known``.

    ``known``: (3, 3). ``arm`` (3,): columns of shoulder, elbow, wrist in row k. Returns the errors of offset
    [m], velocity [m/s, inf: unknown] and shoulder [m]; the first is NaN unless all three points were seen at
    one instant and all numbers are usable.
    """
    unusable = (np.nan, np.nan, np.nan)
    share = (-1.0, 0.5, 0.5)
    known[:, :] = 0.0
    e_p = e_v = 0.0
    for j in range(3):
        p = arm[j]
        same = seen.t_obs[k, p] == seen.t_obs[k, arm[0]]
        if not ((int(seen.present[k]) >> p) & 1 and same):
            return unusable
        if not (0.0 <= seen.e_p[k, p] < LARGEST_M and seen.e_v[k, p] >= 0.0):
            return unusable
        e_p += abs(share[j]) * seen.e_p[k, p]
        e_v += abs(share[j]) * seen.e_v[k, p]
        for axis in range(3):
            x, v = seen.xyz[k, p, axis], seen.v[k, p, axis]
            if not (abs(x) < LARGEST_M and abs(v) < LARGEST_M):
                return unusable
            known[1, axis] += share[j] * x
            known[2, axis] += share[j] * v
    for axis in range(3):
        known[0, axis] = seen.xyz[k, arm[0], axis]
    return e_p, e_v, seen.e_p[k, arm[0]]


@njit(cache=True, error_model="numpy")
def reach_cone(
    known: Array, errors: tuple[float, float, float], span: tuple[float, float], limits: Record
) -> tuple[float, float]:
    """Longest extension [m] and half-angle [rad] about the offset ``known[1]``; NaN when they contradict.

    ``span``: least and greatest time since the arm was seen [s].
    """
    d, v = known[1], known[2]
    e_p, e_v = errors[0], errors[1]
    r = length(d)
    longest = max(abs(span[0]), abs(span[1]))
    moved = e_p + limits.speed * longest
    stretched = e_p + min(limits.extension_speed, limits.speed) * longest
    least, most = max(limits.extension[0], r - stretched), min(limits.extension[1], r + stretched)
    angle = min(seen_angle(e_p, r) + limits.angular_speed * longest, seen_angle(moved, r))
    if e_v < np.inf:
        farthest = widest = 0.0
        for t in span:
            away, across, along = 0.0, 0.0, 0.0
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                centre = d[a] + v[a] * t
                side = d[b] * v[c] * t - d[c] * v[b] * t
                away, across, along = away + centre * centre, across + side * side, along + d[a] * centre
            away, across = np.sqrt(away), np.sqrt(across)
            grown = e_p + abs(t) * (e_v + 0.5 * limits.acceleration * abs(t))
            farthest = max(farthest, away + grown)
            widest = max(widest, float(np.arctan2(across, along)) + seen_angle(grown, away))
        most, angle = min(most, farthest), min(angle, widest)
    if not (least <= most and angle >= 0.0):
        return np.nan, np.nan
    return most, angle


@njit(cache=True, error_model="numpy")
def _sound(
    known: Array, errors: tuple[float, float, float], span: tuple[float, float], limits: Record, points: Array
) -> tuple[int, float]:
    """Write the points of the sound face; return their number (0: none) and what the radius grows by [m]."""
    most, angle = reach_cone(known, errors, span, limits)
    if not most >= 0.0:
        return 0, np.nan
    points[0] = known[0]
    if not angle <= WIDEST_CONE:
        return 1, WHOLE_BALL * most
    d = known[1]
    r = length(d)
    if not r > SMALLEST_M:
        return 1, WHOLE_BALL * most
    frame = np.empty((3, 3))
    frame[0] = d / r
    _complete(frame)
    half = 0.5 * WIDEST_CONE
    turn, rings = 0.5 * min(angle, half), 1
    n = write_ring(points, 1, frame, most / np.cos(turn), turn)
    if angle > half:
        n = write_ring(points, n, frame, most / np.cos(0.5 * (angle - half)), 0.5 * (angle + half))
        rings = 2
    n = write_ring(points, n, frame, most, angle)
    return 1 + (rings + 1) * AROUND, 0.0


@njit(cache=True, error_model="numpy")
def _complete(frame: Array) -> None:
    """Write two unit vectors across ``frame[0]`` into the other rows of ``frame`` (3, 3).

    They turn with the arm about the vertical unless it hangs or stands within about 26° of it.
    """
    u = frame[0]
    away = 2 if abs(u[2]) < 0.9 else 0
    for axis in range(3):
        frame[1, axis] = (1.0 if axis == away else 0.0) - u[away] * u[axis]
    frame[1] /= length(frame[1])
    frame[2] = np.cross(u, frame[1])


@njit(cache=True, error_model="numpy")
def write_ring(points: Array, n: int, frame: Array, distance: float, angle: float) -> int:
    """Write corners at ``angle`` [rad] from ``frame[0]`` about ``points[0]`` from row n on; return the next
    row.

    Their polygon contains the circle of points at ``distance`` [m] and ``angle``.
    """
    along, across = distance * np.cos(angle), distance * np.sin(angle) * BEYOND
    for j in range(AROUND):
        turn = 2.0 * np.pi * j / AROUND
        x, y = across * np.cos(turn), across * np.sin(turn)
        for axis in range(3):
            corner = along * frame[0, axis] + x * frame[1, axis] + y * frame[2, axis]
            points[n + j, axis] = points[0, axis] + corner
    return n + AROUND


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
    known = np.empty((3, 3))
    for i in range(np.searchsorted(stamps, window[0], side="right"), stamps.shape[0]):
        if not stamps[i] <= window[1]:
            break
        for side in range(2):
            arm = limits.point[side]
            errors = read_arm(seen, row, arm, known)
            if not errors[0] >= 0.0:
                continue
            elapsed = stamps[i] - seen.stamp_error - seen.t_obs[row, arm[0]]
            most, angle = reach_cone(known, errors, (elapsed - slack, elapsed + slack), limits)
            offset = 0.5 * (xyz[i, arm[1]] + xyz[i, arm[2]]) - xyz[i, arm[0]]
            error = e_p[i, arm[0]] + 0.5 * (e_p[i, arm[1]] + e_p[i, arm[2]])
            if not (most >= 0.0 and np.isfinite(offset.sum())):
                continue
            far = length(offset)
            turned = float(np.arctan2(length(np.cross(known[1], offset)), np.dot(known[1], offset)))
            across = far * np.sin(min(max(turned - angle, 0.0), 0.5 * np.pi))
            excess = max(far - most, across) - error - ROUNDING_M
            if not excess <= 0.0:
                return i, side, excess
    return -1, -1, 0.0
