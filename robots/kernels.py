"""Compiled kinematics of a tree of revolute and prismatic joints."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def forward(kinematics: NDArray[np.void], q: Array, rotations: Array, positions: Array) -> None:
    """Write the world poses of the joint frames at joint positions ``q`` (≥ n,) [rad; m if prismatic].

    ``rotations`` (≥ n, 3, 3) and ``positions`` (≥ n, 3) [m] are written for the n joints of ``kinematics``; a
    joint frame moves with its joint. NaN in ``q`` gives NaN in the poses of that joint and of all after it.
    """
    tree = kinematics[0]
    turn = np.empty((3, 3))
    shift = np.empty(3)
    for i in range(tree.n):
        _joint_motion(tree, i, q[i], turn, shift)
        parent = tree.parent[i]
        for r in range(3):
            if parent < 0:
                positions[i, r] = shift[r]
                for c in range(3):
                    rotations[i, r, c] = turn[r, c]
                continue
            position = positions[parent, r]
            for k in range(3):
                position += rotations[parent, r, k] * shift[k]
            positions[i, r] = position
            for c in range(3):
                entry = 0.0
                for k in range(3):
                    entry += rotations[parent, r, k] * turn[k, c]
                rotations[i, r, c] = entry


@njit(cache=True, error_model="numpy")
def _joint_motion(tree: Any, i: int, q: float, turn: Array, shift: Array) -> None:
    """Write rotation (3, 3) and translation (3,) of joint frame i in its parent joint's frame."""
    x, y, z = tree.axis[i, 0], tree.axis[i, 1], tree.axis[i, 2]
    angle, stroke = q, 0.0
    if tree.prismatic[i]:
        angle, stroke = 0.0, q
    cos, sin = np.cos(angle), np.sin(angle)
    rest = 1.0 - cos
    for r in range(3):
        r0, r1, r2 = tree.rotation[i, r, 0], tree.rotation[i, r, 1], tree.rotation[i, r, 2]
        along = r0 * x + r1 * y + r2 * z
        turn[r, 0] = cos * r0 + sin * (r1 * z - r2 * y) + rest * along * x
        turn[r, 1] = cos * r1 + sin * (r2 * x - r0 * z) + rest * along * y
        turn[r, 2] = cos * r2 + sin * (r0 * y - r1 * x) + rest * along * z
        shift[r] = tree.translation[i, r] + along * stroke


@njit(cache=True, error_model="numpy")
def velocities(
    kinematics: NDArray[np.void], dq: Array, rotations: Array, positions: Array, angular: Array, linear: Array
) -> None:
    """Write angular (≥ n, 3) [rad/s] and linear (≥ n, 3) [m/s] velocities of the joint frames, world axes.

    ``rotations`` and ``positions`` are what :func:`forward` wrote for the same configuration; ``dq`` (≥ n,).
    A point p fixed in joint frame i moves with ``linear[i] + angular[i] × (p - positions[i])``.
    """
    tree = kinematics[0]
    for i in range(tree.n):
        parent = tree.parent[i]
        for r in range(3):
            linear[i, r] = 0.0
            angular[i, r] = 0.0
        if parent >= 0:
            dx = positions[i, 0] - positions[parent, 0]
            dy = positions[i, 1] - positions[parent, 1]
            dz = positions[i, 2] - positions[parent, 2]
            wx, wy, wz = angular[parent, 0], angular[parent, 1], angular[parent, 2]
            linear[i, 0] = linear[parent, 0] + wy * dz - wz * dy
            linear[i, 1] = linear[parent, 1] + wz * dx - wx * dz
            linear[i, 2] = linear[parent, 2] + wx * dy - wy * dx
            for r in range(3):
                angular[i, r] = angular[parent, r]
        for r in range(3):
            axis = 0.0
            for k in range(3):
                axis += rotations[i, r, k] * tree.axis[i, k]
            if tree.prismatic[i]:
                linear[i, r] += axis * dq[i]
            else:
                angular[i, r] += axis * dq[i]
