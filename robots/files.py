"""Files that set-up reads, and the one line that one gets which cannot be read."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from robots.errors import SetupError

_LONGEST = 200


def is_file(path: Path) -> bool:
    """Whether ``path`` is a file; False, too, where the system takes no such path."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_bytes(path: Path) -> bytes:
    """Read a file.

    Raises
    ------
    SetupError
        If it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise SetupError(f"{printed(path)}: cannot be read ({error.strerror})") from None
    except ValueError as error:  # a path with a NUL
        raise SetupError(f"{printed(path)}: cannot be read ({error})") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    SetupError
        If it cannot be read, is not TOML, is nested too deeply, or has an integer too long to be read.
    """
    content = read_bytes(path)
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
