"""Made-up arms with joints of both kinds, random motion with known bounds, and the tests' own kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robots.enclosure import ENCLOSURE
from robots.limits import JointLimits
from robots.model import KINEMATICS, RobotModel
from robots.motion import Block, new_slices
from robots.reach import reach

Array = NDArray[np.float64]
STROKE = 0.4

ARMS = {
    "one_turning": "R",
    "about_its_middle": "R",
    "planar": "RR",
    "turn_then_slide": "RP",
    "slide_then_turn": "PR",
    "scara": "RRPR",
    "gantry": "PPPRR",
    "six": "RRRRRR",
    "slide_between": "RRPRRPR",
    "branches": "RRRRR",
}


def arm(name: str, rng: np.random.Generator) -> RobotModel:
    """An arm with random placements; some have parallel axes, one forks."""
    kinds = ARMS[name]
    n = len(kinds)
    flat = name in ("planar", "one_turning", "about_its_middle")
    kinematics, enclosure = np.zeros(1, dtype=KINEMATICS), np.zeros(1, dtype=ENCLOSURE)
    tree, capsules = kinematics[0], enclosure[0]
    tree["n"] = capsules["n"] = n
    for j, kind in enumerate(kinds):
        tree["parent"][j] = j - 1 if not (name == "branches" and j == 3) else 0
        tree["prismatic"][j] = kind == "P"
        tree["rotation"][j] = np.eye(3) if flat else Rotation.random(random_state=rng).as_matrix()
        tree["translation"][j] = [0.4 * (j > 0), 0, 0] if flat else rng.uniform(-0.4, 0.4, 3)
        axis = np.array([0.0, 0.0, 1.0]) if flat else rng.normal(size=3)
        tree["axis"][j] = axis / np.linalg.norm(axis)
        capsules["joint"][j] = j
        capsules["a"][j] = [-0.4 * (name == "about_its_middle"), 0, 0] if flat else rng.uniform(-0.3, 0.3, 3)
        capsules["b"][j] = [0.4, 0, 0] if flat else rng.uniform(-0.3, 0.3, 3)
        capsules["radius"][j] = rng.uniform(0.02, 0.1)
    sliding = tree["prismatic"][:n].astype(bool)
    lower, upper = np.where(sliding, -STROKE, -np.inf), np.where(sliding, STROKE, np.inf)
    for j in range(n):
        ends = np.array([capsules["a"][j], capsules["b"][j]])
        capsules["reach"][j] = reach(kinematics, lower, upper, j, ends)
    joints = tuple(f"joint_{j}" for j in range(n))
    ones = np.ones(n)
    limits = JointLimits(joints, lower, upper, 3 * ones, 20 * ones, 200 * ones, np.inf * ones)
    links = tuple(f"link_{j}" for j in range(n))
    return RobotModel(name, joints, limits, kinematics, enclosure, links, (), (), False, (), "bare flange")


@dataclass(frozen=True)
class Motion:
    """Cubic joint motion on one slice: q(t) = Σ c_k t^k, and a tracking error e sin(w t + phase)."""

    h: float
    coefficients: Array
    error: Array
    frequency: Array
    phase: Array

    def command(self, t: float | Array) -> tuple[Array, Array, Array]:
        """q, dq, ddq (n,) at an instant, or (T, n) at instants (T, 1)."""
        c = self.coefficients
        q = c[0] + t * (c[1] + t * (c[2] + t * c[3]))
        return q, c[1] + t * (2 * c[2] + 3 * t * c[3]), 2 * c[2] + 6 * t * c[3]

    def actual(self, t: float | Array) -> Array:
        return self.command(t)[0] + self.error * np.sin(self.frequency * t + self.phase)

    def slices(self) -> Block:
        """The slice block of this motion, with the exact bounds."""
        block = new_slices()
        plan = block[0]
        n = len(self.error)
        plan["n"], plan["n_joints"], plan["t"][1:] = 1, n, self.h
        inner = np.full(n, -1.0)
        bent = self.coefficients[3] != 0.0
        inner[bent] = -self.coefficients[2][bent] / (3 * self.coefficients[3][bent])
        for i, t in enumerate((0.0, self.h)):
            plan["q"][i, :n], plan["dq"][i, :n], plan["ddq"][i, :n] = self.command(t)
        turning = np.clip(inner, 0.0, self.h)
        dq_inner = np.array([abs(self.command(float(t))[1][j]) for j, t in enumerate(turning)])
        plan["dq_max"][0, :n] = np.maximum(np.abs(plan["dq"][:2, :n]).max(axis=0), dq_inner)
        plan["ddq_max"][0, :n] = np.abs(plan["ddq"][:2, :n]).max(axis=0)
        plan["q_error"][:n], plan["dq_error"][:n] = self.error, self.error * self.frequency
        return block


def random_motion(model: RobotModel, rng: np.random.Generator) -> Motion:
    """Fast motion; prismatic joints keep inside their strokes.

    One in three has no tracking error, one a swinging one, and one the largest in all joints all the time.
    """
    n = len(model.joints)
    sliding = model.kinematics[0]["prismatic"][:n].astype(bool)
    h = float(10 ** rng.uniform(-3, -0.7))
    coefficients = np.zeros((4, n))
    coefficients[0] = np.where(sliding, rng.uniform(-0.2, 0.2, n), rng.uniform(-np.pi, np.pi, n))
    for power, limit in ((1, 3.0), (2, 10.0), (3, 30.0)):
        coefficients[power] = limit * rng.uniform(-1, 1, n) * rng.choice([0.0, 1.0])
    coefficients[1:, sliding] *= 0.15
    kind = rng.choice(["none", "swinging", "largest"])
    error = rng.uniform(0, 0.02, n) * (kind != "none")
    if kind == "largest":
        return Motion(h, coefficients, error, np.zeros(n), rng.choice([-0.5, 0.5], n) * np.pi)
    return Motion(h, coefficients, error, rng.uniform(0, 20, n), rng.uniform(0, 2 * np.pi, n))


def poses(model: RobotModel, q: Array) -> tuple[Array, Array]:
    """Joint frames in the world at joint values (..., n): rotations (..., n, 3, 3), positions (..., n, 3)."""
    tree = model.kinematics[0]
    rotations: list[Array] = []
    positions: list[Array] = []
    for j in range(int(tree["n"])):
        moved = q[..., j, None] * tree["axis"][j]
        slides = bool(tree["prismatic"][j])
        turn = Rotation.from_rotvec((0.0 if slides else 1.0) * moved).as_matrix()
        shift = tree["translation"][j] + (moved if slides else 0.0 * moved) @ tree["rotation"][j].T
        parent = int(tree["parent"][j])
        r, p = (np.eye(3), np.zeros(3)) if parent < 0 else (rotations[parent], positions[parent])
        rotations.append(r @ tree["rotation"][j] @ turn)
        positions.append(p + (r @ shift[..., None])[..., 0])
    return np.stack(rotations, axis=-3), np.stack(positions, axis=-2)


def place(model: RobotModel, q: Array, local: Array) -> Array:
    """World positions (..., L, P, 3) of points ``local`` (L, P, 3) of the links for joint values (..., n)."""
    rotations, positions = poses(model, q)
    joint = model.enclosure[0]["joint"][: len(local)]
    turned = np.einsum("...lij,lpj->...lpi", rotations[..., joint, :, :], local)
    return turned + positions[..., joint, None, :]


def axis_points(model: RobotModel, along: Array) -> Array:
    """Points (L, P, 3) of the link axes, in joint frames, at ``along`` (P,) from 0 to 1."""
    capsules = model.enclosure[0]
    n = int(capsules["n"])
    a, b = capsules["a"][:n, None, :], capsules["b"][:n, None, :]
    points: Array = a + along[None, :, None] * (b - a)
    return points
