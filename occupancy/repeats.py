"""Points that are passed on again: what was last read of everybody, and what therefore is nothing new."""

from __future__ import annotations

import math

import numpy as np

from occupancy.humans.kernels import note_reading, refuse_repeats
from occupancy.hypotheses import LAST
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block

_LATE = 0


class Repeats:
    """Remembers where persons were last read in reports of each frame, however often one report lists them.

    A report may list a person several times, so each listing is compared with the last one of every rank;
    from the sixteenth on they share a place. What arrives late is noted apart: it does not hide what is
    newer. Nothing is forgotten when somebody leaves: coordinates that come back unchanged were held.
    """

    def __init__(self) -> None:
        self._last: dict[tuple[int, str], Block] = {}
        self._newest: dict[tuple[int, str], float] = {}
        self._listings: dict[int, int] = {}
        self._late: dict[int, bool] = {}

    def begin(self) -> None:
        """Begin a report."""
        self._listings.clear()
        self._late.clear()

    def refuse(self, number: int, frame: str, reading: np.void, stamp: float) -> None:
        """Refuse the points of a READING record of a person that stand where they stood before; note them.

        ``stamp`` [s] of the report.
        """
        key = number, frame
        last = self._last.get(key, np.empty(0, dtype=LAST))
        refuse_repeats(reading, last)
        rank = self._listings[number] = self._listings.get(number, 0) + 1
        late = self._late.setdefault(number, stamp <= self._newest.get(key, -math.inf))
        place = _LATE if late else min(rank, MAX_PEOPLE)
        if place >= len(last):
            more = np.full(place + 1 - len(last), np.nan, dtype=LAST)
            last = self._last[key] = np.concatenate((last, more))
        note_reading(reading, stamp, last[place])
        self._newest[key] = max(stamp, self._newest.get(key, -math.inf))
