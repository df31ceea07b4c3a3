"""Containers written by other libraries come back message for message."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.verifier.recordings.bags import (
    WRITERS,
    joint_item,
    text_item,
    write_foreign_mcap,
    write_ros1,
    write_ros2,
)
from tests.verifier.recordings.samples import joint_states
from verifier.recordings import RecordingError
from verifier.recordings.containers import open_container

LINE = "=" * 80 + "\n"
START = 1_700_000_000_123_456_789


def sample_items(seconds: float = 1.0):
    states = joint_states(100.0, seconds, START)
    items = [joint_item(state, arrived_ns=state.stamp_ns + 1_234_567) for state in states]
    items += [text_item("/note", START + n * 50_000_001, f"ä{n}") for n in range(9)]
    return states, sorted(items, key=lambda item: item[2])


@pytest.mark.parametrize("kind", WRITERS)
def test_every_message_comes_back_to_the_nanosecond(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    states, items = sample_items()
    container = open_container(write(tmp_path / name, items))
    assert container.damage is None
    assert [(t.name, t.schema, t.messages) for t in container.topics] == [
        ("/joint_states", "sensor_msgs/msg/JointState", 101),
        ("/note", "std_msgs/msg/String", 9),
    ]
    got = list(container.messages(["/joint_states"]))
    assert [m.log_time_ns for m in got] == [state.stamp_ns + 1_234_567 for state in states]
    for message, state in zip(got, states, strict=True):
        stamp = message.value.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == state.stamp_ns
        assert tuple(message.value.name) == state.names
        assert np.array_equal(message.value.position, state.position)
        assert (message.topic, message.schema) == ("/joint_states", "sensor_msgs/msg/JointState")
    notes = [(m.log_time_ns, m.value.data) for m in container.messages(["/note"])]
    assert notes == [(START + n * 50_000_001, f"ä{n}") for n in range(9)]


@pytest.mark.parametrize("kind", WRITERS)
def test_messages_of_several_topics_come_in_order_of_time(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    _states, items = sample_items()
    container = open_container(write(tmp_path / name, items))
    times = [m.log_time_ns for m in container.messages(["/joint_states", "/note"])]
    assert times == sorted(item[2] for item in items)
    assert [r.log_time_ns for r in container.records()] == times


@pytest.mark.parametrize("kind", ["ros1", "mcap", "ros2 sqlite"])
def test_messages_that_stand_in_another_order_are_sorted(tmp_path: Path, kind: str) -> None:
    """Chunks overlap in time: whoever buffers topics apart writes them so."""
    name, write = WRITERS[kind]
    _states, items = sample_items()
    shuffled = [*items[60:], *items[:60]]
    container = open_container(write(tmp_path / name, shuffled))
    records = list(container.records())
    assert [r.log_time_ns for r in records] == sorted(item[2] for item in items)
    assert any(a.place > b.place for a, b in pairwise(records))


def test_a_bag_in_parts_is_read_as_one(tmp_path: Path) -> None:
    _states, items = sample_items()
    whole = write_ros2(tmp_path / "a", items[:50])
    second = write_ros2(tmp_path / "b", items[50:])
    (second / "b.db3").rename(whole / "a_1.db3")
    text = (whole / "metadata.yaml").read_text()
    text = text.replace("- a.db3\n", "- a.db3\n  - a_1.db3\n", 1)
    (whole / "metadata.yaml").write_text(text)
    container = open_container(whole)
    assert [r.log_time_ns for r in container.records()] == [item[2] for item in items]
    assert "metadata.yaml says" in str(container.damage)  # its numbers are those of the first part


def test_a_storage_file_alone_is_read(tmp_path: Path) -> None:
    _states, items = sample_items()
    folder = write_ros2(tmp_path / "a", items)
    container = open_container(folder / "a.db3")
    assert container.damage is None
    assert len(list(container.records())) == len(items)


def test_types_come_from_the_file_and_may_be_anybodys(tmp_path: Path) -> None:
    """The same name as a common type, another layout: a fixed table of types would read nonsense."""
    import rosbags.rosbag1 as ros1

    text = (
        "uint8 kind\nfloat64[] where\nour_msgs/Inner[] inner\n"
        + "=" * 80
        + "\nMSG: our_msgs/Inner\nstring s\n"
    )
    data = struct.pack("<BIdd", 7, 2, 1.5, -2.5) + struct.pack("<II", 1, 2) + b"ab"
    with ros1.Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/x", "sensor_msgs/msg/JointState", msgdef=text, md5sum="*")
        writer.write(connection, 5, data)
    (message,) = open_container(tmp_path / "a.bag").messages(["/x"])
    assert (message.value.kind, message.value.where.tolist()) == (7, [1.5, -2.5])
    assert [each.s for each in message.value.inner] == ["ab"]


BAD_DEFINITIONS = {
    "not a language": ("}{ import os", "cannot be read"),
    "contains itself": (
        f"our_msgs/A[] a\n{LINE}MSG: our_msgs/A\nour_msgs/A a\n",
        "contains itself",
    ),
    "a list of nothing": (f"our_msgs/A[] a\n{LINE}MSG: our_msgs/A\nuint8 X=1\n", "holds nothing"),
    "an endless list": ("string[999999999] a\n", "more than 4096"),
    "an unknown part": ("our_msgs/Gone a\n", "cannot be read"),
    "too long": ("uint8 a\n" + "# x\n" * 100_000, "more than 262144 characters"),
}


@pytest.mark.parametrize("case", BAD_DEFINITIONS)
def test_definitions_that_are_none_are_named(tmp_path: Path, case: str) -> None:
    import rosbags.rosbag1 as ros1

    text, says = BAD_DEFINITIONS[case]
    with ros1.Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/x", "our_msgs/msg/B", msgdef=text, md5sum="*")
        writer.write(connection, 5, b"\0" * 64)
    container = open_container(tmp_path / "a.bag")
    with pytest.raises(RecordingError, match=says) as caught:
        list(container.messages(["/x"]))
    assert "/x, message at 5 ns: our_msgs/msg/B" in str(caught.value)
    assert len(list(container.records())) == 1


@pytest.mark.parametrize("data", [b"", b"\x03", struct.pack("<I", 2**31) + b"a", b"\xff" * 200])
def test_messages_that_do_not_follow_their_definition_are_named(tmp_path: Path, data: bytes) -> None:
    import rosbags.rosbag1 as ros1

    with ros1.Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/x", "our_msgs/msg/B", msgdef="string[] names\n", md5sum="*")
        writer.write(connection, 5, data)
    with pytest.raises(RecordingError, match="does not follow its definition"):
        list(open_container(tmp_path / "a.bag").messages(["/x"]))


def test_bags_of_ros2_without_definitions_are_read_where_the_type_is_common(tmp_path: Path) -> None:
    """Before ROS 2 Iron the files hold none."""
    import sqlite3

    _states, items = sample_items()
    folder = write_ros2(tmp_path / "a", items)
    with sqlite3.connect(folder / "a.db3") as database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    container = open_container(folder)
    assert len(list(container.messages(["/joint_states"]))) == 101
    with sqlite3.connect(folder / "a.db3") as database:
        database.execute("UPDATE topics SET type = 'our_msgs/msg/B'")
    database.close()
    (folder / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match="does not say how our_msgs/msg/B is laid out"):
        next(open_container(folder).messages(["/joint_states"]))


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.bag", b"", "is not a ROS 1 bag of version 2.0"),
        ("a.bag", b"#ROSBAG V1.2\n" + b"x" * 99, "rosbag fix"),
        ("a.db3", b"", "is not a SQLite database"),
        ("a.mcap", b"", "is not an MCAP file"),
        ("a.txt", b"hello", "is not an MCAP file"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=says):
        open_container(tmp_path / name)


def test_what_is_not_there_or_empty_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not exist"):
        open_container(tmp_path / "gone.bag")
    with pytest.raises(RecordingError, match=r"without metadata\.yaml, \.db3 or \.mcap"):
        open_container(tmp_path)


def test_a_database_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    import sqlite3

    with sqlite3.connect(tmp_path / "a.db3") as database:
        database.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) "
            "SELECT x AS topic_id, x AS timestamp, x AS data FROM c"
        )
    database.close()
    with pytest.raises(RecordingError, match="has no table messages"):
        open_container(tmp_path / "a.db3")


def test_an_mcap_of_a_ros2_bag_alone_is_read(tmp_path: Path) -> None:
    _states, items = sample_items()
    folder = write_ros2(tmp_path / "a", items, StoragePlugin.MCAP)
    assert len(list(open_container(folder / "a.mcap").records())) == len(items)


def test_the_real_bags_hold_what_others_have_read_from_them(real_data: Path) -> None:
    """People of the SaRA experiments: the NPZ beside them was made by another program."""
    for bag, npz in (("exp_appraoching", "approaching"), ("exp_headbutt", "headbutt")):
        container = open_container(real_data / "human_robot" / "original" / f"{bag}.bag")
        assert container.damage is None
        messages = list(container.messages(["/SaRA_demo_human_capsules"]))
        xyz = np.array([[(p.x, p.y, p.z) for p in m.value.positions] for m in messages], np.float32)
        other = np.load(real_data / "human_robot" / f"sara_exp_{npz}.npz")
        assert np.array_equal(xyz, other["xyz"])
        times = np.array([m.log_time_ns - messages[0].log_time_ns for m in messages]) / 1e9
        assert np.abs(times - (other["t"] - other["t"][0])).max() < 1e-6


def test_nothing_is_written_beside_what_is_read(tmp_path: Path) -> None:
    _states, items = sample_items()
    folder = write_ros2(tmp_path / "a", items)
    write_ros1(tmp_path / "b.bag", items)
    write_foreign_mcap(tmp_path / "c.mcap", items)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    for path in (folder, tmp_path / "b.bag", tmp_path / "c.mcap"):
        list(open_container(path).records())
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
