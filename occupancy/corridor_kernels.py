"""Compiled corridors: what links occupy on cells of a path, and the slices of many plans in one."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.kernels import bound_motion
from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]

_SLACK_S = 1e-9
"""Path parameters this near to the border of two cells [s] count as being in both: roundings are smaller."""
_SLACK = 1e-6
"""Relative slack where something is compared that other code has computed in another way."""

TOO_LONG, OFF_PATH, COUNTED_BACK = 0, -1, -2
"""Answers of envelop that are no number of cells: more of them than slices; cells that are not there; people
who were seen after the plans begin."""


@njit(cache=True, error_model="numpy")
def longest_bulge(kinematics: Block, enclosure: Block, fixed: Block, slices: Block, bulge: Array) -> None:
    """Write h²/8·A [m] of every link for the bounds and the length of the first slice into ``bulge (L,)``."""
    tree, capsules, plan = kinematics[0], enclosure[0], slices[0]
    h = plan.t[1] - plan.t[0]
    for link in range(capsules.n):
        chain = fixed[0].chain[link]
        a, _, _, _, _ = bound_motion(tree, chain, capsules.reach[link], plan, 0, 0.0)
        bulge[link] = h * h / 8.0 * a


@njit(cache=True, error_model="numpy")
def keep_cells(
    links: Block,
    slices: Block,
    kinematics: Block,
    enclosure: Block,
    fixed: Block,
    bulge: Array,
    at: int,
    points: Array,
    radius: Array,
    speed: Array,
    twist: Array,
) -> None:
    """Copy the rows of swept cells to ``at`` and on, grown by 2 ``bulge (L,)``.

    ``points`` (M, L, 4, 3), ``radius`` (M, L) [m], NaN where a row is not usable. ``speed`` (M,) [m/s]: with
    ṡ = 1 the fastest end point of an axis is nowhere in the cell slower than that. Its velocity differs from
    the mean over the cell, chord divided by length h, by less than A h. ``twist`` (M, L) [m/s]: with ṡ ≤ 1
    the velocities of the two ends of an axis nowhere differ by more; by the same reasoning.
    """
    arm, plan, tree, capsules = links[0], slices[0], kinematics[0], enclosure[0]
    n_links = capsules.n
    for i in range(plan.n):
        h = plan.t[i + 1] - plan.t[i]
        least = 0.0
        for link in range(n_links):
            row = i * n_links + link
            usable = arm.n_points[row] == 4
            radius[at + i, link] = (
                (arm.radius[row] + 2.0 * bulge[link]) * (1.0 + _SLACK) if usable else np.nan
            )
            a, _, _, _, _ = bound_motion(tree, fixed[0].chain[link], capsules.reach[link], plan, i, 0.0)
            for p in range(4):
                for axis in range(3):
                    points[at + i, link, p, axis] = arm.points[row, p, axis]
            for end in range(2):
                square = 0.0
                for axis in range(3):
                    d = arm.points[row, 2 + end, axis] - arm.points[row, end, axis]
                    square += d * d
                slowest = np.sqrt(square) / h - a * h
                least = max(least, slowest)
            turned = 0.0
            for axis in range(3):
                d = arm.points[row, 3, axis] - arm.points[row, 2, axis]
                d -= arm.points[row, 1, axis] - arm.points[row, 0, axis]
                turned += d * d
            twist[at + i, link] = np.sqrt(turned) / h + 2.0 * a * h if usable else np.nan
        speed[at + i] = least


@njit(cache=True, error_model="numpy")
def place_cells(lo: int, n: int, points: Array, radius: Array, out: Block) -> None:
    """Write cells ``lo`` to ``lo + n - 1`` of a corridor as the rows of slices 0 to n - 1 into ``out``."""
    rows = out[0]
    n_links = radius.shape[1]
    row = 0
    for i in range(n):
        rows.first[i] = row
        for link in range(n_links):
            for p in range(4):
                for axis in range(3):
                    rows.points[row, p, axis] = points[lo + i, link, p, axis]
            usable = radius[lo + i, link] >= 0.0
            rows.n_points[row] = 4 if usable else 0
            rows.radius[row] = radius[lo + i, link]
            rows.slice[row], rows.owner[row] = i, link
            rows.covers[row], rows.model[row] = 0, 0
            rows.speed_max[row] = np.nan
            row += 1
    for i in range(n, rows.first.shape[0]):
        rows.first[i] = row
    rows.n = row


@njit(cache=True, error_model="numpy")
def surely_move(
    plans: Block, cells: tuple[float, float, float], speed: Array, out: NDArray[np.bool_]
) -> None:
    """Tell of each of ``plans`` (N,) whether the arm moves at its begin (ṡ = 1). Arguments as envelop."""
    s0, length, moves = cells
    n_cells = speed.shape[0]
    for row in range(plans.shape[0]):
        s = plans[row].s[0]
        out[row] = False
        if s >= s0 and s <= s0 + n_cells * length:
            a = max(int(np.floor((s - _SLACK_S - s0) / length)), 0)
            b = min(int(np.floor((s + _SLACK_S - s0) / length)), n_cells - 1)
            out[row] = speed[a] > moves and speed[b] > moves


@njit(cache=True, error_model="numpy")
def envelop(
    plans: Block,
    begins: Array,
    cells: tuple[float, float, float],
    corridor: tuple[Array, Array],
    people: Block,
    parts: int,
    links: Block,
    slices: Block,
    ledger: Block,
) -> int:
    """Write one plan that contains ``plans``: for each cell of their paths, until when one of them is in it.

    ``plans`` (N,): ``n``, and ``t`` [s, from the begin of the plan] and ``s`` at the slice ends; ``begins``
    (N,) [s], increasing; ``cells`` = (s of the first cell, length [s], speed [m/s] above which an arm moves);
    ``corridor`` = points, radius as keep_cells writes them. Fills ``links`` with the rows of the
    cells, ``slices`` with their times, and ``ledger`` with ``parts`` of everybody for every row. Returns the
    number of cells, or one of the answers above.
    """
    s0, length, _ = cells
    points, radius = corridor
    n_cells, n_links = radius.shape
    plan, book, seen = slices[0], ledger[0], people[0]
    lo, hi, end = n_cells, -1, s0 + n_cells * length + _SLACK_S
    for row in range(plans.shape[0]):
        each = plans[row]
        if not 0 < each.n < each.s.shape[0]:
            return OFF_PATH
        for k in range(each.n):  # what is not a number has no cell
            if not (s0 <= each.s[k] <= each.s[k + 1] + _SLACK_S and each.s[k + 1] <= end):
                return OFF_PATH
        lo = min(lo, max(int(np.floor((each.s[0] - _SLACK_S - s0) / length)), 0))
        hi = max(hi, min(int(np.floor((each.s[each.n] + _SLACK_S - s0) / length)), n_cells - 1))
    n = hi - lo + 1
    if n > MAX_SLICES:
        return TOO_LONG
    plan.n = n
    plan.t[0] = begins[0]
    for i in range(n):
        plan.t[i + 1] = -np.inf
    for row in range(plans.shape[0]):
        each = plans[row]
        for k in range(each.n):
            a = max(int(np.floor((each.s[k] - _SLACK_S - s0) / length)), lo)
            b = min(int(np.floor((each.s[k + 1] + _SLACK_S - s0) / length)), hi)
            for i in range(a - lo, b - lo + 1):
                plan.t[i + 1] = max(plan.t[i + 1], begins[row] + each.t[k + 1])
    for i in range(n):  # in order, whatever roundings do
        plan.t[i + 1] = max(plan.t[i + 1], plan.t[i])
    # a body grows with the time since it was seen; before that instant it would have to grow backwards
    first = plan.t[1] + plan.delay[1] + seen.clock_error
    earliest = plan.t[0] + plan.delay[0] - 2.0 * seen.stamp_error - seen.clock_error
    for k in range(seen.n):
        for p in range(seen.t_obs.shape[1]):
            if (int(seen.present[k]) >> p) & 1:
                t_obs = seen.t_obs[k, p]
                if not first - t_obs >= t_obs - earliest:
                    return COUNTED_BACK
    place_cells(lo, n, points, radius, links)
    book.n_slices, book.n_links, book.n_people = n, n_links, seen.n
    for i in range(n):
        for link in range(n_links):
            for k in range(seen.n):
                book.open[i, link, k] = np.uint32(parts)
    return int(n)
