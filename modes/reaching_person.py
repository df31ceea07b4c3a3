"""Somebody who reaches out with the right hand, as reports of a camera would have it; for scenarios."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson

Array = NDArray[np.float64]

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
"""How far beyond the hand, seen from the robot; to the side; above it [m]."""


def outwards(hand: Array) -> Array:
    """Return the level direction (3,) from the robot's base to a hand."""
    return np.array([hand[0], hand[1], 0.0]) / math.hypot(hand[0], hand[1])


def report_of(hand: Array | None, stamp: float, arrival: float) -> RawMeasurement:
    """Return a report of somebody whose right hand is at ``hand`` (3,) [m], facing the robot's base.

    ``None``: nobody is there.
    """
    if hand is None:
        return RawMeasurement(stamp, arrival, "world", True, ())
    away = outwards(hand)
    aside = np.array([-away[1], away[0], 0.0])
    points = np.full((MAX_POINTS, 3), np.nan)
    for point, (beyond, side, above) in _ARM.items():
        points[point] = hand + beyond * away + side * aside + np.array([0.0, 0.0, above])
    measured = sum(1 << point for point in _ARM)
    who = RawPerson("p1", points, np.full(MAX_POINTS, 0.01), measured)
    return RawMeasurement(stamp, arrival, "world", True, (who,))
