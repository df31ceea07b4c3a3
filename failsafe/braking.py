"""A stop that was measured: how long an arm may go on, and how each joint brakes at least.

From when it is told to stop at 0, with V ≥ |q̇| of a joint, in its direction, while it goes on as intended:

    |q̇(t)| ≤ V for t ≤ delay,   |q̇(t)| ≤ max(0, V − b (t − delay)) afterwards,  b = min(a, V/T)

a: deceleration of the joint, T: time that every joint may take to brake, however slow it is (arms that stop
on their path bring all joints to rest together). What follows for the way: V delay + V²/(2 b), for the time:
delay + V/b. It says nothing about joints faster than those that were measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from failsafe import braking_kernels
from robots.errors import SetupError
from robots.motion import Block

Array = NDArray[np.float64]

LONGEST_S = 10.0
"""Delays and braking times beyond this [s] are refused."""


@dataclass(frozen=True, slots=True, eq=False)
class Braking:
    """How an arm stops by itself when it is told to.

    Attributes
    ----------
    delay_s:
        It goes on as intended for at most this long [s].
    braking_time_s:
        T: however slow a joint is, it may take this long to brake [s].
    deceleration:
        ``(n,)`` a: each joint brakes by at least this, unless T allows it less [rad/s²; m/s²].
    fastest:
        ``(n,)`` speeds up to which this was found [rad/s; m/s].

    Raises
    ------
    SetupError
        A value is not finite, or not of the sign that it must have.
    """

    delay_s: float
    braking_time_s: float
    deceleration: Array
    fastest: Array

    def __post_init__(self) -> None:
        for name, value in (("delay", self.delay_s), ("braking time", self.braking_time_s)):
            if not 0.0 <= value <= LONGEST_S:
                raise SetupError(f"braking: {name} of {value} s should be between 0 and {LONGEST_S:g} s")
        for name, values in (("deceleration", self.deceleration), ("fastest", self.fastest)):
            if not (np.ndim(values) == 1 and np.isfinite(values).all() and np.min(values, initial=1.0) > 0.0):
                raise SetupError(f"braking: {name} {values} should be one finite value > 0 per joint")
        if len(self.deceleration) != len(self.fastest):
            raise SetupError(
                f"braking: {len(self.deceleration)} decelerations and {len(self.fastest)} speeds should be "
                "one of each per joint"
            )

    def brakes_for(self, speed: Array) -> Array:
        """Return how long each joint may brake (n,) [s] from ``speed`` (n,) ≥ 0."""
        return np.maximum(self.braking_time_s, speed / self.deceleration)

    def time(self, speed: Array) -> Array:
        """Return when each joint is at rest at the latest (n,) [s]."""
        return self.delay_s + self.brakes_for(speed)

    def way(self, speed: Array) -> Array:
        """Return how far each joint may get (n,) [rad; m]."""
        return speed * (self.delay_s + 0.5 * self.brakes_for(speed))

    def speed(self, speed: Array, elapsed: float) -> Array:
        """Return how fast each joint may be (n,) after ``elapsed`` [s] from ``speed`` (n,)."""
        braking = max(elapsed - self.delay_s, 0.0)
        if braking == 0.0:
            return speed
        with np.errstate(divide="ignore"):
            share = np.where(speed > 0.0, braking / self.brakes_for(speed), math.inf)
        return speed * np.maximum(1.0 - share, 0.0)

    def append(self, slices: Block, up: Array, down: Array, length: float) -> float:
        """Let ``slices`` end with this stop, told at their last node, in slices of about ``length`` [s].

        ``up, down (n,)``: largest speeds forwards and backwards, ≥ 0, while it goes on as intended. Returns
        how long it lasts [s]; NaN, with no slice left, where there is no room or a bound is not finite.
        """
        brakes = np.stack([self.brakes_for(up), self.brakes_for(down)])
        return float(braking_kernels.append_braking(slices, up, down, self.delay_s, brakes, length))

    def slower(self, margin: float) -> Braking:
        """Return braking of which every time is longer by the share ``margin`` ≥ 0.

        Raises
        ------
        SetupError
            The margin is not a number from 0 to 10, or the times become too long.
        """
        if not 0.0 <= margin <= LONGEST_S:
            raise SetupError(f"margin {margin}: should be a share from 0 to {LONGEST_S:g}")
        more = 1.0 + margin
        return Braking(
            more * self.delay_s, more * self.braking_time_s, self.deceleration / more, self.fastest
        )
