"""One step of the supervisor: whole, by stage, with more people, beside a busy thread, and the naive way.

    python -m bench.step [--steps N] [--rounds N] [--json -]

Elapsed time of ``Supervisor.step`` on one core, reports already decoded. The percentiles are over all steps
of all rounds but the first one.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
import pinocchio
from numpy.typing import NDArray

from bench.closed_loop import panda_cell, steps, work
from bench.machine import describe_machine, keep_to_one_core
from bench.naive import NaiveCheck, moving_links
from bench.stopwatch import Stages, timed_stages
from failsafe.manoeuvre import VelocityProfile
from failsafe.plan import PlanResult
from failsafe.running_plan import RunningPlan
from failsafe.short_term_plan import ShortTermPlanner
from occupancy.engines import CoalEngine
from occupancy.humans.iso13855 import Iso13855
from occupancy.measurement import Gate
from occupancy.separation import Separation
from occupancy.swept import LinkOccupancy
from robots.catalog import RobotSetup, describe
from robots.motion import Block
from verifier.cell import Cell
from verifier.command import State
from verifier.cycle import CycleCheck, Known
from verifier.proposal import NewTrajectory
from verifier.rehearsal import rehearse
from verifier.setup import build_check, build_profile, build_robot
from verifier.supervisor import Supervisor
from verifier.verdict import Status, Verdict

Array = NDArray[np.float64]
SEED = 1
WARM_UP = 1000
COMPARED = 200
STAGES: Stages = {
    "gate": ((Gate, "admit"),),
    "plan": ((ShortTermPlanner, "follow"),),
    "  of it ruckig": ((VelocityProfile, "calculate"),),
    "sweep of links": ((LinkOccupancy, "occupy"),),
    "obligations": ((CycleCheck, "open_obligations"),),
    "occupancy of people": ((Iso13855, "occupy"),),
    "separation": ((Separation, "check"),),
    "command": ((RunningPlan, "motion"), (RunningPlan, "take"), (RunningPlan, "path_state")),
}


@dataclass(frozen=True, slots=True)
class Case:
    """One row of the table."""

    name: str
    people: int
    every: int
    all_models: bool = False
    busy: bool = False
    silence: bool = False
    stands_at_m: float | None = None

    def cell(self) -> Cell:
        """Return the cell of this row."""
        return panda_cell(all_models=self.all_models, silence=self.silence)


CASES = {
    "one_person": Case("1 person, report in every step", 1, 1),
    "one_person_60_hz": Case("1 person, report in every 16th step", 1, 16),
    "one_person_busy": Case("1 person, report in every step, a busy thread", 1, 1, busy=True),
    "silence": Case("1 person, report in every step, a robot that stops by itself", 1, 1, silence=True),
    "beside": Case("1 person beside whom the robot rests, report in every step", 1, 1, stands_at_m=0.5),
    "five_people": Case("5 people, all models, report in every step", 5, 1, all_models=True),
    "five_people_60_hz": Case("5 people, all models, report in every 16th step", 5, 16, all_models=True),
}


def main() -> None:
    """Measure, and print the tables or JSON."""
    options = _options()
    keep_to_one_core()
    began = time.perf_counter(), time.process_time()
    found: dict[str, Any] = {key: _measure(case, options) for key, case in CASES.items()}
    found["stages_us"] = _stages(options)
    found["naive"] = _naive(options, found["one_person"])
    share = (time.process_time() - began[1]) / (time.perf_counter() - began[0])
    found |= {"machine": describe_machine(), "share_of_core": share, "steps": options.steps}
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found, options)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.step", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--steps", type=int, default=12_000, help="steps in each round")
    parser.add_argument("--rounds", type=int, default=3, help="rounds that count")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    return parser.parse_args()


def _supervisor(cell: Cell) -> Supervisor:
    limits = build_robot(cell).limits
    path = work(limits, SEED)
    supervisor = Supervisor.from_cell(cell, path.sample(path.s_begin)[0])
    refusal = supervisor.propose(NewTrajectory(path))
    if refusal is not None:
        raise SystemExit(refusal.text)
    return supervisor


@contextmanager
def _counted() -> Iterator[list[int]]:
    """Count every call of the distance engine: those of all plans of a step, and of all models of people."""
    asked, propose = [0], CoalEngine.propose

    def counting(engine: CoalEngine, a: Array, b: Array) -> tuple[Array, float]:
        asked[0] += 1
        return propose(engine, a, b)

    with patch.object(CoalEngine, "propose", counting):
        yield asked


def _run(case: Case, count: int) -> tuple[Array, list[State], int]:
    """Return microseconds of each step, the states, and the most GJK calls in a step."""
    supervisor = _supervisor(case.cell())
    calls = list(steps(count + WARM_UP, case.people, case.every, SEED, case.stands_at_m))
    times, states, gjk = np.zeros(len(calls)), [], 0
    gc.collect()
    gc.disable()
    try:
        with _counted() as asked:
            for k, call in enumerate(calls):
                asked[0] = 0
                began = time.perf_counter_ns()
                command = supervisor.step(call.now, call.reports)
                times[k] = 1e-3 * (time.perf_counter_ns() - began)
                states.append(command.outcome)
                gjk = max(gjk, asked[0])
    finally:
        gc.enable()
    if supervisor.fault is not None:
        raise supervisor.fault
    return times[WARM_UP:], states[WARM_UP:], gjk


def _measure(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """Run a case in rounds, after a rehearsal."""
    cell = case.cell()
    path = work(build_robot(cell).limits, SEED)
    rehearse(cell, path.sample(path.s_begin)[0])
    with _busy_thread() if case.busy else ExitStack():
        runs = [_run(case, options.steps) for _ in range(options.rounds)]
    times = np.concatenate([run[0] for run in runs])
    states = [state for run in runs for state in run[1]]
    if case.stands_at_m is None and State.EXECUTING not in states:
        raise SystemExit(f"{case.name}: nothing was executed, so that nothing was measured")
    return {
        **{f"{name}_us": float(np.percentile(times, share)) for name, share in PERCENTILES.items()},
        "worst_us": float(times.max()),
        "executing": states.count(State.EXECUTING) / len(states),
        "failsafe": states.count(State.FAILSAFE) / len(states),
        "most_gjk_calls": max(run[2] for run in runs),
    }


PERCENTILES = {"median": 50.0, "p99": 99.0, "p999": 99.9}


@contextmanager
def _busy_thread() -> Iterator[None]:
    """Let a Python thread count as fast as it can while the block runs."""
    done = threading.Event()

    def count() -> None:
        number = 0
        while not done.is_set():
            number += 1

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    thread = threading.Thread(target=count, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        sys.setswitchinterval(interval)


def _stages(options: argparse.Namespace) -> dict[str, float]:
    """Microseconds per step by stage; the stopwatches themselves cost about 0.2 µs a call."""
    with timed_stages(STAGES) as seconds:
        times, _, _ = _run(CASES["one_person"], options.steps)
    share = (len(times) + WARM_UP) / len(times)
    stages = {name: 1e6 * value / (share * len(times)) for name, value in seconds.items()}
    stages["the rest"] = float(times.mean()) - sum(v for k, v in stages.items() if not k.startswith(" "))
    return stages


def _naive(options: argparse.Namespace, ours: dict[str, Any]) -> dict[str, Any]:
    """Put the naive check in the place of ours, on plans of the same run; answers must be the same."""
    cell = panda_cell()
    robot = build_robot(cell)
    whole = describe(robot.name, RobotSetup(bare_flange=True)).tree.model
    fingers = [number for number, name in enumerate(whole.names) if number and name not in robot.joints]
    arm = pinocchio.buildReducedModel(whole, fingers, pinocchio.neutral(whole))
    naive = NaiveCheck(arm, robot, build_profile(cell), cell.check.margin_m)
    taken = _taken(options)
    check = build_check(cell, robot, build_profile(cell), assume_nobody=False, gjk_limit=8)
    times: dict[str, list[float]] = {"ours": [], "naive": []}
    answers: list[tuple[Status, NDArray[np.bool_]]] = []
    for (
        t,
        plan,
        slices,
        known,
    ) in taken:  # all of ours first: the naive way leaves nothing of it in the caches
        began = time.perf_counter()
        answer = check.check_moving(t, plan, slices, known)
        times["ours"].append(time.perf_counter() - began)
        answers.append((answer.status, moving_links(check, slices, going_on=True)))
    for (t, _plan, slices, known), (status, moving) in zip(taken, answers, strict=True):
        began = time.perf_counter()
        apart = naive.separated(slices, known.people, moving)
        times["naive"].append(time.perf_counter() - began)
        if apart != (status is Status.VERIFIED):
            raise SystemExit(f"at t = {t:.3f} s ours says {status.name}, the naive way {apart}")
    separated = sum(status is Status.VERIFIED for status, _ in answers)
    check_us = {name: 1e6 * median(values) for name, values in times.items()}
    rest_us = ours["median_us"] - check_us["ours"]
    naive_us = rest_us + 1e6 * np.percentile(times["naive"], list(PERCENTILES.values()))
    return {
        **{f"{name}_us": float(value) for name, value in zip(PERCENTILES, naive_us, strict=True)},
        "check_us": check_us,
        "plans": len(taken),
        "separated": separated,
    }


def _taken(options: argparse.Namespace) -> list[tuple[float, PlanResult, Block, Known]]:
    """Return plans to go on of a run of one person for which pairs were compared, evenly spread."""
    kept: list[tuple[float, PlanResult, Block, Known]] = []
    original = CycleCheck.check_moving

    def check(self: CycleCheck, t: float, plan: PlanResult, slices: Block, known: Known) -> Verdict:
        answer = original(self, t, plan, slices, known)
        if self.nearest is not None and len(kept) < options.steps:
            kept.append((t, plan, slices.copy(), known._replace(people=known.people.copy())))
        return answer

    with patch.object(CycleCheck, "check_moving", check):
        _run(CASES["one_person"], options.steps)
    return [kept[int(i)] for i in np.linspace(0, len(kept) - 1, min(COMPARED, len(kept)))]


def _lines(found: dict[str, Any], options: argparse.Namespace) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; {options.rounds} rounds of {options.steps} steps"
    yield f"elapsed time; the core was there for {100.0 * found['share_of_core']:.0f} % of it"
    yield ""
    columns = ("median", "99 %", "99.9 %", "worst", "executing", "failsafe", "GJK calls")
    yield from _row("one step, µs", columns, rule=True)
    for key, case in CASES.items():
        row = found[key]
        values = [f"{row[name]:.0f}" for name in ("median_us", "p99_us", "p999_us", "worst_us")]
        values += [f"{100.0 * row['executing']:.0f} %", f"{100.0 * row['failsafe']:.0f} %"]
        yield from _row(case.name, [*values, f"≤ {row['most_gjk_calls']}"])
    naive = found["naive"]
    values = [f"{naive[name]:.0f}" for name in ("median_us", "p99_us", "p999_us")]
    yield from _row("1 person, the naive way", [*values, "", "", "", ""])
    ratio = naive["median_us"] / found["one_person"]["median_us"]
    yield from _row("**naive / ours**", [f"{ratio:.0f}", *[""] * 6])
    yield ""
    check, plans = naive["check_us"], naive["plans"]
    yield f"check of one plan: ours {check['ours']:.1f} µs, naive {check['naive']:.0f} µs"
    yield f"same answer for {plans} of {plans} plans, {naive['separated']} of them separated"
    yield ""
    yield from _row("stage of one step, µs", ("mean",), rule=True)
    for name, value in found["stages_us"].items():
        yield from _row(name, (f"{value:.1f}",))


def _row(label: str, values: Any, *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<60} | " + " | ".join(f"{value:>9}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 62}|" + "|".join("-" * 10 + ":" for _ in values) + "|"


if __name__ == "__main__":
    main()
