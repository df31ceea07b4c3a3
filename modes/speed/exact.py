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
    places = _places(pairs, goal)
    if not math.isnan(free):
        places = np.append(free, places)
    return float(kernels.best_of(pairs, numbers, places))


def _places(pairs: Array, goal: Goal) -> Array:
    """Return every speed within the cap that can be a minimum where somebody is touched.

    All crossings of two pairs are among them, whether or not a third one is lower there: rounding spoils
    telling which pair is the lowest where several pass through 0 at one speed.
    """
    cap, w = goal.cap, goal.weights
    bare = w.closeness * goal.programmed + w.smoothness * goal.previous
    bare /= w.closeness + w.smoothness  # the minimum without anybody
    pairs = _that_matter(pairs, cap)
    i, j = np.triu_indices(len(pairs), 1)
    differences = np.concatenate((pairs[i] - pairs[j], pairs - (1.0, 0.0, 0.0)))
    found = np.concatenate(
        (_roots(differences), *(_stationary(each, goal) for each in pairs), (-cap, bare, cap))
    )
    return np.unique(found[np.abs(found) <= cap])


def _that_matter(pairs: Array, cap: float) -> Array:
    """Return the pairs that may be the lowest one, and at most 1, somewhere within the cap."""
    c0, c1, c2 = pairs.T
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(c2 > 0.0, np.clip(-0.5 * c1 / c2, -cap, cap), 0.0)
    low = c0 + vertex * (c1 + vertex * c2)
    high = np.maximum(c0 - cap * (c1 - cap * c2), c0 + cap * (c1 + cap * c2))
    return np.unique(pairs[(low <= 1.0) & (low <= high.min())], axis=0)


def _roots(c: Array) -> Array:
    """Return the real roots of c[0] + c[1] v + c[2] v², rows of ``(K, 3)``; NaN where there is none.

    A double root that rounding has lost is found as the vertex, which is taken for every row.
    """
    c0, c1, c2 = c.T
    with np.errstate(divide="ignore", invalid="ignore"):
        square = np.maximum(c1 * c1 - 4.0 * c0 * c2, 0.0)
        far = -0.5 * (c1 + np.copysign(np.sqrt(square), c1))
        return np.concatenate((far / c2, c0 / far, -0.5 * c1 / c2))


def _stationary(c: Array, goal: Goal) -> Array:
    """Return the real roots of q' F³ = 2 R F', where the derivative of q + R / F² vanishes.

    In units of the cap, within which the roots are looked for. Of complex ones the real part is returned: a
    double root may come out as two of them, and a place too many does no harm.
    """
    unit = goal.cap
    w = goal.weights
    f = np.polynomial.Polynomial(c * (1.0, unit, unit**2))
    wanted = w.closeness * goal.programmed + w.smoothness * goal.previous
    slope = np.polynomial.Polynomial((-2.0 * wanted / unit, 2.0 * (w.closeness + w.smoothness)))
    share = (goal.programmed / unit) ** 2
    roots = (slope * f**3 - 2.0 * w.penalty * share * f.deriv()).roots()
    return np.asarray(unit * roots.real)
