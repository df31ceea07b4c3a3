"""MediaPipe Pose's 33 landmarks, and which of our points and of the paper's joints they are.

Names and indices are those that MediaPipe publishes. Landmarks are places in an image; which of the body's
points they show, and how far these are behind the skin that a depth camera sees, is said here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_kind, require_number
from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]


class Landmark(IntEnum):
    """Landmarks; the value is the row. Left and right are the person's own, unless the image is mirrored."""

    NOSE = 0
    LEFT_EYE_INNER = 1
    LEFT_EYE = 2
    LEFT_EYE_OUTER = 3
    RIGHT_EYE_INNER = 4
    RIGHT_EYE = 5
    RIGHT_EYE_OUTER = 6
    LEFT_EAR = 7
    RIGHT_EAR = 8
    MOUTH_LEFT = 9
    MOUTH_RIGHT = 10
    LEFT_SHOULDER = 11
    RIGHT_SHOULDER = 12
    LEFT_ELBOW = 13
    RIGHT_ELBOW = 14
    LEFT_WRIST = 15
    RIGHT_WRIST = 16
    LEFT_PINKY = 17
    RIGHT_PINKY = 18
    LEFT_INDEX = 19
    RIGHT_INDEX = 20
    LEFT_THUMB = 21
    RIGHT_THUMB = 22
    LEFT_HIP = 23
    RIGHT_HIP = 24
    LEFT_KNEE = 25
    RIGHT_KNEE = 26
    LEFT_ANKLE = 27
    RIGHT_ANKLE = 28
    LEFT_HEEL = 29
    RIGHT_HEEL = 30
    LEFT_FOOT_INDEX = 31
    RIGHT_FOOT_INDEX = 32


LANDMARKS = len(Landmark)


class Skin(NamedTuple):
    """How far a joint is behind the skin, along the ray of its pixel, and the greatest error of that [m]."""

    behind_m: float
    error_m: float


SKIN: Mapping[str, Skin] = MappingProxyType(
    {
        "head": Skin(0.09, 0.05), "shoulder": Skin(0.06, 0.05), "elbow": Skin(0.045, 0.03),
        "wrist": Skin(0.03, 0.02), "hip": Skin(0.10, 0.06), "knee": Skin(0.06, 0.03),
        "ankle": Skin(0.045, 0.03), "heel": Skin(0.03, 0.03), "knuckle": Skin(0.015, 0.015),
    }
)  # fmt: skip
"""Made up, about half the thickness of people at these places; not verified, and without clothes."""


class Place(NamedTuple):
    """A place of the body that is looked at: the mean pixel of its landmarks, and the skin before it."""

    landmarks: tuple[Landmark, ...]
    skin: str


MEASURED: Mapping[Point, Place] = MappingProxyType(
    {
        Point.HEAD: Place((Landmark.LEFT_EAR, Landmark.RIGHT_EAR), "head"),
        Point.L_SHOULDER: Place((Landmark.LEFT_SHOULDER,), "shoulder"),
        Point.R_SHOULDER: Place((Landmark.RIGHT_SHOULDER,), "shoulder"),
        Point.L_ELBOW: Place((Landmark.LEFT_ELBOW,), "elbow"),
        Point.R_ELBOW: Place((Landmark.RIGHT_ELBOW,), "elbow"),
        Point.L_WRIST: Place((Landmark.LEFT_WRIST,), "wrist"),
        Point.R_WRIST: Place((Landmark.RIGHT_WRIST,), "wrist"),
        Point.L_HIP: Place((Landmark.LEFT_HIP,), "hip"),
        Point.R_HIP: Place((Landmark.RIGHT_HIP,), "hip"),
        Point.L_KNEE: Place((Landmark.LEFT_KNEE,), "knee"),
        Point.R_KNEE: Place((Landmark.RIGHT_KNEE,), "knee"),
        Point.L_ANKLE: Place((Landmark.LEFT_ANKLE,), "ankle"),
        Point.R_ANKLE: Place((Landmark.RIGHT_ANKLE,), "ankle"),
    }
)
"""Points whose place is seen itself. The head is between the ears: depth is read where it is, too."""

ONLY_PLACES: Mapping[str, Place] = MappingProxyType(
    {
        "l_index": Place((Landmark.LEFT_INDEX,), "knuckle"),
        "r_index": Place((Landmark.RIGHT_INDEX,), "knuckle"),
        "l_pinky": Place((Landmark.LEFT_PINKY,), "knuckle"),
        "r_pinky": Place((Landmark.RIGHT_PINKY,), "knuckle"),
        "l_heel": Place((Landmark.LEFT_HEEL,), "heel"),
        "r_heel": Place((Landmark.RIGHT_HEEL,), "heel"),
    }
)
"""Places that are none of the points: knuckles say where a hand is, heels are the paper's LHEE and RHEE."""

INFERRED: tuple[Point, ...] = (
    Point.NECK_BASE, Point.THORAX, Point.PELVIS, Point.L_HAND, Point.R_HAND, Point.L_FINGERTIP,
    Point.R_FINGERTIP,
)  # fmt: skip
"""Points that :func:`infer` puts between others: never in the mask of what was measured."""

_FINGERS = 1.8
"""Fingertip over index knuckle, seen from the wrist; made up."""


@dataclass(frozen=True)
class PoseSettings:
    """What is believed of landmarks; every default is made up.

    Attributes
    ----------
    least_visibility:
        Landmarks whose visibility is below are missing. 0.5 is usual; MediaPipe gives about 0.6 to hips that
        it places at the lower rim of an image which ends above them, hence the default.
    landmark_error_px:
        How far a landmark may be from where the joint is in the image [px].
    largest_error_m:
        A point whose error is larger is missing [m].
    skin:
        How far joints are behind the skin: one :class:`Skin` for each key of :data:`SKIN`.
    """

    least_visibility: float = 0.7
    landmark_error_px: float = 8.0
    largest_error_m: float = 0.35
    skin: Mapping[str, Skin] = field(default_factory=lambda: SKIN)

    def __post_init__(self) -> None:
        require_number("pose: least_visibility", self.least_visibility, 0.0, 1.0)
        require_number("pose: landmark_error_px", self.landmark_error_px, 0.0, 1e3)
        require_number("pose: largest_error_m", self.largest_error_m, 0.0, 10.0, above=True)
        require_kind(
            "pose: skin", self.skin, Mapping, written="a mapping of names to Skin(behind_m, error_m)"
        )
        wrong = sorted(set(self.skin) ^ set(SKIN))
        if wrong:
            raise SetupError(f"pose: skin {wrong[0]!r} is missing or not known; there are {', '.join(SKIN)}")
        for name, skin in self.skin.items():
            require_kind(f"pose: skin {name}", skin, Skin, written="Skin(behind_m, error_m)")
            require_number(f"pose: skin {name}: behind_m", skin.behind_m, 0.0, 1.0)
            require_number(f"pose: skin {name}: error_m", skin.error_m, 0.0, 1.0)


def wrong_landmarks(landmarks: object) -> str | None:
    """Return in one line why these are not 33 landmarks of u, v [px] and visibility; ``None``: they are."""
    if not isinstance(landmarks, np.ndarray) or landmarks.dtype.kind not in "fiu":
        return f"landmarks are {type(landmarks).__name__}, should be an array (33, 3) of numbers"
    if landmarks.shape != (LANDMARKS, 3):
        return f"landmarks of shape {landmarks.shape} should be (33, 3): u, v [px] and visibility of each"
    return None


def pixel_of(place: Place, landmarks: Array, least_visibility: float) -> Array | None:
    """Return the pixel (2,) of a place; ``None``: one of its landmarks is hardly visible, or has no place."""
    rows = landmarks[list(place.landmarks)]
    if not ((rows[:, 2] >= least_visibility).all() and np.isfinite(rows).all()):
        return None
    return np.asarray(rows[:, :2].mean(axis=0))


def infer(points: Array, places: Mapping[str, Array]) -> None:
    """Put points between those that were measured, ``points`` (20, 3) [m]; NaN where one of these is missing.

    The base of the neck is midway between the shoulders, the pelvis between the hips, the thorax between
    the two. The palm is midway between the wrist and the knuckles, fingertips lie beyond the index's knuckle.

    Parameters
    ----------
    points:
        Written into: the rows of :data:`INFERRED`.
    places:
        (3,) [m] of each of :data:`ONLY_PLACES`; NaN: missing.

    Raises
    ------
    SetupError
        The shape is another one.
    """
    if points.shape != (MAX_POINTS, 3):
        raise SetupError(f"points of shape {points.shape} should be (20, 3)")
    points[Point.NECK_BASE] = 0.5 * (points[Point.L_SHOULDER] + points[Point.R_SHOULDER])
    points[Point.PELVIS] = 0.5 * (points[Point.L_HIP] + points[Point.R_HIP])
    points[Point.THORAX] = 0.5 * (points[Point.NECK_BASE] + points[Point.PELVIS])
    for wrist, hand, tip, side in (
        (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP, "l"),
        (Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP, "r"),
    ):
        index, pinky = places[f"{side}_index"], places[f"{side}_pinky"]
        points[hand] = 0.5 * points[wrist] + 0.25 * (index + pinky)
        points[tip] = points[wrist] + _FINGERS * (index - points[wrist])
