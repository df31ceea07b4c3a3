"""Arm reach: shoulder, direction and extension of each arm (docs/method.md, section 4.2).

After Pereira and Althoff, Online formal verification, III-B: the middle M of the forearm seen from the
shoulder S, two angles and a distance; the arm lies within the hull of a ball at S and balls at M. E, W: elbow
and wrist, M = (E + W) / 2; d = M - S, r = |d|, u = d / r.

The sound face
--------------
*What is assumed*: the limits of the profile (:class:`~occupancy.body.ArmLimits`), in a frame that does not
turn: |d'| <= relative_speed, |d''| <= relative_acceleration, u turns at most at angular_speed, r changes at
most at extension_speed and lies in [r_inf, r_sup]; S moves at most at its speed; and that one report shows
the points of an arm at one instant. The arm is seen at τ, Δ = t - τ, |Δ| <= T for every t of the slice and τ
that errors allow; x̂ is what was measured of x. Points within e_S, e_E, e_W give |d(τ) - d̂| <= e = e_S + (e_E
+ e_W) / 2, likewise e_v for velocities.

1. *R1*. r <= r_sup, upper arm and half the forearm at their longest; r >= r_inf, the least of √(a² + b² + 2 a
   b cos flexion) over all lengths a, b of these and all flexions up to the greatest. The angles are not
   limited: they would need a torso frame that is tracked.
2. *R2*. |r(t) - r̂| <= e + min(extension_speed, relative_speed) T. Both u(τ) and û: a ball of radius e at
   distance r̂ is seen at the half-angle asin(e / r̂), or π if e >= r̂; then u turns by angular_speed T at most.
   And d(t) lies in the ball of radius e + relative_speed T around d̂: asin((e + relative_speed T) / r̂) is a
   bound as well. ψ is the smaller.
3. *R3*, if velocities are bounded. d(t) lies within ρ(Δ) = e + e_v |Δ| + relative_acceleration Δ² / 2 of
   d̂ + v̂ Δ. The centre is linear in Δ and ρ convex, so that all these balls lie in the hull of those at the
   two ends of Δ. r is convex: at most the larger |d̂ + v̂ Δ| + ρ of the ends. A cone of half-angle below
   π / 2 is convex, so the one about û with the larger of ∠(û, d̂ + v̂ Δ) + asin(ρ / |d̂ + v̂ Δ|) contains
   the hull.
4. *Intersection*. All cones have the axis û, so the narrowest holds; r⁺ is the least of the upper bounds. If
   the interval of r is empty, the measurement contradicts the limits, and there is no row.
5. *Hull*. d(t) lies in the sector C of all x with |x| <= r⁺ and ∠(x, û) <= ψ. For ψ <= 60° take, in the
   half-plane from the axis at azimuth φ, the polygon Q(φ) with the corner 0, whose edges touch the circle r⁺
   at 0, at 30° (if ψ > 30°), and at ψ, and that ends there: its corners are at ψ/2, or at 15° and (ψ + 30°) /
   2, at r⁺ over the cosine of half the angle between the edges; and at ψ, at r⁺. Q contains all x of C in its
   half-plane. Around the axis each corner makes a circle, which the regular polygon of ten corners contains
   whose radius is larger by 1 / cos 18°. So the hull of 0 and these 20 or 30 corners contains C; with its
   smaller r, every x of C lies between 0 and r⁺, and r_inf needs no corners of its own.
   For ψ > 60° take the ball of radius 1.0623 r⁺.
   *Larger numbers give larger sets*: in Q the boundary at angle θ is r⁺ / cos of the angle to the nearest
   edge's point of touch, min over the edges that are there; growing ψ moves the last one away, so Q grows
   with ψ, hence the hull; the farthest corner of all is 1.06225 r⁺, at ψ = 60°, hence the ball contains all
   hulls. (A grid of directions *on* the sphere and a radius for its sagitta would shrink here and there while
   its box grows.)
   *Without angles*: of an angle α the kernels keep tan(α/2), which grows with α from 0 to ∞ at π. It is
   |x × y| / (|x| |y| + x · y) of the angle between x and y, e / (r + √(r² - e²)) of asin(e / r), and of α + β
   (tan(α/2) + tan(β/2)) / (1 - tan(α/2) tan(β/2)), or ∞ where that denominator is not positive. Edges that
   touch the circle at α and β meet under (α + β) / 2 at r⁺ / cos((β - α) / 2): with a = tan(α/2) and b =
   tan(β/2), r⁺ (1 - a b) / (1 + a b) along û and r⁺ (a + b) / (1 + a b) across it; a = b at the end ψ. Mostly
   it is known without a tangent that ω T gives no smaller bound than relative_speed does: tan x >= x.
6. *Body*. S(t) lies within e_S + speed T of Ŝ; M(t) = S(t) + d(t). The forearm lies within half its longest
   length plus its flesh of M; a point of the upper arm's axis, (1 - λ) S + λ E, within half the forearm of
   (1 - λ) S + λ M; the hand within its radius (and held object) of W. Hence the radii: half the forearm +
   flesh of arm or hand + e_S + speed T.

The published face
------------------
As the paper has it: angles in a frame of the torso when it was seen, R1 with their limits, R2 and R3 of the
joint values from the observation on (0 lies between all limits of rates, which they need), the product of
the intervals, angles widened by 0.1 rad/s Δ, every point by 2.0 m/s Δ + e_p. Nodes at r⁺ on a grid of the
angles, and the radius r⁺ [(1 - cos(Δ1 / 2)) + (1 - cos(Δ2 / 2))]: a point of a cell lies within the sagitta
of its parallel from a chord between two meridians, the ends of the chord within that of the meridian from a
chord between nodes. It is not sound: torsos turn far faster than 0.1 rad/s, shoulders may be faster than 2.0
m/s, the limits are those of the upper arm and of somebody else's joints, and the rate of the first angle has
no bound where the arm points along its axis.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ArmLimits, Part, Point, Profile
from occupancy.humans.arm_kernels import first_arm_outside, occupy_arms
from occupancy.humans.model import Belied, Samples
from occupancy.humans.options import ModelError, held_object
from occupancy.sets import MAX_MODELS, new_reach_sets
from robots.assumption import Assumption, Certainty
from robots.motion import Block

ARMS: Final = np.dtype(
    [
        ("model", np.int64),
        ("speed_max", np.float64),
        ("point", np.int64, (2, 3)),
        ("covers", np.int64, (2, 2)),
        ("radius", np.float64, (2,)),
        ("shoulder_speed", np.float64, (2,)),
        ("extension", np.float64, (2,)),
        ("speed", np.float64),
        ("acceleration", np.float64),
        ("angular_speed", np.float64),
        ("extension_speed", np.float64),
        ("trunk", np.int64, (3, 2)),
        ("low", np.float64, (3,)),
        ("high", np.float64, (3,)),
        ("rate", np.float64, (3,)),
        ("change", np.float64, (3,)),
        ("drift", np.float64),
        ("base_speed", np.float64),
    ]
)
"""What the kernels know of arms, left and right: columns of shoulder, elbow, wrist; masks and radii [m] of
the rows for arm and hand; limits of the sound face; from ``trunk`` on (pairs of columns, lower point first)
of the published one: joint limits [rad, rad, m], their rates and the rates of these, turning [rad/s] and
speed [m/s] of the base."""

_NOT_OF_THE_SOUND_FACE: Final = tuple(
    f".arm.{name}"
    for name in (
        *("flexion", "extension", "abduction", "adduction"),
        *("angular_acceleration", "extension_acceleration", "torso_rate"),
    )
)
"""Limits in a frame of the torso, and of joint values, which the sound face does without."""
_ARMS: Final = (
    (Point.L_SHOULDER, Point.L_ELBOW, Point.L_WRIST),
    (Point.R_SHOULDER, Point.R_ELBOW, Point.R_WRIST),
)
_PARTS: Final = (
    ((Part.L_UPPER_ARM, Part.L_FOREARM), (Part.L_HAND,)),
    ((Part.R_UPPER_ARM, Part.R_FOREARM), (Part.R_HAND,)),
)
_TRUNK: Final = (
    (Point.PELVIS, Point.NECK_BASE),
    (Point.PELVIS, Point.THORAX),
    (Point.THORAX, Point.NECK_BASE),
)
_PUBLISHED: Final = "Pereira and Althoff, Online formal verification, III-B"
_BASE_TURNING: Final = Assumption(
    "people.arm_reach.base_turning", 0.1, "rad/s", _PUBLISHED, Certainty.SOURCED
)
_BASE_SPEED: Final = Assumption("people.arm_reach.base_speed", 2.0, "m/s", _PUBLISHED, Certainty.SOURCED)


class ArmReach:
    """Reachable occupancy of arms about their shoulders, for arms seen as a whole.

    Parameters
    ----------
    profile:
        Limits and sizes.
    face:
        ``"sound"``: follows from the profile. ``"as_published"``: the paper's steps, for comparison; it does
        not follow from the profile.
    held_object_m:
        How far an object in either hand reaches beyond it [m]; ``None``: not declared, 0.
    index:
        Number of this model in the rows that it writes.

    Raises
    ------
    ModelError
        If the profile has no limits of the arm, or a number is not finite or negative.
    """

    def __init__(
        self,
        profile: Profile,
        *,
        face: Literal["sound", "as_published"] = "sound",
        held_object_m: float | None = None,
        index: int = 0,
    ) -> None:
        if face not in ("sound", "as_published"):
            raise ModelError(f"arm_reach: face {face!r} must be 'sound' or 'as_published'")
        self.name = "arm_reach" if face == "sound" else "arm_reach_as_published"
        held = 0.0 if held_object_m is None else held_object_m
        if profile.arm is None:
            raise ModelError(f"{self.name}: profile {profile.name} has no limits of the arm")
        for limit, value in dataclasses.asdict(profile.arm).items():
            if not 0.0 <= value < math.inf:
                raise ModelError(f"{self.name}: arm.{limit} {value} must be finite and not negative")
        if not 0.0 <= held < math.inf:
            raise ModelError(f"{self.name}: held_object_m {held_object_m} must be finite and not negative")
        if not 0 <= index < MAX_MODELS:
            raise ModelError(f"{self.name}: index {index} must be 0 to {MAX_MODELS - 1}")
        self.index = index
        self.profile = profile
        self._published = face == "as_published"
        self._held_object_m = held_object_m
        self._table = _table(profile, profile.arm, held, index)
        self.proves = int(self._table["covers"].sum())

    def new_sets(self) -> Block:
        """Return an empty block for the rows of this model."""
        return new_reach_sets()

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        unused = () if self._published else _NOT_OF_THE_SOUND_FACE
        return (
            *(item for item in self.profile.assumptions if not item.name.endswith(unused)),
            *((_BASE_TURNING, _BASE_SPEED) if self._published else ()),
            held_object(self._held_object_m),
        )

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` (REACH_SETS) by the space that arms of ``people`` (PEOPLE) may fill on ``slices``.

        Rows are grouped by slice and hold over the whole slice, delays included. Never raises. An arm has no
        rows unless shoulder, elbow and wrist were seen at one instant (and, as published, a frame of the
        torso with them), or where what was seen contradicts the limits.
        """
        occupy_arms(people, slices, self._table, self._published, out)

    def belied(self, people: Block, row: int, samples: Samples, window: tuple[float, float]) -> Belied | None:
        """Return the first later arm that lies outside of its sector; of the published face, None."""
        if self._published:
            return None
        sample, side, excess = first_arm_outside(people, row, samples, window, self._table)
        return None if sample < 0 else Belied(sample, _ARMS[side][2], excess)

    def inferred_parts(self, present: int, t_obs: NDArray[np.float64] | None = None) -> int:
        """Return 0: arms that were not seen have no rows."""
        return 0


def extensions(profile: Profile, elbow: float) -> tuple[float, float]:
    """Return the least and greatest distance [m] of a forearm's middle from the shoulder.

    With the lengths a and b of upper arm and half a forearm and the cosine c of the greatest flexion
    ``elbow`` [rad] it is √(a² + b² + 2 a b c) at least. As a function of a and b that is convex, and 0 at a =
    b = 0 only, which no arm has: the least is on an edge of the admissible lengths, where it is at an end or
    at a = -b c or b = -a c.
    """
    sizes = {each.name: float(each.value) for each in profile.assumptions}
    place = f"people.{profile.name}"
    shortest, longest = sizes[f"{place}.stature.shortest"], sizes[f"{place}.stature.longest"]
    a, b = (
        (
            share * shortest * sizes[f"{place}.limb.{limb}.shortest"],
            share * longest * sizes[f"{place}.limb.{limb}.longest"],
        )
        for limb, share in (("upper_arm", 1.0), ("forearm", 0.5))
    )
    c = math.cos(min(elbow, math.pi))
    pairs = [(x, min(max(-x * c, b[0]), b[1])) for x in a] + [(min(max(-y * c, a[0]), a[1]), y) for y in b]
    return min(math.sqrt(max(0.0, x * x + y * y + 2.0 * x * y * c)) for x, y in pairs), a[1] + b[1]


def _table(profile: Profile, arm: ArmLimits, held: float, index: int) -> Block:
    """Return sizes and limits as the kernels take them."""
    table = np.zeros(1, dtype=ARMS)
    table["model"], table["speed_max"] = index, profile.speed.max()
    table["point"], table["trunk"] = _ARMS, _TRUNK
    for side, rows in enumerate(_PARTS):
        table["covers"][0, side] = [sum(1 << part for part in parts) for parts in rows]
    half = 0.5 * float(max(profile.chain[elbow, wrist] for _, elbow, wrist in _ARMS))
    flesh = [max(float(profile.radius[part]) for rows in _PARTS for part in rows[row]) for row in (0, 1)]
    table["radius"] = half + flesh[0], half + flesh[1] + held
    table["shoulder_speed"] = [profile.speed[shoulder] for shoulder, _, _ in _ARMS]
    shortest, longest = extensions(profile, arm.elbow)
    table["extension"] = shortest, longest
    table["speed"], table["acceleration"] = arm.relative_speed, arm.relative_acceleration
    table["angular_speed"], table["extension_speed"] = arm.angular_speed, arm.extension_speed
    table["low"] = -arm.extension, -min(arm.adduction, 0.5 * math.pi), shortest
    table["high"] = arm.flexion, min(arm.abduction, 0.5 * math.pi), longest
    table["rate"] = arm.angular_speed, arm.angular_speed, arm.extension_speed
    table["change"] = arm.angular_acceleration, arm.angular_acceleration, arm.extension_acceleration
    table["drift"], table["base_speed"] = _BASE_TURNING.value, _BASE_SPEED.value
    return table
