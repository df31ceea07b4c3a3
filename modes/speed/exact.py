"""The exact minimum of the objective over one bounded speed.

The objective is a convex quadratic, plus R / F² where F, the least of the pairs' quadratics, is at most 1.
Its minimum is at one of finitely many speeds, and all of them are looked at: the end of an interval in which
somebody is touched, or, where to touch somebody may cost less than not to, a place where two pairs change
over, or where a derivative vanishes: the root of a polynomial of degree 7.

Where nobody is to be touched the best speed lies at the open end of an interval, which has no minimum: the
speed returned is the next one in doubles at which F is above 1.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from modes.speed import kernels
from modes.speed.objective import Goal

Array = NDArray[np.float64]


def exact_speed(pairs: Array, goal: Goal) -> float:
    """Return the speed [m/s] of least objective, of pairs ``(K, 3)``."""
    numbers = goal.array()
    free, settled = kernels.best_free(pairs, numbers)
    if settled:
        return float(free)
    found = [] if math.isnan(free) else [float(free)]
    found += _places(pairs, goal)
    return min(found, key=lambda v: kernels.objective(pairs, numbers, v))


def _places(pairs: Array, goal: Goal) -> list[float]:
    """Return every speed within the cap that can be a minimum where somebody is touched."""
    cap, v = goal.cap, -goal.cap
    places = [-cap, cap]
    for _ in range(2 * len(pairs) + 1):  # two parabolas cross twice at most
        pair = _lowest(pairs, v)
        end, places_on = _until(pairs, pair, v, cap), _stationary(pairs[pair], goal)
        places += [x for x in places_on if v <= x <= end]
        places += [x for x in _roots(pairs[pair] - (1.0, 0.0, 0.0)) if v <= x <= end]
        places.append(end)
        if end >= cap:
            break
        v = end
    return places


def _lowest(pairs: Array, v: float) -> int:
    """Return the pair whose F is the least one just above ``v``."""
    value = pairs[:, 0] + v * (pairs[:, 1] + v * pairs[:, 2])
    near = np.flatnonzero(value <= value.min() + 1e-12 * max(1.0, abs(float(value.min()))))
    slope = pairs[near, 1] + 2.0 * v * pairs[near, 2]
    return int(near[np.lexsort((pairs[near, 2], slope))[0]])


def _until(pairs: Array, pair: int, v: float, cap: float) -> float:
    """Return where another pair gets below this one."""
    end = cap
    for other in pairs:
        for x in _roots(other - pairs[pair]):
            if v + 1e-12 < x < end:
                end = x
    return end


def _roots(c: Array) -> list[float]:
    """Return the real roots of c[0] + c[1] v + c[2] v²."""
    if c[2] == 0.0:
        return [] if c[1] == 0.0 else [float(-c[0] / c[1])]
    square = c[1] * c[1] - 4.0 * c[0] * c[2]
    if square < 0.0:
        return []
    far = -0.5 * (c[1] + math.copysign(math.sqrt(square), c[1]))
    return [float(far / c[2])] + ([float(c[0] / far)] if far != 0.0 else [])


def _stationary(c: Array, goal: Goal) -> list[float]:
    """Return the real roots of q' F³ = 2 R F', where the derivative of q + R / F² vanishes.

    In units of the programmed speed, so that the coefficients of the polynomial are of one size.
    """
    unit = abs(goal.programmed)
    w = goal.weights
    f = np.polynomial.Polynomial(c * (1.0, unit, unit**2))
    wanted = w.closeness * goal.programmed + w.smoothness * goal.previous
    slope = np.polynomial.Polynomial((-2.0 * wanted / unit, 2.0 * (w.closeness + w.smoothness)))
    roots = (slope * f**3 - 2.0 * w.penalty * f.deriv()).roots()
    return [float(x.real) * unit for x in roots if abs(x.imag) <= 1e-7 * max(1.0, abs(x.real))]
