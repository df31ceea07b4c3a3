"""A message of a foreign recording as its container decoded it, and how a source says that it is unusable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


class SourceError(ValueError):
    """A message that says nothing usable: one line, what is wrong, and what would be right."""


@dataclass(frozen=True, slots=True)
class Decoded:
    """One message.

    Attributes
    ----------
    topic:
        Where it was published.
    schema:
        Its type in the spelling of ROS 2, for ROS 1 too: ``"sensor_msgs/msg/JointState"``.
    log_time_ns:
        When it arrived [ns].
    value:
        Attributes as the message definition names them; for JSON a dict.
    """

    topic: str
    schema: str
    log_time_ns: int
    value: Any
