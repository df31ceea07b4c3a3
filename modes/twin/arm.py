"""An arm as a MuJoCo model (extra ``twin``): its kinematics and capsules, with masses, friction and drives.

Masses, friction and drives are whoever's who builds a twin; where they are made up, that twin says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_number
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

STEP_S = 0.001
"""What a twin is simulated with, and its drives follow joint positions with."""
STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


class Made(Protocol):
    """What an arm of six joints is made of, joint by joint.

    Attributes
    ----------
    link_kg:
        Masses of the links, spread over their capsules [kg].
    rotor_kg_m2:
        Inertia of the motors, at the joint.
    coulomb_Nm, viscous_Nm_s:
        Friction.
    stiffness_Nm, damping_Nm_s:
        Of the drives [N m/rad, N m s/rad].
    """

    @property
    def link_kg(self) -> Sequence[float]:
        """Masses."""
        ...

    @property
    def rotor_kg_m2(self) -> Sequence[float]:
        """Inertia of the motors."""
        ...

    @property
    def coulomb_Nm(self) -> Sequence[float]:
        """Friction."""
        ...

    @property
    def viscous_Nm_s(self) -> Sequence[float]:
        """Friction."""
        ...

    @property
    def stiffness_Nm(self) -> Sequence[float]:
        """Of the drives."""
        ...

    @property
    def damping_Nm_s(self) -> Sequence[float]:
        """Of the drives."""
        ...


_MADE = ("link_kg", "rotor_kg_m2", "coulomb_Nm", "viscous_Nm_s", "stiffness_Nm", "damping_Nm_s")
_MAY_BE_ZERO = {"rotor_kg_m2", "coulomb_Nm", "viscous_Nm_s"}


def require_per_joint(made: object, names: Sequence[str] = _MADE) -> None:
    """Refuse what does not give six numbers above 0 (friction and rotors: from 0) for each of ``names``.

    Raises
    ------
    SetupError
        It names the joint.
    """
    for name in names:
        values = getattr(made, name)
        if len(values) != 6:
            raise SetupError(f"twin: {name} has {len(values)} numbers, six joints are simulated")
        for joint, value in enumerate(values):
            least = 0.0 if name in _MAY_BE_ZERO else 1e-9
            require_number(f"twin: {name}, joint {joint + 1}", value, least, 1e9)


def steps_of(period_s: float) -> int:
    """Return how many steps of the simulation a cycle of ``period_s`` [s] has.

    Raises
    ------
    SetupError
        It is no whole number of milliseconds up to 1 s.
    """
    require_number("twin: period_s", period_s, STEP_S, 1.0)
    if abs(round(period_s / STEP_S) * STEP_S - period_s) > 1e-12:
        raise SetupError(f"twin: period_s = {period_s!r} should be a whole number of milliseconds")
    return round(period_s / STEP_S)


def begin_model(name: str, gravity: Sequence[float] | Array = STANDARD_GRAVITY) -> ElementTree.Element:
    """Return an empty model with ``gravity`` (3,) [m/s²] and the step of the twin."""
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(
        root, "option", timestep=f"{STEP_S}", integrator="implicitfast", gravity=text(gravity)
    )
    ElementTree.SubElement(root, "worldbody")
    return root


def add_arm(root: ElementTree.Element, robot: RobotModel, made: Made) -> ElementTree.Element:
    """Add bodies ``link_1`` to ``link_6``, their joints and drives to a model; return the last body.

    Raises
    ------
    SetupError
        The arm is no chain of six revolute joints with a capsule each.
    """
    tree, n = robot.kinematics[0], len(robot.joints)
    chain = list(tree["parent"][:n]) == list(range(-1, n - 1)) and not tree["prismatic"][:n].any()
    if n != 6 or not chain:
        raise SetupError(f"twin: {robot.name} is no chain of six revolute joints")
    at = root.find("worldbody")
    assert at is not None
    drives = ElementTree.SubElement(root, "actuator")
    capsules = robot.enclosure[0]
    for j, name in enumerate(robot.joints):
        turn = tree["rotation"][j]
        axes = text([*turn[:, 0], *turn[:, 1]])
        at = ElementTree.SubElement(
            at, "body", name=f"link_{j + 1}", pos=text(tree["translation"][j]), xyaxes=axes
        )
        ElementTree.SubElement(
            at, "joint", name=name, axis=text(tree["axis"][j]), armature=f"{made.rotor_kg_m2[j]}",
            frictionloss=f"{made.coulomb_Nm[j]}", damping=f"{made.viscous_Nm_s[j]}",
        )  # fmt: skip
        for row in np.flatnonzero(capsules["joint"][: len(robot.links)] == j).tolist():
            mass = made.link_kg[j] / int((capsules["joint"][: len(robot.links)] == j).sum())
            add_bar(at, capsules["a"][row], capsules["b"][row], float(capsules["radius"][row]), mass)
        k, d = made.stiffness_Nm[j], made.damping_Nm_s[j]
        ElementTree.SubElement(
            drives, "general", name=f"drive_{j + 1}", joint=name, gainprm=f"{k}", biastype="affine",
            biasprm=text((0.0, -k, -d)),
        )  # fmt: skip
    return at


def text(numbers: Sequence[float] | Array) -> str:
    """Return numbers as MuJoCo reads them."""
    return " ".join(repr(float(each)) for each in numbers)


def add_bar(parent: ElementTree.Element, a: Array, b: Array, radius: float, mass: float) -> None:
    """Add a capsule (a ball, where it has no length) that collides with nothing."""
    shape = {"type": "capsule", "fromto": text([*a, *b])}
    if np.array_equal(a, b):
        shape = {"type": "sphere", "pos": text(a)}
    ElementTree.SubElement(
        parent, "geom", shape, size=f"{radius}", mass=f"{mass}", contype="0", conaffinity="0"
    )


def import_mujoco() -> Any:
    """Return MuJoCo.

    Raises
    ------
    SetupError
        It is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise SetupError(
            "the twin needs mujoco, which is not installed: pip install 'stopproof[twin]'"
        ) from error
    return mujoco


def cubic(q0: Array, dq0: Array, q1: Array, dq1: Array, n: int) -> tuple[Array, Array]:
    """Return positions and speeds ``(n, 6)`` of a cubic after each of its ``n`` milliseconds."""
    h = n * STEP_S
    u = (np.arange(1, n + 1) / n)[:, None]
    a, b = 2.0 * (q0 - q1) + h * (dq0 + dq1), 3.0 * (q1 - q0) - h * (2.0 * dq0 + dq1)
    return q0 + u * (h * dq0 + u * (b + u * a)), dq0 + u * (2.0 * b + 3.0 * u * a) / h


def cross(a: Array, b: Array) -> Array:
    """Return a × b; ``np.cross`` takes some ten times as long."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
