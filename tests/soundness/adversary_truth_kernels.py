"""Compiled truth of one cycle: the robot goes on, people go on, and whether anybody touches a moving link."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.soundness.adversary_kernels import FOUND, go_on, nearest, robot_at, which_move
from tests.soundness.adversary_people_kernels import advance_people, uniform

Array = NDArray[np.float64]
Block = NDArray[np.void]
Indices = NDArray[np.int64]

NEAR_M = 0.05
"""Who comes nearer than this to a moving link is looked at between the cycles too."""
STEP_S, STEP_M = 0.002, 0.005
"""Longest time, and longest way of person and link together, between two looks."""
BINS = np.array([0.0, 0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, np.inf])
"""Upper ends of the bins of distances to moving links [m]; the first holds contacts."""
TALLY = np.dtype(
    [
        ("cycles", np.int64),
        ("moving", np.int64),
        ("contacts", np.int64),
        ("first", np.int64),
        ("person", np.int64),
        ("link", np.int64),
        ("part", np.int64),
        ("deepest", np.float64),
        ("nearest", np.float64),
        ("histogram", np.int64, (len(BINS),)),
        ("looks", np.int64),
    ]
)
"""``cycles`` in all, and in which a link was ``moving``; cycles with ``contacts``, the ``first`` of them with
whom and where; ``nearest`` [m] to a moving link, and its ``histogram`` over the cycles in which one moved;
``looks`` within cycles."""


@njit(cache=True, error_model="numpy")
def advance(
    arm: Block,
    clusters: tuple[Array, Array, Array],
    held: tuple[Block, Block],
    people: Block,
    parts: tuple[Indices, Indices, Array],
    near: Block,
    tally: Block,
    now: tuple[int, int, float],
) -> None:
    """Go on by cycle k; ``now``: k, what the robot does (State), speed below which a link stands still [m/s].

    ``held``: PLANs and ROBOT; ``parts``: points at the begin (S,) and end (S,) of the body parts, and their
    radius (persons, S) [m].
    """
    k, state, standstill = now
    plans, robot = held
    rec = robot[0]
    crowd = people[0]
    sums = tally[0]
    go_on(plans, robot, k)
    h = rec.cycle
    t = k * h
    begin, end, flesh = parts
    earlier = np.abs(rec.dq)
    _disturb(robot, people, near)
    advance_people(people, near, h, t, state)
    robot_at(arm, plans, robot, t + h, 1.0)
    fast = 0.0
    for j in range(rec.n):
        swing = max(earlier[j], abs(rec.dq[j])) + rec.limits[1, j] * h
        fast += arm[0].reach[j] * (swing * (1.0 + rec.drift) + rec.rate)
    closest = np.inf
    for p in range(crowd.n):
        closest = min(closest, near[p].distance)
    far = (fast + crowd.speed) * h
    rests = earlier.max() == 0.0 and np.abs(rec.dq).max() == 0.0
    sums.cycles += 1
    within = np.inf
    if not rests and closest - far < NEAR_M:
        within = _look(arm, clusters, held, people, parts, tally, (k, standstill, far))
        robot_at(arm, plans, robot, t + h, 1.0)
    other = np.empty(1, dtype=FOUND)
    some_move = which_move(arm, robot, clusters[0], standstill)
    for p in range(crowd.n):
        near[p].distance += far + 1e-6
        own = (begin, end, flesh[p])
        nearest(arm, clusters, robot, crowd.points[p], own, False, near[p : p + 1])
        if not some_move:
            continue
        distance = near[p].distance
        if rec.moving[near[p].link] == 0:
            other[0].distance = np.inf
            nearest(arm, clusters, robot, crowd.points[p], own, True, other)
            distance = other[0].distance
        within = min(within, distance)
    if some_move:
        sums.moving += 1
        sums.nearest = min(sums.nearest, within)
        place = 0
        while place < len(BINS) - 1 and within > BINS[place]:
            place += 1
        sums.histogram[place] += 1


@njit(cache=True, error_model="numpy")
def _disturb(robot: Block, people: Block, near: Block) -> None:
    """Choose how delay and joint errors go on: errors lean towards whoever is nearest."""
    rec = robot[0]
    rec.lag[0] = rec.lag[1]
    if uniform(people) < 0.01:
        draw = uniform(people)
        rec.lag_goal = rec.delay[0] if draw < 0.3 else rec.delay[1]
        if draw > 0.7:
            rec.lag_goal = rec.delay[0] + uniform(people) * (rec.delay[1] - rec.delay[0])
    change = rec.drift * rec.cycle
    rec.lag[1] = rec.lag[0] + min(max(rec.lag_goal - rec.lag[0], -change), change)
    who, change = 0, rec.rate * rec.cycle
    for p in range(people[0].n):
        if near[p].distance < near[who].distance:
            who = p
    at, to = near[who].on_link, near[who].on_body
    for j in range(rec.n):
        rec.error[0, j] = rec.error[1, j]
        a, o = rec.axis[j], rec.place[j]
        r0, r1, r2 = at[0] - o[0], at[1] - o[1], at[2] - o[2]
        closer = (a[1] * r2 - a[2] * r1) * (to[0] - at[0])
        closer += (a[2] * r0 - a[0] * r2) * (to[1] - at[1])
        closer += (a[0] * r1 - a[1] * r0) * (to[2] - at[2])
        goal = rec.bound[j] if closer > 0.0 else -rec.bound[j]
        rec.error[1, j] = rec.error[0, j] + min(max(goal - rec.error[0, j], -change), change)


@njit(cache=True, error_model="numpy")
def _look(
    arm: Block,
    clusters: tuple[Array, Array, Array],
    held: tuple[Block, Block],
    people: Block,
    parts: tuple[Indices, Indices, Array],
    tally: Block,
    about: tuple[int, float, float],
) -> float:
    """Look within a cycle for contacts with moving links; return the nearest below NEAR_M [m], or inf."""
    k, standstill, far = about
    plans, robot = held
    rec = robot[0]
    crowd = people[0]
    sums = tally[0]
    begin, end, flesh = parts
    h = rec.cycle
    steps = int(min(max(np.ceil(max(h / STEP_S, far / STEP_M)), 1.0), 64.0))
    found = np.empty(1, dtype=FOUND)
    found[0].distance = NEAR_M
    any_found, touched = False, False
    body = np.empty_like(crowd.points[0])
    for i in range(1, steps + 1):
        x = i / steps
        robot_at(arm, plans, robot, k * h + x * h, x)
        if not which_move(arm, robot, clusters[0], standstill):
            continue
        sums.looks += 1
        for p in range(crowd.n):
            for point in range(body.shape[0]):
                for axis in range(3):
                    a, b = crowd.before[p, point, axis], crowd.points[p, point, axis]
                    body[point, axis] = a + x * (b - a)
            if not nearest(arm, clusters, robot, body, (begin, end, flesh[p]), True, found):
                continue
            any_found = True
            if found[0].distance <= 0.0:
                touched = True
                if found[0].distance < sums.deepest:
                    sums.deepest = found[0].distance
                if sums.contacts == 0:
                    sums.first = k
                    sums.person = p
                    sums.link = found[0].link
                    sums.part = found[0].part
    if touched:
        sums.contacts += 1
    return found[0].distance if any_found else np.inf
