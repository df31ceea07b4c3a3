"""Time for the space that people may fill, by model, and plain NumPy beside it.

    python -m bench.people [--rounds N] [--json -]

One person, all 20 points of whom were seen by the gate, velocities too; 20 slices; every part. Everything is
measured in one process on one core, the ways to be compared in turns; shown are medians over the rounds, in
processor time. Every row is compared with the one that NumPy computes.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numba import njit

from bench.machine import describe_machine, keep_to_one_core
from bench.numpy_people import occupy_with_numpy
from bench.stopwatch import processor_time
from occupancy.body import load_profile
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.catalog import MODEL_NAMES, build_models
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.model import HumanModel
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.measurement import Gate
from occupancy.region import Monitored, Region
from occupancy.sets import PEOPLE_SETS
from robots.motion import Block, new_slices
from tests.occupancy.people import report, settings, standing

PROFILE = "tum"
SLICES = 20
LENGTHS_S = (0.003, 0.02)
"""Of a slice. The arm is reached as a cone of directions for short times, as a ball for longer ones."""
DELAY_S = (0.0, 0.01)
LATENCY_S = 0.02
FRAME_S, FRAMES, PACE_M_S = 1.0 / 60.0, 5, 0.5
CALLS, CALLS_OF_NUMPY = 2000, 40
"""Calls that are timed together."""
TOLERANCE_M = 1e-11
"""Both ways round differently."""
TOGETHER = "all six together"
EXACT_FIELDS = ("slice", "owner", "covers", "model", "n_points", "speed_max")
ROW_FIELDS = (*EXACT_FIELDS, "radius")

Call = Callable[[], None]


@dataclass(frozen=True)
class Way:
    """One model and what it is asked: all slices by it and by NumPy, one slice; size of the answer."""

    name: str
    ours: Call
    numpy: Call
    one_slice: Call
    rows: int
    points: int


def main() -> None:
    """Measure, and print the tables or JSON."""
    options = _options()
    keep_to_one_core()
    people = somebody()
    began = time.perf_counter(), time.process_time()
    with processor_time():
        cases = {f"{1e3 * length:g} ms": _measure(people, length, options.rounds) for length in LENGTHS_S}
        empty_us = _empty_call_us(people, options.rounds)
    found = {
        "machine": describe_machine(),
        "rounds": options.rounds,
        "share_of_core": (time.process_time() - began[1]) / (time.perf_counter() - began[0]),
        "empty_call_us": empty_us,
        "cases": cases,
    }
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print("\n".join(_lines(found)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.people", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--rounds", type=int, default=9, help="medians over this many rounds")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    return parser.parse_args()


def somebody() -> Block:
    """Return the people block of somebody who walks, as the gate has it, and of nobody who is unlisted."""
    gate = Gate(load_profile(PROFILE), settings(position_error_m=0.004, stamp_error_s=0.001))
    for frame in range(FRAMES):
        t = FRAME_S * frame
        gate.admit(report(t, ("worker", standing(2.0 - PACE_M_S * t))), t)
    people: Block = gate.people.copy()
    assert people["n"][0] == 1 and np.isfinite(people["e_v"][0, 0]).all()
    people["unlisted"], people["t_complete"] = 1, people["t_obs"][0, 0].max()
    return people


def slices_after(people: Block, length_s: float, n: int = SLICES) -> Block:
    """Return ``n`` slices of ``length_s`` [s] from shortly after ``people`` were seen."""
    slices = new_slices()
    slices["n"], slices["delay"] = n, DELAY_S
    slices["t"][0, : n + 1] = people["t_obs"][0, 0].max() + LATENCY_S + length_s * np.arange(n + 1)
    return slices


def models() -> list[HumanModel]:
    """Return the six models of the profile, the published face and a monitored box."""
    profile = load_profile(PROFILE)
    box = Monitored("box", Region.box([-3.0, -3.0, -0.1], [3.0, 3.0, 3.0]), 0.1)
    return [
        *build_models(profile, MODEL_NAMES),
        ArmReach(profile, face="as_published"),
        UnobservedSpace(box, profile),
    ]


def ways(people: Block, length_s: float) -> list[Way]:
    """Return what is to be timed for slices of one length; both ways have given the same answer once."""
    slices, first = slices_after(people, length_s), slices_after(people, length_s, 1)
    found = []
    for model in models():
        ours, theirs = model.new_sets(), model.new_sets()
        with_numpy = occupy_with_numpy(model)
        model.occupy(people, slices, ours)
        with_numpy(people, slices, theirs)
        found.append(
            Way(
                model.name,
                partial(model.occupy, people, slices, ours),
                partial(with_numpy, people, slices, theirs),
                partial(model.occupy, people, first, model.new_sets()),
                *compare(model.name, ours, theirs),
            )
        )
    return found


def together(each: list[Way]) -> Way:
    """Return all of ``each``, one after the other."""

    def all_of(calls: list[Call]) -> Call:
        def call() -> None:
            for one in calls:
                one()

        return call

    return Way(
        TOGETHER,
        *(all_of([getattr(way, which) for way in each]) for which in ("ours", "numpy", "one_slice")),
        sum(way.rows for way in each),
        sum(way.points for way in each),
    )


def compare(name: str, ours: Block, theirs: Block) -> tuple[int, int]:
    """Compare every row; return the number of rows, and of all their points.

    Raises
    ------
    SystemExit
        A row differs by more than rounding.
    """
    a, b, n = ours[0], theirs[0], int(ours["n"][0])
    used = np.arange(a["points"].shape[1]) < a["n_points"][:n, None]
    equal = n == b["n"] and (a["first"] == b["first"]).all()
    for field in EXACT_FIELDS:
        equal = equal and (a[field][:n] == b[field][:n]).all()
    equal = equal and (abs(a["radius"][:n] - b["radius"][:n]) <= TOLERANCE_M).all()
    equal = equal and (abs(a["points"][:n] - b["points"][:n])[used] <= TOLERANCE_M).all()
    if not equal:
        raise SystemExit(f"{name}: the rows differ from those by NumPy")
    return n, int(used.sum())


def _measure(people: Block, length_s: float, rounds: int) -> dict[str, Any]:
    """Microseconds per call of every model, ours and NumPy's in turns."""
    every, found = ways(people, length_s), {}
    for way in (*every, together(every[: len(MODEL_NAMES)])):
        timed = [
            (_us(way.ours, CALLS), _us(way.numpy, CALLS_OF_NUMPY), _us(way.one_slice, CALLS))
            for _ in range(rounds)
        ]
        ours, theirs, one = (median(each) for each in zip(*timed, strict=True))
        found[way.name] = {
            "rows": way.rows,
            "points": way.points,
            "call_us": ours,
            "slice_us": ours / SLICES,
            "one_slice_us": one,
            "numpy_us": theirs,
            "numpy_over_ours": theirs / ours,
            "copy_us": _copy_us(way, rounds),
        }
    return found


def _us(call: Call, calls: int) -> float:
    """Microseconds per call."""
    began = time.perf_counter()
    for _ in range(calls):
        call()
    return 1e6 * (time.perf_counter() - began) / calls


def _copy_us(way: Way, rounds: int) -> float:
    """Microseconds for copying as many bytes as the rows take."""
    of_a_row = sum(PEOPLE_SETS[field].base.itemsize for field in ROW_FIELDS)
    source = np.zeros(way.rows * of_a_row + way.points * 3 * 8, np.uint8)
    target = source.copy()
    return median(_us(partial(np.copyto, target, source), CALLS) for _ in range(rounds))


@njit(error_model="numpy")
def _nothing(people: Block, slices: Block, table: Block, out: Block) -> None:
    """Take what a compiled model takes."""


def _empty_call_us(people: Block, rounds: int) -> float:
    """Microseconds for a compiled call that does nothing."""
    model = Iso13855(load_profile(PROFILE))
    call = partial(_nothing, people, slices_after(people, LENGTHS_S[0]), model._table, model.new_sets())
    call()
    return median(_us(call, CALLS) for _ in range(rounds))


def _lines(found: dict[str, Any]) -> Iterator[str]:
    machine, cases = found["machine"], found["cases"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; medians of {found['rounds']} rounds"
    yield f"processor time; the core was there for {100.0 * found['share_of_core']:.0f} % of the elapsed time"
    yield ""
    yield f"an empty compiled call with four blocks: {found['empty_call_us']:.2f} µs"
    for name, case in cases.items():
        yield ""
        yield from _row(
            f"{SLICES} slices of {name}, µs",
            ["rows", "points", "call", "per slice", "one slice", "mere copy", "NumPy", "NumPy/call"],
            rule=True,
        )
        for model, row in case.items():
            yield from _row(
                f"**{model}**" if model == TOGETHER else model,
                [
                    f"{row['rows']}",
                    f"{row['points']}",
                    f"{row['call_us']:.1f}",
                    f"{row['slice_us']:.2f}",
                    f"{row['one_slice_us']:.1f}",
                    f"{row['copy_us']:.1f}",
                    f"{row['numpy_us']:.0f}",
                    f"{row['numpy_over_ours']:.0f}",
                ],
            )


def _row(label: str, values: list[str], *, rule: bool = False) -> Iterator[str]:
    yield f"| {label:<25} | " + " | ".join(f"{value:>10}" for value in values) + " |"
    if rule:
        yield f"|{'-' * 27}|" + "|".join("-" * 11 + ":" for _ in values) + "|"


if __name__ == "__main__":
    main()
