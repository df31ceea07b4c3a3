"""Results of one command side by side: what `diff` says of them, of whatever command they are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from string import ascii_uppercase
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from verifier.reports.text import DISCLAIMER
from verifier.shown import shown


class Result(Protocol):
    """A result that a command wrote."""

    @property
    def version(self) -> str:
        """Return the version of this software that made it."""


class Change(Protocol):
    """What changed from one result to another."""

    @property
    def changed(self) -> bool:
        """Whether anything did."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""


R = TypeVar("R", bound=Result)
C = TypeVar("C", bound=Change)


@dataclass(frozen=True, slots=True)
class Comparison(ABC, Generic[R, C]):
    """Results, each with the path of its file, and what changed from the first one to each of the others."""

    FORMAT: ClassVar[str]

    paths: tuple[str, ...]
    results: tuple[R, ...]
    tolerance: float
    changes: tuple[C, ...]

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files."""
        return tuple(Path(path).name for path in self.paths)

    @property
    def letters(self) -> str:
        """What the results are called: A, B, …"""
        return ascii_uppercase[: len(self.results)]

    @property
    def exit_status(self) -> int:
        """0 nothing changed, 1 something did."""
        return int(any(change.changed for change in self.changes))

    @abstractmethod
    def summary(self, result: R) -> dict[str, Any]:
        """Return a result in short, as plain values for JSON."""

    @abstractmethod
    def what(self, result: R) -> str:
        """Return a result in one line."""

    @abstractmethod
    def change_lines(self, change: C, letter: str) -> Iterator[str]:
        """Yield what changed from A to ``letter``, most important first."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, described by the schema of the format."""
        return {
            "format": self.FORMAT,
            "version": version("stopproof"),
            "disclaimer": DISCLAIMER,
            "tolerance": self.tolerance,
            "changed": self.exit_status == 1,
            "results": [
                {"file": file, **self.summary(each)}
                for file, each in zip(self.files, self.results, strict=True)
            ],
            "changes": [change.to_dict() for change in self.changes],
        }

    def lines(self) -> list[str]:
        """Return the comparison as text."""
        out = [
            f"{letter}: {shown(file)}: {self.what(each)} (version {shown(each.version)})"
            for letter, file, each in zip(self.letters, self.files, self.results, strict=True)
        ]
        first = self.results[0].version
        for letter, change, each in zip(self.letters[1:], self.changes, self.results[1:], strict=True):
            out += [f"from A to {letter}: {'changed' if change.changed else 'nothing changed'}"]
            if each.version != first:
                both = f"{shown(first)} and {shown(each.version)}"
                out += [f"  made by versions {both}, which is no change by itself"]
            out += [f"  {line}" for line in self.change_lines(change, letter)]
        return [*out, DISCLAIMER]
