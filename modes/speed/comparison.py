"""The two methods that the paper compares with, as far as it describes them.

*Hwang, Ju and Chen 2003*: (13), a sum of collision-trend indices and |V - V_p| / V_p. The index comes from
"projecting the ellipsoids onto a Gaussian distribution"; the full text was not at hand, and exp((1 - F) / 2)
stands for it: 1 where two ellipsoids touch. As printed, (13) divides by V_p with its sign, so that with a
negative V_p to deviate is *rewarded*; the sign is a slip and the corrected variant divides by |V_p|.

*Morato et al. 2014*: at the programmed speed while the centres are farther apart than a threshold, else stop.
The threshold is not given; 0.16 m reproduces both of the paper's standard deviations of the jerk exactly
(0.1595 to 0.1616 m do).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from modes.speed.objective import Goal
from robots.errors import SetupError

Array = NDArray[np.float64]
Sign = Literal["as_printed", "corrected"]

MORATO_THRESHOLD_M = 0.16
_SPEEDS = 2001
"""Speeds within the cap at which (13), which has a kink, is looked at: 0.25 mm/s apart at 250 mm/s."""


def hwang_speed(
    pairs: Array, goal: Goal, sign: Sign = "as_printed", within: tuple[float, float] | None = None
) -> float:
    """Return the speed [m/s] of least (13); ``within``: speeds that leave the robot on its path [m/s].

    Of equal ones the nearest to the programmed speed.
    """
    if sign not in ("as_printed", "corrected"):
        raise SetupError(f"Hwang's method: sign {sign!r} should be as_printed or corrected")
    v = np.linspace(-goal.cap, goal.cap, _SPEEDS)
    v = np.sort(np.append(v, goal.programmed))
    if within is not None:
        v = v[(v >= within[0] - 1e-12) & (v <= within[1] + 1e-12)]
    f = pairs[:, 0, None] + v * (pairs[:, 1, None] + v * pairs[:, 2, None])
    trend = np.exp(0.5 * (1.0 - np.maximum(f, 0.0))).sum(axis=0)
    away = np.abs(v - goal.programmed)
    by = goal.programmed if sign == "as_printed" else abs(goal.programmed)
    value = 2.0 * trend + away / by  # the index of the sample before is the same for every speed
    best = np.flatnonzero(value <= value.min() + 1e-12)
    return float(v[best[np.argmin(away[best])]])


def morato_speed(distance: Array, programmed: float, threshold: float = MORATO_THRESHOLD_M) -> float:
    """Return the programmed speed [m/s]; 0 where a distance of centres is not above the threshold [m]."""
    if not threshold > 0.0:
        raise SetupError(f"Morato's method: threshold of {threshold} m should be above 0")
    return programmed if bool((distance > threshold).all()) else 0.0
