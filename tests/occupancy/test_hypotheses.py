"""Rows of the people block: what taking one out, merging two and widening leave of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.hypotheses import HISTORY, PEOPLE, READING, Hypotheses
from occupancy.measurement import Gate
from occupancy.sets import MAX_PEOPLE
from tests.occupancy.people import mask, only, report, rows_of, settings, standing

ISO = load_profile("iso")
TUM = load_profile("tum")
PER_ROW = [name for name in PEOPLE.names or () if PEOPLE[name].shape[:1] == (MAX_PEOPLE,)]
WRISTS = (Point.L_WRIST, Point.R_WRIST)
E_P = 0.01


def filled(rng: np.random.Generator, persons: list[int]) -> Hypotheses:
    """Hypotheses with one row for each entry of ``persons``, every field of which is some number."""
    of = Hypotheses(TUM.limits, MAX_PEOPLE, clock_error_s=0.0, stamp_error_s=0.0)
    for person in sorted(set(persons)):
        of.add_person(person)
    n = len(persons)
    of.people["n"][0] = n
    for name in PER_ROW:
        field = of.people[name][0]
        field[:n] = rng.integers(1, 1 << 20, field[:n].shape)
    of.people["person"][0, :n] = persons
    for name in HISTORY.names or ():
        field = of._history[name][0]
        field[:n] = rng.integers(1, 1 << 20, field[:n].shape)
    return of


def test_every_field_of_the_others_stays_when_somebody_is_removed(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    assert set(PER_ROW) == {"person", "t_obs", "present", "xyz", "e_p", "e_read", "v", "e_v"}
    for _ in range(count(2_000)):
        persons = [0, 1, 2, *rng.integers(0, 3, int(rng.integers(0, 5))).tolist()]
        persons = [int(each) for each in rng.permutation(persons)]
        of = filled(rng, persons)
        people, history = of.people.copy(), of._history.copy()
        gone = int(rng.integers(3))
        of.remove_person(gone)
        kept = [k for k, person in enumerate(persons) if person != gone]
        assert of.people["n"][0] == len(kept) and of.persons == {0, 1, 2} - {gone}
        for name in PER_ROW:
            np.testing.assert_array_equal(of.people[name][0, : len(kept)], people[name][0, kept])
        for name in HISTORY.names or ():
            np.testing.assert_array_equal(of._history[name][0, : len(kept)], history[name][0, kept])


def reading(t_obs: float, xyz: np.ndarray, e_p: float = E_P) -> np.void:
    """A reading (READING) of the points that are no NaN."""
    out = np.zeros(1, dtype=READING)[0]
    there = np.isfinite(xyz).all(axis=1)
    out["t_obs"], out["xyz"], out["seen"] = t_obs, xyz, xyz
    out["e_p"] = np.where(there, e_p, math.nan)
    out["present"] = sum(1 << int(p) for p in np.flatnonzero(there))
    return out


def full(*, profile: object = ISO, **errors: float) -> Hypotheses:
    """Hypotheses about sixteen persons: there is no row for a second one about anybody."""
    values = {"clock_error_s": 0.0, "stamp_error_s": 0.0} | errors
    of = Hypotheses(profile.limits, MAX_PEOPLE, **values)
    for person in range(MAX_PEOPLE):
        of.add_person(person)
    return of


def test_a_merged_row_claims_nothing_of_points_that_only_one_has() -> None:
    of = full()
    of.update(0, reading(0.0, only(standing(0.0), Point.HEAD, Point.PELVIS, *WRISTS)))
    of.update(0, reading(0.01, only(standing(5.0), Point.HEAD, Point.NECK_BASE)))
    row = of.people[0]
    assert of.overflow and row["present"][0] == mask(Point.HEAD)
    lost = [point for point in Point if point is not Point.HEAD]
    for name in ("t_obs", "xyz", "e_p"):
        assert np.isnan(row[name][0][lost]).all()


def test_a_merged_row_has_its_own_reading_errors_and_no_velocity() -> None:
    of = full(profile=TUM)
    for i in range(20):
        of.update(0, reading(0.01 * i, standing(0.0)))
    assert np.isfinite(of.people["e_v"][0, 0]).all() and of._history["n"][0, 0].all()
    of.update(0, reading(0.2, standing(5.0)))
    assert of.overflow and np.isinf(of.people["e_v"][0, 0]).all() and not of.people["v"][0, 0].any()
    assert not of._history["n"][0, 0].any()
    np.testing.assert_array_equal(of.people["e_read"][0, 0], of.people["e_p"][0, 0])
    assert (of.people["e_read"][0, 0] > 2.5).all()


@pytest.mark.parametrize("error", [E_P, 0.5])
@pytest.mark.parametrize("second", [0.1, -0.1])
def test_a_merged_row_contains_both_whichever_was_seen_first(second: float, error: float) -> None:
    """At every instant, and whenever both were seen within the errors of stamps and clocks."""
    clock, stamp = 0.003, 0.002
    of = full(clock_error_s=clock, stamp_error_s=stamp)
    of.update(0, reading(0.0, standing(0.0)))
    of.update(0, reading(second, standing(5.0), error))
    row, bounds = of.people[0], np.array([-clock, 2.0 * stamp + clock])
    assert of.overflow and (row["t_obs"][0] == second).all()
    for t in np.linspace(-0.5, 1.0, 301):
        longest = np.abs(t - bounds).max()
        shortest = 0.0 if np.ptp(np.sign(t - second - bounds)) else np.abs(t - second - bounds).min()
        for point in Point:
            for x, e in ((0.0, E_P + ISO.speed[point] * (longest - shortest)), (5.0, error)):
                off = float(np.linalg.norm(row["xyz"][0, point] - standing(x)[point]))
                assert off + e <= row["e_p"][0, point] + 1e-9


def test_a_merged_row_contains_the_reading_whatever_is_rounded(rng: np.random.Generator) -> None:
    for _ in range(20):
        of = full()
        first, second = standing(0.0) + rng.normal(size=3), standing(50.0) + rng.normal(size=3)
        of.update(0, reading(0.0, first))
        of.update(0, reading(0.01, second, 0.5))
        row = of.people[0]
        for point in Point:
            here, there = row["xyz"][0, point].tolist(), second[point].tolist()
            away = [Fraction(a) - Fraction(b) for a, b in zip(here, there, strict=True)]
            room = Fraction(float(row["e_p"][0, point])) - Fraction(0.5)
            assert room >= 0 and room**2 >= sum(x**2 for x in away)


def test_overflow_goes_with_who_is_removed_and_comes_back_without() -> None:
    of = full()
    of.update(0, reading(0.0, standing(0.0)))
    of.update(0, reading(0.01, standing(5.0)))
    assert of.overflow
    of.remove_person(0)
    assert not of.overflow and 0 not in of.persons


def test_overflow_ends_when_a_report_agrees_with_all_rows_of_that_person_only() -> None:
    of = full()
    for person in (0, 1):
        of.update(person, reading(0.0, standing(0.0)))
        of.update(person, reading(0.01, standing(5.0)))
    of.update(0, reading(5.0, standing(2.5)))
    assert of.overflow, "the second one is still merged"
    of.update(1, reading(5.0, standing(50.0)))
    assert of.overflow
    of.update(1, reading(50.0, standing(25.0)))
    assert not of.overflow


def test_errors_are_widened_by_every_row_that_agrees() -> None:
    """The first row never had a wrist; by the second one left and right may be exchanged."""
    of = Gate(ISO, settings())
    of.admit(report(0.0, ("a", only(standing(0.0), Point.HEAD))), 0.0)
    apart = only(standing(1.0), Point.HEAD, *WRISTS)
    for side, wrist in zip((0.015, -0.015), WRISTS, strict=True):
        apart[wrist] = 0.9, side, 1.2
    assert of.admit(report(0.01, ("a", apart)), 0.01).contradictions
    between = apart - np.array([0.5, 0.0, 0.0])
    assert not of.admit(report(0.5, ("a", between)), 0.5).contradictions and not of.contradicted
    [row] = rows_of(of, "a")
    assert of.people["e_p"][0, row, list(WRISTS)] == pytest.approx(0.03 + E_P)


def test_a_new_row_and_a_cleared_one_claim_nothing(rng: np.random.Generator) -> None:
    of = filled(rng, [0, 1, 2])
    of.remove_person(1)
    of.add_person(5)
    row = of.people[0]
    assert row["person"][2] == 5 and row["present"][2] == 0
    assert np.isnan(row["xyz"][2]).all() and np.isnan(row["t_obs"][2]).all() and np.isnan(row["e_p"][2]).all()
    assert np.isinf(row["e_v"][2]).all() and not row["v"][2].any() and not of._history["n"][0, 2].any()


def test_only_points_of_one_instant_are_kept_and_no_velocity() -> None:
    of = Hypotheses(TUM.limits, MAX_PEOPLE, clock_error_s=0.0, stamp_error_s=0.0)
    of.add_person(0)
    for i in range(20):
        of.update(0, reading(0.01 * i, standing(0.0)))
    of.update(0, reading(0.2, only(standing(0.0), *WRISTS)))
    assert np.isfinite(of.people["e_v"][0, 0]).all()
    of.keep_only(0, 0.2)
    row = of.people[0]
    assert row["present"][0] == mask(*WRISTS) and np.isinf(row["e_v"][0]).all()
    gone = [point for point in Point if point not in WRISTS]
    for name in ("t_obs", "xyz", "e_p"):
        assert np.isnan(row[name][0][gone]).all() and np.isfinite(row[name][0][list(WRISTS)]).all()
    assert len(gone) == MAX_POINTS - 2
    before = of.people.tobytes()
    of.keep_only(0, 0.3)
    assert of.people.tobytes() == before, "nothing was seen then"


def test_who_agrees_is_asked_of_every_row() -> None:
    of = Hypotheses(ISO.limits, 4, clock_error_s=0.0, stamp_error_s=0.0)
    for person in (0, 1):
        of.add_person(person)
    of.update(1, reading(0.0, standing(9.0)))
    of.update(0, reading(0.0, standing(0.0)))
    of.update(0, reading(0.01, standing(5.0)))
    before = of.people.copy()
    here, nowhere, far = (
        reading(0.02, standing(5.0)),
        reading(0.02, standing(50.0)),
        reading(5.0, standing(2.5)),
    )
    assert [of.may_be(0, each) for each in (here, nowhere, far)] == [True, False, True]
    assert [of.agrees(0, each) for each in (here, nowhere, far)] == [False, False, True]
    assert [of.who_may_be(before, each) for each in (here, nowhere, far)] == [{0}, set(), {0, 1}]
    of.update(0, reading(0.03, standing(50.0)))
    assert of.who_may_be(before, reading(0.04, standing(50.0))) == set(), "as it was before"


def test_rows_of_others_stay_when_three_rows_become_one() -> None:
    of = Hypotheses(ISO.limits, 4, clock_error_s=0.0, stamp_error_s=0.0)
    of.add_person(0)
    for i, x in enumerate((0.0, 2.0, 4.0)):
        of.update(0, reading(0.01 * i, standing(x)))
    for person in (1, 2):
        of.add_person(person)
        of.update(person, reading(0.05, standing(9.0 + person)))
    assert of.people["person"][0, :5].tolist() == [0, 0, 0, 1, 2] and of.contradicted
    of.update(0, reading(3.0, standing(2.5)))
    assert of.people["person"][0, : of.people["n"][0]].tolist() == [0, 1, 2] and not of.contradicted
    assert of.people["xyz"][0, :3, Point.PELVIS, 0].tolist() == [2.5, 10.0, 11.0]


@pytest.mark.parametrize("places", [(0.0, 5.0), (5.0, 0.0), (5.0, 4.9), (4.9, 5.0)])
def test_what_disagrees_with_several_rows_is_held_against_the_farthest(places: tuple[float, float]) -> None:
    of = Hypotheses(ISO.limits, 4, clock_error_s=0.0, stamp_error_s=0.0)
    of.add_person(0)
    for i, x in enumerate(places):
        of.update(0, reading(0.01 * i, standing(x)))
    assert of.people["n"][0] == 2
    found = of.update(0, reading(0.5, standing(50.0)))
    assert found is not None
    elapsed, distance = max(((0.5 - 0.01 * i, 50.0 - x) for i, x in enumerate(places)), key=_beyond)
    assert found.distance_m == pytest.approx(distance) and found.elapsed_s == pytest.approx(elapsed)
    assert found.allowed_m == pytest.approx(2.0 * elapsed + 2.0 * E_P)


def _beyond(pair: tuple[float, float]) -> float:
    elapsed, distance = pair
    return distance - 2.0 * elapsed
