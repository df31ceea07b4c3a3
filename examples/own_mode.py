"""A mode of one's own in one file: it sends the arm to and fro, and slows down where it is asked to.

An installed package offers a mode with an entry point:

    [project.entry-points."stopproof.modes"]
    pendulum = "own_mode:Pendulum"

Here it is run without being installed, beside a loop in real time:

    python examples/own_mode.py
"""

from __future__ import annotations

import threading
import time

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell
from verifier.command import Command
from verifier.loop import Loop
from verifier.mode_runner import ModeRunner, Proposals
from verifier.proposal import NewTrajectory, PathSpeed, Proposal, SceneView
from verifier.rehearsal import rehearse
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading

HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
AWAY = np.array([0.8, 0.2, -0.2, -1.2, 0.2, 1.7, 0.3])
CELL = {
    "cycle_s": 0.02,
    "robot": {"name": "panda", "bare_flange": True, "tracking": {"position_error_rad": 0.001}},
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}


class Pendulum:
    """From standstill to the other of two places; on the way at 60 % of the speed."""

    name = "pendulum"

    def __init__(self) -> None:
        self.slowed = False

    def propose(self, view: SceneView) -> Proposal | None:
        """Return a trajectory where the arm rests, a path speed where it moves."""
        if view.outcome == "STOPPED":
            self.slowed = False
            goal = AWAY if np.abs(view.q - AWAY).max() > 1e-3 else HOME
            return NewTrajectory(self.way(view.q, goal))
        if view.outcome == "EXECUTING" and not self.slowed:
            self.slowed = True
            return PathSpeed(0.6)
        return None

    @staticmethod
    def way(a: np.ndarray, b: np.ndarray, T: float = 1.5) -> IntendedTrajectory:
        """Return a quintic from rest to rest."""
        d, z = b - a, np.zeros(7)
        return IntendedTrajectory([0.0, T], [[a, z, z, 10 * d / T**3, -15 * d / T**4, 6 * d / T**5]], "rest")


class Room:
    """A simulated robot that follows, and one person far away."""

    def __init__(self) -> None:
        self.places: list[float] = []

    def measurements(self) -> list[RawMeasurement]:
        """Return a report of somebody whose head is 5 m away."""
        points, now = np.full((len(Point), 3), np.nan), time.monotonic()
        points[Point.HEAD] = 5.0, 0.0, 1.7
        who = RawPerson("p1", points, np.full(len(Point), 0.02), 1 << Point.HEAD)
        return [RawMeasurement(now, now, "world", True, (who,))]

    def joints(self) -> JointReading | None:
        """Return no reading."""
        return None

    def send(self, command: Command) -> bool:
        """Take the command."""
        self.places.append(float(command.q[0]))
        return True


def main() -> None:
    """Run the loop and the mode for some seconds."""
    cell = Cell.from_table(CELL)
    print("rehearsal, so that no step compiles anything: seconds, the first time minutes", flush=True)
    rehearse(cell, HOME)
    supervisor, room = Supervisor.from_cell(cell, HOME), Room()
    loop, mode = Loop(supervisor, room, room), Pendulum()
    runner = ModeRunner(Proposals(supervisor), mode, period_s=0.05)
    timer = threading.Timer(8.0, loop.stop)
    runner.start()
    timer.start()
    report = loop.run()
    ended = runner.stop()
    print(f"the first joint went from {min(room.places):.2f} to {max(room.places):.2f} rad")
    print(f"the mode was called {runner.report.calls} times, {runner.report.handed_on} proposals handed on")
    print(f"{report.cycles} steps, {report.late} of them late, {report.missed} instants missed")
    print(f"mode ended: {ended}; robot at rest: {report.at_rest}; faults: {runner.report.faults}")


if __name__ == "__main__":
    main()
