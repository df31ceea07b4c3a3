"""Messages that wait on disk until the file is written that they go into; they need no memory."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, NamedTuple

import zstandard

from verifier.recordings.errors import RecordingError

_HEAD = struct.Struct("<qHI")


class AddedTopic(NamedTuple):
    """A topic that is added to a copy: name, its schema, and how its messages are encoded."""

    name: str
    schema: str
    schema_encoding: str
    schema_data: bytes
    encoding: str


class Added(NamedTuple):
    """A message of an added topic."""

    topic: AddedTopic
    data: bytes


class Spool:
    """Takes messages, and gives them back in the same order.

    ``beside``: the file that is to be written, which errors name.
    """

    def __init__(self, stream: IO[bytes], beside: Path) -> None:
        self._stream = stream
        self.beside = beside
        self._topics: list[AddedTopic] = []
        self._packer = zstandard.ZstdCompressor(level=1)

    def add(self, time_ns: int, topic: AddedTopic, data: bytes) -> None:
        """Keep a message.

        Raises
        ------
        RecordingError
            There is no room.
        """
        if topic not in self._topics:
            self._topics.append(topic)
        packed = self._packer.compress(data)
        with _refusing(self.beside):
            self._stream.write(_HEAD.pack(time_ns, self._topics.index(topic), len(packed)) + packed)

    def messages(self) -> Iterator[tuple[int, Added]]:
        """Yield time [ns] and message, as they were added.

        Raises
        ------
        RecordingError
            There was no room.
        """
        unpacker = zstandard.ZstdDecompressor()
        with _refusing(self.beside):
            self._stream.seek(0)
        while head := self._stream.read(_HEAD.size):
            time_ns, topic, length = _HEAD.unpack(head)
            yield time_ns, Added(self._topics[topic], unpacker.decompress(self._stream.read(length)))


@contextmanager
def new_spool(beside: str | Path) -> Iterator[Spool]:
    """Open a spool in the folder of a file that is to be written; nothing of it is left behind.

    Raises
    ------
    RecordingError
        There is no room for it.
    """
    path = Path(beside)
    with _refusing(path):
        stream = TemporaryFile(dir=path.absolute().parent)  # noqa: SIM115 - closed below
    with stream:
        yield Spool(stream, path)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(path, "", f"cannot be written: {error.strerror or error}") from error
