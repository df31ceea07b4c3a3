"""The human body as this software sees it: measured points, canonical parts, profiles of its limits."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.motion import Block

MAX_POINTS = 20
MAX_PARTS = 16


class Point(IntEnum):
    """Body points that a measurement may report; the value is the column in the people block."""

    HEAD = 0
    NECK_BASE = 1
    THORAX = 2
    PELVIS = 3
    L_SHOULDER = 4
    L_ELBOW = 5
    L_WRIST = 6
    L_HAND = 7
    L_FINGERTIP = 8
    R_SHOULDER = 9
    R_ELBOW = 10
    R_WRIST = 11
    R_HAND = 12
    R_FINGERTIP = 13
    L_HIP = 14
    L_KNEE = 15
    L_ANKLE = 16
    R_HIP = 17
    R_KNEE = 18
    R_ANKLE = 19


class Part(IntEnum):
    """Canonical body parts; the value is the bit in a part mask."""

    HEAD = 0
    NECK = 1
    TORSO = 2
    PELVIS = 3
    L_UPPER_ARM = 4
    L_FOREARM = 5
    L_HAND = 6
    R_UPPER_ARM = 7
    R_FOREARM = 8
    R_HAND = 9
    L_THIGH = 10
    L_SHANK = 11
    L_FOOT = 12
    R_THIGH = 13
    R_SHANK = 14
    R_FOOT = 15


POINT_NAMES: tuple[str, ...] = tuple(point.name.lower() for point in Point)
PART_NAMES: tuple[str, ...] = tuple(part.name.lower() for part in Part)
ALL_PARTS: int = (1 << len(Part)) - 1


class ProfileError(SetupError):
    """A profile file that cannot be used; the message names file, key, value and rule."""


LIMBS: dict[str, tuple[tuple[Point, Point], ...]] = {
    "upper_arm": ((Point.L_SHOULDER, Point.L_ELBOW), (Point.R_SHOULDER, Point.R_ELBOW)),
    "forearm": ((Point.L_ELBOW, Point.L_WRIST), (Point.R_ELBOW, Point.R_WRIST)),
    "hand": ((Point.L_WRIST, Point.L_FINGERTIP), (Point.R_WRIST, Point.R_FINGERTIP)),
    "palm": ((Point.L_WRIST, Point.L_HAND), (Point.R_WRIST, Point.R_HAND)),
    "fingers": ((Point.L_HAND, Point.L_FINGERTIP), (Point.R_HAND, Point.R_FINGERTIP)),
    "thigh": ((Point.L_HIP, Point.L_KNEE), (Point.R_HIP, Point.R_KNEE)),
    "shank": ((Point.L_KNEE, Point.L_ANKLE), (Point.R_KNEE, Point.R_ANKLE)),
    "neck": ((Point.NECK_BASE, Point.HEAD),),
    "trunk": ((Point.PELVIS, Point.NECK_BASE),),
    "lower_trunk": ((Point.PELVIS, Point.THORAX),),
    "upper_trunk": ((Point.THORAX, Point.NECK_BASE),),
    "clavicle": ((Point.NECK_BASE, Point.L_SHOULDER), (Point.NECK_BASE, Point.R_SHOULDER)),
    "hip": ((Point.PELVIS, Point.L_HIP), (Point.PELVIS, Point.R_HIP)),
}
"""The skeleton graph: name of a limb -> the pairs of neighbouring points whose distance it bounds."""

RADII: dict[str, tuple[Part, ...]] = {
    "torso_head": (Part.HEAD, Part.NECK, Part.TORSO, Part.PELVIS),
    "arm": (Part.L_UPPER_ARM, Part.L_FOREARM, Part.R_UPPER_ARM, Part.R_FOREARM),
    "hand": (Part.L_HAND, Part.R_HAND),
    "leg": (Part.L_THIGH, Part.L_SHANK, Part.R_THIGH, Part.R_SHANK),
    "foot": (Part.L_FOOT, Part.R_FOOT),
}
"""Name of a body radius -> the parts that it belongs to."""

MAX_LIMBS = 32

BODY = np.dtype(
    [
        ("n_limbs", np.int64),
        ("limb", np.int64, (MAX_LIMBS, 2)),
        ("limb_min", np.float64, (MAX_LIMBS,)),
        ("limb_max", np.float64, (MAX_LIMBS,)),
        ("speed", np.float64, (MAX_POINTS,)),
        ("chain", np.float64, (MAX_POINTS, MAX_POINTS)),
        ("reach", np.float64, (MAX_POINTS, MAX_POINTS)),
    ]
)
"""A profile as kernels read it. ``limb``: pairs of points with the distances [m] that no person leaves;
``speed`` [m/s] of each point; ``chain`` [m]: longest distances between any two points that the profile
assumes, by which parts that are not measured are inferred; ``reach`` [m]: distances that no person
exceeds."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Limits within which every person's body moves (assumption A1 of docs/method.md, section 1).

    Attributes
    ----------
    name, title:
        Key and description.
    speed:
        (20,) m/s, greatest speed of each :class:`Point`.
    radius:
        (16,) m, how far the flesh of each :class:`Part` reaches from the segment between its points.
    chain:
        (20, 20) m, greatest distance between two points of one person: shortest path over the longest
        limbs; 0 on the diagonal.
    limits:
        BODY block for the gate: limb lengths and reaches outside of which a reading is not a person.
    assumptions:
        Every number with unit, source and certainty.
    selectable_speeds:
        Further sourced speeds that :meth:`with_speed` knows.
    """

    name: str
    title: str
    speed: NDArray[np.float64]
    radius: NDArray[np.float64]
    chain: NDArray[np.float64]
    limits: Block
    assumptions: tuple[Assumption, ...]
    selectable_speeds: tuple[Assumption, ...]

    def with_speed(self, speed: float) -> Profile:
        """Return this profile with the speed [m/s] of every point replaced.

        Raises
        ------
        ProfileError
            If the speed is not a positive finite number.
        """
        if not (math.isfinite(speed) and speed > 0.0):
            raise ProfileError(f"profile {self.name}: speed {speed} m/s must be positive and finite")
        name = f"people.{self.name}.speed.every_point"
        known = [a for a in self.selectable_speeds if a.value == speed]
        chosen = (
            replace(known[0], name=name)
            if known
            else Assumption(
                name, speed, "m/s", f"stated in place of profile {self.name}'s", Certainty.DECLARED
            )
        )
        others = tuple(a for a in self.assumptions if not a.name.startswith(f"people.{self.name}.speed."))
        limits = self.limits.copy()
        limits["speed"] = speed
        speeds = np.full(MAX_POINTS, speed)
        return replace(self, speed=speeds, limits=limits, assumptions=(chosen, *others))


def profile_names() -> tuple[str, ...]:
    """Return the names of the bundled profiles."""
    return tuple(sorted(path.stem for path in _PROFILES.glob("*.toml")))


def load_profile(name_or_path: str | Path) -> Profile:
    """Return a bundled profile by its name, or the profile of a TOML file by its path.

    Raises
    ------
    ProfileError
        If there is no such profile, a key is missing or unknown, or a number is not finite and positive,
        has the wrong unit, no source or no known certainty.
    """
    path = name_or_path if isinstance(name_or_path, Path) else _PROFILES / f"{name_or_path}.toml"
    if not path.is_file():
        raise ProfileError(f"profile {name_or_path}: not found; there are {', '.join(profile_names())}")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ProfileError(f"profile {path.name}: not readable as TOML: {error}") from error
    return _profile_from(table, path.name)


_PROFILES = Path(__file__).parent / "profiles"
_TABLES = ("speed", "radius", "stature", "limit", "limb")
_Table = dict[str, object]


def _profile_from(table: _Table, file: str) -> Profile:
    """Check a parsed profile file and return its profile."""
    _keys(table, file, "", required=("name", "title", *_TABLES), optional=("selectable_speed",))
    name, title = table["name"], table["title"]
    if not (isinstance(name, str) and name and isinstance(title, str)):
        raise ProfileError(f"profile {file}: name and title must be texts")
    reader = _Reader(file, f"people.{name}", {})
    _keys(_sub(table, file, "speed"), file, "speed", required=("every_point",), optional=POINT_NAMES)
    reader.read(_sub(table, file, "speed"), "speed", "m/s")
    for key, wanted in (("radius", tuple(RADII)), ("stature", _ENDS), ("limit", _FACTORS)):
        _keys(_sub(table, file, key), file, key, required=wanted)
        reader.read(_sub(table, file, key), key, "1" if key == "limit" else "m")
    limbs = _sub(table, file, "limb")
    _keys(limbs, file, "limb", required=tuple(LIMBS))
    for limb in LIMBS:
        _keys(_sub(limbs, file, limb), file, f"limb.{limb}", required=_ENDS)
        reader.read(_sub(limbs, file, limb), f"limb.{limb}", "stature")
    selectable = _Reader(file, f"people.{name}", {})
    if "selectable_speed" in table:
        selectable.read(_sub(table, file, "selectable_speed"), "selectable_speed", "m/s")
    return _assemble(name, title, reader, tuple(selectable.found.values()))


def _assemble(name: str, title: str, reader: _Reader, selectable: tuple[Assumption, ...]) -> Profile:
    """Compute the tables of a profile from its checked numbers."""
    speed = np.full(MAX_POINTS, reader.value("speed.every_point"))
    for point in Point:
        if f"speed.{point.name.lower()}" in reader.found:
            speed[point] = reader.value(f"speed.{point.name.lower()}")
    radius = np.zeros(MAX_PARTS)
    for key, parts in RADII.items():
        radius[list(parts)] = reader.value(f"radius.{key}")
    shortest, longest = (reader.value(f"stature.{end}") for end in _ENDS)
    low, high = (reader.value(f"limit.{factor}") for factor in _FACTORS)
    limits = np.zeros(1, dtype=BODY)
    chain = np.full((MAX_POINTS, MAX_POINTS), np.inf)
    np.fill_diagonal(chain, 0.0)
    row = 0
    for limb, pairs in LIMBS.items():
        least = shortest * reader.value(f"limb.{limb}.shortest")
        most = longest * reader.value(f"limb.{limb}.longest")
        if not low * least <= high * most:
            raise ProfileError(
                f"profile {reader.file}: limb.{limb}: shortest {least:.4g} m above longest {most:.4g} m"
            )
        for a, b in pairs:
            chain[a, b] = chain[b, a] = most
            limits["limb"][0, row] = a, b
            limits["limb_min"][0, row], limits["limb_max"][0, row] = low * least, high * most
            row += 1
    for via in range(MAX_POINTS):
        chain = np.minimum(chain, chain[:, via, None] + chain[None, via, :])
    limits["n_limbs"], limits["speed"] = row, speed
    limits["chain"], limits["reach"] = chain, high * chain
    return Profile(
        name=name,
        title=title,
        speed=speed,
        radius=radius,
        chain=chain,
        limits=limits,
        assumptions=tuple(reader.found.values()),
        selectable_speeds=selectable,
    )


_ENDS = ("shortest", "longest")
_FACTORS = ("shortest_factor", "longest_factor")
_NUMBER = ("value", "unit", "source", "certainty")
_MAY_BE_ZERO = ".shortest"


@dataclass(frozen=True)
class _Reader:
    """Reads tables of numbers into assumptions, refusing what is not a number with unit and source."""

    file: str
    prefix: str
    found: dict[str, Assumption]

    def read(self, table: _Table, place: str, unit: str) -> None:
        """Read every number of a table whose numbers all have one unit."""
        for key in table:
            self._read_number(_sub(table, self.file, key, place), f"{place}.{key}", unit)

    def value(self, place: str) -> float:
        """Return a number that was read."""
        return float(self.found[place].value)

    def _read_number(self, number: _Table, place: str, unit: str) -> None:
        where = f"profile {self.file}: {place}"
        _keys(number, self.file, place, required=_NUMBER)
        value, source, certainty = number["value"], number["source"], number["certainty"]
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ProfileError(f"{where}: value {value!r} must be a finite number")
        if value < 0.0 or (value == 0.0 and not place.endswith(_MAY_BE_ZERO)):
            raise ProfileError(f"{where}: value {value!r} must be positive")
        if number["unit"] != unit:
            raise ProfileError(f"{where}: unit {number['unit']!r} must be {unit!r}")
        if not (isinstance(source, str) and source.strip()):
            raise ProfileError(f"{where}: source must say where the value comes from")
        if certainty not in list(Certainty):
            raise ProfileError(f"{where}: certainty {certainty!r} must be one of {', '.join(Certainty)}")
        name = f"{self.prefix}.{place}"
        self.found[place] = Assumption(name, float(value), unit, source, Certainty(str(certainty)))


def _sub(table: _Table, file: str, key: str, place: str = "") -> _Table:
    """Return a table within a table."""
    value = table[key]
    if not isinstance(value, dict):
        raise ProfileError(f"profile {file}: {place + '.' if place else ''}{key} must be a table")
    return value


def _keys(
    table: _Table, file: str, place: str, *, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> None:
    """Refuse a table with missing or unknown keys."""
    where = f"profile {file}: {place or 'file'}"
    missing = [key for key in required if key not in table]
    if missing:
        raise ProfileError(f"{where}: missing {', '.join(missing)}")
    unknown = [key for key in table if key not in required and key not in optional]
    if unknown:
        raise ProfileError(
            f"{where}: unknown key {', '.join(unknown)}; known are {', '.join(required + optional)}"
        )
