"""What a result rests on: what is left out of the check, and every number that was believed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption, Certainty
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.cycle import CycleCheck
from verifier.setup import DEFAULT_POSITION_ERROR_M, beyond_limits, build_silence, contact_limits
from verifier.stop_model import braking_of


@dataclass(frozen=True, slots=True)
class Waivers:
    """What the user leaves out of the check, to be listed with every result."""

    assume_nobody: bool
    texts: tuple[str, ...]


def waivers(cell: Cell, robot: RobotModel, *, assume_nobody: bool) -> Waivers:
    """List what is left out of the check and was not accepted in the cell."""
    texts = []
    if robot.tool is None:
        texts.append("no tool declared (give --tool FILE or --bare-flange)")
    if robot.assumed_enclosure and "enclosure" not in cell.robot.accept_assumed:
        texts.append("assumed enclosure of the arm (no meshes; accept with robot.accept_assumed)")
    if robot.assumed_limits and "limits" not in cell.robot.accept_assumed:
        kinds = " and ".join(robot.assumed_limits)
        texts.append(f"assumed {kinds} limits (accept with robot.accept_assumed)")
    if cell.people.ignored_parts:
        texts.append(f"body parts left out: {', '.join(cell.people.ignored_parts)}")
    for name, links in _touching(cell):
        texts.append(f"may touch {name}, not checked: {', '.join(links)}")
    for pair in cell.criteria.links_may_touch:
        texts.append(f"may touch each other, not checked: {' and '.join(pair)}")
    if cell.criteria.contact and contact_limits(cell).unverified and not cell.criteria.accept_unverified:
        texts.append("limits of contact that nobody has verified (accept with criteria.accept_unverified)")
    for pair in cell.criteria.gaps_by_design:
        texts.append(f"gap in which nothing can be clamped, not checked: {' and '.join(pair)}")
    if assume_nobody:
        texts.append("nobody is there (--assume-nobody)")
    return Waivers(assume_nobody, tuple(texts))


def _touching(cell: Cell) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Fixtures that some links may touch."""
    if cell.workspace.floor_may_touch:
        yield "the floor", cell.workspace.floor_may_touch
    for name, table in cell.workspace.fixtures.items():
        if table.may_touch:
            yield f"the fixture {name}", table.may_touch


def stated_assumptions(
    cell: Cell, check: CycleCheck, *, default_error: bool = True
) -> tuple[Assumption, ...]:
    """List every number that a result rests on, of the cell first; recordings add what they state.

    ``default_error``: points may have come without a position error of their own.
    """
    stated = cell.assumptions()
    named = {item.name.removeprefix("cell.") for item in stated}
    items = [*stated, *silence_assumptions(cell, check.robot), *stop_assumptions(cell, check.robot)]
    items += [item for item in check.assumptions() if item.name not in named]
    if default_error and cell.people.position_error_m is None:
        source = "used where nothing else states one"
        default = DEFAULT_POSITION_ERROR_M
        items.append(Assumption("people.position_error", default, "m", source, Certainty.DEFAULT))
    return tuple(items)


def measured_tracking(robot: RobotModel, residual: NDArray[np.float64]) -> tuple[Assumption, ...]:
    """List how far recorded joints ``(n,)`` [rad or m] leave the path that was laid through them."""
    sliding = robot.kinematics["prismatic"][0][: len(robot.joints)]
    source, units = "largest residual of the fit", np.where(sliding, "m", "rad")
    return tuple(
        Assumption(f"robot.tracking.{joint}", float(error), str(unit), source, Certainty.MEASURED)
        for joint, error, unit in zip(robot.joints, residual, units, strict=True)
    )


def stop_assumptions(cell: Cell, robot: RobotModel) -> tuple[Assumption, ...]:
    """List what a stop model that was fitted on recordings believes about the arm."""
    if cell.stop.measured_file is None:
        return ()
    model, braking = braking_of(Path(cell.stop.measured_file), robot)
    sliding = robot.kinematics["prismatic"][0]
    source = f"{model.source}; times {100.0 * model.margin:.3g} % longer"
    items = [("delay", braking.delay_s, "s"), ("braking_time", braking.braking_time_s, "s")]
    for i, joint in enumerate(robot.joints):
        unit = "m" if sliding[i] else "rad"
        items.append((f"deceleration.{joint}", float(braking.deceleration[i]), f"{unit}/s²"))
        items.append((f"measured_up_to.{joint}", float(braking.fastest[i]), f"{unit}/s"))
    return tuple(
        Assumption(f"stop.{name}", value, unit, source, Certainty.MEASURED) for name, value, unit in items
    )


def silence_assumptions(cell: Cell, robot: RobotModel) -> tuple[Assumption, ...]:
    """List what the robot is believed to do beyond its own limits when no command comes."""
    silence, table = build_silence(cell, robot), cell.robot.silence
    if silence is None or table is None:
        return ()
    return tuple(
        Assumption(
            f"robot.silence.beyond_acceleration_limit.{robot.joints[i]}",
            float(silence.deceleration[i]),
            unit,
            f"{table.deceleration_source}; its limit is {robot.limits.acceleration[i]:g}",
            Certainty.DECLARED,
        )
        for i, unit in beyond_limits(robot, silence.deceleration)
    )
