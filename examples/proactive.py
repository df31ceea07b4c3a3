"""An arm between two places, and somebody who walks past: the mode plans, the supervisor verifies.

Needs the extras `twin` and `forecast`; the first run on a machine compiles for a minute:

    python examples/proactive.py
    python examples/proactive.py --without-forecasts
"""

from __future__ import annotations

import sys

import numpy as np

from modes.forecasting.network import load_forecaster
from modes.planning.foresight import Forecasts, Present
from modes.planning.replan_settings import Target
from modes.planning.replanning import ProactiveAvoidance
from modes.planning.trials import FLOOR_Z_M, PICK, PLACE
from modes.twin.camera import Camera
from modes.twin.cell import CellTwin
from modes.twin.people import Walking
from occupancy.body import load_profile
from verifier import Cell, Supervisor

CELL = {
    "cycle_s": 0.01,
    "robot": {
        "name": "ur16e", "bare_flange": True, "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.002, "velocity_error_rad_s": 0.02},
    },
    "people": {"latency_s": 0.05, "repeated_points": "measured"},
    "workspace": {"floor_z_m": FLOOR_Z_M},
}  # fmt: skip


def main() -> None:
    """Go to and fro for twenty seconds, and print what the mode does."""
    person, profile = Walking((0.9, -2.5), (0.9, 2.5), floor_z_m=FLOOR_Z_M), load_profile("iso")
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), np.array(PICK))
    robot = supervisor.check.robot
    targets = [Target(PLACE), Target(PICK), Target(PLACE)]
    told = Present() if "--without-forecasts" in sys.argv else Forecasts(load_forecaster())
    mode = ProactiveAvoidance(robot, targets, profile, told)
    camera, twin = Camera([person]), CellTwin(robot, np.array(PICK), 1, profile)
    doing, nearest = mode.decision.doing, np.inf
    for k in range(2000):
        t = 0.01 * k
        if k % 10 == 5:  # ten times a second
            proposal = mode.propose(supervisor.view())
            if proposal is not None:
                refusal = supervisor.propose(proposal)
                if refusal is not None:
                    mode.refused(refusal)
            if mode.decision.doing is not doing:
                doing = mode.decision.doing
                print(f"{t:5.2f} s  {doing.value}")
        command = supervisor.step(t, camera.arrived(t))
        twin.go(command.q, command.dq)
        twin.put(person.at(twin.t)[None])
        found = twin.nearest(1.0)
        if found.speed_m_s > 0.01:
            nearest = min(nearest, found.gap_m)
    print(f"{mode.reached} of {len(targets)} targets reached; moving links stayed {nearest:.2f} m away")


if __name__ == "__main__":
    main()
