"""The check of one cycle, on its own."""

from __future__ import annotations

import pytest

from robots.errors import SetupError
from tests.oracles.intervals import outward
from verifier.cell import Cell
from verifier.setup import build_check, build_profile, build_robot


def test_a_processor_that_rounds_upward_is_refused() -> None:
    cell = Cell.from_table({"robot": {"name": "ur5", "bare_flange": True}})
    robot, profile = build_robot(cell), build_profile(cell)
    build_check(cell, robot, profile, assume_nobody=False)
    with outward(), pytest.raises(SetupError, match="rounded to nearest"):
        build_check(cell, robot, profile, assume_nobody=False)
