"""Another goal while the robot moves: the new way joins the present one, and a refusal is used to mend it.

A way can only join beyond the place where the stop of the running plan ends (`SceneView.s_rest`), which
moves on while it is made: a lead of some cycles is added. It begins with q, q', q'' of the present path
there. Where it is too quick, the refusal says by how much. The robot side says where its joints were (A2).

    python examples/join_in_motion.py
"""

from __future__ import annotations

import math

import numpy as np

from failsafe.preparation import Refusal
from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import from_motion, rest_to_rest
from occupancy.report import RawMeasurement
from verifier import Cell
from verifier.command import State
from verifier.proposal import NewTrajectory
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading

HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
FIRST = np.array([1.2, 0.3, 0.0, -1.2, 0.0, 1.7, 0.4])
OTHER = np.array([0.9, -0.4, 0.2, -1.8, 0.0, 1.3, 0.0])
CYCLE_S, LEAD_S = 0.01, 0.05
CELL = {
    "cycle_s": CYCLE_S,
    "robot": {"name": "panda", "bare_flange": True, "tracking": {"position_error_rad": 0.001}},
    "stop": {"slice_s": 0.02},
}


def join(supervisor: Supervisor, present: IntendedTrajectory, goal: np.ndarray) -> IntendedTrajectory | None:
    """Propose a way to ``goal`` that joins ``present`` as soon as it can; slower as far as it is refused."""
    duration = 0.5
    for _ in range(10):
        at = supervisor.view().s_rest + LEAD_S
        q, v, a, _ = present.sample(at)
        way = from_motion((q, v, a), goal, duration, at)
        refusal: Refusal | None = supervisor.propose(NewTrajectory(way, join_s=at))
        if refusal is None:
            print(f"  joins at s = {at:.2f} s, {duration:.2f} s to the other goal")
            return way
        print(f"  in {duration:.2f} s: {refusal.objection.name}: {refusal.text}")
        speed = refusal.path_speed
        duration *= 1.02 / speed if math.isfinite(speed) and speed < 1.0 else 1.2
    return None


def main() -> None:
    """Set out for one place, and arrive at another."""
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), HOME)
    way = rest_to_rest([HOME, FIRST], supervisor.check.robot.limits, share=0.4)
    supervisor.propose(NewTrajectory(way))
    followed, last = [HOME, HOME], None
    for k in range(600):
        now = k * CYCLE_S
        where = JointReading(now, followed[k])  # a robot that follows exactly: q of the command for t_k
        nobody = RawMeasurement(now, now, "world", True, ())  # complete, and lists nobody
        command = supervisor.step(now, [nobody], where)
        followed.append(command.q)
        if command.outcome is not last:
            print(f"{command.t:5.2f} s {command.outcome.name:10} {command.verdict.reason.text}")
            last = command.outcome
        if k == 40:
            join(supervisor, way, OTHER)
    assert supervisor.refusal is None and supervisor.deviation is None
    print("arrived" if np.allclose(command.q, OTHER) and last is State.STOPPED else "not there yet")


if __name__ == "__main__":
    main()
