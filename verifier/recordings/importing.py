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
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.clock_offset import ERROR
from verifier.recordings.crowd import Crowd
from verifier.recordings.errors import RecordingError
from verifier.recordings.import_summary import ImportSummary, LeftOut
from verifier.recordings.joint_source import JointSource, open_joints
from verifier.recordings.joint_state import NANO, JointState
from verifier.recordings.mcap_file import Message
from verifier.recordings.npz import MAX_POSITION_ERROR_M
from verifier.recordings.people_report import WORLD, PeopleReport, ReportedPerson
from verifier.recordings.people_source import Counts, PeopleFile, open_people
from verifier.recordings.recording_writer import RecordingWriter, new_recording
from verifier.recordings.table_joints import Commanded
from verifier.shown import shown

MAX_OFFSET_S = 1e9
FEWEST_SAMPLES = 6
"""A path cannot be laid through fewer joint samples."""
STARTS_APART_S = 1e-3
"""Files that begin further apart than this [s] are worth a note."""


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
    time_offset_s, time_offset_error_s:
        How much later than the joints the people start, and its error [s]; ``None``: not stated, so 0.
    point_names:
        Maps point names of the files to ours.
    choice:
        Which topics and joints of bags are meant.

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
    choice: Choice = NOTHING_SAID
    time_offset_error_s: float | None = None

    def __post_init__(self) -> None:
        if self.position_error_m is not None and not 0.0 <= self.position_error_m <= MAX_POSITION_ERROR_M:
            raise SetupError(
                f"position error {self.position_error_m} m: it must be at least 0 m and at most "
                f"{MAX_POSITION_ERROR_M:g} m"
            )
        if self.time_offset_s is not None and not abs(self.time_offset_s) <= MAX_OFFSET_S:
            raise SetupError(f"time offset {self.time_offset_s} s: it must be within {MAX_OFFSET_S:g} s")


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
        overlap in time, or too little of them is in the stretch that all cover: too few samples, or nothing
        that can be read of the people of a file.
    OutputExistsError
        ``out`` is there and ``force`` is false.
    """
    motion = open_joints(Path(joints), settings.robot, settings.robot_joints, settings.run, settings.choice)
    crowds = [_crowd(file, number, motion, len(people), settings) for number, file in enumerate(people, 1)]
    first, last = _overlap(motion, crowds, Path(joints))
    assumptions = (
        *motion.assumptions,
        *_clock(settings),
        *(crowd.place for crowd in crowds),
        *(crowd.error for crowd in crowds),
        *(each for crowd in crowds for each in crowd.source.assumptions),
    )
    with new_recording(out, force=force) as writer:
        writer.describe({"robot": settings.robot, **_clock_error(settings)}, assumptions)
        streams = motion.items(first, last), _reports(crowds, first, last)
        reports = _write(writer, motion, heapq.merge(*streams, key=itemgetter(0)))
        _check_amount(Path(joints), motion.samples, (last - first) / NANO)
    parts = [
        LeftOut(motion.left_out, motion.left_out + motion.samples, "samples", Path(joints).name),
        *(crowd.left_out for crowd in crowds),
    ]
    counts = [crowd.source.counts for crowd in crowds]
    return ImportSummary(
        path=Path(out),
        joints=settings.robot_joints,
        extra_joints=tuple(name for name in motion.names if name not in settings.robot_joints),
        people=tuple(name for crowd in crowds for name in crowd.people),
        unknown_points=tuple(dict.fromkeys(name for count in counts for name in count.unknown_points)),
        missing_points=sum(count.missing_points for count in counts),
        unreadable_reports=sum(count.unreadable for count in counts),
        refused=sum(count.refused for count in counts),
        first_refused=next((count.first_refused for count in counts if count.refused), ""),
        left_out=tuple(part for part in parts if part.number),
        joint_samples=motion.samples,
        reports=reports,
        duration_s=(last - first) / NANO,
        assumptions=assumptions,
        notes=(
            *(note for crowd in crowds for note in crowd.notes()),
            *_starts(motion, crowds, settings),
            *_asked_of_cells(settings),
        ),
        remarks=(
            *motion.units.remarks(Path(joints).name),
            *(remark for crowd in crowds for remark in crowd.remarks()),
            *_unused_names(settings, counts),
        ),
    )


def _crowd(file: PeopleFile, number: int, motion: JointSource, files: int, settings: ImportSettings) -> Crowd:
    source = open_people(file.path, number if files > 1 else None, settings.point_names, settings.choice)
    offset = motion.first_ns - source.first_ns + round((settings.time_offset_s or 0.0) * NANO)
    return Crowd(file, source, offset, settings.position_error_m)


def _starts(motion: JointSource, crowds: Sequence[Crowd], settings: ImportSettings) -> Iterator[str]:
    """Yield that the files begin at different times, if they do: these times are not used."""
    later = [crowd.source.begins_s - motion.begins_s for crowd in crowds]
    if not any(abs(seconds) > STARTS_APART_S for seconds in later):
        return
    begin = [motion.begins_s, *(crowd.source.begins_s for crowd in crowds)]
    *times, last = dict.fromkeys(f"{round(seconds, 6):.15g} s" for seconds in begin)
    text = f"the files begin at {', '.join(times)} and {last}; each is taken to start at 0"
    length = (motion.last_ns - motion.first_ns) / NANO
    if settings.time_offset_s is not None:
        text += f", the people {settings.time_offset_s:g} s later"
    elif max(later) - min(later) <= STARTS_APART_S and -crowds[0].length_s < later[0] < length:
        text += f"; if their times are of one clock, import with --time-offset {round(later[0], 6):.15g}"
    yield text


def _asked_of_cells(settings: ImportSettings) -> Iterator[str]:
    """Yield what ``verify`` will ask of a cell, because of how well the clocks are known."""
    if settings.time_offset_error_s:
        yield (
            f"verify asks for people.clock_error_s of at least {settings.time_offset_error_s:g} in the cell, "
            "the error of --time-offset; `stopproof init` writes it"
        )


def _unused_names(settings: ImportSettings, counts: Sequence[Counts]) -> Iterator[str]:
    """Yield which names that are mapped no file has."""
    for name in settings.point_names:
        if not any(name in count.mapped_points for count in counts):
            yield f"--point-name {shown(name)}: no file has a point of that name"


def _overlap(motion: JointSource, crowds: Sequence[Crowd], path: Path) -> tuple[int, int]:
    """First and last instant that all files cover [ns]."""
    first = max([motion.first_ns, *(crowd.first_ns for crowd in crowds)])
    last = min([motion.last_ns, *(crowd.last_ns for crowd in crowds)])
    if first >= last:
        length = (motion.last_ns - motion.first_ns) / NANO
        raise RecordingError(
            path,
            "",
            f"its {length:.6g} s of motion and the people do not overlap in time",
            "choose another --time-offset",
        )
    return first, last


def _reports(crowds: Sequence[Crowd], first: int, last: int) -> Iterator[tuple[int, PeopleReport]]:
    """The reports of all files in order of arrival; those of one instant become one report.

    Where one names somebody whom another of the same instant names, they stay apart: one report would make
    two persons of them.
    """
    instant = attrgetter("arrived_ns", "stamp_ns")
    merged = heapq.merge(*(crowd.reports(first, last) for crowd in crowds), key=instant)
    for (arrived, stamp), group in groupby(merged, key=instant):
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
    items: Iterable[tuple[int, JointState | Commanded | Message | PeopleReport]],
) -> int:
    """Write everything; return the number of reports."""
    reports = 0
    for _time, item in items:
        if isinstance(item, PeopleReport):
            writer.people(item)
            reports += 1
        elif isinstance(item, JointState):
            writer.joints(item)
        elif isinstance(item, Commanded):
            writer.commands(item.state)
        else:
            writer.copy(item, motion.schema(item))
    return reports


def _check_amount(path: Path, samples: int, seconds: float) -> None:
    if samples < FEWEST_SAMPLES:
        wrong = f"has {samples} samples in the {seconds:.6g} s that all files cover"
        right = f"{FEWEST_SAMPLES} are needed; times of every file must be in seconds"
        raise RecordingError(path, "", wrong, right)


def _clock(settings: ImportSettings) -> Iterator[Assumption]:
    name, source, error_s = "recording.time_offset", "--time-offset", settings.time_offset_error_s
    if error_s is not None:
        yield Assumption("recording.time_offset_error", error_s, "s", source, Certainty.DECLARED)
    if settings.time_offset_s is not None:
        yield Assumption(name, settings.time_offset_s, "s", source, Certainty.DECLARED)
        return
    yield Assumption(
        name,
        0.0,
        "s",
        "nobody stated it: joints and people are taken to start at the same instant",
        Certainty.DEFAULT,
    )


def _clock_error(settings: ImportSettings) -> dict[str, str]:
    """What the recording says of itself, so that ``verify`` asks for a cell that states it."""
    return {} if settings.time_offset_error_s is None else {ERROR: repr(settings.time_offset_error_s)}
