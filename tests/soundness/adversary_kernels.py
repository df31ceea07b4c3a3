"""Compiled truth about the arm: where it is, how near a person is, whether its commands keep their limits.

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
"""Cycles of which is known what plan the robot held."""
PLANS, SPANS, SEGMENTS = 256, 160, 24
"""Plans that are kept, and how many spans of the trajectory and segments of the path speed each may have."""
VELOCITY, ACCELERATION, JERK, POSITION, CONTINUITY, QUANTITIES = 0, 1, 2, 3, 4, 5
ROUNDING = 1e-6
"""Relative excess of a limit that is rounding."""
ROUNDING_RAD = 1e-11
"""Rounding of a commanded position [rad]."""
SAME = 1e-8
"""A command is on its plan up to this [rad, rad/s, rad/s²]: digits that differences of cubics cost."""
PLAN = np.dtype(
    [
        ("begin", np.int64),
        ("segments", np.int64),
        ("t", np.float64, (SEGMENTS + 1,)),
        ("s", np.float64, (SEGMENTS, 4)),
        ("s_end", np.float64),
        ("spans", np.int64),
        ("breaks", np.float64, (SPANS + 1,)),
        ("powers", np.float64, (SPANS, 6, MAX_JOINTS)),
    ]
)
"""A plan as the robot side holds it. From instant ``begin`` on, s is a cubic on each of the ``segments``:
from ``t`` [s after the begin] on with s, ṡ, s̈ and jerk ``s``; beyond them it rests at ``s_end``. q is a
polynomial of s on each of the ``spans``, lowest power first."""
ROBOT = np.dtype(
    [
        ("n", np.int64),
        ("cycle", np.float64),
        ("newest", np.int64),
        ("last", np.float64, (3, MAX_JOINTS)),
        ("limits", np.float64, (5, MAX_JOINTS)),
        ("slot", np.int64),
        ("earlier", np.int64),
        ("plan_of", np.int64, (RING,)),
        ("now", np.int64),
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
        ("ddq", np.float64, (MAX_JOINTS,)),
        ("turn", np.float64, (MAX_JOINTS, 3, 3)),
        ("place", np.float64, (MAX_JOINTS, 3)),
        ("axis", np.float64, (MAX_JOINTS, 3)),
        ("moving", np.int64, (MAX_LINKS,)),
    ]
)
"""``last``: q, dq, ddq of command number ``newest``. ``limits``: velocity, acceleration, jerk, lower, upper
position. The robot holds the plan in ``slot``, and until that begins the ``earlier`` one; ``plan_of``: the
one of each cycle up to ``now``. It follows with a delay within ``delay`` [s] that goes to ``lag_goal`` by
``drift`` [s/s], and errors within ``bound`` [rad] that change by ``rate`` [rad/s]. ``lag`` [s] and ``error``
[rad]: at the begin and the end of the cycle that runs, linear in between. ``excess``: how often something was
beyond its limit, ``worst``: the largest share of it. The rest is the state that was computed last: pose of
each joint (``turn``, ``place``, ``axis``), which links move."""
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
def hold(plans: Block, robot: Block, path: Block, breaks: Array, coefficients: Array, begin: int) -> bool:
    """Take over a plan that begins at instant ``begin``; False if there is no room for all of it.

    ``path``: segments of s, ``breaks`` and ``coefficients``: the trajectory, as the supervisor keeps them.
    """
    rec = robot[0]
    given = path[0]
    rec.earlier, rec.slot = rec.slot, (rec.slot + 1) % PLANS
    plan = plans[rec.slot]
    plan.begin, plan.segments, plan.s_end = begin, given.n, given.s_end
    for i in range(given.n):
        plan.t[i], plan.s[i, 0], plan.s[i, 1] = given.t[i], given.s[i], given.v[i]
        plan.s[i, 2], plan.s[i, 3] = given.a[i], given.j[i]
    plan.t[given.n] = given.t[given.n]
    low = 0
    while low < len(coefficients) - 1 and breaks[low + 1] <= given.s[0]:
        low += 1
    plan.spans = 0
    for m in range(low, len(coefficients)):
        if plan.spans == SPANS:
            return False
        plan.breaks[plan.spans] = breaks[m]
        for d in range(6):
            for j in range(rec.n):
                plan.powers[plan.spans, d, j] = coefficients[m, d, j]
        plan.spans += 1
        plan.breaks[plan.spans] = breaks[m + 1]
        if breaks[m + 1] > given.s_end:
            break
    return True


@njit(cache=True, error_model="numpy")
def let_go(robot: Block) -> None:
    """Go back to the plan before: the last one was withdrawn."""
    robot[0].slot = robot[0].earlier


@njit(cache=True, error_model="numpy")
def go_on(plans: Block, robot: Block, k: int) -> None:
    """Begin cycle k with the plan that is held then."""
    rec = robot[0]
    slot = rec.slot
    if k < plans[slot].begin:
        slot = rec.earlier
    rec.now = k
    rec.plan_of[k % RING] = slot


@njit(cache=True, error_model="numpy")
def on_plan(plans: Block, robot: Block, slot: int, tau: float) -> None:
    """Write q, dq, ddq of a plan at ``tau`` [s after its begin]."""
    rec, plan = robot[0], plans[slot]
    s, v, a = plan.s_end, 0.0, 0.0
    if plan.segments > 0 and tau <= plan.t[plan.segments]:
        i = plan.segments - 1
        while i > 0 and tau < plan.t[i]:
            i -= 1
        x = tau - plan.t[i]
        s0, v0, a0, j0 = plan.s[i, 0], plan.s[i, 1], plan.s[i, 2], plan.s[i, 3]
        s = s0 + x * (v0 + x * (a0 / 2.0 + x * j0 / 6.0))
        v, a = v0 + x * (a0 + x * j0 / 2.0), a0 + x * j0
    m = 0
    while m < plan.spans - 1 and s >= plan.breaks[m + 1]:
        m += 1
    u = s - plan.breaks[m]
    for j in range(rec.n):
        q = d1 = d2 = 0.0
        for d in range(5, -1, -1):
            d2 = d2 * u + 2.0 * d1
            d1 = d1 * u + q
            q = q * u + plan.powers[m, d, j]
        rec.q[j], rec.dq[j], rec.ddq[j] = q, d1 * v, d2 * v * v + d1 * a


@njit(cache=True, error_model="numpy")
def commanded(plans: Block, robot: Block, t: float) -> None:
    """Write what the plan that the robot held at ``t`` [s] commands."""
    rec = robot[0]
    i = min(max(int(np.floor(t / rec.cycle)), 0, rec.now - RING + 1), rec.now)
    slot = rec.plan_of[i % RING]
    on_plan(plans, robot, slot, max(t, 0.0) - plans[slot].begin * rec.cycle)


@njit(cache=True, error_model="numpy")
def note(plans: Block, robot: Block, q: Array, dq: Array, ddq: Array) -> None:
    """Take the next command, and hold it against its plan, the limits, and the command before.

    With a jerk of at most J over the cycle h, the state at one end is within J h, J h²/2, J h³/6 of what
    constant acceleration from the other end gives: a command that is not was jumped to.
    """
    rec = robot[0]
    h, before = rec.cycle, rec.last
    rec.newest += 1
    on_plan(plans, robot, rec.slot, (rec.newest - plans[rec.slot].begin) * h)
    for j in range(rec.n):
        off = max(abs(q[j] - rec.q[j]), abs(dq[j] - rec.dq[j]), abs(ddq[j] - rec.ddq[j]))
        _hold(rec, CONTINUITY, off / SAME)
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
        before[0, j], before[1, j], before[2, j] = q[j], dq[j], ddq[j]


@njit(cache=True, error_model="numpy")
def _hold(rec: np.void, quantity: int, share: float) -> None:
    """Count a share of a limit that is above 1, or not a number."""
    if not share <= 1.0 + ROUNDING:
        rec.excess[quantity] += 1
    if not share <= rec.worst[quantity]:
        rec.worst[quantity] = share


@njit(cache=True, error_model="numpy")
def robot_at(arm: Block, plans: Block, robot: Block, t: float, x: float) -> None:
    """Compute where the arm truly is at ``t`` [s], the share ``x`` of its cycle; which links move."""
    rec = robot[0]
    commanded(plans, robot, t - (rec.lag[0] + x * (rec.lag[1] - rec.lag[0])))
    for j in range(rec.n):
        rec.q[j] += rec.error[0, j] + x * (rec.error[1, j] - rec.error[0, j])
    pose(arm, robot)


@njit(cache=True, error_model="numpy")
def pose(arm: Block, robot: Block) -> None:
    """Compute ``turn``, ``place`` and ``axis`` of each joint from ``q``."""
    chain = arm[0]
    rec = robot[0]
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
    chain = arm[0]
    rec = robot[0]
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
    chain = arm[0]
    rec = robot[0]
    best = found[0]
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
    """Look at the points of one link, in the frame of its joint, and one part; nearest cluster first."""
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
