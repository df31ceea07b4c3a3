"""``sensor_msgs/msg/JointState``, of ROS 2 and of ROS 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_state import NANO, SCHEMA_NAME, FloatArray, JointState
from verifier.recordings.robot_sources.adapter import JointSample

_NONE: FloatArray = np.zeros(0)


class JointStateSource:
    """Joint positions, rates and efforts as they stand in the message; what it lacks stays away."""

    schemas: tuple[str, ...] = (SCHEMA_NAME,)

    def read(self, message: Decoded) -> JointSample:
        """Read one message; rates and efforts of another number than the positions are left away.

        Raises
        ------
        SourceError
            Names, positions or stamp are not there.
        """
        value = message.value
        try:
            names = tuple(map(str, value.name))
            position, velocity, effort = (
                _doubles(each) for each in (value.position, value.velocity, value.effort)
            )
            stamp = int(value.header.stamp.sec) * NANO + int(value.header.stamp.nanosec)
            frame = str(value.header.frame_id)
        except (AttributeError, TypeError, ValueError) as error:
            raise SourceError(f"has not the fields of {SCHEMA_NAME} ({error})") from error
        velocity, effort = (each if len(each) == len(position) else _NONE for each in (velocity, effort))
        return JointSample(JointState(stamp, names, position, velocity, effort, frame))


def _doubles(values: Any) -> FloatArray:
    return np.asarray(values, np.float64)
