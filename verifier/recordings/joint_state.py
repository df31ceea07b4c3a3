"""``sensor_msgs/msg/JointState`` in ROS 2 CDR, encoded and decoded.

The layout (OMG DDS-XTypes 1.3, section 7.4.3, plain CDR) after the four bytes that name the encoding, every
value
aligned to its own size counted from there::

    int32 sec, uint32 nanosec, string frame_id, string[] name, float64[] position, float64[] velocity,
    float64[] effort

A string is its length with the closing NUL, then its bytes; a sequence is its length, then its elements.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SCHEMA_NAME = "sensor_msgs/msg/JointState"
SCHEMA_ENCODING = "ros2msg"
SCHEMA = b"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""Message definition as ``common_interfaces`` publishes it, without comments."""

ENCAPSULATION = 4
STAMP_END = 12
NANO = 1_000_000_000
STAMP = {order: struct.Struct(order + "iI") for order in "<>"}
LATEST_STAMP_NS = 2**31 * NANO
"""Stamps end here, in 2038."""
CDR_BIG_ENDIAN = b"\x00\x00"
CDR_LITTLE_ENDIAN = b"\x00\x01"
_ORDERS = {CDR_LITTLE_ENDIAN: "<", CDR_BIG_ENDIAN: ">"}


class CdrError(ValueError):
    """Bytes that are no JointState message."""


def _empty() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class JointState:
    """One message: stamp [ns], and per joint position [rad or m], velocity, effort (each may be empty)."""

    stamp_ns: int
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray = field(default_factory=_empty)
    effort: FloatArray = field(default_factory=_empty)
    frame: str = ""


class Layout(NamedTuple):
    """Where things are in a message.

    Attributes
    ----------
    key:
        Encoding, everything between the stamp and the first position (frame, joint names, number of
        positions), and the length of the whole message: where these agree, so do names and places of the
        positions.
    names:
        Joint names.
    order:
        ``"<"`` or ``">"``: byte order.
    position, velocity, effort:
        Offset of the first value [bytes] and number of values.
    frame:
        Coordinate frame of the header.
    """

    key: tuple[bytes, bytes, int]
    names: tuple[str, ...]
    order: str
    position: tuple[int, int]
    velocity: tuple[int, int]
    effort: tuple[int, int]
    frame: str

    def fits(self, data: bytes) -> bool:
        """Whether names and positions of ``data`` are where this layout says."""
        encoding, head, size = self.key
        return len(data) == size and data[:2] == encoding and data[STAMP_END : STAMP_END + len(head)] == head

    def stamp_ns(self, data: bytes) -> int:
        """Return the header stamp [ns]."""
        seconds, nanoseconds = STAMP[self.order].unpack_from(data, ENCAPSULATION)
        return int(seconds) * NANO + int(nanoseconds)

    def position_bytes(self, data: bytes) -> bytes:
        """Return the positions as they stand in ``data``."""
        offset, count = self.position
        return data[offset : offset + 8 * count]


class _Cursor:
    """Walks through the values of a message; never beyond its end."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order
        self.offset = STAMP_END

    def length(self) -> int:
        self._align(4)
        end = self.offset + 4
        if end > len(self.data):
            raise CdrError(f"the message ends after {len(self.data)} bytes, in the middle of a length")
        (value,) = struct.unpack_from(self.order + "I", self.data, self.offset)
        self.offset = end
        return int(value)

    def text(self) -> str:
        raw = self._take(self.length(), "text")
        try:
            return raw.removesuffix(b"\x00").decode()
        except UnicodeDecodeError as error:
            raise CdrError(f"text is not UTF-8: {raw[:40]!r}") from error

    def texts(self) -> tuple[str, ...]:
        count = self.length()
        if 4 * count > len(self.data) - self.offset:
            raise CdrError(f"{count} names do not fit into {len(self.data)} bytes")
        return tuple(self.text() for _ in range(count))

    def doubles(self) -> tuple[int, int]:
        count = self.length()
        if count == 0:
            return self.offset, 0
        self._align(8)
        start = self.offset
        self._take(8 * count, "numbers")
        return start, count

    def _take(self, size: int, what: str) -> bytes:
        if size > len(self.data) - self.offset:
            raise CdrError(f"the message ends after {len(self.data)} bytes, in the middle of {what}")
        start = self.offset
        self.offset += size
        return self.data[start : self.offset]

    def _align(self, size: int) -> None:
        self.offset += -(self.offset - ENCAPSULATION) % size


def layout(data: bytes) -> Layout:
    """Find out where things are in a message.

    Raises
    ------
    CdrError
        The bytes are no JointState message in plain CDR.
    """
    encoding = data[:2]
    if encoding not in (CDR_LITTLE_ENDIAN, CDR_BIG_ENDIAN) or len(data) < STAMP_END:
        raise CdrError(f"not plain CDR: the message begins with {data[:4].hex(' ')}")
    order = "<" if encoding == CDR_LITTLE_ENDIAN else ">"
    cursor = _Cursor(data, order)
    frame = cursor.text()
    names = cursor.texts()
    position = cursor.doubles()
    head = data[STAMP_END : position[0]]
    velocity = cursor.doubles()
    effort = cursor.doubles()
    return Layout((encoding, head, len(data)), names, order, position, velocity, effort, frame)


def decode(data: bytes) -> JointState:
    """Decode one message.

    Raises
    ------
    CdrError
        The bytes are no JointState message in plain CDR.
    """
    place = layout(data)
    position, velocity, effort = (
        np.frombuffer(data, place.order + "f8", count, offset).astype(np.float64)
        for offset, count in (place.position, place.velocity, place.effort)
    )
    return JointState(place.stamp_ns(data), place.names, position, velocity, effort, place.frame)


def encode(state: JointState) -> bytes:
    """Encode one message in little-endian CDR."""
    seconds, nanoseconds = divmod(state.stamp_ns, NANO)
    out = bytearray(CDR_LITTLE_ENDIAN + b"\x00\x00" + struct.pack("<iI", seconds, nanoseconds))
    _put_text(out, state.frame)
    _put_length(out, len(state.names))
    for name in state.names:
        _put_text(out, name)
    for values in (state.position, state.velocity, state.effort):
        _put_length(out, len(values))
        if len(values):
            out += bytes(-(len(out) - ENCAPSULATION) % 8)
            out += np.asarray(values, "<f8").tobytes()
    return bytes(out)


def stamp_of(data: bytes) -> int:
    """Return the header stamp [ns] of an encoded message; 0: it has none, or is no message."""
    order = _ORDERS.get(data[:2])
    if order is None or len(data) < STAMP_END:
        return 0
    seconds, nanoseconds = STAMP[order].unpack_from(data, ENCAPSULATION)
    return int(seconds) * NANO + int(nanoseconds)


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """Return an encoded message with another header stamp [ns]."""
    stamp = STAMP[_ORDERS[data[:2]]].pack(*divmod(stamp_ns, NANO))
    return data[:ENCAPSULATION] + stamp + data[STAMP_END:]


def _put_length(out: bytearray, length: int) -> None:
    out += bytes(-(len(out) - ENCAPSULATION) % 4)
    out += struct.pack("<I", length)


def _put_text(out: bytearray, text: str) -> None:
    raw = text.encode() + b"\x00"
    _put_length(out, len(raw))
    out += raw
