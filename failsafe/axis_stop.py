"""The time-optimal jerk-limited stop of one axis in closed form, and the worst one that its limits admit.

From speed v and acceleration a, with |ddq| ≤ A and |dddq| ≤ J. Releasing the acceleration at once ends at the
speed v + a|a| / (2J); its sign σ says which way the axis has to be braked. Mirrored so that σ > 0, the stop
builds up a deceleration p, holds it, and releases it:

    p = min(A, √(J v + a²/2)),  build-up (a + p)/J,  hold max(0, (v + a²/(2J) − p²/J)/p),  release p/J.

**Worst states.** A state is admitted if the axis can go on from it without exceeding V: v + a|a| / (2J) ≤ V,
and likewise the other way. From the border v = V − a²/(2J), a ≥ 0, every stop passes through (V, 0) after
a/J. Hence no stop from an admitted state is at any time faster than V until a⁺/J and then the stop from
(V, 0), where a⁺ = min(A, 2√(JV)) is the largest acceleration on the border; the time to rest is longest from
there. The displacement on the border is V a/J − a³/(6J²) plus that from (V, 0), largest at a = min(A,
√(2JV)).
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError

Array = NDArray[np.float64]


class Start(StrEnum):
    """From which states of an axis a worst stop is looked for."""

    STEADY = "steady"
    """At any admitted speed, with acceleration 0: how stops are tested."""
    ANY = "any"
    """At any speed and acceleration from which the axis can go on within its limits."""


class AxisLimits(NamedTuple):
    """Largest speed, acceleration and jerk of one axis [rad/s, rad/s², rad/s³; m for prismatic joints]."""

    velocity: float
    acceleration: float
    jerk: float


class AxisStop(NamedTuple):
    """A stop of one axis: three segments of constant jerk.

    ``time`` [s]; ``angle``: where it rests, from where it began [rad; m]; ``lowest, highest``: the extremes
    of the displacement on the way. ``durations`` [s] and ``jerks`` [rad/s³] of build-up, hold and release.
    """

    time: float
    angle: float
    lowest: float
    highest: float
    durations: tuple[float, float, float]
    jerks: tuple[float, float, float]


class WorstStop(NamedTuple):
    """Largest value over the admitted states, and the speed and acceleration that it is reached from."""

    value: float
    velocity: float
    acceleration: float


def stop_axis(velocity: float, acceleration: float, limits: AxisLimits) -> AxisStop:
    """Return the time-optimal stop from a state; the speed limit is not looked at.

    Raises
    ------
    SetupError
        Where a number is not finite, a limit not above zero, or the acceleration beyond its limit.
    """
    _check(limits)
    if not math.isfinite(velocity):
        raise SetupError(f"axis stop: speed {velocity:g} must be finite")
    if not abs(acceleration) <= limits.acceleration:
        raise SetupError(
            f"axis stop: acceleration {acceleration:g} must be within its limit {limits.acceleration:g}"
        )
    jerk = limits.jerk
    sign = 1.0 if velocity + acceleration * abs(acceleration) / (2.0 * jerk) >= 0.0 else -1.0
    v, a = sign * velocity, sign * acceleration
    peak = min(limits.acceleration, math.sqrt(max(0.0, jerk * v + 0.5 * a * a)))
    build, hold = max(0.0, (a + peak) / jerk), 0.0
    if peak == limits.acceleration:
        hold = max(0.0, (v + 0.5 * a * a / jerk - peak * peak / jerk) / peak)
    durations = (build, hold, peak / jerk)
    jerks = (-sign * jerk, 0.0, sign * jerk)
    at_rest, lowest, highest = _way(velocity, acceleration, durations, jerks)
    return AxisStop(build + hold + peak / jerk, at_rest, lowest, highest, durations, jerks)


def motion_during(stop: AxisStop, velocity: float, acceleration: float, t: Array) -> tuple[Array, Array]:
    """Return displacement and speed (N,) at the times ``t (N,)`` [s] of a stop from that state."""
    way, speed = np.zeros(np.shape(t)), np.full(np.shape(t), float(velocity))
    left, a = np.maximum(np.asarray(t, dtype=np.float64), 0.0), float(acceleration)
    for duration, jerk in zip(stop.durations, stop.jerks, strict=True):
        x = np.minimum(left, duration)
        way = way + x * (speed + x * (0.5 * a + x * jerk / 6.0))
        speed, a, left = speed + x * (a + 0.5 * jerk * x), a + jerk * duration, left - x
    return way, np.where(t >= stop.time, 0.0, speed)


def worst_time(limits: AxisLimits, start: Start) -> WorstStop:
    """Return the longest time to rest [s] over the admitted states; raises as :func:`stop_axis` does."""
    time = stop_axis(limits.velocity, 0.0, limits).time
    if start is Start.STEADY:
        return WorstStop(time, limits.velocity, 0.0)
    a = _largest_acceleration(limits)
    return WorstStop(time + a / limits.jerk, limits.velocity - 0.5 * a * a / limits.jerk, a)


def worst_angle(limits: AxisLimits, start: Start) -> WorstStop:
    """Return the largest displacement [rad; m] on the way to rest; raises as :func:`stop_axis` does."""
    v, j = limits.velocity, limits.jerk
    angle = stop_axis(v, 0.0, limits).angle
    if start is Start.STEADY:
        return WorstStop(angle, v, 0.0)
    a = min(limits.acceleration, math.sqrt(2.0 * j * v))
    return WorstStop(angle + v * a / j - a**3 / (6.0 * j * j), v - 0.5 * a * a / j, a)


def fastest_during(limits: AxisLimits, start: Start, t: Array) -> Array:
    """Bound |dq| (N,) [rad/s; m/s] at the times ``t (N,)`` [s] of a stop from any admitted state; falls."""
    stop = stop_axis(limits.velocity, 0.0, limits)
    late = 0.0 if start is Start.STEADY else _largest_acceleration(limits) / limits.jerk
    return np.clip(motion_during(stop, limits.velocity, 0.0, t - late)[1], 0.0, limits.velocity)


def _largest_acceleration(limits: AxisLimits) -> float:
    """Largest acceleration of an admitted state; its speed is then as far backwards as it may be."""
    return min(limits.acceleration, 2.0 * math.sqrt(limits.jerk * limits.velocity))


def _check(limits: AxisLimits) -> None:
    for name, value in limits._asdict().items():
        if not 0.0 < value < math.inf:
            raise SetupError(f"axis stop: {name} limit {value:g} must be finite and above zero")


def _way(
    velocity: float, acceleration: float, durations: tuple[float, ...], jerks: tuple[float, ...]
) -> tuple[float, float, float]:
    """Displacement at rest, and its extremes: at the ends of segments and where the speed is 0."""
    at, v, a = 0.0, velocity, acceleration
    seen = [0.0]
    for duration, jerk in zip(durations, jerks, strict=True):
        for x in _turns(v, a, jerk, duration):
            seen.append(at + x * (v + x * (0.5 * a + x * jerk / 6.0)))
        x = duration
        at, v, a = at + x * (v + x * (0.5 * a + x * jerk / 6.0)), v + x * (a + 0.5 * jerk * x), a + jerk * x
        seen.append(at)
    return at, min(seen), max(seen)


def _turns(v: float, a: float, jerk: float, duration: float) -> list[float]:
    """Times inside a segment at which its speed v + a x + jerk x²/2 is 0."""
    if jerk == 0.0:
        found = [-v / a] if a != 0.0 else []
    else:
        root = a * a - 2.0 * jerk * v
        if root < 0.0:
            return []
        found = [(-a + math.sqrt(root)) / jerk, (-a - math.sqrt(root)) / jerk]
    return [x for x in found if 0.0 < x < duration]
