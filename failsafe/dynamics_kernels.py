"""Compiled dynamics of point masses on an arm, and its stop by friction brakes.

With J_p = ∂p/∂q and b_p = Σ_i (∂v_p/∂q_i) dq_i of each point mass (:mod:`failsafe.stopping_kernels`),

    M = Σ m J_pᵀ J_p,   h = Σ m J_pᵀ (b_p − g),   M ddq + h = τ.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.stopping_kernels import columns, slopes
from robots.kernels import forward
from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]

SCRATCH = np.dtype(
    [
        ("mass", np.float64, (MAX_JOINTS, MAX_JOINTS)),
        ("bias", np.float64, (MAX_JOINTS,)),
        ("moving", np.int8, (MAX_JOINTS,)),
        ("sign", np.float64, (MAX_JOINTS,)),
        ("torque", np.float64, (MAX_JOINTS,)),
        ("k", np.float64, (4, MAX_JOINTS)),
        ("q", np.float64, (MAX_JOINTS,)),
        ("dq", np.float64, (MAX_JOINTS,)),
        ("q_next", np.float64, (MAX_JOINTS,)),
        ("dq_next", np.float64, (MAX_JOINTS,)),
    ]
)
"""Mass matrix and bias torques; which joints are ``moving`` (the others are locked), the ``sign`` of their
speed, the ``torque`` of their brakes; stages of the integrator."""

OUTCOME = np.dtype(
    [
        ("rests", np.int8),
        ("time", np.float64),
        ("travel", np.float64, (MAX_JOINTS,)),
        ("displacement", np.float64, (MAX_JOINTS,)),
        ("braked", np.float64),
        ("begin", np.float64),
        ("end", np.float64),
        ("highest", np.float64),
    ]
)
"""Whether it came to rest, after how long [s]; ``travel`` and largest ``displacement`` of each joint [rad;
m]; energy taken by the brakes, kinetic and potential energy at the begin and at the end, highest kinetic
[J]."""

_STILL = 1e-10
_SECANTS = 12


@njit(cache=True, error_model="numpy")
def dynamics(
    kinematics: Block,
    points: NDArray[np.void],
    q: Array,
    dq: Array,
    gravity: Array,
    mass: Array,
    bias: Array,
    work: Block,
) -> float:
    """Write M (>= n, >= n) and h (>= n,); return kinetic energy [J]."""
    rec, n = work[0], kinematics[0].n
    forward(kinematics, q, rec.rotation, rec.position)
    mass[:n, :n] = 0.0
    bias[:n] = 0.0
    kinetic = 0.0
    pull = np.empty(3)
    for p in range(points.shape[0]):
        point = points[p]
        columns(kinematics, point, dq, work)
        slopes(point.m, work)
        m = point.mass
        for r in range(3):
            pull[r] = -gravity[r]
            for k in range(point.m):
                pull[r] += rec.slope[k, r] * rec.dq[k]
            kinetic += 0.5 * m * rec.tail[0, r] ** 2
        for k in range(point.m):
            j = point.chain[k]
            for r in range(3):
                bias[j] += m * rec.column[k, r] * pull[r]
            for g in range(k + 1):
                i = point.chain[g]
                entry = 0.0
                for r in range(3):
                    entry += m * rec.column[k, r] * rec.column[g, r]
                mass[i, j] += entry
                if g != k:
                    mass[j, i] += entry
    return kinetic


@njit(cache=True, error_model="numpy")
def potential(kinematics: Block, points: NDArray[np.void], q: Array, gravity: Array, work: Block) -> float:
    """Return the potential energy [J], 0 at the origin of the world."""
    rec = work[0]
    forward(kinematics, q, rec.rotation, rec.position)
    total = 0.0
    for p in range(points.shape[0]):
        joint = points[p].joint
        for r in range(3):
            at = rec.position[joint, r]
            for c in range(3):
                at += rec.rotation[joint, r, c] * points[p].place[c]
            total -= points[p].mass * gravity[r] * at
    return total


@njit(cache=True, error_model="numpy")
def _accelerate(
    kinematics: Block,
    points: NDArray[np.void],
    q: Array,
    dq: Array,
    gravity: Array,
    out: Array,
    work: Block,
    scratch: Block,
) -> float:
    """Write ddq with brakes on the moving joints and the others locked; return kinetic energy [J]."""
    own, n = scratch[0], kinematics[0].n
    kinetic = dynamics(kinematics, points, q, dq, gravity, own.mass, own.bias, work)
    count = 0
    rows = np.empty(n, dtype=np.int64)
    for j in range(n):
        out[j] = 0.0
        if own.moving[j]:
            rows[count] = j
            count += 1
    if count == 0:
        return kinetic
    matrix, side = np.empty((count, count)), np.empty(count)
    for a in range(count):
        j = rows[a]
        side[a] = -own.bias[j] - own.torque[j] * own.sign[j]
        for b in range(count):
            matrix[a, b] = own.mass[j, rows[b]]
    solution = np.linalg.solve(matrix, side)
    for a in range(count):
        out[rows[a]] = solution[a]
    return kinetic


@njit(cache=True, error_model="numpy")
def _stride(
    kinematics: Block,
    points: NDArray[np.void],
    q: Array,
    dq: Array,
    h: float,
    gravity: Array,
    work: Block,
    scratch: Block,
) -> None:
    """Classical Runge-Kutta step of ``h`` [s] into ``q_next, dq_next``."""
    own, n = scratch[0], kinematics[0].n
    for stage in range(4):
        part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
        for j in range(n):
            a = own.k[stage - 1, j] if stage > 0 else 0.0
            own.dq[j] = dq[j] + part * a
            # position stages: q + part * (speed of the stage before)
            before = dq[j] if stage < 2 else dq[j] + 0.5 * h * own.k[stage - 2, j]
            own.q[j] = q[j] + part * before
        _accelerate(kinematics, points, own.q, own.dq, gravity, own.k[stage], work, scratch)
    for j in range(n):
        k1, k2, k3, k4 = own.k[0, j], own.k[1, j], own.k[2, j], own.k[3, j]
        own.q_next[j] = q[j] + h * dq[j] + h * h * (k1 + k2 + k3) / 6.0
        own.dq_next[j] = dq[j] + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0


@njit(cache=True, error_model="numpy")
def _release(n: int, ddq: Array, scratch: Block) -> bool:
    """Let a locked joint go whose brake cannot hold it; return whether there was one."""
    own = scratch[0]
    for j in range(n):
        if own.moving[j]:
            continue
        needed = own.bias[j]
        for i in range(n):
            if own.moving[i]:
                needed += own.mass[j, i] * ddq[i]
        if abs(needed) > own.torque[j] * (1.0 + 1e-9):
            own.moving[j] = 1
            own.sign[j] = -1.0 if needed > 0.0 else 1.0
            return True
    return False


@njit(cache=True, error_model="numpy")
def _first_to_rest(n: int, dq: Array, scratch: Block) -> int:
    """Return the moving joint whose speed has changed its sign, at the smallest share of the step; -1:
    none."""
    own = scratch[0]
    found, share = -1, 2.0
    for j in range(n):
        if own.moving[j] and own.torque[j] > 0.0 and own.dq_next[j] * own.sign[j] < 0.0:
            here = dq[j] / (dq[j] - own.dq_next[j])
            if here < share:
                found, share = j, here
    return found


@njit(cache=True, error_model="numpy")
def _step_to_rest(
    kinematics: Block,
    points: NDArray[np.void],
    q: Array,
    dq: Array,
    h: float,
    gravity: Array,
    work: Block,
    scratch: Block,
) -> tuple[float, int]:
    """Step by ``h`` [s] or until the first joint comes to rest; return how far, and that joint (-1: none)."""
    own, n = scratch[0], kinematics[0].n
    _stride(kinematics, points, q, dq, h, gravity, work, scratch)
    j = _first_to_rest(n, dq, scratch)
    if j < 0:
        return h, -1
    low, high = 0.0, h
    at_low, at_high = dq[j] * own.sign[j], own.dq_next[j] * own.sign[j]
    for _ in range(_SECANTS):
        middle = low + (high - low) * min(max(at_low / (at_low - at_high), 0.02), 0.98)
        _stride(kinematics, points, q, dq, middle, gravity, work, scratch)
        other = _first_to_rest(n, dq, scratch)
        if other >= 0 and other != j:
            j, low, high = other, 0.0, middle
            at_low, at_high = dq[j] * own.sign[j], own.dq_next[j] * own.sign[j]
            continue
        value = own.dq_next[j] * own.sign[j]
        if abs(value) <= _STILL:
            low = high = middle
            break
        if value > 0.0:
            low, at_low = middle, value
        else:
            high, at_high = middle, value
    _stride(kinematics, points, q, dq, high, gravity, work, scratch)
    return high, j


@njit(cache=True, error_model="numpy")
def brake(
    kinematics: Block,
    points: NDArray[np.void],
    start: Array,
    torque: Array,
    delay: float,
    gravity: Array,
    step: float,
    most: float,
    watched: NDArray[np.void],
    ways: Array,
    work: Block,
    scratch: Block,
    outcome: Block,
) -> None:
    """Drop the drives at ``start (2, n)`` = q, dq; after ``delay`` [s] brakes of ``torque (n,)`` take hold.

    Fixed steps of ``step`` [s], cut where a joint comes to rest, for ``most`` [s] at most. A joint at rest is
    locked while its brake can hold what gravity and the other joints ask of it. ``ways (len(watched),)`` [m]:
    added chords of the watched points.
    """
    own, out, n = scratch[0], outcome[0], kinematics[0].n
    q, dq = start[0].copy(), start[1].copy()
    ddq = np.zeros(n)
    place, before = np.zeros((watched.shape[0], 3)), np.zeros((watched.shape[0], 3))
    ways[:] = 0.0
    out.rests, out.time, out.braked = 0, 0.0, 0.0
    out.travel[:] = 0.0
    out.displacement[:] = 0.0
    own.moving[:] = 1
    own.torque[:] = 0.0
    braking = False
    out.highest = dynamics(kinematics, points, q, dq, gravity, own.mass, own.bias, work)
    out.begin = out.highest + potential(kinematics, points, q, gravity, work)
    _watch(kinematics, watched, q, before, work)
    while out.time < most:
        if not braking and out.time >= delay:
            braking = True
            for j in range(n):
                own.torque[j] = torque[j]
                own.moving[j] = abs(dq[j]) > _STILL
                own.sign[j] = 1.0 if dq[j] > 0.0 else -1.0
                if not own.moving[j]:
                    dq[j] = 0.0
        kinetic = _accelerate(kinematics, points, q, dq, gravity, ddq, work, scratch)
        out.highest = max(out.highest, kinetic)
        if braking:
            for _ in range(n):
                if not _release(n, ddq, scratch):
                    break
                _accelerate(kinematics, points, q, dq, gravity, ddq, work, scratch)
            if not own.moving[:n].any():
                out.rests = 1
                break
        h = step if braking else min(step, max(delay - out.time, 1e-12))
        h, resting = _step_to_rest(kinematics, points, q, dq, h, gravity, work, scratch)
        for j in range(n):
            moved = own.q_next[j] - q[j]
            out.travel[j] += abs(moved)
            out.braked += own.torque[j] * own.sign[j] * moved if own.moving[j] else 0.0
            q[j], dq[j] = own.q_next[j], own.dq_next[j]
            out.displacement[j] = max(out.displacement[j], abs(q[j] - start[0, j]))
        if resting >= 0:
            dq[resting] = 0.0
            own.moving[resting] = 0
        out.time += h
        _watch(kinematics, watched, q, place, work)
        for p in range(watched.shape[0]):
            chord = 0.0
            for r in range(3):
                chord += (place[p, r] - before[p, r]) ** 2
                before[p, r] = place[p, r]
            ways[p] += np.sqrt(chord)
    kinetic = dynamics(kinematics, points, q, dq, gravity, own.mass, own.bias, work)
    out.end = kinetic + potential(kinematics, points, q, gravity, work)


@njit(cache=True, error_model="numpy")
def _watch(kinematics: Block, points: NDArray[np.void], q: Array, out: Array, work: Block) -> None:
    """Write the places (P, 3) of points."""
    rec = work[0]
    forward(kinematics, q, rec.rotation, rec.position)
    for p in range(points.shape[0]):
        joint = points[p].joint
        for r in range(3):
            out[p, r] = rec.position[joint, r]
            for c in range(3):
                out[p, r] += rec.rotation[joint, r, c] * points[p].place[c]
