"""The robot as flat arrays: URDF -> pinocchio -> what kernels read; uncommanded joints are locked."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import pinocchio

from robots.assumption import Assumption
from robots.errors import SetupError
from robots.files import shown
from robots.limits import Array, JointLimits
from robots.motion import MAX_JOINTS, Block
from robots.shapes import rotation_from_rpy
from robots.urdf import Urdf

KINEMATICS = np.dtype(
    [
        ("n", np.int64),
        ("parent", np.int32, (MAX_JOINTS,)),
        ("prismatic", np.int8, (MAX_JOINTS,)),
        ("rotation", np.float64, (MAX_JOINTS, 3, 3)),
        ("translation", np.float64, (MAX_JOINTS, 3)),
        ("axis", np.float64, (MAX_JOINTS, 3)),
    ]
)
"""``n`` joints, parents before children. ``parent``: index of the parent joint, -1 the base. ``rotation`` and
``translation`` [m]: placement of the joint frame in the parent joint's frame at q = 0, the mount folded into
those of the base. ``axis``: unit vector in the joint frame. Joints that turn endlessly are plain revolute."""


@dataclass(frozen=True, eq=False)
class Mount:
    """Pose of the robot base in the world: ``x_world = rotation x_base + translation`` (3, 3), (3,) [m].

    Raises
    ------
    SetupError
        If ``rotation`` is no rotation matrix or a number is not finite.
    """

    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, dtype=np.float64)
        translation = np.array(self.translation, dtype=np.float64)
        if rotation.shape != (3, 3) or not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-9:
            raise SetupError("mount rotation must be a 3 x 3 rotation matrix")
        if not np.linalg.det(rotation) > 0:
            raise SetupError("mount rotation is a reflection: its determinant must be +1")
        if translation.shape != (3,) or not np.isfinite(translation).all():
            raise SetupError(f"mount translation must be three finite numbers [m], not {self.translation!r}")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def from_xyz_rpy(cls, xyz_m: Sequence[float] | Array, rpy_deg: Sequence[float] | Array) -> Self:
        """Mount from a position [m] and fixed-axis roll, pitch, yaw [deg]."""
        if len(rpy_deg) != 3 or not np.isfinite(rpy_deg).all():
            raise SetupError(f"mount rpy_deg must be three finite numbers, not {rpy_deg!r}")
        roll, pitch, yaw = np.deg2rad(rpy_deg)
        return cls(rotation_from_rpy(roll, pitch, yaw), np.array(xyz_m, dtype=np.float64))

    def __matmul__(self, inner: Mount) -> Mount:
        """Pose in the world of what has the pose ``inner`` in this frame."""
        return Mount(self.rotation @ inner.rotation, self.rotation @ inner.translation + self.translation)

    @property
    def is_identity(self) -> bool:
        """Whether the world is the robot base."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not self.translation.any())


class LockedJoint(NamedTuple):
    """A joint that is not commanded, and the positions [rad or m] for which its links are enclosed."""

    name: str
    lower: float
    upper: float
    prismatic: bool


@dataclass(frozen=True, eq=False)
class RobotModel:
    """All that the other packages know about a robot.

    ``kinematics`` is a :data:`KINEMATICS` block, ``enclosure`` a :data:`robots.enclosure.ENCLOSURE` block
    whose rows have the names ``links``. ``fixed_links`` do not move and are not checked against people.
    ``tool``: name of the tool, ``"bare flange"`` if the user said so, None if nobody said anything.
    """

    name: str
    joints: tuple[str, ...]
    limits: JointLimits
    kinematics: Block
    enclosure: Block
    links: tuple[str, ...]
    fixed_links: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    assumed_enclosure: bool
    assumed_limits: tuple[str, ...]
    """Quantities with a limit that is an engineering assumption, e.g. ``("acceleration", "jerk")``."""
    tool: str | None
    locked: tuple[LockedJoint, ...] = ()

    @property
    def content_hash(self) -> str:
        """SHA-256 of everything that a verdict about this robot rests on, wherever its files lie."""
        digest = hashlib.sha256()
        text = (self.name, self.joints, self.links, self.fixed_links, self.tool, self.assumed_enclosure)
        stated = [(item.name, item.value, item.unit, item.certainty) for item in self.assumptions]
        digest.update(repr((text, self.assumed_limits, stated)).encode())
        for block in (self.kinematics, self.enclosure):
            digest.update(block.tobytes())
        for name in ("position_lower", "position_upper", "velocity", "acceleration", "jerk", "torque"):
            digest.update(getattr(self.limits, name).tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class Tree:
    """Joints of a URDF as pinocchio sees them, and which of them the plan commands."""

    urdf: Urdf
    model: Any
    """The pinocchio model with all joints."""
    ids: tuple[int, ...]
    """Pinocchio's index of each commanded joint."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Commanded joints, parents before children."""
        return tuple(self.model.names[i] for i in self.ids)

    @property
    def prismatic(self) -> dict[str, bool]:
        """Commanded joint -> whether it slides."""
        return {joint: self.urdf.joints[joint].prismatic for joint in self.joints}

    def carrier(self, link: str) -> int | None:
        """Commanded joint (pinocchio's index) that moves ``link``, through locked ones too, or None."""
        joint_id = int(self.model.frames[self.model.getBodyId(link)].parentJoint)
        while joint_id and joint_id not in self.ids:
            joint_id = int(self.model.parents[joint_id])
        return joint_id or None

    def hangs_on(self, link: str, joint: str) -> bool:
        """Whether a joint, commanded or not, moves a link."""
        joint_id = int(self.model.frames[self.model.getBodyId(link)].parentJoint)
        while joint_id and self.model.names[joint_id] != joint:
            joint_id = int(self.model.parents[joint_id])
        return joint_id != 0

    @property
    def locked(self) -> tuple[str, ...]:
        """Joints that move but are not commanded."""
        return tuple(str(name) for i, name in enumerate(self.model.names) if i and i not in self.ids)

    @property
    def fixed_links(self) -> tuple[str, ...]:
        """Links with geometry that no commanded joint moves."""
        return tuple(
            link for link in self.urdf.links if link in self.urdf.shaped and self.carrier(link) is None
        )

    def axis(self, joint_id: int) -> Array:
        """Axis (3,) of a joint in its own frame."""
        data = self.model.createData()
        pinocchio.computeJointJacobians(self.model, data, pinocchio.neutral(self.model))
        jacobian = pinocchio.getJointJacobian(self.model, data, joint_id, pinocchio.ReferenceFrame.LOCAL)
        column = np.reshape(jacobian, (6, -1))[:, self.model.joints[joint_id].idx_v]
        slides = self.urdf.joints[self.model.names[joint_id]].prismatic
        axis: Array = np.array(column[:3] if slides else column[3:])
        return axis / np.linalg.norm(axis)

    def kinematics(self, mount: Mount) -> Block:
        """Return the :data:`KINEMATICS` block."""
        block = np.zeros(1, dtype=KINEMATICS)
        tree = block[0]
        tree["n"] = len(self.ids)
        for i, joint_id in enumerate(self.ids):
            placement = self.model.jointPlacements[joint_id]
            parent = self.model.parents[joint_id]
            tree["parent"][i] = self.ids.index(parent) if parent else -1
            tree["prismatic"][i] = self.urdf.joints[self.model.names[joint_id]].prismatic
            rotation, translation = placement.rotation, placement.translation
            if not parent:
                translation = mount.rotation @ translation + mount.translation
                rotation = mount.rotation @ rotation
            tree["rotation"][i], tree["translation"][i] = rotation, translation
            tree["axis"][i] = self.axis(joint_id)
        if not all(np.isfinite(tree[field]).all() for field in ("rotation", "translation", "axis")):
            raise SetupError(f"{self.urdf.path}: a joint placement or axis is not finite")
        return block


def read_tree(urdf: Urdf, commanded: Sequence[str] | None, stated: str | None = None) -> Tree:
    """Let pinocchio read the URDF; ``commanded`` None means every moving joint that mimics no other one.

    ``stated`` names the place that says what is commanded, for messages; None: the URDF.

    Raises
    ------
    SetupError
        If there is no moving joint or more than 16, the base moves, a commanded joint does not exist or
        cannot be commanded, a locked joint carries a commanded one (nobody knows where the arm is then), or
        a joint with geometry follows a commanded one (its links move where those that carry it may rest).
    """
    where = str(urdf.path)
    for joint in urdf.joints.values():
        if joint.kind in ("floating", "planar"):
            raise SetupError(f"{where}: joint {joint.name} is {joint.kind}; a moving base is not supported")
    try:
        model = pinocchio.buildModelFromXML(urdf.xml)
    except (ValueError, RuntimeError) as error:
        raise SetupError(f"{where}: not a URDF that can be read: {' '.join(str(error).split())}") from None
    moving = [str(name) for name in list(model.names)[1:]]
    if commanded is None:
        commanded = [name for name in moving if urdf.joints[name].mimics is None]
    if not moving:
        raise SetupError(f"{where}: robot {urdf.name} has no moving joint")
    where = stated or where
    _check_commanded(urdf, moving, commanded, where)
    ids = tuple(i + 1 for i, name in enumerate(moving) if name in commanded)
    for i in ids:
        parent = model.parents[i]
        if parent and parent not in ids:
            raise SetupError(
                f"{where}: joint {model.names[i]} is commanded, but hangs on joint {model.names[parent]}, "
                "which is not: command that one as well"
            )
    tree = Tree(urdf, model, ids)
    _check_followers(tree, moving, where)
    return tree


def _check_followers(tree: Tree, moving: Sequence[str], where: str) -> None:
    """Refuse joints that move with a commanded one: what they carry would be taken to rest."""
    for name in moving:
        mimics = tree.urdf.joints[name].mimics
        if mimics is None or mimics[0] not in tree.joints or mimics[1] == 0.0:
            continue
        carried = [link for link in tree.urdf.links if link in tree.urdf.shaped and tree.hangs_on(link, name)]
        if carried:
            raise SetupError(
                f"{where}: joint {name} mimics {mimics[0]}, which is commanded, and moves link {carried[0]}: "
                f"it could not be told when that link rests; name the commanded joints without {mimics[0]} "
                "(robot.joints of the cell): both are enclosed for their whole range then"
            )


def _check_commanded(urdf: Urdf, moving: Sequence[str], commanded: Sequence[str], where: str) -> None:
    for name in commanded:
        if name not in moving:
            raise SetupError(
                f"{where}: no moving joint is called {shown(name)}; there are: {', '.join(moving)}"
            )
        if urdf.joints[name].mimics is not None:
            raise SetupError(f"{where}: joint {name} mimics another joint and cannot be commanded")
    if not commanded or len(set(commanded)) != len(commanded):
        raise SetupError(f"{where}: the commanded joints must be named once each, and at least one")
    if len(commanded) > MAX_JOINTS:
        raise SetupError(f"{where}: {len(commanded)} commanded joints; the maximum is {MAX_JOINTS}")
