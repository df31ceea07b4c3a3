"""How long a path among people takes to plan, beside OMPL; how long its motion takes, beside toppra.

    python -m bench.planning [--trials N] [--star-s S] [--longer-s S] [--json -]

*Trials*: those of ``modes/planning/scenes.py``, a UR16e between two fixed places, 11 frames of one or two
people in all of which 250 mm are kept. The paper needs 0.6 to 5.0 s, with a GPU. Processor time of one core,
from the question to the shortened path. OMPL is asked the same: goals, longest edge, and the same proof of
edges by the same kernel, called through Python as ours is; its samples are even, it only leaves out corners
that are not needed, and it draws anew in each run. RRT* uses up its time. Where our planner finds no path,
OMPL's RRTConnect looks for one ``--longer-s`` long. Lengths are of trials in which all but RRT* find a path.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.machine import describe_machine, keep_to_one_core
from bench.ompl_planning import is_installed, ompl_plan
from modes.planning.arrt import VARIANTS, NoPath, Planner, PlannerSettings
from modes.planning.clear_motion import plan_motion
from modes.planning.motion import ROUNDING_RAD, RoundedPath, apart, motion_along
from modes.planning.potential_field import Bodies, Field
from modes.planning.scenes import ROBOT, Scene, scenes
from modes.planning.torch_field import potentials
from occupancy.body import load_profile
from robots.catalog import RobotSetup, load_robot

Array = NDArray[np.float64]
Trial = tuple[Scene, Bodies]

_PAPER_S = "0.6 to 5.0 s"
_SHARE = 0.75
_STAR = "OMPL RRTstar"
_CONFIGURATIONS = 1000


def main() -> None:
    """Measure, and print the tables or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.planning")
    parser.add_argument("--trials", type=int, default=50, help="how many scenes")
    parser.add_argument("--star-s", type=float, default=1.0, help="how long RRT* of OMPL looks [s]")
    parser.add_argument("--longer-s", type=float, default=20.0, help="how long OMPL looks where we fail [s]")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    keep_to_one_core()
    profile = load_profile("iso")
    field = Field(load_robot(ROBOT, setup=RobotSetup(bare_flange=True)))
    trials = [(each, each.bodies(profile)) for each in scenes(field, profile, options.trials)]
    found: dict[str, Any] = {"machine": describe_machine(), "trials": options.trials}
    paths = _plan(found, field, trials, options)
    _compare_motions(found, field, trials, paths)
    found["potentials"] = _measure_potentials(field, trials[0][1])
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print(f"{found['machine']['processor']}, {options.trials} trials", "", *_lines(found), sep="\n")


def _plan(found: dict[str, Any], field: Field, trials: list[Trial], options: Any) -> list[Array | None]:
    """Fill in what planners need and find; return paths of the first variant."""
    planners: dict[str, Any] = {}
    first: list[Array | None] = []
    reasons: list[NoPath | None] = []
    for variant in VARIANTS:
        planner = Planner(field, PlannerSettings(variant=variant))
        planner.plan(trials[0][0].start, trials[0][0].goal, trials[0][1])  # compiles
        answers = []
        for scene, bodies in trials:
            began = time.process_time()
            answer = planner.plan(scene.start, scene.goal, bodies)
            answers.append((answer.path, time.process_time() - began))
            if variant == VARIANTS[0]:
                first.append(answer.path)
                reasons.append(answer.reason)
        planners[variant] = answers
    found["scenes"] = _counted(field, trials, first, reasons)
    if is_installed():
        step = PlannerSettings().step_rad
        for name, longest in (("RRTConnect", 5.0), (_STAR.split()[1], options.star_s)):
            planners[f"OMPL {name}"] = [
                ompl_plan(field, each.start, each.goal, bodies, name, step, longest)
                for each, bodies in trials
            ]
        lost = [k for k, each in enumerate(reasons) if each is NoPath.NODES_USED_UP]
        longer = [
            ompl_plan(
                field,
                trials[k][0].start,
                trials[k][0].goal,
                trials[k][1],
                "RRTConnect",
                step,
                options.longer_s,
            )
            for k in lost
        ]
        found["scenes"]["of these with a path by OMPL"] = sum(path is not None for path, _s in longer)
    compared = [each for name, each in planners.items() if name != _STAR]
    everywhere = [k for k in range(len(trials)) if all(each[k][0] is not None for each in compared)]
    found["planners"] = {name: _summed(each, everywhere) for name, each in planners.items()}
    return first


def _counted(
    field: Field, trials: list[Trial], paths: list[Array | None], reasons: list[NoPath | None]
) -> dict[str, int]:
    """Count what the scenes are like."""
    counts: Counter[str] = Counter()
    planner = Planner(field)
    for (scene, bodies), path, reason in zip(trials, paths, reasons, strict=True):
        goals = planner.goals(scene.start, scene.goal)
        clear = [field.is_clear_between(scene.start, each, bodies) for each in goals]
        near = reason in {NoPath.START_NEAR, NoPath.GOAL_NEAR}
        counts["somebody within 250 mm of start or goal"] += near
        counts["straight way blocked"] += not near and not clear[0]
        counts["every straight way blocked, other turns of the goal as well"] += not near and not any(clear)
        counts["no path with so many nodes"] += reason is NoPath.NODES_USED_UP
        counts["path"] += path is not None
    return dict(counts)


def _summed(answers: list[tuple[Array | None, float]], everywhere: list[int]) -> dict[str, Any]:
    ms = 1e3 * np.array([seconds for _path, seconds in answers])
    lengths = [  # none, where it lacks some
        float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        for path, _s in (answers[k] for k in everywhere)
        if path is not None
    ]
    return {
        "found": sum(path is not None for path, _s in answers),
        "median_ms": float(np.median(ms)),
        "p90_ms": float(np.percentile(ms, 90.0)),
        "worst_ms": float(ms.max()),
        "length_rad": float(np.mean(lengths)) if lengths and len(lengths) == len(everywhere) else None,
    }


def _compare_motions(
    found: dict[str, Any], field: Field, trials: list[Trial], paths: list[Array | None]
) -> None:
    """Fill in how long motions along the paths last [s], and how long they take to compute [ms]."""
    limits = field.robot.limits
    rows: dict[str, list[tuple[float, float]]] = {}
    proven = 0
    for (_scene, bodies), path in zip(trials, paths, strict=True):
        if path is None:
            continue
        began = time.process_time()
        motion = plan_motion(field, path, bodies)
        took = time.process_time() - began
        proven += motion.trajectory is not None
        if motion.trajectory is None:
            continue
        rows.setdefault("plan_motion", []).append((motion.trajectory.s_end, took))
        began = time.process_time()
        along = motion_along(path, limits)
        rows.setdefault("motion_along", []).append((along.s_end, time.process_time() - began))
        if find_spec("toppra") is not None:
            rows.setdefault("toppra", []).append(_toppra(path, field))
    found["proven"] = proven
    found["motions"] = {
        name: {
            "mean_s": float(np.mean([s for s, _t in each])),
            "median_ms": 1e3 * float(np.median([t for _s, t in each])),
        }
        for name, each in rows.items()
    }


def _toppra(path: Array, field: Field) -> tuple[float, float]:
    """Return duration along the same rounded path and processor time [s]; no limit of the jerk."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    limits = field.robot.limits
    began = time.process_time()
    rounded = RoundedPath(apart(path, "path"), ROUNDING_RAD)
    s = np.linspace(0.0, rounded.length, max(30, 20 * len(path)))
    spline = toppra.SplineInterpolator(s, np.array([rounded.at(each)[0] for each in s.tolist()]))
    allowed = [
        constraint.JointVelocityConstraint(_SHARE * np.column_stack((-limits.velocity, limits.velocity))),
        constraint.JointAccelerationConstraint(
            _SHARE * np.column_stack((-limits.acceleration, limits.acceleration))
        ),
    ]
    answer = algorithm.TOPPRA(allowed, spline, parametrizer="ParametrizeConstAccel").compute_trajectory()
    return float(answer.duration), time.process_time() - began


def _measure_potentials(field: Field, bodies: Bodies) -> dict[str, float]:
    """Return how long the potentials of some configurations take [ms], elapsed, by each way there is."""
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (_CONFIGURATIONS, len(field.robot.joints)))
    ways = {"compiled loops": lambda: field.potentials(q, bodies)}
    if find_spec("torch") is not None:
        import torch

        ways["PyTorch, one core"] = lambda: potentials(field, q, bodies, "cpu")
        if torch.cuda.is_available():
            ways["PyTorch, CUDA"] = lambda: potentials(field, q, bodies, "cuda")
    found = {}
    for name, way in ways.items():
        way()
        times = []
        for _ in range(5):
            began = time.perf_counter()
            way()
            times.append(1e3 * (time.perf_counter() - began))
        found[name] = float(np.median(times))
    return found


def _lines(found: dict[str, Any]) -> list[str]:
    lines = ["| scenes | trials |", "|---|---|"]
    lines += [f"| {name} | {count} |" for name, count in found["scenes"].items()]
    lines += [
        "",
        f"The paper: {_PAPER_S}, with a GPU.",
        "",
        "| planner | found | median, ms | 90 %, ms | worst, ms | mean length, rad |",
        "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for name, each in found["planners"].items():
        length = "" if each["length_rad"] is None else f"{each['length_rad']:.2f}"
        lines.append(
            f"| {name} | {each['found']} | {each['median_ms']:.1f} | {each['p90_ms']:.1f} | "
            f"{each['worst_ms']:.1f} | {length} |"
        )
    if not is_installed():
        lines.append("No rows of OMPL: it is not installed (pip install 'stopproof[planning]').")
    lines += ["", f"Motion proven clear: {found['proven']} of {found['scenes'].get('path', 0)} paths.", ""]
    lines += ["| motion | mean duration, s | computed in, ms |", "|---|---|---|"]
    lines += [
        f"| {name} | {each['mean_s']:.2f} | {each['median_ms']:.1f} |"
        for name, each in found["motions"].items()
    ]
    if find_spec("toppra") is None:
        lines.append("No row of toppra: it is not installed (pip install 'stopproof[planning]').")
    lines += ["", f"| potentials of {_CONFIGURATIONS} configurations | ms |", "|---|---|"]
    lines += [f"| {name} | {ms:.1f} |" for name, ms in found["potentials"].items()]
    if "PyTorch, CUDA" not in found["potentials"]:
        lines.append("No row of CUDA: PyTorch with CUDA is not here (pip install 'stopproof[train]').")
    return lines


if __name__ == "__main__":
    main()
