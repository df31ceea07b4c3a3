"""What a recording is refused for: one line with file, place, what is wrong and what would be right."""

import gc
import json
import math
import tracemalloc

import numpy as np
import pytest
from mcap.records import Schema

from tests.verifier.recordings.samples import JOINTS, NANO, joint_states, reports, write_all
from verifier.recordings import Reading, Recording, RecordingError, new_recording
from verifier.recordings.joint_state import JointState, encode
from verifier.recordings.mcap_file import Channel, Message
from verifier.recordings.people_report import PeopleReport


def refusal(path, joints=JOINTS, **options):
    """The one line with which a recording is refused, wherever that turns up."""
    with pytest.raises(RecordingError) as caught:
        for _window in Reading(Recording(path), joints, **options).windows(0.5, 0.1, 0.1):
            pass
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def write_raw(path, messages, states=()):
    """Joints, and messages of any kind: (topic, schema name, encoding, time, data)."""
    with new_recording(path) as writer:
        for state in states:
            writer.joints(state)
        for topic, schema, encoding, time, data in messages:
            channel = Channel(id=0, topic=topic, message_encoding=encoding, metadata={}, schema_id=1)
            record = Schema(id=0, name=schema, encoding="", data=b"")
            writer.copy(Message(channel, time, time, 0, data), record)
    return path


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_joint_value_that_is_no_number(tmp_path, value):
    states = joint_states()
    states[150].position[1] = value
    text = refusal(write_all(tmp_path / "a.mcap", states), people=False)
    assert text == (
        f"/joint_states, 1.500000 s after the first sample: joint elbow is {value}; "
        "every position must be a number"
    )


def test_a_joint_that_nobody_asked_for_may_be_anything(tmp_path):
    states = [
        JointState(s.stamp_ns, (*s.names, "finger"), np.append(s.position, math.nan)) for s in joint_states()
    ]
    path = write_all(tmp_path / "a.mcap", states)
    assert len(list(Reading(Recording(path), JOINTS, people=False).windows(0.5, 0.0, 0.0))) == 4


@pytest.mark.parametrize(
    ("shift", "wrong"),
    [(-10_000_000, "time repeats"), (-25_000_000, "time runs backwards")],
)
@pytest.mark.parametrize("row", [1, 50, 51, 100, 200])
def test_time_that_does_not_advance(tmp_path, shift, wrong, row):
    """``row`` is at the edges of windows and of flushes too."""
    states = joint_states(start_ns=NANO)
    path = tmp_path / "a.mcap"
    with new_recording(path) as writer:
        for number, state in enumerate(states):
            stamp = state.stamp_ns + (shift if number == row else 0)
            writer.joints(JointState(stamp, state.names, state.position))
    text = refusal(path, people=False)
    assert wrong in text
    assert "must increase" in text


def test_joints_missing(tmp_path):
    path = write_all(tmp_path / "a.mcap", joint_states())
    assert refusal(path, (*JOINTS, "wrist"), people=False) == (
        "/joint_states, message at 0 ns: lacks joint wrist (it has shoulder, elbow); "
        "a message with one of the robot's joints must have all of them"
    )
    assert refusal(path, ("a", "b"), people=False) == (
        "/joint_states: has none of a, b (it has shoulder, elbow); choose the robot that was recorded"
    )


def test_one_message_among_many_without_a_joint(tmp_path):
    states = joint_states()
    states[120] = JointState(states[120].stamp_ns, ("elbow",), np.zeros(1))
    assert "message at 1200000000 ns: lacks joint shoulder" in refusal(
        write_all(tmp_path / "a.mcap", states), people=False
    )


def test_a_joint_twice(tmp_path):
    states = [JointState(s.stamp_ns, ("elbow", "shoulder", "elbow"), np.zeros(3)) for s in joint_states()]
    assert "has joint elbow twice" in refusal(write_all(tmp_path / "a.mcap", states), people=False)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_as_many_positions_as_joints(tmp_path, count):
    states = [JointState(s.stamp_ns, s.names, np.zeros(count)) for s in joint_states()]
    assert f"has {count} positions for 2 joints" in refusal(
        write_all(tmp_path / "a.mcap", states), people=False
    )


def test_a_joint_message_that_is_cut(tmp_path):
    path = write_raw(
        tmp_path / "a.mcap", [("/joint_states", "sensor_msgs/msg/JointState", "cdr", 5, b"\x00\x01\x00\x00")]
    )
    assert refusal(path) == (
        "/joint_states, message at 5 ns: not plain CDR: the message begins with 00 01 00 00; "
        "it must be sensor_msgs/msg/JointState in cdr"
    )


def test_nothing_in_it(tmp_path):
    assert refusal(write_all(tmp_path / "a.mcap", [])) == (
        "is empty; a recording holds messages on /joint_states"
    )


def test_no_joints(tmp_path):
    text = refusal(write_all(tmp_path / "a.mcap", reports()))
    assert text.startswith(
        "has no messages on /joint_states (it has /people); record sensor_msgs/msg/JointState"
    )


def test_one_sample(tmp_path):
    assert "has one sample only" in refusal(write_all(tmp_path / "a.mcap", joint_states()[:1]), people=False)


def test_no_people(tmp_path):
    path = write_all(tmp_path / "a.mcap", joint_states())
    assert refusal(path) == (
        "has no messages on /people; record people, or state with verify --assume-nobody that nobody is there"
    )
    assert Reading(Recording(path), JOINTS, people=False).people_span is None


def test_no_overlap(tmp_path):
    path = write_all(tmp_path / "a.mcap", [*joint_states(), *reports(start_ns=5 * NANO)])
    assert refusal(path) == (
        "joints (0 … 2 s) and people (5 … 7 s) do not overlap in time; "
        "both must be on one clock; times are seconds since the first joint sample; "
        "if their clocks differ: `stopproof inspect` bounds their offset; state it as --time-offset S±ERR, "
        "or in the cell as time_offset_s in [recording] with people.clock_error_s"
    )


@pytest.mark.parametrize("topic", ["joints", "people"])
def test_two_clocks(tmp_path, topic):
    path = tmp_path / "a.mcap"
    with new_recording(path) as writer:
        for state in joint_states(start_ns=NANO):
            writer.joints(state)
        for report in reports(start_ns=NANO):
            if topic == "people":
                writer.people(
                    PeopleReport(report.stamp_ns, report.arrived_ns + 60 * NANO, "world", True, report.people)
                )
            else:
                writer.people(report)
    if topic == "joints":
        file = Recording(path).file
        moved = tmp_path / "b.mcap"
        with new_recording(moved) as writer:
            for m in file.messages():
                writer.copy(m._replace(log_time=m.log_time + 60 * NANO), file.schemas[m.channel.schema_id])
        path = moved
    text = refusal(path)
    assert text.startswith("/joint_states" if topic == "joints" else "/people")
    apart = {"joints": "stamps and message times are 60", "people": "message time are 10 to 100 s apart"}
    assert apart[topic] in text


def test_wrong_types(tmp_path):
    path = write_raw(tmp_path / "a.mcap", [("/joint_states", "JointState", "json", 5, b"{}")])
    assert refusal(path) == (
        "/joint_states: is JointState in json; it must be sensor_msgs/msg/JointState in cdr"
    )
    path = write_raw(tmp_path / "b.mcap", [("/people", "People", "cdr", 5, b"{}")], joint_states())
    assert refusal(path) == "/people: is People in cdr; it must be stopproof.People in json"


def people_messages(*contents):
    return [
        ("/people", "stopproof.People", "json", n * 10_000_000, content.encode())
        for n, content in enumerate(contents)
    ]


def report_text(stamp, people):
    return json.dumps({"stamp": stamp, "frame": "world", "complete": True, "people": people})


def test_no_readable_report(tmp_path):
    path = write_raw(tmp_path / "a.mcap", people_messages("{", "[]"), joint_states())
    assert refusal(path).startswith(
        "/people: none of its messages is readable, the first because: not JSON: "
    )


def test_no_known_point_name(tmp_path):
    points = {"RightHand": {"xyz": [1, 2, 3], "state": "measured"}}
    messages = people_messages(*(report_text(n / 100, [{"id": "a", "points": points}]) for n in range(5)))
    path = write_raw(tmp_path / "a.mcap", messages, joint_states())
    text = refusal(path)
    assert text.startswith("/people: has no known point name (it has RightHand); known are head, neck_base,")
    assert text.endswith("the cell can map others in people.point_names")
    mapped = Reading(Recording(path), JOINTS, point_names={"RightHand": "r_hand"})
    (window,) = mapped.windows(100.0, 0.0, 0.0)
    assert len(window.people) == 5


HEAD = {"head": {"xyz": [1, 2, 3], "state": "measured"}}
NOSE = {"nose": {"xyz": [1, 2, 3], "state": "measured"}}


@pytest.mark.parametrize("points", [{}, [], None])
@pytest.mark.parametrize("between", [0, 3])
def test_nobody_with_any_point(tmp_path, points, between):
    """Reports of nobody and reports that cannot be read between those of people change nothing."""
    texts = []
    for n in range(5):
        texts += [report_text(n / 100, []), "[]"][:between]
        texts += [report_text(n / 100, [{"id": "a", "points": points}])]
    path = write_raw(tmp_path / "a.mcap", people_messages(*texts), joint_states())
    text = refusal(path)
    assert text.startswith("/people: has no known point name (it has no point at all); known are head, ")


@pytest.mark.parametrize(
    "person",
    [
        {"points": HEAD},
        {"points": {"head": {"xyz": [None, None, None], "state": "measured"}}},
        {"points": {"head": {"xyz": [None, 1, 2], "state": "inferred"}, **NOSE}},
        {"points": {"head": "here"}},
        {"points": HEAD, "position_error_m": -1},
    ],
)
@pytest.mark.parametrize("others", [{}, NOSE])
def test_one_point_of_a_known_name_is_enough_and_everybody_stays(tmp_path, person, others):
    """Docs: a person of whom nothing is readable is there; a recording is refused for its names only."""
    people = [[{"id": "a", "points": others}]] * 5
    people[3] = [{"id": "b", **person}]
    messages = people_messages(*(report_text(n / 100, listed) for n, listed in enumerate(people)))
    path = write_raw(tmp_path / "a.mcap", messages, joint_states())
    (window,) = Reading(Recording(path), JOINTS).windows(100.0, 0.0, 0.0)
    assert [report.people[0].id for report in window.people] == ["a", "a", "a", "b", "a"]
    assert not any(np.isfinite(r.people[0].xyz).any() for r in window.people if r.people[0].id == "a")


def test_reports_of_nobody_are_good_reports(tmp_path):
    messages = people_messages(*(report_text(n / 100, []) for n in range(5)))
    path = write_raw(tmp_path / "a.mcap", messages, joint_states())
    (window,) = Reading(Recording(path), JOINTS).windows(100.0, 0.0, 0.0)
    assert [report.people for report in window.people] == [()] * 5


def test_single_bad_messages_are_counted_and_listed(tmp_path):
    good = {"head": {"xyz": [1, 2, 3], "state": "measured"}}
    strange = {"nose": {"xyz": [1, 2, 3], "state": "measured"}}
    messages = people_messages(
        "no json",
        report_text(0.01, [{"id": "a", "points": good}]),
        report_text(0.02, [{"id": "a", "points": {"head": {"xyz": [1], "state": "measured"}}}]),
        report_text(0.03, [{"id": "b", "points": strange}, {"id": "a", "points": good}]),
        "[]",
    )
    path = write_raw(tmp_path / "a.mcap", messages, joint_states())
    reading = Reading(Recording(path), JOINTS)
    (window,) = reading.windows(100.0, 0.0, 0.0)
    assert [report.stamp for report in window.people] == [0.01, 0.02, 0.03]
    listed = [(entry.stamp, entry.person, entry.point, entry.reason[:12]) for entry in reading.not_taken]
    assert listed == [
        (0.0, "", None, "not JSON: Ex"),
        (0.02, "a", "head", '"xyz" must b'),
        (0.03, "b", None, "no known poi"),
        (0.04, "", None, "not a JSON o"),
    ]
    assert reading.not_taken_count == 4
    assert reading.unknown_points == {"nose"}
    assert reading.people_span.first_ns == 10_000_000
    assert reading.people_span.last_ns == 30_000_000


def test_the_list_of_bad_messages_stays_short(tmp_path):
    messages = people_messages(report_text(0.0, []), *(["{"] * 1500))
    path = write_raw(tmp_path / "a.mcap", messages, joint_states(seconds=20.0))
    reading = Reading(Recording(path), JOINTS)
    list(reading.windows(5.0, 0.0, 0.0))
    assert len(reading.not_taken) == 1000
    assert reading.not_taken_count == 1500


def test_memory_does_not_grow_with_the_recording(tmp_path, monkeypatch):
    monkeypatch.setattr("verifier.recordings.mcap_file.CHUNK_SIZE", 1 << 16)

    def peak(seconds):
        items = [*joint_states(seconds=seconds), *reports(rate_hz=10.0, seconds=seconds)]
        path = write_all(tmp_path / f"{seconds}.mcap", items)
        del items
        return min(reading(path) for _ in range(2))  # threads that other tests left behind may take some too

    def reading(path):
        gc.collect()
        tracemalloc.start()
        for _window in Reading(Recording(path), JOINTS).windows(2.0, 0.2, 0.5):
            pass
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return used

    assert peak(40.0) < 1.3 * peak(20.0)


def test_stamps_that_run_backwards_under_message_times_that_do_not(tmp_path):
    states = joint_states()
    path = write_all(tmp_path / "a.mcap", states)
    moved = tmp_path / "b.mcap"
    file = Recording(path).file
    with new_recording(moved) as writer:
        for number, m in enumerate(file.messages()):
            stamp = states[number].stamp_ns - (25_000_000 if number == 120 else 0)
            state = JointState(stamp, JOINTS, states[number].position)
            writer.copy(m._replace(data=encode(state)), file.schemas[m.channel.schema_id])
    text = refusal(moved, people=False)
    assert text.startswith(
        "/joint_states, 1.175000 s after the first sample: time runs backwards by 0.015 s; "
    )


@pytest.mark.parametrize(("shift", "wrong"), [(10_000_000, "repeats"), (25_000_000, "runs backwards")])
def test_time_that_does_not_advance_where_the_order_of_joints_changes(tmp_path, shift, wrong):
    path = tmp_path / "a.mcap"
    states = joint_states()
    file = Recording(write_all(tmp_path / "in.mcap", states)).file
    with new_recording(path) as writer:
        for number, m in enumerate(file.messages()):
            late = number >= 100
            names = JOINTS[::-1] if late else JOINTS
            state = JointState(m.log_time - shift * late, names, states[number].position)
            writer.copy(m._replace(data=encode(state)), file.schemas[m.channel.schema_id])
    assert f"time {wrong}" in refusal(path, people=False)
