"""MCAP files of any maker; one without a usable index is read from its beginning as far as it goes."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel as McapChannel
from mcap.records import ChunkIndex, Schema

from verifier.recordings.containers.container import (
    MAX_MESSAGE_BYTES,
    TIME_END_NS,
    Channel,
    Record,
    Stretch,
    in_order,
    readable_text,
    reading,
    topics_of,
)
from verifier.recordings.containers.stored import Stored
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_chunk import RECORD_HEAD, unpack
from verifier.recordings.mcap_file import DAMAGE, MAGIC, MESSAGE_HEAD, McapFile

KIND = "the MCAP file"
CHUNK_TIMES = struct.Struct("<QQ")
_DEFINING = (Opcode.SCHEMA, Opcode.CHANNEL)


class McapContainer(Stored):
    """A complete MCAP file; see :class:`verifier.recordings.containers.container.Container`."""

    def __init__(self, file: McapFile) -> None:
        super().__init__(file.path)
        self._file = file
        self._known = {n: _channel(each, file.schemas) for n, each in file.channels.items()}
        self.channels = tuple(dict.fromkeys(self._known.values()))
        self.topics = topics_of((each, file.counts.get(n, 0)) for n, each in self._known.items())

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` in order of log time."""
        for message in self._file.messages(topics):
            channel = self._known[message.channel.id]
            yield Record(channel, message.log_time, message.data, message.place)


class DamagedMcap(Stored):
    """An MCAP file that :class:`McapFile` refuses for ``why``: what of it can be read.

    Raises
    ------
    RecordingError
        The file is not there.
    """

    def __init__(self, path: Path, why: RecordingError) -> None:
        super().__init__(path)
        self._channels: dict[int, McapChannel] = {}
        self._schemas: dict[int, Schema] = {}
        self._stretches: list[Stretch] = []
        with reading(path, KIND, why.right) as stream:
            self._size = os.fstat(stream.fileno()).st_size
            self._scan(stream)
        self._known = {n: _channel(each, self._schemas) for n, each in self._channels.items()}
        counts: Counter[int] = Counter()
        for stretch in self._stretches:
            counts.update(stretch.counts)
        first = min((stretch.first_ns for stretch in self._stretches), default=None)
        last = max((stretch.last_ns for stretch in self._stretches), default=None)
        self.damage = f"{why.wrong}: {readable_text(counts.values(), first, last)}; {why.right}"
        self.channels = tuple(dict.fromkeys(self._known.values()))
        self.topics = topics_of((each, counts[n]) for n, each in self._known.items())

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` in order of log time."""
        wanted = {n for n, each in self._known.items() if topics is None or each.topic in topics}
        stretches = [each for each in self._stretches if wanted & each.counts.keys()]
        with reading(self.path, KIND, "") as stream:
            yield from in_order(stretches, lambda each: self._unpack(stream, each, wanted))

    def _scan(self, stream: BinaryIO) -> None:
        """Note chunks and messages in order of the file, up to the first that cannot be read."""
        stream.seek(len(MAGIC))
        while True:
            place = stream.tell()
            try:
                opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
                if place + RECORD_HEAD.size + length > self._size or opcode in (
                    Opcode.FOOTER,
                    Opcode.DATA_END,
                ):
                    return
                self._note(stream, place, opcode, length)
                stream.seek(place + RECORD_HEAD.size + length)
            except DAMAGE:
                return

    def _note(self, stream: BinaryIO, place: int, opcode: int, length: int) -> None:
        if opcode in _DEFINING and length <= MAX_MESSAGE_BYTES:
            self._define(opcode, stream.read(length))
        elif opcode in (Opcode.CHUNK, Opcode.MESSAGE):
            counts: Counter[int] = Counter()
            times: list[int] = []
            for channel, log_time, _data, _offset in self._messages(stream, place):
                counts[channel] += 1
                times.append(log_time)
            if times:
                self._stretches.append(Stretch(place, min(times), max(times), dict(counts)))

    def _define(self, opcode: int, body: bytes) -> None:
        data = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(data)
            self._schemas[schema.id] = schema
        else:
            channel = McapChannel.read(data)
            self._channels[channel.id] = channel

    def _messages(self, stream: BinaryIO, place: int) -> Iterator[tuple[int, int, bytes, int]]:
        """Channel, time [ns], bytes and offset of every message of the record at ``place``."""
        for offset, opcode, body in self._inner(stream, place):
            if opcode in _DEFINING:
                self._define(opcode, body)
            elif opcode == Opcode.MESSAGE:
                channel, _sequence, log_time, _published = MESSAGE_HEAD.unpack_from(body)
                if channel not in self._channels or log_time >= TIME_END_NS:
                    raise McapError(f"a message that no channel describes, or beyond time, at byte {place}")
                yield channel, log_time, body[MESSAGE_HEAD.size :], offset

    def _inner(self, stream: BinaryIO, place: int) -> Iterator[tuple[int, int, bytes]]:
        """Offset, opcode and body of every record in the chunk at ``place``, or of the record itself."""
        stream.seek(place)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        if opcode != Opcode.CHUNK:
            if length > MAX_MESSAGE_BYTES:
                raise McapError(f"a message of {length} bytes")
            yield 0, opcode, stream.read(length)
            return
        first, last = CHUNK_TIMES.unpack(stream.read(CHUNK_TIMES.size))
        index = ChunkIndex(length, place, "", 0, last, 0, {}, first, 0)
        records = unpack(stream, index, self._size)
        offset = 0
        while offset < len(records):
            inner, size = RECORD_HEAD.unpack_from(records, offset)
            start = offset + RECORD_HEAD.size
            if start + size > len(records):
                raise McapError("a record ends beyond its chunk")
            yield offset, inner, records[start : start + size]
            offset = start + size

    def _unpack(self, stream: BinaryIO, stretch: Stretch, wanted: set[int]) -> list[Record]:
        return [
            Record(self._known[channel], log_time, data, (stretch.place, offset))
            for channel, log_time, data, offset in self._messages(stream, stretch.place)
            if channel in wanted
        ]


def open_mcap(path: Path) -> Stored:
    """Open an MCAP file; one that is damaged with what can be read of it.

    Raises
    ------
    RecordingError
        The file is not there, or is no MCAP file.
    """
    try:
        return McapContainer(McapFile(path))
    except RecordingError as error:
        if not path.is_file() or not _begins_as_mcap(path):
            raise
        return DamagedMcap(path, error)


def _begins_as_mcap(path: Path) -> bool:
    with reading(path, KIND, "") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def _channel(channel: McapChannel, schemas: dict[int, Schema]) -> Channel:
    schema = schemas.get(channel.schema_id)
    if schema is None:
        return Channel(channel.topic, "", channel.message_encoding, "", "")
    name = schema.name
    if schema.encoding == "ros1msg" and name.count("/") == 1:
        name = name.replace("/", "/msg/")
    definition = schema.data.decode("utf-8", "replace")
    return Channel(channel.topic, name, channel.message_encoding, definition, schema.encoding)
