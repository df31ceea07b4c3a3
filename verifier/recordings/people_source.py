"""Where an import takes people from: a table, or a recording with messages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, POINT_NAMES
from robots.assumption import Assumption
from robots.errors import SetupError
from verifier.recordings import bvh, c3d_file, csv_table, npz, people_schema
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.containers import is_container
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.metadata import noted_assumptions, own_metadata
from verifier.recordings.neutral import PEOPLE, open_neutral
from verifier.recordings.people_report import COLUMN, WORLD, PeopleReport, ReportedPerson
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.table import PeopleTable, Track
from verifier.recordings.topic import PEOPLE_TOPIC

PEOPLE_KINDS = (
    "it must end in .npz, .csv, .csv.gz, .mcap, .bag, .db3, .bvh, .bvh.gz or .c3d, or be the folder of a "
    "ROS 2 bag"
)
DEFAULT_POSITION_ERROR_M = 0.01
FARTHEST_M = 1e4
MAX_TURN_DEG = 3600.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where the frame of people stands at the robot base: translation [m] and rotation about z [degrees].

    Raises
    ------
    SetupError
        A number is NaN, infinite or absurdly large.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw_deg: float = 0.0

    def __post_init__(self) -> None:
        within = all(abs(value) <= FARTHEST_M for value in (self.x, self.y, self.z))
        if not (within and abs(self.yaw_deg) <= MAX_TURN_DEG):
            raise SetupError(
                f"place {self.x} {self.y} {self.z} {self.yaw_deg}: it must be three numbers within "
                f"{FARTHEST_M:g} m and an angle within {MAX_TURN_DEG:g} degrees"
            )

    def apply(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points, shape (…, 3), of the people's frame in the robot's."""
        yaw = math.radians(self.yaw_deg)
        cos, sin = math.cos(yaw), math.sin(yaw)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        placed: NDArray[np.float64] = xyz @ rotation.T + np.array([self.x, self.y, self.z])
        return placed


@dataclass(frozen=True, slots=True)
class PeopleFile:
    """A file of people and where its frame stands; ``None``: nobody said so."""

    path: Path
    place: Place | None = None


@dataclass(slots=True)
class Counts:
    """What was met while reading a file.

    Attributes
    ----------
    people, unknown_points:
        Names of persons, and of points that are neither ours nor mapped.
    mapped_points:
        Names of the map from names of the files to ours that were met.
    missing_points:
        Points that are NaN, infinite or zero.
    unreadable:
        Reports that were not readable.
    refused, first_refused:
        Persons and points of other reports of which verify says that it cannot read them: how many, and who
        and why the first one.
    """

    people: dict[str, None] = field(default_factory=dict)
    unknown_points: dict[str, None] = field(default_factory=dict)
    mapped_points: set[str] = field(default_factory=set)
    missing_points: int = 0
    unreadable: int = 0
    refused: int = 0
    first_refused: str = ""


class PeopleSource(Protocol):
    """Reports to import.

    Attributes
    ----------
    first_ns, last_ns:
        Stamp of the first and last report [ns since the file's start].
    begins_s:
        When the file starts on its own clock [s].
    counts:
        Filled while the reports are read.
    position_error_m:
        What the file states [m].
    assumptions:
        What reading the file assumed.
    """

    first_ns: int
    last_ns: int
    begins_s: float
    counts: Counts
    position_error_m: float | None
    assumptions: tuple[Assumption, ...]

    def reports(self, place: Place, error_m: float) -> Iterator[PeopleReport]:
        """Yield the reports in order of stamp, points in the robot's frame."""


def given_name(person: str | None, number: int | None) -> str:
    """Name a person: ``p<number of the file>`` unless the file does; two files may use the same name."""
    if person is None:
        return f"p{number or 1}"
    return person if number is None else f"{number}/{person}"


class TablePeople:
    """People of an NPZ or CSV table; (0, 0, 0), NaN and infinite coordinates are missing points."""

    def __init__(self, table: PeopleTable, number: int | None, point_names: Mapping[str, str]) -> None:
        self.position_error_m = table.position_error_m
        self.assumptions = table.assumptions
        self.begins_s = table.begins_s
        self.first_ns = min(int(track.t_ns[0]) for track in table.tracks)
        self.last_ns = max(int(track.t_ns[-1]) for track in table.tracks)
        self.counts = Counts()
        self._tracks = [(given_name(track.person, number), track) for track in table.tracks]
        self._columns = self._known_columns(table, point_names)

    def reports(self, place: Place, error_m: float) -> Iterator[PeopleReport]:
        """Yield the reports in order of stamp, points in the robot's frame."""
        rows = [
            (int(time), order, row)
            for order, (_name, track) in enumerate(self._tracks)
            for row, time in enumerate(track.t_ns)
        ]
        rows.sort()
        people: list[ReportedPerson] = []
        for number, (time, order, row) in enumerate(rows):
            name, track = self._tracks[order]
            people.append(self._person(name, track, row, place, error_m))
            if number + 1 == len(rows) or rows[number + 1][0] != time:
                yield PeopleReport(time, time, WORLD, False, tuple(people))
                people = []

    def _known_columns(self, table: PeopleTable, point_names: Mapping[str, str]) -> list[tuple[int, int]]:
        """Pairs of (column in the table, our point)."""
        names = table.tracks[0].names
        self.counts.mapped_points.update(point_names.keys() & names)
        columns: dict[int, int] = {}
        for index, name in enumerate(names):
            column = COLUMN.get(point_names.get(name, name))
            if column is None:
                self.counts.unknown_points[name] = None
            elif column in columns.values():
                raise RecordingError(
                    table.path, name, f"is a second {POINT_NAMES[column]}", "each point must have one name"
                )
            else:
                columns[index] = column
        if not columns:
            raise RecordingError(
                table.path,
                "",
                f"has no known point name (it has {', '.join(names)})",
                f"known are {', '.join(POINT_NAMES)}",
            )
        return list(columns.items())

    def _person(self, name: str, track: Track, row: int, place: Place, error_m: float) -> ReportedPerson:
        xyz = np.full((MAX_POINTS, 3), np.nan)
        measured = 0
        for index, column in self._columns:
            point = track.xyz[row, index]
            if np.isfinite(point).all() and point.any():
                xyz[column] = point
                measured |= 1 << column
            else:
                self.counts.missing_points += 1
        self.counts.people[name] = None
        return ReportedPerson(name, place.apply(xyz), np.full(MAX_POINTS, error_m), measured)


class RecordedPeople:
    """People of a recording with messages, read as verify reads them; reports keep their delay.

    Of a report that is not readable stays who is named in it.
    """

    def __init__(
        self, path: Path, number: int | None, point_names: Mapping[str, str], choice: Choice
    ) -> None:
        self._opened = open_neutral(path, choice, wanted=(PEOPLE,), needed=(PEOPLE,))
        self._file = self._opened.file
        self._number = number
        self._point_names = point_names
        self.position_error_m: float | None = None
        translated = self._opened.folder is not None
        self.assumptions = noted_assumptions(own_metadata(self._file)) if translated else ()
        self.counts = Counts()
        if not any(self._file.counts.get(channel) for channel in self._file.channels_of([PEOPLE_TOPIC])):
            right = f"write {people_schema.SCHEMA_NAME} in json, see docs/recordings.md"
            raise RecordingError(path, "", f"has no messages on {PEOPLE_TOPIC}", right)
        _first, last = self._stream().span()
        first = next(report for report in self._decoded(self._stream()) if report.readable)
        self._start = first.stamp_ns
        self.begins_s = first.stamp_ns / NANO
        self._frame = first.frame
        self.first_ns = 0
        self.last_ns = last.stamp_ns - first.stamp_ns

    def reports(self, place: Place, error_m: float) -> Iterator[PeopleReport]:
        """Yield the reports in order of arrival, points in the robot's frame.

        Raises
        ------
        RecordingError
            The reports are in more than one frame: one place cannot hold for all.
        """
        stream = self._stream()
        for report in self._decoded(stream):
            if report.readable and report.frame != self._frame:
                raise RecordingError(
                    self._file.path,
                    PEOPLE_TOPIC,
                    f"is in the frames {self._frame} and {report.frame}",
                    "one place needs one frame",
                )
            yield PeopleReport(
                report.stamp_ns - self._start,
                report.arrived_ns - self._start,
                WORLD,
                False,
                tuple(self._person(person, place, error_m) for person in report.people),
            )
        self._note(stream)

    def _stream(self) -> PeopleStream:
        return PeopleStream(self._file, self._opened.left_to_map(self._point_names))

    def _decoded(self, stream: PeopleStream) -> Iterator[PeopleReport]:
        return filter(None, map(stream.report, self._file.messages([PEOPLE_TOPIC])))

    def _note(self, stream: PeopleStream) -> None:
        """Count what was not taken: what nobody is told of would be gone."""
        self.counts.unknown_points |= dict.fromkeys(sorted(stream.unknown_points))
        # a translation has mapped them, and does not say which it met
        translated = self._opened.folder is not None
        self.counts.mapped_points |= set(self._point_names) if translated else stream.mapped_points
        self.counts.unreadable = stream.unreadable
        self.counts.refused = stream.flaw_count - stream.unreadable
        first = next((flaw for flaw in stream.flaws if flaw.person is not None), None)
        if first is not None:
            where = f"{first.person}, {first.point}" if first.point else first.person
            self.counts.first_refused = f"{where}: {first.reason}"

    def _person(self, person: ReportedPerson, place: Place, error_m: float) -> ReportedPerson:
        name = given_name(person.id, self._number)
        self.counts.people[name] = None
        xyz = person.xyz.copy()
        xyz[~np.isfinite(xyz).all(axis=1) | ~xyz.any(axis=1)] = np.nan
        missing = np.flatnonzero(np.isnan(xyz[:, 0]))
        self.counts.missing_points += sum(person.measured >> int(point) & 1 for point in missing)
        stated = ~np.isnan(person.error_m)
        return replace(
            person, id=name, xyz=place.apply(xyz), error_m=np.where(stated, person.error_m, error_m)
        )


def open_people(
    path: Path,
    number: int | None,
    point_names: Mapping[str, str],
    choice: Choice = NOTHING_SAID,
) -> PeopleSource:
    """Open a file of people by its ending.

    ``number`` tells several files apart; ``choice``: which topics of a bag are meant.

    Raises
    ------
    RecordingError
        The file is of no known kind, is refused, or has no known point name.
    """
    if path.suffix == ".npz":
        return TablePeople(npz.read_people(path), number, point_names)
    if path.name.endswith((".csv", ".csv.gz")):
        return TablePeople(csv_table.read_people(path), number, point_names)
    if path.name.endswith((".bvh", ".bvh.gz")):
        return TablePeople(bvh.read_people(path), number, point_names)
    if path.suffix == ".c3d":
        return TablePeople(c3d_file.read_people(path), number, point_names)
    if is_container(path):
        return RecordedPeople(path, number, point_names, replace(choice, joint_prefix=None, arm=()))
    raise RecordingError(
        path, "", f"is no kind of file that holds people ({path.suffix or 'no ending'})", PEOPLE_KINDS
    )
