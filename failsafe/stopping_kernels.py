"""Compiled bounds of point speeds and of kinetic energy over boxes of configurations.

A box has centre c and half-widths w; dq is one vertex of the box of joint speeds. Chain of a point p: joints
1 … m from the base, J_k = ∂p/∂q_k, z_k the axis where joint k turns and 0 where it slides. With
v_k = Σ_{j≥k} J_j dq_j and ω_ik = Σ_{i≤j<k} z_j dq_j,

    ∂v/∂q_i = z_i × v_{i+1} + ω_{1,i+1} × J_i =: G_i
    ∂²v/∂q_i∂q_k = z_i × (z_k × v_k) + z_i × (ω_ik × J_k) + ω_1i × (z_i × J_k)      (i ≤ k)

(derivatives of p are z_a × (z_b × J_c) in the order of the chain). Lengths of v_k, ω_ik and J_k do not depend
on joints before k, i + 1 and k, so their largest values over the box follow from the tip by first-order
bounds; M_ik bounds the second derivative. Taylor at the centre then gives, over the whole box,

    ‖v‖ ≤ √(‖v(c)‖² + 2 Σ w_i |v·G_i| + Σ Σ w_i w_k |G_i·G_k|) + ½ Σ Σ w_i w_k M_ik.

The first joint of a chain turns or moves everything as one: it drops out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]

WORK = np.dtype(
    [
        ("rotation", np.float64, (MAX_JOINTS, 3, 3)),
        ("position", np.float64, (MAX_JOINTS, 3)),
        ("point", np.float64, (3,)),
        ("z", np.float64, (MAX_JOINTS, 3)),
        ("column", np.float64, (MAX_JOINTS, 3)),
        ("turns", np.float64, (MAX_JOINTS,)),
        ("dq", np.float64, (MAX_JOINTS,)),
        ("half", np.float64, (MAX_JOINTS,)),
        ("tail", np.float64, (MAX_JOINTS + 1, 3)),
        ("twist", np.float64, (MAX_JOINTS + 1, 3)),
        ("slope", np.float64, (MAX_JOINTS, 3)),
        ("turning", np.float64, (MAX_JOINTS, 3)),
        ("reach", np.float64, (MAX_JOINTS,)),
        ("fast", np.float64, (MAX_JOINTS + 1,)),
        ("spin", np.float64, (MAX_JOINTS + 1, MAX_JOINTS + 1)),
        ("far", np.float64, (MAX_JOINTS + 1,)),
        ("away", np.float64, (MAX_JOINTS,)),
        ("step", np.float64, (MAX_JOINTS, 2)),
        ("vertex", np.float64, (MAX_JOINTS,)),
        ("gain", np.float64, (MAX_JOINTS,)),
        ("cross", np.float64, (MAX_JOINTS, MAX_JOINTS)),
        ("score", np.float64, (MAX_JOINTS,)),
    ]
)
"""Scratch. From ``z`` on, rows count along the chain of the point at hand; ``gain``, ``cross`` and ``score``
count the joints of the robot."""

POINTS = np.dtype(
    [
        ("joint", np.int32),
        ("m", np.int32),
        ("chain", np.int32, (MAX_JOINTS,)),
        ("place", np.float64, (3,)),
        ("ball", np.float64),
        ("mass", np.float64),
        ("reach", np.float64, (MAX_JOINTS,)),
    ]
)
"""Point ``place`` [m] in the frame of ``joint``, moved by the ``m`` joints of ``chain`` (base first);
``ball`` [m]: every point within it counts; ``mass`` [kg]; ``reach`` [m] from each joint of the robot."""

_OUTWARD = 1.0 + 1e-9
"""What roundings may take off a bound."""


@njit(cache=True, error_model="numpy")
def dot(a: Array, b: Array) -> float:
    """Return a · b of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True, error_model="numpy")
def _norm(a: Array) -> float:
    return float(np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]))


@njit(cache=True, error_model="numpy")
def _distance(a: Array, b: Array) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(np.sqrt(x * x + y * y + z * z))


@njit(cache=True, error_model="numpy")
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def _add_cross(a: Array, b: Array, out: Array) -> None:
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def columns(kinematics: Block, point: Any, dq: Array, work: Block) -> None:
    """Write place, axes, columns J, partial velocities and partial turning of a point.

    ``work`` has the poses that ``robots.kernels.forward`` wrote; ``dq (>= n,)``.
    """
    rec, tree = work[0], kinematics[0]
    joint, m = point.joint, point.m
    for r in range(3):
        rec.point[r] = rec.position[joint, r]
        for c in range(3):
            rec.point[r] += rec.rotation[joint, r, c] * point.place[c]
    arm = np.empty(3)
    for k in range(m):
        j = point.chain[k]
        for r in range(3):
            rec.z[k, r] = 0.0
            for c in range(3):
                rec.z[k, r] += rec.rotation[j, r, c] * tree.axis[j, c]
            arm[r] = rec.point[r] - rec.position[j, r]
        rec.dq[k] = dq[j]
        rec.away[k] = dot(arm, arm)
        if tree.prismatic[j]:
            rec.turns[k] = 0.0
            rec.column[k] = rec.z[k]
            rec.z[k] = 0.0
        else:
            rec.turns[k] = 1.0
            _cross(rec.z[k], arm, rec.column[k])
        for r in range(3):
            after = rec.position[point.chain[k + 1], r] if k + 1 < m else rec.point[r]
            arm[r] = after - rec.position[j, r]
        rec.step[k, 0] = _norm(arm)
        along = 0.0
        for r in range(3):
            along += rec.z[k, r] * arm[r]
        rec.step[k, 1] = np.sqrt(max(0.0, rec.step[k, 0] ** 2 - along * along))
    rec.tail[m] = 0.0
    rec.twist[0] = 0.0
    for k in range(m):
        back = m - 1 - k
        for r in range(3):
            rec.twist[k + 1, r] = rec.twist[k, r] + rec.z[k, r] * rec.dq[k]
            rec.tail[back, r] = rec.tail[back + 1, r] + rec.column[back, r] * rec.dq[back]


@njit(cache=True, error_model="numpy")
def _largest(point: Any, half: Array, work: Block) -> None:
    """Bound lengths over the box: reach of J_k, ``fast[k]`` of v_k, ``spin[i, k]`` of ω_ik."""
    rec = work[0]
    m = point.m
    for k in range(m):
        rec.half[k] = half[point.chain[k]]
    for k in range(m - 1, -1, -1):
        if rec.turns[k] == 0.0:
            rec.reach[k] = 1.0
            continue
        most = _norm(rec.column[k])
        for i in range(k + 1, m):
            most += rec.half[i] * rec.reach[i]
        rec.reach[k] = min(most, point.reach[point.chain[k]])
    for k in range(m + 1):
        rec.spin[k, k] = 0.0
        for i in range(k - 1, -1, -1):
            most = _distance(rec.twist[k], rec.twist[i])
            for g in range(i + 1, k):
                most += rec.half[g] * rec.turns[g] * rec.spin[g + 1, k]
            rec.spin[i, k] = most
            if k == i + 1:
                rec.spin[i, k] = rec.turns[i] * abs(rec.dq[i])
            for g in range(i + 1, k):
                rec.spin[i, k] = min(rec.spin[i, k], rec.spin[i, g] + rec.spin[g, k])
    rec.fast[m] = 0.0
    for k in range(m - 1, -1, -1):
        most = _norm(rec.tail[k])
        for g in range(k + 1, m):
            most += rec.half[g] * (rec.turns[g] * rec.fast[g + 1] + rec.spin[k, g + 1] * rec.reach[g])
        rec.fast[k] = min(most, abs(rec.dq[k]) * rec.reach[k] + rec.fast[k + 1])
    _grouped(m, work)


@njit(cache=True, error_model="numpy")
def _grouped(m: int, work: Block) -> None:
    """Improve ``fast`` by groups of joints k … g - 1 that turn about nearly one place.

    Their part of the velocity is ω_kg × (p - o_g) + Σ_{k≤l<g} ω_k,l+1 × (o_l+1 - o_l), where the steps
    between origins have constant lengths if no joint slides. Good for large boxes, where axes cannot all add
    up.
    """
    rec = work[0]
    rec.far[m] = 0.0
    for k in range(m - 1, -1, -1):
        if rec.turns[k] == 0.0:
            return
        rec.far[k] = rec.step[k, 0] + rec.far[k + 1]
        first = np.sqrt(rec.away[k])
        for i in range(k + 1, m):
            first += rec.half[i] * rec.reach[i]
        rec.far[k] = min(rec.far[k], first)
        steps = 0.0
        for g in range(k + 1, m + 1):
            last = g - 1
            steps += min(
                rec.spin[k, g] * rec.step[last, 0],
                rec.spin[k, last] * rec.step[last, 0] + abs(rec.dq[last]) * rec.step[last, 1],
            )
            rec.fast[k] = min(rec.fast[k], rec.spin[k, g] * rec.far[g] + steps + rec.fast[g])


@njit(cache=True, error_model="numpy")
def _bend(i: int, k: int, work: Block) -> float:
    """Bound M_ik of ∂²v/∂q_i∂q_k over the box, i <= k."""
    rec = work[0]
    if rec.turns[i] == 0.0:
        return 0.0
    return float(rec.turns[k] * rec.fast[k] + (rec.spin[i, k] + rec.spin[0, i]) * rec.reach[k])


@njit(cache=True, error_model="numpy")
def slopes(m: int, work: Block) -> None:
    """Write G_i = ∂v/∂q_i and the change z_i × ω of the turning at the centre."""
    rec = work[0]
    rest = np.empty(3)
    for i in range(m):
        _cross(rec.z[i], rec.tail[i + 1], rec.slope[i])
        _add_cross(rec.twist[i + 1], rec.column[i], rec.slope[i])
        for r in range(3):
            rest[r] = rec.twist[m, r] - rec.twist[i + 1, r]
        _cross(rec.z[i], rest, rec.turning[i])


@njit(cache=True, error_model="numpy")
def _first_order(m: int, v: Array, change: Array, half: Array) -> float:
    """Largest length of v + Σ x_i G_i over |x_i| <= half_i, bounded."""
    square = dot(v, v)
    for i in range(1, m):
        if half[i] == 0.0:
            continue
        square += 2.0 * half[i] * abs(dot(v, change[i]))
        for k in range(1, m):
            square += half[i] * half[k] * abs(dot(change[i], change[k]))
    return float(np.sqrt(square))


@njit(cache=True, error_model="numpy")
def speed_bound(kinematics: Block, point: Any, half: Array, work: Block) -> tuple[float, float, int]:
    """Return speed of the ball's fastest point at the centre, its bound over the box, joint to split.

    :func:`columns` has been called for the centre.
    """
    rec = work[0]
    m = point.m
    _largest(point, half, work)
    slopes(m, work)
    v, turning = rec.tail[0], rec.twist[m]
    length = _norm(v)
    bent = bent_turning = 0.0
    split, most = -1, 0.0
    for i in range(1, m):
        score = abs(dot(v, rec.slope[i])) / max(length, 1e-12)
        for k in range(1, m):
            bend = _bend(min(i, k), max(i, k), work)
            area = 0.5 * rec.half[i] * rec.half[k]
            bent += area * bend
            bent_turning += area * rec.turns[i] * rec.turns[k] * rec.spin[max(i, k) + 1, m]
            score += 0.5 * rec.half[k] * (bend + abs(dot(rec.slope[i], rec.slope[k])) / max(length, 1e-12))
        score *= rec.half[i]
        if score > most:
            split, most = point.chain[i], score
    bound = min(_first_order(m, v, rec.slope, rec.half) + bent, rec.fast[0])
    if point.ball > 0.0:
        turned = _first_order(m, turning, rec.turning, rec.half) + bent_turning
        bound += point.ball * min(turned, rec.spin[0, m])
    return fastest_of_ball(v, turning, point.ball), bound * _OUTWARD, split


@njit(cache=True, error_model="numpy")
def fastest_of_ball(v: Array, turning: Array, radius: float) -> float:
    """Speed of the fastest point within ``radius`` of a point that moves with v and turns with ω."""
    length = _norm(turning)
    if not length * radius > 0.0:
        return float(_norm(v))
    along = dot(v, turning) / length
    across = np.sqrt(max(0.0, dot(v, v) - along * along)) + radius * length
    return float(np.sqrt(across * across + along * along))


@njit(cache=True, error_model="numpy")
def energy_bound(
    kinematics: Block, points: NDArray[np.void], dq: Array, half: Array, n: int, work: Block
) -> tuple[float, float, int]:
    """Return kinetic energy [J] at the centre, its bound over the box, joint to split.

    ½ m ‖v + Σ x_i G_i + rest‖² summed over the points: what is linear and quadratic in x is summed first, so
    that slopes of different points cancel; the rest is bounded point by point.
    """
    rec = work[0]
    rec.gain[:] = 0.0
    rec.cross[:] = 0.0
    rec.score[:] = 0.0
    value = rest = fast = 0.0
    for p in range(points.shape[0]):
        point = points[p]
        m = point.m
        columns(kinematics, point, dq, work)
        _largest(point, half, work)
        slopes(m, work)
        v = rec.tail[0]
        value += 0.5 * point.mass * dot(v, v)
        bent = 0.0
        linear = _first_order(m, v, rec.slope, rec.half)
        for i in range(1, m):
            a = point.chain[i]
            rec.gain[a] += point.mass * dot(v, rec.slope[i])
            for k in range(1, m):
                bend = _bend(min(i, k), max(i, k), work)
                rec.cross[a, point.chain[k]] += point.mass * dot(rec.slope[i], rec.slope[k])
                bent += 0.5 * rec.half[i] * rec.half[k] * bend
                rec.score[a] += point.mass * linear * 0.5 * rec.half[k] * bend
        rest += point.mass * bent * (linear + 0.5 * bent)
        fast += 0.5 * point.mass * rec.fast[0] ** 2
    bound = value + rest
    split, most = -1, 0.0
    for a in range(n):
        bound += half[a] * abs(rec.gain[a])
        score = rec.score[a] + abs(rec.gain[a])
        for b in range(n):
            bound += 0.5 * half[a] * half[b] * abs(rec.cross[a, b])
            score += 0.5 * half[b] * abs(rec.cross[a, b])
        if score * half[a] > most:
            split, most = a, score * half[a]
    return value, min(bound, fast) * _OUTWARD, split


@njit(cache=True, error_model="numpy")
def extension(kinematics: Block, points: NDArray[np.void], half: Array, work: Block) -> tuple[float, float]:
    """Return the largest distance of a point from the first axis of its chain at the centre, and in the box
    at least."""
    rec = work[0]
    still = np.zeros(MAX_JOINTS)
    here = least = 0.0
    for p in range(points.shape[0]):
        point = points[p]
        columns(kinematics, point, still, work)
        if rec.turns[0] == 0.0:
            continue
        _largest(point, half, work)
        away = _norm(rec.column[0])
        here = max(here, away + point.ball)
        slack = 0.0
        change = np.empty(3)
        for i in range(1, point.m):
            _cross(rec.z[0], rec.column[i], change)
            slack += rec.half[i] * abs(dot(rec.column[0], change)) / max(away, 1e-12)
            for k in range(1, point.m):
                slack += 0.5 * rec.half[i] * rec.half[k] * rec.turns[min(i, k)] * rec.reach[max(i, k)]
        least = max(least, (away - slack) * (1.0 - 1e-9) + point.ball)
    return here, least
