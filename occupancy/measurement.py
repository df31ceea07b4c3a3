"""Measurements of people, and the gate that alone can make one.

**Reading half.** What cannot be read counts as no measurement *of that point*: the last good one keeps
growing.

**Contradiction half.** What can be read is never discarded. The rows of a person are *hypotheses*: row h says
"at t_obs(h, p) body point p was within e_p(h, p) of xyz(h, p), for every point p that is present". Kept is
the invariant

    at least one row of every person is true,
    (I)

and a part counts as separated only if it is separated for all rows, so whichever row is true, the occupancy
contains the body (A1). The reports are trusted this far, which is weaker than A6:

    a report that agrees with a true row is true; an erroneous report disagrees with every true row.
    (R)

A report N *agrees* with a row iff no point of N is farther from a point of the row than A1 and the profile's
sizes allow for the time between them (:func:`occupancy.humans.kernels.contradiction`). On its arrival

- rows that N disagrees with stay as they are and keep growing;
- all rows that N agrees with are replaced by **one** row.

(I) survives: let h be a true row. If N disagrees with h, h stays. If N agrees with h, N is true by (R), and
the row that replaces h must only claim what N claims. Nothing else was assumed about the other rows, so
nothing is lost by dropping those that N agrees with: had one of them been true, N is. If N agrees with none,
N is added as a row of its own: either A1 failed on the way and N is true, or N is erroneous and h stays. When
N agrees with all rows, one row is left and the contradiction is over.

**Points of different age.** N may lack points that a row has. Keeping such an old point beside N's claims "N
is true *and* the old point is"; that follows only if the row it comes from is true. With a single row h that
N agrees with, h is true by (I) and N by (R), hence so is the mixed row, each point of which has its own t_obs
and grows on its own. With several rows it does not follow: N may agree with a false row s and disagree with
the true row h; N is then possibly true (A1 failed between h and N) while the points left over from s are not,
and a capsule from an old false elbow to a new true wrist contains no arm. So where there were several rows,
the new one has N's points only, and parts that these do not show are inferred from those that they do.

**Overflow.** Every one of ``max_people`` persons has a row reserved. Where no row is left for a new
hypothesis, it is merged with a row of the same person: for each point that both have, a ball that contains
both balls, points that one of them lacks are dropped. If either was true, the merged row is, so (I) survives;
nevertheless ``overflow`` is set and nothing may be verified until a report agrees with all rows of that
person. A person beyond ``max_people`` has no row and, since persons do not leave, the overflow stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point, Profile
from occupancy.humans.kernels import contradiction, read_points, write_points
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block

PEOPLE = np.dtype(
    [
        ("n", np.int64),
        ("clock_error", np.float64),
        ("stamp_error", np.float64),
        ("person", np.int32, (MAX_PEOPLE,)),
        ("t_obs", np.float64, (MAX_PEOPLE, MAX_POINTS)),
        ("present", np.uint32, (MAX_PEOPLE,)),
        ("xyz", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("e_p", np.float64, (MAX_PEOPLE, MAX_POINTS)),
        ("v", np.float64, (MAX_PEOPLE, MAX_POINTS, 3)),
        ("e_v", np.float64, (MAX_PEOPLE, MAX_POINTS)),
    ]
)
"""Last admitted values: one row per hypothesis about a person. ``person``: index into
:attr:`Gate.person_ids`; ``present``: bit per :class:`~occupancy.body.Point` that was ever admitted; ``xyz``
[m, world frame] within ``e_p`` [m]; ``t_obs`` [s]: stamp minus ``stamp_error`` [s], so that the point was
seen in [t_obs - clock_error, t_obs + 2 stamp_error + clock_error]; ``v`` [m/s] within ``e_v``, inf: unknown.
A row without any present point is a person of whom nothing is known but that they are there."""

_READING = np.dtype(
    [
        ("measured", np.int64),
        ("present", np.int64),
        ("t_obs", np.float64),
        ("xyz", np.float64, (MAX_POINTS, 3)),
        ("e_p", np.float64, (MAX_POINTS,)),
        ("reason", np.int8, (MAX_POINTS,)),
        ("value", np.float64, (MAX_POINTS,)),
    ]
)
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


class GateError(ValueError):
    """Settings that a gate cannot work with; the message names value and rule."""


class RefusalReason(StrEnum):
    """Why something in a report is not a measurement."""

    INFERRED = "inferred by the tracker, not measured"
    NOT_FINITE = "coordinates are NaN or infinite"
    ZERO = "coordinates are exactly zero: a missing point"
    BAD_ERROR = "position error is negative or larger than the range of the sensors"
    TOO_FAR = "farther away than the range of the sensors"
    LIMB = "limb of a length that no person has"
    STAMP_NOT_FINITE = "stamp or time of arrival is NaN or infinite"
    STAMP_AHEAD = "stamp is ahead of the clock"
    NOT_ARRIVED = "arrives only later"
    STAMP_BACKWARDS = "stamp does not advance"
    UNKNOWN_FRAME = "coordinate frame is not declared"
    TOO_MANY_PEOPLE = "more people than there is room for"


_ALL_POINTS = (1 << MAX_POINTS) - 1
_POINT_REASONS = (
    RefusalReason.INFERRED,
    RefusalReason.NOT_FINITE,
    RefusalReason.ZERO,
    RefusalReason.BAD_ERROR,
    RefusalReason.TOO_FAR,
    RefusalReason.LIMB,
)
"""In the order of the codes of :func:`occupancy.humans.kernels.read_points`, from 1."""


class RawPerson(NamedTuple):
    """One person of a report.

    ``xyz`` (20, 3) [m, report's frame], NaN: missing; ``error_m`` (20,), NaN: not stated; ``measured``: bit
    per :class:`~occupancy.body.Point` that the tracker measured.
    """

    id: str
    xyz: NDArray[np.float64]
    error_m: NDArray[np.float64]
    measured: int


class RawMeasurement(NamedTuple):
    """One report as it came: when it was seen and when it arrived [s, cell's clock], its frame, who is in
    it."""

    stamp: float
    arrived: float
    frame: str
    complete: bool
    people: tuple[RawPerson, ...]


class Refusal(NamedTuple):
    """A report (``person`` empty), a person or a point that counts as not measured.

    ``value`` is what broke the rule (length [m] of a limb, stamp [s]) or NaN.
    """

    stamp: float
    person: str
    point: Point | None
    reason: RefusalReason
    value: float = math.nan


class Contradiction(NamedTuple):
    """A report that the kept rows of its person, the profile and the position errors do not allow.

    ``point`` was measured ``distance_m`` from where ``earlier`` had been, ``allowed_m`` is the most that is
    possible, ``elapsed_s`` the time between; the pair with the largest excess of the report.
    """

    stamp: float
    person: str
    point: Point
    earlier: Point
    distance_m: float
    allowed_m: float
    elapsed_s: float


class Admission(NamedTuple):
    """What a report was refused for and what it contradicted."""

    refusals: tuple[Refusal, ...]
    contradictions: tuple[Contradiction, ...]


class Reading(NamedTuple):
    """The readable points of one person: ``xyz`` (20, 3) [m, world frame], ``e_p`` (20,) [m]; NaN: none."""

    xyz: NDArray[np.float64]
    e_p: NDArray[np.float64]
    present: int


@dataclass(frozen=True)
class SensorFrame:
    """Pose of a sensor frame in the world, and the error of that pose (assumption A6).

    Attributes
    ----------
    rotation, translation:
        (3, 3) and (3,) [m]: world = rotation · sensor + translation.
    translation_error_m, rotation_error_rad:
        Greatest error of the two; the rotation error moves a point at range r by up to 2 sin(θ/2) r.
    """

    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    translation: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    translation_error_m: float = 0.0
    rotation_error_rad: float = 0.0

    def __post_init__(self) -> None:
        rotation, translation = np.asarray(self.rotation, float), np.asarray(self.translation, float)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0.0, atol=1e-9):
            raise GateError(f"frame: rotation {rotation.tolist()} must be an orthonormal 3x3 matrix")
        if not np.linalg.det(rotation) > 0.0:
            raise GateError(f"frame: rotation {rotation.tolist()} must not mirror")
        if translation.shape != (3,) or not np.isfinite(translation).all():
            raise GateError(f"frame: translation {translation.tolist()} must be three finite numbers")
        _not_negative("frame: translation_error_m", self.translation_error_m)
        _not_negative("frame: rotation_error_rad", self.rotation_error_rad)
        if self.rotation_error_rad > math.pi:
            raise GateError(f"frame: rotation_error_rad {self.rotation_error_rad} must not exceed pi")


@dataclass(frozen=True)
class GateSettings:
    """What the gate needs to know about clocks and sensors.

    Attributes
    ----------
    clock_error_s, stamp_error_s:
        Greatest error of the sensors' clock against the cell's, and of a stamp against the instant of seeing.
    position_error_m:
        Position error of points whose report states none.
    frames:
        Sensor frames by name; ``world`` is always known.
    max_people:
        Persons for whom a row is reserved.
    range_m:
        No sensor sees a person farther away than this.
    """

    clock_error_s: float
    stamp_error_s: float
    position_error_m: float
    frames: Mapping[str, SensorFrame] = field(default_factory=dict)
    max_people: int = 8
    range_m: float = 100.0

    def __post_init__(self) -> None:
        for name in ("clock_error_s", "stamp_error_s", "position_error_m"):
            _not_negative(name, getattr(self, name))
        if not 1 <= self.max_people <= MAX_PEOPLE:
            raise GateError(f"max_people {self.max_people} must be 1 to {MAX_PEOPLE}")
        if not 0.0 < self.range_m <= 1e4:
            raise GateError(f"range_m {self.range_m} must be above 0 and at most 10000 m")


class Gate:
    """The only maker of measurements: admits reports, keeps the hypotheses about every person."""

    def __init__(self, profile: Profile, settings: GateSettings) -> None:
        self.people: Block = np.zeros(1, dtype=PEOPLE)
        self.people["clock_error"] = settings.clock_error_s
        self.people["stamp_error"] = settings.stamp_error_s
        self._rows = self.people[0]
        self._limits = profile.limits
        self._settings = settings
        self._frames = {name: _frame(pose, settings) for name, pose in settings.frames.items()}
        self._frames.setdefault("world", _frame(SensorFrame(), settings))
        self._scratch: Block = np.zeros(1, dtype=_READING)
        self._index: dict[str, int] = {}
        self._last_stamp: list[float] = []
        self._merged: set[int] = set()
        self._too_many = False

    @property
    def person_ids(self) -> tuple[str, ...]:
        """Ids of the persons; the index is what the ``person`` column holds."""
        return tuple(self._index)

    @property
    def contradicted(self) -> bool:
        """Whether some person has more than one row."""
        return int(self._rows["n"]) > len(self._index)

    @property
    def overflow(self) -> bool:
        """Whether people or hypotheses did not get a row of their own: nothing may be verified."""
        return self._too_many or bool(self._merged)

    def admit(self, raw: RawMeasurement, now: float) -> Admission:
        """Take in a report at ``now`` [s, cell's clock]; never raises, whatever the numbers are."""
        refusals: list[Refusal] = []
        contradictions: list[Contradiction] = []
        reason = self._unusable(raw, now)
        if reason is not None:
            refusals.append(Refusal(raw.stamp, "", None, reason, raw.stamp))
        seen_before = tuple(self._last_stamp)
        for person in raw.people:
            index = self._index_of(person.id)
            if index is None:
                refusals.append(Refusal(raw.stamp, person.id, None, RefusalReason.TOO_MANY_PEOPLE))
                continue
            if reason is not None:
                continue
            if index < len(seen_before) and not raw.stamp > seen_before[index]:
                refusals.append(
                    Refusal(raw.stamp, person.id, None, RefusalReason.STAMP_BACKWARDS, seen_before[index])
                )
                continue
            refusals += self._read(raw, person)
            if self._scratch["present"][0]:
                self._last_stamp[index] = raw.stamp
                found = self._update(index, raw.stamp, person.id)
                contradictions += [] if found is None else [found]
        return Admission(tuple(refusals), tuple(contradictions))

    def read(self, raw: RawMeasurement, person: RawPerson) -> Reading | None:
        """Return what can be read of one person, changing nothing; ``None`` in an undeclared frame.

        For samples that are held against earlier predictions; stamps are the caller's business.
        """
        if raw.frame not in self._frames:
            return None
        self._read(raw, person)
        result = self._scratch[0]
        return Reading(result["xyz"].copy(), result["e_p"].copy(), int(result["present"]))

    def _unusable(self, raw: RawMeasurement, now: float) -> RefusalReason | None:
        """Why a report as a whole cannot be read."""
        if not (math.isfinite(raw.stamp) and math.isfinite(raw.arrived) and math.isfinite(now)):
            return RefusalReason.STAMP_NOT_FINITE
        if raw.stamp - self._settings.stamp_error_s > now + self._settings.clock_error_s:
            return RefusalReason.STAMP_AHEAD
        if raw.arrived > now:
            return RefusalReason.NOT_ARRIVED
        if raw.frame not in self._frames:
            return RefusalReason.UNKNOWN_FRAME
        return None

    def _index_of(self, person: str) -> int | None:
        """Index of a person; a new one gets a row without points. ``None``: no room."""
        if person in self._index:
            return self._index[person]
        if len(self._index) == self._settings.max_people:
            self._too_many = True
            return None
        index = len(self._index)
        self._index[person] = index
        self._last_stamp.append(-math.inf)
        self._add_row(index)
        return index

    def _read(self, raw: RawMeasurement, person: RawPerson) -> list[Refusal]:
        """Read a person's points into the scratch record; list those that were refused."""
        scratch = self._scratch[0]
        scratch["measured"] = person.measured & _ALL_POINTS
        scratch["t_obs"] = raw.stamp - self._settings.stamp_error_s
        read_points(person.xyz, person.error_m, self._frames[raw.frame][0], self._limits[0], scratch)
        return [
            Refusal(
                raw.stamp,
                person.id,
                Point(int(p)),
                _POINT_REASONS[int(scratch["reason"][p]) - 1],
                float(scratch["value"][p]),
            )
            for p in scratch["reason"].nonzero()[0]
        ]

    def _update(self, index: int, stamp: float, person: str) -> Contradiction | None:
        """Replace the rows that the scratch reading agrees with; see the argument at the top of this file."""
        rows, reading = self._rows, self._scratch[0]
        own = [k for k, other in enumerate(rows["person"][: rows["n"]].tolist()) if other == index]
        agreed: list[int] = []
        worst: Contradiction | None = None
        for k in own:
            p, q, distance, allowed = contradiction(rows, k, reading, self._limits[0])
            if p < 0:
                agreed.append(k)
            elif worst is None or distance - allowed > worst.distance_m - worst.allowed_m:
                elapsed = float(reading["t_obs"] - rows["t_obs"][k, q])
                worst = Contradiction(stamp, person, Point(p), Point(q), distance, allowed, elapsed)
        if not agreed:
            self._add_hypothesis(index, own[-1])
        elif len(own) == 1:
            write_points(rows, own[0], reading)
        else:
            self._clear(agreed[0])
            write_points(rows, agreed[0], reading)
            for k in reversed(agreed[1:]):
                self._remove_row(k)
        if len(agreed) == len(own):
            self._merged.discard(index)
        return worst

    def _add_hypothesis(self, index: int, other: int) -> None:
        """Add the scratch reading as a row, or merge it with row ``other`` where no row is left."""
        reserved = self._settings.max_people - len(self._index)
        if self._rows["n"] + reserved < MAX_PEOPLE:
            write_points(self._rows, self._add_row(index), self._scratch[0])
        else:
            self._merge(other)
            self._merged.add(index)

    def _merge(self, k: int) -> None:
        """Make row k contain both what it said and what the scratch reading says, at the latter's time."""
        rows, reading = self._rows, self._scratch[0]
        both = int(rows["present"][k]) & int(reading["present"])
        slack = 2.0 * (float(rows["stamp_error"]) + float(rows["clock_error"]))
        for p in range(MAX_POINTS):
            if not both >> p & 1:
                continue
            speed = float(self._limits["speed"][0, p])
            grown = rows["e_p"][k, p] + speed * (abs(reading["t_obs"] - rows["t_obs"][k, p]) + slack)
            middle = 0.5 * (rows["xyz"][k, p] + reading["xyz"][p])
            half = 0.5 * float(np.linalg.norm(rows["xyz"][k, p] - reading["xyz"][p]))
            rows["xyz"][k, p] = middle
            rows["e_p"][k, p] = half + max(grown, reading["e_p"][p])
            rows["t_obs"][k, p] = reading["t_obs"]
        rows["present"][k] = both

    def _add_row(self, index: int) -> int:
        """Append an empty row for a person."""
        k = int(self._rows["n"])
        self._rows["n"] = k + 1
        self._rows["person"][k] = index
        self._clear(k)
        return k

    def _clear(self, k: int) -> None:
        """Make row k claim nothing."""
        rows = self._rows
        rows["present"][k] = 0
        rows["t_obs"][k], rows["xyz"][k], rows["e_p"][k] = math.nan, math.nan, math.nan
        rows["v"][k], rows["e_v"][k] = 0.0, math.inf

    def _remove_row(self, k: int) -> None:
        """Take row k out; the rows after it move up."""
        n = int(self._rows["n"])
        for name in ("person", "t_obs", "present", "xyz", "e_p", "v", "e_v"):
            self._rows[name][k : n - 1] = self._rows[name][k + 1 : n]
        self._rows["n"] = n - 1


def _frame(pose: SensorFrame, settings: GateSettings) -> Block:
    """Return the frame as the reading kernel takes it."""
    frame = np.zeros(1, dtype=_FRAME)
    frame["rotation"], frame["translation"] = pose.rotation, pose.translation
    frame["translation_error"] = pose.translation_error_m
    frame["chord"] = 2.0 * math.sin(0.5 * pose.rotation_error_rad)
    frame["default_error"], frame["range"] = settings.position_error_m, settings.range_m
    return frame


def _not_negative(name: str, value: float) -> None:
    """Refuse a number that is negative or not finite."""
    if not 0.0 <= value < math.inf:
        raise GateError(f"{name} {value} must be finite and not negative")
