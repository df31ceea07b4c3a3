"""Circles and lines beyond which people may be, put into a cell: watched by a scanner, or fenced."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from robots.errors import SetupError
from verifier.cell import Cell
from verifier.cell_tables import FixtureTable, MonitoredTable

CORNERS = 24
"""Of the polygon within a circle: people may come into what lies between."""
AWAY_M = 50.0
"""How far a region reaches where nobody comes from: above, below, behind [m]."""

Corner = tuple[float, float]


class Barrier(StrEnum):
    """What keeps people where they are."""

    SCANNER = "scanner"
    """Nothing: whoever comes over the line is reported."""
    FENCE = "fence"
    """People stay behind it, and do not reach through or over it; the arm must not touch it."""


@dataclass(frozen=True, slots=True)
class Boundary:
    """A circle around the base of a robot, or a line beside it.

    Attributes
    ----------
    base_m:
        Place of the base in the world (3,) [m].
    distance_m:
        From the base [m], above 0.
    angle_deg:
        Direction from the base to the line, about z from the world's x axis [deg]; ``None``: a circle.
    """

    base_m: tuple[float, float, float]
    distance_m: float
    angle_deg: float | None

    @property
    def polygon(self) -> tuple[Corner, ...]:
        """Corners [m] of the region that people must not be in.

        A circle is replaced by a polygon within it, so that people may be wherever they may be outside of the
        circle; a line by the half-plane on the base's side, as far as it matters.
        """
        x, y, _ = self.base_m
        if self.angle_deg is None:
            turns = 2.0 * math.pi * np.arange(CORNERS) / CORNERS
            r = self.distance_m
            return tuple((x + r * math.cos(each), y + r * math.sin(each)) for each in turns)
        angle = math.radians(self.angle_deg)
        along, across = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
        places = (
            (self.distance_m, -AWAY_M), (self.distance_m, AWAY_M), (-AWAY_M, AWAY_M), (-AWAY_M, -AWAY_M),
        )  # fmt: skip
        return tuple((x + u * along[0] + v * across[0], y + u * along[1] + v * across[1]) for u, v in places)

    def planes(self) -> Iterator[FixtureTable]:
        """Yield the planes that close the polygon of a circle, or the one of a line."""
        x, y, z = self.base_m
        if self.angle_deg is None:
            middles = 2.0 * math.pi * (np.arange(CORNERS) + 0.5) / CORNERS
            away = self.distance_m * math.cos(math.pi / CORNERS)
        else:
            middles, away = np.array([math.radians(self.angle_deg)]), self.distance_m
        for angle in middles.tolist():
            u, v = math.cos(angle), math.sin(angle)
            yield FixtureTable(kind="plane", point_m=(x + away * u, y + away * v, z), normal=(-u, -v, 0.0))


def with_scanner(cell: Cell, boundary: Boundary, detection_time_s: float) -> Cell:
    """Return the cell with a region in which everybody is reported; people may come in from beyond."""
    z = boundary.base_m[2]
    table = MonitoredTable(
        kind="prism",
        detection_time_s=detection_time_s,
        polygon_m=boundary.polygon,
        z_m=(z - AWAY_M, z + AWAY_M),
    )
    people = cell.people.model_copy(update={"monitored": {"line": table}})
    return cell.model_copy(update={"people": people})


def with_fence(cell: Cell, boundary: Boundary) -> Cell:
    """Return the cell with a fence that no link may touch, and nobody who comes in.

    Raises
    ------
    SetupError
        A fixture of the cell already has the name of a plane of the fence.
    """
    planes = {f"fence {number}": plane for number, plane in enumerate(boundary.planes(), 1)}
    taken = sorted(planes.keys() & cell.workspace.fixtures.keys())
    if taken:
        raise SetupError(
            f"{cell.where}: workspace.fixtures: {taken[0]!r} is kept for --barrier fence: rename it"
        )
    fixtures = {**cell.workspace.fixtures, **planes}
    workspace = cell.workspace.model_copy(update={"fixtures": fixtures})
    people = cell.people.model_copy(update={"monitored": {}})
    return cell.model_copy(update={"people": people, "workspace": workspace})
