"""People larger than the profile has them: seen in one report, and not forgotten before seen again."""

from __future__ import annotations

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.conformance import LaterSamples, later_too_large
from occupancy.measurement import Gate
from occupancy.region import Monitored, Region
from tests.occupancy.people import ALL_POINTS, mask, only, report, rows_of, settings, standing

Array = np.ndarray
ISO = load_profile("iso")
E_P = 0.01
FOREARM, UPPER_ARM = 0.146 * 1.9, 0.196 * 1.9
ARM = (Point.R_SHOULDER, Point.R_ELBOW, Point.R_WRIST)
HAND = (Point.R_HAND, Point.R_FINGERTIP)


def stretched(upper: float, lower: float) -> Array:
    """Somebody whose right arm hangs down, with limbs of these lengths [m]."""
    xyz = standing()
    for point, below in zip(ARM[1:], (upper, upper + lower), strict=True):
        xyz[point] = xyz[Point.R_SHOULDER] - [0.0, 0.0, below]
    xyz[list(HAND)] = np.nan
    return xyz


def gate(*monitored: Monitored, **changes: object) -> Gate:
    return Gate(ISO, settings(monitored=monitored, position_error_m=E_P, **changes))


@pytest.mark.parametrize(("more", "too_large"), [(2.0 * E_P - 1e-6, False), (2.0 * E_P + 1e-6, True)])
def test_a_limb_may_be_as_long_as_the_longest_and_both_errors(more: float, too_large: bool) -> None:
    of = gate()
    found = of.admit(report(1.0, ("a", stretched(0.3, FOREARM + more))), 1.0)
    assert not found.refusals and bool(found.contradictions) is too_large is of.contradicted
    assert tuple(of.outsized) == (("a",) if too_large else ())
    if too_large:
        (one,) = found.contradictions
        assert {one.point, one.earlier} == {Point.R_ELBOW, Point.R_WRIST} and one.elapsed_s == 0.0
        assert one.distance_m == pytest.approx(FOREARM + more)
        assert one.allowed_m == pytest.approx(FOREARM + 2.0 * E_P)
        assert len(rows_of(of, "a")) == 1, "what was read is kept"


def test_limbs_that_are_possible_one_by_one_may_not_be_together() -> None:
    of = gate()
    more = 1.9 * E_P
    (one,) = of.admit(report(1.0, ("a", stretched(UPPER_ARM + more, FOREARM + more))), 1.0).contradictions
    assert {one.point, one.earlier} == {Point.R_SHOULDER, Point.R_WRIST}


def test_it_is_over_when_both_points_were_seen_in_one_later_report() -> None:
    large, usual = stretched(0.3, 0.35), stretched(0.3, 0.25)
    of = gate()
    for stamp, xyz, outsized in (
        (1.0, usual, ()),
        (2.0, large, ("a",)),
        (3.0, only(usual, Point.HEAD, Point.PELVIS), ("a",)),
        (4.0, only(usual, Point.HEAD, Point.R_ELBOW), ("a",)),
        (4.5, only(usual, Point.R_WRIST, Point.R_SHOULDER), ("a",)),
        (5.0, usual, ()),
        (6.0, only(large, Point.R_ELBOW, Point.R_WRIST), ("a",)),
        (7.0, only(usual, Point.R_ELBOW), ("a",)),
        (8.0, only(usual, Point.R_WRIST), ("a",)),
        (9.0, only(usual, Point.R_ELBOW, Point.R_WRIST), ()),
    ):
        of.admit(report(stamp, ("a", xyz + 1e-4 * stamp)), stamp)
        assert tuple(of.outsized) == outsized, stamp
        assert of.contradicted is bool(outsized)


def test_everybody_counts_for_themselves() -> None:
    of = gate()
    far = stretched(0.3, 0.35) + np.array([5.0, 0.0, 0.0])
    of.admit(report(1.0, ("a", stretched(0.3, 0.25)), ("b", far)), 1.0)
    assert tuple(of.outsized) == ("b",)
    of.admit(report(2.0, ("a", stretched(0.3, 0.26))), 2.0)
    assert tuple(of.outsized) == ("b",)


def test_who_has_left_is_not_too_large_any_more() -> None:
    of = gate(Monitored("cell", Region.box([-5.0, -5.0, -5.0], [1.5, 5.0, 5.0]), 0.05))
    of.admit(report(1.0, ("a", stretched(0.3, 0.35)))._replace(complete=True), 1.0)
    assert tuple(of.outsized) == ("a",)
    gone = of.admit(report(1.02)._replace(complete=True), 1.02)
    assert gone.left == ("a",) and of.outsized == {} and not of.contradicted


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_second_camera_counts_though_its_stamps_do_not_advance(order: tuple[int, int]) -> None:
    """Each shows other points, and agrees with what the other one said: only one report shows the forearm."""
    whole = stretched(0.3, 0.35)
    shown = only(whole, Point.HEAD, Point.PELVIS), only(whole, Point.R_ELBOW, Point.R_WRIST)
    of = gate()
    for stamp in (1.0, 1.02):
        for number in order:
            of.admit(report(stamp, ("a", shown[number] + 1e-4 * stamp)), stamp)
        assert of.outsized == {"a": (Point.R_ELBOW, Point.R_WRIST)} and of.contradicted


@pytest.mark.parametrize("order", [(0.25, 0.35), (0.35, 0.25)])
def test_one_who_is_listed_twice_is_as_large_as_the_larger(order: tuple[float, float]) -> None:
    of = gate()
    of.admit(report(1.0, *(("a", stretched(0.3, lower)) for lower in order)), 1.0)
    assert tuple(of.outsized) == ("a",)


def test_points_that_were_passed_on_are_not_held_against_new_ones() -> None:
    """An elbow that stands where it stood is not measured anew: it may have moved with the wrist."""
    of, xyz = gate(believe_repeats=False), stretched(0.3, 0.25)
    of.admit(report(1.0, ("a", xyz)), 1.0)
    moved = xyz.copy()
    moved[Point.R_WRIST, 2] -= 0.1
    of.admit(report(2.0, ("a", moved)), 2.0)
    assert of.outsized == {}


def test_later_samples_tell_as_well() -> None:
    usual, large = stretched(0.3, 0.25), stretched(0.3, 0.35)
    samples = LaterSamples(
        np.array([1.0, 2.0, 3.0]), np.array([usual, large, usual]), np.full((3, MAX_POINTS), E_P)
    )
    found = later_too_large(samples, ISO, after=1.0, until=2.0)
    assert found is not None and found.sample == 1
    assert {found.point, found.earlier} == {Point.R_ELBOW, Point.R_WRIST}
    assert found.distance_m == pytest.approx(0.35)
    assert found.allowed_m == pytest.approx(FOREARM + 2.0 * E_P)
    assert later_too_large(samples, ISO, after=2.0, until=9.0) is None
    assert later_too_large(samples, ISO, after=0.0, until=1.9) is None


def test_what_is_told_equals_a_plain_twin(rng: np.random.Generator, count) -> None:
    """Points about as far apart as anybody's, some missing, with errors of their own."""
    told = quiet = 0
    for _ in range(count(20_000)):
        xyz = standing() * rng.uniform(0.9, 1.25) + rng.normal(size=(MAX_POINTS, 3)) * rng.choice([0.0, 0.03])
        shown = [p for p in Point if rng.random() < 0.8] or [Point.HEAD]
        errors = rng.uniform(0.0, 0.05, MAX_POINTS)
        raw = report(1.0, ("a", only(xyz, *shown)))
        raw = raw._replace(people=(raw.people[0]._replace(error_m=errors, measured=ALL_POINTS),))
        of = gate()
        refused = {each.point for each in of.admit(raw, 1.0).refusals}
        read = [p for p in shown if p not in refused]
        excess = {
            (p, q): np.linalg.norm(xyz[p] - xyz[q]) - ISO.chain[p, q] - errors[p] - errors[q]
            for p in read
            for q in read
            if p < q
        }
        if min(map(abs, excess.values()), default=1.0) < 1e-7:
            continue
        too_far = {p for pair, more in excess.items() if more > 0.0 for p in pair}
        assert int(of._reading["too_far_apart"][0]) == mask(*too_far)
        assert tuple(of.outsized) == (("a",) if too_far else ())
        told, quiet = told + bool(too_far), quiet + (not too_far)
    assert told > 0 and quiet > 0, (told, quiet)


def test_what_only_rounding_makes_too_large_is_not() -> None:
    """The compiled look and the plain one may round an edge case to different sides."""
    of = gate()
    of.admit(report(1.0, ("a", stretched(0.3, 0.25))), 1.0)
    assert of._sized(0, 1.0, "a") == [] and of.outsized == {} and not of.contradicted
