"""Windows of a recording: nothing lost, nothing twice, in order."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.verifier.recordings.samples import JOINTS, NANO, joint_states, reports, write_all
from verifier.recordings import Reading, Recording, RecordingError, new_recording
from verifier.recordings.joint_state import JointState, encode
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.people_stream import PeopleStream

EPOCH = 1_700_000_000 * NANO


@pytest.fixture
def recording(tmp_path):
    return Recording(
        write_all(tmp_path / "a.mcap", [*joint_states(start_ns=EPOCH), *reports(start_ns=EPOCH)])
    )


@pytest.mark.parametrize("length", [0.1, 0.333, 0.5, 1.0, 2.0, 100.0])
@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (0.2, 0.7), (5.0, 5.0)])
def test_windows_cover_everything_once(recording, length, before, after):
    states, seen = joint_states(start_ns=EPOCH), reports(start_ns=EPOCH)
    reading = Reading(recording, JOINTS)
    windows = list(reading.windows(length, before, after))
    assert [w.last for w in windows] == [False] * (len(windows) - 1) + [True]
    assert windows[0].start == 0.0
    assert windows[-1].end == 2.0
    for one, two in pairwise(windows):
        assert one.end == two.start
    for w in windows:
        want = [
            s
            for s in states
            if w.start - before - 1e-9 <= (s.stamp_ns - EPOCH) / NANO <= w.end + after + 1e-9
        ]
        np.testing.assert_array_equal(w.t, [(s.stamp_ns - EPOCH) / NANO for s in want])
        np.testing.assert_array_equal(w.q, [s.position for s in want])
    arrived = [r.arrived for w in windows for r in w.people]
    assert arrived == [(r.arrived_ns - EPOCH) / NANO for r in seen]
    for w in windows[:-1]:
        assert all(w.start <= r.arrived < w.end for r in w.people)
        ahead = [
            (r.arrived_ns - EPOCH) / NANO
            for r in seen
            if (r.arrived_ns - EPOCH) / NANO >= w.end and (r.stamp_ns - EPOCH) / NANO <= w.end + after + 1e-9
        ]
        assert [r.arrived for r in w.people_ahead] == pytest.approx(ahead)


def test_a_report_that_arrives_seconds_after_the_window_was_seen_in_it(tmp_path):
    late = [replace(r, arrived_ns=r.stamp_ns + 3 * NANO) for r in reports(seconds=0.1)]
    path = write_all(tmp_path / "a.mcap", [*joint_states(seconds=8.0), *late])
    windows = list(Reading(Recording(path), JOINTS).windows(1.0, 0.0, 0.5))
    assert len(windows[0].people_ahead) == len(late)
    assert [len(w.people) for w in windows] == [0, 0, 0, len(late), 0, 0, 0, 0]


def test_a_report_on_another_clock_is_noted_and_not_taken(tmp_path):
    seen = reports()
    seen[50] = replace(seen[50], stamp_ns=seen[50].stamp_ns + 11 * NANO)
    reading = Reading(Recording(write_all(tmp_path / "a.mcap", [*joint_states(), *seen])), JOINTS)
    (window,) = reading.windows(100.0, 0.0, 0.0)
    assert len(window.people) == len(seen)
    left = window.people[50]  # who is in it, and by when
    assert left.stamp == left.arrived == 1.02 and not left.complete
    assert [person.id for person in left.people] == ["p1"]
    assert np.isnan(left.people[0].xyz).all() and left.people[0].measured == 0
    assert reading.not_taken_count == 1
    assert "10 to 100 s apart, more than 10 s" in reading.not_taken[0].reason


@pytest.mark.parametrize(("factor", "unit"), [(10**3, "ms"), (10**6, "µs"), (10**9, "ns")])
def test_a_stamp_in_another_unit_is_named(tmp_path, factor, unit):
    seen = [replace(r, stamp_ns=min(r.stamp_ns * factor, 2**63 - 1)) for r in reports(seconds=8.0)]
    reading = Reading(Recording(write_all(tmp_path / "a.mcap", [*joint_states(seconds=8.0), *seen])), JOINTS)
    list(reading.windows(100.0, 0.0, 0.0))
    assert reading.not_taken_count > 100
    assert f"it looks like {unit}: stamps are in s" in reading.not_taken[-1].reason


@pytest.mark.parametrize("factor", [10**3, 10**6])
def test_the_unit_of_the_first_report_is_named_where_its_clock_ran_before(tmp_path, factor):
    start = 10**9 * NANO // factor
    seen = [replace(r, stamp_ns=r.arrived_ns * factor) for r in reports(start_ns=start, delay_s=0.0)]
    path = write_all(tmp_path / "a.mcap", [*joint_states(start_ns=start), *seen])
    with pytest.raises(
        RecordingError, match=r"the first because: .* \(it looks like (ms|µs): stamps are in s"
    ):
        Reading(Recording(path), JOINTS)


@pytest.mark.parametrize(
    ("offset_s", "late"), [(11.0, 0), (99.97, 0), (1e3, 0), (1e5, 0), (11.0, 30), (99.97, 30)]
)
def test_clocks_that_differ_are_no_unit(tmp_path, offset_s, late):
    """Near 0 there is always a report whose stamp is a thousand message times."""
    seen = [
        replace(r, stamp_ns=r.stamp_ns + round(offset_s * NANO) * (n >= late))
        for n, r in enumerate(reports(rate_hz=100.0, seconds=12.0))
    ]
    path = write_all(tmp_path / "a.mcap", [*joint_states(seconds=12.0), *seen])
    stream = PeopleStream(McapFile(path), {})
    for message in McapFile(path).messages(["/people"]):
        stream.report(message)
    assert stream.flaw_count == len(seen) - late
    assert not any("looks like" in flaw.reason for flaw in stream.flaws)


def test_what_cannot_be_read_begins_the_overlap_as_well(tmp_path):
    seen = [replace(r, stamp_ns=r.stamp_ns + 11 * NANO * (r.stamp_ns < NANO)) for r in reports()]
    reading = Reading(Recording(write_all(tmp_path / "a.mcap", [*joint_states(), *seen])), JOINTS)
    assert reading.overlap == (0.02, 2.0)


def test_report_becomes_what_the_gate_takes(recording):
    window = next(Reading(recording, JOINTS).windows(10.0, 0.0, 0.0))
    report = window.people[25]
    assert (report.stamp, report.arrived, report.frame, report.complete) == (0.5, 0.52, "world", True)
    (person,) = report.people
    assert (person.id, person.measured) == ("p1", 1 << 11)
    np.testing.assert_allclose(person.xyz[11], [1.5, 2.0, 3.0])
    assert np.isnan(np.delete(person.xyz, 11, axis=0)).all()
    assert person.error_m[11] == 0.01


def test_joints_come_in_the_order_asked_for(recording):
    t, q = _motion(recording, JOINTS)
    backwards = _motion(recording, JOINTS[::-1])
    np.testing.assert_array_equal(backwards[1], q[:, ::-1])
    np.testing.assert_array_equal(backwards[0], t)


def _motion(recording, joints):
    (window,) = Reading(recording, joints, people=False).windows(100.0, 0.0, 0.0)
    return window.t, window.q


def test_two_publishers_and_changing_order(tmp_path):
    arm = joint_states()
    gripper = [JointState(s.stamp_ns + 1_000_000, ("finger",), np.zeros(1)) for s in arm[:-1:4]]
    turned = [
        JointState(s.stamp_ns, (*s.names[::-1], "extra"), np.append(s.position[::-1], 9.0)) if n % 3 else s
        for n, s in enumerate(arm)
    ]
    plain = Recording(write_all(tmp_path / "plain.mcap", arm))
    mixed = Recording(write_all(tmp_path / "mixed.mcap", [*turned, *gripper]))
    reading = Reading(mixed, JOINTS, people=False)
    assert set(reading.extra_joints) == {"finger", "extra"}
    (window,) = reading.windows(100.0, 0.0, 0.0)
    t, q = _motion(plain, JOINTS)
    np.testing.assert_array_equal(window.t, t)
    np.testing.assert_array_equal(window.q, q)


def test_joints_without_names_are_taken_in_order(tmp_path):
    states = [JointState(s.stamp_ns, (), s.position) for s in joint_states()]
    reading = Reading(Recording(write_all(tmp_path / "a.mcap", states)), JOINTS, people=False)
    assert reading.assumed_order
    (window,) = reading.windows(100.0, 0.0, 0.0)
    np.testing.assert_array_equal(window.q, [s.position for s in states])
    with pytest.raises(RecordingError, match="has 2 positions for 3 joints; the robot has 3: a, b, c"):
        Reading(Recording(tmp_path / "a.mcap"), ("a", "b", "c"), people=False)


def test_joint_stamps_ahead_of_their_messages_lose_no_report(tmp_path):
    path = tmp_path / "a.mcap"
    source = Recording(write_all(tmp_path / "in.mcap", [*joint_states(), *reports(delay_s=0.0)]))
    with new_recording(path) as writer:
        for m in source.file.messages():
            schema = source.file.schemas[m.channel.schema_id]
            if m.channel.topic == "/joint_states":
                state = JointState(m.log_time + NANO // 2, JOINTS, np.zeros(2))
                writer.copy(m._replace(data=encode(state)), schema)
            else:
                writer.copy(m, schema)
    reading = Reading(Recording(path), JOINTS)
    assert reading.epoch_ns == NANO // 2
    for window in reading.windows(0.25, 0.0, 0.0):
        wanted = [n / 50 - 0.5 for n in range(101) if window.start <= n / 50 - 0.5 < window.end]
        if window.start > 0.0 and not window.last:
            assert [r.arrived for r in window.people] == pytest.approx(wanted)


def test_overlap(tmp_path):
    path = write_all(tmp_path / "a.mcap", [*joint_states(), *reports(start_ns=NANO // 2, seconds=1.0)])
    assert Reading(Recording(path), JOINTS).overlap == (0.5, 2.0)
    assert Reading(Recording(path), JOINTS, people=False).overlap == (0.0, 2.0)


def test_decoding_is_timed_apart(recording):
    reading = Reading(recording, JOINTS)
    before = reading.decode_seconds
    list(reading.windows(0.5, 0.0, 0.0))
    assert 0.0 < before < reading.decode_seconds < 5.0


@pytest.mark.parametrize(
    "numbers", [(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (1.0, -1.0, 0.0), (1.0, 0.0, math.nan)]
)
def test_impossible_windows_are_refused(recording, numbers):
    with pytest.raises(ValueError, match="a window of"):
        next(Reading(recording, JOINTS).windows(*numbers))
