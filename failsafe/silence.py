"""The robot's own reaction to silence, as part of every plan (assumption A4, docs/method.md, section 2).

A robot that does not hold the plan is sent one piece after the other, and each ends at an instant of the
loop. When nothing follows, each joint goes on for at most ``hold_s`` with the velocity that is commanded then
(or with the acceleration, where it extrapolates), and brakes with at least ``deceleration``, or does either
for less long, or more abruptly: from a silence at τ on

    0 ≤ dq(t) ≤ v  for t ≤ τ + hold,  0 ≤ dq(t) ≤ max(0, v − a (t − τ − hold))  afterwards

for a joint with velocity v ≥ 0 (the same with the signs changed for v < 0); v is q̇(τ), and as much more as
q̈ makes of it in ``hold_s``, to either side, where the robot extrapolates: it may turn round. Silence may
begin at any instant from the end of the piece on, also while the stop is being sent. At each instant every
reaction that has not come to rest yet is within ``q_spread`` of what the plan commands, and its velocity
within ``dq_spread``:

    q(t) − q_plan(t) = ∫_τ^t q̇ − (q_plan(t) − q_plan(τ)),

both terms bounded from the velocities on the slices of τ and t. A slice thereby stands for the stop and for
all reactions at once, and one check does for all. Joints may differ: each is bounded by itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from failsafe import silence_kernels
from robots.errors import SetupError
from robots.motion import Block

Array = NDArray[np.float64]

LONGEST_HOLD_S = 1.0
"""A robot that goes on for longer without a command does not react to silence."""


@dataclass(frozen=True, slots=True, eq=False)
class Silence:
    """What the robot does by itself when no command comes.

    Attributes
    ----------
    hold_s:
        It goes on for at most this long [s].
    extrapolates:
        It goes on with the acceleration that it has; else with the velocity.
    deceleration:
        ``(n,)`` it brakes each joint by at least this [rad/s², m/s² for prismatic joints].

    Raises
    ------
    SetupError
        A value is not finite, or not of the sign that it must have.
    """

    hold_s: float
    extrapolates: bool
    deceleration: Array

    def __post_init__(self) -> None:
        if not 0.0 <= self.hold_s <= LONGEST_HOLD_S:
            raise SetupError(f"silence: hold of {self.hold_s} s should be between 0 and {LONGEST_HOLD_S:g} s")
        a = self.deceleration
        if not (np.ndim(a) == 1 and np.isfinite(a).all() and np.min(a, initial=math.inf) > 0.0):
            raise SetupError(f"silence: deceleration {a} should be one finite value > 0 per joint")

    def widen(self, slices: Block, since: float) -> bool:
        """Let ``slices`` stand for every reaction to a silence from ``since`` [s] on, as well.

        ``since``: end of the piece, on the clock of the slices. Slices are added behind the last one until
        the last reaction has come to rest. Returns False, with no slice left, where a bound is not finite.
        """
        return bool(
            silence_kernels.widen(
                slices, float(since), float(self.hold_s), bool(self.extrapolates), self.deceleration
            )
        )
