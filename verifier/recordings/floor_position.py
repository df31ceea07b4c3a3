"""Somebody of whom only the place on the floor is known: what that says of the pelvis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

HIGHEST_PELVIS_M = 1.2
"""No pelvis of somebody who lies, sits, walks or stands on tiptoe is higher above the floor [m]: 0.53 of a
stature of 1.9 m (Drillis and Contini 1966, hip height) is 1.01 m. Who climbs or stands on something is."""


def pelvis_above(
    place: ArrayLike, error_m: float, up: ArrayLike | None = None
) -> tuple[NDArray[np.float64], float]:
    """Return a place of the pelvis (3,) [m], and an error [m] that holds every pelvis above ``place``.

    Parameters
    ----------
    place:
        On the floor (3,) [m].
    error_m:
        Largest horizontal distance of the middle of the pelvis from it [m].
    up:
        Unit vector (3,) away from the floor, in the same frame; ``None``: nobody knows where up is.

    The pelvis is at ``place + h up + d``, with 0 <= h <= :data:`HIGHEST_PELVIS_M`, d horizontal and at most
    ``error_m`` long: within hypot(h/2, error) of half the greatest height, and within hypot(h, error) of the
    place, whatever is up.
    """
    at = np.asarray(place, np.float64)
    if up is None:
        return at, math.hypot(HIGHEST_PELVIS_M, error_m)
    half = 0.5 * HIGHEST_PELVIS_M
    return at + half * np.asarray(up, np.float64), math.hypot(half, error_m)
