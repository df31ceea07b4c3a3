"""ROS4HRI: people as frames of TF, ``head_<id>``, ``l_elbow_<id>``, … below ``body_<id>``.

Each frame is given relative to another one, spread over messages, and some on ``/tf_static``. The points of a
person and stamp are those whose way up to the parent of ``body_<id>`` has that stamp all along, or is static.
People have stamps of their own: each report is about one of them, and whoever's ``body_<id>`` was met is in
one, if need be without points.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_sets import joint_set
from verifier.recordings.people_report import NANO, Flaw, ReportedPerson
from verifier.recordings.people_sources.source import (
    ROS4HRI_ERROR_M,
    Header,
    ReportMaker,
    Reports,
    SourceOptions,
    field_of,
    header_of,
    with_error,
    without_points,
)

STATIC_TOPIC = "tf_static"
ROOT = re.compile(r"((?:.*?/)?)body_(.*)", re.DOTALL)
"""An identifier may be any text (REP-155, Identifier Syntax); a prefix of ROS 1, up to a slash, may stand
before the frame."""
LONGEST_WAY = 16
"""More frames than lie between any of a person's points and the root; also ends loops."""
PATIENCE_NS = NANO
"""Frames of a stamp that come so much later than the others of it are not waited for."""
STATIC = "its frame is static, which does not say when it was there"
NO_ROOT = "its other frames have a stamp that the frame of its body does not have"
TOO_LATE = "frames came after those of a later stamp, or after the report of their own, and were left out"
ROUNDING = 1e-3
"""A quaternion's norm may be off by this from 1."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A frame in its parent: ``x_parent = rotation x + translation``; static ones have no stamp."""

    parent: str
    stamp_ns: int | None
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


@dataclass(slots=True)
class _Body:
    """Somebody, and the stamp whose frames are still coming; ``last``: the newest message with one."""

    name: str
    root: str
    frames: tuple[str, ...]
    stamp_ns: int | None = None
    last: Decoded | None = None


@dataclass(slots=True)
class _Said:
    """What one message says of the bodies, as it is read."""

    message: Decoded
    reports: list[Reports] = field(default_factory=list)
    told: set[tuple[str, str]] = field(default_factory=set)

    def once(self, body: _Body, reason: str) -> bool:
        """Whether this is the first time in the message."""
        new = (body.root, reason) not in self.told
        self.told.add((body.root, reason))
        return new


class Ros4HriFrames:
    """Reads ``/tf`` and ``/tf_static``; one report per person and stamp, once a later one has come."""

    schemas = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

    def __init__(self, options: SourceOptions) -> None:
        stated = options.ros4hri_error_m
        self._error_m = ROS4HRI_ERROR_M if stated is None else stated
        self._certainty = Certainty.DEFAULT if stated is None else Certainty.DECLARED
        self._set = joint_set("ros4hri")
        self._maker = ReportMaker(self._set.title, must_be_seen=False)
        self._links: dict[str, _Link] = {}
        self._bodies: dict[str, _Body] = {}
        self._owner: dict[str, _Body] = {}

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Name the frames, and the error of their positions."""
        source = "the template of human_description has other proportions than people; the rest is assumed"
        if self._certainty is Certainty.DECLARED:
            source = "stated by the user"
        error = Assumption("recording.ros4hri_error", self._error_m, "m", source, self._certainty)
        return (self._set.assumption(), error)

    def read(self, message: Decoded) -> Reports:
        """Return the reports about the stamps before this message's, if any; see :class:`PeopleAdapter`."""
        static = message.topic.rsplit("/", 1)[-1] == STATIC_TOPIC
        links = [_link(transform, static) for transform in field_of(message.value, "transforms")]
        for frame, _ in links:
            self._meet(frame)
        said = _Said(message)
        for body in self._bodies.values():
            if body.last is not None and message.log_time_ns - body.last.log_time_ns > PATIENCE_NS:
                said.reports.append(self._close(body))
        for frame, link in sorted(links, key=lambda each: each[1].stamp_ns or 0):
            self._take(frame, link, said)
        return _together(said.reports)

    def finish(self) -> Reports:
        """Return the reports about the last stamps, and judge the bodies; see :class:`PeopleAdapter`."""
        reports = [self._close(body) for body in self._bodies.values()]
        return _together([*reports, self._maker.finish()])

    def _meet(self, frame: str) -> None:
        """Note the frames of a body that is met for the first time."""
        match = ROOT.fullmatch(frame)
        if match is None or frame in self._bodies:
            return
        prefix, name = match.groups()
        frames = tuple(f"{prefix}{joint}_{name}" for joint in self._set.joints)
        self._bodies[frame] = _Body(f"{prefix}{name}", frame, frames)
        self._owner |= dict.fromkeys(frames, self._bodies[frame])

    def _take(self, frame: str, link: _Link, said: _Said) -> None:
        """Take in one transform."""
        body = self._owner.get(frame)
        if body is None:
            self._links[frame] = link
        elif link.stamp_ns is None:
            self._links[frame] = link
            if frame == body.root:
                said.reports.append(self._unplaced(body, link, said, STATIC))
        elif link.stamp_ns == 0:
            said.reports.append(self._unstamped(body, link, said))
        elif body.stamp_ns is not None and not self._goes_on(body, link.stamp_ns):
            said.reports.append(self._unplaced(body, link, said, TOO_LATE))
        else:
            if link.stamp_ns != body.stamp_ns:
                said.reports.append(self._close(body))
            self._links[frame] = link
            body.stamp_ns, body.last = link.stamp_ns, said.message

    def _goes_on(self, body: _Body, stamp_ns: int) -> bool:
        """Whether a frame with a stamp belongs to what is still to be said of a body."""
        assert body.stamp_ns is not None
        return stamp_ns > body.stamp_ns or (stamp_ns == body.stamp_ns and body.last is not None)

    def _unplaced(self, body: _Body, link: _Link, said: _Said, reason: str) -> Reports:
        """Say that somebody was there by the time of a message, and once in it why no more is known."""
        if not said.once(body, reason):
            return ()
        now = said.message.log_time_ns
        flaw = Flaw(now if link.stamp_ns is None else link.stamp_ns, body.name, None, reason)
        header = Header(now, self._parent(body, link))
        return self._maker.report(said.message, header, [without_points(body.name)], [flaw])

    def _unstamped(self, body: _Body, link: _Link, said: _Said) -> Reports:
        """Say that somebody was there by the time of a message whose frames of theirs have no stamp."""
        if not said.once(body, ""):
            return ()
        header = Header(0, self._parent(body, link))
        return self._maker.report(said.message, header, [without_points(body.name)])

    def _parent(self, body: _Body, link: _Link) -> str:
        """Frame in which a body is: only a declared one is read."""
        root = self._links.get(body.root)
        return link.parent if root is None else root.parent

    def _close(self, body: _Body) -> Reports:
        """Return the report about somebody at the present stamp, if there is anything to say."""
        message, body.last = body.last, None
        if message is None or body.stamp_ns is None:
            return ()
        root, flaws = self._links.get(body.root), list[Flaw]()
        person, frame = without_points(body.name), ""
        if root is None or root.stamp_ns != body.stamp_ns:
            flaws.append(Flaw(body.stamp_ns, body.name, None, NO_ROOT))
            frame = "" if root is None else root.parent
        else:
            person, frame = self._person(body, root.parent), root.parent
        return self._maker.report(message, Header(body.stamp_ns, frame), [person], flaws)

    def _person(self, body: _Body, top: str) -> ReportedPerson:
        """Return somebody's points in the frame ``top``."""
        assert body.stamp_ns is not None
        xyz = np.array([self._place(frame, top, body.stamp_ns) for frame in body.frames])
        person = self._set.person(body.name, xyz, np.zeros(len(xyz), np.bool_))
        return with_error(person, self._error_m)

    def _place(self, frame: str, top: str, stamp_ns: int) -> NDArray[np.float64]:
        """Return the origin of a frame in ``top``; NaN where the way there is not all of this stamp."""
        place = np.zeros(3)
        for _ in range(LONGEST_WAY):
            link = self._links.get(frame)
            if link is None or link.stamp_ns not in (None, stamp_ns):
                break
            place = link.rotation @ place + link.translation
            frame = link.parent
            if frame == top:
                return place
        return np.full(3, np.nan)


def _together(reports: Iterable[Reports]) -> Reports:
    return tuple(report for each in reports for report in each)


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
