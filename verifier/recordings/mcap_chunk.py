"""Chunks of MCAP files: unpacked only up to a stated size, and held against what the index says."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import CRCValidationError

MAX_CHUNK_BYTES = 1 << 28
"""Chunks that unpack to more are refused: common writers make chunks of about 1 to 4 MiB."""
RECORD_HEAD = struct.Struct("<BQ")


class ChunkTooLargeError(ValueError):
    """A chunk that says it unpacks to more than is held in memory; ``str()`` says which and how much."""


def unpack(stream: BinaryIO, index: ChunkIndex, file_size: int) -> bytes:
    """Return the records of a chunk.

    Raises
    ------
    ChunkTooLargeError
        It would be larger than ``MAX_CHUNK_BYTES``.
    mcap.exceptions.McapError, and what else the readers underneath raise
        It is damaged, or not what the index says.
    """
    place = index.chunk_start_offset
    stream.seek(place)
    opcode, size = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
    if opcode != Opcode.CHUNK or size > file_size:
        raise McapError(f"no chunk where the index says one is, at byte {place}")
    chunk = Chunk.read(ReadDataStream(stream))
    if (chunk.message_start_time, chunk.message_end_time) != (
        index.message_start_time,
        index.message_end_time,
    ):
        raise McapError(f"chunk at byte {place} covers another time than the index says")
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ChunkTooLargeError(
            f"the chunk at byte {place} unpacks to {chunk.uncompressed_size / 2**20:.0f} MiB, "
            f"more than {MAX_CHUNK_BYTES / 2**20:.0f} MiB"
        )
    data = _inflate(chunk)
    if len(data) != chunk.uncompressed_size:
        raise McapError(f"chunk at byte {place} unpacks to the wrong size")
    found = zlib.crc32(data) if chunk.uncompressed_crc else 0
    if found != chunk.uncompressed_crc:
        raise CRCValidationError(chunk.uncompressed_crc, found, chunk)
    return data


def _inflate(chunk: Chunk) -> bytes:
    """Unpack to at most one byte more than is declared."""
    most = chunk.uncompressed_size + 1
    if chunk.compression == "":
        return bytes(chunk.data)
    if chunk.compression == "zstd":
        return bytes(zstandard.ZstdDecompressor().stream_reader(chunk.data).read(most))
    if chunk.compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most))
    raise McapError(f"compression {chunk.compression[:40]!r} is not known")
