"""Sources of people and joints through containers: what the adapters say is what verify gets to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from tests.verifier.recordings.bags import ROS2, WRITERS, Item, in_time, joint_item
from tests.verifier.recordings.people_sources import test_azure_kinect as azure
from tests.verifier.recordings.people_sources import test_mocap4r2 as mocap4r2
from tests.verifier.recordings.people_sources import test_ros4hri as ros4hri
from tests.verifier.recordings.people_sources.bodies import person
from tests.verifier.recordings.people_sources.ros import MOCAP
from tests.verifier.recordings.robot_sources.messages import CONTROLLER, CONTROLLER_NEW
from tests.verifier.recordings.samples import JOINTS, joint_states
from verifier.recordings import Choice, Recording, RecordingError, people_sources, robot_sources
from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_state import decode as decode_joints
from verifier.recordings.people_report import COLUMN, encode
from verifier.recordings.people_source import Place, RecordedPeople
from verifier.recordings.people_sources import SourceOptions, new_adapters
from verifier.recordings.reading import Reading
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC, PEOPLE_TOPIC

KINDS = ["ros2 sqlite", "mcap"]
STATES = [joint_item(state) for state in joint_states(100.0, 0.5, azure.NOW)]


def item(message: Decoded) -> Item:
    return message.topic, message.schema, message.log_time_ns, lambda _store: message.value


def said(messages: list[Decoded]) -> list[tuple[int, bytes]]:
    """What the adapter makes of the messages."""
    adapter = new_adapters(SourceOptions())[messages[0].schema]
    reports = [report for message in messages for report in adapter.read(message)]
    return [(each.arrived_ns, encode(each)) for each in (*reports, *adapter.finish())]


def azure_messages() -> list[Decoded]:
    found = []
    for n in range(12):
        stamp = azure.NOW + n * 33_000_000
        markers = azure.body(1, azure.XYZ + 0.001 * n, stamp=stamp)
        value = azure.make(azure.SCHEMA, markers=markers)
        found.append(azure.decoded(azure.SCHEMA, value, stamp + 40_000_000, "/body_tracking"))
    return found


def ros4hri_messages(rng: np.random.Generator) -> list[Decoded]:
    model = ros4hri.Model("a1", rng)
    moving = sorted(set(ros4hri.TEMPLATE) - ros4hri.STATIC)
    messages = [ros4hri.message(model.below(ros4hri.STATIC, 0), ros4hri.NOW, "/tf_static")]
    for n in range(12):
        stamp = ros4hri.NOW + n * 33_000_000
        parts: list[Any] = [[model.body(stamp)], model.below(moving, stamp)]
        messages += [ros4hri.message(part, stamp + 10_000_000 + k) for k, part in enumerate(parts)]
    return messages


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", ["azure", "ros4hri"])
def test_reports_are_what_the_adapter_says(tmp_path: Path, kind: str, source: str, rng) -> None:
    messages = azure_messages() if source == "azure" else ros4hri_messages(rng)
    topic = "/body_tracking" if source == "azure" else "/tf"
    name, write = WRITERS[kind]
    path = write(tmp_path / name, in_time([*STATES, *map(item, messages)]))
    assert not Recording(path).has_people, "the type says other things as well: nobody has named the topic"
    recording = Recording(path, Choice(people_topic=topic))
    assert [(m.log_time, m.data) for m in recording.file.messages([PEOPLE_TOPIC])] == said(messages)
    assert "recording.joint_set" in {each.name for each in recording.assumptions}


@pytest.mark.parametrize("kind", KINDS)
def test_what_an_adapter_refuses_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    """A stream whose bodies are none: indices shifted by one."""
    found = []
    for n in range(40):
        stamp = azure.NOW + n * 10_000_000
        markers = azure.body(1, np.roll(azure.XYZ, 1, axis=0), stamp=stamp)
        value = azure.make(azure.SCHEMA, markers=markers)
        found.append(azure.decoded(azure.SCHEMA, value, stamp, "/k"))
    name, write = WRITERS[kind]
    path = write(tmp_path / name, in_time([*STATES, *map(item, found)]))
    with pytest.raises(RecordingError, match="/k, message at ") as caught:
        Recording(path, Choice(people_topic="/k"))
    assert "\n" not in str(caught.value)


def test_names_that_change_places_are_mapped_once(tmp_path: Path) -> None:
    """By the translation, and not again by who reads it: sides that were exchanged would be so again."""
    at, found = person(), []
    for kind, text in MOCAP.items():
        if (full := f"mocap4r2_msgs/msg/{kind}") not in ROS2.types:
            ROS2.register(get_types_from_msg(text.format("mocap4r2_msgs"), full))
    for n in range(5):
        seen = [(name, at[bone]) for name, bone in (("l_wrist", "wrist_left"), ("r_wrist", "wrist_right"))]
        found.append(mocap4r2.markers([*seen, ("head", at["head"])], azure.NOW + n * 10_000_000))
    name, write = WRITERS["mcap"]
    path = write(tmp_path / name, in_time([*STATES, *map(item, found)]))
    names = {"l_wrist": "r_wrist", "r_wrist": "l_wrist", "head": "neck_base"}
    choice = Choice(people=SourceOptions(point_names=names))
    (window,) = Reading(Recording(path, choice), JOINTS, point_names=names).windows(100.0, 0.0, 0.0)
    imported = RecordedPeople(path, None, names, choice).reports(Place(), 0.0)
    for reports in (window.people, list(imported)):
        assert len(reports) == len(found)
        for (someone,) in (report.people for report in reports):
            for ours, bone in (("r_wrist", "wrist_left"), ("l_wrist", "wrist_right"), ("neck_base", "head")):
                assert someone.xyz[COLUMN[ours]] == pytest.approx(at[bone])
            assert np.isnan(someone.xyz[COLUMN["head"]]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_controller_states_give_joints_and_commands(tmp_path: Path, kind: str) -> None:
    if CONTROLLER not in ROS2.types:
        ROS2.register(get_types_from_msg(CONTROLLER_NEW, CONTROLLER))
    items = []
    for n, state in enumerate(joint_states(100.0, 0.5, azure.NOW)):

        def made(store: Any, state: Any = state) -> Any:
            types = store.types
            sec, nanosec = divmod(state.stamp_ns, 10**9)
            stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            zero = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
            point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
            none = np.zeros(0)
            points = [
                point(q, none, none, none, zero) for q in (state.position + 0.1, state.position, none, none)
            ]
            return types[CONTROLLER](header, list(JOINTS), *points)

        items.append(("/arm/controller_state", CONTROLLER, state.stamp_ns + n, made))
    name, write = WRITERS[kind]
    recording = Recording(write(tmp_path / name, items))
    states, commands = (
        [decode_joints(m.data) for m in recording.file.messages([topic])]
        for topic in (JOINT_TOPIC, COMMAND_TOPIC)
    )
    expected = joint_states(100.0, 0.5, azure.NOW)
    assert [s.stamp_ns for s in states] == [s.stamp_ns for s in commands] == [s.stamp_ns for s in expected]
    for state, command, true in zip(states, commands, expected, strict=True):
        np.testing.assert_array_equal(state.position, true.position)
        np.testing.assert_array_equal(command.position, true.position + 0.1)


def test_the_document_names_every_type_that_is_read() -> None:
    text = (Path(__file__).resolve().parents[3] / "docs/recordings.md").read_text(encoding="utf-8")
    for schema in (*robot_sources.ADAPTERS, *people_sources.ADAPTERS):
        assert f"`{schema}`" in text
