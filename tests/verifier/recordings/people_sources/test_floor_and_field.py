"""Positions on the floor and fields of scanners, by rosbags: what they say, and that nothing is guessed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from occupancy.body import Point
from robots.errors import SetupError
from tests.verifier.recordings.people_sources.ros import (
    adapters,
    as_written,
    decoded,
    header,
    make,
    point,
    pose,
)
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_sources import (
    ADAPTERS,
    GENERAL,
    FieldState,
    FloorPositions,
    SourceOptions,
    speaks_of_people,
)

PEOPLE = "people_msgs/msg/People"
POSES = "geometry_msgs/msg/PoseArray"
POINT = "geometry_msgs/msg/PointStamped"
POSE = "geometry_msgs/msg/PoseStamped"
BOOL = "std_msgs/msg/Bool"
NOW = 1_700_000_000_123_456_789
FLOOR = SourceOptions(floor=FloorPositions(0.3, floor_z_m=-0.5))


def floor_message(schema: str, places: Any) -> Decoded:
    top = header(NOW, "map")
    if schema == PEOPLE:
        people = [
            make("people_msgs/msg/Person", name=f"n{k}", position=point(p)) for k, p in enumerate(places)
        ]
        value = make(schema, header=top, people=people)
    elif schema == POSES:
        value = make(schema, header=top, poses=[pose(p) for p in places])
    else:
        value = make(
            schema,
            header=top,
            **({"point": point(places[0])} if schema == POINT else {"pose": pose(places[0])}),
        )
    return decoded(schema, value, NOW + 20_000_000)


@pytest.mark.parametrize(
    ("schema", "names"), [(PEOPLE, ["n0", "n1"]), (POSES, ["p1", "p2"]), (POINT, ["p1"]), (POSE, ["p1"])]
)
def test_the_pelvis_is_within_the_error_wherever_somebody_stands(schema: str, names: list[str], rng) -> None:
    """Whatever the horizontal offset that was stated allows, and every height of a pelvis."""
    places = rng.normal(0.0, 3.0, (2, 3))
    report = as_written(adapters(FLOOR)[schema].read(floor_message(schema, places)))
    assert [each.id for each in report.people] == names and report.frame == "map"
    for found, place in zip(report.people, places, strict=False):
        assert found.measured == 1 << Point.PELVIS
        for angle in np.linspace(0.0, 2 * np.pi, 9):
            for height in (0.0, 0.1, 0.5, 1.01, 1.2):
                pelvis = [place[0] + 0.3 * np.cos(angle), place[1] + 0.3 * np.sin(angle), height - 0.5]
                off = np.linalg.norm(pelvis - found.xyz[Point.PELVIS])
                assert off <= found.error_m[Point.PELVIS] + 1e-12
        assert found.error_m[Point.PELVIS] < 0.68


@pytest.mark.parametrize("schema", [PEOPLE, POSES, POINT, POSE])
@pytest.mark.parametrize("missing", [(np.nan, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_position_that_is_nan_or_zero_keeps_the_person(schema: str, missing: tuple[float, ...]) -> None:
    report = as_written(adapters(FLOOR)[schema].read(floor_message(schema, [missing])))
    assert len(report.people) == 1 and np.isnan(report.people[0].xyz).all()


@pytest.mark.parametrize("schema", [PEOPLE, POSES, POINT, POSE])
def test_floor_positions_of_unstated_error_are_refused(schema: str) -> None:
    adapter = adapters()[schema]
    assert adapter.assumptions == ()
    with pytest.raises(SourceError, match="state how far the pelvis may be from them"):
        adapter.read(floor_message(schema, [(1.0, 2.0, 0.0)]))


def test_what_was_stated_is_listed() -> None:
    shown = {each.name: (each.value, each.certainty.value) for each in adapters(FLOOR)[PEOPLE].assumptions}
    assert shown == {
        "recording.floor_error": (0.3, "declared"),
        "recording.floor_z": (-0.5, "declared"),
        "recording.highest_pelvis": (1.2, "assumed"),
    }


def test_a_field_that_is_free_is_a_complete_report_of_nobody() -> None:
    adapter = adapters(SourceOptions(field=FieldState(free_when=True, age_s=0.08)))[BOOL]
    free, taken = (decoded(BOOL, make(BOOL, data=state), NOW) for state in (True, False))
    report = as_written(adapter.read(free))
    assert report.complete and report.people == () and report.frame == "world"
    assert (report.stamp_ns, report.arrived_ns) == (NOW - 80_000_000, NOW)
    assert adapter.read(taken) is None and adapter.finish() is None
    assert {each.name for each in adapter.assumptions} == {"recording.switch_free", "recording.switch_age"}
    inverse = adapters(SourceOptions(field=FieldState(free_when=False, age_s=0.0)))[BOOL]
    assert inverse.read(free) is None and inverse.read(taken).complete


def test_a_switch_that_nobody_explained_is_refused() -> None:
    with pytest.raises(SourceError, match="state which of them"):
        adapters()[BOOL].read(decoded(BOOL, make(BOOL), NOW))


@pytest.mark.parametrize("wrong", [-0.1, float("nan"), float("inf")])
def test_numbers_that_cannot_be_are_refused(wrong: float) -> None:
    with pytest.raises(SetupError, match="must be at least 0"):
        FloorPositions(wrong)
    with pytest.raises(SetupError, match="must be at least 0 s"):
        FieldState(True, wrong)
    if not wrong < 0.0:
        with pytest.raises(SetupError, match="finite"):
            FloorPositions(0.1, wrong)


def test_2_d_skeletons_are_refused() -> None:
    with pytest.raises(SourceError, match=r"2-D skeletons.*record /tf and /tf_static"):
        adapters()["hri_msgs/msg/Skeleton2D"].read(
            Decoded("/b/skeleton2d", "hri_msgs/msg/Skeleton2D", 0, None)
        )


def test_every_adapter_is_found_by_its_types_and_is_new_for_each_recording() -> None:
    first, second = adapters(), adapters()
    assert set(first) == set(ADAPTERS) >= GENERAL
    for schema, adapter in first.items():
        assert schema in adapter.schemas and adapter is not second[schema]


def test_types_that_say_other_things_are_not_taken_by_themselves() -> None:
    assert not speaks_of_people(floor_message(POINT, [(1.0, 2.0, 3.0)]))
    assert not speaks_of_people(Decoded("/x", "sensor_msgs/msg/Image", 0, None))
    assert speaks_of_people(floor_message(PEOPLE, []))
