"""Writing recordings in our format (docs/recordings.md)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Attachment, Schema

from robots.assumption import Assumption
from verifier.recordings import joint_state, people_report, people_schema
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import LATEST_STAMP_NS, JointState
from verifier.recordings.mcap_file import McapWriter, Message, MessageTimeError
from verifier.recordings.metadata import METADATA
from verifier.recordings.people_report import PeopleReport
from verifier.recordings.spool import Added
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC, PEOPLE_TOPIC, VERDICT_TOPIC
from verifier.recordings.writing import new_file

FORMAT = "1"
VERDICT_SCHEMA_NAME = "stopproof.Verdict"


class RecordingWriter:
    """Writes messages of a recording to a stream, in the order in which they are given."""

    def __init__(self, stream: BinaryIO) -> None:
        self._out = McapWriter(stream)
        self._joints = Schema(
            id=0,
            name=joint_state.SCHEMA_NAME,
            encoding=joint_state.SCHEMA_ENCODING,
            data=joint_state.SCHEMA,
        )
        self._people = Schema(
            id=0,
            name=people_schema.SCHEMA_NAME,
            encoding=people_schema.SCHEMA_ENCODING,
            data=people_schema.SCHEMA,
        )
        self._verdict = Schema(
            id=0, name=VERDICT_SCHEMA_NAME, encoding="jsonschema", data=b'{"type":"object"}'
        )

    def describe(self, values: Mapping[str, str], assumptions: Sequence[Assumption] = ()) -> None:
        """Write the record ``stopproof``: ``values`` (e.g. ``robot``) and what was assumed."""
        record = {"format": FORMAT, **values}
        if assumptions:
            record["assumptions"] = json.dumps(
                [
                    {
                        "name": a.name,
                        "value": a.value,
                        "unit": a.unit,
                        "source": a.source,
                        "certainty": a.certainty,
                    }
                    for a in assumptions
                ]
            )
        self._out.metadata(METADATA, record)

    def joints(self, state: JointState, arrived_ns: int | None = None) -> None:
        """Write joint positions; the message time is the stamp, unless it is given."""
        self._write_state(JOINT_TOPIC, state, arrived_ns)

    def commands(self, state: JointState, arrived_ns: int | None = None) -> None:
        """Write where the joints were commanded to be; as :meth:`joints`."""
        self._write_state(COMMAND_TOPIC, state, arrived_ns)

    def joints_as_they_are(self, data: bytes, arrived_ns: int) -> None:
        """Write a message with joint positions that is encoded already."""
        self._out.write(self._out.channel(JOINT_TOPIC, self._joints, "cdr"), arrived_ns, data)

    def people(self, report: PeopleReport) -> None:
        """Write a report about people; the message time is when it arrived."""
        self.people_as_they_are(people_report.encode(report), report.arrived_ns)

    def people_as_they_are(self, data: bytes, arrived_ns: int) -> None:
        """Write a report about people that is encoded already."""
        self._out.write(self._out.channel(PEOPLE_TOPIC, self._people, "json"), arrived_ns, data)

    def _write_state(self, topic: str, state: JointState, arrived_ns: int | None) -> None:
        if not abs(state.stamp_ns) < LATEST_STAMP_NS:
            raise MessageTimeError(f"a joint sample would get the stamp {state.stamp_ns / 1e9:.6f} s")
        time_ns = state.stamp_ns if arrived_ns is None else arrived_ns
        self._out.write(self._out.channel(topic, self._joints, "cdr"), time_ns, joint_state.encode(state))

    def verdict(self, time_ns: int, content: Mapping[str, Any]) -> None:
        """Write what was found for the cycle at ``time_ns``."""
        channel = self._out.channel(VERDICT_TOPIC, self._verdict, "json")
        data = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        self._out.write(channel, time_ns, data)

    def added(self, time_ns: int, item: Added) -> None:
        """Write a message of a topic that is added to a copy."""
        topic = item.topic
        schema = Schema(id=0, name=topic.schema, encoding=topic.schema_encoding, data=topic.schema_data)
        self._out.write(self._out.channel(topic.name, schema, topic.encoding), time_ns, item.data)

    def copy(self, message: Message, schema: Schema | None) -> None:
        """Write a message of another file as it is."""
        source = message.channel
        channel = self._out.channel(source.topic, schema, source.message_encoding, source.metadata)
        self._out.write(channel, message.log_time, message.data, message.publish_time)

    def raw(self, topic: str, schema: Schema | None, encoding: str, data: bytes, time_ns: int) -> None:
        """Write a message of another container as it is."""
        self._out.write(self._out.channel(topic, schema, encoding), time_ns, data)

    def copy_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record of another file as it is."""
        self._out.metadata(name, values)

    def copy_attachment(self, attachment: Attachment) -> None:
        """Write an attachment of another file as it is."""
        self._out.attach(attachment)

    def finish(self) -> None:
        """Write the index."""
        self._out.finish()


@contextmanager
def new_recording(path: str | Path, *, force: bool = False) -> Iterator[RecordingWriter]:
    """Open a recording for writing; the file appears when the block ends without an exception.

    Raises
    ------
    OutputExistsError, RecordingError
        As :func:`verifier.recordings.writing.new_file` says; a message was to get a time that none can have.
    """
    with new_file(path, force=force) as stream:
        writer = RecordingWriter(stream)
        try:
            yield writer
        except MessageTimeError as error:
            right = "message times count from 0 and end in the year 2262, stamps of joints in 2038"
            raise RecordingError(path, "", str(error), right) from error
        writer.finish()
