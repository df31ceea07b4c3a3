"""Somebody who walks up, takes the tool, leads it aside, lets go and leaves: touch and camera in one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from modes.contact.experiments import GRIP
from modes.contact.touches import Hand
from modes.contact.twin import Twin
from modes.reaching_person import outwards, report_of
from occupancy.report import RawMeasurement

Array = NDArray[np.float64]

_WALK_M_S, _FAR_M = 1.0, 4.0


@dataclass(slots=True)
class Guest:
    """A person whose right hand holds the tool for a while.

    Attributes
    ----------
    twin:
        Whose tool.
    hand:
        How the tool is led.
    seen_after:
        Control steps from a measurement to its arrival.
    """

    twin: Twin
    hand: Hand = field(default_factory=lambda: Hand(GRIP, 8.0, 14.0, (0.0, 0.15, 0.05), moving_s=2.0))
    seen_after: int = 2
    _seen: deque[tuple[float, Array]] = field(default_factory=deque)
    _left: Array | None = None

    def reports(self, t: float) -> Sequence[RawMeasurement]:
        """Return what arrives at ``t`` [s]: where the person was some steps before; called every step."""
        self._seen.append((t, self.place(t)))
        stamp, place = self._seen[0]
        if len(self._seen) > self.seen_after:
            self._seen.popleft()
        return [report_of(place, stamp, t)]

    def place(self, t: float) -> Array:
        """Return where the hand is (3,) [m]: on the tool, or on its way there or back."""
        spot = self.twin.where(self.hand.spot)
        if t >= self.hand.end_s:
            self._left = spot if self._left is None else self._left
            spot = self._left
        away = max(self.hand.begin_s - t, t - self.hand.end_s, 0.0)
        place: Array = spot + min(_WALK_M_S * away, _FAR_M) * outwards(spot)
        return place
