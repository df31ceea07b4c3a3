"""The tool of an arm: where it is, how it moves, and the configuration that puts it somewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modes import kernels
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

_STEPS = 100
_CLOSE = 1e-12


class ToolFrame:
    """A frame on the last link of an arm, with the axes of its last joint's frame.

    Parameters
    ----------
    robot:
        The arm.
    local_m:
        ``(3,)`` where its origin is, in the frame of the last joint [m].
    """

    def __init__(self, robot: RobotModel, local_m: Array | None = None) -> None:
        self._robot = robot
        self._local = np.zeros(3) if local_m is None else np.array(local_m, dtype=float)
        n = len(robot.joints)
        self._rotations, self._positions = np.zeros((n, 3, 3)), np.zeros((n, 3))

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """Return rotation (3, 3), place (3,) [m] and Jacobian (6, n), linear then angular, at ``q`` (n,)."""
        out, place = np.empty((6, len(self._positions))), np.empty(3)
        kernels.jacobian(self._robot.kinematics, q, self._local, self._rotations, self._positions, place, out)
        return self._rotations[-1].copy(), place, out

    def pose(self, q: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and place (3,) [m] at ``q`` (n,) [rad; m]."""
        rotation, place, _jacobian = self.at(q)
        return rotation, place

    def solve(self, rotation: Array, place: Array, near: Array) -> Array:
        """Return the configuration (6,) [rad] with that pose which Newton's method finds from ``near``.

        Raises
        ------
        SetupError
            The arm has not six joints, none is found, or it is outside the position limits; one line that
            says where.
        """
        n = len(self._positions)
        if n != 6:
            raise SetupError(f"{self._robot.name} has {n} joints: poses are solved for arms of six")
        q, limits = near.copy(), self._robot.limits
        for _ in range(_STEPS):
            turn, at, jacobian = self.at(q)
            skew = rotation @ turn.T
            twist = 0.5 * np.array(
                [skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]
            )
            error = np.concatenate((place - at, twist))
            if float(np.abs(error).max()) < _CLOSE:
                break
            damped = jacobian.T @ jacobian + 1e-12 * np.eye(6)
            q = q + np.clip(np.linalg.solve(damped, jacobian.T @ error), -0.3, 0.3)
        else:
            raise SetupError(
                f"{self._robot.name}: no configuration is found at {np.round(place, 4).tolist()} m"
            )
        outside = (q < limits.position_lower) | (q > limits.position_upper)
        if outside.any():
            joint = self._robot.joints[int(np.argmax(outside))]
            raise SetupError(
                f"{self._robot.name}: at {np.round(place, 4).tolist()} m joint {joint} is beyond its limits"
            )
        return q
