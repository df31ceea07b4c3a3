"""Outlines of sphere-swept volumes, seen from one side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

SIDES: Final = 180
"""Of the polygon that stands for a circle. It lies around it, at most 0.016 % of the radius away."""
LEAST_RADIUS_M: Final = 1e-4
"""Smaller ones are drawn as this one, so that every outline has an area [m]."""
STEP_M: Final = 0.01
"""Longer edges are cut in pieces before those that other outlines hide are left out [m]."""
_SAME_M: Final = 1e-6
"""Edges closer to each other than this coincide [m]."""


def project(points: Array, along: Array) -> Array:
    """Return points (..., 3) [m] as seen from the side: (..., 2) [m], along a horizontal direction, and up.

    ``along`` (3,) is a unit vector. The view is orthographic: no distance is longer in it.
    """
    return np.stack([points @ along, points[..., 2]], axis=-1)


def outline(points: Array, radius: float) -> Array:
    """Return the outline of the hull of ``points`` (P, 2) [m] grown by a disc of ``radius`` [m].

    The projection of a sphere-swept volume is the hull of its projected points, grown by a disc of its
    radius. With a polygon of ``SIDES`` sides around the disc, the hull of all its copies is the hull of the
    points grown by that polygon: it contains the projection, and reaches farther by at most
    radius (1 / cos(π / SIDES) - 1).

    Returns
    -------
    (N, 2) corners [m] of a convex polygon, counter-clockwise.
    """
    angle = 2.0 * math.pi / SIDES * np.arange(SIDES)
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) / math.cos(math.pi / SIDES)
    cloud = (points[:, None] + max(radius, LEAST_RADIUS_M) * corners).reshape(-1, 2)
    return cloud[ConvexHull(cloud).vertices]


def edge_of_union(outlines: Sequence[Array]) -> list[Array]:
    """Return the edges of convex polygons without what lies inside of another one of them.

    Parameters
    ----------
    outlines:
        Each (N, 2) [m], counter-clockwise.

    Returns
    -------
    Lines (M, 2) [m]. Edges are cut every ``STEP_M``, and each piece is there or not by its middle; of edges
    that coincide the first one is there.
    """
    lines: list[Array] = []
    for i, own in enumerate(outlines):
        line = _cut(own)
        middles = 0.5 * (line[:-1] + line[1:])
        hidden = np.zeros(len(middles), dtype=bool)
        for j, other in enumerate(outlines):
            if i != j:
                hidden |= inside(middles, other, _SAME_M if i < j else -_SAME_M)
        changes = np.flatnonzero(np.diff(~hidden, prepend=False, append=False))
        lines += [line[first : last + 1] for first, last in changes.reshape(-1, 2)]
    return lines


def inside(points: Array, polygon: Array, depth: float = 0.0) -> NDArray[np.bool_]:
    """Whether points (M, 2) [m] lie in a convex counter-clockwise polygon (N, 2) [m], ``depth`` [m] deep."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    inward = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return np.asarray((points @ inward.T - np.sum(polygon * inward, axis=1) >= depth).all(axis=1))


def _cut(polygon: Array) -> Array:
    """Return the closed line around a polygon with no piece longer than ``STEP_M``."""
    ends = np.roll(polygon, -1, axis=0)
    pieces = np.maximum(1, np.ceil(np.linalg.norm(ends - polygon, axis=1) / STEP_M)).astype(int)
    parts = [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(polygon, ends, pieces, strict=True)]
    return np.vstack([*parts, polygon[:1]])
