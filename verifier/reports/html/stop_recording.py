"""What a stop report says of a recording: the stop of every cycle, and S_p against the separation."""

from __future__ import annotations

from collections.abc import Iterator

from verifier.reports.html.chart import Mark
from verifier.reports.html.elements import Child, Node, Numbers, name, node, note, section, table
from verifier.reports.html.over_time import Panel, Series, over_time
from verifier.stop_report.report import StopReport, Window

_EVERY = "The stop that is planned for each cycle."
_ZOOM = (
    "Where the separation lies below what is required, somebody was too near for it. With the buttons, a "
    "double click, or the wheel and shift the chart is magnified; drag it to move it."
)


def recording_sections(report: StopReport, numbers: Numbers) -> Iterator[Node]:
    """Yield the sections about a recording: its stops, and S_p against the separation; none without one."""
    found, key = report.recorded, "recorded"
    if found is None:
        return
    rows: list[tuple[Child, ...]] = [
        ("cycles", numbers.show("count", key, "cycles")),
        ("looked at", numbers.show("count", key, "looked_at")),
        ("with a stop", numbers.show("count", key, "planned")),
        ("of these, stops that leave the path", numbers.show("count", key, "off_path")),
        ("without a stop within the limits", numbers.show("count", key, "without_stop")),
        ("whose motion ends before their stop", numbers.show("count", key, "beyond_end")),
    ]
    worst = [Mark(each.t, "longest stop") for each in _instants(report)]
    chart = over_time(
        "Time of the stop of every cycle", "Time of the stop over recorded time",
        [Panel("stop time [s]", (Series("stop time", found.t, found.stop_time_s),))], worst,
        anchor="stops-chart", axis="recorded time [s]",
    )  # fmt: skip
    yield section(
        "Stops over the recording",
        node("figure", chart, node("figcaption", _EVERY), class_="chart", tabindex="0"),
        table("Cycles", ("cycles", "number#"), rows),
        anchor="recorded",
    )  # fmt: skip
    yield _separation(report, numbers)


def _instants(report: StopReport) -> list[Window]:
    case = None if report.recorded is None else report.recorded.case
    return [] if case is None else [each for each in case.instants[:1] if each is not None]


def _separation(report: StopReport, numbers: Numbers) -> Node:
    title, anchor = "S_p against the separation", "separation"
    found, key = report.separation, "protective_separation"
    if found is None:
        return section(title, node("p", "missing", class_="missing"), anchor=anchor)
    parts: list[Child] = [
        node(
            "p", "Separation below S_p (ISO/TS 15066:2016) in ", numbers.show("count", key, "too_close"),
            " of ", numbers.show("count", key, "compared"), " cycles that could be compared. Of the pair of "
            "link and person with the least room in each cycle.",
        )
    ]  # fmt: skip
    marks = [] if found.worst is None else [Mark(found.worst.t, "least room")]
    series = (
        Series("separation", found.t, found.separation_m),
        Series("S_p, what is required", found.t, found.required_m),
    )
    chart = over_time(
        "S_p and the separation over recorded time", f"Below in {found.too_close} of {found.compared} cycles",
        [Panel("distance [m]", series, 220.0)], marks, anchor="separation-chart", axis="recorded time [s]",
    )  # fmt: skip
    parts.append(node("figure", chart, node("figcaption", _ZOOM), class_="chart", tabindex="0"))
    if found.worst is not None:
        parts.append(_least_room(report, numbers))
    return section(title, *parts, anchor=anchor)


def _least_room(report: StopReport, numbers: Numbers) -> Node:
    key = ("protective_separation", "worst")
    worst = numbers.at(*key)
    rows: list[tuple[Child, ...]] = [
        ("instant", numbers.show("{:.3f}", *key, "t"), "s", "–", "since the start of the overlap"),
        ("link", name(worst["link"]), "", "–", ""),
        ("person", name(worst["person"]), "", "–", ""),
        (
            "separation",
            numbers.show("{:.3f}", *key, "separation_m"),
            "m",
            "computed",
            "between their enclosures",
        ),
        (
            "S_p",
            numbers.show("{:.3f}", *key, "required", "distance_m"),
            "m",
            "computed",
            "of the terms below",
        ),
        ("room", numbers.show("{:+.3f}", *key, "room_m"), "m", "computed", "separation less S_p"),
    ]
    for i, item in enumerate(worst["required"]["terms"]):
        place = (*key, "required", "terms", i, "value")
        value: Child = item["value"] if isinstance(item["value"], str) else numbers.show("{:.4g}", *place)
        rows.append((item["name"], value, item["unit"], item["certainty"], note(item["source"])))
    return table("The instant with the least room", ("what", "value#", "unit", "certainty", "source"), rows)
