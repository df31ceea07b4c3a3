"""``/tf_static``: where frames stand in each other, as rigid transforms with names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.robot_sources.joint_sample import field

FloatArray = NDArray[np.float64]

TOPIC = "/tf_static"
SCHEMAS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
UNIT = 1e-3
"""A quaternion whose length is farther from 1 is none of a rotation …"""
SAME = 1e-9
"""… and transforms that differ by more [m; in the matrix] are two."""
FARTHEST_M = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class StaticTransform:
    """A rigid transform: a point of ``child`` is ``rotation @ point + xyz_m`` in ``parent``.

    Attributes
    ----------
    parent, child:
        Names of the frames, without a leading slash.
    xyz_m:
        Where the child's origin stands in the parent (3,) [m].
    rotation:
        Its axes there (3, 3), orthonormal.
    """

    parent: str
    child: str
    xyz_m: FloatArray
    rotation: FloatArray

    def same_as(self, other: StaticTransform) -> bool:
        """Whether both say the same of the same frames."""
        return (
            (self.parent, self.child) == (other.parent, other.child)
            and bool(np.abs(self.xyz_m - other.xyz_m).max() <= SAME)
            and bool(np.abs(self.rotation - other.rotation).max() <= SAME)
        )


def read_transforms(message: Decoded) -> tuple[StaticTransform, ...]:
    """Read a message on ``/tf_static``.

    Raises
    ------
    SourceError
        A frame has no name or stands in itself, a number is NaN, infinite or beyond 10 km, or a quaternion is
        none of a rotation.
    """
    return tuple(_transform(message, each) for each in field(message, message.value, "transforms"))


def together(transforms: Iterable[StaticTransform]) -> Mapping[str, StaticTransform]:
    """Return child -> transform; each frame stands in one other.

    Raises
    ------
    SourceError
        Two transforms of one frame do not say the same.
    """
    found: dict[str, StaticTransform] = {}
    for each in transforms:
        before = found.setdefault(each.child, each)
        if not each.same_as(before):
            raise SourceError(
                f"frame {each.child} stands in {before.parent}, and elsewhere in {each.parent}; a static "
                "frame stands in one place"
            )
    return found


def _transform(message: Decoded, stamped: Any) -> StaticTransform:
    parent = str(field(message, field(message, stamped, "header"), "frame_id")).removeprefix("/")
    child = str(field(message, stamped, "child_frame_id")).removeprefix("/")
    if not parent or not child:
        raise SourceError(f"a transform from {parent!r} to {child!r}; both frames must have a name")
    if parent == child:
        raise SourceError(f"frame {child} stands in itself; its parent must be another frame")
    pose = field(message, stamped, "transform")
    place, turn = field(message, pose, "translation"), field(message, pose, "rotation")
    xyz = _numbers(message, place, "xyz", child)
    quaternion = _numbers(message, turn, "xyzw", child)
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) <= UNIT:
        raise SourceError(f"frame {child}: a quaternion of length {length:.6g}; that of a rotation is 1")
    return StaticTransform(parent, child, xyz, Rotation.from_quat(quaternion / length).as_matrix())


def _numbers(message: Decoded, value: Any, names: str, child: str) -> FloatArray:
    try:
        found = np.array([float(field(message, value, name)) for name in names])
    except TypeError as error:
        raise SourceError(f"frame {child}: {names} are no numbers; write numbers") from error
    if not (np.abs(found) <= FARTHEST_M).all():
        raise SourceError(f"frame {child}: {found.tolist()}; every number must be finite, within 1e4 m")
    return found
