"""The person of a scene: the paper has a hand alone; here somebody reaches out with it, comes and goes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from modes.speed.simulations import Scene
from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson

Array = NDArray[np.float64]

LATENCY_S = 0.05
"""From a measurement to its arrival."""
_WALK_M_S, _FAR_M = 1.0, 6.0
_ARM: dict[Point, tuple[float, float, float]] = {
    Point.R_FINGERTIP: (-0.07, 0.0, 0.0), Point.R_HAND: (0.0, 0.0, 0.0), Point.R_WRIST: (0.08, 0.0, 0.0),
    Point.R_ELBOW: (0.32, 0.0, -0.06), Point.R_SHOULDER: (0.5, 0.02, 0.16),
    Point.NECK_BASE: (0.56, 0.2, 0.22), Point.HEAD: (0.56, 0.2, 0.42), Point.THORAX: (0.58, 0.2, 0.0),
    Point.PELVIS: (0.6, 0.2, -0.3), Point.L_SHOULDER: (0.6, 0.38, 0.16), Point.L_ELBOW: (0.62, 0.42, -0.12),
    Point.L_WRIST: (0.6, 0.42, -0.36), Point.L_HAND: (0.6, 0.42, -0.44),
    Point.L_FINGERTIP: (0.6, 0.42, -0.52),
    Point.R_HIP: (0.6, 0.1, -0.34), Point.R_KNEE: (0.6, 0.1, -0.76), Point.R_ANKLE: (0.6, 0.1, -1.16),
    Point.L_HIP: (0.6, 0.3, -0.34), Point.L_KNEE: (0.6, 0.3, -0.76), Point.L_ANKLE: (0.6, 0.3, -1.16),
}  # fmt: skip
"""Somebody who reaches: how far beyond the hand, seen from the robot; to the side; above it [m]."""


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
        outwards = np.array([place[0], place[1], 0.0]) / math.hypot(place[0], place[1])
        place = place + min(_WALK_M_S * beyond, _FAR_M) * outwards
    return place


def report_at(scene: Scene, t: float, *, people: bool) -> RawMeasurement:
    """Return what arrives at ``t`` [s]: somebody who reaches to where the hand was before the latency.

    ``people``: whether anybody is there.
    """
    stamp = t - LATENCY_S
    hand = hand_at(scene, stamp)
    if not people:
        return RawMeasurement(stamp, t, "world", True, ())
    outwards = np.array([hand[0], hand[1], 0.0]) / math.hypot(hand[0], hand[1])
    points = np.full((MAX_POINTS, 3), np.nan)
    aside = np.array([-outwards[1], outwards[0], 0.0])
    for point, (beyond, side, above) in _ARM.items():
        points[point] = hand + beyond * outwards + side * aside + np.array([0.0, 0.0, above])
    measured = sum(1 << point for point in _ARM)
    who = RawPerson("p1", points, np.full(MAX_POINTS, 0.01), measured)
    return RawMeasurement(stamp, t, "world", True, (who,))
