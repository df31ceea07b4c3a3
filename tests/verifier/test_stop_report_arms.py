"""Stop reports of other arms: one whose first joint slides, one whose stop was measured; closed forms."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from failsafe import box_kernels
from failsafe.bracket import Ended
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY
from robots.catalog import RobotSetup, load_robot
from robots.errors import SetupError
from tests.docs.test_schemas import faults
from tests.verifier.html_page import Element, fetched, parse, unreadable
from verifier import Cell
from verifier.reports.html.stop_report import stop_report_page
from verifier.reports.stop_report import report_lines
from verifier.stop_report import StopReport, StopReportSettings, stop_report
from verifier.stop_report.as_json import report_dict
from verifier.stop_report.compute import compile_search
from verifier.stop_report.report import ANY_MOTION, BRAKES, JOINT_SPACE, MEASURED
from verifier.stop_report.settings import Work

MASS, SPEED, ACCELERATION, JERK = 4.0, 2.0, 10.0, 400.0
HOSTILE = "<script>alert(1)</script> \"q\" 'ü' & ]]>"
"""A name that would be markup."""


def urdf(name: str, kind: str) -> str:
    """An arm of one joint along x, or about y."""
    axis = "1 0 0" if kind == "prismatic" else "0 1 0"
    quoted = name.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
    return f"""<robot name="{quoted}"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="{MASS}"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.1 0.4"/></geometry></collision></link>
<joint name="axis" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="{axis}"/>
<limit lower="-1" upper="1" velocity="{SPEED}" effort="80"/></joint></robot>"""


def cell_of(folder: Path, name: str, kind: str, more: str = "") -> Cell:
    (folder / "arm.urdf").write_text(urdf(name, kind), encoding="utf-8")
    unit = "m" if kind == "prismatic" else "rad"
    limits = f"acceleration_{unit}_s2 = {ACCELERATION}\njerk_{unit}_s3 = {JERK}\n"
    text = f'[robot]\nurdf = "arm.urdf"\nbare_flange = true\n[robot.limits.axis]\n{limits}{more}'
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    return Cell.from_toml(folder / "cell.toml")


def longest_way() -> float:
    """The farthest of all stops with limited jerk, stepped through: from V, with every admissible pull."""
    farthest, dt = 0.0, 4e-5
    for pull in np.linspace(0.0, ACCELERATION, 9):
        v, a, s = SPEED - pull**2 / (2.0 * JERK), float(pull), 0.0
        while v > 0.0:
            # brake as hard as lets the acceleration come back to 0 when the speed does
            jerk = JERK if a < 0.0 and v <= a * a / (2.0 * JERK) else -JERK
            a = min(max(a + jerk * dt, -ACCELERATION), 0.0 if jerk > 0.0 else ACCELERATION)
            s, v = s + v * dt, v + a * dt
            if a == 0.0 and jerk > 0.0:
                break
        farthest = max(farthest, s)
    return farthest


@pytest.fixture(scope="module")
def rail(tmp_path_factory: pytest.TempPathFactory) -> StopReport:
    """A sliding arm with declared brakes."""
    cell = cell_of(tmp_path_factory.mktemp("rail"), HOSTILE, "prismatic")
    settings = StopReportSettings(
        payload_kg=0.0, brake_torque=(80.0,), brake_delay_s=0.05, resolution_m=0.03, deadline_s=0.05
    )
    return stop_report(cell, settings=settings)


def test_a_first_joint_that_slides_has_its_stops_in_metres(rail: StopReport) -> None:
    (way,) = rail.cases[0].of(STOP_ANGLE)
    assert (rail.cases[0].stop, way.unit) == (JOINT_SPACE, "m")
    assert way.lower == pytest.approx(longest_way(), rel=2e-3)
    longest = rail.answer.largest(STOP_TIME)
    assert longest is not None
    assert longest.upper == pytest.approx(SPEED / ACCELERATION + 2.0 * ACCELERATION / JERK, rel=1e-9)
    fastest = rail.answer.largest(POINT_SPEED)
    assert fastest is not None and fastest.lower == pytest.approx(SPEED)
    assert fastest.upper == pytest.approx(SPEED, rel=0.03)


def test_a_first_joint_that_slides_has_category_0_and_grids_without_extension(rail: StopReport) -> None:
    """On a level rail the brake alone spends ½ m V², after V times the delay."""
    (brakes,) = [case for case in rail.cases if case.stop == BRAKES]
    (way,) = brakes.of(STOP_ANGLE)
    by_hand = SPEED * 0.05 + 0.5 * MASS * SPEED**2 / 80.0
    assert way.lower == pytest.approx(by_hand, rel=0.01) and way.upper >= by_hand * 0.999
    assert [each.stop for each in rail.grids] == [JOINT_SPACE, BRAKES]
    for each in rail.grids:
        assert each.grid.complete and len(each.grid.cells) == 9
        assert {(cell.speed, cell.load) for cell in each.grid.cells} == {
            (speed, load) for speed in (0.33, 0.66, 1.0) for load in (0.33, 0.66, 1.0)
        }
    assert "grids of extension" in {each.what for each in rail.missing}
    assert {each.stop for each in rail.to_measure} == {JOINT_SPACE, BRAKES}


def test_the_page_of_a_sliding_arm_speaks_of_no_extension_and_quotes_names(rail: StopReport) -> None:
    written = json.loads(json.dumps(report_dict(rail), allow_nan=False))
    assert not faults("stop-report", written) and written["robot"] == HOSTILE
    page = parse(stop_report_page(rail))
    assert fetched(page) == ["<script>"] and unreadable(page) == []
    assert "extension 100 %" not in page.text and "No extension: joint axis slides" in page.text
    assert HOSTILE in page.first("h1").text
    assert "0.274 m" in page.first("header").text and "°" not in page.first("header").first("tbody").text


def measured_cell(folder: Path, error: float = 0.1) -> Cell:
    (folder / "stops.toml").write_text(
        'robot = "pendulum"\njoints = ["axis"]\ndelay_s = 0.1\nbraking_time_s = 0.2\nmargin = 0.1\n'
        'deceleration_rad_s2 = [5.0]\nfastest_rad_s = [1.5]\nsource = "worst of 9 stops in r.csv (stop)"\n',
        encoding="utf-8",
    )
    tracking = f"[robot.tracking]\nvelocity_error_rad_s = {error}\n"
    more = f'{tracking}[stop]\nmodel = "measured"\nmeasured = "stops.toml"\n'
    return cell_of(folder, "pendulum", "revolute", more)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> StopReport:
    """An arm whose stop was measured up to 1.5 rad/s, and that can be faster."""
    cell = measured_cell(tmp_path_factory.mktemp("measured"))
    settings = StopReportSettings(payload_kg=0.0, resolution_m=0.03, deadline_s=0.05)
    return stop_report(cell, settings=settings)


def test_a_measured_stop_is_the_answer_from_the_speeds_that_were_measured(measured: StopReport) -> None:
    """V = 1.4 intended and 0.1 that no plan intends: delay + V/a, V (delay + V/2a)."""
    assert (measured.answer.stop, measured.answer.over) == (MEASURED, ANY_MOTION)
    longest, turned = measured.answer.largest(STOP_TIME), measured.answer.largest(STOP_ANGLE)
    assert longest is not None and longest.upper == pytest.approx(0.1 + 1.5 / 5.0)
    assert turned is not None and turned.upper == pytest.approx(1.5 * (0.1 + 0.5 * 0.3))
    assert measured.answer_speeds.tolist() == pytest.approx([1.4])
    assert measured.profile.stop == MEASURED and measured.profile.t[-1] == pytest.approx(0.4)
    assert measured.profile.way[-1, 0] == pytest.approx(0.375)
    total = 0.07 + 0.4
    assert measured.total_s == pytest.approx(total)
    needed = measured.distances[0]
    assert needed.stop == MEASURED and needed.required is not None
    assert needed.required.distance_m == pytest.approx(1.6 * total + 8.0 * (0.030 - 0.014))
    of_it = "the stop was measured: worst of 9 stops in r.csv (stop); times 10 % longer"
    assert of_it in report_lines(measured)


def test_slow_joints_of_a_measured_stop_may_take_their_time(measured: StopReport) -> None:
    """At 33 % V = 0.562, which 5 rad/s² would stop sooner than T = 0.2 s allows to be sure of."""
    (grid,) = [each for each in measured.grids if each.stop == MEASURED]
    cell = grid.grid.at(1.0, 0.33, 1.0)
    brackets = {each.quantity: each for each in cell.brackets}
    speed = 0.33 * 1.4 + 0.1
    assert brackets[STOP_TIME].upper == pytest.approx(0.1 + 0.2)
    assert brackets[STOP_ANGLE].upper == pytest.approx(speed * (0.1 + 0.5 * 0.2))
    assert brackets[STOP_WAY].upper >= brackets[STOP_WAY].lower > 0.0


def test_nobody_takes_measured_stops_for_those_of_full_speed(measured: StopReport) -> None:
    page, lines = parse(stop_report_page(measured)), report_lines(measured)
    head = page.first("header").text
    for text in (head, "\n".join(lines)):
        assert "any motion up to the speeds that were measured" in text
        assert "of some joint 70 % of its limit" in text and "100 % of the velocity limits" not in text
        assert "aster than axis 80.2°/s no stop was measured" in text
    assert math.degrees(1.4) == pytest.approx(80.2, abs=0.05)
    assert first_speed(page) == "80"
    assert "torque limits allow" not in head and not [each for each in lines if each.startswith("drives:")]
    assert "the robot's own stop at full speed" in {each.what for each in measured.missing}


def first_speed(page: Element) -> str:
    """The speed of the first axis on the first page [°/s]."""
    (shown,) = [
        each for each in page.first("header").all("data") if "/speeds/0" in each.attributes["data-json"]
    ]
    return shown.text


def test_an_error_beyond_what_was_measured_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"velocity_error_rad_s 1.5: should be below 1.5.* joint axis"):
        stop_report(measured_cell(tmp_path, error=1.5))


def test_compiling_takes_nothing_from_the_time_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on which the first halving of boxes takes a minute, and every other one 1 ms."""
    now, expand = [0.0], box_kernels.expand

    def compiled_once(*arguments: Any) -> Any:
        now[0] += 60.0 if now[0] == 0.0 else 1e-3
        return expand(*arguments)

    monkeypatch.setattr(box_kernels, "expand", compiled_once)
    robot = load_robot("ur3", setup=RobotSetup(bare_flange=True))
    begun = time.perf_counter()
    compile_search(robot, Work(lambda: now[0], lambda: False, lambda _share: None))
    assert now[0] >= 60.0 and time.perf_counter() - begun < 30.0
    asked = [0]

    def should_end() -> bool:
        asked[0] += 1
        return asked[0] > 3

    work = Work(lambda: now[0], should_end, lambda _share: None)
    now[0] = 0.0
    cell = Cell.from_table({"robot": {"name": "ur3", "bare_flange": True}})
    found = stop_report(cell, settings=StopReportSettings(deadline_s=10.0), work=work)
    fastest = found.cases[0].largest(POINT_SPEED)
    assert fastest is not None and fastest.ended is not Ended.DEADLINE and fastest.seconds < 1.0
