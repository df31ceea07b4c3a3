"""Messages built by the library rosbags from message definitions, written and read back as CDR."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robots.assumption import Assumption
from verifier.recordings.decoded import Decoded
from verifier.recordings.people_report import NANO, PeopleReport, decode, encode
from verifier.recordings.people_sources import PeopleAdapter, SourceOptions, new_adapters

ZED = {
    "Keypoint2Df": "float32[2] kp",
    "Keypoint2Di": "uint32[2] kp",
    "Keypoint3D": "float32[3] kp",
    "BoundingBox2Df": "{0}/Keypoint2Df[4] corners",
    "BoundingBox2Di": "{0}/Keypoint2Di[4] corners",
    "BoundingBox3D": "{0}/Keypoint3D[8] corners",
    "Skeleton2D": "{0}/Keypoint2Df[70] keypoints",
    "Skeleton3D": "{0}/Keypoint3D[70] keypoints",
    "ObjectsStamped": "std_msgs/Header header\n{0}/Object[] objects",
    "Object": """string label
int16 label_id
string sublabel
float32 confidence
float32[3] position
float32[6] position_covariance
float32[3] velocity
bool tracking_available
int8 tracking_state
int8 action_state
{0}/BoundingBox2Di bounding_box_2d
{0}/BoundingBox3D bounding_box_3d
float32[3] dimensions_3d
bool skeleton_available
int8 body_format
{0}/BoundingBox2Df head_bounding_box_2d
{0}/BoundingBox3D head_bounding_box_3d
float32[3] head_position
{0}/Skeleton2D skeleton_2d
{0}/Skeleton3D skeleton_3d""",
}
"""Fields of stereolabs/zed-ros2-interfaces."""
OLD_ZED = ZED | {
    "Object": ZED["Object"].replace("int8 body_format\n", ""),
    "Skeleton3D": "{0}/Keypoint3D[18] keypoints",
}
"""As they were before there were several sets."""
MOCAP = {
    "Marker": """int8 USE_NAME=0
int8 USE_INDEX=1
int8 USE_BOTH=2
int8 id_type
int32 marker_index
string marker_name
geometry_msgs/Point translation""",
    "Markers": "std_msgs/Header header\nuint32 frame_number\n{0}/Marker[] markers",
    "RigidBody": "string rigid_body_name\n{0}/Marker[] markers\ngeometry_msgs/Pose pose",
    "RigidBodies": "std_msgs/Header header\nuint32 frame_number\n{0}/RigidBody[] rigidbodies",
}
"""Fields of MOCAP4ROS2-Project/mocap4r2_msgs."""
PEOPLE = {
    "Person": """string name
geometry_msgs/Point position
geometry_msgs/Point velocity
float64 reliability
string[] tagnames
string[] tags""",
    "People": "std_msgs/Header header\n{0}/Person[] people",
}
"""Fields of people_msgs."""


@cache
def _store(old: bool = False) -> Any:
    store = get_typestore(Stores.ROS2_HUMBLE)
    zed = {"zed_msgs": ZED, "zed_interfaces": OLD_ZED if old else ZED}
    for package, messages in (*zed.items(), ("mocap4r2_msgs", MOCAP), ("people_msgs", PEOPLE)):
        for name, text in messages.items():
            store.register(get_types_from_msg(text.format(package), f"{package}/msg/{name}"))
    return store


def make(schema: str, old: bool = False, **fields: Any) -> Any:
    """A message with these fields, all others 0, empty or false."""
    store = _store(old)
    return store.types[schema](**{
        name: fields.get(name, _zero(store, node)) for name, node in store.fielddefs[schema][1]
    })  # fmt: skip


def _zero(store: Any, node: Any) -> Any:
    kind, what = node
    if kind.name == "BASE":
        name = what[0]
        return "" if name == "string" else name == "nothing" if name == "bool" else 0
    if kind.name == "NAME":
        return make(what) if what in store.types else None
    if kind.name == "SEQUENCE":
        element = what[0]
        number = element[0].name == "BASE" and element[1][0] not in ("string", "bool")
        return np.zeros(0, element[1][0]) if number else []
    element, size = what
    if element[0].name == "BASE":
        return np.zeros(size, element[1][0])
    return [make(element[1]) for _ in range(size)]


def header(stamp_ns: int, frame: str = "camera") -> Any:
    sec, nanosec = divmod(stamp_ns, NANO)
    return make(
        "std_msgs/msg/Header",
        stamp=make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec),
        frame_id=frame,
    )


def point(place: Any, kind: str = "Point") -> Any:
    x, y, z = (float(value) for value in place)
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def pose(place: Any) -> Any:
    return make(
        "geometry_msgs/msg/Pose",
        position=point(place),
        orientation=make("geometry_msgs/msg/Quaternion", w=1.0),
    )


def decoded(
    schema: str, value: Any, log_time_ns: int, topic: str = "/people_of_theirs", old: bool = False
) -> Decoded:
    """The message as it is read from a file."""
    store = _store(old)
    data = store.serialize_cdr(value, schema)
    return Decoded(topic, schema, log_time_ns, store.deserialize_cdr(data, schema))


class OneByOne:
    """An adapter of which a test wants one report a message at most."""

    def __init__(self, adapter: PeopleAdapter) -> None:
        self.all = self._adapter = adapter

    @property
    def schemas(self) -> tuple[str, ...]:
        return self._adapter.schemas

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        return self._adapter.assumptions

    def read(self, message: Decoded) -> PeopleReport | None:
        return _only(self._adapter.read(message))

    def finish(self) -> PeopleReport | None:
        return _only(self._adapter.finish())


def _only(reports: tuple[PeopleReport, ...]) -> PeopleReport | None:
    assert len(reports) <= 1
    return reports[0] if reports else None


def adapters(options: SourceOptions | None = None) -> dict[str, OneByOne]:
    return {schema: OneByOne(adapter) for schema, adapter in new_adapters(options).items()}


def as_written(report: PeopleReport | None) -> PeopleReport:
    """The report after it has been through our own format."""
    assert report is not None
    return decode(encode(report), report.arrived_ns)
