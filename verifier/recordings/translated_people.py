"""Reports about people of a foreign recording, written as ours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from robots.assumption import Assumption, Certainty
from verifier.recordings import people_schema
from verifier.recordings.clock_offset import ClockOffsets, moved_json
from verifier.recordings.containers.container import Container, Record
from verifier.recordings.decoded import SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.own_people import STRING, own_text
from verifier.recordings.people_report import Flaw, PeopleReport
from verifier.recordings.people_sources import PeopleAdapter, SourceOptions, new_adapters
from verifier.recordings.people_sources.field import FieldSwitch
from verifier.recordings.recording_writer import RecordingWriter


class TranslatedPeople:
    """Takes the messages of one source in order of time; our own reports are copied to the letter."""

    def __init__(
        self, container: Container, options: SourceOptions, writer: RecordingWriter, clocks: ClockOffsets
    ) -> None:
        self._container = container
        self._adapters = new_adapters(options)
        self._writer = writer
        self._clocks = clocks
        self._used: dict[str, PeopleAdapter] = {}
        self._flaws = 0
        self._first: Flaw | None = None
        self._last: Record | None = None
        self._unknown: set[str] = set()

    def take(self, record: Record) -> None:
        """Write what a message says.

        Raises
        ------
        RecordingError
            It cannot be decoded, or not be said in our words.
        """
        channel, self._last = record.channel, record
        foreign = channel.schema in self._adapters
        if channel.encoding == "json" and (channel.schema == people_schema.SCHEMA_NAME or not foreign):
            self._own(record.data, record)
            return
        decoded = self._container.decode(record)
        if self._clocks.people_s is not None and channel.schema in FieldSwitch.schemas:
            raise RecordingError(
                self._container.path, channel.topic, "has no stamps to move", "state no time offset for it"
            )
        try:
            if channel.schema == STRING:
                self._own(own_text(decoded), record)
            else:
                adapter = self._used.setdefault(channel.schema, self._adapters[channel.schema])
                self._write(adapter.read(decoded))
        except SourceError as error:
            raise self._refused(record, error) from error

    def finish(self) -> None:
        """Write what the last messages say.

        Raises
        ------
        RecordingError
            Nothing of the source can be used.
        """
        for adapter in self._used.values():
            try:
                self._write(adapter.finish())
            except SourceError as error:
                assert self._last is not None
                raise self._refused(self._last, error) from error

    def assumptions(self) -> Iterator[Assumption]:
        """Yield what reading the source assumed, and how much of it could not be read."""
        for adapter in self._used.values():
            yield from adapter.assumptions
        if self._first is not None:
            where = ", ".join(each for each in (self._first.person, self._first.point) if each is not None)
            why = f"persons, points and reports not read; the first: {where} {self._first.reason}"
            yield Assumption("recording.people_left_out", float(self._flaws), "", why, Certainty.MEASURED)

    def _write(self, reports: Iterable[PeopleReport]) -> None:
        for report in reports:
            self._write_one(report)

    def _write_one(self, report: PeopleReport) -> None:
        self._flaws += len(report.flaws)
        self._first = self._first or next(iter(report.flaws), None)
        unstamped = report.stamp_ns == report.arrived_ns and not report.known_points
        moved = 0 if unstamped else self._clocks.people_ns
        arrived_ns = report.arrived_ns + self._clocks.later_ns
        unknown = report.unknown_points - self._unknown  # each is written once: it is only listed
        self._unknown |= unknown
        written = replace(report, stamp_ns=report.stamp_ns + moved, arrived_ns=arrived_ns)
        self._writer.people(replace(written, unknown_points=unknown))

    def _own(self, data: bytes, record: Record) -> None:
        offset_ns = self._clocks.people_ns
        data = moved_json(data, offset_ns) if offset_ns else data
        self._writer.people_as_they_are(data, record.log_time_ns + self._clocks.later_ns)

    def _refused(self, record: Record, error: SourceError) -> RecordingError:
        place = f"{record.channel.topic}, message at {record.log_time_ns} ns"
        return RecordingError(self._container.path, place, str(error))
