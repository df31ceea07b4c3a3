"""Copying a recording with verdicts, and what else was found, added."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Schema

from verifier.recordings.containers.container import Container, Record
from verifier.recordings.mcap_file import McapFile, Message
from verifier.recordings.neutral import open_original
from verifier.recordings.recording import Recording
from verifier.recordings.recording_writer import VERDICT_SCHEMA_NAME, RecordingWriter, new_recording
from verifier.recordings.spool import Added
from verifier.recordings.topic import ADDED_TOPICS, VERDICT_TOPIC
from verifier.recordings.translation import schema_of

_Verdicts = Iterable[tuple[int, Mapping[str, Any]]]
_EVERY = 256
"""Messages between two words about progress."""


@dataclass(frozen=True, slots=True)
class Additions:
    """What is added to a copy besides ``/verdict``.

    Attributes
    ----------
    messages:
        Time [ns] and message, in order of time.
    notes:
        Metadata records by name; those of the same name in the original are replaced.
    """

    messages: Iterable[tuple[int, Added]] = ()
    notes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


NOTHING = Additions()


def copy_with_verdicts(
    recording: Recording | str | Path,
    out: str | Path,
    verdicts: _Verdicts,
    additions: Additions = NOTHING,
    *,
    force: bool = False,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Copy a recording with all that is in it and add ``/verdict``; what an earlier run added is replaced.

    Messages are copied as they stand in the original, whoever made it: nothing of it is translated.

    Parameters
    ----------
    recording:
        What to copy.
    out:
        The new file.
    verdicts:
        Time of the cycle [ns, as in the recording] and its verdict, in order of time; NaN has no place in
        JSON.
    additions:
        What else is added.
    force:
        Overwrite ``out`` if it is there.
    progress:
        Told the share that is done.

    Raises
    ------
    OutputExistsError, RecordingError
        ``out`` is there or cannot be written, or the recording is damaged.
    """
    original = _Original(recording)
    streams = (original.messages(), verdicts, additions.messages)
    tell = _Progress(progress, original)
    with new_recording(out, force=force) as writer:
        for name, values in original.metadata:
            if name not in additions.notes:
                writer.copy_metadata(name, values)
        for attachment in original.attachments():
            writer.copy_attachment(attachment)
        for name, values in additions.notes.items():
            writer.copy_metadata(name, values)
        for time_ns, item in heapq.merge(*streams, key=itemgetter(0)):
            if isinstance(item, Added):
                writer.added(time_ns, item)
            elif isinstance(item, Mapping):
                writer.verdict(time_ns, item)
            else:
                original.write(writer, item)
                tell.one_more()


class _Original:
    """Messages of a recording as they stand there."""

    def __init__(self, recording: Recording | str | Path) -> None:
        self._source: McapFile | Container
        if isinstance(recording, Recording) and not recording.translated:
            self._source = recording.file
        else:
            self._source = open_original(
                recording.path if isinstance(recording, Recording) else Path(recording)
            )
        file = self._source if isinstance(self._source, McapFile) else None
        self._file = file
        self.metadata: list[tuple[str, Mapping[str, str]]] = [] if file is None else list(file.metadata)

    @property
    def count(self) -> int:
        """How many messages there are."""
        if isinstance(self._source, McapFile):
            return sum(self._source.counts.values())
        return sum(topic.messages for topic in self._source.topics)

    def attachments(self) -> Iterator[Attachment]:
        return iter(()) if self._file is None else self._file.attachments()

    def messages(self) -> Iterator[tuple[int, Message | Record]]:
        """Yield time [ns] and message, without those that an earlier run has added."""
        if isinstance(self._source, McapFile):
            schemas = self._source.schemas
            for message in self._source.messages():
                schema = schemas.get(message.channel.schema_id)
                if not _added_before(message.channel.topic, "" if schema is None else schema.name):
                    yield message.log_time, message
            return
        for record in self._source.records():
            if not _added_before(record.channel.topic, record.channel.schema):
                yield record.log_time_ns, record

    def write(self, writer: RecordingWriter, item: Message | Record) -> None:
        if isinstance(item, Record):
            channel = item.channel
            writer.raw(channel.topic, schema_of(channel), channel.encoding, item.data, item.log_time_ns)
            return
        schema: Schema | None = None if self._file is None else self._file.schemas.get(item.channel.schema_id)
        writer.copy(item, schema)


class _Progress:
    """Tells the share of the original that is copied."""

    def __init__(self, told: Callable[[float], None] | None, original: _Original) -> None:
        self._told = told
        self._count = max(original.count, 1) if told is not None else 1
        self._done = 0

    def one_more(self) -> None:
        self._done += 1
        if self._told is not None and self._done % _EVERY == 0:
            self._told(min(self._done / self._count, 1.0))


def _added_before(topic: str, schema: str) -> bool:
    return topic in ADDED_TOPICS or (topic == VERDICT_TOPIC and schema == VERDICT_SCHEMA_NAME)
