"""Compiled sets and distances.

Every comparison that proves something is written so that NaN proves nothing, and every row is tested for
coordinates that are not finite before it takes part: a minimum over NaN would silently ignore it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.sets import MAX_MODELS
from robots.kernels import forward, velocities
from robots.motion import Block

Array = NDArray[np.float64]
Record = Any
"""The one element of a block."""

SKIPPED, SEPARATED, OVERLAPPING, UNDECIDED = 0, 1, 2, 3
"""State of a pair: nothing open depends on it; gap > margin proven; not separable by more than the margin, or
not usable; none of these."""
ROUNDING = 1e-12
"""Relative slack of every certificate; its dot products round by less than 3e-15 of the largest number."""
LARGEST = 1e9
"""Coordinates and radii [m] beyond this prove nothing; keeps all products far from overflow."""
_TINY = 1e-12
_ITERATIONS = 40


@njit(cache=True, error_model="numpy")
def bound_rows(points: Array, n_points: Array, radius: Array, n: int, ball: Array) -> None:
    """Write the enclosing ball (x, y, z, radius) and the magnitude of rows 0 to n-1 into ``ball`` (N, 5) [m].

    Of a row that is not usable (no or too many points, a number that is not finite or beyond ``LARGEST``, a
    negative radius) all five numbers are NaN.
    """
    for row in range(n):
        ball[row, :] = np.nan
        count = n_points[row]
        if not (1 <= count <= points.shape[1] and 0.0 <= radius[row] <= LARGEST):
            continue
        size = 0.0
        usable = True
        for p in range(count):
            for axis in range(3):
                value = abs(points[row, p, axis])
                if not value <= LARGEST:
                    usable = False
                size = max(size, value)
        if not usable:
            continue
        cx = cy = cz = 0.0
        for p in range(count):
            cx += points[row, p, 0] / count
            cy += points[row, p, 1] / count
            cz += points[row, p, 2] / count
        far = 0.0
        for p in range(count):
            dx, dy, dz = points[row, p, 0] - cx, points[row, p, 1] - cy, points[row, p, 2] - cz
            far = max(far, dx * dx + dy * dy + dz * dz)
        ball[row, 0], ball[row, 1], ball[row, 2] = cx, cy, cz
        ball[row, 3] = np.sqrt(far) + radius[row]
        ball[row, 4] = size + radius[row]


@njit(cache=True, error_model="numpy")
def _bound_slice(rows: Record, i: int, ball: Array) -> None:
    """Bound the rows that a block lists for slice i; those that carry another slice are not usable."""
    begin, end = rows.first[i], rows.first[i + 1]
    points, count, radius = rows.points[begin:end], rows.n_points[begin:end], rows.radius[begin:end]
    bound_rows(points, count, radius, end - begin, ball[begin:end])
    for row in range(begin, end):
        if rows.slice[row] != i:
            ball[row, :] = np.nan


@njit(cache=True, error_model="numpy")
def ball_gap(a: Array, b: Array) -> float:
    """Lower bound [m] on the gap between two rows of :func:`bound_rows`; NaN when either is not usable."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    gap: float = np.sqrt(dx * dx + dy * dy + dz * dz) - a[3] - b[3] - ROUNDING * (a[4] + b[4])
    return gap


@njit(cache=True, error_model="numpy")
def segment_parameters(a0: Array, a1: Array, b0: Array, b1: Array) -> tuple[float, float]:
    """Parameters (s, t) in [0, 1] of close points of two segments; parallel and degenerate ones included.

    Ericson, Real-Time Collision Detection, 5.1.9, with one more alternation for nearly parallel segments.
    Only proposes: nothing is proven with it.
    """
    ux, uy, uz = a1[0] - a0[0], a1[1] - a0[1], a1[2] - a0[2]
    vx, vy, vz = b1[0] - b0[0], b1[1] - b0[1], b1[2] - b0[2]
    wx, wy, wz = b0[0] - a0[0], b0[1] - a0[1], b0[2] - a0[2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    determinant = uu * vv - uv * uv
    s = 0.0
    if determinant > 1e-12 * uu * vv:
        s = min(max((uw * vv - vw * uv) / determinant, 0.0), 1.0)
    t = 0.0
    for _ in range(2):
        t = min(max((s * uv - vw) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
        s = min(max((t * uv + uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    return s, t


@njit(cache=True, error_model="numpy")
def certificate(
    a: Array, n_a: int, b: Array, n_b: int, nx: float, ny: float, nz: float
) -> tuple[float, int, int]:
    """Return ``min_B n.b - max_A n.a`` and the indices of the two points that attain it.

    A lower bound on the distance of the hulls of ``a[:n_a]`` and ``b[:n_b]`` for any unit vector n, whatever
    made it: if the hulls meet, their projections meet. NaN if any number is. (docs/method.md, section 5.)
    """
    low, high = np.inf, -np.inf
    i_low, i_high = 0, 0
    total = 0.0
    for j in range(n_b):
        d = nx * b[j, 0] + ny * b[j, 1] + nz * b[j, 2]
        total += d
        if d < low:
            low, i_low = d, j
    for j in range(n_a):
        d = nx * a[j, 0] + ny * a[j, 1] + nz * a[j, 2]
        total += d
        if d > high:
            high, i_high = d, j
    return low - high + 0.0 * total, i_high, i_low


@njit(cache=True, error_model="numpy")
def triangle_weights(p: Array, q: Array, r: Array) -> tuple[float, float, float]:
    """Weights of the point of triangle pqr nearest to the origin (Ericson, 5.1.5)."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    d1, d2 = -(ux * p[0] + uy * p[1] + uz * p[2]), -(vx * p[0] + vy * p[1] + vz * p[2])
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    d3, d4 = -(ux * q[0] + uy * q[1] + uz * q[2]), -(vx * q[0] + vy * q[1] + vz * q[2])
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    d5, d6 = -(ux * r[0] + uy * r[1] + uz * r[2]), -(vx * r[0] + vy * r[1] + vz * r[2])
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6 and d4 - d3 + d5 - d6 > 0.0:
        t = (d4 - d3) / (d4 - d3 + d5 - d6)
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    return va / total, vb / total, vc / total


@njit(cache=True, error_model="numpy")
def _outside(p: Array, q: Array, r: Array, apex: Array) -> bool:
    """Whether the origin lies beyond triangle pqr, seen from ``apex``; True when that is too flat to tell."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    of_origin = -(nx * p[0] + ny * p[1] + nz * p[2])
    of_apex = nx * (apex[0] - p[0]) + ny * (apex[1] - p[1]) + nz * (apex[2] - p[2])
    return not of_origin * of_apex > 0.0


@njit(cache=True, error_model="numpy")
def simplex_weights(w: Array, n: int, weight: Array) -> bool:
    """Write the weights of the point of simplex ``w[:n]`` nearest to the origin; False when it is inside."""
    weight[:] = 0.0
    if n == 1:
        weight[0] = 1.0
    elif n == 2:
        ux, uy, uz = w[1, 0] - w[0, 0], w[1, 1] - w[0, 1], w[1, 2] - w[0, 2]
        uu = ux * ux + uy * uy + uz * uz
        t = -(ux * w[0, 0] + uy * w[0, 1] + uz * w[0, 2])
        t = min(max(t / uu, 0.0), 1.0) if uu > 0.0 else 0.0
        weight[0], weight[1] = 1.0 - t, t
    elif n == 3:
        weight[0], weight[1], weight[2] = triangle_weights(w[0], w[1], w[2])
    else:
        nearest = np.inf
        for face in range(4):
            i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
            if _outside(w[i], w[j], w[k], w[face]):
                wi, wj, wk = triangle_weights(w[i], w[j], w[k])
                x = wi * w[i, 0] + wj * w[j, 0] + wk * w[k, 0]
                y = wi * w[i, 1] + wj * w[j, 1] + wk * w[k, 1]
                z = wi * w[i, 2] + wj * w[j, 2] + wk * w[k, 2]
                square = x * x + y * y + z * z
                if square < nearest:
                    nearest = square
                    weight[:] = 0.0
                    weight[i], weight[j], weight[k] = wi, wj, wk
        return nearest < np.inf
    return True


@njit(cache=True, error_model="numpy")
def witness(a: Array, n_a: int, b: Array, n_b: int, s: Record) -> None:
    """Write close points of both hulls into scratch record ``s``: of the middle of a swept axis and of the
    row's ends.

    Four points are read as two axes (a_i, b_i, a_i+1, b_i+1), fewer as one axis from the first to the last.
    """
    p = s.ends[0]
    q = s.ends[1]
    for axis in range(3):
        p[axis], q[axis] = a[0, axis], a[n_a - 1, axis]
        if n_a == 4:
            p[axis], q[axis] = 0.5 * (a[0, axis] + a[2, axis]), 0.5 * (a[1, axis] + a[3, axis])
    first = b[0]
    last = b[n_b - 1]
    u, v = segment_parameters(p, q, first, last)
    for axis in range(3):
        s.point_a[axis] = p[axis] + u * (q[axis] - p[axis])
        s.point_b[axis] = first[axis] + v * (last[axis] - first[axis])


@njit(cache=True, error_model="numpy")
def _grow_simplex(a: Array, b: Array, i: int, j: int, s: Record) -> int:
    """Add vertex b_j - a_i and move both witness points to the nearest point of the simplex.

    Returns ``UNDECIDED`` to go on, ``SEPARATED`` when nothing nearer is left, ``OVERLAPPING`` when the origin
    is inside.
    """
    n = s.n_simplex
    for k in range(n):
        if s.index[k, 0] == i and s.index[k, 1] == j:
            return SEPARATED
    s.index[n, 0], s.index[n, 1] = i, j
    for axis in range(3):
        s.w[n, axis] = b[j, axis] - a[i, axis]
    if not simplex_weights(s.w, n + 1, s.weight):
        return OVERLAPPING
    kept = 0
    s.point_a[:] = 0.0
    s.point_b[:] = 0.0
    for k in range(n + 1):
        weight = s.weight[k]
        if weight > 0.0:
            i, j = s.index[k, 0], s.index[k, 1]
            s.index[kept, 0], s.index[kept, 1] = i, j
            for axis in range(3):
                s.w[kept, axis] = s.w[k, axis]
                s.point_a[axis] += weight * a[i, axis]
                s.point_b[axis] += weight * b[j, axis]
            kept += 1
    s.n_simplex = kept
    return UNDECIDED if kept > 0 else SEPARATED


@njit(cache=True, error_model="numpy")
def _face_normal(s: Record) -> bool:
    """Write the unit normal of the simplex, if it is a triangle that has one.

    The nearest point of a thin triangle is off by the rounding of its weights, and when it is close to the
    origin that turns the direction to it by far more; the normal is as good as the triangle.
    """
    if s.n_simplex != 3:
        return False
    p, q, r = s.w[0], s.w[1], s.w[2]
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > _TINY:
        return False
    s.normal[0], s.normal[1], s.normal[2] = nx / length, ny / length, nz / length
    return True


@njit(cache=True, error_model="numpy")
def narrow(
    a: Array, n_a: int, b: Array, n_b: int, slack: float, margin: float, exact: bool, s: Record
) -> int:
    """State of one pair of rows; the best certified gap and its direction go to ``s.gap`` and
    ``s.direction``.

    A segment witness and then GJK (Gilbert, Johnson and Keerthi 1988, on the difference of the hulls) propose
    directions; each is judged by :func:`certificate` minus ``slack`` (both radii and rounding) alone. The
    witness points are attained, so their distance minus ``slack`` bounds the gap from above. ``exact`` goes
    on to convergence.
    """
    witness(a, n_a, b, n_b, s)
    s.n_simplex = 0
    s.gap = -np.inf
    s.attained = np.inf
    for _ in range(_ITERATIONS):
        dx, dy, dz = s.point_b[0] - s.point_a[0], s.point_b[1] - s.point_a[1], s.point_b[2] - s.point_a[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        if not length > _TINY:
            s.attained = 0.0
            return OVERLAPPING
        dx, dy, dz = dx / length, dy / length, dz / length
        s.attained = min(s.attained, length)
        if _face_normal(s):
            side = 1.0 if dx * s.normal[0] + dy * s.normal[1] + dz * s.normal[2] > 0.0 else -1.0
            dx, dy, dz = side * s.normal[0], side * s.normal[1], side * s.normal[2]
        between, i, j = certificate(a, n_a, b, n_b, dx, dy, dz)
        if between - slack > s.gap:
            s.gap = between - slack
            s.direction[0], s.direction[1], s.direction[2] = dx, dy, dz
        if not exact and (s.gap > margin or s.attained - slack <= margin):
            break
        if length - between <= 1e-10 * (1.0 + length):
            break
        step = _grow_simplex(a, b, i, j, s)
        if step == OVERLAPPING:
            s.attained = 0.0
            return OVERLAPPING
        if step == SEPARATED:
            break
    if s.gap > margin:
        return SEPARATED
    return OVERLAPPING if s.attained - slack <= margin else UNDECIDED


@njit(cache=True, error_model="numpy")
def in_order(first: Array, n: int, n_slices: int, n_max: int) -> bool:
    """Whether rows 0 to n-1 are exactly those of slices 0 to n_slices-1: nothing stale, nothing left out."""
    if not (0 <= n <= n_max and 0 <= n_slices < first.shape[0] and first[0] == 0 and first[n_slices] == n):
        return False
    backwards = 0
    for i in range(n_slices):
        backwards += first[i + 1] < first[i]
    return backwards == 0


@njit(cache=True, error_model="numpy")
def _pair_state(
    arm: Record, a: int, crowd: Record, b: int, pairs: Record, margin: float, exact: bool, s: Record
) -> int:
    """State of link row ``a`` and people row ``b``; its certified gap is left in ``s.gap``."""
    ball_a = pairs.link_ball[a]
    ball_b = pairs.people_ball[b]
    bound = ball_gap(ball_a, ball_b)
    s.gap = bound
    if bound > margin and not exact:
        return SEPARATED
    if bound >= -np.inf:
        slack = arm.radius[a] + crowd.radius[b] + ROUNDING * (ball_a[4] + ball_b[4])
        return narrow(
            arm.points[a], arm.n_points[a], crowd.points[b], crowd.n_points[b], slack, margin, exact, s
        )
    s.gap = -np.inf
    return OVERLAPPING


@njit(cache=True, error_model="numpy")
def _is_closed(book: Record, i: int) -> bool:
    """Whether nothing is open on slice i."""
    left = np.uint32(0)
    for link in range(book.n_links):
        for k in range(book.n_people):
            left |= book.open[i, link, k]
    return bool(left == 0)


@njit(cache=True, error_model="numpy")
def classify(links: Block, people: Block, ledger: Block, margin: float, pairs: Block, scratch: Block) -> int:
    """Give every (link row, people row) of every slice its state and a certified lower bound of its gap.

    Slices on which nothing is open have no pairs. Returns the number of undecided pairs, or -1 when the
    blocks do not belong together: then there are no pairs.
    """
    arm, crowd, book = links[0], people[0], ledger[0]
    out, s = pairs[0], scratch[0]
    n_slices, n_links, n_people = book.n_slices, book.n_links, book.n_people
    out.offset[:] = 0
    if not (
        in_order(arm.first, arm.n, n_slices, arm.radius.shape[0])
        and in_order(crowd.first, crowd.n, n_slices, crowd.radius.shape[0])
        and 0 <= n_links <= book.open.shape[1]
        and 0 <= n_people <= book.open.shape[2]
    ):
        return -1
    open_ = book.open
    covers = crowd.covers
    person = crowd.owner
    model = crowd.model
    state = out.state
    gap = out.gap
    pair = undecided = 0
    for i in range(n_slices):
        if _is_closed(book, i):
            out.offset[i + 1 :] = pair
            continue
        if pair + (arm.first[i + 1] - arm.first[i]) * (crowd.first[i + 1] - crowd.first[i]) > state.shape[0]:
            return -1
        _bound_slice(arm, i, out.link_ball)
        _bound_slice(crowd, i, out.people_ball)
        for a in range(arm.first[i], arm.first[i + 1]):
            link = arm.owner[a]
            for b in range(crowd.first[i], crowd.first[i + 1]):
                state[pair], gap[pair] = SKIPPED, -np.inf
                counts = 0 <= link < n_links and 0 <= person[b] < n_people and 0 <= model[b] < MAX_MODELS
                if counts and covers[b] & open_[i, link, person[b]] != 0:
                    state[pair] = _pair_state(arm, a, crowd, b, out, margin, False, s)
                    gap[pair] = s.gap
                    undecided += state[pair] == UNDECIDED
                pair += 1
        out.offset[i + 1 :] = pair
    return undecided


@njit(cache=True, error_model="numpy")
def _clear_slice(arm: Record, crowd: Record, book: Record, i: int, pairs: Record) -> bool:
    """Clear what is proven on slice i, keep the cleared bits in ``pairs.cleared``; whether nothing is left
    open.

    A model proves, for one link and person, the parts of all rows that it wrote less the parts of the rows
    that are not separated from every row of the link; one model suffices (docs/method.md, section 4).
    """
    written = (
        pairs.written
    )  # one by one: numba 0.68 takes record fields of one dtype in a tuple for equal shapes
    blocked = pairs.blocked
    rows = pairs.rows
    cleared = pairs.cleared
    n_links, n_people = book.n_links, book.n_people
    written[:, :] = 0
    blocked[:n_links] = 0
    rows[:] = 0
    for b in range(crowd.first[i], crowd.first[i + 1]):
        if 0 <= crowd.owner[b] < n_people and 0 <= crowd.model[b] < MAX_MODELS:
            written[crowd.model[b], crowd.owner[b]] |= crowd.covers[b]
    pair = pairs.offset[i]
    for a in range(arm.first[i], arm.first[i + 1]):
        link = arm.owner[a]
        if 0 <= link < n_links:
            rows[link] += 1
        for b in range(crowd.first[i], crowd.first[i + 1]):
            if pairs.state[pair] != SEPARATED and pairs.state[pair] != SKIPPED:
                blocked[link, crowd.model[b], crowd.owner[b]] |= crowd.covers[b]
            pair += 1
    closed = True
    for link in range(n_links):
        for k in range(n_people):
            proven = np.uint32(0)
            if rows[link] > 0:
                for model in range(MAX_MODELS):
                    proven |= written[model, k] & ~blocked[link, model, k]
            cleared[link, k] = book.open[i, link, k] & proven
            book.open[i, link, k] &= ~proven
            if book.open[i, link, k] != 0:
                closed = False
    return closed


@njit(cache=True, error_model="numpy")
def _report(
    arm: Record, a: int, crowd: Record, b: int, i: int, bits: int, gap: float, s: Record, found: Record
) -> None:
    """Write what is known about one pair into the record of the nearest pair."""
    found.slice, found.link_row, found.people_row = i, a, b
    found.link, found.person, found.parts, found.gap = arm.owner[a], crowd.owner[b], bits, gap
    found.model = crowd.model[b]
    for axis in range(3):
        n = s.direction[axis]
        found.direction[axis] = n
        found.link_point[axis] = s.point_a[axis] + arm.radius[a] * n
        found.people_point[axis] = s.point_b[axis] - crowd.radius[b] * n


@njit(cache=True, error_model="numpy")
def _tightest_of_slice(arm: Record, crowd: Record, i: int, pairs: Record, s: Record, found: Record) -> None:
    """Replace ``found`` by a pair of slice i that proved something with a smaller gap, if there is one.

    Bounds are refined only where they could win, so that the gap reported is close to the largest certified
    one.
    """
    pair = pairs.offset[i]
    for a in range(arm.first[i], arm.first[i + 1]):
        for b in range(crowd.first[i], crowd.first[i + 1]):
            gap = pairs.gap[pair]
            if pairs.state[pair] == SEPARATED and gap < found.gap:
                bits = crowd.covers[b] & pairs.cleared[arm.owner[a], crowd.owner[b]]
                if bits != 0 and _pair_state(arm, a, crowd, b, pairs, found.gap, False, s) != SEPARATED:
                    _pair_state(arm, a, crowd, b, pairs, np.inf, True, s)
                    gap = max(gap, s.gap)
                    pairs.gap[pair] = gap
                    if gap < found.gap:
                        _report(arm, a, crowd, b, i, bits, gap, s, found)
            pair += 1


@njit(cache=True, error_model="numpy")
def settle(
    links: Block,
    people: Block,
    ledger: Block,
    begin: int,
    end: int,
    pairs: Block,
    scratch: Block,
    nearest: Block,
) -> int:
    """Clear slices begin to end-1, note the tightest separated pair; return the first open slice, or -1."""
    arm, crowd, book, work, s, found = links[0], people[0], ledger[0], pairs[0], scratch[0], nearest[0]
    first_open = -1
    for i in range(end - 1, begin - 1, -1):
        if work.offset[i] == work.offset[i + 1]:
            if not _is_closed(book, i):
                first_open = i
            continue
        if not _clear_slice(arm, crowd, book, i, work):
            first_open = i
        _tightest_of_slice(arm, crowd, i, work, s, found)
    return first_open


@njit(cache=True, error_model="numpy")
def blocking(
    links: Block, people: Block, ledger: Block, i: int, pairs: Block, scratch: Block, nearest: Block
) -> bool:
    """Note the nearest pair that keeps something of slice i open; False when no row could have proven it."""
    arm, crowd, book, work, s, found = links[0], people[0], ledger[0], pairs[0], scratch[0], nearest[0]
    found.gap = np.inf
    if work.offset[i] == work.offset[i + 1]:
        return False
    pair = work.offset[i]
    for a in range(arm.first[i], arm.first[i + 1]):
        for b in range(crowd.first[i], crowd.first[i + 1]):
            if work.state[pair] != SEPARATED and work.state[pair] != SKIPPED:
                bits = crowd.covers[b] & book.open[i, arm.owner[a], crowd.owner[b]]
                if bits != 0:
                    s.direction[:] = np.nan
                    s.point_a[:] = np.nan
                    s.point_b[:] = np.nan
                    _pair_state(arm, a, crowd, b, work, np.inf, True, s)
                    gap = max(work.gap[pair], s.gap)
                    if gap < found.gap:
                        _report(arm, a, crowd, b, i, bits, gap, s, found)
            pair += 1
    return bool(found.gap < np.inf)


@njit(cache=True, error_model="numpy")
def certified_gap(links: Block, people: Block, pairs: Block, a: int, b: int, direction: Array) -> float:
    """Lower bound [m] on the gap of link row ``a`` and people row ``b`` from a ``direction`` (3,), or NaN."""
    arm, crowd, work = links[0], people[0], pairs[0]
    nx, ny, nz = direction[0], direction[1], direction[2]
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    size = work.link_ball[a, 4] + work.people_ball[b, 4]
    if not (1e-6 < length < 1e6 and size >= 0.0):
        return np.nan
    between, _, _ = certificate(
        arm.points[a],
        arm.n_points[a],
        crowd.points[b],
        crowd.n_points[b],
        nx / length,
        ny / length,
        nz / length,
    )
    gap: float = between - arm.radius[a] - crowd.radius[b] - ROUNDING * size
    return gap


@njit(cache=True, error_model="numpy")
def hull_distance(
    links: Block, people: Block, pairs: Block, a: int, b: int, scratch: Block
) -> tuple[float, float]:
    """Bracket [m] of the distance of two usable rows without their radii: certified below, attained above."""
    arm, crowd, s = links[0], people[0], scratch[0]
    slack = ROUNDING * (pairs[0].link_ball[a, 4] + pairs[0].people_ball[b, 4])
    narrow(arm.points[a], arm.n_points[a], crowd.points[b], crowd.n_points[b], slack, np.inf, True, s)
    return max(s.gap, 0.0), s.attained


@njit(cache=True, error_model="numpy")
def _larger(a: float, b: float) -> float:
    """The larger of two numbers; NaN when either is NaN, which ``max`` forgets."""
    if a >= b:
        return a
    return b if b > a else np.nan


@njit(cache=True, error_model="numpy")
def _place_axes(kinematics: Block, enclosure: Block, slices: Block, work: Record) -> None:
    """Write end points, fastest end point and spin of every link axis at every slice end into ``work``."""
    capsules, plan = enclosure[0], slices[0]
    position, angular, linear = work.position, work.angular, work.linear
    for k in range(plan.n + 1):
        forward(kinematics, plan.q[k], work.rotation, position)
        velocities(kinematics, plan.dq[k], work.rotation, position, angular, linear)
        for link in range(capsules.n):
            j = capsules.joint[link]
            wx, wy, wz = angular[j, 0], angular[j, 1], angular[j, 2]
            work.spin[k, link] = np.sqrt(wx * wx + wy * wy + wz * wz)
            fastest = 0.0
            for end in range(2):
                local = capsules.a[link] if end == 0 else capsules.b[link]
                axis = work.axis[k, link, end]
                for r in range(3):
                    axis[r] = position[j, r]
                    for c in range(3):
                        axis[r] += work.rotation[j, r, c] * local[c]
                x, y, z = axis[0] - position[j, 0], axis[1] - position[j, 1], axis[2] - position[j, 2]
                vx = linear[j, 0] + wy * z - wz * y
                vy = linear[j, 1] + wz * x - wx * z
                vz = linear[j, 2] + wx * y - wy * x
                square = vx * vx + vy * vy + vz * vz
                fastest = _larger(fastest, square)
            work.speed[k, link] = np.sqrt(fastest)


@njit(cache=True, error_model="numpy")
def stroke_excess(tree: Record, chain: Array, stroke: Array, plan: Record, i: int) -> float:
    """How far [m] the prismatic joints of a chain may leave the strokes that ``reach`` assumes."""
    excess = 0.0
    for j in range(tree.n):
        if chain[j] and tree.prismatic[j]:
            between = 0.5 * plan.dq_max[i, j] * (plan.t[i + 1] - plan.t[i])
            between += plan.q_error[j] + plan.q_spread[i, j]
            high = _larger(plan.q[i, j], plan.q[i + 1, j]) + between - stroke[j, 1]
            low = stroke[j, 0] - min(plan.q[i, j], plan.q[i + 1, j]) + between
            excess += _larger(_larger(high, low), 0.0)
    return excess


@njit(cache=True, error_model="numpy")
def bound_motion(
    tree: Record, chain: Array, reach: Array, plan: Record, i: int, excess: float
) -> tuple[float, float, float, float, float]:
    """Bounds on slice i for points that are at most ``reach`` + ``excess`` [m] from the joint axes.

    Returns acceleration [m/s²] of the commanded point, displacement [m] and velocity error [m/s] by tracking,
    angular acceleration [rad/s²] of the link and its angular velocity error [rad/s]; NaN when a bound in the
    slice block is negative or NaN. Derivation: :mod:`occupancy.swept`.
    """
    acceleration = displacement = velocity_error = turning = turn_error = 0.0
    spin_before = error_before = 0.0
    for j in range(tree.n):
        if not chain[j]:
            continue
        speed = plan.dq_max[i, j]
        error, speed_error = plan.q_error[j], plan.dq_error[j]
        spread, speed_spread = plan.q_spread[i, j], plan.dq_spread[i, j]
        change = plan.ddq_max[i, j]
        if not (speed >= 0.0 and change >= 0.0 and error >= 0.0 and speed_error >= 0.0):
            acceleration = np.nan
        if not (spread >= 0.0 and speed_spread >= 0.0):
            acceleration = np.nan
        error, speed_error = error + spread, speed_error + speed_spread
        turns = not tree.prismatic[j]
        rho = reach[j] + excess if turns else 1.0
        own = speed if turns else 0.0
        acceleration += rho * (change + speed * (own + 2.0 * spin_before))
        displacement += rho * error
        velocity_error += rho * (speed_error + speed * error_before + error * (own + spin_before))
        if turns:
            turning += change + speed * spin_before
            turn_error += speed_error + speed * error_before
            spin_before += speed
            error_before += error
    return acceleration, displacement, velocity_error, turning, turn_error


@njit(cache=True, error_model="numpy")
def sweep(
    kinematics: Block, enclosure: Block, fixed: Block, slices: Block, out: Block, scratch: Block
) -> None:
    """Write one row per slice and link: what the link occupies (docs/method.md, section 3).

    Where the slice block makes no sense the row has no points and its speed is NaN, so that nothing is proven
    with it; rows are never left out.
    """
    tree, capsules, plan, known = kinematics[0], enclosure[0], slices[0], fixed[0]
    rows, work = out[0], scratch[0]
    rows.n = 0
    rows.first[:] = 0
    if not 0 <= plan.n < plan.t.shape[0]:
        return
    _place_axes(kinematics, enclosure, slices, work)
    row = 0
    for i in range(plan.n):
        h = plan.t[i + 1] - plan.t[i]
        for link in range(capsules.n):
            chain = known.chain[link]
            excess = stroke_excess(tree, chain, known.stroke, plan, i)
            a, moved, v, turn, w = bound_motion(tree, chain, capsules.reach[link], plan, i, excess)
            size = capsules.radius[link]
            for side in range(2):
                for end in range(2):
                    for axis in range(3):
                        value = work.axis[i + side, link, end, axis]
                        rows.points[row, 2 * side + end, axis] = value
                        size = _larger(size, abs(value))
            radius = capsules.radius[link] + h * h / 8.0 * a + moved
            speed = _larger(work.speed[i, link], work.speed[i + 1, link]) + 0.5 * h * a + v
            spin = _larger(work.spin[i, link], work.spin[i + 1, link]) + 0.5 * h * turn + w
            fits = plan.n_joints == tree.n and h >= 0.0 and size + radius <= LARGEST
            rows.n_points[row] = 4 if fits else 0
            rows.radius[row] = radius + ROUNDING * (size + radius)
            rows.speed_max[row] = (
                (speed + capsules.radius[link] * spin) * (1.0 + ROUNDING) if fits else np.nan
            )
            rows.slice[row], rows.owner[row] = i, link
            rows.covers[row], rows.model[row] = 0, 0
            row += 1
        rows.first[i + 1] = row
    rows.first[plan.n :] = row
    rows.n = row
