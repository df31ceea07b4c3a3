"""Measurements of people, and the gate that alone can make one.

**Reading half.** What cannot be read counts as no measurement *of that point*: the last good one keeps
growing. A person of whom nothing could be read yet has a row without points: somebody is there, nobody knows
where, nothing is proven.

**Contradiction half.** What can be read is never discarded, and when somebody has left: see
:mod:`occupancy.hypotheses`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point, Profile
from occupancy.gate_kernels import any_refused, read_person
from occupancy.humans.kernels import ROUNDING_M
from occupancy.hypotheses import PEOPLE, READING, Hypotheses
from occupancy.repeats import Repeats
from occupancy.report import (
    LARGEST_S,
    Admission,
    Contradiction,
    GateError,
    GateSettings,
    RawMeasurement,
    RawPerson,
    Reading,
    Refusal,
    RefusalReason,
    SensorFrame,
    is_complete,
)
from occupancy.roll_call import RollCall
from robots.motion import Block

__all__ = [
    "PEOPLE",
    "Admission",
    "Contradiction",
    "Gate",
    "GateError",
    "GateSettings",
    "RawMeasurement",
    "RawPerson",
    "Reading",
    "Refusal",
    "RefusalReason",
    "SensorFrame",
]

_FRAME = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("translation_error", np.float64),
        ("chord", np.float64),
        ("default_error", np.float64),
        ("range", np.float64),
    ]
)
_ALL_POINTS = (1 << MAX_POINTS) - 1
_ROUNDING_S = 1e-6
"""A stamp since 1970 written as a double is 0.24 µs coarse: rounding is no stamp that lies ahead."""
_POINT_REASONS = (
    RefusalReason.INFERRED,
    RefusalReason.NOT_FINITE,
    RefusalReason.ZERO,
    RefusalReason.BAD_ERROR,
    RefusalReason.TOO_FAR,
    RefusalReason.LIMB,
    RefusalReason.REPEATED,
    RefusalReason.UNCOMPARED,
    RefusalReason.SHAPE,
)
"""In the order of the codes of :func:`occupancy.humans.kernels.read_points`, from 1."""


class Gate:
    """The only maker of measurements: admits reports, keeps what is possible for every person."""

    def __init__(self, profile: Profile, settings: GateSettings) -> None:
        self._hypotheses = Hypotheses(
            profile.limits,
            settings.max_people,
            clock_error_s=settings.clock_error_s,
            stamp_error_s=settings.stamp_error_s,
            trust_sides=settings.trust_sides,
        )
        self._roll = RollCall(self._hypotheses, profile.limits, settings.monitored)
        self.people: Block = self._hypotheses.people
        self._body = profile.limits
        self._settings = settings
        self._frames = {name: _frame(pose, settings) for name, pose in settings.frames.items()}
        self._frames.setdefault("world", _frame(SensorFrame(), settings))
        self._reading: Block = np.zeros(1, dtype=READING)
        self._present, self._too_far_apart = self._reading["present"], self._reading["too_far_apart"]
        self._outsized: dict[int, tuple[NDArray[np.bool_], float]] = {}
        self._numbers: dict[str, int] = {}
        self._ids: tuple[str, ...] = ()
        self._last_stamp: list[float] = []
        self._repeats = Repeats()
        self._left: dict[str, float] = {}
        self._too_many = False

    @property
    def person_ids(self) -> tuple[str, ...]:
        """Ids of the persons; the index is what the ``person`` column holds."""
        return self._ids

    @property
    def believes_repeats(self) -> bool:
        """Whether a point whose coordinates do not change at all counts as measured anew."""
        return self._settings.believe_repeats

    @property
    def contradicted(self) -> bool:
        """Whether reports contradict each other or the profile.

        Some person has more than one row, is larger than the profile's sizes allow, or is missing where
        everybody is reported.
        """
        return self._hypotheses.contradicted or len(self._roll.vanished) > 0 or len(self._outsized) > 0

    @property
    def vanished(self) -> tuple[str, ...]:
        """Ids of those who must be in a monitored region, but were missing from a complete report."""
        return tuple(self._ids[number] for number in sorted(self._roll.vanished))

    @property
    def outsized(self) -> dict[str, tuple[Point, Point]]:
        """Who was seen with points farther apart than the profile's sizes allow: id -> two such points.

        Until both of every such two were seen in one later report, within what it allows.
        """
        found = {}
        for number in sorted(self._outsized):
            p, q = np.argwhere(self._outsized[number][0])[0]
            found[self._ids[number]] = Point(int(p)), Point(int(q))
        return found

    @property
    def left(self) -> dict[str, float]:
        """Who has left and not come back: id -> stamp [s] of the complete report that did not list them."""
        return self._left.copy()

    @property
    def overflow(self) -> bool:
        """Whether people or hypotheses did not get a row of their own: nothing may be verified."""
        return self._too_many or self._hypotheses.overflow

    def admit(self, raw: RawMeasurement, now: float) -> Admission:
        """Take in a report at ``now`` [s, cell's clock]; what is wrong with it is returned, never raised.

        A person that a report lists twice is two bodies with one name: the second is held against the first
        like any other reading. A reading whose stamp does not advance tells nothing new where it agrees with
        what is known, and is refused; where it does not, somebody was there, and it is kept.
        """
        if type(raw.people) is not tuple:
            raw = raw._replace(people=tuple(raw.people))  # an iterator lists people only once
        refusals: list[Refusal] = []
        contradictions: list[Contradiction] = []
        reason = self._unusable(raw, now)
        if reason is not None:
            refusals.append(Refusal(raw.stamp, "", None, reason, raw.stamp))
        before = {number: self._last_stamp[number] for number in self._hypotheses.persons}
        self._repeats.begin()
        if self._roll.asked:
            seen = raw.stamp - self._settings.stamp_error_s
            self._roll.begin(seen, is_complete(raw) and reason is None, self._missing(raw))
        placed = True
        for person in raw.people:
            was = self._left.get(person.id, math.nan)
            if raw.stamp <= was:
                refusals.append(Refusal(raw.stamp, person.id, None, RefusalReason.STAMP_BACKWARDS, was))
                continue
            number = self._number_of(person.id)
            placed = placed and number is not None
            if number is None:
                refusals.append(Refusal(raw.stamp, person.id, None, RefusalReason.TOO_MANY_PEOPLE))
            elif reason is None:
                refused = self._read_new(raw, person, number)
                late = number in before and not raw.stamp > before[number]
                if self._roll.asked:
                    self._roll.hear(number, self._reading[0], not late)
                if late and self._hypotheses.agrees(number, self._reading[0]):
                    self._reading["e_read"] = self._reading["e_p"]
                    contradictions += self._sized(number, raw.stamp, person.id)
                    refusals.append(
                        Refusal(raw.stamp, person.id, None, RefusalReason.STAMP_BACKWARDS, before[number])
                    )
                    continue
                if refused:
                    refusals += self._refused(raw.stamp, person.id)
                contradictions += self._take(number, raw.stamp, person.id)
        left = self._close_roll(raw.stamp, placed) if self._roll.asked else ()
        return Admission(tuple(refusals), tuple(contradictions), left)

    def _missing(self, raw: RawMeasurement) -> list[int]:
        """Numbers of the persons who have rows but are not listed in a report."""
        listed = {self._numbers.get(person.id) for person in raw.people}
        return [number for number in self._hypotheses.persons if number not in listed]

    def _close_roll(self, stamp: float, placed: bool) -> tuple[str, ...]:
        """Let go who has left; ``placed``: everybody whom the report lists has a row."""
        known = self._hypotheses.persons
        earlier = [number for number in known if -math.inf < self._last_stamp[number] < stamp]
        gone = self._roll.close(earlier)
        for number in gone:
            self._outsized.pop(number, None)
        left = tuple(self._ids[number] for number in gone)
        self._left.update(dict.fromkeys(left, stamp))
        if self._roll.counted and placed:
            self._too_many = False
        return left

    def read(self, raw: RawMeasurement, person: RawPerson) -> Reading | None:
        """Return what can be read of one person, changing nothing; ``None`` in an undeclared frame.

        For samples that are held against earlier predictions; stamps are the caller's business.
        """
        if raw.frame not in self._frames:
            return None
        self._read(raw, person)
        reading = self._reading[0]
        present = int(reading["present"])
        return Reading(reading["xyz"].copy(), reading["e_p"].copy(), present, reading["seen"].copy())

    def is_ahead(self, raw: RawMeasurement) -> bool:
        """Whether the stamp lies so far after the arrival [s] that not both can be right."""
        allowed = self._settings.stamp_error_s + self._settings.clock_error_s + _ROUNDING_S
        return raw.stamp - raw.arrived > allowed

    def _unusable(self, raw: RawMeasurement, now: float) -> RefusalReason | None:
        """Why a report as a whole cannot be read."""
        if not (math.isfinite(raw.stamp) and math.isfinite(raw.arrived) and math.isfinite(now)):
            return RefusalReason.STAMP_NOT_FINITE
        if not max(abs(raw.stamp), abs(raw.arrived), abs(now)) <= LARGEST_S:
            return RefusalReason.STAMP_TOO_FAR
        if self.is_ahead(raw):
            return RefusalReason.STAMP_AHEAD
        if raw.arrived > now:
            return RefusalReason.NOT_ARRIVED
        if raw.frame not in self._frames:
            return RefusalReason.UNKNOWN_FRAME
        return None

    def _number_of(self, person: str) -> int | None:
        """Number of a person, who gets a row when they have none; ``None``: no room."""
        number, present = self._numbers.get(person), self._hypotheses.persons
        if number in present:
            return number
        if len(present) == self._settings.max_people:
            self._too_many = True
            return None
        if number is None:
            number = self._numbers[person] = len(self._numbers)
            self._ids += (person,)
            self._last_stamp.append(-math.inf)
        self._left.pop(person, None)
        self._last_stamp[number] = -math.inf
        self._hypotheses.add_person(number)
        return number

    def _read(self, raw: RawMeasurement, person: RawPerson) -> None:
        """Read a person's points into the record ``_reading``."""
        t_obs = raw.stamp - self._settings.stamp_error_s
        frame, measured = self._frames[raw.frame], person.measured & _ALL_POINTS
        read_person(person.xyz, person.error_m, measured, t_obs, frame, self._body, self._reading)

    def _read_new(self, raw: RawMeasurement, person: RawPerson, number: int) -> bool:
        """Read a person's points, less those that are passed on again; whether any was refused."""
        self._read(raw, person)
        if self._settings.believe_repeats:
            return any_refused(self._reading)
        return self._repeats.refuse(number, raw.frame, self._reading, raw.stamp)

    def _refused(self, stamp: float, person: str) -> list[Refusal]:
        """List the points that were not read."""
        codes, values = self._reading["reason"][0], self._reading["value"][0]
        return [
            Refusal(stamp, person, Point(int(p)), _POINT_REASONS[int(codes[p]) - 1], float(values[p]))
            for p in codes.nonzero()[0]
        ]

    def _take(self, number: int, stamp: float, person: str) -> list[Contradiction]:
        """Update the rows of a person by what was read, if anything was."""
        if self._present.item() == 0:
            return []
        self._last_stamp[number] = max(stamp, self._last_stamp[number])
        found = self._hypotheses.take(number, self._reading)
        contradictions = [] if found is None else [Contradiction(stamp, person, *found)]
        if self._too_far_apart.item() or number in self._outsized:
            contradictions += self._sized(number, stamp, person)
        return contradictions

    def _sized(self, number: int, stamp: float, person: str) -> list[Contradiction]:
        """Note which points of a person are farther apart than A1 allows, and which are not any more.

        Two points count until both are in one reading that was seen later, and not too far apart in it.
        """
        xyz, e_p = self._reading["xyz"][0], self._reading["e_read"][0]
        distance = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
        allowed = self._body["chain"][0] + e_p[:, None] + e_p[None] + ROUNDING_M
        apart = distance > allowed
        before, since = self._outsized.get(number, (np.zeros_like(apart), -math.inf))
        if stamp > since:
            before = before & ~np.isfinite(distance)
        both = before | apart
        if not both.any():
            self._outsized.pop(number, None)
            return []
        self._outsized[number] = both, max(since, stamp) if apart.any() else since
        if not apart.any():
            return []
        p, q = np.unravel_index(int(np.argmax(np.where(apart, distance - allowed, -np.inf))), apart.shape)
        most, least = float(distance[p, q]), float(allowed[p, q])
        return [Contradiction(stamp, person, Point(int(p)), Point(int(q)), most, least, 0.0)]


def _frame(pose: SensorFrame, settings: GateSettings) -> Block:
    """Return the frame as the reading kernel takes it."""
    frame = np.zeros(1, dtype=_FRAME)
    frame["rotation"], frame["translation"] = pose.rotation, pose.translation
    frame["translation_error"] = pose.translation_error_m
    frame["chord"] = 2.0 * math.sin(0.5 * pose.rotation_error_rad)
    frame["default_error"], frame["range"] = settings.position_error_m, settings.range_m
    return frame
