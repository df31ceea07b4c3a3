"""What leaves the program: lines and JSON on standard output, files, a progress bar."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from robots.errors import SetupError
from verifier.recordings import new_file
from verifier.shown import one_line


def print_lines(lines: Sequence[str]) -> None:
    """Print texts, each on one line whatever it quotes."""
    with _standard_output():
        for line in lines:
            print(one_line(line))
        sys.stdout.flush()


def print_file(text: str) -> None:
    """Print the content of a file as it is."""
    with _standard_output():
        sys.stdout.write(text)
        sys.stdout.flush()


def write_json(value: object, path: str, *, force: bool) -> None:
    """Write to a file, or to standard output for ``-``.

    It is written piece by piece: the text of an hour's recording need not stand in memory.
    """
    if path == "-":
        with _standard_output():
            json.dump(value, sys.stdout, indent=1, allow_nan=False)
            sys.stdout.write("\n")
            sys.stdout.flush()
        return
    with new_file(Path(path), force=force) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", write_through=True)
        json.dump(value, text, indent=1, allow_nan=False)
        text.write("\n")
        text.detach()


def write_bytes(data: bytes, path: str | Path, *, force: bool) -> None:
    """Write to a file."""
    with new_file(path, force=force) as stream:
        stream.write(data)


@contextmanager
def _standard_output() -> Iterator[None]:
    """Whoever reads may stop reading (``| head``): the exit status stays that of the result.

    Raises
    ------
    SetupError
        What was found could not be printed, e.g. because a disk is full.
    """
    try:
        yield
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    except OSError as error:
        raise SetupError(f"standard output: cannot be written: {error.strerror or error}") from error


@contextmanager
def progress(text: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda _share: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)
