"""Straight lines between configurations: which may be taken, and paths that are made shorter by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.planning.avoided import Avoided
from modes.planning.potential_field import MOTION_SLACK_M, Bodies, Field

Array = NDArray[np.float64]

EDGE_SLACK_M = 0.5 * MOTION_SLACK_M
"""By how much an edge may come nearer than the clearance [m]."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Which straight lines may be taken."""

    field: Field
    bodies: Bodies
    avoided: Avoided

    def are_clear(self, a: Array, b: Array) -> bool:
        """Whether the one from ``a`` to ``b`` (n,) keeps the clearance and enters no ball that is avoided."""
        entered = len(self.avoided.radius) > 0 and self.avoided.is_entered(a, b)
        return not entered and self.field.is_clear_between(a, b, self.bodies, EDGE_SLACK_M)


def shortened(path: list[Array], lines: Lines, shortcuts: int, seed: int) -> Array:
    """Replace pieces of a path by straight lines where these are clear, then leave out needless corners."""
    random = np.random.default_rng([seed, 1])
    points = path
    for _ in range(shortcuts):
        if len(points) < 3:
            break
        (i, s), (j, t) = sorted(_drawn(random, len(points)) for _k in range(2))
        if j == i:
            continue
        a = points[i] + s * (points[i + 1] - points[i])
        b = points[j] + t * (points[j + 1] - points[j])
        if lines.are_clear(a, b):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    kept = 1
    while kept < len(points) - 1:
        if lines.are_clear(points[kept - 1], points[kept + 1]):
            del points[kept]
        else:
            kept += 1
    return np.array(points)


def _drawn(random: np.random.Generator, count: int) -> tuple[int, float]:
    return int(random.integers(count - 1)), float(random.uniform())
