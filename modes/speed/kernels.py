"""Compiled parts of speed alteration: the index of every pair as a quadratic in the speed, and optimisers.

A *pair* is an ellipsoid of the robot and one of a body. Over one interval the robot's centre moves in
proportion to the speed v that is chosen, and F, the reciprocal of the danger index, is
``c[0] + c[1] v + c[2] v²``. ``goal`` is ``(P, D, R, v_p, v_prev, cap)``: weights, speeds [m/s].
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SWEEPS = 30
_HALVINGS = 24
"""Leave λ uncertain by 3e-8, and F by its square: at the maximum F does not change with λ to first order."""


@njit(cache=True, error_model="numpy")
def eigen(a: Array, vectors: Array) -> None:
    """Diagonalise the symmetric ``a`` (3, 3) in place by Jacobi rotations; columns of ``vectors`` (3, 3)."""
    for r in range(3):
        for c in range(3):
            vectors[r, c] = 1.0 if r == c else 0.0
    for _ in range(_SWEEPS):
        off = a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2]
        if not off > 1e-30 * (a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                sign = 1.0 if theta >= 0.0 else -1.0
                tan = sign / (abs(theta) + np.sqrt(theta * theta + 1.0))
                cos = 1.0 / np.sqrt(tan * tan + 1.0)
                sin = tan * cos
                for k in range(3):
                    akp, akq = a[k, p], a[k, q]
                    a[k, p], a[k, q] = cos * akp - sin * akq, sin * akp + cos * akq
                for k in range(3):
                    apk, aqk = a[p, k], a[q, k]
                    a[p, k], a[q, k] = cos * apk - sin * aqk, sin * apk + cos * aqk
                    vkp, vkq = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = cos * vkp - sin * vkq, sin * vkp + cos * vkq


@njit(cache=True, error_model="numpy")
def shape(axes: Array, rotation: Array, power: float, out: Array) -> None:
    """Write ``rotation diag(axes^power) rotationᵀ`` (3, 3)."""
    for r in range(3):
        for c in range(3):
            out[r, c] = 0.0
            for k in range(3):
                out[r, c] += rotation[r, k] * axes[k] ** power * rotation[c, k]


@njit(cache=True, error_model="numpy")
def transformed(robot: Array, robot_turn: Array, body: Array, body_turn: Array, out: Array) -> None:
    """Write the metric M (3, 3) [1/m²] of the transformed ellipsoid: F = dᵀ M d, d between the centres [m].

    The body's ellipsoid becomes the unit ball, and the semi-axes of the robot's are lengthened by 1 there.
    """
    to_ball, image = np.empty((3, 3)), np.empty((3, 3))
    square, axes = np.zeros((3, 3)), np.empty((3, 3))
    shape(body, body_turn, -1.0, to_ball)
    shape(robot, robot_turn, 1.0, square)
    for r in range(3):
        for c in range(3):
            image[r, c] = 0.0
            for k in range(3):
                image[r, c] += to_ball[r, k] * square[k, c]
    for r in range(3):
        for c in range(3):
            square[r, c] = 0.0
            for k in range(3):
                square[r, c] += image[r, k] * image[c, k]
    eigen(square, axes)
    for r in range(3):
        for c in range(3):
            out[r, c] = 0.0
    for k in range(3):
        length = np.sqrt(max(square[k, k], 0.0)) + 1.0
        for r in range(3):
            image[k, r] = 0.0
            for c in range(3):
                image[k, r] += axes[c, k] * to_ball[c, r]
            image[k, r] /= length
        for r in range(3):
            for c in range(3):
                out[r, c] += image[k, r] * image[k, c]


@njit(cache=True, error_model="numpy")
def _inverse(a: Array, out: Array) -> None:
    """Write the inverse of the symmetric ``a`` (3, 3)."""
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        for c in range(3):
            k, m = (c + 1) % 3, (c + 2) % 3
            out[c, r] = a[i, k] * a[j, m] - a[i, m] * a[j, k]
    det = a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0]
    for r in range(3):
        for c in range(3):
            out[r, c] /= det


@njit(cache=True, error_model="numpy")
def touching(robot: Array, robot_turn: Array, body: Array, body_turn: Array, d: Array, out: Array) -> None:
    """Write a metric M (3, 3) [1/m²]: at this ``d`` [m] dᵀ M d is the squared factor at which they touch.

    Perram and Wertheim 1985: F(d) = max over λ in [0, 1] of λ (1 - λ) dᵀ [(1 - λ) A + λ B]⁻¹ d, concave in λ.
    At any other d, dᵀ M d is not above F(d), because it belongs to one λ.
    """
    a, b = np.empty((3, 3)), np.empty((3, 3))
    mixed, inverse = np.empty((3, 3)), np.empty((3, 3))
    shape(robot, robot_turn, 2.0, a)
    shape(body, body_turn, 2.0, b)
    low, high = 0.0, 1.0
    share = 0.5
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        for r in range(3):
            for c in range(3):
                mixed[r, c] = (1.0 - share) * a[r, c] + share * b[r, c]
        _inverse(mixed, inverse)
        along, across = 0.0, 0.0
        for r in range(3):
            x = inverse[r, 0] * d[0] + inverse[r, 1] * d[1] + inverse[r, 2] * d[2]
            along += d[r] * x
            for c in range(3):
                y = inverse[c, 0] * d[0] + inverse[c, 1] * d[1] + inverse[c, 2] * d[2]
                across += x * (b[r, c] - a[r, c]) * y
        if (1.0 - 2.0 * share) * along - share * (1.0 - share) * across > 0.0:
            low = share
        else:
            high = share
    for r in range(3):
        for c in range(3):
            out[r, c] = share * (1.0 - share) * inverse[r, c]


@njit(cache=True, error_model="numpy")
def quadratics(
    robot: Array, robot_axes: Array, robot_turn: Array, per_speed: Array,
    body: Array, body_axes: Array, body_turn: Array, at_speed: float, exact: bool, out: Array,
) -> None:  # fmt: skip
    """Write c (N M, 3) of all pairs: F at speed v is c[0] + c[1] v + c[2] v².

    Centres ``robot`` (N, 3) and ``body`` (M, 3) [m], of the robot at v = 0; they move by ``per_speed`` (N, 3)
    [s] times v. ``exact``: the quadratic is Perram and Wertheim's F at ``at_speed``, and nowhere above it.
    """
    metric, d = np.empty((3, 3)), np.empty(3)
    m = len(body)
    for i in range(len(robot)):
        for j in range(m):
            for k in range(3):
                d[k] = body[j, k] - robot[i, k] - at_speed * per_speed[i, k]
            if exact and d[0] == 0.0 == d[1] and d[2] == 0.0:
                d[0] = 1.0  # any direction: which λ is best does not depend on how far
            if exact:
                touching(robot_axes[i], robot_turn[i], body_axes[j], body_turn[j], d, metric)
            else:
                transformed(robot_axes[i], robot_turn[i], body_axes[j], body_turn[j], metric)
            c0, c1, c2 = 0.0, 0.0, 0.0
            for r in range(3):
                dr, tr = body[j, r] - robot[i, r], per_speed[i, r]
                for c in range(3):
                    dc, tc = body[j, c] - robot[i, c], per_speed[i, c]
                    c0 += dr * metric[r, c] * dc
                    c1 -= 2.0 * dr * metric[r, c] * tc
                    c2 += tr * metric[r, c] * tc
            out[i * m + j, 0], out[i * m + j, 1], out[i * m + j, 2] = c0, c1, c2


@njit(cache=True, error_model="numpy")
def least(pairs: Array, v: float) -> float:
    """Return the smallest F at speed ``v``; inf without pairs."""
    found = np.inf
    for i in range(len(pairs)):
        f = pairs[i, 0] + v * (pairs[i, 1] + v * pairs[i, 2])
        found = min(found, max(f, 0.0))
    return found


@njit(cache=True, error_model="numpy")
def objective(pairs: Array, goal: Array, v: float) -> float:
    """Return the objective with its penalty, (11) and (12), at speed ``v``."""
    away, change = (v - goal[3]) / goal[3], (v - goal[4]) / goal[3]
    value: float = goal[0] * away * away + goal[1] * change * change
    f = least(pairs, v)
    if not f > 1.0 and goal[2] > 0.0:  # 0 / 0 is no penalty
        value += goal[2] / (f * f)
    return value


@njit(cache=True, error_model="numpy")
def nearest_free(pairs: Array, v: float, up: float) -> float:
    """Return the first speed from ``v`` on, towards ``up`` (1 or -1), at which no pair touches; inf: none.

    The end of an interval in which F is at most 1 is passed by a few units in the last place.
    """
    for _ in range(len(pairs) + 1):
        if least(pairs, v) > 1.0:
            return v
        for i in range(len(pairs)):
            c0, c1, c2 = pairs[i, 0], pairs[i, 1], pairs[i, 2]
            if c0 + v * (c1 + v * c2) > 1.0:
                continue
            root = c1 * c1 - 4.0 * c2 * (c0 - 1.0)
            if not (c2 > 0.0 and root >= 0.0):
                return np.inf
            end = (-c1 + up * np.sqrt(root)) / (2.0 * c2)
            step = 1e-12 * max(abs(end), 1e-3)
            while not c0 + end * (c1 + end * c2) > 1.0:
                end += up * step
                step *= 2.0
            v = end
    return np.inf


@njit(cache=True, error_model="numpy")
def best_free(pairs: Array, goal: Array) -> tuple[float, bool]:
    """Return the best speed that touches nobody, and whether no speed that touches somebody is better.

    NaN: every speed within the cap touches somebody. The objective without penalty is convex, hence the best
    free speed is the nearest one to its minimum on either side; with it, a touching speed costs R at least.
    """
    cap, weights = goal[5], goal[0] + goal[1]
    middle = (goal[0] * goal[3] + goal[1] * goal[4]) / weights
    middle = min(max(middle, -cap), cap)
    bare = np.empty((0, 3))
    lowest, best, value = objective(bare, goal, middle), np.nan, np.inf
    for up in (1.0, -1.0):
        v = nearest_free(pairs, middle, up)
        if abs(v) <= cap:
            at_v = objective(bare, goal, v)
            if at_v < value:
                best, value = v, at_v
    return best, value <= lowest + goal[2]


@njit(cache=True, error_model="numpy")
def best_of(pairs: Array, goal: Array, places: Array) -> float:
    """Return the first of the speeds ``places`` (K,) with the least objective; NaN without any."""
    best, value = np.nan, np.inf
    for v in places:
        at_v = objective(pairs, goal, v)
        if at_v < value or np.isnan(best):
            best, value = v, at_v
    return best


@njit(cache=True, error_model="numpy")
def evolve(pairs: Array, goal: Array, draws: Array, crossover: float, mutation: float, track: Array) -> float:
    """Run the elite genetic algorithm; return the best speed.

    ``draws`` (generations + 1, population, 6) in [0, 1): the first of a row set up the population, the others
    decide parents, crossover, its share, mutation, and where to. ``track`` (generations + 1, 2): best speed
    and objective of each generation. One parent is drawn by linear ranking, its mate from all alike.
    """
    generations, n = len(track) - 1, draws.shape[1]
    cap = goal[5]
    people, value = np.empty(n), np.empty(n)
    next_people = np.empty(n)
    for i in range(n):
        people[i] = cap * (2.0 * draws[0, i, 0] - 1.0)
        value[i] = objective(pairs, goal, people[i])
    for g in range(generations + 1):
        order = np.argsort(value, kind="mergesort")
        track[g, 0], track[g, 1] = people[order[0]], value[order[0]]
        if g == generations:
            break
        for i in range(n):
            if i < 2:
                next_people[i] = people[order[i]]
                continue
            u = draws[g + 1, i]
            first = people[order[_ranked(u[0], n)]]
            second = people[order[min(int(n * u[1]), n - 1)]]
            child = first
            if u[2] < crossover:
                child = u[3] * first + (1.0 - u[3]) * second
            if u[4] < mutation:
                child = cap * (2.0 * u[5] - 1.0)
            next_people[i] = child
        for i in range(n):
            people[i] = next_people[i]
            value[i] = objective(pairs, goal, people[i])
    return float(track[generations, 0])


@njit(cache=True, error_model="numpy")
def _ranked(u: float, n: int) -> int:
    """Return a rank from 0, drawn by linear ranking with probability falling from 2/n to 0."""
    return min(int(n * (1.0 - np.sqrt(1.0 - u))), n - 1)
