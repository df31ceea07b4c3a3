"""Time per cycle by stage, the real-time factor, and the naive way beside it.

    python -m bench.replay [--cycles N] [--rounds N] [--json -]

Everything is measured in one process on one core, the ways to be compared in turns; shown are medians over
the rounds. Times are processor time: on an idle machine the same as elapsed time, and elsewhere what it would
be. Reading and decoding the recording is apart.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from bench.machine import describe_machine, keep_to_one_core
from bench.naive import NaiveCheck, moving_links
from bench.recordings import DEMO_CELL, write_stretch
from bench.stopwatch import PART_OF_PLAN, processor_time, timed_stages
from failsafe.plan import PlanResult
from robots.catalog import RobotSetup, describe, load_tool
from robots.motion import Block
from verifier.cell import Cell
from verifier.cycle import CycleCheck, Known
from verifier.recordings import Reading, Recording
from verifier.replay import verify
from verifier.section import LEAD_S, TAIL_S, WINDOW_S
from verifier.setup import build_check, build_profile, build_robot
from verifier.verdict import Status, Verdict

PEOPLE = (1, 5)
CYCLES_S = (0.01, 0.001)
COMPARED = 200
"""Plans that both ways check."""
REST = "the rest"
TOLERANCE_M = 1e-4
"""A gap this near to the margin may be judged differently: the certificate gives away less than that."""


@dataclass(frozen=True, slots=True)
class Case:
    """One recording at one cycle."""

    name: str
    recording: Path
    people: int
    cell: Cell


@dataclass(frozen=True, slots=True)
class Taken:
    """What one cycle was asked and what it answered."""

    t: float
    plan: PlanResult
    slices: Block
    known: Known
    moving: NDArray[np.bool_]
    verdict: Verdict


def main() -> None:
    """Measure, and print the tables or JSON."""
    options = _options()
    keep_to_one_core()
    began = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder, processor_time():
        cases = list(_cases(Path(folder), options.cycles))
        for case in cases:
            verify(case.recording, case.cell)  # compiles what is not compiled yet
        results = {case.name: _measure(case, options.rounds) for case in cases}
    share = (time.process_time() - began[1]) / (time.perf_counter() - began[0])
    found = {
        "machine": describe_machine(),
        "rounds": options.rounds,
        "share_of_core": share,
        "cases": results,
    }
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.replay", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--cycles", type=int, default=6000, help="at most this many cycles in each case")
    parser.add_argument("--rounds", type=int, default=5, help="medians over this many rounds")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    return parser.parse_args()


def _cases(folder: Path, cycles: int) -> Iterator[Case]:
    cell = Cell.from_toml(DEMO_CELL)
    for cycle_s in CYCLES_S:
        for people in PEOPLE:
            path = folder / f"{people}_{cycle_s}.mcap"
            write_stretch(path, people, cycles * cycle_s)
            name = f"{people} {'person' if people == 1 else 'people'}, {1e3 * cycle_s:g} ms"
            yield Case(name, path, people, cell.model_copy(update={"cycle_s": cycle_s}))


def _measure(case: Case, rounds: int) -> dict[str, Any]:
    taken, check = _taken(case), _check(case.cell)
    naive = _naive(case.cell)
    ways: dict[str, Callable[[Taken], bool]] = {
        "ours": lambda it: check.check(it.t, it.plan, it.slices, it.known).status is Status.VERIFIED,
        "naive": lambda it: naive.separated(it.slices, it.known.people, it.moving),
        "naive_with_managers": lambda it: naive.separated_by_managers(it.slices, it.known.people, it.moving),
    }
    whole, stages, compared, decoding = [], [], [], []
    answers: dict[str, list[bool]] = {}
    for _ in range(rounds):
        report = verify(case.recording, case.cell)
        whole.append(1e6 * case.cell.cycle_s / report.real_time_factor)
        stages.append(_stages(case))
        decoding.append(1e6 * _decoding_s(case) / report.cycles)
        times = {}
        for way, ask in ways.items():
            times[way], answers[way] = _time(ask, taken)
        compared.append(times)
    cycle_us = median(whole)
    stages_us = {name: median(each[name] for each in stages) for name in stages[0]}
    stages_us[REST] = cycle_us - sum(value for name, value in stages_us.items() if name != PART_OF_PLAN)
    check_us = {way: median(times[way] for times in compared) for way in ways}
    return {
        "cycles": report.cycles,
        "counts": {status.name.lower(): report.count(status) for status in Status},
        "cycle_us": cycle_us,
        "real_time_factor": 1e6 * case.cell.cycle_s / cycle_us,
        "decoding_us": median(decoding),
        "stages_us": stages_us,
        "compared_plans": len(taken),
        "slices_per_plan": float(np.mean([int(it.slices["n"][0]) for it in taken])),
        "check_us": check_us,
        "naive_over_ours": check_us["naive"] / check_us["ours"],
        "managers_over_ours": check_us["naive_with_managers"] / check_us["ours"],
        "cycle_naive_over_ours": (cycle_us - check_us["ours"] + check_us["naive"]) / cycle_us,
        "agreement": _agreement(case, taken, answers, naive),
    }


def _stages(case: Case) -> dict[str, float]:
    """Microseconds per cycle by stage."""
    with timed_stages() as seconds:
        report = verify(case.recording, case.cell)
    return {name: 1e6 * value / report.cycles for name, value in seconds.items()}


def _decoding_s(case: Case) -> float:
    """Seconds for reading and decoding the recording."""
    recording = Recording(case.recording)
    reading = Reading(recording, build_robot(case.cell).joints)
    for _ in reading.windows(WINDOW_S, LEAD_S, TAIL_S):
        pass
    return reading.decode_seconds


def _time(ask: Callable[[Taken], bool], taken: list[Taken]) -> tuple[float, list[bool]]:
    """Return microseconds per plan, and the answers."""
    began = time.perf_counter()
    answers = [ask(it) for it in taken]
    return 1e6 * (time.perf_counter() - began) / len(taken), answers


def _taken(case: Case) -> list[Taken]:
    """Return plans of the recording for which pairs were compared, evenly spread."""
    kept: list[Taken] = []
    with _kept(kept):
        verify(case.recording, case.cell)
    return [kept[int(i)] for i in np.linspace(0, len(kept) - 1, min(COMPARED, len(kept)))]


@contextmanager
def _kept(kept: list[Taken]) -> Iterator[None]:
    """Keep what every check with people is asked and answers, while the block runs."""
    original = CycleCheck.check

    def check(self: CycleCheck, t: float, plan: PlanResult, slices: Block, known: Known) -> Verdict:
        verdict = original(self, t, plan, slices, known)
        if self.nearest is not None:
            moving = moving_links(self, slices)
            kept.append(
                Taken(t, plan, slices.copy(), known._replace(people=known.people.copy()), moving, verdict)
            )
        return verdict

    with patch.object(CycleCheck, "check", check):
        yield


def _check(cell: Cell) -> CycleCheck:
    return build_check(cell, build_robot(cell), build_profile(cell), assume_nobody=False)


def _naive(cell: Cell) -> NaiveCheck:
    robot = build_robot(cell)
    tool = None if cell.robot.tool is None else load_tool(cell.robot.tool)
    arm = describe(robot.name, RobotSetup(tool=tool)).tree.model
    return NaiveCheck(arm, robot, build_profile(cell), cell.check.margin_m)


def _agreement(
    case: Case, taken: list[Taken], answers: dict[str, list[bool]], naive: NaiveCheck
) -> dict[str, Any]:
    """Compare the answers; every difference must be a gap next to the margin.

    Raises
    ------
    SystemExit
        The ways differ by more than the certificate gives away.
    """
    margin, differences = case.cell.check.margin_m, 0
    for i, it in enumerate(taken):
        told = {answers[way][i] for way in answers}
        if len(told) == 1:
            continue
        differences += 1
        gap = naive.smallest_gap(it.slices, it.known.people, it.moving)
        if not abs(gap - margin) <= TOLERANCE_M:
            raise SystemExit(
                f"{case.name}: at t = {it.t:.3f} s the answers differ, but the gap is {gap:.6f} m"
            )
    return {
        "plans": len(taken),
        "separated": sum(answers["ours"]),
        "same": len(taken) - differences,
        "gap_next_to_margin": differences,
    }


def _lines(found: dict[str, Any]) -> Iterator[str]:
    machine, cases = found["machine"], found["cases"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; medians of {found['rounds']} rounds"
    yield f"processor time; the core was there for {100.0 * found['share_of_core']:.0f} % of the elapsed time"
    yield ""
    yield from _row("µs per cycle", list(cases), rule=True)
    for name in next(iter(cases.values()))["stages_us"]:
        label = f"  {name}" if name == PART_OF_PLAN else name
        yield from _row(label, [f"{case['stages_us'][name]:.1f}" for case in cases.values()])
    for label, key, form in (
        ("**cycle**", "cycle_us", "{:.0f}"),
        ("**real-time factor**", "real_time_factor", "{:.1f}"),
        ("decoding, apart", "decoding_us", "{:.1f}"),
        ("cycles", "cycles", "{}"),
    ):
        yield from _row(label, [form.format(case[key]) for case in cases.values()])
    yield ""
    yield from _row("check of one plan, µs", list(cases), rule=True)
    for label, way in (
        ("ours", "ours"),
        ("naive: pair by pair", "naive"),
        ("naive: coal's managers", "naive_with_managers"),
    ):
        yield from _row(label, [f"{case['check_us'][way]:.0f}" for case in cases.values()])
    for label, key in (
        ("**naive / ours**", "naive_over_ours"),
        ("managers / ours", "managers_over_ours"),
        ("whole cycle, naive / ours", "cycle_naive_over_ours"),
    ):
        yield from _row(label, [f"{case[key]:.0f}" for case in cases.values()])
    yield from _row("slices of a plan", [f"{case['slices_per_plan']:.1f}" for case in cases.values()])
    yield from _row(
        "same answer",
        [f"{case['agreement']['same']} of {case['agreement']['plans']}" for case in cases.values()],
    )
    yield from _row("  of them separated", [f"{case['agreement']['separated']}" for case in cases.values()])


def _row(label: str, values: list[str], *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<26} | " + " | ".join(f"{value:>16}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 28}|" + "|".join("-" * 17 + ":" for _ in values) + "|"


if __name__ == "__main__":
    main()
