"""Sources that are refused for what they are: skeletons in an image."""

from __future__ import annotations

from typing import NoReturn

from robots.assumption import Assumption
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_sources.source import Reports, SourceOptions


class HriSkeleton2D:
    """Refuses ``hri_msgs/Skeleton2D``, whose key points are parts of the width and height of an image."""

    schemas = ("hri_msgs/msg/Skeleton2D",)

    def __init__(self, _options: SourceOptions) -> None:
        pass

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Nothing is read, so nothing is assumed."""
        return ()

    def read(self, message: Decoded) -> NoReturn:
        """Refuse the message; see :class:`PeopleAdapter`."""
        raise SourceError(
            f"{message.topic} has 2-D skeletons, in parts of an image; ROS4HRI has the same bodies in 3-D as "
            "frames on /tf: record /tf and /tf_static"
        )

    def finish(self) -> Reports:
        """Nothing is left to say."""
        return ()
