"""ZED ``ObjectsStamped``, by rosbags: every set, states, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.verifier.recordings.people_sources.bodies import (
    BENT,
    STANDING,
    expected,
    in_a_camera,
    joints,
    person,
)
from tests.verifier.recordings.people_sources.ros import OneByOne, adapters, as_written, decoded, header, make
from verifier.recordings.decoded import SourceError
from verifier.recordings.limb_test import BODIES
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_sources import SourceOptions
from verifier.recordings.people_sources.zed import ZedObjects

NEW = "zed_msgs/msg/ObjectsStamped"
OLD = "zed_interfaces/msg/ObjectsStamped"
SETS = {0: "zed_body_18", 1: "zed_body_34", 2: "zed_body_38", 3: "zed_body_70"}
NOW = 1_700_000_000_123_456_789


def body(
    xyz: np.ndarray, package: str = "zed_msgs", old: bool = False, slots: int = 70, **fields: Any
) -> Any:
    places = np.zeros((slots, 3), np.float32)
    places[: len(xyz)] = xyz
    keys = [make(f"{package}/msg/Keypoint3D", kp=place) for place in places]
    skeleton = make(f"{package}/msg/Skeleton3D", old, keypoints=keys)
    stated = {
        "label": "Body_3",
        "label_id": 3,
        "tracking_available": True,
        "tracking_state": 1,
        "skeleton_available": True,
    }
    return make(f"{package}/msg/Object", old, **(stated | fields), skeleton_3d=skeleton)


def message(
    objects: list[Any], stamp: int = NOW, schema: str = NEW, old: bool = False, frame: str = "zed_left"
):
    value = make(schema, old, header=header(stamp, frame), objects=objects)
    return decoded(schema, value, stamp + 40_000_000, old=old)


def adapter() -> OneByOne:
    return OneByOne(ZedObjects(SourceOptions()))


@pytest.mark.parametrize("posture", [STANDING, BENT], ids=["standing", "bent"])
@pytest.mark.parametrize("number", SETS)
def test_every_set_comes_out_at_the_right_points(number: int, posture, rng) -> None:
    at = {name: in_a_camera(place, np.random.default_rng(1)) for name, place in person(1.7, posture).items()}
    reader = adapter()
    report = as_written(reader.read(message([body(joints(SETS[number], at), body_format=number)])))
    assert (report.stamp_ns, report.arrived_ns, report.frame) == (NOW, NOW + 40_000_000, "zed_left")
    assert not report.complete and not report.flaws
    (found,) = report.people
    assert found.id == "Body_3" and np.isnan(found.error_m).all()
    places = expected(SETS[number], at)
    assert found.measured == sum(1 << COLUMN[name] for name in places)
    for name, place in places.items():
        np.testing.assert_allclose(found.xyz[COLUMN[name]], place, atol=1e-6)
    reader.finish()
    (shown,) = reader.assumptions
    assert shown.source.startswith("ZED SDK")


def test_both_packages_are_read() -> None:
    xyz = joints("zed_body_38", person())
    for schema, package in ((NEW, "zed_msgs"), (OLD, "zed_interfaces")):
        reader = adapters()[schema]
        report = reader.read(message([body(xyz, package, body_format=2)], schema=schema))
        assert report is not None and report.people[0].measured


def test_messages_without_body_format_are_read_by_their_number_of_key_points() -> None:
    xyz = joints("zed_body_18", person())
    one = body(xyz, "zed_interfaces", True, 18)
    report = adapter().read(message([one], schema=OLD, old=True))
    assert report is not None and report.people[0].measured


@pytest.mark.parametrize(
    ("state", "measured", "kept"),
    [(0, False, False), (1, True, True), (2, False, True), (3, False, True), (9, False, False)],
)  # fmt: skip
def test_hidden_bodies_are_inferred_and_invalid_ones_have_no_points(
    state: int, measured: bool, kept: bool
) -> None:
    xyz = joints("zed_body_38", person())
    report = adapter().read(message([body(xyz, body_format=2, tracking_state=state)]))
    (found,) = report.people
    assert bool(found.measured) == measured
    assert np.isfinite(found.xyz).any() == kept


def test_nan_and_zero_are_missing_points_not_missing_people() -> None:
    xyz = joints("zed_body_38", person())
    xyz[16], xyz[8] = np.nan, 0.0  # left wrist; an ear, of which the head is the middle
    report = as_written(adapter().read(message([body(xyz, body_format=2)])))
    (found,) = report.people
    assert np.isnan(found.xyz[[COLUMN["l_wrist"], COLUMN["head"]]]).all()
    assert np.isfinite(found.xyz[COLUMN["r_wrist"]]).all()
    everything = np.full_like(xyz, np.nan)
    report = as_written(adapter().read(message([body(everything, body_format=2)])))
    assert [each.id for each in report.people] == ["Body_3"] and not report.people[0].measured


def test_two_bodies_with_one_id_are_both_kept() -> None:
    xyz = joints("zed_body_38", person())
    report = as_written(adapter().read(message([body(xyz, body_format=2), body(xyz + 1.0, body_format=2)])))
    assert [each.id for each in report.people] == ["Body_3", "Body_3 (2)"]
    assert "stands twice" in report.flaws[0].reason


def test_people_of_the_object_detection_stay_without_points_and_things_are_nobody() -> None:
    seen = [
        make("zed_msgs/msg/Object", label=label, label_id=n)
        for n, label in enumerate(["Person", "Vehicle", ""])
    ]
    report = adapter().read(message(seen))
    assert [each.id for each in report.people] == ["Person 0", "2 2"]
    assert all(not each.measured and np.isnan(each.xyz).all() for each in report.people)
    assert "has no skeleton" in report.flaws[0].reason


def test_an_empty_list_is_a_report_about_nobody() -> None:
    report = adapter().read(message([]))
    assert report is not None and report.people == () and not report.complete


def test_a_stream_in_several_frames_says_so_in_each_report() -> None:
    reader, xyz = adapter(), joints("zed_body_38", person())
    for k, frame in enumerate(("left", "/map", "left")):
        report = reader.read(message([body(xyz, body_format=2)], NOW + k, frame=frame))
        assert report.frame == frame.removeprefix("/")


XYZ = joints("zed_body_38", person())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: body(XYZ, body_format=7), "body_format 7 is not known"),
        (lambda: body(XYZ, body_format=0), "more key points than ZED BODY_18"),
        (lambda: body(XYZ, body_format=2, tracking_available=False), "tracking is off"),
    ],
)
def test_what_is_not_known_is_refused(wrong, says: str) -> None:
    with pytest.raises(SourceError, match=says):
        adapter().read(message([wrong()]))


def test_one_stream_has_one_set() -> None:
    reader = adapter()
    reader.read(message([body(XYZ, body_format=2)]))
    with pytest.raises(SourceError, match="ZED BODY_38 and ZED BODY_34"):
        reader.read(message([body(joints("zed_body_34", person()), body_format=1)]))


def test_another_message_of_the_name_is_refused() -> None:
    one = make("people_msgs/msg/People", header=header(NOW))
    with pytest.raises(SourceError, match="no field objects"):
        adapter().read(decoded("people_msgs/msg/People", one, NOW))


def test_millimetres_and_huge_values_are_refused(rng) -> None:
    for scale, says in ((1e3, "as if in mm"), (1e12, "m long")):
        reader = adapter()
        with pytest.raises(SourceError, match=says):
            for k in range(BODIES):
                reader.read(message([body(scale * in_a_camera(XYZ, rng), body_format=2)], NOW + k))


def test_messages_without_a_stamp_leave_people_without_points_and_such_streams_are_refused() -> None:
    reader = adapter()
    report = reader.read(message([body(XYZ, body_format=2)], 0))
    assert report.people[0].id == "Body_3" and np.isnan(report.people[0].xyz).all()
    assert report.stamp_ns == report.arrived_ns == 40_000_000
    assert "stamp is 0" in report.flaws[0].reason
    with pytest.raises(SourceError, match="stamp is 0"):
        reader.finish()
    reader = adapter()
    with pytest.raises(SourceError, match="stamp is 0"):
        for _ in range(BODIES):
            reader.read(message([body(XYZ, body_format=2)], 0))
