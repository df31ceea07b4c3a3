"""Straight lines of a tool in space as joint motion: inverse kinematics, and quintics through its samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.quintics import quintics, rest_to_rest
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

_KNOT_S = 0.05
RAMP_S = 0.2
"""In this time the speed rises from 0 to the programmed one, and falls."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One straight piece, from rest to rest.

    Attributes
    ----------
    way:
        (3,) how far the tool goes [m].
    speed:
        Between the ramps [m/s]; 0: it waits for ``wait_s``.
    wait_s:
        How long it waits [s].
    """

    way: Array
    speed: float
    wait_s: float = 0.0

    @property
    def duration(self) -> float:
        """Seconds."""
        if self.speed == 0.0:
            return self.wait_s
        return float(np.linalg.norm(self.way)) / self.speed + RAMP_S

    def share(self, t: float) -> tuple[float, float, float]:
        """Return the share of the way at ``t`` [s] of it, and its first two derivatives."""
        if self.speed == 0.0:
            return 0.0, 0.0, 0.0
        return rest_to_rest(t, 1.0, self.duration, RAMP_S)


def follow_lines(robot: RobotModel, begin: Array, lines: tuple[Line, ...]) -> IntendedTrajectory:
    """Return the joint motion of a tool that keeps its direction and goes along ``lines`` from ``begin``.

    ``begin`` (6,) [rad]. Between knots 50 ms apart each joint is a quintic with the configuration, velocity
    and acceleration of the line at both ends; in between the tool leaves the line by micrometres.

    Raises
    ------
    SetupError
        A line is shorter than its ramps, or the arm cannot follow it.
    """
    frame = ToolFrame(robot)
    rotation, place = frame.pose(begin)
    q, t0 = begin, 0.0
    knots: list[float] = []
    values: list[tuple[Array, Array, Array]] = []
    for line in lines:
        if line.speed > 0.0 and line.duration < 2.0 * RAMP_S:
            raise SetupError(f"a line of {np.linalg.norm(line.way):g} m at {line.speed:g} m/s is too short")
        n = max(2, math.ceil(line.duration / _KNOT_S))
        for t in np.linspace(0.0, line.duration, n + 1)[(1 if knots else 0) :].tolist():
            share, rate, change = line.share(t)
            q = frame.solve(rotation, place + share * line.way, q)
            knots.append(t0 + t)
            values.append((q, *_derivatives(frame, q, rate * line.way, change * line.way)))
        t0 += line.duration
        place = place + (line.way if line.speed > 0.0 else 0.0)
    return quintics(np.array(knots), values)


def _derivatives(frame: ToolFrame, q: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return q' and q'' of a tool that moves so without turning: J q' = v, J q'' = a - J' q'."""
    step = 1e-6
    jacobian = frame.at(q)[2]
    dq = np.linalg.solve(jacobian, np.concatenate((velocity, np.zeros(3))))
    change = (frame.at(q + step * dq)[2] - frame.at(q - step * dq)[2]) / (2.0 * step)
    ddq = np.linalg.solve(jacobian, np.concatenate((acceleration, np.zeros(3))) - change @ dq)
    return np.asarray(dq, np.float64), np.asarray(ddq, np.float64)
