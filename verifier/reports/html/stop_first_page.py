"""The first page of a stop report: whose stop, its largest numbers, and what they do not stand for."""

from __future__ import annotations

from collections.abc import Iterator

from verifier.reports.html.elements import Child, Node, Numbers, name, node, note, table
from verifier.reports.html.pose_picture import MARKS, clearest, pose_views
from verifier.reports.html.stop_numbers import angle, configuration, pair
from verifier.reports.stop_report import (
    INTERRUPTED,
    distance_lines,
    drive_lines,
    other_distance_lines,
    rests_on_lines,
    speed_text,
    whose,
)
from verifier.reports.text import DISCLAIMER
from verifier.stop_report.report import ANY_MOTION, BRAKES, StopReport

_TWO = "Two numbers: the first is reached in the model, the second is not exceeded in the model."


def first_page(report: StopReport, numbers: Numbers) -> Node:
    """Return the first page: whose stop, the largest numbers, the distance, the worst pose."""
    case = report.answer
    answer = numbers.at("answer")
    waived = f"waived: {len(report.waived)} (below)" if report.waived else "nothing is waived"
    told = [node("p", INTERRUPTED, class_="verdict missing")] if report.interrupted else []
    tiles = [
        _tile(
            numbers.show("{:.3f} s", "answer", "total_s", nothing="not bounded"),
            "T: reaction and stop together, at most",
        ),
        _tile(pair(numbers, "{:.3f}", "s", "worst_case", answer["time"]), "longest stop, once it has begun"),
        _tile(numbers.show("{:.3f} s", "reaction", "seconds"), "reaction before it"),
        _tile(
            pair(numbers, "{:.3f}", "m", "worst_case", answer["way"]),
            "longest way of a point, once the stop has begun",
        ),
        _tile(pair(numbers, "{:.3f}", "m/s", "worst_case", answer["point_speed"]), "fastest point"),
        _distance_tile(report, numbers),
    ]
    listed = _axes(report, numbers)
    picture: list[Child] = []
    if report.poses:
        view, caption = pose_views(report.poses[0])[clearest(report.poses[0])]
        told_of_it = f"{_sentence(report.poses[0].title)}. {caption} {MARKS}"
        picture.append(node("figure", view, node("figcaption", told_of_it)))
    moved = speed_text(report) if case.over == ANY_MOTION else f"recording: {name(report.recording)}"
    believed = (
        name(report.robot),
        moved,
        f"tool: {name(report.tool or 'not declared')}",
        waived,
    )
    return node(
        "header",
        node("h1", f"Worst-case stops of {name(report.robot)}"),
        node("p", f"Stop: {whose(case)}.", class_="verdict"),
        node("p", " · ".join(believed), class_="dim"),
        *told,
        node("ul", *tiles, class_="tiles"),
        node("div", listed, *picture, class_="views"),
        *(node("p", _sentence(line)) for line in distance_lines(report)),
        *(node("p", _sentence(line), class_="missing") for line in other_distance_lines(report)),
        *_besides(report),
        _next(report),
        node("p", _TWO, class_="dim"),
        node("p", DISCLAIMER, class_="dim"),
        class_="first-page",
    )  # fmt: skip


def _axes(report: StopReport, numbers: Numbers) -> Node:
    """The angle of each axis, and from which speed: of the recorded state, or of any."""
    recorded = report.answer.over != ANY_MOTION
    rows: list[tuple[Child, ...]] = []
    for k, place in enumerate(numbers.at("answer", "angles")):
        unit = report.units[k]
        key: tuple[str | int, ...] = (
            ("worst_case", place, "speeds", k) if recorded else ("answer", "speeds", k)
        )
        known = not recorded or numbers.at("worst_case", place, "speeds") is not None
        speed: Child = configuration(numbers, unit, *key) if known else "–"
        rows.append((name(report.joints[k]), speed, angle(numbers, unit, "worst_case", place)))
    speed_head = "from a speed of [°/s, m/s]#" if recorded else "from speeds up to [°/s, m/s]#"
    heads = ("axis", speed_head, "largest displacement#")
    return table("Angle of each axis, once the stop has begun", heads, rows)


def _besides(report: StopReport) -> Iterator[Node]:
    """Say what the numbers of the first page do not stand for."""
    if report.answer.over == ANY_MOTION and report.answer.stop not in ("measured", BRAKES):
        text = (
            "A stop on the path takes as long as the path asks for: no number bounds it over all paths (see "
            "worst cases). With --recording this page is about the stops of that motion."
        )
        yield node("p", text)
    waived = [f"waived: {'; '.join(map(note, report.waived))}"] if report.waived else []
    for line in (*waived, *rests_on_lines(report), *drive_lines(report)):
        yield node("p", _sentence(line), class_="missing")
    found = report.recorded
    if found is not None and found.without_stop:
        text = (
            f"{found.without_stop} cycles of the recording have no stop within the joint limits: these "
            "numbers are not about them."
        )
        yield node("p", text, class_="missing")


def _next(report: StopReport) -> Node:
    """Say what is to be done with the page."""
    steps: list[Child] = ["Next: "]
    if report.missing:
        steps += ["state ", node("a", "what is missing", href="#missing"), "; "]
    steps += [
        "look through ", node("a", "the assumptions", href="#assumptions"), ", the least certain first; ",
        "drive ", node("a", "the stops to be measured", href="#to-measure"),
        " on the real robot. No distance is to be taken from this page before that.",
    ]  # fmt: skip
    return node("p", *steps)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _tile(figure: Child, label: str) -> Node:
    return node(
        "li", node("span", figure, class_="figure"), node("span", label, class_="label"), class_="tile-plain"
    )


def _distance_tile(report: StopReport, numbers: Numbers) -> Node:
    places = numbers.at("answer", "required_distances")
    if not places:
        return _tile(node("span", "missing", class_="missing"), "required distance")
    k, each = places[0], report.distances[places[0]]
    label = f"required distance S, {each.edition}"
    if each.required is None:
        lacking = ", ".join(item.what for item in each.missing)
        return _tile(node("span", "missing", class_="missing"), f"{label}: {lacking} missing")
    certain = f"{label}, {each.required.formula.certainty}"
    return _tile(numbers.show("{:.3f} m", "required_distances", k, "distance_m"), certain)
