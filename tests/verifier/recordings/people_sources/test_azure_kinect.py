"""Azure Kinect ``MarkerArray``, by rosbags: ids, actions, joints there twice, old SDKs, other markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.verifier.recordings.people_sources.bodies import BENT, STANDING, expected, joints, person
from tests.verifier.recordings.people_sources.ros import OneByOne, as_written, decoded, header, make, pose
from verifier.recordings.decoded import SourceError
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_sources import SourceOptions, speaks_of_people
from verifier.recordings.people_sources.azure_kinect import AzureKinectMarkers

SCHEMA = "visualization_msgs/msg/MarkerArray"
NOW = 1_700_000_000_123_456_789
DELETE, DELETEALL, SPHERE = 2, 3, 2


def marker(number: int, place: Any = (0.0, 0.0, 0.0), stamp: int = NOW, **fields: Any) -> Any:
    given = {"header": header(stamp, "depth_camera_link"), "type": SPHERE, "pose": pose(place)} | fields
    return make("visualization_msgs/msg/Marker", id=number, **given)


def body(number: int, xyz: np.ndarray, **fields: Any) -> list[Any]:
    return [marker(100 * number + joint, place, **fields) for joint, place in enumerate(xyz)]


def message(markers: list[Any]):
    return decoded(SCHEMA, make(SCHEMA, markers=markers), NOW + 50_000_000)


def read(markers: list[Any]):
    return OneByOne(AzureKinectMarkers(SourceOptions())).read(message(markers))


@pytest.mark.parametrize("posture", [STANDING, BENT], ids=["standing", "bent"])
def test_two_bodies_come_out_at_the_right_points(posture) -> None:
    at = person(1.6, posture)
    xyz = joints("azure_kinect_32", at)
    report = as_written(read(body(2, xyz) + body(17, xyz + 1.0)))
    assert (report.stamp_ns, report.arrived_ns, report.frame) == (NOW, NOW + 50_000_000, "depth_camera_link")
    assert [each.id for each in report.people] == ["2", "17"]
    for name, place in expected("azure_kinect_32", at).items():
        np.testing.assert_array_equal(report.people[0].xyz[COLUMN[name]], place)
        np.testing.assert_array_equal(report.people[1].xyz[COLUMN[name]], place + 1.0)


def test_what_the_markers_do_not_tell_is_shown() -> None:
    shown = {each.name: each for each in OneByOne(AzureKinectMarkers(SourceOptions())).assumptions}
    assert shown["recording.joint_set"].value == "Azure Kinect, 32 joints"
    assert "no confidence" in shown["recording.joints_measured"].source


XYZ = joints("azure_kinect_32", person())


def test_deleted_markers_are_nobody() -> None:
    report = read([marker(0, action=DELETEALL), *body(1, XYZ)])
    assert [each.id for each in report.people] == ["1"]
    assert read([]) is None
    report = read(body(1, XYZ, action=DELETE))
    assert report.people == () and report.stamp_ns == NOW


def test_the_order_of_markers_and_their_orientation_say_nothing(rng) -> None:
    markers = body(1, XYZ)
    for each in markers:
        each.pose.orientation.x = float(rng.normal())
    mixed = read([markers[k] for k in rng.permutation(len(markers))])
    np.testing.assert_array_equal(mixed.people[0].xyz, read(body(1, XYZ)).people[0].xyz)


def test_two_bodies_with_one_id_keep_no_point_that_both_have() -> None:
    report = read(body(1, XYZ) + body(1, XYZ + 1.0))
    assert [each.id for each in report.people] == ["1"]
    assert not report.people[0].measured and len(report.flaws) == 32
    report = read([*body(1, XYZ), marker(107, (1.0, 1.0, 1.0))])
    assert np.isnan(report.people[0].xyz[COLUMN["l_wrist"]]).all()
    assert report.flaws[0].reason == "joint 7 stands there twice"


def test_several_stamps_or_frames_in_one_message_leave_people_without_points() -> None:
    other = body(1, XYZ)[:31] + body(1, XYZ, stamp=NOW + 1)[31:]
    for markers in (other, body(1, XYZ) + body(2, XYZ, header=header(NOW, "other"))):
        report = read(markers)
        assert not any(each.measured for each in report.people)
        assert "several stamps or frames" in report.flaws[0].reason


@pytest.mark.parametrize(
    ("markers", "says"),
    [
        (body(1, XYZ[:26]), "joints up to 25 only, as body tracking SDKs before 1.0"),
        ([marker(132)], "is joint 32"),
        ([marker(-1)], "is none of a body"),
        (body(1, XYZ, ns="planner"), "namespace 'planner'"),
        (body(1, XYZ, text="head"), "is none of a body"),
        (body(1, XYZ, type=0), "of type 0"),
        (body(1, XYZ, action=1), "is none of a body"),
    ],
)
def test_other_markers_are_refused(markers: list[Any], says: str) -> None:
    with pytest.raises(SourceError, match=says):
        read(markers)


def test_bodies_are_found_among_topics_of_markers() -> None:
    assert speaks_of_people(message(body(1, XYZ)))
    assert speaks_of_people(message(body(1, XYZ[:26])))
    assert not speaks_of_people(message(body(1, XYZ, ns="planner")))
    assert not speaks_of_people(message([marker(1), marker(2)]))
    assert not speaks_of_people(message([]))


def test_wrong_indices_are_refused_at_the_end(rng) -> None:
    reader = OneByOne(AzureKinectMarkers(SourceOptions()))
    for _ in range(3):
        reader.read(message(body(1, np.roll(XYZ, 1, axis=0))))
    with pytest.raises(SourceError, match="not those of Azure Kinect"):
        reader.finish()
