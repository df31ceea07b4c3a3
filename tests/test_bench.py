"""The benchmarks run and print their tables; how long anything takes is no matter of a test."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from bench.people import LENGTHS_S, compare, models, slices_after, somebody
from bench.soak import MOST_GROWTH_MIB, faults, growth
from tests.conftest import Some
from tests.source_files import ROOT

COMMANDS = [
    (
        ("bench.replay", "--cycles", "60", "--rounds", "1"),
        ("gate", "**cycle**", "**naive / ours**", "same answer"),
    ),
    (("bench.people", "--rounds", "1"), ("iso13855", "arm_reach", "**all six together**")),
    (
        ("bench.batch", "--seconds", "1", "--rounds", "1", "--tables", "slices"),
        ("5 ms", "20 ms", "processes", "2"),
    ),
    (
        ("bench.safety_state", "--steps", "100"),
        ("one step of the supervisor", "dry run of a trajectory, for each place"),
    ),
    (("bench.speed", "--decisions", "16"), ("scene, exact", "arm, genetic")),
    (("bench.planning", "--trials", "3", "--star-s", "0.2"), ("connect", "rewired", "plan_motion", "path")),
    (("bench.clear_ways", "--trials", "2"), ("clear way found",)),
    (("bench.pose", "--people", "2", "--images", "2"), ("2", "0.8")),
    (("bench.contact", "--steps", "40"), ("task", "guided")),
    (("bench.brackets", "--gap", "0.4", "--only", "ur5e"), ("ur5e", "ur5e, gripper")),
    (("bench.memory", "--minutes", "0.2"), ("cycles", "**peak memory, JSON written, MB**")),
    (
        ("bench.reading", "--messages", "60", "--rounds", "1", "--only", "our own", "--only", "Azure"),
        ("our own (MCAP)", "Azure Kinect, 32 markers"),
    ),
    (
        ("bench.soak", "--minutes", "0.05", "--rate", "100"),
        ("**passed**", "on time", "late: withdrawn", "missed: no step", "late awake"),
    ),
]
"""What is run, and the rows that its table has."""
IN_A_USUAL_RUN = 1


def test_a_benchmark_prints_its_table(some: Some) -> None:
    for command, rows in some(COMMANDS, IN_A_USUAL_RUN):
        done = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        for row in rows:
            assert re.search(rf"^\| {re.escape(row)} +\|", done.stdout, re.MULTILINE), (command[0], row)


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


BOOKS = {
    "instants": 100, "on_time": 80, "late": 5, "not_taken": 3, "missed": 12, "no_instant": 0, "steps": 88,
    "loop_cycles": 88, "withdrawn": 8, "cycle_s": 0.01, "elapsed_s": 0.99, "jumps": 0, "at_rest": True,
    "fault": None, "memory_judged": True, "growth_mib": 0.1, "states": {"executing": 0.9},
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"on_time": 79}, "100 instants passed, but 99 are accounted for"),
        ({"missed": 13}, "100 instants passed, but 101"),
        ({"loop_cycles": 89}, "the loop counts 89"),
        ({"withdrawn": 7}, "7 commands were withdrawn, not 8"),
        ({"elapsed_s": 1.5}, "do not fill"),
        ({"elapsed_s": float("nan")}, "do not fill"),
        ({"jumps": 1}, "faster than the velocity limits"),
        ({"at_rest": False}, "does not rest"),
        ({"states": {"executing": 0.0, "stopped": 1.0}}, "nothing was executed"),
        ({"fault": "ValueError: x"}, "something raised"),
        ({"growth_mib": MOST_GROWTH_MIB + 0.1}, "memory grew"),
        ({"growth_mib": float("nan")}, "memory grew"),
    ],
)
def test_the_soak_finds_what_does_not_add_up(change: dict[str, object], message: str) -> None:
    assert faults(BOOKS) == []
    (fault,) = faults({**BOOKS, **change})
    assert message in fault


def test_growth_is_what_comes_after_the_warm_up() -> None:
    samples = [(float(t), 100.0 if t < 20 else 150.0 + 0.01 * (t - 20)) for t in range(121)]
    assert growth(samples, 20.0) == pytest.approx(0.01 * 91)  # medians of 20 to 29 s and of 111 to 120 s
    assert growth(samples, 200.0) != growth(samples, 200.0) and growth([], 0.0) != growth([], 0.0)
