"""The robot of a simulation: it holds what is commanded, and follows late and inexactly within the cell."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.running_plan import Motion
from robots.limits import JointLimits
from verifier.cell_tables import Tracking
from verifier.command import Running
from verifier.simulated_silence import OwnStop

Array = NDArray[np.float64]

FINEST_S = 0.002
"""Commands are looked at this often at least."""
QUANTITIES = ("position", "velocity", "acceleration", "jerk", "jump")
"""What is held against the limits; ``jump``: how far a command is from where those before lead."""
_ROUNDING = 1e-6
"""Share of a limit by which rounding may exceed it; the same in rad for positions and jumps."""


class At(NamedTuple):
    """Where the robot truly is: ``q (n,)`` and its commanded velocity ``dq (n,)`` [rad, rad/s; m, m/s]."""

    q: Array
    dq: Array


class SimulatedRobot:
    """Follows a supervisor's running plans with a delay and an error that the cell declares.

    The delay is drawn anew while it rests. The error stays as it was drawn at first; where a velocity error
    is declared, it wanders at most so fast while the robot moves.

    Parameters
    ----------
    limits:
        What commands are held against.
    tracking:
        Delay and errors.
    cycle_s:
        Time between two plans [s].
    q:
        ``(n,)`` where it stands at first [rad; m].
    rng:
        Decides what is left to chance.
    """

    def __init__(
        self,
        limits: JointLimits,
        tracking: Tracking,
        cycle_s: float,
        q: Array,
        rng: np.random.Generator,
    ) -> None:
        assert not isinstance(tracking.position_error_rad, str), "refused when the supervisor was made"
        self.parts = math.ceil(cycle_s / FINEST_S - 1e-9)
        self.worst = dict.fromkeys(QUANTITIES, 0.0)
        self.exceeded = dict.fromkeys(QUANTITIES, 0)
        self._limits, self._tracking, self._rng = limits, tracking, rng
        self._bound, self._rate = tracking.position_error_rad, tracking.velocity_error_rad_s
        self._step = cycle_s / self.parts
        self._half = 0.5 * (limits.position_upper - limits.position_lower)
        ends = np.isfinite(self._half)
        self._middle = np.where(ends, limits.position_lower, 0.0) + np.where(ends, self._half, 0.0)
        self._rows = 3 * self.parts + 4 + math.ceil(tracking.delay_max_s / self._step)
        n = len(q)
        self._q = np.tile(np.asarray(q, dtype=np.float64), (self._rows, 1))
        self._dq, self._ddq = np.zeros((self._rows, n)), np.zeros((self._rows, n))
        self._newest, self._moved_last = self.parts, -self._rows
        self._lag, self._cycle_begins, self._cycle = 0.0, 0.0, cycle_s
        self._error = np.tile(self._some_error(n), (2, 1))
        self._aim = self._some_error(n)

    def hold(self, running: Running, t: float) -> None:
        """Take up what is commanded in the cycle that begins at ``t`` [s], the next one."""
        self._judge(self._take_up(lambda at: running.plan.motion(at - running.begin), t))

    def go_on(self, own: OwnStop, t: float) -> None:
        """Go on alone in the cycle that begins at ``t`` [s], the next one; no limit is held against that."""
        self._take_up(own.motion, t)

    @property
    def newest(self) -> Motion:
        """What was taken up last."""
        row = self._newest % self._rows
        return Motion(self._q[row], self._dq[row], self._ddq[row])

    def _take_up(self, motion: Callable[[float], Motion], t: float) -> NDArray[np.intp]:
        """Write a cycle of motion; return the rows of its begin and parts."""
        rows = (self._newest + np.arange(self.parts + 1)) % self._rows
        for part, row in enumerate(rows.tolist()):
            if part > 0:
                self._q[row], self._dq[row], self._ddq[row] = motion(t + part * self._step)
        self._newest += self.parts
        if self._dq[rows].any():
            self._moved_last = self._newest
        return rows

    def next_cycle(self, k: int) -> None:
        """Choose how delay and error go on in cycle ``k``."""
        first = k * self.parts
        rests = first - self._moved_last > math.ceil(self._tracking.delay_max_s / self._step) + 1
        self._cycle_begins = k * self._cycle
        self._error[0] = self._error[1]
        if rests:
            self._lag = float(self._rng.uniform(self._tracking.delay_min_s, self._tracking.delay_max_s))
            return
        change = self._rate * self._cycle
        self._error[1] += np.clip(self._aim - self._error[1], -change, change)
        if self._rate > 0.0 and not (self._aim - self._error[1]).any():
            self._aim = self._some_error(len(self._aim))

    def at(self, t: float) -> At:
        """Return where the robot is at ``t`` [s], at most the end of what is held."""
        place = max(0.0, (t - self._lag) / self._step)
        i = min(int(place), self._newest - 1)
        x, h = place - i, self._step
        a, b = i % self._rows, (i + 1) % self._rows
        rise, v, w = self._q[b] - self._q[a], h * self._dq[a], h * self._dq[b]
        c, d = 3.0 * rise - 2.0 * v - w, v + w - 2.0 * rise
        dq = (v + x * (2.0 * c + x * 3.0 * d)) / h
        share = min(max((t - self._cycle_begins) / self._cycle, 0.0), 1.0)
        error = self._error[0] + share * (self._error[1] - self._error[0])
        return At(self._q[a] + x * (v + x * (c + x * d)) + error, dq)

    def _some_error(self, n: int) -> Array:
        error: Array = 0.999 * self._rng.uniform(-self._bound, self._bound, n)
        return error

    def _judge(self, rows: NDArray[np.intp]) -> None:
        """Hold commands, and the way from each to the next, against the limits."""
        limits, h, begin, end = self._limits, self._step, rows[:-1], rows[1:]
        q, dq, ddq = self._q[end], self._dq[end], self._ddq[end]
        led = self._q[begin] + h * self._dq[begin] + 0.5 * h * h * self._ddq[begin]
        shares = (
            np.abs(q - self._middle) / self._half,
            np.abs(dq) / limits.velocity,
            np.abs(ddq) / limits.acceleration,
            np.abs(ddq - self._ddq[begin]) / (h * limits.jerk),
            np.maximum(np.abs(q - led) - _ROUNDING, 0.0) / (limits.jerk * h**3 / 6.0),
        )
        for name, share in zip(QUANTITIES, shares, strict=True):
            worst = float(share.max())
            self.worst[name] = max(self.worst[name], worst)
            self.exceeded[name] += not worst <= 1.0 + _ROUNDING
