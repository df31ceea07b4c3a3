"""Blocks and rows for tests of arm reach."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from occupancy.body import PART_NAMES
from occupancy.humans.arm_reach import ArmReach
from occupancy.hypotheses import PEOPLE
from occupancy.sets import new_reach_sets
from robots.motion import Block, new_slices
from tests.occupancy.arm_twin import Twin
from tests.occupancy.people import ALL_POINTS, standing

Array = NDArray[np.float64]
Row = tuple[Array, float, int]
"""Points (P, 3) [m], radius [m], mask of parts."""


def slices(times: Array, delay: tuple[float, float] = (0.0, 0.0)) -> Block:
    block = new_slices()
    block["n"] = len(times) - 1
    block["t"][0, : len(times)] = times
    block["delay"] = delay
    return block


def person(xyz: Array | None = None, *, e_p: float = 0.01, e_v: float = math.inf) -> Block:
    block = np.zeros(1, PEOPLE)
    block["n"], block["present"][0, 0] = 1, ALL_POINTS
    block["xyz"][0, 0] = standing() if xyz is None else xyz
    block["e_p"], block["e_v"] = e_p, e_v
    return block


@cache
def buffer() -> Block:
    return new_reach_sets()


def rows(model: ArmReach, people: Block, plan: Block, i: int = 0) -> list[Row]:
    """Points, radius and parts of the rows of a slice."""
    out = buffer()
    model.occupy(people, plan, out)
    points, n, radius, covers = (out[name][0] for name in ("points", "n_points", "radius", "covers"))
    return [
        (points[k, : n[k]].copy(), float(radius[k]), int(covers[k]))
        for k in range(*out["first"][0, i : i + 2])
    ]


def parts(found: list[Row]) -> set[str]:
    return {name for bit, name in enumerate(PART_NAMES) if any(covers >> bit & 1 for _, _, covers in found)}


def twin_rows(twin: Twin, found: list[Row], i: int = 0) -> list[Row]:
    """Rows of a twin, with the parts of ``found``."""
    twin_set = twin.sound(i)
    if twin_set is None:
        return []
    points, growth = twin_set
    at = np.array([[float(x) for x in point] for point in points])
    return [(at, float(growth + body), row[2]) for body, row in zip(twin.radii(), found, strict=True)]
