"""The scenario: what it prints, its JSON and pictures, and what the verifier makes of a hand on the tool."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from modes.contact.experiments import EXPERIMENTS, identified
from modes.contact.report import ContactReport
from modes.contact.scenario import (
    _SETTINGS,
    CELL,
    HELD_LINKS,
    Size,
    _broken,
    _guided,
    cell_of,
    run_scenario,
)
from modes.contact.trials import PEAKS_N, Arm, faults
from modes.contact.twin import Body
from tests.verifier.shell import Shell, shell
from verifier.scenario import load_scenario, scenario_names
from verifier.setup import build_contact, build_profile

__all__ = ["shell"]

ROOT = Path(__file__).parents[3]
SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/scenario-contact.schema.json").read_text("utf-8"))


WHOLE = "the pieces: test_experiments.py, test_contact_mode.py, and the tests without a report here"


@pytest.fixture(scope="module")
def report() -> ContactReport:
    shares: list[float] = []
    found = run_scenario(Size(hours=0.02, blows=1), shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    return found


@pytest.mark.rarely(WHOLE)
def test_the_json_is_what_the_schema_says(report: ContactReport) -> None:
    document = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    jsonschema.validate(document, SCHEMA)
    assert document["static_compliance_mm_per_N"] == pytest.approx(3.33, abs=0.05)
    assert document["false_alarms_per_hour"] == 0.0 and document["false_alarms"]["hours"] == pytest.approx(
        0.02
    )
    assert [each["name"] for each in document["experiments"]] == [each.name for each in EXPERIMENTS]
    assert len(document["detection_delays"]) == 2 * len(PEAKS_N)


@pytest.mark.rarely(WHOLE)
def test_every_experiment_and_every_fault_ends_as_expected_under_the_verifier_too(
    report: ContactReport,
) -> None:
    document: dict[str, Any] = report.to_dict()
    for key in ("experiments", "experiments_under_the_verifier", "sensor_faults"):
        assert len(document[key]) >= 6
        for each in document[key]:
            assert each["as_expected"] is True, each


@pytest.mark.rarely(WHOLE)
def test_drives_keep_the_tracking_error_that_the_cell_declares(report: ContactReport) -> None:
    """Not so while it is hit, which is said."""
    declared = CELL["robot"]["tracking"]
    for each in report.guided:
        assert each.tracked.beyond == 0 and each.tracked.position_rad < declared["position_error_rad"]
        assert each.tracked.velocity_rad_s < declared["velocity_error_rad_s"]
    assert 0 < report.tracked.beyond < 100
    assert (
        f"in {report.tracked.beyond} control steps, hit, they were off by more: A2 does not hold"
        in "\n".join(report.lines_of_text())
    )


@pytest.mark.rarely(WHOLE)
def test_a_hand_leads_the_tool_only_where_contact_is_declared_and_reports_are_fast(
    report: ContactReport,
) -> None:
    declared, slow, tool_alone, separated = report.guided
    assert declared.links == HELD_LINKS and declared.led_m > 0.06 and declared.stood < 0.2
    assert "collaboration" in declared.states
    assert slow.links == HELD_LINKS and slow.led_m < 5e-3 and "r_upper_arm" in slow.lacking
    assert tool_alone.led_m < 5e-3 and tool_alone.lacking.startswith("link_6 from r_hand")
    assert not separated.links and separated.led_m < 5e-3 and "r_hand" in separated.lacking


@pytest.mark.rarely(WHOLE)
def test_what_is_printed_says_what_was_found_and_what_is_not_checked(report: ContactReport) -> None:
    text = "\n".join(report.lines_of_text())
    assert text.count("as expected") == 2 * len(EXPERIMENTS) and "NOT as expected" not in text
    for said in (
        "Not checked: pressure, edges and points.",
        "masses, friction and noise that are made up",
    ):
        assert said in text
    assert max(map(len, text.splitlines()[:-1])) <= 130


def test_the_cell_names_hand_and_forearm_beside_wrist_and_tool_and_nothing_else() -> None:
    cell, robot = cell_of(HELD_LINKS)
    (contact,) = cell.criteria.contact
    assert tuple(contact.links) == HELD_LINKS == ("link_4", "link_5", "link_6", "tool:handle")
    assert set(contact.parts) == {"l_hand", "l_forearm", "r_hand", "r_forearm"}
    separated, _robot = cell_of()
    assert not separated.criteria.contact
    criterion = build_contact(cell, robot, build_profile(cell))
    assert ("contact.pressure", "not checked") in {
        (each.name, each.value) for each in criterion.assumptions()
    }


@pytest.mark.rarely(WHOLE)
def test_the_report_says_who_may_touch_whom_and_how_fast(report: ContactReport) -> None:
    """Limits as in ISO/TS 15066 for a robot that keeps its position: least of the regions of a part."""
    found: Any = report.to_dict()["power_and_force_limiting"]
    assert found["links"] == list(HELD_LINKS) and found["every_other_pair"] == "separation"
    limits = {each["part"]: each["limit_m_s"] for each in found["parts"]}
    assert set(limits) == {"l_hand", "l_forearm", "r_hand", "r_forearm"}
    assert limits["l_hand"] == limits["r_hand"] and 0.1 < min(limits.values()) <= max(limits.values()) < 2.0


@pytest.mark.rarely(WHOLE)
def test_pictures_are_drawn(report: ContactReport) -> None:
    drawn = report.pictures()
    figures = {f"figure_{n}.png" for n in range(4, 10)}
    assert set(drawn) == figures | {"detection_delays.png", "guided_under_the_verifier.png"}
    assert all(picture.startswith(b"\x89PNG") and len(picture) > 10_000 for picture in drawn.values())


@pytest.fixture(scope="module")
def kr5() -> Arm:
    _cell, robot = cell_of()
    body = Body()
    return Arm(robot, body, identified(robot, body))


def test_a_hand_leads_the_tool_under_the_verifier(kr5: Arm) -> None:
    """The first two seconds of it, with contact declared; the whole of it is in the report."""
    found = _guided(kr5, _SETTINGS[0], 10.0)
    assert found.led_m > 0.01 and found.tracked.beyond == 0 and found.states == "collaboration"


def test_a_frozen_sensor_brings_the_arm_to_rest_under_the_verifier(kr5: Arm) -> None:
    (number,) = (k for k, each in enumerate(faults(kr5.body)) if each.name == "frozen")
    found = _broken(kr5, number)
    assert found.as_expected and found.moved and found.told_s < 0.07


def test_it_is_installed() -> None:
    assert "contact" in scenario_names() and callable(load_scenario("contact"))


@pytest.mark.rarely("run_scenario, in every run; the command itself with the scenario speed-alteration")
def test_the_command_writes_json_and_pictures(shell: Shell, tmp_path: Path) -> None:
    status, out, err = shell(
        "scenario", "contact", "--json", tmp_path / "found.json", "--out", tmp_path / "pictures"
    )
    assert status == 0, err
    document = json.loads((tmp_path / "found.json").read_text("utf-8"))
    jsonschema.validate(document, SCHEMA)
    assert (
        document["false_alarms"]["hours"] == pytest.approx(1.0) and document["false_alarms_per_hour"] == 0.0
    )
    assert "false alarms: the task was left 0 times in 1.00 h" in out
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 8
    assert np.isfinite(document["static_compliance_mm_per_N"])
