"""How long a control step of the contact mode takes, beside the same in SciPy, NumPy and pinocchio.

    python -m bench.contact [--steps N] [--json -]

A step: twelve samples of the sensor looked at and averaged, weight taken off, kinematics and Jacobian, four
filters, thresholds, residual where somebody guides the tool, and the joint speeds. *Task*: the arm follows
its task; *guided*: somebody holds the tool. Elapsed time on one core; medians. The naive row filters with
``scipy.signal.lfilter``, takes kinematics from pinocchio and the pseudoinverse from NumPy.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray
from scipy.signal import lfilter, lfilter_zi

import robots
from bench.machine import describe_machine, keep_to_one_core
from modes.contact.admittance import CyclicTask
from modes.contact.detection import TABLE_1, Residual
from modes.contact.filters import current_high_pass, current_low_pass, force_high_pass, force_low_pass
from modes.contact.machine import ContactMachine, ContactSettings, Measured, State
from modes.contact.wrench import GRAVITY, ToolLoad
from robots.catalog import RobotSetup, load_robot

Array = NDArray[np.float64]

T = 0.012
_AIM_US = 50.0
_BEGIN = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
_GAINS = (100.0, 100.0, 60.0, 40.0, 30.0, 20.0)
_LOAD = ToolLoad(0.5, np.array([0.0, 0.0, 0.05]), np.array([1.0, -2.0, 0.5, 0.05, 0.0, -0.02]))


def main() -> None:
    """Measure, and print the table or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.contact")
    parser.add_argument("--steps", type=int, default=2000, help="control steps of each kind")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    keep_to_one_core()
    found: dict[str, Any] = {"machine": describe_machine(), "steps": options.steps, "aim_us": _AIM_US}
    for name, force in (("task", 0.0), ("guided", 12.0)):
        ours, apart = _measure(force, options.steps)
        found[name] = {**ours, "apart": apart}
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print(f"{found['machine']['processor']}, {options.steps} steps", "", *_lines(found), sep="\n")


def _measured(k: int, force: float, rotation: Array, rng: np.random.Generator) -> Measured:
    """Return a step's samples: a push along y that rises within a second after 0.6 s."""
    t = T * (k + 1)
    push = np.array([0.0, force * min(max(t - 0.6, 0.0), 1.0), 0.0])
    wrenches = _LOAD.unloaded(rotation) + rng.normal(size=(12, 6)) * np.repeat((0.1, 0.002), 3)
    wrenches[:, :3] += push @ rotation
    currents = np.array([0.05, 0.6, 0.5, 0.1, 0.1, 0.05]) + 0.005 * rng.normal(size=6)
    return Measured(t, np.abs(currents), t - 0.001 * np.arange(12)[::-1], wrenches)


def _measure(force: float, steps: int) -> tuple[dict[str, Any], float]:
    """Return times of ours and the naive one [µs], and by how much their high-passed forces differ [N]."""
    robot = load_robot("ra605", setup=RobotSetup(bare_flange=True))
    settings = ContactSettings(Residual(_GAINS), load=_LOAD)
    corners = np.array([[0.368, 0.0, 0.755], [0.368, 0.06, 0.755], [0.368, 0.06, 0.705]])
    machine = ContactMachine(robot, CyclicTask(corners, 2.0), settings)
    naive, rng, q = _Naive(), np.random.default_rng(0), _BEGIN.copy()
    ours, theirs, apart, warm = [], [], 0.0, 150
    for k in range(steps + warm):
        rotation, _place = machine._frame.pose(q)
        measured = _measured(k, force, rotation, rng)
        began = time.perf_counter()
        decision = machine.step(q, measured)
        between = time.perf_counter()
        high = naive.step(q, measured)
        ended = time.perf_counter()
        if k >= warm:
            assert decision.state is (State.COLLABORATION if force else State.TASK), decision.reason
            assert decision.tool is not None
            ours.append(1e6 * (between - began))
            theirs.append(1e6 * (ended - between))
            apart = max(apart, abs(high - decision.tool.high_N))
        q = q + T * decision.dq
    middle, high_us = np.percentile(ours, [50.0, 99.0])
    times = {"median_us": float(middle), "p99_us": float(high_us), "worst_us": float(max(ours))}
    return {**times, "naive_us": float(np.median(theirs))}, apart


class _Naive:
    """The usual way, one call after the other."""

    def __init__(self) -> None:
        path = Path(robots.__file__).parent / "models" / "ra605.urdf"
        self._model = pinocchio.buildModelFromUrdf(str(path))
        self._data = self._model.createData()
        self._designs = [force_high_pass(), force_low_pass(), current_high_pass(), current_low_pass()]
        self._states: list[Array] = []

    def step(self, q: Array, measured: Measured) -> float:
        """Do what a step does; return the high-passed force [N]."""
        pinocchio.computeJointJacobians(self._model, self._data, q)
        joint = self._model.njoints - 1
        jacobian = pinocchio.getJointJacobian(
            self._model, self._data, joint, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        rotation = self._data.oMi[joint].rotation
        assert np.isfinite(measured.wrenches).all() and (np.diff(measured.stamps) > 0.0).all()
        weight = _LOAD.mass_kg * (rotation.T @ GRAVITY)
        own = _LOAD.bias + np.concatenate((weight, np.cross(_LOAD.centre_m, weight)))
        reading = measured.wrenches.mean(axis=0) - own
        force = rotation @ reading[:3]
        signals = [force, force, measured.currents[:3], measured.currents[:3]]
        if not self._states:
            pairs = zip(self._designs, signals, strict=True)
            self._states = [lfilter_zi(d.b, d.a)[:, None] * x for d, x in pairs]
        outs = []
        for i, (design, x) in enumerate(zip(self._designs, signals, strict=True)):
            out, self._states[i] = lfilter(design.b, design.a, x[None], axis=0, zi=self._states[i])
            outs.append(out[0])
        speeds = np.linalg.pinv(jacobian[:3]) @ (0.008 * force)
        assert TABLE_1.high(speeds, speeds).shape == outs[2].shape
        return float(np.linalg.norm(outs[0]))


def _lines(found: dict[str, Any]) -> list[str]:
    lines = [
        "| step | median, µs | 99 %, µs | worst, µs | naive, µs | naive / ours | aim, µs |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in ("task", "guided"):
        each = found[name]
        lines.append(
            f"| {name} | {each['median_us']:.1f} | {each['p99_us']:.1f} | {each['worst_us']:.1f} | "
            f"{each['naive_us']:.0f} | {each['naive_us'] / each['median_us']:.1f} | {_AIM_US:.0f} |"
        )
    return lines


if __name__ == "__main__":
    main()
