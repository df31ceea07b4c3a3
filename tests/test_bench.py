"""The benchmarks run and print their tables; how long anything takes is no matter of a test."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from bench.people import LENGTHS_S, compare, models, slices_after, somebody
from tests.source_files import ROOT


@pytest.mark.parametrize(
    ("command", "rows"),
    [
        (
            ("bench.replay", "--cycles", "60", "--rounds", "1"),
            ("gate", "**cycle**", "**naive / ours**", "same answer"),
        ),
        (("bench.people", "--rounds", "1"), ("iso13855", "arm_reach", "**all six together**")),
        (
            ("bench.batch", "--seconds", "1", "--rounds", "1", "--tables", "slices"),
            ("5 ms", "20 ms", "processes", "2"),
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


@pytest.mark.parametrize("field", ["n", "first", "slice", "owner", "covers", "n_points", "radius", "points"])
def test_a_row_that_differs_from_the_one_by_numpy_ends_the_benchmark(field: str) -> None:
    people = somebody()
    for model in models():
        ours = model.new_sets()
        model.occupy(people, slices_after(people, LENGTHS_S[0]), ours)
        theirs, last = ours.copy(), int(ours["n"][0]) - 1
        assert compare(model.name, ours, theirs)[0] == last + 1 > 0
        if field == "n":
            theirs[field] += 1
        elif field == "first":
            theirs[field][0, 5] += 1
        elif field == "points":
            theirs[field][0, last, ours["n_points"][0, last] - 1, 2] += 1e-9
        else:
            theirs[field][0, last] += 1e-9 if field == "radius" else 1
        with pytest.raises(SystemExit, match=model.name):
            compare(model.name, ours, theirs)
