"""Results of `verify` side by side as one page: robots, payloads, limits, or versions of a program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from verifier.changes import ChangedStatements, Facts, Value, allowed, same
from verifier.difference import Difference, facts
from verifier.reports.difference import (
    KINDS,
    VerifyComparison,
    file_text,
    outcome,
    stated,
    value_text,
)
from verifier.reports.html.chart import LANES, Curve, Track, timeline, words
from verifier.reports.html.elements import Child, Node, Numbers, name, node, note, section, table
from verifier.reports.html.page import page

MOST_ROWS = 200
"""Of a table; how many there are besides is said, and the others are in ``--json``."""
_CHART = (
    "Verdicts of each result, a lane for each verdict, and below them gap and stop time: A drawn through, "
    "the others dashed, each in its own way. The axis is the time since the start of each."
)


def side_by_side_page(comparison: VerifyComparison) -> bytes:
    """Return the page of a comparison; its numbers are those of ``comparison.to_dict()``."""
    numbers = Numbers(comparison.to_dict())
    pairs = zip(comparison.letters[1:], comparison.changes, strict=True)
    sections = [
        _results(comparison, numbers),
        _over_time(comparison),
        facts_section([facts(each) for each in comparison.results], comparison.letters, comparison.tolerance),
        *(_changes(letter, k, change, numbers) for k, (letter, change) in enumerate(pairs)),
        as_text(comparison.lines()),
    ]
    title = f"{len(comparison.results)} results side by side"
    top = head(title, comparison.letters, changed=comparison.exit_status == 1)
    return page("stopproof: results side by side", top, sections)


def head(title: str, letters: str, *, changed: bool) -> Node:
    """Return the head of a page of results A, B, …"""
    said = "something changed" if changed else "nothing changed"
    return node(
        "header",
        node("h1", title),
        node("p", f"From A to {' and '.join(letters[1:])}: {said}.", class_="verdict"),
    )


def _results(comparison: VerifyComparison, numbers: Numbers) -> Node:
    rows: list[tuple[Child, ...]] = []
    for k, (letter, each) in enumerate(zip(comparison.letters, comparison.results, strict=True)):
        counts = [numbers.show("count", "results", k, status.name.lower()) for status in LANES]
        gap = numbers.show("{:+.4f}", "results", k, "tightest_gap_m")
        stop = numbers.show("{:.3f}", "results", k, "stop_time_s", "max")
        what = (name(comparison.files[k]), name(each.recording), name(each.robot), name(each.profile))
        rows.append((letter, *what, numbers.show("count", "results", k, "cycles"), *counts, gap, stop))
    names = ("result", "file", "recording", "robot", "profile", "cycles#")
    heads = (
        *names,
        *(f"{words(status)}#" for status in LANES),
        "smallest verified gap [m]#",
        "longest stop [s]#",
    )
    waived = [
        node("p", f"{letter} waives: {'; '.join(note(text) for text in each.waived)}.")
        for letter, each in zip(comparison.letters, comparison.results, strict=True)
        if each.waived
    ]
    return section("Results", table("Verified in the model", heads, rows), *waived, anchor="results")


def _over_time(comparison: VerifyComparison) -> Node:
    results = comparison.results
    tracks = [
        Track(
            f"{letter}: {name(file)}",
            np.array(each.per_cycle.t),
            np.array(each.per_cycle.status, np.uint8),
            each.step_s,
        )
        for letter, file, each in zip(comparison.letters, comparison.files, results, strict=True)
    ]
    curves = [
        Curve("gap [m]", tuple(each.series("gap_m") for each in results), zero=True, height=190.0),
        Curve(
            "stop time [s]", tuple(each.series("stop_time_s") for each in results), zero=True, height=110.0
        ),
    ]
    counts = "; ".join(
        f"{letter}: {each.verified} of {each.cycles} cycles verified"
        for letter, each in zip(comparison.letters, results, strict=True)
    )
    chart = timeline("Verdicts, gap and stop time over recorded time", counts, tracks, curves)
    return section(
        "Over time",
        node("figure", chart, node("figcaption", _CHART), class_="chart", tabindex="0"),
        anchor="time",
    )


def facts_section(every: Sequence[Facts], letters: str, tolerance: float) -> Node:
    """Return numbers and names of the results, a column each."""
    places = [
        place for place in dict.fromkeys(key for of in every for key in of) if _shown_always(place, every)
    ]
    rows: list[tuple[Child, ...]] = []
    for place in places:
        values = [of.get(place, ("", None)) for of in every]
        unit = next((unit for unit, _value in values if unit), "")
        rows.append((place, unit, *_cells([value for _unit, value in values], unit, tolerance)))
    heads = ("what", "unit", *(f"{letter}#" for letter in letters))
    listed = table("Numbers and names; what differs from A is marked with ≠", heads, rows)
    return section("Numbers", listed, anchor="numbers")


def _shown_always(place: str, every: Sequence[Facts]) -> bool:
    """Leave out what nobody states, and texts, which have a table of their own where they differ."""
    known = any(of.get(place, ("", None))[1] not in (None, "") for of in every)
    return known and not place.endswith(".text") and place != "cell_hash"


def _cells(values: list[Value], unit: str, tolerance: float) -> Iterator[Child]:
    bound = allowed(tolerance, unit)
    for value in values:
        text = "–" if value in (None, "") else value_text(value)
        kind = "value" if same(values[0], value, bound) else "value changed"
        yield node("span", text, class_=kind)


def _changes(letter: str, k: int, change: Difference, numbers: Numbers) -> Node:
    parts: list[Child] = []
    if not change.changed:
        parts.append(node("p", "Nothing changed."))
    else:
        parts += _cycle_parts(letter, k, change, numbers)
        parts += stated_parts(letter, change)
    return section(f"From A to {letter}", *parts, anchor=f"from-a-to-{letter.lower()}")


def _cycle_parts(letter: str, k: int, change: Difference, numbers: Numbers) -> Iterator[Node]:
    key, some = ("changes", k, "cycles"), change.cycles
    clock = "the recording's clock" if some.clock == "recording" else "the time since the start of each"
    names = (
        ("compared", f"compared, by {clock}"),
        ("status_changed", "with another verdict"),
        ("reason_changed", "with the same verdict for another reason"),
        ("only_in_a", "only in A"),
        ("only_in_b", f"only in {letter}"),
    )
    rows: list[tuple[Child, ...]] = [(text, numbers.show("count", *key, one)) for one, text in names]
    rows += [
        (f"with another {text}", numbers.show("count", *key, one, "changed"))
        for one, text in (("gap_m", "gap"), ("stop_time_s", "stop time"))
    ]
    yield table("Cycles", ("cycles that are", "cycles#"), rows)
    ranges = [
        (
            numbers.show("{:.3f}", *key, "ranges", i, "t", 0),
            numbers.show("{:.3f}", *key, "ranges", i, "t", 1),
            numbers.show("count", *key, "ranges", i, "cycles"),
            outcome(each.a),
            outcome(each.b),
        )
        for i, each in enumerate(some.ranges[:MOST_ROWS])
    ]
    if ranges:
        heads = ("first cycle at [s]#", "last at [s]#", "cycles#", "A", letter)
        yield table("Cycles with another outcome, by ranges", heads, ranges)
        total = numbers.show("count", *key, "ranges_total")
        yield node("p", f"Listed: {len(ranges)} of ", total, " ranges.", class_="dim")
    extremes = [
        (
            text,
            numbers.show("{:.3f}", *key, series, side, "t"),
            numbers.show("{:.4f}", *key, series, side, "a"),
            numbers.show("{:.4f}", *key, series, side, "b"),
        )
        for series, what in (("gap_m", "gap [m]"), ("stop_time_s", "stop time [s]"))
        for side, text in (("fall", f"{what} fell most"), ("rise", f"{what} rose most"))
        if getattr(getattr(some, series), side) is not None
    ]
    if extremes:
        yield table("Largest changes of one cycle", ("what", "at [s]#", "A#", f"{letter}#"), extremes)


def stated_parts(letter: str, change: ChangedStatements) -> Iterator[Node]:
    """Yield tables of numbers, assumptions, inputs and texts that changed from A to ``letter``."""
    if change.numbers:
        rows: list[tuple[Child, ...]] = [
            (name(item.name), item.unit, *map(_value, (item.a, item.b)), _step(item.a, item.b))
            for item in change.numbers
        ]
        heads = ("what", "unit", "A#", f"{letter}#", "difference#")
        yield table("Numbers and names that changed", heads, rows)
    yield from _stated_parts(letter, change)


def _value(value: Value) -> Node:
    return node("span", value_text(value), class_="value")


def _step(a: Value, b: Value) -> str:
    if isinstance(a, str) or isinstance(b, str) or a is None or b is None:
        return "–"
    return f"{b - a:+.6g}"


def _stated_parts(letter: str, change: ChangedStatements) -> Iterator[Node]:
    heads = ("what", "A", letter)
    if change.assumptions:
        rows = [(name(item.name), stated(item.a), stated(item.b)) for item in change.assumptions[:MOST_ROWS]]
        yield table(f"Assumptions that changed: {len(change.assumptions)}", heads, rows)
    if change.inputs:
        files = [(name(item.what), file_text(item.a), file_text(item.b)) for item in change.inputs]
        yield table("Inputs that changed", heads, files)
    if change.texts:
        texts = [
            (
                KINDS.get(item.kind, item.kind),
                "A" if item.only_in == "a" else letter,
                note(item.text),
            )
            for item in change.texts
        ]
        yield table("Waivers and notes of one of them", ("kind", "only in", "text"), texts)


def as_text(lines: Sequence[str]) -> Node:
    """Return what the command line prints."""
    text = node("pre", "")
    text.text = "\n".join(note(line) for line in lines)
    return section(
        "As text", node("details", node("summary", "What the command line prints"), text), anchor="text"
    )
