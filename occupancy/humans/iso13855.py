"""People who move no faster than ISO 13855 assumes (docs/method.md, section 4.1).

Every part is enclosed in a sphere-swept volume whose radius is body radius + e_p + v Δt (Pereira and Althoff,
Online formal verification, III-A). v is an approach speed, not a limit of limb speed.

For each part there is a list of *options*: rows of points from which it can be enclosed, shortest chain
first. A part that lies within ``radius`` of the segment from a to b lies, when m1 and m2 are known instead,
within max(d(m1, a), d(m2, b)) + radius of the segment from m1 to m2, with d the profile's longest distance
between points: every point of the segment ab is the same convex combination of a and b as some point of m1 m2
is of m1 and m2. Chain 0 is a measured part, everything else is *inferred*.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, MAX_PARTS, MAX_POINTS, Part, Point, Profile
from occupancy.humans.kernels import choose_rows, occupy_iso
from occupancy.sets import MAX_MODELS
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.motion import Block

_ROWS, _OPTIONS = 2048, 160
_TABLE = np.dtype(
    [
        ("model", np.int64),
        ("ageing", np.float64),
        ("speed", np.float64, (MAX_POINTS,)),
        ("speed_max", np.float64),
        ("n_options", np.int64, (MAX_PARTS,)),
        ("option", np.int64, (MAX_PARTS, _OPTIONS)),
        ("n_rows", np.int64),
        ("n_points", np.int64, (_ROWS,)),
        ("point", np.int64, (_ROWS, 4)),
        ("needs", np.int64, (_ROWS,)),
        ("chain", np.float64, (_ROWS,)),
        ("radius", np.float64, (_ROWS,)),
    ]
)
"""``option``: rows that enclose a part, shortest ``chain`` [m] first; a row has up to four points, ``needs``
them all, and has a ``radius`` [m] of body, held object and chain. ``ageing`` [m/s] weighs age against
chain."""

_AGEING_M_S = 2.0
"""Weighs the age of a point against chain lengths when a row is chosen [m/s]. Not the profile's speed: a
choice that depended on it could let a larger speed prove what a smaller one does not."""

_SEGMENTS: dict[Part, tuple[Point, Point]] = {
    Part.HEAD: (Point.HEAD, Point.HEAD),
    Part.NECK: (Point.NECK_BASE, Point.HEAD),
    Part.TORSO: (Point.PELVIS, Point.NECK_BASE),
    Part.PELVIS: (Point.PELVIS, Point.PELVIS),
    Part.L_UPPER_ARM: (Point.L_SHOULDER, Point.L_ELBOW),
    Part.L_FOREARM: (Point.L_ELBOW, Point.L_WRIST),
    Part.L_HAND: (Point.L_WRIST, Point.L_WRIST),
    Part.R_UPPER_ARM: (Point.R_SHOULDER, Point.R_ELBOW),
    Part.R_FOREARM: (Point.R_ELBOW, Point.R_WRIST),
    Part.R_HAND: (Point.R_WRIST, Point.R_WRIST),
    Part.L_THIGH: (Point.L_HIP, Point.L_KNEE),
    Part.L_SHANK: (Point.L_KNEE, Point.L_ANKLE),
    Part.L_FOOT: (Point.L_ANKLE, Point.L_ANKLE),
    Part.R_THIGH: (Point.R_HIP, Point.R_KNEE),
    Part.R_SHANK: (Point.R_KNEE, Point.R_ANKLE),
    Part.R_FOOT: (Point.R_ANKLE, Point.R_ANKLE),
}
"""The segment that each part lies around."""
_HANDS = {
    Part.L_HAND: (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    Part.R_HAND: (Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
}
_TRUNK = (Point.PELVIS, Point.THORAX, Point.NECK_BASE, Point.HEAD)


class ModelError(SetupError):
    """Settings that a human model cannot work with; the message names value and rule."""


class Iso13855:
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

    name = "iso13855"
    proves = ALL_PARTS
    rows_per_person = MAX_PARTS

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
        held = 0.0 if held_object_m is None else held_object_m
        if not 0.0 <= held < math.inf:
            raise ModelError(f"iso13855: held_object_m {held_object_m} must be finite and not negative")
        if not 0 <= index < MAX_MODELS:
            raise ModelError(f"iso13855: index {index} must be 0 to {MAX_MODELS - 1}")
        self.index = index
        self.profile = profile
        self._approach_speed = approach_speed
        self._held_object_m = held_object_m
        self._table = _table(profile, held, index)
        if approach_speed is not None:
            self._table["speed"] = self._table["speed_max"] = approach_speed

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        assumptions = list(self.profile.assumptions)
        if self._approach_speed is not None:
            place = f"people.{self.profile.name}.speed."
            assumptions = [a for a in assumptions if not a.name.startswith(place)]
            assumptions.append(
                Assumption(
                    f"{place}every_point",
                    self._approach_speed,
                    "m/s",
                    "stated by the user",
                    Certainty.DECLARED,
                )
            )
        if self._held_object_m is None:
            held = Assumption("people.held_object", 0.0, "m", "nothing declared", Certainty.DEFAULT)
        else:
            held = Assumption(
                "people.held_object", self._held_object_m, "m", "stated by the user", Certainty.DECLARED
            )
        return (*assumptions, held)

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` (PEOPLE_SETS) by the space that ``people`` (PEOPLE) may fill on each of ``slices``.

        Rows are grouped by slice and hold over the whole slice, delays included. A part that cannot be
        enclosed has no row. Never raises.
        """
        occupy_iso(people, slices, self._table, out)

    def inferred_parts(self, present: int, t_obs: NDArray[np.float64] | None = None) -> int:
        """Mask of the parts that have a row, but one inferred by chain lengths, when ``present`` are the
        points.

        ``t_obs`` (20,) [s] are their ages as in a row of the people block; ``None``: all the same.
        """
        picked, covers = np.zeros(MAX_PARTS, np.int64), np.zeros(MAX_PARTS, np.int64)
        times = np.zeros(MAX_POINTS) if t_obs is None else t_obs
        n = choose_rows(present, times, self._table[0], picked, covers)
        mask = 0
        for row, covered in zip(picked[:n], covers[:n], strict=True):
            if self._table["chain"][0, row] > 0.0:
                mask |= int(covered)
        return mask


_Option = tuple[float, tuple[Point, ...], float]
"""Chain [m], points, radius [m] of body and chain."""


def _table(profile: Profile, held: float, index: int) -> Block:
    """Return the options of every part as the kernel takes them."""
    table = np.zeros(1, dtype=_TABLE)
    table["model"], table["speed"] = index, profile.speed
    table["ageing"], table["speed_max"] = _AGEING_M_S, profile.speed.max()
    rows: dict[_Option, int] = {}
    for part in Part:
        options = _without_useless(list(_measured(part, profile, held)), list(_inferred(part, profile, held)))
        table["n_options"][0, part] = len(options)
        for place, option in enumerate(options):
            table["option"][0, part, place] = rows.setdefault(option, len(rows))
    for (chain, points, radius), row in rows.items():
        table["n_points"][0, row] = len(points)
        table["point"][0, row, : len(points)] = points
        table["needs"][0, row] = _mask(points)
        table["chain"][0, row], table["radius"][0, row] = chain, radius
    table["n_rows"] = len(rows)
    return table


def _measured(part: Part, profile: Profile, held: float) -> Iterator[_Option]:
    """Options with chain 0: the part's own points are measured."""
    radius = float(profile.radius[part])
    if part in _HANDS:
        for point in _HANDS[part]:
            yield 0.0, (point,), radius + held
        return
    if part in (Part.HEAD, Part.NECK, Part.TORSO, Part.PELVIS):
        for points in _trunk_hulls(part):
            yield 0.0, points, radius
        if part in (Part.NECK, Part.TORSO):
            return
    a, b = _SEGMENTS[part]
    yield 0.0, (a,) if a == b else (a, b), radius


def _trunk_hulls(part: Part) -> Iterator[tuple[Point, ...]]:
    """Hulls of two to four trunk points that contain a part of the trunk, those with most points first.

    Between two points the trunk lies within its radius of the segment between them, as Pereira and Althoff's
    capsule from head to pelvis has it.
    """
    for size in (4, 3, 2):
        for points in combinations(_TRUNK, size):
            ends = {Part.HEAD: (3, 3), Part.NECK: (2, 3), Part.TORSO: (0, 2), Part.PELVIS: (0, 0)}[part]
            places = [_TRUNK.index(point) for point in points]
            low = [place for place in places if place <= ends[0]]
            high = [place for place in places if place >= ends[1]]
            if low and high:
                yield points


def _inferred(part: Part, profile: Profile, held: float) -> Iterator[_Option]:
    """Options with a chain: from any point or pair of points."""
    a, b = _SEGMENTS[part]
    radius = float(profile.radius[part]) + (held if part in _HANDS else 0.0)
    for m1 in Point:
        for m2 in Point:
            if a == b and m1 != m2:
                continue
            chain = float(max(profile.chain[m1, a], profile.chain[m2, b]))
            if chain > 0.0:
                yield chain, (m1,) if m1 == m2 else (m1, m2), radius + chain


def _without_useless(measured: list[_Option], inferred: list[_Option]) -> list[_Option]:
    """Drop inferred options that need all points of an option with a shorter or equal chain."""
    kept = list(measured)
    needs = [_mask(points) for _, points, _ in measured]
    for option in sorted(inferred, key=lambda o: (o[0], len(o[1]), o[1])):
        lacking = ~_mask(option[1])
        if all(need & lacking for need in needs):
            kept.append(option)
            needs.append(~lacking)
    return kept


def _mask(points: tuple[Point, ...]) -> int:
    """Bit mask of points."""
    return sum(1 << point for point in points)
