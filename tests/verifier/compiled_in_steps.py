"""Run a simulation of a cell in this process, and print which compiled functions are new in its steps.

python -m tests.verifier.compiled_in_steps CELL.json [--rehearse]
"""

from __future__ import annotations

import argparse
import gc
import json
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numba.core.registry import CPUDispatcher

from verifier.cell import Cell
from verifier.command import Command
from verifier.rehearsal import rehearse
from verifier.simulation import SimulationSettings, simulate
from verifier.supervisor import Supervisor

HOMES = {
    "panda": np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]),
    "ur5": np.array([0.0, -1.5, 1.5, 0.0, 0.0, 0.0]),
}


def main() -> None:
    """Print the names and the states that the supervisor was in as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cell", type=Path)
    parser.add_argument("--rehearse", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    cell = Cell.from_table(json.loads(options.cell.read_text(encoding="utf-8")))
    if options.rehearse:
        rehearse(cell, HOMES[str(cell.robot.name)])
    functions = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    found: set[str] = set()
    step = Supervisor.step

    def watched(self: Supervisor, *given: Any) -> Command:
        before = [len(each.overloads) for each in functions]
        command = step(self, *given)
        after = [len(each.overloads) for each in functions]
        for each, was, now in zip(functions, before, after, strict=True):
            if now > was:
                found.add(f"{each.py_func.__module__}.{each.py_func.__name__}")
        return command

    with patch.object(Supervisor, "step", watched):
        report = simulate(cell, SimulationSettings(10.0, seed=options.seed, people=2))
    states = {state.name: count for state, count in report.tally.states.items()}
    print(json.dumps({"new": sorted(found), "states": states}))


if __name__ == "__main__":
    main()
