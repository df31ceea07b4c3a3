"""What reports about people are taken for: nobody is there, numbers that are no arrays, what is no person."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import load_profile
from occupancy.gate_kernels import read_person
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement, RawPerson, RefusalReason
from tests.occupancy.people import settings
from verifier.known import PeopleWatch


def nobody_since(complete: object, frame: str = "world") -> float:
    watch = PeopleWatch(Gate(load_profile("iso"), settings()), 0.25)
    watch.admit(RawMeasurement(5.0, 5.0, frame, complete, ()), 5.0)
    assert watch.known().reported
    return watch.known().nobody_since


@pytest.mark.parametrize("complete", [True, np.bool_(True)])
def test_a_complete_report_that_lists_nobody_counts_from_its_earliest_instant(complete: object) -> None:
    assert nobody_since(complete) == 4.75


@pytest.mark.parametrize("complete", [False, "true", "false", 1, 1.0, math.nan, None])
def test_whatever_else_only_counts_as_true_says_nothing_about_who_is_there(complete: object) -> None:
    assert nobody_since(complete) == -math.inf


def test_a_report_that_cannot_be_used_says_nothing_about_who_is_there() -> None:
    assert nobody_since(True, "nowhere") == -math.inf


XYZ = np.linspace(0.5, 1.0, 60).reshape(20, 3)
ERRORS = np.full(20, 0.01)


def known_of(*persons: RawPerson) -> tuple[PeopleWatch, list]:
    watch = PeopleWatch(Gate(load_profile("iso"), settings()), 0.0)
    admission = watch.admit(RawMeasurement(5.0, 5.0, "world", True, persons), 5.0)
    return watch, [(refusal.person, refusal.point, refusal.reason) for refusal in admission.refusals]


@pytest.mark.parametrize(
    ("xyz", "error", "measured"),
    [
        (XYZ.tolist(), ERRORS, 0xFFFFF),
        (XYZ, ERRORS.tolist(), 0xFFFFF),
        (tuple(map(tuple, XYZ.tolist())), tuple(ERRORS.tolist()), np.int64(0xFFFFF)),
        (XYZ.astype(">f8"), ERRORS, np.uint32(0xFFFFF)),
        (np.asfortranarray(XYZ), ERRORS, 0xFFFFF),
        (np.hstack([XYZ, XYZ])[:, :3], ERRORS, 0xFFFFF),
        (np.frombuffer(XYZ.tobytes()).reshape(20, 3), ERRORS, 0xFFFFF),
        (XYZ, np.broadcast_to(0.01, 20), 0xFFFFF),
        (XYZ, np.full(40, 0.01)[::2], 0xFFFFF),
    ],
)
def test_numbers_that_are_no_array_of_doubles_say_the_same(
    xyz: object, error: object, measured: object
) -> None:
    plain, refused = known_of(RawPerson("p", XYZ, ERRORS, 0xFFFFF))
    compiled = tuple(read_person.overloads)
    watch, also_refused = known_of(RawPerson("p", xyz, error, measured))
    assert also_refused == refused and tuple(read_person.overloads) == compiled
    assert watch.known().people.tobytes() == plain.known().people.tobytes()
    assert np.isfinite(watch.known().people["xyz"][0, 0]).any()


@pytest.mark.parametrize(
    ("xyz", "error", "measured"),
    [
        (XYZ[:19], ERRORS, 0xFFFFF),
        (np.zeros((21, 3)), ERRORS, 0xFFFFF),
        (np.zeros((40000, 3)), ERRORS, 0xFFFFF),
        (XYZ[:, :2], ERRORS, 0xFFFFF),
        (XYZ.ravel(), ERRORS, 0xFFFFF),
        (XYZ.tolist()[:3], ERRORS, 0xFFFFF),
        ([[1.0], *XYZ.tolist()[1:]], ERRORS, 0xFFFFF),
        ([["1", "2", "3"]] * 20, ERRORS, 0xFFFFF),
        (np.ma.masked_greater(XYZ, 0.7), ERRORS, 0xFFFFF),
        (XYZ.astype(complex), ERRORS, 0xFFFFF),
        (None, ERRORS, 0xFFFFF),
        (XYZ, ERRORS[:19], 0xFFFFF),
        (XYZ, 0.01, 0xFFFFF),
        (XYZ, ERRORS, 1.0),
        (XYZ, ERRORS, None),
    ],
)
def test_whoever_has_no_twenty_points_is_there_and_nobody_knows_where(
    xyz: object, error: object, measured: object
) -> None:
    """Nothing raises, nothing is read beyond an array, and who else is in the report is taken in."""
    good = RawPerson("good", XYZ + 2.0, ERRORS, 0xFFFFF)
    watch, refused = known_of(RawPerson("bad", xyz, error, measured), good)
    assert refused[0] == ("bad", None, RefusalReason.SHAPE)
    assert [each[0] for each in refused].count("bad") == 1
    people = watch.known().people[0]
    alone, _ = known_of(good)
    points = int(alone.known().people["present"][0, 0])
    assert people["n"] == 2 and people["present"][:2].tolist() == [0, points] and points != 0
    assert watch.gate.person_ids == ("bad", "good")


@pytest.mark.parametrize("kind", [list, iter, lambda people: (each for each in people)])
def test_whoever_is_listed_is_there_however_the_list_is_made(kind: Callable[[list], object]) -> None:
    """An iterator lists people only once; to whoever looks again it would say that nobody is there."""
    persons = [RawPerson("a", XYZ, ERRORS, 0xFFFFF), RawPerson("b", XYZ.tolist(), ERRORS, 0xFFFFF)]
    wanted, _ = known_of(*persons)
    watch = PeopleWatch(Gate(load_profile("iso"), settings()), 0.0)
    watch.admit(RawMeasurement(5.0, 5.0, "world", True, kind(persons)), 5.0)
    assert watch.known().people.tobytes() == wanted.known().people.tobytes()
    assert watch.known().nobody_since == -math.inf
    gate = Gate(load_profile("iso"), settings())
    gate.admit(RawMeasurement(5.0, 5.0, "world", True, kind(persons[:1])), 5.0)
    assert gate.person_ids == ("a",)


def test_an_id_that_is_no_text_is_made_one() -> None:
    watch, _ = known_of(RawPerson(["p"], XYZ, ERRORS, 0xFFFFF))
    assert watch.gate.person_ids == ("['p']",)


def test_before_any_report_nothing_is_known() -> None:
    known = PeopleWatch(Gate(load_profile("iso"), settings()), 0.25).known()
    assert known.reported is False and known.nobody_since == -math.inf


def test_an_older_report_does_not_take_back_what_a_newer_one_said() -> None:
    watch = PeopleWatch(Gate(load_profile("iso"), settings()), 0.25)
    for stamp in (5.0, 4.5):
        watch.admit(RawMeasurement(stamp, 5.0, "world", True, ()), 5.0)
    assert watch.known().nobody_since == 4.75
