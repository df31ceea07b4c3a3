"""Limits of contact between link and body part: numbers with sources, and the speeds that follow from them.

A body region is a mass m_H behind a spring k that may be pressed with the force F_T while it is hit. A robot
of mass m_R that arrives at the relative speed v loads the spring with v √(k μ), μ = (1/m_H + 1/m_R)⁻¹, so
v ≤ F_T / √(k μ). Position-controlled, the robot counts as infinitely heavy: μ = m_H. (docs/method.md, section
5.)
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from occupancy.body import Part
from occupancy.number_table import NumberReader, ProfileError, Table, check_keys, sub_table
from robots.assumption import Assumption, Certainty

REGIONS: Final = (
    "skull", "face", "neck", "back_and_shoulders", "chest", "abdomen", "pelvis", "upper_arm", "lower_arm",
    "hand", "thigh", "lower_leg",
)  # fmt: skip
GAPS: Final = ("body", "head", "leg", "foot", "arm", "hand")

_UPPER_ARM = ("upper_arm", "back_and_shoulders")
_FOREARM = ("lower_arm", "upper_arm")
_HAND = ("hand", "lower_arm")
_THIGH = ("thigh", "pelvis")
_SHANK = ("lower_leg", "thigh")
REGIONS_OF: Final[dict[Part, tuple[str, ...]]] = {
    Part.HEAD: ("skull", "face"),
    Part.NECK: ("neck", "skull", "face"),
    Part.TORSO: ("chest", "back_and_shoulders", "abdomen", "pelvis", "neck"),
    Part.PELVIS: ("pelvis", "abdomen", "back_and_shoulders", "thigh"),
    Part.L_UPPER_ARM: _UPPER_ARM, Part.L_FOREARM: _FOREARM, Part.L_HAND: _HAND,
    Part.R_UPPER_ARM: _UPPER_ARM, Part.R_FOREARM: _FOREARM, Part.R_HAND: _HAND,
    Part.L_THIGH: _THIGH, Part.L_SHANK: _SHANK, Part.L_FOOT: (),
    Part.R_THIGH: _THIGH, Part.R_SHANK: _SHANK, Part.R_FOOT: (),
}  # fmt: skip
"""Every region of which a part may contain something: segments end in joints, and the neck's in the head.
No region is known for a foot."""
GAP_OF: Final[dict[Part, str]] = {
    Part.HEAD: "head", Part.NECK: "head", Part.TORSO: "body", Part.PELVIS: "body",
    Part.L_UPPER_ARM: "arm", Part.L_FOREARM: "arm", Part.L_HAND: "hand",
    Part.R_UPPER_ARM: "arm", Part.R_FOREARM: "arm", Part.R_HAND: "hand",
    Part.L_THIGH: "leg", Part.L_SHANK: "leg", Part.L_FOOT: "foot",
    Part.R_THIGH: "leg", Part.R_SHANK: "leg", Part.R_FOOT: "foot",
}  # fmt: skip
"""The least gap in which a part is not clamped; a hand needs more than its fingers do."""


@dataclass(frozen=True, eq=False)
class ContactLimits:
    """The numbers of one file, each with unit, source and certainty."""

    name: str
    title: str
    numbers: dict[str, Assumption]

    def speed(self, part: Part, robot_mass_kg: float = math.inf) -> float:
        """Greatest speed [m/s] at which a link may meet a part relative to it, of all its regions the least.

        ``-inf`` where a region may not be met by anything that moves, or none is known.
        """
        return min((self._region_speed(each, robot_mass_kg) for each in REGIONS_OF[part]), default=-math.inf)

    def _region_speed(self, region: str, robot_mass_kg: float) -> float:
        factor = self.numbers.get(f"region.{region}.transient_factor")
        if factor is None:
            return -math.inf
        force, stiffness, mass = (self._value(region, key) for key in ("force", "stiffness", "mass"))
        effective = 1.0 / (1.0 / mass + 1.0 / robot_mass_kg)
        return force * float(factor.value) / math.sqrt(stiffness * effective)

    def gap(self, part: Part) -> float:
        """Least gap [m] in which a part is not clamped."""
        return float(self.numbers[f"gap.{GAP_OF[part]}"].value)

    def used(self, parts: Iterable[Part]) -> tuple[Assumption, ...]:
        """Numbers that the speeds and gaps of some parts rest on."""
        places = {f"gap.{GAP_OF[part]}" for part in parts}
        regions = {f"region.{region}." for part in parts for region in REGIONS_OF[part]}
        return tuple(
            item
            for place, item in self.numbers.items()
            if place in places or any(place.startswith(region) for region in regions)
        )

    @property
    def unverified(self) -> bool:
        """Whether some number was not compared with its source."""
        return any(item.certainty is Certainty.UNVERIFIED for item in self.numbers.values())

    def _value(self, region: str, key: str) -> float:
        return float(self.numbers[f"region.{region}.{key}"].value)


def contact_limits_names() -> tuple[str, ...]:
    """Return the names of the bundled files."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def load_contact_limits(name_or_path: str | Path) -> ContactLimits:
    """Return bundled limits by name, or those of a TOML file by its path.

    Raises
    ------
    ProfileError
        There is no such file, a region, gap or number is missing or unknown, or a number is not finite and
        positive, has the wrong unit, no source or no known certainty.
    """
    path = name_or_path if isinstance(name_or_path, Path) else _FOLDER / f"{name_or_path}.toml"
    if not path.is_file():
        known = ", ".join(contact_limits_names())
        raise ProfileError(
            f"contact limits {name_or_path}: not found; there are {known}, or a file NAME.toml"
        )
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ProfileError(f"contact limits {path.name}: not readable as TOML: {error}") from error
    return _read(table, path.name)


_FOLDER = Path(__file__).parent / "contact"
_UNITS: Final = {"force": "N", "stiffness": "N/m", "mass": "kg", "transient_factor": "1"}


def _read(table: Table, file: str) -> ContactLimits:
    check_keys(table, file, "", required=("name", "title", "region", "gap"))
    name, title = table["name"], table["title"]
    if not (isinstance(name, str) and name and isinstance(title, str)):
        raise ProfileError(f"contact limits {file}: name and title must be texts")
    reader = NumberReader(file, f"contact.{name}", {})
    regions, gaps = sub_table(table, file, "region"), sub_table(table, file, "gap")
    check_keys(regions, file, "region", required=REGIONS)
    check_keys(gaps, file, "gap", required=GAPS)
    for region in REGIONS:
        numbers = sub_table(regions, file, region, "region")
        keys = ("force", "stiffness", "mass")
        check_keys(numbers, file, f"region.{region}", required=keys, optional=("transient_factor",))
        for key in numbers:
            reader.read({key: numbers[key]}, f"region.{region}", _UNITS[key])
    reader.read(gaps, "gap", "m")
    return ContactLimits(name, title, dict(reader.found))
