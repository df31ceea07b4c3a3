"""Who is no longer there: complete reports read as roll calls (*Leaving* in :mod:`occupancy.hypotheses`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from occupancy.hypotheses import Hypotheses
from occupancy.region import Monitored
from robots.motion import Block


class RollCall:
    """Follows one report after the other, and removes from the hypotheses who has left.

    Parameters
    ----------
    hypotheses:
        Whose rows and ``t_complete`` it changes.
    limits:
        BODY block: speeds.
    monitored:
        What is watched; with nothing watched nobody ever leaves.
    """

    def __init__(self, hypotheses: Hypotheses, limits: Block, monitored: Sequence[Monitored]) -> None:
        self._hypotheses = hypotheses
        self._rows = hypotheses.people[0]
        self._rows["unlisted"] = int(bool(monitored))
        self._speed = limits["speed"][0].copy()
        self._monitored = tuple(monitored)
        self._vanished: set[int] = set()
        self._t_obs = np.nan
        self._open = self._whole = self._newer = False
        self._listed: set[int] = set()
        self._missing: set[int] = set()
        self._explained: set[int] = set()

    @property
    def vanished(self) -> frozenset[int]:
        """Persons who must be in a region, but were missing from a complete report of it."""
        return frozenset(self._vanished)

    def begin(self, t_obs: float, complete: bool, missing: Iterable[int]) -> None:
        """Begin a report, seen at ``t_obs`` = stamp minus stamp error [s].

        ``complete``: it is usable and marked complete; ``missing``: persons whom it does not list.
        """
        self._t_obs = t_obs
        self._open = bool(self._monitored) and complete and t_obs > self._rows["t_complete"]
        self._whole = self._newer = True
        self._listed, self._missing, self._explained = set(), set(missing), set()

    def hear(self, person: int | None, reading: np.void, newer: bool) -> None:
        """Take note of a listed person before the reading is taken in; ``None``: there is no row for them."""
        if person is not None:
            self._vanished.discard(person)
        if not self._open or person is None:
            return
        self._whole &= person not in self._listed and int(reading["present"]) != 0
        self._newer &= newer
        self._listed.add(person)
        self._explained |= {other for other in self._missing if self._hypotheses.may_be(other, reading)}

    def close(self, seen_before: Iterable[int]) -> tuple[int, ...]:
        """Draw the conclusions of a report once everybody in it was taken in; return who has left.

        ``seen_before``: persons whose newest reading is older than the report.
        """
        if not (self._open and self._whole):
            return ()
        self._rows["t_complete"] = self._t_obs
        if not self._newer:
            return ()
        candidates = self._missing & set(seen_before)
        left = tuple(person for person in sorted(candidates) if self._may_go(person))
        for person in left:
            self._hypotheses.remove_person(person)
            self._vanished.discard(person)
        for person in self._listed if left else ():
            self._hypotheses.keep_only(person, self._t_obs)
        return left

    @property
    def counted(self) -> bool:
        """Whether the report that was closed last is the newest complete one."""
        return self._open and self._whole

    def _may_go(self, person: int) -> bool:
        """Whether the absence of a person who was seen before can be explained."""
        if person in self._explained:
            return True
        if person in self._vanished or self._certainly_inside(person):
            self._vanished.add(person)
            return False
        return True

    def _certainly_inside(self, person: int) -> bool:
        """Whether every row has a point that was inside of one region throughout its detection time."""
        rows = self._rows
        slack = 2.0 * float(rows["stamp_error"] + rows["clock_error"])
        own = self._hypotheses.rows_of(person)
        for watched in self._monitored:
            elapsed = np.abs(self._t_obs - rows["t_obs"][own]) + watched.detection_time_s + slack
            needed = rows["e_p"][own] + self._speed * elapsed + watched.boundary_error_m
            if (watched.region.depth(rows["xyz"][own]) >= needed).any(axis=1).all():
                return True
        return False
