"""MCAP files: what is in them, their messages in log-time order, and writing them.

The index at the end of the file (https://mcap.dev/spec) says which chunks hold which topics; messages are
unpacked chunk by chunk, so the memory needed does not depend on the length of the recording.
"""

from __future__ import annotations

import operator
import struct
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, ChunkIndex, Schema
from mcap.writer import CompressionType, Writer

from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_chunk import RECORD_HEAD, ChunkTooLargeError, unpack
from verifier.recordings.mcap_index import IndexLackingError, read_index

LIBRARY = "stopproof"
MAGIC = b"\x89MCAP0\r\n"
_MEANT = {
    ".toml": "it ends in .toml as files of cells and tools do: --cell takes a cell; name a recording",
    ".json": "it ends in .json as results do, which `stopproof diff` compares; name a recording",
}
"""What files of other endings mostly are."""
_IMPORTED = "`stopproof import` makes one from NPZ and CSV files"
LOG_TIME = operator.attrgetter("log_time")
TIME_END_NS = 2**63
"""Message times from here on (the year 2262) do not fit into the 64 bits that times have inside."""
CHUNK_SIZE = 1 << 20
MESSAGE_HEAD = struct.Struct("<HIQQ")
DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    LookupError,
    RuntimeError,
    EOFError,
    MemoryError,
    OverflowError,
    OSError,
)
"""What the readers underneath raise on damaged files."""


class MessageTimeError(ValueError):
    """A time that no message can have; ``str()`` says which."""


class Message(NamedTuple):
    """One message as it stands in the file; times in ns; ``place`` grows along the file."""

    channel: Channel
    log_time: int
    publish_time: int
    sequence: int
    data: bytes
    place: tuple[int, int] = (0, 0)


class McapFile:
    """A complete MCAP file.

    Parameters
    ----------
    path:
        The file.
    shown:
        What it is called in messages: the recording that it was made from; ``None``: as it is.

    Attributes
    ----------
    path:
        What the file is called.
    channels, schemas:
        By id.
    counts:
        Messages per channel id; channels without messages are absent.
    metadata:
        Names and values of the metadata records.

    Raises
    ------
    RecordingError
        The file is not there, is no MCAP file, ends early or is damaged.
    """

    def __init__(self, path: str | Path, shown: Path | None = None) -> None:
        self._file = Path(path)
        self.path = shown or self._file
        with self._opened() as stream:
            index = read_index(stream, self._size)
        self.channels: dict[int, Channel] = index.channels
        self.schemas: dict[int, Schema] = index.schemas
        self.counts: dict[int, int] = index.counts
        self.metadata: tuple[tuple[str, dict[str, str]], ...] = index.metadata
        self._chunks = index.chunks

    @property
    def _size(self) -> int:
        return self._file.stat().st_size

    @property
    def _mend(self) -> str:
        return f"`mcap recover {self.path.name} -o FIXED.mcap` repairs it"

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        """The file as a stream; whatever damage turns up while it is read becomes a ``RecordingError``."""
        if not self._file.exists():
            raise RecordingError(self.path, "", "does not exist", "name an MCAP file")
        if self._file.is_dir():
            raise RecordingError(self.path, "", "is a folder", "name an MCAP file")
        if not self._file.is_file():
            right = "save it as a file first: its index is at the end"
            raise RecordingError(self.path, "", "is a pipe or device, not a file", right)
        try:
            stream = self._file.open("rb")
        except OSError as error:
            raise RecordingError(self.path, "", f"cannot be read: {error.strerror or error}") from error
        try:
            with stream:
                if stream.read(len(MAGIC)) != MAGIC:
                    right = _MEANT.get(self.path.suffix, _IMPORTED)
                    raise RecordingError(self.path, "", "is not an MCAP file", right)
                stream.seek(0)
                yield stream
        except RecordingError:
            raise
        except IndexLackingError as error:
            raise RecordingError(self.path, "", str(error), self._mend) from error
        except ChunkTooLargeError as error:
            right = f"rewrite it: `mcap compress --chunk-size 4194304 {self.path.name} -o FIXED.mcap`"
            raise RecordingError(self.path, "", str(error), right) from error
        except DAMAGE as error:
            reason = str(error) or type(error).__name__
            raise RecordingError(self.path, "", f"ends early or is damaged ({reason})", self._mend) from error

    def channels_of(self, topics: Collection[str]) -> set[int]:
        """Return the ids of the channels of ``topics``."""
        return {channel.id for channel in self.channels.values() if channel.topic in topics}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (``None``: of all) in log-time order.

        A chunk is unpacked when the messages before it have been taken; messages of chunks that overlap in
        time are merged.

        Raises
        ------
        RecordingError
            The file is damaged.
        """
        wanted = set(self.channels) if topics is None else self.channels_of(topics)
        chunks = [chunk for chunk in self._chunks if _may_hold(chunk, wanted)]
        pending: list[Message] = []
        found: Counter[int] = Counter()
        with self._opened() as stream:
            for number, chunk in enumerate(chunks):
                for message in self._unpack(stream, chunk, wanted):
                    found[message.channel.id] += 1
                    pending.append(message)
                pending.sort(key=LOG_TIME)
                until = chunks[number + 1].message_start_time if number + 1 < len(chunks) else None
                ready = len(pending) if until is None else bisect_left(pending, until, key=LOG_TIME)
                yield from pending[:ready]
                del pending[:ready]
            self._check_found(found, wanted)

    def last(self, topic: str) -> Iterator[Message]:
        """Yield the messages of a topic from the last one backwards.

        Raises
        ------
        RecordingError
            The file is damaged.
        """
        wanted = self.channels_of([topic])
        chunks = [chunk for chunk in self._chunks if _may_hold(chunk, wanted)]
        chunks.sort(key=operator.attrgetter("message_end_time"), reverse=True)
        pending: list[Message] = []
        with self._opened() as stream:
            for number, chunk in enumerate(chunks):
                pending.extend(self._unpack(stream, chunk, wanted))
                pending.sort(key=LOG_TIME)
                before = chunks[number + 1].message_end_time if number + 1 < len(chunks) else None
                kept = 0 if before is None else bisect_right(pending, before, key=LOG_TIME)
                yield from reversed(pending[kept:])
                del pending[kept:]

    def attachments(self) -> Iterator[Attachment]:
        """Yield what is attached to the recording, one at a time."""
        with self._opened() as stream:
            yield from SeekingReader(stream, record_size_limit=self._size).iter_attachments()

    def _check_found(self, found: Mapping[int, int], wanted: Collection[int]) -> None:
        """Whoever leaves out a chunk leaves out people."""
        for channel in wanted:
            if found.get(channel, 0) != self.counts.get(channel, 0):
                raise McapError(
                    f"{found.get(channel, 0)} messages on {self.channels[channel].topic}, "
                    f"its index says {self.counts.get(channel, 0)}"
                )

    def _unpack(self, stream: BinaryIO, index: ChunkIndex, wanted: Collection[int]) -> Iterator[Message]:
        data = unpack(stream, index, self._size)
        for message in self._records(index.chunk_start_offset, data, wanted):
            if not index.message_start_time <= message.log_time <= index.message_end_time:
                raise McapError(f"chunk at byte {index.chunk_start_offset} holds a message of another time")
            if message.log_time >= TIME_END_NS:
                raise RecordingError(
                    self.path,
                    message.channel.topic,
                    f"a message time is {message.log_time} ns, beyond the year 2262",
                    "message times are nanoseconds, as a rule since 1970",
                )
            yield message

    def _records(self, chunk: int, data: bytes, wanted: Collection[int]) -> Iterator[Message]:
        offset, end = 0, len(data)
        while offset < end:
            opcode, length = RECORD_HEAD.unpack_from(data, offset)
            start = offset + RECORD_HEAD.size
            offset = start + length
            if offset > end:
                raise McapError("a record ends beyond its chunk")
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(data, start)
                if channel not in self.channels:
                    raise McapError(f"a message of channel {channel}, which the index does not list")
                if channel in wanted:
                    body = data[start + MESSAGE_HEAD.size : offset]
                    place = chunk, start
                    yield Message(self.channels[channel], log_time, publish_time, sequence, body, place)


def _may_hold(chunk: ChunkIndex, wanted: Collection[int]) -> bool:
    """Without message indexes it is not known which channels a chunk holds."""
    held = chunk.message_index_offsets
    return not held or any(channel in wanted for channel in held)


class McapWriter:
    """Writes an MCAP file (chunked, zstd) to a stream; the same calls give the same bytes."""

    def __init__(self, stream: BinaryIO) -> None:
        self._writer = Writer(stream, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=LIBRARY)
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[str, int, str, tuple[tuple[str, str], ...]], int] = {}
        self._sequence: dict[int, int] = {}

    def channel(
        self, topic: str, schema: Schema | None, encoding: str, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Return the channel of ``topic``, announced when it is new."""
        schema_id = 0 if schema is None else self._schema(schema.name, schema.encoding, schema.data)
        key = (topic, schema_id, encoding, tuple(sorted((metadata or {}).items())))
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(topic, encoding, schema_id, dict(key[3]))
        return self._channels[key]

    def _schema(self, name: str, encoding: str, data: bytes) -> int:
        key = (name, encoding, data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(name, encoding, data)
        return self._schemas[key]

    def write(self, channel: int, log_time: int, data: bytes, publish_time: int | None = None) -> None:
        """Write one message; times in ns.

        Raises
        ------
        MessageTimeError
            A message cannot have this time.
        """
        if not 0 <= log_time < TIME_END_NS:
            raise MessageTimeError(f"a message would get the time {log_time / 1e9:.6f} s")
        sequence = self._sequence.get(channel, 0)
        self._sequence[channel] = sequence + 1
        published = log_time if publish_time is None else publish_time
        self._writer.add_message(channel, log_time, data, published, sequence)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def attach(self, a: Attachment) -> None:
        """Attach a file."""
        self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)

    def finish(self) -> None:
        """Write what is left, then the index."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves this one without types
