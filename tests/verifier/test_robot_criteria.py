"""Fixtures, floor, self-collision and joint limits in whole recordings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.errors import SetupError
from tests.verifier.scenes import CELL, Array, Scene, at_rest, swing
from verifier import Cell, Reason, Status, VerifyReport, verify
from verifier.cell_reading import CellError
from verifier.verdict import CriterionKind

OPEN_END = {Reason.NO_REPORT_YET, Reason.BEYOND_END}
WALL: dict[str, Any] = {"kind": "box", "xyz_m": [0.9, 0.0, 0.3], "size_m": [0.1, 2.0, 2.0]}
"""In front of the arm, which comes as far as x = 0.75 m."""


def cell(**tables: Any) -> Cell:
    return Cell.from_table({**CELL, **tables})


def judged(path: Path, scene: Scene, *, nobody: bool = False, **tables: Any) -> VerifyReport:
    recording = scene.write(path / f"{len(list(path.iterdir()))}.mcap")
    return verify(recording, cell(**tables), assume_nobody=nobody)


def fixtures(**each: dict[str, Any]) -> dict[str, Any]:
    return {"fixtures": each}


def reasons(report: VerifyReport) -> set[Reason]:
    return {Reason(int(reason)) for reason in np.unique(report.per_cycle.reason)}


def test_without_tables_both_are_listed_as_not_checked(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(duration=0.5))
    assert {"workspace", "self_collision", "torque"} <= set(report.not_checked_criteria)
    assert report.checked_criteria == ("separation", "joint_limits")
    assert reasons(report) <= {Reason.SEPARATED, *OPEN_END}


def test_a_far_fixture_is_checked_and_changes_nothing(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(duration=0.5), workspace={"floor_z_m": -0.8, **fixtures(wall=WALL)})
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    assert "workspace" in report.checked_criteria and "workspace" not in report.not_checked_criteria
    assert report.exit_status == 0
    assert any("workspace" in line for line in report.lines() if line.startswith("checked:"))


NEAR = {**WALL, "xyz_m": [0.6, 0.0, 0.3]}


@pytest.mark.parametrize("nobody", [False, True])
def test_a_near_fixture_is_in_reach_whoever_is_there(tmp_path: Path, nobody: bool) -> None:
    report = judged(tmp_path, Scene(duration=0.5), nobody=nobody, workspace=fixtures(wall=NEAR))
    assert Reason.FIXTURE_IN_REACH in reasons(report)
    assert report.count(Status.VERIFIED) == 0 and report.exit_status == 1
    found = report.first_witness
    assert found is not None
    assert (found.other, found.person, found.criterion) == ("wall", "", "workspace")
    assert found.gap_m <= 1e-4
    terms = found.budget
    rest = terms.distance - terms.link - terms.body - terms.latency - terms.stop - terms.error
    assert rest == pytest.approx(found.gap_m, abs=1e-12)
    text = "\n".join(report.lines())
    assert "and wall (workspace), gap -" in text and "could touch a fixture" in text


def test_also_when_no_report_has_arrived(tmp_path: Path) -> None:
    late = Scene(duration=0.5, people_from=0.3)
    report = judged(tmp_path, late, workspace=fixtures(wall=NEAR))
    assert report.count(Status.NOT_CHECKED) < 0.5 * report.cycles
    assert Reason.NO_REPORT_YET not in reasons(report)


def test_the_position_error_is_part_of_the_witness(tmp_path: Path) -> None:
    near = {**NEAR, "position_error_m": 0.07}
    report = judged(tmp_path, Scene(duration=0.5), workspace=fixtures(wall=near))
    without = judged(tmp_path, Scene(duration=0.5), workspace=fixtures(wall=NEAR))
    assert report.first_witness is not None and without.first_witness is not None
    assert report.first_witness.budget.error == pytest.approx(without.first_witness.budget.error + 0.07)
    stated = {item.name: item.value for item in report.assumptions}
    assert stated["cell.workspace.fixtures.wall.position_error_m"] == 0.07
    assert stated["workspace.wall.error"] == 0.07


def test_a_robot_that_stands_still_may_touch_what_it_touches(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(duration=0.5, motion=at_rest), workspace=fixtures(wall=NEAR))
    assert reasons(report) == {Reason.AT_REST, *OPEN_END}


def test_links_that_may_touch_are_waived_and_listed(tmp_path: Path) -> None:
    table = {"kind": "plane", "point_m": [0.0, 0.0, 0.02], "normal": [0.0, 0.0, 1.0]}
    blocked = judged(tmp_path, Scene(duration=0.5), workspace=fixtures(table=table))
    assert blocked.first_witness is not None and blocked.first_witness.link == "shoulder_link"
    touching = {**table, "may_touch": ["shoulder_link", "upper_arm_link"]}
    report = judged(tmp_path, Scene(duration=0.5), workspace=fixtures(table=touching))
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    assert report.waived == ("may touch the fixture table, not checked: shoulder_link, upper_arm_link",)
    assert report.exit_status == 3
    assert "workspace.table.may_touch.shoulder_link" in {item.name for item in report.assumptions}
    with pytest.raises(SetupError, match=r"fixture table: may_touch: link hand is not known; there are: sh"):
        judged(tmp_path, Scene(), workspace=fixtures(table={**table, "may_touch": ["hand"]}))


def test_floor_and_its_links(tmp_path: Path) -> None:
    workspace = {
        "floor_z_m": 0.02,
        "floor_may_touch": ["shoulder_link", "upper_arm_link"],
        "floor_error_m": 0.001,
    }
    report = judged(tmp_path, Scene(duration=0.5), workspace=workspace)
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    assert report.waived == ("may touch the floor, not checked: shoulder_link, upper_arm_link",)
    high = judged(tmp_path, Scene(duration=0.5), workspace={**workspace, "floor_z_m": 0.5})
    assert high.first_witness is not None and high.first_witness.other == "floor"


def folded(t: float) -> Array:
    """The forearm folds onto the upper arm."""
    return swing(t) * [1, 1, 0, 1, 1, 1] + [0.0, 0.0, 1.9 + 0.9 * np.sin(1.5 * t), 0.0, 0.0, 0.0]


def test_the_arm_against_itself(tmp_path: Path) -> None:
    motion = Scene(duration=1.0, motion=folded)
    plain = judged(tmp_path, motion)
    assert reasons(plain) == {Reason.SEPARATED, *OPEN_END}
    report = judged(tmp_path, motion, criteria={"self_collision": True})
    assert Reason.LINKS_IN_REACH in reasons(report) and "self_collision" in report.checked_criteria
    found = report.first_witness
    assert found is not None and found.criterion == "self_collision" and found.other
    terms = found.budget
    rest = terms.distance - terms.link - terms.body - terms.latency - terms.stop - terms.error
    assert rest == pytest.approx(found.gap_m, abs=1e-12)
    pair = [found.link, found.other]
    allowed = {"self_collision": True, "links_may_touch": [pair]}
    other = judged(tmp_path, motion, criteria=allowed)
    assert other.waived == (f"may touch each other, not checked: {' and '.join(pair)}",)
    again = other.first_witness
    assert again is None or {again.link, again.other} != set(pair)


def test_the_swinging_arm_does_not_meet_itself(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(duration=0.5), criteria={"self_collision": True})
    assert reasons(report) == {Reason.SEPARATED, *OPEN_END}
    left_out = {
        (item.name.rsplit(".", 1)[1], item.value): item.source
        for item in report.assumptions
        if item.name.startswith("self_collision.left_out.")
    }
    assert left_out["shoulder_link", "upper_arm_link"] == "joined by one joint"
    assert len(left_out) == 5


def test_joint_limits_name_their_criterion(tmp_path: Path) -> None:
    from verifier.verdict import verdict

    slow = {"shoulder_pan_joint": {"velocity_rad_s": 0.1}}
    report = judged(tmp_path, Scene(duration=0.5), robot={**CELL["robot"], "limits": slow})
    assert Reason.STATE_BEYOND_LIMITS in reasons(report)
    assert "joint_limits" in report.checked_criteria
    for reason, criterion in (
        (Reason.STATE_BEYOND_LIMITS, CriterionKind.JOINT_LIMITS),
        (Reason.NO_STOP_WITHIN_LIMITS, CriterionKind.JOINT_LIMITS),
        (Reason.FIXTURE_IN_REACH, CriterionKind.WORKSPACE),
        (Reason.LINKS_IN_REACH, CriterionKind.SELF_COLLISION),
        (Reason.REACHABLE, CriterionKind.SEPARATION),
    ):
        assert verdict(reason, 0.0, gap_m=0.0, stop_time_s=0.0, not_checked=0).criterion == criterion


TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


def write_mesh(path: Path, size: float) -> Path:
    lines = ["solid it"]
    for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        corners = [[size * x for x in TETRAHEDRON[k]] for k in face]
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in corners)]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid it"]))
    return path


def test_meshes_lie_beside_the_cell_and_count_for_its_hash(tmp_path: Path) -> None:
    write_mesh(tmp_path / "it.stl", 500.0)
    recording = Scene(duration=0.3).write(tmp_path / "r.mcap")
    text = (
        '[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n[people]\nlatency_s = 0.03\n'
        'repeated_points = "measured"\n[workspace.fixtures.it]\nkind = "mesh"\nfile = "it.stl"\n'
        "scale = 0.001\n"
    )

    def run(place: str) -> VerifyReport:
        (tmp_path / "cell.toml").write_text(text + place)
        return verify(recording, Cell.from_toml(tmp_path / "cell.toml"))

    far = run("xyz_m = [0.9, 0.0, 0.0]\n")
    assert reasons(far) == {Reason.SEPARATED, *OPEN_END}
    near = run("xyz_m = [0.1, -0.1, 0.05]\n")
    assert near.first_witness is not None and near.first_witness.other == "it"
    apart = run('xyz_m = [0.9, 0.0, 0.0]\npieces = "connected"\n')
    assert reasons(apart) == {Reason.SEPARATED, *OPEN_END}
    write_mesh(tmp_path / "it.stl", 499.0)
    assert run("xyz_m = [0.9, 0.0, 0.0]\n").cell_hash != far.cell_hash
    (tmp_path / "it.stl").write_text("this is no mesh")
    with pytest.raises(SetupError, match=r"it\.stl: not a mesh"):
        run("")


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "kind": (fixtures(x={"kind": "ball"}), "kind"),
    "too few": (fixtures(x={"kind": "box", "xyz_m": [0.0, 0.0, 0.0]}), "a box needs the keys size_m, xyz_m"),
    "too many": (fixtures(x={**WALL, "a_m": [0.0, 0.0, 0.0]}), "may have rpy_deg, and no others"),
    "flat": (fixtures(x={**WALL, "size_m": [1.0, 0.0, 1.0]}), "size_m"),
    "floor": (fixtures(floor=WALL), "floor_z_m"),
    "no floor": ({"floor_error_m": 0.1}, "give floor_z_m"),
    "nan": ({"floor_z_m": float("nan")}, "floor_z_m"),
    "null": (fixtures(x={"kind": "mesh", "file": "a\0"}), "null character"),
}


@pytest.mark.parametrize("case", BAD)
def test_tables_that_make_no_sense_are_refused(case: str) -> None:
    table, message = BAD[case]
    with pytest.raises(CellError, match=message):
        cell(workspace=table)


def test_exempt_pairs_need_their_criterion(tmp_path: Path) -> None:
    with pytest.raises(CellError, match="self_collision = true"):
        cell(criteria={"links_may_touch": [["a", "b"]]})
    wrong = {"self_collision": True, "links_may_touch": [["wrist_1_link", "b"]]}
    with pytest.raises(SetupError, match="link b of wrist_1_link and b: is not known"):
        judged(tmp_path, Scene(), criteria=wrong)


def test_an_output_never_replaces_a_mesh(tmp_path: Path, shell: Callable[..., Any]) -> None:
    mesh = write_mesh(tmp_path / "it.stl", 1.0)
    recording = Scene(duration=0.3).write(tmp_path / "r.mcap")
    (tmp_path / "cell.toml").write_text(
        '[robot]\nbare_flange = true\n[workspace.fixtures.it]\nkind = "mesh"\nfile = "it.stl"\n'
    )
    arguments = ("verify", recording, "--cell", tmp_path / "cell.toml", "--json", mesh, "--force")
    status, _, error = shell(*arguments)
    assert status == 2 and "mesh of it" in error
    assert mesh.read_text().startswith("solid")
