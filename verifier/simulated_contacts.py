"""Where the bodies of simulated people are from the links of the arm, by coal on capsules.

This is the truth of a simulation. It shares the enclosures of the links with the check, and the positions of
the joints, but no set, no bound and no distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

from robots.kernels import forward, velocities
from robots.model import RobotModel
from verifier.scripted_people import Flesh

Array = NDArray[np.float64]


class Arm(NamedTuple):
    """Links at an instant: axes from ``a`` to ``b`` (n, 3) [m], and the ``speed`` (n,) [m/s] of their fastest
    points.
    """

    a: Array
    b: Array
    speed: Array


class Pair(NamedTuple):
    """A link and a body part (``Part``), their distance [m] (negative: overlap) and nearest points (3,)."""

    distance: float
    link: int
    part: int
    on_link: Array
    on_body: Array


class Distances:
    """Compares the capsules of an arm with those of people.

    Parameters
    ----------
    robot:
        The arm that stands there.
    people, points:
        Body parts of each person, and where their points are at some instant (persons, 20, 3) [m]: the two
        ends of a part keep their distance.
    """

    def __init__(self, robot: RobotModel, people: Sequence[Flesh], points: Array) -> None:
        rows, n = robot.enclosure[0], int(robot.enclosure["n"][0])
        self._kinematics, self._people = robot.kinematics, tuple(people)
        self._joint, self._radius = rows["joint"][:n].astype(int), rows["radius"][:n].copy()
        self._a, self._b = rows["a"][:n].copy(), rows["b"][:n].copy()
        self._shapes, self._size = _capsules(self._a, self._b, self._radius)
        self._bodies = [
            _capsules(xyz[flesh.begin], xyz[flesh.end], flesh.radius)
            for flesh, xyz in zip(people, points, strict=True)
        ]
        joints = len(robot.joints)
        self._turns, self._places = np.zeros((joints, 3, 3)), np.zeros((joints, 3))
        self._angular, self._linear = np.zeros((joints, 3)), np.zeros((joints, 3))
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()

    def arm(self, q: Array, dq: Array) -> Arm:
        """Return the links at joint positions ``q (n,)`` and velocities ``dq (n,)``."""
        forward(self._kinematics, q, self._turns, self._places)
        velocities(self._kinematics, dq, self._turns, self._places, self._angular, self._linear)
        turn, place = self._turns[self._joint], self._places[self._joint]
        spin, drift = self._angular[self._joint], self._linear[self._joint]
        a, b = (np.einsum("nij,nj->ni", turn, local) for local in (self._a, self._b))
        fastest = np.maximum(*(_norm(drift + _cross(spin, lever)) for lever in (a, b)))
        return Arm(place + a, place + b, fastest + self._radius * _norm(spin))

    def nearest(
        self, arm: Arm, p: int, points: Array, pairs: NDArray[np.bool_], within: float = np.inf
    ) -> Pair | None:
        """Return the nearest of some pairs of a link and a part of person ``p``, if below ``within`` [m].

        ``points`` (20, 3) [m], ``pairs`` (links, rows of flesh). Pairs whose balls around both middles are
        farther apart need no engine.
        """
        flesh, (shapes, size) = self._people[p], self._bodies[p]
        begin, end = points[flesh.begin], points[flesh.end]
        middle, own = 0.5 * (begin + end), 0.5 * (arm.a + arm.b)
        apart = _norm(own[:, None] - middle[None]) - self._size[:, None] - size[None]
        apart[~pairs] = np.inf
        best: Pair | None = None
        for place in np.argsort(apart, axis=None).tolist():
            link, row = divmod(place, len(shapes))
            if not apart[link, row] < within:
                break
            self._result.clear()
            distance = coal.distance(
                self._shapes[link], _pose(arm.a[link], arm.b[link]),
                shapes[row], _pose(begin[row], end[row]), self._request, self._result,
            )  # fmt: skip
            if distance < within:
                within = float(distance)
                on_link, on_body = self._result.getNearestPoint1(), self._result.getNearestPoint2()
                best = Pair(within, link, int(flesh.part[row]), np.array(on_link), np.array(on_body))
        return best


def _capsules(a: Array, b: Array, radius: Array) -> tuple[list[coal.Capsule], Array]:
    """Return capsules along z, and the radii (n,) [m] of balls around them."""
    lengths = _norm(b - a)
    shapes = [coal.Capsule(float(r), float(length)) for r, length in zip(radius, lengths, strict=True)]
    return shapes, 0.5 * lengths + radius


def _norm(vectors: Array) -> Array:
    lengths: Array = np.sqrt((vectors * vectors).sum(axis=-1))
    return lengths


def _cross(u: Array, v: Array) -> Array:
    """Return u × v for (n, 3) each; np.cross takes ten times as long for few rows."""
    x, y, z = u.T
    a, b, c = v.T
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)


def _pose(a: Array, b: Array) -> coal.Transform3s:
    """Return the pose of a capsule along z whose axis goes from ``a`` to ``b`` (3,) [m].

    Any rotation that brings z onto the axis does (Duff et al. 2017, Building an Orthonormal Basis,
    Revisited).
    """
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    middle = np.array([0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)])
    x, y, z = bx - ax, by - ay, bz - az
    size = math.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return coal.Transform3s(_UPRIGHT, middle)
    x, y, z = x / size, y / size, z / size
    sign = math.copysign(1.0, z)
    c = -1.0 / (sign + z)
    d = x * y * c
    turn = [[1.0 + sign * x * x * c, d, x], [sign * d, sign + y * y * c, y], [-sign * x, -y, z]]
    return coal.Transform3s(np.array(turn), middle)


_UPRIGHT = np.eye(3)
