"""A planner that asks first: which way leaves somebody room enough, and how fast may the robot go on it?

The way straight ahead is held against people as they are known now before it is proposed; where it would come
too close, the planner takes the one with the arm drawn in. On the way it slows down as far as it is told. For
comparison the same planner goes on without asking.

    python examples/planner_with_safety_state.py
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import rest_to_rest
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell
from verifier.command import State
from verifier.proposal import NewTrajectory, PathSpeed
from verifier.safety_state import ProbeSettings, SafetyProbe, look
from verifier.supervisor import Supervisor

LEFT = np.array([-1.2, 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
RIGHT = np.array([1.2, 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
DRAWN_IN = np.array([0.0, -0.9, 0.0, -1.2, 0.0, 0.9, 0.0])  # added to a place
CYCLE_S = 0.01
CELL = {
    "cycle_s": CYCLE_S,
    "robot": {"name": "panda", "bare_flange": True, "tracking": {"position_error_rad": 0.001}},
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}


MIDDLE = {"PELVIS": 0.95, "THORAX": 1.25, "NECK_BASE": 1.45, "HEAD": 1.65}
SIDES = {
    "SHOULDER": (0.18, 1.42), "ELBOW": (0.22, 1.12), "WRIST": (0.22, 0.87), "HAND": (0.22, 0.79),
    "FINGERTIP": (0.22, 0.69), "HIP": (0.1, 0.92), "KNEE": (0.1, 0.5), "ANKLE": (0.1, 0.08),
}  # fmt: skip


def report(t: float) -> RawMeasurement:
    """Somebody who walks up to 1.1 m at 0.5 m/s, stays for a while, and walks away again."""
    x = min(2.6, max(1.1, 2.6 - 0.5 * t, 1.1 + 0.5 * (t - 12.0)))
    points = np.empty((len(Point), 3))
    for name, z in MIDDLE.items():
        points[Point[name]] = x, 0.0, z
    for name, (y, z) in SIDES.items():
        points[Point["L_" + name]], points[Point["R_" + name]] = (x, y, z), (x, -y, z)
    who = RawPerson("somebody", points, np.full(len(Point), 0.01), (1 << len(Point)) - 1)
    return RawMeasurement(t, t, "world", True, (who,))


class Planner:
    """Takes the arm to and fro between two places."""

    def __init__(self, supervisor: Supervisor, cell: Cell, asks: bool) -> None:
        self.supervisor, self.asks = supervisor, asks
        self.limits = supervisor.check.robot.limits
        self.probe = SafetyProbe.from_cell(cell, ProbeSettings(horizon_s=0.1), supervisor.check.robot)
        self.slowest = 1.0

    def ways(self, q: np.ndarray, goal: np.ndarray) -> dict[str, IntendedTrajectory]:
        """Return the ways that there are, the quickest first."""
        around = [q, q + DRAWN_IN, goal + DRAWN_IN, goal]
        return {
            "straight ahead": rest_to_rest([q, goal], self.limits, share=0.5),
            "with the arm drawn in": rest_to_rest(around, self.limits, share=0.5),
        }

    def choose(self, q: np.ndarray, goal: np.ndarray) -> str | None:
        """Propose the first way on which every plan would be verified now; return its name."""
        for name, way in self.ways(q, goal).items():
            found = self.probe.would_verify(look(self.supervisor), way) if self.asks else None
            if found is None or found.verified:
                self.supervisor.propose(NewTrajectory(way))
                self.supervisor.propose(PathSpeed(1.0))
                return name
            print(f"  {name}: {found.constraint.text if found.constraint else found.refusal.text}")
        return None

    def slow_down(self) -> None:
        """Go as fast as is allowed."""
        if self.asks:
            speed = self.probe.state(look(self.supervisor)).allowed_path_speed
            self.slowest = min(self.slowest, speed)
            self.supervisor.propose(PathSpeed(speed))


def drive(asks: bool) -> None:
    """Go to and fro for a while."""
    cell = Cell.from_table(CELL)
    supervisor = Supervisor.from_cell(cell, LEFT)
    planner, goal, states, arrived = Planner(supervisor, cell, asks), RIGHT, Counter[State](), 0
    moving = False
    for k in range(2000):
        command = supervisor.step(k * CYCLE_S, [report(k * CYCLE_S)])
        states[command.outcome] += 1
        if moving and np.abs(command.q - goal).max() < 1e-9:
            moving, arrived, goal = False, arrived + 1, LEFT if goal is RIGHT else RIGHT
        if moving:
            planner.slow_down()
        elif k % 20 == 0:
            name = planner.choose(command.q, goal)
            moving = name is not None
            if moving and asks:
                print(f"{k * CYCLE_S:5.2f} s {name}")
    who = "asks" if asks else "does not ask"
    print(f"a planner that {who}: arrived {arrived} times, {states[State.FAILSAFE]} steps of failsafe stops")
    if asks:
        print(f"slowest path speed that it asked for: {planner.slowest:.2f}")


def main() -> None:
    """Compare a planner that asks with one that does not."""
    drive(asks=False)
    drive(asks=True)


if __name__ == "__main__":
    main()
