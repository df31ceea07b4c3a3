"""Where reports about people come from: one adapter per type of message."""

from __future__ import annotations

from collections.abc import Mapping

from verifier.recordings.people_sources.adapter import PeopleAdapter
from verifier.recordings.people_sources.own import OwnPeople

__all__ = ["ADAPTERS", "GENERAL", "PeopleAdapter"]

ADAPTERS: Mapping[str, PeopleAdapter] = {
    schema: adapter for adapter in (OwnPeople(),) for schema in adapter.schemas
}
"""Type of message -> what reads it."""

GENERAL = frozenset(
    {
        "std_msgs/msg/String",
        "visualization_msgs/msg/MarkerArray",
        "tf2_msgs/msg/TFMessage",
        "geometry_msgs/msg/PoseArray",
        "geometry_msgs/msg/PointStamped",
    }
)
"""Types that say other things as well: a topic of one of these is taken only if it is named, or is ours."""
