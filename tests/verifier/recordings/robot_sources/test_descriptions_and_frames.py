"""``/robot_description`` and ``/tf_static``, against messages that rosbags encoded and decoded."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores
from scipy.spatial.transform import Rotation

from tests.verifier.recordings.robot_sources.messages import header, loose, store, through
from verifier.cell import Cell
from verifier.cell_filling import fill_in
from verifier.recordings import RecordingError, inspect_recording
from verifier.recordings.beside import read_description
from verifier.recordings.decoded import SourceError
from verifier.recordings.neutral import open_whole
from verifier.recordings.robot_sources.robot_description import description
from verifier.recordings.robot_sources.robot_description import read_description as read_text
from verifier.recordings.robot_sources.transforms import read_transforms, together

STRING, TF = "std_msgs/msg/String", "tf2_msgs/msg/TFMessage"
URDF = """<?xml version="1.0"?>
<robot name="two axes">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="bolt" type="fixed"><parent link="b"/><child link="c"/></joint>
</robot>"""


def refused(call, *arguments):
    with pytest.raises((SourceError, RecordingError)) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("ros1", [False, True])
def test_a_description_of_both_ros(ros1):
    types = store(base=Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    message = through(types, STRING, types.types[STRING](data=URDF), ros1=ros1)
    found = read_text(message)
    assert (found.name, found.joints, found.content) == ("two axes", ("turn", "slide"), URDF.encode())
    assert found.identity.startswith("urdf:two axes:")
    assert "must be the text of a URDF" in refused(read_text, loose(message, data=3))


@pytest.mark.parametrize(
    "text", ["", "<robot", "<sdf/>", "robot", "<robot>" + "<a>" * 5000 + "</a>" * 5000 + "</robot>"]
)
def test_what_is_no_urdf_is_refused(text):
    assert "publish the URDF itself, not xacro" in refused(description, text.encode())


def described(path, *texts, schema=STRING):
    types = store()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        names = writer.register_schema(schema, "ros2msg", b"string data")
        channel = writer.register_channel("/robot_description", "cdr", names)
        for k, text in enumerate(texts):
            data = bytes(types.serialize_cdr(types.types[STRING](data=text), STRING))
            writer.add_message(channel, k + 1, data, k + 1)
        writer.finish()
    return path


def test_inspect_says_which_arm_is_described(tmp_path):
    found = inspect_recording(described(tmp_path / "a.mcap", URDF, URDF))
    assert found.description == description(URDF.encode()).identity
    assert f"described in the recording: {found.description}; `init --urdf FILE` writes it" in found.lines()
    two = inspect_recording(described(tmp_path / "b.mcap", URDF, URDF.replace("two axes", "other")))
    assert two.description is None and "/robot_description: describes two arms" in two.remarks
    bad = described(tmp_path / "c.mcap", URDF, schema="std_msgs/msg/Bool")
    assert "is of another type" in refused(read_description, open_whole(bad))


def test_init_writes_the_description_and_takes_limits_for_it(tmp_path):
    limits = tmp_path / "joint_limits.yaml"
    limits.write_text(
        "joint_limits:\n"
        "  turn: {has_velocity_limits: true, max_velocity: 2.5, has_acceleration_limits: false}\n"
        "  slide: {has_acceleration_limits: true, max_acceleration: 1, has_jerk_limits: true, max_jerk: 20}\n"
        "  finger: {has_velocity_limits: true, max_velocity: 1.0}\n"
    )
    path = described(tmp_path / "a.mcap", URDF)
    text, found, _remarks = fill_in(str(path), None, "arm.urdf", str(limits))
    assert found.content == URDF.encode()
    assert '# not of this arm, left out: "finger"' in text
    file = tmp_path / "cell.toml"
    file.write_text(text.replace('tool = "____"', 'tool = "t.toml"').replace("____", "0.05"))
    robot = Cell.from_toml(file).robot
    assert robot.urdf.endswith("arm.urdf")
    turn, slide = robot.limits["turn"], robot.limits["slide"]
    assert (turn.velocity_rad_s, turn.acceleration_rad_s2, turn.velocity_m_s) == (2.5, None, None)
    assert (slide.acceleration_m_s2, slide.jerk_m_s3, slide.velocity_m_s) == (1.0, 20.0, None)


# /tf_static.


def transform(types, parent="base", child="tool", xyz=(1.0, 2.0, 3.0), quaternion=(0.0, 0.0, 0.0, 1.0)):
    kinds = types.types
    return kinds["geometry_msgs/msg/TransformStamped"](
        header(types, 0, parent),
        child,
        kinds["geometry_msgs/msg/Transform"](
            kinds["geometry_msgs/msg/Vector3"](*xyz), kinds["geometry_msgs/msg/Quaternion"](*quaternion)
        ),
    )


def tf(*transforms):
    types = store()
    message = types.types[TF]([transform(types, **each) for each in transforms])
    return through(types, TF, message, "/tf_static")


def test_transforms_are_those_of_scipy(rng, count):
    for _ in range(count(300)):
        turn, xyz = Rotation.random(random_state=rng), rng.normal(size=3)
        quaternion = turn.as_quat() * rng.uniform(0.9995, 1.0005)
        (found,) = read_transforms(tf({"xyz": xyz, "quaternion": quaternion, "parent": "/world"}))
        assert (found.parent, found.child) == ("world", "tool")
        np.testing.assert_array_equal(found.xyz_m, xyz)
        np.testing.assert_allclose(found.rotation, turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"quaternion": (0, 0, 0, 0)}, "frame tool: a quaternion of length 0; that of a rotation is 1"),
        ({"quaternion": (0, 0, 0, 1.01)}, "a quaternion of length 1.01"),
        ({"quaternion": (0, math.nan, 0, 1)}, "every number must be finite"),
        ({"xyz": (1, math.inf, 0)}, "every number must be finite"),
        ({"xyz": (1e5, 0, 0)}, "within 1e4 m"),
        ({"parent": ""}, "both frames must have a name"),
        ({"child": "/"}, "both frames must have a name"),
        ({"parent": "/tool"}, "frame tool stands in itself"),
    ],
)
def test_transforms_that_are_refused(wrong, why):
    assert why in refused(read_transforms, tf(wrong))


def test_a_frame_stands_in_one_place():
    first, again = tf({}, {"child": "camera"}), tf({})
    found = together([*read_transforms(first), *read_transforms(again)])
    assert set(found) == {"tool", "camera"}
    moved = tf({"xyz": (1.0, 2.0, 3.001)})
    assert "a static frame stands in one place" in refused(
        together, [*read_transforms(first), *read_transforms(moved)]
    )
    assert "without transforms" in refused(read_transforms, loose(first, transforms=None))
    broken = SimpleNamespace(header=SimpleNamespace(frame_id="a"), child_frame_id="b", transform=3)
    assert "without translation" in refused(read_transforms, loose(first, transforms=[broken]))
