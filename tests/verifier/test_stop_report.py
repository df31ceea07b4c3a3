"""Stop reports: text, JSON and page say the same; what is missing or guessed is marked; bad input, Ctrl-C."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from failsafe.bracket import Ended, Witness
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY, ArmSearch
from robots.catalog import RobotSetup, load_robot
from robots.errors import SetupError
from robots.kernels import forward
from tests.docs.test_schemas import faults
from tests.test_wording import faults as forbidden
from tests.verifier.html_page import Element, fetched, numbers, parse, resolve, unreadable
from tests.verifier.scenes import Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier import Cell, verify
from verifier.reports.html.pose_picture import clearest
from verifier.reports.html.stop_report import stop_report_page
from verifier.reports.stop_report import INTERRUPTED, report_lines
from verifier.reports.text import DISCLAIMER
from verifier.stop_report import StopReport, StopReportSettings, stop_report
from verifier.stop_report.as_json import report_dict
from verifier.stop_report.poses import pose_of
from verifier.stop_report.report import ANY_MOTION, BRAKES, JOINT_SPACE, PATH_CONSISTENT, RECORDED
from verifier.stop_report.settings import Work
from verifier.stop_report_command import ended_by_interrupt

QUICK = 0.03
SHOWN = re.compile(r"([+-]?[\d.]+(?:e[+-]?\d+)?)( s| m| m/s|%)?")
TABLE: dict[str, Any] = {
    "robot": {"name": "ur5", "bare_flange": True, "accept_assumed": ["limits"],
              "tracking": {"delay_max_s": 0.008}},
    "people": {"latency_s": 0.03},
}  # fmt: skip
TORQUES = (160.0, 160.0, 150.0, 28.0, 28.0, 28.0)

Json = dict[str, Any]


def ur3(**robot: Any) -> Cell:
    return Cell.from_table({"robot": {"name": "ur3", "bare_flange": True, **robot}})


def as_written(report: StopReport) -> Json:
    written: Json = json.loads(json.dumps(report_dict(report), allow_nan=False))
    return written


@cache
def page_of(report: StopReport) -> Element:
    """The page, read once for all tests that look at it."""
    return parse(stop_report_page(report))


@pytest.fixture(scope="module")
def free() -> StopReport:
    """Nobody has stated anything."""
    return stop_report(ur3(), settings=StopReportSettings(deadline_s=QUICK))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    people = {"p1": lambda _t: person_at(0.9, 0.0)}
    return Scene(duration=0.5, people=people).write(tmp_path_factory.mktemp("stop") / "r.mcap")


@pytest.fixture(scope="module")
def full(recording: Path) -> StopReport:
    """Everything is stated."""
    settings = StopReportSettings(
        payload_kg=2.0, payload_at_m=(0.0, 0.0, 0.05), speed=0.5, brake_torque=TORQUES, brake_delay_s=0.05,
        resolution_m=0.03, deadline_s=QUICK,
    )  # fmt: skip
    return stop_report(Cell.from_table(TABLE), recording, settings)


@pytest.fixture(scope="module", params=["free", "full"])
def report(request: pytest.FixtureRequest) -> StopReport:
    made: StopReport = request.getfixturevalue(request.param)
    return made


def test_the_json_is_what_the_schema_says(report: StopReport) -> None:
    written = as_written(report)
    assert not faults("stop-report", written)
    short = {name: value[:1] if isinstance(value, list) else value for name, value in written.items()}
    short |= {"grids": [], "recorded": None, "protective_separation": None}
    assert not faults("stop-report", short)
    for key in short:
        assert faults("stop-report", {name: value for name, value in short.items() if name != key}), key
    assert faults("stop-report", {**short, "grade": 1})
    for each in written["worst_case"]:
        assert {"quantity", "lower", "upper", "unit", "configuration", "method"} <= set(each)
        assert (each["upper"] is None) == bool(each["reason"])


def test_a_reaction_that_nobody_stated_is_said_and_marked(free: StopReport, full: StopReport) -> None:
    for made, named in (
        (free, "detection = 0.05 s, decision = 0.02 s, actuation = 0 s; "),
        (full, "decision = 0.02 s; "),
    ):
        (line,) = (each for each in report_lines(made) if "reaction has defaults" in each)
        assert f"nobody stated: {named}state" in line
        marked = [each.text for each in page_of(made).all("p") if "missing" in each.classes]
        assert any(named in text for text in marked)
    stated = Cell.from_table(TABLE | {"cycle_s": 0.01})
    made = stop_report(stated, settings=StopReportSettings(deadline_s=QUICK))
    assert not any("reaction has defaults" in each for each in report_lines(made))


def test_distances_of_the_other_stops_are_told_beside_that_of_the_answer(full: StopReport) -> None:
    told = [each for each in report_lines(full) if each.startswith("if the protective device triggers")]
    others = [each for each in full.distances if each.stop != full.answer.stop and each.required is not None]
    assert {each.stop for each in others} == {JOINT_SPACE, BRAKES} and len(told) == len(others) == 2
    page = page_of(full).text
    for line, each in zip(told, others, strict=True):
        assert f"the stop {each.stop}: S = {each.required.distance_m:.3f} m (ISO 13855:2010)" in line
        assert line[1:] in page


def test_what_is_to_be_done_before_is_said_in_the_text_too(report: StopReport) -> None:
    assert any("no distance is to be taken from here before that" in line for line in report_lines(report))


def test_drives_that_can_do_nothing_are_not_called_zero(full: StopReport) -> None:
    (line,) = (each for each in report_lines(full) if each.startswith("drives: "))
    least = min(each.allowed.found for each in full.torques)
    share = "nothing" if least < 0.005 else f"only {least:.2f}"
    assert f"allow in some states {share} of the acceleration limits" in line


def test_every_number_of_the_page_is_that_of_the_json(report: StopReport) -> None:
    written, page = as_written(report), page_of(report)
    found = numbers(page)
    assert len(found) > 400
    for pointer, value, text in found:
        assert resolve(written, pointer) == value, pointer
        shown = SHOWN.fullmatch(text.replace("\N{NO-BREAK SPACE}", ""))
        if value is None or shown is None:
            assert text in ("not bounded", "–", "infinite") or isinstance(value, int), (pointer, text)
            continue
        digits = shown[1].partition("e")[0].partition(".")[2]
        near = 0.51 * 10.0 ** -len(digits) if "e" not in text else 0.01 * abs(value)
        scales = (1.0, 180.0 / math.pi, 100.0)
        wanted = [scale * value for scale in scales]
        off = [abs(float(shown[1]) - each) - max(near, 5e-4 * abs(each)) for each in wanted]
        assert min(off) <= 0.0, (pointer, value, text)


def test_the_text_has_the_numbers_of_the_json(report: StopReport) -> None:
    written, lines = as_written(report), report_lines(report)
    answer = written["answer"]
    assert lines[0].startswith(f"stop: {answer['stop']}:")
    for key, unit in (("time", "s"), ("way", "m"), ("point_speed", "m/s")):
        bracket = written["worst_case"][answer[key]]
        line = next(each for each in lines if each.startswith(f"  {bracket['quantity']}: "))
        assert f"{bracket['upper']:.3f} {unit}" in line
    angles = next(each for each in lines if each.startswith("  angle: "))
    for place in answer["angles"]:
        assert f"{math.degrees(written['worst_case'][place]['upper']):.1f}°" in angles
    for place in answer["required_distances"]:
        distance = written["required_distances"][place]
        line = next(each for each in lines if f"required distance, {distance['edition']}" in each)
        given = distance["distance_m"]
        assert ("missing" in line) if given is None else (f"S = {given:.3f} m" in line)
    assert lines[-1] == DISCLAIMER
    assert all(f"missing: {each['what']}" in "\n".join(lines) for each in written["missing"])


def test_the_page_loads_nothing_and_runs_one_script(report: StopReport) -> None:
    page = page_of(report)
    assert fetched(page) == ["<script>"]
    assert unreadable(page) == []
    script = page.first("script")
    assert not set(script.attributes)
    digest = base64.b64encode(hashlib.sha256(script.text.encode()).digest()).decode()
    policies = [each.attributes["content"] for each in page.all("meta") if "http-equiv" in each.attributes]
    (policy,) = [each for each in policies if "default-src 'none'" in each]
    assert f"script-src 'sha256-{digest}'" in policy
    harmless = script.text.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?:|fetch|import|eval|innerHTML|XMLHttp", harmless)
    assert DISCLAIMER in page.first("footer").text
    assert page.first("header").text.index("Stop: ") < page.first("header").text.index("longest stop")


def test_no_word_that_is_not_used(report: StopReport) -> None:
    for text in (*report_lines(report), page_of(report).text):
        assert not forbidden("stop report", text)


def test_the_first_page_is_an_answer_and_says_what_it_rests_on(free: StopReport, full: StopReport) -> None:
    longest = full.answer.largest(STOP_TIME)
    assert longest is not None
    assert full.total_s == pytest.approx(0.03 + 2 * 0.01 + 0.008 + longest.upper)
    for each in (free, full):
        head = page_of(each).first("header")
        (total,) = [one for one in head.all("data") if one.attributes["data-json"] == "/answer/total_s"]
        assert total.text == f"{each.total_s:.3f} s"
        assert f"T = {each.total_s:.3f} s: reaction" in "\n".join(report_lines(each))
        assert "acceleration limits are assumed" in head.text, "10 rad/s² have no source"
        links = {link.attributes["href"] for link in head.all("a")}
        assert {"#to-measure", "#assumptions"} <= links and ("#missing" in links) == bool(each.missing)
        assert "where it would be 0.05 s later" in head.first("figcaption").text
    alone, stated = (page_of(each).first("header").text for each in (free, full))
    assert f"Waived: {'; '.join(free.waived)}" in alone and "Waived" not in stated
    assert "required distance S, ISO 13855:2010, unverified" in stated
    assert re.search(r"S = [\d.]+ m, unverified \(", stated)


def test_stops_to_be_measured_say_when_they_are_in_the_recording(free: StopReport, full: StopReport) -> None:
    section = next(e for e in page_of(full).all("section") if e.attributes["id"] == "to-measure")
    instants = [
        e for e in section.all("data") if re.fullmatch(r"/to_measure/\d+/t", e.attributes["data-json"])
    ]
    assert len(instants) == len([each for each in full.to_measure if each.instant is not None]) > 0
    section = next(e for e in page_of(free).all("section") if e.attributes["id"] == "to-measure")
    captions = [each.text for each in section.all("caption")]
    assert len(captions) == 2 and captions[1].endswith("guessed brakes")
    for each in section.all("data"):
        k = int(each.attributes["data-json"].split("/")[2])
        assert inside(each, "guessed") == free.to_measure[k].guessed


def test_the_picture_of_the_first_page_is_the_least_foreshortened() -> None:
    arm = ArmSearch(load_robot("ur3", setup=RobotSetup(bare_flange=True)))
    for turned, best in ((0.0, 0), (0.5 * math.pi, 1)):
        q = np.array([turned, -1.0, 0.4, 0.0, 0.0, 0.0])
        pose = pose_of(arm, "any", JOINT_SPACE, Witness(q, np.full(6, 1e-3), np.zeros(6)))
        assert clearest(pose) == best


def inside(each: Element, of: str) -> bool:
    here: Element | None = each
    while here is not None and of not in here.classes:
        here = here.parent
    return here is not None


def test_what_is_missing_is_marked(free: StopReport) -> None:
    page = page_of(free)
    marked = [each.text for each in page.all() if "missing" in each.classes]
    assert marked.count("missing") >= 5
    named = {each.what for each in free.missing}
    assert {"brake torques and delay", "S_p against the separation"} <= named
    for what in named:
        assert f"{what}: missing" in marked
    assert [each for each in free.distances if each.required is None and each.missing]


def test_guessed_brakes_are_marked_and_never_an_answer(free: StopReport, full: StopReport) -> None:
    page, written = page_of(free), as_written(free)
    guessed = [k for k, each in enumerate(written["worst_case"]) if each["guessed"]]
    grids = [k for k, each in enumerate(written["grids"]) if each["guessed"]]
    assert guessed and grids
    begins = tuple(f"/worst_case/{k}/" for k in guessed) + tuple(f"/grids/{k}/" for k in grids)
    shown = [each for each in page.all("data") if each.attributes["data-json"].startswith(begins)]
    assert len(shown) > 100 and all(inside(each, "guessed") for each in shown)
    captions = [each for each in page.all("caption", "figcaption") if inside(each, "guessed")]
    assert captions and all("guessed brakes" in each.text for each in captions)
    assert len([each for each in page.all("p") if "watermark" in each.classes]) >= 2
    assert not free.answer.guessed and free.answer.stop != BRAKES
    assert not [each for each in free.distances if each.stop == BRAKES]
    assert not [each for each in report_lines(free) if each.startswith(BRAKES)]
    declared = page_of(full)
    assert not [each for each in declared.all() if "guessed" in each.classes]
    assert [each for each in full.cases if each.stop == BRAKES and not each.guessed]
    assert [each for each in full.distances if each.stop == BRAKES]


def test_brackets_of_the_answer_hold_and_cells_know_of_each_other(report: StopReport) -> None:
    for case in report.cases:
        for each in case.brackets:
            assert 0.0 <= each.lower <= each.upper
    for one in report.grids:
        assert one.grid.complete and len(one.grid.cells) == 27
        for small in one.grid.cells:
            for large in one.grid.cells:
                if (
                    small.load == large.load
                    and small.speed <= large.speed
                    and small.extension <= large.extension
                ):
                    for a, b in zip(small.brackets, large.brackets, strict=True):
                        assert a.lower <= b.lower and a.upper <= b.upper


def test_stops_of_the_recording_are_those_of_verify(full: StopReport, recording: Path) -> None:
    judged = verify(recording, Cell.from_table(TABLE)).per_cycle.stop_time_s
    assert full.recorded is not None and full.recorded.case is not None
    mine = full.recorded.stop_time_s
    both = np.isfinite(judged) & np.isfinite(mine)
    assert both.sum() > 10
    np.testing.assert_allclose(mine[both], judged[both], atol=1e-6)
    longest = full.recorded.case.largest(STOP_TIME)
    assert longest is not None and longest.lower == pytest.approx(np.nanmax(mine))
    assert full.answer is full.recorded.case and full.answer.over == RECORDED
    assert full.recorded.planned + full.recorded.without_stop + full.recorded.beyond_end == len(mine)


def test_angles_and_ways_of_the_recording_against_the_profile(full: StopReport) -> None:
    """No joint of the longest stop turns farther than the bracket says; ways by ρ |dq| of brute force."""
    case = full.answer
    profile = full.profile
    assert profile.over == RECORDED
    for j, bracket in enumerate(case.of(STOP_ANGLE)):
        assert profile.way[:, j].max() <= bracket.upper
        assert np.trapezoid(profile.speed[:, j], profile.t) == pytest.approx(profile.way[-1, j], abs=2e-4)
    way, speed = case.largest(STOP_WAY), case.largest(POINT_SPEED)
    assert way is not None and speed is not None
    assert 0.0 < way.lower <= way.upper <= speed.upper * np.nanmax(full.recorded.stop_time_s) * 1.001


def test_the_required_distance_by_hand(full: StopReport) -> None:
    longest = full.answer.largest(STOP_TIME)
    assert longest is not None
    total = 0.03 + 2 * 0.01 + 0.008 + longest.upper
    intrusion = 8.0 * (0.030 - 0.014)
    near, far = 2.0 * total + intrusion, max(1.6 * total + intrusion, 0.5)
    found = full.distances[0]
    assert found.required is not None and (found.stop, found.over) == (PATH_CONSISTENT, RECORDED)
    assert found.required.distance_m == pytest.approx(near if near <= 0.5 else far, abs=1e-9)
    assert full.separation is not None and full.separation.worst is not None
    (unbounded,) = [
        each for each in full.distances if (each.stop, each.over) == (PATH_CONSISTENT, ANY_MOTION)
    ]
    assert [each.what for each in unbounded.missing] == ["T"], "the device has been stated"


def test_the_fastest_point_of_a_pose_is_the_fastest_of_the_capsules(rng: np.random.Generator) -> None:
    """Against points on the balls at the ends of every capsule, moved by differences in time."""
    arm = ArmSearch(load_robot("ur3", setup=RobotSetup(bare_flange=True)))
    n, h = len(arm.model.joints), 1e-6
    directions = rng.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for _ in range(3):
        q, dq = rng.uniform(-3.0, 3.0, n), rng.uniform(-3.0, 3.0, n)
        pose = pose_of(arm, "any", JOINT_SPACE, Witness(q, dq, np.zeros(n)))
        rows = arm.model.enclosure[0]
        fastest = 0.0
        for link in range(len(arm.model.links)):
            joint, places = int(rows["joint"][link]), []
            for state in (q - h * dq, q + h * dq):
                rotation, position = np.zeros((n, 3, 3)), np.zeros((n, 3))
                forward(arm.model.kinematics, np.ascontiguousarray(state), rotation, position)
                ends = (
                    np.array([rows["a"][link], rows["b"][link]])[:, None] + rows["radius"][link] * directions
                )
                places.append(ends.reshape(-1, 3) @ rotation[joint].T + position[joint])
            fastest = max(fastest, float(np.linalg.norm(places[1] - places[0], axis=1).max()) / (2 * h))
        speed = float(np.linalg.norm(pose.velocity))
        assert fastest <= speed * (1 + 1e-6)
        assert fastest >= 0.97 * speed


def test_it_can_be_ended_early_and_says_so(recording: Path) -> None:
    for allowed in (0, 3, 40):
        asked = [0]

        def should_end(allowed: int = allowed, asked: list[int] = asked) -> bool:
            asked[0] += 1
            return asked[0] > allowed

        work = Work(time.perf_counter, should_end, lambda _share: None)
        found = stop_report(Cell.from_table(TABLE), recording, StopReportSettings(deadline_s=QUICK), work)
        assert found.interrupted and found.exit_status == 1
        assert any(each.ended is Ended.INTERRUPTED for case in found.cases for each in case.brackets)
        written = as_written(found)
        assert not faults("stop-report", written)
        page = page_of(found)
        assert INTERRUPTED in page.first("header").text and unreadable(page) == []
        assert INTERRUPTED in report_lines(found)
        assert "S_p against the separation" in {each.what for each in found.missing}


def test_the_longest_time_of_each_stop_is_to_be_measured(free: StopReport, full: StopReport) -> None:
    """Once, whatever joints have it; the times of the others come with their angles."""
    for made in (free, full):
        for grid in made.grids:
            (cell,) = (each for each in grid.grid.cells if each.extension == each.speed == each.load == 1.0)
            times = [each.lower for each in cell.brackets if each.quantity == STOP_TIME]
            of = [each.bracket for each in made.to_measure if each.stop == grid.stop and each.instant is None]
            assert [each.lower for each in of if each.quantity == STOP_TIME] == [max(times)]
            assert sum(each.quantity == STOP_ANGLE for each in of) == len(made.joints)


def test_axes_on_one_curve_are_named(full: StopReport) -> None:
    """All joints of a UR5 have one velocity limit: its stops differ in nothing."""
    way = full.profile.way
    assert len({way[:, j].tobytes() for j in range(6)}) < 6
    caption = page_of(full).text
    assert re.search(r"[\w ]+ and \w+ have one curve\.", caption)


@contextmanager
def handled_by(handler: Any) -> Iterator[None]:
    """Whoever starts the tests may have had Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_first_interrupt_ends_the_work_the_second_one_the_program() -> None:
    with handled_by(signal.default_int_handler):
        with ended_by_interrupt() as should_end:
            assert not should_end()
            signal.raise_signal(signal.SIGINT)
            assert should_end()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_that_is_ignored_stays_ignored() -> None:
    with handled_by(signal.SIG_IGN), ended_by_interrupt() as should_end:
        signal.raise_signal(signal.SIGINT)
        assert not should_end() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"payload_kg": -1.0}, "--payload -1"),
        ({"payload_kg": math.nan}, "--payload nan"),
        ({"payload_at_m": (0.0, 0.0, 0.1)}, "give --payload KG too"),
        ({"payload_kg": 1.0, "payload_at_m": (0.0, 0.0, 90.0)}, "--payload-at 90: should be -5 to 5 m"),
        ({"speed": 0.0}, "--speed 0: should be 1e-06 to 1"),
        ({"speed": 9e-7}, "--speed 9e-07: should be 1e-06 to 1"),
        ({"speed": 50.0}, "--speed 50: should be 1e-06 to 1, a share of the limits: 0.5 is 50 %"),
        ({"speed": math.nan}, "--speed nan"),
        ({"deadline_s": 0.0}, "--deadline 0"),
        ({"deadline_s": math.inf}, "--deadline inf"),
        ({"seed": -1}, "--seed -1"),
        ({"brake_torque": (1.0,)}, "--brake-torque, --brake-delay: each needs the other one"),
        ({"brake_delay_s": 0.1}, "--brake-torque, --brake-delay"),
        ({"brake_torque": (1.0,), "brake_delay_s": 0.1}, "an unknown mass is not assumed"),
        ({"brake_torque": (0.0,), "brake_delay_s": 0.1, "payload_kg": 1.0}, "--brake-torque 0"),
        ({"brake_torque": (1e30,), "brake_delay_s": 0.1, "payload_kg": 1.0}, "at most 1e+06 for every joint"),
        ({"resolution_m": math.nan}, "--resolution nan"),
        ({"height_m": -0.1}, "--field-height -0.1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(SetupError, match=re.escape(told)):
        StopReportSettings(**settings)


URDF = """<robot name="ur3"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="4"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.1 0.4"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="80"/></joint></robot>"""
"""An arm of one joint that is called like one of the catalogue."""


def of_urdf(folder: Path) -> str:
    """A cell with that arm."""
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
    limits = "[robot.limits.turn]\nacceleration_rad_s2 = 10.0\njerk_rad_s3 = 400.0\n"
    return f'[robot]\nurdf = "arm.urdf"\nbare_flange = true\n{limits}'


ZERO = '[robot]\nname = "ur3"\nbare_flange = true\n[robot.limits.elbow_joint]\nvelocity_rad_s = 0.0\n'


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--robot", "ur3", "--payload", 3.5), "payload of 3.5 kg is beyond the rated payload of 3 kg"),
        (("--robot", "lwa4p", "--payload", 1), "mass"),
        (("--robot", "ur3", "--recording", "RECORDING"), "they must agree"),
        (("--cell", "ZERO"), "velocity_rad_s"),
        (("--robot", "ur9"), "ur9"),
        (("--cell", "URDF", "--payload", 1), "give --payload-frame LINK too"),
        ((), "no robot is named"),
        (("--robot", "ur3", "--payload", 1, "--brake-torque", "5,5", "--brake-delay", 0.1), "2 torques"),
        (("--robot", "ur3", "--brake-torque", "5,x", "--brake-delay", 0.1), "numbers with commas"),
        (
            ("--robot", "ur3", "--resolution", 0.09, "--deadline", QUICK),
            "should be 0 to 0.07 m (30 mm is 0.03)",
        ),
        (("--robot", "ur3", "--json", "OUT"), "names the same file"),
        (("--robot", "ur3", "--out", "page.txt"), "its name must end in .html"),
        (("--robot", "ur3", "--recording", "OUT", "--force"), "is the recording itself"),
        (("--robot", "ur3", "--recording", "nowhere.mcap"), "nowhere.mcap"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    shell: Shell, tmp_path: Path, recording: Path, options: tuple[object, ...], told: str
) -> None:
    (tmp_path / "zero.toml").write_text(ZERO, encoding="utf-8")
    out = tmp_path / "page.html"
    (tmp_path / "urdf.toml").write_text(of_urdf(tmp_path), encoding="utf-8")
    places = {
        "RECORDING": recording,
        "ZERO": tmp_path / "zero.toml",
        "OUT": out,
        "URDF": tmp_path / "urdf.toml",
    }
    if "--force" in options:
        out.write_text("taken", encoding="utf-8")
    given = [places.get(str(each), each) for each in options]
    target = () if "--out" in options else ("--out", out)
    assert told in refused(shell("stop-report", *given, *target))
    assert not out.exists() or out.read_text(encoding="utf-8") == "taken"


def test_the_command_writes_whole_files_and_overwrites_none(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: StopReport
) -> None:
    monkeypatch.setattr("verifier.stop_report_command.stop_report", lambda *_args: free)
    page, table = tmp_path / "p.html", tmp_path / "p.json"
    status, out, _err = shell("stop-report", "--robot", "ur3", "--out", page, "--json", table)
    assert status == 3 and f"wrote {page} and {table}" in out
    assert page.read_bytes() == stop_report_page(free) and json.loads(table.read_text()) == as_written(free)
    assert "exists" in refused(shell("stop-report", "--robot", "ur3", "--out", page))
    status, out, _err = shell("stop-report", "--robot", "ur3", "--out", page, "--force", "--json", "-")
    assert status == 3 and json.loads(out)["robot"] == "ur3"


def test_an_arm_of_a_urdf_against_a_pendulum(tmp_path: Path) -> None:
    """One joint: all is known in closed form; the rated payload of a namesake is not its own."""
    (tmp_path / "cell.toml").write_text(of_urdf(tmp_path), encoding="utf-8")
    cell = Cell.from_toml(tmp_path / "cell.toml")
    bare = stop_report(cell, settings=StopReportSettings(deadline_s=1.0))
    assert "loads, category 0" in {each.what for each in bare.missing}
    settings = StopReportSettings(
        payload_kg=1.0, payload_frame="arm", brake_torque=(60.0,), brake_delay_s=0.0, deadline_s=1.0
    )
    found = stop_report(cell, settings=settings)
    longest, turned = found.answer.largest(STOP_TIME), found.answer.largest(STOP_ANGLE)
    assert longest is not None and turned is not None
    # speeding up by a = 10 at v = 2 - a²/2J, the ramp to v = 2, then v/a + a/J
    assert longest.upper == pytest.approx(2.0 / 10.0 + 10.0 / 400.0 + 10.0 / 400.0, rel=1e-9)
    (brakes,) = [case for case in found.cases if case.stop == BRAKES]
    (angle,) = brakes.of(STOP_ANGLE)
    # ½ I ω² is spent by the brake less or plus the weight that the joint lifts
    inertia, pull = 0.1 + 4.0 * 0.2**2, 4.0 * 0.2 * 9.80665
    assert angle.lower <= 0.5 * inertia * 4.0 / (60.0 - pull) * 1.02
    assert angle.lower >= 0.5 * inertia * 4.0 / (60.0 + pull) * 0.98
    assert angle.upper >= 0.5 * inertia * 4.0 / 60.0


def test_an_arm_of_unknown_masses_has_all_but_what_needs_them() -> None:
    cell = Cell.from_table({"robot": {"name": "lwa4p", "bare_flange": True}})
    found = stop_report(cell, settings=StopReportSettings(deadline_s=QUICK, height_m=0.3))
    assert [each.stop for each in found.grids] == [JOINT_SPACE] and not found.torques
    assert "loads, category 0" in {each.what for each in found.missing}
    required = found.distances[0].required
    assert required is not None and required.term("C") == pytest.approx(1.2 - 0.4 * 0.3)
