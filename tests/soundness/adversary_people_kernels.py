"""Compiled people: they keep their limb lengths, move no faster than the profile, and chase the arm."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.body import Point

Array = NDArray[np.float64]
Block = NDArray[np.void]

MAX_PEOPLE, MAX_POINTS = 3, 20
AWAY, CHASE, FLICKER, BANG, POUNCE, WANDER, STAND, MODES = 0, 1, 2, 3, 4, 5, 6, 7
FAR_M = 3.2
"""Nobody goes farther away than this: there would be nothing to see of them."""
EXECUTING, FAILSAFE, RECOVERING = 1, 2, 3
"""States of the supervisor."""
PEOPLE = np.dtype(
    [
        ("n", np.int64),
        ("random", np.uint64),
        ("speed", np.float64),
        ("base", np.float64, (3,)),
        ("before", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("points", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("active", np.int64),
        ("mode", np.int64, (MAX_PEOPLE,)),
        ("until", np.float64, (MAX_PEOPLE,)),
        ("toggle", np.float64, (MAX_PEOPLE,)),
        ("approach", np.int64, (MAX_PEOPLE,)),
        ("share", np.float64, (MAX_PEOPLE,)),
        ("dwell", np.float64, (MAX_PEOPLE,)),
        ("way", np.float64, (MAX_PEOPLE, 3)),
        ("last", np.float64, (MAX_PEOPLE,)),
        ("height", np.float64, (MAX_PEOPLE,)),
        ("weights", np.float64, (MODES,)),
    ]
)
"""``before`` and ``points``: body points at the begin and the end of the cycle that runs [m], lines between.
``active``: who goes for the arm; others keep out of the way.
``share`` of the speed is spent on walking, the rest on limbs. ``weights``: how likely each mode is."""

_L_ARM = (Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP)
_R_ARM = (Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP)
LIMBS = (
    (Point.L_SHOULDER, _L_ARM),
    (Point.L_ELBOW, _L_ARM[1:]),
    (Point.L_WRIST, _L_ARM[2:]),
    (Point.R_SHOULDER, _R_ARM),
    (Point.R_ELBOW, _R_ARM[1:]),
    (Point.R_WRIST, _R_ARM[2:]),
    (Point.L_HIP, (Point.L_KNEE, Point.L_ANKLE)),
    (Point.L_KNEE, (Point.L_ANKLE,)),
    (Point.R_HIP, (Point.R_KNEE, Point.R_ANKLE)),
    (Point.R_KNEE, (Point.R_ANKLE,)),
    (Point.PELVIS, tuple(point for point in Point if point != Point.PELVIS)),
)
"""What turns about which point."""
PIVOT = np.array([pivot for pivot, _ in LIMBS], dtype=np.int64)
TURNS = np.array([[point in turned for point in Point] for _, turned in LIMBS])
LAST_LIMB = len(LIMBS) - 1


@njit(cache=True, error_model="numpy")
def uniform(people: Block) -> float:
    """A random number in [0, 1), from the state in the block."""
    rec = people[0]
    x = rec.random
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    rec.random = x
    return float(x >> np.uint64(11)) * 2.0**-53


@njit(cache=True, error_model="numpy")
def direction(people: Block, out: Array) -> None:
    """Write a random unit vector (3,)."""
    z, angle = 2.0 * uniform(people) - 1.0, 2.0 * np.pi * uniform(people)
    ring = np.sqrt(1.0 - z * z)
    out[0], out[1], out[2] = ring * np.cos(angle), ring * np.sin(angle), z


@njit(cache=True, error_model="numpy")
def moved(body: Array, limb: int, spin: Array, walk: Array, scale: float, out: Array) -> float:
    """Write the body (20, 3) with a limb turned by ``spin`` [rad] and all shifted by ``walk`` [m].

    Both are multiplied by ``scale``. Returns how far the fastest point went [m].
    """
    pivot = body[PIVOT[limb]]
    angle = scale * np.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    c, s = np.cos(angle), np.sin(angle)
    u0 = u1 = u2 = 0.0
    if angle > 0.0:
        u0, u1, u2 = scale * spin[0] / angle, scale * spin[1] / angle, scale * spin[2] / angle
    farthest = 0.0
    for p in range(body.shape[0]):
        x, y, z = body[p, 0], body[p, 1], body[p, 2]
        if TURNS[limb, p]:
            r0, r1, r2 = x - pivot[0], y - pivot[1], z - pivot[2]
            along = (u0 * r0 + u1 * r1 + u2 * r2) * (1.0 - c)
            x = pivot[0] + c * r0 + s * (u1 * r2 - u2 * r1) + along * u0
            y = pivot[1] + c * r1 + s * (u2 * r0 - u0 * r2) + along * u1
            z = pivot[2] + c * r2 + s * (u0 * r1 - u1 * r0) + along * u2
        out[p, 0], out[p, 1], out[p, 2] = x + scale * walk[0], y + scale * walk[1], z + scale * walk[2]
        went = 0.0
        for axis in range(3):
            went += (out[p, axis] - body[p, axis]) ** 2
        farthest = max(farthest, np.sqrt(went))
    return farthest


@njit(cache=True, error_model="numpy")
def step_body(body: Array, limb: int, spin: Array, walk: Array, far: float, out: Array) -> None:
    """Move a body so that its fastest point goes ``far`` [m] or a little less, never more."""
    scale = 1.0
    for _ in range(8):
        went = moved(body, limb, spin, walk, scale, out)
        if went <= far and went >= 0.99 * far:
            return
        if went <= 0.0:
            return
        scale *= 0.999 * far / went
    if not moved(body, limb, spin, walk, scale, out) <= far:
        out[:] = body


@njit(cache=True, error_model="numpy")
def advance_people(people: Block, near: Block, dt: float, t: float, state: int) -> None:
    """Move everybody on by a cycle of ``dt`` [s] that begins at ``t``; ``near``: nearest pairs (persons,);
    ``state``: what the robot does.
    """
    rec = people[0]
    walk, spin = np.empty(3), np.empty(3)
    rec.before[:] = rec.points
    for p in range(rec.n):
        _decide(people, p, near[p].distance, t, state)
        limb, speed = _wish(people, p, near[p], walk, spin)
        step_body(rec.before[p], limb, spin, walk, speed * dt * (1.0 - 1e-9), rec.points[p])


@njit(cache=True, error_model="numpy")
def _decide(people: Block, p: int, near: float, t: float, state: int) -> None:
    """Choose what somebody is up to, for a while; and whether they approach the arm right now."""
    rec = people[0]
    if t >= rec.until[p]:
        rec.until[p] = t + 0.3 + 2.5 * uniform(people)
        rec.toggle[p] = t
        if p == 0 and uniform(people) < 0.5:
            rec.active = int(uniform(people) * rec.n)
        draw, mode = uniform(people), 0
        while mode < MODES - 1 and draw >= rec.weights[mode]:
            draw -= rec.weights[mode]
            mode += 1
        rec.mode[p] = mode
        rec.share[p] = 1.0 if uniform(people) < 0.5 else uniform(people)
        rec.dwell[p] = 0.4 * uniform(people) ** 3
        if mode == CHASE:
            rec.until[p] = t + 0.2 + 0.8 * uniform(people)
        direction(people, rec.way[p])
    mode = rec.mode[p]
    if mode == CHASE:
        rec.approach[p] = 1
    elif mode == FLICKER:
        if state != EXECUTING:
            late = state == FAILSAFE and rec.dwell[p] > 0.1
            soon = state == RECOVERING and rec.dwell[p] < 0.05
            rec.approach[p] = 1 if late or soon else 0
            rec.toggle[p] = t + rec.dwell[p]
        elif t >= rec.toggle[p]:
            rec.approach[p] = 1
    elif mode == BANG:
        if t >= rec.toggle[p]:
            rec.approach[p] = 1 - rec.approach[p]
            rec.toggle[p] = t + 0.02 + rec.dwell[p]
    elif mode == POUNCE:
        if near < 0.3 + rec.dwell[p] and near < rec.last[p] and state != 0:
            rec.approach[p] = 1
        elif near > 1.0:
            rec.approach[p] = 0
    rec.last[p] = near


@njit(cache=True, error_model="numpy")
def _wish(people: Block, p: int, near: np.void, walk: Array, spin: Array) -> tuple[int, float]:
    """Write which way to walk, and how to turn which limb; return that limb and the speed to use [m/s]."""
    rec = people[0]
    body, mode = rec.points[p], rec.mode[p]
    passive = p != rec.active
    apart = gone = 0.0
    for axis in range(3):
        walk[axis], spin[axis] = near.on_link[axis] - near.on_body[axis], 0.0
        apart += walk[axis] ** 2
    for axis in range(2):
        gone += (body[Point.PELVIS, axis] - rec.base[axis]) ** 2
    far_away = gone > FAR_M * FAR_M
    if mode == STAND or (mode == POUNCE and rec.approach[p] == 0):
        if not (passive and near.distance < 1.0):
            walk[:] = 0.0
            return LAST_LIMB, 0.0
    elif mode == WANDER:
        for axis in range(3):
            walk[axis] = rec.way[p, axis]
        walk[2] = 0.2 * (rec.height[p] - body[Point.PELVIS, 2])
        for axis in range(3):
            spin[axis] = 2.0 * rec.way[p, (axis + 1) % 3]
        if far_away:
            for axis in range(2):
                walk[axis] = rec.base[axis] - body[Point.PELVIS, axis]
        if not passive or near.distance > 1.0:
            return int(10.0 * rec.dwell[p]) % (LAST_LIMB + 1), rec.speed * rec.share[p]
        for axis in range(3):
            walk[axis], spin[axis] = near.on_link[axis] - near.on_body[axis], 0.0
    apart = max(np.sqrt(apart), 1e-9)
    if not (mode in (CHASE, FLICKER, BANG, POUNCE) and rec.approach[p] == 1 and not passive):
        if far_away or (passive and near.distance > 1.5):
            walk[:] = 0.0
            return LAST_LIMB, 0.0
        for axis in range(3):
            walk[axis] = -walk[axis] / apart
        walk[2] = 0.5 * (rec.height[p] - body[Point.PELVIS, 2])
        return LAST_LIMB, rec.speed
    limb = LAST_LIMB
    if rec.share[p] < 1.0:
        limb = _reach_out(rec, p, near, walk, spin)
    for axis in range(3):
        walk[axis] *= rec.share[p] / apart
    return limb, rec.speed


@njit(cache=True, error_model="numpy")
def _reach_out(rec: np.void, p: int, near: np.void, way: Array, spin: Array) -> int:
    """Turn the limb whose end is nearest to the arm towards it, as fast as walking would leave."""
    body = rec.points[p]
    nearest_point, least = 0, np.inf
    for point in range(MAX_POINTS):
        off = 0.0
        for axis in range(3):
            off += (body[point, axis] - near.on_body[axis]) ** 2
        if off < least:
            nearest_point, least = point, off
    limb = LAST_LIMB
    for number in range(LAST_LIMB):
        if TURNS[number, nearest_point] and (limb == LAST_LIMB or rec.dwell[p] < 0.15):
            limb = number
    pivot, r, size = body[PIVOT[limb]], np.empty(3), 0.0
    for axis in range(3):
        r[axis] = near.on_body[axis] - pivot[axis]
        size += r[axis] ** 2
    size = max(size, 1e-4)
    apart = max(np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2), 1e-9)
    rest = (1.0 - rec.share[p]) / (size * apart)
    spin[0] = (r[1] * way[2] - r[2] * way[1]) * rest
    spin[1] = (r[2] * way[0] - r[0] * way[2]) * rest
    spin[2] = (r[0] * way[1] - r[1] * way[0]) * rest
    return limb


@njit(cache=True, error_model="numpy")
def see(people: Block, near: Block, x: float, kind: int, error: Array, bias: Array, out: Array) -> None:
    """Write what a sensor reports of everybody at the share ``x`` of the cycle.

    Off by at most ``error`` (20,) [m]; ``kind`` 0: away from the arm, 1: at random, 2: by ``bias`` (persons,
    20, 3), 3: exact.
    """
    rec = people[0]
    way = np.zeros(3)
    for p in range(rec.n):
        apart = 0.0
        for axis in range(3):
            way[axis] = near[p].on_body[axis] - near[p].on_link[axis]
            apart += way[axis] ** 2
        way /= max(np.sqrt(apart), 1e-9)
        for point in range(MAX_POINTS):
            if kind == 1:
                direction(people, way)
            for axis in range(3):
                off = way[axis] if kind < 2 else bias[p, point, axis] if kind == 2 else 0.0
                true = rec.before[p, point, axis] + x * (
                    rec.points[p, point, axis] - rec.before[p, point, axis]
                )
                out[p, point, axis] = true + error[point] * (1.0 - 1e-9) * off
