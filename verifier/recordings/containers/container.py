"""What all containers of messages have in common: topics, messages in order of time, damage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

from verifier.recordings.decoded import Decoded
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_file import DAMAGE
from verifier.recordings.topic import Topic

NANO = 1_000_000_000
TIME_END_NS = 2**63
MAX_MESSAGE_BYTES = 1 << 28
"""Chunks and messages that say they are larger are refused, before memory is taken for them."""
MAX_WAITING_BYTES = 1 << 30
"""Messages of parts that overlap in time wait in memory for their turn; no more than this."""


@dataclass(frozen=True, slots=True)
class Channel:
    """Who wrote a message, and how it is to be read.

    Attributes
    ----------
    topic, schema:
        Name, and type in the spelling of ROS 2.
    encoding:
        Of the messages: ``cdr`` (ROS 2), ``ros1``, ``json`` …
    definition, definition_encoding:
        Message definition as it stands in the file, ``""`` if there is none; ``ros2msg``, ``ros2idl``,
        ``ros1msg``, ``jsonschema`` …
    """

    topic: str
    schema: str
    encoding: str
    definition: str
    definition_encoding: str


class Record(NamedTuple):
    """One message as it stands in the file; ``place`` grows along the file."""

    channel: Channel
    log_time_ns: int
    data: bytes
    place: tuple[int, ...]


class Container(Protocol):
    """A file, or a folder of files, with messages.

    Attributes
    ----------
    path:
        The file or folder.
    topics:
        What there is, in order of name, with the numbers of messages.
    channels:
        Every kind of message in it.
    damage:
        What could not be read, what can, and how to repair it; ``None``: the container is complete.
    """

    path: Path
    topics: tuple[Topic, ...]
    channels: tuple[Channel, ...]
    damage: str | None

    def messages(self, topics: Collection[str]) -> Iterator[Decoded]:
        """Yield the messages of ``topics``, decoded, in order of log time.

        Raises
        ------
        RecordingError
            A message cannot be decoded, or the container turns out to be damaged.
        """

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` (``None``: of all) as they stand there, in order of log time.

        Raises
        ------
        RecordingError
            The container turns out to be damaged.
        """

    def decode(self, record: Record) -> Decoded:
        """Decode one message.

        Raises
        ------
        RecordingError
            Its definition is missing or not readable, or the message does not follow it.
        """


class Stretch(NamedTuple):
    """A part of a file that holds messages: where, their first and last time [ns], and their numbers."""

    place: int
    first_ns: int
    last_ns: int
    counts: dict[int, int]


def in_order(stretches: Sequence[Stretch], unpack: Callable[[Stretch], Iterable[Record]]) -> Iterator[Record]:
    """Yield the records of stretches in order of log time; those of one time in the order of the file.

    A stretch is unpacked when the records before it have been taken.

    Raises
    ------
    ValueError
        Stretches overlap so much that what waits for its turn does not fit into memory.
    """
    ordered = sorted(stretches, key=lambda stretch: (stretch.first_ns, stretch.place))
    waiting: list[Record] = []
    for number, stretch in enumerate(ordered):
        waiting += unpack(stretch)
        if sum(len(record.data) for record in waiting) > MAX_WAITING_BYTES:
            raise ValueError("its parts overlap in time so much that they do not fit into memory")
        waiting.sort(key=lambda record: (record.log_time_ns, record.place))
        until = ordered[number + 1].first_ns if number + 1 < len(ordered) else TIME_END_NS
        ready = next((n for n, record in enumerate(waiting) if record.log_time_ns >= until), len(waiting))
        yield from waiting[:ready]
        del waiting[:ready]


def topics_of(channels: Iterable[tuple[Channel, int]]) -> tuple[Topic, ...]:
    """Return topics in order of name; channels of one topic and type become one entry."""
    found: Counter[tuple[str, str, str]] = Counter()
    for channel, count in channels:
        found[channel.topic, channel.schema, channel.encoding] += count
    return tuple(Topic(*key, found[key]) for key in sorted(found))


def readable_text(counts: Iterable[int], first_ns: int | None, last_ns: int | None) -> str:
    """Say what of a damaged file can be read."""
    number = sum(counts)
    if not number or first_ns is None or last_ns is None:
        return "nothing of it can be read"
    return f"{number} messages of its first {(last_ns - first_ns) / NANO:.3f} s can be read"


@contextmanager
def reading(path: Path, kind: str, repair: str) -> Iterator[BinaryIO]:
    """The file as a stream; whatever damage turns up while it is read becomes a ``RecordingError``."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise RecordingError(path, "", f"cannot be read: {error.strerror or error}") from error
    with stream, damage_as_refusal(path, kind, repair):
        yield stream


@contextmanager
def damage_as_refusal(path: Path, kind: str, repair: str) -> Iterator[None]:
    """Turn whatever damage turns up in the block into a ``RecordingError``."""
    try:
        yield
    except RecordingError:
        raise
    except DAMAGE as error:
        reason = str(error) or type(error).__name__
        raise RecordingError(path, "", f"{kind} is damaged ({reason})", repair) from error
