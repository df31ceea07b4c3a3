"""Power and force limiting in whole recordings: a hand reaches towards a slow arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from occupancy.body import Point
from robots.errors import SetupError
from tests.verifier.scenes import CELL, Array, Scene, person_at, swing
from verifier import Cell, Reason, Status, VerifyReport, verify
from verifier.cell_reading import CellError

LINKS = [f"{name}_link" for name in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")]
NARROW = [
    ["forearm_link", "wrist_2_link"],
    ["forearm_link", "wrist_3_link"],
    ["wrist_1_link", "wrist_3_link"],
    ["upper_arm_link", "wrist_1_link"],
    ["shoulder_link", "forearm_link"],
]
"""Gaps of the arm's own in this posture that are narrower than an arm."""
RULE: dict[str, Any] = {
    "links": LINKS,
    "parts": ["r_hand", "r_forearm", "r_upper_arm", "l_hand", "l_forearm"],
    "person_speed": "neglected",
}
CRITERIA: dict[str, Any] = {"contact": [RULE], "gaps_by_design": NARROW, "accept_unverified": True}
OPEN_END = {Reason.NO_REPORT_YET, Reason.BEYOND_END}
WORKSPACE: dict[str, Any] = {"floor_z_m": -0.8}


def reaching(t: float) -> Array:
    """The right arm stretched towards the robot."""
    points = person_at(1.5, 0.0)
    for point, offset in (
        (Point.R_ELBOW, (-0.3, 0.05, -0.05)),
        (Point.R_WRIST, (-0.55, 0.1, -0.1)),
        (Point.R_HAND, (-0.63, 0.1, -0.12)),
        (Point.R_FINGERTIP, (-0.73, 0.1, -0.14)),
    ):
        points[point] = points[Point.R_SHOULDER] + offset
    return points


def slow(t: float) -> Array:
    return swing(0.2 * t)


def cell(criteria: dict[str, Any], workspace: dict[str, Any] = WORKSPACE, **tracking: Any) -> Cell:
    tracking = tracking or {"velocity_error_rad_s": 0.001}
    robot = {**CELL["robot"], "tracking": tracking}
    return Cell.from_table({**CELL, "robot": robot, "workspace": workspace, "criteria": criteria})


def judged(path: Path, given: Cell, scene: Scene | None = None) -> VerifyReport:
    scene = scene or Scene(duration=0.6, motion=slow, people={"p1": reaching})
    return verify(scene.write(path / f"{len(list(path.iterdir()))}.mcap"), given)


def reasons(report: VerifyReport) -> dict[Reason, int]:
    values, counts = np.unique(report.per_cycle.reason, return_counts=True)
    return {Reason(int(reason)): int(n) for reason, n in zip(values, counts, strict=True)}


def test_a_hand_may_be_touched_slowly(tmp_path: Path) -> None:
    without = judged(tmp_path, cell({}))
    assert Reason.REACHABLE in reasons(without) and without.first_witness is not None
    assert "power_and_force_limiting" in without.not_checked_criteria
    report = judged(tmp_path, cell(CRITERIA))
    found = reasons(report)
    assert found.get(Reason.CONTACT_WITHIN_LIMITS) == reasons(without)[Reason.REACHABLE]
    assert Reason.REACHABLE not in found and report.first_witness is None
    assert "power_and_force_limiting" in report.checked_criteria
    contact = report.per_cycle.reason == int(Reason.CONTACT_WITHIN_LIMITS)
    assert np.isnan(report.per_cycle.gap_m[contact]).all()
    assert report.tightest is None or report.tightest.gap_m > 0.0
    text = "\n".join(report.lines())
    assert f"  verified     {contact.sum():>9}  what links do not stay apart from" in text
    assert "pressure, edges and points are not checked" in text
    assert report.exit_status == 3 and len(report.waived) == len(NARROW)


def test_the_result_lists_every_number(tmp_path: Path) -> None:
    report = judged(tmp_path, cell(CRITERIA))
    stated = {item.name: item for item in report.assumptions}
    assert stated["contact.0.limit.r_hand"].value == pytest.approx(320 / np.sqrt(40e3 * 2), rel=1e-9)
    assert stated["contact.0.limit.r_upper_arm"].value == pytest.approx(420 / np.sqrt(35e3 * 40), rel=1e-9)
    assert stated["contact.0.robot_mass_kg"].value == np.inf
    assert stated["contact.0.person_speed_m_s"].source == "the part's own speed is neglected"
    assert stated["contact.ts15066.region.hand.stiffness"].certainty == "unverified"
    assert stated["contact.pressure"].value == "not checked"
    assert stated["cell.robot.tracking.velocity_error_rad_s"].value == 0.001
    assert ("contact.gap_not_checked.shoulder_link", "joined by one joint") in {
        (item.name, item.source) for item in report.assumptions
    }


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"contact": [{**RULE, "links": [link for link in LINKS if link != "forearm_link"]}]}, ""),
        ({"contact": [{**RULE, "parts": ["l_hand", "l_forearm"]}]}, ""),
        ({"contact": [{**RULE, "person_speed": "added"}]}, "the person's speed leaves none to the link"),
        ({"gaps_by_design": NARROW[1:]}, f"between link and {NARROW[0][1]} the "),
    ],
    ids=["another link", "another part", "person's speed", "a narrow gap"],
)
def test_what_is_not_allowed_must_stay_apart(change: dict[str, Any], why: str, tmp_path: Path) -> None:
    report = judged(tmp_path, cell({**CRITERIA, **change}))
    assert Reason.REACHABLE in reasons(report)
    witness = report.first_witness
    assert witness is not None and witness.link in LINKS
    assert witness.no_contact.startswith(why) and bool(why) == bool(witness.no_contact)
    assert (f"contact of {witness.link} is declared, but " in "\n".join(report.lines())) == bool(why)


def test_a_fast_arm_may_touch_nothing(tmp_path: Path) -> None:
    scene = Scene(duration=0.6, motion=lambda t: swing(1.8 * t) * [2, 1, 1, 1, 1, 1], people={"p1": reaching})
    report = judged(tmp_path, cell(CRITERIA), scene)
    found = reasons(report)
    assert Reason.REACHABLE in found and report.first_witness is not None
    assert "may be touched at no more than " in report.first_witness.no_contact
    assert set(found) <= {Reason.REACHABLE, Reason.SEPARATED, Reason.CONTACT_WITHIN_LIMITS, *OPEN_END}


def test_beside_a_fixture_nothing_may_be_touched(tmp_path: Path) -> None:
    wall = {"kind": "box", "xyz_m": [0.76, 0.0, 0.3], "size_m": [0.1, 2.0, 2.0]}
    near = judged(tmp_path, cell(CRITERIA, {**WORKSPACE, "fixtures": {"wall": wall}}))
    assert Reason.REACHABLE in reasons(near) and near.count(Status.VERIFIED) > 0
    assert near.first_witness is not None and "between link and wall the " in near.first_witness.no_contact


def test_a_head_within_reach_is_never_touched(tmp_path: Path) -> None:
    scene = Scene(duration=0.4, motion=slow, people={"p1": lambda t: person_at(0.9, 0.0, -1.5)})
    report = judged(tmp_path, cell(CRITERIA), scene)
    assert reasons(report)[Reason.REACHABLE] > 20
    assert report.first_witness is not None and "head" in report.first_witness.part


def test_the_witness_is_of_what_may_not_be_touched(tmp_path: Path) -> None:
    """The hand is nearest, and may be touched; what is shown must be what is in the way."""
    scene = Scene(duration=0.4, motion=slow, people={"p1": lambda t: reaching(t) - [0.4, 0.0, 0.0]})
    plain = judged(tmp_path, cell({}), scene)
    report = judged(tmp_path, cell(CRITERIA), scene)
    assert plain.first_witness is not None and plain.first_witness.part == "r_hand"
    assert plain.deepest is not None and plain.deepest.part in RULE["parts"]
    for found in (report.first_witness, report.deepest):
        assert found is not None and found.part not in RULE["parts"]


def test_unverified_limits_are_a_waiver(tmp_path: Path) -> None:
    criteria = {key: value for key, value in CRITERIA.items() if key != "accept_unverified"}
    report = judged(tmp_path, cell(criteria))
    assert report.waived[0].startswith("limits of contact that nobody has verified")


def test_own_limits_stand_beside_the_cell(tmp_path: Path) -> None:
    from occupancy import contact_limits

    bundled = Path(contact_limits.__file__).parent / "contact" / "ts15066.toml"
    text = bundled.read_text(encoding="utf-8").replace('"unverified"', '"sourced"')
    (tmp_path / "ours.toml").write_text(text.replace('name = "ts15066"', 'name = "ours"'), encoding="utf-8")
    given = cell({"contact": [RULE], "gaps_by_design": NARROW, "contact_limits": "ours.toml"})
    table = given.model_dump(exclude_unset=True, exclude_none=True)
    given = Cell.from_table(table, folder=tmp_path)
    report = judged(tmp_path, given)
    assert not [text for text in report.waived if "verified" in text]
    assert "contact.ours.region.hand.force" in {item.name for item in report.assumptions}
    weaker = text.replace("value = 160.0", "value = 1.0").replace('name = "ts15066"', 'name = "ours"')
    (tmp_path / "ours.toml").write_text(weaker, encoding="utf-8")
    other = judged(tmp_path, given)
    assert other.cell_hash != report.cell_hash and Reason.REACHABLE in reasons(other)


def test_a_light_robot_may_be_faster_and_says_so(tmp_path: Path) -> None:
    light = {**RULE, "moving_mass_kg": 10.0, "payload_kg": 1.0}
    report = judged(tmp_path, cell({**CRITERIA, "contact": [light]}))
    stated = {item.name: item for item in report.assumptions}
    assert stated["contact.0.robot_mass_kg"].value == 6.0
    assert "understates" in stated["contact.0.robot_mass_kg"].source
    effective = 1.0 / (1.0 / 40.0 + 1.0 / 6.0)
    expected = 420 / np.sqrt(35e3 * effective)
    assert stated["contact.0.limit.r_upper_arm"].value == pytest.approx(
        min(expected, 300 / np.sqrt(30e3 * 2))
    )


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "part": ({"contact": [{**RULE, "parts": ["thumb"]}]}, "'thumb' is not a body part"),
    "no part": ({"contact": [{**RULE, "parts": []}]}, "parts"),
    "half a mass": ({"contact": [{**RULE, "payload_kg": 1.0}]}, "give both, or none"),
    "limits": ({"contact": [RULE], "contact_limits": "din"}, "'din' is not known; there are ts15066"),
    "no rule": ({"gaps_by_design": NARROW}, "belongs to"),
}


@pytest.mark.parametrize("case", BAD)
def test_rules_that_make_no_sense_are_refused(case: str) -> None:
    criteria, message = BAD[case]
    with pytest.raises(CellError, match=message):
        cell(criteria)


def test_a_rule_needs_surroundings_and_speeds(tmp_path: Path) -> None:
    with pytest.raises(CellError, match=r"^cell: criteria\.contact needs \[workspace\]"):
        cell(CRITERIA, {})
    with pytest.raises(CellError, match=r"state robot\.tracking\.velocity_error_rad_s"):
        cell(CRITERIA, delay_max_s=0.01)
    for part in ("head", "neck", "l_foot"):
        with pytest.raises(SetupError, match=f"{part} must not be touched"):
            judged(tmp_path, cell({**CRITERIA, "contact": [{**RULE, "parts": ["l_hand", part]}]}))
    with pytest.raises(SetupError, match="link hand is not known"):
        judged(tmp_path, cell({**CRITERIA, "contact": [{**RULE, "links": ["hand"]}]}))
