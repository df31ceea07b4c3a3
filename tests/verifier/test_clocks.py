"""Clocks that differ: what is verified with an offset and its error is verified with the true clock too."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from robots.errors import SetupError
from tests.verifier.recordings.bags import WRITERS, all_items
from tests.verifier.recordings.samples import joint_states, reports, write_all
from tests.verifier.scenes import EPOCH_NS, person_at, write_reports
from verifier import Cell, Status
from verifier.commands import cli
from verifier.opened import open_recording
from verifier.recordings import Choice, Recording, RecordingError, copy_with_verdicts
from verifier.recordings.clock_offset import ClockOffsets, moved_cdr, moved_json
from verifier.recordings.joint_state import JointState
from verifier.recordings.joint_state import decode as decode_joints
from verifier.recordings.joint_state import encode as encode_joints
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.people_report import decode
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC
from verifier.replay import verify

NANO = 1_000_000_000
CELL = {
    "robot": {"bare_flange": True, "accept_assumed": ["limits", "enclosure"]},
    "people": {"latency_s": 0.01},
}


def written(path: Path, ahead_s: float = 0.0) -> Path:
    """Somebody walks to the arm and away; their clock is ahead, reports take 60 ms."""
    seen = [n / 30.0 - 0.3 for n in range(69)]
    walk = {t: {"p1": person_at(2.2 - 1.2 * np.sin(1.6 * max(t, 0.0)) ** 2, 0.2)} for t in seen}
    return write_reports(path, [(t + ahead_s, t + 0.06, who) for t, who in walk.items()])


def verified(path: Path, offset_s: float | None = None, error_s: float = 0.0) -> set[int]:
    people, recording = {**CELL["people"], "clock_error_s": error_s}, {}
    if offset_s is not None:
        recording = {"time_offset_s": offset_s}
    cell = Cell.from_table({**CELL, "people": people, "recording": recording})
    report = verify(open_recording(path, cell), cell)
    assert report.cycles == 200, "the overlap begins with the joints"
    return set(np.flatnonzero(report.per_cycle.status == Status.VERIFIED).tolist())


@pytest.fixture(scope="module")
def true(tmp_path_factory) -> set[int]:
    """Cycles that are verified with the true clock."""
    return verified(written(tmp_path_factory.mktemp("true") / "true.mcap"))


@pytest.mark.parametrize(("ahead_s", "wrong_by"), [(0.4, -1.0), (-3000.0, 1.0)])
def test_what_is_verified_is_so_with_the_true_clock(tmp_path, true, ahead_s, wrong_by):
    """The offset is wrong by as much as its error allows."""
    error_s = 0.03
    declared = verified(written(tmp_path / "other.mcap", ahead_s), -ahead_s + wrong_by * error_s, error_s)
    assert declared <= true, "witness: cycles that only the wrong clock verifies"
    assert wrong_by > 0.0 or declared < true, "stamps too old by the error cost something"
    assert len(declared) > 20 and len(true) < 195, "there is something to be told apart"


def test_an_error_that_is_not_declared_would_be_found(tmp_path, true):
    wrong = verified(written(tmp_path / "other.mcap", 0.4), -0.4 + 0.05, 0.0)
    assert not wrong <= true


@pytest.mark.parametrize("kind", ["mcap", "ros1", "ros2 sqlite"])
@pytest.mark.parametrize("which", ["people", "joints"])
def test_stamps_are_moved_and_nothing_else(tmp_path, kind, which):
    states, people = joint_states(100.0, 1.0, EPOCH_NS), reports(50.0, 1.0, EPOCH_NS)
    name, write = WRITERS[kind]
    path = write(tmp_path / name, all_items(states, people))
    clocks = ClockOffsets(-0.125, None, 0.01) if which == "people" else ClockOffsets(None, 0.25, 0.01)
    before, after = Recording(path), Recording(path, Choice(clocks=clocks))
    for topic, read in ((JOINT_TOPIC, lambda m: decode_joints(m.data)), (PEOPLE_TOPIC, people_of)):
        pairs = zip(before.file.messages([topic]), after.file.messages([topic]), strict=True)
        for one, other in pairs:
            moved = {JOINT_TOPIC: ("joints", 250_000_000), PEOPLE_TOPIC: ("people", -125_000_000)}[topic]
            expected = moved[1] if moved[0] == which else 0
            assert read(other).stamp_ns - read(one).stamp_ns == expected
            late = 10_000_000 if (which, topic) == ("joints", PEOPLE_TOPIC) else 0
            assert other.log_time - one.log_time == late, (
                "joints known to 10 ms: reports count as later by that"
            )
    assert any(a.name == f"recording.{which}_time_offset" for a in after.assumptions)


def people_of(message):
    return decode(message.data, message.log_time)


def test_ours_keeps_what_it_says_beside_the_stamp(rng, count):
    for _ in range(count(1000)):
        stamp_ns, offset_ns = (int(each) for each in rng.integers(-(10**17), 10**17, 2))
        stamp = f"{'-' if stamp_ns < 0 else ''}{abs(stamp_ns) // NANO}.{abs(stamp_ns) % NANO:09d}"
        text = f'{{"frame":"world","x":[1e3,NaN,"ü"],"stamp":{stamp},"people":[]}}'
        moved = decode(moved_json(text.encode(), offset_ns), 0)
        assert moved.stamp_ns == decode(text.encode(), 0).stamp_ns + offset_ns
        assert b'"x": [1000.0, NaN, "\\u00fc"]' in moved_json(text.encode(), offset_ns)
    for text in (b"", b"[]", b'{"stamp":"soon"}', b'{"stamp":1,"stamp":2}', b"\xff"):
        assert moved_json(text, 5) == text, "what is no report is refused later, with its own reason"


def test_stamps_are_not_moved_twice(tmp_path):
    path = written(tmp_path / "a.mcap", 0.4)
    cell = Cell.from_table({**CELL, "people": {"clock_error_s": 0.01}, "recording": {"time_offset_s": -0.4}})
    out = tmp_path / "out.mcap"
    moved = open_recording(path, cell)
    shutil.copy(moved.file._file, out)
    with pytest.raises(RecordingError, match="its stamps were moved already"):
        open_recording(out, cell)
    with pytest.raises(
        RecordingError, match=r"clock_error_s of the cell must be at least that, it is 0\.001"
    ):
        open_recording(out, Cell.from_table({"people": {"clock_error_s": 0.001}}))
    assert open_recording(out, Cell.from_table({"people": {"clock_error_s": 0.01}})).has_people


def test_a_copy_with_verdicts_keeps_its_stamps_and_needs_the_same_offset(tmp_path):
    path, out = written(tmp_path / "a.mcap", 0.4), tmp_path / "out.mcap"
    cell = Cell.from_table({**CELL, "people": {"clock_error_s": 0.01}, "recording": {"time_offset_s": -0.4}})
    copy_with_verdicts(open_recording(path, cell), out, [])
    for topic in (JOINT_TOPIC, PEOPLE_TOPIC):
        before, after = (
            [(m.log_time, m.data) for m in McapFile(each).messages((topic,))] for each in (path, out)
        )
        assert before == after and before
    opened = [open_recording(each, cell) for each in (path, out)]
    moved = [[m.data for m in each.file.messages((PEOPLE_TOPIC,))] for each in opened]
    assert moved[0] == moved[1] != [m.data for m in McapFile(path).messages((PEOPLE_TOPIC,))]


def test_clocks_of_two_epochs_are_refused_with_what_to_write(tmp_path):
    path = written(tmp_path / "a.mcap", 1000.0 - EPOCH_NS / NANO)
    result = run("verify", path, "--bare-flange")
    line = str(result.exception)
    assert isinstance(result.exception, SetupError) and "\n" not in line
    assert "since a start" in line and "since 1970 (2023-11-14)" in line
    assert "--time-offset S±ERR" in line and "inspect" in line


def test_joints_of_another_epoch_are_refused_with_what_to_write(tmp_path):
    states, people = joint_states(100.0, 1.0, 5 * NANO), reports(50.0, 1.0, EPOCH_NS)
    from tests.verifier.recordings.bags import in_time, joint_item, people_item, write_foreign_mcap

    late = [joint_item(s, arrived_ns=s.stamp_ns - 5 * NANO + EPOCH_NS + 1_000_000) for s in states]
    path = write_foreign_mcap(tmp_path / "a.mcap", in_time([*late, *map(people_item, people)]))
    line = str(run("verify", path, "--robot", "ur5", "--bare-flange").exception)
    assert "joint" in line
    from verifier.recordings import Reading

    with pytest.raises(
        RecordingError, match=r"5\.000 s since a start.*joints_time_offset_s in \[recording\]"
    ):
        Reading(Recording(path), ("shoulder", "elbow"))
    there = Recording(path, Choice(clocks=ClockOffsets(None, EPOCH_NS / NANO - 5.0, 0.01)))
    assert Reading(there, ("shoulder", "elbow")).overlap[1] == pytest.approx(1.0, abs=0.03)


def test_inspect_bounds_the_offset_and_verify_takes_the_line(tmp_path):
    """From nothing known to a verdict: true offset -0.4 s, reports take 60 ms."""
    path = written(tmp_path / "a.mcap", 0.4)
    text = run("inspect", path).output
    assert "another clock, since nothing arrives before it is there" in text
    assert "the offset was at most -0.340000 s" in text and "--time-offset" not in text
    text = run("inspect", path, "--latency", "0.05", "0.07").output
    (stated,) = [
        line.split("--time-offset ")[1].split(",")[0] for line in text.splitlines() if "--time-off" in line
    ]
    offset, error = map(float, stated.split("±"))
    assert abs(offset + 0.4) <= error <= 0.015
    refused = run("verify", path, "--bare-flange", "--time-offset", str(offset))
    assert "states no error" in str(refused.exception)
    result = run("verify", path, "--bare-flange", f"--time-offset={stated.replace('±', '+-')}", "--json", "-")
    assert result.exception is None and result.return_value in (1, 3)
    used = {each["name"]: each["value"] for each in json.loads(result.output)["assumptions"]}
    assert (used["recording.people_time_offset"], used["cell.people.clock_error_s"]) == (offset, error)


@pytest.mark.parametrize("stated", [0.01, 0.5])
def test_option_and_cell_together(stated):
    cell = Cell.from_table({"people": {"clock_error_s": stated}})
    if stated < 0.1:
        with pytest.raises(SetupError, match="must be at least the error of the offset"):
            cell.with_options(time_offset=(1.0, 0.1))
        return
    together = cell.with_options(time_offset=(1.0, 0.1))
    assert (together.recording.time_offset_s, together.people.clock_error_s) == (1.0, 0.5)
    with pytest.raises(SetupError, match="they must agree"):
        together.with_options(time_offset=(2.0, 0.1))


def test_an_offset_needs_its_error():
    for key in ("time_offset_s", "joints_time_offset_s"):
        with pytest.raises(SetupError, match=r"state it as people\.clock_error_s"):
            Cell.from_table({"recording": {key: 1.0}})


def test_unstamped_joints_stay_where_they_are():
    """A stamp of 0 says that the message time counts, which is on the clock of the recorder already."""
    unstamped, stamped = (encode_joints(JointState(t, ("a",), np.zeros(1))) for t in (0, NANO))
    assert moved_cdr(unstamped, 5) == unstamped
    assert decode_joints(moved_cdr(stamped, 5)).stamp_ns == NANO + 5


def test_stamps_that_joints_cannot_have_are_refused(tmp_path):
    states, people = joint_states(100.0, 1.0, EPOCH_NS), reports(50.0, 1.0, EPOCH_NS)
    path = write_all(tmp_path / "a.mcap", [*states, *people])
    with pytest.raises(RecordingError, match=r"would become -.* s; stamps of joints begin in 1970"):
        Recording(path, Choice(clocks=ClockOffsets(None, -1.8e9, 0.0)))


def run(*arguments: object):
    return CliRunner().invoke(cli, [str(each) for each in arguments], standalone_mode=False)
