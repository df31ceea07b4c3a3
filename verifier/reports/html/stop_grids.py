"""The grids of a stop report: heat maps and tables, reaction and braking apart."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from failsafe.bracket import Ended
from verifier.reports.html.elements import Child, Node, Numbers, name, node, note, section, table
from verifier.reports.html.heat_map import Field, heat_map
from verifier.reports.html.stop_numbers import DEGREES, angle, mark, pair, watermark
from verifier.stop_report.report import WORDS, Grid, StopReport

_MAPS = (
    ("time_s", "time of the stop", "s"),
    ("way_m", "longest way of a point during the stop", "m"),
    ("point_speed_m_s", "speed of the fastest point", "m/s"),
)
_STEADY = (
    "From steady speeds, as stops are tested; a stop that begins while the arm speeds up takes longer (worst "
    "cases)."
)
_EXTENSION = "Extension: the largest distance of a point from the first axis when the stop begins."
_ANY = "From every configuration."
_SAME = (
    "Categories 1 and 2 have the same motion here: 2 keeps drive power afterwards. The load does not matter "
    "to it, unless the drives cannot brake so hard (below)."
)
_BRAKES = (
    "Category 0: after the delay of the brakes, which counts as braking, they take hold; gravity pulls "
    "meanwhile."
)


def grid_sections(report: StopReport, numbers: Numbers) -> Iterator[Node]:
    """Yield a section for each grid."""
    for k, each in enumerate(report.grids):
        parts = _grid(each, k, report, numbers)
        body = [watermark(*parts)] if each.guessed else parts
        which = " and ".join(map(str, each.categories))
        title = f"Grid, category {which}" if which else f"Grid, {each.stop}"
        yield section(title, *body, anchor=f"grid-{each.stop.replace('_', '-')}")


def _grid(each: Grid, k: int, report: StopReport, numbers: Numbers) -> list[Child]:
    about = _SAME if each.categories == (1, 2) else _BRAKES if each.categories == (0,) else ""
    extends = _extends(each)
    told = f"{_STEADY} {_EXTENSION}" if extends else f"{_STEADY} {_ANY}"
    parts: list[Child] = [node("p", f"Stop: {each.stop}, {WORDS[each.stop]}. {about} {told}")]
    load = f"100 % of load: {_load(each)}."
    if extends:
        largest = pair(numbers, "{:.3f}", "m", "grids", k, "largest_extension_m")
        parts.append(node("p", "100 % of extension: ", largest, f". {load}"))
    else:
        parts.append(node("p", f"No extension: {note(each.grid.largest_extension.reason)}. {load}"))
    if not each.grid.complete:
        parts.append(node("p", "The work was ended before: fields are missing.", class_="missing"))
    parts += _maps(each, k, numbers)
    parts.append(_table(each, k, numbers))
    parts += _angles(each, k, report, numbers)
    return parts


def _extends(each: Grid) -> bool:
    """Whether there is an extension; an arm whose first joint slides has none."""
    return each.grid.largest_extension.ended is not Ended.UNBOUNDED


def _load(each: Grid) -> str:
    return "any" if each.load_kg is None else f"{each.load_kg:g} kg"


def _maps(each: Grid, k: int, numbers: Numbers) -> Iterator[Node]:
    cells = numbers.at("grids", k, "cells")
    loads = sorted({cell["load"] for cell in cells}) if each.grid.load_matters else [None]
    for key, title, unit in _MAPS:
        fields = [
            _field(cell, cell["braking"][key], _extends(each))
            for cell in cells
            if cell["braking"][key] is not None
        ]
        if fields:
            told = f"{title.capitalize()} [{unit}]; the reaction is not in it{mark(guessed=each.guessed)}."
            caption = node("figcaption", told)
            yield node("figure", heat_map(title, unit, fields, loads), caption, class_="chart", tabindex="0")


def _field(cell: dict[str, Any], found: dict[str, Any], extends: bool) -> Field:
    extension = cell["extension"] if extends else None
    return Field(cell["load"], cell["speed"], extension, found["lower"], found["upper"])


def _shown(each: Grid, numbers: Numbers, k: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the cells that differ: where the load does not matter, those of one load."""
    cells = numbers.at("grids", k, "cells")
    for i, cell in enumerate(cells):
        if each.grid.load_matters or cell["load"] == cells[0]["load"]:
            yield i, cell


def _table(each: Grid, k: int, numbers: Numbers) -> Node:
    rows = []
    for i, cell in _shown(each, numbers, k):
        key = ("grids", k, "cells", i)
        load = f"load {100 * cell['load']:.0f} %, " if each.grid.load_matters else ""
        extension = f", extension {100 * cell['extension']:.0f} %" if _extends(each) else ""
        braking = [
            pair(numbers, "{:.3f}", "", *key, "braking", what) if cell["braking"][what] is not None else "–"
            for what in ("time_s", "way_m", "point_speed_m_s")
        ]
        rows.append(
            (
                f"{load}speed {100 * cell['speed']:.0f} %{extension}",
                numbers.show("{:.3f}", *key, "reaction_s"), braking[0],
                numbers.show("{:.3f}", *key, "reaction_way_m"), braking[1], braking[2],
            )
        )  # fmt: skip
    heads = (
        "at", "reaction [s]#", "braking [s]#", "way in the reaction [m]#", "way while braking [m]#",
        "fastest point [m/s]#",
    )  # fmt: skip
    told = f"Time and way of the stop {each.stop}; reaction and braking apart{mark(guessed=each.guessed)}"
    return table(told, heads, rows)


def _angles(each: Grid, k: int, report: StopReport, numbers: Numbers) -> Iterator[Node]:
    """Yield a table for each load that matters: axes down, speeds across."""
    full = [(i, cell) for i, cell in _shown(each, numbers, k) if cell["extension"] == 1.0]
    for load in dict.fromkeys(cell["load"] for _i, cell in full):
        of_load = [(i, cell) for i, cell in full if cell["load"] == load]
        rows: list[tuple[Child, ...]] = []
        for j, joint in enumerate(report.joints):
            times = DEGREES if report.units[j] == "rad" else 1.0
            row: list[Child] = [name(joint)]
            for i, _cell in of_load:
                key = ("grids", k, "cells", i)
                row.append(numbers.show("{:.1f}", *key, "reaction_angle", j, times=times))
                row.append(angle(numbers, report.units[j], *key, "braking", "angles", j))
            rows.append(tuple(row))
        heads = ["axis"]
        for _i, cell in of_load:
            heads += [f"{100 * cell['speed']:.0f} %: reaction#", "braking#"]
        at = f", load {100 * load:.0f} %" if each.grid.load_matters else ""
        at += mark(guessed=each.guessed)
        reached = " at 100 % extension" if _extends(each) else ""
        told = (
            f"Angle of each axis, stop {each.stop} [°, m]{reached}, by speed; reaction and braking apart{at}"
        )
        yield table(told, heads, rows)
