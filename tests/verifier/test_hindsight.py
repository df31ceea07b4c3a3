"""What the rest of a recording says about a cycle, piece by piece."""

from __future__ import annotations

import math

import numpy as np
import pytest

from occupancy.body import Point, load_profile
from occupancy.hypotheses import PLACES
from occupancy.measurement import Gate, GateSettings, RawMeasurement, RawPerson
from occupancy.sets import MAX_PEOPLE
from tests.verifier.scenes import ALL_POINTS, Array, person_at
from verifier.hindsight import PeopleHindsight, RobotHindsight, sightings, with_newcomers
from verifier.verdict import Reason

ISO = load_profile("iso")
STAMP_ERROR, CLOCK_ERROR, E_P = 0.003, 0.002, 0.01


def gate() -> Gate:
    return Gate(ISO, GateSettings(CLOCK_ERROR, STAMP_ERROR, E_P))


def seen(stamp: float, **people: Array | None) -> RawMeasurement:
    """A report; ``None``: a person whose points are all inferred by the tracker."""
    unstated = np.full(len(Point), np.nan)
    listed = tuple(
        RawPerson(name, person_at(9.0, 9.0), unstated, 0)
        if xyz is None
        else RawPerson(name, xyz, unstated, ALL_POINTS)
        for name, xyz in people.items()
    )
    return RawMeasurement(stamp, stamp, "world", True, listed)


def known(*reports: RawMeasurement) -> Gate:
    of = gate()
    for report in reports:
        assert not of.admit(report, report.stamp).contradictions
    return of


# ---------------------------------------------------------------------------------------------- sightings


def test_sightings_are_sorted_and_say_since_when() -> None:
    far, near = person_at(4.0, 0.0), person_at(3.9, 0.0)
    absurd = [seen(stamp, c=far) for stamp in (math.nan, -1e308, 1e308)]
    found = sightings(gate(), [seen(2.0, a=near), seen(1.0, a=far, b=None), *absurd])
    assert set(found) == {"a", "b"}
    assert (found["a"].since, found["b"].since, found["b"].samples) == (1.0, 1.0, ())
    assert found["b"].first is None
    (samples,) = found["a"].samples
    assert samples.t.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(samples.xyz[:, 0, 0], [far[0, 0], near[0, 0]])
    assert (samples.e_p == E_P).all()


def test_nobody_is_seen_later_than_their_report_arrives() -> None:
    ahead = seen(9.0, a=person_at(4.0, 0.0))._replace(arrived=1.0)
    found = sightings(gate(), [ahead])["a"]
    assert (found.since, found.samples) == (1.0, ())


def test_two_readings_of_one_stamp_are_both_kept() -> None:
    one, other = person_at(4.0, 0.0), person_at(0.5, 0.0)
    found = sightings(gate(), [seen(1.0, a=one), seen(1.0, a=other), seen(2.0, a=one)])["a"]
    assert [samples.t.tolist() for samples in found.samples] == [[1.0, 2.0], [1.0]]
    assert found.samples[1].xyz[0, 0, 0] == other[0, 0]


@pytest.mark.parametrize("sources", [1, 2, PLACES, PLACES + 1])
def test_what_is_passed_on_is_no_sighting(sources: int) -> None:
    reports = [seen(1.0 + 0.1 * i, a=person_at(4.0 + 0.01 * (i % sources), 0.0)) for i in range(3 * sources)]
    (samples,) = sightings(gate(), reports)["a"].samples
    new = [sources > PLACES or i < sources for i in range(3 * sources)]
    assert np.isfinite(samples.xyz).all(axis=(1, 2)).tolist() == new
    assert np.isfinite(samples.xyz).any(axis=(1, 2)).tolist() == new
    believing = Gate(ISO, GateSettings(CLOCK_ERROR, STAMP_ERROR, E_P, believe_repeats=True))
    (samples,) = sightings(believing, reports)["a"].samples
    assert np.isfinite(samples.xyz).all()


def test_what_was_inferred_and_is_passed_on_as_measured_is_no_sighting() -> None:
    inferred = person_at(9.0, 9.0)
    reports = [seen(1.0, a=None), seen(1.1, a=inferred), seen(1.2, a=inferred + 0.01), seen(1.3, b=None)]
    found = sightings(gate(), reports)
    (samples,) = found["a"].samples
    assert samples.t.tolist() == [1.1, 1.2] and np.isnan(samples.xyz[0]).all()
    assert np.isfinite(samples.xyz[1]).all() and found["b"].samples == ()


# -------------------------------------------------------------------------------------------------- people


def outside(moved: float, elapsed: float, *, person: str = "a", until: float = 9.0) -> Reason | None:
    """Reason found where the second of two persons was seen ``moved`` farther ``elapsed`` later."""
    start = person_at(4.0, 0.0)
    of = known(seen(1.0, other=person_at(-4.0, 0.0), a=start))
    later = seen(1.0 + elapsed, **{person: start + np.array([moved, 0.0, 0.0])})
    found = PeopleHindsight(ISO, None).check(
        of.people, of.person_ids, sightings(of, [later]), np.array([1.0]), (1.0, until)
    )
    return None if found is None else found.reason


def test_a_person_is_outside_by_the_millimetre() -> None:
    allowed = 2.0 * (0.2 + 2.0 * (STAMP_ERROR + CLOCK_ERROR)) + 2.0 * E_P
    assert outside(allowed - 1e-3, 0.2) is None
    assert outside(allowed + 1e-3, 0.2) is Reason.PERSON_OUTSIDE_PREDICTION
    assert outside(allowed + 1e-3, 0.2, until=1.19) is None
    assert outside(allowed + 1e-3, 0.2, until=1.2) is Reason.PERSON_OUTSIDE_PREDICTION
    assert outside(3.0, 0.2, person="somebody else") is None


def test_a_sample_right_after_the_newest_report_counts_and_the_report_itself_does_not() -> None:
    assert outside(3.0, 0.001) is Reason.PERSON_OUTSIDE_PREDICTION
    assert outside(3.0, 0.0) is None


def test_every_series_and_every_row_is_looked_at() -> None:
    start = person_at(4.0, 0.0)
    of = known(seen(1.0, a=start))
    later = [seen(1.2, a=start), seen(1.2, a=start + np.array([3.0, 0.0, 0.0]))]
    found = PeopleHindsight(ISO, None).check(
        of.people, of.person_ids, sightings(of, later), np.array([1.0]), (1.0, 9.0)
    )
    assert found is not None and found.reason is Reason.PERSON_OUTSIDE_PREDICTION


@pytest.mark.parametrize(("now", "found"), [(1.2, True), (1.3, False)])
@pytest.mark.parametrize(("stamp", "x"), [(0.99, 0.9), (1.0, 0.9), (0.5, 2.9)])
def test_what_comes_late_and_was_seen_before_counts_until_it_has_come(
    now: float, found: bool, stamp: float, x: float
) -> None:
    """A second sensor is slow: at 1.3 s it says where somebody was whom the first saw elsewhere at 1.0 s."""
    late = seen(stamp, a=person_at(x, 0.0))._replace(arrived=1.3)
    of, reports = known(seen(1.0, a=person_at(4.0, 0.0))), [seen(1.0, a=person_at(4.0, 0.0)), late]
    later = sightings(of, reports)
    finding = PeopleHindsight(ISO, None).check(of.people, of.person_ids, later, np.array([1.0]), (now, 2.0))
    assert (finding is not None) is found
    if finding is not None:
        assert finding.reason is Reason.PERSON_OUTSIDE_PREDICTION and finding.t == stamp


def test_what_comes_late_and_agrees_contradicts_nothing() -> None:
    late = seen(0.9, a=person_at(3.81, 0.0))._replace(arrived=1.3)
    of, reports = known(seen(1.0, a=person_at(4.0, 0.0))), [seen(1.0, a=person_at(4.0, 0.0)), late]
    later = sightings(of, reports)
    ((samples, arrived),) = later["a"].late
    assert samples.t.tolist() == [0.9] and arrived.tolist() == [1.3]
    stamps = np.array([1.0])
    assert PeopleHindsight(ISO, None).check(of.people, of.person_ids, later, stamps, (1.2, 2.0)) is None


def test_what_comes_in_order_is_never_late(rng: np.random.Generator) -> None:
    """Against the definition: some other reading of the person was seen no earlier and had come by then."""
    for _ in range(200):
        stamps = np.round(rng.uniform(1.0, 2.0, 8), 1)
        came = stamps + rng.choice([0.0, 0.05, 0.5], 8)
        reports = [
            seen(stamp, a=person_at(4.0 + 0.01 * i, 0.0))._replace(arrived=at)
            for i, (stamp, at) in enumerate(zip(stamps.tolist(), came.tolist(), strict=True))
        ]
        expected = sorted(
            (stamps[i], came[i])
            for i in range(8)
            if any(stamps[j] >= stamps[i] and came[j] <= came[i] for j in range(8) if j != i)
        )
        late = sightings(gate(), reports)["a"].late
        found = sorted(pair for samples, at in late for pair in zip(samples.t, at, strict=True))
        assert found == expected


@pytest.mark.parametrize(
    ("stamps", "until", "gap"),
    [
        ([1.0, 1.2, 1.4], 1.6, None),
        ([1.0, 1.2, 1.6], 1.7, 0.4),  # between two reports
        ([1.0, 1.5, 1.6], 1.7, 0.5),  # after the newest report of the cycle
        ([1.0, 1.2], 1.7, 0.5),  # before the robot has stopped
        ([1.0, 1.2, 1.45], 1.45, None),  # a report at the very end
        ([0.2, 1.0, 1.2], 1.4, None),  # before the newest report: an earlier cycle's business
        ([1.0], 1.2, None),
        ([1.0], 1.31, 0.31),
    ],
)
def test_silences(stamps: list[float], until: float, gap: float | None) -> None:
    # the person "old" was last seen long before: the newest report of anybody counts
    of = known(seen(0.2, old=person_at(-4.0, 0.0)), seen(1.0, a=person_at(4.0, 0.0)))
    found = PeopleHindsight(ISO, 0.3).check(of.people, of.person_ids, {}, np.array(stamps), (1.0, until))
    if gap is None:
        assert found is None
    else:
        assert found is not None and found.reason is Reason.PEOPLE_STREAM_GAP
        assert f"{gap:.3f} s; declared: at most 0.300 s" in found.text


# ----------------------------------------------------------------------------------------------- newcomers


def test_newcomers_get_a_row_with_their_first_sighting() -> None:
    of = known(seen(1.0, a=person_at(4.0, 0.0)))
    new = person_at(3.0, 1.0)
    new[Point.L_HAND] = np.nan
    reports = [seen(1.1, b=None), seen(1.3, b=new), seen(1.4, b=person_at(2.0, 1.0)), seen(2.0, late=new)]
    wider = with_newcomers(of.people, of.person_ids, sightings(of, reports), 1.2)
    assert wider is not None and wider.ids == ("a", "b") and not wider.overflow
    rows = wider.people[0]
    assert rows["n"] == 2 and of.people["n"][0] == 1
    assert rows["person"][1] == 1
    assert rows["present"][1] == ALL_POINTS & ~(1 << Point.L_HAND)
    there = [p for p in Point if p is not Point.L_HAND]
    np.testing.assert_array_equal(rows["xyz"][1][there], new[there])
    assert (rows["e_p"][1][there] == E_P).all()
    assert rows["t_obs"][1][there].tolist() == [1.3 - STAMP_ERROR] * len(there)
    assert math.isnan(rows["t_obs"][1][Point.L_HAND])
    assert math.isinf(rows["e_v"][1].min())


def test_a_newcomer_of_whom_nothing_was_read_could_be_anywhere() -> None:
    of = known(seen(1.0, a=person_at(4.0, 0.0)))
    wider = with_newcomers(of.people, of.person_ids, sightings(of, [seen(1.1, b=None)]), 1.2)
    assert wider is not None and wider.people["n"][0] == 2 and wider.people["present"][0, 1] == 0


def test_nobody_is_new_who_is_known_or_is_listed_later() -> None:
    of = known(seen(1.0, a=person_at(4.0, 0.0)))
    reports = [seen(1.1, a=person_at(4.0, 0.0)), seen(1.3, b=person_at(3.0, 0.0))]
    assert with_newcomers(of.people, of.person_ids, sightings(of, reports), 1.2999) is None
    assert with_newcomers(of.people, of.person_ids, sightings(of, reports), 1.3) is not None


@pytest.mark.parametrize("number", [MAX_PEOPLE - 1, MAX_PEOPLE])
def test_newcomers_without_a_row_are_told(number: int) -> None:
    of = known(seen(1.0, a=person_at(4.0, 0.0)))
    crowd = seen(1.1, **{f"p{i}": person_at(4.0, float(i)) for i in range(number)})
    wider = with_newcomers(of.people, of.person_ids, sightings(of, [crowd]), 1.2)
    assert wider is not None and wider.overflow is (number > MAX_PEOPLE - 1)
    assert wider.people["n"][0] == MAX_PEOPLE and len(wider.ids) == number + 1


# --------------------------------------------------------------------------------------------------- robot


def robot(
    t: Array, residual: Array | None = None, covers: tuple[float, float] = (-math.inf, math.inf)
) -> RobotHindsight:
    off = np.zeros((len(t), 2)) if residual is None else residual
    return RobotHindsight(t, covers, off, np.array([0.01, 0.02]), ("one", "two"), 0.15)


@pytest.mark.parametrize(
    ("since", "until", "found"),
    [
        (0.0, 0.39, None),
        (0.0, 0.4, "gap"),  # the plan reaches the instant after which nothing is known
        (0.5, 0.55, "gap"),  # it lies within
        (0.6, 0.9, "gap"),  # it begins with the sample that ends the gap
        (0.6001, 0.9, None),
    ],
)
def test_gaps_between_samples(since: float, until: float, found: str | None) -> None:
    t = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9])
    answer = robot(t).check(since, until)
    assert (answer is None) is (found is None)
    if answer is not None:
        assert answer.reason is Reason.ROBOT_STREAM_GAP and "0.200 s; allowed: 0.150 s" in answer.text


def test_gaps_at_the_edges_of_what_samples_should_cover() -> None:
    t = np.arange(1.0, 2.05, 0.1)
    assert robot(t, covers=(0.9, 2.1)).check(0.9, 2.1) is None
    assert robot(t, covers=(0.5, 2.1)).check(0.6, 0.7) is not None
    assert robot(t, covers=(0.5, 2.1)).check(1.2, 2.1) is None
    assert robot(t, covers=(0.9, 5.0)).check(1.2, 1.9) is None
    assert robot(t, covers=(0.9, 5.0)).check(3.0, 3.1) is not None
    assert robot(np.zeros(0), covers=(0.0, 30.0)).check(3.0, 3.1) is not None


@pytest.mark.parametrize(("joint", "bound"), [(0, 0.01), (1, 0.02)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_joint_off_the_path_is_enough(joint: int, bound: float, sign: float) -> None:
    t = np.arange(0.0, 1.0, 0.1)
    residual = np.zeros((len(t), 2))
    residual[5, joint] = sign * bound
    assert robot(t, residual).check(0.0, 0.9) is None
    residual[5, joint] = sign * (bound + 1e-6)
    found = robot(t, residual).check(0.0, 0.9)
    assert found is not None and found.reason is Reason.ROBOT_OUTSIDE_TRACKING
    assert found.text.startswith(("one", "two")[joint]) and found.t == t[5]
    assert robot(t, residual).check(t[5], 0.9) is not None
    assert robot(t, residual).check(0.0, t[5]) is not None
    assert robot(t, residual).check(0.0, 0.49) is None
    assert robot(t, residual).check(0.51, 0.9) is None


def test_what_is_not_a_number_is_off_the_path() -> None:
    t = np.arange(0.0, 1.0, 0.1)
    residual = np.zeros((len(t), 2))
    residual[5, 1] = math.nan
    assert robot(t, residual).check(0.0, 0.9) is not None
