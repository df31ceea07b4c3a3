"""Where a frame stands in another one, by the transforms of a recording; those that move are refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.neutral import open_whole
from verifier.recordings.robot_sources.transforms import (
    SCHEMAS,
    FloatArray,
    StaticTransform,
    read_transforms,
    together,
)

STATIC, MOVING = "tf_static", "tf"
"""Last part of the names of topics."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A point of a frame is ``rotation @ point + xyz_m`` in another; ``frames``: the way, both ends in."""

    rotation: FloatArray
    xyz_m: FloatArray
    frames: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """The transforms of a recording.

    Attributes
    ----------
    path:
        The recording.
    static:
        Frame -> where it stands in its parent, on ``/tf_static``.
    moving:
        Frame -> its parent, on ``/tf``: its pose may change.
    """

    path: Path
    static: Mapping[str, StaticTransform]
    moving: Mapping[str, str]

    def knows(self, frame: str, base: str) -> bool:
        """Whether both frames hang together, moving or not."""
        return self._way_up(frame)[-1] == self._way_up(base)[-1] and frame != base

    def chain(self, frame: str, base: str) -> Chain:
        """Return where ``frame`` stands in ``base``.

        Raises
        ------
        RecordingError
            Nothing leads from one to the other, or something between them moves.
        """
        up, down = self._way_up(frame), self._way_up(base)
        if up[-1] != down[-1]:
            known = ", ".join(sorted({*self.static, *(each.parent for each in self.static.values())}))
            wrong = f"no transform leads from frame {frame} to {base} (static are {known or 'none'})"
            raise RecordingError(self.path, f"/{STATIC}", wrong, "state the pose in the cell")
        while len(up) > 1 and len(down) > 1 and up[-2] == down[-2]:
            up, down = up[:-1], down[:-1]
        moves = [each for each in (*up[:-1], *down[:-1]) if each in self.moving]
        if moves:
            wrong = f"frame {moves[0]} moves (/{MOVING}), and stands between {frame} and {base}"
            raise RecordingError(
                self.path, f"/{STATIC}", wrong, "a sensor frame must stand still at the base"
            )
        of_frame, of_base = self._in_last(up), self._in_last(down)
        back = of_base[0].T
        rotation, xyz = back @ of_frame[0], back @ (of_frame[1] - of_base[1])
        return Chain(rotation, xyz, (*up, *reversed(down[:-1])))

    def still(self, frame: str) -> tuple[str, ...]:
        """Return the other frames in which ``frame`` stands still."""
        names = {*self.static, *(each.parent for each in self.static.values())} - {frame}
        return tuple(name for name in sorted(names) if self._stands_still(frame, name))

    def _stands_still(self, frame: str, base: str) -> bool:
        try:
            self.chain(frame, base)
        except RecordingError:
            return False
        return True

    def _way_up(self, frame: str) -> tuple[str, ...]:
        """The frame, its parent, and so on to the last."""
        way = [frame]
        while True:
            link = self.static.get(way[-1])
            parent = self.moving.get(way[-1]) if link is None else link.parent
            if parent is None:
                return tuple(way)
            if parent in way:
                wrong = f"frames {', '.join(way)} stand in a circle"
                raise RecordingError(self.path, f"/{STATIC}", wrong, "transforms must make a tree")
            way.append(parent)

    def _in_last(self, way: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Pose of the first frame of a way up in its last."""
        rotation, xyz = np.eye(3), np.zeros(3)
        for frame in way[:-1]:
            link = self.static[frame]
            rotation, xyz = link.rotation @ rotation, link.rotation @ xyz + link.xyz_m
        return rotation, xyz


def read_frames(path: Path) -> RecordedFrames:
    """Read the transforms of a recording of any kind.

    Raises
    ------
    RecordingError
        It is not complete, a static transform cannot be read, or two of one frame do not say the same.
    """
    container = open_whole(path)
    of_transforms = [topic.name for topic in container.topics if topic.schema in SCHEMAS and topic.messages]
    static: list[StaticTransform] = []
    moving: dict[str, str] = {}
    place = f"/{STATIC}"
    try:
        for message in container.messages({name for name in of_transforms if _last(name) == STATIC}):
            static += read_transforms(message)
        found = together(static)
    except SourceError as error:
        raise RecordingError(container.path, place, str(error)) from error
    for message in container.messages({name for name in of_transforms if _last(name) == MOVING}):
        moving |= _moving(message)
    return RecordedFrames(container.path, found, moving)


def frames_that_move(path: Path, frames: Collection[str]) -> tuple[str, ...]:
    """Return those of ``frames`` that ``/tf`` of a recording moves, or something between them and the last.

    What ``/tf`` repeats without a change stands still.

    Raises
    ------
    RecordingError
        The recording is not complete.
    """
    container = open_whole(path)
    topics = {topic.name for topic in container.topics if topic.schema in SCHEMAS and topic.messages}
    parents: dict[str, str] = {}
    first: dict[str, tuple[str, ...]] = {}
    moved: set[str] = set()
    for message in container.messages({name for name in topics if _last(name) in (STATIC, MOVING)}):
        for each in getattr(message.value, "transforms", ()):
            child, parent = (
                str(name).removeprefix("/") for name in (each.child_frame_id, each.header.frame_id)
            )
            parents.setdefault(child, parent)
            if first.setdefault(child, pose := (parent, repr(each.transform))) != pose:
                moved.add(child)
    return tuple(frame for frame in frames if moved & set(_ancestry(frame.removeprefix("/"), parents)))


def _ancestry(frame: str, parents: Mapping[str, str]) -> list[str]:
    way = [frame]
    while (parent := parents.get(way[-1])) is not None and parent not in way:
        way.append(parent)
    return way


def _moving(message: Decoded) -> dict[str, str]:
    """Child -> parent; what cannot be read as such is nobody's way to the base."""
    return {
        str(each.child_frame_id).removeprefix("/"): str(each.header.frame_id).removeprefix("/")
        for each in getattr(message.value, "transforms", ())
    }


def _last(topic: str) -> str:
    return topic.rsplit("/", 1)[-1]
