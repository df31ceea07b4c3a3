"""The person of a scene: the paper has a hand alone; here somebody reaches out with it, comes and goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modes.reaching_person import outwards, report_of
from modes.speed.simulations import Scene
from occupancy.report import RawMeasurement

Array = NDArray[np.float64]

LATENCY_S = 0.05
"""From a measurement to its arrival."""
_WALK_M_S, _FAR_M = 1.0, 6.0


def hand_at(scene: Scene, t: float) -> Array:
    """Return the hand of a scene (3,) [m] at ``t`` [s] after sample 1.

    Before it comes into the paper's sight, and after it has left it, it is on its way from and to 6 m away:
    the supervisor has to see everybody, and does not forget who goes out of sight.
    """
    at, hands = t / scene.interval_s, scene.hands[:, 0]
    seen = np.flatnonzero(np.isfinite(hands).all(axis=1))
    place = np.array([np.interp(at, seen, hands[seen, axis]) for axis in range(3)])
    beyond = max(float(seen[0]) - at, at - float(seen[-1]), 0.0) * scene.interval_s
    if beyond > 0.0 and len(seen) < len(hands):
        place = place + min(_WALK_M_S * beyond, _FAR_M) * outwards(place)
    return place


def report_at(scene: Scene, t: float, *, people: bool) -> RawMeasurement:
    """Return what arrives at ``t`` [s]: somebody who reaches to where the hand was before the latency.

    ``people``: whether anybody is there.
    """
    stamp = t - LATENCY_S
    return report_of(hand_at(scene, stamp) if people else None, stamp, t)
