"""Danger indices of ellipsoids around links and body parts (Chan and Tsai 2020, (4) to (7)).

The index is 1/F, F at least 0; at 1 and above, two ellipsoids are said to touch. Two F are offered:

* *transformed*, the paper's: the body's ellipsoid is mapped to the unit ball, and in that frame the semi-axes
  of the robot's are lengthened by 1. For two balls that is exact. Otherwise the lengthened ellipsoid lies
  **inside** the true sum of ellipsoid and ball, so that contacts are missed: an index below 1 does not even
  say that these ellipsoids are apart.
* *exact*: the square of the factor by which both must be scaled about their centres to touch (Perram and
  Wertheim 1985). Below 1 just where they are apart. For two balls it equals the other one.

No index contains a stopping distance, a delay or a measurement error: it is a proposal's business, and proves
nothing (docs/speed.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import coal
import numpy as np
from numpy.typing import NDArray

from modes.speed import kernels
from robots.errors import SetupError

Array = NDArray[np.float64]
Index = Literal["transformed", "exact"]
INDICES: tuple[Index, ...] = ("transformed", "exact")


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoids:
    """Ellipsoids in the world.

    Attributes
    ----------
    centre:
        ``(N, 3)`` [m].
    semi_axes:
        ``(N, 3)`` [m], above 0.
    rotation:
        ``(N, 3, 3)``: columns are the directions of the semi-axes.

    Raises
    ------
    SetupError
        Shapes do not fit, a number is not finite, a semi-axis is not above 0, or a matrix is no rotation.
    """

    centre: Array
    semi_axes: Array
    rotation: Array

    def __post_init__(self) -> None:
        n = len(self.centre)
        shapes = self.centre.shape, self.semi_axes.shape, self.rotation.shape
        if shapes != ((n, 3), (n, 3), (n, 3, 3)):
            raise SetupError(f"ellipsoids: shapes {shapes} should be (N, 3), (N, 3), (N, 3, 3)")
        for name in ("centre", "semi_axes", "rotation"):
            if not np.isfinite(getattr(self, name)).all():
                raise SetupError(f"ellipsoids: {name} has a number that is not finite")
        if not (self.semi_axes > 0.0).all():
            least = float(self.semi_axes.min())
            raise SetupError(f"ellipsoids: a semi-axis of {least:g} m should be above 0")
        turned = np.einsum("nki,nkj->nij", self.rotation, self.rotation)
        if n and not np.abs(turned - np.eye(3)).max() < 1e-6:
            raise SetupError("ellipsoids: a rotation is no rotation matrix")

    def __len__(self) -> int:
        return len(self.centre)

    @classmethod
    def balls(cls, centre: Array, radius: float) -> Ellipsoids:
        """Return balls around ``centre (N, 3)`` [m]."""
        n = len(centre)
        return cls(np.array(centre, dtype=float), np.full((n, 3), radius), np.tile(np.eye(3), (n, 1, 1)))

    @classmethod
    def around_capsules(cls, a: Array, b: Array, radius: Array) -> Ellipsoids:
        """Return spheroids that contain the capsules from ``a`` to ``b`` (N, 3) of ``radius`` (N,) [m]."""
        axis = b - a
        length = np.linalg.norm(axis, axis=1)
        along, across = spheroid(0.5 * length, np.asarray(radius, dtype=float))
        axes = np.column_stack((along, across, across))
        return cls(0.5 * (a + b), axes, _frames(axis, length))

    def moved(self, by: Array) -> Ellipsoids:
        """Return the same with other centres, ``by (N, 3)`` away [m]."""
        return Ellipsoids(self.centre + by, self.semi_axes, self.rotation)


def spheroid(half: Array, radius: Array) -> tuple[Array, Array]:
    """Return the semi-axes along and across of a spheroid around a capsule, near the smallest one.

    ``half``: half the length of the segment, ``radius`` (N,) [m]. With b² = r² + u r h and
    a² = b² + h² + r h / u every u in (0, 1] contains the capsule (its support function is nowhere larger);
    the smallest volume of 64 of them is taken.
    """
    share = np.geomspace(1e-3, 1.0, 64)
    h, r = np.asarray(half)[:, None], np.asarray(radius)[:, None]
    across = r**2 + share * r * h
    along = across + h**2 + r * h / share
    best = np.argmin(along * across**2, axis=1)
    rows = np.arange(len(h))
    return np.sqrt(along[rows, best]), np.sqrt(across[rows, best])


def _frames(axis: Array, length: Array) -> Array:
    """Return rotations (N, 3, 3) whose first column is the direction of ``axis``, any one where that is 0."""
    first = np.where(length[:, None] > 1e-9, axis / np.maximum(length, 1e-9)[:, None], [1.0, 0.0, 0.0])
    helper = np.where(np.abs(first[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    second = np.cross(first, helper)
    second /= np.linalg.norm(second, axis=1)[:, None]
    return np.stack((first, second, np.cross(first, second)), axis=2)


def danger_index(robot: Ellipsoids, body: Ellipsoids, index: Index = "transformed") -> Array:
    """Return the danger index ``(N, M)`` of every link–body pair, (7); inf where two centres coincide."""
    zero = np.zeros((len(robot), 3))
    return index_of(pair_quadratics(robot, zero, body, 0.0, index), 0.0).reshape(len(robot), len(body))


def pair_quadratics(
    robot: Ellipsoids, per_speed: Array, body: Ellipsoids, at_speed: float, index: Index
) -> Array:
    """Return c ``(N M, 3)``: F of every pair is ``c[0] + c[1] v + c[2] v²`` at the speed v [m/s].

    Parameters
    ----------
    robot, body:
        Where they are at the end of the interval, the robot at v = 0.
    per_speed:
        ``(N, 3)``: how far the robot's centres move in the interval, per speed [s].
    at_speed:
        With the exact index: where F is exact [m/s]; elsewhere it is not above the exact one.
    """
    if index not in INDICES:
        raise SetupError(f"danger index {index!r}: known are {', '.join(INDICES)}")
    out = np.empty((len(robot) * len(body), 3))
    kernels.quadratics(
        robot.centre, robot.semi_axes, robot.rotation, np.ascontiguousarray(per_speed, dtype=float),
        body.centre, body.semi_axes, body.rotation, float(at_speed), index == "exact", out,
    )  # fmt: skip
    return out


def index_of(pairs: Array, v: float) -> Array:
    """Return the danger index (N M,) of quadratics at speed ``v`` [m/s]."""
    f = np.maximum(pairs[:, 0] + v * (pairs[:, 1] + v * pairs[:, 2]), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / f)


def surface_gap(robot: Ellipsoids, body: Ellipsoids) -> Array:
    """Return the distances ``(N, M)`` of the surfaces [m], by GJK; below 0 where they overlap."""
    out = np.empty((len(robot), len(body)))
    request = coal.DistanceRequest()
    for i, (shape, place) in enumerate(_shapes(robot)):
        for j, (other, where) in enumerate(_shapes(body)):
            out[i, j] = coal.distance(shape, place, other, where, request, coal.DistanceResult())
    return out


def _shapes(those: Ellipsoids) -> list[tuple[coal.Ellipsoid, coal.Transform3s]]:
    return [
        (coal.Ellipsoid(*axes), coal.Transform3s(turn, centre))
        for centre, axes, turn in zip(those.centre, those.semi_axes, those.rotation, strict=True)
    ]
