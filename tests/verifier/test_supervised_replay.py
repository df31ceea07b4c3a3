"""A recorded intention under the supervisor: who is touched, what time is lost, what is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson
from robots.errors import SetupError
from tests.occupancy.arms import place
from tests.source_files import ROOT
from tests.verifier.scenes import CELL, Scene, at_rest, far, person_at
from tests.verifier.shell import Shell, refused
from verifier import Cell, verify
from verifier.command import State
from verifier.contacts import RecordedContacts
from verifier.criteria import Standstill
from verifier.reports.supervised import Contact
from verifier.setup import build_gate, build_profile, build_robot
from verifier.supervised import supervise
from verifier.verdict import Reason, Status

Count = Callable[[int], int]
SCHEMA = json.loads((ROOT / "docs" / "supervised.schema.json").read_text(encoding="utf-8"))


def comes_and_goes(t: float) -> np.ndarray:
    return person_at(2.4 - 1.6 * np.sin(np.pi * min(t, 6.0) / 6.0), 0.0)


def test_far_from_everybody_only_setting_out_costs_time(tmp_path: Path) -> None:
    report = supervise(Scene(people={"p1": far}).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.stops == 0 and report.contacts == () and report.slowed[0] == 1.0
    assert 0.0 < report.time_lost_s < 0.5
    assert report.share(State.EXECUTING) > 0.8 and report.count(Status.CONTRADICTED) == 0
    assert report.exit_status == 0


def test_somebody_who_comes_near_stops_the_robot_and_lets_it_go_on(tmp_path: Path) -> None:
    scene = Scene(people={"p1": comes_and_goes}, duration=8.0)
    report = supervise(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.stops > 0 and report.recoveries > 1 and report.contacts == ()
    assert report.share(State.STOPPED) > 0.1 and report.share(State.EXECUTING) > 0.2
    assert report.time_lost_s > 0.5
    assert report.reached_s + report.time_lost_s == pytest.approx(8.0 - 0.05, abs=0.1)
    assert report.reasons[Reason.REACHABLE] > 10


def test_whoever_outruns_the_profile_is_touched_and_that_is_said(tmp_path: Path) -> None:
    def jumps(t: float) -> np.ndarray:
        return person_at(4.0 if t < 1.0 else 0.45, 0.0)

    scene = Scene(people={"p1": jumps}, duration=1.6)
    report = supervise(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    (contact,) = report.contacts
    assert contact.person == "p1" and contact.depth_m > 0.0
    assert contact.t == pytest.approx(1.0, abs=0.05)
    assert report.count(Status.CONTRADICTED) > 0 and report.exit_status == 1


def test_a_motion_that_is_too_fast_is_slowed_down_and_that_is_said(tmp_path: Path) -> None:
    def hasty(t: float) -> np.ndarray:
        return np.array([0.5 * np.sin(8.0 * t), -1.2, 1.3, -0.4, 0.0, 0.0])

    report = supervise(Scene(motion=hasty).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    factor, why = report.slowed
    assert factor > 1.0 and "shoulder_pan_joint" in why
    assert report.reached_s < 2.0 / factor + 0.1


def test_an_arm_that_rests_is_followed_without_a_plan(tmp_path: Path) -> None:
    report = supervise(Scene(motion=at_rest, duration=1.0).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.contacts == () and report.stops == 0


def test_exit_statuses_are_those_of_the_documents(tmp_path: Path) -> None:
    """A robot that stopped for somebody, as it should, is no failure; one that never moved shows nothing."""
    people = {"p1": lambda _t: person_at(9.0, 0.0)}
    done = supervise(Scene(people=people, duration=0.5).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    refused_plans = np.full_like(done.status, int(Status.NOT_VERIFIED))
    contact = Contact("p1", 0.1, 0.01)
    contradicted = np.full_like(done.status, int(Status.CONTRADICTED))
    assert done.exit_status == 0 and done.count(Status.VERIFIED) > 0
    for change, expected in (
        ({"status": refused_plans}, 0),
        ({"contacts": (contact,)}, 1),
        ({"status": contradicted}, 1),
        ({"time_lost_s": np.nan}, 1),
        ({"waived": ("no tool",)}, 3),
        ({"waived": ("no tool",), "contacts": (contact,)}, 1),
    ):
        assert replace(done, **change).exit_status == expected, change
    idle = replace(done, time_lost_s=np.nan)
    assert "no plan was ever adopted: the robot stood still all the time" in idle.lines()
    document = (ROOT / "docs" / "supervisor.md").read_text(encoding="utf-8")
    assert re.findall(r"(?m)^\| (\d+) \| (?=plans|a contact|the input|as 0|an internal)", document) == [
        "0", "1", "2", "3", "70",
    ]  # fmt: skip


def test_touching_is_what_distances_say(rng: np.random.Generator, count: Count) -> None:
    """A wrist alone, its hand a ball, against every link as a segment with a radius."""
    cell = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur5"}})
    robot, profile = build_robot(cell), build_profile(cell)
    contacts = RecordedContacts(robot, build_gate(cell, profile), profile, Standstill(0.001, 0.002))
    capsules, n = robot.enclosure[0], int(robot.enclosure["n"][0])
    share = np.linspace(0.0, 1.0, 400)[:, None]
    yes = no = 0
    for number in range(count(2_000)):
        q, dq = rng.uniform(-2.0, 2.0, 6), rng.uniform(0.2, 0.5, 6)
        local = np.array([capsules["a"][:n] + x * (capsules["b"][:n] - capsules["a"][:n]) for x in share])
        points = place(robot, q[None], local.transpose(1, 0, 2))[0]
        wrist = points[rng.integers(n), rng.integers(400)] + rng.uniform(-0.4, 0.4, 3)
        apart = np.linalg.norm(points - wrist, axis=-1).min(axis=1) - capsules["radius"][:n] - 0.205
        xyz = np.full((MAX_POINTS, 3), np.nan)
        xyz[Point.R_WRIST] = wrist
        person = RawPerson("p", xyz, np.zeros(MAX_POINTS), 1 << Point.R_WRIST)
        report = RawMeasurement(float(number), float(number), "world", False, (person,))
        found = contacts.touching(report, q, dq)
        if abs(apart.min()) > 1e-3:
            assert bool(found) == (apart.min() < 0.0)
            yes, no = yes + bool(found), no + (not found)
        assert contacts.touching(report, q, np.zeros(6)) == []
    assert yes > 0 and no > 0


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (Scene(joint_rate=5.0), "joint samples pause for 0.200 s"),
        (Scene(duration=0.02), "joint samples"),
    ],
)
def test_what_is_refused(tmp_path: Path, scene: Scene, message: str) -> None:
    with pytest.raises(SetupError, match=message):
        supervise(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))


@pytest.mark.parametrize("command", ["verify", "limits", "replay", "simulate"])
def test_the_help_says_what_the_exit_status_means(shell: Shell, command: str) -> None:
    status, out, _ = shell(command, "--help")
    assert status == 0 and "Exit status:" in out and "3 " in out and "under waivers" in out


def test_what_it_rests_on_is_what_verify_says_and_that_is_shown(tmp_path: Path) -> None:
    path, cell = Scene(duration=0.5).write(tmp_path / "r.mcap"), Cell.from_table(CELL)
    report, judged = supervise(path, cell), verify(path, cell)
    assert report.assumptions == judged.assumptions
    shown = [line for line in judged.lines() if line.startswith(("default:", "measured:", "assumed:"))]
    assert shown and set(shown) <= set(report.lines())
    names = [item["name"] for item in report.to_dict()["assumptions"]]
    assert names == [item.name for item in report.assumptions]


def test_command_line(shell: Shell, tmp_path: Path) -> None:
    path = Scene(duration=1.0).write(tmp_path / "r.mcap")
    assert "--supervised" in refused(shell("replay", path))
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n')
    cell_without = tmp_path / "waived.toml"
    cell_without.write_text('[robot]\naccept_assumed = ["limits"]\n')
    assert shell("replay", path, "--supervised", "--cell", cell_without)[0] == 3
    done = shell("replay", path, "--supervised", "--cell", cell)
    assert done[0] == 0 and "contacts while moving, in the model: 0" in done[1]
    printed = json.loads(shell("replay", path, "--supervised", "--cell", cell, "--json", "-")[1])
    jsonschema.Draft202012Validator(SCHEMA).validate(printed)
    assert printed["cycles"] == sum(printed[status.name.lower()] for status in Status)
    assert sum(printed["states"].values()) == pytest.approx(1.0)
