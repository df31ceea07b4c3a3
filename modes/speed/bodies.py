"""Ellipsoids around the links of an arm and around the parts of people, for danger indices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from modes.people_capsules import around_parts
from modes.speed.danger_index import Ellipsoids
from occupancy.body import Part, Profile
from robots import kernels
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

UPPER_BODY: tuple[Part, ...] = (
    Part.HEAD, Part.NECK, Part.TORSO, Part.L_UPPER_ARM, Part.L_FOREARM, Part.L_HAND,
    Part.R_UPPER_ARM, Part.R_FOREARM, Part.R_HAND,
)  # fmt: skip
"""What the paper models: most collisions are with the upper part of the body (section II A)."""


def require_parts(parts: object) -> None:
    """Refuse what is no tuple of body parts.

    Raises
    ------
    SetupError
        There is no part, or something else than parts.
    """
    if not (isinstance(parts, tuple) and all(isinstance(part, Part) for part in parts)):
        raise SetupError(
            f"speed alteration: parts = {parts!r} should be a tuple of parts, as (Part.R_HAND, Part.HEAD)"
        )
    if not parts:
        raise SetupError("speed alteration: a body without parts is nobody: name at least one part")


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """An arm at one place of its path.

    Attributes
    ----------
    links:
        Ellipsoids around the links, in the order of ``RobotModel.links``.
    per_path:
        ``(N, 3)``: how their centres move per path parameter [m/s].
    speed_per_path:
        How fast the fastest of these centres, or the end of the last link, moves at path speed 1 [m/s].
    """

    links: Ellipsoids
    per_path: Array
    speed_per_path: float


class LinkEllipsoids:
    """The ellipsoids of an arm: spheroids around the capsules that enclose its links."""

    def __init__(self, robot: RobotModel) -> None:
        rows, n = robot.enclosure[0], len(robot.links)
        self._kinematics = robot.kinematics
        self._joint = rows["joint"][:n].astype(int)
        self._local = Ellipsoids.around_capsules(rows["a"][:n], rows["b"][:n], rows["radius"][:n])
        last = int(np.flatnonzero(self._joint == self._joint.max())[-1])
        self._tip = self._joint[last], rows["b"][last].copy()
        j = len(robot.joints)
        self._rotations, self._positions = np.zeros((j, 3, 3)), np.zeros((j, 3))
        self._angular, self._linear = np.zeros((j, 3)), np.zeros((j, 3))

    def at(self, q: Array, dq_ds: Array) -> Arm:
        """Return the arm at ``q`` (n,) [rad; m], which moves with ``dq_ds`` (n,) per path parameter."""
        kernels.forward(self._kinematics, q, self._rotations, self._positions)
        kernels.velocities(
            self._kinematics, dq_ds, self._rotations, self._positions, self._angular, self._linear
        )
        turn = self._rotations[self._joint]
        away = np.einsum("nij,nj->ni", turn, self._local.centre)
        links = Ellipsoids(
            self._positions[self._joint] + away, self._local.semi_axes, turn @ self._local.rotation
        )
        per_path = self._linear[self._joint] + np.cross(self._angular[self._joint], away)
        joint, tip = self._tip
        lever = self._rotations[joint] @ tip
        speed = np.linalg.norm(self._linear[joint] + np.cross(self._angular[joint], lever))
        centres = np.linalg.norm(per_path, axis=1)
        return Arm(links, per_path, max(float(speed), float(centres.max())))


@dataclass(frozen=True, slots=True, eq=False)
class BodyEllipsoids:
    """The ellipsoids of people.

    Attributes
    ----------
    profile:
        Has the radii of the parts.
    parts:
        Which of them are looked at.

    Raises
    ------
    SetupError
        There is no part, or something else than parts.
    """

    profile: Profile
    parts: tuple[Part, ...] = field(default=UPPER_BODY)

    def __post_init__(self) -> None:
        require_parts(self.parts)

    def around(self, xyz: Array) -> Ellipsoids:
        """Return ellipsoids around the parts of people, points ``xyz (people, 20, 3)`` [m], NaN: not seen.

        A part of which one end is seen is a ball there; one of which none is, is left out: this is advice.
        """
        found = around_parts(xyz, self.parts, self.profile)
        return Ellipsoids.around_capsules(found.a, found.b, found.radius)
