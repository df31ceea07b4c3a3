"""Who was not seen may be anywhere that was not seen (docs/method.md, section 4.5)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, Profile
from occupancy.humans.kernels import ROUNDING_M, occupy_unobserved
from occupancy.humans.model import Belied, Samples
from occupancy.humans.options import ModelError
from occupancy.region import Monitored
from occupancy.sets import MAX_MODELS, new_people_sets
from robots.assumption import Assumption, Certainty
from robots.motion import Block

Array = NDArray[np.float64]

UNOBSERVED = "unobserved space"
"""Stands in witnesses for the person whom nobody lists."""
ARENA_M: Final = 100.0
"""Rows are to be compared only with what lies within this distance of the world's origin [m]."""
FARTHEST_FRONT_M: Final = 100.0
"""A front that would have come farther than this is not known [m]."""


class UnobservedSpace:
    """The space that people may fill whom the newest complete report does not list.

    *Who.* By A5 a complete report, seen at τ, lists everybody who had some part in the region throughout
    [τ - T, τ], T the detection time. Whoever is not listed was outside with their whole body at some instant
    u of that interval. No point of a body is faster than v, the largest speed of the profile. (Where only the
    profile's points are held to v, "outside" is to be read of the body as the profile encloses it: what lies
    within a body radius of (1 - λ) a + λ b at t has, with the same offset from the same convex combination at
    u, a point of that enclosure within v |t - u|.) So at t their whole body lies within

        boundary error + v Δt,   Δt = max(|t - u|) over the slice and over all u that errors of clock and
                                      stamp leave possible,

    of the outside, which is the union of one open half-space per face.

    *Rows.* One per face: a tetrahedron whose base lies on the face's plane, around the foot c of the world's
    origin on that plane. With R = W + |c|, W the sum of the two radii below, the base has the inradius √2 R
    and the apex the height √2 R; the other three faces are at the distance √2 R · √2 R / (2 R) = R from c. So
    the tetrahedron contains the half-ball of radius R around c, and that contains what the half-space has in
    common with the ball of radius W around the world's origin. Who was outside of that ball at u does not
    reach the arena: W is the arena's radius plus the farthest that a front may have come. All corners are
    within 1000 m of the origin, so that a certificate of separation loses at most 1e-12 · 2000 m to rounding,
    and the corners themselves round by less than what is added to each radius, 1e-9 m.

    *Several regions.* Somebody who is not listed is outside of every region at some instant, one for each. So
    each model alone contains everybody who is not listed, and proving one of them suffices.

    All rows belong to a person of their own, number ``n`` of the people block, and only while that block says
    that people may be unlisted. Without a complete report, and for any number that is not usable, there are
    no rows.

    Parameters
    ----------
    monitored:
        Region, detection time and boundary error.
    profile:
        Its largest speed is that of the front.
    index:
        Number of this model in the rows that it writes.

    Raises
    ------
    ModelError
        If the index does not fit into a row.
    """

    proves = ALL_PARTS

    def __init__(self, monitored: Monitored, profile: Profile, *, index: int = 0) -> None:
        if not 0 <= index < MAX_MODELS:
            raise ModelError(f"unobserved: index {index} must be 0 to {MAX_MODELS - 1}")
        self.name = f"unobserved:{monitored.name}"
        self.index = index
        self.monitored = monitored
        self.profile = profile
        self.speed = float(profile.speed.max())
        region = monitored.region
        self._faces = np.array(
            [_beyond(normal, float(d)) for normal, d in zip(region.normal, region.offset, strict=True)]
        )
        self._rule = (
            monitored.detection_time_s,
            monitored.boundary_error_m + ROUNDING_M,
            self.speed,
            FARTHEST_FRONT_M,
        )

    def new_sets(self) -> Block:
        """Return an empty block for the rows of this model."""
        return new_people_sets()

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        place, stated = f"people.monitored.{self.monitored.name}", "stated by the user: A5"
        return (
            *(item for item in self.profile.assumptions if item.name.split(".")[2] == "speed"),
            Assumption(
                f"{place}.detection_time_s", self.monitored.detection_time_s, "s", stated, Certainty.DECLARED
            ),
            Assumption(
                f"{place}.boundary_error_m", self.monitored.boundary_error_m, "m", stated, Certainty.DECLARED
            ),
        )

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` (PEOPLE_SETS) by the space of whoever is not listed on each of ``slices``.

        Rows are grouped by slice and hold over the whole slice, delays included. Never raises.
        """
        occupy_unobserved(people, slices, self._faces, self._rule, self.index, out)

    def belied(self, people: Block, row: int, samples: Samples, window: tuple[float, float]) -> Belied | None:
        """Return None: who was seen is no matter of unobserved space."""
        return None

    def inferred_parts(self, present: int, t_obs: Array | None = None) -> int:
        """Return 0: nothing of this is a part of a body that could have been measured."""
        return 0


def _beyond(normal: Array, offset: float) -> Array:
    """Corners (4, 3) [m] of a tetrahedron that contains normal · x >= offset as far as it matters."""
    foot = offset * normal
    size = math.sqrt(2.0) * (ARENA_M + FARTHEST_FRONT_M + abs(offset))
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    angle = np.array([0.0, 1.0, 2.0]) * 2.0 * math.pi / 3.0
    base = foot + 2.0 * size * (np.outer(np.cos(angle), across) + np.outer(np.sin(angle), along))
    return np.vstack([base, foot + size * normal])
