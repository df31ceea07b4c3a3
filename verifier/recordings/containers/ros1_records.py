"""Records of ROS 1 bags, version 2.0 (https://wiki.ros.org/Bags/Format/2.0), read within stated sizes."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator, Mapping
from typing import BinaryIO, NamedTuple

import lz4.frame

from verifier.recordings.containers.container import MAX_MESSAGE_BYTES, NANO

MAGIC = b"#ROSBAG V2.0\n"
LENGTH = struct.Struct("<I")
POSITION = struct.Struct("<Q")
TIME = struct.Struct("<II")
COUNT = struct.Struct("<II")
MAX_HEADER_BYTES = 1 << 20
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7


class BagError(ValueError):
    """Bytes that are no record; ``str()`` says what is wrong."""


class Ended(BagError):  # noqa: N818 - not every end is an error
    """The file ends, at a record's border or within one."""


class Head(NamedTuple):
    """Header of a record: its fields, and how many bytes of data follow it."""

    fields: Mapping[bytes, bytes]
    size: int

    @property
    def kind(self) -> int:
        """Which kind of record it is."""
        value = self.fields.get(b"op", b"")
        if len(value) != 1:
            raise BagError("a record does not say of which kind it is")
        return value[0]

    def number(self, name: bytes) -> int:
        """Return a field of 4 or 8 bytes."""
        value = self.fields.get(name, b"")
        if len(value) not in (LENGTH.size, POSITION.size):
            raise BagError(f"a record has no field {name.decode()!r}")
        return int.from_bytes(value, "little")

    def time_ns(self, name: bytes) -> int:
        """Return a field that is a time [ns]."""
        value = self.fields.get(name, b"")
        if len(value) != TIME.size:
            raise BagError(f"a record has no time {name.decode()!r}")
        seconds, nanoseconds = TIME.unpack(value)
        return int(seconds) * NANO + int(nanoseconds)


def read_head(stream: BinaryIO) -> Head:
    """Read the header of the record that begins here.

    Raises
    ------
    Ended
        The file ends.
    BagError
        There is no header of a record here.
    """
    header = _take(stream, _length(stream), MAX_HEADER_BYTES)
    return Head(fields(header), _length(stream))


def read_data(stream: BinaryIO, head: Head) -> bytes:
    """Read the data of the record whose header was read last.

    Raises
    ------
    BagError
        The file ends before, or the record says that it is larger than anything that is read.
    """
    return _take(stream, head.size, MAX_MESSAGE_BYTES)


def fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header.

    Raises
    ------
    BagError
        The bytes are no header.
    """
    found: dict[bytes, bytes] = {}
    offset = 0
    while offset < len(header):
        if offset + LENGTH.size > len(header):
            raise BagError("a header ends within a field")
        (size,) = LENGTH.unpack_from(header, offset)
        offset += LENGTH.size
        name, sign, value = header[offset : offset + size].partition(b"=")
        offset += size
        if offset > len(header) or not sign:
            raise BagError("a field of a header is none")
        found[name] = value
    return found


def unpacked(head: Head, data: bytes) -> bytes:
    """Return the records of a chunk.

    Raises
    ------
    BagError
        It says that it is larger than anything that is read, is damaged, or is packed in an unknown way.
    """
    size = head.number(b"size")
    if size > MAX_MESSAGE_BYTES:
        raise BagError(
            f"a chunk unpacks to {size / 2**20:.0f} MiB, more than {MAX_MESSAGE_BYTES / 2**20:.0f}"
        )
    packing = head.fields.get(b"compression", b"")
    try:
        records = _inflate(packing, data, size + 1)
    except (OSError, RuntimeError, EOFError) as error:
        raise BagError(f"a chunk cannot be unpacked ({error})") from error
    if len(records) != size:
        raise BagError("a chunk unpacks to another size than it says")
    return records


def _inflate(packing: bytes, data: bytes, most: int) -> bytes:
    if packing == b"none":
        return data
    if packing == b"bz2":
        return bz2.BZ2Decompressor().decompress(data, most)
    if packing == b"lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
    raise BagError(f"compression {packing[:40]!r} is not known")


def records(chunk: bytes) -> Iterator[tuple[int, Head, bytes]]:
    """Yield offset, header and data of every record in an unpacked chunk.

    Raises
    ------
    BagError
        The bytes are no records.
    """
    offset, end = 0, len(chunk)
    while offset < end:
        place = offset
        header, offset = _part(chunk, offset)
        data, offset = _part(chunk, offset)
        yield place, Head(fields(header), len(data)), data


def _part(chunk: bytes, offset: int) -> tuple[bytes, int]:
    start = offset + LENGTH.size
    if start > len(chunk):
        raise BagError("a chunk ends within a record")
    (size,) = LENGTH.unpack_from(chunk, offset)
    if start + size > len(chunk):
        raise BagError("a record ends beyond its chunk")
    return chunk[start : start + size], start + size


def _length(stream: BinaryIO) -> int:
    raw = stream.read(LENGTH.size)
    if len(raw) < LENGTH.size:
        raise Ended("it ends early")
    return int(LENGTH.unpack(raw)[0])


def _take(stream: BinaryIO, size: int, most: int) -> bytes:
    if size > most:
        raise BagError(f"a record says that it has {size} bytes, more than {most}")
    data = stream.read(size)
    if len(data) < size:
        raise Ended("it ends early")
    return data
