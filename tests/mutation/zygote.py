"""A process that has imported what tests import of others, and forks one that runs pytest per line of input.

A line of input is JSON: the arguments of pytest and the time it may take [s], or null. A line of output is
the exit status, or null where it took too long. Runs in the folder whose tests it runs; what pytest prints
goes to the file that is the argument.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
from importlib import import_module
from pathlib import Path

FOREIGN = (
    "numpy", "scipy.interpolate", "scipy.optimize", "scipy.spatial", "numba", "pinocchio", "coal", "fcl",
    "ruckig", "pydantic", "click", "rich.progress", "mcap.reader", "mcap.writer", "rosbags.typesys",
    "pytest", "hypothesis",
)  # fmt: skip
MEMORY = 8 << 30
"""Bytes that a run may use."""
NAP_S = 0.02


def serve(said: Path) -> None:
    """Run what is asked for, one after the other, until input ends."""
    for name in FOREIGN:
        import_module(name)
    for line in sys.stdin:
        arguments, limit_s = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(arguments, said)
        print(json.dumps(_wait(child, limit_s)), flush=True)


def _run(arguments: list[str], said: Path) -> None:
    """Become a run of pytest, in a group of its own."""
    status = 1
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(file, stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        status = int(import_module("pytest").main(arguments))
        sys.stdout.flush()
    finally:
        os._exit(status)


def _wait(child: int, limit_s: float | None) -> int | None:
    """Return the exit status of a run, negative for a signal; None when it is stopped, after too long."""
    end = None if limit_s is None else time.monotonic() + limit_s
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if end is not None and time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(NAP_S)


if __name__ == "__main__":
    sys.path[0] = str(Path.cwd())
    serve(Path(sys.argv[1]))
