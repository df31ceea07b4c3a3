"""Running inputs through a reader, each within a time limit, and counting what came of them."""

from __future__ import annotations

import shutil
import signal
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random
from types import FrameType
from typing import NamedTuple, Protocol

from robots.errors import SetupError
from tests.fuzz_readers.checks import QuietPassError
from tests.fuzz_readers.files import file_readers
from tests.fuzz_readers.messages import message_readers
from verifier.recordings.decoded import SourceError

LIMIT_S = 10.0
"""A reader that takes longer for an input of some kB hangs."""
LISTED = 20
IN_A_BLOCK = 1000


class Reader(Protocol):
    """Reads inputs of one kind."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def weight(self) -> int:
        """How many inputs it gets, beside others."""

    def attempt(self, rnd: Random, folder: Path) -> None:
        """Make one wrong input and read it; raises SetupError or SourceError where it is refused."""

    def valid(self, folder: Path) -> None:
        """Read what is not wrong."""


class HangError(BaseException):
    """An input took too long; no reader may catch it."""


@dataclass
class Outcome:
    """What came of the inputs of one reader; ``failures``: number of the input, and what happened."""

    reader: str
    inputs: int = 0
    read: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    seconds: float = 0.0
    failures: list[tuple[int, str]] = field(default_factory=list)


def readers() -> list[Reader]:
    """Return every reader."""
    return [*file_readers(), *message_readers()]


class Block(NamedTuple):
    """Inputs ``first`` to ``behind - 1`` of one reader."""

    reader: str
    first: int
    behind: int
    seed: int


def blocks(reader: Reader, inputs: range, seed: int) -> list[Block]:
    """Divide the inputs of a reader into blocks that processes take one after the other."""
    starts = range(inputs.start, inputs.stop, IN_A_BLOCK)
    return [Block(reader.name, first, min(first + IN_A_BLOCK, inputs.stop), seed) for first in starts]


def run_block(block: Block) -> Outcome:
    """Run one block."""
    return run(_named()[block.reader], range(block.first, block.behind), block.seed)


@cache
def _named() -> dict[str, Reader]:
    return {each.name: each for each in readers()}


def merged(outcomes: Sequence[Outcome]) -> Outcome:
    """Add up what came of the blocks of one reader."""
    whole = Outcome(outcomes[0].reader)
    for each in outcomes:
        for key in ("inputs", "read", "refused", "seconds"):
            setattr(whole, key, getattr(whole, key) + getattr(each, key))
        whole.slowest_s = max(whole.slowest_s, each.slowest_s)
        whole.failures += each.failures
    return whole


def run(reader: Reader, inputs: range, seed: int, limit_s: float = LIMIT_S) -> Outcome:
    """Run inputs, each made from the seed, the reader's name and its number alone."""
    outcome, begin = Outcome(reader.name), time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in inputs:
            folder = Path(name) / "input"
            folder.mkdir()
            _one(reader, Random(f"{seed} {reader.name} {number}"), folder, limit_s, outcome, number)
            shutil.rmtree(folder)
    outcome.seconds = time.perf_counter() - begin
    return outcome


def _one(reader: Reader, rnd: Random, folder: Path, limit_s: float, outcome: Outcome, number: int) -> None:
    begin = time.perf_counter()
    failure = ""
    outcome.inputs += 1
    try:
        with _limited(limit_s):
            reader.attempt(rnd, folder)
        outcome.read += 1
    except SourceError:
        outcome.refused += 1  # whoever shows it makes one line of it
    except SetupError as error:
        outcome.refused += 1
        if "\n" in str(error) or not str(error).strip():
            failure = f"refused in other than one line: {str(error)!r}"
    except HangError:
        failure = f"takes more than {limit_s:g} s"
    except QuietPassError as error:
        failure = f"quiet pass: {error}"
    except Exception as error:
        failure = _described(error)
    if failure:
        outcome.failures.append((number, failure))
    outcome.slowest_s = max(outcome.slowest_s, time.perf_counter() - begin)


def _described(error: Exception) -> str:
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    where = "" if frame is None else f" in {Path(frame.tb_frame.f_code.co_filename).name}:{frame.tb_lineno}"
    return f"{type(error).__name__}: {str(error)[:200]}{where}"


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def late(_signal: int, _frame: FrameType | None) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
