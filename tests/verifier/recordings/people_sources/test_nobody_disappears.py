"""One rule for every source: whoever is named is in a report, if need be without points."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from tests.verifier.recordings.bags import ROS2, in_time, joint_item, write_foreign_mcap
from tests.verifier.recordings.people_sources import test_azure_kinect as azure
from tests.verifier.recordings.people_sources import test_floor_and_field as floor
from tests.verifier.recordings.people_sources import test_mocap4r2 as mocap
from tests.verifier.recordings.people_sources import test_ros4hri as ros4hri
from tests.verifier.recordings.people_sources import test_skeletons as skeletons
from tests.verifier.recordings.people_sources import test_zed as zed
from tests.verifier.recordings.people_sources.bodies import joints, person
from tests.verifier.recordings.people_sources.ros import MOCAP, as_written, decoded, header, make, point, pose
from tests.verifier.recordings.samples import joint_states
from verifier.recordings import Recording, inspect_recording
from verifier.recordings.decoded import Decoded
from verifier.recordings.people_report import NANO, ReportedPerson
from verifier.recordings.people_sources import ADAPTERS, FloorPositions, SourceOptions, new_adapters
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.topic import PEOPLE_TOPIC

NOW = 1_700_000_000_000_000_000
STEP_NS = 33_000_000
LATE_NS = 40_000_000
Seen = tuple[str, float]
"""Who, and a factor for all coordinates; NaN: nothing of them is readable."""
Make = Callable[[list[Seen], int], Decoded]


def _zed(seen: Iterable[Seen], stamp: int) -> Decoded:
    xyz = joints("zed_body_38", person())
    return zed.message([zed.body(xyz * k, body_format=2, label=name) for name, k in seen], stamp)


def _azure(seen: Iterable[Seen], stamp: int) -> Decoded:
    markers = [m for name, k in seen for m in azure.body(int(name), azure.XYZ * k, stamp=stamp)]
    return decoded(azure.SCHEMA, make(azure.SCHEMA, markers=markers), NOW)


def _markers(seen: Iterable[Seen], stamp: int) -> Decoded:
    at = person()
    found = [(f"{name}:LWRB", at["wrist_left"] * k) for name, k in seen]
    return mocap.markers(found, stamp)


def _bodies(seen: Iterable[Seen], stamp: int) -> Decoded:
    place = person()["wrist_left"]
    kind = "mocap4r2_msgs/msg/RigidBody"
    bodies = [make(kind, rigid_body_name=f"{name}/LWRB", pose=pose(place * k)) for name, k in seen]
    return decoded(mocap.BODIES, make(mocap.BODIES, header=header(stamp), rigidbodies=bodies), NOW)


def _frames(seen: Iterable[Seen], stamp: int) -> Decoded:
    turn = Rotation.identity()
    frames = [ros4hri.transform(f"body_{n}", "camera", (k, k, k), turn, stamp) for n, k in seen]
    return ros4hri.message(frames)


def _skeletons(seen: Iterable[Seen], stamp: int) -> Decoded:
    xyz = joints("coco_17", person())
    people = [skeletons.body(xyz * k, None, name) for name, k in seen]
    return skeletons.message("coco_17", people, stamp=stamp / NANO)


def _floor(seen: Iterable[Seen], stamp: int) -> Decoded:
    people = [make("people_msgs/msg/Person", name=name, position=point((k, k, 0.0))) for name, k in seen]
    return decoded(floor.PEOPLE, make(floor.PEOPLE, header=header(stamp, "map"), people=people), NOW)


MAKERS: dict[str, Make] = {
    zed.NEW: _zed, azure.SCHEMA: _azure, mocap.MARKERS: _markers, mocap.BODIES: _bodies,
    ros4hri.SCHEMA: _frames, "stopproof.Skeletons": _skeletons, floor.PEOPLE: _floor,
}  # fmt: skip
"""Sources that name people; by type, what makes a message about some of them with one stamp."""
ALIKE = {zed.OLD, "tf/msg/tfMessage"}
"""Types that the same adapter reads in the same way."""
NAMELESS = {floor.POSES, floor.POINT, floor.POSE, floor.BOOL, "hri_msgs/msg/Skeleton2D"}
"""Types that name nobody: numbered by order, of one person, a switch, refused."""
FAR, NEAR = "17", "29"
every_source = pytest.mark.parametrize("schema", sorted(MAKERS))


def listed(schema: str, messages: Iterable[Decoded]) -> dict[str, list[ReportedPerson]]:
    """Everybody whom the reports list, as verify reads them, with what each report says."""
    options = SourceOptions(point_names=mocap.NAMES, floor=FloorPositions(0.3))
    reader = new_adapters(options)[schema]
    reports = [report for message in messages for report in reader.read(message)]
    found: dict[str, list[ReportedPerson]] = {}
    for report in map(as_written, (*reports, *reader.finish())):
        for each in report.people:
            found.setdefault(each.id.removeprefix("Body_"), []).append(each)
    return found


def arriving(message: Decoded, time_ns: int) -> Decoded:
    return replace(message, log_time_ns=time_ns)


def test_every_type_is_tried_or_names_nobody() -> None:
    assert set(MAKERS) | ALIKE | NAMELESS == set(ADAPTERS)


@every_source
def test_whoever_has_no_readable_point_is_listed(schema: str) -> None:
    said = MAKERS[schema]
    found = listed(schema, [said([(FAR, 1.0), (NEAR, np.nan)], NOW + n * STEP_NS) for n in range(3)])
    assert len(found[FAR]) == len(found[NEAR]) == 3
    assert all(each.measured for each in found[FAR])
    assert not any(np.isfinite(each.xyz).any() for each in found[NEAR])


@every_source
def test_whoever_is_older_and_comes_after_somebody_else_is_read(schema: str) -> None:
    said, messages = MAKERS[schema], []
    for n in range(3):
        stamp = NOW + n * STEP_NS
        messages.append(arriving(said([(FAR, 1.0)], stamp), stamp + LATE_NS))
        messages.append(arriving(said([(NEAR, 1.0)], stamp - LATE_NS), stamp + LATE_NS + 1))
    found = listed(schema, messages)
    for name in (FAR, NEAR):
        assert len(found[name]) == 3 and all(each.measured for each in found[name])


@every_source
def test_whoever_has_no_stamp_is_listed_without_points(schema: str) -> None:
    said, messages = MAKERS[schema], []
    for n in range(3):
        stamp = NOW + n * STEP_NS
        messages.append(arriving(said([(FAR, 1.0)], stamp), stamp + LATE_NS))
        messages.append(arriving(said([(NEAR, 1.0)], 0), stamp + LATE_NS + 1))
    found = listed(schema, messages)
    assert len(found[FAR]) == len(found[NEAR]) == 3
    assert all(each.measured for each in found[FAR])
    assert not any(np.isfinite(each.xyz).any() for each in found[NEAR])


@every_source
def test_whoever_is_seen_once_is_listed(schema: str) -> None:
    said = MAKERS[schema]
    both = said([(FAR, 1.0), (NEAR, 1.0)], NOW)
    found = listed(schema, [both, *(said([(FAR, 1.0)], NOW + n * STEP_NS) for n in range(1, 5))])
    assert len(found[NEAR]) == 1 and found[NEAR][0].measured and len(found[FAR]) == 5


def test_several_stamps_in_one_message() -> None:
    """Of those sources whose messages have several: frames are read, markers stay without points."""
    early = [ros4hri.transform(f"body_{NEAR}", "camera", (1, 1, 1), Rotation.identity(), NOW - 1_000_000)]
    late = [ros4hri.transform(f"body_{FAR}", "camera", (2, 2, 2), Rotation.identity(), NOW)]
    found = listed(ros4hri.SCHEMA, [ros4hri.message(early + late)])
    assert found[NEAR][0].measured and found[FAR][0].measured
    markers = azure.body(int(NEAR), azure.XYZ, stamp=NOW - 1_000_000) + azure.body(int(FAR), azure.XYZ)
    found = listed(azure.SCHEMA, [decoded(azure.SCHEMA, make(azure.SCHEMA, markers=markers), NOW)])
    assert set(found) == {NEAR, FAR}


@pytest.mark.parametrize("sign", ":/")
def test_whoever_stands_before_names_that_are_not_known_is_listed(sign: str) -> None:
    seen = [("anna:LWRB", (1, 1, 1)), (f"bob{sign}HEAD", (2, 1, 1)), (f"bob{sign}PELV", (2, 1, 0.5))]
    found = listed(mocap.MARKERS, [mocap.markers(seen), mocap.markers(seen[1:])])
    assert set(found) == {"anna", "bob"} and len(found["bob"]) == 2
    assert not any(np.isfinite(each.xyz).any() for each in found["bob"])


def test_names_that_are_not_known_reach_verify_and_inspect(tmp_path: Path) -> None:
    for name, text in MOCAP.items():
        kind = f"mocap4r2_msgs/msg/{name}"
        if kind not in ROS2.types:
            ROS2.register(get_types_from_msg(text.format("mocap4r2_msgs"), kind))
    known = [("anna:l_wrist", (1, 1, 1)), ("anna:l_elbow", (1, 1, 1.25))]
    seen = [known, [*known, ("bob:HEAD", (2, 1, 1))], [("TABLE", (3, 0, 0))]]
    items = [joint_item(state) for state in joint_states(100.0, 0.5, NOW)]
    for n, each in enumerate(seen):
        message = mocap.markers(each, NOW + n * STEP_NS)
        items.append((message.topic, message.schema, message.log_time_ns, lambda _, v=message.value: v))
    path = write_foreign_mcap(tmp_path / "a.mcap", in_time(items))
    stream = PeopleStream((recording := Recording(path)).file, {})
    reports = [stream.report(message) for message in recording.file.messages([PEOPLE_TOPIC])]
    assert stream.unknown_points == {"bob:HEAD", "TABLE"}
    assert [[each.id for each in report.people] for report in reports] == [["anna"], ["anna", "bob"], []]
    inspected = inspect_recording(path)
    assert inspected.unknown_points == ("TABLE", "bob:HEAD")
    assert "point names that are not known: TABLE, bob:HEAD" in inspected.lines()
    assert inspected.people == {"anna": 2, "bob": 1}
