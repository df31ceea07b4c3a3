"""What a sphere-swept volume looks like in pieces that viewers draw: spheres, cylinders, triangles.

The boundary of hull(P) ⊕ ball(r) consists of parts of the spheres around the corners, of the cylinders around
the edges, and of the faces moved outwards by r. All of these lie within the set, so their union is its exact
outline; what lies inside of it is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

Array = NDArray[np.float64]

_FEW = 4
"""Up to so many points all pairs and triples are drawn: no hull is needed."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of one set.

    Attributes
    ----------
    radius:
        Of the spheres and cylinders [m].
    spheres:
        (S, 3) centres [m].
    cylinders:
        (C, 2, 3) ends of their axes [m].
    triangles:
        (T, 3, 3) corners [m].
    """

    radius: float
    spheres: Array
    cylinders: Array
    triangles: Array


def pieces(points: Array, radius: float) -> Pieces:
    """Return the pieces of the hull of ``points`` (P, 3) [m], grown by ``radius`` [m]."""
    corners = np.array(list(dict.fromkeys(map(tuple, points.tolist()))))
    edges, faces = _hull(corners)
    ends = corners[np.array(edges, dtype=np.intp).reshape(-1, 2)]
    return Pieces(
        radius, corners, ends, _moved(corners[np.array(faces, dtype=np.intp).reshape(-1, 3)], radius)
    )


def _hull(corners: Array) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
    """Return pairs and triples of corners among which all edges and faces of the hull are."""
    n = len(corners)
    if n <= _FEW:
        return list(combinations(range(n), 2)), list(combinations(range(n), 3))
    try:
        faces = [tuple(int(i) for i in face) for face in ConvexHull(corners).simplices]
    except QhullError:  # in one plane, or nearly
        return list(combinations(range(n), 2)), _fan(corners)
    return sorted({pair for face in faces for pair in combinations(sorted(face), 2)}), faces


def _fan(corners: Array) -> list[tuple[int, ...]]:
    """Return triangles that cover the hull of corners in one plane."""
    middle = corners - corners.mean(axis=0)
    _u, _s, (x, y, _z) = np.linalg.svd(middle, full_matrices=False)
    flat = np.column_stack([middle @ x, middle @ y])
    try:
        order = [int(i) for i in ConvexHull(flat).vertices]
    except QhullError:  # in one line: the cylinders say it all
        return []
    return [(order[0], order[i], order[i + 1]) for i in range(1, len(order) - 1)]


def _moved(faces: Array, radius: float) -> Array:
    """Return the faces (F, 3, 3) moved along their normals by the radius, to both sides."""
    if not len(faces):
        return faces
    u, v = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    normals = u[:, [1, 2, 0]] * v[:, [2, 0, 1]] - u[:, [2, 0, 1]] * v[:, [1, 2, 0]]
    lengths = np.sqrt((normals * normals).sum(axis=1))
    flat = lengths > 0.0
    step = (radius / lengths[flat])[:, None] * normals[flat]
    return np.concatenate([faces[flat] + step[:, None], faces[flat] - step[:, None]])
