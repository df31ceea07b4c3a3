"""The page about a run: score, its interval, and every mutant that no test noticed."""

from __future__ import annotations

import math
from collections.abc import Sequence
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


TEXT = """\
A mutant is one small change of a file of the trusted core: another operator, comparison, constant or
condition, by [cosmic-ray](https://github.com/sixty-north/cosmic-ray) and two kinds more
(`tests/mutation/mutants.py`). The sample is drawn from all mutants of all files alike. Each is tried with the
tests that belong to its file (`tests/mutation/table.py`) until one fails. *Killed*: a test failed. *Timed
out*: stopped after several times what the tests take without a change; an endless loop, mostly. *Survived*:
nothing was noticed, and each is listed below. *Equivalent*: drawn, but no test can tell it from the original,
for the reason given in `tests/mutation/equivalents.toml`; not tried, and not part of the score. The score is
the share of killed and timed out among those tried, with the interval of Wilson at 95 %.
"""
COLUMNS = ("file", "mutants", "tried", "killed", "timed out", "survived", "equivalent", "score")


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


def page(head: Sequence[str], tallies: Sequence[Tally]) -> str:
    """Return the page; ``head``: lines that say how it was made."""
    rows = [row(each) for each in tallies]
    lines = ["# Mutants of the trusted core", "", *head, "", TEXT, f"| {' | '.join(COLUMNS)} |"]
    lines += [f"|{'---|' * len(COLUMNS)}", *rows, total(tallies), "", "## Survivors", ""]
    for tally in tallies:
        alive = [each.mutant for each in tally.tried if each.outcome is Outcome.SURVIVED]
        lines += [f"- {tally.file}:{each.line}: {each.change}" for each in alive]
    return "\n".join([*lines, ""])


def row(tally: Tally) -> str:
    """Row of a file."""
    counts = [str(tally.count(each)) for each in (Outcome.KILLED, Outcome.TIMED_OUT, Outcome.SURVIVED)]
    tried = len(tally.tried)
    cells = [tally.file, str(tally.possible), str(tried), *counts, str(tally.equivalent)]
    return f"| {' | '.join([*cells, score(tally.noticed, tried)])} |"


def total(tallies: Sequence[Tally]) -> str:
    """Row of all files together."""
    whole = Tally(
        "all", sum(x.possible for x in tallies), sum(x.equivalent for x in tallies),
        tuple(each for x in tallies for each in x.tried),
    )  # fmt: skip
    return row(whole)
