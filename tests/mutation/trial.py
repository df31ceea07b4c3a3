"""Trying mutants, each in a copy of the tree: do the tests notice?"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from queue import SimpleQueue
from typing import Self

import pytest

from tests.mutation.mutants import Mutant

LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "out", "*.egg-info")
ZYGOTE = Path(__file__).with_name("zygote.py")
SAID = "out.txt"
"""What pytest printed last, in the copy."""
LOCATORS = "tests.mutation.compiled.ByContent,InTreeCacheLocator,UserWideCacheLocator"


class Outcome(Enum):
    """What became of a mutant."""

    KILLED = "killed"
    TIMED_OUT = "timed out"
    SURVIVED = "survived"


class TrialError(Exception):
    """Tests that cannot be run, or do not pass without a change."""


class Copy:
    """A copy of the tree that mutants are tried in, one after the other; never the working tree.

    Parameters
    ----------
    tree:
        What is copied.
    root:
        Folder of the copy, which does not exist yet.
    options:
        Options of pytest.
    compiled:
        Folder for compiled functions, which copies may share; None: nothing is compiled.
    """

    def __init__(self, tree: Path, root: Path, options: Sequence[str], compiled: Path | None = None) -> None:
        shutil.copytree(tree, root, ignore=LEFT_OUT)
        self.root = root
        self._options = tuple(options)
        surroundings = dict(os.environ) | {"OMP_NUM_THREADS": "1"}
        if compiled is not None:
            surroundings |= {"NUMBA_CACHE_LOCATOR_CLASSES": LOCATORS, "NUMBA_CACHE_DIR": str(compiled)}
        self._runner = subprocess.Popen(
            [sys.executable, str(ZYGOTE), SAID], cwd=root, env=surroundings, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def time(self, test: str) -> float:
        """Run a test file without a change; return how long it takes [s].

        Raises
        ------
        TrialError
            When not all of it passes.
        """
        began = time.monotonic()
        if self._run([test], None) != 0:
            said = (self.root / SAID).read_text(encoding="utf-8", errors="replace").splitlines()[-20:]
            raise TrialError("\n".join([f"{test} does not pass without a change:", *said]))
        return time.monotonic() - began

    def attempt(self, mutant: Mutant, tests: Sequence[str], limit_s: float) -> Outcome:
        """Run tests on a mutant until the first one fails.

        Whatever else pytest ends with, a crash or an import that fails, counts as noticed.

        Raises
        ------
        TrialError
            When there is no test to run.
        """
        path = self.root / mutant.file
        kept, stamp = path.read_text(encoding="utf-8"), path.stat().st_mtime
        try:
            path.write_text(mutant.text, encoding="utf-8")
            os.utime(path, (stamp + 2.0, stamp + 2.0))  # what Python compiled before is out of date
            status = self._run(["-x", *tests], limit_s)
        finally:
            path.write_text(kept, encoding="utf-8")
            os.utime(path, (stamp + 4.0, stamp + 4.0))
        if status is None:
            return Outcome.TIMED_OUT
        if status == pytest.ExitCode.NO_TESTS_COLLECTED:
            raise TrialError(f"no test ran for {mutant.file}")
        return Outcome.SURVIVED if status == 0 else Outcome.KILLED

    def close(self) -> None:
        """End the process that runs the tests."""
        self._runner.__exit__(None, None, None)

    def _run(self, arguments: Sequence[str], limit_s: float | None) -> int | None:
        """Run pytest in the copy; return its exit status, or None when it takes too long."""
        shutil.rmtree(self.root / ".hypothesis", ignore_errors=True)
        command = ["-q", "-p", "no:cacheprovider", *self._options, *arguments]
        assert self._runner.stdin is not None and self._runner.stdout is not None
        print(json.dumps([command, limit_s]), file=self._runner.stdin, flush=True)
        answer = self._runner.stdout.readline()
        if not answer:
            raise TrialError("the process that runs the tests has ended")
        status: int | None = json.loads(answer)
        return status


class Copies:
    """As many copies as processes work at once; each trial takes one that is free."""

    def __init__(
        self, tree: Path, folder: Path, jobs: int, options: Sequence[str], compiled: Path | None = None
    ) -> None:
        self._all = [Copy(tree, folder / str(job), options, compiled) for job in range(jobs)]
        self._free: SimpleQueue[Copy] = SimpleQueue()
        for copy in self._all:
            self._free.put(copy)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for copy in self._all:
            copy.close()

    @contextmanager
    def one(self) -> Iterator[Copy]:
        """Lend a copy."""
        copy = self._free.get()
        try:
            yield copy
        finally:
            self._free.put(copy)
