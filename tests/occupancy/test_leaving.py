"""Who has left: cases one by one, and a crowd that walks in and out while ids change and reports are late."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Part, Point, load_profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.measurement import Gate, RawMeasurement, RefusalReason
from occupancy.region import Monitored, Region
from occupancy.sets import new_people_sets
from robots.motion import Block
from tests.occupancy.moving_people import HANDS, SEGMENTS, each_outside, unit
from tests.occupancy.people import only, report, rows_of, settings, standing
from tests.occupancy.test_iso13855 import slices

ISO = load_profile("iso")
Array = np.ndarray
BOX = Region.box((-3.0, -3.0, -1.0), (3.0, 3.0, 3.0))
CELL = Monitored("cell", BOX, 0.1)
NOTHING_READ = np.full((MAX_POINTS, 3), np.nan)
MIDDLE, BORDER, AWAY = standing(0.0), standing(2.9), standing(5.0)


def gate(*monitored: Monitored, **changes: object) -> Gate:
    return Gate(ISO, settings(monitored=monitored, **changes))


def seen(at: Gate, stamp: float, *people: tuple[str, Array], complete: bool = True) -> tuple[str, ...]:
    """Admit a report; return who has left."""
    return at.admit(report(stamp, *people)._replace(complete=complete), max(stamp, 9.0)).left


def present(at: Gate) -> set[str]:
    return {at.person_ids[k] for k in at.people["person"][0, : at.people["n"][0]]}


# ------------------------------------------------------------------------------------------------- removed


@pytest.mark.parametrize("xyz", [BORDER, AWAY], ids=["border", "away"])
def test_who_may_have_left_goes_into_the_unobserved_space(xyz: Array) -> None:
    of = gate(CELL)
    assert seen(of, 1.0, ("a", xyz), ("b", MIDDLE)) == ()
    assert seen(of, 1.02, ("b", MIDDLE)) == ("a",)
    assert present(of) == {"b"} and of.left == {"a": 1.02}
    assert of.people["unlisted"] == 1 and of.people["t_complete"] == 1.02
    assert not of.contradicted


def test_ghost_of_a_changed_id_goes() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE)) == ("a",)
    assert present(of) == {"b"} and not of.contradicted


def test_ghost_goes_although_the_new_id_was_known_from_an_incomplete_report() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE), complete=False) == ()
    assert present(of) == {"a", "b"}
    assert seen(of, 1.04, ("b", MIDDLE)) == ("a",)


@pytest.mark.parametrize("one", [BORDER, MIDDLE], ids=["border", "middle"])
def test_person_with_two_hypotheses_goes_with_both(one: Array) -> None:
    """By one of them they need not be inside, and which of them holds is not known."""
    of = gate(CELL)
    seen(of, 1.0, ("a", one), ("b", standing(0.0, 1.0)))
    seen(of, 1.01, ("a", AWAY), ("b", standing(0.0, 1.0)))
    assert len(rows_of(of, "a")) == 2 and of.contradicted
    assert seen(of, 1.03, ("b", standing(0.0, 1.0))) == ("a",)
    assert of.people["n"] == 1 and not of.contradicted


def test_merged_hypotheses_go_and_the_overflow_with_them() -> None:
    of = gate(CELL, max_people=16)
    for k in range(16):
        seen(of, 1.0, (f"p{k}", standing(-2.0, 0.1 * k)), complete=False)
    seen(of, 1.01, ("p0", standing(50.0)), complete=False)
    assert of.overflow
    everybody_else = [(f"p{k}", standing(-2.0, 0.1 * k)) for k in range(1, 16)]
    assert seen(of, 1.02, *everybody_else) == ("p0",)
    assert not of.overflow and of.people["n"] == 15


def test_room_is_there_again_after_somebody_left() -> None:
    of = gate(CELL, max_people=2)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE), ("c", AWAY)) == ("a",)
    assert of.overflow, "c got no row yet"
    assert seen(of, 1.04, ("b", MIDDLE), ("c", AWAY)) == ()
    assert present(of) == {"b", "c"} and not of.overflow


def test_overflow_stays_while_somebody_listed_cannot_be_read() -> None:
    of = gate(CELL, max_people=2)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE), ("c", AWAY))
    assert of.overflow
    seen(of, 1.02, ("a", BORDER), ("b", NOTHING_READ))
    assert of.overflow
    seen(of, 1.04, ("a", BORDER), ("b", MIDDLE))
    assert not of.overflow


# --------------------------------------------------------------------------------------------- not removed


def test_without_a_region_nobody_leaves_and_nothing_else_is_demanded() -> None:
    of = gate()
    seen(of, 1.0, ("a", AWAY))
    assert seen(of, 1.02) == ()
    assert present(of) == {"a"} and of.people["unlisted"] == 0 and not of.people["t_complete"] > -math.inf


@pytest.mark.parametrize("complete", [False, "false", "no", "true", 1, 1.0, math.nan, np.bool_(False)])
def test_incomplete_report_removes_nobody_and_starts_nothing(complete: object) -> None:
    """Only a truth value says that a report is complete: a text or number from a file does not."""
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE), complete=complete) == ()
    assert present(of) == {"a", "b"} and of.people["t_complete"] == 1.0
    assert seen(of, 1.04, ("b", MIDDLE), complete=np.bool_(True)) == ("a",)


def refused(stamp: float) -> RawMeasurement:
    return report(stamp, ("b", MIDDLE), frame="nowhere")


def test_report_that_is_not_usable_removes_nobody() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    for raw, now in (
        (refused(1.02), 9.0),
        (report(9.5, ("b", MIDDLE)), 9.0),
        (report(math.nan, ("b", MIDDLE)), 9.0),
        (report(1.02, ("b", MIDDLE))._replace(arrived=9.5), 9.0),
    ):
        assert of.admit(raw, now).left == ()
    assert present(of) == {"a", "b"} and of.people["t_complete"] == 1.0


def test_person_in_the_middle_does_not_vanish() -> None:
    """A5 is contradicted: they must be listed, and nobody who is listed can be them. It does not heal."""
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE), ("b", BORDER))
    assert seen(of, 1.02, ("b", BORDER)) == ()
    assert present(of) == {"a", "b"} and of.contradicted and of.vanished == ("a",)
    assert seen(of, 1.5) == ("b",)
    assert seen(of, 8.0) == () and of.vanished == ("a",)
    seen(of, 8.1, ("a", MIDDLE), complete=False)
    assert not of.contradicted and of.vanished == ()


@pytest.mark.parametrize("order", [1, -1])
def test_the_order_in_which_people_are_listed_does_not_matter(order: int) -> None:
    """What a is now says nothing about whom b may have been: readings are compared with what was before."""
    of = gate(CELL)
    seen(of, 1.0, ("missing", standing(0.0)), ("a", standing(0.04)))
    listed = [("a", standing(0.02)), ("b", standing(0.07))]
    assert seen(of, 1.02, *listed[::order]) == ("missing",) and of.vanished == ()


@pytest.mark.parametrize("stamp", [0.9, 1.01, 1.02])
def test_a_late_report_from_before_does_not_explain_who_is_missing(stamp: float) -> None:
    """What was seen before the complete report says nothing about who is missing in that one."""
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE), ("b", MIDDLE + 1.0))
    assert seen(of, 1.02, ("b", MIDDLE + 1.0)) == () and of.vanished == ("a",)
    seen(of, stamp, ("a", MIDDLE), complete=False)
    assert of.contradicted and of.vanished == ("a",)
    seen(of, 1.03, ("a", MIDDLE), complete=False)
    assert not of.contradicted and of.vanished == ()


def test_vanished_person_goes_once_somebody_listed_can_be_them() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    assert seen(of, 1.02) == () and of.vanished == ("a",)
    assert seen(of, 1.2, ("z", standing(0.2))) == ("a",)
    assert of.vanished == () and not of.contradicted


def test_who_came_in_within_the_detection_time_need_not_be_listed() -> None:
    """Certainly inside now, but not throughout the detection time: the front covers them."""
    deep = standing(2.0)
    for detection, left in ((0.1, ()), (1.0, ("a",))):
        of = gate(Monitored("cell", BOX, detection))
        seen(of, 1.0, ("a", deep))
        assert seen(of, 1.02) == left


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ({}, ()),
        ({"position_error_m": 0.8}, ("a",)),
        ({"clock_error_s": 0.2}, ("a",)),
        ({"stamp_error_s": 0.2}, ("a",)),
    ],
)
def test_errors_make_it_less_certain_that_somebody_is_inside(
    change: dict[str, float], left: tuple[str, ...]
) -> None:
    of = gate(CELL, **change)
    seen(of, 1.0, ("a", standing(2.1)))
    assert seen(of, 1.02) == left


def test_the_border_is_known_within_its_error() -> None:
    for error, left in ((0.0, ()), (0.8, ("a",))):
        of = gate(Monitored("cell", BOX, 0.1, boundary_error_m=error))
        seen(of, 1.0, ("a", standing(2.1)))
        assert seen(of, 1.02) == left


def test_one_point_in_one_region_is_enough() -> None:
    """The wrist is in none, and the head in the second one."""
    other = Monitored("other", Region.box((7.0, -3.0, -1.0), (13.0, 3.0, 3.0)), 0.1)
    spread = only(standing(10.0), Point.HEAD, Point.L_WRIST)
    spread[Point.L_WRIST, 0] = 14.0
    of = gate(CELL, other)
    seen(of, 1.0, ("a", spread))
    assert seen(of, 1.02) == () and of.vanished == ("a",)


def test_unmeasured_person_stays() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", NOTHING_READ), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE)) == ()
    assert present(of) == {"a", "b"}


def test_nobody_goes_while_somebody_listed_cannot_be_read() -> None:
    """The one without points may be the one who is missed; the front does not start anew either."""
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE), ("c", NOTHING_READ)) == ()
    assert seen(of, 1.025, ("c", NOTHING_READ), ("b", MIDDLE)) == ()
    assert seen(of, 1.03, ("b", NOTHING_READ)) == ()
    assert of.people["t_complete"] == 1.0 and present(of) == {"a", "b", "c"}


def test_report_that_lists_an_id_twice_is_no_roll_call() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE), ("b", MIDDLE)) == ()
    assert of.people["t_complete"] == 1.0


def test_older_complete_report_changes_nothing() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    seen(of, 1.04, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE)) == ()
    assert of.people["t_complete"] == 1.04 and present(of) == {"a", "b"}


def test_a_second_complete_report_of_one_instant_is_no_newer_one() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    assert seen(of, 1.02) == () and of.vanished == ("a",)
    assert seen(of, 1.02, ("z", standing(0.02))) == () and of.vanished == ("a",)
    assert seen(of, 1.04, ("z", standing(0.02))) == ("a",)


def test_nobody_goes_by_a_report_that_is_older_than_what_others_say() -> None:
    """Whoever goes was seen before the report, and so was everybody whom it lists."""
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    seen(of, 1.05, ("a", BORDER), complete=False)
    assert seen(of, 1.03, ("b", MIDDLE)) == ()
    assert of.people["t_complete"] == 1.03
    seen(of, 1.08, ("b", MIDDLE), complete=False)
    assert seen(of, 1.07, ("b", MIDDLE)) == ()
    assert seen(of, 1.075, ("b", MIDDLE), ("c", AWAY)) == (), "whoever else is listed"
    assert present(of) == {"a", "b", "c"}
    assert seen(of, 1.09, ("b", MIDDLE), ("c", AWAY)) == ("a",)


def test_nobody_goes_who_was_seen_elsewhere_at_the_same_instant() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    seen(of, 1.02, ("a", BORDER), complete=False)
    assert seen(of, 1.02, ("b", MIDDLE)) == () and present(of) == {"a", "b"}


def test_a_late_reading_that_contradicts_makes_nobody_seen_earlier() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    seen(of, 1.05, ("a", BORDER), complete=False)
    seen(of, 0.5, ("a", AWAY), complete=False)
    assert len(rows_of(of, "a")) == 2
    assert seen(of, 1.03, ("b", MIDDLE)) == () and present(of) == {"a", "b"}


# ------------------------------------------------------------------------------- two as one, and one as two


def test_one_reading_stands_for_one_body() -> None:
    """Two side by side, of whom a tracker makes one: whoever is left out is missing, near as the other is."""
    of = gate(CELL)
    beside = standing(0.0, 0.03)
    seen(of, 1.0, ("a", MIDDLE), ("b", beside))
    assert seen(of, 1.02, ("a", 0.5 * (MIDDLE + beside))) == ()
    assert present(of) == {"a", "b"} and of.contradicted and of.vanished == ("b",)
    assert seen(of, 1.04, ("a", MIDDLE), ("b", beside)) == () and of.vanished == ()


def test_two_of_three_are_enough_for_two_bodies_only() -> None:
    of = gate(CELL)
    three = [(name, standing(0.0, 0.01 * i)) for i, name in enumerate("abc")]
    seen(of, 1.0, *three)
    assert seen(of, 1.02, ("y", standing(0.0, 0.0)), ("z", standing(0.0, 0.01))) == ()
    assert set(of.vanished) == {"a", "b", "c"}, "any of them may be the one who is not listed"
    others = [(name, xyz) for name, (_, xyz) in zip("uvw", three, strict=True)]
    assert seen(of, 1.04, *others) == ("a", "b", "c", "y", "z")
    assert not of.contradicted


def test_readings_are_shared_out_so_that_everybody_has_one() -> None:
    """y can be a or b, z can only be a: so y is b."""
    of = gate(CELL)
    seen(of, 1.0, ("a", standing(0.0, 0.0)), ("b", standing(0.0, 0.1)))
    assert seen(of, 1.02, ("y", standing(0.0, 0.05)), ("z", standing(0.0, -0.05))) == ("a", "b")


def test_second_name_of_somebody_is_no_second_body() -> None:
    """A ghost in the middle, where nobody can have come in: it may go again."""
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    seen(of, 1.02, ("a", standing(0.001)), ("ghost", standing(0.002)))
    assert present(of) == {"a", "ghost"}
    assert seen(of, 1.04, ("a", standing(0.003))) == ("ghost",)
    assert not of.contradicted


def test_whoever_may_have_come_in_is_no_second_name() -> None:
    of = gate(CELL)
    edge = standing(2.0)
    seen(of, 1.0, ("a", edge))
    seen(of, 1.7, ("a", edge), ("b", edge))
    assert seen(of, 1.72, ("a", edge)) == () and of.vanished == ("b",)


def test_ghost_far_from_everybody_is_somebody() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    seen(of, 1.02, ("a", MIDDLE), ("b", standing(0.5)))
    assert seen(of, 1.04, ("a", MIDDLE)) == () and of.vanished == ("b",)


def test_second_name_becomes_the_body_when_the_first_one_goes() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", MIDDLE))
    seen(of, 1.02, ("a", MIDDLE), ("b", MIDDLE))
    assert seen(of, 1.04, ("b", MIDDLE)) == ("a",)
    assert seen(of, 1.06) == () and of.vanished == ("b",)


# ---------------------------------------------------------------------------------------------- coming back


def test_who_comes_back_has_the_old_number_and_a_new_row() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    seen(of, 1.02, ("b", MIDDLE))
    seen(of, 5.0, ("a", only(standing(-2.9), Point.HEAD)), ("b", MIDDLE))
    assert of.person_ids == ("a", "b") and of.left == {}
    [row] = rows_of(of, "a")
    assert of.people["present"][0, row] == 1 << Point.HEAD
    assert of.people["xyz"][0, row, Point.HEAD, 0] == -2.9
    assert not of.contradicted


def test_who_comes_back_unread_stays_although_they_were_read_before_they_left() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER), ("b", MIDDLE))
    assert seen(of, 1.02, ("b", MIDDLE)) == ("a",)
    seen(of, 1.04, ("a", NOTHING_READ), ("b", MIDDLE))
    assert seen(of, 1.06, ("b", MIDDLE)) == () and present(of) == {"a", "b"}


def test_a_complete_report_counts_from_the_earliest_instant_of_its_stamp() -> None:
    of = gate(CELL, stamp_error_s=0.004)
    seen(of, 1.0, ("a", BORDER))
    assert of.people["t_complete"] == 1.0 - 0.004


def test_who_comes_back_under_a_new_id_is_somebody_new() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER))
    assert seen(of, 1.02) == ("a",)
    seen(of, 2.0, ("z", BORDER))
    assert of.person_ids == ("a", "z") and present(of) == {"z"}


@pytest.mark.parametrize("stamp", [1.02, 1.05])
def test_late_report_from_before_does_not_bring_anybody_back(stamp: float) -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER))
    seen(of, 1.05)
    late = of.admit(report(stamp, ("a", BORDER))._replace(complete=False), 9.0)
    assert [r.reason for r in late.refusals] == [RefusalReason.STAMP_BACKWARDS]
    assert present(of) == set() and of.left == {"a": 1.05}


def test_who_is_listed_after_somebody_who_left_later_is_read() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("a", BORDER))
    seen(of, 1.05)
    late = of.admit(report(1.02, ("a", BORDER), ("b", MIDDLE))._replace(complete=False), 9.0)
    assert [(r.person, r.reason) for r in late.refusals] == [("a", RefusalReason.STAMP_BACKWARDS)]
    assert present(of) == {"b"}


def test_points_of_two_bodies_are_not_mixed_when_an_id_changes_hands() -> None:
    """b's hand is all that the last report shows of b, who may be a by now: b's old elbow is dropped."""
    of = gate(CELL, position_error_m=0.15)
    seen(of, 1.0, ("a", standing(2.9, 0.3)), ("b", standing(2.9)))
    assert seen(of, 1.02, ("b", only(standing(2.9, 0.2), Point.L_WRIST))) == ("a",)
    [row] = rows_of(of, "b")
    assert of.people["present"][0, row] == 1 << Point.L_WRIST
    assert np.isnan(of.people["xyz"][0, row, Point.L_ELBOW]).all()
    assert np.isinf(of.people["e_v"][0, row]).all()


def test_points_of_different_age_stay_when_nobody_left() -> None:
    of = gate(CELL)
    seen(of, 1.0, ("b", standing(2.9)))
    seen(of, 1.02, ("b", only(standing(2.9), Point.L_WRIST)))
    assert of.people["present"][0, rows_of(of, "b")[0]] == (1 << MAX_POINTS) - 1


# ---------------------------------------------------------------------------------- a crowd in and out


@dataclass
class Walker:
    """A person who walks at random, and how the tracker calls them; ``track``: instant -> place (2,) [m]."""

    track: Array
    id: str | None = None
    points: dict[float, Array] = field(default_factory=dict)


STEP, HORIZON = 0.02, 0.3
RADII = {part: float(ISO.radius[part]) for part in Part}
RADII.update(dict.fromkeys(HANDS, 0.03))
ENDS = {**SEGMENTS, **{part: (of[0], of[2]) for part, of in HANDS.items()}}
"""A hand lies within its radius of each of its points: 3 cm around the segment from wrist to fingertip."""


def walk(rng: np.random.Generator, steps: int) -> Array:
    """Places (steps, 2) [m] of somebody in and around the box, at most at 2 m/s."""
    place, places = rng.uniform(-5.0, 5.0, 2), []
    way = unit(rng, 1)[0][:2]
    for _ in range(steps):
        if rng.random() < 0.05 or np.abs(place).max() > 5.0:
            goal = rng.uniform(-4.5, 4.5, 2)
            way = (goal - place) / max(float(np.linalg.norm(goal - place)), 1e-6)
        place = place + 2.0 * STEP * rng.choice([1.0, 1.0, 0.3]) * way
        places.append(place)
    return np.array(places)


def body(place: Array) -> tuple[Array, Array]:
    """Points (n, 3) on the segments of a body, and the radius (n,) [m] around each."""
    xyz = standing(float(place[0]), float(place[1]))
    inner, radii = [], []
    for part, (a, b) in ENDS.items():
        for share in (0.0, 0.5, 1.0):
            inner.append(xyz[a] + share * (xyz[b] - xyz[a]))
            radii.append(RADII[part])
    return np.array(inner), np.array(radii)


def partly_inside(place: Array) -> bool:
    """Whether some part is in the box; 0.05 m more, because the parts are looked at in three points only."""
    inner, radii = body(place)
    low, high = -BOX.offset[3:], BOX.offset[:3]
    return bool((np.linalg.norm(inner - np.clip(inner, low, high), axis=1) < radii + 0.05).any())


def uncovered(rng: np.random.Generator, place: Array, sets: list[Block]) -> float:
    """Greatest distance [m] by which a point of a body lies outside of all rows."""
    inner, radii = body(place)
    points = inner + radii[:, None] * unit(rng, len(inner))
    points = points[rng.choice(len(points), 8, replace=False)]
    excess = np.full(len(points), 9.0)
    for out in sets:
        for k in range(int(out["first"][0, 1])):
            hull, radius = out["points"][0, k, : out["n_points"][0, k]], float(out["radius"][0, k])
            still = np.flatnonzero(excess > 0.0)
            if not len(still):
                return float(excess.max())
            excess[still] = np.minimum(excess[still], each_outside(points[still], hull, radius))
    return float(excess.max())


@dataclass(frozen=True)
class Forget:
    """What an ablation leaves out."""

    rows_outside: bool = False
    detection: bool = False


def crowd(rng: np.random.Generator, forget: Forget) -> tuple[float, int, int]:
    """Let people walk for 4 s; return the worst uncovered distance [m], and numbers of who left and checks.

    An id changes hands only after a complete report without it; otherwise ids are trusted.
    """
    detection = 0.3 if forget.detection else float(rng.choice([0.0, 0.1, 0.3]))
    of = gate(Monitored("cell", BOX, 0.0 if forget.detection else detection), max_people=16)
    model = UnobservedSpace(Monitored("cell", BOX, 0.0 if forget.detection else detection), ISO, index=1)
    bodies, steps = Iso13855(ISO), 200
    early = 0.0 if forget.detection else float(rng.choice([0.0, 0.1]))
    window, ahead = round(detection / STEP), round(HORIZON / STEP)
    walkers = [
        Walker(walk(rng, steps + ahead)) for _ in range(4 if forget.detection else int(rng.integers(1, 5)))
    ]
    inside = [[partly_inside(place) for place in each.track] for each in walkers]
    worst, left, checked, complete_before, fresh = -math.inf, 0, 0, False, 0
    for step in range(window, steps):
        stamp, complete = step * STEP, bool(rng.random() < 0.5)
        people: list[tuple[str, Array]] = []
        taken = {each.id for each in walkers}
        for number, each in enumerate(walkers):
            must = all(inside[number][step - window : step + 1])
            anyway = rng.random() < (early if complete else 0.5)
            listed = (complete and must) or (anyway and (complete or each.id is not None))
            if complete and listed and (each.id is None or rng.random() < 0.03):
                each.id = next(name for k in range(9) if (name := f"p{(fresh + k) % 9}") not in taken)
                taken.add(each.id)
                fresh += 1
            if listed and each.id is not None:
                xyz = standing(*each.track[step])
                xyz = xyz + 0.01 * rng.random() * unit(rng, MAX_POINTS)
                hidden = rng.random(MAX_POINTS) < rng.choice([0.0, 0.5])
                hidden[int(rng.integers(MAX_POINTS))] = False
                xyz[hidden] = np.nan
                if np.isfinite(xyz).any():
                    people.append((each.id, xyz))
            elif complete:
                each.id = None
        left += len(seen_at(of, stamp, people, complete))
        complete_before |= complete
        if complete_before and rng.random() < 0.15:
            later = int(rng.integers(1, ahead))
            when = (step + later) * STEP
            plan = slices(np.array([when - 0.01, when]))
            sets = [new_people_sets(), new_people_sets()]
            bodies.occupy(of.people, plan, sets[0])
            if not forget.rows_outside:
                model.occupy(of.people, plan, sets[1])
            unmeasured = (of.people["present"][0, : of.people["n"][0]] == 0).any()
            for each in walkers if not (unmeasured or of.overflow) else ():
                worst = max(worst, uncovered(rng, each.track[step + later], sets))
                checked += 1
    return worst, left, checked


def seen_at(of: Gate, stamp: float, people: list[tuple[str, Array]], complete: bool) -> tuple[str, ...]:
    return of.admit(report(stamp, *people)._replace(complete=complete), stamp).left


def test_nobody_of_a_crowd_is_ever_outside_of_all_rows(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Ids change, are reused, people enter and leave, reports are partial and often incomplete."""
    left = checked = 0
    for _ in range(count(400)):
        worst, gone, instants = crowd(rng, Forget())
        assert worst <= 1e-9
        left, checked = left + gone, checked + instants
    assert left > count(400) and checked > 20 * count(400)


@pytest.mark.parametrize("forget", [Forget(rows_outside=True), Forget(detection=True)], ids=["space", "time"])
def test_both_halves_of_the_rule_are_needed(rng: np.random.Generator, forget: Forget) -> None:
    assert any(crowd(rng, forget)[0] > 1e-2 for _ in range(12))
