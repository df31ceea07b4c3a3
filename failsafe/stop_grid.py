"""Stops at 33, 66 and 100 % of extension, speed and load, as makers state them (ISO 10218-1:2011, Annex B).

Extension is the largest distance of a point of the arm from the first axis, as a share of the largest one
possible; 33 % means: no point farther than that when the stop begins. Speed is the share of every joint's
velocity limit, load that of the payload. The axes of a maker's table are three; here every joint is a row.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from failsafe.bracket import Bracket
from failsafe.stopping import ArmSearch, StopModel
from robots.errors import SetupError

SHARES = (0.33, 0.66, 1.0)


@dataclass(frozen=True, eq=False)
class GridCell:
    """Brackets at shares of extension, speed and load; ``extension_m``: no point farther [m] (inf: any)."""

    extension: float
    speed: float
    load: float
    extension_m: float
    brackets: tuple[Bracket, ...]


@dataclass(frozen=True, eq=False)
class StopGrid:
    """Cells of one stop model in the order load, speed, extension; ``largest_extension``: a bracket [m].

    ``load_matters``: whether cells differ by load. ``complete``: false where the work was ended early, and
    cells are missing.
    """

    stop: str
    largest_extension: Bracket
    load_matters: bool
    cells: tuple[GridCell, ...]
    complete: bool

    def at(self, extension: float, speed: float, load: float) -> GridCell:
        """Return a cell.

        Raises
        ------
        SetupError
            There is no such cell.
        """
        for cell in self.cells:
            if (cell.extension, cell.speed, cell.load) == (extension, speed, load):
                return cell
        raise SetupError(f"stop grid: no cell at extension {extension:g}, speed {speed:g}, load {load:g}")


def stop_grid(
    arm: ArmSearch,
    stop_at: Callable[[float, float], StopModel],
    *,
    load_matters: bool,
    shares: tuple[float, ...] = SHARES,
) -> StopGrid:
    """Bracket every cell; ``stop_at(speed, load)`` makes the stop model of two shares.

    Where the load does not matter, cells of all loads share their brackets. What has been reached at an
    interrupt is returned.

    Raises
    ------
    SetupError
        A share that is not above 0 and at most 1; whatever ``stop_at`` refuses.
    """
    for share in shares:
        if not 0.0 < share <= 1.0:
            raise SetupError(f"stop grid: share {share:g} must be above 0 and at most 1")
    extent = arm.largest_extension()
    largest = Bracket(
        "largest extension", arm.links[extent.point] if extent.point >= 0 else "none found", "m",
        extent.best, extent.bound, None, f"branch and bound, {extent.boxes} boxes", extent.ended,
        seconds=extent.seconds,
    )  # fmt: skip
    cells: list[GridCell] = []
    name, complete = "", True
    for load in shares:
        for speed in shares:
            stop = stop_at(speed, load)
            name = stop.name
            for extension in shares:
                far = math.inf if extension == 1.0 else extension * extent.bound
                if not load_matters and load != shares[0]:
                    same = next(c for c in cells if (c.extension, c.speed) == (extension, speed))
                    cells.append(GridCell(extension, speed, load, far, same.brackets))
                    continue
                cells.append(GridCell(extension, speed, load, far, stop.worst(arm, far)))
                if arm.interrupted:
                    complete = False
                    return StopGrid(name, largest, load_matters, tuple(cells), complete)
    return StopGrid(name, largest, load_matters, tuple(cells), complete)
