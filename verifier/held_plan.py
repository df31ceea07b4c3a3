"""The robot side of assumption A4: it holds the last plan, and goes on with it when nothing newer comes.

A plan leaves the supervisor as setpoints from its begin until rest. :class:`PlanHolder` is what a robot's
controller has to do with them; it needs nothing but arithmetic, and may be written in any language.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError
from robots.motion import Block
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]


def setpoints_dtype(rows: int, joints: int) -> np.dtype[np.void]:
    """Return the type of a plan as setpoints: at most ``rows`` of ``joints`` values.

    ``number`` counts plans; row i is commanded at ``begin + i * step`` [s]; rows from the last one on: rest.
    """
    return np.dtype(
        [
            ("number", np.int64),
            ("begin", np.float64),
            ("step", np.float64),
            ("n", np.int64),
            ("q", np.float64, (rows, joints)),
            ("dq", np.float64, (rows, joints)),
        ]
    )


def new_setpoints(rows: int, joints: int) -> Block:
    """Return an empty plan.

    Raises
    ------
    SetupError
        Fewer than two rows, or no joint.
    """
    if rows < 2 or joints < 1:
        raise SetupError(f"{rows} rows of {joints} joints should be at least 2 of 1")
    return np.zeros(1, dtype=setpoints_dtype(rows, joints))


def write_setpoints(supervisor: Supervisor, parts: int, out: Block) -> bool:
    """Write the plan of the last command, ``parts`` setpoints a cycle; return whether there is room for it.

    A plan that has no room must not be counted as handed over. ``number`` is left alone.
    """
    record, running = out[0], supervisor.running
    step = supervisor.cycle_s / parts
    rows = 1 + math.ceil(max(running.plan.duration_s, supervisor.cycle_s) / step)
    record["n"] = 0
    if rows > record["q"].shape[0] or not math.isfinite(running.begin):
        return False
    record["begin"], record["step"] = running.begin, step
    for i in range(rows):
        # rounding may put the last setpoint just before the end, where the plan has not come to rest yet
        last = i == rows - 1
        motion = running.plan.motion(max(i * step, running.plan.duration_s) if last else i * step)
        record["q"][i], record["dq"][i] = motion.q, motion.dq
    record["n"] = rows
    return True


class Setpoint(NamedTuple):
    """Where the robot is to be: ``q, dq (n,)`` [rad, rad/s; m, m/s]; ``resting``: the plan has ended."""

    q: Array
    dq: Array
    resting: bool


class PlanHolder:
    """Holds the plan that is executed and the one that begins next.

    Parameters
    ----------
    q:
        ``(n,)`` where the robot stands at first [rad; m].
    guard_s:
        A plan that is offered later than this before its begin [s] is refused.
    jump:
        Largest difference [rad; m] between the plan that is held and a new one where that begins.
    rows:
        Most setpoints of a plan.

    Raises
    ------
    SetupError
        ``q``, ``guard_s`` or ``jump`` are not finite, or negative.
    """

    def __init__(self, q: Array, guard_s: float, jump: float, rows: int) -> None:
        place = np.array(q, dtype=np.float64)
        for name, value in (("guard_s", guard_s), ("jump", jump)):
            if not 0.0 <= value < math.inf:
                raise SetupError(f"{name} = {value} should be finite and not negative")
        if place.ndim != 1 or not np.isfinite(place).all():
            raise SetupError(f"q = {place} should be one finite value per joint")
        self._guard, self._jump = guard_s, jump
        self._held, self._next = (new_setpoints(rows, len(place)) for _ in range(2))
        self._held["q"][0, :2], self._held["n"] = place, 2
        self._held["begin"], self._held["step"] = -math.inf, 1.0
        self._next["begin"] = math.inf

    @property
    def number(self) -> int:
        """Return the number of the plan that was accepted last; 0: none."""
        return int(max(self._held["number"][0], self._next["number"][0]))

    def offer(self, plan: Block, now: float) -> bool:
        """Take a plan over if it can be followed; return whether it was."""
        record = plan[0]
        n = int(record["n"])
        self._go_to(now)
        if plan.dtype != self._held.dtype or not 2 <= n <= record["q"].shape[0]:
            return False
        begin, step = float(record["begin"]), float(record["step"])
        timely = now + self._guard <= begin < math.inf and 0.0 < step < math.inf
        if not (timely and record["number"] > self.number and self._next["n"][0] == 0):
            return False
        rows, speeds = record["q"][:n], record["dq"][:n]
        if not (np.isfinite(rows).all() and np.isfinite(speeds).all() and not speeds[-1].any()):
            return False
        here = _at(self._held, begin)
        if not np.abs(here.q - rows[0]).max() <= self._jump:
            return False
        np.copyto(self._next, plan)
        return True

    def setpoint(self, now: float) -> Setpoint:
        """Return where the robot is to be; ``now`` [s] does not go back."""
        self._go_to(now)
        return _at(self._held, now)

    def _go_to(self, now: float) -> None:
        if self._next["n"][0] > 0 and now >= self._next["begin"][0]:
            self._held, self._next = self._next, self._held
            self._next["n"] = 0


def _at(plan: Block, t: float) -> Setpoint:
    """Interpolate a plan by cubics; at rest in its last row beyond its end."""
    record = plan[0]
    n, q, dq = int(record["n"]), record["q"], record["dq"]
    place = (t - float(record["begin"])) / float(record["step"])
    if not place < n - 1:
        return Setpoint(q[n - 1].copy(), np.zeros_like(q[n - 1]), True)
    i = max(0, int(place))
    x, h = max(0.0, place - i), float(record["step"])
    rise, v, w = q[i + 1] - q[i], h * dq[i], h * dq[i + 1]
    c, d = 3.0 * rise - 2.0 * v - w, v + w - 2.0 * rise
    return Setpoint(q[i] + x * (v + x * (c + x * d)), (v + x * (2.0 * c + x * 3.0 * d)) / h, False)
