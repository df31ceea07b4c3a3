"""The project's Python files, parsed, for tests that read the source instead of running it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORE_PACKAGES = ("robots", "occupancy", "failsafe")
PACKAGES = (*CORE_PACKAGES, "verifier", "modes")
"""What is shipped; modes may not be there yet."""
OTHER_FOLDERS = ("tests", "bench", "examples")


@dataclass(frozen=True)
class Source:
    """One file: its path from the root, with slashes, and its syntax tree."""

    name: str
    tree: ast.Module

    @property
    def package(self) -> str:
        """The top-level folder."""
        return self.name.split("/", 1)[0]

    @property
    def file(self) -> str:
        """The last part of the path."""
        return self.name.rsplit("/", 1)[-1]


def sources(*folders: str) -> Iterator[Source]:
    """Yield every Python file below the folders."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield _source(path)


@cache
def _source(path: Path) -> Source:
    """Parse a file; several tests read the same ones, and none changes them."""
    name = path.relative_to(ROOT).as_posix()
    return Source(name, ast.parse(path.read_text(encoding="utf-8"), filename=name))


def imported(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the full name and line of everything that is imported; relative imports as ``.``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield ".", node.lineno
            for alias in node.names:
                yield f"{node.module}.{alias.name}", node.lineno


def called(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the dotted name and line of everything that is called by name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = dotted(node.func)
            if name:
                yield name, node.lineno


def dotted(node: ast.expr) -> str:
    """``a.b.c`` of a chain of attributes; what comes before a call or index is left out (``.c``)."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return ""


def docstrings(tree: ast.AST) -> set[int]:
    """Identities of the nodes that are docstrings, those of attributes included."""
    found = set()
    for node in ast.walk(tree):
        for block in ("body", "orelse", "finalbody"):
            for statement in getattr(node, block, []) if not isinstance(node, ast.Lambda | ast.IfExp) else []:
                if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                    found.add(id(statement.value))
    return found
