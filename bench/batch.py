"""Batch replay from arrays: cycles per second and core, several cores, cost against people, arms and slices.

    python -m bench.batch [--seconds S] [--rounds N] [--tables T ...] [--json -] [--plot F.svg]

Each row verifies the same motion and people twice: by ``verifier.batch``, and by ordinary replay, whose
answers are compared with it in every run. Times are processor time of one process without reading and
decoding, medians over the rounds. Of several processes the processor time of the busiest one is shown, and
the elapsed time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.machine import describe_machine
from bench.recordings import DEMO, DEMO_CELL, standing, write_stretch
from bench.stopwatch import processor_time
from robots.model import RobotModel
from verifier import Cell, Status, VerifyReport, verify
from verifier.batch import BatchResult, BatchVerifier, stretches
from verifier.recordings import Reading, Recording, new_recording
from verifier.recordings.arrays import ArraySource, JointSamples, PeoplePoints
from verifier.recordings.joint_state import JointState
from verifier.recordings.window import Window
from verifier.recordings.windowed import JointPosition
from verifier.section import LEAD_S, TAIL_S, WINDOW_S
from verifier.setup import build_robot

Array = NDArray[np.float64]

JOINT_RATE_HZ, PEOPLE_RATE_HZ = 500, 60
PEOPLE = (1, 2, 4, 8)
ARMS = ("ur3", "ur5", "ur10", "panda")
SLICES_S = (0.005, 0.01, 0.02)
JOBS = (1, 2, 4)
AIM = 30_000
"""Cycles per second and core."""
ROBOT: dict[str, Any] = {"bare_flange": True, "accept_assumed": ["limits", "enclosure"]}


@dataclass(frozen=True)
class Case:
    """One recording to verify: its file, its cell, and what the row is called."""

    table: str
    name: str
    path: Path
    cell: Cell
    about: dict[str, float] = field(default_factory=dict)


class Held:
    """A recording that has been read and decoded, as it is asked for anew."""

    def __init__(self, case: Case, verifier: BatchVerifier) -> None:
        reading = self._reading = Reading(Recording(case.path), verifier.robot.joints)
        self.path, self.overlap = case.path, reading.overlap
        self._windows = list(reading.windows(WINDOW_S, LEAD_S, TAIL_S))

    def windows(self, _length: float, _before: float, _after: float) -> Iterator[Window]:
        """Yield the windows that were read."""
        return iter(self._windows)

    def positions_of(self, joints: Collection[str]) -> Iterator[JointPosition]:
        """Read what the file says of joints that the windows leave out."""
        return self._reading.positions_of(joints)


def main() -> None:
    """Measure, and print the tables or JSON."""
    options = _options()
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter(), time.process_time()
        with processor_time():
            cases = (each for each in _cases(Path(folder), options.seconds) if each.table in options.tables)
            rows = [_measure(case, options.rounds) for case in cases]
        share = (time.process_time() - began[1]) / (time.perf_counter() - began[0])
        found = {
            "machine": describe_machine(),
            "rounds": options.rounds,
            "share_of_core": share,
            "rows": rows,
            "cores": _cores(options.seconds, options.rounds),
        }
    if options.plot is not None:
        _draw(found, options.plot)
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.batch", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="length of each synthetic recording")
    parser.add_argument("--rounds", type=int, default=3, help="medians over this many rounds")
    parser.add_argument("--tables", nargs="+", choices=list(HEADINGS), default=list(HEADINGS))
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    parser.add_argument("--plot", metavar="F.svg", help="draw the costs (needs matplotlib, extra 'plot')")
    return parser.parse_args()


def _cases(folder: Path, seconds: float) -> Iterator[Case]:
    demo = Cell.from_toml(DEMO_CELL)
    encounter = folder / "encounter.mcap"
    write_stretch(encounter, 1, min(6.0, seconds))
    yield Case("recordings", "the demonstration, 10 ms", DEMO, demo)
    yield Case("recordings", "its encounter, 1 ms", encounter, demo.model_copy(update={"cycle_s": 0.001}))
    for cycle_s in (0.01, 0.001):
        cell = _cell("ur5", cycle_s)
        name = f"somebody passes a UR5, {1e3 * cycle_s:g} ms"
        yield Case("recordings", name, _written(folder, cell, 1, seconds), cell)
    for people in PEOPLE:
        cell = _cell("ur5", 0.001)
        yield Case("people", str(people), _written(folder, cell, people, seconds), cell, {"people": people})
    for arm in ARMS:
        cell = _cell(arm, 0.001)
        links = float(build_robot(cell).enclosure["n"][0])
        yield Case("arms", arm, _written(folder, cell, 1, seconds), cell, {"links": links})
    for slice_s in SLICES_S:
        cell = _cell("ur5", 0.001, slice_s)
        yield Case(
            "slices", f"{1e3 * slice_s:g} ms", _written(folder, cell, 1, seconds), cell, {"slice": slice_s}
        )


def _cell(arm: str, cycle_s: float, slice_s: float = 0.01) -> Cell:
    return Cell.from_table(
        {
            "cycle_s": cycle_s,
            "robot": {**ROBOT, "name": arm},
            "people": {"latency_s": 0.03, "clock_error_s": 0.001},
            "stop": {"slice_s": slice_s},
        }
    )


def synthetic(robot: RobotModel, people: int, seconds: float) -> tuple[JointSamples, PeoplePoints]:
    """Return an arm that swings, and people who step to and fro 1.5 to 3.5 m away, evenly around it."""
    t = np.arange(int(seconds * JOINT_RATE_HZ) + 1) / JOINT_RATE_HZ
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    middle = np.zeros(len(lower))
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle[bounded] = 0.5 * (lower[bounded] + upper[bounded])
    speed = np.minimum(0.25 * robot.limits.velocity, 0.6)
    rate = 0.5 + 0.2 * np.arange(len(middle))
    q = middle + speed / rate * np.sin(rate * t[:, None] + np.arange(len(middle)))
    seen = np.arange(int(seconds * PEOPLE_RATE_HZ) + 1) / PEOPLE_RATE_HZ
    xyz = np.empty((len(seen), people, 20, 3))
    for person in range(people):
        angle = 2.0 * np.pi * person / people
        away = 2.5 - np.cos(2.0 * np.pi * seen / 15.0 + person)
        place = np.stack([away * np.cos(angle), away * np.sin(angle), np.full(len(seen), -0.8)], axis=1)
        xyz[:, person] = standing() + place[:, None]
    return JointSamples(t + 1.0, q), PeoplePoints(seen + 1.0, xyz, arrived=seen + 1.03, error_m=0.01)


def _written(folder: Path, cell: Cell, people: int, seconds: float) -> Path:
    """Write a synthetic recording, which ordinary replay reads."""
    robot = build_robot(cell)
    path = folder / f"{robot.name}_{people}.mcap"
    if path.exists():
        return path
    joints, reports = synthetic(robot, people, seconds)
    messages: list[tuple[int, Any]] = [
        (int(ns), JointState(int(ns), robot.joints, q)) for ns, q in zip(joints.t_ns, joints.q, strict=True)
    ]
    messages += [(report.arrived_ns, report) for report in reports.reports]
    with new_recording(path) as writer:
        writer.describe({"robot": robot.name})
        for _, message in sorted(messages, key=lambda item: item[0]):
            (writer.joints if isinstance(message, JointState) else writer.people)(message)
    return path


def _measure(case: Case, rounds: int) -> dict[str, Any]:
    """Time one case both ways, and compare the answers."""
    verifier = BatchVerifier(case.cell)
    held = Held(case, verifier)
    report = verify(case.path, case.cell)
    cycles = report.cycles
    verifier.stretch(held, 0, cycles)  # both have compiled now what was not compiled yet
    batch_us, ordinary_us = [], []
    for _ in range(rounds):
        began = time.perf_counter()
        answers = verifier.stretch(held, 0, cycles)
        batch_us.append(1e6 * (time.perf_counter() - began) / cycles)
        report = verify(case.path, case.cell)
        ordinary_us.append(1e6 * case.cell.cycle_s / report.real_time_factor)
    _compare(case, answers, report)
    return {
        "table": case.table,
        "name": case.name,
        **case.about,
        "cycles": cycles,
        "verified": answers.count(Status.VERIFIED) / cycles,
        "together": float(answers.bounded.mean()),
        "batch_us": median(batch_us),
        "ordinary_us": median(ordinary_us),
        "cycles_per_s": 1e6 / median(batch_us),
        "ordinary_over_batch": median(ordinary_us) / median(batch_us),
    }


def _compare(case: Case, answers: BatchResult, report: VerifyReport) -> None:
    """Compare both ways cycle by cycle.

    Raises
    ------
    SystemExit
        An answer differs.
    """
    rows = report.per_cycle
    for name in ("status", "reason", "stop_time_s"):
        ours, theirs = getattr(answers, name), getattr(rows, name)
        if not np.array_equal(ours, theirs, equal_nan=name == "stop_time_s"):
            raise SystemExit(f"{case.name}: {name} of cycle {int(np.argmax(ours != theirs))} differs")


def _cores(seconds: float, rounds: int) -> list[dict[str, Any]]:
    """One long motion divided among processes: what the busiest one does, and elapsed time."""
    verifier = BatchVerifier(_cell("ur5", 0.001))
    joints, people = synthetic(verifier.robot, 1, 4.0 * seconds)
    source = ArraySource(joints, people, verifier.robot.joints)
    cycles = len(verifier.verify(joints, people).t)
    found = []
    for jobs in JOBS:
        busiest, elapsed, load = [], [], []
        for _ in range(rounds):
            load.append(os.getloadavg()[0])
            took = []
            for stretch in stretches(cycles, jobs):
                began = time.process_time()
                verifier.stretch(source, *stretch)
                took.append(time.process_time() - began)
            busiest.append(max(took))
            start = time.perf_counter()
            verifier.verify(joints, people, jobs=jobs)
            elapsed.append(time.perf_counter() - start)
        row = {"jobs": jobs, "cycles": cycles, "busiest_s": median(busiest), "elapsed_s": median(elapsed)}
        found.append({**row, "load": max(load)})
    return found


HEADINGS = {
    "recordings": "recordings",
    "people": "people, UR5 at 1 ms",
    "arms": "arms (links), one person at 1 ms",
    "slices": "length of slices, UR5, one person at 1 ms",
}


def _lines(found: dict[str, Any]) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; medians of {found['rounds']} rounds"
    yield f"processor time; the core was there for {100.0 * found['share_of_core']:.0f} % of the elapsed time"
    for table, heading in HEADINGS.items():
        if not any(row["table"] == table for row in found["rows"]):
            continue
        yield ""
        yield from _row(
            heading, ["cycles/s", "µs", "ordinary µs", "ratio", "together", "verified"], rule=True
        )
        for row in found["rows"]:
            if row["table"] == table:
                values = [
                    f"{row['cycles_per_s']:.0f}",
                    f"{row['batch_us']:.1f}",
                    f"{row['ordinary_us']:.0f}",
                    f"{row['ordinary_over_batch']:.1f}",
                    f"{100.0 * row['together']:.0f} %",
                    f"{100.0 * row['verified']:.0f} %",
                ]
                yield from _row(_name(row), values)
    first = found["cores"][0]
    yield ""
    yield f"one motion of {first['cycles']} cycles; load of the machine: {first['load']:.1f}"
    yield ""
    columns = ["busiest, s", "speed-up", "elapsed, s", "speed-up"]
    yield from _row("processes", columns, rule=True)
    for row in found["cores"]:
        values = []
        for key in ("busiest_s", "elapsed_s"):
            values += [f"{row[key]:.2f}", f"{first[key] / row[key]:.2f}"]
        yield from _row(str(row["jobs"]), values)


def _name(row: dict[str, Any]) -> str:
    """What a row is called: of an arm with the number of its link capsules."""
    name: str = row["name"]
    return f"{name} ({row['links']:.0f})" if "links" in row else name


def _row(label: str, values: list[str], *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<42} | " + " | ".join(f"{value:>12}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 44}|" + "|".join("-" * 13 + ":" for _ in values) + "|"


def _draw(found: dict[str, Any], path: str) -> None:
    """Draw cycles per second against people, links and slices, both ways.

    Raises
    ------
    SystemExit
        matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SystemExit(
            "--plot: matplotlib is not installed; the extra 'plot' has it: pip install 'stopproof[plot]'"
        ) from error
    figure = Figure(figsize=(10.0, 3.4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    columns = (("people", "people"), ("arms", "arm (link capsules)"), ("slices", "length of slices"))
    for axes, (table, label) in zip(panels, columns, strict=True):
        rows = [row for row in found["rows"] if row["table"] == table]
        at = [_name(row) for row in rows]
        axes.plot(at, [row["cycles_per_s"] for row in rows], "o-", label="batch")
        axes.plot(at, [1e6 / row["ordinary_us"] for row in rows], "s--", label="ordinary replay")
        axes.axhline(AIM, color="0.6", linewidth=1.0, linestyle=":")
        axes.set_xlabel(label)
        axes.set_yscale("log")
        axes.grid(visible=True, which="both", alpha=0.3)
    panels[0].set_ylabel("cycles per second and core")
    panels[0].legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
