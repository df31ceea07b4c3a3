"""The example of a stop without people does what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys

from tests.source_files import ROOT


def test_the_example_prints_a_stop_that_ends_at_rest() -> None:
    done = subprocess.run(
        [sys.executable, "examples/path_true_stop.py"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    head, *rows = done.stdout.splitlines()
    found = re.fullmatch(r"READY: at rest after (0\.\d+) s, (0\.\d+) s further on the path", head)
    assert found is not None
    # a stop from speed 1 covers half the way of going on, but for the shape of its jerk
    assert 0.3 * float(found[1]) < float(found[2]) < 0.7 * float(found[1])
    last = [float(x) for x in rows[-1].split("dq [")[1].rstrip("]").split()]
    assert len(rows) == 6 and not any(last)
