"""Seeded pairs of small hulls, the hard ones included."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rng = np.random.Generator


def _unit(rng: Rng) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _hull(rng: Rng) -> Array:
    return rng.normal(size=(int(rng.integers(1, 5)), 3)) * 10 ** rng.uniform(-2, 0.3)


def random(rng: Rng) -> tuple[Array, Array]:
    return _hull(rng), _hull(rng) + rng.normal(size=3)


def far(rng: Rng) -> tuple[Array, Array]:
    return _hull(rng), _hull(rng) + _unit(rng) * rng.uniform(5, 500)


def parallel(rng: Rng) -> tuple[Array, Array]:
    along = _unit(rng)
    across = np.cross(along, _unit(rng))
    start, shift = rng.normal(size=3), rng.uniform(-2, 2)
    tilt = rng.choice([0.0, 1e-9, 1e-6]) * _unit(rng)
    a = start + np.outer([0, rng.uniform(0.01, 2)], along)
    b = start + across * rng.uniform(0, 1) + np.outer([shift, shift + rng.uniform(-2, 2)], along + tilt)
    if rng.random() < 0.5:
        a = np.vstack([a, a + rng.uniform(0, 0.1) * across])
    return a, b


def collinear(rng: Rng) -> tuple[Array, Array]:
    along, start = _unit(rng), rng.normal(size=3)
    s = rng.uniform(-2, 2, size=4)
    return start + np.outer(s[:2], along), start + np.outer(s[2:], along)


def touching(rng: Rng) -> tuple[Array, Array]:
    """Both hulls lie on their sides of a plane, and share a point of it up to a very small gap."""
    n, at = _unit(rng), rng.normal(size=3)
    gap = rng.choice([0.0, 1e-9, 1e-6, 1e-4, 1e-3])
    sides = []
    for sign in (-1.0, 1.0):
        points = rng.normal(size=(int(rng.integers(1, 4)), 3))
        depth = np.abs(points @ n)
        points += np.outer(sign * depth - points @ n, n)
        sides.append(np.vstack([np.zeros(3), points]) + at + (sign > 0) * gap * n)
    return sides[0], sides[1]


def nested(rng: Rng) -> tuple[Array, Array]:
    """The second lies inside the first."""
    outer = rng.normal(size=(4, 3))
    weights = rng.dirichlet(np.ones(4), size=int(rng.integers(1, 5)))
    return outer, weights @ outer


def crossing(rng: Rng) -> tuple[Array, Array]:
    """Both contain a common point."""
    a, b = _hull(rng), _hull(rng)
    wa, wb = rng.dirichlet(np.ones(len(a))), rng.dirichlet(np.ones(len(b)))
    return a - wa @ a, b - wb @ b


def degenerate(rng: Rng) -> tuple[Array, Array]:
    """Coinciding, collinear and coplanar points."""
    hulls = []
    for shift in (0.0, rng.uniform(0, 2)):
        points = rng.normal(size=(4, 3))
        kind = rng.integers(4)
        if kind == 0:
            points[:] = points[0]
        elif kind == 1:
            points[2:] = points[:2]
        elif kind == 2:
            points = points[0] + np.outer(rng.uniform(-1, 1, 4), points[1])
        else:
            points = points[0] + rng.uniform(-1, 1, (4, 2)) @ points[1:3]
        hulls.append(points + shift * _unit(rng))
    return hulls[0], hulls[1]


def swept(rng: Rng) -> tuple[Array, Array]:
    """A link axis before and after a small motion, and a limb."""
    axis = rng.normal(size=(2, 3)) * 0.3
    motion = rng.normal(size=(2, 3)) * 10 ** rng.uniform(-5, -1)
    limb = rng.normal(size=(2, 3)) * 0.3 + rng.normal(size=3)
    return np.vstack([axis, axis + motion]), limb


KINDS: dict[str, Callable[[Rng], tuple[Array, Array]]] = {
    kind.__name__: kind
    for kind in (random, far, parallel, collinear, touching, nested, crossing, degenerate, swept)
}
MEETING = ("nested", "crossing")
