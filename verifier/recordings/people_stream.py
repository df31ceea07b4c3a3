"""The reports about people of a recording: decoding them, and noting what of them was not taken."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from occupancy.body import POINT_NAMES
from verifier.recordings import people_report, people_schema
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import Flaw, PeopleReport, ReportError, unreadable
from verifier.recordings.recording import PEOPLE_TOPIC, Recording

MAX_FLAWS = 1000
MAX_CLOCK_OFFSET_S = 10.0
"""Stamps and message times further apart than this [s] are taken to be on different clocks."""


_UNITS = {"ms": 10**3, "µs": 10**6, "ns": 10**9}


def _shows_somebody(report: PeopleReport) -> bool:
    """Whether a point of anybody in the report could be read."""
    return any(bool(np.isfinite(person.xyz).any()) for person in report.people)


def _hint(report: PeopleReport) -> str:
    """Name the unit in which the stamp would agree with the message time, if there is one."""
    near = (
        unit
        for unit, factor in _UNITS.items()
        if abs(report.stamp_ns / factor - report.arrived_ns) <= MAX_CLOCK_OFFSET_S * NANO
    )
    unit = next(near, None)
    return "" if unit is None else f" (it looks like {unit}: stamps are in s)"


class PeopleStream:
    """Decodes the reports of a recording.

    Attributes
    ----------
    flaws, flaw_count:
        Persons, points and whole reports that were not taken: the first 1000 of them, and how many there are.
    unknown_points:
        Point names met that are neither ours nor mapped.

    Whoever is named in a report that cannot be read is there all the same, nobody knows where: such a report
    comes without points.
    """

    def __init__(self, recording: Recording, point_names: Mapping[str, str]) -> None:
        self.recording = recording
        self.point_names = point_names
        self.flaws: list[Flaw] = []
        self.flaw_count = 0
        self.unknown_points: set[str] = set()

    def report(self, message: Message) -> PeopleReport | None:
        """Decode one message; what cannot be read is noted as a flaw. ``None``: it names nobody."""
        try:
            report = people_report.decode(message.data, message.log_time, self.point_names)
        except ReportError as error:
            self._note([Flaw(message.log_time, None, None, str(error))])
            return unreadable(message.log_time, error.people) if error.people else None
        apart = abs(report.arrived_ns - report.stamp_ns) / NANO
        if apart > MAX_CLOCK_OFFSET_S:
            text = f"stamp and message time are {apart:.6g} s apart, more than {MAX_CLOCK_OFFSET_S:g} s"
            self._note([Flaw(report.stamp_ns, None, None, text + _hint(report))])
            people = [person.id for person in report.people]
            return unreadable(message.log_time, people) if people else None
        self._note(report.flaws)
        self.unknown_points |= report.unknown_points
        return report

    def span(self) -> tuple[PeopleReport, PeopleReport]:
        """Return the first report, and the last readable one.

        Raises
        ------
        RecordingError
            No report is readable, or people are reported but none with a known point.
        """
        file = self.recording.file
        first = self._first_with_a_person(file.messages([PEOPLE_TOPIC]))
        look = PeopleStream(self.recording, self.point_names)
        backwards = (look.report(message) for message in file.last(PEOPLE_TOPIC))
        last = next(report for report in backwards if report is not None and report.readable)
        return first, last

    def _first_with_a_person(self, messages: Iterable[Message]) -> PeopleReport:
        """The first report, once it is known that the recording does not refuse every person in it."""
        look = PeopleStream(self.recording, self.point_names)
        reports = (report for message in messages if (report := look.report(message)) is not None)
        first = next(reports, None)
        readable = first
        while readable is not None and not readable.readable:
            readable = next(reports, None)
        if first is None or readable is None:
            wrong = f"none of its messages is readable, the first because: {look.flaws[0].reason}"
            raise RecordingError(
                self.recording.path,
                PEOPLE_TOPIC,
                wrong,
                f"write {people_schema.SCHEMA_NAME} with stamps on the clock of the message times, "
                "see docs/recordings.md",
            )
        if _shows_somebody(readable) or any(map(_shows_somebody, reports)) or not look.unknown_points:
            return first
        raise RecordingError(
            self.recording.path,
            PEOPLE_TOPIC,
            f"has no known point name (it has {', '.join(sorted(look.unknown_points))})",
            f"known are {', '.join(POINT_NAMES)}; the cell can map others in people.point_names",
        )

    def _note(self, flaws: Iterable[Flaw]) -> None:
        for flaw in flaws:
            self.flaw_count += 1
            if len(self.flaws) < MAX_FLAWS:
                self.flaws.append(flaw)
