"""Convex regions that sensors watch, as intersections of half-spaces (docs/method.md, section 4.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from robots.errors import SetupError

Array = NDArray[np.float64]

MAX_FACES: Final = 32
FARTHEST_M: Final = 100.0
"""No face of a region lies farther from the world's origin [m]."""
_THINNEST_M = 1e-3


class RegionError(SetupError):
    """A region that is not usable; the message names value and rule."""


@dataclass(frozen=True, eq=False)
class Region:
    """All points x with normal · x <= offset for every face.

    Attributes
    ----------
    normal:
        (F, 3), unit vectors that point outwards.
    offset:
        (F,) m, at most 100 m from the world's origin.

    Raises
    ------
    RegionError
        If shapes do not agree, a number is not finite, a normal is no unit vector, a face is too far away, or
        the region contains no ball of a millimetre.
    """

    normal: Array
    offset: Array

    def __post_init__(self) -> None:
        normal, offset = np.array(self.normal, np.float64), np.array(self.offset, np.float64)
        faces = len(offset) if offset.ndim == 1 else 0
        if not (1 <= faces <= MAX_FACES and normal.shape == (faces, 3)):
            raise RegionError(
                f"a region needs 1 to {MAX_FACES} faces: normals (F, 3) and offsets (F,), not "
                f"{normal.shape} and {offset.shape}"
            )
        if not (np.abs(np.linalg.norm(normal, axis=1) - 1.0) <= 1e-12).all():
            raise RegionError(f"the normals of a region must be unit vectors, not {normal.tolist()}")
        if not (np.abs(offset) <= FARTHEST_M).all():
            raise RegionError(
                f"the faces of a region must lie within {FARTHEST_M:g} m of the world's origin, not "
                f"{offset.tolist()} m"
            )
        if not _thickness(normal, offset) >= _THINNEST_M:
            raise RegionError("the region is empty: no point lies inside of all its faces")
        normal.flags.writeable = offset.flags.writeable = False
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset", offset)

    @classmethod
    def box(cls, lower: ArrayLike, upper: ArrayLike) -> Self:
        """Return the box between two corners (3,) [m]."""
        low, high = _vector("lower", lower), _vector("upper", upper)
        if not (low < high).all():
            raise RegionError(
                f"a box needs lower {low.tolist()} below upper {high.tolist()} along every axis"
            )
        return cls(np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([high, -low]))

    @classmethod
    def prism(cls, polygon: ArrayLike, lower: float, upper: float) -> Self:
        """Return what stands between two heights [m] above a convex polygon (P, 2) [m], in either sense."""
        corners = np.asarray(polygon, np.float64)
        if corners.ndim != 2 or corners.shape[1] != 2 or not 3 <= len(corners) <= MAX_FACES - 2:
            raise RegionError(f"a polygon needs 3 to {MAX_FACES - 2} corners (P, 2), not {corners.shape}")
        if not (np.isfinite(corners).all() and -math.inf < lower < upper < math.inf):
            raise RegionError("a prism needs finite corners and a lower height below its upper height")
        edge = np.roll(corners, -1, axis=0) - corners
        after = np.roll(edge, -1, axis=0)
        turn = np.arctan2(edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0], (edge * after).sum(axis=1))
        sense = math.copysign(1.0, float(turn.sum()))
        once = abs(abs(float(turn.sum())) - 2.0 * math.pi) < 1e-6
        if not (once and (sense * turn > 0.0).all() and (sense * turn < 3.14).all()):
            raise RegionError(f"the corners must go once around a convex polygon, not {corners.tolist()}")
        outwards = sense * np.column_stack([edge[:, 1], -edge[:, 0]])
        outwards /= np.linalg.norm(outwards, axis=1)[:, None]
        sides = np.column_stack([outwards, np.zeros(len(corners))])
        normal = np.vstack([sides, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
        return cls(normal, np.concatenate([(outwards * corners).sum(axis=1), [upper, -lower]]))

    @classmethod
    def frustum(
        cls,
        origin: ArrayLike,
        rotation: ArrayLike,
        *,
        horizontal: float,
        vertical: float,
        near: float,
        far: float,
    ) -> Self:
        """Return what a camera sees between two depths.

        Parameters
        ----------
        origin:
            (3,) m, where its lines of sight meet.
        rotation:
            (3, 3), orthonormal; its columns are the camera's axes in the world: forwards, to its left, up.
        horizontal, vertical:
            Whole field of view across and along "up" [rad], below π.
        near, far:
            Depths along "forwards" [m], 0 <= near < far.
        """
        eye, axes = _vector("origin", origin), np.asarray(rotation, np.float64)
        if axes.shape != (3, 3) or not np.allclose(axes.T @ axes, np.eye(3), rtol=0.0, atol=1e-9):
            raise RegionError(f"the rotation of a frustum must be orthonormal (3, 3), not {axes.tolist()}")
        if not np.linalg.det(axes) > 0.0:
            raise RegionError("the rotation of a frustum must not mirror")
        for name, angle in (("horizontal", horizontal), ("vertical", vertical)):
            if not 0.0 < angle < math.pi:
                raise RegionError(f"the {name} field of view {angle} rad must be above 0 and below pi")
        if not 0.0 <= near < far < math.inf:
            raise RegionError(f"a frustum needs 0 <= near < far, not {near} m and {far} m")
        forwards, left, up = axes.T
        sides = [
            sign * math.cos(0.5 * angle) * axis - math.sin(0.5 * angle) * forwards
            for axis, angle in ((left, horizontal), (up, vertical))
            for sign in (1.0, -1.0)
        ]
        normal = np.array([*sides, forwards, -forwards])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        depth = np.array([0.0, 0.0, 0.0, 0.0, far, -near])
        return cls(normal, normal @ eye + depth)

    def depth(self, points: ArrayLike) -> Array:
        """How deep each of ``points`` (…, 3) [m] lies inside: its ball of that radius does. Negative outside.

        NaN for points that are not finite.
        """
        away = self.offset - np.asarray(points, np.float64) @ self.normal.T
        nearest: Array = away.min(axis=-1)
        return nearest


@dataclass(frozen=True, eq=False)
class Monitored:
    """A region whose sensors list everybody in it (assumption A5 of docs/method.md, section 1).

    Whoever had some part of the body, or of what they hold, in the region throughout the detection time is
    listed in a report that is marked complete. People who stay outside, or have come in since, need not be.

    Attributes
    ----------
    name, region:
        Which region.
    detection_time_s:
        Somebody who came in is listed after this time at the latest.
    boundary_error_m:
        How far the true boundary may lie inside of the stated one.

    Raises
    ------
    RegionError
        If a number is negative or not finite.
    """

    name: str
    region: Region
    detection_time_s: float
    boundary_error_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("detection_time_s", "boundary_error_m"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise RegionError(
                    f"{self.name}: {name} {getattr(self, name)} must be finite and not negative"
                )


def _thickness(normal: Array, offset: Array) -> float:
    """Radius [m] of the largest ball inside, at most 1 m; negative: there is none."""
    found = linprog(
        np.array([0.0, 0.0, 0.0, -1.0]),
        A_ub=np.column_stack([normal, np.ones(len(offset))]),
        b_ub=offset,
        bounds=[(None, None)] * 3 + [(None, 1.0)],
    )
    x = found.x
    return float(x[3]) if found.status == 0 and x is not None else -math.inf


def _vector(name: str, value: ArrayLike) -> Array:
    vector = np.asarray(value, np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise RegionError(f"{name} {vector.tolist()} must be three finite numbers")
    return vector
