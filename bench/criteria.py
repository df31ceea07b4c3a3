"""Time for the criteria that need no people, and coal asked about every pair beside it.

    python -m bench.criteria [--rounds N]

A UR5 with the gripper of the demonstration at 0.1 to 0.5 rad/s, 6 slices of 10 ms; a floor, a table,
a post. Everything in one process on one core, in turns; medians over the rounds, in processor time. What coal
says is used to check that nothing is proven apart that it sees closer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from bench.machine import describe_machine, keep_to_one_core
from occupancy.engines import CoalEngine
from occupancy.self_collision import SelfCollision
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from occupancy.workspace import Workspace, box, capsule, half_space
from occupancy.workspace_kernels import mark_moving
from robots.catalog import RobotSetup, load_robot, load_tool
from robots.model import Mount
from robots.motion import new_slices

SLICES, LENGTH_S, MARGIN_M = 6, 0.01, 1e-4
CALLS, CALLS_OF_COAL = 500, 2
Q = np.array([0.0, -1.2, 1.3, -0.4, 0.3, 0.0])
DQ = np.array([0.5, 0.2, 0.3, 0.1, 0.1, 0.1])


def main() -> None:
    """Measure and print one line for each criterion."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=30)
    rounds = parser.parse_args().rounds
    keep_to_one_core()
    print(describe_machine())
    for name, ours, coal, pairs in _cases():
        fast, slow = [], []
        for _ in range(rounds):
            fast.append(_time(ours, CALLS))
            slow.append(_time(coal, CALLS_OF_COAL))
        ratio = median(b / a for a, b in zip(fast, slow, strict=True))
        print(
            f"{name}: {median(fast):.1f} µs for {pairs} pairs, coal {median(slow):.0f} µs, {ratio:.0f} times"
        )


def _time(call: Callable[[], object], calls: int) -> float:
    call()
    began = time.process_time()
    for _ in range(calls):
        call()
    return 1e6 * (time.process_time() - began) / calls


def _cases() -> list[tuple[str, Callable[[], object], Callable[[], object], int]]:
    tool = load_tool(Path(__file__).parent.parent / "data" / "gripper.toml")
    robot = load_robot("ur5", setup=RobotSetup(tool=tool))
    slices, links, active = new_slices(), new_link_sets(), np.zeros(24, dtype=np.uint8)
    plan = slices[0]
    plan["n"], plan["n_joints"] = SLICES, len(Q)
    for i in range(SLICES + 1):
        plan["t"][i] = LENGTH_S * i
        plan["q"][i, : len(Q)], plan["dq"][i, : len(Q)] = Q + DQ * plan["t"][i], DQ
    plan["dq_max"][:SLICES, : len(Q)], plan["ddq_max"][:SLICES, : len(Q)] = DQ, 1.0
    LinkOccupancy(robot).occupy(slices, links)
    mark_moving(links, slices, robot.enclosure, 1e-3, 2e-3, active)
    fixtures = [
        half_space("floor", (0.0, 0.0, -0.8), (0.0, 0.0, 1.0)),
        box("table", (1.5, 1.0, 0.04), Mount(translation=np.array([0.0, 0.0, -0.03])), 0.005),
        capsule("post", (-0.8, 0.5, -0.8), (-0.8, 0.5, 1.5), 0.05),
    ]
    space = Workspace(fixtures, robot.links, {"table": ["shoulder_link"]}, MARGIN_M)
    itself = SelfCollision(robot, (), MARGIN_M)
    rows, engine, n = links[0], CoalEngine(), len(robot.links)

    def ask_about_fixtures() -> None:
        for row in range(int(rows["n"])):
            for fixture in fixtures[1:]:
                gap = engine.propose(rows["points"][row, :4], fixture.pieces[0].points)[1]
                apart = gap - rows["radius"][row] - fixture.pieces[0].radius > MARGIN_M
                assert apart or robot.links[row % n] == "shoulder_link"

    def ask_about_links() -> None:
        for i in range(SLICES):
            for a, b in itself.pairs:
                k, m = i * n + robot.links.index(a), i * n + robot.links.index(b)
                engine.propose(rows["points"][k, :4], rows["points"][m, :4])

    for check in (space, itself):
        assert check.check(links, slices, active) is None
    return [
        (
            "workspace",
            lambda: space.check(links, slices, active),
            ask_about_fixtures,
            SLICES * n * len(fixtures),
        ),
        (
            "self-collision",
            lambda: itself.check(links, slices, active),
            ask_about_links,
            SLICES * len(itself.pairs),
        ),
    ]


if __name__ == "__main__":
    main()
