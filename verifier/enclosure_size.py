"""Whether links are as long as no arm's: geometry in mm that is read as m; nothing is refused for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from robots.assumption import Certainty
from robots.catalog import fitted_parts, robot_names
from robots.enclosure import CERTAINTIES, EnclosedPart
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.shown import shown

LONG_M: Final = 5.0
"""Enclosures longer than this [m] are more likely of geometry in mm: a link of 5 mm would be no link."""
_TOOL: Final = "tool:"


class PartSize(NamedTuple):
    """Name of a link or tool, length of its capsule [m], and whether that was fitted, not declared."""

    name: str
    length_m: float
    fitted: bool


def sizes_of(robot: RobotModel) -> Iterator[PartSize]:
    """Yield the sizes of all capsules of a robot."""
    block, computed = robot.enclosure[0], CERTAINTIES.index(Certainty.COMPUTED)
    for i, name in enumerate(robot.links):
        axis = float(np.linalg.norm(block["b"][i] - block["a"][i]))
        length = axis + 2.0 * float(block["radius"][i])
        yield PartSize(name, length, int(block["certainty"][i]) == computed)


def too_long(sizes: Iterable[PartSize]) -> Iterator[str]:
    """Yield, in at most one line each, that links and that tools are as long as no arm's."""
    long = sorted((size for size in sizes if size.length_m > LONG_M), key=lambda size: -size.length_m)
    links = [size for size in long if not size.name.startswith((_TOOL, "payload:"))]
    tools = [size for size in long if size not in links]
    for found, fitted in (
        (links, 'are its meshes in mm? then write <mesh scale="0.001 0.001 0.001"/>'),
        (tools, "is its mesh in mm? a tool file has no scale: write the mesh in m"),
    ):
        if found:
            asked = fitted if found[0].fitted else "are its numbers in mm? they are read as m"
            length = f"its enclosure is {found[0].length_m:.3g} m long"
            yield f"{shown(found[0].name)}: {length}{_also(found[1:])}: {asked}"


def _also(others: Sequence[PartSize]) -> str:
    names = ", ".join(shown(size.name) for size in others)
    return f" (above {LONG_M:g} m as well: {names})" if others else ""


def remarks_on_urdf(robot: str, package_dirs: Sequence[Path] = ()) -> tuple[str, ...]:
    """Return what to look at in the URDF of a user's arm, whose limits need not be known yet."""
    if robot in robot_names():
        return ()
    try:
        parts = fitted_parts(robot, package_dirs)
    except SetupError as refused:
        return (f"verify would refuse this URDF: {refused}",)
    return tuple(too_long(map(_size, parts)))


def _size(part: EnclosedPart) -> PartSize:
    axis = float(np.linalg.norm(part.capsule.b - part.capsule.a))
    return PartSize(part.name, axis + 2.0 * part.capsule.radius, part.certainty is Certainty.COMPUTED)
