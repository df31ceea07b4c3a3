"""How fast a path of lines and rounded corners can be driven: each corner at its own speed, lines between.

Corners are driven at a constant speed, as fast as their bends allow; on lines the speed rises and falls with
bounded acceleration and jerk. Both are polynomials of time of degree 5 at most, so that the motion lies on
the path exactly. On each line it is as fast as those ramps allow; it is not time-optimal: ramps end without
acceleration, and corners are driven at one speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits

Array = NDArray[np.float64]

_HALVINGS = 60
_BRIEF_S = 1e-12
"""Pieces that are shorter are left out."""


class Bounds(NamedTuple):
    """Greatest speed, acceleration and jerk along a line [rad/s, rad/s², rad/s³]."""

    v: float
    a: float
    j: float


def in_time(breaks: Array, coefficients: Array, limits: JointLimits) -> IntendedTrajectory:
    """Return motion from rest to rest along a path, within the limits of velocity, acceleration and jerk.

    Parameters
    ----------
    breaks, coefficients:
        ``(2k,)`` [rad] and ``(2k - 1, 6, n)``: lines and corners in turn, powers of the way beyond each
        break, lowest first. Lines have directions of length 1; corners go over into them with two
        derivatives.
    limits:
        Of the joints.
    """
    lengths = np.diff(breaks)
    lines = [_line_bounds(coefficients[k, 1], limits) for k in range(0, len(lengths), 2)]
    corners = [_corner_speed(lengths[k], coefficients[k], limits) for k in range(1, len(lengths), 2)]
    speeds = _speeds(lengths[::2].tolist(), lines, corners)
    spans: list[float] = []
    pieces: list[Array] = []
    for k, length in enumerate(lengths.tolist()):
        if k % 2:
            v = speeds[(k + 1) // 2]
            spans.append(length / v)
            pieces.append(coefficients[k] * (v ** np.arange(6))[:, None])
            continue
        at = 0.0
        for span, powers in _along(length, speeds[k // 2], speeds[k // 2 + 1], lines[k // 2]):
            piece = np.zeros_like(coefficients[k])
            piece[0] = coefficients[k, 0] + at * coefficients[k, 1]
            piece[1:4] = np.outer(powers, coefficients[k, 1])
            spans.append(span)
            pieces.append(piece)
            at += float(powers @ span ** np.arange(1, 4))
    return IntendedTrajectory(np.concatenate(([0.0], np.cumsum(spans))), np.array(pieces), "rest")


def _line_bounds(direction: Array, limits: JointLimits) -> Bounds:
    with np.errstate(divide="ignore"):
        rates = 1.0 / np.abs(direction)
    found = (float(np.min(rates * each)) for each in (limits.velocity, limits.acceleration, limits.jerk))
    return Bounds(*found)


def _corner_speed(length: float, coefficients: Array, limits: JointLimits) -> float:
    """Return the constant speed at which a corner keeps the limits."""
    found, powers = math.inf, coefficients
    for order, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1):
        powers = powers[1:] * np.arange(1.0, len(powers))[:, None]
        largest = _largest(length, powers)
        with np.errstate(divide="ignore"):
            found = min(found, float(np.min((limit / largest) ** (1.0 / order))))
    return found


def _largest(length: float, powers: Array) -> Array:
    """Return no less than the magnitudes (n,) of polynomials on 0 to ``length``: of Bernstein values."""
    d = len(powers) - 1
    ratios = np.array([[math.comb(i, k) / math.comb(d, k) for k in range(d + 1)] for i in range(d + 1)])
    return np.asarray(np.abs(ratios @ (powers * (length ** np.arange(d + 1))[:, None])).max(axis=0))


def _speeds(lengths: list[float], lines: list[Bounds], corners: list[float]) -> list[float]:
    """Return the speeds at the ends of all lines: no faster than corners allow, and lines can reach."""
    found = [0.0, *corners, 0.0]
    for k, bounds in enumerate(lines):
        most = min(found[k + 1], bounds.v)
        found[k + 1] = min(most, _reached(found[k], most, lengths[k], bounds))
    for k in range(len(lines) - 1, -1, -1):
        most = min(found[k], lines[k].v)
        found[k] = min(most, _reached(found[k + 1], most, lengths[k], lines[k]))
    return found


def _reached(v: float, most: float, length: float, bounds: Bounds) -> float:
    """Return the largest speed up to ``most`` that is reached from ``v`` within ``length``."""
    if most <= v or _ramp_way(v, most, bounds) <= length:
        return most
    low, high = v, most
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _ramp_way(v, middle, bounds) <= length else (low, middle)
    return low


def _ramp_times(v0: float, v1: float, bounds: Bounds) -> tuple[float, float]:
    """Return how long jerk and constant acceleration last in a ramp between two speeds [s]."""
    change = abs(v1 - v0)
    jerk_s = bounds.a / bounds.j
    if change >= bounds.a * jerk_s:
        return jerk_s, change / bounds.a - jerk_s
    return math.sqrt(change / bounds.j), 0.0


def _ramp_way(v0: float, v1: float, bounds: Bounds) -> float:
    jerk_s, steady_s = _ramp_times(v0, v1, bounds)
    return 0.5 * (v0 + v1) * (2.0 * jerk_s + steady_s)


def _along(length: float, v0: float, v1: float, bounds: Bounds) -> list[tuple[float, Array]]:
    """Return durations [s] and powers 1 to 3 of time of the way along a line, piece by piece."""
    low = max(v0, v1)
    high = max(bounds.v, low)
    if _ramp_way(v0, high, bounds) + _ramp_way(high, v1, bounds) > length:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            fits = _ramp_way(v0, middle, bounds) + _ramp_way(middle, v1, bounds) <= length
            low, high = (middle, high) if fits else (low, middle)
        high = low
    rest = length - _ramp_way(v0, high, bounds) - _ramp_way(high, v1, bounds)
    cruise = [(rest / high, np.array([high, 0.0, 0.0]))] if high > 0.0 else []
    pieces = [*_ramp(v0, high, bounds), *cruise, *_ramp(high, v1, bounds)]
    return [piece for piece in pieces if piece[0] > _BRIEF_S]


def _ramp(v0: float, v1: float, bounds: Bounds) -> list[tuple[float, Array]]:
    jerk_s, steady_s = _ramp_times(v0, v1, bounds)
    j = math.copysign(bounds.j, v1 - v0)
    a = j * jerk_s
    bend = 0.5 * a * jerk_s
    return [
        (jerk_s, np.array([v0, 0.0, j / 6.0])),
        (steady_s, np.array([v0 + bend, 0.5 * a, 0.0])),
        (jerk_s, np.array([v1 - bend, 0.5 * a, -j / 6.0])),
    ]
