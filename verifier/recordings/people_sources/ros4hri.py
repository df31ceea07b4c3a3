"""ROS4HRI: people as frames of TF, ``head_<id>``, ``l_elbow_<id>``, … below ``body_<id>``.

Each frame is given relative to another one, spread over messages, and some on ``/tf_static``. The points of a
person and stamp are those whose way up to the parent of ``body_<id>`` has that stamp all along, or is static.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_sets import joint_set
from verifier.recordings.people_report import Flaw, PeopleReport, ReportedPerson
from verifier.recordings.people_sources.source import (
    ROS4HRI_ERROR_M,
    Header,
    ReportMaker,
    SourceOptions,
    field_of,
    header_of,
    with_error,
)

STATIC_TOPIC = "tf_static"
ROOT = re.compile(r"body_([A-Za-z0-9]+)")
LONGEST_WAY = 16
"""More frames than lie between any of a person's points and the root; also ends loops."""
ROUNDING = 1e-3
"""A quaternion's norm may be off by this from 1."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A frame in its parent: ``x_parent = rotation x + translation``; static ones have no stamp."""

    parent: str
    stamp_ns: int | None
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


class Ros4HriFrames:
    """Reads ``/tf`` and ``/tf_static``; one report per stamp, once a later one has come."""

    schemas = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

    def __init__(self, options: SourceOptions) -> None:
        stated = options.ros4hri_error_m
        self._error_m = ROS4HRI_ERROR_M if stated is None else stated
        self._certainty = Certainty.DEFAULT if stated is None else Certainty.DECLARED
        self._set = joint_set("ros4hri")
        self._maker = ReportMaker(self._set.title, must_be_seen=False)
        self._links: dict[str, _Link] = {}
        self._frames: set[str] = set()
        self._last: Decoded | None = None
        self._flaws: list[Flaw] = []
        self._stamp_ns = 0

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Name the frames, and the error of their positions."""
        source = "the template of human_description has other proportions than people; the rest is assumed"
        if self._certainty is Certainty.DECLARED:
            source = "stated by the user"
        error = Assumption("recording.ros4hri_error", self._error_m, "m", source, self._certainty)
        return (self._set.assumption(), error)

    def read(self, message: Decoded) -> PeopleReport | None:
        """Return the report about the stamp before this message's, if any; see :class:`PeopleAdapter`."""
        static = message.topic.rsplit("/", 1)[-1] == STATIC_TOPIC
        links = [_link(transform, static) for transform in field_of(message.value, "transforms")]
        self._note_frames(frame for frame, _ in links)
        stamps = [link.stamp_ns for frame, link in links if frame in self._frames]
        stamp_ns = max((stamp for stamp in stamps if stamp is not None), default=None)
        if stamp_ns is None:
            self._links.update(links)
            return None
        if self._last is not None and stamp_ns < self._stamp_ns:
            reason = "frames came after those of a later stamp, and were left out"
            self._flaws.append(Flaw(stamp_ns, None, None, reason))
            return None
        done = None
        if stamp_ns > self._stamp_ns:
            done, self._stamp_ns = self._report(), stamp_ns
        self._links.update(links)
        self._last = message
        return done

    def finish(self) -> PeopleReport | None:
        """Return the report about the last stamp, and judge the bodies; see :class:`PeopleAdapter`."""
        report = self._report()
        self._last = None
        self._maker.finish()
        return report

    def _note_frames(self, frames: Iterable[str]) -> None:
        """Note the frames of bodies that are met for the first time."""
        for frame in frames:
            match = ROOT.fullmatch(frame)
            if match is not None and frame not in self._frames:
                self._frames |= {f"{joint}_{match[1]}" for joint in self._set.joints}

    def _report(self) -> PeopleReport | None:
        """Return the report about everybody whose root has the present stamp."""
        if self._last is None:
            return None
        people: list[ReportedPerson] = []
        frame = ""
        for body, root in list(self._links.items()):
            match = ROOT.fullmatch(body)
            if match is None or root.stamp_ns != self._stamp_ns:
                continue
            frame = frame or root.parent
            if root.parent != frame:
                reason = f"is in {root.parent}, others are in {frame}: one report has one frame"
                self._flaws.append(Flaw(self._stamp_ns, match[1], None, reason))
            people.append(self._person(match[1], root.parent if root.parent == frame else None))
        flaws, self._flaws = self._flaws, []
        if not people:
            return None
        return self._maker.report(self._last, Header(self._stamp_ns, frame), people, flaws)

    def _person(self, name: str, top: str | None) -> ReportedPerson:
        """Return somebody's points in the frame ``top``; ``None``: in no frame that could be named."""
        xyz = np.full((len(self._set.joints), 3), np.nan)
        if top is not None:
            for row, joint in enumerate(self._set.joints):
                xyz[row] = self._place(f"{joint}_{name}", top)
        person = self._set.person(name, xyz, np.zeros(len(xyz), np.bool_))
        return with_error(person, self._error_m)

    def _place(self, frame: str, top: str) -> NDArray[np.float64]:
        """Return the origin of a frame in ``top``; NaN where the way there is not all of this stamp."""
        place = np.zeros(3)
        for _ in range(LONGEST_WAY):
            link = self._links.get(frame)
            if link is None or link.stamp_ns not in (None, self._stamp_ns):
                break
            place = link.rotation @ place + link.translation
            frame = link.parent
            if frame == top:
                return place
        return np.full(3, np.nan)


def has_a_body(value: Any) -> bool:
    """Whether a TF message has the root of somebody's body."""
    return any(ROOT.fullmatch(frame) for frame in _children(value))


def _children(value: Any) -> Iterator[str]:
    for transform in field_of(value, "transforms"):
        yield str(field_of(transform, "child_frame_id")).removeprefix("/")


def _link(transform: Any, static: bool) -> tuple[str, _Link]:
    header = header_of(transform)
    rotation = np.array([field_of(transform, f"transform.rotation.{axis}") for axis in "xyzw"], np.float64)
    place = np.array([field_of(transform, f"transform.translation.{axis}") for axis in "xyz"], np.float64)
    if np.isfinite(rotation).all() and abs(np.linalg.norm(rotation) - 1.0) <= ROUNDING:
        turned = Rotation.from_quat(rotation).as_matrix()
    else:
        turned = np.full((3, 3), np.nan)
    child = str(field_of(transform, "child_frame_id")).removeprefix("/")
    return child, _Link(header.frame, None if static else header.stamp_ns, turned, place)
