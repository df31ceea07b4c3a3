"""Compiled motion of scripted people: rates change no faster, and points go no faster, than a profile allows.

A person is a pelvis that slides over the floor, turns about the vertical, and swings both stretched arms in
the plane ahead: x = (x, y, yaw, left arm, right arm) [m, m, rad, rad, rad]. Within a step the rates are
linear in time, so every point moves on a curve with a continuous velocity.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS

Array = NDArray[np.float64]
Block = NDArray[np.void]

RATES, BOUNDS = 5, MAX_POINTS + 6
MOST_PERSONS = 8
"""A gate has room for no more."""
SHARE = 1.0 - 1e-9
"""Rounding must not carry anybody over a limit."""
SCRIPTED = np.dtype(
    [
        ("n", np.int64),
        ("x", np.float64, (MOST_PERSONS, RATES)),
        ("rate", np.float64, (MOST_PERSONS, RATES)),
        ("next_rate", np.float64, (MOST_PERSONS, RATES)),
        ("step", np.float64),
        ("height", np.float64, (MOST_PERSONS,)),
        ("offset", np.float64, (MOST_PERSONS, MAX_POINTS, 3)),
        ("arm", np.int64, (MAX_POINTS,)),
        ("along", np.float64, (MOST_PERSONS, MAX_POINTS)),
        ("lever", np.float64, (MOST_PERSONS, BOUNDS, 4)),
        ("speed", np.float64, (BOUNDS,)),
        ("acceleration", np.float64, (BOUNDS,)),
    ]
)
"""``x`` at the begin of the step of ``step`` [s], with the rates there and at its end. ``offset`` [m]: points
from the pelvis at yaw 0, of an arm (``arm`` 0 left, 1 right, -1 neither) those of the shoulder, from which
the point is ``along`` [m] the arm. Row i of ``lever`` bounds something by ``speed`` and ``acceleration``: it
goes at most at lever · (walking speed, |yaw rate|, |left|, |right|) [m/s or rad/s], inf: not limited."""


@njit(cache=True, error_model="numpy")
def _magnitudes(rate: Array, out: Array) -> None:
    out[0] = np.sqrt(rate[0] ** 2 + rate[1] ** 2)
    out[1], out[2], out[3] = abs(rate[2]), abs(rate[3]), abs(rate[4])


@njit(cache=True, error_model="numpy")
def _turning(lever: Array, size: Array) -> float:
    """Acceleration by turning alone: an arm swings in a plane that turns."""
    found = float(lever[1] * size[1] ** 2)
    for arm in range(2, 4):
        found += lever[arm] * (size[arm] ** 2 + 2.0 * size[1] * size[arm])
    return found


@njit(cache=True, error_model="numpy")
def set_out(people: Block, wish: Array, dt: float) -> None:
    """Begin a step of ``dt`` [s] with the rates in ``wish`` (n, 5), as far as the limits allow.

    The rates of a step end between those that it began with and those that are wished, shortened until the
    speeds fit and turning alone takes no more than half of any acceleration. Both bounds are convex in the
    rates, so they hold all through the step.
    """
    rec = people[0]
    size, change, wanted = np.empty(4), np.empty(4), np.empty(RATES)
    for p in range(rec.n):
        for i in range(RATES):
            rec.x[p, i] += 0.5 * rec.step * (rec.rate[p, i] + rec.next_rate[p, i])
            rec.rate[p, i] = rec.next_rate[p, i]
            wanted[i] = wish[p, i]
        _magnitudes(wanted, size)
        scale = 1.0
        for row in range(BOUNDS):
            lever, speed = rec.lever[p, row], 0.0
            for i in range(4):
                speed += lever[i] * size[i]
            if not speed * scale <= SHARE * rec.speed[row]:
                scale = SHARE * rec.speed[row] / speed
            turning = _turning(lever, size)
            if not turning * scale**2 <= 0.5 * rec.acceleration[row]:
                scale = SHARE * np.sqrt(0.5 * rec.acceleration[row] / turning)
        for i in range(RATES):
            wanted[i] = scale * wanted[i] - rec.rate[p, i]
        _magnitudes(wanted, change)
        share = 1.0
        for row in range(BOUNDS):
            lever, jump = rec.lever[p, row], 0.0
            for i in range(4):
                jump += lever[i] * change[i]
            if not share * jump <= SHARE * 0.5 * rec.acceleration[row] * dt:
                share = SHARE * 0.5 * rec.acceleration[row] * dt / jump
        for i in range(RATES):
            rec.next_rate[p, i] = rec.rate[p, i] + share * wanted[i]
    rec.step = dt


@njit(cache=True, error_model="numpy")
def state_at(people: Block, tau: float, out: Array) -> None:
    """Write x (n, 5) at ``tau`` [s] after the begin of the step."""
    rec = people[0]
    for p in range(rec.n):
        for i in range(RATES):
            bend = 0.0
            if rec.step > 0.0:
                bend = 0.5 * tau * tau * (rec.next_rate[p, i] - rec.rate[p, i]) / rec.step
            out[p, i] = rec.x[p, i] + tau * rec.rate[p, i] + bend


@njit(cache=True, error_model="numpy")
def points_at(people: Block, tau: float, out: Array) -> None:
    """Write the body points (n, 20, 3) [m, world] at ``tau`` [s] after the begin of the step."""
    rec = people[0]
    x = np.empty((MOST_PERSONS, RATES))
    state_at(people, tau, x)
    for p in range(rec.n):
        c, s = np.cos(x[p, 2]), np.sin(x[p, 2])
        for point in range(MAX_POINTS):
            ahead, left = rec.offset[p, point, 0], rec.offset[p, point, 1]
            up = rec.offset[p, point, 2]
            if rec.arm[point] >= 0:
                angle = x[p, 3 + rec.arm[point]]
                ahead += rec.along[p, point] * np.sin(angle)
                up -= rec.along[p, point] * np.cos(angle)
            out[p, point, 0] = x[p, 0] + c * ahead - s * left
            out[p, point, 1] = x[p, 1] + s * ahead + c * left
            out[p, point, 2] = rec.height[p] + up
