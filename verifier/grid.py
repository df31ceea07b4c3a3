"""The instants at which a loop of fixed rate makes its steps."""

from __future__ import annotations

import math

from failsafe.short_term_plan import LATEST_CLOCK_S


class Grid:
    """Instants t_k = t_0 + k cycles; t_0 is when the first step was called.

    Attributes
    ----------
    origin, k:
        t_0 [s], and the cycle that it is now.
    went_back:
        The clock showed less than before: how much time has passed since then is not known.
    """

    def __init__(self, cycle_s: float, early_s: float) -> None:
        self._cycle, self._early = cycle_s, early_s
        self.origin = math.nan
        self.k = -1
        self.went_back = False
        self._latest = -math.inf

    def advance(self, now: float) -> int:
        """Go to the cycle that holds ``now`` [s]; return how many that is, 0 if time does not advance."""
        self.went_back = now < self._latest
        if not abs(now) <= LATEST_CLOCK_S:
            return 0
        self._latest = now
        if self.k < 0:
            self.origin, self.k = now, 0
            return 1
        k = math.floor((now - self.origin + self._early) / self._cycle)
        steps = k - self.k
        if steps <= 0:
            return 0
        self.k = k
        return steps
