"""Monitored regions in whole recordings: people whom nobody lists are held against the robot too."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from occupancy.region import FARTHEST_M
from robots.errors import SetupError
from tests.source_files import ROOT
from tests.verifier.scenes import CELL, Array, Scene, at, person_at, swing, write_reports
from tests.verifier.shell import Shell, refused
from verifier import Cell, Reason, Status, VerifyReport, verify

WIDE: dict[str, Any] = {
    "kind": "box", "min_m": [-5.0, -5.0, -9.0], "max_m": [5.0, 5.0, 9.0], "detection_time_s": 0.1,
}  # fmt: skip
NARROW = {**WIDE, "max_m": [1.1, 5.0, 9.0]}
"""The robot comes within a metre of the face at x = 1.1 m."""


def cell(**monitored: dict[str, Any]) -> Cell:
    people = {**CELL["people"], "monitored": monitored} if monitored else CELL["people"]
    return Cell.from_table({"robot": CELL["robot"], "people": people})


def judged(path: Path, scene: Scene, **monitored: dict[str, Any]) -> VerifyReport:
    return verify(scene.write(path / "r.mcap"), cell(**monitored))


def reasons(report: VerifyReport) -> set[Reason]:
    return {Reason(int(reason)) for reason in np.unique(report.per_cycle.reason)}


OPEN_END = {Reason.NO_REPORT_YET, Reason.BEYOND_END}


def test_wide_region_verifies_with_somebody_inside(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=True), cell=WIDE)
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    assert report.exit_status == 0
    stated = {item.name: item.value for item in report.assumptions}
    assert stated["cell.people.monitored.cell.detection_time_s"] == 0.1


def test_that_nobody_was_reported_rests_on_the_region_too(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(duration=1.0, people={}, complete=True), cell=WIDE)
    assert report.count(Status.VERIFIED) > 0
    (note,) = (line for line in report.lines() if "lists anybody" in line)
    assert note.endswith("rests on A5, and on the proof that nobody comes in")


def test_narrow_region_lets_unseen_people_reach_the_robot(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=True), cell=NARROW)
    assert Reason.REACHABLE in reasons(report) and report.count(Status.CONTRADICTED) == 0
    witness = report.first_witness
    assert witness is not None
    assert (witness.person, witness.part, witness.model) == (
        "unobserved space",
        "whole body",
        "unobserved:cell",
    )
    budget = witness.budget
    grown = budget.latency + budget.stop + budget.error + budget.sides
    rest = budget.distance - budget.link - budget.body - grown
    assert rest == pytest.approx(witness.gap_m, abs=1e-9)
    assert budget.latency == pytest.approx(2.0 * (0.03 + 0.1), abs=1e-6) and budget.body == 0.0
    assert budget.stop == pytest.approx(2.0 * (witness.slice[1] - witness.cycle_t), abs=1e-6)


def test_a_region_that_does_not_contain_the_robot_must_be_larger(tmp_path: Path) -> None:
    """The arm reaches through the face at x = 0.3 m: no latency, stop or error of 0 would help."""
    report = judged(tmp_path, Scene(complete=True), cell={**WIDE, "max_m": [0.3, 5.0, 9.0]})
    witness = report.first_witness
    assert witness is not None and (witness.region, witness.shrink_first) == ("cell", "region")
    assert witness.room_m <= 0.0
    text = "\n".join(report.lines())
    assert f"shrink first: region: {witness.link} is not inside of the monitored region cell" in text
    assert "people.monitored.cell is larger" in text and "shrink first: latency" not in text
    assert report.to_dict()["budget_m"]["shrink_first"] == "region"


def test_a_region_with_too_little_room_says_how_far_its_border_is(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=True), cell=NARROW)
    witness = report.first_witness
    assert witness is not None and witness.shrink_first == "latency" and witness.region == "cell"
    low, high = (point[0] for point in witness.points)
    assert high == pytest.approx(1.1 - (witness.budget.latency + witness.budget.stop), abs=0.02)
    assert 0.0 < witness.room_m < 1.1 - low + 0.01
    text = "\n".join(report.lines())
    assert f"the border of the monitored region cell is {witness.room_m:.3f} m away" in text


def test_who_is_listed_is_no_matter_of_a_region(tmp_path: Path) -> None:
    scene = Scene(complete=True, people={"unobserved:x": lambda _t: person_at(1.0, 0.0)})
    report = judged(tmp_path, scene, cell=WIDE)
    witness = report.first_witness
    assert witness is not None and witness.person == "unobserved:x"
    assert witness.region is None and "the border of" not in "\n".join(report.lines())


def test_verified_cycle_can_be_tightest_against_the_unobserved_space(tmp_path: Path) -> None:
    region = {**WIDE, "max_m": [1.4, 5.0, 9.0]}
    report = judged(tmp_path, Scene(complete=True), cell=region)
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    assert report.tightest is not None and report.tightest.person == "unobserved space"
    assert 0.0 < report.tightest.gap_m < 0.5


def test_without_a_table_nothing_changes(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=True))
    assert report.tightest is not None and report.tightest.person == "p1"
    assert not any("monitored" in item.name for item in report.assumptions)


def test_nobody_reported_is_held_against_the_unobserved_space_too(tmp_path: Path) -> None:
    for name, region, expected in (
        ("wide", WIDE, Reason.NOBODY_REPORTED),
        ("narrow", NARROW, Reason.REACHABLE),
    ):
        folder = tmp_path / name
        folder.mkdir()
        report = judged(folder, Scene(people={}, complete=True), cell=region)
        assert expected in reasons(report)
        assert reasons(report) <= {expected, Reason.NOBODY_REPORTED, *OPEN_END}
        if expected is Reason.NOBODY_REPORTED:
            assert math.isfinite(report.per_cycle.gap_m[10])
            assert report.tightest is not None and report.tightest.person == "unobserved space"


def test_without_a_complete_report_nothing_is_verified(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=False), cell=WIDE)
    assert reasons(report) == {Reason.NOT_OBSERVED, *OPEN_END} and report.exit_status == 1
    witness = report.first_witness
    assert witness is not None and witness.person == "unobserved space"
    assert witness.model == "unobserved:cell"
    assert witness.part == "whole body" and math.isnan(witness.budget.distance)


def test_one_of_two_regions_suffices(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(complete=True), narrow=NARROW, wide=WIDE)
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}


@pytest.mark.parametrize(
    "change",
    [{"detection_time_s": 0.4}, {"boundary_error_m": 0.6}, {"max_m": [0.8, 5.0, 9.0]}],
    ids=lambda change: next(iter(change)),
)
def test_less_that_is_known_never_verifies_more(tmp_path: Path, change: dict[str, Any]) -> None:
    region = {**WIDE, "max_m": [1.4, 5.0, 9.0]}
    scene = Scene(complete=True, duration=1.2)
    (tmp_path / "base").mkdir()
    base = judged(tmp_path / "base", scene, cell=region)
    worse = judged(tmp_path, scene, cell={**region, **change})
    verified = worse.per_cycle.status == Status.VERIFIED
    assert (base.per_cycle.status[verified] == Status.VERIFIED).all()
    assert worse.count(Status.VERIFIED) < base.count(Status.VERIFIED)


def run(path: Path, where: dict[str, Callable[[float], Array | None]], seconds: float = 2.0) -> VerifyReport:
    """Complete reports every 20 ms of whoever is somewhere; ``None``: not listed."""
    reports = []
    for t in at(50.0, seconds):
        people = {name: xyz for name, place in where.items() if (xyz := place(t)) is not None}
        reports.append((t, t + 0.03, people))
    recording = write_reports(path / "r.mcap", reports, motion=swing)
    return verify(recording, cell(cell=WIDE))


def test_who_walks_out_of_the_region_no_longer_blocks(tmp_path: Path) -> None:
    def walker(t: float) -> Array | None:
        return person_at(4.0 + 1.5 * t, 0.0) if t < 1.0 else None

    report = run(tmp_path, {"p1": walker, "p2": lambda _t: person_at(-4.0, 0.0)}, 2.0)
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}


def test_changed_id_leaves_no_ghost(tmp_path: Path) -> None:
    def before(t: float) -> Array | None:
        return person_at(3.0, 0.0) if t < 0.6 else None

    def after(t: float) -> Array | None:
        return person_at(3.0, 0.0) if t >= 0.6 else None

    report = run(tmp_path, {"p1": before, "z9": after})
    assert report.count(Status.VERIFIED) > 150 and report.count(Status.NOT_VERIFIED) == 0
    # until the new id is known, a cycle knows one body as p1 and later sees it as somebody new
    assert report.count(Status.CONTRADICTED) == 0


def test_who_vanishes_in_the_middle_contradicts_the_reports(tmp_path: Path) -> None:
    def gone(t: float) -> Array | None:
        return person_at(3.0, 0.0) if t < 0.6 else None

    report = run(tmp_path, {"p1": gone, "p2": lambda _t: person_at(-4.0, 0.0)})
    late = report.per_cycle.reason[report.per_cycle.t > 0.65]
    assert set(late) <= {Reason.INCONSISTENT_REPORTS, Reason.BEYOND_END}
    [found] = [item for item in report.contradicted if item.reason is Reason.INCONSISTENT_REPORTS]
    assert found.assumption == "A5 reports" and "p1 must be in the monitored region" in found.text


def test_who_comes_back_near_the_robot_was_not_reported_before(tmp_path: Path) -> None:
    """p1 leaves, and is next seen where nobody can have come unseen: the cycles before are contradicted."""

    def back(t: float) -> Array | None:
        if t < 0.5:
            return person_at(4.9, 0.0)
        return person_at(1.0, 0.0) if t >= 1.5 else None

    report = run(tmp_path, {"p1": back, "p2": lambda _t: person_at(-4.0, 0.0)})
    assert Reason.UNREPORTED_PERSON in reasons(report)
    [found] = [item for item in report.contradicted if item.reason is Reason.UNREPORTED_PERSON]
    assert "p1, first seen then" in found.text
    first = int(np.argmax(report.per_cycle.reason == Reason.UNREPORTED_PERSON))
    assert 0.5 < report.per_cycle.t[first] < 1.5


# ---------------------------------------------------------------------------------------------------- cell


PRISM = {
    "kind": "prism", "polygon_m": [[-4.0, -4.0], [4.0, -4.0], [0.0, 5.0]], "z_m": [-9.0, 9.0],
    "detection_time_s": 0.2,
}  # fmt: skip
FRUSTUM = {
    "kind": "frustum", "origin_m": [0.0, 0.0, 6.0], "rpy_deg": [0.0, 90.0, 0.0], "near_m": 0.5, "far_m": 20.0,
    "horizontal_fov_deg": 110.0, "vertical_fov_deg": 110.0, "detection_time_s": 0.0,
}  # fmt: skip


@pytest.mark.parametrize("region", [PRISM, FRUSTUM], ids=["prism", "frustum"])
def test_other_kinds_of_regions_verify_too(tmp_path: Path, region: dict[str, Any]) -> None:
    report = judged(tmp_path, Scene(complete=True, duration=1.0), cell=region)
    assert Reason.SEPARATED in reasons(report)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ({**WIDE, "kind": "ball"}, "kind"),
        ({key: value for key, value in WIDE.items() if key != "max_m"}, "a box needs the keys max_m, min_m"),
        ({**WIDE, "z_m": [0.0, 1.0]}, "a box needs the keys max_m, min_m and no others"),
        ({key: value for key, value in WIDE.items() if key != "detection_time_s"}, "detection_time_s"),
        ({**WIDE, "detection_time_s": -0.1}, "detection_time_s"),
        ({**WIDE, "boundary_error_m": math.nan}, "boundary_error_m"),
        ({**WIDE, "max_m": [-9.0, 5.0, 9.0]}, r"people.monitored.cell: .*below upper"),
        ({**WIDE, "max_m": [500.0, 5.0, 9.0]}, r"people.monitored.cell: .*within 100 m"),
        ({**PRISM, "polygon_m": [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]}, "convex"),
        ({**FRUSTUM, "vertical_fov_deg": 180.0}, "vertical_fov_deg"),
        ({**FRUSTUM, "far_m": 0.2}, "near < far"),
    ],
)
def test_what_is_no_region_is_refused_with_its_place(
    tmp_path: Path, region: dict[str, Any], message: str
) -> None:
    with pytest.raises(SetupError, match=message):
        judged(tmp_path, Scene(complete=True, duration=0.5), cell=region)


def test_a_region_of_a_file_is_refused_with_the_file(tmp_path: Path, shell: Shell) -> None:
    text = "[robot]\nbare_flange = true\n[people.monitored.'my cell']\nkind = 'box'\ndetection_time_s = 0.1\n"
    path = tmp_path / "cell.toml"
    path.write_text(f"{text}min_m = [-5, -5, -5]\nmax_m = [500, 5, 5]\n", encoding="utf-8")
    recording = Scene(complete=True, duration=0.3).write(tmp_path / "r.mcap")
    for more in ((), ("--human", "iso13855"), ("--compare",)):
        told = refused(shell("verify", recording, "--cell", path, *more))
        assert f"{path}: people.monitored.my cell: the faces of a region must lie within 100 m" in told


def test_the_distance_that_the_document_states_is_the_one_that_is_refused() -> None:
    text = (ROOT / "docs/cell.md").read_text(encoding="utf-8")
    assert f"must pass within {FARTHEST_M:g} m of the world's origin" in " ".join(text.split())


def test_more_regions_than_models_have_numbers_are_refused() -> None:
    with pytest.raises(SetupError, match="at most 8"):
        cell(**{f"r{k}": WIDE for k in range(8)})


def test_arm_beyond_the_arena_is_not_verified(tmp_path: Path) -> None:
    """Rows of unobserved space hold within 100 m of the world's origin."""
    table = {"robot": {**CELL["robot"], "mount": {"xyz_m": [0.0, 0.0, 150.0]}}}
    people = {"latency_s": 0.03, "monitored": {"cell": WIDE}}
    recording = Scene(complete=True, duration=1.0).write(tmp_path / "r.mcap")
    report = verify(recording, Cell.from_table({**table, "people": people}))
    assert reasons(report) == {Reason.NOT_OBSERVED, *OPEN_END}
