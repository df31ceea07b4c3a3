"""Making a recording from separate files of joint motion and of people."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from verifier.recordings.errors import RecordingError
from verifier.recordings.inspection import assumption_line
from verifier.recordings.joint_source import JointSource, open_joints
from verifier.recordings.joint_state import NANO, JointState
from verifier.recordings.likely_units import Pace, PeopleUnits
from verifier.recordings.mcap_file import Message
from verifier.recordings.npz import MAX_POSITION_ERROR_M
from verifier.recordings.people_report import WORLD, PeopleReport, ReportedPerson
from verifier.recordings.people_source import (
    DEFAULT_POSITION_ERROR_M,
    PeopleFile,
    PeopleSource,
    Place,
    open_people,
)
from verifier.recordings.recording_writer import RecordingWriter, new_recording
from verifier.shown import LONGEST_VALUE, shown

MAX_OFFSET_S = 1e9
FEWEST_SAMPLES = 6
"""A path cannot be laid through fewer joint samples."""
NOT_COMPLETE = (
    'no imported report is marked "complete", because nobody said that nobody else was there: whoever was '
    "reported once never leaves, a report that lists nobody says nothing, and with a monitored region in the "
    'cell nothing is verified; if the source does list everybody, write "complete": true into its reports on '
    "/people (docs/recordings.md)"
)


@dataclass(frozen=True, slots=True)
class ImportSettings:
    """What an import needs to be told.

    Attributes
    ----------
    robot, robot_joints:
        Name of the arm, and its joints in the order of its model.
    run:
        Which of the runs of a joint file that numbers them.
    position_error_m:
        Position error of the points [m] where the file states none; ``None``: 0.01 m, shown as default.
    time_offset_s:
        How much later than the joints the people start [s]; ``None``: not stated, so 0.
    point_names:
        Maps point names of the files to ours.

    Raises
    ------
    SetupError
        A number is NaN, infinite, negative or absurdly large.
    """

    robot: str
    robot_joints: tuple[str, ...]
    run: int | None = None
    position_error_m: float | None = None
    time_offset_s: float | None = None
    point_names: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.position_error_m is not None and not 0.0 <= self.position_error_m <= MAX_POSITION_ERROR_M:
            raise SetupError(
                f"position error {self.position_error_m} m: it must be at least 0 m and at most "
                f"{MAX_POSITION_ERROR_M:g} m"
            )
        if self.time_offset_s is not None and not abs(self.time_offset_s) <= MAX_OFFSET_S:
            raise SetupError(f"time offset {self.time_offset_s} s: it must be within {MAX_OFFSET_S:g} s")


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What an import did.

    Attributes
    ----------
    path:
        The new recording.
    joints, extra_joints:
        Joints of the robot, and joints of the file that the robot does not have (they are kept).
    people:
        Names given to the persons.
    unknown_points:
        Point names that are neither ours nor mapped; they are ignored.
    missing_points:
        Points that were NaN, infinite or exactly zero, and are left out.
    unreadable_reports:
        Reports of an MCAP of which only the names of the people in them could be taken, if any.
    refused, first_refused:
        Persons and points of other reports of an MCAP that could not be read, and the first of them.
    joint_samples, reports:
        Messages written.
    duration_s:
        Length of the stretch that all files cover [s].
    assumptions:
        What was assumed; also written into the recording.
    remarks:
        What should be looked at.
    """

    path: Path
    joints: tuple[str, ...]
    extra_joints: tuple[str, ...]
    people: tuple[str, ...]
    unknown_points: tuple[str, ...]
    missing_points: int
    unreadable_reports: int
    refused: int
    first_refused: str
    joint_samples: int
    reports: int
    duration_s: float
    assumptions: tuple[Assumption, ...]
    remarks: tuple[str, ...]

    def lines(self) -> list[str]:
        """Return everything as text."""
        lines = [
            f"{self.path}: {self.duration_s:.3f} s, {self.joint_samples} samples, {self.reports} reports",
            f"people: {', '.join(map(shown, self.people)) or 'none'}",
        ]
        if self.extra_joints:
            lines.append(
                f"joints of the file that the robot does not have: {', '.join(map(shown, self.extra_joints))}"
            )
        if self.unknown_points:
            names = ", ".join(map(shown, self.unknown_points))
            lines.append(f"point names that are not known and were ignored: {names}")
        if self.missing_points:
            lines.append(f"points that were NaN, infinite or zero and were left out: {self.missing_points}")
        if self.unreadable_reports:
            lines.append(
                f"reports that could not be read but for the names in them: {self.unreadable_reports}"
            )
        if self.refused:
            lines.append(
                f"persons and points that could not be read and were left out: {self.refused}, "
                f"the first: {shown(self.first_refused, LONGEST_VALUE)}"
            )
        lines += [assumption_line(assumption) for assumption in self.assumptions]
        lines += [f"note: {NOT_COMPLETE}"] if self.reports else []
        return [*lines, *(f"look at: {remark}" for remark in self.remarks)]


@dataclass(frozen=True, slots=True)
class _Crowd:
    """The reports of one file, with where and when they are put."""

    file: PeopleFile
    source: PeopleSource
    offset_ns: int
    error: Assumption
    units: PeopleUnits = field(default_factory=PeopleUnits)

    def reports(self) -> Iterator[PeopleReport]:
        place = self.file.place or Place()
        for report in self.source.reports(place, float(self.error.value)):
            self.units.add(report)
            stamp, arrived = report.stamp_ns + self.offset_ns, report.arrived_ns + self.offset_ns
            yield PeopleReport(stamp, arrived, WORLD, False, report.people)


def import_recording(
    out: str | Path,
    joints: str | Path,
    people: Sequence[PeopleFile],
    settings: ImportSettings,
    *,
    force: bool = False,
) -> ImportSummary:
    """Combine joint motion and people into one recording.

    Both start at the same time, the people ``time_offset_s`` later; what is written is the stretch that all
    files cover. A report arrives when it is seen, except that reports from an MCAP keep their delay. No
    report counts as complete, because nobody said that there was nobody else. Other topics of an MCAP with
    joints are copied.

    Raises
    ------
    RecordingError
        A file is refused, the robot's joints are not in the file, no point name is known, the files do not
        overlap in time, or too little of them is in the stretch that all cover.
    OutputExistsError
        ``out`` is there and ``force`` is false.
    """
    motion = open_joints(Path(joints), settings.robot, settings.robot_joints, settings.run)
    crowds = [_crowd(file, number, motion, len(people), settings) for number, file in enumerate(people, 1)]
    first, last = _overlap(motion, crowds, Path(joints))
    assumptions = (
        *motion.assumptions,
        _clock(settings),
        *_places(crowds),
        *(crowd.error for crowd in crowds),
        *(each for crowd in crowds for each in crowd.source.assumptions),
    )
    pace = Pace()
    with new_recording(out, force=force) as writer:
        writer.describe({"robot": settings.robot}, assumptions)
        streams = motion.items(first, last), _reports(crowds, first, last)
        reports = _write(writer, motion, heapq.merge(*streams, key=itemgetter(0)), pace)
        _check_amount(Path(joints), motion.samples, (last - first) / NANO)
    counts = [crowd.source.counts for crowd in crowds]
    return ImportSummary(
        path=Path(out),
        joints=settings.robot_joints,
        extra_joints=tuple(name for name in motion.names if name not in settings.robot_joints),
        people=tuple(name for count in counts for name in count.people),
        unknown_points=tuple(dict.fromkeys(name for count in counts for name in count.unknown_points)),
        missing_points=sum(count.missing_points for count in counts),
        unreadable_reports=sum(count.unreadable for count in counts),
        refused=sum(count.refused for count in counts),
        first_refused=next((count.first_refused for count in counts if count.refused), ""),
        joint_samples=motion.samples,
        reports=reports,
        duration_s=(last - first) / NANO,
        assumptions=assumptions,
        remarks=(*pace.remarks(Path(joints).name), *_remarks(crowds)),
    )


def _remarks(crowds: Sequence[_Crowd]) -> Iterator[str]:
    for crowd in crowds:
        yield from crowd.units.remarks(crowd.file.path.name)


def _crowd(
    file: PeopleFile, number: int, motion: JointSource, files: int, settings: ImportSettings
) -> _Crowd:
    source = open_people(file.path, number if files > 1 else None, settings.point_names)
    offset = motion.first_ns - source.first_ns + round((settings.time_offset_s or 0.0) * NANO)
    return _Crowd(file, source, offset, _position_error(file, source, settings))


def _overlap(motion: JointSource, crowds: Sequence[_Crowd], path: Path) -> tuple[int, int]:
    """First and last instant that all files cover [ns]."""
    first = max([motion.first_ns, *(crowd.source.first_ns + crowd.offset_ns for crowd in crowds)])
    last = min([motion.last_ns, *(crowd.source.last_ns + crowd.offset_ns for crowd in crowds)])
    if first >= last:
        length = (motion.last_ns - motion.first_ns) / NANO
        raise RecordingError(
            path,
            "",
            f"its {length:.6g} s of motion and the people do not overlap in time",
            "choose another --time-offset",
        )
    return first, last


def _reports(crowds: Sequence[_Crowd], first: int, last: int) -> Iterator[tuple[int, PeopleReport]]:
    """The reports of all files in order of arrival; those of one instant become one report.

    Where one names somebody whom another of the same instant names, they stay apart: one report would make
    two persons of them.
    """
    instant = attrgetter("arrived_ns", "stamp_ns")
    merged = heapq.merge(*(crowd.reports() for crowd in crowds), key=instant)
    for (arrived, stamp), group in groupby(merged, key=instant):
        if first <= stamp <= last:
            for people in _one_of_each(group):
                yield arrived, PeopleReport(stamp, arrived, WORLD, False, people)


def _one_of_each(reports: Iterable[PeopleReport]) -> Iterator[tuple[ReportedPerson, ...]]:
    people: dict[str, ReportedPerson] = {}
    for report in reports:
        named = {person.id: person for person in report.people}
        if people.keys() & named.keys():
            yield tuple(people.values())
            people = {}
        people |= named
    yield tuple(people.values())


def _write(
    writer: RecordingWriter,
    motion: JointSource,
    items: Iterable[tuple[int, JointState | Message | PeopleReport]],
    pace: Pace,
) -> int:
    """Write everything, and see how fast joints move; return the number of reports."""
    reports = 0
    for _time, item in items:
        if isinstance(item, PeopleReport):
            writer.people(item)
            reports += 1
        elif isinstance(item, JointState):
            writer.joints(item)
            pace.add("joints", item.stamp_ns, item.position)
        else:
            writer.copy(item, motion.schema(item))
    return reports


def _check_amount(path: Path, samples: int, seconds: float) -> None:
    if samples < FEWEST_SAMPLES:
        wrong = f"has {samples} samples in the {seconds:.6g} s that all files cover"
        right = f"{FEWEST_SAMPLES} are needed; times of every file must be in seconds"
        raise RecordingError(path, "", wrong, right)


def _position_error(file: PeopleFile, source: PeopleSource, settings: ImportSettings) -> Assumption:
    name = f"recording.position_error.{file.path.name}"
    if source.position_error_m is not None:
        return Assumption(name, source.position_error_m, "m", file.path.name, Certainty.DECLARED)
    if settings.position_error_m is not None:
        return Assumption(name, settings.position_error_m, "m", "--position-error", Certainty.DECLARED)
    return Assumption(
        name, DEFAULT_POSITION_ERROR_M, "m", "nobody stated it: default of this software", Certainty.DEFAULT
    )


def _clock(settings: ImportSettings) -> Assumption:
    name = "recording.time_offset"
    if settings.time_offset_s is not None:
        return Assumption(name, settings.time_offset_s, "s", "--time-offset", Certainty.DECLARED)
    return Assumption(
        name,
        0.0,
        "s",
        "nobody stated it: joints and people are taken to start at the same instant",
        Certainty.DEFAULT,
    )


def _places(crowds: Sequence[_Crowd]) -> Iterator[Assumption]:
    for crowd in crowds:
        place, name = crowd.file.place, f"recording.place.{crowd.file.path.name}"
        if place is None:
            source = "nobody stated it: the people's frame is taken to be the robot base"
            yield Assumption(name, "0 0 0 0", "m m m deg", source, Certainty.DEFAULT)
        else:
            value = f"{place.x:g} {place.y:g} {place.z:g} {place.yaw_deg:g}"
            yield Assumption(name, value, "m m m deg", "--place", Certainty.DECLARED)
