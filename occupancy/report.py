"""What sensors report about people, and why some of it is not a measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Point
from occupancy.region import Monitored
from occupancy.sets import MAX_PEOPLE
from robots.errors import SetupError

LARGEST_S = 1e12
"""Times farther from zero than this [s] are no times; keeps all arithmetic far from overflow."""


class GateError(SetupError):
    """Settings that a gate cannot work with; the message names value and rule."""


class RefusalReason(StrEnum):
    """Why something in a report is not a measurement."""

    INFERRED = "inferred by the tracker, not measured"
    NOT_FINITE = "coordinates are NaN or infinite"
    ZERO = "coordinates are exactly zero: a missing point"
    BAD_ERROR = "position error is negative or larger than the range of the sensors"
    TOO_FAR = "farther away than the range of the sensors"
    LIMB = "limb of a length that no person has"
    REPEATED = "exactly where it stood before: passed on again, not measured anew"
    UNCOMPARED = "not held against what was read before, which was forgotten: so many others came since"
    SHAPE = "not 20 points of three numbers each, with one error each"
    STAMP_NOT_FINITE = "stamp or time of arrival is NaN or infinite"
    STAMP_TOO_FAR = "stamp or time of arrival is more than 1e12 s from zero"
    STAMP_AHEAD = "stamp is ahead of the clock"
    NOT_ARRIVED = "arrives only later"
    STAMP_BACKWARDS = "stamp does not advance"
    UNKNOWN_FRAME = "coordinate frame is not declared"
    TOO_MANY_PEOPLE = "more people than there is room for"


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


def is_complete(report: RawMeasurement) -> bool:
    """Whether a report says that it lists everybody: by a truth value, not by what counts as one."""
    return report.complete is True or (isinstance(report.complete, np.bool_) and bool(report.complete))


class Refusal(NamedTuple):
    """A report (``person`` empty), a person or a point that counts as not measured.

    ``value`` is what broke the rule (length [m] of a limb, stamp [s]; of a point that was passed on again,
    the stamp with which it was seen) or NaN.
    """

    stamp: float
    person: str
    point: Point | None
    reason: RefusalReason
    value: float = math.nan


class Contradiction(NamedTuple):
    """A report that the kept rows of its person, the profile and the position errors do not allow.

    Or in itself, where ``elapsed_s`` is 0: then both points are of this report, and no person of the profile
    is so large.

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
    """What a report was refused for, what it contradicted, and the ids of those who have left."""

    refusals: tuple[Refusal, ...]
    contradictions: tuple[Contradiction, ...]
    left: tuple[str, ...] = ()


class Reading(NamedTuple):
    """The readable points of one person: ``xyz`` (20, 3) [m, world frame], ``e_p`` (20,) [m]; NaN: none.

    ``seen`` (20, 3) [m]: all that were reported within range, inferred or refused ones included.
    """

    xyz: NDArray[np.float64]
    e_p: NDArray[np.float64]
    present: int
    seen: NDArray[np.float64]


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
    monitored:
        Regions that complete reports cover; without any, nobody who was reported ever leaves.
    believe_repeats:
        Whether a point whose coordinates do not change at all counts as measured anew.
    trust_sides:
        Whether left and right are never exchanged.
    """

    clock_error_s: float
    stamp_error_s: float
    position_error_m: float
    frames: Mapping[str, SensorFrame] = field(default_factory=dict)
    max_people: int = 8
    range_m: float = 100.0
    monitored: tuple[Monitored, ...] = ()
    believe_repeats: bool = False
    trust_sides: bool = False

    def __post_init__(self) -> None:
        for name in ("clock_error_s", "stamp_error_s", "position_error_m"):
            _not_negative(name, getattr(self, name))
        if not 1 <= self.max_people <= MAX_PEOPLE:
            raise GateError(f"max_people {self.max_people} must be 1 to {MAX_PEOPLE}")
        if not 0.0 < self.range_m <= 1e4:
            raise GateError(f"range_m {self.range_m} must be above 0 and at most 10000 m")


def _not_negative(name: str, value: float) -> None:
    """Refuse a number that is negative or not finite."""
    if not 0.0 <= value < math.inf:
        raise GateError(f"{name} {value} must be finite and not negative")
