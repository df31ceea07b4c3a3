"""A stop report as one page: the answer first, then every bracket, the grids, and what it rests on."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files

import numpy as np

from robots.assumption import Certainty
from robots.limits import Array
from verifier.reports.html.elements import Child, Node, Numbers, add, items, name, node, note, section, table
from verifier.reports.html.over_time import Panel, Series, over_time
from verifier.reports.html.page import page
from verifier.reports.html.pose_picture import MARKS, pose_views
from verifier.reports.html.stop_first_page import first_page
from verifier.reports.html.stop_grids import grid_sections
from verifier.reports.html.stop_numbers import (
    DEGREES,
    both_lines,
    configuration,
    joint_values,
    mark,
    watermark,
)
from verifier.reports.html.stop_recording import recording_sections
from verifier.reports.stop_report import (
    NOT_CLAIMED,
    report_lines,
)
from verifier.stop_report.as_json import report_dict
from verifier.stop_report.report import ANY_MOTION, WORDS, Profile, StopReport

WEAKEST_FIRST = (
    (Certainty.UNVERIFIED, "recalled or second hand; nobody has checked it"),
    (Certainty.ASSUMED, "an engineering choice without a source"),
    (Certainty.DEFAULT, "nobody stated it; this software's default"),
    (Certainty.MEASURED, "taken from recordings"),
    (Certainty.DECLARED, "stated by the user"),
    (Certainty.SOURCED, "read in the named source"),
    (Certainty.COMPUTED, "derived from other numbers"),
)
_POSE = (
    f"Capsules that contain the arm, in the state from which the lower number is reached. {MARKS} Floor, "
    "fixtures and the arm itself were not looked at: the worst pose may be one that the cell does not allow."
)


def stop_report_page(report: StopReport) -> bytes:
    """Return the page of a report; its numbers are those of :func:`verifier.stop_report.as_json.report_dict`.

    The page can be read without its script, which magnifies charts and turns a picture.
    """
    numbers = Numbers(report_dict(report))
    sections = [
        _distances(report, numbers),
        _worst_cases(report, numbers),
        *grid_sections(report, numbers),
        _poses(report, numbers),
        _profile(report),
        *recording_sections(report, numbers),
        *_torques(report, numbers),
        _to_measure(report, numbers),
        _missing(report),
        _assumptions(report, numbers),
        _inputs(report, numbers),
        _as_text(report),
    ]
    script = files("verifier.reports.html").joinpath("stop_report.js").read_text(encoding="utf-8")
    return page(
        f"stopproof: worst-case stops of {name(report.robot)}", first_page(report, numbers), sections, script
    )


def _distances(report: StopReport, numbers: Numbers) -> Node:
    parts: list[Child] = [
        node(
            "p", "From when somebody is where the robot must stop, to its rest: the reaction, then the stop. "
            "No formula here has been compared with a licensed copy of a standard.",
        )
    ]  # fmt: skip
    rows: list[tuple[Child, ...]] = [
        (
            part.name,
            numbers.show("{:.3f}", "reaction", "parts", k, "value"),
            str(part.certainty),
            note(part.source),
        )
        for k, part in enumerate(report.reaction.parts)
    ]
    rows.append(("together", numbers.show("{:.3f}", "reaction", "seconds"), "computed", "their sum"))
    parts.append(table("Reaction", ("part", "s#", "certainty", "source"), rows))
    for k, each in enumerate(report.distances):
        title = f"{each.form}, {each.edition}; stop: {each.stop}, {each.over}"
        if each.required is None:
            parts.append(_lacking(title, k, report, numbers))
        else:
            parts.append(_required(title, k, numbers))
    return section("Required distances", *parts, anchor="distances")


def _lacking(title: str, k: int, report: StopReport, numbers: Numbers) -> Node:
    each, key = report.distances[k], ("required_distances", k)
    rows: list[tuple[Child, ...]] = [
        (
            item.name,
            numbers.show("{:.3f}", *key, "known", i, "value"),
            item.unit,
            str(item.certainty),
            note(item.source),
        )
        for i, item in enumerate(each.known)
    ]
    rows += [
        (
            item.what,
            node("span", "missing", class_="missing"),
            "",
            "–",
            f"{item.why}{_stated_by(item.remedy)}",
        )
        for item in each.missing
    ]
    rows.append(("S", node("span", "missing", class_="missing"), "m", "–", "a term is missing"))
    return table(title, ("term", "value#", "unit", "certainty", "source"), rows)


def _required(title: str, k: int, numbers: Numbers) -> Node:
    key = ("required_distances", k, "required", "terms")
    rows: list[tuple[Child, ...]] = []
    for i, item in enumerate(numbers.at(*key)):
        is_text = isinstance(item["value"], str)
        value: Child = item["value"] if is_text else numbers.show("{:.4g}", *key, i, "value")
        rows.append((item["name"], value, item["unit"], item["certainty"], note(item["source"])))
    total = numbers.show("{:.3f}", "required_distances", k, "distance_m")
    rows.append(("S", total, "m", "no surer than its terms", "of the terms above"))
    return table(title, ("term", "value#", "unit", "certainty", "source"), rows)


def _stated_by(remedy: str) -> str:
    return f"; state it: {remedy}" if remedy else ""


def _worst_cases(report: StopReport, numbers: Numbers) -> Node:
    parts: list[Child] = [node("p", f"{NOT_CLAIMED.capitalize()}.")]
    for case in report.cases:
        rows = []
        for number, owner, bracket, _instant in report.numbered():
            if owner is case:
                rows.append(
                    _bracket_row(number, bracket.unit, bracket.part, bracket.quantity, numbers, report)
                )
        heads = (
            "quantity", "of", "unit", "reached#", "at configuration [°, m]", "not exceeded#", "gap#",
            "method, and why it ended", "s#",
        )  # fmt: skip
        told = f"{case.stop}: {WORDS[case.stop]}; over {case.over_text}{mark(guessed=case.guessed)}"
        listed = table(told, heads, rows)
        parts.append(watermark(listed) if case.guessed else listed)
    return section("Worst cases", *parts, anchor="worst-cases")


def _bracket_row(
    number: int, unit: str, part: str, quantity: str, numbers: Numbers, report: StopReport
) -> tuple[Child, ...]:
    key = ("worst_case", number)
    found = numbers.at(*key)
    how = found["reason"] or "; ".join(dict.fromkeys((found["method"], found["ended"])))
    where: Child = "–"
    if found["configuration"] is not None:
        where = node("span", joint_values(numbers, report.units, *key, "configuration"), class_="small")
        if found["t"] is not None:
            add(where, ", at ", numbers.show("{:.3f} s", *key, "t"))
    return (
        quantity, name(part), unit, numbers.show("{:z.4f}", *key, "lower"), where,
        numbers.show("{:.4f}", *key, "upper", nothing="not bounded"),
        numbers.show("{:.1%}", *key, "gap") if found["upper"] is not None else "–", how,
        numbers.show("{:.1f}", *key, "seconds"),
    )  # fmt: skip


def _poses(report: StopReport, numbers: Numbers) -> Node:
    parts: list[Child] = [node("p", _POSE)]
    for k, pose in enumerate(report.poses):
        figures = [node("figure", view, node("figcaption", caption)) for view, caption in pose_views(pose)]
        parts += [node("h3", pose.title.capitalize()), node("div", *figures, class_="views pose-views")]
        rows = [
            (
                name(joint),
                configuration(numbers, report.units[j], "worst_poses", k, "configuration", j),
                configuration(numbers, report.units[j], "worst_poses", k, "speeds", j),
            )
            for j, joint in enumerate(report.joints)
        ]
        speed = numbers.show("{:.3f} m/s", "worst_poses", k, "point_speed_m_s")
        parts.append(table(f"State: {pose.title}", ("axis", "position [°, m]#", "speed [°/s, m/s]#"), rows))
        parts.append(node("p", f"Fastest point there: {name(pose.link)}, ", speed, "."))
    if not report.poses:
        parts.append(node("p", "None was found."))
    return section("Worst poses", *parts, anchor="poses")


def _profile(report: StopReport) -> Node:
    found = report.profile
    text = f"Longest stop, {found.stop}: {WORDS[found.stop]}."
    if found.over == ANY_MOTION:
        text += " Each axis from its own worst state; they need not be in it at once."
    text += "".join(f" {' and '.join(each)} have one curve." for each in _on_one_curve(found, report))
    drawn = over_time(
        "Angle and speed of each axis over the worst stop", _described(found, report), _panels(found, report),
        anchor="profile-chart", axis="time since the stop begins [s]",
    )  # fmt: skip
    figure = node("figure", drawn, node("figcaption", text), class_="chart", tabindex="0")
    return section("The worst stop over time", figure, anchor="profile")


def _panels(found: Profile, report: StopReport) -> list[Panel]:
    def rows(values: Array) -> tuple[Series, ...]:
        return tuple(
            Series(joint, found.t, values[:, j] * (DEGREES if report.units[j] == "rad" else 1.0))
            for j, joint in enumerate(report.joints)
        )

    units = " or ".join(sorted({"°" if unit == "rad" else "m" for unit in report.units}))
    return [Panel(f"turned [{units}]", rows(found.way)), Panel(f"speed [{units}/s]", rows(found.speed))]


def _on_one_curve(found: Profile, report: StopReport) -> list[list[str]]:
    """Return the joints of each curve that belongs to several: they are drawn on top of each other."""
    curves: dict[bytes, list[str]] = {}
    for j, joint in enumerate(report.joints):
        key = (np.round(np.stack([found.way[:, j], found.speed[:, j]]), 6) + 0.0).tobytes()
        curves.setdefault(key, []).append(name(joint))
    return [joints for joints in curves.values() if len(joints) > 1]


def _described(found: Profile, report: StopReport) -> str:
    most = found.way.max(axis=0)
    return "; ".join(
        f"{joint} by {most[j] * DEGREES:.1f}°" if report.units[j] == "rad" else f"{joint} by {most[j]:.3f} m"
        for j, joint in enumerate(report.joints)
    )


def _torques(report: StopReport, numbers: Numbers) -> Iterator[Node]:
    if not report.torques:
        return
    rows = [
        (
            numbers.show("{:.3g}", "torques", k, "load_kg"),
            numbers.show("{:.2f}", "torques", k, "share_guaranteed"),
            numbers.show("{:.2f}", "torques", k, "share_found"),
            name(each.allowed.joint),
            "–"
            if each.allowed.witness is None
            else joint_values(numbers, report.units, "torques", k, "configuration"),
        )
        for k, each in enumerate(report.torques)
    ]
    heads = (
        "load [kg]#",
        "in every state at least#",
        "in the worst state found#",
        "joint that limits the first",
        "in that configuration [°, m]",
    )
    text = (
        "Planned stops take the acceleration limits as given; brakes and measured stops do not. This is the "
        "share of them that torque limits allow when every joint brakes at once from full speed. Below 1.00 "
        "in the worst state found: there the drives cannot brake as the model says; the real stop is longer, "
        "or accelerations must be lower."
    )
    yield section(
        "Can the drives brake so hard?", node("p", text),
        table("Share of the acceleration limits that torque limits allow", heads, rows), anchor="torques",
    )  # fmt: skip


def _to_measure(report: StopReport, numbers: Numbers) -> Node:
    text = (
        "What the model says has to be measured on the real robot. Each row: bring the arm to that speed in "
        "that configuration, stop it, and note time, angle or way. More than the last number: the model is "
        "wrong there. Floor, fixtures and the arm itself were not looked at: where a configuration cannot be "
        "had, measure one near it."
    )
    if not report.to_measure:
        return section("To be measured", node("p", "Nothing was found."), anchor="to-measure")
    parts: list[Child] = [node("p", text)]
    if any(not each.guessed for each in report.to_measure):
        parts.append(_stops_to_measure(report, numbers, guessed=False))
    if any(each.guessed for each in report.to_measure):
        parts.append(watermark(_stops_to_measure(report, numbers, guessed=True)))
    return section("To be measured", *parts, anchor="to-measure")


def _stops_to_measure(report: StopReport, numbers: Numbers, *, guessed: bool) -> Node:
    rows: list[tuple[Child, ...]] = []
    for k, each in enumerate(report.to_measure):
        if each.guessed is not guessed:
            continue
        key = ("to_measure", k)
        where = joint_values(numbers, report.units, *key, "configuration")
        if each.instant is not None:
            add(where, ", at ", numbers.show("{:.3f} s", *key, "t"), " of the recording")
        speed = joint_values(numbers, report.units, *key, "speeds")
        load: Child = "any" if each.load_kg is None else numbers.show("{:.3g}", *key, "load_kg")
        expected = both_lines(numbers, each.bracket.unit, *key)
        rows.append(
            (
                each.stop,
                f"{each.bracket.quantity}, {name(each.bracket.part)}",
                where,
                speed,
                load,
                expected,
                "",
            )
        )
    heads = (
        "stop",
        "what to measure",
        "configuration [°, m]",
        "joint speeds [°/s, m/s]",
        "load [kg]",
        "expected",
        "measured",
    )
    return table(f"Stops to be measured on the real robot{mark(guessed=guessed)}", heads, rows)


def _missing(report: StopReport) -> Node:
    if not report.missing:
        return section("Missing", node("p", "Nothing that this report knows of."), anchor="missing")
    rows = [
        (node("span", f"{each.what}: missing", class_="missing"), note(each.why), each.remedy or "–")
        for each in report.missing
    ]
    return section(
        "Missing",
        table("What nobody has stated, or cannot be said", ("what", "why", "how it is stated"), rows),
        anchor="missing",
    )


def _assumptions(report: StopReport, numbers: Numbers) -> Node:
    parts: list[Child] = [node("p", "The report holds in the model and under these assumptions.")]
    for certainty, text in WEAKEST_FIRST:
        which = [k for k, item in enumerate(report.assumptions) if item.certainty is certainty]
        rows = []
        for k in which:
            item = report.assumptions[k]
            value = (
                name(item.value)
                if isinstance(item.value, str)
                else numbers.show("{:g}", "assumptions", k, "value", nothing="infinite")
            )
            rows.append((name(item.name), value, item.unit, note(item.source)))
        if rows:
            parts.append(
                table(f"{certainty} ({len(rows)}): {text}", ("name", "value#", "unit", "source"), rows)
            )
    waived = items(note(text) for text in report.waived) if report.waived else node("p", "Nothing.")
    return section("Assumptions", *parts, node("h3", "Waived"), waived, anchor="assumptions")


def _inputs(report: StopReport, numbers: Numbers) -> Node:
    def digest(text: str) -> Node:
        return node("span", text, class_="hash")

    rows = [
        (name(each.what), name(each.file), numbers.show("count", "inputs", k, "bytes"), digest(each.sha256))
        for k, each in enumerate(report.inputs)
    ]
    listed: Child = node("p", "No file of the user was read.")
    if rows:
        listed = table("Files", ("what", "file", "bytes#", "SHA-256"), rows)
    others: list[tuple[Child, ...]] = [
        ("hash of all values of the cell, content of the robot included", digest(report.cell_hash)),
        ("version of stopproof", report.version),
        ("time that it took [s]", numbers.show("{:.0f}", "seconds")),
    ]
    return section("Inputs", listed, table("The run", ("what", "value"), others), anchor="inputs")


def _as_text(report: StopReport) -> Node:
    text = node("pre", "")
    text.text = "\n".join(note(line) for line in report_lines(report))
    return section(
        "As text", node("details", node("summary", "What the command line prints"), text), anchor="text"
    )
