"""``control_msgs/JointTrajectoryControllerState``: what a trajectory controller commanded, and what came."""

from __future__ import annotations

from typing import Any

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_state import JointState
from verifier.recordings.robot_sources.joint_sample import JointSample, Names, field, names_of

_MEASURED = ("feedback", "actual")
_COMMANDED = ("reference", "desired")


class ControllerStates:
    """Feedback and reference of one stamp, in fields of both versions of the message.

    ``error`` is not read, it is their difference and of either sign in different versions; nor is
    ``output``, what the controller asks of the drive.
    """

    schemas = ("control_msgs/msg/JointTrajectoryControllerState",)

    def read(self, message: Decoded) -> JointSample:
        """Return what a message says.

        Source: ros-controls/control_msgs, JointTrajectoryControllerState.msg: ``reference`` and ``feedback``,
        before version 4 ``desired`` and ``actual``; some versions have both, and the old ones empty.

        Raises
        ------
        SourceError
            It has neither field, no names, no measured positions; lengths differ, or a position is no number.
        """
        value = message.value
        names = names_of(message, field(message, value, "joint_names"))
        if not names.joints:
            raise SourceError("the controller names no joints; joint_names must list them")
        measured = _point(message, names, _MEASURED)
        if measured is None:
            raise SourceError(
                f"{' and '.join(name for name in _MEASURED if hasattr(value, name))} without positions; a "
                "controller that is given velocities or efforts alone measures none: record sensor_msgs/"
                "JointState"
            )
        return JointSample(measured, _point(message, names, _COMMANDED))


def _point(message: Decoded, names: Names, fields: tuple[str, ...]) -> JointState | None:
    """The first of these fields that holds positions; ``None``: none does."""
    field(message, message.value, *fields)
    for name in fields:
        point: Any = getattr(message.value, name, None)
        if point is None:
            continue
        q, dq, tau = (field(message, point, each) for each in ("positions", "velocities", "effort"))
        if len(q):
            return names.state(q, dq, tau, name)
    return None
