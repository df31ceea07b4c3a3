"""Files that set-up reads, and the one line that one gets which cannot be read."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from robots.errors import SetupError

LARGEST = 2**30
"""Bytes of a mesh, a URDF or a result; more would fill the memory."""
LARGEST_TEXT = 2**24
"""Bytes of a file that people write."""
_AT_ONCE = 2**20
_LONGEST = 200


def is_file(path: Path) -> bool:
    """Whether ``path`` is a file; False, too, where the system takes no such path."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_bytes(path: Path, largest: int = LARGEST) -> bytes:
    """Read a file of at most ``largest`` bytes.

    Raises
    ------
    SetupError
        If it cannot be read, or is larger: a device never ends.
    """
    try:
        with path.open("rb") as file:
            content = b"".join(_parts(file, largest))
    except FileNotFoundError:
        raise SetupError(f"{printed(path)}: does not exist") from None
    except OSError as error:
        raise SetupError(f"{printed(path)}: cannot be read ({error.strerror})") from None
    except ValueError as error:  # a path with a NUL
        raise SetupError(f"{printed(path)}: cannot be read ({error})") from None
    if len(content) > largest:
        raise SetupError(f"{printed(path)}: larger than {largest / 2**20:g} MiB, or without an end")
    return content


def _parts(file: BinaryIO, largest: int) -> Iterator[bytes]:
    """Read until the end, or until there is more than ``largest``."""
    size = 0
    while size <= largest and (part := file.read(_AT_ONCE)):
        size += len(part)
        yield part


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    SetupError
        If it cannot be read, is not TOML, is nested too deeply, or has an integer too long to be read.
    """
    content = read_bytes(path, LARGEST_TEXT)
    try:
        return tomllib.loads(content.decode("utf-8"))
    except RecursionError:
        raise SetupError(
            f"{path}: not a TOML file that can be read (its values are nested too deeply)"
        ) from None
    except ValueError as error:
        raise SetupError(f"{path}: not a TOML file ({error})") from None


def shown(value: object) -> str:
    """Return a value out of a file for a message: on one line and not endless, whatever it is."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # Python writes no integer of thousands of digits
        return f"a huge {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def printed(name: Path | str) -> str:
    """Return a path or name for a message."""
    text = str(name)
    return text if text and text.isprintable() else repr(text)
