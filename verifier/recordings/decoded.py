"""One message of a foreign recording, decoded, and how a source that cannot be read is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


class SourceError(ValueError):
    """A message that cannot be translated: one line that says what is wrong, and what would be right."""


@dataclass(frozen=True, slots=True)
class Decoded:
    """One message.

    Attributes
    ----------
    topic:
        Where it was published.
    schema:
        Its type in ROS 2 spelling, for ROS 1 too: ``"sensor_msgs/msg/JointState"``.
    log_time_ns:
        When it arrived [ns].
    value:
        Attributes as the ``.msg`` file has them; of a JSON message, the object.
    """

    topic: str
    schema: str
    log_time_ns: int
    value: Any
