"""Messages of arms, encoded and decoded by rosbags from public definitions of their fields.

Sources: ros-controls/control_msgs, control_msgs/msg/JointTrajectoryControllerState.msg; franka_msgs/msg/
FrankaRobotState.msg of frankaemika/franka_ros2 and FrankaState.msg of frankaemika/franka_ros. Fields that are
not read are left away.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from verifier.recordings.decoded import Decoded

NANO = 1_000_000_000
STATE = "sensor_msgs/msg/JointState"
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
FRANKA = "franka_msgs/msg/FrankaRobotState"
FRANKA_1 = "franka_msgs/msg/FrankaState"

POINT = "trajectory_msgs/JointTrajectoryPoint"
CONTROLLER_NEW = f"""std_msgs/Header header
string[] joint_names
{POINT} reference
{POINT} feedback
{POINT} error
{POINT} output
"""
CONTROLLER_BOTH = f"""{CONTROLLER_NEW}{POINT} desired
{POINT} actual
"""
CONTROLLER_OLD = f"""std_msgs/Header header
string[] joint_names
{POINT} desired
{POINT} actual
{POINT} error
"""
FRANKA_NEW = """std_msgs/Header header
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
sensor_msgs/JointState measured_joint_motor_state
float64[7] ddq_d
float64[7] dtau_j
"""
FRANKA_OLD = """std_msgs/Header header
float64[6] cartesian_collision
float64[7] q
float64[7] q_d
float64[7] dq
float64[7] dq_d
float64[7] tau_J
float64[7] dtau_J
float64[7] tau_J_d
"""

JOINTS = ("shoulder", "elbow", "wrist")


@cache
def store(schema="", definition="", base=Stores.ROS2_HUMBLE):
    """Types of a distribution, with one more."""
    types = get_typestore(base)
    if schema:
        types.register(get_types_from_msg(definition, schema))
    return types


def header(types, stamp_ns, frame="base"):
    named = types.types
    seconds, nanoseconds = divmod(stamp_ns, NANO)
    more = {"seq": 0} if "seq" in named["std_msgs/msg/Header"].__dataclass_fields__ else {}
    stamp = named["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return named["std_msgs/msg/Header"](**more, stamp=stamp, frame_id=frame)


def joint_state(types, stamp_ns, names, position, velocity=(), effort=()):
    numbers = [np.array(values, np.float64) for values in (position, velocity, effort)]
    return types.types[STATE](header(types, stamp_ns), list(names), *numbers)


def point(types, positions=(), velocities=()):
    none = np.zeros(0)
    zero = types.types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    arrays = [np.array(values, np.float64) for values in (positions, velocities)]
    return types.types["trajectory_msgs/msg/JointTrajectoryPoint"](*arrays, none, none, zero)


def through(types, schema, message, topic="/topic", log_time_ns=7, ros1=False):
    """Encode and decode a message as a container would."""
    if ros1:
        value = types.deserialize_ros1(types.serialize_ros1(message, schema), schema)
    else:
        value = types.deserialize_cdr(types.serialize_cdr(message, schema), schema)
    return Decoded(topic, schema, log_time_ns, value)


def loose(message, **changed):
    """The same message with other values, also such that no encoder would take."""
    value = {name: getattr(message.value, name) for name in message.value.__dataclass_fields__}
    for name, new in changed.items():
        if new is None:
            del value[name]
        else:
            value[name] = new
    return Decoded(message.topic, message.schema, message.log_time_ns, SimpleNamespace(**value))
