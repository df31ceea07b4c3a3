"""Points that obey limits of speed and acceleration and use them up, and what a sensor says about them.

Independent of the models: positions are exact integrals of accelerations that are constant for a millisecond,
as hard as allowed and thrown about at random instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 1e-3


@dataclass(frozen=True)
class Motions:
    """``n`` motions on a grid: times (T,) [s], positions (T, n, 3) [m] and velocities (T, n, 3) [m/s]."""

    t: Array
    x: Array
    v: Array

    def at(self, t: float) -> tuple[Array, Array]:
        """Position and velocity (n, 3) at one instant, exactly."""
        i = min(max(int(np.searchsorted(self.t, t, side="right")) - 1, 0), len(self.t) - 2)
        h = t - self.t[i]
        a = (self.v[i + 1] - self.v[i]) / (self.t[i + 1] - self.t[i])
        return self.x[i] + h * self.v[i] + 0.5 * h * h * a, self.v[i] + h * a


def directions(rng: np.random.Generator, n: int) -> Array:
    """Random unit vectors (n, 3)."""
    drawn = rng.normal(size=(n, 3))
    out: Array = drawn / np.linalg.norm(drawn, axis=1)[:, None]
    return out


def bang_bang(
    rng: np.random.Generator, begin: float, end: float, speed: Array, acceleration: Array, change_hz: float
) -> Motions:
    """Motions over [begin, end] [s] with |v| <= ``speed`` (n,) and |a| = ``acceleration`` (n,) or 0.

    The direction of acceleration changes at random, ``change_hz`` times a second on average. A step that
    would exceed the speed is made with as much of the acceleration as the speed allows. Without changes the
    motions start slowly and go straight on.
    """
    n, steps = len(speed), int(np.ceil((end - begin) / STEP_S))
    t = begin + STEP_S * np.arange(steps + 1)
    x, v = np.empty((steps + 1, n, 3)), np.empty((steps + 1, n, 3))
    x[0] = rng.uniform(-0.3, 0.3, (n, 3))
    pushed = directions(rng, n)
    v[0] = pushed * (0.1 * speed)[:, None]
    if change_hz > 0.0:
        v[0] = directions(rng, n) * (speed * rng.uniform(0.0, 1.0, n))[:, None]
    changes = rng.random((steps, n)) < change_hz * STEP_S
    for i in range(steps):
        new = changes[i]
        if new.any():
            pushed[new] = directions(rng, int(new.sum()))
        step = STEP_S * acceleration[:, None] * pushed
        after = v[i] + step
        too_fast = np.linalg.norm(after, axis=1) > speed
        if too_fast.any():
            after[too_fast] = _slowed(v[i, too_fast], step[too_fast], speed[too_fast])
            pushed[too_fast] = directions(rng, int(too_fast.sum()))
        v[i + 1] = after
        x[i + 1] = x[i] + 0.5 * STEP_S * (v[i] + after)
    return Motions(t, x, v)


def _slowed(v: Array, step: Array, speed: Array) -> Array:
    """v + λ step with the largest λ in [0, 1] that keeps |v + λ step| <= speed."""
    a = np.einsum("ij,ij->i", step, step)
    b = np.einsum("ij,ij->i", v, step)
    c = np.minimum(np.einsum("ij,ij->i", v, v) - speed**2, 0.0)
    share = (-b + np.sqrt(b * b - a * c)) / a * (1.0 - 1e-12)
    out: Array = v + np.clip(share, 0.0, 1.0)[:, None] * step
    return out


def to_hull(points: Array, x: Array) -> Array:
    """Distance (n,) [m] of ``x`` (n, 3) from the segments between ``points`` (n, 2, 3)."""
    a, along = points[:, 0], points[:, 1] - points[:, 0]
    length = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", x - a, along) / np.where(length > 0.0, length, 1.0)
    out: Array = np.linalg.norm(x - a - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1)
    return out
