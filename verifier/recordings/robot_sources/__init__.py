"""What drivers and controllers of arms say, in our words: one adapter for each kind of message."""

from __future__ import annotations

from collections.abc import Mapping

from verifier.recordings.robot_sources.controller_state import ControllerStates
from verifier.recordings.robot_sources.franka_state import FrankaRobotStates, FrankaStates
from verifier.recordings.robot_sources.joint_sample import JointAdapter, JointSample
from verifier.recordings.robot_sources.joint_states import JointStates

__all__ = ["ADAPTERS", "JointAdapter", "JointSample"]

ADAPTERS: Mapping[str, JointAdapter] = {
    schema: adapter
    for adapter in (JointStates(), ControllerStates(), FrankaRobotStates(), FrankaStates())
    for schema in adapter.schemas
}
"""Message type -> what reads it."""
