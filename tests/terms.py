"""Find for every single term of every model of people a motion that gets out of its set without that term.

python -m tests.terms [--seed N] [--tries N] [--only MODEL] [--out FILE]

Trials are seeded N, N + 1, …, until a motion lies outside of what the model makes of the same reports
without the term; each seed is also tried with it. Exit status 1: a term has no such seed, or something lay
outside with it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tests.occupancy.inclusion import TRIALS, WHOLE, Outcome
from tests.occupancy.inclusion_kernels import FLOOR_M
from tests.occupancy.left_out import TERMS

ROOT = Path(__file__).parent.parent
OUTSIDE_M = 1e-4
"""How far out [m] counts as outside: far more than rounding."""
COLUMNS = (
    "model", "term", "what is left out", "first failing seed", "outside by [m]", "tries", "with the term [m]"
)  # fmt: skip


@dataclass(frozen=True)
class Found:
    """What came of one term: ``tries`` trials, the last of which was outside if ``outside``.

    ``without`` and ``whole``: the last trial without the term, and the worst of all with it.
    """

    model: str
    term: str
    seed: int
    tries: int
    without: Outcome
    whole: Outcome

    @property
    def outside(self) -> bool:
        return self.without.excess_m > OUTSIDE_M

    @property
    def as_it_should_be(self) -> bool:
        """Outside without the term, and never with it."""
        return self.outside and self.whole.excess_m <= 0.0

    def row(self) -> str:
        """One row of the table."""
        what = TERMS[self.model][self.term].what
        seed, by = (str(self.seed), f"{self.without.excess_m:.3g}") if self.outside else ("none", "-")
        inside = f"{self.whole.excess_m:.1e}" if self.whole.excess_m >= FLOOR_M else f"below {FLOOR_M:g}"
        return f"| {self.model} | {self.term} | {what} | {seed} | {by} | {self.tries} | {inside} |"


def find(model: str, term: str, seed: int, tries: int) -> Found:
    """Try seeds from ``seed`` on until something lies outside without the term."""
    trial, left = TRIALS[model], TERMS[model][term]
    whole: Outcome | None = None
    for k in range(tries):
        with_it, without = trial(seed + k, True, WHOLE), trial(seed + k, True, left)
        if whole is None or not with_it.excess_m <= whole.excess_m:
            whole = with_it
        if without.excess_m > OUTSIDE_M:
            break
    assert whole is not None, "at least one try"
    return Found(model, term, seed + k, k + 1, without, whole)


def find_all(seed: int, tries: int, models: Iterable[str] = tuple(TERMS)) -> Iterator[Found]:
    """Yield what came of every term of some models."""
    for model in models:
        for term in TERMS[model]:
            yield find(model, term, seed, tries)


def main(arguments: list[str] | None = None) -> int:
    """Print the table, and write the page if one is asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.terms", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0, help="of the first trial")
    parser.add_argument("--tries", type=int, default=1000, help="trials of a term at most")
    parser.add_argument("--only", choices=sorted(TERMS), help="a single model")
    parser.add_argument("--out", type=Path, help="write a page there")
    options = parser.parse_args(arguments)
    if not options.tries >= 1:
        parser.error("--tries must be at least 1")
    if not options.seed >= 0:
        parser.error(f"--seed {options.seed}: must be at least 0")
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"]
    wrong = []
    print("\n".join(lines))
    for found in find_all(options.seed, options.tries, (options.only,) if options.only else tuple(TERMS)):
        lines.append(found.row())
        print(lines[-1], flush=True)
        if not found.as_it_should_be:
            wrong.append(found)
    for found in wrong:
        fault = "with the term, outside" if found.outside else "no failing seed"
        print(f"{found.model}, {found.term}: {fault} ({found.whole.witness})", file=sys.stderr)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(_page(options, lines), encoding="utf-8")
    return 1 if wrong else 0


TEXT = f"""\
For each single term of each model of people ([method.md](../method.md), section 4): the first seed whose
motions get out of the set, by more than {OUTSIDE_M:g} m, when the model leaves out that term and nothing
else. A trial is a crowd of seeded random people who use up the limits of a profile, all one way. Last
column: the worst of the same seeds with the term; negative is inside. A row is made again by
`python -m tests.terms --seed S --tries 1 --only MODEL`, with the seed and the model of the row.
"""


def _page(options: argparse.Namespace, table: list[str]) -> str:
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    only = f" --only {options.only!r}" if options.only else ""
    command = f"`python -m tests.terms --seed {options.seed} --tries {options.tries}{only}`"
    date = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    head = ["# Every term is needed", "", command, "", f"- commit: {commit}", f"- date: {date}", ""]
    return "\n".join([*head, TEXT, *table, ""])


if __name__ == "__main__":
    sys.exit(main())
