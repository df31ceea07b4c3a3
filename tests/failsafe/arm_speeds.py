"""Velocities of points of an arm by the tests' own kinematics, for the bounds of worst-case stops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robots.model import RobotModel
from tests.occupancy.arms import poses

Array = NDArray[np.float64]


def jacobians(
    model: RobotModel, q: Array, joint: int, place: Array, known: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """∂p/∂q and ∂(turning)/∂q, each (N, 3, n), of a point fixed in a joint frame, at ``q (N, n)``.

    ``known``: poses at ``q``, where they have been computed.
    """
    tree = model.kinematics[0]
    rotations, positions = poses(model, q) if known is None else known
    p = positions[:, joint] + rotations[:, joint] @ place
    linear, angular = np.zeros((2, len(q), 3, q.shape[1]))
    k = joint
    while k >= 0:
        axis = rotations[:, k] @ tree["axis"][k]
        if tree["prismatic"][k]:
            linear[:, :, k] = axis
        else:
            linear[:, :, k], angular[:, :, k] = np.cross(axis, p - positions[:, k]), axis
        k = int(tree["parent"][k])
    return linear, angular


def speeds(model: RobotModel, q: Array, dq: Array, point: np.void) -> Array:
    """Speed (N,) of the fastest point of a ball at ``q, dq (N, n)``, in closed form.

    Every point p + δ of the ball has v + ω × δ; the longest is where ω × δ, which lies in the plane across ω,
    points along v's part in that plane.
    """
    return ball_speeds(jacobians(model, q, int(point["joint"]), point["place"]), dq, float(point["ball"]))


def ball_speeds(columns: tuple[Array, Array], dq: Array, radius: float) -> Array:
    """The same, from the Jacobians of the ball's centre."""
    linear, angular = columns
    v, w = (np.einsum("nij,nj->ni", each, dq) for each in (linear, angular))
    size = np.linalg.norm(w, axis=1)
    u = w / np.maximum(size, 1e-300)[:, None]
    along = (v * u).sum(axis=1)
    across = np.linalg.norm(v - along[:, None] * u, axis=1)
    turned = np.hypot(across + radius * size, along)
    return np.where(size > 0.0, turned, np.linalg.norm(v, axis=1))


def energies(model: RobotModel, q: Array, dq: Array, points: NDArray[np.void]) -> Array:
    """Kinetic energy (N,) [J] of the point masses."""
    total, known = np.zeros(len(q)), poses(model, q)
    for point in points:
        linear, _ = jacobians(model, q, int(point["joint"]), point["place"], known)
        v = np.einsum("nij,nj->ni", linear, dq)
        total += 0.5 * float(point["mass"]) * (v * v).sum(axis=1)
    return total


def extensions(model: RobotModel, q: Array, points: NDArray[np.void]) -> Array:
    """Largest distance (N,) [m] of a ball from the first axis of its chain; 0 where that joint slides."""
    tree = model.kinematics[0]
    rotations, positions = poses(model, q)
    far = np.zeros(len(q))
    for point in points:
        root = int(point["chain"][0])
        if tree["prismatic"][root]:
            continue
        joint = int(point["joint"])
        p = positions[:, joint] + rotations[:, joint] @ point["place"]
        axis = rotations[:, root] @ tree["axis"][root]
        away = np.linalg.norm(np.cross(axis, p - positions[:, root]), axis=1)
        far = np.maximum(far, away + float(point["ball"]))
    return far


def fastest(model: RobotModel, q: Array, dq: Array, points: NDArray[np.void], speed: Array) -> float:
    """Largest speed of a ball over configurations ``q (N, n)``, at the vertex that alternation finds from dq.

    The direction of v asks for the signs of dq that make it longer; these give a new direction.
    """
    known, best = poses(model, q), 0.0
    for point in points:
        columns = jacobians(model, q, int(point["joint"]), point["place"], known)
        vertex = dq
        for _ in range(3):
            v = np.einsum("nij,nj->ni", columns[0], vertex)
            vertex = np.where(np.einsum("nij,ni->nj", columns[0], v) >= 0.0, 1.0, -1.0) * speed
        best = max(best, float(ball_speeds(columns, vertex, float(point["ball"])).max()))
    return best
