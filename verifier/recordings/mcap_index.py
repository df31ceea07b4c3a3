"""The index at the end of an MCAP file, held against its own checksum and counts (https://mcap.dev/spec)."""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import dataclass
from operator import attrgetter
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Schema, Statistics

FOOTER = struct.Struct("<BQQQI8s")
"""Opcode, length, where the index and its table of contents begin, checksum, magic."""
FOOTER_LENGTH = 20
CHECKSUM_END = 12
BLOCK = 1 << 20


class IndexLackingError(ValueError):
    """The file is not damaged, but its index does not say enough; ``str()`` says what is missing."""


@dataclass(frozen=True, slots=True)
class Index:
    """What a file says it holds.

    Attributes
    ----------
    channels, schemas:
        By id.
    counts:
        Messages per channel id; channels without messages are absent.
    chunks:
        In order of their first message's time.
    metadata:
        Names and values of the metadata records.
    """

    channels: dict[int, Channel]
    schemas: dict[int, Schema]
    counts: dict[int, int]
    chunks: tuple[ChunkIndex, ...]
    metadata: tuple[tuple[str, dict[str, str]], ...]


def read_index(stream: BinaryIO, size: int) -> Index:
    """Read the index of a file of ``size`` bytes.

    Raises
    ------
    IndexLackingError
        There is no index, or it does not name the chunks, channels or numbers of messages.
    mcap.exceptions.McapError, and what else the reader underneath raises
        The file is damaged.
    """
    if size < FOOTER.size:
        raise McapError(f"{size} bytes hold no footer")
    _check_sum(stream)
    stream.seek(0)
    reader = SeekingReader(stream, record_size_limit=size)
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise IndexLackingError("has no index")
    chunks, statistics = summary.chunk_indexes, summary.statistics
    counts = {channel: n for channel, n in statistics.channel_message_counts.items() if n}
    if not chunks and statistics.message_count:
        raise IndexLackingError("is not divided into chunks")
    _check_counts(statistics, counts, len(chunks))
    named = {channel: summary.channels.get(channel) for channel in counts}
    if not all(
        channel is not None and (channel.schema_id == 0 or channel.schema_id in summary.schemas)
        for channel in named.values()
    ):
        raise IndexLackingError("has an index that does not say which topics and schemas there are")
    metadata = tuple((record.name, record.metadata) for record in reader.iter_metadata())
    ordered = tuple(sorted(chunks, key=attrgetter("message_start_time")))
    return Index(summary.channels, summary.schemas, counts, ordered, metadata)


def _check_sum(stream: BinaryIO) -> None:
    """Without this a flipped bit in the index would silently take chunks out of what is read."""
    end = stream.seek(-FOOTER.size, os.SEEK_END)
    opcode, length, start, _contents, expected, _magic = FOOTER.unpack(stream.read(FOOTER.size))
    if opcode != Opcode.FOOTER or length != FOOTER_LENGTH:
        raise McapError("no footer at its end")
    if not expected or not start:
        return
    left = end + FOOTER.size - CHECKSUM_END - start
    stream.seek(start)
    found = 0
    while left > 0:
        block = stream.read(min(left, BLOCK))
        if not block:
            break
        left -= len(block)
        found = zlib.crc32(block, found)
    if left or found != expected:
        raise McapError(f"checksum of the index is {found:08x}, not {expected:08x}")


def _check_counts(statistics: Statistics, counts: dict[int, int], chunks: int) -> None:
    if statistics.message_count and not counts:
        raise IndexLackingError("has an index without the numbers of messages")
    if statistics.message_count != sum(counts.values()):
        raise McapError(
            f"{statistics.message_count} messages, but {sum(counts.values())} on all channels together"
        )
    if statistics.chunk_count != chunks:
        raise McapError(f"{statistics.chunk_count} chunks, of which the index lists {chunks}")
