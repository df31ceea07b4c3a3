"""People of whom little more is known than where they stand (docs/method.md, section 4.4).

For floor positions, boxes and tracks of scanners: one point of the body, x and y of it, is enough. Every part
of the body lies in one vertical capsule.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from occupancy.body import Part, Point, Profile
from occupancy.humans.kernels import occupy_upright
from occupancy.humans.options import HANDS, SEGMENTS, ModelError, Option, OptionModel
from robots.assumption import Assumption, Certainty
from robots.motion import Block

_COLUMN_M = 100.0
"""Half the height of the column where no floor is declared [m]."""


class Pedestrian(OptionModel):
    """Reachable occupancy of whole people from one point each, by the speed of their fastest point.

    A person's row is the capsule of radius

        ρ = D + e_p + v Δt,   D = max over parts of max(d(q, a), d(q, b)) + body radius (+ held object)

    around the vertical line through the point q, with v the profile's largest speed, d its longest distances
    between points, a and b the ends of the segment that a part lies around, and Δt as for the other models.
    Of the measured points the one with the smallest D is taken, older ones counting as farther away.

    *Proof.* Let y be a point of the body at an instant of the slice. It lies within a body radius of some
    s = (1 - λ) a + λ b, and |s - q'| <= max(|a - q'|, |b - q'|), with q' where q is then; so |y - q'| <= D,
    and the horizontal distance is no larger. q' is horizontally within e_p + v Δt of the x and y that were
    measured. So y is within ρ of the vertical line, and it is in the capsule if its height is between that of
    the two ends: a point of the axis has the same height and lies within ρ.

    The height of q enters nowhere, so a track that knows x and y only may state any height as long as it is
    always the same (the gate compares reports in three dimensions); ``error_m`` bounds the error of x and y.
    Height of the ends: without ``floor_m`` the axis is a column of 200 m around the world's origin. With
    ``floor_m`` it begins at the floor, and ends where somebody one of whose feet is on the floor can reach:
    the ankle is at most the radius of a foot above the floor, and every point of the body within D of the
    ankle. Who may jump or climb, or stand on something, needs the column.

    Parameters
    ----------
    profile:
        Limits and sizes.
    floor_m:
        Height of the floor in the world [m]; ``None``: not declared.
    held_object_m:
        How far an object in either hand reaches beyond it [m]; ``None``: not declared, 0.
    index:
        Number of this model in the rows that it writes.

    Raises
    ------
    ModelError
        If a number is not finite, the held object is negative, or the floor is farther than 50 m away.
    """

    def __init__(
        self,
        profile: Profile,
        *,
        floor_m: float | None = None,
        held_object_m: float | None = None,
        index: int = 0,
    ) -> None:
        if floor_m is not None and not abs(floor_m) <= 0.5 * _COLUMN_M:
            raise ModelError(
                f"pedestrian: floor_m {floor_m} must be within {0.5 * _COLUMN_M:g} m of the world's origin"
            )
        super().__init__("pedestrian", profile, _whole_body, held_object_m=held_object_m, index=index)
        self._table["speed"] = self._table["speed_max"]
        self._floor_m = floor_m
        self._ends = (-_COLUMN_M, _COLUMN_M)
        if floor_m is not None:
            held = 0.0 if held_object_m is None else held_object_m
            feet = ((Part.L_FOOT, Point.L_ANKLE), (Part.R_FOOT, Point.R_ANKLE))
            above = max(float(profile.radius[foot]) + _reach(ankle, profile, held) for foot, ankle in feet)
            self._ends = (float(floor_m), float(floor_m + above))

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        if self._floor_m is None:
            return super().assumptions()
        source = "stated by the user; one foot of everybody is on it"
        floor = Assumption("people.floor", self._floor_m, "m", source, Certainty.DECLARED)
        return (*super().assumptions(), floor)

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` as :meth:`OptionModel.occupy` does, by one row per person and slice."""
        occupy_upright(people, slices, self._table, self._ends, out)


def _reach(point: Point, profile: Profile, held: float) -> float:
    """Greatest distance [m] of anything of the body, and of what it holds, from one of its points."""
    return max(
        float(profile.chain[point, list(SEGMENTS[part])].max())
        + float(profile.radius[part])
        + (held if part in HANDS else 0.0)
        for part in Part
    )


def _whole_body(part: Part, profile: Profile, held: float) -> Iterator[Option]:
    """The same options for every part, so that every person has one row; ``chain`` is the whole reach."""
    for point in Point:
        reach = _reach(point, profile, held)
        if reach < math.inf:
            yield reach, (point,), reach
