"""The human body as this software sees it: measured points, canonical parts."""

from __future__ import annotations

from enum import IntEnum

MAX_POINTS = 20
MAX_PARTS = 16


class Point(IntEnum):
    """Body points that a measurement may report; the value is the column in the people block."""

    HEAD = 0
    NECK_BASE = 1
    THORAX = 2
    PELVIS = 3
    L_SHOULDER = 4
    L_ELBOW = 5
    L_WRIST = 6
    L_HAND = 7
    L_FINGERTIP = 8
    R_SHOULDER = 9
    R_ELBOW = 10
    R_WRIST = 11
    R_HAND = 12
    R_FINGERTIP = 13
    L_HIP = 14
    L_KNEE = 15
    L_ANKLE = 16
    R_HIP = 17
    R_KNEE = 18
    R_ANKLE = 19


class Part(IntEnum):
    """Canonical body parts; the value is the bit in a part mask."""

    HEAD = 0
    NECK = 1
    TORSO = 2
    PELVIS = 3
    L_UPPER_ARM = 4
    L_FOREARM = 5
    L_HAND = 6
    R_UPPER_ARM = 7
    R_FOREARM = 8
    R_HAND = 9
    L_THIGH = 10
    L_SHANK = 11
    L_FOOT = 12
    R_THIGH = 13
    R_SHANK = 14
    R_FOOT = 15


POINT_NAMES: tuple[str, ...] = tuple(point.name.lower() for point in Point)
PART_NAMES: tuple[str, ...] = tuple(part.name.lower() for part in Part)
ALL_PARTS: int = (1 << len(Part)) - 1
