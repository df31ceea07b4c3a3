"""Capsules of small volume around sets of balls, and the proof that nothing sticks out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from robots.errors import SetupError

Array = NDArray[np.float64]

SLACK = 1e-9
"""Every fitted radius is this much [m] larger than the computed one; rounding stays a million times below."""
LARGEST = 1e3
"""Coordinates beyond this [m] prove nothing: a distance between them may round by more than the slack."""

_WORKING_SET = 24
_ROUNDS = 12
_REFINED_STARTS = 5


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within ``radius`` [m] of the segment from ``a`` to ``b`` (3,) [m]; ``a == b`` is a ball."""

    a: Array
    b: Array
    radius: float

    @cached_property
    def volume(self) -> float:
        """Volume [m³]."""
        length = float(np.linalg.norm(self.b - self.a))
        return float(np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius))

    def excess(self, balls: Array) -> float:
        """Return by how much the farthest of ``balls`` (N, 4) [x, y, z, radius; m] sticks out [m].

        Not positive means that all balls lie inside. A capsule is convex, so it then contains the convex hull
        of the balls too: every triangle, polyhedron or swept piece whose corners they are. NaN in, NaN out.
        """
        return float(np.max(_segment_distances(self.a, self.b, balls)[0] + balls[:, 3]) - self.radius)

    def contains(self, balls: Array) -> bool:
        """Whether all balls (N, 4) lie inside, with half of :data:`SLACK` left over for rounding.

        False where a number is not finite or so large (above :data:`LARGEST`) that the slack would not cover
        the rounding of a distance: there nothing is proven.
        """
        numbers = (self.a, self.b, np.array([self.radius]), balls)
        if not all(bool((np.abs(x) <= LARGEST).all()) for x in numbers):
            return False
        return self.excess(balls) <= -0.5 * SLACK


def _is_near(axis: Array, balls: Array) -> bool:
    """Whether both ends (axis[0:3], axis[3:6]) of a candidate lie within twice the balls' extent.

    The smallest capsule needs no more; an optimiser that has run away sees volumes that are all rounding.
    """
    middle = balls[:, :3].mean(axis=0)
    extent = float(np.max(np.linalg.norm(balls[:, :3] - middle, axis=1) + balls[:, 3]))
    ends = np.linalg.norm(axis[:6].reshape(2, 3) - middle, axis=1)
    return bool((ends <= 2.0 * extent).all())


def fit_capsule(balls: Array) -> Capsule:
    """Fit a capsule of locally minimal volume around ``balls`` (N, 4) [x, y, z, radius; m].

    The radius is computed last, as the exact maximum over all balls plus :data:`SLACK`: the optimiser decides
    how small the capsule is, never whether it contains the balls.
    """
    if balls.ndim != 2 or balls.shape[1] != 4 or len(balls) == 0:
        raise SetupError(f"a capsule is fitted around balls of shape (N, 4) with N > 0, not {balls.shape}")
    if not np.isfinite(balls).all() or (balls[:, 3] < 0).any():
        raise SetupError(
            "a capsule cannot be fitted around a ball that is not finite or has a negative radius"
        )
    corners = extreme_balls(balls)
    starts = sorted((_along(direction, corners) for direction in _directions(corners)), key=_volume)
    refined = [_optimise(start, corners) for start in starts[:_REFINED_STARTS]]
    near = [found for found in refined if _is_near(found, corners) and _volume(found) > 0.0]
    candidates = near + starts[:1]
    best = min(candidates, key=_volume)
    distance, _, _ = _segment_distances(best[0:3], best[3:6], balls)
    return Capsule(best[0:3].copy(), best[3:6].copy(), float(np.max(distance + balls[:, 3])) + SLACK)


def rough_volume(balls: Array) -> float:
    """Volume [m³] of a capsule around ``balls`` (N, 4) that is nearly as small as the fitted one."""
    return min(_volume(_along(direction, balls)) for direction in _directions(balls))


def extreme_balls(balls: Array) -> Array:
    """Return balls (M, 4) among ``balls`` (N, 4) with the same convex hull, up to rounding.

    Only for speed. Qhull may drop a point within rounding (1e-14 m) of the hull of the others, which
    :data:`SLACK` covers many times over; links without locked joints are checked with all points anyway.
    """
    kept: list[Array] = []
    for radius in np.unique(balls[:, 3]):
        group = np.unique(balls[balls[:, 3] == radius], axis=0)
        try:
            kept.append(group[ConvexHull(group[:, :3]).vertices] if len(group) > 8 else group)
        except QhullError:  # flat or collinear: all of them
            kept.append(group)
    return np.vstack(kept)


def _segment_distances(a: Array, b: Array, balls: Array) -> tuple[Array, Array, Array]:
    """Distances (N,) of ball centres from segment ab; parameters of, vectors (N, 3) from its points."""
    axis, offset = b - a, balls[:, :3] - a
    length2 = float(axis @ axis)
    along = np.clip(offset @ axis / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(balls))
    vector = offset - along[:, None] * axis
    return np.sqrt(np.einsum("ij,ij->i", vector, vector)), along, vector


def _directions(balls: Array) -> Array:
    """Axis directions (D, 3) to start from: principal and coordinate axes and the diagonals between them."""
    centred = balls[:, :3] - balls[:, :3].mean(axis=0)
    principal = np.linalg.svd(centred, full_matrices=False)[2] if len(balls) > 1 else np.eye(3)
    diagonals = [[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]
    return np.vstack([principal, np.eye(3), np.array(diagonals) / np.sqrt(2.0)])


def _along(direction: Array, balls: Array) -> Array:
    """Start (7,) = (a, b, radius): the shortest capsule of the radius that this axis direction needs."""
    basis = np.linalg.svd(direction[None, :])[2]
    local = balls[:, :3] @ basis.T
    radial = local[:, 1:]
    centre = 0.5 * (radial.min(axis=0) + radial.max(axis=0))
    off_axis = np.linalg.norm(radial - centre, axis=1)
    radius = float(np.max(off_axis + balls[:, 3]))
    cap = np.sqrt(np.maximum((radius - balls[:, 3]) ** 2 - off_axis**2, 0.0))
    low, high = float(np.min(local[:, 0] + cap)), float(np.max(local[:, 0] - cap))
    if low > high:
        low = high = 0.5 * (low + high)
    ends = np.array([[low, *centre], [high, *centre]]) @ basis
    distance, _, _ = _segment_distances(ends[0], ends[1], balls)
    return np.concatenate([ends.ravel(), [float(np.max(distance + balls[:, 3]))]])


def _volume(x: Array) -> float:
    length = float(np.linalg.norm(x[3:6] - x[0:3]))
    return float(np.pi * x[6] ** 2 * (length + 4.0 / 3.0 * x[6]))


def _volume_gradient(x: Array) -> Array:
    axis = x[3:6] - x[0:3]
    length = float(np.linalg.norm(axis))
    along = np.pi * x[6] ** 2 * axis / max(length, 1e-12)
    return np.concatenate([-along, along, [2.0 * np.pi * x[6] * (length + 2.0 * x[6])]])


def _optimise(start: Array, balls: Array) -> Array:
    """Minimise the volume over (a, b, radius) with the balls inside, adding violated balls round by round.

    The start is returned where nothing smaller is found.
    """
    x, working = start.copy(), _farthest(start, balls, _WORKING_SET)
    for _ in range(_ROUNDS):
        subset = balls[working]
        x = _solve(x, subset)
        worst = _farthest(x, balls, 6)
        if _margin(x, balls[worst]).min() > -1e-7 * max(x[6], 1e-3):
            break
        working = np.union1d(working, worst)
    x[6] -= float(_margin(x, balls).min())
    return x if _volume(x) <= _volume(start) else start


def _farthest(x: Array, balls: Array, number: int) -> NDArray[np.intp]:
    return np.argsort(_margin(x, balls))[:number]


def _margin(x: Array, balls: Array) -> Array:
    margin: Array = x[6] - balls[:, 3] - _segment_distances(x[0:3], x[3:6], balls)[0]
    return margin


def _margin_gradient(x: Array, balls: Array) -> Array:
    distance, along, vector = _segment_distances(x[0:3], x[3:6], balls)
    unit = vector / np.maximum(distance, 1e-12)[:, None]
    return np.hstack([(1.0 - along)[:, None] * unit, along[:, None] * unit, np.ones((len(balls), 1))])


def _solve(x: Array, balls: Array) -> Array:
    # the stubs of scipy know constraints as a list of objects only; SLSQP takes dicts as its manual says
    result = minimize(  # type: ignore[call-overload]
        lambda y: 1e3 * _volume(y),
        x,
        jac=lambda y: 1e3 * _volume_gradient(y),
        method="SLSQP",
        constraints=[
            {"type": "ineq", "fun": lambda y: _margin(y, balls), "jac": lambda y: _margin_gradient(y, balls)}
        ],
        options={"maxiter": 60, "ftol": 1e-10},
    )
    return np.asarray(result.x, dtype=np.float64) if np.isfinite(result.x).all() else x
