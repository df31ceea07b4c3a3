"""Grids of a stop report: cells that know of each other, and grids of arms that have no extension."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from failsafe.bracket import Bracket, Ended
from failsafe.stop_grid import SHARES, GridCell, StopGrid, stop_grid
from failsafe.stopping import ArmSearch, StopModel
from robots.model import RobotModel


def no_extension(robot: RobotModel) -> str:
    """Say why an arm has no extension about its first joint; empty: it has one."""
    if not robot.kinematics[0]["prismatic"][0]:
        return ""
    return f"joint {robot.joints[0]} slides: the arm has no extension about it"


def grid_of(arm: ArmSearch, stop_at: Callable[[float, float], StopModel], *, load_matters: bool) -> StopGrid:
    """Bracket every cell (:func:`failsafe.stop_grid.stop_grid`), and let the cells know of each other.

    An arm without extension has cells of speed and load alone; that of its grid is not bounded, which says
    why.
    """
    why = no_extension(arm.model)
    if why:
        return _without_extension(arm, stop_at, why, load_matters=load_matters)
    grid = stop_grid(arm, stop_at, load_matters=load_matters)
    return replace(grid, cells=nested(grid.cells))


def _without_extension(
    arm: ArmSearch, stop_at: Callable[[float, float], StopModel], why: str, *, load_matters: bool
) -> StopGrid:
    largest = Bracket("largest extension", "", "m", 0.0, math.inf, None, "none", Ended.UNBOUNDED, why)
    cells: list[GridCell] = []
    of_speed: dict[float, tuple[Bracket, ...]] = {}
    name = ""
    for load in SHARES:
        for speed in SHARES:
            if load_matters or speed not in of_speed:
                stop = stop_at(speed, load)
                name, of_speed[speed] = stop.name, stop.worst(arm)
            cells.append(GridCell(1.0, speed, load, math.inf, of_speed[speed]))
            if arm.interrupted:
                return StopGrid(name, largest, load_matters, nested(tuple(cells)), complete=False)
    return StopGrid(name, largest, load_matters, nested(tuple(cells)), complete=True)


def nested(cells: tuple[GridCell, ...]) -> tuple[GridCell, ...]:
    """Let cells of one load know of each other: a larger extension or speed admits every state of a smaller.

    What is reached in the smaller cell is reached in the larger one, and what is not exceeded in the larger
    one is not exceeded in the smaller one.
    """

    def within(small: GridCell, large: GridCell) -> bool:
        same = small.load == large.load and len(small.brackets) == len(large.brackets)
        return same and small.extension <= large.extension and small.speed <= large.speed

    out = []
    for cell in cells:
        brackets = []
        for k, each in enumerate(cell.brackets):
            best = max((one.brackets[k] for one in cells if within(one, cell)), key=lambda b: b.lower)
            least = min((one.brackets[k] for one in cells if within(cell, one)), key=lambda b: b.upper)
            changed = each
            if best.lower > each.lower:
                changed = replace(changed, lower=best.lower, witness=best.witness, part=best.part)
            if least.upper < each.upper:
                changed = replace(changed, upper=least.upper, method=least.method, reason=least.reason)
            brackets.append(changed)
        out.append(replace(cell, brackets=tuple(brackets)))
    return tuple(out)
