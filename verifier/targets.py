"""The files that a command is to write, looked at before it works: none may be an input or one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robots.errors import SetupError
from verifier.paths import same_file
from verifier.recordings import check_new_file
from verifier.recordings.containers.ros2_folder import ENDINGS, METADATA

Named = tuple[str, str | Path | None]
"""What a file is (an option, *recording*), and its path; ``None``: not given."""


@dataclass(frozen=True, slots=True)
class Targets:
    """Files to write.

    Attributes
    ----------
    paths:
        In the order in which they were given; standard output is not among them.
    """

    paths: tuple[str, ...]

    @property
    def written(self) -> list[str]:
        """What is said when they are written."""
        return [f"wrote {' and '.join(self.paths)}"] if self.paths else []


def check_targets(outputs: Sequence[Named], inputs: Sequence[Named], *, force: bool) -> Targets:
    """Refuse, before any work, what could or must not be written after it.

    Parameters
    ----------
    outputs:
        Options and their files; ``-`` is standard output, which only ``--json`` may name.
    inputs:
        What the files are that the command reads, and their paths; names of the catalogue do no harm.
    force:
        Files that exist may be overwritten; inputs, other outputs and what is no regular file may not.

    Raises
    ------
    SetupError
        In one line: which option, what is wrong with its file.
    """
    seen: list[tuple[str, str]] = []
    for option, value in outputs:
        if value is None:
            continue
        path = str(value)
        _check_name(option, path)
        if path == "-":
            continue
        for what, read in inputs:
            if read is not None and same_file(path, read):
                raise SetupError(f"{option} {path}: is the {what} itself; name another file")
            if read is not None and _is_part(path, read):
                raise SetupError(f"{option} {path}: is a part of the {what}; name another file")
        for other, taken in seen:
            if same_file(path, taken):
                raise SetupError(f"{option} {path}: {other} names the same file; name another one")
        check_new_file(path, force=force)
        seen.append((option, path))
    return Targets(tuple(path for _option, path in seen))


def _is_part(path: str, read: str | Path) -> bool:
    """Whether a file would be one of the bag that is read: a folder, or named by a file in it."""
    folder = Path(read)
    if folder.name.endswith(ENDINGS):
        folder = folder.parent
    named = Path(path).name == METADATA or path.endswith(ENDINGS)
    return named and (folder / METADATA).is_file() and same_file(Path(path).parent, folder)


def require_page(output: Named) -> None:
    """Refuse a page whose name says that it is something else.

    Raises
    ------
    SetupError
        In one line: the name does not end in .html or .htm.
    """
    option, path = output
    if path is not None and not str(path).lower().endswith((".html", ".htm")):
        raise SetupError(f"{option} {path}: is a page; its name must end in .html")


def _check_name(option: str, path: str) -> None:
    may_print = option == "--json"
    if not path:
        right = "name a file, or - for standard output" if may_print else "name a file"
        raise SetupError(f"{option} '': the name is empty; {right}")
    if path == "-" and not may_print:
        raise SetupError(f"{option} -: cannot go to standard output; name a file (./- for one called -)")
