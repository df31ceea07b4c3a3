"""The supervisor dies, and the robot comes to rest on the plan that it holds (assumption A4).

Three processes: one runs the supervisor, one is a simulated robot with a plan holder, and the first kills the
supervisor in the middle of a motion, as a power cut would.

    python examples/watchdog.py
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import time
from multiprocessing.connection import Connection

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell
from verifier.command import Cause, Command
from verifier.held_plan import PlanHolder, new_setpoints, setpoints_dtype, write_setpoints
from verifier.loop import Loop
from verifier.mailbox import Mailbox
from verifier.proposal import NewTrajectory
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading

CYCLE = 0.02
PARTS = 10  # setpoints a cycle
ROWS = 800  # room for stops of 1.6 s
BOUND_S = ROWS * CYCLE / PARTS + 2 * CYCLE  # longest time to rest after silence
GUARD_S = 0.002  # a plan must be there this long before its begin
HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
AWAY = np.array([1.2, 0.4, -0.3, -1.1, 0.4, 1.8, 0.5])
CELL = {
    "cycle_s": CYCLE,
    "robot": {
        "name": "panda",
        "bare_flange": True,
        "tracking": {"position_error_rad": 0.002, "delay_max_s": 0.01},
    },
    "stop": {"slice_s": 0.02},
    "people": {"repeated_points": "measured"},
}


def there_and_back(times: int) -> IntendedTrajectory:
    """Quintics between two places, standing still at each."""
    places, T, pieces = [HOME, *[AWAY, HOME] * times], 2.0, []
    for a, b in itertools.pairwise(places):
        d, none = b - a, np.zeros(7)
        pieces.append([a, none, none, 10 * d / T**3, -15 * d / T**4, 6 * d / T**5])
    return IntendedTrajectory(T * np.arange(len(places)), pieces, "rest")


class Room:
    """Source of reports and sink of commands: one person far away, the robot behind a mailbox."""

    def __init__(self, supervisor: Supervisor, mailbox: Mailbox) -> None:
        self.supervisor, self.mailbox = supervisor, mailbox
        self.plan, self.number = new_setpoints(ROWS, 7), 0

    def measurements(self) -> list[RawMeasurement]:
        """Return a report of somebody who stands 5 m away."""
        heights = np.linspace(0.1, 1.7, len(Point))
        points = np.column_stack([np.full(len(Point), 5.0), np.zeros(len(Point)), np.sort(heights)])
        points[Point.HEAD] = 5.0, 0.0, 1.7
        points[[p for p in Point if p is not Point.HEAD]] = np.nan
        now = time.monotonic()
        who = RawPerson("p1", points, np.full(len(Point), 0.02), 1 << Point.HEAD)
        return [RawMeasurement(now, now, "world", True, (who,))]

    def joints(self) -> JointReading | None:
        """Return no reading: the simulated robot follows."""
        return None

    def send(self, command: Command) -> bool:
        """Hand a new plan over, and wait for the receipt."""
        if command.cause is not Cause.ADOPTED:
            return True  # the robot holds that plan already
        if not write_setpoints(self.supervisor, PARTS, self.plan):
            return False
        self.number += 1
        self.plan["number"] = self.number
        self.mailbox.put(self.plan)
        while self.mailbox.signed != self.number and time.monotonic() < command.deadline:
            time.sleep(1e-4)
        return self.mailbox.signed == self.number


def supervise(name: str) -> None:
    """Process of the supervisor."""
    mailbox = Mailbox(name, setpoints_dtype(ROWS, 7), create=False)
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), HOME)
    refusal = supervisor.propose(NewTrajectory(there_and_back(100)))
    assert refusal is None, refusal
    room = Room(supervisor, mailbox)
    Loop(supervisor, room, room).run()


def be_a_robot(name: str, out: Connection) -> None:
    """Process of the robot: 500 setpoints a second; ends when it has moved and rests."""
    mailbox = Mailbox(name, setpoints_dtype(ROWS, 7), create=False)
    holder, plan = PlanHolder(HOME, GUARD_S, 1e-6, ROWS), new_setpoints(ROWS, 7)
    trace, moved, said, rests_since = [], False, False, time.monotonic()
    while True:
        now = time.monotonic()
        if mailbox.get(plan) and plan["number"][0] > holder.number and holder.offer(plan, now):
            mailbox.sign(holder.number)
        place = holder.setpoint(now)
        trace.append([now, *place.q])
        moved = moved or np.abs(place.dq).max() > 0.3
        if moved and not said:
            out.send("moving")
            said = True
        rests_since = rests_since if place.resting else now
        if moved and now - rests_since > 0.5:
            break
        time.sleep(0.002)
    out.send(np.array(trace))


def main() -> None:
    """Run both, kill one, look at the other."""
    context = multiprocessing.get_context("spawn")
    name = f"stopproof-{os.getpid()}"
    mailbox = Mailbox(name, setpoints_dtype(ROWS, 7), create=True)
    here, there = context.Pipe()
    robot = context.Process(target=be_a_robot, args=(name, there))
    supervisor = context.Process(target=supervise, args=(name,))
    try:
        robot.start()
        supervisor.start()
        if not here.poll(300.0):
            raise SystemExit("the robot did not begin to move")
        here.recv()
        time.sleep(0.2)
        killed = time.monotonic()
        os.kill(supervisor.pid or 0, signal.SIGKILL)
        trace = here.recv() if here.poll(60.0) else None
        if trace is None:
            raise SystemExit("the robot did not come to rest")
        report(trace, killed)
    finally:
        for process in (supervisor, robot):
            if process.is_alive():
                process.kill()
            process.join()
        mailbox.close()
        mailbox.unlink()


def report(trace: np.ndarray, killed: float) -> None:
    """Print how the robot came to rest."""
    t, q = trace[:, 0], trace[:, 1:]
    speed = np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]).max(axis=1)
    at_kill = speed[np.searchsorted(t, killed) - 1]
    rest = t[1:][speed > 1e-9].max() - killed
    moved = np.abs(q[-1] - q[np.searchsorted(t, killed) - 1]).max()
    print(f"when the supervisor was killed the robot moved at {at_kill:.3f} rad/s")
    print(f"it came to rest after {1e3 * rest:.0f} ms and {moved:.4f} rad, bound {1e3 * BOUND_S:.0f} ms")
    print(f"largest speed on the way {speed[np.searchsorted(t, killed) - 1 :].max():.3f} rad/s")


if __name__ == "__main__":
    main()
