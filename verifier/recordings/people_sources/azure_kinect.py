"""Azure Kinect body tracking as its ROS driver publishes it: ``visualization_msgs/MarkerArray``.

A marker's id is body · 100 + joint; neither ``ns`` nor ``text`` is set, the stamp is that of the image
(microsoft/Azure_Kinect_ROS_Driver, docs/usage.md and k4a_ros_device.cpp).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_sets import joint_set
from verifier.recordings.people_report import Flaw, ReportedPerson
from verifier.recordings.people_sources.source import (
    Header,
    ReportMaker,
    Reports,
    SourceOptions,
    field_of,
    header_of,
    without_points,
)

ADD, DELETE, DELETEALL, SPHERE = 0, 2, 3, 2
"""``action`` and ``type`` of visualization_msgs/Marker; there is no other action."""
OLD_JOINTS = 26
"""Body tracking SDKs before 1.0 have this many joints, with other indices."""


class AzureKinectMarkers:
    """Reads ``MarkerArray`` of the Azure Kinect driver; one report per message."""

    schemas = ("visualization_msgs/msg/MarkerArray",)

    def __init__(self, _options: SourceOptions) -> None:
        self._set = joint_set("azure_kinect_32")
        self._maker = ReportMaker(self._set.title)

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Name the set of joints, and what the markers do not tell."""
        source = (
            "the markers carry no confidence: joints that the tracker predicts while hidden look the same"
        )
        all_seen = Assumption("recording.joints_measured", "all", "", source, Certainty.ASSUMED)
        return (self._set.assumption(), all_seen)

    def read(self, message: Decoded) -> Reports:
        """Return the report about the bodies of a message; see :class:`PeopleAdapter`.

        Empty: an array without markers, which has no stamp.
        """
        markers = list(field_of(message.value, "markers"))
        if not markers:
            return ()
        headers = {header_of(marker) for marker in markers}
        header = max(headers)
        flaws: list[Flaw] = []
        people = [
            self._body(body, joints, header.stamp_ns, flaws) for body, joints in _bodies(markers).items()
        ]
        if len(headers) > 1:
            reason = "its markers have several stamps or frames"
            flaws.append(Flaw(message.log_time_ns, None, None, reason))
            people = [without_points(person.id) for person in people]
            header = Header(message.log_time_ns, header.frame)
        return self._maker.report(message, header, people, flaws)

    def finish(self) -> Reports:
        """Judge what has been seen; see :class:`PeopleAdapter`."""
        return self._maker.finish()

    def _body(
        self, body: int, joints: list[tuple[int, Any]], stamp_ns: int, flaws: list[Flaw]
    ) -> ReportedPerson:
        numbers = [joint for joint, _ in joints]
        if max(numbers) >= len(self._set.joints):
            raise SourceError(
                f"marker id {100 * body + max(numbers)} is joint {max(numbers)}; ids must be body * 100 + "
                f"joint, as the Azure Kinect driver has them, with {len(self._set.joints)} joints"
            )
        if max(numbers) < OLD_JOINTS:
            raise SourceError(
                f"body {body} has joints up to {max(numbers)} only, as body tracking SDKs before 1.0 have, "
                f"with other indices; record {self._set.title} with SDK 1.0 or later"
            )
        xyz = np.full((len(self._set.joints), 3), np.nan)
        for joint, position in joints:
            xyz[joint] = [field_of(position, axis) for axis in "xyz"]
        for joint in {number for number in numbers if numbers.count(number) > 1}:
            xyz[joint] = np.nan
            flaws.append(Flaw(stamp_ns, str(body), None, f"joint {joint} stands there twice"))
        return self._set.person(str(body), xyz, np.zeros(len(xyz), np.bool_))


def _bodies(markers: list[Any]) -> dict[int, list[tuple[int, Any]]]:
    """Return body -> (joint, position) of the markers that are shown."""
    found: dict[int, list[tuple[int, Any]]] = {}
    for marker in markers:
        action = int(field_of(marker, "action"))
        if action in (DELETE, DELETEALL):
            continue
        number = int(field_of(marker, "id"))
        if action != ADD or number < 0 or not _is_joint(marker):
            raise SourceError(
                f"marker {number} of type {marker.type} in namespace {str(marker.ns)[:40]!r} is none of a "
                "body; those of the Azure Kinect driver are spheres without namespace and text"
            )
        body, joint = divmod(number, 100)
        found.setdefault(body, []).append((joint, field_of(marker, "pose.position")))
    return found


def _is_joint(marker: Any) -> bool:
    plain = not field_of(marker, "ns") and not field_of(marker, "text")
    return plain and int(field_of(marker, "type")) == SPHERE


def has_a_body(value: Any) -> bool:
    """Whether a marker array has a body with as many joints as some body tracking SDK has."""
    joints: dict[int, set[int]] = {}
    for marker in field_of(value, "markers"):
        if int(field_of(marker, "action")) == ADD:
            if not _is_joint(marker):
                return False
            body, joint = divmod(int(field_of(marker, "id")), 100)
            joints.setdefault(body, set()).add(joint)
    return any(len(found) >= OLD_JOINTS for found in joints.values())
