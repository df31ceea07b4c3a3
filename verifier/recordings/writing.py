"""Output files appear whole or not at all, and never in place of another file unless told so."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from verifier.recordings.errors import OutputExistsError, RecordingError


@contextmanager
def new_file(path: str | Path, *, force: bool = False) -> Iterator[BinaryIO]:
    """Open a file that gets its name only when the block ends without an exception.

    The bytes go to a temporary file in the same folder, which takes the name in one step; after an exception
    nothing is left behind and an older file of that name is untouched.

    Raises
    ------
    OutputExistsError
        ``path`` is there and ``force`` is false.
    RecordingError
        The folder is not there or cannot be written to, or ``path`` is a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise RecordingError(path, "", "is a folder", "name a file to write to")
    if path.exists() and not force:
        raise OutputExistsError(path)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        stream = partial.open("xb")
    except OSError as error:
        raise RecordingError(path, "", f"cannot be written: {error.strerror or error}") from error
    try:
        with stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        if path.exists() and not force:
            raise OutputExistsError(path)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
