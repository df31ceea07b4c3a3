"""A message of a recording of somebody else's format, decoded; and how what it says is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Decoded:
    """One message.

    Attributes
    ----------
    topic:
        Where it was published.
    schema:
        Its type in the spelling of ROS 2, for ROS 1 too: ``sensor_msgs/msg/JointState``.
    log_time_ns:
        When it arrived [ns].
    value:
        Attributes as the message definition has them; for JSON a ``dict``.
    """

    topic: str
    schema: str
    log_time_ns: int
    value: Any


class SourceError(ValueError):
    """A message that cannot be said in our words; one line: what is wrong, what would be right."""
