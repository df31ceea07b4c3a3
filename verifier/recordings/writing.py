"""Output files appear whole or not at all, and never in place of another file unless told so."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from verifier.recordings.errors import OutputExistsError, RecordingError

_STREAMS = ("/dev/std", "/dev/fd/", "/proc/")
"""Where streams of this process have names; one that is a file now must not be replaced by another."""


@contextmanager
def new_file(path: str | Path, *, force: bool = False) -> Iterator[BinaryIO]:
    """Open a file that gets its name only when the block ends without an exception.

    The bytes go to a temporary file in the same folder, which takes the name in one step; after an exception
    nothing is left behind and an older file of that name is untouched. Of a link, the file that it names is
    written.

    Raises
    ------
    OutputExistsError
        ``path`` is there and ``force`` is false.
    RecordingError
        The folder is not there or cannot be written to, ``path`` is no regular file, or there is no room.
    """
    path = Path(path)
    _check(path, force=force)
    target = Path(os.path.realpath(path))
    partial = _partial(target)
    try:
        with partial.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        _check(path, force=force)
        partial.replace(target)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            partial.unlink()


def check_new_file(path: str | Path, *, force: bool = False) -> None:
    """Refuse what :func:`new_file` would refuse, for those who work long before they write.

    Raises
    ------
    OutputExistsError, RecordingError
        As :func:`new_file` says.
    """
    path = Path(path)
    _check(path, force=force)
    partial = _partial(Path(os.path.realpath(path)))
    try:
        partial.open("xb").close()
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            partial.unlink()


def _check(path: Path, *, force: bool) -> None:
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = None
    except OSError as error:
        raise _unwritable(path, error) from error
    if mode is not None and stat.S_ISDIR(mode):
        raise RecordingError(path, "", "is a folder", "name a file to write to")
    is_stream = os.path.abspath(path).startswith(_STREAMS)  # noqa: PTH100 - links are not followed
    if is_stream or (mode is not None and not stat.S_ISREG(mode)):
        raise RecordingError(path, "", "is no regular file", "name a file to write to")
    if mode is not None and not force:
        raise OutputExistsError(path)


def _partial(target: Path) -> Path:
    """Name the temporary file; it is no longer than most names, so that it does not fail for its length."""
    return target.with_name(f".{target.name[:32]}.{secrets.token_hex(4)}.partial")


def _unwritable(path: Path, error: OSError) -> RecordingError:
    if isinstance(error, FileNotFoundError) and not path.parent.exists():
        return RecordingError(path, "", "cannot be written: its folder does not exist", "make it first")
    return RecordingError(path, "", f"cannot be written: {error.strerror or error}")
