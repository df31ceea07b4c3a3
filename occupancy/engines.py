"""Collision engines that propose separating directions: coal and python-fcl.

An engine is never trusted: the direction that it proposes goes through the certificate of ``separation``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final, Protocol

import coal
import fcl
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_POINTS: Final = 32
"""Up to this many points both engines search all points for the support. Beyond, they climb along the faces
that they were given; with a list of faces that is not the true hull they then stop at wrong points and the
distance comes out far too large."""
_ROUNDS: Final = 64


class Engine(Protocol):
    """Something that proposes the direction in which two hulls are farthest apart."""

    name: str

    def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
        """Return a direction (3,) from the hull of ``points_a`` (N, 3) to that of ``points_b`` (M, 3), and a
        distance.

        The distance [m] is what the engine says: it may be wrong, and it is not positive when the hulls meet.
        The direction may have any length; NaN or zero when the engine has none.
        """
        ...


class _WorkingSets(ABC):
    """Works on at most ``MOST_POINTS`` points of each set and exchanges them until no other point matters."""

    def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
        """Return direction (3,) and distance [m], see :class:`Engine`."""
        a, b = np.asarray(points_a, dtype=np.float64), np.asarray(points_b, dtype=np.float64)
        near_a, near_b = a[:MOST_POINTS], b[:MOST_POINTS]
        for _ in range(_ROUNDS):
            direction, distance = self._ask(near_a, near_b)
            next_a, next_b = _exchange(a, near_a, direction), _exchange(b, near_b, -direction)
            if not distance > 0.0 or (next_a is near_a and next_b is near_b):
                break
            near_a, near_b = next_a, next_b
        return direction, distance

    @abstractmethod
    def _ask(self, a: Array, b: Array) -> tuple[Array, float]:
        """Ask the engine about two sets of at most ``MOST_POINTS`` points."""


def _exchange(points: Array, near: Array, direction: Array) -> Array:
    """Return ``near`` itself when no point lies farther along ``direction``, else a better working set.

    Half of it are the farthest of the old points: they hold the present nearest point, so that the distance
    of the working sets can only fall from round to round.
    """
    if len(points) <= MOST_POINTS:
        return near
    along, along_near = points @ direction, near @ direction
    if not along.max() > along_near.max() + 1e-12 * float(np.abs(points).max()):
        return near
    half = MOST_POINTS // 2
    return np.vstack([near[np.argsort(-along_near)[:half]], points[np.argsort(-along)[:half]]])


class CoalEngine(_WorkingSets):
    """GJK and EPA of coal, on convex sets given as points and a fan of triangles."""

    name = "coal"

    def __init__(self) -> None:
        self._request = coal.DistanceRequest()
        self._identity = coal.Transform3s.Identity()

    def _ask(self, a: Array, b: Array) -> tuple[Array, float]:
        result = coal.DistanceResult()
        distance = coal.distance(
            _coal_convex(a), self._identity, _coal_convex(b), self._identity, self._request, result
        )
        return np.asarray(result.normal, dtype=np.float64), float(distance)


def _coal_convex(points: Array) -> coal.Convex:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        vertices.append(point)
    for k in range(1, len(points) - 1):
        triangles.append(coal.Triangle(0, k, k + 1))
    return coal.Convex(vertices, triangles)


class FclEngine(_WorkingSets):
    """GJK of python-fcl, on convex sets given as points and a fan of triangles."""

    name = "python-fcl"

    def __init__(self) -> None:
        self._request = fcl.DistanceRequest(enable_nearest_points=True)

    def _ask(self, a: Array, b: Array) -> tuple[Array, float]:
        result = fcl.DistanceResult()
        distance = float(fcl.distance(_fcl_convex(a), _fcl_convex(b), self._request, result))
        if not distance > 0.0:
            return np.full(3, np.nan), distance
        return np.subtract(result.nearest_points[1], result.nearest_points[0]), distance


def _fcl_convex(points: Array) -> fcl.CollisionObject:
    padded = np.vstack([points, np.repeat(points[-1:], max(0, 3 - len(points)), axis=0)])
    faces = [[3, 0, k, k + 1] for k in range(1, len(padded) - 1)]
    return fcl.CollisionObject(fcl.Convex(padded, len(faces), np.ravel(faces)), fcl.Transform())
