"""Hot loops of the planner: distances of an arm from people, and the potential of (5) and (6)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.kernels import segment_parameters
from robots.kernels import forward
from robots.motion import Block

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


FARTHEST_M = 1000.0
"""Links that move farther than that are not followed: nothing is proven."""


@njit(cache=True, error_model="numpy")
def influence(d: float, reach: float) -> float:
    """Return Φ of (6) at a distance ``d`` [m], 0 beyond ``reach`` [m]; what is no number counts as inside."""
    if not d >= 0.0:
        return 2.0
    return float(np.cos(0.5 * np.pi * d / reach)) if d <= reach else 0.0


@njit(cache=True, error_model="numpy")
def axis_distance(point: Array, a: Array, b: Array) -> float:
    """Return the distance [m] of a point (3,) from the segment a b."""
    along, length, square = 0.0, 0.0, 0.0
    for c in range(3):
        along += (point[c] - a[c]) * (b[c] - a[c])
        length += (b[c] - a[c]) ** 2
    share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    for c in range(3):
        square += (point[c] - a[c] - share * (b[c] - a[c])) ** 2
    return float(np.sqrt(square))


@njit(cache=True, error_model="numpy")
def segment_distance(a0: Array, a1: Array, b0: Array, b1: Array) -> float:
    """Return the distance [m] of two segments, by their ends (3,)."""
    s, t = segment_parameters(a0, a1, b0, b1)
    square = 0.0
    for c in range(3):
        square += (a0[c] + s * (a1[c] - a0[c]) - b0[c] - t * (b1[c] - b0[c])) ** 2
    return float(np.sqrt(square))


@njit(cache=True, error_model="numpy")
def place(rotations: Array, positions: Array, joints: Indices, local: Array, out: Array) -> None:
    """Write places (m, 3) of points ``local`` (m, 3), each fixed to one of ``joints`` (m,)."""
    for i in range(len(joints)):
        j = joints[i]
        for r in range(3):
            out[i, r] = positions[j, r]
            for c in range(3):
                out[i, r] += rotations[j, r, c] * local[i, c]


@njit(cache=True, error_model="numpy")
def potentials(
    kinematics: Block,
    n: int,
    configurations: Array,
    joints: Indices,
    local: Array,
    skin: Array,
    a: Array,
    b: Array,
    radius: Array,
    weight: Array,
    reach: float,
    out: Array,
) -> None:
    """Write U of (5) for each of ``configurations`` (B, n).

    Points ``local`` (m, 3) are fixed to ``joints`` (m,), each with a ball of radius ``skin`` (m,) around it;
    axes of body parts are ``a`` to ``b`` (frames, parts, 3), their radii (parts,); ``weight`` (frames,).
    """
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    points = np.empty((len(joints), 3))
    for i in range(len(configurations)):
        forward(kinematics, configurations[i], rotations, positions)
        place(rotations, positions, joints, local, points)
        out[i] = 0.0
        for f in range(len(weight)):
            for k in range(len(radius)):
                for p in range(len(joints)):
                    d = axis_distance(points[p], a[f, k], b[f, k]) - radius[k] - skin[p]
                    out[i] += weight[f] * influence(d, reach)


@njit(cache=True, error_model="numpy")
def _link_gap(
    tip: Array, top: Array, skin: float, a: Array, b: Array, radius: Array, balls: Array, gap: float
) -> float:
    """Return the least gap [m] of a link from body parts in all frames; ``gap`` where none is less."""
    for k in range(len(radius)):
        gap = _pair_gap(tip, top, skin, a, b, radius, balls, k, gap)
    return gap


@njit(cache=True, error_model="numpy")
def _pair_gap(
    tip: Array, top: Array, skin: float, a: Array, b: Array, radius: Array, balls: Array, k: int, gap: float
) -> float:
    """Return the least gap [m] of a link from body part ``k`` in all frames; ``gap`` where none is less.

    ``balls`` (frames + 1, parts, 5): centres and radii of balls around a part, the last row in all frames;
    last in that row how far it is at most from where the frame in the middle has it.
    """
    half, frames = (
        skin + 0.5 * np.sqrt((top[0] - tip[0]) ** 2 + (top[1] - tip[1]) ** 2 + (top[2] - tip[2]) ** 2),
        len(a),
    )
    x, y, z = 0.5 * (tip[0] + top[0]), 0.5 * (tip[1] + top[1]), 0.5 * (tip[2] + top[2])
    if _is_farther(x, y, z, half + gap, balls[frames, k]):
        return gap
    middle = frames // 2
    d = segment_distance(tip, top, a[middle, k], b[middle, k]) - radius[k] - skin
    if d - balls[frames, k, 4] >= gap:
        return gap
    if not d >= gap:
        gap = -np.inf if np.isnan(d) else d
    for f in range(frames if balls[frames, k, 4] > 0.0 else 0):
        if f == middle or _is_farther(x, y, z, half + gap, balls[f, k]):
            continue
        d = segment_distance(tip, top, a[f, k], b[f, k]) - radius[k] - skin
        if not d >= gap:
            gap = -np.inf if np.isnan(d) else d
    return gap


@njit(cache=True, error_model="numpy")
def _is_farther(x: float, y: float, z: float, away: float, ball: Array) -> bool:
    """Whether a place is at least ``away`` [m] from a ball, its centre and radius first; NaN is not."""
    reach = away + ball[3]
    square = (x - ball[0]) ** 2 + (y - ball[1]) ** 2 + (z - ball[2]) ** 2
    return bool(square >= reach * reach and reach >= 0.0)


@njit(cache=True, error_model="numpy")
def clearance(
    kinematics: Block,
    n: int,
    q: Array,
    joints: Indices,
    ends: Array,
    skin: Array,
    a: Array,
    b: Array,
    radius: Array,
    balls: Array,
    enough: float,
    gaps: Array,
) -> float:
    """Return the least gap [m] of links at ``q`` (n,) from body parts in all frames; negative: overlap.

    ``gaps`` (links,): that of each link. ``enough``: what is farther than that is said to be that far.
    Links are capsules: ``ends`` (links, 2, 3) fixed to ``joints`` (links,), radii ``skin`` (links,).
    """
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    tips = np.empty((len(joints), 3))
    tops = np.empty((len(joints), 3))
    forward(kinematics, q, rotations, positions)
    place(rotations, positions, joints, ends[:, 0], tips)
    place(rotations, positions, joints, ends[:, 1], tops)
    least = enough
    for i in range(len(joints)):
        gaps[i] = _link_gap(tips[i], tops[i], skin[i], a, b, radius, balls, enough)
        least = min(least, gaps[i])
    return least


@njit(cache=True, error_model="numpy")
def is_clear_between(
    kinematics: Block,
    n: int,
    begin: Array,
    end: Array,
    lever: Array,
    joints: Indices,
    ends: Array,
    skin: Array,
    a: Array,
    b: Array,
    radius: Array,
    balls: Array,
    wanted: float,
    slack: float,
) -> bool:
    """Whether links keep ``wanted`` less ``slack`` [m] from body parts all the way from ``begin`` to ``end``.

    Proven, not sampled: where the gap of a link from a part is g, it stays above the bound as long as no
    point of the link has moved by more than g less the bound; ``lever`` (links, n) bounds how far they move
    per joint [m/rad; 1]. Asked for at both ends and wherever a pair is looked at is ``wanted``; between these
    places a gap may be ``slack`` less. Each pair is looked at half way, where most are proven at once; what
    is left is followed from the begin, each pair as seldom as its gap allows.
    """
    links, parts, longest = len(joints), len(radius), 0.0
    way, gaps, q = np.zeros(links), np.empty(links), np.empty(n)
    for i in range(links):
        for j in range(n):
            way[i] += lever[i, j] * abs(end[j] - begin[j])
        longest = max(longest, way[i])
        if not way[i] <= FARTHEST_M:
            return False
    for q_end in (end, begin):
        if (
            not clearance(kinematics, n, q_end, joints, ends, skin, a, b, radius, balls, wanted, gaps)
            >= wanted
        ):
            return False
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    tips, tops = np.empty((links, 3)), np.empty((links, 3))
    _placed(kinematics, begin, end, 0.5, joints, ends, rotations, positions, q, tips, tops)
    pairs, proven, left = np.empty((links * parts, 2), dtype=np.int64), np.empty((links * parts, 3)), 0
    for i in range(links):
        enough = wanted + 0.5 * way[i]
        for k in range(parts):
            gap = _pair_gap(tips[i], tops[i], skin[i], a, b, radius, balls, k, enough)
            if not gap >= wanted:
                return False
            if gap - wanted + slack < 0.5 * way[i]:
                share = (gap - wanted + slack) / way[i]
                pairs[left, 0], pairs[left, 1] = i, k
                proven[left, 0], proven[left, 1], proven[left, 2] = 0.0, 0.5 - share, 0.5 + share
                left += 1
    while left > 0:
        share = proven[:left, 0].min()
        if share >= 1.0:
            break
        _placed(kinematics, begin, end, share, joints, ends, rotations, positions, q, tips, tops)
        for p in range(left):
            i, k = pairs[p]
            if proven[p, 0] > share + 0.5 * slack / longest:
                continue
            enough = wanted + (1.0 - share) * way[i]
            gap = _pair_gap(tips[i], tops[i], skin[i], a, b, radius, balls, k, enough)
            if not gap >= wanted:
                return False
            proven[p, 0] = share + (gap - wanted + slack) / way[i]
            if proven[p, 1] <= proven[p, 0] < proven[p, 2]:
                proven[p, 0] = proven[p, 2]
    return True


@njit(cache=True, error_model="numpy")
def _placed(
    kinematics: Block,
    begin: Array,
    end: Array,
    share: float,
    joints: Indices,
    ends: Array,
    rotations: Array,
    positions: Array,
    q: Array,
    tips: Array,
    tops: Array,
) -> None:
    """Write both ends of the links' axes, ``tips`` and ``tops`` (links, 3), at a share of a straight line."""
    for j in range(len(begin)):
        q[j] = begin[j] + share * (end[j] - begin[j])
    forward(kinematics, q, rotations, positions)
    place(rotations, positions, joints, ends[:, 0], tips)
    place(rotations, positions, joints, ends[:, 1], tops)


@njit(cache=True, error_model="numpy")
def clear_up_to(
    kinematics: Block,
    n: int,
    breaks: Array,
    coefficients: Array,
    speed: Array,
    lever: Array,
    joints: Indices,
    ends: Array,
    skin: Array,
    a: Array,
    b: Array,
    radius: Array,
    balls: Array,
    wanted: float,
    slack: float,
) -> float:
    """Return up to which parameter links are proven to keep ``wanted`` less ``slack`` [m] along a curve.

    As in :func:`is_clear_between`; ``speed`` (M, n) bounds |q'| of the pieces of ``coefficients`` (M, 6, n).
    """
    links, pieces = len(joints), len(speed)
    rate, left = np.zeros((pieces, links)), np.zeros(links)
    for m in range(pieces):
        for i in range(links):
            for j in range(n):
                rate[m, i] += lever[i, j] * speed[m, j]
            left[i] += rate[m, i] * (breaks[m + 1] - breaks[m])
            if not left[i] <= FARTHEST_M:
                return float(breaks[0])
    gaps, q, m, t = np.empty(links), np.empty(n), 0, breaks[0]
    while True:
        x = t - breaks[m]
        for j in range(n):
            q[j] = coefficients[m, 5, j]
            for k in range(4, -1, -1):
                q[j] = q[j] * x + coefficients[m, k, j]
        far = wanted + max(0.0, left.max())
        if not clearance(kinematics, n, q, joints, ends, skin, a, b, radius, balls, far, gaps) >= wanted:
            return float(t)
        gaps += slack - wanted
        begin = t
        while True:
            span = breaks[m + 1] - t
            step = span
            for i in range(links):
                if not rate[m, i] * step <= gaps[i]:
                    step = min(step, gaps[i] / rate[m, i])
            for i in range(links):
                gaps[i] -= rate[m, i] * step
                left[i] -= rate[m, i] * step
            if step < span:
                t += step
                break
            m += 1
            t = breaks[m]
            if m == pieces:
                return float(t)
        if not t > begin:
            return float(begin)


@njit(cache=True, error_model="numpy")
def enters(begin: Array, end: Array, centre: Array, radius: Array) -> bool:
    """Whether the line from ``begin`` to ``end`` (n,) enters a ball; ``centre`` (k, n), ``radius`` (k,)."""
    n, length = len(begin), 0.0
    for j in range(n):
        length += (end[j] - begin[j]) ** 2
    for k in range(len(radius)):
        along, square = 0.0, 0.0
        for j in range(n):
            along += (centre[k, j] - begin[j]) * (end[j] - begin[j])
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        for j in range(n):
            square += (centre[k, j] - begin[j] - share * (end[j] - begin[j])) ** 2
        if not square >= radius[k] ** 2:
            return True
    return False
