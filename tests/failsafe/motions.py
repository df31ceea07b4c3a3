"""Random trajectories, limits and path states, and an evaluation that owes the core nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from failsafe.scaling import PathState
from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits

Array = NDArray[np.float64]


def limits_of(
    v: Array, a: Array, j: Array, lower: Array | None = None, upper: Array | None = None
) -> JointLimits:
    n = len(v)
    low = np.full(n, -np.inf) if lower is None else np.asarray(lower, dtype=float)
    high = np.full(n, np.inf) if upper is None else np.asarray(upper, dtype=float)
    return JointLimits(tuple(f"joint_{i}" for i in range(n)), low, high, v, a, j, np.full(n, np.inf))


def random_limits(rng: np.random.Generator, n: int) -> JointLimits:
    """Between a heavy arm with little jerk and a light one with a lot."""
    return limits_of(
        rng.uniform(1.0, 4.0, n), 10.0 ** rng.uniform(0.3, 1.5, n), 10.0 ** rng.uniform(1.5, 4.0, n)
    )


@dataclass(frozen=True)
class Motion:
    """A trajectory and the spline that it was made from."""

    trajectory: IntendedTrajectory
    splines: tuple[BSpline, ...]
    """q, q', q'', q'''."""

    def derivatives(self, s: Array) -> list[Array]:
        return [spline(s) for spline in self.splines]


def motion_of(spline: BSpline) -> Motion:
    breaks = np.unique(spline.t)
    coefficients = [spline(breaks[:-1], nu=d) / math.factorial(d) for d in range(spline.k + 1)]
    return Motion(
        IntendedTrajectory(breaks, np.stack(coefficients, axis=1)),
        tuple(spline.derivative(d) if d else spline for d in range(4)),
    )


def random_motion(rng: np.random.Generator, limits: JointLimits, load: float, degree: int = 5) -> Motion:
    """A curved path whose largest velocity, acceleration or jerk at ṡ = 1 is ``load`` times the limit."""
    n = len(limits.joints)
    spans = int(rng.integers(8, 40))
    lengths = rng.uniform(0.3, 1.0, spans)
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    knots = np.concatenate([np.zeros(degree), breaks, np.full(degree, breaks[-1])])
    roughness = 10.0 ** rng.uniform(-1.5, 0.0)
    shape = np.cumsum(rng.normal(size=(spans + degree, n)), axis=0) + roughness * rng.normal(
        size=(spans + degree, n)
    )
    shape *= np.where(rng.random(n) < 0.2, 0.01, 1.0)
    unit = motion_of(BSpline(knots, shape, degree))
    s = np.linspace(0.0, breaks[-1], 60 * spans)
    peaks = [np.abs(d).max(axis=0) for d in unit.derivatives(s)]
    # stretching time by k divides the derivatives by k, k², k³
    k = max(
        (peaks[1] / limits.velocity).max() / load,
        np.sqrt((peaks[2] / limits.acceleration).max() / load),
        np.cbrt((peaks[3] / limits.jerk).max() / load),
    )
    return motion_of(BSpline(knots * k, shape, degree))


def unwritable(breaks: Array, coefficients: Array) -> tuple[Array, Array]:
    """As those of a trajectory: what takes both kinds of array would be compiled twice."""
    breaks.setflags(write=False)
    coefficients.setflags(write=False)
    return breaks, coefficients


def path_of(record: np.void, tau: Array) -> tuple[Array, Array, Array, Array]:
    """s, ṡ, s̈, s⃛ at ``tau``: the segments of a path record integrated from the first state on."""
    n = int(record["n"])
    t, jerk = np.asarray(record["t"][: n + 1]), np.asarray(record["j"][:n])
    state = np.array([record["s"][0], record["v"][0], record["a"][0]])
    starts = []
    for k in range(n):
        starts.append(state)
        state = _advance(state, jerk[k], t[k + 1] - t[k])
    k = np.clip(np.searchsorted(t, tau, side="right") - 1, 0, n - 1)
    begin = np.array(starts)[k].T
    s, v, a = _advance(begin, jerk[k], tau - t[k])
    return s, v, a, jerk[k]


def _advance(state: Array, j: Array, d: Array) -> Array:
    s, v, a = state
    return np.array([s + d * v + d**2 / 2 * a + d**3 / 6 * j, v + d * a + d**2 / 2 * j, a + d * j])


def executed(motion: Motion, record: np.void, tau: Array) -> tuple[Array, Array, Array, Array]:
    """q, dq, ddq, dddq at ``tau``."""
    s, v, a, j = (x[:, None] for x in path_of(record, tau))
    q, d1, d2, d3 = motion.derivatives(s[:, 0])
    return q, d1 * v, d2 * v**2 + d1 * a, d3 * v**3 + 3 * d2 * v * a + d1 * j


@dataclass(frozen=True)
class Case:
    """A path state on a random motion, the joint limits that go with it, and the motion."""

    limits: JointLimits
    motion: Motion
    state: PathState


KINDS = ("curved", "accelerated", "near_limits", "rough")


def random_cases(rng: np.random.Generator, kind: str, count: int) -> Iterator[Case]:
    """Yield path states.

    curved: anywhere, ṡ up to 1. accelerated: s̈ ≠ 0, up to what the joints allow there. near_limits: just
    before or at the instant that comes closest to a limit, ṡ = 1. rough: cubic splines, whose q''' jumps,
    with large q''.
    """
    for index in range(count):
        if index % 10 == 0:
            limits = random_limits(rng, int(rng.integers(1, 8)))
            load = rng.uniform(0.8, 1.0) if kind == "near_limits" else rng.uniform(0.2, 0.95)
            motion = random_motion(rng, limits, load, 3 if kind == "rough" else 5)
            where = np.linspace(0.0, 0.7 * motion.trajectory.s_end, 2000)
            d = motion.derivatives(where)
            shares = [
                np.abs(d[1]) / limits.velocity,
                np.abs(d[2]) / limits.acceleration,
                np.abs(d[3]) / limits.jerk,
            ]
            weight = np.max(shares, axis=(0, 2)) ** 4
        s, sdot, sddot = rng.uniform(0.0, where[-1]), rng.choice([1.0, rng.uniform(0.0, 1.0)]), 0.0
        if kind in ("near_limits", "rough"):
            s = max(
                0.0, rng.choice(where, p=weight / weight.sum()) - rng.uniform(0.0, 0.1) * (rng.random() < 0.7)
            )
        if kind == "near_limits":
            sdot = 1.0
        if kind == "accelerated":
            sdot = rng.uniform(0.02, 0.9)
            low, high = allowed_acceleration(limits, motion, s, sdot)
            sddot = rng.uniform(low, high)
        yield Case(limits, motion, PathState(float(s), float(sdot), float(sddot)))


def allowed_acceleration(limits: JointLimits, motion: Motion, s: float, sdot: float) -> tuple[float, float]:
    """Range of s̈ that the joint accelerations allow at one instant, at most ±100."""
    _, d1, d2, _ = (d[0] for d in motion.derivatives(np.array([s])))
    at_rest = d2 * sdot**2
    sign = np.where(d1 == 0.0, 1.0, np.sign(d1))
    steep = np.maximum(np.abs(d1), 1e-9)
    low = ((-limits.acceleration - sign * at_rest) / steep).max()
    high = ((limits.acceleration - sign * at_rest) / steep).min()
    return max(low, -100.0), min(high, 100.0)


def excess(limits: JointLimits, dq: Array, ddq: Array, dddq: Array) -> float:
    """Largest share of a limit that is used."""
    return max(
        (np.abs(dq) / limits.velocity).max(),
        (np.abs(ddq) / limits.acceleration).max(),
        (np.abs(dddq) / limits.jerk).max(),
    )


def instants(record: np.void, points: int = 60) -> Array:
    """Times that cover every segment of a path record from just after its begin to its end."""
    n = int(record["n"])
    t = np.asarray(record["t"][: n + 1])
    if n == 0:
        return np.zeros(0)
    inner = np.linspace(0.0, 1.0, points)
    inner[0] = 1e-9
    return (t[:-1, None] + np.diff(t)[:, None] * inner[None, :]).ravel()
