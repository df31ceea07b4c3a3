"""A planner that wants a lot: random trajectories that use most of the limits, one after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits

Array = NDArray[np.float64]

FASTEST = 0.95
"""Share of the velocity limits that is used at most."""


def quintic(start: tuple[Array, Array, Array], goal: Array, tau: float) -> Array:
    """Coefficients (6, n) from q, q', q'' (n,) to rest at ``goal`` (n,) in ``tau`` [s]."""
    q, v, a = start
    d = goal - (q + tau * (v + 0.5 * tau * a))
    e, g = -(v + tau * a) * tau, -a * tau * tau
    return np.stack(
        [
            q,
            v,
            0.5 * a,
            (10 * d - 4 * e + 0.5 * g) / tau**3,
            (-15 * d + 7 * e - g) / tau**4,
            (6 * d - 3 * e + 0.5 * g) / tau**5,
        ]
    )


def _load(coefficients: Array, tau: float, limits: JointLimits, load: float) -> float:
    """Largest share of what is wanted of the limits, 1: all of it."""
    x = np.linspace(0.0, tau, 40)
    worst, rest = 0.0, coefficients
    rows = (FASTEST * limits.velocity, load * limits.acceleration, load * limits.jerk)
    for limit in rows:
        rest = rest[1:] * np.arange(1, len(rest))[:, None]
        values = (x[:, None] ** np.arange(len(rest))) @ rest
        worst = max(worst, float((np.abs(values).max(axis=0) / limit).max()))
    return worst


def leg(
    rng: np.random.Generator, limits: JointLimits, start: tuple[Array, Array, Array], load: float
) -> tuple[Array, float] | None:
    """Return coefficients and duration [s] of a way from a state to rest elsewhere; None if none fits."""
    n = len(limits.joints)
    low, high = np.maximum(limits.position_lower, -2.8), np.minimum(limits.position_upper, 2.8)
    middle, half = 0.5 * (low + high), 0.45 * (high - low)
    change = rng.normal(size=n) * rng.choice([0.3, 0.8, 1.5])
    goal = np.clip(start[0] + change, middle - half, middle + half)
    tau = 0.2
    for _ in range(40):
        coefficients = quintic(start, goal, tau)
        share = _load(coefficients, tau, limits, load)
        if share <= 1.0:
            x = np.linspace(0.0, tau, 20)[:, None] ** np.arange(6) @ coefficients
            inside = (x >= limits.position_lower).all() and (x <= limits.position_upper).all()
            return (coefficients, tau) if inside else None
        tau *= min(1.4, max(1.03, share ** (1.0 / 3.0)))
    return None


def trajectory(
    rng: np.random.Generator,
    limits: JointLimits,
    start: tuple[Array, Array, Array],
    load: float,
    legs: int,
) -> IntendedTrajectory | None:
    """Return a trajectory through ``legs`` random postures, at rest in each; None if none was found."""
    breaks, spans = [0.0], []
    for _ in range(legs):
        found = leg(rng, limits, start, load)
        if found is None:
            break
        coefficients, tau = found
        spans.append(coefficients)
        breaks.append(breaks[-1] + tau)
        end = (tau ** np.arange(6)) @ coefficients
        start = (end, np.zeros_like(end), np.zeros_like(end))
    return IntendedTrajectory(breaks, np.array(spans), "rest") if spans else None


def posture(rng: np.random.Generator, limits: JointLimits) -> Array:
    """Return a random posture (n,) well within the limits."""
    low, high = np.maximum(limits.position_lower, -2.8), np.minimum(limits.position_upper, 2.8)
    return low + (high - low) * rng.uniform(0.2, 0.8, len(low))
