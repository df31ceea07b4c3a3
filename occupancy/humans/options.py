"""Models whose rows are hulls of a few measured points (docs/method.md, section 4.1).

Each part has a table of *options*: rows of points from which it can be enclosed. A part that lies within
``radius`` of the segment from a to b lies, when m1 and m2 are known instead, within max(d(m1, a), d(m2, b)) +
radius of the segment from m1 to m2, with d the profile's longest distance between points: every point of the
segment ab is the same convex combination of a and b as some point of m1 m2 is of m1 and m2. The *chain* of an
option is that distance: 0 for a measured part, everything else is *inferred*.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_PARTS, MAX_POINTS, Part, Point, Profile
from occupancy.humans.kernels import choose_rows, occupy_speed
from occupancy.humans.model import Belied, Samples
from occupancy.sets import MAX_MODELS, new_people_sets
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.motion import Block

_ROWS, _OPTIONS = 2048, 160
TABLE: Final = np.dtype(
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

SEGMENTS: Final[dict[Part, tuple[Point, Point]]] = {
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
HANDS: Final[dict[Part, tuple[Point, ...]]] = {
    Part.L_HAND: (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    Part.R_HAND: (Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
}
"""Points each of which, alone, has the whole hand within the hand's radius."""

_POINTS: Final = tuple(Point)

Option = tuple[float, tuple[Point, ...], float]
"""Chain [m], points, radius [m] of body and chain."""
PartOptions = Callable[[Part, Profile, float], Iterable[Option]]
"""Gives the options of a part from profile and reach of a held object [m]; none: it is not contained."""


class ModelError(SetupError):
    """Settings that a human model cannot work with; the message names value and rule."""


class OptionModel:
    """Reachable occupancy of people whose points keep to the speeds of a profile.

    Parameters
    ----------
    name:
        Stands in every witness.
    profile:
        Limits and sizes.
    options:
        How each part can be enclosed.
    held_object_m:
        How far an object in either hand reaches beyond it [m]; ``None``: not declared, 0.
    index:
        Number of this model in the rows that it writes.

    Raises
    ------
    ModelError
        If a number is not finite or negative.
    """

    rests_on: tuple[str, ...] = ("speed", "radius", "stature", "limit", "limb")
    """Tables of the profile whose numbers the rows depend on."""

    def __init__(
        self,
        name: str,
        profile: Profile,
        options: PartOptions,
        *,
        held_object_m: float | None = None,
        index: int = 0,
    ) -> None:
        held = 0.0 if held_object_m is None else held_object_m
        if not 0.0 <= held < math.inf:
            raise ModelError(f"{name}: held_object_m {held_object_m} must be finite and not negative")
        if not 0 <= index < MAX_MODELS:
            raise ModelError(f"{name}: index {index} must be 0 to {MAX_MODELS - 1}")
        self.name = name
        self.index = index
        self.profile = profile
        self._held_object_m = held_object_m
        self._table = _table(profile, {part: list(options(part, profile, held)) for part in Part}, index)
        self.proves = sum(1 << part for part in Part if self._table["n_options"][0, part])

    def new_sets(self) -> Block:
        """Return an empty block for the rows of this model."""
        return new_people_sets()

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        return (
            *(item for item in self.profile.assumptions if item.name.split(".")[2] in self.rests_on),
            held_object(self._held_object_m),
        )

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` (PEOPLE_SETS) by the space that ``people`` (PEOPLE) may fill on each of ``slices``.

        Rows are grouped by slice and hold over the whole slice, delays included. A part that cannot be
        enclosed has no row. Never raises.
        """
        occupy_speed(people, slices, self._table, out)

    def belied(self, people: Block, row: int, samples: Samples, window: tuple[float, float]) -> Belied | None:
        """Return None: nothing is assumed besides speeds and lengths."""
        return None

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


def held_object(held_m: float | None) -> Assumption:
    """Return how far a held object reaches beyond the hand [m], as an assumption; ``None``: not declared."""
    if held_m is None:
        return Assumption("people.held_object", 0.0, "m", "nothing declared", Certainty.DEFAULT)
    return Assumption("people.held_object", held_m, "m", "stated by the user", Certainty.DECLARED)


def _table(profile: Profile, by_part: dict[Part, list[Option]], index: int) -> Block:
    """Return the options of every part as the kernel takes them."""
    table = np.zeros(1, dtype=TABLE)
    table["model"], table["speed"] = index, profile.speed
    table["ageing"], table["speed_max"] = _AGEING_M_S, profile.speed.max()
    rows: dict[Option, int] = {}
    for part, options in by_part.items():
        kept = _without_useless(options)
        table["n_options"][0, part] = len(kept)
        for place, option in enumerate(kept):
            table["option"][0, part, place] = rows.setdefault(option, len(rows))
    for (chain, points, radius), row in rows.items():
        table["n_points"][0, row] = len(points)
        table["point"][0, row, : len(points)] = points
        table["needs"][0, row] = _mask(points)
        table["chain"][0, row], table["radius"][0, row] = chain, radius
    table["n_rows"] = len(rows)
    return table


def inferred(part: Part, profile: Profile, held: float) -> Iterable[Option]:
    """Yield the options with a chain: from any point or pair of points."""
    a, b = SEGMENTS[part]
    radius = float(profile.radius[part]) + (held if part in HANDS else 0.0)
    to_a, to_b = profile.chain[:, a].tolist(), profile.chain[:, b].tolist()
    for m1, from_m1 in zip(_POINTS, to_a, strict=True):
        for m2, from_m2 in zip(_POINTS, to_b, strict=True):
            if a == b and m1 is not m2:
                continue
            chain = max(from_m1, from_m2)
            if chain > 0.0:
                yield chain, (m1,) if m1 is m2 else (m1, m2), radius + chain


def _without_useless(options: list[Option]) -> list[Option]:
    """Sort by chain, and drop inferred options that need all points of one with a shorter or equal chain."""
    kept = [option for option in options if option[0] == 0.0]
    needs = {_mask(points) for _, points, _ in kept}
    for option in sorted((o for o in options if o[0] > 0.0), key=lambda o: (o[0], len(o[1]), o[1])):
        masks = _masks_within(option[1])
        if needs.isdisjoint(masks):
            kept.append(option)
            needs.add(masks[-1])
    return kept


def _masks_within(points: tuple[Point, ...]) -> list[int]:
    """Bit masks of some of the points, those of all of them last."""
    masks = [0]
    for point in points:
        masks += [mask | 1 << point for mask in masks]
    return masks[1:]


def _mask(points: tuple[Point, ...]) -> int:
    """Bit mask of points."""
    return sum(1 << point for point in points)
