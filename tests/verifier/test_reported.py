"""What a report says about the reports that it rests on: nobody in any, stamps ahead, errors not stated."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Schema

from occupancy.body import Point
from tests.verifier.scenes import CELL, Scene, at, far, person_at, write_reports
from verifier import Cell, Status, verify
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_file import McapFile, McapWriter
from verifier.recordings.people_report import ReportedPerson
from verifier.reports.verification import Refused, VerifyReport
from verifier.verdict import Reason

NOBODY = "lists anybody: that nobody was there rests on A5 alone"


def notes(report: VerifyReport, words: str) -> list[str]:
    return [line for line in report.lines() if line.startswith("note: ") and words in line]


def test_that_nobody_was_ever_reported_is_said(tmp_path: Path) -> None:
    scene = Scene(duration=1.0, people={}, complete=True)
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    verified = report.count(Status.VERIFIED)
    assert verified > 0 and report.exit_status == 0
    assert f"  verified     {verified:>9}  a complete report listed nobody" in report.lines()
    assert notes(report, NOBODY) == [f"note: no report {NOBODY}"]


@pytest.mark.parametrize("when", [0.0, 0.9, 1.96])
def test_one_report_that_lists_somebody_is_enough(tmp_path: Path, when: float) -> None:
    """Even the last one, which arrives after the last cycle."""
    reports = [(t, t, {"p1": far(t)} if t == when else {}) for t in (*at(10.0, 1.9), 1.96)]
    report = verify(write_reports(tmp_path / "r.mcap", reports), Cell.from_table(CELL))
    assert not notes(report, NOBODY)


def test_reasons_of_verified_cycles_stand_there_unless_people_are_far_away_in_all(tmp_path: Path) -> None:
    reports = [(t, t, {} if t < 1.0 else {"p1": far(t)}) for t in at(50.0, 2.0)]
    mixed = verify(write_reports(tmp_path / "a.mcap", reports), Cell.from_table(CELL))
    rows = [line for line in mixed.lines() if line.startswith("  verified ")]
    assert len(rows) == 2 and sum(int(row.split()[1]) for row in rows) == mixed.count(Status.VERIFIED)
    plain = verify(Scene(duration=0.5).write(tmp_path / "b.mcap"), Cell.from_table(CELL))
    assert plain.count(Status.VERIFIED) > 0
    assert not any(line.startswith("  verified ") for line in plain.lines())


@pytest.mark.parametrize(
    ("people", "told"),
    [
        ({}, None),
        ({"p1": far}, "the recording has 51 reports that list people (p1): not looked at"),
        (
            {f"p{n}": far for n in range(1, 5)},
            "the recording has 51 reports that list people (p1, p2, p3, …): not looked at",
        ),
    ],
)
def test_people_whom_nobody_looks_at_are_named(tmp_path: Path, people: dict, told: str | None) -> None:
    scene = Scene(duration=1.0, people=people, complete=True)
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL), assume_nobody=True)
    assert notes(report, "not looked at") == ([] if told is None else [f"note: {told}"])
    assert not notes(report, NOBODY)
    assert any(line.endswith("  nobody is there by assumption") for line in report.lines())


@pytest.mark.parametrize(("ahead", "clock_error", "told"), [(0.4, 0.0, 51), (0.4, 0.5, 0), (-0.01, 0.0, 0)])
def test_stamps_that_lie_ahead_are_measured(
    tmp_path: Path, ahead: float, clock_error: float, told: int
) -> None:
    reports = [(t + ahead, t, {"p1": person_at(4.0, 1e-3 * t)}) for t in at(50.0, 1.0)]
    table = {**CELL, "people": {**CELL["people"], "clock_error_s": clock_error}}
    report = verify(write_reports(tmp_path / "r.mcap", reports), Cell.from_table(table))
    found = notes(report, "people.clock_error_s")
    assert len(found) == (told > 0)
    if told:
        assert (
            found[0].startswith(f"note: {told} reports were refused because") and "by up to 0.4 s" in found[0]
        )


@pytest.mark.parametrize(("error", "used"), [(0.005, False), (math.nan, True)])
def test_the_default_position_error_is_listed_where_a_point_states_none(
    tmp_path: Path, error: float, used: bool
) -> None:
    errors = np.full(len(Point), 0.005)
    errors[Point.R_WRIST] = error
    person = ReportedPerson("p1", far(0.0), errors, (1 << len(Point)) - 1)
    path = write_reports(tmp_path / "r.mcap", [(t, t, {"p1": person}) for t in at(50.0, 2.0)])
    names = {item.name for item in verify(path, Cell.from_table(CELL)).assumptions}
    assert ("people.position_error" in names) is used


def refusals(report: VerifyReport) -> list[str]:
    """The lines on refused measurements."""
    lines = report.lines()
    first = next(i for i, line in enumerate(lines) if line.startswith("refused measurements"))
    return [lines[first], *itertools.takewhile(lambda line: line.startswith("   "), lines[first + 1 :])]


def millimetres(t: float) -> np.ndarray:
    return 1e3 * person_at(4.0, 1e-3 * t)


@pytest.mark.parametrize(
    ("scene", "why", "times", "hint"),
    [
        (
            Scene(duration=0.5, people={"p1": millimetres}),
            "farther away than the range of the sensors",
            480,
            "are the coordinates in m?",
        ),
        (Scene(duration=0.5, frame="hall"), "coordinate frame is not declared", 24, "[people.frames]"),
        (Scene(duration=0.5, delay=-0.1), "stamp is ahead of the clock", 26, "people.clock_error_s"),
    ],
)
def test_the_first_line_says_why_nothing_is_known(
    tmp_path: Path, scene: Scene, why: str, times: int, hint: str
) -> None:
    """Of the 26 reports those count that arrive by the last cycle; each has one person with 20 points."""
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.count(Status.VERIFIED) == 0
    assert report.lines()[1].endswith(
        f", under A1–A7; {report.refused_total} measurements refused, mostly: {why}"
    )
    (_first, row) = refusals(report)
    assert row.startswith(f"  {report.refused_total:>9} × {why}: ") and hint in row
    assert abs(report.refused_total - times) <= times // 24
    assert report.to_dict()["refused_measurements_by_reason"] == {why: report.refused_total}


def test_refusals_that_explain_nothing_stay_out_of_the_first_line(tmp_path: Path) -> None:
    def one_far_point(t: float) -> np.ndarray:
        points = far(t)
        if t > 0.5:
            points[Point.HEAD] = 1e4
        points[Point.L_HAND] = 0.0
        return points

    scene = Scene(people={"p1": one_far_point})
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.count(Status.VERIFIED) > 0
    assert report.lines()[1].endswith("under A1–A7")
    rows = refusals(report)[1:]
    assert [row.split(" × ")[1].split(":")[0] for row in rows] == [
        "coordinates are exactly zero",
        "farther away than the range of the sensors",
    ]
    assert sum(int(row.split(" × ")[0]) for row in rows) == report.refused_total


def test_only_the_most_frequent_reasons_are_printed_and_the_counts_add_up(tmp_path: Path) -> None:
    report = verify(Scene(duration=0.5).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    many = tuple((f"reason {n}", 100 - n) for n in range(20))
    first = Refused(0.0, "p1", None, "reason 0")
    odd = replace(report, refused=(first,), refused_for=many, refused_total=2000)
    assert "mostly" not in odd.lines()[1]
    unseen = np.full(report.cycles, int(Reason.PERSON_WITHOUT_BOUND), np.uint8)
    status = np.full(report.cycles, int(Status.NOT_VERIFIED), np.uint8)
    unknown = replace(odd, per_cycle=replace(odd.per_cycle, reason=unseen, status=status))
    assert unknown.lines()[1].endswith("; 2 000 measurements refused, for several reasons (below)")
    rows = refusals(odd)[1:]
    assert len(rows) == 7 and rows[-1].endswith("× other reasons, or not listed")
    assert sum(int(row.split(" × ")[0].replace(" ", "")) for row in rows) == 2000


@pytest.mark.parametrize("also", ["stopproof.People", "zed_msgs/msg/ObjectsStamped"])
def test_people_on_topics_that_are_not_read_are_said(tmp_path: Path, also: str) -> None:
    """Who is only on another topic is nobody: somebody has to say so, and it is told."""
    ours = Scene(duration=0.5).write(tmp_path / "ours.mcap")
    assert not notes(verify(ours, Cell.from_table(CELL)), "other topics")
    file, encoding = McapFile(ours), "json" if also.startswith("stopproof") else "cdr"
    path = tmp_path / "r.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        for message in file.messages():
            kind = file.schemas[message.channel.schema_id]
            channel = writer.channel(message.channel.topic, kind, message.channel.message_encoding)
            writer.write(channel, message.log_time, message.data)
        other = writer.channel("/camera2", Schema(id=0, name=also, encoding="", data=b""), encoding)
        writer.write(other, message.log_time, b"{}")
        writer.finish()
    table = {**CELL, "robot": {**CELL["robot"], "name": "ur5"}}
    several = r"has several topics with people: .*; choose one with --people-topic, or people_topic in"
    with pytest.raises(RecordingError, match=several):
        verify(path, Cell.from_table(table))
    cell = Cell.from_table({**table, "recording": {"people_topic": "/people"}})
    report = verify(path, cell)
    told = f"note: people on other topics were not read, and are nobody for the check: /camera2 ({also})"
    assert notes(report, "other topics") == [told]
    waived = verify(path, cell, assume_nobody=True)
    assert not notes(waived, "other topics")
