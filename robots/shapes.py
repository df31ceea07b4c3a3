"""Link geometry as balls (N, 4) [x, y, z, radius; m]: a convex set that holds the balls holds their hull.

A mesh lies in the hull of its vertices, a box in that of its corners, and so on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.capsule import LARGEST, Array, extreme_balls
from robots.errors import SetupError

_RIM = 64
"""Corners of the polygon drawn around a rim; it lies outside the circle by 0.12 % of the radius at most."""
_ARC = np.pi / 16.0
"""Longest arc [rad] that one chord replaces when a part is turned; what the chord cuts off is added."""
_MANY = 2000
"""More balls of one radius than this are replaced by fewer around them."""
_DIRECTIONS = 800
_WORTH_IT = 1.05
"""Largest factor by which those may reach farther."""
_FLAT = 1e-6
_ROUNDED_UP = 1.0 + 1e-9


def point_balls(points: Array) -> Array:
    """Balls of radius 0 around points (N, 3)."""
    return np.column_stack([points, np.zeros(len(points))])


def primitive_balls(shape: Any) -> Array:
    """Balls whose hull contains a coal box, ball or cylinder: the shapes that a URDF may have.

    Raises
    ------
    SetupError
        For any other shape.
    """
    kind = type(shape).__name__
    if kind == "Box":
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(8, 3)
        return point_balls(signs * np.asarray(shape.halfSide))
    if kind == "Sphere":
        return np.array([[0.0, 0.0, 0.0, shape.radius]])
    if kind == "Cylinder":
        rims = [_rim(shape.radius, -shape.halfLength), _rim(shape.radius, shape.halfLength)]
        return point_balls(np.vstack(rims))
    raise SetupError(f"shape {kind} is not supported; possible are: box, sphere, cylinder, mesh")


def place(balls: Array, rotation: Array, translation: Array) -> Array:
    """Balls moved by ``x -> rotation x + translation``."""
    return np.column_stack([balls[:, :3] @ rotation.T + translation, balls[:, 3]])


def sweep(balls: Array, axis: Array, lower: float, upper: float, *, prismatic: bool) -> Array:
    """Balls whose hull contains the given ones at all joint positions from ``lower`` to ``upper`` [m or rad].

    Sliding along the unit vector ``axis``: both ends. Turning about it (±inf: endlessly): positions at most
    :data:`_ARC` apart; between two of them a centre at distance r from the axis leaves their chord by
    r(1 - cos(step/2)) at most, which all radii grow by for the largest r.

    Raises
    ------
    SetupError
        If a sliding range is endless, or beyond what can be enclosed.
    """
    corners = simplified(extreme_balls(balls))
    if prismatic:
        if not max(abs(lower), abs(upper)) <= LARGEST:
            raise SetupError(
                f"a sliding joint without finite limits, at most {LARGEST:g} m, cannot be enclosed"
            )
        return simplified(
            np.vstack([place(corners, np.eye(3), position * axis) for position in (lower, upper)])
        )
    if upper - lower >= 2.0 * np.pi:
        lower, upper = -np.pi, np.pi
    steps = max(1, int(np.ceil((upper - lower) / _ARC)))
    lever = np.linalg.norm(np.cross(corners[:, :3], axis), axis=1).max()
    corners[:, 3] += lever * (1.0 - np.cos(0.5 * (upper - lower) / steps))
    angles = np.linspace(lower, upper, steps + 1)
    turned = [place(corners, rotation_about(axis, float(angle)), np.zeros(3)) for angle in angles]
    return simplified(np.vstack(turned))


def simplified(balls: Array) -> Array:
    """Return few balls (M, 4) whose hull contains that of ``balls`` (N, 4) and is hardly larger.

    Every joint that is not commanded multiplies the balls by up to 33: without this, a few of them in a row
    take minutes. Up to :data:`_MANY` balls of one radius are kept as they are.
    """
    groups = [balls[balls[:, 3] == radius] for radius in np.unique(balls[:, 3])]
    return np.vstack([_simplified(extreme_balls(group)) if len(group) > _MANY else group for group in groups])


def _simplified(group: Array) -> Array:
    """Keep the farthest of many balls of one radius in evenly spread directions, and move them outward.

    All centres lie in the hull H of those kept, once it is scaled about a point m in it by the largest of
    n·(centre - m) / (offset - n·m) over all facets n·x <= offset of H. The group is returned as it is where
    it is flat, or where that factor is not worth it.
    """
    middle = group[:, :3].mean(axis=0)
    points = group[:, :3] - middle
    _, extent, axes = np.linalg.svd(points, full_matrices=False)
    if not extent[-1] > _FLAT * extent[0]:
        return group
    farthest = np.unique(np.argmax(points @ (axes.T / extent) @ _spread_directions().T, axis=0))
    try:
        hull = ConvexHull(points[farthest])
    except QhullError:  # as good as flat
        return group
    offsets = -hull.equations[:, 3]
    if not (offsets > 0.0).all():
        return group
    factor = max(
        float((points @ normal).max() / offset)
        for normal, offset in zip(hull.equations[:, :3], offsets, strict=True)
    )
    if not factor <= _WORTH_IT:
        return group
    return np.column_stack([middle + _ROUNDED_UP * factor * points[farthest], group[farthest, 3]])


def _spread_directions() -> Array:
    """Unit vectors (:data:`_DIRECTIONS`, 3), spread evenly: a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def rotation_about(axis: Array, angle: float) -> Array:
    """Rotation matrix (3, 3) about the unit vector ``axis`` by ``angle`` [rad]."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
    return rotation


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation matrix (3, 3) of fixed-axis roll, pitch, yaw [rad], as URDF has them."""
    ex, ey, ez = np.eye(3)
    rotation: Array = rotation_about(ez, yaw) @ rotation_about(ey, pitch) @ rotation_about(ex, roll)
    return rotation


def _rim(radius: float, z: float) -> Array:
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    outer = radius / np.cos(np.pi / _RIM)
    return np.column_stack([outer * np.cos(angle), outer * np.sin(angle), np.full(_RIM, z)])
