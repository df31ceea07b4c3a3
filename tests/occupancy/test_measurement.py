"""The gate: what counts as measured, and what happens when reports contradict each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Part, Point, Profile, load_profile
from occupancy.measurement import (
    Gate,
    GateError,
    GateSettings,
    RawMeasurement,
    RawPerson,
    RefusalReason,
    SensorFrame,
)
from occupancy.region import Monitored, Region
from occupancy.sets import MAX_PEOPLE
from tests.occupancy.people import (
    ALL_POINTS,
    UNSTATED,
    clip,
    clips,
    mask,
    only,
    report,
    rows_of,
    settings,
    standing,
)

ISO = load_profile("iso")
HUGE = 1e300


def gate(profile: Profile = ISO, **changes: object) -> Gate:
    return Gate(profile, settings(**changes))


def state(of: Gate) -> bytes:
    return of.people.tobytes()


# ---------------------------------------------------------------------------------------------- settings


@pytest.mark.parametrize("name", ["clock_error_s", "stamp_error_s", "position_error_m"])
@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_settings_refuse_errors_that_are_no_bound(name: str, value: float) -> None:
    with pytest.raises(GateError, match=name):
        settings(**{name: value})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"max_people": 0}, "max_people 0 must be 1 to 16"),
        ({"max_people": 17}, "max_people 17 must be 1 to 16"),
        ({"range_m": 0.0}, "range_m"),
        ({"range_m": math.nan}, "range_m"),
        ({"range_m": math.inf}, "range_m"),
    ],
)
def test_settings_refuse(changes: dict[str, object], said: str) -> None:
    with pytest.raises(GateError, match=said):
        settings(**changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "must not mirror"),
        ({"rotation": 1.001 * np.eye(3)}, "orthonormal"),
        ({"rotation": np.full((3, 3), np.nan)}, "orthonormal"),
        ({"translation": np.array([0.0, np.nan, 0.0])}, "three finite"),
        ({"translation": np.zeros(2)}, "three finite"),
        ({"translation_error_m": -0.1}, "translation_error_m"),
        ({"rotation_error_rad": math.nan}, "rotation_error_rad"),
        ({"rotation_error_rad": 4.0}, "must not exceed pi"),
    ],
)
def test_frames_refuse(changes: dict[str, object], said: str) -> None:
    with pytest.raises(GateError, match=said):
        SensorFrame(**changes)


# ----------------------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("where", [0, 1, 2])
@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (math.nan, RefusalReason.NOT_FINITE),
        (math.inf, RefusalReason.NOT_FINITE),
        (-math.inf, RefusalReason.NOT_FINITE),
        (HUGE, RefusalReason.TOO_FAR),
        (-HUGE, RefusalReason.TOO_FAR),
        (1e5, RefusalReason.TOO_FAR),
    ],
)
def test_unreadable_coordinate_refuses_the_point_and_not_the_person(
    value: float, reason: RefusalReason, where: int
) -> None:
    xyz = standing()
    xyz[Point.R_WRIST, where] = value
    g = gate()
    raw = RawMeasurement(0.0, 0.0, "world", True, (RawPerson("a", xyz, UNSTATED, ALL_POINTS),))
    [refusal] = g.admit(raw, 0.0).refusals
    assert (refusal.person, refusal.point, refusal.reason) == ("a", Point.R_WRIST, reason)
    assert g.people["present"][0, 0] == ALL_POINTS & ~mask(Point.R_WRIST)
    assert np.isnan(g.people["xyz"][0, 0, Point.R_WRIST]).all()


@pytest.mark.parametrize(
    ("xyz", "error"),
    [((19, 3), (20,)), ((21, 3), (20,)), ((20, 2), (20,)), ((20, 4), (20,)), ((20, 3), (19,))],
)
def test_arrays_of_another_shape_are_not_read(xyz: tuple[int, int], error: tuple[int]) -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing())), 0.0)
    before = g.people.copy()
    who = RawPerson("a", np.full(xyz, 0.7), np.full(error, 0.01), ALL_POINTS)
    refusals = g.admit(RawMeasurement(0.1, 0.1, "world", True, (who,)), 0.1).refusals
    assert [(r.person, r.point, r.reason) for r in refusals] == [("a", p, RefusalReason.SHAPE) for p in Point]
    assert g.people.tobytes() == before.tobytes()


def test_point_at_exactly_zero_is_a_missing_point() -> None:
    xyz = standing()
    xyz[Point.L_HAND] = 0.0
    g = gate()
    [refusal] = g.admit(report(0.0, ("a", xyz)), 0.0).refusals
    assert (refusal.point, refusal.reason) == (Point.L_HAND, RefusalReason.ZERO)
    assert not g.people["present"][0, 0] & mask(Point.L_HAND)


def test_zero_is_zero_in_the_sensor_frame() -> None:
    """A point that the sensor puts at its own origin is missing wherever that origin is."""
    frame = SensorFrame(translation=np.array([2.0, 0.24, 0.85]))
    xyz = standing() - frame.translation
    xyz[Point.L_WRIST] = 0.0
    g = gate(frames={"camera": frame})
    [refusal] = g.admit(report(0.0, ("a", xyz), frame="camera"), 0.0).refusals
    assert (refusal.point, refusal.reason) == (Point.L_WRIST, RefusalReason.ZERO)


def test_inferred_point_is_not_measured_and_missing_point_is_not_refused() -> None:
    xyz = standing()
    xyz[Point.HEAD] = np.nan
    g = gate()
    seen = ALL_POINTS & ~mask(Point.L_KNEE, Point.HEAD)
    raw = RawMeasurement(0.0, 0.0, "world", True, (RawPerson("a", xyz, UNSTATED, seen),))
    [refusal] = g.admit(raw, 0.0).refusals
    assert (refusal.point, refusal.reason) == (Point.L_KNEE, RefusalReason.INFERRED)
    assert g.people["present"][0, 0] == seen


@pytest.mark.parametrize("point", Point)
def test_a_refusal_is_listed_whichever_point_it_is(point: Point) -> None:
    found = gate().admit(report(0.0, ("a", standing()), measured=ALL_POINTS & ~mask(point)), 0.0)
    assert [(r.point, r.reason) for r in found.refusals] == [(point, RefusalReason.INFERRED)]


@pytest.mark.parametrize("error", [-1e-6, math.inf, -math.inf, HUGE])
def test_position_error_that_is_no_bound_refuses_the_point(error: float) -> None:
    errors = UNSTATED.copy()
    errors[Point.HEAD] = error
    g = gate()
    raw = RawMeasurement(0.0, 0.0, "world", True, (RawPerson("a", standing(), errors, ALL_POINTS),))
    [refusal] = g.admit(raw, 0.0).refusals
    assert (refusal.point, refusal.reason) == (Point.HEAD, RefusalReason.BAD_ERROR)


def test_stated_error_counts_and_the_default_fills_the_gaps() -> None:
    errors = UNSTATED.copy()
    errors[Point.HEAD] = 0.034
    g = gate(position_error_m=0.02)
    g.admit(RawMeasurement(0.0, 0.0, "world", True, (RawPerson("a", standing(), errors, ALL_POINTS),)), 0.0)
    assert g.people["e_p"][0, 0, Point.HEAD] == 0.034
    assert g.people["e_p"][0, 0, Point.PELVIS] == 0.02


def test_limb_that_no_person_has_refuses_both_its_ends_only() -> None:
    xyz = standing()
    xyz[Point.L_ANKLE] += (0.0, 0.0, -0.6)
    found = gate().admit(report(0.0, ("a", xyz)), 0.0).refusals
    assert {(r.point, r.reason) for r in found} == {
        (Point.L_KNEE, RefusalReason.LIMB),
        (Point.L_ANKLE, RefusalReason.LIMB),
    }
    assert all(math.isclose(r.value, 1.0, abs_tol=1e-9) for r in found)


def test_position_errors_widen_the_limb_limits() -> None:
    """Two points that may each be 0.2 m off may show a limb 0.4 m too long: noise, not an index."""
    xyz = standing()
    xyz[Point.L_ANKLE] += (0.0, 0.0, -0.6)
    assert not gate(position_error_m=0.2).admit(report(0.0, ("a", xyz)), 0.0).refusals


@pytest.mark.parametrize("scale", [1000.0, 100.0, 0.001, 39.37])
def test_wrong_units_are_refused_as_a_whole(scale: float) -> None:
    g = gate(range_m=1e4)
    g.admit(report(0.0, ("a", standing() * scale)), 0.0)
    kept = int(g.people["present"][0, 0])
    short = mask(
        Point.THORAX, Point.NECK_BASE, *(p for p in Point if p.name[2:] in ("WRIST", "HAND", "FINGERTIP"))
    )
    assert kept & ~short == 0, "limbs that may have length 0 pass when everything is far too small"
    if scale > 1.0:
        assert kept == 0


def test_wrong_indices_are_refused(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Two columns of different limbs exchanged: nearly always some limb is impossible."""
    caught = []
    for _ in range(count(20_000)):
        xyz = standing()
        a, b = rng.choice(20, 2, replace=False)
        xyz[[a, b]] = xyz[[b, a]]
        moved = float(np.linalg.norm(xyz[a] - xyz[b]))
        if moved > 0.6:
            caught.append(bool(gate().admit(report(0.0, ("a", xyz)), 0.0).refusals))
    assert np.mean(caught) > 0.9


# ------------------------------------------------------------------------------------------------ stamps


@pytest.mark.parametrize("which", ["stamp", "arrived", "now"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_times_that_are_no_numbers_refuse_the_report(which: str, value: float) -> None:
    raw, now = report(0.0, ("a", standing())), 0.0
    if which == "now":
        now = value
    else:
        raw = raw._replace(**{which: value})
    g = gate()
    [refusal] = g.admit(raw, now).refusals
    assert refusal.reason is RefusalReason.STAMP_NOT_FINITE
    assert g.people["present"][0, 0] == 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("which", ["stamp", "arrived", "now"])
@pytest.mark.parametrize("value", [-1e308, -1.1e12, 1.1e12, 1e308])
def test_times_that_no_clock_shows_refuse_the_report(which: str, value: float) -> None:
    box = Monitored("cell", Region.box((-3.0, -3.0, -1.0), (3.0, 3.0, 3.0)), 0.1)
    times = {"stamp": 0.0, "arrived": 0.0, "now": 0.0} | {which: value}
    raw = report(times["stamp"], ("a", standing()))._replace(arrived=times["arrived"])
    g = gate(monitored=(box,))
    g.admit(report(-2.0, ("b", standing(0.0))), -2.0)
    found = g.admit(raw, times["now"])
    assert [refusal.reason for refusal in found.refusals] == [RefusalReason.STAMP_TOO_FAR]
    assert g.people["present"][0, rows_of(g, "a")[0]] == 0 and found.left == ()
    assert g.people["t_complete"] == -2.0 and not g.contradicted
    g.admit(report(0.1, ("a", standing(0.5)), ("b", standing(0.0))), 1.0)
    assert g.people["t_complete"] == 0.1


@pytest.mark.parametrize("stamp", [-1e12, 1e12])
def test_times_up_to_that_are_read(stamp: float) -> None:
    g = gate()
    assert not g.admit(report(stamp, ("a", standing())), stamp).refusals
    assert g.people["t_obs"][0, 0, Point.HEAD] == stamp


@pytest.mark.parametrize(("ahead", "refused"), [(0.0009, False), (0.0011, True), (1e6, True)])
def test_stamp_ahead_of_the_clock_by_more_than_its_error_is_refused(ahead: float, refused: bool) -> None:
    g = gate(clock_error_s=0.001)
    raw = report(10.0 + ahead, ("a", standing()))._replace(arrived=10.0)
    reasons = [r.reason for r in g.admit(raw, 10.0).refusals]
    assert reasons == ([RefusalReason.STAMP_AHEAD] if refused else [])
    assert bool(g.people["present"][0, 0]) is not refused


@pytest.mark.parametrize(("ahead", "refused"), [(0.0029, False), (0.0031, True)])
def test_stamp_and_clock_may_both_be_off(ahead: float, refused: bool) -> None:
    g = gate(clock_error_s=0.001, stamp_error_s=0.002)
    assert g.is_ahead(report(10.0 + ahead, ("a", standing()))._replace(arrived=10.0)) is refused


@pytest.mark.parametrize(("ahead", "refused"), [(0.0, False), (5e-7, False), (0.01, True)])
def test_a_stamp_after_the_arrival_stays_refused_when_the_clock_has_reached_it(
    ahead: float, refused: bool
) -> None:
    g = gate()
    raw = report(10.0 + ahead, ("a", standing()))._replace(arrived=10.0)
    assert g.is_ahead(raw) is refused
    assert [r.reason for r in g.admit(raw, 11.0).refusals] == [RefusalReason.STAMP_AHEAD] * refused
    assert g.person_ids == ("a",)


def test_a_stamp_that_is_just_as_far_ahead_as_it_may_be_is_not_ahead() -> None:
    """A millionth of a second is granted for how stamps are rounded."""
    g = Gate(load_profile("iso"), settings(clock_error_s=0.0, stamp_error_s=0.0))
    for ahead, refused in ((1e-6, False), (np.nextafter(1e-6, 1.0), True)):
        assert g.is_ahead(report(float(ahead), ("a", standing()))._replace(arrived=0.0)) is refused


def test_report_is_not_used_before_it_arrives() -> None:
    g = gate()
    raw = report(1.0, ("a", standing()))._replace(arrived=1.2)
    assert [r.reason for r in g.admit(raw, 1.1).refusals] == [RefusalReason.NOT_ARRIVED]
    assert not g.admit(raw, 1.2).refusals


@pytest.mark.parametrize(("stamp", "moved"), [(1.0, 0.0), (0.999, 0.0), (0.5, 0.9), (-5.0, 9.0)])
def test_stamps_that_repeat_or_run_backwards_change_nothing(stamp: float, moved: float) -> None:
    g = gate()
    g.admit(report(1.0, ("a", standing())), 1.0)
    before = state(g)
    [refusal] = g.admit(report(stamp, ("a", standing() + np.array([moved, 0.0, 0.0]))), 1.1).refusals
    assert (refusal.person, refusal.reason) == ("a", RefusalReason.STAMP_BACKWARDS)
    assert state(g) == before and not g.contradicted


@pytest.mark.parametrize(("stamp", "moved"), [(1.0, 0.5), (0.999, 0.5), (0.5, 1.2), (-5.0, 13.0)])
def test_somebody_seen_elsewhere_is_kept_whatever_the_stamp(stamp: float, moved: float) -> None:
    """Two sensors with one clock may both call their person "a"."""
    g = gate()
    g.admit(report(1.0, ("a", standing())), 1.0)
    before = rows_of(g, "a")
    admission = g.admit(report(stamp, ("a", standing() + np.array([moved, 0.0, 0.0]))), 1.1)
    assert not admission.refusals and admission.contradictions
    assert g.contradicted and len(rows_of(g, "a")) == len(before) + 1


def test_stamps_are_compared_per_person() -> None:
    g = gate()
    g.admit(report(1.0, ("a", standing())), 1.1)
    assert not g.admit(report(0.9, ("b", standing(y=3.0))), 1.1).refusals
    assert g.person_ids == ("a", "b")


def test_who_is_listed_after_somebody_seen_before_is_read() -> None:
    g = gate()
    g.admit(report(1.0, ("a", standing())), 1.1)
    [refusal] = g.admit(report(1.0, ("a", standing()), ("b", standing(y=3.0))), 1.1).refusals
    assert (refusal.person, refusal.reason) == ("a", RefusalReason.STAMP_BACKWARDS)
    assert g.person_ids == ("a", "b") and rows_of(g, "b")


def test_refused_stamp_ahead_does_not_block_what_comes_after() -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing())), 0.0)
    g.admit(report(1e9, ("a", standing())), 0.01)
    assert not g.admit(report(0.02, ("a", standing())), 0.02).refusals
    assert g.people["t_obs"][0, 0, Point.HEAD] == 0.02


def test_stamp_error_is_taken_off_the_time_of_observation() -> None:
    g = gate(stamp_error_s=0.004)
    g.admit(report(1.0, ("a", standing())), 1.0)
    assert (g.people["t_obs"][0, 0] == 1.0 - 0.004).all()
    assert g.people["stamp_error"] == 0.004


# ------------------------------------------------------------------------------------- who is there at all


def test_person_whose_stream_stops_stays() -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing()), ("b", standing(y=2.0))), 0.0)
    before = g.people["t_obs"][0, 1].copy()
    for k in range(1, 50):
        g.admit(report(0.1 * k, ("a", standing())), 0.1 * k)
    assert g.people["n"] == 2
    np.testing.assert_array_equal(g.people["t_obs"][0, 1], before)


def test_empty_complete_report_removes_nobody() -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing())), 0.0)
    before = state(g)
    g.admit(report(1.0), 1.0)
    assert state(g) == before


@pytest.mark.parametrize("how", ["unreadable points", "undeclared frame", "stamp ahead"])
def test_person_of_whom_nothing_can_be_read_is_still_there(how: str) -> None:
    """Their row has no point: no model can enclose them, so nothing can be verified."""
    raw = report(0.0, ("a", standing()))
    if how == "unreadable points":
        raw = report(0.0, ("a", np.zeros((20, 3))))
    if how == "undeclared frame":
        raw = report(0.0, ("a", standing()), frame="camera")
    if how == "stamp ahead":
        raw = report(5.0, ("a", standing()))._replace(arrived=0.0)
    g = gate()
    assert g.admit(raw, 0.0).refusals
    assert g.people["n"] == 1 and g.people["present"][0, 0] == 0
    assert not g.admit(report(1.0, ("a", standing())), 1.0).contradictions
    assert g.people["n"] == 1 and g.people["present"][0, 0] == ALL_POINTS


def test_more_people_than_rows_overflows_for_good() -> None:
    g = gate(max_people=2)
    found = g.admit(report(0.0, *[(name, standing(y=2.0 * i)) for i, name in enumerate("abc")]), 0.0)
    assert [(r.person, r.reason) for r in found.refusals] == [("c", RefusalReason.TOO_MANY_PEOPLE)]
    assert g.overflow and g.person_ids == ("a", "b")
    g.admit(report(1.0, ("a", standing())), 1.0)
    assert g.overflow


# ------------------------------------------------------------------------------------------------- frames


def test_points_and_errors_are_carried_into_the_world(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """The true point lies within e_p for any true pose that the errors of the declared one allow."""
    tightest = 0.0
    for _ in range(count(20_000)):
        rotation, turn = random_rotation(rng), rng.uniform(0.0, 0.3)
        translation, shift = rng.normal(size=3), rng.uniform(0.0, 0.1)
        frame = SensorFrame(rotation, translation, shift, turn)
        e = rng.uniform(0.0, 0.05)
        g = gate(frames={"camera": frame}, position_error_m=e)
        seen = rotation.T @ (standing() - translation).T
        g.admit(report(0.0, ("a", seen.T), frame="camera"), 0.0)
        world, error = g.people["xyz"][0, 0], g.people["e_p"][0, 0]
        np.testing.assert_allclose(world, standing(), atol=1e-12)
        wrong = axis_rotation(unit(rng), turn) @ rotation
        true = seen.T + e * unit(rng)
        at = true @ wrong.T + translation + shift * unit(rng)
        off = np.linalg.norm(at - world, axis=1)
        assert (off <= error + 1e-12).all()
        tightest = max(tightest, float((off / error).max()))
    assert tightest > 0.6


def test_half_a_degree_at_three_metres_is_26_mm() -> None:
    frame = SensorFrame(rotation_error_rad=math.radians(0.5))
    g = gate(frames={"camera": frame}, position_error_m=0.0)
    xyz = only(standing(), Point.HEAD)
    xyz[Point.HEAD] = (3.0, 0.0, 0.0)
    g.admit(report(0.0, ("a", xyz), frame="camera"), 0.0)
    assert g.people["e_p"][0, 0, Point.HEAD] == pytest.approx(0.026, abs=5e-4)


def unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def axis_rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return axis_rotation(unit(rng), rng.uniform(0.0, math.pi))


# ------------------------------------------------------------------------------------------ contradictions


def shifted(by: float) -> np.ndarray:
    return standing(x=2.0 + by)


@pytest.mark.parametrize(
    ("by", "contradicts"),
    [(0.2 + 0.02 - 1e-6, False), (0.2 + 0.02 + 1e-6, True), (-0.22 - 1e-6, True)],
)
def test_limit_is_speed_times_time_plus_both_errors(by: float, contradicts: bool) -> None:
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    found = g.admit(report(0.1, ("a", shifted(by))), 0.1).contradictions
    assert bool(found) is contradicts is g.contradicted
    if contradicts:
        assert (found[0].person, found[0].stamp, found[0].elapsed_s) == ("a", 0.1, 0.1)
        assert found[0].distance_m == pytest.approx(abs(by)) and found[0].allowed_m == pytest.approx(0.22)
        assert found[0].point is found[0].earlier


def test_clock_and_stamp_errors_widen_the_limit() -> None:
    """Two stamps and two clock readings, each off by its error: 2 * (0.003 + 0.002) s at 2 m/s are 0.02 m."""
    for by, contradicts in ((0.24 - 1e-6, False), (0.24 + 1e-6, True)):
        g = gate(clock_error_s=0.003, stamp_error_s=0.002)
        g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
        assert bool(g.admit(report(0.1, ("a", shifted(by))), 0.1).contradictions) is contradicts


def test_the_profiles_speed_decides() -> None:
    for speed, contradicts in ((2.0, False), (1.6, True)):
        g = gate(ISO.with_speed(speed))
        g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
        assert bool(g.admit(report(1.0, ("a", shifted(1.9))), 1.0).contradictions) is contradicts


def test_contradicting_report_becomes_a_second_row_and_the_old_one_stays() -> None:
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    g.admit(report(0.01, ("a", shifted(1.0))), 0.01)
    assert rows_of(g, "a") == [0, 1]
    np.testing.assert_array_equal(g.people["xyz"][0, 0], shifted(0.0))
    np.testing.assert_array_equal(g.people["xyz"][0, 1], shifted(1.0))
    assert (g.people["t_obs"][0, 0] == 0.0).all() and (g.people["t_obs"][0, 1] == 0.01).all()


def test_single_outlier_clears_when_both_rows_could_have_led_to_the_report() -> None:
    """Row at 1 m grows at 2 m/s: a person who stands still agrees with it after 0.49 s (errors 0.02 m)."""
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    g.admit(report(0.01, ("a", shifted(1.0))), 0.01)
    cleared = None
    for k in range(2, 100):
        g.admit(report(0.01 * k, ("a", shifted(0.0))), 0.01 * k)
        if not g.contradicted:
            cleared = 0.01 * k
            break
    assert cleared == pytest.approx(0.5, abs=0.0101)
    assert g.people["n"] == 1
    np.testing.assert_array_equal(g.people["xyz"][0, 0], shifted(0.0))


def test_report_that_agrees_with_some_rows_replaces_those_only() -> None:
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    g.admit(report(0.01, ("a", shifted(1.0))), 0.01)
    g.admit(report(0.02, ("a", shifted(2.0))), 0.02)
    assert len(rows_of(g, "a")) == 3
    g.admit(report(0.03, ("a", shifted(1.01))), 0.03)
    kept = sorted(float(g.people["xyz"][0, k, Point.PELVIS, 0]) for k in rows_of(g, "a"))
    assert kept == pytest.approx([2.0, 3.01, 4.0])


def test_rows_of_others_are_untouched_by_a_collapse() -> None:
    g = gate()
    for k, stamp in enumerate((0.0, 0.01)):
        g.admit(report(stamp, ("a", shifted(1.0 * k)), ("b", standing(y=5.0))), stamp)
    assert g.contradicted and rows_of(g, "b") == [1]
    g.admit(report(1.0, ("a", shifted(0.5))), 1.0)
    assert not g.contradicted and g.people["n"] == 2
    [b] = rows_of(g, "b")
    np.testing.assert_array_equal(g.people["xyz"][0, b], standing(y=5.0))
    assert (g.people["t_obs"][0, b] == 0.01).all()


def test_points_of_different_age_stay_together_while_nothing_contradicts() -> None:
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    g.admit(report(0.1, ("a", only(shifted(0.1), Point.HEAD, Point.NECK_BASE))), 0.1)
    t = g.people["t_obs"][0, 0]
    assert t[Point.HEAD] == t[Point.NECK_BASE] == 0.1 and t[Point.PELVIS] == 0.0
    assert g.people["xyz"][0, 0, Point.HEAD, 0] == 2.1 and g.people["xyz"][0, 0, Point.PELVIS, 0] == 2.0
    assert g.people["present"][0, 0] == ALL_POINTS


def test_points_of_a_row_that_may_be_wrong_are_not_kept_beside_new_ones() -> None:
    g = gate()
    g.admit(report(0.0, ("a", shifted(0.0))), 0.0)
    g.admit(report(0.01, ("a", shifted(1.0))), 0.01)
    g.admit(report(0.02, ("a", only(shifted(1.0), Point.HEAD, Point.NECK_BASE))), 0.02)
    old, new = rows_of(g, "a") if g.people["t_obs"][0, 0, 0] == 0.0 else rows_of(g, "a")[::-1]
    assert g.people["present"][0, old] == ALL_POINTS
    assert g.people["present"][0, new] == mask(Point.HEAD, Point.NECK_BASE)
    assert np.isnan(g.people["xyz"][0, new, Point.PELVIS]).all()


def test_new_point_too_far_from_the_rest_of_the_body_contradicts() -> None:
    """The wrist of somebody else under the same id, although this row never had a wrist."""
    g = gate()
    g.admit(report(0.0, ("a", only(standing(), Point.HEAD, Point.NECK_BASE))), 0.0)
    found = g.admit(report(0.01, ("a", only(standing(x=5.0), Point.L_WRIST))), 0.01).contradictions
    assert found and found[0].point is Point.L_WRIST
    assert len(rows_of(g, "a")) == 2
    g = gate()
    g.admit(report(0.0, ("a", only(standing(), Point.HEAD, Point.NECK_BASE))), 0.0)
    assert not g.admit(report(0.01, ("a", only(standing(), Point.L_WRIST))), 0.01).contradictions


def test_two_bodies_under_one_id_are_both_kept() -> None:
    g = gate()
    for k in range(5):
        stamp = 0.01 * k
        g.admit(report(stamp, ("a", standing()), ("a", standing(y=3.0))), stamp)
        places = sorted(float(g.people["xyz"][0, i, Point.PELVIS, 1]) for i in rows_of(g, "a"))
        assert places == [0.0, 3.0] and g.contradicted
        assert all(g.people["t_obs"][0, i, Point.PELVIS] == stamp for i in rows_of(g, "a"))


def test_exchanged_ids_keep_every_place_covered() -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing()), ("b", standing(y=3.0))), 0.0)
    g.admit(report(0.01, ("b", standing()), ("a", standing(y=3.0))), 0.01)
    assert g.people["n"] == 4 and g.contradicted
    for person in "ab":
        assert {float(g.people["xyz"][0, k, Point.PELVIS, 1]) for k in rows_of(g, person)} == {0.0, 3.0}


def jumps(n: int) -> list[RawMeasurement]:
    """Reports 1 ms and 1 m apart."""
    return [report(0.001 * k, ("a", standing(x=1.0 * k))) for k in range(n)]


def test_overflow_clears_only_when_a_report_agrees_with_every_row() -> None:
    g = gate(max_people=1)
    for raw in jumps(MAX_PEOPLE):
        g.admit(raw, 1.0)
    assert g.people["n"] == MAX_PEOPLE and not g.overflow
    g.admit(report(0.1, ("a", standing(x=90.0))), 1.0)
    assert g.people["n"] == MAX_PEOPLE and g.overflow and g.contradicted
    g.admit(report(0.2, ("a", standing(x=90.1))), 1.0)
    assert g.overflow
    g.admit(report(50.0, ("a", standing(x=8.0))), 50.0)
    assert g.people["n"] == 1 and not g.overflow and not g.contradicted


def test_every_expected_person_has_a_row_of_their_own_in_spite_of_hypotheses() -> None:
    g = gate(max_people=8)
    for raw in jumps(40):
        g.admit(raw, 1.0)
    assert g.overflow and g.people["n"] == MAX_PEOPLE - 7
    for k, name in enumerate("bcdefgh"):
        g.admit(report(1.0, (name, standing(y=3.0 * k + 3.0))), 1.0)
    assert g.people["n"] == MAX_PEOPLE and len(g.person_ids) == 8


def test_merged_row_contains_what_both_rows_allowed(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """At any later time the ball of the merged row contains the balls of all hypotheses that went into it."""
    compared = 0
    for _ in range(count(2_000)):
        g = gate(max_people=MAX_PEOPLE, clock_error_s=0.001, stamp_error_s=0.002)
        for name in "bcdefghijklmnop":
            g.admit(report(0.0, (name, standing())), 1.0)
        raws = [report(0.001 * k, ("a", standing(*rng.uniform(-20.0, 20.0, 2)))) for k in range(4)]
        disagreed = [bool(g.admit(raw, 1.0).contradictions) for raw in raws]
        if disagreed != [False, True, True, True]:
            continue
        compared += 1
        [row] = rows_of(g, "a")
        assert g.overflow
        later = rng.uniform(0.0, 2.0)
        merged = g.people["e_p"][0, row] + 2.0 * (later - g.people["t_obs"][0, row])
        for raw in raws:
            grown = 0.01 + 2.0 * (later - (raw.stamp - 0.002))
            off = np.linalg.norm(raw.people[0].xyz - g.people["xyz"][0, row], axis=1)
            assert (off + grown <= merged + 1e-9).all()
    assert compared > 0


# ---------------------------------------------------------------------------------- the invariant, at random


def test_some_row_always_holds(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """A person within the profile, and outliers that disagree with every row that holds.

    Reports lose points at random, so rows mix points of different age.
    """
    contradicted = mixed = outliers = 0
    for _ in range(count(2_000)):
        g = gate(max_people=int(rng.choice([1, 8, 16])), clock_error_s=0.001, stamp_error_s=0.001)
        true, t = standing(), 0.0
        g.admit(report(t, ("a", true)), t)
        for _ in range(40):
            step = float(rng.choice([0.001, 0.01, 0.1]))
            t += step
            heading = rng.normal(size=(20, 3)) * 0.02 + unit(rng)
            true = true + 2.0 * step * heading / np.maximum(1.0, np.linalg.norm(heading, axis=1))[:, None]
            seen = true + 0.01 * rng.uniform(-1.0, 1.0, (20, 1)) * unit(rng)
            seen[rng.random(20) < rng.choice([0.0, 0.3, 0.9])] = np.nan
            outlier = seen + rng.uniform(0.5, 3.0) * unit(rng)
            if rng.random() < 0.3 and all(
                _disagrees(g, k, outlier, t) for k in rows_of(g, "a") if _holds(g, k, true, t)
            ):
                seen, outliers = outlier, outliers + 1
            g.admit(report(t, ("a", seen)), t)
            contradicted += g.contradicted
            holds = [_holds(g, k, true, t) for k in rows_of(g, "a")]
            assert any(holds)
            mixed += any(np.ptp(_ages(g, k)) > 0.0 for k in rows_of(g, "a") if len(_ages(g, k)))
    assert contradicted > 0 and mixed > 0 and outliers > 0


def _ages(g: Gate, k: int) -> np.ndarray:
    times = g.people["t_obs"][0, k]
    return times[np.isfinite(times)]


def _disagrees(g: Gate, k: int, seen: np.ndarray, t: float) -> bool:
    """Some point is farther from its own place in row k than speed, clocks and errors allow."""
    allowed = g.people["e_p"][0, k] + 0.01 + 2.0 * (t - 0.001 - g.people["t_obs"][0, k] + 2.0 * 0.002)
    return bool((np.linalg.norm(seen - g.people["xyz"][0, k], axis=1) > allowed + 1e-6).any())


def _holds(g: Gate, k: int, true: np.ndarray, t: float) -> bool:
    present = int(g.people["present"][0, k]) >> np.arange(20) & 1 == 1
    reach = g.people["e_p"][0, k] + 2.0 * (t - g.people["t_obs"][0, k] + 0.001)
    off = np.linalg.norm(true - g.people["xyz"][0, k], axis=1)
    return bool((off <= reach + 1e-9)[present].all())


def test_any_numbers_are_answered_and_never_kept_unless_usable(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    nasty = [math.nan, math.inf, -math.inf, 0.0, -0.0, HUGE, -HUGE, 1e-320, 1.0, -1.0, 99.0]
    frame = SensorFrame(random_rotation(rng), rng.normal(size=3), 0.01, 0.02)
    for _ in range(count(5_000)):
        g = gate(frames={"camera": frame}, max_people=2)
        for _ in range(8):
            xyz = rng.choice(nasty, (20, 3))
            error = rng.choice([*nasty, 0.01], 20)
            person = RawPerson(str(rng.choice(["a", "b", "c"])), xyz, error, int(rng.integers(0, 1 << 40)))
            stamp, arrived, now = (float(x) for x in rng.choice(nasty, 3))
            name = str(rng.choice(["world", "camera", "nowhere"]))
            g.admit(RawMeasurement(stamp, arrived, name, True, (person,)), now)
        rows = g.people[0]
        for k in range(int(rows["n"])):
            present = int(rows["present"][k]) >> np.arange(20) & 1 == 1
            assert (np.abs(rows["xyz"][k, present]) <= 110.0).all()
            assert ((rows["e_p"][k, present] >= 0.0) & (rows["e_p"][k, present] <= 1e4)).all()
            assert np.isfinite(rows["t_obs"][k, present]).all()
            assert np.isnan(rows["xyz"][k, ~present]).all()


def test_read_gives_world_points_and_changes_nothing() -> None:
    frame = SensorFrame(translation=np.array([1.0, 0.0, 0.0]))
    g = gate(frames={"camera": frame})
    g.admit(report(0.0, ("a", standing(x=1.0)), frame="camera"), 0.0)
    before = state(g)
    raw = report(0.1, ("a", only(standing(x=1.1), Point.HEAD)), frame="camera")
    reading = g.read(raw, raw.people[0])
    assert reading is not None and reading.present == mask(Point.HEAD)
    np.testing.assert_allclose(reading.xyz[Point.HEAD], standing(x=2.1)[Point.HEAD])
    assert np.isnan(reading.xyz[Point.PELVIS]).all() and reading.e_p[Point.HEAD] == 0.01
    assert state(g) == before
    assert g.read(raw._replace(frame="nowhere"), raw.people[0]) is None


def test_velocity_is_unknown_and_never_zero_by_default() -> None:
    g = gate()
    g.admit(report(0.0, ("a", standing())), 0.0)
    g.admit(report(0.1, ("a", standing())), 0.1)
    assert (g.people["e_v"][0, 0] == math.inf).all()


# ------------------------------------------------------------------------------------------- real recordings


def admitted(path: Path) -> tuple[int, int, int, dict[tuple[str, str], int]]:
    """Frames, frames with a contradiction, most rows, and refusals by point and reason."""
    t, xyz = clip(path)
    g = Gate(ISO, GateSettings(clock_error_s=0.0, stamp_error_s=0.0, position_error_m=0.01))
    refused: dict[tuple[str, str], int] = {}
    contradicted = rows = 0
    for stamp, points in zip(t, xyz, strict=True):
        found = g.admit(report(float(stamp), ("a", points)), float(stamp))
        for refusal in found.refusals:
            assert refusal.point is not None
            key = (refusal.point.name, refusal.reason.name)
            refused[key] = refused.get(key, 0) + 1
        contradicted += bool(found.contradictions)
        rows = max(rows, int(g.people["n"][0]))
    return len(t), contradicted, rows, refused


@pytest.mark.real_data
def test_every_frame_of_every_clean_clip_is_admitted(real_data: Path) -> None:
    """Two sources pass some of their points on again: one in ten frames, and shoulders that never move."""
    paths = list(clips(real_data / "human", lambda name: "glitch" in name))
    assert len(paths) >= 15
    for path in paths:
        frames, _, _, refused = admitted(path)
        assert frames > 100 and {reason for _, reason in refused} <= {"REPEATED"}, path.name
        assert not refused or path.name.startswith(("kth_", "icl_")), path.name


@pytest.mark.real_data
def test_the_glitch_is_a_contradiction_and_never_a_quiet_pass(real_data: Path) -> None:
    [path] = clips(real_data / "human", lambda name: "glitch" not in name)
    _, contradicted, rows, _ = admitted(path)
    assert contradicted > 0 and rows > 1


@pytest.mark.real_data
def test_live_recordings_beside_an_arm_are_readable_but_for_swaps(real_data: Path) -> None:
    """Their marker swaps make impossible limbs and jumps, lost markers are held; all else is admitted."""
    for path in clips(real_data / "human_robot"):
        frames, contradicted, _, refused = admitted(path)
        assert {reason for _, reason in refused} == {"LIMB", "REPEATED"}
        assert max(n for (_, reason), n in refused.items() if reason == "LIMB") < 0.05 * frames
        assert 0 < contradicted < 0.3 * frames


def test_reasons_are_told_apart() -> None:
    texts = [str(reason) for reason in RefusalReason]
    assert len(set(texts)) == len(texts)
    assert all(a not in b for a, b in itertools.permutations(texts, 2))
    assert len(Part) == 16
