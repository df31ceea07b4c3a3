"""Assumption A2 held against what the robot reports: does it follow its commands as declared?"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Added to the tracking error [rad; m]."""


class JointReading(NamedTuple):
    """Measured joint positions ``q (n,)`` [rad; m] at ``t`` [s, cell's clock]."""

    t: float
    q: Array


class Deviation(NamedTuple):
    """A joint that was not where any allowed delay would have it.

    ``joint``: number, -1: the reading itself is not usable; ``by``: how far outside [rad; m].
    """

    t: float
    joint: int
    by: float


def between_commands(acceleration: Array, jerk: Array, cycle_s: float, delay: tuple[float, float]) -> Array:
    """Return ``between`` of a monitor for joints with these limits ``(n,)``.

    A cubic through q and dq at two instants h apart is within J h³/96 of a motion with a jerk of at most J
    (the third-order Peano kernel of Hermite interpolation). With a delay that varies, the extremum of the
    motion may lie between two instants at hand, by at most A h²/8 beyond them.
    """
    bound: Array = jerk * cycle_s**3 / 96.0
    if delay[1] > delay[0]:
        bound = bound + acceleration * cycle_s**2 / 8.0
    return bound


_KEPT = 2.0
"""Cycles that readings may be older than ``oldest_s``: a command is for the instant after the next one."""


class TrackingMonitor:
    """Keeps the commands of the recent past and holds readings against them.

    A reading at t agrees iff each joint lies within ``q_error`` of some command between t - ``delay[1]`` and
    t - ``delay[0]``. That is necessary for A2 and not sufficient: the delay of one joint is not compared with
    that of another. A reading from before what is kept of the past, or of what is commanded more than a cycle
    after the newest command, tells nothing about now, and does not agree.

    Parameters
    ----------
    q_error:
        ``(n,)`` bound of the joint error [rad; m].
    delay:
        Smallest and largest delay between command and robot [s].
    cycle_s:
        Time between two commands [s].
    between:
        ``(n,)`` how far the commanded motion may be from what is interpolated between its commands, and may
        go beyond the values at hand between two of them [rad; m]; see :func:`between_commands`.
    oldest_s:
        Readings can be compared up to this [s], and two cycles, before the newest command.

    Raises
    ------
    SetupError
        ``oldest_s`` is negative or not finite.
    """

    def __init__(
        self,
        q_error: Array,
        delay: tuple[float, float],
        cycle_s: float,
        between: Array | None = None,
        oldest_s: float = 0.25,
    ) -> None:
        if not 0.0 <= oldest_s < math.inf:
            raise SetupError(f"oldest reading of {oldest_s} s should be finite and not negative")
        self._q_error = np.asarray(q_error, dtype=np.float64)
        self._allowed = self._q_error + _ROUNDING + (0.0 if between is None else between)
        self._delay = delay
        self._oldest, self._ahead = oldest_s + _KEPT * cycle_s, delay[0] + cycle_s * (1.0 + _ROUNDING)
        self.rows = 4 + math.ceil((delay[1] + oldest_s) / cycle_s)
        n = len(self._q_error)
        self._t = np.full(self.rows, math.nan)
        self._q, self._dq = np.full((self.rows, n), math.nan), np.full((self.rows, n), math.nan)
        self._newest = -1

    def note(self, t: float, q: Array, dq: Array) -> None:
        """Keep a command; ``t`` [s] increases, or is that of the last one, which is then replaced."""
        if self._newest < 0 or t != self._t[self._newest]:
            self._newest = (self._newest + 1) % len(self._t)
        self._t[self._newest], self._q[self._newest], self._dq[self._newest] = t, q, dq

    def check(self, reading: JointReading) -> Deviation | None:
        """Return how a reading disagrees with the commands; ``None``: it does not, or there are none yet."""
        q = np.asarray(reading.q, dtype=np.float64)
        if q.shape != self._q_error.shape or not (np.isfinite(q).all() and math.isfinite(reading.t)):
            return Deviation(reading.t, -1, math.inf)
        begin, end = reading.t - self._delay[1], reading.t - self._delay[0]
        order = np.argsort(self._t)[: np.count_nonzero(np.isfinite(self._t))]
        if len(order) == 0:
            return None
        t = self._t[order]
        if not -self._oldest <= reading.t - t[-1] <= self._ahead:
            return Deviation(reading.t, -1, math.inf)
        at = np.clip([begin, end], t[0], t[-1])
        inside = order[(t > at[0]) & (t < at[1])]
        places = np.concatenate([self._between(order, at), self._q[inside]])
        outside = np.maximum(places.min(axis=0) - q, q - places.max(axis=0)) - self._allowed
        worst = int(np.argmax(outside))
        return None if outside[worst] <= 0.0 else Deviation(reading.t, worst, float(outside[worst]))

    def _between(self, order: NDArray[np.intp], at: Array) -> Array:
        """Interpolate the commands at two instants ``(2, n)``, cubic between each two."""
        t = self._t[order]
        left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(0, len(t) - 2))
        right = np.minimum(left + 1, len(t) - 1)
        h = np.where(right > left, t[right] - t[left], 1.0)
        x = ((at - t[left]) / h)[:, None]
        a, b = order[left], order[right]
        v, w = h[:, None] * self._dq[a], h[:, None] * self._dq[b]
        rise = self._q[b] - self._q[a]
        places: Array = self._q[a] + x * (v + x * (3.0 * rise - 2.0 * v - w + x * (v + w - 2.0 * rise)))
        return places
