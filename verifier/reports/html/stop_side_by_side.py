"""Stop reports side by side as one page: payloads, speeds, limits, robots, or versions of this software."""

from __future__ import annotations

from collections.abc import Iterator

from verifier.reports.html.elements import Child, Node, Numbers, name, node, note, section, table
from verifier.reports.html.heat_map import Field, heat_map
from verifier.reports.html.page import page
from verifier.reports.html.side_by_side import MOST_ROWS, as_text, facts_section, head, stated_parts
from verifier.reports.html.stop_numbers import mark, pair, watermark
from verifier.reports.stop_difference import (
    APART,
    StopReportComparison,
    bounds_text,
    shares_text,
    step_text,
    stop_text,
)
from verifier.stop_report.difference import (
    Bounds,
    Key,
    StopReportDifference,
    WorstCaseChange,
    alike,
    bounds,
    cases,
    stop_facts,
)
from verifier.stop_report.read_back import Grid, StopReportResult

_MAPS = (("time_s", "time of the stop", "s"), ("way_m", "longest way of a point during the stop", "m"))


def stop_side_by_side_page(comparison: StopReportComparison) -> bytes:
    """Return the page of a comparison; its numbers are those of ``comparison.to_dict()``."""
    pairs = zip(comparison.letters[1:], comparison.changes, strict=True)
    every = [stop_facts(each) for each in comparison.results]
    sections = [
        _reports(comparison, Numbers(comparison.to_dict())),
        _worst_cases(comparison),
        *_grids(comparison),
        facts_section(every, comparison.letters, comparison.tolerance),
        *(_changes(letter, change) for letter, change in pairs),
        as_text(comparison.lines()),
    ]
    title = f"{len(comparison.results)} stop reports side by side"
    top = head(title, comparison.letters, changed=comparison.exit_status == 1)
    return page("stopproof: stop reports side by side", top, sections)


def _reports(comparison: StopReportComparison, numbers: Numbers) -> Node:
    rows: list[tuple[Child, ...]] = []
    for k, (letter, each) in enumerate(zip(comparison.letters, comparison.results, strict=True)):
        of = numbers.at("results", k)
        loads: list[Child] = []
        for i in range(len(of["loads_kg"])):
            loads += [", " if loads else None, numbers.show("{:g}", "results", k, "loads_kg", i)]
        spans = [
            "–" if of[what] is None else pair(numbers, "{:.3f}", "", "results", k, what)
            for what in ("time_s", "way_m")
        ]
        total = numbers.show("{:.3f}", "results", k, "total_s", nothing="not bounded")
        tool = "–" if each.tool is None else name(each.tool)
        whose = f"{name(each.answer.stop)}, {name(each.answer.over)}"
        what = (name(comparison.files[k]), name(each.robot), tool, node("span", *loads), whose)
        rows.append((letter, *what, *spans, total))
    heads = (
        "report", "file", "robot", "tool", "load at 100 % [kg]#", "stop", "longest stop [s]#",
        "longest way [m]#", "reaction and stop [s]#",
    )  # fmt: skip
    told = [
        node("p", f"{letter} waives: {'; '.join(note(text) for text in each.waived)}.")
        for letter, each in zip(comparison.letters, comparison.results, strict=True)
        if each.waived
    ]
    told += [
        node("p", f"{letter} was ended before everything was looked at.", class_="missing")
        for letter, each in zip(comparison.letters, comparison.results, strict=True)
        if each.interrupted
    ]
    return section("Stop reports", table("First page of each", heads, rows), *told, anchor="reports")


def _worst_cases(comparison: StopReportComparison) -> Node:
    every = [cases(each) for each in comparison.results]
    rows: list[tuple[Child, ...]] = []
    for key in dict.fromkeys(key for of in every for key in of):
        unit = key[-1]
        spans = [bounds(of[key]) if key in of else None for of in every]
        rows.append((_case(key), *_cells(spans, unit, comparison.tolerance)))
    heads = ("worst case", *(f"{letter}#" for letter in comparison.letters))
    rows = rows[:MOST_ROWS]
    listed = table("Reached at least, and not exceeded; what differs from A is marked with ≠", heads, rows)
    return section("Worst cases", listed, anchor="worst-cases")


def _case(key: Key) -> str:
    stop, over, guessed, quantity, part, _unit = key
    return f"{stop_text(stop, guessed=guessed)}, {name(over)}: {name(quantity)} of {name(part)}"


def _cells(spans: list[Bounds | None], unit: str, tolerance: float) -> Iterator[Child]:
    first = spans[0]
    for each in spans:
        bound = tolerance if unit in ("m", "s") else 0.0
        equal = each is first or (each is not None and first is not None and alike(first, each, bound))
        yield node("span", bounds_text(each, unit), class_="value" if equal else "value changed")


def _grids(comparison: StopReportComparison) -> Iterator[Node]:
    """Yield a section for each stop that has a grid: the maps of all results, one below the other."""
    for stop in dict.fromkeys(grid.stop for each in comparison.results for grid in each.grids):
        parts: list[Child] = []
        guessed = False
        for key, title, unit in _MAPS:
            for letter, report in zip(comparison.letters, comparison.results, strict=True):
                grid = next((each for each in report.grids if each.stop == stop), None)
                if grid is not None:
                    guessed = guessed or grid.guessed
                    parts += _map(grid, report, key, (f"{letter}: {title}", unit))
        body = [watermark(*parts)] if guessed else parts
        yield section(f"Grid, {name(stop)}", *body, anchor=f"grid-{stop.replace('_', '-')}")


def _map(grid: Grid, report: StopReportResult, key: str, what: tuple[str, str]) -> Iterator[Node]:
    title, unit = what
    found = [(cell, getattr(cell.braking, key)) for cell in grid.cells]
    fields = [
        Field(cell.load, cell.speed, grid.extension(cell), each.lower, each.upper)
        for cell, each in found
        if each is not None
    ]
    if fields:
        loads = sorted({each.load for each in fields}) if grid.load_matters else [None]
        load = "" if grid.load_kg is None else f", 100 % of load is {grid.load_kg:g} kg"
        told = f"{title} [{unit}], {name(report.robot)}{load}; the reaction is not in it"
        caption = node("figcaption", f"{told}{mark(guessed=grid.guessed)}.")
        yield node("figure", heat_map(title, unit, fields, loads), caption, class_="chart", tabindex="0")


def _changes(letter: str, change: StopReportDifference) -> Node:
    parts: list[Child] = []
    if not change.changed:
        parts.append(node("p", "Nothing changed."))
    parts += _worst_parts(letter, change.worst_cases)
    parts += _grid_parts(letter, change)
    parts += stated_parts(letter, change)
    return section(f"From A to {letter}", *parts, anchor=f"from-a-to-{letter.lower()}")


def _worst_parts(letter: str, found: tuple[WorstCaseChange, ...]) -> Iterator[Node]:
    if found:
        rows = [
            (
                _case((each.stop, each.over, each.guessed, each.quantity, each.part, each.unit)),
                bounds_text(each.a, each.unit),
                bounds_text(each.b, each.unit),
                "yes" if each.apart else "no",
            )
            for each in found[:MOST_ROWS]
        ]
        yield table("Worst cases with other numbers", ("worst case", "A#", f"{letter}#", "apart"), rows)
        yield node("p", f"{APART[0].upper()}{APART[1:]}.", class_="dim")


def _grid_parts(letter: str, change: StopReportDifference) -> Iterator[Node]:
    rows = []
    for each in change.grids:
        of = f" of {name(each.part)}" if each.part else ""
        extremes = [
            "–" if one is None else f"{shares_text(one)}: {step_text(one.a, one.b, each.unit)}"
            for one in (each.fall, each.rise)
        ]
        counts = [str(n) for n in (each.compared, each.changed, each.apart, each.only_in_a, each.only_in_b)]
        rows.append(
            (f"{stop_text(each.stop, guessed=each.guessed)}: {each.quantity}{of}", *counts, *extremes)
        )
    if rows:
        heads = (
            "quantity", "fields of both#", "with other numbers#", "apart#", "only in A#",
            f"only in {letter}#", "fell most", "rose most",
        )  # fmt: skip
        yield table("Fields of grids", heads, rows)
