"""How fast a link may be that touches a body part, and how wide gaps must be, for the brute-force checker.

The numbers are read from the file of limits by hand. A region is a mass behind a spring. What the robot
brings along relative to the person, ½ μ v² with the reduced mass μ of both, is in the spring, F²/2k, when
that is loaded most; so F stays below its limit if v is at most F / √(k μ).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REGIONS: dict[str, tuple[str, ...]] = {
    "head": ("skull", "face"),
    "neck": ("neck", "skull", "face"),
    "torso": ("chest", "back_and_shoulders", "abdomen", "pelvis", "neck"),
    "pelvis": ("pelvis", "abdomen", "back_and_shoulders", "thigh"),
    "upper_arm": ("upper_arm", "back_and_shoulders"),
    "forearm": ("lower_arm", "upper_arm"),
    "hand": ("hand", "lower_arm"),
    "thigh": ("thigh", "pelvis"),
    "shank": ("lower_leg", "thigh"),
    "foot": (),
}
"""Which regions a part may contain; of a foot none is known."""
GAPS = {
    "head": "head", "neck": "head", "torso": "body", "pelvis": "body", "upper_arm": "arm", "forearm": "arm",
    "hand": "hand", "thigh": "leg", "shank": "leg", "foot": "foot",
}  # fmt: skip


@dataclass(frozen=True)
class Rule:
    """Links and parts, by name, that may touch.

    ``person_speed`` [m/s]: how fast the part itself may come; ``robot_mass`` [kg]: what arrives.
    """

    links: tuple[str, ...]
    parts: tuple[str, ...]
    person_speed: float = 0.0
    robot_mass: float = math.inf


class Limits:
    """The numbers of one file."""

    def __init__(self, path: Path) -> None:
        table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        self._regions, self._gaps = table["region"], table["gap"]

    def gap(self, part: str) -> float:
        """Least gap [m] in which a part is not clamped."""
        return float(self._gaps[GAPS[either_side(part)]]["value"])

    def speed(self, part: str, robot_mass: float = math.inf) -> float:
        """Greatest speed [m/s] of a link relative to a part that it touches; 0 where nothing may move."""
        regions = REGIONS[either_side(part)]
        return min((self._speed_at(self._regions[name], robot_mass) for name in regions), default=0.0)

    def _speed_at(self, region: dict[str, Any], robot_mass: float) -> float:
        if "transient_factor" not in region:
            return 0.0
        force = region["force"]["value"] * region["transient_factor"]["value"]
        mass, stiffness = region["mass"]["value"], region["stiffness"]["value"]
        reduced = mass if math.isinf(robot_mass) else mass * robot_mass / (mass + robot_mass)
        energy = force**2 / (2.0 * stiffness)
        return math.sqrt(2.0 * energy / reduced)

    def allowed(
        self, rules: Sequence[Rule], links: Sequence[str], parts: Sequence[str], standstill: float
    ) -> dict[str, Array]:
        """How fast (L,) [m/s] each of ``links`` may be that touches each of ``parts``.

        Nobody minds a touch below ``standstill``; what no rule names must not move faster. Where several
        rules name a pair, the least holds.
        """
        found = {}
        for part in parts:
            speeds = np.zeros(len(links))
            for index, link in enumerate(links):
                stated = [
                    self.speed(part, rule.robot_mass) - rule.person_speed
                    for rule in rules
                    if part in rule.parts and link in rule.links
                ]
                speeds[index] = min(stated, default=0.0)
            found[part] = np.maximum(speeds, standstill)
        return found


def either_side(part: str) -> str:
    """The part without the side of the body that it is on."""
    return part.removeprefix("l_").removeprefix("r_")
