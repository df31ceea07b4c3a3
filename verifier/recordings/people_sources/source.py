"""What the adapters of people's sources have in common: options, headers, and how a report is made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np

from occupancy.body import MAX_POINTS
from robots.assumption import Assumption
from robots.errors import SetupError
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.limb_test import BODIES, LimbTest
from verifier.recordings.people_report import NANO, Flaw, PeopleReport, ReportedPerson

ROS4HRI_ERROR_M = 0.5
"""Default position error of ROS4HRI frames [m]. The template of human_description has other proportions
than people: with every joint angle right, a wrist is up to 0.28 m from where it is, for statures of 1.5 to
1.9 m and the template's 1.65 m (tests/verifier/recordings/people_sources/test_ros4hri.py). The rest, for the
angles and the place of the body, is assumed."""
Reports = tuple[PeopleReport, ...]
UNSTAMPED = "the header stamp is 0: it does not say when this was seen"


@dataclass(frozen=True, slots=True)
class FloorPositions:
    """What positions on the floor say about a person.

    Attributes
    ----------
    error_m:
        Largest horizontal distance [m] of the middle of the pelvis from the position that is reported.
    floor_z_m:
        Height of the floor in the frame of the positions [m]; its z points up.
    tilted:
        Frames whose z does not.

    Raises
    ------
    SetupError
        A number is negative where it must not be, NaN or infinite.
    """

    error_m: float
    floor_z_m: float = 0.0
    tilted: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if not (0.0 <= self.error_m < math.inf and math.isfinite(self.floor_z_m)):
            raise SetupError(
                f"floor positions: error_m {self.error_m} must be at least 0 and floor_z_m "
                f"{self.floor_z_m} finite"
            )


@dataclass(frozen=True, slots=True)
class FieldState:
    """What a switch says about a protective or detection field.

    Attributes
    ----------
    free_when:
        The value that it has while nobody is in the field.
    age_s:
        How much older than its message time a state may be [s].

    Raises
    ------
    SetupError
        The age is negative, NaN or infinite.
    """

    free_when: bool
    age_s: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.age_s < math.inf:
            raise SetupError(f"field state: age_s {self.age_s} must be at least 0 s and finite")


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """What the user says about a source.

    Attributes
    ----------
    point_names:
        Names of the recording -> ours (``people.point_names`` of the cell).
    ros4hri_error_m:
        Position error of ROS4HRI frames [m]; ``None``: not stated, :data:`ROS4HRI_ERROR_M`.
    floor, field:
        What positions on the floor, and switches of scanner fields, say; ``None``: nobody said so, and they
        are refused.

    Raises
    ------
    SetupError
        The error is negative, NaN or infinite.
    """

    point_names: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    ros4hri_error_m: float | None = None
    floor: FloorPositions | None = None
    field: FieldState | None = None

    def __post_init__(self) -> None:
        if self.ros4hri_error_m is not None and not 0.0 <= self.ros4hri_error_m < math.inf:
            raise SetupError(f"ros4hri_error_m {self.ros4hri_error_m} must be at least 0 m and finite")


class PeopleAdapter(Protocol):
    """Says what the messages of one source say about people, in our words.

    One adapter reads one source: it keeps what spans several messages.
    """

    @property
    def schemas(self) -> tuple[str, ...]:
        """Message types that it reads."""

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """What reading them assumed."""

    def read(self, message: Decoded) -> Reports:
        """Return the reports that are complete with this message, in the frame of the source.

        What is wrong with one person or message is listed in their ``flaws``, and whoever is named stays, if
        need be without points: nobody who is named is in no report.

        Raises
        ------
        SourceError
            Nothing of the source can be used: one line, what is wrong and what would be right.
        """

    def finish(self) -> Reports:
        """Return the reports that the last messages make, after all have been read.

        Raises
        ------
        SourceError
            As for :meth:`read`; some faults are known only when all has been seen.
        """


class Header(NamedTuple):
    """When something was seen [ns], and in which frame."""

    stamp_ns: int
    frame: str


def field_of(value: Any, path: str) -> Any:
    """Return a field of a message by its dotted path.

    Raises
    ------
    SourceError
        The message has none of that name.
    """
    for name in path.split("."):
        if not hasattr(value, name):
            raise SourceError(f"its messages have no field {path}: it is another type of the same name")
        value = getattr(value, name)
    return value


def header_of(value: Any) -> Header:
    """Return the ``std_msgs/Header`` of a message; ROS 1 frames may begin with a slash.

    Raises
    ------
    SourceError
        It has none.
    """
    header = field_of(value, "header")
    stamp = field_of(header, "stamp")
    stamp_ns = int(field_of(stamp, "sec")) * NANO + int(field_of(stamp, "nanosec"))
    return Header(stamp_ns, str(field_of(header, "frame_id")).removeprefix("/"))


def without_points(name: str) -> ReportedPerson:
    """Return somebody of whom nothing is known but that they are there."""
    nothing = np.full(MAX_POINTS, math.nan)
    return ReportedPerson(name, np.full((MAX_POINTS, 3), math.nan), nothing, 0)


class ReportMaker:
    """Makes the reports of one source; its bodies are held against the limbs of people."""

    def __init__(self, title: str, *, must_be_seen: bool = True) -> None:
        self._test = LimbTest(title, must_be_seen)
        self._stamped = self._unstamped = 0

    def report(
        self,
        message: Decoded,
        header: Header,
        people: Iterable[ReportedPerson],
        flaws: Iterable[Flaw] = (),
        unknown_points: Iterable[str] = (),
    ) -> Reports:
        """Return the report about the people of a message, as the only one.

        A message without a stamp says who was there by the time it arrived, and no more: nobody knows how old
        it is.

        Raises
        ------
        SourceError
            The bodies so far are not those of people, or no message so far has a stamp.
        """
        listed, known_flaws, stamp_ns = tuple(people), tuple(flaws), header.stamp_ns
        if stamp_ns:
            self._stamped += 1
            for person in listed:
                self._test.add(person)
        else:
            self._unstamped += 1
            if not self._stamped and self._unstamped == BODIES:
                self._refuse_unstamped()
            stamp_ns = message.log_time_ns
            listed = tuple(without_points(person.id) for person in listed)
            known_flaws = (*known_flaws, Flaw(stamp_ns, None, None, UNSTAMPED))
        report = PeopleReport(
            stamp_ns,
            message.log_time_ns,
            header.frame,
            False,
            listed,
            known_flaws,
            frozenset(unknown_points),
            any(person.measured or np.isfinite(person.xyz).any() for person in listed),
        )
        return (report,)

    def finish(self) -> Reports:
        """Judge what has been seen; no report is left to make.

        Raises
        ------
        SourceError
            The bodies are not those of people, or no message has a stamp.
        """
        if self._unstamped and not self._stamped:
            self._refuse_unstamped()
        self._test.finish()
        return ()

    def _refuse_unstamped(self) -> None:
        raise SourceError(f"{UNSTAMPED}; the driver must write when each image was taken")


def with_error(person: ReportedPerson, error_m: float) -> ReportedPerson:
    """Return a person each of whose points has this error [m]."""
    return replace(person, error_m=np.full(MAX_POINTS, error_m))
