"""Making bytes, text and messages wrong, as broken disks, editors, drivers and other versions do."""

from __future__ import annotations

import dataclasses
import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import Any, NamedTuple

import numpy as np

NUMBERS = (
    math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1.0, -1.0, 1e6, 2.0**63, -(2.0**31),
)  # fmt: skip
WORDS = (
    b"nan", b"NaN", b"inf", b"-inf", b"Infinity", b"1e308", b"1e999", b"-0", b"-0.0", b"", b"0", b"1e-320",
    b"0x10", b"9" * 400, b"1_000", b"\xd9\xa1", b"--1", b"1,5", b"null", b"true", b'"x"', b"\x00", b"[]",
    b"{}",
)  # fmt: skip
"""What stands in place of a number in a text."""
TEXTS = ("", "x" * 3000, "\x00", "\n", "\ud800", "a/b:c", "é\u202e", "nan", "../..", "body_", "{", "0")
TOKEN = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
FIELD = re.compile(rb"[^,;\s:\"{}\[\]=]+")
MOST_BYTES = 64


def some_bytes(rnd: Random, most: int = MOST_BYTES) -> bytes:
    """Return up to ``most`` random bytes."""
    return rnd.randbytes(rnd.randint(0, most))


def broken_bytes(data: bytes, rnd: Random) -> bytes:
    """Return bytes with one to four things wrong."""
    for _ in range(rnd.choice((1, 1, 2, 4))):
        data = rnd.choice(BYTES)(data, rnd)
    return data


def broken_text(data: bytes, rnd: Random) -> bytes:
    """Return text with one to four things wrong, as bytes."""
    for _ in range(rnd.choice((1, 1, 2, 4))):
        data = rnd.choice(TEXT if rnd.random() < 0.8 else BYTES)(data, rnd)
    return data


def invented(data: bytes, rnd: Random) -> bytes:
    """Return something that begins like ``data`` and goes on with parts of it, or at random."""
    head = data[: rnd.choice((0, 4, 8, 16, 64))]
    if rnd.random() < 0.5:
        return head + some_bytes(rnd, 512)
    words = FIELD.findall(data[:4000]) or [b"x"]
    joints = (b",", b"\n", b" ", b":", b'"', b"[", b"]", b"{", b"}", b"=", b"\t", b";")
    parts = (
        rnd.choice((rnd.choice(words), rnd.choice(joints), rnd.choice(WORDS)))
        for _ in range(rnd.randint(1, 80))
    )
    return head + b"".join(parts)


def _place(data: bytes, rnd: Random) -> int:
    return rnd.randint(0, max(0, len(data) - 1))


def _flip(data: bytes, rnd: Random) -> bytes:
    found = bytearray(data)
    for _ in range(rnd.choice((1, 1, 1, 3, 20)) if found else 0):
        found[_place(data, rnd)] ^= 1 << rnd.randint(0, 7)
    return bytes(found)


def _cut(data: bytes, rnd: Random) -> bytes:
    return data[: _place(data, rnd)]


def _left_out(data: bytes, rnd: Random) -> bytes:
    at = _place(data, rnd)
    return data[:at] + data[at + rnd.randint(1, MOST_BYTES) :]


def _put_in(data: bytes, rnd: Random) -> bytes:
    at = _place(data, rnd)
    return data[:at] + some_bytes(rnd) + data[at:]


def _twice(data: bytes, rnd: Random) -> bytes:
    at, again = _place(data, rnd), _place(data, rnd)
    return data[:again] + data[at : at + rnd.randint(1, 4 * MOST_BYTES)] + data[again:]


def _exchanged(data: bytes, rnd: Random) -> bytes:
    a, b = sorted((_place(data, rnd), _place(data, rnd)))
    n = rnd.randint(1, MOST_BYTES)
    if a + n > b or b + n > len(data):
        return data[b:] + data[:b]
    return data[:a] + data[b : b + n] + data[a + n : b] + data[a : a + n] + data[b + n :]


def _double(data: bytes, rnd: Random) -> bytes:
    """A number of a message, aligned as CDR has it or not."""
    at = _place(data, rnd) // 4 * 4 if rnd.random() < 0.8 else _place(data, rnd)
    number = struct.pack("<d", rnd.choice(NUMBERS))
    return data[:at] + number + data[at + 8 :]


def _length(data: bytes, rnd: Random) -> bytes:
    """A length, a count or an offset."""
    at = _place(data, rnd) // 4 * 4 if rnd.random() < 0.8 else _place(data, rnd)
    number = rnd.choice(
        (0, 1, 2**31 - 1, 2**31, 2**32 - 1, len(data), rnd.getrandbits(32), rnd.randint(0, 300))
    )
    return data[:at] + struct.pack("<I", number) + data[at + 4 :]


def _zeroed(data: bytes, rnd: Random) -> bytes:
    at, n = _place(data, rnd), rnd.randint(1, MOST_BYTES)
    return data[:at] + bytes(min(n, len(data) - at)) + data[at + n :]


BYTES: Sequence[Callable[[bytes, Random], bytes]] = (
    _flip, _flip, _cut, _left_out, _put_in, _twice, _exchanged, _double, _double, _length, _length, _zeroed,
)  # fmt: skip


def _another_number(data: bytes, rnd: Random) -> bytes:
    found = list(TOKEN.finditer(data))
    if not found:
        return data
    where = rnd.choice(found)
    return data[: where.start()] + rnd.choice(WORDS) + data[where.end() :]


def _fields_exchanged(data: bytes, rnd: Random) -> bytes:
    found = list(FIELD.finditer(data))
    if len(found) < 2:
        return data
    a, b = sorted(rnd.sample(found, 2), key=lambda each: each.start())
    return data[: a.start()] + b[0] + data[a.end() : b.start()] + a[0] + data[b.end() :]


def _lines(data: bytes, rnd: Random) -> bytes:
    lines = data.split(b"\n")
    at = rnd.randrange(len(lines))
    kind = rnd.randint(0, 3)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(rnd.randrange(len(lines)), lines[at])
    elif kind == 2:
        other = rnd.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines[at] = lines[at][: _place(lines[at], rnd)]
    return b"\n".join(lines)


def _separators(data: bytes, rnd: Random) -> bytes:
    old, new = rnd.sample((b",", b";", b" ", b"\t", b"\n", b"\r\n", b'"', b":"), 2)
    return data.replace(old, new, rnd.choice((1, 2, -1)))


TEXT: Sequence[Callable[[bytes, Random], bytes]] = (
    _another_number, _another_number, _another_number, _fields_exchanged, _lines, _separators,
)  # fmt: skip


class Leaf(NamedTuple):
    """A value in a message: what holds it, and under which name or number."""

    holder: Any
    key: Any

    @property
    def value(self) -> Any:
        """The value."""
        return getattr(self.holder, self.key) if isinstance(self.key, _Name) else self.holder[self.key]

    def put(self, value: Any) -> None:
        """Put another value there."""
        if isinstance(self.key, _Name):
            setattr(self.holder, self.key, value)
        else:
            self.holder[self.key] = value


class _Name(str):
    """Name of an attribute."""


def leaves(holder: Any) -> Iterator[Leaf]:
    """Yield every value of a message, those that hold others too."""
    if dataclasses.is_dataclass(holder):
        keys: Iterator[Any] = (_Name(each.name) for each in dataclasses.fields(holder))
    elif isinstance(holder, dict):
        keys = iter(list(holder))
    elif isinstance(holder, list):
        keys = iter(range(len(holder)))
    elif isinstance(holder, np.ndarray):
        yield from (Leaf(holder, k) for k in range(len(holder)))
        return
    else:
        return
    for key in keys:
        if not (isinstance(key, _Name) and key.startswith("_")):
            leaf = Leaf(holder, key)
            yield leaf
            yield from leaves(leaf.value)


def another_value(leaf: Leaf, rnd: Random, *, any_type: bool) -> Any:
    """Return a value in place of that of a leaf; ``any_type``: also of another type, as JSON may have it."""
    old = leaf.value
    if any_type and rnd.random() < 0.2:
        return rnd.choice((None, True, 3, -1.5, math.nan, "x", [], {}, [1, 2, 3], {"a": 1}, 10**400))
    if isinstance(old, (bool, np.bool_)):
        return not old
    if isinstance(leaf.holder, np.ndarray) and leaf.holder.dtype.kind in "iu":
        limits = np.iinfo(leaf.holder.dtype)
        return rnd.choice((limits.min, limits.max, 0, 1))
    if isinstance(old, (int, np.integer)):
        return rnd.choice((0, 1, -1, 2, 3, 2**31 - 1, -(2**31), int(old) + 1, int(old) - 1, 255))
    if isinstance(old, (float, np.floating)):
        number = rnd.choice((*NUMBERS, 1e3 * float(old), float(old) + 1.0, -float(old)))
        return float(np.float32(number)) if isinstance(old, np.float32) else number
    if isinstance(old, str):
        return rnd.choice((*TEXTS, old + "x", old[:-1], old * 2))
    if isinstance(old, np.ndarray):
        return rnd.choice((old[:0], old[:-1], np.concatenate([old, old]), np.concatenate([old, old[:1]])))
    if isinstance(old, list):
        return rnd.choice((old[:0], old[:-1], old + old, old[::-1], old + old[:1]))
    return old
