"""The human body as this software sees it: measured points, canonical parts, profiles of its limits."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.number_table import NumberReader, ProfileError, Table, check_keys, sub_table
from robots.assumption import Assumption, Certainty
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
        ("acceleration", np.float64, (MAX_POINTS,)),
        ("chain", np.float64, (MAX_POINTS, MAX_POINTS)),
    ]
)
"""A profile as kernels read it. ``limb``: pairs of points with the distances [m] that no person leaves;
``speed`` [m/s] and ``acceleration`` [m/s²] of each point, inf: not limited; ``chain`` [m]: longest distances
between any two points that the profile assumes; parts that are not measured are inferred by them, and data
are held against them."""


@dataclass(frozen=True)
class ArmLimits:
    """Limits of the arm's three degrees of freedom about the shoulder (docs/method.md, section 4.2).

    The middle of the forearm is at the distance r (*extension*) from the shoulder, in a direction given by
    two angles: azimuth q1 about an axis, and elevation q2 from the plane across it.

    Attributes
    ----------
    flexion, extension, abduction, adduction:
        How far the upper arm turns from hanging down: forward, backward, outward, and across the body [rad].
    elbow:
        Greatest flexion of the elbow [rad]: bounds how near the forearm comes to the shoulder.
    angular_speed, angular_acceleration:
        Of the direction, in a frame that does not turn [rad/s, rad/s²].
    extension_speed, extension_acceleration:
        Of the distance [m/s, m/s²].
    relative_speed, relative_acceleration:
        Of the middle of the forearm relative to the shoulder [m/s, m/s²].
    torso_rate:
        Angular speed of the torso [rad/s].
    """

    flexion: float
    extension: float
    abduction: float
    adduction: float
    elbow: float
    angular_speed: float
    angular_acceleration: float
    extension_speed: float
    extension_acceleration: float
    relative_speed: float
    relative_acceleration: float
    torso_rate: float


ARM_UNITS: dict[str, str] = {
    "flexion": "rad",
    "extension": "rad",
    "abduction": "rad",
    "adduction": "rad",
    "elbow": "rad",
    "angular_speed": "rad/s",
    "angular_acceleration": "rad/s²",
    "extension_speed": "m/s",
    "extension_acceleration": "m/s²",
    "relative_speed": "m/s",
    "relative_acceleration": "m/s²",
    "torso_rate": "rad/s",
}
"""Keys and units of the table ``arm`` of a profile."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Limits within which every person's body moves (assumption A1 of docs/method.md, section 1).

    Attributes
    ----------
    name, title:
        Key and description.
    models:
        Names of the models of people that follow from this profile.
    speed:
        (20,) m/s, greatest speed of each :class:`Point`.
    acceleration:
        (20,) m/s², greatest acceleration of each; inf: the profile does not limit it.
    radius:
        (16,) m, how far the flesh of each :class:`Part` reaches from the segment between its points.
    chain:
        (20, 20) m, greatest distance between two points of one person: shortest path over the longest
        limbs; 0 on the diagonal.
    limits:
        BODY block for the gate: limb lengths outside of which a reading is not a person, and chains beyond
        which a person contradicts A1.
    assumptions:
        Every number with unit, source and certainty.
    arm:
        Limits of the arm about the shoulder; ``None``: the profile has none.
    selectable_speeds:
        Further sourced speeds that :meth:`with_speed` knows.
    """

    name: str
    title: str
    models: tuple[str, ...]
    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    radius: NDArray[np.float64]
    chain: NDArray[np.float64]
    limits: Block
    arm: ArmLimits | None
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
        has the wrong unit, no source or no known certainty, or a file bears the name of a bundled profile.
    """
    path = name_or_path if isinstance(name_or_path, Path) else _PROFILES / f"{name_or_path}.toml"
    if not path.is_file():
        raise ProfileError(f"profile {name_or_path}: not found; there are {', '.join(profile_names())}")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ProfileError(f"profile {path.name}: not readable as TOML: {error}") from error
    profile = _profile_from(table, path.name)
    if path.parent != _PROFILES and profile.name in profile_names():
        raise ProfileError(
            f"profile {path.name}: name {profile.name!r} is that of a bundled profile; give it another, "
            "for results show it"
        )
    return profile


_PROFILES = Path(__file__).parent / "profiles"
_TABLES = ("speed", "radius", "stature", "limit", "limb")
_OPTIONAL = ("acceleration", "arm", "selectable_speed")


def _profile_from(table: Table, file: str) -> Profile:
    """Check a parsed profile file and return its profile."""
    check_keys(table, file, "", required=("name", "title", "models", *_TABLES), optional=_OPTIONAL)
    name, title, models = table["name"], table["title"], table["models"]
    if not (isinstance(name, str) and name and isinstance(title, str)):
        raise ProfileError(f"profile {file}: name and title must be texts")
    if not (isinstance(models, list) and models and all(isinstance(each, str) for each in models)):
        raise ProfileError(f"profile {file}: models must be a list of names")
    reader = NumberReader(file, f"people.{name}", {})
    for key, unit in (("speed", "m/s"), ("acceleration", "m/s²")):
        if key in table:
            check_keys(
                sub_table(table, file, key), file, key, required=("every_point",), optional=POINT_NAMES
            )
            reader.read(sub_table(table, file, key), key, unit)
    if "arm" in table:
        arm = sub_table(table, file, "arm")
        check_keys(arm, file, "arm", required=tuple(ARM_UNITS))
        for key, unit in ARM_UNITS.items():
            reader.read({key: arm[key]}, "arm", unit)
    for key, wanted in (("radius", tuple(RADII)), ("stature", _ENDS), ("limit", _FACTORS)):
        check_keys(sub_table(table, file, key), file, key, required=wanted)
        reader.read(sub_table(table, file, key), key, "1" if key == "limit" else "m")
    limbs = sub_table(table, file, "limb")
    check_keys(limbs, file, "limb", required=tuple(LIMBS))
    for limb in LIMBS:
        check_keys(sub_table(limbs, file, limb), file, f"limb.{limb}", required=_ENDS)
        reader.read(sub_table(limbs, file, limb), f"limb.{limb}", "stature")
    selectable = NumberReader(file, f"people.{name}", {})
    if "selectable_speed" in table:
        selectable.read(sub_table(table, file, "selectable_speed"), "selectable_speed", "m/s")
    return _assemble((name, title, tuple(models)), reader, tuple(selectable.found.values()))


def _assemble(
    head: tuple[str, str, tuple[str, ...]], reader: NumberReader, selectable: tuple[Assumption, ...]
) -> Profile:
    """Compute the tables of a profile from its checked numbers; ``head``: name, title and models."""
    name, title, models = head
    speed, acceleration = _of_points(reader, "speed"), _of_points(reader, "acceleration")
    arm = None
    if "arm.extension" in reader.found:
        arm = ArmLimits(**{key: reader.value(f"arm.{key}") for key in ARM_UNITS})
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
    limits["n_limbs"], limits["speed"], limits["acceleration"] = row, speed, acceleration
    limits["chain"] = chain
    return Profile(
        name=name,
        title=title,
        models=models,
        speed=speed,
        acceleration=acceleration,
        radius=radius,
        chain=chain,
        limits=limits,
        arm=arm,
        assumptions=tuple(reader.found.values()),
        selectable_speeds=selectable,
    )


_ENDS = ("shortest", "longest")
_FACTORS = ("shortest_factor", "longest_factor")


def _of_points(reader: NumberReader, key: str) -> NDArray[np.float64]:
    """Return the numbers (20,) of a table of points; inf where there is no such table."""
    if f"{key}.every_point" not in reader.found:
        return np.full(MAX_POINTS, np.inf)
    every = reader.value(f"{key}.every_point")
    places = (f"{key}.{point.name.lower()}" for point in Point)
    return np.array([reader.value(place) if place in reader.found else every for place in places])
