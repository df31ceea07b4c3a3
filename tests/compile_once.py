"""Test processes that need the same compiled function at the same time: one compiles it, the others wait.

In a fresh clone nothing is compiled yet. Without this, processes side by side compile the large functions
once each, minutes of processor time in all.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

_held: set[Path] = set()


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold a lock between processes; who holds it already goes on, as a function that calls itself does."""
    if lock in _held:
        yield
        return
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        _held.add(lock)
        try:
            yield
        finally:
            _held.discard(lock)


def install() -> None:
    """Let every compiled function that numba keeps on disk be compiled by one process at a time.

    A process that waits for another one holds callers of what it waits for, and calls have no cycle but that
    of a function with itself: nobody waits for whoever waits for them. After the wait numba finds what the
    other one has kept.
    """
    compile_here = Dispatcher.compile

    def compile_(self: Dispatcher, sig: Any) -> Any:
        folder = self._cache.cache_path
        if folder is None or sig in self.overloads:
            return compile_here(self, sig)
        with (
            global_compiler_lock,
            _alone(Path(folder) / f"{self.py_func.__module__}.{self.py_func.__qualname__}.lock"),
        ):
            return compile_here(self, sig)

    Dispatcher.compile = compile_
