"""Who is faster than the profile, seen over a longer time: from one report to the next, errors hide it.

A reading agrees with the one before it if it lies within v Δt + 2 e; at 60 reports a second and an error of
10 mm that lets pass whoever is 1.2 m/s faster than the profile. Half a second later the same errors hide no
more than 40 mm/s. So each point is also held against where it was read at moments of the last half second.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from occupancy.body import MAX_POINTS, Point, Profile
from occupancy.pace_kernels import keep_moment, outpaced
from occupancy.report import Contradiction
from robots.motion import Block

MOMENTS: Final = 32
LEAST_S: Final = 1.0 / 64.0
"""Time between two moments that are kept, at least [s]: all of them together are the last half second, or
more where reports are rarer."""

PAST = np.dtype(
    [
        ("n", np.int64),
        ("newest", np.float64),
        ("t", np.float64, (MOMENTS, MAX_POINTS)),
        ("xyz", np.float64, (MOMENTS, MAX_POINTS, 3)),
        ("e_p", np.float64, (MOMENTS, MAX_POINTS)),
    ]
)
"""Where the points of one person were read at the last moments, as in PEOPLE; ``t`` NaN: not, or perhaps
those of the other side. ``n``: how many moments there ever were; ``newest`` [s]: time of the last one."""


class Pace:
    """Holds people against the speeds of a profile, over the last half second.

    Attributes
    ----------
    contradicted:
        Whether somebody was outpaced when :meth:`hold` was called last.
    """

    def __init__(self, profile: Profile) -> None:
        self._speed = np.ascontiguousarray(profile.speed, dtype=np.float64)
        self._past: dict[int, Block] = {}
        self.contradicted = False

    def hold(self, people: Block, ids: tuple[str, ...]) -> tuple[Contradiction, ...]:
        """Compare the rows of ``people`` (PEOPLE) with what was kept of them; return who was too fast.

        ``ids``: names of people by their number. Somebody with several rows contradicts their own reports
        already: then nothing is compared, and nothing forgotten. Of those without a row nothing is kept.
        """
        rows = people["person"][0, : int(people["n"][0])].tolist()
        for number in [number for number in self._past if number not in rows]:
            del self._past[number]
        found: list[Contradiction] = []
        for row, number in enumerate(rows):
            if rows.count(number) == 1:
                found += self._hold_one(people, row, number, ids)
        self.contradicted = bool(found)
        return tuple(found)

    def _hold_one(self, people: Block, row: int, number: int, ids: tuple[str, ...]) -> list[Contradiction]:
        past = self._past.get(number)
        if past is None:
            past = self._past[number] = np.zeros(1, dtype=PAST)
            past["t"], past["newest"] = np.nan, -np.inf
        p, moment, distance, allowed = outpaced(people, row, past, self._speed)
        found = []
        if p >= 0:
            stamp = float(people["t_obs"][0, row, p] + people["stamp_error"][0])
            elapsed = abs(float(people["t_obs"][0, row, p] - past["t"][0, moment, p]))
            found.append(Contradiction(stamp, ids[number], Point(p), Point(p), distance, allowed, elapsed))
        keep_moment(people, row, past, LEAST_S)
        return found
