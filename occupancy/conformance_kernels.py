"""Compiled tests of recorded motion: points against the rows of a model, and the accelerations they show."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.kernels import narrow
from robots.motion import Block

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Record = Any
"""One record of a block: its fields are attributes in compiled code."""


@njit(cache=True, error_model="numpy")
def body_depth(crowd: Record, k: int, part: int, place: int, body: Record) -> float:
    """How deep [m] the point at ``place`` of a part must lie: the part's radius on its axis, else 0.

    ``crowd`` is a record of the people block, ``k`` a row of it, ``body`` a record of a PARTS block.
    A hand has one point for an axis, the one seen last of those that enclose it (the first of several).
    """
    if body.n_axis[part] > 1 or body.point[part, 1] < 0:
        return float(body.radius[part]) if place < body.n_axis[part] else 0.0
    newest, carrier = -np.inf, 0
    for i in range(body.point.shape[1]):
        p = body.point[part, i]
        if p >= 0 and (int(crowd.present[k]) >> p) & 1 and crowd.t_obs[k, p] > newest:
            newest, carrier = crowd.t_obs[k, p], i
    return float(body.radius[part]) if place == carrier else 0.0


@njit(cache=True, error_model="numpy")
def _declared(rows: Record, crowd: Record, i: int, person: int, part: int) -> bool:
    """Whether slice i has a row of a part for every hypothesis about a person: else nothing is said of it."""
    for k in range(crowd.n):
        if crowd.person[k] != person:
            continue
        has = False
        for row in range(rows.first[i], rows.first[i + 1]):
            has = has or (rows.owner[row] == k and (int(rows.covers[row]) >> part) & 1 != 0)
        if not has:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _excess(
    rows: Record, crowd: Record, at: tuple[int, int, int, int], x: Array, e_p: float, body: Record, s: Record
) -> float:
    """How far [m] a point lies outside of the union of a part's rows; inf if there is none.

    ``at``: slice, person, part, place of the point in the part. ``x`` (1, 3) [m] within ``e_p`` [m].
    """
    i, person, part, place = at
    best = np.inf
    for row in range(rows.first[i], rows.first[i + 1]):
        k = rows.owner[row]
        if k >= crowd.n or crowd.person[k] != person or not (int(rows.covers[row]) >> part) & 1:
            continue
        narrow(rows.points[row], rows.n_points[row], x, 1, 0.0, np.inf, True, s)
        best = min(best, s.attained - rows.radius[row] + body_depth(crowd, k, part, place, body) - e_p)
    return float(best)


@njit(cache=True, error_model="numpy")
def worst_points(
    sets: Block,
    people: Block,
    person: int,
    later: Indices,
    samples: tuple[Array, Array],
    tables: tuple[Block, Block],
    found: Block,
) -> None:
    """Write the point of each later sample that lies outside most, or inside least, into ``found``.

    Slice 2 h of ``sets`` holds at the instant of sample ``later[h]`` (-1: none) of ``samples``: points
    (T, 20, 3) [m], NaN where none, within errors (T, 20) [m]. ``tables``: a PARTS block and a scratch block.
    A record of ``found`` (FOUND, one per horizon) counts the points of parts of which something was said.
    """
    rows, crowd = sets[0], people[0]
    xyz, e_p = samples
    body, s = tables[0][0], tables[1][0]
    for h in range(later.shape[0]):
        out, m = found[h], later[h]
        out.tested, out.part, out.point, out.excess = 0, -1, -1, -np.inf
        if m < 0:
            continue
        for part in range(body.point.shape[0]):
            if not _declared(rows, crowd, 2 * h, person, part):
                continue
            for place in range(body.point.shape[1]):
                p = body.point[part, place]
                if p < 0 or not np.isfinite(xyz[m, p, 0]):
                    continue
                at = (2 * h, person, part, place)
                excess = _excess(rows, crowd, at, xyz[m, p : p + 1], e_p[m, p], body, s)
                if excess < np.inf:
                    out.tested += 1
                    if not excess <= out.excess:
                        out.excess, out.part, out.point = excess, part, p


@njit(cache=True, error_model="numpy")
def greatest_acceleration(
    t: Array, x: Array, e: Array, marks: Indices, depth: int, longest: float
) -> tuple[float, int]:
    """Return the greatest acceleration [m/s²] that three samples show beyond their errors, and the last one.

    From j to k the mean velocity was (x_k - x_j) / τ; if no acceleration exceeds a, then at m, Δ after k,
    |x_m - x_k - (x_k - x_j) Δ / τ| <= a Δ (τ + Δ) / 2, up to e_k + e_m + (e_j + e_k) Δ / τ. Looked at are all
    j among the ``depth`` samples before k and all m up to ``longest`` [s] after it. ``x`` (T, 3) [m] within
    ``e`` (T,) [m] at ``t`` (T,) [s, increasing]; ``marks`` (T + 1,): number of samples before each that do
    not count; nothing is said across one.
    """
    most, where = 0.0, -1
    n = t.shape[0]
    for k in range(1, n - 1):
        for j in range(max(0, k - depth), k):
            if marks[k + 1] > marks[j]:
                continue
            before = t[k] - t[j]
            for m in range(k + 1, n):
                after = t[m] - t[k]
                if after > longest or marks[m + 1] > marks[j]:
                    break
                share = after / before
                away = 0.0
                for axis in range(x.shape[1]):
                    off = x[m, axis] - x[k, axis] - (x[k, axis] - x[j, axis]) * share
                    away += off * off
                over = np.sqrt(away) - e[k] - e[m] - (e[j] + e[k]) * share
                a = 2.0 * over / (after * (before + after))
                if a > most:
                    most, where = a, m
    return most, where
