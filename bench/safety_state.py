"""What a safety state costs whoever asks, beside one step of the supervisor.

    python -m bench.safety_state [--steps N] [--json -]

A Panda at 1 kHz and one person as in ``bench.step``; every 20th step somebody asks, in the same thread,
between two steps. Elapsed time on one core; a dry run is with its preparation.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.closed_loop import panda_cell, steps, work
from bench.machine import describe_machine, keep_to_one_core
from failsafe.waypoints import rest_to_rest
from verifier.cell import Cell
from verifier.command import State
from verifier.proposal import NewTrajectory
from verifier.safety_state import ProbeSettings, SafetyProbe, look
from verifier.setup import build_robot
from verifier.supervisor import Supervisor

SEED, WARM_UP, EVERY = 1, 400, 20
ROWS = {
    "step": "one step of the supervisor",
    "look": "copies of what the next step begins with",
    "free": "safety state, nothing to slow down for",
    "slowed": "safety state, slowed or not verified",
    "dry_run": "dry run of a trajectory, for each place",
}


def main() -> None:
    """Measure, and print the table or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.safety_state")
    parser.add_argument("--steps", type=int, default=12_000, help="steps of the supervisor")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    keep_to_one_core()
    _measure(WARM_UP)  # compiles
    times = _measure(options.steps + WARM_UP)
    found: dict[str, Any] = {"machine": describe_machine(), "steps": options.steps}
    for key, values in times.items():
        low, middle, high = np.percentile(values, [0.0, 50.0, 99.0]) if values else [np.nan] * 3
        found[key] = {
            "count": len(values), "least_us": float(low), "median_us": float(middle), "p99_us": float(high)
        }  # fmt: skip
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found)))


def _measure(count: int) -> dict[str, list[float]]:
    """Return microseconds of everything, the first calls left out."""
    cell = panda_cell()
    supervisor, probe = _supervisor(cell)
    limits = supervisor.check.robot.limits
    low, high = limits.position_lower, limits.position_upper
    other = rest_to_rest([0.6 * low + 0.4 * high, 0.4 * low + 0.6 * high], limits, share=0.5)
    times: dict[str, list[float]] = {key: [] for key in ROWS}

    def timed(key: str, function: Any, *arguments: Any) -> Any:
        began = time.perf_counter_ns()
        answer = function(*arguments)
        times[key].append(1e-3 * (time.perf_counter_ns() - began))
        return answer

    executed = 0
    gc.collect()
    gc.disable()
    try:
        for k, call in enumerate(steps(count, 1, 16, SEED)):
            executed += timed("step", supervisor.step, call.now, call.reports).outcome is State.EXECUTING
            if k % EVERY == EVERY - 1:
                outlook = timed("look", look, supervisor)
                state = timed("free", probe.state, outlook)
                if state.allowed_path_speed != 1.0 or state.refused is not None:
                    times["slowed"].append(times["free"].pop())
            if k % 200 == 199:
                began = time.perf_counter_ns()
                run = probe.would_verify(look(supervisor), other)
                if run.places > 1:
                    times["dry_run"].append(1e-3 * (time.perf_counter_ns() - began) / run.places)
    finally:
        gc.enable()
    if supervisor.fault is not None:
        raise supervisor.fault
    if not executed:
        raise SystemExit("nothing was executed, so that nothing was measured")
    return {key: values[WARM_UP // EVERY if key != "dry_run" else 0 :] for key, values in times.items()}


def _supervisor(cell: Cell) -> tuple[Supervisor, SafetyProbe]:
    robot = build_robot(cell)
    path = work(robot.limits, SEED)
    supervisor = Supervisor.from_cell(cell, path.sample(path.s_begin)[0])
    refusal = supervisor.propose(NewTrajectory(path))
    if refusal is not None:
        raise SystemExit(refusal.text)
    return supervisor, SafetyProbe.from_cell(cell, ProbeSettings(), robot)


def _lines(found: dict[str, Any]) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; {found['steps']} steps"
    yield ""
    yield from _row("µs", ("median", "99 %", "least", "/ step", "count"), rule=True)
    step = found["step"]["median_us"]
    for key, name in ROWS.items():
        row = found[key]
        values = [f"{row[each]:.0f}" for each in ("median_us", "p99_us", "least_us")]
        yield from _row(name, [*values, f"{row['median_us'] / step:.1f}", str(row["count"])])


def _row(label: str, values: Any, *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<42} | " + " | ".join(f"{value:>7}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 44}|" + "|".join("-" * 8 + ":" for _ in values) + "|"


if __name__ == "__main__":
    main()
