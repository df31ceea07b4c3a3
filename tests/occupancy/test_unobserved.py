"""Unobserved space: whoever was outside of a region stays in its rows; the rows lose nothing to rounding."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from occupancy.body import ALL_PARTS, load_profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.kernels import ROUNDING_M
from occupancy.humans.unobserved import ARENA_M, FARTHEST_FRONT_M, ModelError, UnobservedSpace
from occupancy.measurement import Gate
from occupancy.region import Monitored, Region
from occupancy.separation import Separation, new_ledger, open_obligations
from occupancy.sets import distance_to_hull, new_link_sets, new_people_sets
from robots.motion import MAX_SLICES, Block
from tests.occupancy.left_out import Forget, fresher, no_clock_error, no_delay, no_stamp_error, nothing
from tests.occupancy.moving_people import unit
from tests.occupancy.people import report, settings, standing
from tests.occupancy.test_iso13855 import rows, slices
from tests.occupancy.test_region import FIELD, FLOOR_PLAN, rotation

ISO, TUM = load_profile("iso"), load_profile("tum")
Array = np.ndarray
SPEED = float(ISO.speed.max())
BOX = Region.box((-2.0, -3.0, -1.0), (2.0, 3.0, 3.0))


def regions(rng: np.random.Generator) -> list[Region]:
    return [
        BOX,
        Region.prism(FLOOR_PLAN, -0.5, 1.5),
        Region.frustum(rng.uniform(-1.0, 1.0, 3), rotation(rng), **FIELD),
        Region.box((90.0, -99.0, -99.0), (99.0, 99.0, -90.0)),
    ]


def gate_of(*monitored: Monitored, stamp: float | None = 0.0, **changes: object) -> Gate:
    gate = Gate(ISO, settings(monitored=monitored, **changes))
    if stamp is not None:
        gate.admit(report(stamp), stamp + 1.0)
    return gate


def occupy(model: UnobservedSpace | Iso13855, people: Block, plan: Block) -> Block:
    out = new_people_sets()
    model.occupy(people, plan, out)
    return out


# --------------------------------------------------------------------------------------------- plain cases


def test_one_row_for_every_face_and_slice() -> None:
    watched = Monitored("cell", BOX, 0.2, 0.03)
    gate = gate_of(watched, clock_error_s=0.001, stamp_error_s=0.002)
    gate.admit(report(0.01, ("a", standing(1.0))), 1.0)
    model = UnobservedSpace(watched, ISO, index=4)
    out = occupy(model, gate.people, slices(np.array([0.1, 0.11, 0.13]), (0.004, 0.007)))
    assert (model.name, model.proves, model.inferred_parts(7)) == ("unobserved:cell", ALL_PARTS, 0)
    assert out["n"] == 12 and list(out["first"][0, :4]) == [0, 6, 12, 12]
    for i, end in enumerate((0.11, 0.13)):
        for k, (normal, offset) in zip(rows(out, i), zip(BOX.normal, BOX.offset, strict=True), strict=True):
            age = end + 0.007 + 0.001 - (0.01 - 0.002)
            assert out["radius"][0, k] == pytest.approx(0.03 + SPEED * (age + 0.2), abs=1e-8)
            assert out["covers"][0, k] == ALL_PARTS and out["n_points"][0, k] == 4
            assert (out["slice"][0, k], out["owner"][0, k], out["model"][0, k]) == (i, 1, 4)
            assert out["speed_max"][0, k] == SPEED
            np.testing.assert_allclose(out["points"][0, k, :3] @ normal, offset, atol=1e-10)
            assert out["points"][0, k, 3] @ normal > 200.0


def test_front_moves_at_the_fastest_speed_of_the_profile() -> None:
    watched = Monitored("cell", BOX, 0.0)
    out = occupy(UnobservedSpace(watched, TUM), gate_of(watched).people, slices(np.array([0.0, 0.1])))
    assert out["radius"][0, 0] == pytest.approx(0.1 * TUM.speed.max(), abs=1e-8)


def test_stamp_after_the_slice_grows_backwards() -> None:
    """Seen at 1 s, looked at on [0.2, 0.3] s: somebody in there then may have left before 1 s."""
    watched = Monitored("cell", BOX, 0.3)
    gate = gate_of(watched, stamp=1.0, clock_error_s=0.001, stamp_error_s=0.002)
    out = occupy(UnobservedSpace(watched, ISO), gate.people, slices(np.array([0.2, 0.3])))
    assert out["radius"][0, 0] == pytest.approx(SPEED * (0.8 + 0.002 + 0.001), abs=1e-8)


def test_no_rows_unless_people_may_be_unlisted_or_before_a_complete_report() -> None:
    watched = Monitored("cell", BOX, 0.1)
    model, plan = UnobservedSpace(watched, ISO), slices(np.array([0.0, 0.1]))
    assert occupy(model, gate_of(watched).people, plan)["n"] == 6
    assert occupy(model, gate_of().people, plan)["n"] == 0
    everybody_listed = gate_of(watched).people.copy()
    everybody_listed["unlisted"] = 0
    assert occupy(model, everybody_listed, plan)["n"] == 0
    assert occupy(model, gate_of(watched, stamp=None).people, plan)["n"] == 0
    gate = gate_of(watched, stamp=None)
    gate.admit(report(0.0)._replace(complete=False), 0.0)
    assert occupy(model, gate.people, plan)["n"] == 0
    gate.admit(report(-0.5), 0.0)
    assert occupy(model, gate.people, plan)["n"] == 6


def test_front_that_came_too_far_has_no_rows() -> None:
    watched = Monitored("cell", BOX, 0.0)
    model, people = UnobservedSpace(watched, ISO), gate_of(watched).people
    last = FARTHEST_FRONT_M / SPEED
    assert occupy(model, people, slices(np.array([0.0, last - 1e-3])))["n"] == 6
    assert occupy(model, people, slices(np.array([0.0, last + 1e-3])))["n"] == 0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["t_complete", "clock_error", "stamp_error", "t", "delay"])
def test_number_that_is_none_gives_no_row(field: str, value: float) -> None:
    watched = Monitored("cell", BOX, 0.1)
    people, plan = gate_of(watched).people.copy(), slices(np.array([0.0, 0.1]))
    (plan if field in ("t", "delay") else people)[field][...] = value
    assert occupy(UnobservedSpace(watched, ISO), people, plan)["n"] == 0


def test_content_of_the_block_before_does_not_matter() -> None:
    watched = Monitored("cell", BOX, 0.1)
    people, plan = gate_of(watched).people, slices(np.linspace(0.0, 1.0, MAX_SLICES + 1))
    used = new_people_sets()
    used.view(np.uint8)[:] = 255
    UnobservedSpace(watched, ISO).occupy(people, plan, used)
    fresh = occupy(UnobservedSpace(watched, ISO), people, plan)
    n = int(fresh["n"][0])
    assert used["n"] == n == 6 * MAX_SLICES
    for name in ("first", "n_points", "radius", "slice", "owner", "covers", "model", "speed_max", "points"):
        size = n if name != "first" else None
        np.testing.assert_array_equal(fresh[name][0, :size], used[name][0, :size])


@pytest.mark.parametrize("index", [-1, 8])
def test_index_must_fit_into_a_row(index: int) -> None:
    with pytest.raises(ModelError, match="index"):
        UnobservedSpace(Monitored("cell", BOX, 0.1), ISO, index=index)


def test_no_model_of_bodies_writes_rows_for_whoever_is_not_listed() -> None:
    watched = Monitored("cell", BOX, 0.1)
    gate = gate_of(watched)
    gate.admit(report(0.1, ("a", standing(1.0)), ("b", standing(-1.0))), 1.0)
    out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.1, 0.2])))
    assert set(out["owner"][0, : out["n"][0]].tolist()) == {0, 1}


# ----------------------------------------------------------------------------------------------- inclusion


def outside_of_rows(out: Block, i: int, region: Region, x: Array) -> float:
    """Distance [m] by which a point lies outside of all rows of slice i."""
    beyond = region.normal @ x - region.offset
    worst = math.inf
    for face in np.argsort(-beyond):
        k = rows(out, i)[int(face)]
        worst = min(worst, distance_to_hull(out["points"][0, k], x) - float(out["radius"][0, k]))
        if worst <= 0.0:
            return worst
    return worst


@dataclass(frozen=True)
class Errors:
    """Greatest errors of clock, stamp [s] and boundary [m], and the detection time [s]."""

    clock: float
    stamp: float
    boundary: float
    detection: float


def entering(
    rng: np.random.Generator, region: Region, errors: Errors, stamp: float, t: float
) -> Array | None:
    """Where somebody is at ``t`` who was just outside at some instant within the detection time.

    Mostly as bad as possible: just outside of one face, as long ago as possible, straight inwards at full
    speed. ``None``: the start was not outside of the true region.
    """
    off, tick = rng.choice([-1.0, 1.0], 2) if rng.random() < 0.7 else rng.uniform(-1.0, 1.0, 2)
    seen = stamp + off * errors.stamp + tick * errors.clock
    u = seen - errors.detection * rng.choice([0.0, 1.0, 1.0, rng.random()])
    face = int(rng.integers(len(region.offset)))
    normal = region.normal[face]
    across = np.cross(normal, unit(rng, 1)[0])
    start = region.offset[face] * normal + across * rng.choice([0.5, 2.0, 30.0])
    start = start + (rng.choice([0.0, 0.0, 2.0]) - errors.boundary) * normal
    if region.depth(start) > errors.boundary + 1e-12:
        return None
    way = -normal if rng.random() < 0.7 else unit(rng, 1)[0]
    moved: Array = start + SPEED * abs(t - u) * rng.choice([1.0, rng.random()]) * way
    return moved


def worst_excess(rng: np.random.Generator, n: int, forget: Forget, known: str = "") -> float:
    """Greatest distance [m] by which one of n points lies outside of the rows of one random case."""
    errors = Errors(*(float(rng.uniform(0.0, top)) for top in (0.02, 0.02, 0.05, 0.3)))
    region = regions(rng)[int(rng.integers(4))]
    told = replace(errors, **{known: 0.0}) if known else errors
    watched = Monitored("cell", region, told.detection, told.boundary)
    stamp = float(rng.uniform(-1.0, 1.0))
    gate = gate_of(watched, stamp=stamp, clock_error_s=errors.clock, stamp_error_s=errors.stamp)
    delay = (float(rng.uniform(0.0, 0.01)), float(rng.uniform(0.01, 0.05)))
    times = stamp + float(rng.choice([-0.5, 0.0, 0.3])) + np.cumsum(rng.uniform(0.0, 0.03, 12))
    people, plan = gate.people.copy(), slices(times, delay)
    forget(people, plan)
    out = occupy(UnobservedSpace(watched, ISO), people, plan)
    worst = -math.inf
    for _ in range(n):
        i = int(rng.integers(len(times) - 1))
        span = (times[i] + delay[0], times[i + 1] + delay[1])
        x = entering(rng, region, errors, stamp, float(rng.choice([*span, rng.uniform(*span)])))
        if x is not None:
            worst = max(worst, outside_of_rows(out, i, region, x))
    return worst


def test_whoever_was_outside_stays_inside_of_the_rows(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Who enters right after, or just before, the last complete report; a million are in test_inclusion."""
    worst, wanted = -math.inf, max(2_000, count(100_000))
    for _ in range(wanted // 100):
        excess = worst_excess(rng, 100, nothing)
        assert excess <= 1e-9
        worst = max(worst, excess)
    assert worst > -1e-6, "nobody came near the boundary: the test shows nothing"


@pytest.mark.parametrize("forget", [no_clock_error, no_stamp_error, no_delay, fresher])
def test_every_error_is_needed(rng: np.random.Generator, forget: Forget) -> None:
    assert any(worst_excess(rng, 80, forget) > 1e-3 for _ in range(40))


@pytest.mark.parametrize("known", ["detection", "boundary"])
def test_detection_time_and_boundary_error_are_needed(rng: np.random.Generator, known: str) -> None:
    assert any(worst_excess(rng, 80, nothing, known) > 1e-3 for _ in range(40))


def test_speed_is_needed(rng: np.random.Generator) -> None:
    watched = Monitored("cell", BOX, 0.1)
    slow = UnobservedSpace(watched, ISO.with_speed(1.6))
    out = occupy(slow, gate_of(watched).people, slices(np.array([0.1, 0.4])))
    assert outside_of_rows(out, 0, BOX, np.array([2.0 - 2.0 * 0.5, 0.0, 1.0])) == pytest.approx(0.2, abs=1e-6)


def test_rows_contain_all_that_matters_outside(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Points anywhere within both radii of the world's origin, without growth."""
    farthest = ARENA_M + FARTHEST_FRONT_M
    for _ in range(count(400)):
        for region in regions(rng):
            watched = Monitored("cell", region, 0.0)
            out = occupy(UnobservedSpace(watched, ISO), gate_of(watched).people, slices(np.zeros(2)))
            points = unit(rng, 30) * farthest * rng.choice([1.0, 0.99, 0.3, 0.02], 30)[:, None]
            for x in points[region.depth(points) <= 0.0]:
                assert outside_of_rows(out, 0, region, x) <= 0.0


def test_rows_hold_nothing_deep_inside(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """A point at depth d is d outside of every row: the rows are no larger than they must be."""
    for _ in range(count(1_000)):
        for region in regions(rng):
            watched = Monitored("cell", region, 0.0)
            out = occupy(UnobservedSpace(watched, ISO), gate_of(watched).people, slices(np.zeros(2)))
            points = rng.uniform(-3.0, 3.0, (20, 3))
            depths = region.depth(points)
            for x, depth in zip(points[depths > 0.0], depths[depths > 0.0], strict=True):
                assert outside_of_rows(out, 0, region, x) == pytest.approx(depth - ROUNDING_M, abs=1e-7)


def test_certificates_lose_less_than_a_micrometre(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """The gap that is proven for a link deep inside is its depth less both radii."""
    checked = 0
    for _ in range(count(5_000)):
        for region in regions(rng):
            watched = Monitored("cell", region, 0.0)
            people = gate_of(watched).people
            out = occupy(UnobservedSpace(watched, ISO), people, slices(np.array([0.0, 0.05])))
            axis = rng.uniform(-2.0, 2.0, 3) + 0.3 * rng.normal(size=(4, 3))
            truth = float(region.depth(axis).min()) - 0.05 - 2.0 * 0.05
            links = new_link_sets()
            links["n"], links["first"][0, 1:] = 1, 1
            links["points"][0, 0], links["n_points"][0, 0], links["radius"][0, 0] = axis, 4, 0.05
            ledger = new_ledger()
            open_obligations(ledger, 1, 1, [ALL_PARTS])
            found = Separation(margin=0.0).check(links, out, ledger)
            if truth > 1e-6:
                assert found.separated
                assert truth - 1e-6 < found.gap_m <= truth
                checked += 1
            else:
                assert not found.separated or found.gap_m <= truth
    assert checked > 10


# --------------------------------------------------------------------------------------------------- laws


def test_more_of_anything_never_shrinks_a_row(rng: np.random.Generator) -> None:
    watched = Monitored("cell", BOX, 0.1, 0.01)
    people = gate_of(watched, clock_error_s=0.001, stamp_error_s=0.001).people
    plan = slices(np.array([0.1, 0.2, 0.3]), (0.0, 0.01))
    base = occupy(UnobservedSpace(watched, ISO), people, plan)
    n = int(base["n"][0])
    older, unsure, late = people.copy(), people.copy(), plan.copy()
    older["t_complete"] -= 0.01
    unsure["clock_error"] += 0.01
    late["delay"][0, 1] += 0.01
    smaller = Region.box((-1.9, -3.0, -1.0), (2.0, 3.0, 3.0))
    for model, seen, when in (
        (UnobservedSpace(watched, ISO), older, plan),
        (UnobservedSpace(watched, ISO), unsure, plan),
        (UnobservedSpace(watched, ISO), people, late),
        (UnobservedSpace(watched, ISO.with_speed(2.5)), people, plan),
        (UnobservedSpace(Monitored("cell", BOX, 0.2, 0.01), ISO), people, plan),
        (UnobservedSpace(Monitored("cell", BOX, 0.1, 0.02), ISO), people, plan),
        (UnobservedSpace(Monitored("cell", smaller, 0.1, 0.01), ISO), people, plan),
    ):
        out = occupy(model, seen, when)
        assert out["n"] == n and (out["radius"][0, :n] >= base["radius"][0, :n]).all()
        for i in range(2):
            for x in rng.uniform(-4.0, 4.0, (20, 3)):
                if outside_of_rows(base, i, BOX, x) <= 0.0:
                    assert outside_of_rows(out, i, BOX, x) <= 1e-9


def test_rows_equal_those_of_a_plain_twin(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    for _ in range(count(20_000)):
        region = regions(rng)[int(rng.integers(4))]
        watched = Monitored("cell", region, float(rng.uniform(0, 0.3)), float(rng.uniform(0, 0.1)))
        clock, stamp_error, stamp = rng.uniform(0.0, 0.02, 3)
        gate = gate_of(watched, stamp=float(stamp), clock_error_s=clock, stamp_error_s=stamp_error)
        t, delay = np.sort(rng.uniform(-1.0, 1.0, 4)), np.sort(rng.uniform(0.0, 0.1, 2))
        out = occupy(UnobservedSpace(watched, ISO), gate.people, slices(t, (delay[0], delay[1])))
        seen = stamp - stamp_error
        begin = t[:-1] + delay[0] - 2.0 * stamp_error - clock
        end = t[1:] + delay[1] + clock
        elapsed = np.maximum(end - seen + watched.detection_time_s, seen - begin)
        radius = watched.boundary_error_m + ROUNDING_M + SPEED * elapsed
        faces = len(region.offset)
        np.testing.assert_allclose(out["radius"][0, : 3 * faces], np.repeat(radius, faces), atol=1e-12)
