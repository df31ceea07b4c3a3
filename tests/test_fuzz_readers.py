"""Broken files and messages for every reader, a few of each; all: `python -m tests.fuzz_readers`."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import make_dataclass
from pathlib import Path
from random import Random
from types import SimpleNamespace

import pytest

from robots.errors import SetupError
from tests.fuzz_readers.__main__ import page, shares
from tests.fuzz_readers.checks import need
from tests.fuzz_readers.messages import MessageReader
from tests.fuzz_readers.run import Outcome, Reader, blocks, merged, readers, run, run_block
from verifier.recordings.people_sources import ADAPTERS
from verifier.recordings.robot_sources import ADAPTERS as ARMS

FULL = 30_000
"""Inputs of all readers together."""


@pytest.fixture(scope="module")
def all_readers() -> list[Reader]:
    return readers()


def test_what_is_valid_is_read(all_readers: list[Reader], tmp_path: Path) -> None:
    for reader in all_readers:
        folder = tmp_path / reader.name
        folder.mkdir()
        reader.valid(folder)


def test_every_reader_reads_or_refuses(
    all_readers: list[Reader], seed: int, count: Callable[[int], int]
) -> None:
    for reader, inputs in shares(all_readers, count(FULL)):
        outcome = run(reader, range(inputs), seed)
        assert outcome.inputs == outcome.read + outcome.refused == inputs, (reader.name, outcome.failures[:5])
        assert not outcome.failures, (reader.name, outcome.failures[:5])


def test_every_adapter_is_among_them(all_readers: list[Reader]) -> None:
    """But for those that are another type with the same reader, or refuse everything."""
    streams = [each.streams for each in all_readers if isinstance(each, MessageReader)]
    found = {message.schema for kinds in streams for stream in kinds for message in stream}
    same = {"zed_interfaces/msg/ObjectsStamped", "tf/msg/tfMessage"}
    assert set(ADAPTERS) - found == same | {"hri_msgs/msg/Skeleton2D"}
    assert set(ARMS) - found == {"franka_msgs/msg/FrankaState"}


def test_in_blocks_the_same_comes_of_it(all_readers: list[Reader], monkeypatch: pytest.MonkeyPatch) -> None:
    reader = next(each for each in all_readers if each.name == "JointState")
    monkeypatch.setattr("tests.fuzz_readers.run.IN_A_BLOCK", 7)
    parts = blocks(reader, range(3, 23), 0)
    assert [(each.first, each.behind) for each in parts] == [(3, 10), (10, 17), (17, 23)]
    found, whole = merged([run_block(each) for each in parts]), run(reader, range(3, 23), 0)
    assert (found.read, found.refused, found.inputs) == (whole.read, whole.refused, 20)
    failed = merged(
        [Outcome("a", 1, slowest_s=2.0, failures=[(0, "x")]), Outcome("a", 2, failures=[(2, "y")])]
    )
    assert failed == Outcome("a", 3, slowest_s=2.0, failures=[(0, "x"), (2, "y")])


class Fake:
    """A reader that does with a number what it is told to do."""

    name, weight = "fake", 1

    def __init__(self, read: Callable[[float], object]) -> None:
        self._read = read

    def attempt(self, rnd: Random, folder: Path) -> None:
        assert not list(folder.iterdir())
        self._read(rnd.choice((1.0, math.nan)))

    def valid(self, folder: Path) -> None:
        self._read(1.0)


def raises(error: Exception) -> Callable[[float], object]:
    def read(value: float) -> object:
        if math.isnan(value):
            raise error
        return value

    return read


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (raises(SetupError("one line")), ""),
        (raises(SetupError("two\nlines")), "other than one line"),
        (raises(KeyError("x")), "KeyError: 'x' in test_fuzz_readers.py"),
        (lambda value: need(not math.isnan(value), "NaN is read"), "quiet pass: NaN is read"),
        (lambda value: time.sleep(0.0 if value == 1.0 else 10.0), "takes more than 0.05 s"),
    ],
)
def test_what_must_not_happen_is_noticed(read: Callable[[float], object], said: str) -> None:
    outcome = run(Fake(read), range(6), 1, limit_s=0.05)
    assert outcome.inputs == 6 and outcome.read and outcome.read < 6
    assert bool(outcome.failures) == bool(said)
    assert all(said in what for _, what in outcome.failures)


def test_a_nan_that_becomes_a_number_is_noticed() -> None:
    def quiet(stream: list[SimpleNamespace]) -> dict[tuple[int, str, int], float]:
        x = stream[0].value["x"]
        return {(0, "p", 0): 0.0 if math.isnan(x) else x}

    message = SimpleNamespace(value={"x": 1.0})
    stream = [make_dataclass("Message", ["value"])(message.value)]
    outcome = run(MessageReader("quiet", [stream], quiet), range(60), 1)
    assert any("moved" in what for _, what in outcome.failures)
    honest = MessageReader("honest", [stream], lambda read: {(0, "p", 0): read[0].value["x"]})
    assert message.value == {"x": 1.0}, "what was changed is put back"
    assert honest.streams


def test_the_same_input_is_made_again(all_readers: list[Reader], tmp_path: Path) -> None:
    made = []
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        with contextlib.suppress(SetupError):
            all_readers[0].attempt(Random("0 own recording 7"), folder)
        made.append({each.name: each.read_bytes() for each in folder.iterdir()})
    assert made[0] == made[1] and made[0]


def test_the_page_counts_everything() -> None:
    text = page([Outcome("a", 3, 2, 1), Outcome("b", 5, 1, 3, failures=[(1, "x")])], 8, 2, 1)
    assert "| a | 3 | 2 | 1 | 0 |" in text and "| all | 8 | 3 | 4 | 1 |" in text
    assert "--inputs 8 --seed 2" in text
