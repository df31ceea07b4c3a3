"""How much space a sphere-swept volume takes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

_FLAT = 1e-6
"""Hulls thinner than this share of their size are taken as flat, and the radius as larger by as much."""


def volume(points: Array, radius: float) -> float:
    """Volume [m³] of the hull of ``points`` (P, 3) [m] grown by a ball of ``radius`` [m].

    Steiner's formula: V + S r + H r² + 4/3 π r³, with volume V and surface S of the hull and H = 1/2 Σ length
    times exterior angle of its edges. A hull that is flat but for rounding is projected, and the radius grown
    by what that moves it: the result errs on the large side, by less than 1e-4 of it.
    """
    centred = np.asarray(points, dtype=np.float64) - np.mean(points, axis=0)
    size = float(np.abs(centred).max())
    if size == 0.0:
        return _steiner((0.0, 0.0, 0.0), radius)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    rank = int(np.sum(spread > _FLAT * size))
    flat = centred @ axes[:rank].T
    moved = float(np.linalg.norm(centred - flat @ axes[:rank], axis=1).max()) if rank < 3 else 0.0
    return _steiner(_measures(flat), radius + moved)


def _steiner(measures: tuple[float, float, float], r: float) -> float:
    solid, surface, bend = measures
    return solid + surface * r + bend * r * r + 4.0 / 3.0 * math.pi * r**3


def _measures(points: Array) -> tuple[float, float, float]:
    """Volume, surface and H of a hull of full dimension 1, 2 or 3, as a body in space."""
    if points.shape[1] == 1:
        return 0.0, 0.0, math.pi * float(np.ptp(points))
    hull = ConvexHull(points)
    if points.shape[1] == 2:
        area, perimeter = hull.volume, hull.area
        return 0.0, 2.0 * float(area), 0.5 * math.pi * float(perimeter)
    return float(hull.volume), float(hull.area), _bend(hull)


def _bend(hull: ConvexHull) -> float:
    """Half the sum over all edges of length times angle between the normals of both faces."""
    total = 0.0
    for face, neighbours in enumerate(hull.neighbors):
        for place, other in enumerate(neighbours):
            if other > face:
                ends = np.delete(hull.simplices[face], place)
                a, b = hull.points[ends]
                n, m = hull.equations[face, :3], hull.equations[other, :3]
                angle = math.atan2(float(np.linalg.norm(np.cross(n, m))), float(n @ m))
                total += float(np.linalg.norm(a - b)) * angle
    return 0.5 * total
