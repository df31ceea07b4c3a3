"""Recordings in which somebody is where nobody looked: late, unreadable, in a gap, under a known name."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point
from robots.catalog import _locate
from robots.errors import SetupError
from tests.verifier.scenes import CELL, UR5_JOINTS, Array, Scene, at, far, person_at, swing, write_reports
from tests.verifier.test_replay import judged, reasons
from verifier import Cell, Reason, Status, verify
from verifier.recordings import Recording, new_recording
from verifier.recordings.people_report import ReportedPerson

FAR, NEAR = person_at(4.0, 0.0), person_at(0.4, 0.0)
CYCLE = 0.01


def cell(**people: object) -> Cell:
    return Cell.from_table({**CELL, "people": {**CELL["people"], **people}})


def reason_at(report: object, t: float) -> Reason:
    return Reason(int(report.per_cycle.reason[round(t / CYCLE)]))


def nothing_read() -> ReportedPerson:
    return ReportedPerson("p1", NEAR, np.full(len(Point), 0.005), 0)


# ---------------------------------------------------------------------------------- robot: gaps, vibration


@pytest.mark.parametrize("gap_s", [1.0, 6.0, 20.0])
def test_no_cycle_of_a_gap_is_verified_however_long_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gap_s: float
) -> None:
    monkeypatch.setattr("verifier.replay.WINDOW_S", 3.0)
    monkeypatch.setattr("verifier.replay.TAIL_S", 2.0)
    monkeypatch.setattr("verifier.section.TAIL_S", 2.0)
    seconds = 10.0 + gap_s
    path = write_reports(
        tmp_path / "r.mcap",
        [(t, t + 0.03, {"p1": FAR}) for t in at(20.0, seconds)],
        joint_times=[t for t in at(100.0, seconds) if not 5.0 < t < 5.0 + gap_s],
    )
    table = {**CELL, "robot": {**CELL["robot"], "tracking": {"position_error_rad": 0.5}}}
    status = verify(path, Cell.from_table(table)).per_cycle.status
    within = slice(500, round(100 * (5.0 + gap_s)) + 1)
    assert (status[within] == Status.CONTRADICTED).all() and len(status[within]) > 0
    assert (status[10:450] != Status.CONTRADICTED).all()
    assert (status[within.stop + 1 :] != Status.CONTRADICTED).all()


@pytest.mark.parametrize(("gap_s", "between"), [(0.15, 0), (1.0, 0), (1.0, 3), (6.0, 3)])
def test_both_sides_of_a_gap_are_judged_and_nothing_across_it(
    tmp_path: Path, gap_s: float, between: int
) -> None:
    """One path across the gap would miss its samples by tenths of a radian, and nothing would be judged."""
    begin, end = 3.0, 3.0 + gap_s
    middle = [begin + 0.5 * gap_s + 0.01 * n for n in range(between)]
    times = [t for t in at(100.0, 12.0) if t <= begin or t >= end]
    path = write_reports(
        tmp_path / "r.mcap",
        [(t, t + 0.03, {"p1": FAR}) for t in at(20.0, 12.0)],
        joint_times=sorted([*times, *middle]),
        motion=lambda t: swing(3.0 * t),
    )
    limits = {joint: {"acceleration_rad_s2": 40.0, "jerk_rad_s3": 4000.0} for joint in UR5_JOINTS}
    report = verify(path, Cell.from_table({**CELL, "robot": {**CELL["robot"], "limits": limits}}))
    status, t = report.per_cycle.status, report.per_cycle.t
    assert set(status[(t > 0.1) & (t < begin - 0.5)]) == set(status[(t > end + 0.05) & (t < 11.5)]) == {2}
    inside = status[(t >= begin) & (t <= end)]
    assert len(inside) > 10 and (inside == Status.CONTRADICTED).all()
    stops = report.per_cycle.stop_time_s
    across = (t < end) & (t + 2 * CYCLE + np.nan_to_num(stops) > begin)
    assert not (status[across] == Status.VERIFIED).any()
    assert max(a.value for a in report.assumptions if a.name.startswith("robot.tracking.")) < 1e-3


def test_a_stretch_without_two_samples_that_belong_together_is_no_error(tmp_path: Path) -> None:
    reports = [(t, t + 0.03, {"p1": FAR}) for t in at(20.0, 20.0)]
    path = write_reports(tmp_path / "r.mcap", reports, joint_times=at(1.0, 20.0))
    report = verify(path, cell())
    assert report.count(Status.CONTRADICTED) == report.cycles
    assert {item.reason for item in report.contradicted} == {Reason.ROBOT_STREAM_GAP}


def test_too_few_samples_are_refused_with_file_and_time(tmp_path: Path) -> None:
    path = write_reports(
        tmp_path / "r.mcap", [(0.0, 0.01, {"p1": FAR})], joint_times=[n * 0.05 for n in range(5)]
    )
    with pytest.raises(
        SetupError, match=r"r\.mcap: 5 joint samples between 0\.00 s and 0\.20 s are too few: a path needs 6"
    ):
        verify(path, cell())


def test_a_path_that_cannot_be_fitted_is_refused_with_file_and_time(tmp_path: Path) -> None:
    path = write_reports(
        tmp_path / "r.mcap",
        [(t, t + 0.03, {"p1": FAR}) for t in at(20.0, 2.0)],
        motion=lambda t: swing(t) * 600.0 * (-1.0) ** round(125 * t),
    )
    with pytest.raises(SetupError, match=r"r\.mcap: .*between 0\.00 s and 2\.00 s"):
        verify(path, cell())


def test_a_clock_that_was_set_is_named(tmp_path: Path) -> None:
    times = [*at(100.0, 1.0), *(2e8 + t for t in at(100.0, 1.0))]
    reports = [(t, t + 0.03, {"p1": FAR}) for t in times]
    path = write_reports(tmp_path / "r.mcap", reports, joint_times=times)
    with pytest.raises(SetupError, match=r"time jumps by 2e\+08 s at 1\.000 s after the first joint sample"):
        verify(path, cell())


@pytest.mark.parametrize(("amplitude", "touched"), [(0.0, True), (0.01, False)])
def test_a_robot_that_shakes_is_not_at_rest(tmp_path: Path, amplitude: float, touched: bool) -> None:
    def shake(t: float) -> Array:
        return swing(0.3) + np.array([amplitude * math.sin(2.0 * math.pi * 60.0 * t), 0, 0, 0, 0, 0])

    scene = Scene(motion=shake, joint_rate=500.0, people={"p1": lambda _t: person_at(0.3, 0.0)})
    found = reasons(judged(tmp_path, scene))
    assert (Reason.AT_REST in found) is touched
    assert (Reason.REACHABLE in found) is not touched


# --------------------------------------------------------------------------------------- people: who is new


def test_somebody_of_whom_nothing_is_read_at_first_is_there_all_the_same(tmp_path: Path) -> None:
    reports = [(t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0)]
    reports += [(t, t + 0.3, {"p1": FAR, "p2": replace(nothing_read(), id="p2")}) for t in (1.001, 1.021)]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell())
    assert reason_at(report, 0.8) is Reason.SEPARATED
    assert reason_at(report, 1.0) is Reason.UNREPORTED_PERSON
    assert reason_at(report, 1.2) is Reason.UNREPORTED_PERSON
    assert reason_at(report, 1.4) is Reason.PERSON_WITHOUT_BOUND
    assert any("p2, first seen then" in item.text and "wherever" in item.text for item in report.contradicted)


def test_a_first_sighting_that_the_second_one_belies(tmp_path: Path) -> None:
    reports = [(t, t + 0.03, {}) for t in at(50.0, 2.0) if t < 0.95]
    reports += [(t, t + 0.03, {"p1": FAR if t < 0.97 else NEAR}) for t in at(50.0, 2.0) if t >= 0.95]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell())
    assert reason_at(report, 0.8) is Reason.NOBODY_REPORTED
    assert reason_at(report, 0.95) is Reason.PERSON_OUTSIDE_PREDICTION


@pytest.mark.parametrize("seen", [0.7, 1.4, 1.99])
def test_a_report_that_comes_seconds_later_is_held_against_what_was_verified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seen: float
) -> None:
    monkeypatch.setattr("verifier.replay.WINDOW_S", 1.0)
    monkeypatch.setattr("verifier.replay.TAIL_S", 0.6)
    monkeypatch.setattr("verifier.section.TAIL_S", 0.6)
    reports = [(t, t + 0.03, {}) for t in at(50.0, 9.0)]
    reports.append((seen, seen + 5.0, {"p1": NEAR}))
    path = write_reports(tmp_path / "r.mcap", reports, joint_times=at(125.0, 9.0))
    report = verify(path, cell())
    assert reason_at(report, seen - 0.3) is Reason.NOBODY_REPORTED
    for t in (seen - 0.04, seen + 0.1, seen + 0.3):
        assert reason_at(report, t) is Reason.UNREPORTED_PERSON, t


@pytest.mark.parametrize("offset", [0.0, 0.001, -0.001])
def test_two_sensors_that_call_two_people_by_one_name(tmp_path: Path, offset: float) -> None:
    reports = [(t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0)]
    reports += [(t + offset, t + 0.031, {"p1": NEAR}) for t in at(50.0, 2.0)]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell())
    assert report.count(Status.VERIFIED) == 0
    assert report.count(Status.CONTRADICTED) > 180


def test_reports_that_cannot_be_read_are_reports(tmp_path: Path) -> None:
    reports = [(t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0)]
    frames = dict.fromkeys(range(50), "camera_2")
    report = verify(write_reports(tmp_path / "r.mcap", reports, frames=frames), cell())
    assert reason_at(report, 0.02) is Reason.NO_REPORT_YET
    assert reason_at(report, 0.5) is Reason.PERSON_WITHOUT_BOUND
    assert reason_at(report, 1.5) is Reason.SEPARATED
    assert report.exit_status == 1


def test_a_last_report_with_an_early_stamp_hides_nothing(tmp_path: Path) -> None:
    def walk(t: float) -> Array:
        return person_at(max(0.4, 3.0 - 1.5 * t), 0.0)

    reports = [(t, t + 0.03, {"p1": walk(t)}) for t in at(50.0, 2.0)]
    plain = verify(write_reports(tmp_path / "a.mcap", reports), cell())
    reports.append((0.1, 2.04, {"p1": walk(0.1)}))
    late = verify(write_reports(tmp_path / "b.mcap", reports), cell())
    assert plain.count(Status.NOT_VERIFIED) > 0
    assert np.array_equal(plain.per_cycle.status, late.per_cycle.status)


@pytest.mark.parametrize("ahead", [0.05, 9.0, 11.0])
@pytest.mark.parametrize("others", [True, False])
def test_nobody_hides_behind_a_clock_that_is_ahead(tmp_path: Path, ahead: float, others: bool) -> None:
    reports = [(t, t + 0.03, {"p1": FAR} if others else {}) for t in at(50.0, 2.0)]
    reports += [(t + ahead, t, {"near": NEAR}) for t in at(10.0, 2.0) if t > 0.95]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell(empty_report_valid_s=0.2))
    assert reason_at(report, 0.5) is (Reason.SEPARATED if others else Reason.NOBODY_REPORTED)
    assert reason_at(report, 0.99) is Reason.UNREPORTED_PERSON
    assert report.count(Status.VERIFIED) < 100
    assert (report.per_cycle.status[104:190] == Status.NOT_VERIFIED).all()
    assert reason_at(report, 1.5) is Reason.PERSON_WITHOUT_BOUND
    wrong = "stamp is ahead of the clock" if ahead < 10.0 else "stamp and message time are 10 to 100 s apart"
    assert sum(wrong in item.reason for item in report.refused) >= 10


def test_a_first_report_with_a_stamp_ahead_cuts_nothing_off(tmp_path: Path) -> None:
    reports = [(1.5, 0.001, {"p1": FAR}), *((t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0))]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell())
    assert report.cycles == 199
    assert reason_at(report, 1.0) is Reason.SEPARATED


def test_reports_that_come_after_the_last_cycle_are_counted(tmp_path: Path) -> None:
    reports = [(t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0)]
    report = verify(write_reports(tmp_path / "r.mcap", reports), cell())
    assert "reports that had not arrived by the last cycle: 2" in report.notes


def test_somebody_in_a_report_that_cannot_be_read_is_there(tmp_path: Path) -> None:
    path = write_reports(tmp_path / "r.mcap", [(t, t + 0.03, {"p1": FAR}) for t in at(50.0, 2.0)])
    file = Recording(path).file
    twice = b'{"stamp": 1, "frame": "world", "people": [{"id": "p2", "points": {}}], "people": []}'
    with new_recording(tmp_path / "s.mcap") as writer:
        writer.describe({"robot": "ur5"})
        for number, message in enumerate(file.messages()):
            bad = message.channel.topic == "/people" and number > 175
            content = message._replace(data=twice) if bad else message
            writer.copy(content, file.schemas[message.channel.schema_id])
    report = verify(tmp_path / "s.mcap", cell())
    first = next(item.stamp for item in report.refused if "key 'people' is given twice" in item.reason)
    assert 0.9 < first < 1.1
    assert reason_at(report, first - 0.2) is Reason.SEPARATED
    assert reason_at(report, first - 0.01) is Reason.UNREPORTED_PERSON
    assert reason_at(report, first + 0.04) is Reason.PERSON_WITHOUT_BOUND


# ------------------------------------------------------------------------------------------ people: nobody


@pytest.mark.parametrize(
    ("valid_s", "stamp_error_s", "clock_error_s", "until"),
    [(0.2, 0.0, 0.0, 0.7), (0.2, 0.05, 0.02, 0.63), (0.0, 0.0, 0.0, 0.5)],
)
def test_nobody_counts_from_the_stamp_less_its_errors(
    tmp_path: Path, valid_s: float, stamp_error_s: float, clock_error_s: float, until: float
) -> None:
    reports = [(t, t, {}) for t in at(50.0, 0.5)]
    path = write_reports(tmp_path / "r.mcap", reports)
    errors = {"stamp_error_s": stamp_error_s, "clock_error_s": clock_error_s}
    report = verify(path, cell(latency_s=0.0, empty_report_valid_s=valid_s, **errors))
    last = np.flatnonzero(report.per_cycle.reason == Reason.NOBODY_REPORTED).max()
    assert report.per_cycle.t[last] == pytest.approx(until, abs=1.001 * CYCLE)
    assert (report.per_cycle.reason[last + 1 : 190] == Reason.STALE_EMPTY_REPORT).all()


def test_an_older_empty_report_takes_nothing_back(tmp_path: Path) -> None:
    reports = [(0.0, 0.0, {}), (1.0, 1.0, {}), (0.5, 1.001, {})]
    report = verify(
        write_reports(tmp_path / "r.mcap", reports), cell(latency_s=0.0, empty_report_valid_s=0.3)
    )
    assert reason_at(report, 1.2) is Reason.NOBODY_REPORTED


def test_an_empty_report_in_an_undeclared_frame_says_nothing(tmp_path: Path) -> None:
    reports = [(t, t, {}) for t in at(50.0, 2.0)]
    frames = dict.fromkeys(range(30, 101), "camera_2")
    report = verify(write_reports(tmp_path / "r.mcap", reports, frames=frames), cell(latency_s=0.0))
    assert reason_at(report, 0.5) is Reason.NOBODY_REPORTED
    assert reason_at(report, 1.5) is Reason.STALE_EMPTY_REPORT


# --------------------------------------------------------------------------------------- what must agree


def test_a_urdf_of_another_arm_is_refused(tmp_path: Path) -> None:
    path = Scene(robot="ur5").write(tmp_path / "r.mcap")
    limits = {joint: {"acceleration_rad_s2": 10.0, "jerk_rad_s3": 400.0} for joint in UR5_JOINTS}
    table = {"robot": {**CELL["robot"], "urdf": str(_locate("ur3")[1]), "limits": limits}}
    with pytest.raises(SetupError, match=r"recording is of ur5, but .*\.urdf describes ur3"):
        verify(path, Cell.from_table(table))


def test_a_tool_of_the_command_line_must_be_that_of_the_cell() -> None:
    stated = Cell.from_table({"robot": {"tool": "gripper.toml"}})
    assert stated.with_options(tool="gripper.toml").robot.tool == "gripper.toml"
    with pytest.raises(SetupError, match=r"--tool tiny\.toml: the cell says gripper\.toml"):
        stated.with_options(tool="tiny.toml")


@pytest.mark.parametrize(
    "table",
    [
        {"check": {"standstill_speed_m_s": 100.0}},
        {"check": {"standstill_error_m": 1.0}},
        {"people": {"empty_report_valid_s": 1e9}},
        {"robot": {"max_sample_gap_s": 1e9}},
        {"cycle_s": 1e-10},
    ],
)
def test_numbers_that_would_empty_the_check_are_refused(table: dict[str, object]) -> None:
    with pytest.raises(SetupError, match=r"must be at (least|most)"):
        Cell.from_table(table)


def test_motion_before_the_first_report_is_named(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(people_from=0.5, people={"p1": far}))
    assert any("the first 0.500 s of motion" in note for note in report.notes)
