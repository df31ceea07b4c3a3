"""Compiled functions kept by what they are made of, so that a mutant compiles what it changes.

numba keeps a compiled function as long as its file is the same. A mutant changes a file, so all of it would
be compiled anew; and callers in other files would go on with what they had compiled in. Here the key is the
text of the function, of everything it calls, and of the constants of their files. For processes with
``NUMBA_CACHE_LOCATOR_CLASSES`` = this class and ``NUMBA_CACHE_DIR`` = a folder.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Self

from numba.core import config
from numba.core.caching import _CacheLocator

ROOT = Path(__file__).resolve().parents[2]


class ByContent(_CacheLocator):
    """Where numba keeps a function of this project."""

    def __init__(self, function: Callable[..., Any], file: Path) -> None:
        self._line = function.__code__.co_firstlineno
        self._key = digest(file, function.__name__)
        self._py_file = str(file)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Self | None:
        file = Path(py_file).resolve()
        if not file.is_relative_to(ROOT) or inspect.getsourcefile(py_func) is None:
            return None
        return cls(py_func, file)

    def get_cache_path(self) -> str:
        return str(Path(config.CACHE_DIR, Path(self._py_file).parent.relative_to(ROOT)))

    def get_source_stamp(self) -> str:
        return self._key

    def get_disambiguator(self) -> str:
        return f"{self._line}-{self._key[:16]}"


def digest(file: Path, function: str) -> str:
    """Return a digest of a function and all that it calls."""
    seen: set[tuple[Path, str]] = set()
    waiting = [(file, function)]
    while waiting:
        each = waiting.pop()
        if each not in seen:
            seen.add(each)
            waiting += [
                found for name in _functions(each[0])[each[1]][1] for found in _by_name().get(name, ())
            ]
    whole = hashlib.sha256()
    for path, name in sorted(seen):
        whole.update(f"{path.relative_to(ROOT)} {name}\n{_functions(path)[name][0]}".encode())
    for path in sorted({path for path, _ in seen}):
        whole.update(_constants(path).encode())
    return whole.hexdigest()


@cache
def _by_name() -> dict[str, list[tuple[Path, str]]]:
    """Name of a compiled function -> where there are any, in files that compile something."""
    found: dict[str, list[tuple[Path, str]]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        if "njit" in path.read_text(encoding="utf-8"):
            for name in _functions(path):
                found.setdefault(name, []).append((path, name))
    return found


@cache
def _functions(path: Path) -> dict[str, tuple[str, frozenset[str]]]:
    """Functions of a file -> text, and every name in it."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            inside = [x for x in ast.walk(node) if isinstance(x, ast.Name | ast.Attribute)]
            names = frozenset(x.id if isinstance(x, ast.Name) else x.attr for x in inside)
            found[node.name] = (ast.unparse(node), names)
    return found


@cache
def _constants(path: Path) -> str:
    """Return what a file has outside of functions, and the files of the project that it imports."""
    outside, imported = [], []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.FunctionDef):
            outside.append(ast.unparse(node))
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            parts = ROOT.joinpath(*node.module.split("."))
            names = [parts / f"{each.name}.py" for each in node.names]
            imported += [x for x in (parts.with_suffix(".py"), *names) if x.is_file()]
    return "\n".join([*outside, *(_constants(each) for each in imported)])
