"""Let people who want a contact run against the supervisor, and print what came of it.

python -m tests.adversary [--cycles N] [--seed S] [--jobs J] [--robot NAME]... [--out FILE]

A run of all arms with all cycles is written to docs/results/; a shorter one only where --out says so.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tests.full import _commit
from tests.soundness.adversary import CYCLES, CYCLES_IN_ALL, Total, one_run
from tests.soundness.adversary_arm import ROBOTS
from tests.soundness.adversary_truth_kernels import BINS, NEAR_M
from verifier.command import Cause, State

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "results" / "adversary.md"
LEAST_SHARE = 0.1
"""Less of the time in EXECUTING or FAILSAFE, of all arms together, is no test."""
QUANTITY = ("velocity", "acceleration", "jerk", "position", "continuity")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=CYCLES_IN_ALL)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--out", type=Path, help=f"page to write; of a whole run {PAGE.relative_to(ROOT)}")
    given = parser.parse_args(arguments)
    if not (given.seed >= 0 and given.cycles > 0 and given.jobs > 0):
        parser.error("--seed must be at least 0, --cycles and --jobs above 0")
    robots = tuple(given.robot or ROBOTS)
    began, commit = time.monotonic(), _commit()
    totals = _all_runs(robots, given.seed, given.cycles, given.jobs)
    seconds = time.monotonic() - began
    whole = Total()
    for total in totals.values():
        whole.add(total)
    command = f"python -m tests.adversary --cycles {given.cycles} --seed {given.seed} --jobs {given.jobs}"
    if given.robot:
        command += "".join(f" --robot {name}" for name in robots)
    page = _page(command, commit, seconds, given.jobs, totals, whole)
    sys.stdout.write(page)
    out = given.out or (PAGE if robots == ROBOTS and given.cycles >= CYCLES_IN_ALL else None)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page, encoding="utf-8")
    for failure in whole.failures[:20]:
        sys.stderr.write(failure + "\n")
    shares = (whole.share(State.EXECUTING), whole.share(State.FAILSAFE))
    if not (min(whole.nearest) < NEAR_M and min(shares) > LEAST_SHARE):
        sys.stderr.write("vacuous: nobody came near, or the robot hardly moved or hardly ever had to stop\n")
        return 1
    return int(bool(whole.failures))


def _all_runs(robots: tuple[str, ...], seed: int, cycles: int, jobs: int) -> dict[str, Total]:
    """Let the arms take turns, run after run, until there are enough cycles."""
    runs = max(1, cycles // (CYCLES * len(robots)))
    totals = {robot: Total() for robot in robots}
    tasks = [(robot, seed, number) for number in range(runs) for robot in robots]
    if jobs == 1:
        for robot, of, number in tasks:
            totals[robot].add(one_run(robot, of, number))
        return totals
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(one_run, *task): task[0] for task in tasks}
        for done in as_completed(waiting):
            totals[waiting.pop(done)].add(done.result())
    return totals


def _page(
    command: str, commit: str, seconds: float, jobs: int, totals: dict[str, Total], whole: Total
) -> str:
    """The page with the results."""
    rows = [*totals.items(), ("all", whole)] if len(totals) > 1 else list(totals.items())
    lines = [
        "# People who want a contact",
        "",
        f"`{command}`: commit {commit}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, {seconds / 60.0:.1f} minutes"
        f" on {jobs} of {os.cpu_count()} cores, {whole.cycles / seconds:.0f} cycles/s.",
        "",
        "The supervisor's loop is closed by people who keep to the assumptions and go for the arm, by",
        "sensors and a robot that err as far as the cell declares, and by a planner that wants a lot. Beside",
        "it the true motion is computed by an oracle of its own (`tests/soundness/adversary.py`).",
        "",
        "| arm | runs | cycles | with contact | beyond a limit | nearest, mm | runs without approach |"
        + "".join(f" {state.name} |" for state in State),
        "|---|" + "---|" * (6 + len(State)),
    ]
    for name, total in rows:
        lines.append(
            f"| {name} | {total.runs} | {total.cycles} | {total.contacts} | {int(total.excess.sum())} "
            f"| {min(total.nearest) * 1e3:.2f} | {total.vacuous} |"
            + "".join(f" {total.share(state):.1%} |" for state in State)
        )
    lines += [
        "",
        "*With contact*: cycles in which a link that moves touches somebody. *Without approach*: runs in",
        "which nobody came within 50 mm of a moving link.",
        "",
        "Nearest approach to a moving link:",
        "",
        "| up to, m | cycles | runs |",
        "|---|---|---|",
    ]
    edges = np.concatenate([[-np.inf], BINS])
    runs, _ = np.histogram(np.minimum(whole.nearest, 1e9), np.append(edges[:-1] + 1e-300, 1e10))
    for upper, cycles, number in zip(BINS, whole.histogram, runs, strict=True):
        lines.append(f"| {'more' if np.isinf(upper) else f'{upper:g}'} | {cycles} | {number} |")
    shares = ", ".join(
        f"{name} {worst:.4f}" for name, worst in zip(QUANTITY, whole.worst, strict=True) if name != "position"
    )
    causes = ", ".join(f"{cause.name} {whole.causes[cause]}" for cause in Cause if whole.causes[cause])
    events = ", ".join(f"{name} {number}" for name, number in sorted(whole.events.items()))
    lines += ["", f"Largest share of a limit that was used: {shares}.", "", f"Causes: {causes}.", ""]
    lines += [
        f"Events: {events}. *reading refused*: joints that were where they may be, but not where the monitor",
        f"of tracking looks for them; the farthest was {whole.refused_by:.2g} rad off.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
