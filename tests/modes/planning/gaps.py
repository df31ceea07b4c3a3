"""Gaps of an arm from people by other means: Rodrigues' formula, distances in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies
from robots.model import RobotModel

Array = NDArray[np.float64]


def placed(robot: RobotModel, q: Array) -> tuple[list[Array], list[Array]]:
    """Rotations (B, 3, 3) and places (B, 3) of the frames of all joints at ``q`` (B, n)."""
    tree, count = robot.kinematics[0], len(q)
    rotations: list[Array] = []
    places: list[Array] = []
    for j in range(q.shape[1]):
        x, y, z = tree["axis"][j]
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turned, slid = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
        if tree["prismatic"][j]:
            slid = q[:, j, None] * tree["axis"][j]
        else:
            angle = q[:, j, None, None]
            turned = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
        rotation = tree["rotation"][j] @ turned
        place = tree["translation"][j] + slid @ tree["rotation"][j].T
        parent = int(tree["parent"][j])
        if parent >= 0:
            place = places[parent] + np.einsum("bij,bj->bi", rotations[parent], place)
            rotation = rotations[parent] @ rotation
        rotations.append(rotation)
        places.append(place)
    return rotations, places


def axis_gaps(p: Array, q: Array, a: Array, b: Array) -> Array:
    """Distances of segments p q and a b (..., 3): between their lines, if met within both, or from an end."""
    u, v, r = q - p, b - a, p - a
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    ur, vr = (u * r).sum(-1), (v * r).sum(-1)
    det = uu * vv - uv * uv
    with np.errstate(all="ignore"):
        s, t = (uv * vr - ur * vv) / det, (uu * vr - uv * ur) / det
    met = (det > 1e-14) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    s, t = np.where(met, s, 0.0)[..., None], np.where(met, t, 0.0)[..., None]
    between = np.where(met, np.linalg.norm(r + s * u - t * v, axis=-1), np.inf)
    ends = (_from_axis(p, a, v), _from_axis(q, a, v), _from_axis(a, p, u), _from_axis(b, p, u))
    return np.minimum(between, np.minimum.reduce(ends))


def _from_axis(x: Array, a: Array, v: Array) -> Array:
    square = (v * v).sum(-1)
    share = np.clip(((x - a) * v).sum(-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - a - share[..., None] * v, axis=-1))


def least_gaps(robot: RobotModel, q: Array, bodies: Bodies) -> Array:
    """The least gap of a link from a part in any frame at each of ``q`` (B, n) [m]."""
    rows = robot.enclosure[0]
    rotations, places = placed(robot, q)
    found = np.full(len(q), np.inf)
    for i in range(len(robot.links)):
        j = int(rows["joint"][i])
        tip, top = (places[j] + rotations[j] @ rows[end][i] for end in "ab")
        gaps = axis_gaps(tip[:, None, None], top[:, None, None], bodies.a[None], bodies.b[None])
        found = np.minimum(found, (gaps - bodies.radius - rows["radius"][i]).min(axis=(1, 2), initial=np.inf))
    return found
