"""Link geometry as convex pieces: each the hull of a few balls.

Pieces are kept in arrays (pieces, corners, 4) [x, y, z, radius; m], one array for each number of corners.
A piece is what one capsule has to contain as a whole: a triangle of a mesh, a box, a cylinder. What holds the
corner balls of a piece in one convex set holds the piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError

Array = NDArray[np.float64]
Pieces = tuple[Array, ...]

_RIM = 64
"""Corners of the polygon drawn around a rim; it lies outside the circle by 0.12 % of the radius at most."""
_ARC = np.pi / 16.0
"""Longest arc [rad] that one chord replaces when a part is turned; what the chord cuts off is added."""


def mesh_pieces(vertices: Array, triangles: NDArray[np.int64]) -> Pieces:
    """Pieces of a mesh: its triangles, and each vertex by itself, in case no triangle uses it."""
    balls = np.column_stack([vertices, np.zeros(len(vertices))])
    return balls[triangles], balls[:, None, :]


def primitive_pieces(shape: Any) -> Pieces:
    """Pieces of a coal box, ball, capsule, cylinder or cone.

    Raises
    ------
    SetupError
        For any other shape.
    """
    kind = type(shape).__name__
    if kind == "Box":
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(8, 3)
        return (_points(signs * np.asarray(shape.halfSide)),)
    if kind == "Sphere":
        return (np.array([[[0.0, 0.0, 0.0, shape.radius]]]),)
    if kind == "Capsule":
        return (np.array([[[0.0, 0.0, z, shape.radius] for z in (-shape.halfLength, shape.halfLength)]]),)
    if kind == "Cylinder":
        rims = [_rim(shape.radius, -shape.halfLength), _rim(shape.radius, shape.halfLength)]
        return (_points(np.vstack(rims)),)
    if kind == "Cone":
        return (_points(np.vstack([_rim(shape.radius, -shape.halfLength), [[0.0, 0.0, shape.halfLength]]])),)
    raise SetupError(
        f"shape {kind} is not supported; possible are mesh, box, sphere, capsule, cylinder, cone"
    )


def place(pieces: Pieces, rotation: Array, translation: Array) -> Pieces:
    """Pieces moved by ``x -> rotation x + translation``."""
    return tuple(_moved(corners, rotation, translation) for corners in pieces)


def sweep(pieces: Pieces, axis: Array, lower: float, upper: float, prismatic: bool) -> Pieces:
    """Pieces that contain all positions of a joint from ``lower`` to ``upper`` [m or rad; ±inf if endless].

    Sliding: the hull of both ends. Turning: corners are sampled at most :data:`_ARC` apart, and each ball
    grows by the sagitta r(1 - cos(step/2)) of its own path, so that the hull contains the arcs between.
    """
    if prismatic:
        if not np.isfinite([lower, upper]).all():
            raise SetupError("a sliding joint without finite limits cannot be enclosed")
        ends = [place(pieces, np.eye(3), position * axis) for position in (lower, upper)]
        return tuple(np.concatenate(pair, axis=1) for pair in zip(*ends, strict=True))
    if upper - lower >= 2.0 * np.pi:
        lower, upper = -np.pi, np.pi
    steps = max(1, int(np.ceil((upper - lower) / _ARC)))
    angles = np.linspace(lower, upper, steps + 1)
    sagitta = 1.0 - np.cos(0.5 * (upper - lower) / steps)
    grown = []
    for corners in pieces:
        centres = corners[..., :3]
        lever = np.linalg.norm(centres - (centres @ axis)[..., None] * axis, axis=-1)
        grown.append(np.concatenate([centres, (corners[..., 3] + sagitta * lever)[..., None]], axis=-1))
    turned = [place(tuple(grown), rotation_about(axis, float(angle)), np.zeros(3)) for angle in angles]
    return tuple(np.concatenate(parts, axis=1) for parts in zip(*turned, strict=True))


def balls_of(pieces: Sequence[Array]) -> Array:
    """All corner balls (N, 4)."""
    return np.vstack([corners.reshape(-1, 4) for corners in pieces])


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


def _points(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])[None, :, :]


def _rim(radius: float, z: float) -> Array:
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    outer = radius / np.cos(np.pi / _RIM)
    return np.column_stack([outer * np.cos(angle), outer * np.sin(angle), np.full(_RIM, z)])


def _moved(corners: Array, rotation: Array, translation: Array) -> Array:
    return np.concatenate([corners[..., :3] @ rotation.T + translation, corners[..., 3:]], axis=-1)
