"""How narrow the bracket of the fastest point gets within a minute, and what the closed form would say.

    python -m bench.brackets [--deadline S] [--gap SHARE] [--only ROBOT ...]

Arms of the catalogue, bare and with the bundled gripper, all joints up to their velocity limits. *Gap*: share
of the upper number that is not known to be reached. *Closed form*: the bound that every point is at its reach
from every joint; *closed form / bound* is what the search gains.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from bench.machine import describe_machine, keep_to_one_core
from failsafe.box_search import BoxSearch, Found, arm_points
from failsafe.bracket import Effort
from robots.catalog import RobotSetup, load_robot, load_tool, robot_names
from robots.model import RobotModel

GRIPPER = Path(__file__).parents[1] / "data" / "gripper.toml"
HEAD = (
    "| arm | joints | reached, m/s | bound, m/s | gap | closed form / bound | boxes | seconds | ended |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--deadline", type=float, default=60.0, help="longest time of one search [s]")
    parser.add_argument("--gap", type=float, default=0.1, help="narrow enough")
    parser.add_argument("--only", nargs="+", default=list(robot_names()), choices=robot_names())
    options = parser.parse_args()
    keep_to_one_core()
    effort = Effort(gap=options.gap, clock=time.perf_counter, deadline_s=options.deadline)
    search_of(load_robot(options.only[0], setup=RobotSetup(bare_flange=True))).run(Effort(gap=0.9))
    for key, value in describe_machine().items():
        print(f"{key}: {value}")
    print(f"searches of at most {options.deadline:g} s for a gap of {options.gap:.0%}\n\n{HEAD}")
    for name in options.only:
        bare = RobotSetup(bare_flange=True)
        for title, setup in ((name, bare), (f"{name}, gripper", RobotSetup(tool=load_tool(GRIPPER)))):
            model = load_robot(name, setup=setup)
            search = search_of(model)
            print(row(title, model, search, search.run(effort)), flush=True)


def search_of(model: RobotModel) -> BoxSearch:
    points, _links = arm_points(model)
    return BoxSearch(model, points, model.limits.velocity)


def row(title: str, model: RobotModel, search: BoxSearch, found: Found) -> str:
    return (
        f"| {title} | {len(model.joints)} | {found.best:.2f} | {found.bound:.2f} "
        f"| {1.0 - found.best / found.bound:.1%} | {search.reach_bound() / found.bound:.2f} "
        f"| {found.boxes} | {found.seconds:.1f} | {found.ended} |"
    )


if __name__ == "__main__":
    main()
