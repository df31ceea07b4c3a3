"""Whatever a supervisor answers, its verdict names the criteria that its cell does not enable."""

from __future__ import annotations

import math
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from failsafe.waypoints import rest_to_rest
from occupancy.report import RawMeasurement
from tests.verifier.supervised import PANDA, PANDA_AWAY, PANDA_HOME, report
from verifier import Cell, Supervisor
from verifier.command import Cause, Command
from verifier.proposal import NewTrajectory
from verifier.verdict import CriterionKind as Kind

FLOOR: dict[str, Any] = {"workspace": {"floor_z_m": -0.5}}
SELF: dict[str, Any] = {"criteria": {"self_collision": True}}
ALWAYS = {Kind.SEPARATION, Kind.JOINT_LIMITS}
CELLS: dict[str, tuple[dict[str, Any], set[Kind]]] = {
    "neither": ({}, set()),
    "floor": (FLOOR, {Kind.WORKSPACE}),
    "self-collision": (SELF, {Kind.SELF_COLLISION}),
    "both": (FLOOR | SELF, {Kind.WORKSPACE, Kind.SELF_COLLISION}),
}
NO_TUPLE: Any = None
RAISING = RawMeasurement(0.0, 0.0, "world", True, NO_TUPLE)


def driven(cell: Cell) -> list[Command]:
    """One command at least of every cause."""
    supervisor = Supervisor.from_cell(cell, PANDA_HOME)
    cycle, found = supervisor.cycle_s, [supervisor.step(0.0)]
    way = rest_to_rest(np.stack([PANDA_HOME, PANDA_AWAY]), supervisor.check.robot.limits)
    assert supervisor.propose(NewTrajectory(way)) is None
    for k in range(1, 10):
        found.append(supervisor.step(k * cycle, [report(k * cycle, 9.0)] if k > 3 else []))
    found += [supervisor.withdraw(), supervisor.step(math.nan)]
    with patch.object(supervisor.check, "check_moving", None):
        found.append(supervisor.step(10 * cycle, [report(10 * cycle, 9.0)]))
    found += [supervisor.step(11 * cycle, [RAISING]), supervisor.step(12 * cycle)]
    return found


@pytest.mark.parametrize("name", CELLS)
def test_every_verdict_of_a_supervisor_names_what_is_not_checked(name: str) -> None:
    table, enabled = CELLS[name]
    commands = driven(Cell.from_table(PANDA | table))
    assert {command.cause for command in commands} == set(Cause)
    for command in commands:
        missing = {kind for kind in Kind if command.verdict.not_checked >> kind & 1}
        assert missing == set(Kind) - ALWAYS - enabled, command.cause.name
