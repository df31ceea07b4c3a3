"""Messages of every adapter, with values that no driver should write."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from tests.fuzz_readers import checks
from tests.fuzz_readers.mutate import Leaf, another_value, broken_text, invented, leaves
from tests.verifier.recordings.people_sources import test_azure_kinect as azure
from tests.verifier.recordings.people_sources import test_floor_and_field as floor
from tests.verifier.recordings.people_sources import test_mocap4r2 as mocap
from tests.verifier.recordings.people_sources import test_ros4hri as ros4hri
from tests.verifier.recordings.people_sources import test_skeletons as skeletons
from tests.verifier.recordings.people_sources import test_zed as zed
from tests.verifier.recordings.people_sources.bodies import joints, person
from tests.verifier.recordings.people_sources.ros import decoded, make, pose
from tests.verifier.recordings.robot_sources import messages as arms
from verifier.recordings import people_report, robot_sources
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_report import PeopleReport, ReportError
from verifier.recordings.people_sources import (
    FieldState,
    FloorPositions,
    SourceOptions,
    new_adapters,
    speaks_of_people,
)

NOW = zed.NOW
OPTIONS = SourceOptions(point_names=mocap.NAMES, floor=FloorPositions(0.3), field=FieldState(False, 0.1))
STEP_NS = 33_000_000
Place = tuple[int, str, int]
"""Number of the report, person, point."""


@dataclass
class MessageReader:
    """Reads messages of one type, one of which is wrong in each input.

    Attributes
    ----------
    name, streams:
        What it is called, and valid messages, stream by stream.
    read:
        Reads a stream; returns the measured points, or joints, that it let pass.
    any_type:
        Whether values may have other types.
    """

    name: str
    streams: Sequence[Sequence[Decoded]]
    read: Callable[[Sequence[Decoded]], dict[Place, Any]]
    any_type: bool = False
    weight: int = 4
    _known: list[tuple[list[Leaf], dict[Place, Any]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.streams = [
            [replace(each, value=_writable(each.value)) for each in stream] for stream in self.streams
        ]
        for stream in self.streams:
            found = [leaf for each in stream for leaf in leaves(each.value)]
            self._known.append((found, self.read(stream)))

    def attempt(self, rnd: Random, _folder: Path) -> None:
        """Read a stream with a few wrong values; a lone NaN must never move a point."""
        number = rnd.randrange(len(self.streams))
        places, before = self._known[number]
        changed: list[tuple[Leaf, Any]] = []
        lone = None
        try:
            for _ in range(rnd.choice((1, 1, 1, 2, 5, 20))):
                leaf = rnd.choice(places)
                try:
                    old, new = leaf.value, another_value(leaf, rnd, any_type=self.any_type)
                    leaf.put(new)
                except (IndexError, KeyError, OverflowError, AttributeError, ValueError, TypeError):
                    continue  # a list is shorter by now, or the type cannot hold it
                changed.append((leaf, old))
                lone = new if len(changed) == 1 else None
            after = self.read(self.streams[number])
        finally:
            for leaf, old in reversed(changed):
                leaf.put(old)
        if isinstance(lone, float) and not np.isfinite(lone):
            for place, xyz in after.items():
                same = place not in before or np.array_equal(xyz, before[place])
                checks.need(same, f"a value that is {lone} moved {place} from {before.get(place)} to {xyz}")

    def valid(self, _folder: Path) -> None:
        """Read the streams as they are."""
        for (_leaves, before), stream in zip(self._known, self.streams, strict=True):
            checks.need(repr(self.read(stream)) == repr(before), "a stream is not as it was")


@dataclass(frozen=True)
class TextReader:
    """Reads reports about people in our own words, broken as text."""

    name: str
    texts: Sequence[bytes]
    weight: int = 4

    def attempt(self, rnd: Random, _folder: Path) -> None:
        """Read one broken report."""
        text = rnd.choice(self.texts)
        self._read((invented if rnd.random() < 0.1 else broken_text)(text, rnd))

    def valid(self, _folder: Path) -> None:
        """Read the reports as they are."""
        for text in self.texts:
            self._read(text)

    def _read(self, data: bytes) -> None:
        try:
            checks.report(people_report.decode(data, 7, {"Hand": "l_hand"}, ("a", "b")))
        except ReportError as error:
            raise SourceError(str(error)) from error


def message_readers() -> Iterator[MessageReader | TextReader]:
    """Yield the readers of messages."""
    yield TextReader("report about people", list(_reports()))
    for name, streams in _people().items():
        yield MessageReader(name, streams, _read_people, any_type=name == "stopproof.Skeletons")
    for name, stream in _arms().items():
        yield MessageReader(name, [stream], _read_joints)


def _reports() -> Iterator[bytes]:
    point = {"xyz": [1.0, -2.5, 0.25], "state": "measured", "error_m": 0.02}
    points = {"head": point, "r_wrist": {**point, "state": "inferred"}, "Hand": point, "foo": point}
    people = [
        {"id": "p1", "position_error_m": 0.01, "points": points},
        {"id": "p2", "points": {"pelvis": point}},
    ]
    standing = {"id": "p3", "floor": {"xyz": [1.5, 2.5, 0.0], "error_m": 0.3, "up": [0.0, 0.0, 1.0]}}
    for stamp, frame, complete in ((12.34, "world", True), (1700000000.123456789, "camera", ["a", "b"])):
        yield json.dumps(
            {"stamp": stamp, "frame": frame, "complete": complete, "people": [*people, standing]}
        ).encode()


def _people() -> dict[str, list[list[Decoded]]]:
    at = person(1.7)
    rng = np.random.default_rng(3)
    model = ros4hri.Model("a1", rng)
    moving = sorted(set(ros4hri.TEMPLATE) - ros4hri.STATIC)
    static = ros4hri.message(model.below(sorted(ros4hri.STATIC), 0), NOW, "/tf_static")
    frames = [
        ros4hri.message([model.body(stamp), *model.below(moving, stamp)], stamp + STEP_NS)
        for stamp in _stamps(3)
    ]
    bodies = [make("mocap4r2_msgs/msg/RigidBody", rigid_body_name="LWRB", pose=pose((1.0, 2.0, 3.0)))]
    rigid = make(mocap.BODIES, header=mocap.header(NOW), rigidbodies=bodies)
    seen = [("anna:LWRB", at["wrist_left"]), ("anna:LELB", at["elbow_left"]), (7, at["head"])]
    switches = [
        decoded(floor.BOOL, make(floor.BOOL, data=each), stamp, "/f")
        for each, stamp in zip((True, False), _stamps(2), strict=True)
    ]
    return {
        "ZED": [[zed.message([zed.body(joints(name, at), body_format=number)], stamp) for stamp in _stamps(2)]
                for number, name in zed.SETS.items()],
        "Azure Kinect": [[azure.message(azure.body(2, azure.XYZ)), azure.message(azure.body(2, azure.XYZ))]],
        "mocap4r2": [[mocap.markers(seen, stamp) for stamp in _stamps(2)],
                     [decoded(mocap.BODIES, rigid, NOW)]],
        "ROS4HRI": [[static, *frames]],
        "stopproof.Skeletons": [[skeletons.message(name, [skeletons.body(joints(name, at))])]
                                for name in ("coco_17", "mediapipe_33", "azure_kinect_32")],
        "floor positions": [[floor.floor_message(schema, [(1.0, 2.0, 0.1), (2.0, 1.0, 0.0)])]
                            for schema in (floor.PEOPLE, floor.POSES, floor.POINT, floor.POSE)],
        "field switch": [switches],
    }  # fmt: skip


def _stamps(number: int) -> list[int]:
    return [NOW + k * STEP_NS for k in range(number)]


def _arms() -> dict[str, list[Decoded]]:
    found = {}
    kinds = {
        "JointState": (arms.STATE, "", _state),
        "JointTrajectoryControllerState": (arms.CONTROLLER, arms.CONTROLLER_NEW, _controller),
        "FrankaRobotState": (arms.FRANKA, arms.FRANKA_NEW, _franka),
    }  # fmt: skip
    for name, (schema, definition, made) in kinds.items():
        types = arms.store(schema, definition) if definition else arms.store()
        found[name] = [
            arms.through(types, schema, made(types, stamp), log_time_ns=stamp) for stamp in _stamps(2)
        ]
    return found


def _state(types: Any, stamp: int) -> Any:
    return arms.joint_state(types, stamp, arms.JOINTS, (0.1, 0.2, 0.3))


def _controller(types: Any, stamp: int) -> Any:
    points = [arms.point(types, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0)) for _ in range(2)]
    empty = [arms.point(types), arms.point(types)]
    return types.types[arms.CONTROLLER](arms.header(types, stamp), list(arms.JOINTS), *points, *empty)


def _franka(types: Any, stamp: int) -> Any:
    names = [f"fr3_joint{k}" for k in range(1, 8)]
    states = [arms.joint_state(types, stamp, names, np.linspace(0.1, 0.7, 7)) for _ in range(3)]
    return types.types[arms.FRANKA](arms.header(types, stamp), *states, np.zeros(7), np.zeros(7))


def _read_people(stream: Sequence[Decoded]) -> dict[Place, Any]:
    adapters = new_adapters(OPTIONS)
    used = adapters[stream[0].schema]
    speaks_of_people(stream[-1])
    found = [report for message in stream for report in used.read(message)]
    passed: dict[Place, Any] = {}
    for number, each in enumerate([*found, *used.finish()]):
        checks.report(each)
        passed |= _measured(number, each)
    return passed


def _measured(number: int, found: PeopleReport) -> dict[Place, Any]:
    return {
        (number, each.id, point): each.xyz[point].copy()
        for each in found.people
        for point in range(len(each.xyz))
        if each.measured >> point & 1 and np.isfinite(each.xyz[point]).all()
    }


def _read_joints(stream: Sequence[Decoded]) -> dict[Place, Any]:
    passed: dict[Place, Any] = {}
    for number, message in enumerate(stream):
        sample = robot_sources.ADAPTERS[message.schema].read(message)
        for state in filter(None, (sample.state, sample.reference)):
            checks.state(state)
            passed |= {(number, name, 0): q for name, q in zip(state.names, state.position, strict=False)}
    return passed


def _writable(value: Any) -> Any:
    """Arrays of decoded messages cannot be written: copies of them can."""
    if isinstance(value, np.ndarray):
        return value.copy()
    for leaf in leaves(value):
        if isinstance(leaf.value, np.ndarray):
            leaf.put(leaf.value.copy())
    return value
