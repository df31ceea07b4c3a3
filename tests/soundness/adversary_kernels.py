"""Compiled truth about the arm: where it is, how near a person is to it, and whether its commands keep limits.

Own kinematics and own distances; nothing here is of the checked software. Plain twins:
tests/soundness/test_adversary_kernels.py.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.soundness.adversary_arm import MAX_JOINTS, MAX_LINKS

Array = NDArray[np.float64]
Block = NDArray[np.void]

RING = 512
"""Commands that are kept."""
VELOCITY, ACCELERATION, JERK, POSITION, CONTINUITY, QUANTITIES = 0, 1, 2, 3, 4, 5
ROUNDING = 1e-6
"""Relative excess of a limit that is rounding."""
ROUNDING_RAD = 1e-11
"""Rounding of a commanded position [rad]."""
ROBOT = np.dtype(
    [
        ("n", np.int64),
        ("cycle", np.float64),
        ("newest", np.int64),
        ("ring", np.float64, (RING, 3, MAX_JOINTS)),
        ("limits", np.float64, (5, MAX_JOINTS)),
        ("delay", np.float64, (2,)),
        ("drift", np.float64),
        ("lag_goal", np.float64),
        ("lag", np.float64, (2,)),
        ("bound", np.float64, (MAX_JOINTS,)),
        ("rate", np.float64),
        ("error", np.float64, (2, MAX_JOINTS)),
        ("excess", np.int64, (QUANTITIES,)),
        ("worst", np.float64, (QUANTITIES,)),
        ("q", np.float64, (MAX_JOINTS,)),
        ("dq", np.float64, (MAX_JOINTS,)),
        ("turn", np.float64, (MAX_JOINTS, 3, 3)),
        ("place", np.float64, (MAX_JOINTS, 3)),
        ("axis", np.float64, (MAX_JOINTS, 3)),
        ("moving", np.int64, (MAX_LINKS,)),
    ]
)
"""``ring``: q, dq, ddq of command k at k mod RING. ``limits``: velocity, acceleration, jerk, lower and upper
position. The robot follows with a delay within ``delay`` [s] that goes to ``lag_goal`` by ``drift`` [s/s], and
errors within ``bound`` [rad] that change by ``rate`` [rad/s]. ``lag`` [s] and ``error`` [rad]: at the begin and the end of the cycle that runs, linear in between.
``excess``: how often a quantity was beyond its limit, ``worst``: the largest share of it. The rest is the
state that was computed last: pose of each joint (``turn``, ``place``, ``axis``), which links move."""
FOUND = np.dtype(
    [
        ("distance", np.float64),
        ("link", np.int64),
        ("part", np.int64),
        ("on_link", np.float64, (3,)),
        ("on_body", np.float64, (3,)),
    ]
)
"""The nearest pair of a link and a body part [m]: surface to surface, negative inside of each other."""


@njit(cache=True, error_model="numpy")
def command_at(robot: Block, t: float) -> None:
    """Write what is commanded at ``t`` [s since command 0] into ``q`` and ``dq``: quintic between commands."""
    rec = robot[0]
    h = rec.cycle
    i = min(max(int(np.floor(t / h)), max(0, rec.newest - RING + 1)), rec.newest - 1)
    x = min(max(t - i * h, 0.0), h)
    before, after = rec.ring[i % RING], rec.ring[(i + 1) % RING]
    for j in range(rec.n):
        q, v, a = before[0, j], before[1, j], before[2, j]
        d = after[0, j] - (q + h * (v + 0.5 * h * a))
        e = (after[1, j] - (v + h * a)) * h
        g = (after[2, j] - a) * h * h
        c3, c4, c5 = 10 * d - 4 * e + 0.5 * g, -15 * d + 7 * e - g, 6 * d - 3 * e + 0.5 * g
        u = x / h
        rec.q[j] = q + x * (v + 0.5 * x * a) + u * u * u * (c3 + u * (c4 + u * c5))
        rec.dq[j] = v + x * a + u * u * (3 * c3 + u * (4 * c4 + 5 * u * c5)) / h


@njit(cache=True, error_model="numpy")
def note(robot: Block, q: Array, dq: Array, ddq: Array) -> None:
    """Take the next command, and hold it against the limits and against the one before.

    With a jerk of at most J over the cycle h, the state at one end is within J h, J h²/2, J h³/6 of what
    constant acceleration from the other end gives: a command that is not was jumped to.
    """
    rec = robot[0]
    h = rec.cycle
    before, after = rec.ring[rec.newest % RING], rec.ring[(rec.newest + 1) % RING]
    rec.newest += 1
    for j in range(rec.n):
        after[0, j], after[1, j], after[2, j] = q[j], dq[j], ddq[j]
        v_max, a_max, j_max = rec.limits[0, j], rec.limits[1, j], rec.limits[2, j]
        _hold(rec, VELOCITY, abs(dq[j]) / v_max)
        _hold(rec, ACCELERATION, abs(ddq[j]) / a_max)
        _hold(rec, JERK, abs(ddq[j] - before[2, j]) / h / j_max)
        if not (q[j] >= rec.limits[3, j] - ROUNDING_RAD and q[j] <= rec.limits[4, j] + ROUNDING_RAD):
            rec.excess[POSITION] += 1
        dv = dq[j] - before[1, j]
        room_v, room_q = 0.5 * j_max * h * h + ROUNDING_RAD, j_max * h * h * h / 6.0 + ROUNDING_RAD
        _hold(rec, CONTINUITY, abs(dv - h * before[2, j]) / room_v)
        _hold(rec, CONTINUITY, abs(dv - h * ddq[j]) / room_v)
        step = q[j] - before[0, j]
        _hold(rec, CONTINUITY, abs(step - h * (before[1, j] + 0.5 * h * before[2, j])) / room_q)
        _hold(rec, CONTINUITY, abs(step - h * (dq[j] - 0.5 * h * ddq[j])) / room_q)


@njit(cache=True, error_model="numpy")
def _hold(rec: np.void, quantity: int, share: float) -> None:
    """Count a share of a limit that is above 1, or not a number."""
    if not share <= 1.0 + ROUNDING:
        rec.excess[quantity] += 1
    if not share <= rec.worst[quantity]:
        rec.worst[quantity] = share


@njit(cache=True, error_model="numpy")
def robot_at(arm: Block, robot: Block, t: float, x: float) -> None:
    """Compute where the arm truly is at ``t`` [s], the share ``x`` of its cycle; which links move."""
    rec = robot[0]
    command_at(robot, t - (rec.lag[0] + x * (rec.lag[1] - rec.lag[0])))
    for j in range(rec.n):
        rec.q[j] += rec.error[0, j] + x * (rec.error[1, j] - rec.error[0, j])
    pose(arm, robot)


@njit(cache=True, error_model="numpy")
def pose(arm: Block, robot: Block) -> None:
    """Compute ``turn``, ``place`` and ``axis`` of each joint from ``q``."""
    chain, rec = arm[0], robot[0]
    for i in range(chain.n):
        turn, place = rec.turn[i], rec.place[i]
        fixed, shift, axis = chain.rotation[i], chain.translation[i], chain.axis[i]
        c, s = np.cos(rec.q[i]), np.sin(rec.q[i])
        ax, ay, az = axis[0], axis[1], axis[2]
        d = 1.0 - c
        r = (
            (c + ax * ax * d, ax * ay * d - az * s, ax * az * d + ay * s),
            (ax * ay * d + az * s, c + ay * ay * d, ay * az * d - ax * s),
            (ax * az * d - ay * s, ay * az * d + ax * s, c + az * az * d),
        )
        for a in range(3):
            m0, m1, m2 = fixed[a, 0], fixed[a, 1], fixed[a, 2]
            p = shift[a]
            if i > 0:
                up = rec.turn[i - 1]
                u0, u1, u2 = up[a, 0], up[a, 1], up[a, 2]
                m0 = u0 * fixed[0, 0] + u1 * fixed[1, 0] + u2 * fixed[2, 0]
                m1 = u0 * fixed[0, 1] + u1 * fixed[1, 1] + u2 * fixed[2, 1]
                m2 = u0 * fixed[0, 2] + u1 * fixed[1, 2] + u2 * fixed[2, 2]
                p = rec.place[i - 1, a] + u0 * shift[0] + u1 * shift[1] + u2 * shift[2]
            place[a] = p
            rec.axis[i, a] = m0 * ax + m1 * ay + m2 * az
            for b in range(3):
                turn[a, b] = m0 * r[0][b] + m1 * r[1][b] + m2 * r[2][b]


@njit(cache=True, error_model="numpy")
def which_move(arm: Block, robot: Block, centre: Array, standstill: float) -> bool:
    """Write which links have a point that is commanded faster than ``standstill`` [m/s]; tell if any does.

    Centres of clusters stand for the link: they are within its hull, so no point that is faster than all of
    the link makes it move.
    """
    chain, rec = arm[0], robot[0]
    some = False
    for j in range(rec.n):
        some |= rec.dq[j] != 0.0
    any_moves = False
    for link in range(chain.links):
        rec.moving[link] = 0
        if not some:
            continue
        joint = chain.joint[link]
        turn, place = rec.turn[joint], rec.place[joint]
        for c in range(chain.first[link], chain.first[link + 1]):
            v0 = v1 = v2 = 0.0
            x0 = place[0] + turn[0, 0] * centre[c, 0] + turn[0, 1] * centre[c, 1] + turn[0, 2] * centre[c, 2]
            x1 = place[1] + turn[1, 0] * centre[c, 0] + turn[1, 1] * centre[c, 1] + turn[1, 2] * centre[c, 2]
            x2 = place[2] + turn[2, 0] * centre[c, 0] + turn[2, 1] * centre[c, 1] + turn[2, 2] * centre[c, 2]
            for i in range(joint + 1):
                r0, r1, r2 = x0 - rec.place[i, 0], x1 - rec.place[i, 1], x2 - rec.place[i, 2]
                a0, a1, a2, w = rec.axis[i, 0], rec.axis[i, 1], rec.axis[i, 2], rec.dq[i]
                v0 += w * (a1 * r2 - a2 * r1)
                v1 += w * (a2 * r0 - a0 * r2)
                v2 += w * (a0 * r1 - a1 * r0)
            if v0 * v0 + v1 * v1 + v2 * v2 > standstill * standstill:
                rec.moving[link], any_moves = 1, True
                break
    return any_moves


@njit(cache=True, error_model="numpy")
def _share(a: Array, d: Array, dd: float, p0: float, p1: float, p2: float) -> float:
    """Where on the segment a + s d, 0 <= s <= 1, a point is nearest."""
    if dd <= 0.0:
        return 0.0
    s = ((p0 - a[0]) * d[0] + (p1 - a[1]) * d[1] + (p2 - a[2]) * d[2]) / dd
    return min(max(s, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _off(a: Array, d: Array, dd: float, p0: float, p1: float, p2: float) -> float:
    """Distance of a point from the segment a + s d."""
    s = _share(a, d, dd, p0, p1, p2)
    x, y, z = p0 - a[0] - s * d[0], p1 - a[1] - s * d[1], p2 - a[2] - s * d[2]
    return np.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def nearest(
    arm: Block,
    clusters: tuple[Array, Array, Array],
    robot: Block,
    body: Array,
    parts: tuple[NDArray[np.int64], NDArray[np.int64], Array],
    only_moving: bool,
    found: Block,
) -> bool:
    """Write the nearest pair into ``found`` if it is nearer than the distance there; tell whether it is.

    ``body`` (20, 3) [m]; ``parts``: points at the begin (S,) and end (S,) of each part, and its radius [m].
    """
    chain, rec, best = arm[0], robot[0], found[0]
    begin, end, flesh = parts
    a, d, c = np.empty(3), np.empty(3), np.empty(3)
    bounds = np.empty((chain.links, len(begin)))
    least, first = np.inf, 0
    for link in range(chain.links):
        turn, place = rec.turn[chain.joint[link]], rec.place[chain.joint[link]]
        for x in range(3):
            c[x] = place[x]
            for y in range(3):
                c[x] += turn[x, y] * chain.centre[link, y]
        for s in range(len(begin)):
            bounds[link, s] = np.inf
            if only_moving and rec.moving[link] == 0:
                continue
            dd = 0.0
            for x in range(3):
                d[x] = body[end[s], x] - body[begin[s], x]
                dd += d[x] * d[x]
            bound = _off(body[begin[s]], d, dd, c[0], c[1], c[2])
            bounds[link, s] = bound - chain.radius[link] - chain.thickness[link] - flesh[s]
            if bounds[link, s] < least:
                least, first = bounds[link, s], link * len(begin) + s
    improved = False
    for turn_of in range(-1, chain.links * len(begin)):
        pair = first if turn_of < 0 else turn_of
        link, s = pair // len(begin), pair % len(begin)
        if not bounds[link, s] < best.distance or (turn_of >= 0 and pair == first):
            continue
        turn, place = rec.turn[chain.joint[link]], rec.place[chain.joint[link]]
        dd = 0.0
        for x in range(3):
            a[x] = d[x] = 0.0
            for y in range(3):
                a[x] += turn[y, x] * (body[begin[s], y] - place[y])
                d[x] += turn[y, x] * (body[end[s], y] - body[begin[s], y])
            dd += d[x] * d[x]
        improved |= _open(chain, clusters, link, s, (a, d, dd), flesh[s], best, rec)
    return improved


@njit(cache=True, error_model="numpy")
def _open(
    chain: np.void,
    clusters: tuple[Array, Array, Array],
    link: int,
    s: int,
    segment: tuple[Array, Array, float],
    flesh: float,
    best: np.void,
    rec: np.void,
) -> bool:
    """Look at the points of one link and one part, in the frame of the link's joint; nearest cluster first."""
    centre, radius, points = clusters
    a, d, dd = segment
    less = chain.thickness[link] + flesh
    low, high = chain.first[link], chain.first[link + 1]
    bounds = np.empty(high - low)
    for c in range(low, high):
        bounds[c - low] = _off(a, d, dd, centre[c, 0], centre[c, 1], centre[c, 2]) - radius[c] - less
    start = low + int(np.argmin(bounds))
    at, where = -1, -1
    for turn_of in range(low - 1, high):
        c = start if turn_of < low else turn_of
        if not bounds[c - low] < best.distance or (turn_of >= low and c == start):
            continue
        for p in range(points.shape[1]):
            distance = _off(a, d, dd, points[c, p, 0], points[c, p, 1], points[c, p, 2]) - less
            if distance < best.distance:
                best.distance = distance
                at, where = c, p
    if at < 0:
        return False
    best.link, best.part = link, s
    turn, place = rec.turn[chain.joint[link]], rec.place[chain.joint[link]]
    p0, p1, p2 = points[at, where, 0], points[at, where, 1], points[at, where, 2]
    share = _share(a, d, dd, p0, p1, p2)
    for x in range(3):
        best.on_link[x] = place[x] + turn[x, 0] * p0 + turn[x, 1] * p1 + turn[x, 2] * p2
        best.on_body[x] = place[x]
        for y in range(3):
            best.on_body[x] += turn[x, y] * (a[y] + share * d[y])
    return True
