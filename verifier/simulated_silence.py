"""What a simulated robot does by itself when no command comes, within what the cell declares (A4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from failsafe.running_plan import Motion
from failsafe.silence import Silence
from robots.limits import JointLimits

Array = NDArray[np.float64]

_SHORT_OF_THE_END = 1e-3
"""A joint stands still at once where it comes this near to the end of its range [rad; m]."""


class OwnStop:
    """The motion of a robot from the instant at which no command followed until it rests.

    Each joint by itself goes on for some of the time that it may, as often as not for all of it, and brakes
    as softly as it may, or harder. Before the end of its range a joint stands still at once.

    Parameters
    ----------
    silence, limits:
        What is declared; where joints end.
    begin:
        Instant at which no command followed [s].
    state:
        Commanded q, dq, ddq then.
    rng:
        Decides what is left to chance.
    """

    def __init__(
        self, silence: Silence, limits: JointLimits, begin: float, state: Motion, rng: np.random.Generator
    ) -> None:
        n = len(state.q)
        self._begin = begin
        self._q, self._dq = state.q.copy(), state.dq.copy()
        self._ddq = state.ddq.copy() if silence.extrapolates else np.zeros(n)
        self._hold = silence.hold_s * rng.choice([0.0, 0.5, 1.0, 1.0], n)
        self._brake = silence.deceleration * rng.choice([1.0, 1.0, 2.0, 20.0], n)
        self._fastest = self._dq + self._ddq * self._hold
        self._braking = np.abs(self._fastest) / self._brake
        self.end = begin + float((self._hold + self._braking).max())
        self._low = np.minimum(limits.position_lower + _SHORT_OF_THE_END, self._q)
        self._high = np.maximum(limits.position_upper - _SHORT_OF_THE_END, self._q)

    def motion(self, t: float) -> Motion:
        """Return q, dq, ddq at ``t`` [s], not before the begin."""
        x = t - self._begin
        held, braked = np.minimum(x, self._hold), np.clip(x - self._hold, 0.0, self._braking)
        slower = np.sign(self._fastest) * self._brake
        q = self._q + held * (self._dq + 0.5 * self._ddq * held)
        q += braked * (self._fastest - 0.5 * slower * braked)
        dq = np.where(x <= self._hold, self._dq + self._ddq * x, self._fastest - slower * braked)
        dq[x >= self._hold + self._braking] = 0.0
        dq[(q < self._low) | (q > self._high)] = 0.0
        return Motion(np.clip(q, self._low, self._high), dq, np.zeros_like(q))
