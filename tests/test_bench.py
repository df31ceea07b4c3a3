"""The benchmarks run and print their tables; how long anything takes is no matter of a test."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.source_files import ROOT


@pytest.mark.parametrize(
    ("command", "rows"),
    [
        (
            ("bench.replay", "--cycles", "60", "--rounds", "1"),
            ("gate", "**cycle**", "**naive / ours**", "same answer"),
        ),
        (("bench.memory", "--minutes", "0.2"), ("cycles", "**peak memory, JSON written, MB**")),
    ],
)
def test_a_benchmark_prints_its_table(command: tuple[str, ...], rows: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    for row in rows:
        assert re.search(rf"^\\| {re.escape(row)} +\\|", done.stdout, re.MULTILINE), row
