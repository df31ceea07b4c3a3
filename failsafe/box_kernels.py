"""Compiled branch and bound over boxes of configurations, by the bounds of :mod:`failsafe.stopping_kernels`.

A node of the search is a box of configurations with one vertex of the box of joint speeds. Nodes stand in a
table; a heap has the slots of those that are open, the most promising one first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.stopping_kernels import (
    columns,
    dot,
    energy_bound,
    extension,
    fastest_of_ball,
    slopes,
    speed_bound,
)
from robots.kernels import forward
from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]

NODES = np.dtype(
    [
        ("bound", np.float64),
        ("point", np.int32),
        ("centre", np.float64, (MAX_JOINTS,)),
        ("half", np.float64, (MAX_JOINTS,)),
        ("signs", np.int32),
        ("split", np.int32),
    ]
)
"""Box of configurations ``centre ± half`` and vertex of the speeds: bit j of ``signs`` is set where joint j
runs backwards. ``bound`` of the value, the ``point`` (-1: all), the joint to ``split`` next (-1: none)."""

TASK = np.dtype(
    [
        ("n", np.int64),
        ("energy", np.int8),
        ("extension", np.float64),
        ("lower", np.float64, (MAX_JOINTS,)),
        ("upper", np.float64, (MAX_JOINTS,)),
        ("speed", np.float64, (MAX_JOINTS,)),
        ("points", np.int64),
    ]
)
"""``n`` joints; ``energy``: kinetic energy of all points instead of the speed of one; ``extension`` [m]: no
point may be farther from the first axis of its chain (inf: anywhere); boxes of q and of |dq|."""

STATE = np.dtype(
    [
        ("open", np.int64),
        ("used", np.int64),
        ("free", np.int64),
        ("evaluated", np.int64),
        ("best", np.float64),
        ("settled", np.float64),
        ("point", np.int64),
        ("q", np.float64, (MAX_JOINTS,)),
        ("dq", np.float64, (MAX_JOINTS,)),
    ]
)
"""``open`` nodes in the heap; ``used`` slots of the node table, ``free`` of them free; ``best`` value and
where it is reached; ``settled``: largest bound of what was laid aside as near enough to the best value."""


@njit(cache=True, error_model="numpy")
def evaluate(
    kinematics: Block, points: NDArray[np.void], task: Block, node: Any, work: Block, state: Block
) -> None:
    """Set bound and split of a node, and the best value if its centre has a larger one."""
    rec, todo, found = work[0], task[0], state[0]
    found.evaluated += 1
    for j in range(todo.n):
        rec.vertex[j] = -todo.speed[j] if (node.signs >> j) & 1 else todo.speed[j]
    forward(kinematics, node.centre, rec.rotation, rec.position)
    if todo.energy:
        value, bound, split = energy_bound(kinematics, points, rec.vertex, node.half, todo.n, work)
    else:
        point = points[node.point]
        columns(kinematics, point, rec.vertex, work)
        value, bound, split = speed_bound(kinematics, point, node.half, work)
    node.bound = np.minimum(node.bound, bound) if bound >= 0.0 else np.inf  # NaN proves nothing
    node.split = split
    if todo.extension < np.inf and node.bound > found.best:
        here, least = extension(kinematics, points, node.half, work)
        if least > todo.extension:
            node.bound = 0.0
        if not here <= todo.extension:
            return
    if value > found.best:
        found.best = value
        found.point = node.point
        found.q[:] = node.centre
        found.dq[:] = rec.vertex


@njit(cache=True, error_model="numpy")
def _push(nodes: NDArray[np.void], heap: NDArray[np.int64], slot: int, state: Block) -> None:
    found = state[0]
    at = found.open
    found.open += 1
    while at > 0:
        above = (at - 1) // 2
        if nodes[heap[above]].bound >= nodes[slot].bound:
            break
        heap[at] = heap[above]
        at = above
    heap[at] = slot


@njit(cache=True, error_model="numpy")
def _pop(nodes: NDArray[np.void], heap: NDArray[np.int64], state: Block) -> int:
    found = state[0]
    top = heap[0]
    found.open -= 1
    n = found.open
    last = heap[n]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= n:
            break
        if below + 1 < n and nodes[heap[below + 1]].bound > nodes[heap[below]].bound:
            below += 1
        if nodes[last].bound >= nodes[heap[below]].bound:
            break
        heap[at] = heap[below]
        at = below
    heap[at] = last
    return int(top)


@njit(cache=True, error_model="numpy")
def keep(
    nodes: NDArray[np.void],
    heap: NDArray[np.int64],
    free: NDArray[np.int64],
    slot: int,
    enough: float,
    state: Block,
) -> None:
    """Put a node into the heap, unless its bound is near enough to the best value, or it has nothing to
    split."""
    found = state[0]
    bound = nodes[slot].bound
    if bound > found.best * enough and nodes[slot].split >= 0:
        _push(nodes, heap, slot, state)
        return
    found.settled = max(found.settled, bound)
    free[found.free] = slot
    found.free += 1


@njit(cache=True, error_model="numpy")
def expand(
    kinematics: Block,
    points: NDArray[np.void],
    task: Block,
    nodes: NDArray[np.void],
    heap: NDArray[np.int64],
    free: NDArray[np.int64],
    enough: float,
    steps: int,
    reserve: int,
    work: Block,
    state: Block,
) -> bool:
    """Halve the most promising boxes, ``steps`` of them at most; return whether there is more to do.

    Boxes whose bound is at most ``enough`` times the best value are laid aside; ``state.settled`` has the
    largest bound of those. Where no more than ``reserve`` slots of the table of nodes are left, the box that
    stands last is halved or laid aside instead: down to the end of it, and so of one after the other, which
    makes room. Ends early where the table is full.
    """
    found = state[0]
    for _ in range(steps):
        if found.open == 0 or nodes[heap[0]].bound <= found.best * enough:
            return False
        room = found.free + nodes.shape[0] - found.used
        if room == 0:
            return True
        if room > reserve:
            first = _pop(nodes, heap, state)
        else:
            found.open -= 1
            first = heap[found.open]
            if nodes[first].bound <= found.best * enough:
                keep(nodes, heap, free, first, enough, state)
                continue
        if found.free > 0:
            found.free -= 1
            second = free[found.free]
        else:
            second = found.used
            found.used += 1
        nodes[second] = nodes[first]
        j = nodes[first].split
        half = 0.5 * nodes[first].half[j]
        nodes[first].half[j] = half
        nodes[second].half[j] = half
        nodes[first].centre[j] -= half
        nodes[second].centre[j] += half
        for slot in (first, second):
            evaluate(kinematics, points, task, nodes[slot], work, state)
            keep(nodes, heap, free, slot, enough, state)
    return True


@njit(cache=True, error_model="numpy")
def value_at(
    kinematics: Block,
    points: NDArray[np.void],
    task: Block,
    p: int,
    q: Array,
    dq: Array,
    gradient: Array,
    work: Block,
) -> float:
    """Return speed of the ball of point ``p``, or energy, at (q, dq); write its slope, and the better signs
    of dq.

    ``gradient (n,)``: of ½‖v‖² or of the energy with respect to q. Speeds are pushed to the vertex at which
    the convex function grows: dq_j takes the sign of its own derivative.
    """
    rec, todo = work[0], task[0]
    forward(kinematics, q, rec.rotation, rec.position)
    gradient[: todo.n] = 0.0
    rec.gain[:] = 0.0
    value = 0.0
    first, last = (0, points.shape[0]) if todo.energy else (p, p + 1)
    for index in range(first, last):
        point = points[index]
        columns(kinematics, point, dq, work)
        slopes(point.m, work)
        v = rec.tail[0]
        weight = point.mass if todo.energy else 1.0
        for k in range(point.m):
            j = point.chain[k]
            gradient[j] += weight * dot(v, rec.slope[k])
            rec.gain[j] += weight * dot(v, rec.column[k])
        if todo.energy:
            value += 0.5 * point.mass * dot(v, v)
        else:
            value = fastest_of_ball(v, rec.twist[point.m], point.ball)
    for j in range(todo.n):
        if rec.gain[j] * dq[j] < 0.0:
            dq[j] = -dq[j]
    return value


@njit(cache=True, error_model="numpy")
def ascend(
    kinematics: Block,
    points: NDArray[np.void],
    task: Block,
    p: int,
    q: Array,
    dq: Array,
    steps: int,
    work: Block,
) -> float:
    """Climb from (q, dq) within the boxes of configurations and speeds; return the value reached there.

    ``q, dq (>= n,)`` are changed; dq stays at a vertex. Steps along the slope, shortened until they gain.
    """
    todo = task[0]
    n = todo.n
    gradient, other = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    trial_q, trial_dq = q.copy(), dq.copy()
    best = value_at(kinematics, points, task, p, q, dq.copy(), gradient, work)
    stride = 0.3
    for _ in range(steps):
        size = 1e-300
        for j in range(n):
            size = max(size, abs(gradient[j]))
        for j in range(n):
            trial_q[j] = min(max(q[j] + stride * gradient[j] / size, todo.lower[j]), todo.upper[j])
        trial_dq[:] = dq
        value_at(kinematics, points, task, p, trial_q, trial_dq, other, work)
        value = value_at(kinematics, points, task, p, trial_q, trial_dq.copy(), other, work)
        allowed = True
        if value > best and todo.extension < np.inf:
            allowed = extension(kinematics, points, np.zeros(MAX_JOINTS), work)[0] <= todo.extension
        if value > best and allowed:
            best = value
            q[:] = trial_q
            dq[:] = trial_dq
            gradient[:] = other
            stride = min(2.0 * stride, 0.5)
        else:
            stride *= 0.5
            if stride < 1e-9:
                break
    return best
