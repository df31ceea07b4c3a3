"""Let every reader read broken and invented files and messages, and count what comes of it.

python -m tests.fuzz_readers --inputs N [--seed S] [--reader NAME]... [--first K] [--jobs N] [--out FILE.md]

An input may be read, or refused in one line. Anything else is a failure: another exception, more than 10 s,
more memory than 4 GiB, or a number that is none and was taken for one. Exit status 1 after a failure. The
input number K of a reader is made from seed, name and K alone: `--reader NAME --first K --inputs 1` makes it
again.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from tests.full import _commit
from tests.fuzz_readers.run import LIMIT_S, LISTED, Block, Outcome, Reader, blocks, merged, readers, run_block

MEMORY_BYTES = 4 << 30
HEAD = """# Fuzzing of the readers

`python -m tests.fuzz_readers --inputs {inputs} --seed {seed} --out docs/results/fuzzing.md`: small valid
files and messages of every kind, made by independent libraries where there are some, are broken (bits
flipped, cut, put in, left out, twice, exchanged; numbers replaced by NaN, infinite, 1e308, -0 and
others; lengths, lines, separators, whole values), and a tenth of the files is invented. Each must be
read, or refused in one line, within {limit:g} s and 4 GiB. What is read is checked: joints are finite
and their times increase; what is not a number is no measured point; one NaN never moves another point;
what is written again in our own words says the same.

| reader | inputs | read | refused | failures | slowest, ms | inputs a second, of one process |
|---|---|---|---|---|---|---|
"""


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz_readers")
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", action="append", default=[])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    chosen = [each for each in readers() if not given.reader or each.name in given.reader]
    if not chosen or given.inputs < 1 or given.jobs < 1:
        names = ", ".join(each.name for each in readers())
        parser.error(f"readers are {names}; --inputs and --jobs must be at least 1")
    if given.inputs == 1 and len(chosen) == 1:
        _limit_memory()
        return _again(chosen[0], given.seed, given.first)
    work = [
        block
        for each, number in shares(chosen, given.inputs)
        for block in blocks(each, range(given.first, given.first + number), given.seed)
    ]
    outcomes = [_told(merged(of_one)) for of_one in _by_reader(_done(work, given.jobs))]
    if given.out is not None:
        given.out.write_text(page(outcomes, given.inputs, given.seed, given.jobs), encoding="utf-8")
    return int(any(each.failures for each in outcomes))


def shares(chosen: list[Reader], inputs: int) -> list[tuple[Reader, int]]:
    """Divide the inputs among readers by weight, at least one each."""
    total = sum(each.weight for each in chosen)
    return [(each, max(1, -(-inputs * each.weight // total))) for each in chosen]


def _done(work: list[Block], jobs: int) -> Iterator[Outcome]:
    """Run blocks in processes of their own, each with its own limit of memory; outcomes in their order."""
    with ProcessPoolExecutor(min(jobs, len(work)), initializer=_limit_memory) as pool:
        yield from pool.map(run_block, work)


def _by_reader(outcomes: Iterable[Outcome]) -> Iterator[list[Outcome]]:
    for _reader, of_one in groupby(outcomes, key=lambda each: each.reader):
        yield list(of_one)


def page(outcomes: list[Outcome], inputs: int, seed: int, jobs: int) -> str:
    """Return the page of results."""
    rows = [
        f"| {each.reader} | {each.inputs} | {each.read} | {each.refused} | {len(each.failures)} "
        f"| {1e3 * each.slowest_s:.0f} | {each.inputs / max(each.seconds, 1e-9):.0f} |"
        for each in outcomes
    ]
    total = [sum(getattr(each, key) for each in outcomes) for key in ("inputs", "read", "refused")]
    failures = sum(len(each.failures) for each in outcomes)
    rows.append(f"| all | {total[0]} | {total[1]} | {total[2]} | {failures} | | |")
    made = f"Commit {_commit()}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, {jobs} processes."
    return HEAD.format(inputs=inputs, seed=seed, limit=LIMIT_S) + "\n".join(rows) + f"\n\n{made}\n"


def _told(outcome: Outcome) -> Outcome:
    print(
        f"{outcome.reader}: {outcome.inputs} inputs, {outcome.read} read, {outcome.refused} refused, "
        f"{len(outcome.failures)} failures, slowest {1e3 * outcome.slowest_s:.0f} ms, "
        f"{outcome.seconds:.0f} s",
        flush=True,
    )
    for number, what in outcome.failures[:LISTED]:
        print(f"  --reader {outcome.reader!r} --first {number} --inputs 1: {what}", flush=True)
    return outcome


def _again(reader: Reader, seed: int, number: int) -> int:
    """Read one input and show what happens."""
    with TemporaryDirectory() as name:
        try:
            reader.attempt(Random(f"{seed} {reader.name} {number}"), Path(name))
        except Exception:
            traceback.print_exc()
            return 1
    return 0


def _limit_memory() -> None:
    used = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, resource.RLIM_INFINITY))


if __name__ == "__main__":
    sys.exit(main())
