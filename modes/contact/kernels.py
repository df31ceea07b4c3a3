"""Hot loops of the mode: filters that run."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def advance(b: Array, a: Array, state: Array, x: Array, y: Array) -> None:
    """Take a sample ``x`` (channels,) into ``state`` (order, channels), write ``y``; a[0] is 1.

    Transposed direct form II.
    """
    last = len(state) - 1
    for c in range(len(x)):
        y[c] = b[0] * x[c] + state[0, c]
        for i in range(last):
            state[i, c] = b[i + 1] * x[c] + state[i + 1, c] - a[i + 1] * y[c]
        state[last, c] = b[last + 1] * x[c] - a[last + 1] * y[c]


@njit(cache=True, error_model="numpy")
def _det(m: Array) -> float:
    """Return the determinant of a matrix (3, 3)."""
    first = m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
    second = m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
    third = m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    return float(first - second + third)


@njit(cache=True, error_model="numpy")
def least_change(jacobian: Array, velocity: Array, wanted: Array, out: Array) -> None:
    """Write ``wanted + J' (J J' + δ I)⁻¹ (velocity - J wanted)``, J (3, n); δ is 0 away from singularities.

    δ rises to 1e-3 as the determinant of J J' falls below 1e-6.
    """
    n = len(wanted)
    gram = np.zeros((3, 3))
    missing = velocity.copy()
    for r in range(3):
        for j in range(n):
            missing[r] -= jacobian[r, j] * wanted[j]
        for c in range(3):
            for j in range(n):
                gram[r, c] += jacobian[r, j] * jacobian[c, j]
    share = _det(gram) / 1e-6
    if share < 1.0:
        for r in range(3):
            gram[r, r] += 1e-3 * (1.0 - max(share, 0.0)) ** 2
    det = _det(gram)
    for j in range(n):
        out[j] = wanted[j]
    for r in range(3):
        a, b = gram[(r + 1) % 3], gram[(r + 2) % 3]  # Cramer's rule, of a symmetric matrix
        weight = 0.0
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            weight += (a[d] * b[e] - a[e] * b[d]) * missing[c] / det
        for j in range(n):
            out[j] += jacobian[r, j] * weight


@njit(cache=True, error_model="numpy")
def follow(
    jacobian: Array,
    place: Array,
    wanted: Array,
    velocity: Array,
    gain: float,
    posture: Array,
    q: Array,
    posture_gain: float,
    out: Array,
) -> None:
    """Write speeds (n,) of (5), (6) and (20): the tool to ``wanted``, which moves with ``velocity`` (3,).

    ``jacobian`` (≥ 3, n).
    """
    v, own = np.empty(3), np.empty(len(q))
    for c in range(3):
        v[c] = velocity[c] + gain * (wanted[c] - place[c])
    for j in range(len(q)):
        own[j] = posture_gain * (posture[j] - q[j])
    least_change(jacobian[:3], v, own, out)


@njit(cache=True, error_model="numpy")
def give_way(
    jacobian: Array, force: Array, begin: Array, place: Array, compliance: float, stiffness: float, out: Array
) -> None:
    """Write speeds (n,) of (19): the tool yields to ``force`` (≥ 3,) [N], and goes back to ``begin`` (3,)."""
    v = np.empty(3)
    for c in range(3):
        v[c] = compliance * (force[c] + stiffness * (begin[c] - place[c]))
    least_change(jacobian[:3], v, np.zeros(len(out)), out)


@njit(cache=True, error_model="numpy")
def joint_torques(jacobian: Array, wrench: Array, out: Array) -> None:
    """Write J'F (n,) [N m] of a force and a moment (6,)."""
    for j in range(len(out)):
        out[j] = 0.0
        for r in range(6):
            out[j] += jacobian[r, j] * wrench[r]


@njit(cache=True, error_model="numpy")
def exceeds(x: Array, most: float) -> bool:
    """Whether the size of a number (n,) is above ``most``, or no number."""
    largest = 0.0
    for k in range(len(x)):
        largest = max(largest, abs(x[k]) if np.isfinite(x[k]) else np.inf)
    return bool(largest > most)


BELIEVED, NOT_A_NUMBER, SATURATED, FROZEN, DROPPED, CLOCK = range(6)
"""What :func:`watch` returns."""


@njit(cache=True, error_model="numpy")
def watch(
    now: float,
    period: float,
    stamps: Array,
    samples: Array,
    limits: Array,
    seen: Array,
    last: Array,
    mean: Array,
) -> int:
    """Look at samples (m, 6) stamped (m,) [s]; write their ``mean`` (6,), return whether they are believed.

    ``limits``: range [N], range [N m], how long frozen and how long silent [s]. ``seen`` (2,), when a sample
    came and when one differed last [s], and ``last`` (6,) are kept from call to call.
    """
    count = len(stamps)
    for k in range(count):
        if not np.isfinite(stamps[k]):
            return NOT_A_NUMBER
        for c in range(6):
            if not np.isfinite(samples[k, c]):
                return NOT_A_NUMBER
    before, gap = seen[0], 0.0
    for k in range(count):
        if not stamps[k] > before or stamps[k] > now + period:
            return CLOCK
        if np.isfinite(before):
            gap = max(gap, stamps[k] - before)
        before = stamps[k]
    if gap > limits[3]:
        return DROPPED
    for c in range(6):
        mean[c] = 0.0 if count else last[c]
    saturated = False
    for k in range(count):
        for c in range(6):
            if samples[k, c] != last[c]:
                seen[1] = stamps[k]
            last[c] = samples[k, c]
            mean[c] += samples[k, c] / count
            saturated |= abs(samples[k, c]) >= limits[0 if c < 3 else 1]
        seen[0] = stamps[k]
    if not now - seen[0] <= limits[3]:
        return DROPPED
    if seen[0] - seen[1] > limits[2]:
        return FROZEN
    return SATURATED if saturated else BELIEVED


@njit(cache=True, error_model="numpy")
def unloaded(mass: float, centre: Array, bias: Array, gravity: Array, rotation: Array, out: Array) -> None:
    """Write what an untouched sensor reads (6,): ``bias``, and the weight of its tool in its own axes."""
    w = np.zeros(3)
    for r in range(3):
        for k in range(3):
            w[r] += mass * rotation[k, r] * gravity[k]
        out[r] = bias[r] + w[r]
    out[3] = bias[3] + centre[1] * w[2] - centre[2] * w[1]
    out[4] = bias[4] + centre[2] * w[0] - centre[0] * w[2]
    out[5] = bias[5] + centre[0] * w[1] - centre[1] * w[0]


@njit(cache=True, error_model="numpy")
def contact(
    mass: float, centre: Array, bias: Array, gravity: Array, rotation: Array, reading: Array, out: Array
) -> None:
    """Write ``reading`` (6,) less what an untouched sensor reads, force and torque turned into base axes."""
    own = np.empty(6)
    unloaded(mass, centre, bias, gravity, rotation, own)
    for r in range(3):
        out[r] = out[3 + r] = 0.0
        for k in range(3):
            out[r] += rotation[r, k] * (reading[k] - own[k])
            out[3 + r] += rotation[r, k] * (reading[3 + k] - own[3 + k])


@njit(cache=True, error_model="numpy")
def threshold(table: Array, dq: Array, ddq: Array, out: Array) -> None:
    """Write (8), or (10), for each joint: rows of ``table`` (5, k): least, per speed, per acceleration, and
    what speeds [rad/s] and accelerations [rad/s²] are divided by."""
    for j in range(len(out)):
        out[j] = (
            table[0, j] + table[1, j] * abs(dq[j]) / table[3, j] + table[2, j] * abs(ddq[j]) / table[4, j]
        )


@njit(cache=True, error_model="numpy")
def limited(
    jacobian: Array, wanted: Array, before: Array, cap: float, fastest: Array, most: Array, out: Array
) -> None:
    """Write ``wanted`` (n,) slowed down, all joints alike, to the cap of the tool [m/s] and to ``fastest``.

    From ``before`` it changes by no more than ``most``, all joints by the same share of the change; but it is
    slowed down further where ``before`` was too fast.
    """
    square, share, excess = 0.0, 1.0, 1.0
    for r in range(3):
        v = 0.0
        for j in range(len(wanted)):
            v += jacobian[r, j] * wanted[j]
        square += v * v
    for j in range(len(wanted)):
        share = max(share, abs(wanted[j]) / fastest[j])
    share = max(share, np.sqrt(square) / cap)
    for j in range(len(wanted)):
        excess = max(excess, abs(wanted[j] / share - before[j]) / most[j])
    square = 0.0
    for j in range(len(wanted)):
        out[j] = before[j] + (wanted[j] / share - before[j]) / excess
    for r in range(3):
        v = 0.0
        for j in range(len(wanted)):
            v += jacobian[r, j] * out[j]
        square += v * v
    share = max(1.0, np.sqrt(square) / cap)
    for j in range(len(wanted)):
        share = max(share, abs(out[j]) / fastest[j])
    for j in range(len(wanted)):
        out[j] /= share


@njit(cache=True, error_model="numpy")
def cycle(corners: Array, leg_s: float, t: float, place: Array, velocity: Array) -> None:
    """Write where somebody is (3,), and how fast, who goes round ``corners`` (C, 3); a quintic each side."""
    legs = t / leg_s
    leg = int(np.floor(legs))
    share = legs - leg
    here, there = corners[leg % len(corners)], corners[(leg + 1) % len(corners)]
    way = share * share * share * (10.0 + share * (6.0 * share - 15.0))
    speed = 30.0 * share * share * (1.0 - share) * (1.0 - share) / leg_s
    for c in range(3):
        place[c] = here[c] + way * (there[c] - here[c])
        velocity[c] = speed * (there[c] - here[c])


@njit(cache=True, error_model="numpy")
def are_finite(x: Array, y: Array, z: Array) -> bool:
    """Whether all numbers (n,) are finite."""
    for each in (x, y, z):
        for k in range(len(each)):
            if not np.isfinite(each[k]):
                return False
    return True


@njit(cache=True, error_model="numpy")
def body(
    high_b: Array,
    high_a: Array,
    high_state: Array,
    low_b: Array,
    low_a: Array,
    low_state: Array,
    high_table: Array,
    low_table: Array,
    currents: Array,
    dq: Array,
    before: Array,
    rate: float,
    out: Array,
) -> int:
    """Take currents (≥ k,) and commanded speeds (≥ k,) into both filters.

    Writes rows of ``out`` (4, k): high-passed, low-passed, both thresholds; and ``before`` (k,), the speeds.
    Returns 1 for a collision, 2 for what lasts, 3 for both, 0 for neither.
    """
    k = out.shape[1]
    x, ddq = np.abs(currents[:k]), np.empty(k)
    for j in range(k):
        ddq[j] = (dq[j] - before[j]) * rate
        before[j] = dq[j]
    advance(high_b, high_a, high_state, x, out[0])
    advance(low_b, low_a, low_state, x, out[1])
    threshold(high_table, dq, ddq, out[2])
    threshold(low_table, dq, ddq, out[3])
    found = 0
    for j in range(k):
        if abs(out[0, j]) > out[2, j]:
            found |= 1
        if out[1, j] > out[3, j]:
            found |= 2
    return found


@njit(cache=True, error_model="numpy")
def tool(
    high_b: Array,
    high_a: Array,
    high_state: Array,
    low_b: Array,
    low_a: Array,
    low_state: Array,
    force: Array,
) -> tuple[float, float]:
    """Take a force (3,) into both filters, and return the sizes of what comes out [N]."""
    fast, slow = np.empty(3), np.empty(3)
    advance(high_b, high_a, high_state, force, fast)
    advance(low_b, low_a, low_state, force, slow)
    return np.sqrt((fast * fast).sum()), np.sqrt((slow * slow).sum())


@njit(cache=True, error_model="numpy")
def residual(gains: Array, currents: Array, offset: Array, torques: Array, signed: bool, out: Array) -> None:
    """Write (18) for each joint: ``signed`` as it is printed, else the difference of sizes."""
    for j in range(len(out)):
        motor = abs(gains[j] * (currents[j] - offset[j]))
        out[j] = motor - torques[j] if signed else abs(motor - abs(torques[j]))
