"""The page about a run: score, its interval, and every mutant that no test noticed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tests.mutation.mutants import Mutant
from tests.mutation.trial import Outcome


@dataclass(frozen=True)
class Tried:
    """A mutant and what became of it."""

    mutant: Mutant
    outcome: Outcome


class Tally(NamedTuple):
    """A file: how many mutants it has, how many drawn are equivalent, what became of the others."""

    file: str
    possible: int
    equivalent: int
    tried: tuple[Tried, ...]

    def count(self, outcome: Outcome) -> int:
        return sum(each.outcome is outcome for each in self.tried)

    @property
    def noticed(self) -> int:
        """Killed, or stopped for taking too long."""
        return len(self.tried) - self.count(Outcome.SURVIVED)


HEAD = """\
# Mutants of the trusted core, and of what judges recordings by it

`make mutation`, which is `python -m tests.mutation --out docs/results/mutation.md`; single files:
`python -m tests.mutation --only FILE --sample N --seed S --out docs/results/mutation.md`. Rows of files that
are not run stay as they are. A run that was ended goes on with `--resume`.

A mutant is one small change of a file: another operator, comparison, constant or condition, by
[cosmic-ray](https://github.com/sixty-north/cosmic-ray) and two kinds more (`tests/mutation/mutants.py`). The
sample is drawn from all mutants of the files that are run. Each is tried with the tests that belong to its
file (`tests/mutation/table.py`) until one fails. *Killed*: a test failed. *Timed out*: stopped after several
times what the tests take without a change; an endless loop, mostly. *Survived*: nothing was noticed, and each
is listed below. *Equivalent*: drawn, but no test can tell it from the original, for the reason given in
`tests/mutation/equivalents.toml`; not tried, and not part of the score. The score is the share of killed and
timed out among those tried, with the interval of Wilson at 95 %.
"""
COLUMNS = (
    "file", "mutants", "tried", "killed", "timed out", "survived", "equivalent", "score", "seed", "scale",
    "commit", "date, UTC",
)  # fmt: skip
ROW = re.compile(r"^\| (\S+\.py) \|((?: \d+ \|){6})", re.MULTILINE)
SURVIVOR = re.compile(r"^- (\S+\.py):\d+: ", re.MULTILINE)


def interval(hits: int, tries: int, z: float = 1.959964) -> tuple[float, float]:
    """Return Wilson's interval for a share of ``hits`` in ``tries``; from 0 to 1 without any try."""
    if tries == 0:
        return 0.0, 1.0
    share, square = hits / tries, z * z / tries
    middle = (share + 0.5 * square) / (1.0 + square)
    half = z * math.sqrt(share * (1.0 - share) / tries + square / (4.0 * tries)) / (1.0 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


def score(noticed: int, tried: int) -> str:
    """Share and interval in percent."""
    if tried == 0:
        return "-"
    low, high = interval(noticed, tried)
    return f"{100.0 * noticed / tried:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"


def row(tally: Tally, run: Sequence[str] = ()) -> str:
    """Row of a file; ``run``: seed, scale, commit, date."""
    counts = [tally.count(each) for each in (Outcome.KILLED, Outcome.TIMED_OUT, Outcome.SURVIVED)]
    numbers = [tally.possible, len(tally.tried), *counts, tally.equivalent]
    return _cells(tally.file, numbers, run)


def total(rows: Iterable[str]) -> str:
    """Row of all files together."""
    found = [ROW.match(each) for each in rows]
    numbers = [[int(x) for x in each[2].replace("|", " ").split()] for each in found if each is not None]
    return _cells("all", [sum(column) for column in zip(*numbers, strict=True)] or [0] * 6, ())


def drawn_before(text: str, run: Sequence[str]) -> dict[str, int]:
    """Return how many mutants of each file a page has of the same run (seed, scale, commit)."""
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines() if ROW.match(line)]
    return {cells[1]: int(cells[3]) + int(cells[7]) for cells in rows if cells[9:12] == list(run[:3])}


def _cells(name: str, numbers: Sequence[int], run: Sequence[str]) -> str:
    _, tried, killed, timed_out, *_ = numbers
    return f"| {' | '.join([name, *map(str, numbers), score(killed + timed_out, tried), *run])} |"


def page(tallies: Iterable[Tally], run: Sequence[str], before: str = "") -> str:
    """Return the page; what stands of other files on the page ``before`` stays."""
    rows = {match[1]: line for line in before.splitlines() if (match := ROW.match(line))}
    alive: dict[str, list[str]] = {}
    for line in before.splitlines():
        if match := SURVIVOR.match(line):
            alive.setdefault(match[1], []).append(line)
    for tally in tallies:
        rows[tally.file] = row(tally, run)
        survivors = [each.mutant for each in tally.tried if each.outcome is Outcome.SURVIVED]
        alive[tally.file] = [f"- {tally.file}:{each.line}: {each.change}" for each in survivors]
    lines = [HEAD, f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"]
    lines += [*(rows[file] for file in sorted(rows)), total(rows.values()), "", "## Survivors", ""]
    lines += [line for file in sorted(alive) for line in alive[file]]
    return "\n".join([*lines, ""])
