"""What `inspect` finds, against recordings whose content is known."""

import json

import numpy as np
import pytest

from occupancy.body import Point
from tests.verifier.recordings.samples import JOINTS, NANO, joint_states, person, reports, write_all
from verifier.cell import Cell
from verifier.recordings import RecordingError, inspect_recording, new_recording
from verifier.recordings.inspection import catalogue, guess_robots
from verifier.recordings.joint_state import JointState
from verifier.recordings.people_report import PeopleReport, ReportedPerson


def test_topics_rates_and_clocks(tmp_path):
    path = write_all(tmp_path / "a.mcap", [*joint_states(start_ns=NANO), *reports(start_ns=NANO)])
    found = inspect_recording(path)
    joints, people = found.topics
    assert (joints.name, joints.messages, joints.schema, joints.encoding) == (
        "/joint_states",
        201,
        "sensor_msgs/msg/JointState",
        "cdr",
    )
    assert joints.rate_hz == pytest.approx(100.0)
    assert joints.largest_gap_s == pytest.approx(0.01)
    assert joints.stamp_age_s == (0.0, 0.0, 0.0)
    assert people.rate_hz == pytest.approx(50.0)
    assert people.stamp_age_s == pytest.approx((0.02, 0.02, 0.02))
    assert (people.first_s, people.last_s) == pytest.approx((0.02, 2.02))
    assert found.duration_s == pytest.approx(2.02)
    assert found.joints == JOINTS
    assert found.people == {"p1": 101}
    assert found.points == {"r_wrist": 1.0}
    assert found.frames == ("world",)
    assert found.position_error_m == (0.01, 0.01)
    assert found.remarks == ()


def test_gaps_are_found(tmp_path):
    states = [s for s in joint_states() if not 0.5 * NANO < s.stamp_ns < 0.9 * NANO]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*states, *reports()]))
    joints = found.topics[0]
    assert joints.largest_gap_s == pytest.approx(0.4)
    assert joints.gap_at_s == pytest.approx(0.5)
    assert any("a gap of 0.400 s after 0.500 s" in remark for remark in found.remarks)


def test_clocks_that_disagree_are_remarked(tmp_path):
    late = reports(delay_s=0.5)
    early = [PeopleReport(r.arrived_ns, r.stamp_ns, r.frame, True, r.people) for r in reports(delay_s=0.1)]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*joint_states(), *late]))
    assert "/people: stamps are up to 0.5 s older than the message time" in found.remarks
    found = inspect_recording(write_all(tmp_path / "b.mcap", [*joint_states(), *early]))
    assert "/people: stamps are up to 0.1000 s ahead of the message time" in found.remarks


def test_publishers_are_told_apart(tmp_path):
    gripper = [JointState(n * NANO // 10 + 1, ("finger",), np.zeros(1)) for n in range(20)]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*joint_states(), *gripper]))
    assert [(p.name, p.messages) for p in found.publishers] == [("shoulder, elbow", 201), ("finger", 20)]
    assert found.publishers[1].rate_hz == pytest.approx(10.0)
    assert found.joints == (*JOINTS, "finger")


def test_what_would_be_refused_is_shown(tmp_path):
    states = joint_states()
    states[3].position[0] = np.nan
    path = tmp_path / "a.mcap"
    with new_recording(path) as writer:
        for state in [*states, states[5]]:
            writer.joints(state)
    found = inspect_recording(path)
    assert "/joint_states: a position is NaN or infinite at 30000000 ns" in found.remarks
    assert "/joint_states: time repeats or runs backwards at 50000000 ns" in found.remarks
    assert "there are no messages on /people" in found.remarks


def test_points_errors_and_inferred(tmp_path):
    xyz = np.full((20, 3), np.nan)
    xyz[:4] = 1.0
    error = np.full(20, np.nan)
    error[0], error[1] = 0.02, 0.05
    someone = ReportedPerson("a", xyz, error, 0b0011)
    people = [PeopleReport(n, n, "camera", True, (someone, person("b"))) for n in (1, 2)]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*joint_states(), *people]))
    assert found.people == {"a": 2, "b": 2}
    assert found.points == {"head": 0.5, "neck_base": 0.5, "r_wrist": 0.5}
    assert found.inferred_points == 4
    assert found.position_error_m == (0.01, 0.05)


def walking(name, n, every, frame="world"):
    """A head that moves from report to report, and a wrist that is passed on until each ``every``-th."""
    xyz = np.full((20, 3), np.nan)
    xyz[Point.HEAD] = 1.0 + 0.01 * n, 2.0, 1.6
    xyz[Point.R_WRIST] = 1.0 + 0.01 * (n // every), 2.0, 1.1
    xyz[Point.L_WRIST] = 0.0
    measured = 1 << Point.HEAD | 1 << Point.R_WRIST | 1 << Point.L_WRIST
    return ReportedPerson(name, xyz, np.full(20, np.nan), measured)


def test_points_that_are_passed_on_are_counted_and_the_key_is_named(tmp_path):
    """Of 60 reports, each with two readings of a and one of b that differ: a's wrist changes 20 times."""
    people = [
        PeopleReport(
            n * NANO // 50 + 1, n * NANO // 50 + 1, "world", True, (walking("a", n, 3), walking("b", n, 1))
        )
        for n in range(60)
    ]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*joint_states(), *people]))
    assert found.repeated_points == pytest.approx(40 / 240)
    assert found.points == {"head": 1.0, "r_wrist": 1.0}
    (line,) = [line for line in found.lines() if line.startswith("exactly where they stood before: ")]
    assert "16.7% of the measured points" in line and 'people.repeated_points = "measured"' in line
    key, _, value = line.split(" in the cell")[0].rpartition(" = ")
    assert getattr(
        Cell.from_table({"people": {"repeated_points": value.strip('"')}}).people, key.split(".")[-1]
    )
    moving = [PeopleReport(n + 1, n + 1, "world", True, (walking("a", n, 1),)) for n in range(9)]
    found = inspect_recording(write_all(tmp_path / "b.mcap", [*joint_states(), *moving]))
    assert found.repeated_points == 0.0 and "stood before" not in "".join(found.lines())


def test_another_person_or_frame_is_no_reading_before(tmp_path):
    people = [
        PeopleReport(n + 1, n + 1, frame, True, (walking(name, 0, 1),))
        for n, (name, frame) in enumerate([("a", "world"), ("b", "world"), ("a", "camera"), ("a", "world")])
    ]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*joint_states(), *people]))
    assert found.repeated_points == pytest.approx(2 / 8)


def test_an_empty_recording_can_be_looked_at(tmp_path):
    found = inspect_recording(write_all(tmp_path / "a.mcap", []))
    assert (found.duration_s, found.topics, found.joints) == (0.0, (), ())
    assert found.lines()


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK")
    with pytest.raises(RecordingError, match="is not an MCAP file; `stopproof import`"):
        inspect_recording(tmp_path / "a.zip")


def test_robot_is_guessed_by_its_joints():
    arms = {"a": ("j1", "j2"), "b": ("j1", "j2", "j3"), "c": ("k1",)}
    assert guess_robots({"j1", "j2"}, arms) == ("a",)
    assert guess_robots({"j1", "j2", "j3", "finger"}, arms) == ("a", "b")
    assert guess_robots({"j1"}, arms) == ()
    assert guess_robots(set(), arms) == ()


def test_catalogue_knows_its_joints():
    arms = catalogue()
    assert arms["panda"] == tuple(f"panda_joint{n}" for n in range(1, 8))
    assert len(arms["ur5"]) == 6


def test_guess_is_the_stated_robot_else_the_only_candidate(tmp_path):
    panda = joint_states(names=tuple(f"panda_joint{n}" for n in range(1, 8)))
    found = inspect_recording(write_all(tmp_path / "panda.mcap", panda))
    assert (found.robot, found.robot_guess) == (None, "panda")
    ur = joint_states(names=catalogue()["ur5"])
    found = inspect_recording(write_all(tmp_path / "ur.mcap", ur))
    assert set(found.robot_candidates) == {"ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e"}
    assert found.robot_guess is None
    found = inspect_recording(write_all(tmp_path / "ur5.mcap", ur, lambda w: w.describe({"robot": "ur5"})))
    assert found.robot_guess == "ur5"


def test_json_and_text(tmp_path):
    single = joint_states()[:1]
    found = inspect_recording(write_all(tmp_path / "a.mcap", [*single, *reports()]))
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert json.loads(text)["topics"][0]["rate_hz"] is None
    lines = found.lines()
    assert all("\n" not in line for line in lines)
    assert any(line.startswith("/people: stopproof.People (json), 101 messages") for line in lines)
    assert "position error: 0.01 m" in lines
