"""A planner in a process of its own, so that its computing never delays a cycle.

The planner sees where the robot is in one piece of shared memory and writes trajectories into another. Here
it computes for a second for every trajectory, in vain, to show that nobody waits for it.

    python examples/planner_process.py
"""

from __future__ import annotations

import multiprocessing
import os
import time
from multiprocessing.synchronize import Event

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell
from verifier.command import State
from verifier.mailbox import Mailbox
from verifier.proposal import NewTrajectory, Proposal, SceneView
from verifier.supervisor import Supervisor

HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
AWAY = np.array([0.8, 0.2, -0.2, -1.2, 0.2, 1.7, 0.3])
SPANS = 16
WAY = np.dtype([("number", "i8"), ("n", "i8"), ("breaks", "f8", SPANS + 1), ("c", "f8", (SPANS, 6, 7))])
SEEN = np.dtype([("number", "i8"), ("resting", "i8"), ("q", "f8", 7)])
CELL = {
    "cycle_s": 0.01,
    "robot": {"name": "panda", "bare_flange": True, "tracking": {"position_error_rad": 0.001}},
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}


def plan(seen_name: str, way_name: str, end: Event) -> None:
    """Process of the planner."""
    seen_box = Mailbox(seen_name, SEEN, create=False)
    way_box = Mailbox(way_name, WAY, create=False)
    seen, way, T, number = np.zeros(1, SEEN), np.zeros(1, WAY), 2.0, 0
    while not end.is_set():
        if not (seen_box.get(seen) and seen["resting"][0]):
            time.sleep(0.01)
            continue
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            np.linalg.svd(np.random.default_rng(0).random((60, 60)))
        q = seen["q"][0]
        d = (AWAY if np.abs(q - AWAY).max() > 1e-3 else HOME) - q
        number += 1
        way["number"], way["n"], way["breaks"][0, :2] = number, 1, (0.0, T)
        way["c"][0, 0] = q, 0 * q, 0 * q, 10 * d / T**3, -15 * d / T**4, 6 * d / T**5
        way_box.put(way)
        while not end.is_set() and way_box.signed != number:
            time.sleep(0.01)
        time.sleep(0.1)


class FarPlanner:
    """The mode on this side: shows the planner where the robot is, proposes what comes back."""

    name = "far planner"

    def __init__(self, seen: Mailbox, way: Mailbox) -> None:
        self.seen, self.way = seen, way
        self.last = 0

    def propose(self, view: SceneView) -> Proposal | None:
        """Return the newest trajectory, once."""
        record = np.zeros(1, SEEN)
        record["resting"], record["q"] = view.outcome == "STOPPED", view.q
        self.seen.put(record)
        way = np.zeros(1, WAY)
        if not self.way.get(way) or way["number"][0] == self.last:
            return None
        self.last = int(way["number"][0])
        self.way.sign(self.last)
        n = int(way["n"][0])
        return NewTrajectory(IntendedTrajectory(way["breaks"][0, : n + 1], way["c"][0, :n], "rest"))


def report(now: float) -> RawMeasurement:
    """Somebody whose head is 5 m away."""
    points = np.full((len(Point), 3), np.nan)
    points[Point.HEAD] = 5.0, 0.0, 1.7
    who = RawPerson("p1", points, np.full(len(Point), 0.02), 1 << Point.HEAD)
    return RawMeasurement(now, now, "world", True, (who,))


def main() -> None:
    """Cycle by cycle for some seconds, the planner beside it."""
    context = multiprocessing.get_context("spawn")
    names = [f"stopproof-{kind}-{os.getpid()}" for kind in ("seen", "way")]
    seen, way = Mailbox(names[0], SEEN, create=True), Mailbox(names[1], WAY, create=True)
    end = context.Event()
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), HOME)
    planner = context.Process(target=plan, args=(*names, end))
    planner.start()
    mode, arrived, moved, begin = FarPlanner(seen, way), 0, False, time.monotonic()
    try:
        while arrived < 2 and time.monotonic() < begin + 120.0:
            now = time.monotonic()
            command = supervisor.step(now, [report(now)])
            proposal = mode.propose(supervisor.view())  # quick; a slow one belongs into a ModeRunner
            if proposal is not None:
                refusal = supervisor.propose(proposal)
                print(refusal.text if refusal else f"trajectory {mode.last} was taken")
            rests = command.outcome is State.STOPPED
            arrived += moved and rests
            moved = not rests
            time.sleep(0.005)
    finally:
        end.set()
        planner.join(10.0)
        if planner.is_alive():
            planner.kill()
            planner.join()
        for box in (seen, way):
            box.close()
            box.unlink()
    print(f"arrived {arrived} times")


if __name__ == "__main__":
    main()
