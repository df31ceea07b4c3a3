"""Run the tests with all randomised counts and write the result to docs/results/.

python -m tests.full [--seed N] [--scale S] [--only GROUP]... [--file TEST]... [--out FILE]

Group by group: each has a row of its own in the page, written as soon as it has finished, with the commit
that it was run on. Rows of groups that are not run stay as they are. A single file of tests, after a change
of the tests alone, has a row of its own, which goes when its group is run again. The cycles of the adversary
are left to ``python -m tests.adversary``, which makes the same runs and a page of its own.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).parent.parent
GROUPS = ("soundness", "failsafe", "robots", "occupancy", "modes", "everything else")
ELSEWHERE = (
    "tests/soundness/test_adversary.py::test_nobody_is_touched_by_a_moving_link_and_no_limit_is_exceeded"
)
"""Made by ``python -m tests.adversary``, run by run the same."""
HEAD = [
    "# All randomised counts",
    "",
    "`make test-full`, which is `python -m tests.full` and then `python -m tests.adversary`; a group:",
    "`python -m tests.full --only GROUP`; one file, when only its tests have changed since:",
    "`python -m tests.full --file occupancy/test_sets.py`. The cycles of the adversary are on a page",
    "of their own, [adversary.md](adversary.md).",
    "",
    "| tests | result | minutes | cores | seed | share of counts | real recordings | commit | date, UTC |",
    "|---|---|---|---|---|---|---|---|---|",
]


@dataclass(frozen=True)
class Options:
    """What a run was asked for."""

    seed: int
    scale: float
    jobs: int
    out: Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", action="append", choices=GROUPS)
    parser.add_argument("--file", action="append", help="one file of tests, as occupancy/test_sets.py")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "full-counts.md")
    given = parser.parse_args(arguments)
    if not given.seed >= 0:
        parser.error(f"--seed {given.seed}: must be at least 0")
    for file in given.file or ():
        if not (ROOT / "tests" / file).is_file():
            parser.error(f"--file {file}: there is no tests/{file}")
    options = Options(given.seed, given.scale, given.jobs, given.out)
    failed = 0
    for group in [*(given.only or ()), *(given.file or ())] or GROUPS:
        status, row, slow = _run(group, options)
        failed = failed or status
        _write(group, row, slow, options.out)
    return failed


def _places(group: str) -> list[str]:
    """Where the tests of a group stand."""
    if group != "everything else":
        return [f"tests/{group}"]
    named = {ROOT / "tests" / each for each in GROUPS}
    folders = [path for path in (ROOT / "tests").iterdir() if path.is_dir() and path not in named]
    files = (ROOT / "tests").glob("test_*.py")
    found = [*(path for path in folders if any(path.rglob("test_*.py"))), *files]
    return sorted(str(path.relative_to(ROOT)) for path in found)


def _run(group: str, options: Options) -> tuple[int, str, list[str]]:
    """Run a group; return its exit status, its row, and its longest tests."""
    command = [sys.executable, "-m", "pytest", "-n", str(options.jobs), "--dist", "worksteal"]
    command += ["--seed", str(options.seed), "--scale", str(options.scale), "--durations", "8"]
    command += ["--deselect", ELSEWHERE]
    commit = _commit()
    lines, began = [], time.monotonic()
    with subprocess.Popen([*command, *_places(group)], cwd=ROOT, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            sys.stdout.write(line)
            sys.stdout.flush()
            lines.append(line.rstrip())
    closing = [line.strip("= ") for line in lines if re.search(r"\d+ (passed|failed)", line)]
    result = re.sub(r" in [\d.]+s.*", "", closing[-1]) if closing else "pytest did not finish"
    real = "yes" if os.environ.get("STOPPROOF_REAL_DATA") else "no"
    cells = [
        group,
        result,
        f"{(time.monotonic() - began) / 60.0:.1f}",
        f"{options.jobs} of {os.cpu_count()}",
        f"{options.seed}",
        f"{options.scale:g}",
        real,
        commit,
        f"{datetime.now(UTC):%Y-%m-%d %H:%M}",
    ]
    return run.returncode, f"| {' | '.join(cells)} |", [x for x in lines if re.match(r"\d+\.\d+s call", x)]


def _commit() -> str:
    """Return the commit of the tree; changes to the page itself do not count."""
    git = ["git", "-C", str(ROOT)]
    name = subprocess.run([*git, "describe", "--always"], capture_output=True, text=True, check=False)
    changed = subprocess.run(
        [*git, "status", "--porcelain", "--", ".", ":!docs/results"],
        capture_output=True,
        text=True,
        check=False,
    )
    return name.stdout.strip() + ("-dirty" if changed.stdout.strip() else "")


def _group_of(row: str) -> str:
    """Group that the file of a row belongs to."""
    if not row.endswith(".py"):
        return ""
    folder = row.split("/", maxsplit=1)[0]
    return folder if folder in GROUPS else "everything else"


def _write(group: str, row: str, slow: list[str], out: Path) -> None:
    """Put the row of a group into the page, and its longest tests; what stands there of others stays."""
    rows: dict[str, str] = {}
    longest: dict[str, str] = {}
    if out.exists():
        text = out.read_text(encoding="utf-8")
        found = [(line.split("|")[1].strip(), line) for line in text.splitlines() if line.startswith("| ")]
        rows = {each: line for each, line in found if each in GROUPS or each.endswith(".py")}
        rows = {each: line for each, line in rows.items() if _group_of(each) != group}
        longest = dict(re.findall(r"The longest tests of ([^\n]+):\n\n```\n(.*?)```", text, re.DOTALL))
    rows[group], longest[group] = row, "".join(f"{line}\n" for line in slow)
    order = [
        each for group_ in GROUPS for each in sorted(rows) if each == group_ or _group_of(each) == group_
    ]
    page = [*HEAD, *(rows[each] for each in order), ""]
    for each in order:
        if each in GROUPS:
            page += [f"The longest tests of {each}:", "", f"```\n{longest.get(each, '')}```", ""]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join(page), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
