"""Admittance control and the kinematic control of a task, (5), (6) and (19), and the paper's cyclic task.

(19) is printed with an error e whose sign is not; the robot returns to where the contact began with
e = p_0 - p only, and so it is here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.contact import kernels
from modes.settings import require_number, require_numbers
from robots.errors import SetupError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Admittance:
    """v = C (f + K (p_0 - p)), per axis: at rest f moves by 1/K; time constant 1/(C K).

    The paper's: 3.33 mm per newton, 0.417 s.

    Attributes
    ----------
    compliance:
        C [m/(s N); joint-space: rad/(s N m)].
    stiffness:
        K [N/m; N m/rad].

    Raises
    ------
    SetupError
        A number is not above 0, or the two together are too fast for the control step.
    """

    compliance: float = 0.008
    stiffness: float = 300.0
    period_s: float = 0.012

    def __post_init__(self) -> None:
        for name in ("compliance", "stiffness", "period_s"):
            require_number(f"admittance: {name}", getattr(self, name), 0.0, 1e9, above=True)
        if self.compliance * self.stiffness * self.period_s >= 1.0:
            raise SetupError(
                f"admittance: compliance {self.compliance:g} times stiffness {self.stiffness:g} should be "
                f"below 1 / period_s = {1.0 / self.period_s:.4g} 1/s: the arm would swing beyond its place"
            )

    def velocity(self, force: Array, begin: Array, place: Array) -> Array:
        """Return v (k,) [m/s] under ``force`` (k,) [N] at ``place``; the contact began at ``begin``."""
        return np.asarray(self.compliance * (force + self.stiffness * (begin - place)))


def joint_speeds(jacobian: Array, velocity: Array, wanted: Array) -> Array:
    """Return (5): the speeds (n,) [rad/s] next to ``wanted`` (n,) that move the tool with ``velocity`` (3,).

    ``jacobian``: ``(3, n)``. Where it is singular the speed is damped instead of growing without bound.
    """
    out = np.empty(len(wanted))
    kernels.least_change(np.ascontiguousarray(jacobian), velocity, wanted, out)
    return out


def task_velocity(velocity: Array, place: Array, wanted: Array, gain: float) -> Array:
    """Return (6): ṗ_d + K (p_d - p), ``velocity`` being ṗ_d and ``wanted`` p_d."""
    return np.asarray(velocity + gain * (wanted - place))


class CyclicTask:
    """The paper's task: along straight lines from corner to corner and round, at rest in each.

    Parameters
    ----------
    corners:
        ``(C, 3)`` [m]; from the last one it goes on to the first.
    leg_s:
        Time for each line, a quintic from rest to rest [s].

    Raises
    ------
    SetupError
        There are fewer than two corners, or one is not finite.
    """

    def __init__(self, corners: Sequence[Sequence[float]] | Array, leg_s: float = 3.0) -> None:
        self.corners = require_numbers("cyclic task: corners", corners, (-1, 3))
        if len(self.corners) < 2:
            raise SetupError(f"cyclic task: {len(self.corners)} corner, two or more are needed")
        require_number("cyclic task: leg_s", leg_s, 0.01, 1e6)
        self.leg_s = float(leg_s)

    def at(self, t: float) -> tuple[Array, Array]:
        """Return p_d (3,) [m] and ṗ_d (3,) [m/s] when the task has run for ``t`` [s]."""
        place, velocity = np.empty(3), np.empty(3)
        kernels.cycle(self.corners, self.leg_s, t, place, velocity)
        return place, velocity
