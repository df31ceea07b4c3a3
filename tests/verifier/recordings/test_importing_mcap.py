"""Import from MCAP: what verify would refuse or count is refused or said."""

import math
from dataclasses import replace

import numpy as np
import pytest

from occupancy.body import Point
from tests.verifier.recordings.imports import (
    ROBOT,
    SETTINGS,
    imported,
    people_file,
    raw_people,
    report_text,
    written,
)
from tests.verifier.recordings.samples import NANO, joint_states, person, reports, write_all
from verifier.recordings import (
    PeopleFile,
    Place,
    Recording,
    RecordingError,
    import_recording,
    new_recording,
)
from verifier.recordings.joint_state import JointState
from verifier.recordings.mcap_file import Channel, McapFile, Message
from verifier.recordings.people_report import PeopleReport
from verifier.recordings.reading import Reading


def test_joints_of_an_mcap_are_copied_with_every_other_topic(tmp_path, people):
    start = 1_700_000_000 * NANO
    states = joint_states(start_ns=start, names=ROBOT)

    def also(writer):
        writer.verdict(start, {"old": True})
        channel = Channel(id=0, topic="/wrench", message_encoding="cdr", metadata={"a": "b"}, schema_id=0)
        for n in range(3):
            writer.copy(Message(channel, start + n * NANO, start, 0, bytes([n])), None)

    source = write_all(tmp_path / "in.mcap", [*states, *reports(start_ns=start)], also)
    _, reading, window = imported(tmp_path, source, [PeopleFile(people)])
    assert reading.epoch_ns == start
    assert reading.overlap == (0.0, 2.0)
    np.testing.assert_array_equal(window.q, [s.position for s in states])
    assert {r.people[0].id for r in window.people} == {"p1"}
    file = McapFile(tmp_path / "out.mcap")
    wrench = list(file.messages(["/wrench"]))
    assert [(m.log_time, m.data) for m in wrench] == [(start + n * NANO, bytes([n])) for n in range(3)]
    assert wrench[0].channel.metadata == {"a": "b"}
    assert not list(file.messages(["/verdict"]))


def test_people_of_an_mcap_keep_their_delay(tmp_path, joints):
    source = write_all(tmp_path / "in.mcap", reports(start_ns=55 * NANO, delay_s=0.03))
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source, Place(0.0, 0.0, 1.0))])
    assert summary.people == ("p1",)
    assert [r.stamp for r in window.people] == pytest.approx(np.arange(101) / 50)
    assert [r.arrived for r in window.people] == pytest.approx(np.arange(101) / 50 + 0.03)
    np.testing.assert_allclose(window.people[0].people[0].xyz[Point.R_WRIST], [1.0, 2.0, 4.0])
    assert window.people[0].people[0].error_m[Point.R_WRIST] == 0.01


def test_people_of_an_mcap_in_two_frames_are_refused(tmp_path, joints):
    people = [
        PeopleReport(r.stamp_ns, r.arrived_ns, f"f{n % 2}", True, (person(),))
        for n, r in enumerate(reports())
    ]
    source = write_all(tmp_path / "in.mcap", people)
    with pytest.raises(RecordingError, match="is in the frames f0 and f1; one place needs one frame"):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)
    assert not (tmp_path / "out.mcap").exists()


def test_mcap_without_people_is_refused(tmp_path, joints):
    source = write_all(tmp_path / "in.mcap", joint_states())
    with pytest.raises(RecordingError, match="has no messages on /people"):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)


# An MCAP source is refused for what verify refuses, in the same words.


def bad_joints(path, kind):
    states = joint_states(start_ns=NANO, names=ROBOT)
    stamps = [state.stamp_ns for state in states]
    if kind in ("nan", "infinite"):
        states[150].position[1] = math.nan if kind == "nan" else -math.inf
    elif kind == "repeats":
        stamps[150] = stamps[149]
    elif kind == "lacks":
        states[150] = JointState(stamps[150], ROBOT[:1], np.zeros(1))
    else:
        stamps[150] -= NANO // 20
    return written(path, states, stamps)


@pytest.mark.parametrize("with_people", [False, True])
@pytest.mark.parametrize("kind", ["backwards", "repeats", "nan", "infinite", "lacks"])
def test_joints_of_an_mcap_are_refused_as_verify_refuses_them(tmp_path, kind, with_people):
    """Also where the bad sample is outside of the stretch that is written."""
    source = bad_joints(tmp_path / "in.mcap", kind)
    with pytest.raises(RecordingError) as verified:
        list(Reading(Recording(source), ROBOT, people=False).windows(0.5, 0.1, 0.1))
    sources = [PeopleFile(people_file(tmp_path / "p.npz", seconds=1.0))] if with_people else []
    out = tmp_path / "out.mcap"
    with pytest.raises(RecordingError) as imports:
        import_recording(out, source, sources, SETTINGS)
    assert str(imports.value) == str(verified.value)
    assert str(imports.value).startswith(f"{source}: /joint_states, ")
    assert not out.exists()


def test_long_joints_of_an_mcap_are_checked_to_the_end(tmp_path):
    states = joint_states(seconds=25.0, names=ROBOT)
    good = import_recording(tmp_path / "o.mcap", written(tmp_path / "a.mcap", states), [], SETTINGS)
    assert good.joint_samples == len(states) == 2501
    for row in (1000, 1001, 2400, 2500):
        stamps = [state.stamp_ns for state in states]
        stamps[row] = stamps[row - 1]
        source = written(tmp_path / "b.mcap", states, stamps)
        with pytest.raises(RecordingError, match=rf"{(row - 1) / 100:.6f} s after .*: time repeats"):
            import_recording(tmp_path / "p.mcap", source, [], SETTINGS)
        source.unlink()


@pytest.mark.parametrize("kind", ["two clocks", "no names", "no points", "no report"])
def test_people_of_an_mcap_are_refused_as_verify_refuses_them(tmp_path, joints, kind):
    if kind == "two clocks":
        people = [replace(r, arrived_ns=r.arrived_ns + 60 * NANO) for r in reports()]
        source = write_all(tmp_path / "in.mcap", [*joint_states(names=ROBOT), *people])
    else:
        points = {"nose": {"xyz": [1, 2, 3], "state": "measured"}} if kind == "no names" else {}
        text = "[]" if kind == "no report" else ""
        texts = [text or report_text(n, {"id": "a", "points": points}) for n in range(101)]
        raw_people(tmp_path / "people.mcap", *texts)
        source = tmp_path / "in.mcap"
        with new_recording(source) as writer:
            for state in joint_states(names=ROBOT):
                writer.joints(state)
            for message in McapFile(tmp_path / "people.mcap").messages():
                writer.copy(message, None)
    with pytest.raises(RecordingError) as verified:
        Reading(Recording(source), ROBOT)
    with pytest.raises(RecordingError) as imports:
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)
    assert str(imports.value) == str(verified.value)


def test_what_could_not_be_read_of_reports_is_said(tmp_path, joints):
    """Of what verify counts in the source, nothing is gone without a word."""
    good = {"xyz": [1, 2, 3], "state": "measured"}
    texts = [report_text(n, {"id": "a", "points": {"head": good}}) for n in range(101)]
    texts[10] = report_text(10, {"id": "a", "points": {"head": {**good, "xyz": [1]}}})
    texts[20] = report_text(20, {"id": "a", "points": {"head": good, "pelvis": {**good, "xyz": [0, 0, 0]}}})
    texts[30] = report_text(30, {"id": "a", "points": {"head": good, "pelvis": {**good, "xyz": [None] * 3}}})
    texts[40] = report_text(40, {"id": "b", "points": {"head": good}, "position_error_m": -1})
    texts[50] = "[]"
    texts[60] = report_text(600, {"id": "c", "points": {"head": good}})  # 10.8 s ahead of its message
    source = raw_people(tmp_path / "people.mcap", *texts)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source)])
    assert (summary.missing_points, summary.unreadable_reports, summary.refused) == (2, 2, 2)
    assert summary.people == ("a", "b", "c")
    lines = summary.lines()
    assert "points that were NaN, infinite or zero and were left out: 2" in lines
    assert "reports that could not be read but for the names in them: 2" in lines
    (line,) = [line for line in lines if line.startswith("persons and points that could not be read")]
    assert line.endswith('left out: 2, the first: a, head: "xyz" must be three numbers, not [1]')
    stamps = {r.stamp: r.people for r in window.people}
    assert np.isnan(stamps[0.8][0].xyz).all() and stamps[0.8][0].id == "b"
    assert np.isnan(stamps[1.2][0].xyz).all() and stamps[1.2][0].id == "c"


def test_stamps_of_people_that_do_not_advance_stay_for_verify_to_count(tmp_path, joints):
    seen = reports()
    for n, earlier in ((30, 20), (50, 49), (70, 69)):
        seen[n] = replace(seen[n], stamp_ns=seen[earlier].stamp_ns)
    _, _, window = imported(tmp_path, joints, [PeopleFile(write_all(tmp_path / "in.mcap", seen))])
    assert [report.stamp for report in window.people] == [report.stamp_ns / NANO for report in seen]


def test_two_reports_of_one_instant_do_not_make_two_persons_of_one(tmp_path, joints):
    """Verify counts the second as one that does not advance; a new report is begun, as in the source."""
    people = [report for report in reports() for _ in range(2)]
    source = write_all(tmp_path / "in.mcap", people)
    other = people_file(tmp_path / "other.npz")
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source), PeopleFile(other)])
    assert summary.people == ("1/p1", "p2")
    assert {person.id for report in window.people for person in report.people} == {"1/p1", "p2"}


@pytest.mark.parametrize("lag_s", [-0.5, 0.03, 0.5])
def test_joints_of_an_mcap_are_chosen_by_their_stamps(tmp_path, lag_s):
    start = 100 * NANO
    joints = tmp_path / "in.mcap"
    with new_recording(joints) as writer:
        plain = write_all(tmp_path / "plain.mcap", joint_states(start_ns=start, names=ROBOT))
        for message in McapFile(plain).messages():
            moved = message._replace(log_time=message.log_time + round(lag_s * NANO))
            writer.copy(moved, McapFile(plain).schemas[message.channel.schema_id])
    people = write_all(tmp_path / "people.mcap", reports(start_ns=start))
    summary, reading, window = imported(tmp_path, joints, [PeopleFile(people)])
    assert summary.joint_samples == len(window.t) == 201
    assert reading.overlap == (0.0, 2.0)


def test_people_that_arrive_before_time_begins_are_refused(tmp_path, joints):
    ahead = [replace(r, arrived_ns=max(0, r.stamp_ns - 5 * NANO)) for r in reports(start_ns=6 * NANO)]
    people = write_all(tmp_path / "people.mcap", ahead)
    with pytest.raises(
        RecordingError,
        match=r"out\.mcap: a message would get the time -5\.000000 s; message times count from 0",
    ):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(people)], SETTINGS)
    assert not (tmp_path / "out.mcap").exists()


def test_who_is_named_in_a_report_that_cannot_be_read_is_imported(tmp_path, joints):
    plain = write_all(tmp_path / "plain.mcap", reports())
    with new_recording(tmp_path / "people.mcap") as writer:
        for number, message in enumerate(McapFile(plain).messages()):
            bad = b'{"stamp": "late", "people": [{"id": "p2"}]}'
            content = message._replace(data=bad) if number == 50 else message
            writer.copy(content, McapFile(plain).schemas[message.channel.schema_id])
    summary, _, window = imported(tmp_path, joints, [PeopleFile(tmp_path / "people.mcap")])
    assert summary.unreadable_reports == 1 and summary.people == ("p1", "p2")
    assert "reports that could not be read but for the names in them: 1" in summary.lines()
    (report,) = (r for r in window.people if r.people[0].id == "p2")
    assert report.stamp == pytest.approx(1.02)
    assert np.isnan(report.people[0].xyz).all()
