"""`stopproof diff` of stop reports: what changed between payloads, limits, versions, and nothing else."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.docs.test_schemas import faults
from tests.verifier.compared import complete_page, in_schema, marked, nothing_changed, put
from tests.verifier.html_page import parse, unreadable
from tests.verifier.shell import Shell, refused
from verifier import Cell
from verifier.reports.html.stop_side_by_side import stop_side_by_side_page
from verifier.reports.stop_difference import compare_stop_reports
from verifier.stop_report import StopReportSettings, stop_report
from verifier.stop_report.as_json import report_dict
from verifier.stop_report.difference import StopReportDifference, stop_report_difference
from verifier.stop_report.read_back import StopReportResult

Json = dict[str, Any]
QUICK = 0.02
TORQUES = (160.0, 160.0, 150.0, 28.0, 28.0, 28.0)


def with_payload(kg: float) -> Json:
    cell = Cell.from_table({"robot": {"name": "ur5", "bare_flange": True, "accept_assumed": ["limits"]}})
    settings = StopReportSettings(
        payload_kg=kg, payload_at_m=(0.0, 0.0, 0.1), brake_torque=TORQUES, brake_delay_s=0.05,
        deadline_s=QUICK,
    )  # fmt: skip
    written: Json = json.loads(json.dumps(report_dict(stop_report(cell, settings=settings)), allow_nan=False))
    return written


@pytest.fixture(scope="module")
def light() -> Json:
    return with_payload(0.5)


@pytest.fixture(scope="module")
def heavy() -> Json:
    return with_payload(4.5)


def read(value: Json) -> StopReportResult:
    return StopReportResult.model_validate(value)


def compared(a: Json, b: Json, tolerance: float = 1e-6) -> StopReportDifference:
    return stop_report_difference(read(a), read(b), tolerance)


def test_a_report_does_not_differ_from_itself(light: Json) -> None:
    again = copy.deepcopy(light)
    again["seconds"], again["version"] = 99.0, "0.0.0"
    again["worst_case"][0]["configuration"] = None
    found = compared(light, again, 0.0)
    assert not found.changed and found.compared == len(light["worst_case"])


def test_a_heavier_payload_changes_what_brakes_do_and_no_stop_within_limits(light: Json, heavy: Json) -> None:
    """Joint-space stops are made of acceleration limits, whatever the load; brakes are not."""
    found = compared(light, heavy)
    assert {each.stop for each in found.worst_cases if each.apart} <= {"brakes"}
    names = {each.name for each in found.numbers}
    assert {"cell_hash", "answer.total_s"} & names == set() and "grids.brakes.load_kg" in names
    times = next(each for each in found.grids if (each.stop, each.quantity) == ("brakes", "stop time"))
    assert times.rise is not None and times.changed
    lower = {
        (cell["load"], cell["speed"], cell["extension"]): cell["braking"]["time_s"]["lower"]
        for cell in next(grid for grid in heavy["grids"] if grid["stop"] == "brakes")["cells"]
    }
    place = (times.rise.load, times.rise.speed, times.rise.extension)
    assert times.rise.b.lower == lower[place]


def by_hand(a: Json, b: Json) -> tuple[int, int]:
    """How many brackets differ, and how many of them have no number in common: from the JSON, one by one."""
    differ = disjoint = 0
    for old, new in zip(a["worst_case"], b["worst_case"], strict=True):
        spans = [(each["lower"], math.inf if each["upper"] is None else each["upper"]) for each in (old, new)]
        if spans[0] != spans[1]:
            differ += 1
            disjoint += max(spans[0][0], spans[1][0]) > min(spans[0][1], spans[1][1])
    return differ, disjoint


def test_brackets_that_changed_are_those_of_a_plain_loop(
    light: Json, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(500)):
        other = copy.deepcopy(light)
        for each in other["worst_case"]:
            kind = int(rng.integers(5))
            if kind == 0:
                each["lower"] *= float(rng.uniform(0.5, 1.0))
            elif kind == 1 and each["upper"] is not None:
                each["lower"] = each["upper"] * 1.1
                each["upper"] *= 1.2
            elif kind == 2:
                each["upper"] = None
        found = compared(light, other, 0.0)
        pairs = [each for each in found.worst_cases if each.a is not None and each.b is not None]
        assert (len(pairs), sum(each.apart for each in pairs)) == by_hand(light, other)
        assert found.changed == bool(pairs)


def fields(report: Json, stop: str) -> list[Json]:
    cells: list[Json] = next(grid for grid in report["grids"] if grid["stop"] == stop)["cells"]
    return cells


def test_fields_of_grids_that_changed(light: Json) -> None:
    other = copy.deepcopy(light)
    cells = fields(other, "joint_space")
    for cell, factor in zip(cells[:3], (0.5, 2.0, 3.0), strict=True):
        for end in ("lower", "upper"):
            cell["braking"]["time_s"][end] *= factor
    cells[3]["braking"]["angles"][2]["upper"] = None
    (times, angle) = compared(light, other).grids
    assert (times.quantity, times.part, times.unit) == ("stop time", "", "s")
    assert (times.compared, times.changed, times.apart) == (len(cells), 3, 3)
    for extreme, k in ((times.fall, 0), (times.rise, 2)):
        before, after = fields(light, "joint_space")[k], cells[k]
        assert (extreme.load, extreme.speed, extreme.extension) == tuple(
            before[share] for share in ("load", "speed", "extension")
        )
        assert extreme.a.upper == before["braking"]["time_s"]["upper"]
        assert extreme.b.upper == after["braking"]["time_s"]["upper"]
    assert (angle.quantity, angle.part, angle.changed, angle.apart) == ("angle", light["joints"][2], 1, 0)
    assert angle.fall is None and angle.rise.b.upper is None
    del cells[5]
    only = compared(light, other).grids
    assert {each.only_in_a for each in only} == {1} and {each.only_in_b for each in only} == {0}


def test_a_number_that_is_lost_rose_and_one_that_is_found_fell(light: Json) -> None:
    other = copy.deepcopy(light)
    way = fields(other, "joint_space")[0]["braking"]["way_m"]
    way["upper"] = None
    (lost,) = compared(light, other).grids
    (found,) = compared(other, light).grids
    assert lost.fall is None and lost.rise.b.upper is None
    assert found.rise is None and found.fall.a.upper is None


def test_an_arm_of_another_unit_is_another_arm(light: Json) -> None:
    """1 rad is not 1 m: neither number is held against the other, and each has its own unit."""
    other = copy.deepcopy(light)
    first = light["joints"][0]
    other["units"][0] = "m"
    for each in other["worst_case"]:
        if each["part"] == first and each["unit"] == "rad":
            each["unit"] = "m"
    for one, two, unit in ((light, other, "rad"), (other, light, "m")):
        found = compare_stop_reports(["a.json", "b.json"], [read(one), read(two)], 1e-6)
        (change,) = found.changes
        assert {each.name for each in change.numbers} >= {f"units.{first}", f"speeds.{first}"}
        angles = [each for each in change.worst_cases if (each.part, each.quantity) == (first, "stop angle")]
        assert angles and all((each.a is None) != (each.b is None) and each.apart for each in angles)
        assert {each.unit for each in angles if each.b is None} == {unit}
        grids = [each for each in change.grids if each.part == first]
        assert grids and all(each.compared == 0 and each.rise is None for each in grids)


def test_an_arm_without_extension_has_fields_of_any_configuration(light: Json) -> None:
    one, other = copy.deepcopy(light), copy.deepcopy(light)
    for report in (one, other):
        for grid in report["grids"]:
            grid["largest_extension_m"]["upper"] = None
            grid["cells"] = [cell for cell in grid["cells"] if cell["extension"] == 1.0]
    for cell in fields(other, "joint_space"):
        cell["braking"]["time_s"]["upper"] *= 2.0
    found = compare_stop_reports(["a.json", "b.json"], [read(one), read(other)], 1e-6)
    told = "\n".join(found.lines())
    assert "any configuration" in told and "extension 100" not in told
    page = parse(stop_side_by_side_page(found))
    assert "any configuration" in page.text and "extension 100" not in page.text


def test_what_differs_looks_different(light: Json) -> None:
    """A difference below the usual digits is printed with more of them."""
    other = copy.deepcopy(light)
    place = next(k for k, each in enumerate(light["worst_case"]) if each["unit"] == "m/s")
    other["worst_case"][place]["upper"] *= 1.0 + 1e-6
    found = compare_stop_reports(["a.json", "b.json"], [read(light), read(other)], 1e-9)
    (line,) = (line for line in found.lines() if "m/s → " in line)
    before, after = line.partition(": ")[2].partition(": ")[2].split(" → ")
    assert before != after


CHANGES: dict[str, tuple[Callable[[Json], Json], str]] = {
    "robot": (put("robot", "ur10"), "robot: ur5 → ur10"),
    "total": (put("answer/total_s", 9.0), "answer.total_s: "),
    "total is lost": (put("answer/total_s", None), "→ none"),
    "reaction": (put("reaction/seconds", 0.5), "reaction.seconds: "),
    "speed of a joint": (put("speeds/0", 0.25), "speeds.shoulder_pan_joint: "),
    "distance": (put("required_distances/0/distance_m", 7.5), "required_distances."),
    "ended before": (put("interrupted", True), "interrupted: false → true"),
    "load": (put("grids/0/load_kg", 3.5), "load_kg: "),
    "torque": (put("torques/0/share_found", 0.125), "share_found: "),
    "waived": (put("waived", ["nobody looked"]), "waived, only in B: nobody looked"),
    "missing": (put("missing", [{"what": "H", "why": "nobody said"}]), "missing, only in B: H: nobody said"),
    "assumption": (put("assumptions/0/value", 0.987), "0.987"),
    "input": (put("inputs", [{"what": "cell", "file": "c.toml", "bytes": 1, "sha256": "f" * 64}]), "c.toml"),
    "a bracket is gone": (put("worst_case/0-", None), "only in A: 1; only in B: 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_each_change_is_told(light: Json, name: str) -> None:
    change, told = CHANGES[name]
    other = copy.deepcopy(light)
    if name == "a bracket is gone":
        other["answer"] |= {"time": None, "angles": [], "point_speed": None, "way": None}
    found = compare_stop_reports(["a.json", "b.json"], [read(light), read(change(other))], 1e-6)
    assert found.exit_status == 1 and any(told in line for line in found.lines()), found.lines()


def test_metres_and_seconds_within_the_tolerance_are_no_change(light: Json) -> None:
    other = copy.deepcopy(light)
    for each in other["worst_case"]:
        if each["unit"] in ("m", "s") and each["upper"] is not None:
            each["upper"] += 1e-4
    assert compared(light, other, 1e-6).worst_cases and not compared(light, other, 1.1e-4).changed


@pytest.fixture(scope="module")
def three(light: Json, heavy: Json) -> list[Json]:
    third = copy.deepcopy(light)
    for change, _told in list(CHANGES.values())[:-1]:
        change(third)
    third["robot"] = "<script>alert(1)</script>"
    third["waived"] = ['<b>"nobody"</b>']
    return [light, heavy, third]


def test_the_page_is_complete_readable_and_alone(three: list[Json]) -> None:
    comparison = compare_stop_reports(["x/a.json", "b<.json", "c.json"], [read(each) for each in three], 1e-6)
    made = stop_side_by_side_page(comparison)
    page = complete_page(made, comparison, "3 stop reports side by side", 12)
    titles = [each.text for each in page.all("title")]
    for letter in "ABC":
        assert f"{letter}: time of the stop [s]" in titles
    assert marked(page)


def test_nothing_is_marked_where_nothing_changed(light: Json) -> None:
    nothing_changed(stop_side_by_side_page(compare_stop_reports(["a", "a"], [read(light)] * 2, 1e-6)))


def test_json_is_what_the_schema_says(three: list[Json]) -> None:
    for reports in (three, three[:1] * 2, three[1:]):
        read_back = [read(each) for each in reports]
        in_schema("diff-stop-report", compare_stop_reports(["a.json"] * len(reports), read_back, 1e-6))


# ------------------------------------------------------------------------------------------ command line


@pytest.fixture
def files(three: list[Json], tmp_path: Path) -> dict[str, Path]:
    paths = {"a": tmp_path / "a.json", "b": tmp_path / "b.json"}
    for path, value in zip(paths.values(), three[:2], strict=True):
        path.write_text(json.dumps(value))
    return paths


def test_the_command(shell: Shell, files: dict[str, Path], tmp_path: Path) -> None:
    status, out, err = shell("diff", files["a"], files["a"])
    assert (status, err) == (0, "") and "from A to B: nothing changed" in out
    status, out, err = shell("diff", files["a"], files["b"], "--report", tmp_path / "d.html")
    assert (status, err) == (1, "") and "a.json: ur5 with bare flange, 0.5 kg: " in out
    assert "b.json: ur5 with bare flange, 4.5 kg: " in out
    assert unreadable(parse((tmp_path / "d.html").read_bytes())) == []
    status, out, err = shell("diff", files["a"], files["b"], "--json", "-")
    assert (status, err) == (1, "") and not faults("diff-stop-report", json.loads(out))


BAD: dict[str, tuple[Callable[[Json], Any], str]] = {
    "not json": (lambda r: json.dumps(r)[:-20], "not JSON"),
    "a list": (lambda r: [r], "a.json is a stop report and {b} is none"),
    "a result of verify": (put("format", "stopproof verify 1"), "is none: compare results of one command"),
    "another format": (put("format", "stopproof stop-report 99"), "format stopproof stop-report 99, this"),
    "a key missing": (put("grids-", None), "grids: is missing; docs/stop-report.schema.json lists the keys"),
    "brackets the wrong way round": (put("worst_case/0/upper", 0.0), "upper is less than lower"),
    "a place that is none": (put("answer/time", 10**6), "answer names a place that worst_case does not have"),
    "a joint too many": (put("speeds/6", None), "speeds"),
    "a negative load": (put("grids/0/load_kg", -1.0), "grids.0.load_kg = -1.0: must be at least 0"),
    "no such stop": (put("worst_case/0/stop", "by hand"), "worst_case.0.stop"),
    "a joint twice": (put("joints/1", "shoulder_pan_joint"), "a joint is given twice"),
    "a grid twice": (put("grids/0/stop", "brakes"), "a grid of a stop is given twice"),
    "a field twice": (
        lambda r: put("grids/0/cells/1", r["grids"][0]["cells"][0])(r),
        "grids.0: a field of its cells is given twice",
    ),
    "angles of others": (put("grids/0/cells/0/braking/angles/0/part", "x"), "are not those of the joints"),
    "a text for a number": (put("reaction/seconds", "0.1"), "reaction.seconds"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_stop_report_is_refused_in_one_line(
    shell: Shell, files: dict[str, Path], light: Json, name: str
) -> None:
    make, told = BAD[name]
    made = copy.deepcopy(light)
    if name == "a joint too many":
        made["speeds"].append(1.0)
    made = make(made)
    files["b"].write_text(made if isinstance(made, str) else json.dumps(made))
    for order in (("a", "b"), ("b", "a")):
        line = refused(shell("diff", *(files[each] for each in order)))
        assert "b.json" in line and told.format(b=files["b"]) in line, line
        assert len(line) < 1100
