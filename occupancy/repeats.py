"""Points that are passed on again: what was last read of everybody, and what therefore is nothing new."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from occupancy.gate_kernels import refuse_and_note
from occupancy.hypotheses import LAST
from robots.motion import Block

PERSONS = 64
"""Of how many persons it is kept where they were read: those who were listed last."""
_TAKEN, _ASIDE = 0, 1


@dataclass
class _Known:
    """Where a person was read in reports of one frame, and the newest stamp [s] of these."""

    places: Block
    newest: float = -math.inf


@dataclass
class _Person:
    """What is known of a person by frame; ``forgotten``: there may have been more."""

    forgotten: bool
    frames: dict[str, _Known] = field(default_factory=dict)

    def known(self, frame: str) -> _Known:
        """Return what is known from reports of a frame."""
        if frame not in self.frames:
            places = np.full(2, np.nan, dtype=LAST)
            if self.forgotten:
                places["xyz"][_TAKEN] = math.inf
            self.frames[frame] = _Known(places)
        return self.frames[frame]


class Repeats:
    """Remembers where persons were last read in reports of each frame, however often one report lists them.

    Every listing is compared with the last sixteen different places of each point, so that up to sixteen
    listings or sources that take turns under one name are told from what is measured. What arrives late and
    what is refused is noted apart: it does not push out what is newer. Nothing is forgotten when somebody
    leaves: coordinates that come back unchanged were held.

    Memory is bounded: who was not listed for longest is forgotten once ``persons`` others were listed since.
    If they come back, any reading may be one of the forgotten ones until sixteen different places have been
    met, which by then would have taken the place of all that was known; so none of these is believed. What
    had been noted apart is lost.
    """

    def __init__(self, persons: int = PERSONS) -> None:
        self._most = persons
        self._persons: dict[int, _Person] = {}
        self._forgotten_below = 0
        self._late: dict[int, bool] = {}

    def begin(self) -> None:
        """Begin a report."""
        self._late.clear()

    def refuse(self, number: int, frame: str, reading: Block, stamp: float) -> bool:
        """Refuse the points of a READING block of a person that stand where they stood before; note them.

        ``stamp`` [s] of the report. Returns whether any point of the reading is refused, for whatever reason.
        """
        known = self._listed(number).known(frame)
        late = self._late.setdefault(number, stamp <= known.newest)
        known.newest = max(stamp, known.newest)
        return bool(refuse_and_note(reading, known.places, stamp, _ASIDE if late else _TAKEN, _ASIDE))

    def _listed(self, number: int) -> _Person:
        """Return what is known of a person, who is now the last one who was listed."""
        person = self._persons.pop(number, None)
        if person is None:
            person = _Person(forgotten=number < self._forgotten_below)
        self._persons[number] = person
        if len(self._persons) > self._most:
            oldest = next(iter(self._persons))
            del self._persons[oldest]
            self._forgotten_below = max(self._forgotten_below, oldest + 1)
        return person
