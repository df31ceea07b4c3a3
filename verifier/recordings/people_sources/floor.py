"""Positions on the floor: trackers that say where somebody stands, and nothing of the body.

What they say is put as a pelvis within a ball: at half the greatest height of a pelvis above the floor, with
an error that holds every height and the horizontal error that the user states. So it is true for every model
of people, and model *pedestrian* takes the whole body from it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from occupancy.body import MAX_POINTS, Point
from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.floor_position import HIGHEST_PELVIS_M, pelvis_above
from verifier.recordings.people_report import ReportedPerson
from verifier.recordings.people_sources.source import (
    FloorPositions,
    ReportMaker,
    Reports,
    SourceOptions,
    field_of,
    header_of,
)

UP = (0.0, 0.0, 1.0)


class _Floor:
    """People from positions on the floor."""

    def __init__(self, options: SourceOptions, title: str) -> None:
        self._floor = options.floor
        self._maker = ReportMaker(title, must_be_seen=False)

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """List what a position on the floor was taken to say."""
        if self._floor is None:
            return ()
        stated = "stated by the user: horizontal distance of the pelvis from the position that is reported"
        height = (
            "lying to tiptoe: 0.53 of 1.9 m and a margin; not for who climbs, jumps or stands on something"
        )
        return (
            Assumption("recording.floor_error", self._floor.error_m, "m", stated, Certainty.DECLARED),
            Assumption(
                "recording.floor_z", self._floor.floor_z_m, "m", "stated by the user", Certainty.DECLARED
            ),
            Assumption("recording.highest_pelvis", HIGHEST_PELVIS_M, "m", height, Certainty.ASSUMED),
        )

    def finish(self) -> Reports:
        """Judge what has been seen; see :class:`PeopleAdapter`."""
        return self._maker.finish()

    def _report(self, message: Decoded, places: Iterable[tuple[str, Any]]) -> Reports:
        if self._floor is None:
            raise SourceError(
                f"{message.topic} has positions on the floor, which say nothing of the body; state how far "
                "the pelvis may be from them: error_m in [recording.floor] of the cell"
            )
        header = header_of(message.value)
        if header.frame in self._floor.tilted:
            raise SourceError(
                f"{message.topic} has positions on the floor in frame {header.frame}, whose z does not point "
                "up in the cell: publish them in one whose z does"
            )
        people = [_pelvis(name, place, self._floor) for name, place in places]
        return self._maker.report(message, header, people)


class PeoplePositions(_Floor):
    """Reads ``people_msgs/People``; a person's name is their id."""

    schemas = ("people_msgs/msg/People",)

    def __init__(self, options: SourceOptions) -> None:
        super().__init__(options, "people_msgs")

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        people = field_of(message.value, "people")
        return self._report(message, [(str(field_of(p, "name")), field_of(p, "position")) for p in people])


class PosePositions(_Floor):
    """Reads ``geometry_msgs/PoseArray``; nothing says who is who, so people are numbered in the order given.

    Where that order changes, people jump, which contradicts the profile.
    """

    schemas = ("geometry_msgs/msg/PoseArray",)

    def __init__(self, options: SourceOptions) -> None:
        super().__init__(options, "the poses")

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        poses = field_of(message.value, "poses")
        return self._report(
            message, [(f"p{n}", field_of(pose, "position")) for n, pose in enumerate(poses, 1)]
        )


class PointPosition(_Floor):
    """Reads ``geometry_msgs/PointStamped`` or ``PoseStamped``: one person."""

    schemas = ("geometry_msgs/msg/PointStamped", "geometry_msgs/msg/PoseStamped")

    def __init__(self, options: SourceOptions) -> None:
        super().__init__(options, "the positions")

    def read(self, message: Decoded) -> Reports:
        """Return the report about the person; see :class:`PeopleAdapter`."""
        point = message.schema == self.schemas[0]
        return self._report(message, [("p1", field_of(message.value, "point" if point else "pose.position"))])


def _pelvis(name: str, place: Any, floor: FloorPositions) -> ReportedPerson:
    """Return somebody whose pelvis is within the cylinder of a position, by the ball around it.

    A position of exactly 0, 0, 0 is none, as everywhere.
    """
    xyz = np.full((MAX_POINTS, 3), np.nan)
    x, y, z = (field_of(place, axis) for axis in "xyz")
    pelvis, error_m = pelvis_above((x, y, floor.floor_z_m), floor.error_m, UP)
    if np.isfinite(pelvis).all() and any((x, y, z)):
        xyz[Point.PELVIS] = pelvis
    return ReportedPerson(name, xyz, np.full(MAX_POINTS, error_m), 1 << Point.PELVIS)
