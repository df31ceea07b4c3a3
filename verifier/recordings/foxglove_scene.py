"""Scenes as the viewer Foxglove draws them: ``foxglove.SceneUpdate`` and ``foxglove.FrameTransforms``.

Protobuf, as the package ``foxglove-sdk`` (extra ``foxglove``) encodes it: it brings the schemas that the
viewer knows, so that none is kept here, and a scene has fewer bytes than in JSON. A capsule is no primitive
there: sets are given in pieces (:mod:`verifier.scene_sets`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robots.errors import SetupError
from verifier.recordings.spool import AddedTopic
from verifier.recordings.topic import FIXTURES_TOPIC, FRAMES_TOPIC, SCENE_TOPIC
from verifier.scene_sets import Pieces

Array = NDArray[np.float64]
Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity; 0 to 1."""

NOT_INSTALLED = "the scene needs foxglove-sdk, which is not installed: pip install 'stopproof[foxglove]'"
WORLD = "world"
LATEST_NS = (2**32 - 1) * 1_000_000_000
"""Times in scenes are seconds of 32 bits: up to the year 2106."""
_LETTERS_M = 0.07
_NANO = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Entity:
    """Something in a scene, with what it is made of.

    Attributes
    ----------
    name:
        No two of one scene have the same.
    colour:
        Of everything in it.
    sets:
        Sphere-swept volumes.
    dots, dot_m:
        (N, 3) points [m], drawn as balls of this radius [m].
    lines:
        (N, 2, 3) ends [m].
    text, at:
        What is written, and where (3,) [m].
    facts:
        What the viewer shows of it when it is clicked at.
    """

    name: str
    colour: Colour
    sets: Sequence[Pieces] = ()
    dots: Array = field(default_factory=lambda: np.zeros((0, 3)))
    dot_m: float = 0.0
    lines: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    text: str = ""
    at: Array = field(default_factory=lambda: np.zeros(3))
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame by its pose in the world: rotation (3, 3), position (3,) [m]."""

    name: str
    rotation: Array
    position: Array


def require_foxglove() -> None:
    """Refuse, before long work, what could not be written after it.

    Raises
    ------
    SetupError
        The extra ``foxglove`` is not installed.
    """
    if find_spec("foxglove") is None:
        raise SetupError(NOT_INSTALLED)


class SceneEncoder:
    """Encodes scenes and frames.

    Raises
    ------
    SetupError
        The extra ``foxglove`` is not installed.

    Attributes
    ----------
    scene, fixtures, frames:
        The topics.
    """

    def __init__(self) -> None:
        try:
            from foxglove import messages
        except ImportError as error:
            raise SetupError(NOT_INSTALLED) from error
        self._m: Any = messages
        update, transforms = messages.SceneUpdate.get_schema(), messages.FrameTransforms.get_schema()
        self.scene, self.fixtures = (
            AddedTopic(name, update.name, update.encoding, bytes(update.data), "protobuf")
            for name in (SCENE_TOPIC, FIXTURES_TOPIC)
        )
        self.frames = AddedTopic(
            FRAMES_TOPIC, transforms.name, transforms.encoding, bytes(transforms.data), "protobuf"
        )

    def update(self, time_ns: int, entities: Sequence[Entity]) -> bytes:
        """Return a scene that replaces the one before it."""
        m, stamp = self._m, self._stamp(time_ns)
        clear = m.SceneEntityDeletion(timestamp=stamp, type=m.SceneEntityDeletionType.All)
        drawn = [self._entity(stamp, entity) for entity in entities]
        return bytes(m.SceneUpdate(deletions=[clear], entities=drawn).encode())

    def transforms(self, time_ns: int, frames: Sequence[Frame]) -> bytes:
        """Return the poses of frames in the world."""
        m, stamp = self._m, self._stamp(time_ns)
        found = [
            m.FrameTransform(
                timestamp=stamp,
                parent_frame_id=WORLD,
                child_frame_id=frame.name,
                translation=self._vector(frame.position),
                rotation=self._quaternion(*_quaternion(frame.rotation)),
            )
            for frame in frames
        ]
        return bytes(m.FrameTransforms(transforms=found).encode())

    def _stamp(self, time_ns: int) -> Any:
        return self._m.Timestamp(*divmod(time_ns, _NANO))

    def _entity(self, stamp: Any, entity: Entity) -> Any:
        m, colour = self._m, self._m.Color(**dict(zip("rgba", entity.colour, strict=True)))
        lines = m.LinePrimitive(
            type=m.LinePrimitiveLineType.LineList,
            pose=self._pose(np.zeros(3)),
            thickness=3.0,
            scale_invariant=True,
            points=self._points(entity.lines),
            color=colour,
        )
        text = m.TextPrimitive(
            pose=self._pose(entity.at),
            billboard=True,
            font_size=_LETTERS_M,
            color=colour,
            text=entity.text,
        )
        spheres = [self._sphere(at, each.radius, colour) for each in entity.sets for at in each.spheres]
        spheres += [self._sphere(at, entity.dot_m, colour) for at in entity.dots]
        return m.SceneEntity(
            timestamp=stamp,
            frame_id=WORLD,
            id=entity.name,
            metadata=[m.KeyValuePair(key=key, value=value) for key, value in entity.facts.items()],
            spheres=spheres,
            cylinders=[
                self._cylinder(ends, each.radius, colour) for each in entity.sets for ends in each.cylinders
            ],
            triangles=[
                m.TriangleListPrimitive(
                    pose=self._pose(np.zeros(3)), points=self._points(each.triangles), color=colour
                )
                for each in entity.sets
                if len(each.triangles)
            ],
            lines=[lines] if len(entity.lines) else [],
            texts=[text] if entity.text else [],
        )

    def _sphere(self, at: Array, radius: float, colour: Any) -> Any:
        size = self._m.Vector3(x=2.0 * radius, y=2.0 * radius, z=2.0 * radius)
        return self._m.SpherePrimitive(pose=self._pose(at), size=size, color=colour)

    def _cylinder(self, ends: Array, radius: float, colour: Any) -> Any:
        """Return the cylinder around an axis: its own axis is z, and its origin in the middle."""
        along = ends[1] - ends[0]
        length = math.sqrt(float(along @ along))
        return self._m.CylinderPrimitive(
            pose=self._m.Pose(
                position=self._vector(0.5 * (ends[0] + ends[1])),
                orientation=self._quaternion(*_from_z(along / length)),
            ),
            size=self._m.Vector3(x=2.0 * radius, y=2.0 * radius, z=length),
            bottom_scale=1.0,
            top_scale=1.0,
            color=colour,
        )

    def _points(self, points: Array) -> list[Any]:
        return [self._m.Point3(x=x, y=y, z=z) for x, y, z in points.reshape(-1, 3).tolist()]

    def _pose(self, at: Array) -> Any:
        return self._m.Pose(position=self._vector(at), orientation=self._quaternion(0.0, 0.0, 0.0, 1.0))

    def _vector(self, v: Array) -> Any:
        x, y, z = v.tolist()
        return self._m.Vector3(x=x, y=y, z=z)

    def _quaternion(self, x: float, y: float, z: float, w: float) -> Any:
        return self._m.Quaternion(x=x, y=y, z=z, w=w)


def _from_z(along: Array) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of the shortest turn from the z axis to a unit vector."""
    x, y, z = along.tolist()
    w = 1.0 + z
    if w < 1e-9:
        return 1.0, 0.0, 0.0, 0.0
    length = math.sqrt(x * x + y * y + w * w)
    return -y / length, x / length, 0.0, w / length


def _quaternion(rotation: Array) -> tuple[float, float, float, float]:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
    return x, y, z, w
