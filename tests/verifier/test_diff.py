"""`stopproof diff`: what changed between results of `verify`, and nothing else."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.docs.test_schemas import faults
from tests.verifier.compared import complete_page, in_schema, marked, nothing_changed, put
from tests.verifier.html_page import parse, unreadable
from tests.verifier.scenes import CELL, Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier import Cell, verify
from verifier.changes import same, without_folders
from verifier.difference import difference
from verifier.reports.difference import compare_results
from verifier.reports.html.side_by_side import side_by_side_page
from verifier.result import VerifyResult
from verifier.verdict import STATUS_OF_REASON, Reason, Status

Json = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]


def walking_up(t: float) -> np.ndarray:
    return person_at(1.7 - 1.2 * t, 0.0)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Json:
    folder = tmp_path_factory.mktemp("diff")
    scene = Scene(duration=0.8, people={"p1": walking_up}).write(folder / "r.mcap")
    table = {**CELL, "people": {**CELL["people"], "clock_error_s": 0.001}}
    printed: Json = json.loads(json.dumps(verify(scene, Cell.from_table(table)).to_dict()))
    assert printed["verified"] and printed["not_verified"] and printed["not_checked"]
    return printed


def read(value: Json) -> VerifyResult:
    return VerifyResult.model_validate(value)


def consistent(value: Json) -> Json:
    """Counts as they follow from the cycles."""
    status = value["per_cycle"]["status"]
    names = ("not_checked", "not_verified", "verified", "contradicted")
    return {**value, **{name: status.count(k) for k, name in enumerate(names)}, "cycles": len(status)}


def test_a_result_does_not_differ_from_itself(result: Json) -> None:
    found = difference(read(result), read(result), 0.0)
    assert not found.changed and found.cycles.compared == result["cycles"]
    assert found.cycles.clock == "recording"


def test_cycles_that_changed_are_those_of_a_plain_loop(
    result: Json, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Random outcomes, cycles left out, another start: matched by instant, one after the other."""
    for _ in range(count(300)):
        a, b = copy.deepcopy(result), copy.deepcopy(result)
        shift = int(rng.integers(-3, 4))
        b["start_ns"] += shift * 10_000_000
        if rng.random() < 0.3:
            b["inputs"][0]["sha256"] = "0" * 64  # another recording: by the time since the start of each
            shift = 0
        kept = {}
        for name, value in (("a", a), ("b", b)):
            rows, n = value["per_cycle"], value["cycles"]
            some = np.flatnonzero(rng.random(n) < 0.9) if rng.random() < 0.7 else np.arange(n)
            reasons = (
                np.repeat(rng.integers(0, len(Reason), n), 3)[:n] if rng.random() < 0.8 else rows["reason"]
            )
            rows["reason"] = [int(reasons[i]) for i in some]
            rows["status"] = [int(STATUS_OF_REASON[Reason(k)]) for k in rows["reason"]]
            rows["gap_m"] = [None if rng.random() < 0.2 else float(rng.normal()) for _ in some]
            rows["t"] = [rows["t"][i] for i in some]
            rows["stop_time_s"] = [rows["stop_time_s"][i] for i in some]
            kept[name] = {round(t * 100): k for k, t in enumerate(rows["t"])}
        a, b = consistent(a), consistent(b)
        found = difference(read(a), read(b), 0.1).cycles
        both = sorted(k for k in kept["a"] if k - shift in kept["b"])
        assert (found.compared, found.only_in_a, found.only_in_b) == (
            len(both), len(kept["a"]) - len(both), len(kept["b"]) - len(both),
        )  # fmt: skip
        changed: list[tuple[int, tuple[int, int]]] = []
        gaps, steps = 0, [0.0]
        for k in both:
            old, new = a["per_cycle"], b["per_cycle"]
            i, j = kept["a"][k], kept["b"][k - shift]
            if old["reason"][i] != new["reason"][j]:
                changed.append((k, (old["reason"][i], new["reason"][j])))
            x, y = old["gap_m"][i], new["gap_m"][j]
            if (x is None) != (y is None):
                gaps += 1
            elif x is not None and abs(y - x) > 0.1:
                gaps += 1
                verified = Status.VERIFIED in (old["status"][i], new["status"][j])
                steps.append(y - x if verified else 0.0)
        assert sum(each.cycles for each in found.ranges) == len(changed)
        assert found.status_changed + found.reason_changed == len(changed)
        listed = [(round(each.t[0] * 100), (each.a.reason, each.b.reason)) for each in found.ranges]
        starts = dict(changed)
        for k, (old_name, new_name) in listed:
            assert starts[k] == (Reason[old_name.upper()], Reason[new_name.upper()])
        assert found.gap_m.changed == gaps
        fall, rise = found.gap_m.fall, found.gap_m.rise
        assert (fall.b - fall.a if fall else 0.0) == pytest.approx(min(*steps, 0.0))
        assert (rise.b - rise.a if rise else 0.0) == pytest.approx(max(*steps, 0.0))


def test_ranges_end_where_cycles_are_missing(result: Json) -> None:
    a, b, n = result, copy.deepcopy(result), result["cycles"]
    for row in b["per_cycle"].values():
        del row[n // 2]
    b["per_cycle"]["reason"] = [int(Reason.NO_ROOM)] * (n - 1)
    b["per_cycle"]["status"] = [1] * (n - 1)
    found = difference(read(a), read(consistent(b))).cycles
    at = result["per_cycle"]["t"][n // 2]
    assert not any(each.t[0] < at < each.t[1] for each in found.ranges)
    assert found.ranges[0].t[0] == result["per_cycle"]["t"][0]
    assert sum(each.cycles for each in found.ranges) == n - 1


EXCESS = {"t": 1.0, "joint": "j", "quantity": "position", "value": 2.0, "limit": 1.0, "unit": "rad"}
AGAINST = {
    "reason": "people_stream_gap",
    "assumption": "A5 reports",
    "text": "x",
    "first_t": 0.5,
    "cycles": 3,
}
CHANGES: dict[str, tuple[Callable[[Json], object], str]] = {
    "robot": (put("robot", "ur10"), "robot: ur5 → ur10"),
    "profile": (put("profile", "tum"), "profile: "),
    "cell": (put("cell_hash", "0" * 16), "cell_hash: "),
    "budget": (put("tightest/budget_m/stop", 0.5), "tightest.budget_m.stop: "),
    "gap": (put("tightest/gap_m", 0.5), "tightest.gap_m: "),
    "link": (put("tightest/link", "other"), "tightest.link: "),
    "no tightest": (put("tightest", None), "tightest.link: "),
    "stop time": (put("stop_time_s/max", 9.0), "stop_time_s.max: "),
    "refused": (put("refused_measurements_total", 7), "refused_measurements_total: 0 readings → 7"),
    "reason of refusals": (put("refused_measurements_by_reason/late", 7), "by_reason.late: none → 7"),
    "criteria": (put("criteria+", "torque"), "criteria: separation, joint_limits → "),
    "waiver": (put("waived+", "nobody"), "waived, only in B: nobody"),
    "note": (put("notes", []), "note, only in A: "),
    "assumption": (put("assumptions/0/value", 0.5), "assumptions: 1 changed"),
    "source": (put("assumptions/0/source", "elsewhere"), "elsewhere)"),
    "certainty": (put("assumptions/0/certainty", "unverified"), "(unverified: "),
    "one assumption less": (put("assumptions/0-", None), "→ not stated"),
    "one more": (put("assumptions+", {"name": "x"}), "x: not stated → "),
    "recording": (put("inputs/0/sha256", "1" * 64), "(111111111111…)"),
    "input": (put("inputs+", {"what": "tool file"}), "tool file: none → r.mcap"),
    "gap of a cycle": (put("per_cycle/gap_m/10", 9.0), "gap: another one in 1 cycle"),
    "stop of a cycle": (put("per_cycle/stop_time_s/10", None), "stop time: another one in 1 cycle"),
    "excess": (put("first_limit_excess", EXCESS), "first_limit_excess.value: none → 2 rad"),
    "contradiction": (put("contradictions", [AGAINST]), "people_stream_gap.cycles: none → 3 cycles"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_change_is_told_alone(result: Json, name: str) -> None:
    change, told = CHANGES[name]
    other = copy.deepcopy(result)
    change(other)
    comparison = compare_results(["a.json", "b.json"], [read(result), read(other)], 1e-6)
    assert comparison.exit_status == 1
    text = "\n".join(comparison.lines())
    assert told in text and "from A to B: changed" in text
    found = comparison.changes[0]
    if name != "recording":
        assert found.cycles.clock == "recording"
    told_of = [found.numbers, found.assumptions, found.inputs, found.texts]
    cycles = found.cycles.gap_m.changed + found.cycles.stop_time_s.changed
    assert sum(map(bool, told_of)) + bool(cycles) == 1, "one kind of change alone"
    back = compare_results(["a.json", "b.json"], [read(other), read(result)], 1e-6)
    assert back.exit_status == 1


def test_the_gap_of_a_cycle_that_fails_in_both_is_no_largest_change(result: Json) -> None:
    """It says when the cycle fails; that it differs is still told."""
    failing = [k for k, status in enumerate(result["per_cycle"]["status"]) if status == Status.NOT_VERIFIED]
    verified = [k for k, status in enumerate(result["per_cycle"]["status"]) if status == Status.VERIFIED]
    other = copy.deepcopy(result)
    gap = other["per_cycle"]["gap_m"]
    gap[failing[0]], gap[verified[0]] = -9.0, gap[verified[0]] - 0.01
    found = difference(read(result), read(other)).cycles.gap_m
    assert found.changed == 2 and found.rise is None and found.fall is not None
    assert found.fall.b - found.fall.a == pytest.approx(-0.01, abs=1e-6)


NO_CHANGES: dict[str, Callable[[Json], object]] = {
    "computing time": lambda r: r.update(real_time_factor=99.0),
    "version": lambda r: r.update(version="9.9.9"),
    "name of the file": lambda r: (r.update(recording="s.mcap"), r["inputs"][0].update(file="s.mcap")),
    "rounding": lambda r: r["tightest"].update(gap_m=r["tightest"]["gap_m"] + 1e-8),
    "rounding of a cycle": lambda r: r["per_cycle"]["gap_m"].__setitem__(
        10, r["per_cycle"]["gap_m"][10] + 1e-8
    ),
    "a key of a later version": lambda r: r.update(later=1),
}


@pytest.mark.parametrize("name", NO_CHANGES)
def test_what_is_no_change(result: Json, name: str) -> None:
    other = copy.deepcopy(result)
    NO_CHANGES[name](other)
    assert not difference(read(result), read(other)).changed


def test_other_folders_are_no_change(result: Json, tmp_path: Path) -> None:
    a, b = copy.deepcopy(result), copy.deepcopy(result)
    for value, folder in ((a, "cells"), (b, tmp_path / "an other" / "place of mine")):
        item = {"name": "cell.robot.tool", "value": f"{folder}/g.toml", "unit": "", "certainty": "declared"}
        value["assumptions"].append({**item, "source": f"{folder}/g.toml"})
    assert not difference(read(a), read(b)).changed
    b["assumptions"][-1]["value"] = "cells/h.toml"
    assert len(difference(read(a), read(b)).assumptions) == 1


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("a/b/g.toml", "g.toml"),
        ("my cells/b/g.toml", "g.toml"),
        ("/home/a b/c/my gripper.toml", "my gripper.toml"),
        ("/a b/c.toml: robot", "c.toml: robot"),
        ("../a b/c.stl", "c.stl"),
        ("fitted on /a b/x.toml and /c/d e/y.toml", "fitted on x.toml and y.toml"),
        ("speeds: /a b/x.urdf; torques: /c/y.urdf", "speeds: x.urdf; torques: y.urdf"),
        ("/x.toml", "x.toml"),
        ("m/s of maker, table 3", "m/s of maker, table 3"),
        ("see a/b.urdf, c", "see b.urdf, c"),
        ("rad/s", "rad/s"),
        ("Org/Repo, x.yaml", "Org/Repo, x.yaml"),
    ],
)
def test_folders_are_left_out_of_names_of_files_alone(text: str, left: str) -> None:
    assert without_folders(text) == left


def test_tolerance_is_for_metres_and_seconds(result: Json) -> None:
    other = copy.deepcopy(result)
    other["tightest"]["gap_m"] += 0.01
    other["stop_time_s"]["max"] += 0.01
    assert len(difference(read(result), read(other), 0.02).numbers) == 0
    assert len(difference(read(result), read(other), 0.005).numbers) == 2
    other["verified"] = result["verified"]
    other["refused_measurements_total"] += 1
    assert len(difference(read(result), read(other), 5.0).numbers) == 1


def test_values_that_count_as_one() -> None:
    assert same(1e-15, 2e-15) and same(1.0, 1.0 + 1e-10) and same(None, None) and same("a", "a")
    assert not same(1.0, 1.0 + 1e-8) and not same(None, 0.0) and not same("1", 1.0) and not same(0.0, 1e-9)


# ------------------------------------------------------------------------------------------ the page


@pytest.fixture(scope="module")
def three(result: Json) -> list[Json]:
    second, third = copy.deepcopy(result), copy.deepcopy(result)
    n = result["cycles"]
    second["per_cycle"]["status"][: n // 2] = [1] * (n // 2)
    second["per_cycle"]["reason"][: n // 2] = [int(Reason.NO_ROOM)] * (n // 2)
    second["waived"] = ['<b>"nobody"</b>']
    second["robot"] = "<script>alert(1)</script>"
    for change, _told in list(CHANGES.values()):
        change(third)
    return [result, consistent(second), third]


def test_the_page_is_complete_readable_and_alone(three: list[Json]) -> None:
    comparison = compare_results(["x/a.json", "b<.json", "c.json"], [read(each) for each in three], 1e-6)
    page = complete_page(side_by_side_page(comparison), comparison, "3 results side by side", 41)
    assert len(marked(page)) >= len(comparison.changes[1].numbers) - 4
    curves = [each.attributes["class"] for each in page.first("svg").all("path") if "curve" in each.classes]
    assert curves == [f"curve curve-{k}" for k in (1, 2, 3)] * 2


def test_nothing_is_marked_where_nothing_changed(result: Json) -> None:
    nothing_changed(side_by_side_page(compare_results(["a", "a"], [read(result)] * 2, 1e-6)))


def test_json_is_what_the_schema_says(three: list[Json]) -> None:
    for results in (three, three[:1] * 2, three[1:]):
        in_schema("diff", compare_results(["a.json"] * len(results), [read(each) for each in results], 1e-6))


# ------------------------------------------------------------------------------------------ command line


@pytest.fixture
def files(result: Json, three: list[Json], tmp_path: Path) -> dict[str, Path]:
    paths = {"a": tmp_path / "a.json", "b": tmp_path / "b.json"}
    for path, value in zip(paths.values(), (result, three[1]), strict=True):
        path.write_text(json.dumps(value))
    return paths


def test_the_command(shell: Shell, files: dict[str, Path], tmp_path: Path) -> None:
    status, out, err = shell("diff", files["a"], files["a"])
    assert (status, err) == (0, "") and "from A to B: nothing changed" in out
    status, out, err = shell("diff", files["a"], files["b"], "--report", tmp_path / "d.html")
    assert (status, err) == (1, "") and "from A to B: changed" in out and "wrote " in out
    assert "\x1b" not in out and unreadable(parse((tmp_path / "d.html").read_bytes())) == []
    status, out, err = shell("diff", files["a"], files["b"], "--json", "-")
    assert (status, err) == (1, "")
    printed = json.loads(out)
    assert printed["changed"] and len(printed["changes"]) == 1 and not faults("diff", printed)
    half = sum(each["cycles"] for each in printed["changes"][0]["cycles"]["ranges"])
    assert (
        half
        == printed["changes"][0]["cycles"]["status_changed"]
        + printed["changes"][0]["cycles"]["reason_changed"]
    )


def test_a_page_is_not_overwritten(shell: Shell, files: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "d.html").write_text("mine")
    assert "exists already" in refused(shell("diff", *files.values(), "--report", tmp_path / "d.html"))
    assert (tmp_path / "d.html").read_text() == "mine"
    assert "is the result itself" in refused(shell("diff", *files.values(), "--json", files["a"], "--force"))


def all_of(place: str, value: Any) -> Callable[[Json], object]:
    """A change of every entry of a list of ``per_cycle``."""
    return lambda result: put(f"per_cycle/{place}", [value] * result["cycles"])(result)


NO_NUMBER = put("tightest/gap_m", float("nan"))
BAD: dict[str, tuple[Callable[[Json], Any], str]] = {
    "not json": (lambda r: json.dumps(r)[:-20], "not JSON"),
    "a list": (lambda r: [r], "is no result of `stopproof verify --json`"),
    "a number": (lambda _r: 7, "is no result"),
    "another result": (lambda _r: {"format": "stopproof diff 1"}, "is no result"),
    "another format": (put("format", "stopproof verify 99"), "is of the format stopproof verify 99, this"),
    "no format": (put("format-", None), "names no format"),
    "format is no text": (put("format", 1), "is no result"),
    "a key missing": (put("tightest-", None), "tightest: is missing; docs/verify.schema.json lists the keys"),
    "lists of several lengths": (put("per_cycle/t", [0.0]), "must be of one length"),
    "times that stand": (all_of("t", 1.0), "increase"),
    "a status that is none": (all_of("status", 7), "per_cycle.status"),
    "a reason without name": (all_of("reason", 99), "reason 99"),
    "counts that are wrong": (put("contradicted", 1), "contradicted is not the number"),
    "a gap that is no number": (lambda r: json.dumps(NO_NUMBER(r)), "tightest.gap_m"),
    "a huge start": (put("start_ns", 10**30), "start_ns"),
    "a text for a number": (put("cycles", "12"), "cycles"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_result_is_refused_in_one_line(
    shell: Shell, files: dict[str, Path], result: Json, name: str
) -> None:
    make, told = BAD[name]
    made = make(copy.deepcopy(result))
    files["b"].write_text(made if isinstance(made, str) else json.dumps(made))
    for order in (("a", "b"), ("b", "a")):
        line = refused(shell("diff", *(files[each] for each in order)))
        assert "b.json: " in line and told in line, line
        assert len(line) < 1100 and "cell.md" not in line


def test_other_bad_input(shell: Shell, files: dict[str, Path], tmp_path: Path) -> None:
    assert "compares 2 to 6 results, not 1" in refused(shell("diff", files["a"]))
    assert "compares 2 to 6 results, not 7" in refused(shell("diff", *[files["a"]] * 7))
    assert "missing.json: does not exist" in refused(shell("diff", files["a"], tmp_path / "missing.json"))
    assert "cannot be read" in refused(shell("diff", files["a"], tmp_path))
    for value in ("-1", "nan", "inf"):
        assert "--tolerance" in refused(shell("diff", *files.values(), f"--tolerance={value}"))
    assert "cannot go to standard output" in refused(shell("diff", *files.values(), "--report", "-"))
    page = tmp_path / "d.txt"
    assert "d.txt: is a page; its name must end in .html" in refused(
        shell("diff", *files.values(), "--report", page)
    )
    assert not page.exists()


def test_two_runs_of_one_recording(shell: Shell, tmp_path: Path) -> None:
    """End to end: a slower sensor chain costs verified cycles, and both hashes say what differs."""
    scene = Scene(duration=0.6, people={"p1": walking_up}).write(tmp_path / "r.mcap")
    head = '[robot]\nbare_flange = true\n[people]\nrepeated_points = "measured"\nlatency_s = '
    for name, latency in (("a", 0.03), ("b", 0.06)):
        (tmp_path / f"{name}.toml").write_text(f"{head}{latency}\n")
        shell("verify", scene, "--cell", tmp_path / f"{name}.toml", "--json", tmp_path / f"{name}.json")
    status, out, _err = shell("diff", tmp_path / "a.json", tmp_path / "b.json", "--json", "-")
    found = json.loads(out)["changes"][0]
    assert status == 1
    assert [each["what"] for each in found["inputs"]] == ["cell"]
    assert "cell.people.latency_s" in [each["name"] for each in found["assumptions"]]
    assert not re.search(r"recording", json.dumps(found["inputs"]))
