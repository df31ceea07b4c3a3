"""What `diff` prints of stop reports: side by side, and what changed, most important first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from verifier.reports.difference import stated_lines
from verifier.reports.side_by_side import Comparison
from verifier.reports.text import counted, spaced
from verifier.shown import LONGEST_VALUE, shown
from verifier.stop_report.difference import (
    Bounds,
    FieldExtreme,
    GridChange,
    StopReportDifference,
    WorstCaseChange,
    bounds,
    stop_report_difference,
)
from verifier.stop_report.read_back import StopReportResult

SHOWN = 24
"""Worst cases, and quantities of grids, that are printed; all are in the JSON and in the page."""
_USUAL, _EXACT = ".4f", ".10g"
APART = (
    "apart: no number is in both brackets; elsewhere the worst case may be the same, and a search has come "
    "farther"
)


class StopReportComparison(Comparison[StopReportResult, StopReportDifference]):
    """Stop reports; docs/diff-stop-report.schema.json describes the JSON."""

    FORMAT = "stopproof diff of stop reports 1"

    def summary(self, result: StopReportResult) -> dict[str, Any]:
        """Return the first page."""
        answer = result.answer
        time, way = (
            None if place is None else bounds(result.worst_case[place]) for place in (answer.time, answer.way)
        )
        names = ("robot", "tool", "recording", "version", "cell_hash")
        return {
            **{name: getattr(result, name) for name in names},
            "stop": answer.stop,
            "over": answer.over,
            "loads_kg": loads(result),
            "total_s": answer.total_s,
            "time_s": None if time is None else asdict(time),
            "way_m": None if way is None else asdict(way),
            "waived": list(result.waived),
            "interrupted": result.interrupted,
        }

    def what(self, result: StopReportResult) -> str:
        """Return of which arm and stop it is, and how long that takes."""
        total = "not bounded" if result.answer.total_s is None else f"{result.answer.total_s:.3f} s"
        tool = "" if result.tool is None else f" with {shown(result.tool)}"
        load = "".join(f", {each:g} kg" for each in loads(result))
        whose = f"{shown(result.answer.stop)} over {shown(result.answer.over)}"
        waived = f", {counted(len(result.waived), 'waiver')}" if result.waived else ""
        ended = ", ended before everything was looked at" if result.interrupted else ""
        return f"{shown(result.robot)}{tool}{load}: {whose}: reaction and stop {total}{waived}{ended}"

    def change_lines(self, change: StopReportDifference, letter: str) -> Iterator[str]:
        """Yield worst cases, then fields of grids, then what is stated."""
        yield from _worst_lines(change, letter)
        yield from _grid_lines(change.grids, letter)
        yield from stated_lines(change, letter)


def compare_stop_reports(
    paths: Sequence[str], results: Sequence[StopReportResult], tolerance: float
) -> StopReportComparison:
    """Compare stop reports, each with the path of its file, with the first one of them."""
    first, *others = results
    changes = tuple(stop_report_difference(first, each, tolerance) for each in others)
    return StopReportComparison(tuple(paths), tuple(results), tolerance, changes)


def loads(report: StopReportResult) -> list[float]:
    """Return the loads at 100 % [kg]."""
    found = {each.load_kg for each in report.grids if each.load_kg is not None}
    if not found:  # ended before there was a grid
        payload = f"robot.{report.robot}.mass.payload"
        of = (item.value for item in report.assumptions if item.name == payload)
        found = {value for value in of if isinstance(value, float)}
    return sorted(found)


def _worst_lines(change: StopReportDifference, letter: str) -> Iterator[str]:
    found = change.worst_cases
    both = [each for each in found if each.a is not None and each.b is not None]
    count = sum(each.apart for each in both)
    yield (
        f"worst cases: {spaced(len(both))} of {spaced(change.compared)} with other numbers, "
        f"{spaced(count)} of them apart"
        + _only(sum(each.b is None for each in found), sum(each.a is None for each in found), letter)
    )
    if both:
        yield f"  {APART}"
    for each in found[:SHOWN]:
        yield f"  {worst_text(each)}"
    if len(found) > SHOWN:
        yield f"  and {spaced(len(found) - SHOWN)} more (--json)"


def _grid_lines(grids: Sequence[GridChange], letter: str) -> Iterator[str]:
    if grids:
        yield "grids, where the number that one would take fell and rose most:"
    for each in grids[:SHOWN]:
        of = f" of {shown(each.part)}" if each.part else ""
        changed = f"{spaced(each.changed)} of {spaced(each.compared)} fields, {spaced(each.apart)} apart"
        only = _only(each.only_in_a, each.only_in_b, letter)
        yield f"  {stop_text(each.stop, guessed=each.guessed)}, {each.quantity}{of}: {changed}{only}"
        for label, extreme in (("fell", each.fall), ("rose", each.rise)):
            if extreme is not None:
                yield f"    {label} at {shares_text(extreme)}: {step_text(extreme.a, extreme.b, each.unit)}"
    if len(grids) > SHOWN:
        yield f"  and {spaced(len(grids) - SHOWN)} more (--json)"


def _only(in_a: int, in_b: int, letter: str) -> str:
    return f"; only in A: {spaced(in_a)}; only in {letter}: {spaced(in_b)}" if in_a or in_b else ""


def stop_text(stop: str, *, guessed: bool) -> str:
    """Return whose stop; guessed brakes are called so."""
    return f"{shown(stop)} (guessed)" if guessed else shown(stop)


def worst_text(each: WorstCaseChange) -> str:
    """Return which worst case, and both brackets."""
    far = ", apart" if each.apart and each.a is not None and each.b is not None else ""
    whose = f"{stop_text(each.stop, guessed=each.guessed)}, {shown(each.over)}"
    what = f"{shown(each.quantity)} of {shown(each.part, LONGEST_VALUE)}"
    return f"{whose}: {what}: {step_text(each.a, each.b, each.unit)}{far}"


def shares_text(each: FieldExtreme) -> str:
    """Return which field."""
    where = "any configuration" if each.extension is None else f"extension {100.0 * each.extension:.0f} %"
    return f"load {100.0 * each.load:.0f} %, speed {100.0 * each.speed:.0f} %, {where}"


def step_text(a: Bounds | None, b: Bounds | None, unit: str) -> str:
    """Return both brackets, with as many digits as it takes to tell them apart; angles in degrees too."""
    before, after = (bounds_text(each, unit) for each in (a, b))
    if before == after:
        before, after = (bounds_text(each, unit, _EXACT) for each in (a, b))
    return f"{before} → {after}"


def bounds_text(each: Bounds | None, unit: str, form: str = _USUAL) -> str:
    """Return a bracket with its unit."""
    if each is None:
        return "none"
    if unit == "rad":
        degrees = Bounds(math.degrees(each.lower), None if each.upper is None else math.degrees(each.upper))
        in_degrees = "" if form == _EXACT else f" ({_range(degrees, '.1f')}°)"
        return f"{_range(each, form)} rad{in_degrees}"
    return f"{_range(each, form)} {unit}"


def _range(each: Bounds, form: str) -> str:
    if each.upper is None:
        return f"at least {each.lower:{form}}"
    low, high = f"{each.lower:{form}}", f"{each.upper:{form}}"
    return high if low == high else f"{low} to {high}"
