"""Change the trusted core in small ways, one at a time, and see whether the tests notice.

python -m tests.mutation [--sample N] [--seed S] [--only FILE]... [--jobs N] [--scale S]
                         [--compiled FOLDER] [--out FILE] [--resume]

Needs cosmic-ray (extra ``test``). Mutants are tried in copies of the tree, in a folder that is removed.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

from tests.mutation import equivalents
from tests.mutation.mutants import Change, Mutant, apply, changes
from tests.mutation.page import Tally, Tried, drawn_before, page, row, total
from tests.mutation.table import TESTS, belonging_to
from tests.mutation.trial import Copies, TrialError

ROOT = Path(__file__).resolve().parents[2]
START_S, COMPILE_S, TIMES = 20.0, 90.0, 5.0
"""A mutant may take this long [s] to start and to compile, and so many times what its tests take."""


def main(arguments: list[str] | None = None) -> int:
    """Run, print what becomes of each mutant, and write the page if one is asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, default=600, help="mutants to draw")
    parser.add_argument("--seed", type=int, default=0, help="of the sample; tests run with their own")
    parser.add_argument(
        "--only", action="append", choices=sorted(TESTS), metavar="FILE", help="draw from this file"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--scale", type=float, default=0.01, help="share of the counts of randomised tests")
    parser.add_argument("--compiled", type=Path, help="folder for compiled functions, to be used again")
    parser.add_argument("--out", type=Path, help="page to write the rows into")
    parser.add_argument(
        "--resume", action="store_true", help="leave out files of which the page has what would be tried"
    )
    options = parser.parse_args(arguments)
    for name in ("sample", "jobs"):
        if not getattr(options, name) >= 1:
            parser.error(f"--{name} must be at least 1")
    if options.resume and options.out is None:
        parser.error("--resume: give the page with --out")
    if not options.seed >= 0:
        parser.error(f"--seed {options.seed}: must be at least 0")
    run, tallies, out = _run(options), [], options.out
    before = out.read_text(encoding="utf-8") if out is not None and out.exists() else ""
    drawn = draw(options.only or sorted(TESTS), options.sample, options.seed)
    if options.resume:
        known = drawn_before(before, run)
        drawn = {file: of for file, of in drawn.items() if known.get(file) != len(of[1])}
    try:
        for tally in _try_all(drawn, options):
            tallies.append(tally)
            print(row(tally), flush=True)
            if out is not None:  # after each file, so that a run that is ended has not been in vain
                out.parent.mkdir(parents=True, exist_ok=True)
                out.write_text(page(tallies, run, before), encoding="utf-8")
    except TrialError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(total(row(each) for each in tallies))
    return 0


def draw(
    files: Sequence[str], sample: int, seed: int, root: Path = ROOT
) -> dict[str, tuple[int, list[Mutant]]]:
    """Draw mutants from all those of some files: file -> how many it has, and those drawn."""
    sources = {file: (root / file).read_text(encoding="utf-8") for file in files}
    possible = {file: changes(source) for file, source in sources.items()}
    everything = [(file, change) for file in files for change in possible[file]]
    random.Random(seed).shuffle(everything)
    chosen: dict[str, list[tuple[Change, Mutant]]] = {file: [] for file in files}
    left = sample
    for file, change in everything:
        if left == 0:
            break
        mutant = apply(file, sources[file], change)
        if mutant is not None:
            chosen[file].append((change, mutant))
            left -= 1
    return {file: (len(possible[file]), [x for _, x in sorted(chosen[file], key=_place)]) for file in files}


def _place(drawn: tuple[Change, Mutant]) -> Change:
    return drawn[0]


def _try_all(drawn: dict[str, tuple[int, list[Mutant]]], options: argparse.Namespace) -> Iterator[Tally]:
    """Try what was drawn, file by file, in as many copies of the tree at once as there are jobs."""
    same = {(each.file, each.before, each.after) for each in equivalents.load()}
    wanted = {
        file: [x for x in mutants if (file, x.before, x.after) not in same]
        for file, (_, mutants) in drawn.items()
    }
    arguments = ("--scale", str(options.scale))
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        folder = Path(name)
        compiled = options.compiled.resolve() if options.compiled else folder / "compiled"
        with (
            Copies(ROOT, folder, options.jobs, arguments, compiled) as copies,
            ThreadPoolExecutor(options.jobs) as pool,
        ):
            times: dict[str, float] = {}
            for file, mutants in wanted.items():
                tests = [test for test in belonging_to(file) if mutants and test not in times]
                times.update(zip(tests, pool.map(lambda test: _time(test, copies), tests), strict=True))
                tried = tuple(pool.map(lambda each: _try(each, copies, times), mutants))
                possible, chosen = drawn[file]
                yield Tally(file, possible, len(chosen) - len(tried), tried)


def _time(test: str, copies: Copies) -> float:
    """Run a test file without a change in a copy that is free; return its time [s]."""
    with copies.one() as copy:
        return copy.time(test)


def _try(mutant: Mutant, copies: Copies, times: dict[str, float]) -> Tried:
    """Try one mutant in a copy that is free."""
    tests = belonging_to(mutant.file)
    limit = START_S + COMPILE_S + TIMES * sum(times[test] for test in tests)
    with copies.one() as copy:
        tried = Tried(mutant, copy.attempt(mutant, tests, limit))
    print(f"{mutant.file}:{mutant.line}: {mutant.change}: {tried.outcome.value}", flush=True)
    return tried


def _run(options: argparse.Namespace) -> list[str]:
    """Seed, scale, commit and date of a run; changes of pages do not count."""
    git = ["git", "-C", str(ROOT)]
    name = subprocess.run([*git, "describe", "--always"], capture_output=True, text=True, check=False)
    status = [*git, "status", "--porcelain", "--", ".", ":!docs/results"]
    changed = subprocess.run(status, capture_output=True, text=True, check=False)
    commit = name.stdout.strip() + ("-dirty" if changed.stdout.strip() else "")
    return [str(options.seed), f"{options.scale:g}", commit, f"{datetime.now(UTC):%Y-%m-%d %H:%M}"]


if __name__ == "__main__":
    sys.exit(main())
