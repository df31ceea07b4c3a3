"""Recordings of other makers, written by an independent library (rosbags)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from verifier.recordings.joint_state import JointState
from verifier.recordings.people_report import PeopleReport, encode

NANO = 1_000_000_000
JOINT_STATE, STRING = "sensor_msgs/msg/JointState", "std_msgs/msg/String"
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)

Item = tuple[str, str, int, Any]
"""Topic, type, time of arrival [ns], message as a function of the type store."""


def joint_item(state: JointState, topic: str = "/joint_states", arrived_ns: int | None = None) -> Item:
    def made(store: Any) -> Any:
        types = store.types
        sec, nanosec = divmod(state.stamp_ns, NANO)
        stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        seq = {"seq": 0} if store is ROS1 else {}
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=state.frame, **seq)
        numbers = [np.asarray(each, np.float64) for each in (state.position, state.velocity, state.effort)]
        return types[JOINT_STATE](header, list(state.names), *numbers)

    return topic, JOINT_STATE, state.stamp_ns if arrived_ns is None else arrived_ns, made


def text_item(topic: str, time_ns: int, text: str) -> Item:
    return topic, STRING, time_ns, lambda store: store.types[STRING](data=text)


def people_item(report: PeopleReport, topic: str = "/people") -> Item:
    return text_item(topic, report.arrived_ns, encode(report).decode())


def in_time(items: Iterable[Item]) -> list[Item]:
    return sorted(items, key=lambda item: item[2])


def all_items(states: Iterable[JointState], reports: Iterable[PeopleReport]) -> list[Item]:
    return in_time([*map(joint_item, states), *map(people_item, reports)])


def write_ros1(
    path: Path, items: Sequence[Item], compression: str | None = None, chunk_bytes: int = 4096
) -> Path:
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(Ros1Writer.CompressionFormat[compression])
    writer.chunk_threshold = chunk_bytes
    with writer:
        _write(writer, items, ROS1, ROS1.serialize_ros1)
    return path


def write_ros2(
    path: Path,
    items: Sequence[Item],
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    writer = Ros2Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        _write(writer, items, ROS2, ROS2.serialize_cdr)
    return path


def write_foreign_mcap(path: Path, items: Sequence[Item], chunk_bytes: int = 4096) -> Path:
    """One file as a data logger writes it: the mcap package, definitions as ROS 2 has them."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=chunk_bytes)
        writer.start(profile="ros2", library="test")
        channels: dict[tuple[str, str], int] = {}
        for topic, kind, time_ns, made in items:
            if (topic, kind) not in channels:
                text = ROS2.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(made(ROS2), kind))
            writer.add_message(channels[topic, kind], time_ns, data, time_ns)
        writer.finish()
    return path


def _write(writer: Any, items: Sequence[Item], store: Any, serialize: Callable[[Any, str], Any]) -> None:
    connections: dict[tuple[str, str], Any] = {}
    for topic, kind, time_ns, made in items:
        if (topic, kind) not in connections:
            connections[topic, kind] = writer.add_connection(topic, kind, typestore=store)
        writer.write(connections[topic, kind], time_ns, bytes(serialize(made(store), kind)))


WRITERS: dict[str, tuple[str, Callable[[Path, Sequence[Item]], Path]]] = {
    "ros1": ("a.bag", write_ros1),
    "ros1 bz2": ("a.bag", lambda path, items: write_ros1(path, items, "BZ2")),
    "ros1 lz4": ("a.bag", lambda path, items: write_ros1(path, items, "LZ4")),
    "ros2 sqlite": ("a", write_ros2),
    "ros2 mcap": ("a", lambda path, items: write_ros2(path, items, StoragePlugin.MCAP)),
    "ros2 sqlite zstd file": (
        "a",
        lambda path, items: write_ros2(path, items, compression=CompressionMode.FILE),
    ),
    "ros2 sqlite zstd message": (
        "a",
        lambda path, items: write_ros2(path, items, compression=CompressionMode.MESSAGE),
    ),
    "mcap": ("a.mcap", write_foreign_mcap),
}
"""Name -> name of the file or folder, and what writes it."""


def files_of(path: Path) -> list[Path]:
    """The files of a container, largest first."""
    files = [path] if path.is_file() else [each for each in path.iterdir() if each.is_file()]
    return sorted(files, key=lambda each: -each.stat().st_size)
