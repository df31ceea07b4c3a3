"""Compiled motions of arms that use up limits about the shoulder; nothing here is of the models.

An arm is an upper arm of length a and a forearm of length 2 b; M is the forearm's middle, d the way from the
shoulder to M. On piece i, with h the time since its begin, d is either turned and stretched,

    d = (r + h r') (cos(h ω) u + sin(h ω) s)          u, s unit vectors across each other,

or moved on as in :mod:`tests.occupancy.body_kernels`, d = x + h v + h² a / 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.occupancy.body_kernels import ALMOST, direction, one_of
from tests.occupancy.inclusion_kernels import EXCESS, OPEN_WIDTH, Array, hold

TRIES = 40
"""Places that are tried for a motion to be one of an arm."""
S, E, W = 0, 1, 2
"""Columns of shoulder, elbow and wrist."""


@njit(cache=True, error_model="numpy")
def across(u: Array, wish: Array, out: Array) -> None:
    """Write the unit vector across ``u`` (3,) nearest to ``wish`` (3,) into ``out``."""
    size = dot = 0.0
    for axis in range(3):
        dot += u[axis] * wish[axis]
    for axis in range(3):
        out[axis] = wish[axis] - dot * u[axis]
        size += out[axis] ** 2
    if not size > 1e-12:
        least = 0 if abs(u[0]) < 0.6 else 1
        size = 1.0 - u[least] ** 2
        for axis in range(3):
            out[axis] = (1.0 if axis == least else 0.0) - u[least] * u[axis]
    out /= np.sqrt(size)


@njit(cache=True, error_model="numpy")
def turn_arms(
    rng: np.random.Generator,
    t: Array,
    limits: tuple[float, float, float],
    least: Array,
    most: Array,
    u: Array,
    s: Array,
    rates: Array,
) -> None:
    """Turn and stretch arms as fast as ``limits`` (speed, turning, stretching) [m/s, rad/s, m/s] allow.

    ``t`` (B + 1,) [s]; extensions stay within ``least`` and ``most`` (n,) [m]. ``u``, ``s`` and ``rates``
    = (r, r', ω), all (n, B, 3), become the pieces. What changes, changes at once.
    """
    speed, turning, stretching = limits[0] * ALMOST, limits[1] * ALMOST, limits[2] * ALMOST
    wish, end, side = np.empty(3), np.empty(3), np.empty(3)
    for n in range(u.shape[0]):
        change = one_of(rng, (0.0, 0.5, 1.0))
        direction(rng, end)
        direction(rng, wish)
        across(end, wish, side)
        r, wanted = rng.uniform(least[n], most[n]), one_of(rng, (-1.0, 0.0, 1.0))
        for i in range(u.shape[1]):
            h = t[i + 1] - t[i]
            if rng.random() < change:
                direction(rng, wish)
                across(end, wish, side)
                wanted = one_of(rng, (-1.0, -0.5, 0.0, 0.5, 1.0))
            stretch = wanted * min(stretching, speed)
            stretch = min(max(stretch, (least[n] - r) / h), (most[n] - r) / h)
            farthest = max(r, r + h * stretch)
            turn = min(turning, np.sqrt(max(0.0, speed * speed - stretch * stretch)) / farthest)
            u[n, i], s[n, i] = end, side
            rates[n, i, 0], rates[n, i, 1], rates[n, i, 2] = r, stretch, turn
            r += h * stretch
            c, sn = np.cos(turn * h), np.sin(turn * h)
            for axis in range(3):
                p, q = end[axis], side[axis]
                end[axis], side[axis] = c * p + sn * q, c * q - sn * p


@njit(cache=True, error_model="numpy")
def offsets(
    turned: bool, t: Array, x: Array, v: Array, a: Array, when: Array, d: Array, speed: Array
) -> None:
    """Write d [m] and its velocity [m/s] (n, m, 3) at ``when`` (n, m) [s].

    Pieces (n, B, 3) from ``t`` (B + 1,) on: u, s and (r, r', ω) if ``turned``, otherwise x, v and a.
    """
    for n in range(x.shape[0]):
        for m in range(when.shape[1]):
            i = min(max(int(np.searchsorted(t, when[n, m], side="right")) - 1, 0), x.shape[1] - 1)
            h = when[n, m] - t[i]
            r, stretch, turn = a[n, i, 0] + h * a[n, i, 1], a[n, i, 1], a[n, i, 2]
            c, sn = np.cos(h * turn), np.sin(h * turn)
            for axis in range(3):
                p, q = x[n, i, axis], v[n, i, axis]
                if turned:
                    d[n, m, axis] = r * (c * p + sn * q)
                    speed[n, m, axis] = stretch * (c * p + sn * q) + r * turn * (c * q - sn * p)
                else:
                    d[n, m, axis] = p + h * q + 0.5 * h * h * a[n, i, axis]
                    speed[n, m, axis] = q + h * a[n, i, axis]


@njit(cache=True, error_model="numpy")
def place_arms(
    rng: np.random.Generator, moved: Array, least: Array, most: Array, start: Array
) -> NDArray[np.bool_]:
    """Find where motions ``moved`` (n, m, 3) [m] can be those of arms: ``start`` (n, 3) is added to all of
    each.

    Returns for which one was found that keeps all extensions within ``least`` and ``most`` (n,) [m].
    """
    found = np.zeros(moved.shape[0], np.bool_)
    u = np.empty(3)
    for n in range(moved.shape[0]):
        for _ in range(TRIES):
            direction(rng, u)
            m, r = int(rng.random() * moved.shape[1]), rng.uniform(least[n], most[n])
            for axis in range(3):
                start[n, axis] = r * u[axis] - moved[n, m, axis]
            inside = True
            for m in range(moved.shape[1]):
                square = 0.0
                for axis in range(3):
                    square += (start[n, axis] + moved[n, m, axis]) ** 2
                inside = inside and least[n] ** 2 <= square <= most[n] ** 2
            if inside:
                found[n] = True
                break
    return found


@njit(cache=True, error_model="numpy")
def worst_of_arms(
    rng: np.random.Generator,
    out: NDArray[np.void],
    at: Array,
    times: Array,
    bits: NDArray[np.int64],
    flesh: tuple[float, float],
    covered: NDArray[np.uint32],
    open_cases: Array,
) -> Array:
    """Return the case of an arm that lies farthest outside of a row that covers it.

    ``at`` (slices, instants, persons, 2, 3, 3) [m]: shoulder, elbow, wrist of each side at ``times``
    (slices, instants) [s]; ``bits`` (2, 3): upper arm, forearm, hand of each side; ``flesh`` [m] of arm
    and hand; otherwise as :func:`tests.occupancy.inclusion_kernels.worst_of_bodies`.
    """
    rows: Any = out[0]
    worst = np.zeros(OPEN_WIDTH)
    worst[EXCESS] = -np.inf
    case, x = np.empty(4), np.empty(3)
    open_cases[0, 0] = 0
    covered[:] = 0
    lost = 0
    for i in range(at.shape[0]):
        for row in range(rows.first[i], rows.first[i + 1]):
            k, radius = rows.owner[row], rows.radius[row]
            covered[i, k] |= rows.covers[row]
            for side in range(2):
                for limb in range(3):
                    part = bits[side, limb]
                    if not (rows.covers[row] >> part) & 1:
                        continue
                    room = radius - flesh[1 if limb == 2 else 0]
                    first = S if limb == 0 else E if limb == 1 else W
                    for j in range(at.shape[1]):
                        arm = at[i, j, k, side]
                        case[0], case[1], case[2], case[3] = i, k, part, times[i, j]
                        lost += hold(rows, row, arm[first], room, case, worst, open_cases)
                        if limb == 2:
                            continue
                        lost += hold(rows, row, arm[first + 1], room, case, worst, open_cases)
                        share = rng.random()
                        for axis in range(3):
                            x[axis] = (1.0 - share) * arm[first, axis] + share * arm[first + 1, axis]
                        lost += hold(rows, row, x, room, case, worst, open_cases)
    if lost > 0:
        worst[EXCESS] = np.inf
    return worst
