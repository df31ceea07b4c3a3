"""Skeletons by index in JSON, ``stopproof.Skeletons``: for trackers without a message type of their own.

::

    {"stamp": s, "frame": "camera", "joint_set": "mediapipe_33",
     "people": [{"id": "p1", "xyz_m": [[x, y, z], null, …], "visibility": [0.9, …]}]}

``joint_set`` is one of ``joint_sets.toml``; ``xyz_m`` has one entry per joint [m, in the frame of a sensor],
``null`` where nothing was measured; ``visibility`` (0 to 1) is what the tracker says of each, and needed of
MediaPipe, which makes up what it does not see. What MediaPipe itself writes is refused: ``pose_landmarks``
are parts of an image, ``pose_world_landmarks`` are centred at the hips; both need the depth of a camera.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_sets import JointSet, joint_set
from verifier.recordings.people_report import MAX_STAMP_S, NANO, Flaw, ReportedPerson
from verifier.recordings.people_sources.source import (
    Header,
    ReportMaker,
    Reports,
    SourceOptions,
    without_points,
)

VISIBLE = 0.5
"""Joints of a lower visibility are inferred: an engineering choice."""
NEEDS_VISIBILITY = "mediapipe_33"
HIP_CENTRED = ("pose_world_landmarks", "world_landmarks", "poseWorldLandmarks", "worldLandmarks")
IN_THE_IMAGE = ("pose_landmarks", "landmarks", "poseLandmarks", "keypoints_2d", "pose_keypoints_2d")
_RIGHT = 'needed are "xyz_m": positions in m in the frame of a camera, by its depth'


class JsonSkeletons:
    """Reads ``stopproof.Skeletons``; one report per message."""

    schemas = ("stopproof.Skeletons",)

    def __init__(self, _options: SourceOptions) -> None:
        self._set: JointSet | None = None
        self._maker = ReportMaker("the skeletons")
        self._by_visibility = False

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Name the joint set, and from which visibility on a joint was taken to be seen."""
        found: tuple[Assumption, ...] = () if self._set is None else (self._set.assumption(),)
        if self._by_visibility:
            source = "engineering choice: joints of a lower visibility are inferred"
            found += (Assumption("recording.visibility", VISIBLE, "", source, Certainty.ASSUMED),)
        return found

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        value = message.value
        if not isinstance(value, Mapping):
            raise SourceError("a message is no JSON object; needed are stamp, frame, joint_set and people")
        _refuse_other_landmarks(value)
        used = self._joint_set(value.get("joint_set"))
        header = Header(_stamp_ns(value.get("stamp")), _text(value, "frame"))
        entries = value.get("people")
        if not isinstance(entries, list):
            raise SourceError('"people" must be a list')
        flaws: list[Flaw] = []
        people = [self._person(used, entry, header.stamp_ns, flaws) for entry in entries]
        return self._maker.report(message, header, people, flaws)

    def finish(self) -> Reports:
        """Judge what has been seen; see :class:`PeopleAdapter`."""
        return self._maker.finish()

    def _joint_set(self, name: object) -> JointSet:
        used = joint_set(name)
        if not all(isinstance(joint, int) for joint in used.joints):
            raise SourceError(f"joint set {used.name} has names, no indices")
        if self._set is None:
            self._set = used
            self._maker = ReportMaker(used.title)
        elif used != self._set:
            raise SourceError(f"skeletons are of {self._set.title} and {used.title}; one stream has one set")
        return used

    def _person(self, used: JointSet, entry: Any, stamp_ns: int, flaws: list[Flaw]) -> ReportedPerson:
        if not isinstance(entry, Mapping):
            raise SourceError('a person must be an object with "id" and "xyz_m"')
        _refuse_other_landmarks(entry)
        name = _text(entry, "id")
        try:
            xyz = _positions(entry.get("xyz_m"), len(used.joints))
            visibility = _visibility(entry.get("visibility"), len(used.joints))
        except _PersonError as error:
            flaws.append(Flaw(stamp_ns, name, None, str(error)))
            return without_points(name)
        if visibility is None:
            if used.name == NEEDS_VISIBILITY:
                raise SourceError(
                    f'"visibility" is missing: {used.title} makes up what it does not see, and that must not '
                    "count as measured"
                )
            return used.person(name, xyz, np.zeros(len(xyz), np.bool_))
        self._by_visibility = True
        return used.person(name, xyz, ~(visibility >= VISIBLE))


class _PersonError(ValueError):
    """What is wrong with one person."""


def _refuse_other_landmarks(value: Mapping[str, Any]) -> None:
    for key in HIP_CENTRED:
        if key in value:
            raise SourceError(f'"{key}" are centred at the hips and do not say where the person is; {_RIGHT}')
    for key in IN_THE_IMAGE:
        if key in value:
            raise SourceError(f'"{key}" are places in an image, 2-D; {_RIGHT}')


def _text(value: Mapping[str, Any], key: str) -> str:
    text = value.get(key)
    if not isinstance(text, str) or not text:
        raise SourceError(f'"{key}" must be a text')
    return text


def _stamp_ns(value: object) -> int:
    seconds = _number(value)
    if not abs(seconds) < MAX_STAMP_S:
        raise SourceError('"stamp" must be a number of seconds: when it was seen')
    return round(seconds * NANO)


def _number(value: object) -> float:
    """A JSON number as float; NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    return float(value) if abs(value) < 1e300 else math.nan


def _positions(value: object, joints: int) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) != joints:
        raise _PersonError(f'"xyz_m" must have {joints} entries')
    xyz = np.full((joints, 3), np.nan)
    for row, place in enumerate(value):
        if place is None:
            continue
        if not isinstance(place, list) or len(place) != 3:
            raise _PersonError(f'entry {row} of "xyz_m" must be three numbers, or null')
        xyz[row] = [_number(number) for number in place]
    return xyz


def _visibility(value: object, joints: int) -> NDArray[np.float64] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != joints:
        raise _PersonError(f'"visibility" must have {joints} numbers')
    return np.array([_number(number) for number in value])
