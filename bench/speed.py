"""How long a decision of the speed alteration takes, beside the same in plain NumPy and SciPy.

    python -m bench.speed [--decisions N] [--json -]

*Scene*: the decisions of the paper's first simulation, one ball each of robot and hand, for which the paper
needs 85 ms (i5, 2.7 GHz). *Arm*: all links of a Panda against the upper bodies of two people. Pairs are made
ready, and a speed is chosen. Elapsed time on one core; medians. The naive rows find the same speed: the
genetic algorithm in NumPy, generation by generation, and SciPy's bounded scalar search from 50 starts.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bench.machine import describe_machine, keep_to_one_core
from modes.speed.bodies import BodyEllipsoids, LinkEllipsoids
from modes.speed.danger_index import Ellipsoids, Index, pair_quadratics
from modes.speed.exact import exact_speed
from modes.speed.genetic import GeneticSettings, evolve
from modes.speed.objective import Goal
from modes.speed.simulations import BALL_ABOVE_FLANGE_M, RADIUS_M, Choice, run, simulation
from occupancy.body import MAX_POINTS, Point, load_profile
from robots.catalog import RobotSetup, load_robot

Array = NDArray[np.float64]
Make = Callable[[], Array]

_PAPER_MS = 85.0
_STARTS = 50
_CAP = 0.25


def main() -> None:
    """Measure, and print the table or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.speed")
    parser.add_argument("--decisions", type=int, default=2000, help="decisions of each kind")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    keep_to_one_core()
    found: dict[str, Any] = {"machine": describe_machine(), "decisions": options.decisions}
    for name, decisions in (("scene", _scene()), ("arm", _arm())):
        found[name] = _measure(decisions, options.decisions)
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print(f"{found['machine']['processor']}, {options.decisions} decisions", "", *_lines(found), sep="\n")


def _scene() -> list[tuple[Make, Goal]]:
    """Return the decisions of simulation 1."""
    scene, met = simulation(1), run(simulation(1), Choice("proposed"))
    decisions = []
    for k in range(1, len(met.speed)):
        robot = Ellipsoids.balls(met.place[k][None], RADIUS_M)
        body = Ellipsoids.balls(2.0 * scene.hands[k] - scene.hands[k - 1], RADIUS_M)
        previous = float(met.speed[k - 1])
        per_speed = np.array([[0.0, 0.1, 0.0]])
        decisions.append((_made(robot, per_speed, body, previous, "transformed"), Goal(0.05, previous)))
    assert BALL_ABOVE_FLANGE_M > 0.0
    return decisions


def _arm() -> list[tuple[Make, Goal]]:
    """Return decisions of a Panda with two people near it."""
    rng = np.random.default_rng(1)
    robot = load_robot("panda", setup=RobotSetup(bare_flange=True))
    links, bodies = LinkEllipsoids(robot), BodyEllipsoids(load_profile("iso"))
    decisions = []
    for _ in range(64):
        q = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]) + rng.uniform(-0.3, 0.3, 7)
        arm = links.at(q, rng.uniform(-0.3, 0.3, 7))
        xyz = rng.uniform(-0.2, 0.2, (2, MAX_POINTS, 3)) + np.array([[[0.9, 0.0, 0.6]], [[0.0, 1.0, 0.5]]])
        xyz[:, Point.PELVIS] -= (0.0, 0.0, 0.4)
        per_speed = arm.per_path * (0.1 / arm.speed_per_path)
        goal = Goal(arm.speed_per_path, 0.5 * arm.speed_per_path, max(_CAP, arm.speed_per_path))
        decisions.append((_made(arm.links, per_speed, bodies.around(xyz), goal.previous, "exact"), goal))
    return decisions


def _made(robot: Ellipsoids, per_speed: Array, body: Ellipsoids, at: float, index: Index) -> Make:
    return lambda: pair_quadratics(robot, per_speed, body, at, index)


def _measure(decisions: list[tuple[Make, Goal]], count: int) -> dict[str, Any]:
    """Return the median and 99th percentile of each way to decide [µs], and the naive ones."""
    rng = np.random.default_rng(2)
    ways: dict[str, tuple[Callable[[Array, Goal], float], int]] = {
        "exact": (exact_speed, count),
        "genetic": (lambda pairs, goal: evolve(pairs, goal, rng).speed, max(count // 4, 8)),
        "naive_exact": (_naive_exact, max(count // 100, 4)),
        "naive_genetic": (lambda pairs, goal: _naive_genetic(pairs, goal, rng), max(count // 100, 4)),
    }
    found: dict[str, Any] = {"pairs": len(decisions[0][0]())}
    for way, (choose, n) in ways.items():
        times = []
        for k in range(n + 8):
            make, goal = decisions[k % len(decisions)]
            began = time.perf_counter()
            choose(make(), goal)
            times.append(1e6 * (time.perf_counter() - began))
        middle, high = np.percentile(times[8:], [50.0, 99.0])
        found[way] = {"median_us": float(middle), "p99_us": float(high), "worst_us": float(max(times[8:]))}
    apart = [abs(exact_speed(m(), g) - _naive_exact(m(), g)) for m, g in decisions[:8]]
    found["naive_apart_mm_s"] = 1e3 * float(np.median(apart))
    return found


def _values(pairs: Array, goal: Goal, v: Array) -> Array:
    w = goal.weights
    bare = w.closeness * (v - goal.programmed) ** 2 + w.smoothness * (v - goal.previous) ** 2
    f = np.maximum(pairs[:, 0, None] + v * (pairs[:, 1, None] + v * pairs[:, 2, None]), 1e-12).min(axis=0)
    return np.asarray(bare / goal.programmed**2 + np.where(f > 1.0, 0.0, w.penalty / f**2))


def _naive_exact(pairs: Array, goal: Goal) -> float:
    edges = np.linspace(-goal.cap, goal.cap, _STARTS + 1)
    tried = [
        minimize_scalar(
            lambda v: float(_values(pairs, goal, np.array([v]))[0]), bounds=ends, method="bounded"
        )
        for ends in pairwise(edges)
    ]
    return float(min(tried, key=lambda each: each.fun).x)


def _naive_genetic(pairs: Array, goal: Goal, rng: np.random.Generator) -> float:
    settings = GeneticSettings()
    n = settings.population
    people = rng.uniform(-goal.cap, goal.cap, n)
    value = _values(pairs, goal, people)
    for _ in range(settings.generations):
        order = people[np.argsort(value, kind="stable")]
        u = rng.random((n, 6))
        first = order[np.minimum((n * (1.0 - np.sqrt(1.0 - u[:, 0]))).astype(int), n - 1)]
        second = order[(n * u[:, 1]).astype(int)]
        child = np.where(u[:, 2] < settings.crossover, u[:, 3] * first + (1.0 - u[:, 3]) * second, first)
        child = np.where(u[:, 4] < settings.mutation, goal.cap * (2.0 * u[:, 5] - 1.0), child)
        people = np.append(order[:2], child[2:])
        value = _values(pairs, goal, people)
    return float(people[np.argmin(value)])


def _lines(found: dict[str, Any]) -> list[str]:
    lines = [
        "| decision | pairs | median, µs | 99 %, µs | worst, µs | naive, µs | naive / ours | paper / ours |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for name in ("scene", "arm"):
        each = found[name]
        for way in ("exact", "genetic"):
            ours, naive = each[way], each[f"naive_{way}"]["median_us"]
            paper = f"{1e3 * _PAPER_MS / ours['median_us']:.0f}" if name == "scene" else ""
            lines.append(
                f"| {name}, {way} | {each['pairs']} | {ours['median_us']:.1f} | {ours['p99_us']:.1f} | "
                f"{ours['worst_us']:.1f} | {naive:.0f} | {naive / ours['median_us']:.0f} | {paper} |"
            )
    return lines


if __name__ == "__main__":
    main()
