"""After a rehearsal no step compiles anything, nor reads compiled functions from disk."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.errors import SetupError
from tests.source_files import ROOT
from verifier.cell import Cell
from verifier.rehearsal import rehearse

PANDA: dict[str, Any] = {
    "name": "panda",
    "bare_flange": True,
    "accept_assumed": ["limits"],
    "tracking": {"position_error_rad": 0.001, "velocity_error_rad_s": 0.01},
}
MODELS = (
    "iso13855", "articulated_velocity", "articulated_acceleration", "arm_reach", "articulated_position",
    "pedestrian",
)  # fmt: skip
ROOM = {"kind": "box", "min_m": [-3, -3, -1], "max_m": [3, 3, 3], "detection_time_s": 0.05}
CELLS: dict[str, dict[str, Any]] = {
    "one model": {"robot": PANDA, "people": {"latency_s": 0.03}, "stop": {"allow_joint_space": True}},
    "all models": {"robot": PANDA, "people": {"latency_s": 0.03, "profile": "tum", "models": MODELS}},
    "all models and criteria": {
        "robot": PANDA,
        "people": {
            "latency_s": 0.03, "profile": "tum", "models": MODELS,
            "monitored": {"room": {**ROOM, "boundary_error_m": 0.02}},
        },
        "workspace": {"floor_z_m": -0.8},
        "criteria": {
            "self_collision": True,
            "contact": [{"links": ["panda_link7"], "parts": ["l_hand", "r_hand"]}],
        },
    },
    "a robot that stops by itself": {
        "robot": {
            **PANDA,
            "silence": {"hold_s": 0.02, "goes_on_with": "velocity", "deceleration_rad_s2": 5.0},
        },
        "people": {"latency_s": 0.03},
    },
}  # fmt: skip


def new_in_steps(folder: Path, cell: dict[str, Any], *options: str) -> dict[str, Any]:
    """What a process of its own finds."""
    path = folder / "cell.json"
    path.write_text(json.dumps(cell), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "tests.verifier.compiled_in_steps", str(path), *options],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    assert found["states"].get("EXECUTING", 0) > 100 and found["states"].get("FAILSAFE", 0) > 0
    return found


INSTEAD = dict.fromkeys(
    ("one model", "all models", "a robot that stops by itself"), "all models and criteria"
)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.rarely(INSTEAD[name])) if name in INSTEAD else name
        for name in CELLS
    ],
)
def test_nothing_is_compiled_in_a_step_after_a_rehearsal(name: str, tmp_path: Path, seed: int) -> None:
    found = new_in_steps(tmp_path, CELLS[name], "--rehearse", "--seed", str(seed))
    assert found["new"] == []


@pytest.mark.rarely("nothing is compiled after a rehearsal, in every run")
def test_without_a_rehearsal_steps_compile(tmp_path: Path, seed: int) -> None:
    found = new_in_steps(tmp_path, CELLS["one model"], "--seed", str(seed))
    assert {"occupancy.kernels.blocking", "occupancy.kernels.classify"} < set(found["new"])


def test_a_rehearsal_tells_what_cannot_be_used() -> None:
    with pytest.raises(SetupError, match="panda_joint4 is 0"):
        rehearse(Cell.from_table(CELLS["one model"]), np.zeros(7))
