"""Points that are passed on again: refused, while what was seen first keeps growing."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.humans.kernels import INFERRED, READ, REPEATED, UNCOMPARED
from occupancy.hypotheses import PLACES, READING
from occupancy.measurement import Gate, RefusalReason
from occupancy.region import Monitored, Region
from occupancy.repeats import PERSONS, Repeats
from robots.motion import Block
from tests.occupancy.people import only, report, rows_of, settings, standing

ISO = load_profile("iso")
Array = np.ndarray


def gate(**changes: object) -> Gate:
    return Gate(ISO, settings(**({"believe_repeats": False} | changes)))


def seen_at(of: Gate, point: Point, person: str = "a") -> float:
    [row] = rows_of(of, person)
    return float(of.people["t_obs"][0, row, point])


def moved(xyz: Array, *points: Point, by: float = 1e-6) -> Array:
    out = xyz.copy()
    out[list(points), 0] += by
    return out


def test_a_point_that_stands_exactly_where_it_stood_is_not_measured_anew() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    found = of.admit(report(1.1, ("a", moved(standing(), Point.L_WRIST))), 1.1)
    assert {r.reason for r in found.refusals} == {RefusalReason.REPEATED}
    assert {r.point for r in found.refusals} == set(Point) - {Point.L_WRIST}
    assert {r.value for r in found.refusals} == {1.0}
    assert seen_at(of, Point.L_WRIST) == 1.1
    assert all(seen_at(of, point) == 1.0 for point in set(Point) - {Point.L_WRIST})


def test_a_frozen_stream_grows_from_when_it_froze() -> None:
    of = gate()
    for stamp in np.arange(1.0, 3.0, 0.1):
        found = of.admit(report(float(stamp), ("a", standing())), float(stamp))
    assert len(found.refusals) == MAX_POINTS
    assert all(r.value == 1.0 and r.stamp == pytest.approx(2.9) for r in found.refusals)
    assert seen_at(of, Point.HEAD) == 1.0 and not of.contradicted


def test_one_coordinate_by_the_smallest_number_is_enough() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    nudged = standing()
    nudged[:, 2] = np.nextafter(nudged[:, 2], 9.0)
    assert of.admit(report(1.1, ("a", nudged)), 1.1).refusals == ()


def test_repeats_are_believed_where_the_settings_say_so() -> None:
    of = gate(believe_repeats=True)
    for stamp in (1.0, 1.1):
        assert of.admit(report(stamp, ("a", standing())), stamp).refusals == ()
    assert seen_at(of, Point.HEAD) == 1.1


@pytest.mark.parametrize("sources", [2, 3, PLACES])
def test_frozen_sources_that_take_turns_grow_from_when_they_froze(sources: int) -> None:
    of = gate()
    for i in range(4 * sources):
        stamp = 1.0 + 0.1 * i
        found = of.admit(report(stamp, ("a", standing(2.0 + 1e-3 * (i % sources)))), stamp)
        assert len(found.refusals) == (0 if i < sources else MAX_POINTS)
        assert {r.value for r in found.refusals} <= {1.0 + 0.1 * (i % sources)}
    assert seen_at(of, Point.HEAD) == 1.0 + 0.1 * (sources - 1) and not of.contradicted


def test_a_frozen_source_stays_known_however_much_another_one_measures() -> None:
    """What is met again is given up last: a source that is passed on at a sixteenth of the rate is known."""
    of = gate()
    for i in range(10 * PLACES):
        live = standing(2.0 + 1e-4 * (i + 1)) if i % PLACES else standing()
        found = of.admit(report(1.0 + 0.1 * i, ("a", live)), 99.0)
        assert len(found.refusals) == (MAX_POINTS if i and i % PLACES == 0 else 0)


def test_as_much_is_kept_as_the_method_says() -> None:
    """Known gaps in docs/method.md: sixteen places, and persons until 64 others were listed."""
    assert (PLACES, PERSONS) == (16, 64)


def test_what_is_compared_are_the_last_different_places_and_not_all_that_ever_were() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 99.0)
    for i in range(PLACES):
        assert of.admit(report(1.1 + 0.1 * i, ("a", standing(2.001 + 1e-4 * i))), 99.0).refusals == ()
    assert of.admit(report(9.0, ("a", standing())), 99.0).refusals == ()


def test_a_point_that_was_missing_in_between_is_still_the_same() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    of.admit(report(1.1, ("a", only(standing(2.01), Point.HEAD))), 1.1)
    found = of.admit(report(1.2, ("a", standing(2.0))), 1.2)
    assert {r.point for r in found.refusals} == set(Point) and {r.value for r in found.refusals} == {1.0}


def test_two_sensors_are_told_apart_by_their_frames_and_persons_by_their_names() -> None:
    of = gate(frames={"camera": of_camera()})
    of.admit(report(1.0, ("a", standing()), ("b", standing(4.0))), 1.0)
    other = report(1.1, ("a", standing()), frame="camera")
    assert of.admit(other, 1.1).refusals == (), "the same place, but seen by somebody else"
    assert of.admit(report(1.2, ("b", standing(4.0))), 1.2).refusals != ()
    assert len(of.admit(report(1.3, ("a", standing()), frame="camera"), 1.3).refusals) == MAX_POINTS


def of_camera() -> object:
    from occupancy.measurement import SensorFrame

    return SensorFrame()


def test_a_late_reading_that_was_not_taken_in_is_compared_with_all_the_same() -> None:
    """What is passed on at 1.1 s was seen at 0.9 s."""
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    of.admit(report(0.9, ("a", standing(2.005))), 1.0)
    found = of.admit(report(1.1, ("a", standing(2.005))), 1.1)
    assert {r.value for r in found.refusals} == {0.9} and seen_at(of, Point.HEAD) == 1.0
    assert of.admit(report(1.2, ("a", standing(2.006))), 1.2).refusals == ()


def test_a_limb_that_was_refused_is_not_measured_when_it_is_passed_on() -> None:
    """A wrist that is held while the elbow moves: refused with the elbow first, and nothing new later."""
    of = gate()
    wrong = only(standing(), Point.L_WRIST, Point.L_ELBOW, Point.HEAD)
    wrong[Point.L_ELBOW] += 5.0
    found = of.admit(report(1.0, ("a", wrong)), 1.0)
    assert {r.reason for r in found.refusals} == {RefusalReason.LIMB}
    right = moved(standing(), Point.L_ELBOW)
    found = of.admit(report(1.5, ("a", only(right, Point.L_WRIST, Point.L_ELBOW))), 1.5)
    assert [(r.point, r.reason, r.value) for r in found.refusals] == [
        (Point.L_WRIST, RefusalReason.REPEATED, 1.0)
    ]
    assert seen_at(of, Point.L_ELBOW) == 1.5


def test_what_was_inferred_is_not_measured_when_it_is_passed_on() -> None:
    """A tracker that guesses where a lost wrist is, and calls the guess measured from then on."""
    of = gate()
    of.admit(report(1.0, ("a", only(standing(), Point.HEAD))), 1.0)
    guessed = only(moved(standing(), Point.HEAD), Point.HEAD, Point.L_WRIST)
    found = of.admit(report(1.1, ("a", guessed), measured=1 << Point.HEAD), 1.1)
    assert [(r.point, r.reason) for r in found.refusals] == [(Point.L_WRIST, RefusalReason.INFERRED)]
    later = only(moved(standing(), Point.HEAD, by=2e-6), Point.HEAD, Point.L_WRIST)
    found = of.admit(report(1.5, ("a", later)), 1.5)
    assert [(r.point, r.reason, r.value) for r in found.refusals] == [
        (Point.L_WRIST, RefusalReason.REPEATED, 1.1)
    ]
    later += 1e-6
    assert of.admit(report(1.6, ("a", later)), 1.6).refusals == () and seen_at(of, Point.L_WRIST) == 1.6


def test_what_is_inferred_does_not_push_out_what_was_measured() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    for i in range(2 * PLACES):
        of.admit(report(1.1 + 0.1 * i, ("a", standing(2.0 + 1e-3 * i)), measured=0), 9.0)
    found = of.admit(report(5.0, ("a", standing())), 9.0)
    assert len(found.refusals) == MAX_POINTS and {r.value for r in found.refusals} == {1.0}


def test_what_was_measured_and_inferred_is_as_old_as_the_measurement() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    of.admit(report(1.1, ("a", standing()), measured=0), 9.0)
    found = of.admit(report(1.2, ("a", standing())), 9.0)
    assert {r.value for r in found.refusals} == {1.0}


def test_what_was_refused_for_its_error_is_not_measured_when_it_is_passed_on() -> None:
    of = gate()
    bad = report(1.0, ("a", standing()))
    bad = bad._replace(people=(bad.people[0]._replace(error_m=np.full(MAX_POINTS, -1.0)),))
    assert {r.reason for r in of.admit(bad, 1.0).refusals} == {RefusalReason.BAD_ERROR}
    found = of.admit(report(1.1, ("a", standing())), 1.1)
    assert {r.reason for r in found.refusals} == {RefusalReason.REPEATED}


def test_frozen_points_do_not_clear_a_contradiction() -> None:
    """A jump that is passed on again and again says nothing new; the place before keeps growing."""
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    for stamp in np.arange(1.1, 4.0, 0.1):
        of.admit(report(float(stamp), ("a", standing(9.0))), float(stamp))
    assert len(rows_of(of, "a")) == 2 and of.contradicted
    assert sorted(of.people["t_obs"][0, :2, Point.HEAD]) == [1.0, 1.1]


def test_a_frozen_stream_that_lists_somebody_twice_grows_from_when_it_froze() -> None:
    """Both listings agree, so that nothing contradicts: what is passed on must not count as new."""
    of = gate()
    for stamp in np.arange(1.0, 3.0, 0.1):
        both = ("a", standing()), ("a", standing(2.005))
        found = of.admit(report(float(stamp), *both), float(stamp))
    assert len(found.refusals) == 2 * MAX_POINTS and {r.value for r in found.refusals} == {1.0}
    assert seen_at(of, Point.HEAD) == 1.0 and not of.contradicted
    turned = of.admit(report(4.0, *both[::-1]), 4.0)
    assert len(turned.refusals) == 2 * MAX_POINTS, "in whatever order"


def test_a_second_listing_that_changes_is_read() -> None:
    of = gate()
    for stamp in (1.0, 1.1):
        found = of.admit(report(stamp, ("a", standing()), ("a", standing(2.005 + 0.001 * stamp))), stamp)
    assert len(found.refusals) == MAX_POINTS and seen_at(of, Point.HEAD) == 1.1


@pytest.mark.parametrize(("listings", "refused"), [(PLACES, PLACES), (PLACES + 1, 0)])
def test_sixteen_listings_of_one_report_are_kept_apart(listings: int, refused: int) -> None:
    of = gate()
    many = [("a", standing(2.0 + 1e-4 * i)) for i in range(listings)]
    for stamp in (1.0, 1.1):
        found = of.admit(report(stamp, *many), stamp)
    assert len(found.refusals) == refused * MAX_POINTS and not of.contradicted


@pytest.mark.parametrize("late", [0.5, 1.2])
def test_a_late_reading_does_not_hide_that_newer_points_are_passed_on(late: float) -> None:
    """Else what is passed on would be held against both rows as new, agree and clear the contradiction."""
    of = gate()
    for stamp, x in ((1.0, 2.0), (1.2, 2.1), (late, 9.0)):
        of.admit(report(stamp, ("a", standing(x))), 9.0)
    found = of.admit(report(5.0, ("a", standing(2.1))), 9.0)
    assert len(found.refusals) == MAX_POINTS and {r.value for r in found.refusals} == {1.2}
    assert of.contradicted and sorted(of.people["t_obs"][0, :2, Point.HEAD]) == sorted([1.2, late])


@pytest.mark.parametrize("stamps", [np.full(2 * PLACES, 5.0), np.linspace(2.0, 4.0, 2 * PLACES)])
def test_whatever_arrives_late_does_not_push_out_what_is_newer(stamps: Array) -> None:
    """With the same stamp, or with older ones that go up again."""
    of = gate()
    of.admit(report(5.0, ("a", standing())), 9.0)
    for i, late in enumerate(stamps):
        of.admit(report(float(late), ("a", standing(2.001 + 1e-4 * i))), 9.0)
    found = of.admit(report(6.0, ("a", standing())), 9.0)
    assert len(found.refusals) == MAX_POINTS and {r.value for r in found.refusals} == {5.0}


def test_what_is_late_is_judged_for_each_report() -> None:
    of = gate()
    of.admit(report(5.0, ("a", standing())), 9.0)
    of.admit(report(4.0, ("a", standing(2.001))), 9.0)
    for i in range(PLACES):
        of.admit(report(6.0 + 0.1 * i, ("a", standing(2.002 + 1e-4 * i))), 9.0)
    found = of.admit(report(8.0, ("a", standing(2.001))), 9.0)
    assert len(found.refusals) == MAX_POINTS, "what came late has places of its own"
    assert of.admit(report(8.1, ("a", standing())), 9.0).refusals == ()


def test_nobody_leaves_by_a_report_that_repeats_who_is_there() -> None:
    box = Monitored("cell", Region.box((-3.0, -3.0, -1.0), (3.0, 3.0, 3.0)), 0.1)
    of = gate(monitored=(box,))
    of.admit(report(1.0, ("a", standing(2.9)), ("b", standing(0.0))), 1.0)
    assert of.admit(report(1.1, ("b", standing(0.0))), 1.1).left == ()
    assert of.people["t_complete"] == 1.0, "the unobserved space does not start anew either"
    assert of.admit(report(1.2, ("b", standing(0.001))), 1.2).left == ("a",)


def test_who_comes_back_is_not_where_the_tracker_held_them() -> None:
    """They may have walked along the border meanwhile: then nothing was read of them yet."""
    box = Monitored("cell", Region.box((-3.0, -3.0, -1.0), (3.0, 3.0, 3.0)), 0.1)
    of = gate(monitored=(box,))
    of.admit(report(1.0, ("a", standing(2.9))), 1.0)
    assert of.admit(report(1.1), 1.1).left == ("a",)
    found = of.admit(report(5.0, ("a", standing(2.9))), 5.0)
    assert len(found.refusals) == MAX_POINTS and {r.value for r in found.refusals} == {1.0}
    [row] = rows_of(of, "a")
    assert of.people["present"][0, row] == 0 and of.people["t_complete"] == 1.1
    assert of.admit(report(5.1, ("a", standing(2.9, 2.5))), 5.1).refusals == ()
    assert seen_at(of, Point.HEAD) == 5.1 and not of.contradicted


# ------------------------------------------------------------------------------------ what is forgotten


def come_and_go(of: Gate, since: float, people: int) -> None:
    """As many others are listed one after the other, and leave."""
    for i in range(people):
        of.admit(report(since + 0.001 * i, (f"{since} {i}", standing(2.9, 0.01 * i))), 99.0)
    assert len(of.admit(report(since + 1.0), 99.0).left) == 1


def forgetful(**changes: object) -> Gate:
    box = Monitored("cell", Region.box((-3.0, -3.0, -1.0), (3.0, 3.0, 3.0)), 0.1)
    return gate(monitored=(box,), max_people=2, **changes)


@pytest.mark.parametrize(("others", "kept"), [(PERSONS - 1, True), (PERSONS, False)])
def test_who_was_forgotten_is_not_believed_to_be_where_a_tracker_held_them(others: int, kept: bool) -> None:
    of = forgetful()
    of.admit(report(1.0, ("a", standing(2.9))), 99.0)
    come_and_go(of, 2.0, others)
    for stamp in (10.0, 10.1):
        found = of.admit(report(stamp, ("a", standing(2.9))), 99.0)
        again = kept or stamp > 10.0
        reason = RefusalReason.REPEATED if again else RefusalReason.UNCOMPARED
        assert {r.reason for r in found.refusals} == {reason} and len(found.refusals) == MAX_POINTS
        assert not again or {r.value for r in found.refusals} == {1.0 if kept else 10.0}
        assert again or np.isnan([r.value for r in found.refusals]).all()
    [row] = rows_of(of, "a")
    assert of.people["present"][0, row] == 0


def test_who_was_forgotten_is_read_after_sixteen_different_places_in_every_frame() -> None:
    of = forgetful(frames={"camera": of_camera()})
    of.admit(report(1.0, ("a", standing(2.9))), 99.0)
    come_and_go(of, 2.0, PERSONS)
    for frame, since in (("world", 10.0), ("camera", 20.0)):
        for i in range(PLACES):
            stamp, xyz = since + 0.1 * i, standing(2.5 + 1e-3 * i)
            found = of.admit(report(stamp, ("a", xyz), frame=frame), 99.0)
            assert {r.reason for r in found.refusals} == {RefusalReason.UNCOMPARED}
            of.admit(report(stamp + 0.05, ("a", xyz), frame=frame), 99.0)
        found = of.admit(report(since + 2.0, ("a", standing(2.4)), frame=frame), 99.0)
        assert found.refusals == ()


def refused_as(repeats: Repeats, number: int, x: float) -> set[int]:
    """Say that a person stands at x [m]; return why points are no measurement."""
    said = reading_of(standing(x), np.full(MAX_POINTS, True))
    repeats.begin()
    repeats.refuse(number, "world", said, 1.0)
    return set(said["reason"][0].tolist())


def test_who_is_listed_again_and_again_is_not_forgotten() -> None:
    repeats = Repeats(persons=2)
    for number in range(1, 9):
        assert refused_as(repeats, 0, 2.0 + 0.1 * number) == refused_as(repeats, number, 2.0) == {READ}


def test_everybody_who_was_forgotten_is_so_in_whatever_order() -> None:
    repeats = Repeats(persons=1)
    assert [refused_as(repeats, number, 2.0) for number in (0, 1, 2)] == [{READ}] * 3
    assert [refused_as(repeats, number, 2.1) for number in (0, 1, 2, 0)] == [{UNCOMPARED}] * 4


def test_who_is_new_is_read_however_many_were_forgotten() -> None:
    of = forgetful()
    come_and_go(of, 2.0, PERSONS + 5)
    assert of.admit(report(10.0, ("new", standing(2.9))), 99.0).refusals == ()


def reading_of(xyz: Array, measured: Array) -> Block:
    """A reading (READING) of points of which some were measured, and the others inferred."""
    block = np.zeros(1, dtype=READING)
    out = block[0]
    there = np.isfinite(xyz).all(axis=1)
    out["seen"] = xyz
    out["xyz"] = np.where((there & measured)[:, None], xyz, np.nan)
    out["present"] = sum(1 << int(p) for p in np.flatnonzero(there & measured))
    out["reason"] = np.where(there & ~measured, INFERRED, READ)
    return block


def test_memory_does_not_grow_with_everybody_who_was_ever_seen() -> None:
    repeats = Repeats()
    said = reading_of(standing(), np.full(MAX_POINTS, True))

    def used(first: int, last: int) -> int:
        for number in range(first, last):
            repeats.begin()
            for frame in ("world", "camera"):
                repeats.refuse(number, frame, said.copy(), float(number))
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = used(0, 2 * PERSONS)
        assert abs(used(2 * PERSONS, 20 * PERSONS) - before) < 20_000
    finally:
        tracemalloc.stop()


class Twin:
    """What :class:`Repeats` says, in plain Python: places in the order in which they were met."""

    def __init__(self) -> None:
        self.known: dict[tuple[object, ...], dict[bytes, float]] = {}
        self.newest: dict[tuple[object, ...], float] = {}

    def refused(self, number: int, frame: str, xyz: Array, measured: Array, stamp: float) -> dict[int, float]:
        """Points that are passed on -> the stamp with which they were first seen."""
        late = stamp <= self.newest.get((number, frame), -np.inf)
        self.newest[number, frame] = max(stamp, self.newest.get((number, frame), -np.inf))
        out: dict[int, float] = {}
        for p in np.flatnonzero(np.isfinite(xyz).all(axis=1)):
            at = xyz[p].tobytes()
            lanes = [self.known.setdefault((number, frame, int(p), aside), {}) for aside in (False, True)]
            stamps = [lane[at] for lane in lanes if at in lane]
            if measured[p] and stamps:
                out[int(p)] = min(stamps)
                met = [lane for lane in lanes if at in lane]
            else:
                met = [lanes[late or not measured[p]]]
            for lane in met:
                lane[at] = lane.pop(at, stamp)
                while len(lane) > PLACES:
                    del lane[next(iter(lane))]
        return out


def passed_on(rng: np.random.Generator, persons: int, numbers: int, apart: float) -> tuple[int, int, int]:
    """Random reports of few places each; return how many points were read, refused and not compared.

    ``apart``: share of what is late or inferred.
    """
    repeats, twin = Repeats(persons), Twin()
    read = refused = uncompared = 0
    places = standing() + 1e-3 * rng.integers(0, 5, (24, 1, 3))
    for i in range(400):
        number, frame = int(rng.integers(numbers)), str(rng.choice(["world", "camera"]))
        stamp = float(i) - (50.0 if rng.random() < apart else 0.0)
        xyz = places[rng.integers(rng.choice([4, 24]), size=MAX_POINTS), range(MAX_POINTS)]
        xyz[rng.random(MAX_POINTS) < 0.2] = np.nan
        measured = rng.random(MAX_POINTS) >= apart
        said = reading_of(xyz, measured)
        repeats.begin()
        repeats.refuse(number, frame, said, stamp)
        said = said[0]
        wanted = twin.refused(number, frame, xyz, measured, stamp)
        found = {int(p): float(said["value"][p]) for p in np.flatnonzero(said["reason"] == REPEATED)}
        lost = set(np.flatnonzero(said["reason"] == UNCOMPARED).tolist())
        assert wanted.keys() <= found.keys() | lost
        if persons >= numbers:
            assert found == wanted and not lost
        kept = np.flatnonzero(np.isfinite(said["xyz"]).all(axis=1))
        assert set(kept) == set(np.flatnonzero(np.isfinite(xyz).all(axis=1) & measured)) - found.keys() - lost
        assert int(said["present"]) == sum(1 << int(p) for p in kept)
        read, refused, uncompared = read + len(kept), refused + len(found), uncompared + len(lost)
    return read, refused, uncompared


def test_what_is_refused_equals_what_a_plain_twin_refuses(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(200)):
        read, refused, uncompared = passed_on(rng, 3, 3, 0.3)
        assert read > 0 and refused > 0 and uncompared == 0


def test_nothing_is_read_that_would_be_refused_had_nobody_been_forgotten(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    told = [passed_on(rng, 2, 3, 0.0) for _ in range(count(500))]
    assert all(np.sum(told, axis=0) > 0)
