"""``sensor_msgs/JointState``: what most drivers publish."""

from __future__ import annotations

from verifier.recordings.decoded import Decoded
from verifier.recordings.robot_sources.joint_sample import JointSample, field, names_of


class JointStates:
    """Positions as measured; velocities and efforts where there is one for each joint."""

    schemas = ("sensor_msgs/msg/JointState",)

    def read(self, message: Decoded) -> JointSample:
        """Return what a message says.

        Source: ros2/common_interfaces, sensor_msgs/msg/JointState.msg: arrays may be empty, else they must
        have the length of ``name``. A message without names is in the order of the model.

        Raises
        ------
        SourceError
            Lengths differ, a name stands there twice, or a position is no number.
        """
        value = message.value
        names = names_of(message, field(message, value, "name"))
        q, dq, tau = (field(message, value, each) for each in ("position", "velocity", "effort"))
        return JointSample(names.state(q, dq, tau, "the message"))
