"""What is held possible about every person: rows that are hypotheses, and how a reading changes them.

A row *holds* at time t iff each of its points is then within e_p + v |t - t_obs| of its ``xyz``. Kept is (I):

    at every instant, at least one row of every person holds.

A part counts as separated only if it is separated for all rows, so whichever row holds, the body is inside of
what was checked. Reports are trusted this far, which is weaker than A6 together with A1, and called (R):

    a report that agrees with a row that holds is true; when no row holds any more, the report is true.

So an erroneous report shows by disagreeing with the truth, and does not coincide with a person who outruns
the profile. A report N *agrees* with a row iff no point of N is farther from a point of the row than A1 and
the profile's sizes allow for the time between (:func:`occupancy.humans.kernels.contradiction`). On its
arrival

- rows that N disagrees with stay as they are and keep growing;
- all rows that N agrees with are replaced by **one** row, or N is added as a row if there are none.

(I) survives. Let h hold. If N disagrees with h, h stays, and keeps holding under A1. If N agrees with h, N is
true by (R), and so holds the row that replaces h if it claims no more than N does; the other rows that go
were not needed. If no row holds because A1 failed on the way, N is true, and a row with N's points is written
in either case. (A failure at a point that N does not show stays unnoticed until that point is seen.) When N
agrees with all rows, one row is left and the contradiction is over.

**Exchanged sides.** A report that agrees may still have the names of some pairs exchanged, left for right, if
it agrees so as well. Then the errors of these points are widened until each is right whichever is which
(:func:`occupancy.humans.kernels.widen_exchanged`), and (R) is demanded of what is left: that at most such
pairs are exchanged whose last reading in the row was right. Hence what is possible is judged by the errors
with which points were *read*, not by widened ones: else one doubt would nourish the next for ever. An
exchange that is out of reach disagrees. One that lasts is taken for the truth once a row that it disagreed
with has grown so far that it agrees; where it exchanges whole limbs, that only renames the places that are
covered, and where it exchanges single points of a limb, limb lengths are what can tell.

**Points of different age.** N may lack points that a row has. Keeping such an old point beside N's claims
that both hold. With a single row h that N agrees with, h holds by (I), N is true by (R), hence the mixed row
holds; each of its points has its own t_obs and grows on its own. With several rows it does not follow: N may
agree with a row s that does not hold and disagree with h, which does or did. N may still be true (A1 failed
after h) while the points left over from s are wrong, and a capsule from a wrong old elbow to a true new wrist
contains no arm. So where there were several rows, the new one has N's points only; parts that these do not
show are inferred from those that they do.

**Overflow.** Every one of ``max_people`` persons has a row reserved. Where no row is left for a new
hypothesis, it is merged with a row of the same person: for each point that both have, a ball that contains
both, while points that one of them lacks are dropped. If either held, the merged row does, so (I) survives;
nevertheless ``overflow`` is set and nothing may be verified until a report agrees with all rows of that
person.

**Leaving.** Without a monitored region nobody ever leaves. With one, everybody who is *not listed* in the
newest complete report N is an obligation of their own, which the unobserved space alone can prove
(:class:`occupancy.humans.unobserved.UnobservedSpace`): the people block demands it (``unlisted``), whatever
else is configured. Then (I) is needed only in this form (J):

    at every instant, every person is in the unobserved space of N, or N listed them under some id, at least
    one row of which holds.

Take any person P and a new complete report N, seen at τ. If some part of P was in the region throughout the
detection time before τ, N lists P under some id by A5; by (R) what it says is true, and it has just been
written into a row of that id (beside older points only where ids are trusted to mean the same body).
Otherwise P was outside at an instant of that interval, which is what the unobserved space of N starts from.
Neither case uses rows of ids that N does *not* list, so these may go: who left is in the unobserved space,
who only changed their id is listed under the other one. The detection time is why "not listed" must not be
read as "outside at τ": a person may have been inside for almost that long, and the front starts from τ less
the detection time. And where the person was last seen decides nothing: a ghost in the middle of the region
and a person on its border go by the same argument, but the latter only *into* the unobserved space, never
into nothing.

Conditions, each needed:

- N is complete, usable as a whole, newer than the complete report before it, lists no id twice, and something
  could be read of everybody whom it lists: somebody listed without a point may be just the one who is missed.
  Otherwise N is no new start for the unobserved space either, which keeps growing from the older one.
- Everybody listed is seen there later than before. (An id seen even later, by another sensor, has a row from
  then, and need not be the one that N means. That the unobserved space starts from N all the same rests on
  ids that mean the same body in both.) Whoever goes was themselves seen before N.
- Afterwards, where a row of a listed id has points older than N, only those of N stay: the id may have
  changed hands, and points of two bodies make no row that holds. Velocities are forgotten with them.
- One who was *certainly* inside throughout the detection time, by a row's point, its error and its speed,
  must be listed under another id. One reading stands for one body: if the readings of N cannot be shared out
  so that each of those who must be there, listed or not, has one of their own that agrees with some row of
  theirs, reports contradict A5 (two were merged into one, for example): whoever is missing stays, keeps
  growing, and nothing is verified until they are listed again or there is a reading for each. (J) does not
  need that; it is there because a tracker that drops or merges people is what most likely breaks A5.
- A *second name* needs no reading: somebody first seen where nobody can have come in since the last complete
  report was listed in that one by A5, under another id; if they agree with somebody who has rows, they are no
  further body (one was split into two, for example). Once anybody has left, nobody counts as a second name.
- One of whom nothing was ever read stays: nothing could explain their absence.

Numbers of persons stay with their ids for good; who comes back gets a new row, which claims nothing older. A
late report from before somebody left does not bring them back: (J) covers them.
"""

from __future__ import annotations

import math
from collections.abc import Set
from typing import NamedTuple

import numpy as np

from occupancy.body import MAX_POINTS, Point
from occupancy.gate_kernels import take_agreeing
from occupancy.humans.kernels import (
    ROUNDING_M,
    contradiction,
    estimate_velocities,
    mark_too_far_apart,
    widen_exchanged,
    write_points,
)
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block

PEOPLE = np.dtype(
    [
        ("n", np.int64),
        ("clock_error", np.float64),
        ("stamp_error", np.float64),
        ("unlisted", np.int64),
        ("t_complete", np.float64),
        ("person", np.int32, (MAX_PEOPLE,)),
        ("t_obs", np.float64, (MAX_PEOPLE, MAX_POINTS)),
        ("present", np.uint32, (MAX_PEOPLE,)),
        ("xyz", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("e_p", np.float64, (MAX_PEOPLE, MAX_POINTS)),
        ("e_read", np.float64, (MAX_PEOPLE, MAX_POINTS)),
        ("v", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("e_v", np.float64, (MAX_PEOPLE, MAX_POINTS)),
    ]
)
"""Last admitted values: one row per hypothesis about a person. ``person``: index into
:attr:`Gate.person_ids`; ``present``: bit per :class:`~occupancy.body.Point` that was ever admitted; ``xyz``
[m, world frame] within ``e_p`` [m]; ``e_read`` [m]: the same without allowing for exchanged sides; ``t_obs``
[s]: stamp minus ``stamp_error`` [s], so that the point was seen in [t_obs - clock_error, t_obs + 2
stamp_error + clock_error]; ``v`` [m/s] within ``e_v``, inf: unknown. A row without any present point is a
person of whom nothing is known but that they are there. ``unlisted``: 1 if people may be there whom no row
stands for, so that person number ``n`` is to be proven apart as well, which only models of the unobserved
space can; ``t_complete`` [s]: stamp minus ``stamp_error`` of the newest complete report, -inf if there is
none."""

HISTORY_DEPTH = 16
"""Samples of a point that are kept for its velocity."""

HISTORY = np.dtype(
    [
        ("n", np.int64, (MAX_PEOPLE, MAX_POINTS)),
        ("t", np.float64, (MAX_PEOPLE, MAX_POINTS, HISTORY_DEPTH)),
        ("xyz", np.float64, (MAX_PEOPLE, MAX_POINTS, HISTORY_DEPTH, 3)),
        ("e_p", np.float64, (MAX_PEOPLE, MAX_POINTS, HISTORY_DEPTH)),
    ]
)
"""The last readings of every point of every row, from which its velocity is found; ``n``: how many there ever
were, the newest at (n - 1) modulo the depth."""

PLACES = 16
"""Different places of a point that are kept, for telling what is passed on."""

READING = np.dtype(
    [
        ("measured", np.int64),
        ("present", np.int64),
        ("t_obs", np.float64),
        ("seen", np.float64, (MAX_POINTS, 3)),
        ("xyz", np.float64, (MAX_POINTS, 3)),
        ("e_p", np.float64, (MAX_POINTS,)),
        ("e_read", np.float64, (MAX_POINTS,)),
        ("reason", np.int8, (MAX_POINTS,)),
        ("value", np.float64, (MAX_POINTS,)),
        ("too_far_apart", np.int64),
    ]
)
"""One person of one report as it was read; ``too_far_apart``: bit per point that was seen farther from
another one than the profile's sizes allow, position errors granted."""

LAST = np.dtype(
    [("xyz", np.float64, (MAX_POINTS, PLACES, 3)), ("stamp", np.float64, (MAX_POINTS, PLACES))],
)
"""The last different places at which each point of a person was seen, the one that was met last in front, and
the stamp with which it was first seen there; NaN: none, infinite: one that was forgotten."""


class Disagreement(NamedTuple):
    """``point`` of a reading was farther from where ``earlier`` had been than the time between allows."""

    point: Point
    earlier: Point
    distance_m: float
    allowed_m: float
    elapsed_s: float


class Hypotheses:
    """The people block, and the only code that writes it."""

    def __init__(
        self,
        limits: Block,
        max_people: int,
        *,
        clock_error_s: float,
        stamp_error_s: float,
        trust_sides: bool = False,
    ) -> None:
        self.people: Block = np.zeros(1, dtype=PEOPLE)
        self._rows = self.people[0]
        self._rows["t_complete"] = -math.inf
        self._rows["clock_error"] = clock_error_s
        self._rows["stamp_error"] = stamp_error_s
        self._history: Block = np.zeros(1, dtype=HISTORY)
        self._limits = limits[0]
        self._body = limits
        self._moving = bool(np.isfinite(limits["acceleration"]).any())
        self._max_people = max_people
        self._trust_sides = trust_sides
        self._persons: set[int] = set()
        self._n, self._owner = self.people["n"], self.people["person"][0]
        self._merged: set[int] = set()

    @property
    def contradicted(self) -> bool:
        """Whether some person has more than one row."""
        return bool(self._n.item() > len(self._persons))

    @property
    def overflow(self) -> bool:
        """Whether hypotheses of some person had to share a row."""
        return bool(self._merged)

    @property
    def persons(self) -> Set[int]:
        """Numbers of the persons who have rows; changes with them."""
        return self._persons

    def add_person(self, person: int) -> None:
        """Give a person who has no row one that claims nothing."""
        self._persons.add(person)
        self._add_row(person)

    def remove_person(self, person: int) -> None:
        """Take all rows of a person out; see *Leaving* above."""
        for k in reversed(self.rows_of(person)):
            self._remove_row(k)
        self._persons.discard(person)
        self._merged.discard(person)

    def keep_only(self, person: int, t_obs: float) -> None:
        """Drop all other points, and velocities, from rows of a person that have points seen at ``t_obs``."""
        rows = self._rows
        for k in self.rows_of(person):
            new = rows["t_obs"][k] == t_obs
            if new.any() and (np.isfinite(rows["t_obs"][k]) & ~new).any():
                rows["t_obs"][k, ~new], rows["xyz"][k, ~new], rows["e_p"][k, ~new] = (math.nan,) * 3
                rows["present"][k] = sum(1 << int(p) for p in np.flatnonzero(new))
            if new.any():
                self._forget_motion(k)

    def rows_of(self, person: int) -> list[int]:
        """Rows of a person in the block."""
        numbers = self._owner[: self._n.item()].tolist()
        return [k for k, other in enumerate(numbers) if other == person]

    def agrees(self, person: int, reading: np.void) -> bool:
        """Whether a READING record agrees with every row of a person."""
        return all(self._agrees(k, reading) for k in self.rows_of(person))

    def may_be(self, person: int, reading: np.void) -> bool:
        """Whether a READING record agrees with some row of a person."""
        return any(self._agrees(k, reading) for k in self.rows_of(person))

    def who_may_be(self, before: Block, reading: np.void) -> set[int]:
        """Persons of an earlier copy of the people block, with some row of whom a READING record agrees."""
        rows = before[0]
        agreed = (k for k in range(int(rows["n"])) if contradiction(rows, k, reading, self._limits)[0] < 0)
        return {int(rows["person"][k]) for k in agreed}

    def _agrees(self, k: int, reading: np.void) -> bool:
        return bool(contradiction(self._rows, k, reading, self._limits)[0] < 0)

    def take(self, person: int, reading: Block) -> Disagreement | None:
        """As :meth:`update` for a READING block, quicker where the reading agrees with an only row."""
        own = self.rows_of(person)
        if len(own) == 1 and take_agreeing(
            self.people, own[0], reading, self._history, self._body, self._moving, self._trust_sides
        ):
            self._merged.discard(person)
            return None
        return self.update(person, reading[0])

    def update(self, person: int, reading: np.void) -> Disagreement | None:
        """Replace the rows of a person that a READING record agrees with; see the argument above.

        Returns by what the reading disagrees most with one of the rows, if it does with any.
        """
        rows = self._rows
        own = self.rows_of(person)
        mark_too_far_apart(reading, self._limits)
        agreed: list[int] = []
        worst: Disagreement | None = None
        for k in own:
            p, q, distance, allowed = contradiction(rows, k, reading, self._limits)
            if p < 0:
                agreed.append(k)
            elif worst is None or distance - allowed > worst.distance_m - worst.allowed_m:
                elapsed = float(reading["t_obs"] - rows["t_obs"][k, q])
                worst = Disagreement(Point(p), Point(q), distance, allowed, elapsed)
        reading["e_read"] = reading["e_p"]
        for k in () if self._trust_sides else agreed:
            widen_exchanged(rows, k, reading, self._limits)
        if not agreed:
            self._add_hypothesis(person, own[-1], reading)
        elif len(own) == 1:
            self._write(own[0], reading)
        else:
            self._clear(agreed[0])
            self._write(agreed[0], reading)
            for k in reversed(agreed[1:]):
                self._remove_row(k)
        if len(agreed) == len(own):
            self._merged.discard(person)
        return worst

    def _add_hypothesis(self, person: int, other: int, reading: np.void) -> None:
        """Add the reading as a row, or merge it with row ``other`` where no row is left."""
        reserved = self._max_people - len(self._persons)
        if self._rows["n"] + reserved < MAX_PEOPLE:
            self._write(self._add_row(person), reading)
        else:
            self._merge(other, reading)
            self._merged.add(person)

    def _write(self, k: int, reading: np.void) -> None:
        """Write the points of a reading, and their velocities where the profile limits accelerations."""
        if self._moving:
            estimate_velocities(self._rows, k, reading, self._history[0], self._limits)
        write_points(self._rows, k, reading)

    def _merge(self, k: int, reading: np.void) -> None:
        """Make row k contain both what it said and what the reading says, at the latter's time."""
        rows = self._rows
        slack = 2.0 * float(rows["stamp_error"] + rows["clock_error"])
        both = int(rows["present"][k]) & int(reading["present"])
        for p in range(MAX_POINTS):
            if not both >> p & 1:
                rows["t_obs"][k, p], rows["xyz"][k, p], rows["e_p"][k, p] = math.nan, math.nan, math.nan
                continue
            elapsed = abs(float(reading["t_obs"] - rows["t_obs"][k, p])) + slack
            grown = float(rows["e_p"][k, p] + self._limits["speed"][p] * elapsed)
            apart = float(np.linalg.norm(rows["xyz"][k, p] - reading["xyz"][p]))
            rows["xyz"][k, p] = 0.5 * (rows["xyz"][k, p] + reading["xyz"][p])
            rows["e_p"][k, p] = 0.5 * apart + max(grown, float(reading["e_p"][p])) + ROUNDING_M
            rows["t_obs"][k, p] = reading["t_obs"]
        rows["e_read"][k] = rows["e_p"][k]
        rows["present"][k] = both
        self._forget_motion(k)

    def _add_row(self, person: int) -> int:
        """Append a row that claims nothing."""
        k = int(self._rows["n"])
        self._rows["n"] = k + 1
        self._rows["person"][k] = person
        self._clear(k)
        return k

    def _clear(self, k: int) -> None:
        """Make row k claim nothing."""
        rows = self._rows
        rows["present"][k] = 0
        rows["t_obs"][k], rows["xyz"][k], rows["e_p"][k] = math.nan, math.nan, math.nan
        self._forget_motion(k)

    def _forget_motion(self, k: int) -> None:
        """Make row k claim nothing about velocities."""
        self._rows["v"][k], self._rows["e_v"][k] = 0.0, math.inf
        self._history["n"][0, k] = 0

    def _remove_row(self, k: int) -> None:
        """Take row k out; the rows after it move up."""
        n = int(self._rows["n"])
        for name in ("person", "t_obs", "present", "xyz", "e_p", "e_read", "v", "e_v"):
            self._rows[name][k : n - 1] = self._rows[name][k + 1 : n]
        for name in ("n", "t", "xyz", "e_p"):
            self._history[name][0, k : n - 1] = self._history[name][0, k + 1 : n]
        self._rows["n"] = n - 1
