"""Reports that say where somebody stands, and for which regions they are complete."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.verifier.recordings.samples import joint_states, write_all
from verifier.recordings import Choice, Reading, Recording
from verifier.recordings.people_report import COLUMN, PeopleReport, ReportError, decode
from verifier.recordings.people_schema import SCHEMA

PELVIS = COLUMN["pelvis"]
HEAD = {"xyz": [1, 2, 3], "state": "measured"}


def said(people: list[Any], complete: Any = False, regions: tuple[str, ...] = ()) -> PeopleReport:
    message = {"stamp": 1.0, "frame": "world", "complete": complete, "people": people}
    return decode(json.dumps(message).encode(), 0, regions=regions)


def standing(floor: Any, **more: Any) -> dict[str, Any]:
    return {"id": "p1", "floor": floor} | more


@pytest.mark.parametrize("states_up", [True, False])
def test_every_pelvis_above_a_place_is_within_the_error(states_up: bool, rng, count) -> None:
    """In any frame: lying to tiptoe, and as far aside as was stated."""
    tightest = 1.0
    for _ in range(count(20_000)):
        turn = Rotation.random(rng=rng).as_matrix()
        place, aside = rng.normal(0.0, 3.0, 3), rng.uniform(0.0, 1.0)
        floor = {"xyz": place.tolist(), "error_m": aside}
        if states_up:
            floor["up"] = turn[:, 2].tolist()
        (person,) = said([standing(floor)]).people
        angle, height = rng.uniform(0.0, 2.0 * np.pi), 1.2 * rng.choice([0.0, 1.0, rng.uniform()])
        offset = aside * rng.choice([1.0, rng.uniform()])
        pelvis = place + turn @ [offset * np.cos(angle), offset * np.sin(angle), height]
        away = np.linalg.norm(pelvis - person.xyz[PELVIS])
        assert person.measured == 1 << PELVIS
        assert away <= person.error_m[PELVIS] + 1e-9
        tightest = min(tightest, person.error_m[PELVIS] - away)
    assert tightest < 0.05, "the error is no larger than it must be"


def test_points_and_a_place_go_together() -> None:
    report = said(
        [standing({"xyz": [4, 5, 0], "error_m": 0.2}, points={"head": HEAD}, position_error_m=0.01)]
    )
    (person,) = report.people
    assert not report.flaws and report.known_points
    assert person.measured == 1 << PELVIS | 1 << COLUMN["head"]
    np.testing.assert_array_equal(person.xyz[PELVIS], [4, 5, 0])
    assert (person.error_m[COLUMN["head"]], person.error_m[PELVIS]) == (0.01, np.hypot(1.2, 0.2))


@pytest.mark.parametrize(
    ("floor", "reason"),
    [
        (None, 'must be an object with "xyz" and "error_m"'),
        ({"xyz": [1, 2, 3]}, 'must be an object with "xyz" and "error_m"'),
        ({"xyz": [1, 2], "error_m": 0.1}, "three numbers"),
        ({"xyz": [1, "2", 3], "error_m": 0.1}, "three numbers"),
        ({"xyz": [1, 2, 3], "error_m": None}, "a number"),
        ({"xyz": [1, 2, 3], "error_m": -0.1}, "at least 0"),
        ({"xyz": [1, 2, 3], "error_m": float("nan")}, "at least 0"),
        ({"xyz": [1, 2, 3], "error_m": 0.1, "up": [0, 0, 2]}, "unit vector"),
        ({"xyz": [1, 2, 3], "error_m": 0.1, "up": [0, 0, float("nan")]}, "unit vector"),
        ({"xyz": [1, 2, 3], "error_m": 0.1, "up": None}, "three numbers"),
    ],
)
def test_a_place_that_cannot_be_read_leaves_somebody_without_points(floor: Any, reason: str) -> None:
    report = said([standing(floor)])
    (flaw,) = report.flaws
    assert flaw.person == "p1" and reason in flaw.reason
    assert [each.id for each in report.people] == ["p1"] and not report.people[0].measured


@pytest.mark.parametrize("xyz", [[0, 0, 0], [None, 1, 1], [float("inf"), 0, 0], [0.0, -0.0, 0]])
def test_places_that_are_missing_are_no_pelvis(xyz: list[Any]) -> None:
    """Zeros too: not 0.6 m above them."""
    (person,) = said([standing({"xyz": xyz, "error_m": 0.1, "up": [0, 0, 1]})]).people
    assert not np.isfinite(person.xyz[PELVIS]).all()


def test_a_pelvis_beside_a_place_is_given_twice() -> None:
    report = said([standing({"xyz": [1, 2, 0], "error_m": 0.1}, points={"pelvis": HEAD, "head": HEAD})])
    assert [(flaw.point, "given twice" in flaw.reason) for flaw in report.flaws] == [("pelvis", True)]
    assert report.people[0].measured == 1 << COLUMN["head"] and np.isnan(report.people[0].xyz[PELVIS]).all()


@pytest.mark.parametrize(
    ("complete", "regions", "counts", "flaws"),
    [
        (True, (), True, 0),
        (True, ("a", "b"), True, 0),
        (False, ("a",), False, 0),
        (["a"], (), False, 0),
        (["a"], ("a",), True, 0),
        (["a"], ("a", "b"), False, 0),
        (["b", "a"], ("a", "b"), True, 0),
        ([], ("a",), False, 0),
        ([], (), False, 0),
        (["a", "c"], ("a",), True, 1),
        (["c"], ("a",), False, 1),
    ],
)
def test_a_report_is_complete_if_it_speaks_for_all_regions(
    complete: Any, regions: tuple[str, ...], counts: bool, flaws: int
) -> None:
    report = said([], complete, regions)
    assert (report.complete, len(report.flaws)) == (counts, flaws)


@pytest.mark.parametrize("complete", [1, "a", None, {"a": True}, [1], ["a", None]])
def test_other_words_for_complete_are_refused(complete: Any) -> None:
    with pytest.raises(ReportError, match='"complete" must be'):
        said([], complete, ("a",))


def test_the_regions_of_the_cell_reach_the_reports(tmp_path: Path) -> None:
    """Without a cell nobody knows which regions there are: such a report is not complete."""
    text = {"stamp": 0.5, "frame": "world", "complete": ["a"], "people": []}
    path = write_all(
        tmp_path / "a.mcap",
        joint_states(seconds=1.0),
        lambda writer: writer.people_as_they_are(json.dumps(text).encode(), 500_000_000),
    )
    for regions, counts in (((), False), (("a",), True), (("a", "b"), False)):
        recording = Recording(path, Choice(regions=regions))
        (window,) = Reading(recording, recording.joint_names).windows(10.0, 0.0, 0.0)
        assert [report.complete for report in window.people] == [counts]


def test_the_schema_takes_both_words() -> None:
    schema = json.loads(SCHEMA)
    report = {"stamp": 1.0, "frame": "world", "people": [standing({"xyz": [1, 2, 0], "error_m": 0.1})]}
    jsonschema.validate(report | {"complete": ["a"]}, schema)
    jsonschema.validate(report | {"complete": True}, schema)
    for bad in ({"complete": [1]}, {"people": [{"id": "p1"}]}, {"people": [standing({"xyz": [1, 2, 0]})]}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(report | bad, schema)
