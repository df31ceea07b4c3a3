"""Markers and rigid bodies of mocap4r2, by rosbags: names through the map of the cell."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.verifier.recordings.people_sources.bodies import person
from tests.verifier.recordings.people_sources.ros import (
    adapters,
    as_written,
    decoded,
    header,
    make,
    point,
    pose,
)
from verifier.recordings.decoded import SourceError
from verifier.recordings.npz import read_people
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_source import Place, TablePeople
from verifier.recordings.people_sources import SourceOptions

MARKERS, BODIES = "mocap4r2_msgs/msg/Markers", "mocap4r2_msgs/msg/RigidBodies"
NOW = 1_700_000_000_123_456_789
NAMES = {"LWRB": "l_wrist", "LELB": "l_elbow", "7": "head", "anna:special": "r_wrist"}


def marker(name: str | int, place: Any) -> Any:
    stated = {"id_type": 1, "marker_index": name} if isinstance(name, int) else {"marker_name": name}
    return make("mocap4r2_msgs/msg/Marker", **stated, translation=point(place))


def markers(seen: list[tuple[str | int, Any]], stamp: int = NOW):
    value = make(MARKERS, header=header(stamp, "mocap"), markers=[marker(*each) for each in seen])
    return decoded(MARKERS, value, stamp + 5_000_000)


def adapter(schema: str = MARKERS, **names: str):
    return adapters(SourceOptions(point_names=NAMES | names))[schema]


def test_names_are_mapped_and_people_are_told_apart() -> None:
    at = person()
    seen = [
        ("anna:LWRB", at["wrist_left"]), ("anna:LELB", at["elbow_left"]), ("anna:special", at["wrist_right"]),
        ("bert/LWRB", at["wrist_left"] + 1.0), ("l_knee", at["knee_left"]), (7, at["head"]),
        ("gripper", (1, 1, 1)),
    ]  # fmt: skip
    reader = adapter()
    report = reader.read(markers(seen))
    assert report.unknown_points == {"gripper"} and report.frame == "mocap"
    report = as_written(report)
    found = {each.id: each for each in report.people}
    assert set(found) == {"anna", "bert", "p1"}
    for who, name, place in (
        ("anna", "l_wrist", at["wrist_left"]), ("anna", "l_elbow", at["elbow_left"]),
        ("anna", "r_wrist", at["wrist_right"]), ("bert", "l_wrist", at["wrist_left"] + 1.0),
        ("p1", "l_knee", at["knee_left"]), ("p1", "head", at["head"]),
    ):  # fmt: skip
        np.testing.assert_array_equal(found[who].xyz[COLUMN[name]], place)
    assert found["bert"].measured == 1 << COLUMN["l_wrist"]
    reader.finish()


def test_rigid_bodies_are_read_at_their_origin() -> None:
    bodies = [
        make("mocap4r2_msgs/msg/RigidBody", rigid_body_name="LWRB", pose=pose((1.0, 2.0, 3.0))),
        make("mocap4r2_msgs/msg/RigidBody", rigid_body_name="robot", pose=pose((0.0, 0.0, 0.5))),
    ]
    value = make(BODIES, header=header(NOW), rigidbodies=bodies)
    report = adapter(BODIES).read(decoded(BODIES, value, NOW))
    np.testing.assert_array_equal(report.people[0].xyz[COLUMN["l_wrist"]], (1.0, 2.0, 3.0))
    assert report.unknown_points == {"robot"}


def test_lost_markers_are_missing_and_people_stay() -> None:
    report = adapter().read(markers([("LWRB", (0, 0, 0)), ("LELB", (np.nan, 1, 1))]))
    (found,) = report.people
    assert not found.measured and np.isnan(found.xyz).all()


def test_a_point_that_is_given_twice_is_refused() -> None:
    report = adapter().read(markers([("LWRB", (1, 0, 0)), ("l_wrist", (2, 0, 0)), ("LELB", (1, 0, 0.3))]))
    assert report.people[0].measured == 1 << COLUMN["l_elbow"]
    assert (report.flaws[0].point, report.flaws[0].reason) == ("l_wrist", "the point is given twice")


def test_messages_without_a_known_name_say_nothing_and_streams_are_refused() -> None:
    reader = adapter()
    assert reader.read(markers([("gripper", (1, 1, 1)), ("base", (2, 1, 1))])) is None
    assert reader.read(markers([])).people == ()
    with pytest.raises(SourceError, match=r"no marker has a known name \(it has gripper, base\)"):
        reader.finish()
    adapter().finish()


def test_millimetres_are_refused() -> None:
    reader, at = adapter(), person()
    reader.read(markers([("LWRB", 1e3 * at["wrist_left"]), ("LELB", 1e3 * at["elbow_left"])]))
    with pytest.raises(SourceError, match=r"l_elbow to l_wrist is 255\.\d m long, as if in mm"):
        reader.finish()


@pytest.mark.real_data
def test_real_people_are_reported_as_an_import_reports_them(real_data: Path, some) -> None:
    """Live motion capture with drop-outs and swaps, and clean clips: the same points and missing ones."""
    files = [*sorted(real_data.glob("human_robot/*.npz")), *sorted(real_data.glob("human/kth*.npz"))]
    assert files
    for path in some(files, 2):
        table = read_people(path)
        (track,) = table.tracks
        imports = TablePeople(table, None, {}).reports(Place(), np.nan)
        reports = list(itertools.islice(imports, 0, 400, 10))
        reader = adapters()[MARKERS]
        for row, imported in zip(range(0, 400, 10), reports, strict=False):
            seen = list(zip(track.names, track.xyz[row], strict=True))
            (found,) = as_written(reader.read(markers(seen, NOW + imported.stamp_ns))).people
            (known,) = imported.people
            np.testing.assert_array_equal(found.xyz, known.xyz)
            assert found.measured == known.measured
        reader.finish()


@pytest.mark.parametrize("order", [1, -1])
def test_markers_without_a_person_are_not_taken_for_somebody_called_alike(order: int) -> None:
    reader = adapters(SourceOptions(point_names=NAMES))[MARKERS]
    first, second = [markers([(name, (1, 1, 1))]) for name in ("LWRB", "p1:LWRB")][::order]
    reader.read(first)
    with pytest.raises(SourceError, match="would be of p1, who is there too"):
        reader.read(second)
