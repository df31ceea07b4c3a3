"""Reports of rendered people: what is measured, inferred and missing, where, and what is refused."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.forecasting.camera import LEVEL, Mounting, Tilt, TiltOutcome, tilt_of
from modes.forecasting.detector import Detection, DetectionOutcome
from modes.forecasting.landmarks import INFERRED, LANDMARKS, MEASURED, SKIN, Landmark, PoseSettings, Skin
from modes.forecasting.pose import (
    FrameOutcome,
    PointOutcome,
    report_of_detection,
    report_of_frame,
)
from modes.forecasting.skeleton import JOINTS, Joint
from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.measurement import Gate
from occupancy.report import GateSettings, RefusalReason
from robots.errors import SetupError
from tests.modes.forecasting.rendered_person import BARE, EXACT, USUAL, Scene, frame, measured, render, scene

Array = NDArray[np.float64]


@pytest.fixture
def seen(rng: np.random.Generator) -> tuple[Scene, Array, Array]:
    found = scene(rng)
    return found, found.landmarks(), render(found)


def test_before_a_near_wall_what_may_be_the_wall_is_missing(rng: np.random.Generator) -> None:
    """Within the error of a landmark there is a wrist, or the wall 0.5 m behind it: nobody knows which."""
    found = scene(rng, behind_m=0.5)
    out = frame(found.landmarks(), render(found))
    assert out.points[Point.L_WRIST] is out.points[Point.R_WRIST] is PointOutcome.TOO_UNSURE
    assert Point.L_WRIST not in measured(out)


def test_tilt_and_mounting_place_the_person(seen: tuple[Scene, Array, Array]) -> None:
    """A camera that looks down by 20° from the side: the accelerometer's tilt, then yaw and position."""
    _, landmarks, depth = seen
    up = np.array([0.0, -math.sin(0.35), math.cos(0.35)])
    mounting = Mounting(np.array([1.0, 2.0, 2.5]), math.pi / 2, 0.01, 0.02)
    out = frame(landmarks, depth, replace(BARE, mounting=mounting), tilt_of(9.81 * up))
    level = frame(landmarks, depth, BARE)
    assert out.report is not None and level.report is not None
    ahead = np.array([0.0, math.cos(0.35), math.sin(-0.35)])
    for point in MEASURED:
        x, y, z = level.report.people[0].xyz[point]
        right_up_ahead = (
            np.array([x, 0.0, 0.0]) + y * ahead + z * np.array([0.0, math.sin(0.35), math.cos(0.35)])
        )
        turned = np.array([-right_up_ahead[1], right_up_ahead[0], right_up_ahead[2]]) + mounting.position_m
        assert out.report.people[0].xyz[point] == pytest.approx(turned, abs=1e-9)
        more = out.report.people[0].error_m[point] - level.report.people[0].error_m[point]
        assert more == pytest.approx(0.01 + 2.0 * math.sin(0.01) * math.dist((0, 0, 0), (x, y, z)))


def test_what_lies_between_is_inferred(seen: tuple[Scene, Array, Array]) -> None:
    found, landmarks, depth = seen
    out = frame(landmarks, depth, BARE)
    assert set(MEASURED) | set(INFERRED) == set(Point) and not set(MEASURED) & set(INFERRED)
    assert measured(out) == sorted(MEASURED)
    assert out.report is not None
    (person,) = out.report.people
    assert np.isfinite(person.xyz).all()
    assert {point for point in Point if out.points[point] is PointOutcome.INFERRED} == set(INFERRED)
    assert np.isnan(person.error_m[list(INFERRED)]).all()
    middle = 0.5 * (found.truth(Point.L_SHOULDER) + found.truth(Point.R_SHOULDER))
    assert person.xyz[Point.NECK_BASE] == pytest.approx(middle, abs=0.02)
    hand = found.places[[Landmark.LEFT_WRIST, Landmark.LEFT_INDEX, Landmark.LEFT_PINKY]]
    assert np.linalg.norm(person.xyz[Point.L_HAND] - hand.mean(axis=0)) < 0.05
    tip, knuckle = person.xyz[Point.L_FINGERTIP], hand[1]
    assert np.linalg.norm(tip - hand[0]) > 1.2 * np.linalg.norm(knuckle - hand[0])


def test_a_gate_believes_what_was_measured_alone(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    report = frame(landmarks, depth).report
    assert report is not None
    admitted = Gate(load_profile("iso"), GateSettings(0.0, 0.0, 0.05)).admit(report, 5.2)
    assert not admitted.contradictions
    assert {refused.point for refused in admitted.refusals} == set(INFERRED)
    assert {refused.reason for refused in admitted.refusals} == {RefusalReason.INFERRED}


def test_the_papers_joints(seen: tuple[Scene, Array, Array]) -> None:
    """Heels are those landmarks, CLAV and C7 lie before and behind the neck, L3 above the pelvis."""
    found, landmarks, depth = seen
    joints = frame(landmarks, depth, BARE).joints
    assert joints is not None and joints.shape == (JOINTS, 3) and np.isfinite(joints).all()
    heel = found.places[Landmark.LEFT_HEEL]  # the ankle may be before it
    assert joints[Joint.LHEE][[0, 2]] == pytest.approx(heel[[0, 2]], abs=0.02)
    assert joints[Joint.LHEE][1] == pytest.approx(heel[1], abs=0.06)
    assert joints[Joint.RAEL] == pytest.approx(found.places[Landmark.RIGHT_ELBOW], abs=0.02)
    assert joints[Joint.CLAV][1] < joints[Joint.C7][1], "the person faces the camera"
    hips = 0.5 * (found.places[Landmark.LEFT_HIP] + found.places[Landmark.RIGHT_HIP])
    assert 0.05 < joints[Joint.L3][2] - hips[2] < 0.2
    landmarks[Landmark.LEFT_HEEL, 2] = 0.1
    joints = frame(landmarks, depth, BARE).joints
    assert joints is not None and np.isnan(joints[Joint.LHEE]).all() and np.isfinite(joints[Joint.RHEE]).all()


@pytest.mark.parametrize("visibility", [0.0, 0.69, math.nan, -1.0])
def test_what_is_hardly_visible_is_missing(seen: tuple[Scene, Array, Array], visibility: float) -> None:
    _, landmarks, depth = seen
    landmarks[Landmark.LEFT_SHOULDER, 2] = visibility
    out = frame(landmarks, depth)
    gone = {Point.L_SHOULDER, Point.NECK_BASE, Point.THORAX}
    assert set(measured(out)) == set(MEASURED) - gone
    assert out.report is not None
    (person,) = out.report.people
    assert {point for point in Point if np.isnan(person.xyz[point]).any()} == gone
    assert out.points[Point.L_SHOULDER] is PointOutcome.NOT_VISIBLE
    assert out.points[Point.NECK_BASE] is PointOutcome.MISSING


@pytest.mark.parametrize(("u", "v"), [(math.nan, 5.0), (-5.0, 5.0), (5.0, 1e9), (math.inf, 5.0)])
def test_a_landmark_outside_of_the_image_is_missing(
    seen: tuple[Scene, Array, Array], u: float, v: float
) -> None:
    _, landmarks, depth = seen
    landmarks[Landmark.LEFT_KNEE, :2] = u, v
    out = frame(landmarks, depth)
    assert out.points[Point.L_KNEE] is PointOutcome.NOT_VISIBLE and Point.L_KNEE not in measured(out)


@pytest.mark.parametrize("hole", [0.0, math.nan])
def test_a_point_without_depth_is_missing(seen: tuple[Scene, Array, Array], hole: float) -> None:
    _, landmarks, depth = seen
    u, v = landmarks[Landmark.RIGHT_ELBOW, :2].round().astype(int)
    depth[v - 12 : v + 13, u - 12 : u + 13] = hole
    out = frame(landmarks, depth)
    assert out.outcome is FrameOutcome.MEASURED
    assert out.points[Point.R_ELBOW] is PointOutcome.NO_DEPTH
    assert set(measured(out)) == set(MEASURED) - {Point.R_ELBOW}
    assert out.report is not None and np.isnan(out.report.people[0].xyz[Point.R_ELBOW]).all()
    assert np.isnan(out.report.people[0].error_m[Point.R_ELBOW])


def test_what_stands_before_a_point_is_not_of_the_body(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    u, v = landmarks[Landmark.RIGHT_KNEE, :2].round().astype(int)
    depth[v - 20 : v + 21, u - 20 : u + 21] = 0.6
    out = frame(landmarks, depth)
    assert out.points[Point.R_KNEE] is PointOutcome.NOT_OF_THE_BODY and Point.R_KNEE not in measured(out)


@pytest.mark.parametrize("empty", [0.0, math.nan, math.inf])
def test_an_empty_depth_image_measures_nobody(seen: tuple[Scene, Array, Array], empty: float) -> None:
    """Somebody is in the image: the report says so, without a single point."""
    _, landmarks, depth = seen
    out = frame(landmarks, np.full(depth.shape, empty))
    assert out.outcome is FrameOutcome.NO_DEPTH and "\n" not in out.detail
    assert out.report is not None and len(out.report.people) == 1
    assert not measured(out) and np.isnan(out.report.people[0].xyz).all()


def test_nobody_visible_is_another_outcome_than_nobody(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    hidden = landmarks.copy()
    hidden[:, 2] = 0.0
    out = frame(hidden, depth)
    assert out.outcome is FrameOutcome.NO_POINT and out.report is not None and len(out.report.people) == 1
    nobody = frame(None, depth)
    assert nobody.outcome is FrameOutcome.NO_PERSON and nobody.report is not None
    assert nobody.report.people == () and nobody.report.complete is False and nobody.points == ()


def test_millimetres_are_declared(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    raw = np.round(1000.0 * depth).astype(np.uint16)
    declared = frame(landmarks, raw, replace(USUAL, metres_per_unit=0.001)).report
    in_metres = frame(landmarks, depth).report
    assert declared is not None and in_metres is not None
    assert declared.people[0].measured == in_metres.people[0].measured
    same = np.allclose(declared.people[0].xyz, in_metres.people[0].xyz, atol=1e-3, equal_nan=True)
    assert same
    wrong = frame(landmarks, raw)
    assert wrong.outcome is FrameOutcome.NO_DEPTH and "is metres_per_unit = 1 right?" in wrong.detail


@pytest.mark.parametrize(
    ("change", "outcome", "says"),
    [
        ({"landmarks": np.zeros((17, 3))}, FrameOutcome.WRONG_LANDMARKS, "(17, 3) should be (33, 3)"),
        ({"landmarks": np.zeros((33, 4))}, FrameOutcome.WRONG_LANDMARKS, "(33, 4) should be (33, 3)"),
        ({"landmarks": "somebody"}, FrameOutcome.WRONG_LANDMARKS, "str"),
        ({"landmarks": np.full((33, 3), "x")}, FrameOutcome.WRONG_LANDMARKS, "of numbers"),
        ({"depth": np.zeros((90, 120))}, FrameOutcome.WRONG_DEPTH, "(90, 120) should be (360, 480)"),
        ({"depth": np.zeros((360, 480, 1))}, FrameOutcome.WRONG_DEPTH, "should be (360, 480)"),
        ({"depth": np.zeros((360, 480), dtype=np.uint8)}, FrameOutcome.WRONG_DEPTH, "uint8"),
        ({"depth": np.zeros((360, 480), dtype=np.complex128)}, FrameOutcome.WRONG_DEPTH, "complex128"),
        ({"depth": None}, FrameOutcome.WRONG_DEPTH, "NoneType"),
        ({"tilt": tilt_of((0.0, 0.0, 20.0))}, FrameOutcome.TILT_UNKNOWN, TiltOutcome.MOVING.value),
        ({"stamp": math.nan}, FrameOutcome.WRONG_STAMP, "seen at nan"),
        ({"arrived": "now"}, FrameOutcome.WRONG_STAMP, "arrived at 'now'"),
    ],
)
def test_a_frame_that_cannot_be_used_says_why(
    seen: tuple[Scene, Array, Array], change: dict[str, Any], outcome: FrameOutcome, says: str
) -> None:
    _, landmarks, depth = seen
    usual: dict[str, Any] = {
        "landmarks": landmarks,
        "depth": depth,
        "tilt": LEVEL,
        "stamp": 5.0,
        "arrived": 5.1,
    }
    out = report_of_frame(**(usual | change), camera=USUAL)
    assert out.outcome is outcome and says in out.detail and "\n" not in out.detail
    assert out.report is None


def test_stamps_and_name_are_those_given(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    report = frame(landmarks, depth, replace(USUAL, person="left cell")).report
    assert report is not None
    assert (report.stamp, report.arrived, report.frame, report.complete) == (5.0, 5.1, "world", False)
    assert report.people[0].id == "left cell" and report.people[0].xyz.shape == (MAX_POINTS, 3)


def test_a_detector_without_result_reports_nothing(seen: tuple[Scene, Array, Array]) -> None:
    _, landmarks, depth = seen
    late = Detection(DetectionOutcome.TIMED_OUT, detail="no answer within 0.5 s")
    out = report_of_detection(late, depth, LEVEL, 5.0, 5.1, USUAL)
    assert out.outcome is FrameOutcome.NO_DETECTION and out.report is None and "in time" in out.detail
    good = report_of_detection(Detection(DetectionOutcome.FOUND, landmarks), depth, LEVEL, 5.0, 5.1, USUAL)
    assert good.outcome is FrameOutcome.MEASURED
    nobody = report_of_detection(Detection(DetectionOutcome.NOBODY), depth, LEVEL, 5.0, 5.1, USUAL)
    assert nobody.outcome is FrameOutcome.NO_PERSON


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: replace(USUAL, metres_per_unit=0.0), "camera: metres_per_unit = 0.0"),
        (lambda: replace(USUAL, metres_per_unit=1000.0), "camera: metres_per_unit = 1000.0"),
        (lambda: replace(USUAL, intrinsics={"fx": 1.0}), "camera: intrinsics"),
        (lambda: replace(USUAL, person=3), "camera: person"),
        (lambda: replace(USUAL, depth=EXACT), "window_px = 1 should be at least pose: landmark_error_px = 8"),
        (lambda: PoseSettings(least_visibility=2.0), "pose: least_visibility = 2.0"),
        (lambda: PoseSettings(landmark_error_px=math.nan), "pose: landmark_error_px = nan"),
        (lambda: PoseSettings(skin={"elbow": Skin(0.0, 0.0)}), "pose: skin 'ankle' is missing"),
        (lambda: PoseSettings(skin=dict.fromkeys(SKIN, Skin(-1.0, 0.0))), "behind_m = -1.0"),
        (lambda: replace(PoseSettings(), skin=None), "pose: skin = None"),
    ],
)
def test_wrong_settings_are_refused_by_name(make: Callable[[], object], says: str) -> None:
    with pytest.raises(SetupError) as caught:
        make()
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_whatever_comes_is_measured_or_missing(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Numbers of any kind raise nothing and warn of nothing; what is not measured has no place."""
    odd = np.array([0.0, -1.0, math.nan, math.inf, -math.inf, 1e300, 0.5, 2.0, 5.49, 300.0])
    tilts = (LEVEL, Tilt(TiltOutcome.KNOWN, -0.5, 0.2))
    for _ in range(max(30, count(3000))):
        landmarks = rng.uniform(0.0, 480.0, (LANDMARKS, 3))
        landmarks[:, 2] = rng.uniform(0.6, 1.0, LANDMARKS)
        strange = rng.uniform(size=landmarks.shape) < rng.choice([0.0, 0.05, 0.5])
        landmarks[strange] = rng.choice(odd, strange.sum())
        depth = rng.choice([1.0, 2.0, 2.3], (45, 60)).repeat(8, axis=0).repeat(8, axis=1)
        holes = rng.uniform(size=depth.shape) < rng.choice([0.0, 0.3, 0.9])
        depth[holes] = rng.choice(odd, holes.sum())
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            out = frame(landmarks, depth, USUAL, tilts[int(rng.integers(2))])
        assert out.report is not None
        (person,) = out.report.people
        for point in Point:
            known = out.points[point] in {PointOutcome.MEASURED, PointOutcome.INFERRED}
            assert np.isfinite(person.xyz[point]).all() == known == (not np.isnan(person.xyz[point]).any())
            is_measured = out.points[point] is PointOutcome.MEASURED
            assert bool(person.measured >> point & 1) == is_measured == np.isfinite(person.error_m[point])
            assert not is_measured or 0.0 < person.error_m[point] <= USUAL.pose.largest_error_m


def test_landmarks_are_numbered_as_published() -> None:
    """By ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker: the nose is 0, the body 11 to 32."""
    body = (
        "SHOULDER",
        "ELBOW",
        "WRIST",
        "PINKY",
        "INDEX",
        "THUMB",
        "HIP",
        "KNEE",
        "ANKLE",
        "HEEL",
        "FOOT_INDEX",
    )
    assert Landmark.NOSE == 0 and Landmark.LEFT_EAR == 7 and Landmark.RIGHT_EAR == 8 and LANDMARKS == 33
    for place, name in enumerate(body):
        assert Landmark[f"LEFT_{name}"] == 11 + 2 * place
        assert Landmark[f"RIGHT_{name}"] == 12 + 2 * place
