"""Sets of points that an occupancy is made of, and the row blocks that carry them through a cycle.

A sphere-swept volume (SSV) is the convex hull of a few points, grown by a ball. Balls and capsules are the
SSVs of one and of two points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.enclosure import MAX_LINKS
from robots.errors import SetupError
from robots.motion import MAX_SLICES, Block

MAX_PEOPLE: Final = 16
"""Rows of the people block: a person takes more than one after a contradiction."""
MAX_PEOPLE_SETS: Final = 256
"""People rows per slice."""
MAX_SET_POINTS: Final = 4
MAX_REACH_SETS: Final = 64
"""Rows per slice of a model with large hulls: two for each arm of every people row."""
MAX_REACH_POINTS: Final = 32
"""Up to so many points both engines take a hull as it is (:mod:`occupancy.engines`)."""
MAX_MODELS: Final = 8
"""Human models that one cell may enable."""

_ROUNDING: Final = 8.0 * float(np.finfo(np.float64).eps)


class SetError(SetupError):
    """A set whose points or radius are not usable numbers."""


def _rows(n_rows: int, n_points: int = MAX_SET_POINTS) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("n", np.int64),
            ("first", np.int64, (MAX_SLICES + 1,)),
            ("points", np.float64, (n_rows, n_points, 3)),
            ("n_points", np.int32, (n_rows,)),
            ("radius", np.float64, (n_rows,)),
            ("slice", np.int32, (n_rows,)),
            ("owner", np.int32, (n_rows,)),
            ("covers", np.uint32, (n_rows,)),
            ("model", np.int8, (n_rows,)),
            ("speed_max", np.float64, (n_rows,)),
        ]
    )


LINK_SETS: Final = _rows(MAX_SLICES * MAX_LINKS)
"""What the arm occupies: ``owner`` is the row of the enclosure block, ``points`` [m] are the end points of
the link's axis at the two ends of the slice (a_i, b_i, a_i+1, b_i+1), ``speed_max`` [m/s] bounds the speed of
every point of the link over the slice. Rows ``first[i]`` to ``first[i+1] - 1`` belong to slice i, and
``first`` equals ``n`` from the last slice on. A row with ``n_points = 0`` says that nothing is known: nothing
is ever proven with it."""

PEOPLE_SETS: Final = _rows(MAX_SLICES * MAX_PEOPLE_SETS)
"""What people may occupy: ``owner`` is the row of the people block, ``covers`` the mask of canonical parts
that the row contains, ``model`` the index of the human model that wrote it; otherwise as ``LINK_SETS``."""

REACH_SETS: Final = _rows(MAX_SLICES * MAX_REACH_SETS, MAX_REACH_POINTS)
"""As ``PEOPLE_SETS``, fewer rows of more points each."""


def new_link_sets() -> Block:
    """Return an empty block of link rows."""
    return np.zeros(1, dtype=LINK_SETS)


def new_people_sets() -> Block:
    """Return an empty block of people rows."""
    return np.zeros(1, dtype=PEOPLE_SETS)


def new_reach_sets() -> Block:
    """Return an empty block of people rows with large hulls."""
    return np.zeros(1, dtype=REACH_SETS)


@dataclass(frozen=True)
class SphereSweptVolume:
    """The convex hull of ``points`` (P, 3) [m], grown by a ball of ``radius`` [m].

    Raises
    ------
    SetError
        When there is no point, a coordinate is not finite, or the radius is negative or not finite.
    """

    points: NDArray[np.float64]
    radius: float

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[0] == 0 or points.shape[1] != 3:
            raise SetError(f"a set needs points of shape (P, 3) with P > 0, not {points.shape}")
        if not np.isfinite(points).all():
            raise SetError(f"the points of a set must be finite, not {points.tolist()}")
        if not 0.0 <= self.radius < np.inf:
            raise SetError(f"the radius of a set must be finite and not negative, not {self.radius} m")
        points.flags.writeable = False
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "radius", float(self.radius))

    def inflate(self, by: float) -> Self:
        """Return the same set grown by ``by`` [m] in every direction.

        Raises
        ------
        SetError
            When ``by`` is negative or not finite: an occupancy never shrinks.
        """
        if not 0.0 <= by < np.inf:
            raise SetError(f"a set is inflated by a finite length that is not negative, not {by} m")
        return type(self)(self.points, self.radius + by)

    def excess(self, point: ArrayLike) -> float:
        """Distance [m] by which ``point`` (3,) lies outside; 0 inside; infinite when it is not finite."""
        p = np.asarray(point, dtype=np.float64)
        if not np.isfinite(p).all():
            return float("inf")
        return max(0.0, distance_to_hull(self.points, p) - self.radius)

    def contains(self, other: SphereSweptVolume | ArrayLike, tolerance: float = 1e-9) -> bool:
        """Whether a point (3,) or another set provably lies inside, up to ``tolerance`` [m].

        ``hull(A) + ball(r)`` lies in ``hull(B) + ball(R)`` with r <= R if and only if every point of A is
        within R - r of ``hull(B)``: support functions are additive under Minkowski sums, and the equal ball
        cancels. When r > R the answer is False, although a flat ball may fit into a large hull: not shown is
        not contained.
        """
        if not isinstance(other, SphereSweptVolume):
            return self.excess(other) <= tolerance
        room = self.radius - other.radius
        if room < 0.0:
            return False
        return all(distance_to_hull(self.points, p) <= room + tolerance for p in other.points)


class Ball(SphereSweptVolume):
    """All points within ``radius`` [m] of ``centre`` (3,) [m]."""

    @classmethod
    def at(cls, centre: ArrayLike, radius: float) -> Ball:
        """Return the ball around ``centre``."""
        return cls(np.asarray(centre, dtype=np.float64).reshape(-1, 3), radius)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centre (3,) [m]."""
        centre: NDArray[np.float64] = self.points[0]
        return centre

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.points) != 1:
            raise SetError(f"a ball has 1 point, not {len(self.points)}")


class Capsule(SphereSweptVolume):
    """All points within ``radius`` [m] of the segment between two points."""

    @classmethod
    def between(cls, a: ArrayLike, b: ArrayLike, radius: float) -> Capsule:
        """Return the capsule around the segment from ``a`` (3,) to ``b`` (3,) [m]."""
        return cls(np.asarray([a, b], dtype=np.float64), radius)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.points) != 2:
            raise SetError(f"a capsule has 2 points, not {len(self.points)}")


def enclose(*sets: SphereSweptVolume) -> SphereSweptVolume:
    """Return the hull of all points with the largest radius: it contains every one of ``sets``.

    Raises
    ------
    SetError
        When there is nothing to enclose.
    """
    if not sets:
        raise SetError("there is nothing to enclose")
    return SphereSweptVolume(np.vstack([each.points for each in sets]), max(each.radius for each in sets))


def distance_to_hull(points: NDArray[np.float64], p: ArrayLike) -> float:
    """Distance [m] of ``p`` (3,) from the convex hull of ``points`` (P, 3): attained, so never below the
    exact one; infinite where a difference of coordinates is not finite.
    """
    with np.errstate(over="ignore"):
        offset = np.asarray(points, dtype=np.float64) - np.asarray(p, dtype=np.float64)
    if not np.isfinite(offset).all():
        return float("inf")
    return float(np.linalg.norm(nearest_weights(offset) @ offset))


def nearest_weights(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return weights (P,), none negative and of sum 1, of the point of the hull of ``points`` (P, 3) that is
    nearest to 0.

    Wolfe, *Finding the nearest point in a polytope*, Mathematical Programming 11 (1976): of a few points, the
    nearest in their affine hull; whichever point is farthest to this side joins them, and those leave whose
    weight would be negative. The end is the optimality condition, x·p >= x·x for all points p, up to
    rounding. (Non-negative least squares solve the same problem; those of scipy 1.17 return, once in some ten
    thousand points and without a word, weights that do not meet the condition.)
    """
    scaled = points / (np.abs(points).max() or 1.0)
    active, weights = [int(np.argmin(np.linalg.norm(scaled, axis=1)))], np.ones(1)
    best, length = (active, weights), np.inf
    while True:
        x = weights @ scaled[active]
        reached = float(np.linalg.norm(x))
        if not reached < length:
            break
        best, length = (active, weights), reached
        along = scaled @ x
        farthest = int(np.argmin(along))
        short = reached**2 - along[farthest] <= _ROUNDING * reached
        if short or reached <= _ROUNDING or farthest in active:
            break
        active, weights = _towards_zero([*active, farthest], np.append(weights, 0.0), scaled)
    answer = np.zeros(len(points))
    answer[best[0]] = best[1]
    return answer


def _towards_zero(
    active: list[int], weights: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[list[int], NDArray[np.float64]]:
    """Go to the nearest point of the affine hull, or to the border of the hull and on with who is left."""
    while True:
        first, others = points[active[0]], points[active[1:]]
        share = np.linalg.lstsq((others - first).T, -first, rcond=None)[0]
        wanted = np.concatenate([[1.0 - share.sum()], share])
        shrinking = np.flatnonzero(wanted < 0.0)
        if not len(shrinking):
            return active, wanted
        reach = weights[shrinking] / (weights[shrinking] - wanted[shrinking])
        weights = np.maximum(weights + reach.min() * (wanted - weights), 0.0)
        weights[shrinking[np.argmin(reach)]] = 0.0
        staying = np.flatnonzero(weights)
        active, weights = [active[i] for i in staying], weights[staying] / weights.sum()
