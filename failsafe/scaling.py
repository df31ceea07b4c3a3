"""Time scaling along a path: enclosures of its derivatives, and the search for path acceleration and jerk."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe import limit_kernels, search_kernels, trajectory_kernels
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
        trajectory_kernels.derivative_bounds(b, c, trajectory_kernels.locate(b, s0), s0, s1, lo, hi)
    return lo, hi


def bounds_of_stretches(trajectory: IntendedTrajectory, begin: Array, end: Array) -> tuple[Array, Array]:
    """Enclose q and three derivatives over each of C stretches: lower and upper bounds, ``(C, 4, J)``."""
    lo = np.full((len(begin), 4, trajectory.n_joints), np.nan)
    hi = lo.copy()
    trajectory_kernels.bounds_of_stretches(
        trajectory.kernel_breaks, trajectory.kernel_coefficients, begin, end, lo, hi
    )
    return lo, hi


def conservative_budget(
    trajectory: IntendedTrajectory, limits: JointLimits, state: PathState
) -> tuple[float, float] | None:
    """Return path acceleration and jerk of a stop from the largest derivatives over its stretch, or None.

    The textbook way, for comparison: often infeasible or slow where the search is neither (docs/method.md,
    section 2).
    """
    out = np.zeros(2)
    found = search_kernels.conservative_budget(
        trajectory.kernel_breaks,
        trajectory.kernel_coefficients,
        *state,
        trajectory.s_max,
        limit_rows(limits),
        np.zeros(1, dtype=limit_kernels.WORK),
        out,
    )
    return (float(out[0]), float(out[1])) if found else None


class PathState(NamedTuple):
    """Where the motion is on its path: s [s], ṡ [1], s̈ [1/s]."""

    s: float
    sdot: float
    sddot: float = 0.0


TIGHTER = (0.999, 0.98, 0.94, 0.88, 0.8, 0.7, 0.58, 0.46, 0.35, 0.25, 0.17, 0.1)
"""Shares of the joint limits that a candidate is predicted to keep, in the order in which they are tried."""
LOOSER = (1.0, 1.03, 1.1, 1.3, 2.0, 5.0, math.inf)
"""The same where nothing is predicted to keep the first share; mostly to learn which limit forbids a stop."""


class AccelerationSearch:
    """Which path accelerations and jerks (a_s, j_s) to try, in at most ``steps`` steps.

    For each step, changes of speed in closed form are evaluated at some instants for a logarithmic grid of
    pairs; the quickest that is predicted to keep a share of the limits becomes the candidate. The first one
    that is proven is taken; until then the share is reduced. Nothing is concluded from a prediction, nor
    from one candidate about another.
    """

    def __init__(self, limits: Array, steps: int) -> None:
        self._limits = limits
        self._steps = steps
        self._work = np.zeros(1, dtype=limit_kernels.WORK)
        self._ahead = np.zeros(1, dtype=search_kernels.AHEAD)
        self._pair = np.zeros(2)

    def candidates(
        self, trajectory: IntendedTrajectory, state: PathState, target: float
    ) -> Iterator[tuple[float, float]]:
        """Yield pairs (a_s, j_s) for a change from ``state`` to ṡ = ``target``, the quickest first."""
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        search_kernels.look_ahead(b, c, *state, target, self._limits, self._ahead, self._work)
        margins: tuple[float, ...] = TIGHTER
        left = self._steps
        if not self._predict(state, target, margins[0]):
            margins = LOOSER
        for margin in margins:
            if left > 0 and self._predict(state, target, margin):
                left -= 1
                yield float(self._pair[0]), float(self._pair[1])
        if target == 0.0 and search_kernels.conservative_budget(
            b, c, *state, trajectory.s_max, self._limits, self._work, self._pair
        ):
            yield float(self._pair[0]), float(self._pair[1])

    def _predict(self, state: PathState, target: float, margin: float) -> bool:
        return bool(
            search_kernels.predict_quickest(
                state.sdot, state.sddot, target, self._limits, margin, self._ahead, self._pair
            )
        )
