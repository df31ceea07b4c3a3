"""Reading recordings of every kind, and plain decoding of the same file by rosbags in the same run.

    python -m bench.reading [--messages N] [--rounds R] [--only NAME]... [--json -]

Each row is a file with N messages of one source. *Ours* opens it as verify does, translates where it is not
ours, and decodes and checks every joint sample and report. *Plain* decodes every message of the file by
rosbags (of JSON: by json), and does nothing with it. Each is a process of its own; times are processor time,
the least of the rounds; memory is the peak above what stood before the file was opened.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.typesys import get_types_from_msg

from bench.machine import describe_machine
from tests.fuzz_readers.messages import NOW, STEP_NS
from tests.verifier.recordings.bags import ROS2, WRITERS, Item, all_items, in_time, joint_item
from tests.verifier.recordings.people_sources import ros
from tests.verifier.recordings.people_sources import test_azure_kinect as azure
from tests.verifier.recordings.people_sources import test_mocap4r2 as mocap
from tests.verifier.recordings.people_sources import test_zed as zed
from tests.verifier.recordings.people_sources.bodies import joints, person
from tests.verifier.recordings.robot_sources import messages as arms
from tests.verifier.recordings.samples import joint_states, reports, write_all
from verifier.recordings import Choice, Recording
from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC

MEGABYTE = 1 << 20
JOINT_SHARE = 0.9
"""Of the messages of a container; the rest are reports, about as 500 Hz beside 60 Hz."""
AT_ONCE = 1000


CONTAINERS = {
    "MCAP of others": "mcap",
    "ROS 2 bag, SQLite": "ros2 sqlite",
    "ROS 2 bag, MCAP": "ros2 mcap",
    "ROS 1 bag": "ros1",
    "ROS 1 bag, LZ4": "ros1 lz4",
}


@dataclass(frozen=True)
class Row:
    """A file to read: what it is called, where it is, how many messages it has, which topic has people."""

    name: str
    path: Path
    messages: int
    people: str | None = None


def main() -> None:
    """Measure, and print the table or JSON; as a child process, read one file one way."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.reading", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--messages", type=int, default=20_000, help="messages of each file")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", action="append", metavar="NAME", help="rows whose name begins like this")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    for hidden in ("--ours", "--plain", "--people"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.ours is not None:
        print(json.dumps(_measured(lambda: _ours(Path(options.ours), options.people))))
    elif options.plain is not None:
        print(json.dumps(_measured(lambda: _plain(Path(options.plain)))))
    else:
        begins = tuple(options.only or ("",))
        rows = list(_rows(options.messages, options.rounds, begins))
        if not rows:
            parser.error(f"--only {', '.join(begins)}: no row begins like that")
        found = {"machine": describe_machine(), "rows": rows}
        print(json.dumps(found, indent=1) if options.json == "-" else "\n".join(_lines(found, options)))


def _rows(messages: int, rounds: int, begins: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as name:
        for row in _files(Path(name), messages):
            if not row.name.startswith(begins):
                continue
            ways: dict[str, Any] = {"name": row.name, "messages": row.messages}
            for way in ("ours", "plain"):
                more = () if row.people is None or way == "plain" else ("--people", row.people)
                runs = [_child(f"--{way}", str(row.path), *more) for _ in range(rounds)]
                ways[way] = {key: min(run[key] for run in runs) for key in ("seconds", "memory_mb")}
            yield ways


def _child(*arguments: str) -> dict[str, float]:
    command = [sys.executable, "-m", "bench.reading", *arguments]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def _lines(found: dict[str, Any], options: argparse.Namespace) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}; least of {options.rounds} rounds, processor time"
    yield ""
    heads = (
        "messages",
        "number",
        "ours, 1/s",
        "rosbags, 1/s",
        "ours / rosbags, time",
        "ours, MB",
        "rosbags, MB",
    )
    yield f"| {heads[0]:<26} | " + " | ".join(f"{head:>{len(head)}}" for head in heads[1:]) + " |"
    yield f"|{'-' * 28}|" + "|".join("-" * (len(head) + 1) + ":" for head in heads[1:]) + "|"
    for row in found["rows"]:
        ours, plain, number = row["ours"], row["plain"], row["messages"]
        numbers = (
            f"{number}",
            f"{number / ours['seconds']:.0f}",
            f"{number / plain['seconds']:.0f}",
            f"{ours['seconds'] / plain['seconds']:.2f}",
            f"{ours['memory_mb']:.0f}",
            f"{plain['memory_mb']:.0f}",
        )
        cells = (f"{text:>{len(head)}}" for text, head in zip(numbers, heads[1:], strict=True))
        yield f"| {row['name']:<26} | " + " | ".join(cells) + " |"


def _measured(read: Callable[[], int]) -> dict[str, float]:
    """Processor time [s] and peak memory [MB] of reading; the file must have something in it."""
    before, began = _reset_peak(), time.process_time()
    assert read() > 0
    return {
        "seconds": time.process_time() - began,
        "memory_mb": max(0.0, (_memory("VmHWM") - before) / MEGABYTE),
    }


def _reset_peak() -> int:
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    return _memory("VmRSS")


def _memory(key: str) -> int:
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    (kilobytes,) = re.findall(rf"{key}:\s+(\d+) kB", status)
    return 1024 * int(kilobytes)


def _ours(path: Path, people_topic: str | None) -> int:
    recording = Recording(path, Choice(people_topic=people_topic))
    stream, found = JointStream(recording, recording.joint_names), 0
    people = PeopleStream(recording.file, {})
    for message in recording.file.messages([JOINT_TOPIC, PEOPLE_TOPIC]):
        if message.channel.topic == JOINT_TOPIC:
            stream.take(message)
        else:
            people.report(message)
        found += 1
        if found % AT_ONCE == 0:
            stream.drain()
    stream.drain()
    return found


def _plain(path: Path) -> int:
    if path.suffix == ".mcap":
        return _plain_mcap(path)
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found = 0
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _time, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found += 1
    return found


def _plain_mcap(path: Path) -> int:
    """A file without the folder that rosbags asks for: mcap reads it, rosbags decodes."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    store, found = get_typestore(Stores.ROS2_JAZZY), 0
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding == "json":
                json.loads(message.data)
            else:
                assert schema is not None
                store.deserialize_cdr(message.data, schema.name)
            found += 1
    return found


def _files(folder: Path, messages: int) -> Iterator[Row]:
    _register()
    seconds = messages * JOINT_SHARE / 500.0
    states = joint_states(500.0, seconds, NOW)
    people = reports(500.0 * (1.0 - JOINT_SHARE) / JOINT_SHARE, seconds, NOW)
    ours = write_all(folder / "ours.mcap", [*states, *people])
    number = len(states) + len(people)
    yield Row("our own (MCAP)", ours, number)
    items = all_items(states, people)
    for title, kind in CONTAINERS.items():
        yield _written(folder, title, kind, items)
    few = [joint_item(state) for state in joint_states(100.0, 0.5, NOW)]
    for title, found, topic in _sources(messages // 10):
        yield _written(folder, title, "ros2 sqlite", in_time([*few, *map(_item, found)]), topic)
    for title, found in _arms(messages):
        yield _written(folder, title, "ros2 sqlite", [_item(each) for each in found])


def _register() -> None:
    """Let the writer know the types that no distribution has."""
    for package, messages in (("zed_msgs", ros.ZED), ("mocap4r2_msgs", ros.MOCAP)):
        for name, text in messages.items():
            ROS2.register(get_types_from_msg(text.format(package), f"{package}/msg/{name}"))
    ROS2.register(get_types_from_msg(arms.CONTROLLER_NEW, arms.CONTROLLER))


def _written(folder: Path, title: str, kind: str, items: Sequence[Item], people: str | None = None) -> Row:
    inside = folder / title.replace(" ", "_").replace("/", "_")
    inside.mkdir()
    name, write = WRITERS[kind]
    return Row(title, write(inside / name, items), len(items), people)


def _item(message: Decoded) -> Item:
    return message.topic, message.schema, message.log_time_ns, lambda _store: message.value


def _sources(number: int) -> Iterator[tuple[str, list[Decoded], str]]:
    at, step = person(), STEP_NS
    xyz = joints("zed_body_38", at)
    bodies = [zed.message([zed.body(xyz + 0.001 * k, body_format=2)], NOW + k * step) for k in range(number)]
    yield "ZED, 38 key points", bodies, bodies[0].topic
    arrays = []
    for k in range(number):
        stamp = NOW + k * step
        value = azure.make(azure.SCHEMA, markers=azure.body(1, azure.XYZ + 0.001 * k, stamp=stamp))
        arrays.append(azure.decoded(azure.SCHEMA, value, stamp + step, "/body_tracking"))
    yield "Azure Kinect, 32 markers", arrays, "/body_tracking"
    seen = [("l_wrist", at["wrist_left"]), ("r_wrist", at["wrist_right"]), ("l_elbow", at["elbow_left"]),
            ("l_knee", at["knee_left"]), ("head", at["head"])]  # fmt: skip
    markers = [
        mocap.markers([(n, xyz + 0.001 * k) for n, xyz in seen], NOW + k * step) for k in range(number)
    ]
    yield "mocap4r2, 5 markers", markers, markers[0].topic


def _arms(number: int) -> Iterator[tuple[str, list[Decoded]]]:
    types = arms.store(arms.CONTROLLER, arms.CONTROLLER_NEW)
    found = []
    for k in range(number):
        stamp = NOW + k * 2_000_000
        points = [arms.point(types, (0.1, 0.2, 0.001 * k), (0.0, 0.0, 0.0)) for _ in range(2)]
        empty = [arms.point(types), arms.point(types)]
        value = types.types[arms.CONTROLLER](arms.header(types, stamp), list(arms.JOINTS), *points, *empty)
        found.append(arms.through(types, arms.CONTROLLER, value, "/controller_state", stamp))
    yield "controller state", found


if __name__ == "__main__":
    main()
