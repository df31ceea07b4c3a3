"""Time scaling along a path: enclosures of its derivatives, and the search for path acceleration and jerk."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from failsafe import kernels
from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits

Array = NDArray[np.float64]


def limit_rows(limits: JointLimits) -> Array:
    """Return position lower and upper, velocity, acceleration and jerk limits as ``(5, n)``."""
    rows = (limits.position_lower, limits.position_upper, limits.velocity, limits.acceleration, limits.jerk)
    return np.ascontiguousarray(np.stack(rows), dtype=np.float64)


def derivative_bounds(trajectory: IntendedTrajectory, s0: float, s1: float) -> tuple[Array, Array]:
    """Enclose q, q', q'', q''' over [s0, s1]: lower and upper bounds, each ``(4, J)``.

    Taylor form about the centre of each span, rounded outward: exact up to O((s1 - s0)²).
    """
    lo, hi = np.full((4, trajectory.n_joints), np.nan), np.full((4, trajectory.n_joints), np.nan)
    if trajectory.s_begin <= s0 <= s1 <= trajectory.s_max:
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        kernels.derivative_bounds(b, c, kernels.locate(b, s0), s0, s1, lo, hi)
    return lo, hi


def conservative_budget(
    trajectory: IntendedTrajectory, limits: JointLimits, s: float, sdot: float, sddot: float = 0.0
) -> tuple[float, float] | None:
    """Return path acceleration and jerk of a stop from the largest derivatives over its stretch, or None.

    The textbook way, for comparison: often infeasible or slow where the search is neither (docs/method.md,
    section 2).
    """
    out = np.zeros(2)
    found = kernels.conservative_budget(
        trajectory.kernel_breaks,
        trajectory.kernel_coefficients,
        s,
        sdot,
        sddot,
        trajectory.s_max,
        limit_rows(limits),
        np.zeros(1, dtype=kernels.WORK),
        out,
    )
    return (float(out[0]), float(out[1])) if found else None


class AccelerationSearch:
    """Which path accelerations and jerks to try, in at most ``steps`` steps.

    Begins with what the joint accelerations allow locally. Downwards, by the factor by which the limit was
    exceeded, until one is proven; then by bisection of the logarithm between the largest proven and the
    smallest refused one. The jerk is what the local chain rule leaves for it; where the joint jerk is
    exceeded while the path jerk acts, the path jerk is reduced instead. Nothing is concluded from one
    candidate about another: each is proven itself.
    """

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._work = np.zeros(1, dtype=kernels.WORK)

    def begin(
        self,
        trajectory: IntendedTrajectory,
        limits: Array,
        s: float,
        sdot: float,
        sddot: float,
        target: float,
    ) -> None:
        """Start a search at the path state (s, ṡ, s̈) towards ṡ = ``target``."""
        self._breaks, self._coefficients = trajectory.kernel_breaks, trajectory.kernel_coefficients
        self._limits, self._s, self._target = limits, s, target
        self._speed = sdot
        self._least = abs(sddot)
        self._left = self._steps
        self._accepted, self._refused = 0.0, math.inf
        self._jerk_share = 0.97
        guess = kernels.guess_path_acceleration(
            self._breaks, self._coefficients, s, sdot, target, limits, self._work
        )
        self.a = max(0.97 * guess, self._least, 1e-3)
        self._set_jerk()

    def _set_jerk(self) -> None:
        self.j = self._jerk_share * kernels.guess_path_jerk(
            self._breaks,
            self._coefficients,
            self._s,
            self._speed,
            self._target,
            self.a,
            self._limits,
            self._work,
        )

    def accepted(self, improved: bool) -> bool:
        """Note that (a, j) is proven; return whether there is another candidate."""
        self._accepted = max(self._accepted, self.a)
        reached = math.sqrt(max(abs(self._speed - self._target), 1e-12) * self.j)
        if not improved or reached <= self.a:
            return False
        return self._next(math.sqrt(self.a * self._refused) if self._refused < math.inf else 1.3 * self.a)

    def refused(self, excess: float, by_jerk: bool) -> bool:
        """Note that (a, j) exceeds a limit ``excess`` times; return whether there is another candidate."""
        if by_jerk:
            self._jerk_share *= min(0.8, max(0.3, 0.95 / excess)) if excess > 1.0 else 0.8
            return self._next(self.a)
        self._refused = min(self._refused, self.a)
        if self._accepted > 0.0:
            return self._next(math.sqrt(self._accepted * self._refused))
        factor = 0.97 / excess if excess > 1.0 else 0.8
        return self._next(self.a * min(0.9, max(0.4, factor)))

    def _next(self, a: float) -> bool:
        self._left -= 1
        if self._left <= 0 or (self._accepted > 0.0 and self._refused < 1.05 * self._accepted):
            return False
        if a < self._least:
            if self.a <= self._least:
                return False
            a = self._least
        self.a = a
        self._set_jerk()
        return True
