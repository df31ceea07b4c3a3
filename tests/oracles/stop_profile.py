"""Own integration of jerk-limited motion in one dimension, and the fastest stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """Constant ``jerks`` (P,), each held for its part of ``durations`` (P,) [s], from a state at time 0."""

    position: float
    velocity: float
    acceleration: float
    durations: tuple[float, ...]
    jerks: tuple[float, ...]

    @property
    def duration(self) -> float:
        """Time until the last jerk ends [s]."""
        return math.fsum(self.durations)

    def sample(self, time: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (T,) each; before 0 at constant velocity, at the end at rest."""
        p, v, a = self.position, self.velocity, self.acceleration
        out = p + v * np.minimum(time, 0.0), np.full(time.shape, v), np.full(time.shape, a)
        start = 0.0
        for duration, jerk in zip(self.durations, self.jerks, strict=True):
            dt = np.clip(time - start, 0.0, duration)
            within = time >= start
            for target, value in zip(
                out,
                (p + v * dt + a * dt**2 / 2 + jerk * dt**3 / 6, v + a * dt + jerk * dt**2 / 2, a + jerk * dt),
                strict=True,
            ):
                target[within] = value[within]
            p, v, a = (
                p + v * duration + a * duration**2 / 2 + jerk * duration**3 / 6,
                v + a * duration + jerk * duration**2 / 2,
                a + jerk * duration,
            )
            start += duration
        return out


def fastest_stop(
    position: float, velocity: float, acceleration: float, acceleration_limit: float, jerk_limit: float
) -> Profile:
    """Fastest way to zero velocity and acceleration; the state's acceleration is within the limit.

    Where releasing the acceleration alone would leave a velocity v + a |a| / (2 j) > 0, the acceleration
    falls to -A, stays there and returns to 0. Without a plateau v = (2 A² - a²) / (2 j). Otherwise mirrored.
    """
    if velocity + acceleration * abs(acceleration) / (2.0 * jerk_limit) < 0.0:
        mirrored = fastest_stop(-position, -velocity, -acceleration, acceleration_limit, jerk_limit)
        return Profile(
            position, velocity, acceleration, mirrored.durations, tuple(-j for j in mirrored.jerks)
        )
    deepest = math.sqrt(max(0.0, jerk_limit * velocity + 0.5 * acceleration**2))
    plateau = 0.0
    if deepest > acceleration_limit:
        deepest = acceleration_limit
        plateau = (velocity - (2.0 * deepest**2 - acceleration**2) / (2.0 * jerk_limit)) / deepest
    fall = (acceleration + deepest) / jerk_limit
    return Profile(
        position,
        velocity,
        acceleration,
        (max(fall, 0.0), max(plateau, 0.0), deepest / jerk_limit),
        (-jerk_limit, 0.0, jerk_limit),
    )
