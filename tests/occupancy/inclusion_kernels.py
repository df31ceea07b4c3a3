"""Compiled checks that bodies lie in rows, apart from all code of the models.

A ball of radius f lies in a hull grown by R if its centre is within R - f of the hull. Distances are
attained: the length of a weighted mean of the hull's points, so that "inside" never rests on convergence.
What the iteration leaves undecided is handed over to be computed in another way; what is no number lies
outside.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Record = Any

STEPS = 400
CONVERGED_M = 1e-11
FLOOR_M = -0.01
"""What lies farther inside than this [m] is inside, and it is not asked how far."""
MOST_OPEN = 256
OPEN_WIDTH = 10
"""Columns of an undecided case: row of the block, point (3), room [m], excess [m], slice, person, part, time
[s]; those of the worst case are the same."""
EXCESS, SLICE = 5, 6


@njit(cache=True, error_model="numpy")
def from_hull(points: Array, n: int, x: Array, enough: float) -> tuple[float, bool]:
    """Distance [m] of ``x`` (3,) from the hull of ``points[:n]``, and whether it is the least one.

    Attained; a distance of at most ``enough`` need not be the least one. No points: infinite.
    """
    if n > 4:
        return _from_many(points, n, x, enough)
    least = np.inf
    for i in range(n):
        square = 0.0
        for axis in range(3):
            square += (points[i, axis] - x[axis]) ** 2
        least = min(least, square) if square == square else np.nan
    least = np.sqrt(least)
    for i in range(n):
        if not least > enough:
            return least, least == 0.0 or n == 1
        for j in range(i):  # a bare number of edges would be a type of its own, compiled apart
            least = min(least, _from_simplex(points, (j, i, i, i), np.int64(1), x))
            for k in range(j):
                least = min(least, _from_simplex(points, (k, j, i, i), np.int64(2), x))
                for m in range(k):
                    least = min(least, _from_simplex(points, (m, k, j, i), np.int64(3), x))
    return least, True


@njit(cache=True, error_model="numpy")
def _from_simplex(points: Array, corner: tuple[int, int, int, int], edges: int, x: Array) -> float:
    """Distance [m] of ``x`` from its foot on a segment, triangle or tetrahedron; inf if that is not on it.

    A segment's foot is kept on it. Solved by elimination, from the normal equations of the edges.
    """
    a, share = np.zeros((3, 4)), np.zeros(3)
    for r in range(edges):
        for axis in range(3):
            origin = points[corner[0], axis]
            edge = points[corner[r + 1], axis] - origin
            a[r, 3] += edge * (x[axis] - origin)
            for c in range(edges):
                a[r, c] += edge * (points[corner[c + 1], axis] - origin)
    for r in range(edges):
        if not a[r, r] > 0.0:
            return np.inf
        for below in range(r + 1, edges):
            factor = a[below, r] / a[r, r]
            for c in range(r, 4):
                a[below, c] -= factor * a[r, c]
    left = 1.0
    for r in range(edges - 1, -1, -1):
        share[r] = a[r, 3]
        for c in range(r + 1, edges):
            share[r] -= a[r, c] * share[c]
        share[r] /= a[r, r]
        if edges == 1:
            share[r] = min(max(share[r], 0.0), 1.0)
        if not share[r] >= 0.0:
            return np.inf
        left -= share[r]
    if not left >= 0.0:
        return np.inf
    square = 0.0
    for axis in range(3):
        gap = points[corner[0], axis] - x[axis]
        for r in range(edges):
            gap += share[r] * (points[corner[r + 1], axis] - points[corner[0], axis])
        square += gap * gap
    return float(np.sqrt(square))


@njit(cache=True, error_model="numpy")
def _from_many(points: Array, n: int, x: Array, enough: float) -> tuple[float, bool]:
    """Distance as :func:`from_hull` gives it, by pairwise Frank-Wolfe steps from the nearest point on.

    It is the least one when it is at most ``CONVERGED_M`` above a lower bound.
    """
    away, weights = np.empty(3), np.zeros(n)
    nearest, square = 0, np.inf
    for i in range(n):
        own = 0.0
        for axis in range(3):
            own += (points[i, axis] - x[axis]) ** 2
        if own < square:
            nearest, square = i, own
    weights[nearest] = 1.0
    for axis in range(3):
        away[axis] = points[nearest, axis] - x[axis]
    for _ in range(STEPS):
        square = away[0] ** 2 + away[1] ** 2 + away[2] ** 2
        distance = np.sqrt(square)
        if distance <= enough:
            return distance, distance <= CONVERGED_M
        low, high, best, worst = np.inf, -np.inf, 0, 0
        for i in range(n):
            along = 0.0
            for axis in range(3):
                along += away[axis] * (points[i, axis] - x[axis])
            if along < low:
                low, best = along, i
            if weights[i] > 0.0 and along > high:
                high, worst = along, i
        if square - low <= CONVERGED_M * distance:
            return distance, True
        length = 0.0
        for axis in range(3):
            length += (points[best, axis] - points[worst, axis]) ** 2
        if not length > 0.0:
            break
        step = min(weights[worst], (high - low) / length)
        weights[best] += step
        weights[worst] = weights[worst] - step if step < weights[worst] else 0.0
        for axis in range(3):
            away[axis] = 0.0
            for i in range(n):
                away[axis] += weights[i] * (points[i, axis] - x[axis])
    return np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2), False


@njit(cache=True, error_model="numpy")
def hold(rows: Record, row: int, x: Array, room: float, case: Array, worst: Array, open_cases: Array) -> int:
    """Take the ball around ``x`` (3,) whose centre has ``room`` [m] about the hull of a row into account.

    ``case``: slice, person, part, time. ``worst`` (``OPEN_WIDTH``,) is replaced if this lies farther out,
    with what is certain; a case that is not decided goes to ``open_cases`` (``MOST_OPEN``,
    ``OPEN_WIDTH``), of which the first column of row 0 counts all. Returns 1 if there was no room for it.
    """
    nearest = max(worst[EXCESS], FLOOR_M)
    distance, least = from_hull(rows.points[row], rows.n_points[row], x, room + nearest)
    excess = distance - room
    if not np.isfinite(excess):
        excess, least = np.inf, True
    undecided = not least and not excess <= 0.0
    if excess <= nearest or not (least or undecided):
        return 0
    into = worst
    if undecided:
        n = int(open_cases[0, 0])
        if n + 1 >= open_cases.shape[0]:
            return 1
        open_cases[0, 0] = n + 1
        into = open_cases[n + 1]
    into[0] = row
    into[1:4] = x
    into[4], into[EXCESS] = room, excess
    into[SLICE:] = case
    return 0


@njit(cache=True, error_model="numpy")
def worst_of_bodies(
    rng: np.random.Generator,
    out: NDArray[np.void],
    at: Array,
    times: Array,
    anatomy: tuple[Indices, Indices, Array],
    covered: NDArray[np.uint32],
    open_cases: Array,
) -> Array:
    """Return the case (``OPEN_WIDTH``,) of a body part that lies farthest outside of a row that covers it.

    ``at`` (slices, instants, persons, 20, 3) [m] are the true points at ``times`` (slices, instants) [s];
    ``anatomy``: the points at both ends of each part's axis (16, 2), the points of a hand (16, 3), -1 for
    other parts, and the flesh (16,) [m]. A part lies within its flesh of the segment between its ends,
    a hand within its flesh of each of its points. ``covered`` (slices, persons) becomes the mask of the
    parts that rows cover.
    """
    rows = out[0]
    ends, hands, flesh = anatomy
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
            for part in range(flesh.shape[0]):
                if not (rows.covers[row] >> part) & 1:
                    continue
                for j in range(at.shape[1]):
                    case[0], case[1], case[2], case[3] = i, k, part, times[i, j]
                    body = at[i, j, k]
                    if hands[part, 0] >= 0:
                        _tip(rng, body, hands[part], flesh[part], rows.points[row, 0], j % 2 == 0, x)
                        lost += hold(rows, row, x, radius, case, worst, open_cases)
                        continue
                    a, b = ends[part, 0], ends[part, 1]
                    room = radius - flesh[part]
                    lost += hold(rows, row, body[a], room, case, worst, open_cases)
                    if a != b:
                        lost += hold(rows, row, body[b], room, case, worst, open_cases)
                        share = rng.random()
                        for axis in range(3):
                            x[axis] = (1.0 - share) * body[a, axis] + share * body[b, axis]
                        lost += hold(rows, row, x, room, case, worst, open_cases)
    if lost > 0:
        worst[EXCESS] = np.inf
    return worst


@njit(cache=True, error_model="numpy")
def _tip(
    rng: np.random.Generator, body: Array, hand: Indices, reach: float, seen: Array, outwards: bool, x: Array
) -> None:
    """Write a farthest point of a hand into ``x`` (3,): away from ``seen`` (3,), or in any direction.

    All of a hand lies within ``reach`` of each of its three points: from their middle on, as far as that
    allows.
    """
    way, size = np.empty(3), 0.0
    for axis in range(3):
        x[axis] = (body[hand[0], axis] + body[hand[1], axis] + body[hand[2], axis]) / 3.0
    for axis in range(3):
        way[axis] = x[axis] - seen[axis] if outwards else rng.standard_normal()
        size += way[axis] ** 2
    if not size > 1e-18:
        way[0], size = 1.0, way[1] ** 2 + way[2] ** 2 + 1.0
    way /= np.sqrt(size)
    longest = np.inf
    for point in hand:
        along = off = 0.0
        for axis in range(3):
            gap = x[axis] - body[point, axis]
            along += gap * way[axis]
            off += gap * gap
        longest = min(longest, -along + np.sqrt(max(0.0, along * along + reach * reach - off)))
    for axis in range(3):
        x[axis] += longest * way[axis]
