"""Closed loops with scripted people: what is found, that it can be found, and what is refused."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from failsafe.silence import Silence
from occupancy.body import PART_NAMES, Part
from occupancy.contact_limits import load_contact_limits
from robots.catalog import robot_names
from robots.errors import SetupError
from tests.conftest import Some
from tests.source_files import ROOT
from tests.verifier.shell import Shell, refused
from verifier.cell import Cell
from verifier.command import Cause, State
from verifier.reports.simulation import BINS_M, Approach, SimulationReport, Tally
from verifier.scripted_planner import Planner
from verifier.setup import (
    GJK_CALLS_OF_A_PLAN,
    Supervised,
    build_check,
    build_profile,
    build_robot,
    build_supervised,
)
from verifier.simulation import SimulationSettings, simulate
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.verdict import Reason, Status

SCHEMA = json.loads((ROOT / "docs" / "simulate.schema.json").read_text(encoding="utf-8"))
UR5: dict[str, Any] = {
    "robot": {
        "name": "ur5",
        "bare_flange": True,
        "accept_assumed": ["limits"],
        "tracking": {"position_error_rad": 0.001, "delay_max_s": 0.008},
    },
    "people": {"latency_s": 0.03},
}
SLOW_M_S = 0.05


def cell(**tables: dict[str, Any]) -> Cell:
    """The cell above with other tables."""
    merged = {name: {**UR5.get(name, {}), **table} for name, table in tables.items()}
    return Cell.from_table({**UR5, **merged})


def run(table: Cell, seconds: float = 5.0, **other: Any) -> SimulationReport:
    return simulate(table, SimulationSettings(seconds=seconds, **other))


def plain(report: SimulationReport) -> dict[str, Any]:
    """What must be the same for the same seed."""
    values = report.to_dict()
    del values["real_time_factor"]
    jsonschema.Draft202012Validator(SCHEMA).validate({**values, "real_time_factor": 1.0})
    return values


def test_the_same_seed_gives_the_same_result() -> None:
    first, again, other = (plain(run(cell(), 3.0, people=2, seed=seed)) for seed in (3, 3, 4))
    assert first == again
    assert first["nearest"] != other["nearest"]


def test_nobody_is_touched_and_nothing_is_exceeded(seed: int) -> None:
    report = run(cell(), 20.0, seed=seed)
    tally = report.tally
    assert report.contacts == () and not any(report.limits_exceeded.values())
    assert tally.count(Status.CONTRADICTED) == 0 and report.exit_status == 0
    assert report.nearest is not None and report.nearest.distance_m < 0.2
    assert report.histogram[0] == 0 and report.histogram.sum() == report.moving > 400
    assert tally.cycles == 2000 == sum(tally.causes.values()) == sum(tally.states.values())
    assert tally.stops > 5 and tally.states[State.EXECUTING] > 400
    elapsed = tally.last_at - tally.adopted_at
    assert 0.0 < tally.path_s < elapsed and report.time_lost_s == pytest.approx(elapsed - tally.path_s)
    assert max(report.largest_share.values()) <= 1.0 + 1e-6
    plain(report)


def believing_in_slow_people(table: Cell) -> Supervised:
    """What the supervisor is made of, but for the speed of people, which it underrates."""
    parts, robot = build_supervised(table), build_robot(table)
    slow = build_profile(table).with_speed(SLOW_M_S)
    check = build_check(table, robot, slow, assume_nobody=False, gjk_limit=GJK_CALLS_OF_A_PLAN)
    return replace(parts, check=check)


def test_contacts_are_found_when_the_supervisor_is_deceived(seed: int) -> None:
    """The truth is not what the supervisor believes: the same people beside it are touched."""
    table = cell()
    settings = SimulationSettings(seconds=16.0, seed=seed)
    report = simulate(table, settings, parts=believing_in_slow_people(table))
    assert report.contacts and report.exit_status == 1
    assert report.histogram[0] > 0 and not report.vacuous
    first = report.contacts[0]
    assert first.depth_m > 0.0 and first.speed_m_s > 0.001
    values = plain(report)
    assert values["contacts_while_moving"] == len(values["contacts"]) > 0
    lines = "\n".join(report.lines())
    assert f"{first.person} ({first.part}) and {first.link}" in lines
    assert report.nearest is not None and report.nearest.distance_m <= 0.0
    deepest = max(contact.depth_m for contact in report.contacts)
    assert deepest == pytest.approx(-report.nearest.distance_m)


def test_limits_are_found_exceeded_when_the_supervisor_believes_in_higher_ones(seed: int) -> None:
    table = cell()
    parts, robot = build_supervised(table), build_robot(table)
    limits = replace(robot.limits, acceleration=3.0 * robot.limits.acceleration, jerk=5.0 * robot.limits.jerk)
    check = build_check(
        table,
        replace(robot, limits=limits),
        build_profile(table),
        assume_nobody=False,
        gjk_limit=GJK_CALLS_OF_A_PLAN,
    )
    report = simulate(table, SimulationSettings(seconds=8.0, seed=seed), parts=replace(parts, check=check))
    assert report.limits_exceeded["jerk"] > 0 and report.exit_status == 1
    assert "limits exceeded: none" not in "\n".join(report.lines())


def test_people_faster_than_the_profile_are_reported_as_contradicted(seed: int) -> None:
    report = run(cell(), 5.0, faster=3.0, seed=seed)
    assert report.tally.count(Status.CONTRADICTED) > 0 and report.exit_status == 1
    assert report.tally.contradicted_at <= min([c.t for c in report.contacts], default=np.inf)
    assert "was first contradicted at" in "\n".join(report.lines())
    slower = run(cell(), 5.0, faster=0.5, seed=seed)
    assert slower.tally.count(Status.CONTRADICTED) == 0 and slower.contacts == ()


def test_nobody_stops_a_robot_that_is_alone() -> None:
    report = run(cell(), 3.0, people=0, rate_hz=100.0, dropped=0.0)
    assert report.nearest is None and report.vacuous and report.exit_status == 1
    assert report.tally.stops == 0 and report.tally.states[State.EXECUTING] > 250
    assert 0.0 <= report.time_lost_s < 0.5
    lines = "\n".join(report.lines())
    assert "shows nothing about people" in lines and "nobody" in lines


OWN_STOP = {"hold_s": 0.04, "goes_on_with": "acceleration", "deceleration_rad_s2": 2.0}


def test_commands_that_get_lost_leave_the_robot_with_the_plan_that_it_holds(seed: int) -> None:
    report = run(cell(), 20.0, lost=0.1, seed=seed)
    assert report.contacts == () and not any(report.limits_exceeded.values())
    assert report.tally.count(Status.CONTRADICTED) == 0
    assert report.tally.lost > 100 and report.tally.own_stops == 0
    assert report.tally.causes[Cause.WITHDRAWN] > 20 and report.tally.states[State.EXECUTING] > 200
    assert "went on with the plan that it held" in "\n".join(report.lines())
    assert plain(report)["commands_lost"] == report.tally.lost


def test_a_robot_that_stops_by_itself_touches_nobody(seed: int, count: Callable[[int], int]) -> None:
    """In any way that the cell declares; then it goes on, under a new supervisor, from where it rests."""
    seconds = float(max(24, count(160)))
    report = run(cell(robot={"silence": OWN_STOP}), seconds, lost=0.01, seed=seed)
    assert report.contacts == () and report.tally.count(Status.CONTRADICTED) == 0
    assert not any(report.limits_exceeded.values())
    assert report.tally.own_stops > seconds / 16.0 and report.motions > report.tally.own_stops
    assert "stopped by itself" in "\n".join(report.lines())
    assert plain(report)["own_stops"] == report.tally.own_stops


@pytest.mark.rarely("the other faults of this file")
def test_a_robot_that_stops_worse_than_believed_is_found_out(seed: int) -> None:
    """The supervisor believes in a stop that is far quicker than the robot's own."""
    slow = {"hold_s": 0.5, "goes_on_with": "velocity", "deceleration_rad_s2": 0.3}
    table = cell(robot={"silence": slow})
    parts = build_supervised(table)
    quick = Silence(0.0, False, np.full(6, 1e3))
    parts = replace(parts, plans=replace(parts.plans, silence=quick))
    runs = (
        SimulationSettings(seconds=20.0, seed=seed + number, lost=0.05, rate_hz=60.0) for number in range(6)
    )
    assert any(simulate(table, each, parts=parts).contacts for each in runs)


def test_a_run_ends_early_where_no_motion_is_found_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    proposed = Planner.propose

    def propose(planner: Planner, *given: Any) -> None:
        if planner.proposed == 2:
            raise SetupError("no motion of ur5 was found")
        proposed(planner, *given)

    monkeypatch.setattr(Planner, "propose", propose)
    report = run(cell(), 30.0, people=0, rate_hz=100.0, dropped=0.0)
    assert report.motions == 2 and report.tally.cycles < 3000 and report.exit_status == 1
    assert "the run ended early, at" in "\n".join(report.lines())
    assert "no motion of ur5 was found" in plain(report)["ended"]


def test_a_short_run_is_called_vacuous() -> None:
    report = run(cell(), 0.05)
    assert report.vacuous and "this run shows nothing about people" in "\n".join(report.lines())
    assert plain(report)["vacuous"] is True


@pytest.mark.rarely("test_other_people")
def test_eight_people(seed: int) -> None:
    report = run(cell(), 4.0, people=8, seed=seed)
    assert report.contacts == () and report.tally.count(Status.CONTRADICTED) == 0
    assert report.tally.causes[Cause.ADOPTED] > 0


@pytest.mark.rarely("tests/soundness/test_adversary.py, with five arms")
def test_each_arm_of_the_catalogue(seed: int, some: Some) -> None:
    for name in some(robot_names(), 5):
        table = cell(robot={"name": name, "accept_assumed": ["limits", "enclosure"]})
        report = run(table, 2.0, seed=seed)
        assert report.contacts == () and not any(report.limits_exceeded.values()), name
        assert report.tally.causes[Cause.ADOPTED] > 20, name


@pytest.mark.parametrize(
    "people",
    [
        {"profile": "tum", "models": ["articulated_acceleration", "arm_reach"]},
        {"profile": "extreme", "models": ["articulated_velocity"]},
        {"models": ["pedestrian"], "held_object_m": 0.2, "clock_error_s": 0.004, "stamp_error_s": 0.003},
    ],
    ids=["tum", "extreme", "pedestrian"],
)
def test_other_people(people: dict[str, Any], seed: int) -> None:
    report = run(cell(people=people), 4.0, seed=seed)
    assert report.contacts == () and report.tally.count(Status.CONTRADICTED) == 0
    assert report.tally.causes[Cause.ADOPTED] > 20


def test_the_planner_keeps_clear_of_what_stands_there() -> None:
    wall = {"kind": "box", "xyz_m": [0.6, 0.0, 0.3], "size_m": [0.1, 2.0, 2.0]}
    table = cell(
        workspace={"floor_z_m": -0.5, "floor_may_touch": [], "fixtures": {"wall": wall}},
        criteria={"self_collision": True},
        robot={"mount": {"xyz_m": [0.0, 0.0, 0.2], "rpy_deg": [0.0, 0.0, 30.0]}},
    )
    report = run(table, 4.0, people=0, rate_hz=100.0, dropped=0.0)
    assert report.tally.stops == 0 and report.tally.given_up == 0 and report.motions > 1
    assert report.floor == (-0.5, True)


def test_a_way_is_found_from_where_the_robot_has_stopped_by_itself() -> None:
    """Beside the floor, where at full speed every plan stands for reactions that reach it."""
    silence = {"hold_s": 0.1, "deceleration_rad_s2": 2.0, "goes_on_with": "acceleration"}
    tool = {"tool": str(ROOT / "data" / "gripper.toml"), "bare_flange": False}
    table = cell(robot={"silence": silence, **tool}, workspace={"floor_z_m": -0.8})
    robot = build_robot(table)
    parts = build_supervised(table, robot)
    beside = np.array([-1.036, -0.7004, 0.0432, -0.1967, -0.4281, 0.6164])
    planner = Planner(table, robot, parts, -0.8, np.random.default_rng(0))
    settings = SupervisorSettings(0.25 * table.cycle_s)
    planner.propose(Supervisor(parts.check, parts.watch, parts.plans, settings, beside), beside)
    assert planner.proposed == 1


@pytest.mark.parametrize(("height", "floor"), [(0.0, -0.8), (0.8, 0.0), (2.5, 0.0), (-1.0, -1.8)])
def test_people_stand_below_the_robot_where_no_floor_is_declared(height: float, floor: float) -> None:
    table = cell(robot={"mount": {"xyz_m": [0.0, 0.0, height], "rpy_deg": [180.0, 0.0, 0.0]}})
    report = run(table, 0.3)
    assert report.floor == (pytest.approx(floor), False)
    assert f"people stand at z = {floor:g} m (default)" in "\n".join(report.lines())


def test_an_arm_that_is_walled_in_is_refused() -> None:
    box = {"kind": "box", "xyz_m": [0.0, 0.0, 0.5], "size_m": [3.0, 3.0, 3.0]}
    with pytest.raises(SetupError, match="no posture of ur5 was found"):
        run(cell(workspace={"fixtures": {"block": box}}), 1.0)


def test_what_the_cell_lets_touch_is_no_contact(seed: int) -> None:
    links = build_robot(cell()).links
    parts = ["l_hand", "r_hand", "l_forearm", "r_forearm", "l_upper_arm", "r_upper_arm", "torso"]
    table = cell(
        robot={"tracking": {**UR5["robot"]["tracking"], "velocity_error_rad_s": 0.0}},
        workspace={"floor_z_m": -0.8},
        criteria={
            "accept_unverified": True,
            "contact": [{"links": list(links), "parts": parts, "person_speed": "neglected"}],
        },
        people={"latency_s": 0.03, "ignored_parts": ["head", "neck", "pelvis"]},
    )
    deceived = simulate(
        table, SimulationSettings(seconds=10.0, seed=seed), parts=believing_in_slow_people(table)
    )
    limits = load_contact_limits(table.criteria.contact_limits)
    limit = {name: limits.speed(Part(PART_NAMES.index(name))) for name in parts}
    assert {contact.part for contact in deceived.contacts}.isdisjoint(["head", "neck", "pelvis"])
    assert all(each.speed_m_s > limit.get(each.part, 0.0) for each in deceived.contacts)
    looks, fastest = deceived.declared_touches
    assert looks > 0 and 0.0 < fastest <= max(limit.values())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seconds": -1.0}, "--seconds -1: should be above 0"),
        ({"seconds": float("nan")}, "--seconds nan: should be above 0"),
        ({"seconds": 1e9}, "at most 86400"),
        ({"seconds": 0.001}, "shorter than a cycle"),
        ({"people": 9}, "--people 9: should be 0 to 8"),
        ({"people": -1}, "--people -1: should be 0 to 8"),
        ({"seed": -1}, "--seed -1"),
        ({"faster": 0.0}, "--faster 0"),
        ({"faster": float("nan")}, "--faster nan"),
        ({"rate_hz": 0.0}, "--report-rate 0"),
        ({"dropped": 1.0}, "--dropped 1"),
        ({"lost": 1.0}, "--lost 1"),
        ({"lost": -0.1}, "--lost -0.1"),
        ({"dropped": float("nan")}, "--dropped nan"),
    ],
)
def test_what_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SetupError, match=message):
        simulate(cell(), SimulationSettings(**{"seconds": 1.0, **change}))


def test_what_it_rests_on_is_shown() -> None:
    report = run(cell(), 0.2)
    named = {item["name"]: item for item in report.to_dict()["assumptions"]}
    assert named["cell.people.latency_s"]["certainty"] == "declared"
    assert named["cell.cycle_s"]["certainty"] == "default"
    assert named["people.position_error"]["value"] == pytest.approx(report.sensors.position_error_m)
    assert any(name.startswith("robot.ur5.") for name in named)
    assert any(line.startswith("default: ") and "position_error" in line for line in report.lines())


def test_bins_are_in_order() -> None:
    assert (np.diff(BINS_M) > 0.0).all() and BINS_M[0] == 0.0 and BINS_M[-1] == np.inf


# The command line

TOML = """[robot]
name = "ur5"
bare_flange = true
accept_assumed = ["limits"]
[robot.tracking]
position_error_rad = 0.001
"""


def test_a_run_in_which_nobody_mattered_does_not_count_as_verified() -> None:
    """Nothing was checked: nobody came near enough to be touched, or to hold the robot back."""
    idle = run(cell(), 0.6, people=2)
    assert idle.vacuous and idle.shows_nothing and idle.exit_status == 1
    assert not math.isnan(idle.tally.adopted_at) and idle.moving > 0
    assert "shows nothing about people, and does not count as verified" in "\n".join(idle.lines())
    for reason in (Reason.REACHABLE, Reason.UNRESOLVED):
        held = replace(idle, tally=replace(idle.tally, reasons=Counter({reason: 1, Reason.SEPARATED: 9})))
        assert held.vacuous and not held.shows_nothing and held.exit_status == 0
        assert "this run is vacuous" in "\n".join(held.lines())
        assert replace(held, waived=("nobody is there",)).exit_status == 3
    near = replace(idle, nearest=Approach(0.0, 0.05, "link", "p1", "head"))
    assert not near.vacuous and near.exit_status == 0
    assert replace(idle, tally=Tally(cycles=60, reasons=Counter({Reason.REACHABLE: 60}))).exit_status == 1


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "cell.toml"
    found.write_text(TOML, encoding="utf-8")
    return found


def test_command_line(shell: Shell, path: Path, tmp_path: Path) -> None:
    status, out, err = shell("simulate", path, "--cycles", 60, "--people", 2)
    assert status == 1 and err == "", "nobody comes near in so short a time"
    assert "shows nothing about people" in out
    assert out.splitlines()[0].startswith("stop: path-consistent")
    assert "contacts while moving, in the model: 0" in out and "60 cycles of 10 ms" in out
    assert "Simulated. Not a manufacturer's declaration" in out
    target = tmp_path / "out.json"
    status, out, _ = shell("simulate", path, "--seconds", 0.6, "--people", 2, "--json", target)
    assert status == 1 and out.splitlines()[-1] == f"wrote {target}"
    assert "--force" in refused(shell("simulate", path, "--cycles", 60, "--json", target))
    status, out, _ = shell("simulate", path, "--cycles", 60, "--people", 2, "--json", "-")
    printed, written = json.loads(out), json.loads(target.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(SCHEMA).validate(printed)
    assert printed["cycles"] == sum(printed[status.name.lower()] for status in Status)
    assert sum(printed["states"].values()) == pytest.approx(1.0)
    for values in (printed, written):
        del values["real_time_factor"]
    assert printed == written


def test_waivers_have_their_status(shell: Shell, path: Path) -> None:
    path.write_text(TOML.replace("bare_flange = true\n", ""), encoding="utf-8")
    status, out, _ = shell("simulate", path, "--seconds", 4)
    assert status == 3 and "no tool declared" in out.splitlines()[0]


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (TOML, ("--seconds", "-3"), "--seconds -3: should be above 0"),
        (TOML, ("--seconds", "nan"), "--seconds nan"),
        (TOML, ("--seconds", "abc"), "'--seconds': 'abc' is not a valid float"),
        (TOML, ("--seconds", "1", "--cycles", "5"), "--cycles and --seconds both say how long"),
        (TOML, ("--cycles", "0"), "--cycles 0: should be at least 1"),
        (TOML, ("--people", "9"), "--people 9: should be 0 to 8"),
        (TOML, ("--json", "."), "is a folder"),
        (TOML.replace("position_error_rad = 0.001", ""), (), "position_error_rad"),
        (TOML.replace('name = "ur5"', ""), (), "no robot is named"),
        ("[robot\n", (), "cell.toml"),
    ],
)
def test_refusals_of_the_command_line(
    shell: Shell, path: Path, text: str, options: tuple[str, ...], message: str
) -> None:
    path.write_text(text, encoding="utf-8")
    assert message in refused(shell("simulate", path, *options))


def test_a_cell_that_is_not_there_is_refused(shell: Shell, tmp_path: Path) -> None:
    assert "nothing.toml" in refused(shell("simulate", tmp_path / "nothing.toml"))
    assert "CELL.toml" in refused(shell("simulate"))
