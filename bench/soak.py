"""The loop in real time for long: is every cycle accounted for, and does memory grow?

    python -m bench.soak [--minutes N] [--rate HZ] [--people N] [--real-time] [--json -]

A Panda at work with people walking to and fro, a simulated robot side and a mode in a thread of its own. Ends
with an error if an instant is neither on time, late, refused nor missed, or if memory grows.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.closed_loop import LATENCY_S, panda_cell, person
from bench.machine import describe_machine
from failsafe.waypoints import rest_to_rest
from occupancy.report import RawMeasurement
from robots.limits import JointLimits
from verifier.command import Cause, Command, State
from verifier.loop import Histogram, Loop, LoopReport, ask_for_real_time
from verifier.mode_runner import ModeRunner, Proposals
from verifier.proposal import NewTrajectory, PathSpeed, Proposal, SceneView
from verifier.rehearsal import rehearse
from verifier.setup import build_robot
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading

Array = NDArray[np.float64]

SEED = 1
REPORTS_HZ = 60.0
MODE_PERIOD_S = 0.25
LEAST_MINUTES = 5.0
"""What memory does in shorter runs is shown, but not judged."""
WARM_UP_S = 120.0
MOST_GROWTH_MIB = 2.0
"""Half an hour at 1 kHz are 1.8 million steps: 2 bytes lost in each would exceed this."""
BINS_US = (50, 100, 200, 500, 1000, 2000, 5000)


class Accounts:
    """A supervisor that keeps its own books: steps, and which instants their commands belong to."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self.cycle_s = supervisor.cycle_s
        self.steps = self.withdrawn = self.kept = self.no_instant = 0
        self._counts = False
        self.first = self.last = self.began = self.ended = float("nan")
        self.states = dict.fromkeys(State, 0)

    def step(
        self, now: float, measurements: tuple[RawMeasurement, ...], joints: JointReading | None
    ) -> Command:
        """Pass on, and count."""
        command = self._supervisor.step(now, measurements, joints)
        self.steps += 1
        self._counts = command.cause is not Cause.CLOCK
        self.kept += self._counts
        self.no_instant += not self._counts
        self.states[command.outcome] += 1
        if not self.first <= self.last:
            self.first, self.began = command.t, now
        self.last, self.ended = command.t, now
        return command

    def withdraw(self) -> Command:
        """Pass on, and count."""
        self.withdrawn += 1
        if self._counts:
            self.kept -= 1
        else:
            self.no_instant -= 1
        return self._supervisor.withdraw()

    def propose(self, proposal: Proposal) -> object:
        """Pass on."""
        return self._supervisor.propose(proposal)

    @property
    def stops_by_itself(self) -> bool:
        """Pass on."""
        return self._supervisor.stops_by_itself

    @property
    def instants(self) -> int:
        """How many instants have passed, from the first command to the last."""
        return round((self.last - self.first) / self.cycle_s) + 1


class Room:
    """People who walk to and fro, seen by sensors; and the robot side, which looks at what it gets."""

    def __init__(self, people: int, limits: JointLimits) -> None:
        self._people, self._velocity = people, limits.velocity
        self._rng = np.random.default_rng(SEED)
        self._next = 0.0
        self._last: Command | None = None
        self._held: deque[Command] = deque(maxlen=5)
        self.sent = self.overdue = self.jumps = self.reports = 0

    def measurements(self) -> list[RawMeasurement]:
        """Return a report every now and then."""
        now = time.monotonic()
        if now < self._next:
            return []
        self._next = now + 1.0 / REPORTS_HZ
        self.reports += 1
        seen = now - LATENCY_S
        persons = tuple(person(number, self._people, seen, self._rng) for number in range(self._people))
        return [RawMeasurement(seen, now, "world", True, persons)]

    def joints(self) -> JointReading | None:
        """Return where the robot is: where the newest command that is not ahead has it."""
        now = time.monotonic()
        past = [command for command in self._held if command.t <= now]
        return JointReading(past[-1].t, past[-1].q) if past else None

    def send(self, command: Command) -> bool:
        """Hold a command; count what comes after its deadline, or leads from the one before too fast."""
        self.sent += 1
        self.overdue += time.monotonic() > command.deadline
        if self._last is not None:
            far = self._velocity * max(command.t - self._last.t, 0.0)
            self.jumps += not bool((np.abs(command.q - self._last.q) <= far + 1e-9).all())
        self._last = command
        self._held.append(command)
        return True


class Wanderer:
    """A mode: from standstill through two seeded places, on the way now and then at another speed."""

    name = "wanderer"

    def __init__(self, limits: JointLimits) -> None:
        self._limits, self._rng = limits, np.random.default_rng(SEED)

    def place(self) -> Array:
        """Return a posture in the middle of the joint ranges."""
        low, high = self._limits.position_lower, self._limits.position_upper
        chosen: Array = low + (high - low) * self._rng.uniform(0.25, 0.75, len(low))
        return chosen

    def propose(self, view: SceneView) -> Proposal | None:
        """Return a trajectory where the arm rests, sometimes a path speed where it moves."""
        if view.outcome == "STOPPED":
            return NewTrajectory(rest_to_rest([view.q, self.place(), self.place()], self._limits, share=0.7))
        return PathSpeed(float(self._rng.choice([0.5, 1.0, 1.0]))) if self._rng.uniform() < 0.1 else None


class Memory(threading.Thread):
    """Samples the resident memory [MiB] every ``period_s``."""

    def __init__(self, period_s: float) -> None:
        super().__init__(daemon=True)
        self._period, self._done = period_s, threading.Event()
        self.samples: list[tuple[float, float]] = []

    def run(self) -> None:
        """Sample until told to stop."""
        statm, page = Path("/proc/self/statm"), os.sysconf("SC_PAGESIZE") if hasattr(os, "sysconf") else 0
        while statm.is_file():
            pages = int(statm.read_text(encoding="ascii").split()[1])
            self.samples.append((time.monotonic(), pages * page / 2**20))
            if self._done.wait(self._period):
                return

    def stop(self) -> None:
        """Let the thread end."""
        self._done.set()
        self.join()


def growth(samples: list[tuple[float, float]], warm_up_s: float) -> float:
    """Return the median of the last tenth less that of the first after the warm-up [MiB]; NaN: too few."""
    if not samples:
        return float("nan")
    kept = [mib for t, mib in samples if t - samples[0][0] >= warm_up_s]
    tenth = len(kept) // 10
    return median(kept[-tenth:]) - median(kept[:tenth]) if tenth else float("nan")


def faults(found: dict[str, Any]) -> list[str]:
    """Return in which way the books do not add up, or what else must not be."""
    passed, wrong = found["instants"], []
    known = found["on_time"] + found["late"] + found["not_taken"] + found["missed"]
    if known != passed:
        wrong.append(f"{passed} instants passed, but {known} are accounted for")
    if found["steps"] != found["loop_cycles"]:
        wrong.append(f"{found['steps']} steps were made, the loop counts {found['loop_cycles']}")
    if found["withdrawn"] != found["late"] + found["not_taken"]:
        wrong.append(
            f"{found['withdrawn']} commands were withdrawn, not {found['late'] + found['not_taken']}"
        )
    if not abs((passed - 1) * found["cycle_s"] - found["elapsed_s"]) < found["cycle_s"]:
        wrong.append(f"{passed} instants do not fill {found['elapsed_s']:.3f} s")
    if found["jumps"]:
        wrong.append(f"{found['jumps']} commands lead from the one before faster than the velocity limits")
    if not found["states"].get("executing"):
        wrong.append("nothing was executed, so that nothing was tried")
    if not found["at_rest"]:
        wrong.append("the robot does not rest at the end")
    if found["fault"] is not None:
        wrong.append(f"something raised: {found['fault']}")
    if found["memory_judged"] and not found["growth_mib"] <= MOST_GROWTH_MIB:
        wrong.append(f"memory grew by {found['growth_mib']:.1f} MiB, more than {MOST_GROWTH_MIB:g}")
    return wrong


def soak(minutes: float, rate: float, people: int) -> dict[str, Any]:
    """Run the loop and return what was counted."""
    cell = panda_cell().model_copy(update={"cycle_s": 1.0 / rate})
    limits = build_robot(cell).limits
    seconds = 60.0 * minutes
    memory = Memory(min(5.0, max(0.1, seconds / 200.0)))
    mode, room = Wanderer(limits), Room(people, limits)
    rehearse(cell, mode.place())  # nothing is compiled while the loop runs
    supervisor = Supervisor.from_cell(cell, mode.place())
    accounts = Accounts(supervisor)
    loop = Loop(accounts, room, room)  # it has what a loop calls of a supervisor, and counts
    runner = ModeRunner(Proposals(supervisor), mode, period_s=MODE_PERIOD_S)
    timer = threading.Timer(seconds, loop.stop)
    for thread in (memory, runner, timer):
        thread.start()
    try:
        report = loop.run()
    finally:
        timer.cancel()
        runner.stop()
        memory.stop()
    fault = report.fault or supervisor.fault
    return {
        **_counted(accounts, report, room),
        "cycle_s": 1.0 / rate,
        "elapsed_s": accounts.ended - accounts.began,
        "fault": None if fault is None else f"{type(fault).__name__}: {fault}",
        "mode": {"calls": runner.report.calls, "handed_on": runner.report.handed_on},
        "step_time": _spread(report.step_time),
        "wake_up": _spread(report.wake_up),
        "growth_mib": growth(memory.samples, min(WARM_UP_S, 0.2 * seconds)),
        "memory_mib": [mib for _t, mib in memory.samples],
        "memory_judged": minutes >= LEAST_MINUTES and bool(memory.samples),
    }


def _counted(accounts: Accounts, report: LoopReport, room: Room) -> dict[str, Any]:
    steps = accounts.steps
    return {
        "instants": accounts.instants,
        "on_time": accounts.kept,
        "late": report.late,
        "not_taken": report.not_taken,
        "missed": report.missed,
        "no_instant": accounts.no_instant,
        "steps": steps,
        "loop_cycles": report.cycles,
        "withdrawn": accounts.withdrawn,
        "sent": room.sent,
        "overdue": room.overdue,
        "jumps": room.jumps,
        "reports": room.reports,
        "at_rest": report.at_rest,
        "states": {state.name.lower(): n / max(1, steps) for state, n in accounts.states.items()},
    }


def _spread(histogram: Histogram) -> dict[str, Any]:
    """Return percentiles [µs] of a histogram, and how many lie in each of a few wide bins."""
    edges = np.array([*BINS_US, np.inf]) * 1e-6
    places = np.searchsorted(edges, histogram.edges[1:] * (1.0 - 1e-9))
    wide = np.bincount(places, weights=histogram.counts, minlength=len(edges)).astype(int)
    return {
        **{f"{name}_us": 1e6 * histogram.quantile(share) for name, share in QUANTILES.items()},
        "worst_us": 1e6 * histogram.longest_s,
        "counts": wide.tolist(),
    }


QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999}


def main() -> None:
    """Measure, print the tables or JSON, and end with an error if something does not add up."""
    options = _options()
    granted = ask_for_real_time() if options.real_time else None
    soak(2.0 / 60.0, options.rate, options.people)  # compiles
    found = soak(options.minutes, options.rate, options.people)
    found |= {"machine": describe_machine(), "granted": None if granted is None else repr(granted)}
    wrong = faults(found)
    if options.json == "-":
        json.dump({**found, "faults": wrong}, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found, options)))
    if wrong:
        raise SystemExit("; ".join(wrong))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.soak",
        description=(__doc__ or "").split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=30.0, help="how long")
    parser.add_argument("--rate", type=float, default=1000.0, help="cycles a second, 10 to 1000")
    parser.add_argument("--people", type=int, default=1, help="how many people walk to and fro")
    parser.add_argument("--real-time", action="store_true", help="ask for locked memory and priority")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    for name, low, high in (("minutes", 0.01, 1e4), ("rate", 10.0, 1000.0), ("people", 1, 8)):
        if not low <= getattr(options, name) <= high:
            parser.error(f"--{name} {getattr(options, name)} should be {low:g} to {high:g}")
    return options


def _lines(found: dict[str, Any], options: argparse.Namespace) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; {options.people} people, Panda, separation"
    granted = found["granted"] or "no priority asked for"
    yield f"{found['elapsed_s']:.1f} s at {options.rate:g} Hz; {granted}"
    yield ""
    yield from _row("instants", ("number", "share"), rule=True)
    for key, name in ROWS.items():
        yield from _row(name, (found[key], f"{100.0 * found[key] / found['instants']:.3f} %"))
    yield from _row("handed over after the deadline all the same", (found["overdue"], ""))
    yield ""
    yield from _row("cycles, µs", ("median", "99 %", "99.9 %", "worst"), rule=True)
    for key, name in (("step_time", "step, until handed over"), ("wake_up", "late awake")):
        row = found[key]
        yield from _row(name, [f"{row[n]:.0f}" for n in ("median_us", "p99_us", "p999_us", "worst_us")])
    yield ""
    heads = [*(f"≤ {edge}" for edge in BINS_US), f"> {BINS_US[-1]}"]
    yield from _row("number of cycles, by µs", heads, rule=True)
    for key, name in (("step_time", "step, until handed over"), ("wake_up", "late awake")):
        yield from _row(name, found[key]["counts"])
    yield ""
    yield from _row("memory, MiB", ("first", "last", "growth"), rule=True)
    memory = found["memory_mib"] or [float("nan")]
    values = [f"{value:.1f}" for value in (memory[0], memory[-1], found["growth_mib"])]
    yield from _row("resident; growth after the warm-up", values)
    yield ""
    yield f"growth: median of the last tenth of the samples less that of the first after {WARM_UP_S:g} s"
    judged = "" if found["memory_judged"] else f"; not judged: shorter than {LEAST_MINUTES:g} minutes"
    yield f"(a fifth of the time in shorter runs); more than {MOST_GROWTH_MIB:g} MiB is a fault{judged}"
    shares = ", ".join(f"{name} {100.0 * share:.1f} %" for name, share in found["states"].items())
    yield f"{shares}; {found['reports']} reports; the mode proposed {found['mode']['handed_on']} times"
    yield f"accounts: {'; '.join(faults(found)) or 'every instant is accounted for'}"


ROWS = {
    "instants": "**passed**",
    "on_time": "on time",
    "late": "late: withdrawn",
    "not_taken": "not taken by the robot side: withdrawn",
    "missed": "missed: no step",
    "no_instant": "steps in which the clock did not advance",
}


def _row(label: str, values: Any, *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<46} | " + " | ".join(f"{value:>9}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 48}|" + "|".join("-" * 10 + ":" for _ in values) + "|"


if __name__ == "__main__":
    main()
