"""What is given in place of a cell is refused in words, wherever cells are built into parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from verifier import verify
from verifier.batch import BatchVerifier
from verifier.cell import Cell
from verifier.comparison import compare
from verifier.limits import find_limits
from verifier.protective_separation import separation_history
from verifier.safety_state import SafetyProbe
from verifier.setup import (
    build_check,
    build_gate,
    build_profile,
    build_robot,
    build_supervised,
    build_watch,
    require_cell,
)
from verifier.simulation import SimulationSettings, simulate
from verifier.supervised import supervise
from verifier.supervisor import Supervisor

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "data" / "demo.mcap"
GIVEN = [
    ("cell.toml", r"not what is of type str: read the file first, with Cell\.from_toml\('cell\.toml'\)$"),
    (ROOT / "data" / "demo.toml", r"read the file first, with Cell\.from_toml\('.*demo\.toml'\)$"),
    (
        {"robot": {"name": "ur5"}},
        r"not what is of type dict: make one of this table with Cell\.from_table\(table\)$",
    ),
    (None, r"not None: read a file with Cell\.from_toml\(path\), or Cell\(\) has every default$"),
    (3, "not what is of type int: read a file with"),
    (Cell, "not what is of type ModelMetaclass: read a file with"),
]
TAKERS = {
    "Supervisor.from_cell": lambda cell: Supervisor.from_cell(cell, np.zeros(6)),
    "SafetyProbe.from_cell": SafetyProbe.from_cell,
    "verify": lambda cell: verify(DEMO, cell),
    "supervise": lambda cell: supervise(DEMO, cell),
    "find_limits": lambda cell: find_limits(DEMO, cell),
    "separation_history": lambda cell: separation_history(DEMO, cell),
    "compare": lambda cell: compare(DEMO, cell),
    "simulate": lambda cell: simulate(cell, SimulationSettings(seconds=1.0)),
    "BatchVerifier": BatchVerifier,
    "build_robot": build_robot,
    "build_profile": build_profile,
    "build_gate": lambda cell: build_gate(cell, build_profile(Cell())),
    "build_watch": build_watch,
    "build_check": lambda cell: build_check(cell, None, build_profile(Cell()), assume_nobody=False),
    "build_supervised": build_supervised,
}


@pytest.mark.parametrize("take", TAKERS.values(), ids=TAKERS)
@pytest.mark.parametrize(("given", "words"), GIVEN, ids=[str(type(given).__name__) for given, _ in GIVEN])
def test_what_is_no_cell_is_refused_with_how_one_is_made(take, given, words):
    with pytest.raises(SetupError, match=f"^a Cell is needed here, .*{words}"):
        take(given)


def test_a_path_that_acts_on_a_terminal_is_shown_harmlessly():
    with pytest.raises(SetupError) as caught:
        require_cell("a\x1b[2J\n" + "b" * 5000)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 400
    require_cell(Cell())
