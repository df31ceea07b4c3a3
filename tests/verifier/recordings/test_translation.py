"""Foreign recordings become ours message by message, and the verdicts are those of the neutral format."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.records import Schema

from tests.verifier.recordings.bags import (
    WRITERS,
    Item,
    all_items,
    in_time,
    joint_item,
    people_item,
    text_item,
    write_foreign_mcap,
    write_ros1,
    write_ros2,
)
from tests.verifier.recordings.samples import JOINTS, joint_states, reports, write_all
from verifier.recordings import Choice, Recording, RecordingError, joint_state
from verifier.recordings.joint_state import JointState, decode
from verifier.recordings.mcap_file import McapWriter
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC

START = 1_700_000_000_123_456_789


def everything(recording: Recording) -> list[tuple[str, int, bytes]]:
    messages = recording.file.messages([JOINT_TOPIC, PEOPLE_TOPIC])
    return sorted((m.channel.topic, m.log_time, m.data) for m in messages)


def samples(seconds: float = 1.0):
    states = joint_states(100.0, seconds, START)
    rates = [replace(s, velocity=s.position + 1, effort=s.position * 2, frame="base") for s in states]
    return rates, reports(50.0, seconds, START)


@pytest.mark.parametrize("kind", WRITERS)
def test_ours_through_another_container_comes_back_without_loss(tmp_path: Path, kind: str) -> None:
    """Bytes and times: what verify reads is the same, whatever it came in."""
    states, people = samples()
    ours = Recording(write_all(tmp_path / "ours.mcap", [*states, *people]))
    name, write = WRITERS[kind]
    path = write(tmp_path / name, all_items(states, people))
    foreign = Recording(path)
    assert everything(foreign) == everything(ours)
    assert foreign.path == path
    assert foreign.joint_names == ours.joint_names == JOINTS
    assert foreign.robot is None


def test_what_was_translated_is_said(tmp_path: Path) -> None:
    states, people = samples()
    recording = Recording(write_ros1(tmp_path / "a.bag", all_items(states, people)))
    assert [(a.name, a.value, str(a.certainty)) for a in recording.assumptions] == [
        ("recording.joints_topic", "/joint_states (sensor_msgs/msg/JointState)", "assumed"),
        ("recording.people_topic", "/people (std_msgs/msg/String)", "assumed"),
    ]


def test_ours_is_read_where_it_lies(tmp_path: Path) -> None:
    states, people = samples()
    path = write_all(tmp_path / "a.mcap", [*states, *people])
    assert Recording(path)._opened.folder is None
    assert not Recording(path).assumptions


def test_the_temporary_file_is_gone_with_the_recording(tmp_path: Path) -> None:
    states, people = samples()
    recording = Recording(write_ros1(tmp_path / "a.bag", all_items(states, people)))
    folder = Path(recording._opened.folder.name)
    assert folder.is_dir()
    del recording
    assert not folder.exists()


def with_prefix(prefix: str, states: list[JointState]) -> list[JointState]:
    return [replace(s, names=tuple(prefix + name for name in s.names)) for s in states]


def two_arms() -> list[Item]:
    states, people = samples()
    left = [replace(s, names=tuple(f"left_{name}" for name in s.names)) for s in states]
    right = [
        replace(s, names=tuple(f"right_{name}" for name in s.names), position=-s.position) for s in states
    ]
    return in_time([*map(joint_item, left), *map(joint_item, right), *map(people_item, people)])


def test_a_prefix_is_taken_off_and_said(tmp_path: Path) -> None:
    states, people = samples()
    named = with_prefix("ur5/", states)
    path = write_ros2(tmp_path / "a", in_time([*map(joint_item, named), *map(people_item, people)]))
    recording = Recording(path, Choice(arm=JOINTS))
    assert recording.joint_names == JOINTS
    assert "recording.joint_prefix" in {a.name for a in recording.assumptions}
    ours = Recording(write_all(tmp_path / "ours.mcap", [*states, *people]))
    assert everything(recording) == everything(ours)


def test_two_arms_are_refused_unless_one_is_chosen(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", two_arms())
    with pytest.raises(RecordingError, match="joints of the arm 2 times, after left_, right_; choose one"):
        Recording(path, Choice(arm=JOINTS))
    recording = Recording(path, Choice(arm=JOINTS, joint_prefix="right_"))
    first = [decode(m.data) for m in recording.file.messages([JOINT_TOPIC])]
    right = [state for state in first if state.names == JOINTS]
    states, _people = samples()
    assert len(right) == len(states)
    assert all(np.array_equal(a.position, -b.position) for a, b in zip(right, states, strict=True))
    with pytest.raises(RecordingError, match="has no joint that begins with up_"):
        Recording(path, Choice(arm=JOINTS, joint_prefix="up_"))


def test_a_prefix_in_one_of_our_files_is_taken_off_too(tmp_path: Path) -> None:
    states, people = samples()
    named = with_prefix("left_", states)
    path = write_all(tmp_path / "a.mcap", [*named, *people])
    assert Recording(path).joint_names == ("left_shoulder", "left_elbow")
    recording = Recording(path, Choice(arm=JOINTS))
    assert everything(recording) == everything(Recording(write_all(tmp_path / "b.mcap", [*states, *people])))


def test_several_topics_are_refused_unless_one_is_named(tmp_path: Path) -> None:
    states, people = samples()
    items = [joint_item(s, topic) for s in states for topic in ("/a/joint_states", "/b/joint_states")]
    path = write_foreign_mcap(tmp_path / "a.mcap", in_time([*items, *map(people_item, people)]))
    with pytest.raises(RecordingError, match=r"several topics with joints: /a/joint_states .*, /b/joint_st"):
        Recording(path)
    recording = Recording(path, Choice(joints_topic="/b/joint_states"))
    assert recording.assumptions[0].value == "/b/joint_states (sensor_msgs/msg/JointState)"
    assert str(recording.assumptions[0].certainty) == "declared"
    for topic, says in (("/c", "has no topic /c"), ("/people", "joints are read from")):
        with pytest.raises(RecordingError, match=says):
            Recording(path, Choice(joints_topic=topic))


def test_the_only_topic_needs_no_name_and_ours_goes_first(tmp_path: Path) -> None:
    states, people = samples()
    only = in_time([*(joint_item(s, "/ur/joint_states") for s in states), *map(people_item, people)])
    assert len(everything(Recording(write_ros1(tmp_path / "a.bag", only)))) == len(states) + len(people)
    both = in_time([*only, *map(joint_item, states)])
    recording = Recording(write_ros1(tmp_path / "b.bag", both))
    assert recording.assumptions[0].value == "/joint_states (sensor_msgs/msg/JointState)"


def test_text_is_not_taken_for_people_unless_it_is_on_our_topic_or_named(tmp_path: Path) -> None:
    states, people = samples()
    items = in_time([*map(joint_item, states), *(people_item(each, "/tracker") for each in people)])
    path = write_ros1(tmp_path / "a.bag", items)
    assert not Recording(path).has_people
    assert Recording(path, Choice(people_topic="/tracker")).has_people


def test_reports_are_kept_to_the_letter(tmp_path: Path) -> None:
    """Also such as cannot be read: verify judges them, and lists what it refuses."""
    states, _people = samples()
    texts = ['{"stamp": 1e', "", '{"people": [{"id": "p1"}, {"id": "p1"}]}']
    items = [
        *map(joint_item, states),
        *(text_item("/people", START + n, text) for n, text in enumerate(texts)),
    ]
    recording = Recording(write_ros2(tmp_path / "a", in_time(items)))
    assert [m.data.decode() for m in recording.file.messages([PEOPLE_TOPIC])] == texts


@pytest.mark.parametrize("kind", ["ros1", "ros2 sqlite", "mcap"])
def test_time_that_runs_backwards_in_the_file_is_refused(tmp_path: Path, kind: str) -> None:
    """Sorting by message time would hide it."""
    states, _people = samples()
    items = list(map(joint_item, [replace(s, stamp_ns=0) for s in states]))
    items = [(topic, schema, START + n * 10**7, made) for n, (topic, schema, _t, made) in enumerate(items)]
    items[40], items[41] = items[41], items[40]
    name, write = WRITERS[kind]
    path = write(tmp_path / name, items)
    with pytest.raises(RecordingError, match="time runs backwards"):
        list(JointTimes(Recording(path)))


class JointTimes:
    """All joint samples as verify takes them."""

    def __init__(self, recording: Recording) -> None:
        from verifier.recordings.joint_stream import JointStream

        self._messages = recording.file.messages([JOINT_TOPIC])
        self._stream = JointStream(recording, JOINTS)

    def __iter__(self) -> Any:
        return map(self._stream.take, self._messages)


def test_stamps_beyond_what_ours_can_hold_are_refused(tmp_path: Path) -> None:
    late = joint_states(100.0, 0.1, 3_000_000_000 * 10**9)
    late = [replace(s, names=("p_shoulder", "p_elbow")) for s in late]
    items = [joint_item(replace(s, stamp_ns=s.stamp_ns % 10**18), arrived_ns=s.stamp_ns) for s in late]
    path = write_ros1(tmp_path / "a.bag", items)
    with pytest.raises(RecordingError, match=r"stamp 3000000000\.0.*stamps of joints in 2038"):
        Recording(path)


def test_a_recording_without_joints_or_of_unknown_types_is_refused(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", [text_item("/note", 5, "x")])
    with pytest.raises(RecordingError, match=r"no topic with joints \(it has /note\); joints are read from"):
        Recording(path)


def test_other_topics_are_copied_where_they_are_wanted(tmp_path: Path) -> None:
    states, people = samples()
    items = in_time([*all_items(states, people), text_item("/note", START, "x")])
    path = write_ros1(tmp_path / "a.bag", items)
    assert {t.name for t in Recording(path).topics} == {JOINT_TOPIC, PEOPLE_TOPIC}
    recording = Recording(path, everything=True)
    (note,) = recording.file.messages(["/note"])
    assert (note.channel.message_encoding, note.log_time, note.data) == ("ros1", START, b"\1\0\0\0x")
    assert recording.file.schemas[note.channel.schema_id].name == "std_msgs/msg/String"


def test_what_an_mcap_says_of_itself_is_kept(tmp_path: Path) -> None:
    states, people = samples()
    named = with_prefix("left_", states)
    path = write_all(
        tmp_path / "a.mcap", [*named, *people], lambda writer: writer.describe({"robot": "ours"})
    )
    assert Recording(path, Choice(arm=JOINTS)).robot == "ours"


def test_json_of_ours_in_a_foreign_mcap(tmp_path: Path) -> None:
    """Joints under another name, people in our own words: the digits of a stamp are kept."""
    from mcap.reader import make_reader

    states, people = samples()
    path = write_all(tmp_path / "a.mcap", [*states, *people])
    recording = Recording(path, Choice(people_topic="/people", joint_prefix="should"))
    with path.open("rb") as stream:
        texts = [m.data for _s, _c, m in make_reader(stream).iter_messages(topics=["/people"])]
    assert [m.data for m in recording.file.messages([PEOPLE_TOPIC])] == texts
    assert json.loads(texts[0])["stamp"] == pytest.approx(START / 1e9)


SWAPPED = joint_state.SCHEMA.replace(
    b"float64[] position\nfloat64[] velocity", b"float64[] velocity\nfloat64[] position"
)
"""A definition of the same name, in which other numbers stand where the positions of ROS stand."""


@pytest.mark.parametrize("topic", ["/joint_states", "/arm/joint_states"])
@pytest.mark.parametrize("definition", [joint_state.SCHEMA, SWAPPED, b""])
def test_joint_states_are_read_by_the_definition_in_the_file(
    tmp_path: Path, topic: str, definition: bytes
) -> None:
    first, second = np.array([0.5, -0.25]), np.array([3.0, 4.0])
    position = second if definition == SWAPPED else first
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        schema = Schema(id=0, name=joint_state.SCHEMA_NAME, encoding="ros2msg", data=definition)
        channel = writer.channel(topic, schema, "cdr")
        for n in range(3):
            state = joint_state.JointState(START + n, ("a", "b"), first, second)
            writer.write(channel, START + n, joint_state.encode(state))
        writer.finish()
    recording = Recording(path)
    for message in recording.file.messages([JOINT_TOPIC]):
        np.testing.assert_array_equal(joint_state.decode(message.data).position, position)


def test_a_definition_of_joint_states_that_cannot_be_read_refuses(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        schema = Schema(id=0, name=joint_state.SCHEMA_NAME, encoding="ros2msg", data=b"no message")
        channel = writer.channel(JOINT_TOPIC, schema, "cdr")
        writer.write(channel, START, joint_state.encode(joint_state.JointState(START, ("a",), np.zeros(1))))
        writer.finish()
    with pytest.raises(RecordingError, match="its definition in the file cannot be read"):
        Recording(path)
