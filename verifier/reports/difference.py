"""What `diff` prints: results side by side, and what changed, most important first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from verifier.changes import ChangedStatements, Value
from verifier.difference import Difference, Outcome, Range, SeriesChange, difference
from verifier.reports.side_by_side import Comparison
from verifier.reports.text import counted, cycles, spaced
from verifier.result import VerifyResult
from verifier.shown import LONGEST_VALUE, shown, with_unit
from verifier.verdict import Reason, Status

MOST_RESULTS = 6
"""More curves in one picture cannot be told apart."""
RANGES_SHOWN = 12
TEXTS_SHOWN = 50
KINDS = {"notes": "note"}
"""What one text of a kind is called, where it is not called as its kind."""


class VerifyComparison(Comparison[VerifyResult, Difference]):
    """Results of `verify`; docs/diff.schema.json describes the JSON."""

    FORMAT = "stopproof diff 1"

    def summary(self, result: VerifyResult) -> dict[str, Any]:
        """Return what was verified, under what, and how often."""
        counts = ("cycles", "verified", "not_verified", "contradicted", "not_checked")
        names = ("recording", "robot", "profile", "stop_model", "cell_hash", "version")
        return {
            **{name: getattr(result, name) for name in names},
            **{name: getattr(result, name) for name in counts},
            "tightest_gap_m": None if result.tightest is None else result.tightest.gap_m,
            "stop_time_s": {"median": result.stop_time_s.median, "max": result.stop_time_s.max},
            "waived": list(result.waived),
        }

    def what(self, result: VerifyResult) -> str:
        """Return what was verified, and how often."""
        counts = f"verified in the model: {spaced(result.verified)} of {spaced(result.cycles)} cycles"
        waived = f", {counted(len(result.waived), 'waiver')}" if result.waived else ""
        return f"{shown(result.recording)}, {shown(result.robot)}, {shown(result.profile)}: {counts}{waived}"

    def change_lines(self, change: Difference, letter: str) -> Iterator[str]:
        """Yield cycles, then what is stated."""
        yield from _cycle_lines(change, letter)
        yield from stated_lines(change, letter)


def compare_results(
    paths: Sequence[str], results: Sequence[VerifyResult], tolerance: float
) -> VerifyComparison:
    """Compare results of `verify`, each with the path of its file, with the first one of them."""
    first, *others = results
    changes = tuple(difference(first, each, tolerance) for each in others)
    return VerifyComparison(tuple(paths), tuple(results), tolerance, changes)


def stated_lines(change: ChangedStatements, letter: str) -> Iterator[str]:
    """Yield numbers, assumptions, inputs and texts that changed from A to ``letter``."""
    if change.numbers:
        yield "numbers:"
    for item in change.numbers:
        yield f"  {shown(item.name, LONGEST_VALUE)}: {arrow(item.a, item.b, item.unit)}"
    if change.assumptions:
        yield f"assumptions: {len(change.assumptions)} changed"
    for one in change.assumptions:
        yield f"  {shown(one.name, LONGEST_VALUE)}: {stated(one.a)} → {stated(one.b)}"
    if change.inputs:
        yield "inputs:"
    for each in change.inputs:
        yield f"  {shown(each.what)}: {file_text(each.a)} → {file_text(each.b)}"
    for text in change.texts[:TEXTS_SHOWN]:
        where = "A" if text.only_in == "a" else letter
        yield f"{KINDS.get(text.kind, text.kind)}, only in {where}: {shown(text.text, LONGEST_VALUE)}"
    if len(change.texts) > TEXTS_SHOWN:
        yield f"and {spaced(len(change.texts) - TEXTS_SHOWN)} more waivers and notes (--json)"


def _cycle_lines(change: Difference, letter: str) -> Iterator[str]:
    some = change.cycles
    clock = "the recording's clock" if some.clock == "recording" else "time since the start of each"
    verdicts, reasons = spaced(some.status_changed), spaced(some.reason_changed)
    changed = f"{verdicts} with another verdict, {reasons} with another reason alone"
    yield f"cycles: {spaced(some.compared)} compared by {clock}: {changed}"
    if some.only_in_a or some.only_in_b:
        yield f"  only in A: {spaced(some.only_in_a)}; only in {letter}: {spaced(some.only_in_b)}"
    for each in some.ranges[:RANGES_SHOWN]:
        yield f"  {range_text(each)}"
    if some.ranges_total > RANGES_SHOWN:
        yield f"  and {spaced(some.ranges_total - RANGES_SHOWN)} more ranges (--json)"
    yield from _series_lines("gap", "m", some.gap_m)
    yield from _series_lines("stop time", "s", some.stop_time_s)


def _series_lines(what: str, unit: str, change: SeriesChange) -> Iterator[str]:
    if change.changed:
        yield f"{what}: another one in {cycles(change.changed)}"
    for label, one in (("fell most", change.fall), ("rose most", change.rise)):
        if one is not None:
            step = one.b - one.a
            yield f"  {label} at t = {one.t:.3f} s: {one.a:.4f} → {one.b:.4f} {unit} ({step:+.4f} {unit})"


def range_text(each: Range) -> str:
    """Return when, how many, and from which outcome to which."""
    when = f"{each.t[0]:.3f} – {each.t[1]:.3f} s"
    both = " → ".join(f"{status_text(side)} ({shown(side.reason)})" for side in (each.a, each.b))
    return f"{when:<21} {cycles(each.cycles, 7)}  {both}"


def status_text(each: Outcome) -> str:
    """Return the name of a status in words."""
    return Status(each.status).name.lower().replace("_", " ")


def outcome(each: Outcome) -> str:
    """Return status and reason in whole words."""
    reason = Reason.__members__.get(each.reason.upper())
    text = shown(each.reason) if reason is None else reason.text
    return f"{status_text(each)} ({text})"


def arrow(a: Value, b: Value, unit: str) -> str:
    """Return both values and, of numbers, by how much they differ."""
    both = f"{value_text(a, unit)} → {value_text(b, unit)}"
    if isinstance(a, str) or isinstance(b, str) or a is None or b is None:
        return both
    return f"{both} ({with_unit(f'{b - a:+.6g}', unit)})"


def value_text(value: Value, unit: str = "") -> str:
    """Return one value with its unit."""
    if value is None:
        return "none"
    if isinstance(value, str):
        return with_unit(value, unit) if value else "''"
    return with_unit(spaced(value) if isinstance(value, int) else f"{value:.6g}", unit)


def stated(item: Any) -> str:
    """Return value, certainty and source of an assumption."""
    if item is None:
        return "not stated"
    value = "infinite" if item["value"] is None else value_text(item["value"], item["unit"])
    return f"{value} ({shown(item['certainty'])}: {shown(item['source'])})"


def file_text(item: Any) -> str:
    """Return name and the first digits of the hash of an input."""
    return "none" if item is None else f"{shown(item['file'])} ({shown(item['sha256'][:12])}…)"
