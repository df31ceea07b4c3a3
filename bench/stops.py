"""Path-consistent stops: share of states with one, duration, time to find it, and the conservative budget.

    python -m bench.stops [--states N] [--seed N] [--recording FILE.npz --robot NAME]

Random states are those of the tests: curved paths, s̈ ≠ 0, near the limits, and rough (cubic) paths. A
recording adds the states at every 10 ms of it.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.machine import describe_machine, keep_to_one_core
from failsafe import path_kernels
from failsafe.manoeuvre import PathManoeuvre
from failsafe.plan import PlanOutcome, PlanSettings, StopKind
from failsafe.scaling import PathState, conservative_budget
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, fit_samples
from robots.catalog import RobotSetup, load_robot
from robots.limits import JointLimits
from tests.failsafe.motions import KINDS, random_cases

CYCLE_S = 0.01

State = tuple[JointLimits, IntendedTrajectory, PathState]


@dataclass
class Tally:
    """What became of the states of one kind; durations in seconds, NaN without a stop."""

    search: list[float] = field(default_factory=list)
    budget: list[float] = field(default_factory=list)
    candidates: list[int] = field(default_factory=list)
    fallback: int = 0
    plan_s: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        search, budget = np.array(self.search), np.array(self.budget)
        both = np.isfinite(search) & np.isfinite(budget)
        ratio = budget[both] / search[both]
        microseconds = 1e6 * np.array(self.plan_s)
        return (
            f"| {name} | {len(search)} | {_percent(np.isfinite(search))} | {_percent(np.isfinite(budget))} "
            f"| {1e3 * np.nanmedian(search):.0f} | {np.median(ratio):.2f} | {np.percentile(ratio, 90):.2f} "
            f"| {np.percentile(ratio, 99):.2f} | {self.fallback} | {np.mean(self.candidates):.2f} "
            f"| {np.median(microseconds):.0f} | {np.percentile(microseconds, 99):.0f} |"
        )


def _percent(share: NDArray[np.bool_]) -> str:
    return f"{100.0 * share.mean():.2f} %"


HEAD = (
    "| states | number | with a stop | with a budget | stop, median ms | budget / stop, median | 90 % | 99 % "
    "| left the path | candidates | plan, median µs CPU | 99 % |\n" + "|---" * 12 + "|"
)


def tally(states: Iterator[State]) -> Tally:
    """Search and budget for each state from which the intended piece keeps the limits."""
    result = Tally()
    for limits, trajectory, state in states:
        n = len(limits.joints)
        finder = PathManoeuvre(limits, steps=12, step_s=0.01, positions=True)
        path_kernels.begin_path(finder.path, *state, 1e-3)
        if not finder.proven(trajectory, finder.path, 0):
            continue
        result.search.append(_duration(finder) if finder.search(trajectory, 0, state, 0.0) else math.nan)
        result.candidates.append(finder.candidates)
        budget = conservative_budget(trajectory, limits, state)
        found = budget is not None and finder.candidate(trajectory, 0, state, 0.0, *budget)
        result.budget.append(_duration(finder) if found else math.nan)
        zeros = np.zeros(n)
        planner = ShortTermPlanner(limits, PlanSettings(CYCLE_S, (0.0, 0.0), zeros, zeros))
        begin = time.thread_time()
        plan = planner.plan(trajectory, 0.0, *state)
        result.plan_s.append(time.thread_time() - begin)
        result.fallback += plan.outcome is PlanOutcome.READY and plan.stop is StopKind.JOINT_SPACE
    return result


def _duration(finder: PathManoeuvre) -> float:
    record = finder.path[0]
    return float(record["t"][record["n"]])


def _random(kind: str, count: int, seed: int) -> Iterator[State]:
    for case in random_cases(np.random.default_rng(seed), kind, count):
        yield case.limits, case.motion.trajectory, case.state


def _recorded(file: Path, robot: str) -> Iterator[State]:
    with np.load(file) as data:
        trajectory = fit_samples(data["t"], data["q"].astype(float)).trajectory
    limits = load_robot(robot, setup=RobotSetup(bare_flange=True)).limits
    for s in np.arange(trajectory.s_begin, trajectory.s_end - 0.5, 0.01):
        yield limits, trajectory, PathState(float(s), 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=2000, help="random states of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recording", type=Path, help="NPZ with t, q")
    parser.add_argument("--robot", help="whose limits hold for the recording")
    options = parser.parse_args()
    if (options.recording is None) != (options.robot is None):
        parser.error("--recording and --robot belong together")
    keep_to_one_core()
    for name, value in describe_machine().items():
        print(f"{name}: {value}")
    print(f"\nseed {options.seed}, one core, cycle {CYCLE_S} s\n\n{HEAD}")
    tally(_random("curved", 20, 0))  # compiles
    for kind in KINDS:
        print(tally(_random(kind, options.states, options.seed)).row(kind.replace("_", " ")), flush=True)
    if options.recording is not None:
        print(tally(_recorded(options.recording, options.robot)).row(options.recording.stem))


if __name__ == "__main__":
    main()
