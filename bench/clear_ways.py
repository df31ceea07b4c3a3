"""In which trials of the proactive scenario a way with 250 mm of clearance exists, by two planners.

    python -m bench.clear_ways [--trials N] [--longest SECONDS]

The witness of the scenario searches with the truth, with 6000 nodes. Where it finds none, OMPL's RRT-Connect
(extra ``planning``) is asked the same with a long budget, and it is said whether somebody is within 250 mm of
start or goal, so that there is none.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from bench.machine import describe_machine, keep_to_one_core
from bench.ompl_planning import is_installed, ompl_plan
from modes.planning.outcomes import Witness
from modes.planning.scenario import fixtures, profile_of_people, robot_of_cell
from modes.planning.trials import PICK, PLACE, Trial, trials

_STEP_RAD = 0.8


def main() -> None:
    """Search, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.clear_ways")
    parser.add_argument("--trials", type=int, default=50, help="how many")
    parser.add_argument("--longest", type=float, default=10.0, help="budget of OMPL for each question [s]")
    options = parser.parse_args()
    keep_to_one_core()
    witness, counts = Witness(robot_of_cell(), profile_of_people(), fixtures()), Counter[str]()
    for each in trials(options.trials):
        counts[_found(witness, each, options.longest)] += 1
    print(f"{describe_machine()['processor']}, {options.trials} trials", "")
    print("| trials | |", "|---|---|", sep="\n")
    for name, count in counts.most_common():
        print(f"| {name} | {count} |")
    if not is_installed():
        print(
            "",
            "OMPL is not here (pip install 'stopproof[planning]'): nothing was searched for longer.",
            sep="\n",
        )


def _found(witness: Witness, trial: Trial, longest_s: float) -> str:
    """Return what is known of a trial's clear way."""
    if witness.has_clear_way(trial):
        return "clear way found"
    field, start, goal = witness.field, np.array(PICK), np.array(PLACE)
    free = []
    for frames in witness.asked(trial):
        near = [not field.is_clear(q, witness.bodies(frames)) for q in (start, goal)]
        if any(near):
            continue
        free.append(frames)
    if not free:
        return "none: somebody within 250 mm of start or goal"
    if not is_installed():
        return "not found"
    for frames in free:
        path, _seconds = ompl_plan(
            field, start, goal, witness.all_of_it(frames), "RRTConnect", _STEP_RAD, longest_s
        )
        if path is not None:
            return "found by OMPL alone"
    return "not found, by OMPL neither"


if __name__ == "__main__":
    main()
