"""What `verify` found, as one page: verdicts over time, witnesses, and what the result rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from robots.assumption import Certainty
from verifier.reports.assumptions import OF_THE_MODEL
from verifier.reports.html.budget import budget
from verifier.reports.html.chart import LANES, Curve, Mark, Track, css_class, timeline, words
from verifier.reports.html.elements import Child, Node, Numbers, items, name, node, note, section, table
from verifier.reports.html.page import page
from verifier.reports.html.still_picture import views
from verifier.reports.stretches import Stretch
from verifier.reports.text import REFUSED_HINT, REMEDY, advice, pair_text, whose_stop, why_unbounded
from verifier.reports.verification import VerifyReport
from verifier.verdict import Witness

MOST_STRETCHES, MOST_MAGNIFIED, MOST_REFUSED = 100, 4, 50
"""Rows and charts; how many there are besides is said, and the others are in ``--json``."""
_AROUND_S = 0.5
_STILL = (
    "Sets of the links on this slice, and of people at its end as this model has them; the skeleton is what "
    "was last seen. The pair that decided is red; the dots are the nearest points of its two sets."
)
WITNESSES = (
    (
        "first_witness",
        "First witness",
        "Of the first cycle that is not verified, in its first slice that is open.",
    ),
    (
        "deepest",
        "Deepest slice",
        "Of the same cycle: the slice with the smallest gap, when all have been compared.",
    ),
    ("tightest", "Tightest pair", "Of the verified cycle with the smallest gap."),
)
_CHART = (
    "Above: the verdict of every cycle, a lane for each; one cycle is drawn wider than it is. Gap: of "
    "verified cycles a lower bound over the whole stop, of others that of the nearest pair of the first "
    "slice that is open, negative for an overlap; none where no pair was compared."
)
_BELIEVED = (
    "The result holds in the model and under these assumptions. That nothing contradicts one does not show "
    "that it holds."
)
_WEAKEST_FIRST = (
    Certainty.UNVERIFIED,
    Certainty.ASSUMED,
    Certainty.DEFAULT,
    Certainty.MEASURED,
    Certainty.DECLARED,
    Certainty.SOURCED,
    Certainty.COMPUTED,
)
_OF_CERTAINTY = {
    Certainty.UNVERIFIED: "recalled or from a secondary source; nobody has checked it",
    Certainty.ASSUMED: "an engineering choice without a source",
    Certainty.DEFAULT: "nobody stated it",
    Certainty.MEASURED: "taken from recordings",
    Certainty.DECLARED: "stated by the user",
    Certainty.SOURCED: "read in the named source",
    Certainty.COMPUTED: "derived from other numbers",
}


def verification_page(report: VerifyReport) -> bytes:
    """Return the page of a report; its numbers are those of ``report.to_dict()``."""
    numbers = Numbers(report.to_dict())
    sections = [
        _over_time(report, numbers),
        _witnesses(report, numbers),
        _contradictions(report, numbers),
        _refused(report, numbers),
        _checked(report, numbers),
        _assumptions(report, numbers),
        _inputs(report, numbers),
        _as_text(report),
    ]
    return page(f"stopproof: {name(report.recording)}", _head(report, numbers), sections)


def _head(report: VerifyReport, numbers: Numbers) -> Node:
    waived = f"under {len(report.waived)} waivers (below)" if report.waived else "nothing is waived"
    under = "A1–A7 and the waivers below" if report.waived else "A1–A7"
    of = node("span", " of ", numbers.show("count", "cycles"), f" cycles, under {under}", class_="of")
    verdict = node("p", "verified in the model: ", numbers.show("count", "verified"), of, class_="verdict")
    tiles = [
        _tile(numbers.show("count", status.name.lower()), words(status), css_class(status))
        for status in LANES
    ]
    stops = ("stop_time_s", "median"), ("stop_time_s", "max")
    tiles += [
        _tile(numbers.show("{:.3f} s", *stops[0]), "stop time, median"),
        _tile(numbers.show("{:.3f} s", *stops[1]), "stop time, longest"),
        _tile(
            numbers.show("{:+.4f} m", "tightest", "gap_m") if report.tightest else "–",
            "smallest verified gap",
        ),
    ]
    believed = (
        name(report.robot),
        f"stop: {whose_stop(report.stop_model)}",
        f"profile: {name(report.profile)}",
        waived,
    )
    return node(
        "header",
        node("h1", f"Verification of {name(report.recording)}"),
        node("p", " · ".join(believed), class_="dim"),
        verdict,
        node("ul", *tiles, class_="tiles"),
    )


def _tile(figure: Child, label: str, kind: str = "plain") -> Node:
    return node(
        "li",
        node("span", figure, class_="figure"),
        node("span", label, class_="label"),
        class_=f"tile-{kind}",
    )


def _over_time(report: VerifyReport, numbers: Numbers) -> Node:
    whole = node("figure", _chart(report), node("figcaption", _CHART), class_="chart", tabindex="0")
    return section(
        "Verdicts over time", whole, _reasons(report, numbers), *_stretches(report, numbers), anchor="time"
    )


def _chart(report: VerifyReport, window: tuple[float, float] | None = None) -> Node:
    rows = report.per_cycle
    step = float(rows.t[1] - rows.t[0]) if len(rows.t) > 1 else 1.0
    gap = np.where(np.isfinite(rows.gap_m), rows.gap_m, np.nan).astype(np.float64)
    stop = rows.stop_time_s.astype(np.float64)
    counts = ", ".join(f"{words(status)} {report.count(status)}" for status in LANES)
    when = "" if window is None else f" from {window[0]:.3f} to {window[1]:.3f} s"
    return timeline(
        f"Verdict, gap and stop time over recorded time{when}",
        f"Cycles of the whole recording: {counts}",
        [Track("", rows.t, rows.status, step)],
        [Curve("gap [m]", (gap,), zero=True), Curve("stop time [s]", (stop,), zero=True, height=90.0)],
        _marks(report),
        window,
    )


def _marks(report: VerifyReport) -> list[Mark]:
    named = ((report.first_witness, "first witness"), (report.tightest, "tightest"))
    return [Mark(found.cycle_t, label) for found, label in named if found is not None]


def _reasons(report: VerifyReport, numbers: Numbers) -> Node:
    rows: list[tuple[Child, ...]] = []
    for status in LANES:
        for reason, _n in report.reasons(status):
            key = ("reasons", status.name.lower(), reason.name.lower())
            rows.append((words(status), reason.text, numbers.show("count", *key)))
    rows.append(("together", "", numbers.show("count", "cycles")))
    return table("Cycles by verdict and reason", ("verdict", "reason", "cycles#"), rows)


def _stretches(report: VerifyReport, numbers: Numbers) -> Iterator[Node]:
    failing = report.failing
    if not failing:
        yield node("p", "No cycle is not verified or contradicted.")
        return
    listed = range(min(len(failing), MOST_STRETCHES, len(numbers.at("stretches"))))
    rows = [
        (
            numbers.show("{:.3f}", "stretches", k, "t", 0),
            numbers.show("{:.3f}", "stretches", k, "t", 1),
            words(failing[k].status),
            numbers.show("count", "stretches", k, "cycles"),
            failing[k].reason.text,
        )
        for k in listed
    ]
    heads = ("first cycle at [s]#", "last at [s]#", "verdict", "cycles#", "reason of most of them")
    yield table("Stretches that failed", heads, rows)
    yield _besides(numbers, "stretches_total", len(rows), "stretches")
    for group in _magnified(report, failing):
        yield _magnifier(report, group)


def _magnified(report: VerifyReport, failing: list[Stretch]) -> list[list[Stretch]]:
    """Return the stretches that charts of their own show: those with most cycles, neighbours together."""
    t, groups = report.per_cycle.t, list[list[Stretch]]()
    for each in failing:
        if groups and t[each.first] - t[groups[-1][-1].last] <= 2.0 * _AROUND_S:
            groups[-1].append(each)
        else:
            groups.append([each])
    return sorted(sorted(groups, key=lambda group: -sum(one.cycles for one in group))[:MOST_MAGNIFIED])


def _magnifier(report: VerifyReport, group: list[Stretch]) -> Node:
    t = report.per_cycle.t
    begin, end = float(t[group[0].first]), float(t[group[-1].last])
    kinds = " and ".join(dict.fromkeys(words(each.status) for each in group))
    reasons = "; ".join(dict.fromkeys(each.reason.text for each in group))
    text = f"Magnified, from {begin:.3f} to {end:.3f} s: {kinds}: {reasons}."
    window = (max(begin - _AROUND_S, 0.0), end + _AROUND_S)
    return node("figure", _chart(report, window), node("figcaption", text), class_="chart", tabindex="0")


def _besides(numbers: Numbers, total: str, listed: int, what: str) -> Node:
    others = "." if listed == numbers.at(total) else "; the others are in the JSON result."
    return node("p", f"Listed: {listed} of ", numbers.show("count", total), f" {what}{others}", class_="dim")


def _witnesses(report: VerifyReport, numbers: Numbers) -> Node:
    parts: list[Child] = []
    for key, title, what in WITNESSES:
        found: Witness | None = getattr(report, key)
        if found is None or (key == "deepest" and _is_first(report, found)):
            continue
        parts += [node("h3", title), node("p", what, class_="dim")]
        parts += _witness(report, numbers, (key, title), found)
    if not parts:
        parts.append(node("p", "No pair was compared."))
    parts += _excess(report, numbers)
    return section("Witnesses", *parts, anchor="witnesses")


def _is_first(report: VerifyReport, deepest: Witness) -> bool:
    """Tell whether the deepest slice is the first one that is open: nothing need be shown twice."""
    return report.first_witness is not None and deepest.slice == report.first_witness.slice


def _witness(
    report: VerifyReport, numbers: Numbers, place: tuple[str, str], found: Witness
) -> Iterator[Node]:
    key, title = place
    yield node("p", f"Cycle at t = {found.cycle_t:.3f} s, {pair_text(found)}.")
    still = report.stills.get(key)
    if still is not None:
        titles = (
            "From the side: from left to right runs the line from one of the pair to the other.",
            "From above.",
        )
        figures = [
            node("figure", view, node("figcaption", text))
            for view, text in zip(views(still), titles, strict=True)
        ]
        yield node("div", *figures, class_="views")
        yield node("p", _STILL, class_="dim")
    yield table(f"{title}: the pair", ("what", "value"), _fields(numbers, key, found))
    if math.isnan(found.budget.distance):
        yield node("p", f"No metres can be counted: {why_unbounded(found)}.")
        return
    yield from budget(numbers, key, title, found)
    if not found.other:
        yield node("p", node("strong", "Shrink first: "), advice(found), ".")


def _fields(numbers: Numbers, key: str, found: Witness) -> list[tuple[Child, ...]]:
    rows: list[tuple[Child, ...]] = [
        ("instant of the cycle [s]", numbers.show("{:.3f}", key, "cycle_t")),
        ("slice begins, ends [s]", _both(numbers, key, "slice")),
        ("link", name(found.link)),
    ]
    if found.other:
        rows.append(("fixture or second link", name(found.other)))
    else:
        rows += [
            ("person", name(found.person)),
            ("parts", found.part + (" (inferred)" if found.inferred else "")),
            ("model of people", found.model),
            ("seen before [s]", numbers.show("{:.2f}", key, "age_s")),
        ]
    if found.no_contact:
        rows.append(("contact is declared, but", note(found.no_contact)))
    rows.append(("rule", found.criterion.replace("_", " ")))
    rows.append(("gap [m]", numbers.show("{:+.3f}", key, "gap_m")))
    return rows


def _both(numbers: Numbers, *keys: str) -> Node:
    shown = [numbers.show("{:.3f}", *keys, k) for k in (0, 1)]
    return node("span", shown[0], " – ", shown[1])


def _excess(report: VerifyReport, numbers: Numbers) -> Iterator[Node]:
    if report.first_excess is None:
        return
    excess, key = report.first_excess, "first_limit_excess"
    yield node("h3", "First limit in the way")
    unit = f" [{excess.unit}]" if excess.unit else ""
    rows: list[tuple[Child, ...]] = [
        ("instant [s]", numbers.show("{:.3f}", key, "t")),
        ("joint", name(excess.joint) if excess.joint else "the path itself"),
        (f"{excess.quantity.replace('_', ' ')}{unit}", numbers.show("{:.4g}", key, "value")),
        (f"limit{unit}", numbers.show("{:.4g}", key, "limit")),
    ]
    yield table("The joint limit that first stood in the way of a plan", ("what", "value"), rows)


def _contradictions(report: VerifyReport, numbers: Numbers) -> Node:
    if not report.contradicted:
        text = "Nothing that could be held against this recording contradicts an assumption."
        return section("Contradictions", node("p", text), anchor="contradictions")
    rows = [
        (
            item.assumption,
            note(item.text),
            numbers.show("{:.3f}", "contradictions", k, "first_t"),
            numbers.show("count", "contradictions", k, "cycles"),
            REMEDY[item.reason],
        )
        for k, item in enumerate(report.contradicted)
    ]
    heads = ("assumption", "what was seen first", "at [s]#", "cycles#", "what can be done")
    return section(
        "Contradictions", table("Contradicted by the same recording", heads, rows), anchor="contradictions"
    )


def _refused(report: VerifyReport, numbers: Numbers) -> Node:
    title, anchor = "Refused measurements", "refused"
    if not report.refused_total:
        total = numbers.show("count", "refused_measurements_total")
        return section(title, node("p", total, ": every reading was used."), anchor=anchor)
    reasons = [
        (
            note(reason) + REFUSED_HINT.get(reason, ""),
            numbers.show("count", "refused_measurements_by_reason", reason),
        )
        for reason, _n in report.refused_for
    ]
    reasons.append(("together", numbers.show("count", "refused_measurements_total")))
    listed = report.refused[:MOST_REFUSED]
    rows = [
        (
            numbers.show("{:.3f}", "refused_measurements", k, "stamp"),
            name(item.person) if item.person else "the whole report",
            name(item.point) if item.point else "–",
            note(item.reason),
        )
        for k, item in enumerate(listed)
    ]
    return section(
        title,
        node("p", "A reading that is refused is not used; the last good one keeps growing."),
        table("By reason", ("reason", "readings#"), reasons),
        table("The first of them", ("stamp [s]#", "person", "point", "reason"), rows),
        _besides(numbers, "refused_measurements_total", len(rows), "readings"),
        anchor=anchor,
    )


def _checked(report: VerifyReport, numbers: Numbers) -> Node:
    def plain(texts: tuple[str, ...]) -> str:
        return ", ".join(text.replace("_", " ") for text in texts) or "nothing"

    waived = items(note(text) for text in report.waived) if report.waived else node("p", "Nothing.")
    stops = numbers.show("count", "stops_in_joint_space")
    return section(
        "What was checked, and what was not",
        node("p", node("strong", "Checked: "), plain(report.checked_criteria), "."),
        node("p", node("strong", "Not checked: "), plain(report.not_checked_criteria), "."),
        node("h3", "Waived"),
        waived,
        node("p", "Stops that leave the path: ", stops, "."),
        node("h3", "Notes"),
        items(note(text) for text in report.notes) if report.notes else node("p", "None."),
        anchor="checked",
    )


def _assumptions(report: VerifyReport, numbers: Numbers) -> Node:
    heads = ("name", "assumption", "contradicted in cycles#")
    against = [(each, text, _contradicted_in(report, each)) for each, text in OF_THE_MODEL]
    parts: list[Child] = [
        node("p", _BELIEVED),
        table("A1 to A7", heads, against),
    ]
    for certainty in _WEAKEST_FIRST:
        which = [k for k, item in enumerate(report.assumptions) if item.certainty is certainty]
        if which:
            rows = [_assumption(report, numbers, k) for k in which]
            caption = f"{certainty} ({len(rows)}): {_OF_CERTAINTY[certainty]}"
            parts.append(table(caption, ("name", "value#", "unit", "source"), rows))
    return section("Assumptions", *parts, anchor="assumptions")


def _contradicted_in(report: VerifyReport, each: str) -> str:
    cycles = [item.cycles for item in report.contradicted if item.assumption.split()[0] == each]
    return str(sum(cycles)) if cycles else "–"


def _assumption(report: VerifyReport, numbers: Numbers, k: int) -> tuple[Child, ...]:
    item = report.assumptions[k]
    is_text = isinstance(item.value, str)
    value = (
        name(item.value) if is_text else numbers.show("{:g}", "assumptions", k, "value", nothing="infinite")
    )
    return name(item.name), value, item.unit, note(item.source)


def _inputs(report: VerifyReport, numbers: Numbers) -> Node:
    rows = [
        (name(item.what), name(item.file), numbers.show("count", "inputs", k, "bytes"), _hash(item.sha256))
        for k, item in enumerate(report.inputs)
    ]
    others: list[tuple[Child, ...]] = [
        ("hash of all values of the cell, content of the robot included", _hash(report.cell_hash)),
        ("version of stopproof", report.version),
        ("start of the overlap on the recording's clock [ns]", numbers.show("{}", "start_ns")),
        ("recorded time / computing time, decoding apart", numbers.show("{:.1f}", "real_time_factor")),
    ]
    return section(
        "Inputs",
        table("Files", ("what", "file", "bytes#", "SHA-256"), rows),
        table("The run", ("what", "value"), others),
        anchor="inputs",
    )


def _hash(text: str) -> Node:
    return node("span", text, class_="hash")


def _as_text(report: VerifyReport) -> Node:
    text = node("pre", "")
    text.text = "\n".join(note(line) for line in report.lines())
    whole = node("details", node("summary", "What the command line prints"), text)
    return section("As text", whole, anchor="text")
