"""People whom nobody lists: outside of a monitored region at some instant, then on the way inwards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.body import Profile
from occupancy.hypotheses import PEOPLE
from occupancy.region import Monitored, Region
from robots.motion import Block
from tests.occupancy.crowds import INSTANTS, NOW, SLICES, watch
from tests.occupancy.inclusion_kernels import EXCESS, FLOOR_M, OPEN_WIDTH, Array, from_hull
from tests.occupancy.moving_people import unit
from tests.occupancy.test_region import FIELD, FLOOR_PLAN, rotation

TURNS = 3
"""Pieces of a path before it goes straight on."""


@cache
def _fixed(name: str) -> tuple[Region, Array]:
    return {
        "box": lambda: (Region.box((-2.0, -3.0, -1.0), (2.0, 3.0, 3.0)), np.array([0.0, 0.0, 1.0])),
        "prism": lambda: (Region.prism(FLOOR_PLAN, -0.5, 1.5), np.array([0.3, 0.3, 0.5])),
        "far": lambda: (
            Region.box((90.0, -99.0, -99.0), (99.0, 99.0, -90.0)),
            np.array([94.5, 0.0, -94.5]),
        ),
    }[name]()


def region(rng: np.random.Generator) -> tuple[Region, Array]:
    """A box, a prism, a camera's frustum, or a box near the edge of what is allowed; and a point inside."""
    name = str(rng.choice(["box", "prism", "far", "frustum"]))
    if name != "frustum":
        return _fixed(name)
    eye, axes = rng.uniform(-1.0, 1.0, 3), rotation(rng)
    return Region.frustum(eye, axes, **FIELD), eye + 2.0 * axes[:, 0]


@dataclass(frozen=True)
class Entrance:
    """A monitored region, its newest complete report, a plan, and where people truly are on it.

    ``at`` (slices, instants, n, 3) [m] at ``times`` (slices, instants) [s].
    """

    watched: Monitored
    people: Block
    plan: Block
    at: Array
    times: Array


def entering(rng: np.random.Generator, profile: Profile, n: int, *, aligned: bool) -> Entrance:
    """Up to ``n`` points of bodies that were outside within the detection time, and move at full speed.

    A point of a body keeps its place to a mean of two points of the axis, each with its own bang-bang motion.
    """
    seen = watch(rng, aligned=aligned, lost=False, ages=False)
    where, inside = region(rng)
    late = float(rng.uniform(0.0, 0.05) * rng.choice([0.0, 1.0]))
    watched = Monitored("cell", where, float(rng.uniform(0.0, 0.3)), late)
    off = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], (n, 2))
    back = rng.choice([0.0, 1.0, 1.0, rng.random()], n)
    if aligned:
        off[:], back[:] = (-1.0, 1.0) if seen.later else (1.0, 0.0)
    u = NOW + off @ [seen.stamp_error, seen.clock_error] - watched.detection_time_s * back
    face = rng.integers(len(where.offset), size=n)
    normal = where.normal[face]
    start = inside + np.cross(normal, unit(rng, n)) * rng.choice([0.1, 0.5, 2.0, 30.0], (n, 1))
    outwards = where.offset[face] - late + rng.choice([0.0, 0.0, 2.0], n) - (start * normal).sum(axis=1)
    start += outwards[:, None] * normal
    outside = where.depth(start) <= late + 1e-12
    u, normal, start = u[outside], normal[outside], start[outside]
    straight = np.full(len(u), True) if aligned else rng.random(len(u)) < 0.5
    times = seen.times.ravel()
    gone = [_path(rng, times[None] - u[:, None], -normal, straight) for _ in range(2)]
    share = rng.random(len(u))[:, None, None]
    x = start[:, None] + float(profile.speed.max()) * ((1.0 - share) * gone[0] + share * gone[1])
    people = np.zeros(1, PEOPLE)
    people["stamp_error"], people["clock_error"] = seen.stamp_error, seen.clock_error
    people["unlisted"], people["t_complete"] = 1, NOW - seen.stamp_error
    at = np.ascontiguousarray(x.transpose(1, 0, 2)).reshape(SLICES, INSTANTS, -1, 3)
    return Entrance(watched, people, seen.plan, at, seen.times)


def _path(rng: np.random.Generator, elapsed: Array, inwards: Array, straight: NDArray[np.bool_]) -> Array:
    """How far (n, m, 3) paths at 1 m/s have come after, or came before, ``elapsed`` (n, m) [s]."""
    n = len(elapsed)
    ways = unit(rng, n * 2 * (TURNS + 1)).reshape(n, 2, TURNS + 1, 3)
    ways[rng.random((n, 2, TURNS + 1)) < 0.3] *= -1.0
    ways[straight] = inwards[straight, None, None]
    lasts = rng.uniform(0.0, 0.3, (n, TURNS + 1))
    lasts[:, -1] = np.inf
    begins = np.concatenate([np.zeros((n, 1)), np.cumsum(lasts[:, :-1], axis=1)], axis=1)
    spent = np.clip(np.abs(elapsed)[..., None] - begins[:, None], 0.0, lasts[:, None])
    before = elapsed < 0.0
    out: Array = np.where(
        before[..., None],
        np.einsum("nmp,npi->nmi", spent, ways[:, 0]),
        np.einsum("nmp,npi->nmi", spent, ways[:, 1]),
    )
    return out


@njit(cache=True, error_model="numpy")
def worst_of_entering(out: NDArray[np.void], at: Array, times: Array) -> Array:
    """Return the case (``OPEN_WIDTH``,) of a point that lies farthest outside of *all* rows of a slice.

    ``at`` (slices, instants, n, 3) [m] at ``times`` (slices, instants) [s].
    """
    rows = out[0]
    worst = np.zeros(OPEN_WIDTH)
    worst[EXCESS] = -np.inf
    for i in range(at.shape[0]):
        for j in range(at.shape[1]):
            for n in range(at.shape[2]):
                least, best = np.inf, -1
                enough = max(worst[EXCESS], FLOOR_M)
                for row in range(rows.first[i], rows.first[i + 1]):
                    radius = rows.radius[row]
                    away, _ = from_hull(rows.points[row], rows.n_points[row], at[i, j, n], radius + enough)
                    if away - radius < least:
                        least, best = away - radius, row
                    if least <= enough:
                        break
                if not least <= enough:
                    worst[0], worst[EXCESS] = best, least
                    worst[1:4] = at[i, j, n]
                    worst[6], worst[7], worst[8], worst[9] = i, n, -1.0, times[i, j]
    return worst
