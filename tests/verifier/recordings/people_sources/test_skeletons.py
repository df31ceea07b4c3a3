"""Skeletons by index in JSON: every set, visibility, MediaPipe's own landmarks, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.verifier.recordings.people_sources.bodies import (
    BENT,
    ORDER,
    STANDING,
    expected,
    in_a_camera,
    joints,
    person,
)
from tests.verifier.recordings.people_sources.ros import OneByOne, as_written
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_sources import SourceOptions
from verifier.recordings.people_sources.skeletons import JsonSkeletons

ARRIVED = 12_500_000_000


def message(joint_set: str, people: list[Any], **other: Any) -> Decoded:
    value = {"stamp": 12.25, "frame": "camera", "joint_set": joint_set, "people": people} | other
    return Decoded("/skeletons", "stopproof.Skeletons", ARRIVED, json.loads(json.dumps(value)))


def body(xyz: np.ndarray, visible: float | None = 0.9, name: str = "p1", **other: Any) -> dict[str, Any]:
    seen = {} if visible is None else {"visibility": [visible] * len(xyz)}
    return {"id": name, "xyz_m": xyz.tolist(), **seen} | other


def read(sent: Decoded):
    return OneByOne(JsonSkeletons(SourceOptions())).read(sent)


@pytest.mark.parametrize("posture", [STANDING, BENT], ids=["standing", "bent"])
@pytest.mark.parametrize("name", sorted(ORDER))
def test_every_set_comes_out_at_the_right_points(name: str, posture) -> None:
    at = {
        joint: in_a_camera(place, np.random.default_rng(2)) for joint, place in person(1.85, posture).items()
    }
    reader = OneByOne(JsonSkeletons(SourceOptions()))
    report = as_written(reader.read(message(name, [body(joints(name, at))])))
    assert (report.stamp_ns, report.arrived_ns, report.frame) == (12_250_000_000, ARRIVED, "camera")
    for point, place in expected(name, at).items():
        np.testing.assert_allclose(report.people[0].xyz[COLUMN[point]], place, atol=1e-12)
        assert report.people[0].measured >> COLUMN[point] & 1
    reader.finish()


XYZ = joints("mediapipe_33", person())


def test_what_mediapipe_does_not_see_is_inferred() -> None:
    seen = [0.9] * 33
    seen[15] = seen[8] = 0.4  # left wrist; right ear, with which the head is inferred
    reader = OneByOne(JsonSkeletons(SourceOptions()))
    report = as_written(reader.read(message("mediapipe_33", [body(XYZ, visibility=seen)])))
    (found,) = report.people
    for name in ("l_wrist", "head"):
        assert np.isfinite(found.xyz[COLUMN[name]]).all() and not found.measured >> COLUMN[name] & 1
    assert found.measured >> COLUMN["r_wrist"] & 1
    shown = {each.name: each for each in reader.assumptions}
    assert shown["recording.visibility"].value == 0.5
    assert shown["recording.joint_set"].certainty == "unverified"
    unreadable = [None] * 33
    assert not read(message("mediapipe_33", [body(XYZ, visibility=unreadable)])).people[0].measured


def test_missing_entries_are_missing_points() -> None:
    entries: list[Any] = XYZ.tolist()
    entries[15], entries[16], entries[13], entries[14] = None, [0, 0, 0], [None, 1, 2], ["1", 2, 3]
    (found,) = read(message("mediapipe_33", [body(XYZ, xyz_m=entries)])).people
    for name in ("l_wrist", "r_wrist", "l_elbow", "r_elbow"):
        assert np.isnan(found.xyz[COLUMN[name]]).all() and not found.measured >> COLUMN[name] & 1
    assert found.measured >> COLUMN["l_shoulder"] & 1


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"xyz_m": XYZ.tolist()[:32]}, "must have 33 entries"),
        ({"xyz_m": None}, "must have 33 entries"),
        ({"xyz_m": [[1.0, 2.0]] * 33}, "entry 0"),
        ({"visibility": [0.9] * 32}, "must have 33 numbers"),
    ],
)
def test_somebody_whose_points_cannot_be_read_stays(wrong: dict[str, Any], says: str) -> None:
    report = as_written(read(message("mediapipe_33", [body(XYZ, **wrong), body(XYZ, name="p2")])))
    assert [bool(each.measured) for each in report.people] == [False, True]
    flaw = read(message("mediapipe_33", [body(XYZ, **wrong)])).flaws[0]
    assert flaw.person == "p1" and says in flaw.reason


@pytest.mark.parametrize(
    ("sent", "says"),
    [
        (message("mediapipe_33", [{"id": "p1", "pose_world_landmarks": []}]), "centred at the hips"),
        (message("mediapipe_33", [], world_landmarks=[]), "centred at the hips"),
        (message("mediapipe_33", [{"id": "p1", "pose_landmarks": []}]), "in an image, 2-D"),
        (message("mediapipe_33", [body(XYZ, None)]), '"visibility" is missing'),
        (message("mediapipe", []), "joint set 'mediapipe' is not known"),
        (message("ros4hri", []), "has names, no indices"),
        (message("mediapipe_33", {}), '"people" must be a list'),
        (message("mediapipe_33", [3]), "must be an object"),
        (message("mediapipe_33", [body(XYZ, name="")]), '"id" must be a text'),
        (message("mediapipe_33", [], stamp="now"), '"stamp" must be a number'),
        (message("mediapipe_33", [], stamp=None), '"stamp" must be a number'),
        (message("mediapipe_33", [], stamp=1.7e18), '"stamp" must be a number'),
        (message("mediapipe_33", [], frame=None), '"frame" must be a text'),
        (Decoded("/x", "stopproof.Skeletons", 0, []), "no JSON object"),
    ],
)
def test_what_is_not_said_is_refused(sent: Decoded, says: str) -> None:
    with pytest.raises(SourceError, match=says):
        read(sent)


def test_hip_centred_skeletons_are_known_by_their_hips_too() -> None:
    reader = OneByOne(JsonSkeletons(SourceOptions()))
    for posture in (STANDING, BENT):
        xyz = joints("mediapipe_33", person(1.7, posture))
        reader.read(message("mediapipe_33", [body(xyz - 0.5 * (xyz[23] + xyz[24]))]))
    with pytest.raises(SourceError, match="centred at the hips and do not say where the person is"):
        reader.finish()


def test_one_stream_has_one_set() -> None:
    reader = OneByOne(JsonSkeletons(SourceOptions()))
    reader.read(message("mediapipe_33", [body(XYZ)]))
    with pytest.raises(SourceError, match="one stream has one set"):
        reader.read(message("coco_17", []))


def test_random_json_is_read_or_refused(rng, count) -> None:
    """No other exception, whatever stands where."""
    odd = [
        None,
        True,
        -1,
        1e308,
        10**400,
        "x",
        [],
        {},
        [[]],
        [None] * 33,
        [[1, 2, 3]] * 33,
        [[1e308] * 3] * 33,
        XYZ.tolist(),
    ]
    keys = ["stamp", "frame", "joint_set", "people", "id", "xyz_m", "visibility"]
    for _ in range(count(20000)):
        person_ = body(XYZ) | {keys[rng.integers(4, 7)]: odd[rng.integers(len(odd))]}
        value = {"stamp": 1.0, "frame": "c", "joint_set": "mediapipe_33", "people": [person_]}
        if rng.random() < 0.5:
            value[keys[rng.integers(0, 4)]] = odd[rng.integers(len(odd))]
        reader = OneByOne(JsonSkeletons(SourceOptions()))
        try:
            as_written(reader.read(Decoded("/x", "stopproof.Skeletons", ARRIVED, value)))
            reader.finish()
        except SourceError as error:
            assert "\n" not in str(error)
