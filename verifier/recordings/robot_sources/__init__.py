"""Where an arm's joints come from: one adapter per type of message."""

from __future__ import annotations

from collections.abc import Mapping

from verifier.recordings.robot_sources.adapter import JointAdapter, JointSample
from verifier.recordings.robot_sources.joint_state_source import JointStateSource

__all__ = ["ADAPTERS", "JointAdapter", "JointSample"]

ADAPTERS: Mapping[str, JointAdapter] = {
    schema: adapter for adapter in (JointStateSource(),) for schema in adapter.schemas
}
"""Type of message -> what reads it."""
