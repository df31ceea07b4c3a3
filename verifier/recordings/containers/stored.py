"""What the readers of containers share: decoding what they read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path

from verifier.recordings.containers.container import Channel, Record
from verifier.recordings.containers.message_types import MessageError, MessageTypes
from verifier.recordings.decoded import Decoded
from verifier.recordings.errors import RecordingError
from verifier.recordings.topic import Topic


class Stored(ABC):
    """A container whose records a subclass reads; see :class:`.container.Container`."""

    topics: tuple[Topic, ...] = ()
    channels: tuple[Channel, ...] = ()
    damage: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self._types = MessageTypes()

    @abstractmethod
    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` (``None``: of all) in order of log time."""

    def messages(self, topics: Collection[str]) -> Iterator[Decoded]:
        """Yield the messages of ``topics``, decoded, in order of log time."""
        return map(self.decode, self.records(topics))

    def decode(self, record: Record) -> Decoded:
        """Decode one message."""
        channel = record.channel
        try:
            value = self._types.decode(channel, record.data)
        except MessageError as error:
            place = f"{channel.topic}, message at {record.log_time_ns} ns"
            raise RecordingError(self.path, place, f"{channel.schema or 'a message'}: {error}") from error
        return Decoded(channel.topic, channel.schema, record.log_time_ns, value)
