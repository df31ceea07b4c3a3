"""Mutants that no test can tell from the original, each with the reason."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple

FILE = Path(__file__).with_name("equivalents.toml")


class Equivalent(NamedTuple):
    """A line of a file, what it becomes, and why that is the same; lines without indentation."""

    file: str
    before: str
    after: str
    reason: str


def load(file: Path = FILE) -> tuple[Equivalent, ...]:
    """Return what the file lists."""
    listed = tomllib.loads(file.read_text(encoding="utf-8")).get("equivalent", [])
    return tuple(Equivalent(**each) for each in listed)
