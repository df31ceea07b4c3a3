"""Trying mutants, each in a copy of the tree: do the tests notice?"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.mutation.mutants import Mutant

LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "out", "*.egg-info")
MEMORY = 8 << 30
"""Bytes that a mutant may use."""
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


@dataclass(frozen=True)
class Copy:
    """A copy of the tree that mutants are tried in, one after the other; never the working tree.

    Attributes
    ----------
    root:
        Folder of the copy.
    options:
        Options of pytest.
    compiled:
        Folder for compiled functions, which copies may share; None: nothing is compiled.
    """

    root: Path
    options: tuple[str, ...]
    compiled: Path | None = None

    @classmethod
    def of(cls, tree: Path, root: Path, options: Sequence[str], compiled: Path | None = None) -> Copy:
        """Copy a tree to ``root``, which does not exist yet."""
        shutil.copytree(tree, root, ignore=LEFT_OUT)
        return cls(root, tuple(options), compiled)

    def times(self, tests: Sequence[str]) -> dict[str, float]:
        """Run tests without a change; return the time of each test file [s].

        Raises
        ------
        TrialError
            When they do not all pass.
        """
        report = self.root / "out.xml"
        status = self._run([*tests, "--junitxml", str(report)], None)
        if status != 0:
            said = (self.root / SAID).read_text(encoding="utf-8", errors="replace").splitlines()[-20:]
            raise TrialError("\n".join(["the tests do not pass without a change:", *said]))
        found = dict.fromkeys(tests, 0.0)
        for case in ElementTree.parse(report).iter("testcase"):
            name = case.get("classname", "").replace(".", "/")
            for file in tests:
                if (name + "/").startswith(file.removesuffix(".py") + "/"):
                    found[file] += float(case.get("time", "0"))
        return found

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

    def _run(self, arguments: Sequence[str], limit_s: float | None) -> int | None:
        """Run pytest in the copy; return its exit status, or None when it takes too long."""
        shutil.rmtree(self.root / ".hypothesis", ignore_errors=True)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *self.options, *arguments]
        surroundings = dict(os.environ) | {"OMP_NUM_THREADS": "1"}
        if self.compiled is not None:
            surroundings |= {"NUMBA_CACHE_LOCATOR_CLASSES": LOCATORS, "NUMBA_CACHE_DIR": str(self.compiled)}
        with (
            (self.root / SAID).open("wb") as said,
            subprocess.Popen(
                command, cwd=self.root, env=surroundings, stdin=subprocess.DEVNULL, stdout=said,
                stderr=subprocess.STDOUT, start_new_session=True,
            ) as run,
        ):  # fmt: skip
            try:
                resource.prlimit(run.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
                return run.wait(limit_s)
            except subprocess.TimeoutExpired:
                return None
            finally:
                if run.poll() is None:
                    os.killpg(run.pid, signal.SIGKILL)
