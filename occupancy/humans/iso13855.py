"""People who move no faster than ISO 13855 assumes (docs/method.md, section 4.1).

Every part is enclosed in a sphere-swept volume whose radius is body radius + e_p + v Δt (Pereira and Althoff,
Online formal verification, III-A). v is an approach speed, not a limit of limb speed. Torso and head share
one capsule there, from head to pelvis. A bent neck leaves that capsule; here they share the hull of the trunk
points that were measured, where both ends of a part are among them, and a part of which one is missing is
inferred.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

from occupancy.body import Part, Point, Profile
from occupancy.humans.options import HANDS, SEGMENTS, ModelError, Option, OptionModel, inferred
from robots.assumption import Assumption, Certainty

_TRUNK = (Point.PELVIS, Point.THORAX, Point.NECK_BASE, Point.HEAD)
_TRUNK_PARTS = (Part.HEAD, Part.NECK, Part.TORSO, Part.PELVIS)


class Iso13855(OptionModel):
    """Reachable occupancy of people whose every body point moves at most at an approach speed.

    Parameters
    ----------
    profile:
        Limits and sizes.
    approach_speed:
        Speed of every point [m/s] in place of the profile's; to choose a lower one, give gate and model
        ``profile.with_speed(...)``: what the gate does not hold against the data must not be assumed.
    held_object_m:
        How far an object in either hand reaches beyond it [m]; ``None``: not declared, 0.
    index:
        Number of this model in the rows that it writes.

    Raises
    ------
    ModelError
        If a number is not finite, negative, or the speed is below the profile's.
    """

    def __init__(
        self,
        profile: Profile,
        *,
        approach_speed: float | None = None,
        held_object_m: float | None = None,
        index: int = 0,
    ) -> None:
        fastest = float(profile.speed.max())
        if approach_speed is not None and not (math.isfinite(approach_speed) and approach_speed >= fastest):
            raise ModelError(
                f"iso13855: approach_speed {approach_speed} m/s must be finite and not below {fastest} m/s, "
                f"the speed of profile {profile.name} that reports are checked against"
            )
        super().__init__("iso13855", profile, _options, held_object_m=held_object_m, index=index)
        self._approach_speed = approach_speed
        if approach_speed is not None:
            self._table["speed"] = self._table["speed_max"] = approach_speed

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        stated = super().assumptions()
        if self._approach_speed is None:
            return stated
        place = f"people.{self.profile.name}.speed."
        speed = Assumption(
            f"{place}every_point", self._approach_speed, "m/s", "stated by the user", Certainty.DECLARED
        )
        kept = [each for each in stated if not each.name.startswith(place)]
        return (*kept[:-1], speed, kept[-1])


def _options(part: Part, profile: Profile, held: float) -> Iterator[Option]:
    yield from _measured(part, profile, held)
    yield from inferred(part, profile, held)


def _measured(part: Part, profile: Profile, held: float) -> Iterator[Option]:
    """Options with chain 0: the part's own points are measured."""
    radius = float(profile.radius[part])
    if part in HANDS:
        for point in HANDS[part]:
            yield 0.0, (point,), radius + held
        return
    if part in _TRUNK_PARTS:
        for points in _trunk_hulls(part):
            yield 0.0, points, radius
        if part in (Part.NECK, Part.TORSO):
            return
    a, b = SEGMENTS[part]
    yield 0.0, (a,) if a == b else (a, b), radius


def _trunk_hulls(part: Part) -> Iterator[tuple[Point, ...]]:
    """Hulls of two to four trunk points that contain the segment of a part, those with most points first."""
    for size in (4, 3, 2):
        for points in combinations(_TRUNK, size):
            if set(SEGMENTS[part]) <= set(points):
                yield points
