"""A supervisor in ten lines: a path, somebody who comes and goes, and what becomes of it.

python examples/embed.py
"""

from __future__ import annotations

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell, Supervisor
from verifier.command import State
from verifier.proposal import NewTrajectory

HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
TURN = np.array([1.2, 0.3, 0.0, 0.3, 0.0, 0.2, 0.4])
CELL = {
    "cycle_s": 0.01,
    "robot": {"name": "panda", "bare_flange": True, "tracking": {"position_error_rad": 0.001}},
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}


def report(t: float) -> RawMeasurement:
    """Somebody whose head is seen: walks up to 0.9 m at 1.2 m/s, and away again."""
    points = np.full((len(Point), 3), np.nan)
    points[Point.HEAD] = 0.9 + abs(1.2 * t - 3.0), 0.0, 1.7
    who = RawPerson("somebody", points, np.full(len(Point), 0.01), 1 << Point.HEAD)
    return RawMeasurement(t, t, "world", True, (who,))


def main() -> None:
    """Drive the path once, cycle by cycle."""
    z, T = np.zeros(7), 3.0
    path = IntendedTrajectory([0.0, T], [[HOME, z, z, 10 * TURN / T**3, -15 * TURN / T**4, 6 * TURN / T**5]])
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), HOME)
    refusal = supervisor.propose(NewTrajectory(path))
    print(refusal.text if refusal else "the path was taken")
    last = None
    for k in range(900):
        command = supervisor.step(k * 0.01, [report(k * 0.01)])
        if command.outcome is not last:
            print(f"{command.t:5.2f} s {command.outcome.name:10} {command.verdict.reason.text}")
            last = command.outcome
    print("arrived" if np.allclose(command.q, HOME + TURN) and last is State.STOPPED else "not there yet")


if __name__ == "__main__":
    main()
