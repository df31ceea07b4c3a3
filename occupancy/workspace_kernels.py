"""Compiled checks of the arm against fixtures and against itself.

As in :mod:`occupancy.kernels`, nothing but a certificate proves, and NaN proves nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.kernels import LARGEST, ROUNDING, ball_gap, bound_rows, narrow, stroke_excess
from robots.motion import Block

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]
Record = Any
"""The one element of a block."""


@njit(cache=True, error_model="numpy")
def mark_moving(
    links: Block, slices: Block, enclosure: Block, speed: float, error: float, active: Flags
) -> int:
    """Write 1 into ``active`` (L,) for links that move on some slice of the plan, else 0; return how many.

    A link moves on a slice unless no point of it can be faster than ``speed`` [m/s] and tracking errors
    displace it by no more than ``error`` [m]; what is NaN moves.
    """
    rows, plan, capsules = links[0], slices[0], enclosure[0]
    moving = 0
    for link in range(capsules.n):
        displaced = 0.0
        for j in range(capsules.reach.shape[1]):
            displaced += capsules.reach[link, j] * plan.q_error[j]
        rests = displaced <= error
        for i in range(plan.n):
            rests = rests and rows.speed_max[i * capsules.n + link] <= speed
        active[link] = 0 if rests else 1
        moving += 0 if rests else 1
    return moving


@njit(cache=True, error_model="numpy")
def mark_commanded(slices: Block, chain: NDArray[np.int8], active: Flags) -> None:
    """Write 1 into ``active`` (L,) for links on a joint that the plan moves, however slowly, else 0.

    ``chain`` (L, J): joints that carry each link. A joint whose speed is NaN moves.
    """
    plan = slices[0]
    active[:] = 0
    for j in range(min(plan.n_joints, chain.shape[1])):
        rests = True
        for i in range(plan.n):
            rests = rests and plan.dq_max[i, j] <= 0.0
        if not rests:
            for link in range(chain.shape[0]):
                if chain[link, j] != 0:
                    active[link] = 1


@njit(cache=True, error_model="numpy")
def _nothing_found(found: Record) -> None:
    found.slice = found.link = found.other = -1
    found.gap = np.inf
    found.other_radius = found.lost = 0.0
    for axis in range(3):
        found.direction[axis] = found.link_point[axis] = found.other_point[axis] = np.nan


@njit(cache=True, error_model="numpy")
def _note(
    found: Record,
    i: int,
    link: int,
    other: int,
    gap: float,
    radii: tuple[float, float],
    lost: float,
    s: Record,
) -> None:
    """Write a pair that is not proven apart into ``found``, if none with a smaller gap is there."""
    if not gap < found.gap and found.slice >= 0:
        return
    found.slice, found.link, found.other, found.gap = i, link, other, gap
    found.other_radius, found.lost = radii[1], lost
    for axis in range(3):
        n = s.direction[axis]
        found.direction[axis] = n
        found.link_point[axis] = s.point_a[axis] + radii[0] * n
        found.other_point[axis] = s.point_b[axis] - radii[1] * n


@njit(cache=True, error_model="numpy")
def _forget_witness(s: Record) -> None:
    for axis in range(3):
        s.direction[axis] = s.point_a[axis] = s.point_b[axis] = np.nan


@njit(cache=True, error_model="numpy")
def _facet_of_ball(fixed: Record, p: int, ball: Array, slack: float) -> float:
    """Largest lower bound [m] on the gap of a ball and piece p in the directions of its facets."""
    best = -np.inf
    for f in range(fixed.n_facets[p]):
        facet = fixed.facet[p, f]
        gap = facet[0] * ball[0] + facet[1] * ball[1] + facet[2] * ball[2] - facet[3] - ball[3] - slack
        best = max(best, gap)
    return best


@njit(cache=True, error_model="numpy")
def _facet_of_points(fixed: Record, p: int, points: Array, n: int, slack: float, s: Record) -> float:
    """Largest certified gap [m] of ``points[:n]`` and piece p along its facets, with witness."""
    best = -np.inf
    for f in range(fixed.n_facets[p]):
        facet = fixed.facet[p, f]
        low, lowest, total = np.inf, 0, 0.0
        for k in range(n):
            d = facet[0] * points[k, 0] + facet[1] * points[k, 1] + facet[2] * points[k, 2]
            total += d
            if d < low:
                low, lowest = d, k
        gap = low - facet[3] - slack + 0.0 * total
        if gap > best:
            best = gap
            for axis in range(3):
                s.direction[axis] = -facet[axis]
                s.point_a[axis] = points[lowest, axis]
                s.point_b[axis] = points[lowest, axis] - (low - facet[3]) * facet[axis]
    return best


@njit(cache=True, error_model="numpy")
def _fixture_gap(
    arm: Record, row: int, ball: Array, fixed: Record, p: int, corners: Array, margin: float, s: Record
) -> float:
    """Certified lower bound [m] of the gap of a link row and piece p; the search ends above ``margin``.

    ``margin`` infinite: the largest bound that is found, with witness points in ``s``. ``-inf`` for a row
    that is not usable.
    """
    if not ball[4] >= 0.0:
        _forget_witness(s)
        return -np.inf
    own = fixed.ball[p]
    rounding = ROUNDING * (ball[4] + own[4])
    begin, end = fixed.first[p], fixed.first[p + 1]
    gap: float = -np.inf
    if end > begin:
        gap = ball_gap(ball, own)
        if gap > margin:
            return gap
    in_ball = _facet_of_ball(fixed, p, ball, fixed.radius[p] + rounding)
    if in_ball > margin:
        return in_ball
    slack = arm.radius[row] + fixed.radius[p] + rounding
    points, n = arm.points[row], arm.n_points[row]
    _forget_witness(s)
    facet = _facet_of_points(fixed, p, points, n, slack, s)
    if end == begin or facet > margin:
        return facet
    gap = max(gap, facet)
    narrow(points, n, corners[begin:end], end - begin, slack, margin, margin == np.inf, s)
    gap = max(gap, s.gap)
    return gap


@njit(cache=True, error_model="numpy")
def check_fixtures(
    links: Block,
    n_slices: int,
    n_links: int,
    active: Flags,
    fixtures: Block,
    corners: Array,
    margin: float,
    balls: Array,
    scratch: Block,
    nearest: Block,
) -> bool:
    """Whether every active link is proven farther than ``margin`` [m] from every fixture on every slice.

    If not, ``nearest`` is the pair with the smallest certified gap of the first slice on which one is open.
    Rows that do not belong together prove nothing.
    """
    arm, fixed, s, found = links[0], fixtures[0], scratch[0], nearest[0]
    _nothing_found(found)
    if not (n_slices > 0 and n_links > 0 and arm.n == n_slices * n_links and arm.n <= balls.shape[0]):
        found.slice = 0
        found.gap = -np.inf
        return False
    bound_rows(arm.points, arm.n_points, arm.radius, arm.n, balls)
    for i in range(n_slices):
        for link in range(n_links):
            if active[link] == 0:
                continue
            row = i * n_links + link
            if arm.slice[row] != i or arm.owner[row] != link:
                balls[row, :] = np.nan
            ball = balls[row]
            for p in range(fixed.n):
                if fixed.exempt[link, fixed.fixture[p]] != 0:
                    continue
                if not _fixture_gap(arm, row, ball, fixed, p, corners, margin, s) > margin:
                    gap = _fixture_gap(arm, row, ball, fixed, p, corners, np.inf, s)
                    _note(found, i, link, fixed.fixture[p], gap, (arm.radius[row], fixed.radius[p]), 0.0, s)
        if found.slice >= 0:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _relative_motion(
    tree: Record, known: Record, reach: Array, apart: Array, link: int, plan: Record, i: int
) -> tuple[float, float]:
    """Bounds for a link's axis, seen from what does not move with the joints ``apart`` (J,) on slice i.

    Returns its speed [m/s] and its displacement by tracking errors [m]; NaN where a bound of the slice is
    negative or NaN.
    """
    excess = stroke_excess(tree, known.chain[link], known.stroke, plan, i)
    speed = displaced = 0.0
    for j in range(tree.n):
        if apart[j] != 0:
            rho = 1.0 if tree.prismatic[j] != 0 else reach[j] + excess
            error, spread = plan.q_error[j], plan.q_spread[i, j]
            if not (plan.dq_max[i, j] >= 0.0 and error >= 0.0 and spread >= 0.0):
                return np.nan, np.nan
            speed += rho * plan.dq_max[i, j]
            displaced += rho * (error + spread)
    return speed, displaced


@njit(cache=True, error_model="numpy")
def _axis_gap(a: Array, b: Array, radii: float, enough: float, s: Record) -> float:
    """Certified lower bound [m] of the gap of two capsules with axes ``a``, ``b`` (2, 3) at one instant.

    Balls around the middles of the axes first; the search ends above ``enough``.
    """
    square = half_a = half_b = size = 0.0
    for axis in range(3):
        d = 0.5 * (b[0, axis] + b[1, axis] - a[0, axis] - a[1, axis])
        da, db = 0.5 * (a[1, axis] - a[0, axis]), 0.5 * (b[1, axis] - b[0, axis])
        square, half_a, half_b = square + d * d, half_a + da * da, half_b + db * db
        size += abs(a[0, axis]) + abs(a[1, axis]) + abs(b[0, axis]) + abs(b[1, axis])
    if not (size <= LARGEST and radii >= 0.0):
        _forget_witness(s)
        return -np.inf
    slack = radii + ROUNDING * (size + radii)
    bound: float = np.sqrt(square) - np.sqrt(half_a) - np.sqrt(half_b) - slack
    if bound > enough:
        return bound
    _forget_witness(s)
    narrow(a, 2, b, 2, slack, enough, enough == np.inf, s)
    gap: float = max(bound, s.gap)
    return gap


@njit(cache=True, error_model="numpy")
def check_pairs(
    links: Block,
    slices: Block,
    kinematics: Block,
    enclosure: Block,
    fixed: Block,
    pairs: Block,
    active: Flags,
    margin: float,
    scratch: Block,
    nearest: Block,
) -> bool:
    """Whether both links of every pair are proven farther apart than ``margin`` [m] over every slice.

    Both at the same instant: with certified gaps g at the ends of a slice of length h and the relative speed
    v of the two axes, the gap is nowhere below (g_i + g_i+1 - v h) / 2, less what tracking errors displace
    one against the other. If not, ``nearest`` is the pair with the smallest such bound of the first slice on
    which one is open. A pair neither of whose links is active is passed over.
    """
    arm, plan, tree, capsules = links[0], slices[0], kinematics[0], enclosure[0]
    known, each, s, found = fixed[0], pairs[0], scratch[0], nearest[0]
    n_slices, n_links = plan.n, capsules.n
    _nothing_found(found)
    if not (n_slices > 0 and n_links > 0 and arm.n == n_slices * n_links and plan.n_joints == tree.n):
        found.slice = 0
        found.gap = -np.inf
        return False
    for i in range(n_slices):
        h = plan.t[i + 1] - plan.t[i]
        for k in range(each.n):
            a, b = each.a[k], each.b[k]
            if active[a] == 0 and active[b] == 0:
                continue
            row_a, row_b = i * n_links + a, i * n_links + b
            radii = capsules.radius[a] + capsules.radius[b]
            v_a, e_a = _relative_motion(tree, known, capsules.reach[a], each.apart_a[k], a, plan, i)
            v_b, e_b = _relative_motion(tree, known, capsules.reach[b], each.apart_b[k], b, plan, i)
            lost = 0.5 * h * (v_a + v_b) * (1.0 + ROUNDING) + (e_a + e_b) * (1.0 + ROUNDING)
            usable = (
                arm.n_points[row_a] == 4
                and arm.n_points[row_b] == 4
                and arm.slice[row_a] == i
                and arm.slice[row_b] == i
                and arm.owner[row_a] == a
                and arm.owner[row_b] == b
                and h >= 0.0
                and lost >= 0.0
            )
            gap = -np.inf
            _forget_witness(s)
            for enough in (margin + lost, np.inf):
                if usable and not gap > margin:
                    axis_a, axis_b = arm.points[row_a], arm.points[row_b]
                    after = _axis_gap(axis_a[2:4], axis_b[2:4], radii, enough, s)
                    before = _axis_gap(axis_a[0:2], axis_b[0:2], radii, enough, s)
                    gap = 0.5 * (before + after) - lost
            if not gap > margin:
                _note(found, i, a, b, gap, (capsules.radius[a], capsules.radius[b]), lost, s)
        if found.slice >= 0:
            return False
    return True
