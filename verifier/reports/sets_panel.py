"""What a picture of predicted sets shows, as numbers: outlines, skeletons, and what is said of each point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import LIMBS, PART_NAMES, POINT_NAMES, Part, Point
from verifier.outline import outline, project
from verifier.snapshot import Predicted, Snapshot

Array = NDArray[np.float64]

GROUPS: Final[dict[str, tuple[Part, ...]]] = {
    "trunk and head": (Part.TORSO, Part.PELVIS, Part.NECK, Part.HEAD),
    "legs": (Part.L_THIGH, Part.L_SHANK, Part.L_FOOT, Part.R_THIGH, Part.R_SHANK, Part.R_FOOT),
    "arms": (Part.L_UPPER_ARM, Part.L_FOREARM, Part.R_UPPER_ARM, Part.R_FOREARM),
    "hands": (Part.L_HAND, Part.R_HAND),
}
"""Parts that are drawn in one colour."""
SEVERAL: Final = "several of these"
"""Group of a row that contains parts of more than one."""
_VIA: Final = {
    (Point.PELVIS, Point.NECK_BASE): Point.THORAX,
    (Point.L_WRIST, Point.L_FINGERTIP): Point.L_HAND,
    (Point.R_WRIST, Point.R_FINGERTIP): Point.R_HAND,
}
"""Pairs that no line joins where the point between them was seen."""
_MOST_NAMED: Final = 3
"""Points outside that are named in a panel; of others the number is given."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A model's prediction for one instant and the person at that instant, in metres: to the right, and up.

    Attributes
    ----------
    model:
        Its name.
    outlines:
        By group, the outline (N, 2) of each row.
    missed:
        By part that a point lies outside of, the outlines of its rows.
    points:
        (20, 2), where the person was at the instant; NaN: not seen.
    excess_m, part, flesh_m:
        (20,) as in :class:`verifier.snapshot.Predicted`.
    """

    model: str
    outlines: dict[str, tuple[Array, ...]]
    missed: dict[Part, tuple[Array, ...]]
    points: Array
    excess_m: Array
    part: NDArray[np.int64]
    flesh_m: Array

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(20,) points in the rows of all their parts, with the flesh around them."""
        return self.excess_m <= 0.0

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(20,) points that are not in the rows of some part."""
        return self.excess_m > 0.0

    @property
    def silent(self) -> NDArray[np.bool_]:
        """(20,) points of which nothing is said, and those that were not seen."""
        return ~(self.inside | self.outside)

    @property
    def corners(self) -> Array:
        """(N, 2) corners of all outlines."""
        return np.vstack([np.empty((0, 2)), *(each for group in self.outlines.values() for each in group)])

    @property
    def finding(self) -> str:
        """Text: the points that are outside, farthest first, or how deep all are inside at least."""
        if not self.outside.any():
            deep = self.excess_m[self.inside]
            return f"inside, {-1e3 * deep.max():.0f} mm deep or more" if len(deep) else "says nothing"
        order = np.argsort(np.where(self.outside, -self.excess_m, np.inf))[: np.count_nonzero(self.outside)]
        lines = [f"{_millimetres(self.excess_m[p])} {self._where(p)}" for p in order[:_MOST_NAMED]]
        more = len(order) - len(lines)
        return "\n".join([*lines, f"and {more} more"] if more else lines)

    def _where(self, p: int) -> str:
        part, point = PART_NAMES[self.part[p]], POINT_NAMES[p]
        return part if part == point else f"{part} ({point})"


def panel_of(snapshot: Snapshot, horizon: int, predicted: Predicted) -> Panel:
    """Return what is drawn of a model's prediction for a horizon of a snapshot (its number)."""
    parts = {Part(part) for part in predicted.part[predicted.excess_m > 0.0]}
    outlines: dict[str, tuple[Array, ...]] = {}
    missed: dict[Part, tuple[Array, ...]] = {}
    for row in predicted.rows:
        own = outline(project(row.points, snapshot.along), row.radius)
        group = group_of(row.covers)
        outlines[group] = (*outlines.get(group, ()), own)
        for part in parts:
            if row.covers >> part & 1:
                missed[part] = (*missed.get(part, ()), own)
    points = project(snapshot.later[horizon], snapshot.along)
    of_points = (predicted.excess_m, predicted.part, predicted.flesh_m)
    return Panel(predicted.model, outlines, missed, points, *of_points)


def group_of(covers: int) -> str:
    """Return the group of a row that contains the parts of a mask."""
    groups = [name for name, parts in GROUPS.items() if any(covers >> part & 1 for part in parts)]
    return groups[0] if len(groups) == 1 else SEVERAL


def bones(points: Array) -> Iterator[tuple[Point, Point]]:
    """Yield the pairs of points (20, D) that a line joins: neighbours that were both seen."""
    seen = np.asarray(np.isfinite(points).all(axis=1))
    for pairs in LIMBS.values():
        for a, b in pairs:
            via = _VIA.get((a, b))
            if seen[a] and seen[b] and (via is None or not seen[via]):
                yield a, b


def _millimetres(metres: float) -> str:
    return f"{1e3 * metres:+.{1 if metres < 0.01 else 0}f} mm"
