"""The reports about people of a recording: decoding them, and noting what of them was not taken."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from occupancy.body import POINT_NAMES
from verifier.recordings import people_report, people_schema
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import Flaw, PeopleReport, ReportError
from verifier.recordings.recording import PEOPLE_TOPIC, Recording

MAX_FLAWS = 1000
MAX_CLOCK_OFFSET_S = 10.0
"""Stamps and message times further apart than this [s] are taken to be on different clocks."""


def _shows_somebody(report: PeopleReport) -> bool:
    """Whether a point of anybody in the report could be read."""
    return any(bool(np.isfinite(person.xyz).any()) for person in report.people)


class PeopleStream:
    """Decodes the reports of a recording.

    Attributes
    ----------
    flaws, flaw_count:
        Persons, points and whole reports that were not taken: the first 1000 of them, and how many there are.
    unknown_points:
        Point names met that are neither ours nor mapped.
    """

    def __init__(self, recording: Recording, point_names: Mapping[str, str]) -> None:
        self.recording = recording
        self.point_names = point_names
        self.flaws: list[Flaw] = []
        self.flaw_count = 0
        self.unknown_points: set[str] = set()

    def report(self, message: Message) -> PeopleReport | None:
        """Decode one message; one that is no report is noted as a flaw."""
        try:
            report = people_report.decode(message.data, message.log_time, self.point_names)
        except ReportError as error:
            self._note([Flaw(message.log_time, None, None, str(error))])
            return None
        apart = (report.arrived_ns - report.stamp_ns) / NANO
        if abs(apart) > MAX_CLOCK_OFFSET_S:
            text = f"stamp and message time are {abs(apart):.6g} s apart, more than {MAX_CLOCK_OFFSET_S:g} s"
            self._note([Flaw(report.stamp_ns, None, None, text)])
            return None
        self._note(report.flaws)
        self.unknown_points |= report.unknown_points
        return report

    def span(self) -> tuple[PeopleReport, PeopleReport]:
        """Return the first and the last readable report.

        Raises
        ------
        RecordingError
            No report is readable, or people are reported but none with a known point.
        """
        file = self.recording.file
        first = self._first_with_a_person(file.messages([PEOPLE_TOPIC]))
        look = PeopleStream(self.recording, self.point_names)
        backwards = (look.report(message) for message in file.last(PEOPLE_TOPIC))
        last = next(report for report in backwards if report is not None)
        return first, last

    def _first_with_a_person(self, messages: Iterable[Message]) -> PeopleReport:
        """The first report, once it is known that the recording does not refuse every person in it."""
        look = PeopleStream(self.recording, self.point_names)
        reports = (report for message in messages if (report := look.report(message)) is not None)
        first = next(reports, None)
        if first is None:
            wrong = f"none of its messages is readable, the first because: {look.flaws[0].reason}"
            raise RecordingError(
                self.recording.path,
                PEOPLE_TOPIC,
                wrong,
                f"write {people_schema.SCHEMA_NAME} with stamps on the clock of the message times, "
                "see docs/recordings.md",
            )
        if _shows_somebody(first) or any(map(_shows_somebody, reports)) or not look.unknown_points:
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
