"""Points that are passed on again: what was last read of everybody, and what therefore is nothing new."""

from __future__ import annotations

import math

import numpy as np

from occupancy.humans.kernels import note_reading, refuse_repeats
from occupancy.hypotheses import LAST
from robots.motion import Block

_TAKEN, _ASIDE = 0, 1


class Repeats:
    """Remembers where persons were last read in reports of each frame, however often one report lists them.

    Every listing is compared with the last sixteen different places of each point, so that up to sixteen
    listings or sources that take turns under one name are told from what is measured. What arrives late and
    what is refused is noted apart: it does not push out what is newer. Nothing is forgotten when somebody
    leaves: coordinates that come back unchanged were held.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[int, str], Block] = {}
        self._newest: dict[tuple[int, str], float] = {}
        self._late: dict[int, bool] = {}

    def begin(self) -> None:
        """Begin a report."""
        self._late.clear()

    def refuse(self, number: int, frame: str, reading: np.void, stamp: float) -> None:
        """Refuse the points of a READING record of a person that stand where they stood before; note them.

        ``stamp`` [s] of the report.
        """
        key = number, frame
        if key not in self._known:
            self._known[key], self._newest[key] = np.full(2, np.nan, dtype=LAST), -math.inf
        known = self._known[key]
        refuse_repeats(reading, known)
        late = self._late.setdefault(number, stamp <= self._newest[key])
        note_reading(reading, stamp, known[_ASIDE if late else _TAKEN], known[_ASIDE])
        self._newest[key] = max(stamp, self._newest[key])
