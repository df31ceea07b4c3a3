"""Reports of people from landmarks and depth: what is not seen is missing, what lies between is inferred."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.camera import Intrinsics, Mounting, Tilt, TiltOutcome
from modes.forecasting.depth import DepthImage, DepthOutcome, DepthSettings, sample
from modes.forecasting.detector import Detection, DetectionOutcome
from modes.forecasting.landmarks import (
    INFERRED,
    MEASURED,
    ONLY_PLACES,
    Place,
    PoseSettings,
    infer,
    pixel_of,
    wrong_landmarks,
)
from modes.forecasting.skeleton import Joint, joints_of_points
from modes.settings import require_kind, require_number
from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson
from robots.errors import SetupError

Array = NDArray[np.float64]
_DEPTH_TYPES = ("uint16", "float32", "float64")


@dataclass(frozen=True)
class Camera:
    """A camera with aligned depth.

    Attributes
    ----------
    intrinsics:
        Of the image to which the depth is aligned.
    mounting:
        Where it is.
    metres_per_unit:
        Of the depth image: 0.001 for millimetres, 1 for metres. Has no default, for it cannot be guessed.
    depth, pose:
        How depth is read, and what is believed of landmarks.
    person:
        What reports call the one person that is found.
    """

    intrinsics: Intrinsics
    mounting: Mounting
    metres_per_unit: float
    depth: DepthSettings = field(default_factory=DepthSettings)
    pose: PoseSettings = field(default_factory=PoseSettings)
    person: str = "p1"

    def __post_init__(self) -> None:
        for name, kind in (
            ("intrinsics", Intrinsics),
            ("mounting", Mounting),
            ("depth", DepthSettings),
            ("pose", PoseSettings),
            ("person", str),
        ):
            require_kind(f"camera: {name}", getattr(self, name), kind, written=f"a {kind.__name__}")
        require_number("camera: metres_per_unit", self.metres_per_unit, 0.0, 1.0, above=True)
        if self.depth.window_px < self.pose.landmark_error_px:
            raise SetupError(
                f"depth: window_px = {self.depth.window_px} should be at least pose: landmark_error_px = "
                f"{self.pose.landmark_error_px:g}, for the joint's surface may be anywhere in it"
            )


class FrameOutcome(StrEnum):
    """What came of a frame."""

    MEASURED = "somebody was measured"
    NO_PERSON = "the detector found nobody"
    NO_DEPTH = "somebody is in the image, and no pixel of the depth image has a depth within range"
    NO_POINT = "somebody is in the image, and no point could be measured"
    NO_DETECTION = "the detector gave no result"
    WRONG_LANDMARKS = "landmarks of another number or kind"
    WRONG_DEPTH = "a depth image of another size or kind"
    TILT_UNKNOWN = "the tilt of the camera is not known"
    WRONG_STAMP = "the instants of seeing and arrival are not two finite numbers"


class PointOutcome(StrEnum):
    """What came of a point."""

    MEASURED = "measured"
    INFERRED = "put between others"
    NOT_VISIBLE = "hardly visible, or outside of the image"
    NO_DEPTH = "no depth there"
    NOT_OF_THE_BODY = "far in front of the body, or behind it"
    TOO_UNSURE = "error larger than what is wanted"
    MISSING = "not between others, because one of these is missing"


class Frame(NamedTuple):
    """What came of a frame.

    Attributes
    ----------
    outcome, detail:
        What came of it; in one line what is wrong with it, empty where nothing is.
    report:
        For a gate; ``None``: there is nothing to report. It is never complete: one camera does not see
        everybody, and one person at most is found.
    points:
        (20,) outcome of each :class:`~occupancy.body.Point`; empty without a person.
    joints:
        (15, 3) [m, world] the paper's joints; NaN: not known. CLAV, C7 and L3 are interpolated.
    """

    outcome: FrameOutcome
    detail: str = ""
    report: RawMeasurement | None = None
    points: tuple[PointOutcome, ...] = ()
    joints: Array | None = None


class _Look(NamedTuple):
    """A place in the camera's frame (3,) [m], depth of the skin [m], error [m]."""

    outcome: PointOutcome
    xyz: Array
    skin_m: float
    error_m: float


def report_of_frame(
    landmarks: object, depth: DepthImage, tilt: Tilt, stamp: float, arrived: float, camera: Camera
) -> Frame:
    """Return the report of one image and its depth, in the world; raises nothing.

    Parameters
    ----------
    landmarks:
        (33, 3): u, v [px] and visibility of each :class:`~modes.forecasting.landmarks.Landmark`; ``None``:
        nobody was found.
    depth:
        (height, width) of uint16, float32 or float64, aligned to the image; 0 and NaN are holes.
    tilt:
        Of the camera, from :func:`~modes.forecasting.camera.tilt_of`.
    stamp, arrived:
        When it was exposed, and when this report can be used [s, cell's clock].
    camera:
        Camera and settings.
    """
    flaw = _flaw(landmarks, depth, tilt, (stamp, arrived), camera)
    if flaw is not None:
        return flaw
    if landmarks is None:
        nobody = RawMeasurement(float(stamp), float(arrived), "world", False, ())
        return Frame(FrameOutcome.NO_PERSON, report=nobody)
    found = np.asarray(landmarks, dtype=np.float64)
    looks = {point: _look(place, found, depth, camera) for point, place in MEASURED.items()}
    others = {name: _look(place, found, depth, camera) for name, place in ONLY_PLACES.items()}
    middle = _middle_depth(looks)
    looks = {point: _judged(look, middle, camera) for point, look in looks.items()}
    others = {name: _judged(look, middle, camera) for name, look in others.items()}
    return _assembled(looks, others, depth, tilt, (float(stamp), float(arrived)), camera)


def report_of_detection(
    detection: Detection, depth: DepthImage, tilt: Tilt, stamp: float, arrived: float, camera: Camera
) -> Frame:
    """Return the report of what a detector found (:func:`report_of_frame`); none without a result."""
    if detection.outcome in {DetectionOutcome.FOUND, DetectionOutcome.NOBODY}:
        return report_of_frame(detection.landmarks, depth, tilt, stamp, arrived, camera)
    return Frame(FrameOutcome.NO_DETECTION, f"{detection.outcome.value}: {detection.detail}")


def _flaw(
    landmarks: object, depth: object, tilt: Tilt, stamps: tuple[object, object], camera: Camera
) -> Frame | None:
    """Why a frame cannot be used at all."""
    if not all(isinstance(each, Real) and np.isfinite(float(each)) for each in stamps):
        return Frame(FrameOutcome.WRONG_STAMP, f"seen at {stamps[0]!r}, arrived at {stamps[1]!r}")
    if tilt.outcome is not TiltOutcome.KNOWN:
        return Frame(FrameOutcome.TILT_UNKNOWN, tilt.outcome.value)
    size = (camera.intrinsics.height, camera.intrinsics.width)
    if not isinstance(depth, np.ndarray) or depth.dtype.name not in _DEPTH_TYPES:
        kind = depth.dtype.name if isinstance(depth, np.ndarray) else type(depth).__name__
        return Frame(
            FrameOutcome.WRONG_DEPTH, f"depth of {kind} should be an array of {', '.join(_DEPTH_TYPES)}"
        )
    if depth.shape != size:
        return Frame(
            FrameOutcome.WRONG_DEPTH, f"depth of shape {depth.shape} should be {size}, as the image is"
        )
    wrong = None if landmarks is None else wrong_landmarks(landmarks)
    return None if wrong is None else Frame(FrameOutcome.WRONG_LANDMARKS, wrong)


def _look(place: Place, landmarks: Array, depth: DepthImage, camera: Camera) -> _Look:
    """Look at a place: its skin, the joint behind it, the error of both."""
    nowhere = np.full(3, np.nan)
    uv = pixel_of(place, landmarks, camera.pose.least_visibility)
    if uv is None:
        return _Look(PointOutcome.NOT_VISIBLE, nowhere, np.nan, np.nan)
    read = sample(depth, camera.metres_per_unit, float(uv[0]), float(uv[1]), camera.depth)
    if read.outcome is not DepthOutcome.READ:
        outside = read.outcome is DepthOutcome.OUTSIDE
        why = PointOutcome.NOT_VISIBLE if outside else PointOutcome.NO_DEPTH
        return _Look(why, nowhere, np.nan, np.nan)
    skin = camera.pose.skin[place.skin]
    ray = camera.intrinsics.rays(uv)
    slant = float(np.linalg.norm(ray))
    xyz = ray * (read.depth_m + skin.behind_m / slant)
    aside = camera.pose.landmark_error_px / min(camera.intrinsics.fx, camera.intrinsics.fy) * float(xyz[1])
    along = slant * (float(camera.depth.error_m(read.depth_m)) + read.spread_m) + skin.error_m
    error = along + aside + float(camera.mounting.error_m(xyz))
    return _Look(PointOutcome.MEASURED, xyz, read.depth_m, error)


def _middle_depth(looks: dict[Point, _Look]) -> float:
    """Return the median depth of the skin of all points that have one [m]; NaN: none has."""
    depths = [look.skin_m for look in looks.values() if look.outcome is PointOutcome.MEASURED]
    return float(np.median(depths)) if depths else np.nan


def _judged(look: _Look, middle_m: float, camera: Camera) -> _Look:
    """Leave a place out that is not of the body, or too unsure."""
    if look.outcome is not PointOutcome.MEASURED:
        return look
    if not abs(look.skin_m - middle_m) <= camera.depth.body_depth_m:
        return _Look(PointOutcome.NOT_OF_THE_BODY, np.full(3, np.nan), np.nan, np.nan)
    if not look.error_m <= camera.pose.largest_error_m:
        return _Look(PointOutcome.TOO_UNSURE, np.full(3, np.nan), np.nan, np.nan)
    return look


def _assembled(
    looks: dict[Point, _Look],
    others: dict[str, _Look],
    depth: DepthImage,
    tilt: Tilt,
    stamps: tuple[float, float],
    camera: Camera,
) -> Frame:
    """Put the points of one person together."""
    points, error, measured = np.full((MAX_POINTS, 3), np.nan), np.full(MAX_POINTS, np.nan), 0
    outcomes = [PointOutcome.MISSING] * MAX_POINTS
    for point, look in looks.items():
        points[point], error[point], outcomes[point] = look.xyz, look.error_m, look.outcome
        if look.outcome is PointOutcome.MEASURED:
            measured |= 1 << point
    infer(points, {name: look.xyz for name, look in others.items()})
    for point in INFERRED:
        if np.isfinite(points[point]).all():
            outcomes[point] = PointOutcome.INFERRED
    world = camera.mounting.to_world(points, tilt)
    joints = joints_of_points(world)
    for joint, name in ((Joint.LHEE, "l_heel"), (Joint.RHEE, "r_heel")):
        joints[joint] = camera.mounting.to_world(others[name].xyz, tilt)
    person = RawPerson(camera.person, world, error, measured)
    report = RawMeasurement(*stamps, "world", False, (person,))
    outcome, detail = FrameOutcome.MEASURED, ""
    if not measured:
        outcome, detail = _nothing_measured(depth, camera)
    return Frame(outcome, detail, report, tuple(outcomes), joints)


def _nothing_measured(depth: DepthImage, camera: Camera) -> tuple[FrameOutcome, str]:
    """Tell an image without depth from one where nothing of the body has any."""
    z = depth.astype(np.float64) * camera.metres_per_unit
    least, most = camera.depth.nearest_m, camera.depth.farthest_m
    if ((z >= least) & (z <= most)).any():
        return FrameOutcome.NO_POINT, ""
    known = z[np.isfinite(z) & (z > 0.0)]
    if not len(known):
        return FrameOutcome.NO_DEPTH, "every pixel is 0 or not finite"
    return FrameOutcome.NO_DEPTH, (
        f"half of the depths are above {np.median(known):.4g} m, none from {least:g} to {most:g} m; "
        f"is metres_per_unit = {camera.metres_per_unit:g} right?"
    )
