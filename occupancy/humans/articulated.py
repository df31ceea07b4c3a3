"""Every part on its own: by speed, by speed and acceleration, and by the length of the limb it hangs on.

docs/method.md, section 4.3. The speed model grows a part's own points by v Δt. The acceleration model moves
them along with their measured velocity, and grows by what error and acceleration can add: it knows where
somebody is going. The position model follows the nearest point of the trunk instead, and adds the longest
chain from there: it is the tightest one where hands are fast and the trunk is slow.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from occupancy.body import Part, Point, Profile
from occupancy.humans.kernels import first_accelerated, occupy_acceleration
from occupancy.humans.model import Belied, Samples
from occupancy.humans.options import HANDS, SEGMENTS, ModelError, Option, OptionModel, inferred
from robots.motion import Block

_TORSO = ((Point.PELVIS, Point.THORAX, Point.NECK_BASE), (Point.PELVIS, Point.NECK_BASE))


class ArticulatedVelocity(OptionModel):
    """Parts whose points keep to the speeds of a profile; one row for each part.

    Parameters and errors as for :class:`~occupancy.humans.options.OptionModel`.
    """

    def __init__(self, profile: Profile, *, held_object_m: float | None = None, index: int = 0) -> None:
        super().__init__(
            "articulated_velocity", profile, _own_points, held_object_m=held_object_m, index=index
        )


class ArticulatedPosition(OptionModel):
    """Arms, legs, neck and head by their distance from points of the rest of the body.

    Parameters and errors as for :class:`~occupancy.humans.options.OptionModel`.
    """

    def __init__(self, profile: Profile, *, held_object_m: float | None = None, index: int = 0) -> None:
        super().__init__(
            "articulated_position", profile, _rest_of_the_body, held_object_m=held_object_m, index=index
        )


class ArticulatedAcceleration(OptionModel):
    """Parts whose points move on with the velocity they had, up to the accelerations of a profile.

    A point is used only while its velocity is known with a bound; rows are hulls of where the points would be
    at the two ends of the slice: in between the centre moves on a line and the radius is convex in time.

    Parameters and errors as for :class:`~occupancy.humans.options.OptionModel`; the profile must limit
    accelerations.
    """

    rests_on = (*OptionModel.rests_on, "acceleration")

    def __init__(self, profile: Profile, *, held_object_m: float | None = None, index: int = 0) -> None:
        if not np.isfinite(profile.acceleration).all():
            raise ModelError(f"articulated_acceleration: profile {profile.name} limits no accelerations")
        super().__init__(
            "articulated_acceleration", profile, _two_points, held_object_m=held_object_m, index=index
        )
        self._acceleration = profile.acceleration

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` as :meth:`OptionModel.occupy` does."""
        occupy_acceleration(people, slices, self._table, self._acceleration, out)

    def belied(self, people: Block, row: int, samples: Samples, window: tuple[float, float]) -> Belied | None:
        """Return the first later sample that velocities and accelerations do not allow."""
        sample, point, excess = first_accelerated(people, row, samples, window, self.profile.limits)
        return None if sample < 0 else Belied(sample, Point(point), excess)


def _own_points(part: Part, profile: Profile, held: float) -> Iterator[Option]:
    radius = float(profile.radius[part])
    if part in HANDS:
        yield from ((0.0, (point,), radius + held) for point in HANDS[part])
    elif part is Part.TORSO:
        yield from ((0.0, points, radius) for points in _TORSO)
    else:
        a, b = SEGMENTS[part]
        yield 0.0, (a,) if a == b else (a, b), radius
    yield from inferred(part, profile, held)


def _two_points(part: Part, profile: Profile, held: float) -> Iterable[Option]:
    """Options of at most two points: a row has room for them at both ends of a slice."""
    return (option for option in _own_points(part, profile, held) if len(option[1]) <= 2)


_LIMBS: dict[Part, tuple[Point, ...]] = {
    Part.HEAD: (Point.HEAD,),
    Part.NECK: (Point.HEAD,),
    **dict.fromkeys(
        (Part.L_UPPER_ARM, Part.L_FOREARM, Part.L_HAND),
        (Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    ),
    **dict.fromkeys(
        (Part.R_UPPER_ARM, Part.R_FOREARM, Part.R_HAND),
        (Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
    ),
    **dict.fromkeys((Part.L_THIGH, Part.L_SHANK, Part.L_FOOT), (Point.L_KNEE, Point.L_ANKLE)),
    **dict.fromkeys((Part.R_THIGH, Part.R_SHANK, Part.R_FOOT), (Point.R_KNEE, Point.R_ANKLE)),
}
"""The points that move with a part's limb; the position model looks at all others."""


def _rest_of_the_body(part: Part, profile: Profile, held: float) -> Iterator[Option]:
    if part not in _LIMBS:
        return
    for option in inferred(part, profile, held):
        if len(option[1]) == 1 and option[1][0] not in _LIMBS[part]:
            yield option
