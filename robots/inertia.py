"""Masses of an arm and of what it carries: URDF -> pinocchio -> one rigid body per commanded joint.

A rigid body moves like six point masses m/6 at c ± √(3 s_i / m) e_i, where c is its centre of mass and s_i,
e_i are eigenvalues and eigenvectors of its second moment S = ½ tr(I) 1 − I about c: mass, centre and S of the
six are those of the body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
import pinocchio

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.limits import Array
from robots.model import Mount, Tree
from robots.tool import frame_placement, unknown_flange

GRAVITY_M_S2 = 9.80665
"""Standard acceleration of gravity, CGPM 1901."""
_LARGEST_KG = 1e5
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Payload:
    """Everything that hangs on the flange, tool and workpiece together.

    Attributes
    ----------
    mass_kg:
        0 for nothing at all; there is no default.
    com_m:
        Centre of mass (3,) in the frame of the link ``frame`` (None: the flange of the model file).
    inertia_kg_m2:
        (3, 3) about that centre, in axes of the frame.

    Raises
    ------
    SetupError
        A number that is not finite or impossible.
    """

    mass_kg: float
    com_m: Array = field(default_factory=lambda: np.zeros(3))
    inertia_kg_m2: Array = field(default_factory=lambda: np.zeros((3, 3)))
    frame: str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.mass_kg, bool) or not 0.0 <= self.mass_kg <= _LARGEST_KG:
            raise SetupError(
                f"payload: mass {self.mass_kg!r} kg must be a number from 0 to {_LARGEST_KG:g}; an "
                "unknown mass is not assumed"
            )
        if np.shape(self.com_m) != (3,) or not np.isfinite(self.com_m).all():
            raise SetupError(f"payload: centre of mass {self.com_m!r} must be three finite numbers [m]")
        _check_inertia("payload", np.asarray(self.inertia_kg_m2, dtype=np.float64))

    def scaled(self, share: float) -> Payload:
        """Return a payload of the same shape with ``share`` of the mass."""
        return Payload(share * self.mass_kg, self.com_m, share * self.inertia_kg_m2, self.frame)


@dataclass(frozen=True, eq=False)
class Body:
    """What moves with a commanded joint, in the frame of that joint; ``inertia_kg_m2`` about ``com_m``."""

    joint: int
    mass_kg: float
    com_m: Array
    inertia_kg_m2: Array

    def point_masses(self) -> tuple[Array, Array]:
        """Return places (P, 3) [m] and masses (P,) [kg] that move like this body."""
        moment = 0.5 * np.trace(self.inertia_kg_m2) * np.eye(3) - self.inertia_kg_m2
        sizes, axes = np.linalg.eigh(moment)
        if not sizes.max(initial=0.0) > 0.0:
            return self.com_m[None].copy(), np.array([self.mass_kg])
        away = np.sqrt(3.0 * np.maximum(sizes, 0.0) / self.mass_kg) * axes
        places = np.concatenate([self.com_m + away.T, self.com_m - away.T])
        return places, np.full(6, self.mass_kg / 6.0)


@dataclass(frozen=True, eq=False)
class MassModel:
    """Bodies of an arm, one for each commanded joint, its payload included; gravity (3,) [m/s²] in the world.

    Joints that are not commanded are where their position is 0; what hangs on them counts where it is then.
    """

    robot: str
    bodies: tuple[Body, ...]
    gravity: Array
    payload: Payload
    assumptions: tuple[Assumption, ...]

    @property
    def moving_kg(self) -> float:
        """Mass of all that moves."""
        return math.fsum(body.mass_kg for body in self.bodies)


def read_masses(
    robot: str, tree: Tree, payload: Payload | None, flange: str | None, rated_kg: float | None
) -> MassModel:
    """Read the masses of a URDF and add the payload.

    Raises
    ------
    SetupError
        In one line: no payload stated, more than ``rated_kg``, a link with geometry or a joint without mass,
        an impossible inertia.
    """
    if payload is None:
        raise SetupError(f"{robot}: payload mass is not known; state it in kg, 0 for a bare flange")
    if rated_kg is not None and not payload.mass_kg <= rated_kg:
        raise SetupError(
            f"{robot}: payload of {payload.mass_kg:g} kg is beyond the rated payload of {rated_kg:g} kg"
        )
    bodies, file, prefix = list(_bodies(robot, tree)), tree.urdf.path.name, f"robot.{robot}.mass"
    found = [
        Assumption(f"{prefix}.{tree.joints[body.joint]}", body.mass_kg, "kg", file, Certainty.SOURCED)
        for body in bodies
    ]
    carried = payload.frame if payload.frame is not None else flange
    if payload.mass_kg > 0.0:
        if carried is None:
            raise unknown_flange(tree, f"{robot}: payload")
        joint, placement = frame_placement(tree, carried, f"{robot}: payload")
        bodies[joint] = _joined(bodies[joint], _placed(payload, joint, placement))
    found.append(Assumption(f"{prefix}.payload", payload.mass_kg, "kg", "declared", Certainty.DECLARED))
    return MassModel(robot, tuple(bodies), np.array([0.0, 0.0, -GRAVITY_M_S2]), payload, tuple(found))


def _bodies(robot: str, tree: Tree) -> tuple[Body, ...]:
    """One body per commanded joint, with what hangs on it through joints that are not commanded."""
    _check_links(robot, tree)
    try:
        model = pinocchio.buildModelFromXML(tree.urdf.content.decode("utf-8"))
    except (ValueError, RuntimeError, UnicodeDecodeError) as error:
        raise SetupError(f"{robot}: masses cannot be read: {' '.join(str(error).split())}") from None
    locked = [model.getJointId(name) for name in tree.locked]
    model = pinocchio.buildReducedModel(model, locked, pinocchio.neutral(model))
    bodies = []
    for j, joint in enumerate(tree.joints):
        inertia = model.inertias[model.getJointId(joint)]
        mass, com = float(inertia.mass), np.array(inertia.lever)
        if not 0.0 < mass <= _LARGEST_KG or not np.isfinite(com).all():
            raise SetupError(
                f"{robot}: joint {joint} moves a mass of {mass:g} kg in {tree.urdf.path.name}; it must "
                "be known and above zero"
            )
        tensor = np.array(inertia.inertia)
        _check_inertia(f"{robot}: joint {joint}", tensor)
        bodies.append(Body(j, mass, com, tensor))
    return tuple(bodies)


def _check_links(robot: str, tree: Tree) -> None:
    """Refuse a moving link that has a shape and no mass."""
    root = ElementTree.fromstring(tree.urdf.content)
    massive = {
        link.get("name", "")
        for link in root.findall("link")
        if link.find("inertial") is not None and link.find("inertial/mass") is not None
    }
    for link in tree.urdf.links:
        if link in tree.urdf.shaped and link not in massive and tree.carrier(link) is not None:
            raise SetupError(
                f"{robot}: link {link} has no mass in {tree.urdf.path.name}; an unknown mass is not assumed"
            )


def _check_inertia(what: str, tensor: Array) -> None:
    if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
        raise SetupError(f"{what}: inertia must be 3 x 3 finite numbers [kg m²]")
    scale = max(1e-12, float(np.abs(tensor).max()))
    moment = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    if np.abs(tensor - tensor.T).max() > _FLAT * scale or np.linalg.eigvalsh(moment).min() < -_FLAT * scale:
        raise SetupError(
            f"{what}: inertia is impossible: no body has it (symmetric, principal moments a <= b + c)"
        )


def _placed(payload: Payload, joint: int, placement: Mount) -> Body:
    turn = placement.rotation
    com = turn @ np.asarray(payload.com_m, dtype=np.float64) + placement.translation
    return Body(joint, payload.mass_kg, com, turn @ payload.inertia_kg_m2 @ turn.T)


def _joined(a: Body, b: Body) -> Body:
    """One body of two on the same joint (Steiner)."""
    mass = a.mass_kg + b.mass_kg
    com = (a.mass_kg * a.com_m + b.mass_kg * b.com_m) / mass
    tensor = np.zeros((3, 3))
    for body in (a, b):
        away = body.com_m - com
        tensor = tensor + body.inertia_kg_m2
        tensor = tensor + body.mass_kg * (float(away @ away) * np.eye(3) - np.outer(away, away))
    return Body(a.joint, mass, com, tensor)
