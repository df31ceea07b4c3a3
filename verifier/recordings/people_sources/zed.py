"""ZED body tracking: ``ObjectsStamped`` of zed_msgs, or of zed_interfaces as it was called before."""

from __future__ import annotations

from typing import Any

import numpy as np

from robots.assumption import Assumption
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_sets import JointSet, joint_set
from verifier.recordings.people_report import Flaw, ReportedPerson
from verifier.recordings.people_sources.source import (
    ReportMaker,
    Reports,
    SourceOptions,
    field_of,
    header_of,
    without_points,
)

FORMATS = {0: "zed_body_18", 1: "zed_body_34", 2: "zed_body_38", 3: "zed_body_70"}
"""``body_format`` of zed_msgs/msg/Object.msg."""
BY_SIZE = {18: "zed_body_18", 34: "zed_body_34", 38: "zed_body_38"}
"""Messages from before there was a ``body_format`` have as many key points as the set."""
OK, SEARCHING, TERMINATE = 1, 2, 3
"""``tracking_state``: seen; hidden, and estimated; hidden for the last time."""
THINGS = {"Vehicle", "Bag", "Animal", "Electronics", "Fruit/Vegetable", "Sport"}
"""Labels of the object detection (sl::OBJECT_CLASS) that are not people."""


class ZedObjects:
    """Reads ``ObjectsStamped``; one report per message.

    The key points stand in the first places of an array of 70, whichever set they are of: ``body_format``
    says which, never their number. Estimated bodies are inferred; (0, 0, 0) and NaN are missing points.
    """

    schemas = ("zed_msgs/msg/ObjectsStamped", "zed_interfaces/msg/ObjectsStamped")

    def __init__(self, _options: SourceOptions) -> None:
        self._set: JointSet | None = None
        self._maker = ReportMaker("ZED")

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Name the set of key points."""
        return () if self._set is None else (self._set.assumption(),)

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        header = header_of(message.value)
        people: list[ReportedPerson] = []
        flaws: list[Flaw] = []
        for thing in field_of(message.value, "objects"):
            label = str(field_of(thing, "label"))
            name = label or str(field_of(thing, "label_id"))
            if field_of(thing, "skeleton_available"):
                people.append(self._body(thing, name))
            elif label not in THINGS:
                reason = "has no skeleton; body tracking, not object detection, says where limbs are"
                people.append(without_points(f"{name} {field_of(thing, 'label_id')}"))
                flaws.append(Flaw(header.stamp_ns, people[-1].id, None, reason))
        return self._maker.report(message, header, people, flaws)

    def finish(self) -> Reports:
        """Judge what has been seen; see :class:`PeopleAdapter`."""
        return self._maker.finish()

    def _body(self, thing: Any, name: str) -> ReportedPerson:
        if not field_of(thing, "tracking_available"):
            raise SourceError(
                "tracking is off, so that nobody knows who is who; switch enable_tracking of the bodies on"
            )
        points = [field_of(key, "kp") for key in field_of(thing, "skeleton_3d.keypoints")]
        if any(np.shape(point) != (3,) for point in points):
            raise SourceError("its key points are no three numbers each: it is another type of the same name")
        xyz = np.array(points, np.float64).reshape(len(points), 3)
        used = self._joint_set(thing, len(xyz))
        rest = xyz[len(used.joints) :]
        if (np.isfinite(rest).all(axis=1) & rest.any(axis=1)).any():
            raise SourceError(
                f"{name} has more key points than {used.title}; body_format must say which set it is"
            )
        state = int(field_of(thing, "tracking_state"))
        if state not in (OK, SEARCHING, TERMINATE):
            return without_points(name)
        hidden = np.full(len(used.joints), state != OK)
        return used.person(name, xyz[: len(used.joints)], hidden)

    def _joint_set(self, thing: Any, points: int) -> JointSet:
        """Return the set that a body states, which must be that of all."""
        if hasattr(thing, "body_format"):
            name, stated = FORMATS.get(int(thing.body_format)), f"body_format {thing.body_format}"
        else:
            name, stated = BY_SIZE.get(points), f"a body of {points} key points and no body_format"
        if name is None:
            raise SourceError(f"{stated} is not known; known are {', '.join(FORMATS.values())}")
        used = joint_set(name)
        if points < len(used.joints):
            raise SourceError(f"a body has {points} key points; {used.title} has {len(used.joints)}")
        if self._set is None:
            self._set = used
            self._maker = ReportMaker(used.title)
        elif used != self._set:
            raise SourceError(f"bodies are of {self._set.title} and {used.title}; one stream has one set")
        return used
