"""``franka_msgs``: the state of a Franka arm, of ROS 2 and of ROS 1."""

from __future__ import annotations

from typing import Any

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.robot_sources.joint_sample import JointSample, field, names_of

JOINTS = 7


class FrankaRobotStates:
    """``FrankaRobotState``: measured and desired joint states, with names."""

    schemas = ("franka_msgs/msg/FrankaRobotState",)

    def read(self, message: Decoded) -> JointSample:
        """Return what a message says; earlier versions with ``q`` and ``q_d`` too.

        Source: frankaemika/franka_ros2, franka_msgs/msg/FrankaRobotState.msg, FrankaState.msg.

        Raises
        ------
        SourceError
            It has neither fields, lengths differ, or a position is no number.
        """
        value = message.value
        if not hasattr(value, "measured_joint_state"):
            return _numbered(message)
        measured, desired = value.measured_joint_state, field(message, value, "desired_joint_state")
        names = names_of(message, field(message, measured, "name"))
        if not names.joints:
            raise SourceError("measured_joint_state names no joints; its name must list them")
        state = names.state(measured.position, measured.velocity, measured.effort, "measured_joint_state")
        if not len(desired.position):
            return JointSample(state)
        if tuple(desired.name) not in ((), names.joints):
            raise SourceError(
                f"desired_joint_state is of {', '.join(desired.name)}, measured_joint_state of "
                f"{', '.join(names.joints)}; both must be of the same joints"
            )
        return JointSample(
            state, names.state(desired.position, desired.velocity, desired.effort, "desired_joint_state")
        )


class FrankaStates:
    """``FrankaState`` of franka_ros and of the first franka_ros2: seven numbers each, without names."""

    schemas = ("franka_msgs/msg/FrankaState",)

    def read(self, message: Decoded) -> JointSample:
        """Return what a message says; its joints have no names, they are in the order of the arm.

        Source: frankaemika/franka_ros, franka_msgs/msg/FrankaState.msg.

        Raises
        ------
        SourceError
            A field is missing, has not seven numbers, or a position is no number.
        """
        return _numbered(message)


def _numbered(message: Decoded) -> JointSample:
    value = message.value
    names = names_of(message, ())

    def numbers(*fields: str) -> Any:
        found = field(message, value, *fields)
        if len(found) != JOINTS:
            raise SourceError(f"{fields[0]} has {len(found)} numbers; a Franka arm has {JOINTS} joints")
        return found

    return JointSample(
        names.state(numbers("q"), numbers("dq"), numbers("tau_J", "tau_j"), "q"),
        names.state(numbers("q_d"), numbers("dq_d"), numbers("tau_J_d", "tau_j_d"), "q_d"),
    )
