"""Distances between convex hulls of up to four points by going through all features, many pairs at once.

Every distance is attained by two points of the hulls, so it is never below the exact one; for hulls that do
not meet it is the exact one up to rounding, because the nearest points of two polytopes lie on a vertex and a
face or on two edges. Whether they meet is decided apart: an edge crosses a face, or a vertex lies in a
tetrahedron. Volumes that could be rounding count as zero; hulls that are that flat meet at distance 0 anyway.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRIANGLES = tuple(combinations(range(4), 3))
EDGES = tuple(combinations(range(4), 2))


def dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def pad(points: Array) -> Array:
    """(P, 3) -> (4, 3), repeating the last point: the hull stays the same."""
    return np.vstack([points, np.repeat(points[-1:], 4 - len(points), axis=0)])


def point_segment(p: Array, a: Array, b: Array) -> Array:
    """Distance of p from segment ab, all (..., 3)."""
    ab = b - a
    along, square = dot(p - a, ab), dot(ab, ab)
    t = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0), 0.0, 1.0)
    return np.linalg.norm(p - a - t[..., None] * ab, axis=-1)


def point_triangle(p: Array, a: Array, b: Array, c: Array) -> Array:
    """Distance of p from triangle abc: its edges, and its plane where the foot lies inside all edges."""
    edges = np.minimum(point_segment(p, a, b), np.minimum(point_segment(p, b, c), point_segment(p, c, a)))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=-1)
    inside = length > 0
    for first, second in ((a, b), (b, c), (c, a)):
        inside = inside & (dot(np.cross(second - first, p - first), normal) >= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.abs(dot(p - a, normal)) / length
    return np.where(inside, np.fmin(edges, height), edges)


def segment_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Distance of segments ab and cd: end points against the other segment, and the interior solution."""
    ends = np.minimum(
        np.minimum(point_segment(a, c, d), point_segment(b, c, d)),
        np.minimum(point_segment(c, a, b), point_segment(d, a, b)),
    )
    u, v, w = b - a, d - c, c - a
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
    determinant = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (uw * vv - vw * uv) / determinant, (uw * uv - vw * uu) / determinant
        inside = (determinant > 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
        between = np.linalg.norm(w - s[..., None] * u + t[..., None] * v, axis=-1)
    return np.where(inside, np.fmin(ends, between), ends)


def attained_distance(a: Array, b: Array) -> Array:
    """Smallest distance over all features of the surfaces of hulls a, b (..., 4, 3)."""
    best = np.full(np.broadcast_shapes(a.shape[:-2], b.shape[:-2]), np.inf)
    for one, other in ((a, b), (b, a)):
        faces = [other[..., corners, :] for corners in zip(*TRIANGLES, strict=True)]
        for i in range(4):
            best = np.minimum(best, point_triangle(one[..., i, None, :], *faces).min(axis=-1))
    edges = [b[..., corners, :] for corners in zip(*EDGES, strict=True)]
    for i, j in EDGES:
        apart = segment_segment(a[..., i, None, :], a[..., j, None, :], *edges)
        best = np.minimum(best, apart.min(axis=-1))
    return best


def _volume(a: Array, b: Array, c: Array, d: Array) -> Array:
    u, v, w = np.broadcast_arrays(b - a, c - a, d - a)
    volume = dot(np.cross(u, v), w)
    size = np.abs([u, v, w]).max(axis=(0, -1))
    return np.where(np.abs(volume) > 1e-12 * size**3, volume, 0.0)


def crosses(a: Array, b: Array) -> NDArray[np.bool_]:
    """Whether an edge of one hull properly crosses a face of the other, or a vertex lies properly inside."""
    met = np.zeros(np.broadcast_shapes(a.shape[:-2], b.shape[:-2]), dtype=bool)
    for one, other in ((a, b), (b, a)):
        r, s, t = (other[..., corners, :] for corners in zip(*TRIANGLES, strict=True))
        for i, j in EDGES:
            p, q = one[..., i, None, :], one[..., j, None, :]
            sides = _volume(r, s, t, p) * _volume(r, s, t, q) < 0
            e, f, g = _volume(p, q, r, s), _volume(p, q, s, t), _volume(p, q, t, r)
            met |= (sides & (e * f > 0) & (f * g > 0)).any(axis=-1)
        inside = np.ones((*met.shape, 4), dtype=bool)
        for k in range(4):
            face = [other[..., m, None, :] for m in range(4) if m != k]
            inside &= _volume(*face, one) * _volume(*face, other[..., k, None, :]) > 0
        met |= inside.any(axis=-1)
    return met


def distance(a: Array, b: Array) -> Array:
    """Distance of hulls (..., 4, 3); 0 where they properly meet."""
    return np.where(crosses(a, b), 0.0, attained_distance(a, b))


def point_distance(p: Array, hull: Array) -> Array:
    """Distance of points p (..., 3) from hulls (..., 4, 3): faces, and 0 properly inside."""
    corners = [hull[..., k, :] for k in range(4)]
    p, *corners = np.broadcast_arrays(p, *corners)
    best = np.min([point_triangle(p, *(corners[k] for k in face)) for face in TRIANGLES], axis=0)
    inside = np.ones(best.shape, dtype=bool)
    for k in range(4):
        face = [corners[m] for m in range(4) if m != k]
        inside &= _volume(*face, p) * _volume(*face, corners[k]) > 0
    return np.where(inside, 0.0, best)


def exact_point_distance(p: Array, hull: Array) -> float:
    """Distance of p (3,) from a hull (P, 3), in rational numbers but for the last root.

    The nearest point lies in the relative interior of some simplex of the corners, and there it is the foot
    of the perpendicular: of all feet inside their simplex the nearest. No rounding, however flat the hull is;
    slow.
    """
    corners = [[Fraction(float(x)) for x in corner] for corner in hull]
    place = [Fraction(float(x)) for x in p]
    best = None
    for size in range(1, min(len(corners), 4) + 1):
        for first, *others in combinations(corners, size):
            square = _square_to_foot(place, first, others)
            if square is not None and (best is None or square < best):
                best = square
    assert best is not None, "a hull has corners"
    return math.sqrt(best)


def _square_to_foot(
    place: Sequence[Fraction], first: Sequence[Fraction], others: Sequence[Sequence[Fraction]]
) -> Fraction | None:
    """Squared distance to the foot on the plane through the corners; None unless it lies between them."""
    away = [x - y for x, y in zip(place, first, strict=True)]
    edges = [[x - y for x, y in zip(corner, first, strict=True)] for corner in others]
    gram = [[_exact_dot(u, v) for v in edges] for u in edges]
    weights = _solved(gram, [_exact_dot(u, away) for u in edges])
    if weights is None or any(w < 0 for w in weights) or sum(weights) > 1:
        return None
    for weight, edge in zip(weights, edges, strict=True):
        away = [x - weight * y for x, y in zip(away, edge, strict=True)]
    return _exact_dot(away, away)


def _exact_dot(u: Sequence[Fraction], v: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(u, v, strict=True)), Fraction(0))


def _solved(matrix: list[list[Fraction]], right: list[Fraction]) -> list[Fraction] | None:
    """Gauss and Jordan; None where there is not exactly one solution."""
    rows = [[*row, y] for row, y in zip(matrix, right, strict=True)]
    for c in range(len(rows)):
        pivot = next((r for r in range(c, len(rows)) if rows[r][c] != 0), None)
        if pivot is None:
            return None
        rows[c], rows[pivot] = rows[pivot], rows[c]
        for r in range(len(rows)):
            if r != c:
                factor = rows[r][c] / rows[c][c]
                rows[r] = [x - factor * y for x, y in zip(rows[r], rows[c], strict=True)]
    return [rows[c][-1] / rows[c][c] for c in range(len(rows))]
