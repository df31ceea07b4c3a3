"""Points that are passed on again: what was last read of everybody, and what therefore is nothing new."""

from __future__ import annotations

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
        self._listings: dict[int, int] = {}

    def begin(self) -> None:
        """Begin a report."""
        self._listings.clear()

    def refuse(self, number: int, frame: str, reading: np.void) -> None:
        """Refuse the points of a READING record of a person that stand where they stood before."""
        self._listings[number] = self._listings.get(number, 0) + 1
        if (number, frame) in self._last:
            refuse_repeats(reading, self._last[number, frame])

    def note(self, number: int, frame: str, reading: np.void, stamp: float, *, late: bool) -> None:
        """Note what was read of a person in a report of a ``stamp`` [s], refused before in the same one."""
        place = _LATE if late else min(self._listings[number], MAX_PEOPLE)
        last = self._last.get((number, frame), np.empty(0, dtype=LAST))
        if place >= len(last):
            more = np.full(place + 1 - len(last), np.nan, dtype=LAST)
            last = self._last[number, frame] = np.concatenate((last, more))
        note_reading(reading, stamp, last[place])
