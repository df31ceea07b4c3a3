"""Who is no longer there: complete reports read as roll calls (*Leaving* in :mod:`occupancy.hypotheses`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set

import numpy as np
from numpy.typing import NDArray

from occupancy.hypotheses import Hypotheses
from occupancy.region import Monitored
from robots.motion import Block

Array = NDArray[np.float64]


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
        self._second_names: set[int] = set()
        self._t_obs = self._t_before = np.nan
        self._open = self._whole = self._newer = False
        self._listed: set[int] = set()
        self._missing: set[int] = set()
        self._inside: set[int] = set()
        self._may_be: list[set[int]] = []
        self._before: Block = hypotheses.people
        self._first: list[tuple[int, np.void]] = []

    @property
    def asked(self) -> bool:
        """Whether there is a region that complete reports cover; without one there are no roll calls."""
        return bool(self._monitored)

    @property
    def vanished(self) -> Set[int]:
        """Persons who must be in a region, but were missing from a complete report of it; changes."""
        return self._vanished

    def begin(self, t_obs: float, complete: bool, missing: Iterable[int]) -> None:
        """Begin a report, seen at ``t_obs`` = stamp minus stamp error [s].

        ``complete``: it is usable and marked complete; ``missing``: persons whom it does not list.
        """
        self._t_obs, self._t_before = t_obs, float(self._rows["t_complete"])
        self._open = bool(self._monitored) and complete and t_obs > self._t_before
        self._whole = self._newer = True
        self._listed, self._missing = set(), set(missing)
        self._may_be, self._first = [], []
        asked = self._open and self._missing
        if asked:
            self._before = self._hypotheses.people.copy()
        self._inside = {person for person in self._hypotheses.persons if asked and self._certain(person)}

    def hear(self, person: int | None, reading: np.void, newer: bool) -> None:
        """Take note of a listed person before the reading is taken in; ``None``: there is no row for them."""
        if person is None or not self._monitored:
            return
        if self._t_obs > self._t_before:
            self._vanished.discard(person)
        if not any(self._rows["present"][self._hypotheses.rows_of(person)]):
            self._first.append((person, reading.copy()))
        if not self._open:
            return
        self._whole &= person not in self._listed and int(reading["present"]) != 0
        self._newer &= newer
        self._listed.add(person)
        if self._missing:
            self._may_be.append(self._hypotheses.who_may_be(self._before, reading))

    def close(self, seen_before: Iterable[int]) -> tuple[int, ...]:
        """Draw the conclusions of a report once everybody in it was taken in; return who has left.

        ``seen_before``: persons whose newest reading is older than the report.
        """
        self._look_for_second_names()
        if not (self._open and self._whole):
            return ()
        self._rows["t_complete"] = self._t_obs
        if not self._newer:
            return ()
        candidates = self._missing & set(seen_before)
        self._vanished |= self._unexplained(candidates)
        left = tuple(sorted(candidates - self._vanished))
        for person in left:
            self._hypotheses.remove_person(person)
        if left:
            self._second_names.clear()
            for person in self._listed:
                self._hypotheses.keep_only(person, self._t_obs)
        return left

    @property
    def counted(self) -> bool:
        """Whether the report that was closed last is the newest complete one."""
        return self._open and self._whole

    def _unexplained(self, candidates: set[int]) -> set[int]:
        """Who of ``candidates``, seen before and missing now, must be in a region; forgets who is explained.

        One reading stands for one body. So each of those who must be there, listed or not, needs a reading of
        their own that agrees with what was known of them before this report, in whatever order it lists
        people; listed ones whom no reading agrees with are contradicted anyway.
        """
        must = candidates & (self._inside | self._vanished) - self._second_names
        agreed = set().union(*self._may_be)
        bodies = must | (self._inside & self._listed & agreed) - self._second_names
        if must and not _each_has_one(sorted(bodies), self._may_be):
            return must
        self._vanished -= candidates
        return set()

    def _look_for_second_names(self) -> None:
        """Note whoever was seen for the first time in this report, but cannot be anybody new.

        Somebody who was inside throughout the detection time before the complete report before this one was
        listed in it by A5, under another id; if they may be someone who has rows, they are no further body.
        """
        for person, reading in self._first:
            others = self._hypotheses.persons - {person}
            if self._was_inside(reading["xyz"], reading["e_p"], self._t_obs - self._t_before) and any(
                self._hypotheses.may_be(other, reading) for other in others
            ):
                self._second_names.add(person)

    def _certain(self, person: int) -> bool:
        """Whether every row of a person has a point that was inside throughout the detection time."""
        rows = self._rows
        own = self._hypotheses.rows_of(person)
        return all(
            self._was_inside(rows["xyz"][k], rows["e_p"][k], self._t_obs - rows["t_obs"][k]) for k in own
        )

    def _was_inside(self, xyz: Array, e_p: Array, elapsed: Array | float) -> bool:
        """Whether some point (20, 3) [m] was inside of one region throughout the detection time before.

        ``e_p`` (20,) [m]; ``elapsed`` [s]: between seeing the point and the report.
        """
        slack = 2.0 * float(self._rows["stamp_error"] + self._rows["clock_error"])
        for watched in self._monitored:
            grown = self._speed * (np.abs(elapsed) + watched.detection_time_s + slack)
            if (watched.region.depth(xyz) >= e_p + grown + watched.boundary_error_m).any():
                return True
        return False


def _each_has_one(bodies: Sequence[int], may_be: Sequence[set[int]]) -> bool:
    """Whether each body can be given a reading of its own among those that ``may_be`` it."""
    taken: dict[int, int] = {}

    def give(body: int, tried: set[int]) -> bool:
        for reading, who in enumerate(may_be):
            if body in who and reading not in tried:
                tried.add(reading)
                if reading not in taken or give(taken[reading], tried):
                    taken[reading] = body
                    return True
        return False

    return all(give(body, set()) for body in bodies)
