"""ROS 1 bags (``.bag``, version 2.0): chunk after chunk, so that memory does not grow with the recording.

A bag without an index, or with a damaged one, is read from its beginning as far as it goes.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from verifier.recordings.containers.container import (
    Channel,
    Record,
    Stretch,
    in_order,
    readable_text,
    reading,
    topics_of,
)
from verifier.recordings.containers.ros1_records import (
    BAG,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    COUNT,
    INDEX,
    MAGIC,
    MESSAGE,
    BagError,
    Ended,
    Head,
    fields,
    read_data,
    read_head,
    records,
    unpacked,
)
from verifier.recordings.containers.stored import Stored
from verifier.recordings.errors import RecordingError

KIND = "the ROS 1 bag"


@dataclass(slots=True)
class _Contents:
    """What a bag holds: who wrote what, by connection, and where."""

    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[Stretch] = field(default_factory=list)
    damage: str | None = None

    @property
    def counts(self) -> Counter[int]:
        total: Counter[int] = Counter()
        for chunk in self.chunks:
            total.update(chunk.counts)
        return total

    def connect(self, head: Head, data: bytes) -> None:
        """Note a connection; the same one may stand in the file several times."""
        topic, about = head.fields.get(b"topic", b""), fields(data)
        name = _ros2_name(_text(about.get(b"type", b"")))
        definition = _text(about.get(b"message_definition", b""))
        channel = Channel(_text(topic), name, "ros1", definition, "ros1msg")
        number = head.number(b"conn")
        if self.channels.setdefault(number, channel) != channel:
            raise BagError(f"connection {number} stands there twice, with different topics or types")


class Ros1Bag(Stored):
    """A ROS 1 bag; see :class:`verifier.recordings.containers.container.Container`.

    Raises
    ------
    RecordingError
        The file is not there, or is no ROS 1 bag of version 2.0.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._repair = f"`rosbag reindex {path.name}` repairs it"
        with reading(path, KIND, self._repair) as stream:
            contents = _contents(stream, path)
        self._connections = contents.channels
        self._chunks = contents.chunks
        self.damage = None
        if contents.damage is not None:
            times = [chunk for chunk in self._chunks if chunk.counts]
            first = min((chunk.first_ns for chunk in times), default=None)
            last = max((chunk.last_ns for chunk in times), default=None)
            text = readable_text(contents.counts.values(), first, last)
            self.damage = f"{contents.damage}: {text}; {self._repair}"
        counts = contents.counts
        self.channels = tuple(dict.fromkeys(contents.channels.values()))
        self.topics = topics_of((channel, counts[n]) for n, channel in contents.channels.items())

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` in order of log time."""
        wanted = {n for n, c in self._connections.items() if topics is None or c.topic in topics}
        stretches = [chunk for chunk in self._chunks if wanted & chunk.counts.keys()]
        with reading(self.path, KIND, self._repair) as stream:
            yield from in_order(stretches, lambda chunk: self._unpack(stream, chunk, wanted))

    def _unpack(self, stream: BinaryIO, chunk: Stretch, wanted: set[int]) -> list[Record]:
        """Return the wanted messages of a chunk, which must be those that the index promises."""
        stream.seek(chunk.place)
        head = read_head(stream)
        if head.kind != CHUNK:
            raise BagError(f"no chunk where the index says one is, at byte {chunk.place}")
        found: Counter[int] = Counter()
        taken = []
        for offset, number, time_ns, data in _messages(unpacked(head, read_data(stream, head))):
            found[number] += 1
            if not chunk.first_ns <= time_ns <= chunk.last_ns:
                raise BagError(f"the chunk at byte {chunk.place} holds a message of another time")
            if number in wanted:
                taken.append(Record(self._connections[number], time_ns, data, (chunk.place, offset)))
        if dict(found) != chunk.counts:
            raise BagError(
                f"the chunk at byte {chunk.place} holds {found.total()} messages, not "
                f"{sum(chunk.counts.values())}"
            )
        return taken


def _contents(stream: BinaryIO, path: Path) -> _Contents:
    if stream.read(len(MAGIC)) != MAGIC:
        right = "`rosbag fix` brings bags of ROS before 2010 to version 2.0"
        raise RecordingError(path, "", "is not a ROS 1 bag of version 2.0", right)
    start = stream.tell()
    try:
        head = read_head(stream)
        if head.kind != BAG:
            raise BagError("it does not begin with the header of a bag")
        if head.fields.get(b"encryptor"):
            raise RecordingError(path, "", "is encrypted", "decrypt it with the tools of ROS 1")
        index, connections, chunks = (
            head.number(name) for name in (b"index_pos", b"conn_count", b"chunk_count")
        )
        if not index:
            raise BagError("it has no index: the recording was not ended")
        stream.seek(index)
        return _indexed(stream, connections, chunks)
    except BagError as error:
        stream.seek(start)
        return _scanned(stream, str(error))


def _indexed(stream: BinaryIO, connections: int, chunks: int) -> _Contents:
    """Read the index: connections, then chunks with what they hold, up to the end of the file."""
    contents = _Contents()
    end = stream.seek(0, os.SEEK_CUR)
    size = os.fstat(stream.fileno()).st_size
    if end > size:
        raise BagError("it ends early")
    while stream.tell() < size:
        head = read_head(stream)
        data = read_data(stream, head)
        if head.kind == CONNECTION:
            contents.connect(head, data)
        elif head.kind == CHUNK_INFO:
            contents.chunks.append(_chunk_info(head, data))
        else:
            raise BagError("its index holds what belongs elsewhere")
    if (len(contents.channels), len(contents.chunks)) != (connections, chunks):
        raise BagError(
            f"its index lists {len(contents.channels)} connections and {len(contents.chunks)} chunks, "
            f"not {connections} and {chunks}"
        )
    unknown = set(contents.counts) - contents.channels.keys()
    if unknown:
        raise BagError(f"its index does not list connection {min(unknown)}")
    return contents


def _chunk_info(head: Head, data: bytes) -> Stretch:
    if head.number(b"ver") != 1 or len(data) != COUNT.size * head.number(b"count"):
        raise BagError("an entry of its index is none")
    counts = dict(COUNT.iter_unpack(data))
    counts = {number: count for number, count in counts.items() if count}
    return Stretch(head.number(b"chunk_pos"), head.time_ns(b"start_time"), head.time_ns(b"end_time"), counts)


def _scanned(stream: BinaryIO, why: str) -> _Contents:
    """Read what is there without an index, up to the first record that cannot be read."""
    contents = _Contents(damage=why)
    while True:
        place = stream.tell()
        try:
            head = read_head(stream)
            data = read_data(stream, head)
            if head.kind == CHUNK:
                contents.chunks.append(_looked_at(contents, place, unpacked(head, data)))
            elif head.kind == CONNECTION:
                contents.connect(head, data)
            elif head.kind not in (BAG, INDEX, CHUNK_INFO):
                raise BagError(f"a record of unknown kind {head.kind}")
        except Ended:
            return contents
        except BagError as error:
            contents.damage = f"{why}; from byte {place} on: {error}"
            return contents


def _looked_at(contents: _Contents, place: int, chunk: bytes) -> Stretch:
    """Return what a chunk holds that no index describes, and note its connections."""
    counts: Counter[int] = Counter()
    times: list[int] = []
    for _offset, head, data in records(chunk):
        if head.kind == CONNECTION:
            contents.connect(head, data)
    for _offset, number, time_ns, _data in _messages(chunk):
        if number not in contents.channels:
            raise BagError(f"a message of connection {number}, which is not described")
        counts[number] += 1
        times.append(time_ns)
    return Stretch(place, min(times, default=0), max(times, default=0), dict(counts))


def _messages(chunk: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Offset, connection, time [ns] and bytes of every message of a chunk."""
    for offset, head, data in records(chunk):
        if head.kind == MESSAGE:
            yield offset, head.number(b"conn"), head.time_ns(b"time"), data
        elif head.kind != CONNECTION:
            raise BagError("a chunk holds what belongs elsewhere")


def _text(raw: bytes) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise BagError(f"text is not UTF-8: {raw[:40]!r}") from error


def _ros2_name(name: str) -> str:
    package, slash, message = name.partition("/")
    return f"{package}/msg/{message}" if slash and "/" not in message else name
