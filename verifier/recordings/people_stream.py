"""The reports about people of a recording: decoding them, and noting what of them was not taken."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

from occupancy.body import POINT_NAMES
from verifier.recordings import people_report, people_schema
from verifier.recordings.clock_offset import MOVED_BY, in_words
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.mcap_file import McapFile, Message
from verifier.recordings.people_report import Flaw, PeopleReport, ReportError, unreadable
from verifier.recordings.topic import PEOPLE_TOPIC

MAX_FLAWS = 1000
MAX_CLOCK_OFFSET_S = 10.0
"""Stamps and message times further apart than this [s] are taken to be on different clocks."""

_UNITS = {"ms": 10**3, "µs": 10**6, "ns": 10**9}
_LIKE = 0.1
"""A unit is named where stamps in it go on as message times do, to this part of them."""


def _hint(stamp_ns: int, arrived_ns: int) -> str:
    """Name the unit in which as much time has gone by for the stamps as for the messages, if there is one."""
    near = (
        unit
        for unit, factor in _UNITS.items()
        if abs(stamp_ns / factor - arrived_ns) < _LIKE * abs(arrived_ns)
    )
    unit = next(near, None)
    return "" if unit is None else f" (it looks like {unit}: stamps are in s)"


class PeopleStream:
    """Decodes the reports of a recording.

    Parameters
    ----------
    file:
        The recording, which has messages on ``/people``.
    point_names:
        Maps its point names to ours.
    regions:
        Names of the monitored regions that complete reports must speak for.

    Attributes
    ----------
    flaws, flaw_count:
        Persons, points and whole reports that were not taken: the first 1000 of them, and how many there are.
    unreadable:
        Whole reports among them.
    unknown_points:
        Point names met that are neither ours nor mapped.
    mapped_points:
        Names of the map that were met.

    Whoever is named in a report that cannot be read is there all the same, nobody knows where: such a report
    comes without points.
    """

    def __init__(self, file: McapFile, point_names: Mapping[str, str], regions: Collection[str] = ()) -> None:
        self.file = file
        self._regions = regions
        self.point_names = point_names
        self.flaws: list[Flaw] = []
        self.flaw_count = 0
        self.unreadable = 0
        self.unknown_points: set[str] = set()
        self.mapped_points: set[str] = set()
        self._since: tuple[int, int] | None = None
        self._other_clock: PeopleReport | None = None

    def report(self, message: Message) -> PeopleReport | None:
        """Decode one message; what cannot be read is noted as a flaw. ``None``: it names nobody."""
        try:
            report = people_report.decode(message.data, message.log_time, self.point_names, self._regions)
        except ReportError as error:
            return self._unreadable(message, message.log_time, str(error), error.people)
        hint = self._unit(report)
        apart = abs(report.arrived_ns - report.stamp_ns) / NANO
        if apart > MAX_CLOCK_OFFSET_S:
            least = 10.0 ** math.floor(math.log10(apart))  # the same words for all that are about as far
            text = f"stamp and message time are {least:g} to {10.0 * least:g} s apart, more than "
            text += f"{MAX_CLOCK_OFFSET_S:g} s"
            people = [person.id for person in report.people]
            self._other_clock = self._other_clock or report
            return self._unreadable(message, report.stamp_ns, text + hint, people)
        self._note(report.flaws)
        self.unknown_points |= report.unknown_points
        self.mapped_points |= report.mapped_points
        return report

    def span(self) -> tuple[PeopleReport, PeopleReport]:
        """Return the first report, and the last readable one.

        Raises
        ------
        RecordingError
            No report is readable, or people are reported but none ever with a known point name.
        """
        first = self._first_with_a_person(self.file.messages([PEOPLE_TOPIC]))
        look = PeopleStream(self.file, self.point_names)
        backwards = (look.report(message) for message in self.file.last(PEOPLE_TOPIC))
        last = next(report for report in backwards if report is not None and report.readable)
        return first, last

    def _first_with_a_person(self, messages: Iterable[Message]) -> PeopleReport:
        """The first report, once it is known that the recording does not refuse every person in it."""
        look = PeopleStream(self.file, self.point_names)
        first: PeopleReport | None = None
        readable = listed = False
        for report in filter(None, map(look.report, messages)):
            first = first or report
            if report.known_points:
                return first
            readable = readable or report.readable
            listed = listed or (report.readable and bool(report.people))
        if first is None or not readable:
            wrong = f"none of its messages is readable, the first because: {look.flaws[0].reason}"
            if look._other_clock is not None:
                raise look._refuse_clock(look._other_clock, wrong)
            raise RecordingError(
                self.file.path,
                PEOPLE_TOPIC,
                wrong,
                f"write {people_schema.SCHEMA_NAME} with stamps on the clock of the message times, "
                "see docs/recordings.md",
            )
        if not listed:
            return first
        raise RecordingError(
            self.file.path,
            PEOPLE_TOPIC,
            f"has no known point name (it has {', '.join(sorted(look.unknown_points)) or 'no point at all'})",
            f"known are {', '.join(POINT_NAMES)}; the cell can map others in people.point_names",
        )

    def _refuse_clock(self, report: PeopleReport, wrong: str) -> RecordingError:
        stamp, message = in_words(report.stamp_ns), in_words(report.arrived_ns)
        return RecordingError(
            self.file.path,
            PEOPLE_TOPIC,
            f"{wrong}: a stamp is {stamp}, and its message time {message}",
            f"write {people_schema.SCHEMA_NAME} with stamps on the clock of the message times, or: "
            f"{MOVED_BY['people']}",
        )

    def _unit(self, report: PeopleReport) -> str:
        """Name the unit of the stamps by the time since the first report: clocks that differ go alike.

        Of the first itself, by the time since 0, unless that is so short that any ratio may be chance.
        """
        if self._since is not None:
            stamp_ns, arrived_ns = self._since
            return _hint(report.stamp_ns - stamp_ns, report.arrived_ns - arrived_ns)
        self._since = report.stamp_ns, report.arrived_ns
        return _hint(*self._since) if report.arrived_ns >= MAX_CLOCK_OFFSET_S * NANO else ""

    def _unreadable(
        self, message: Message, stamp_ns: int, reason: str, people: Sequence[str]
    ) -> PeopleReport | None:
        self.unreadable += 1
        self._note([Flaw(stamp_ns, None, None, reason)])
        return unreadable(message.log_time, people) if people else None

    def _note(self, flaws: Iterable[Flaw]) -> None:
        for flaw in flaws:
            self.flaw_count += 1
            if len(self.flaws) < MAX_FLAWS:
                self.flaws.append(flaw)
