"""Kernels of people against plain twins, and on the very bounds that they state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import MAX_PARTS, MAX_POINTS, Part, Point, Profile, load_profile
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedPosition, ArticulatedVelocity
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.kernels import (
    choose_rows,
    contradiction,
    estimate_velocities,
    first_accelerated,
    first_outside,
    write_points,
)
from occupancy.humans.options import OptionModel
from occupancy.humans.pedestrian import Pedestrian
from occupancy.humans.unobserved import FARTHEST_FRONT_M, UnobservedSpace
from occupancy.hypotheses import HISTORY, HISTORY_DEPTH, PEOPLE, READING
from occupancy.measurement import Gate, RefusalReason
from occupancy.region import Monitored, Region
from occupancy.sets import new_people_sets
from robots.motion import Block, new_slices
from tests.occupancy.crowds import flat
from tests.occupancy.people import ALL_POINTS, mask, only, report, settings, standing

Array = NDArray[np.float64]
Count = Callable[[int], int]
ISO, TUM = load_profile("iso"), load_profile("tum")
GENTLE = flat(TUM, 2.0, 5.0)
ROUNDING_M, LARGEST_M = 1e-9, 1e6
"""What the kernels allow for rounding, and from where on a number is not usable [m]."""


def below(x: float) -> float:
    return math.nextafter(x, 0.0)


def above(x: float) -> float:
    return math.nextafter(x, math.inf)


def known(points: Array, *, e_p: float = 0.0, e_v: float = math.inf) -> Block:
    """Row 0 of a people block; every point seen at 0 s."""
    people = np.zeros(1, dtype=PEOPLE)
    people["n"], people["present"][0, 0] = 1, ALL_POINTS
    people["xyz"][0, 0], people["e_p"], people["e_read"], people["e_v"] = points, e_p, e_p, e_v
    return people


def seen(points: Array, t: float, e_p: float = 0.0) -> np.void:
    """A reading; NaN: not seen."""
    block = np.zeros(1, dtype=READING)
    block["xyz"], block["e_p"], block["e_read"], block["t_obs"] = points, e_p, e_p, t
    block["present"] = mask(*(Point(int(p)) for p in np.flatnonzero(np.isfinite(points[:, 0]))))
    return block[0]


def random_known(rng: np.random.Generator, profile: Profile) -> Block:
    """Somebody whose points were seen at different times, some of them never."""
    people = known(standing() + rng.normal(scale=0.03, size=(MAX_POINTS, 3)))
    record = people[0]
    for p in np.flatnonzero(rng.random(MAX_POINTS) < 0.2):
        record["present"][0] &= ~np.uint32(1 << int(p))
    record["t_obs"][0] = rng.uniform(-0.05, 0.05, MAX_POINTS)
    record["e_p"][0], record["e_v"][0] = rng.uniform(0.0, 0.02, (2, MAX_POINTS))
    record["e_v"][0, rng.random(MAX_POINTS) < 0.2] = math.inf
    record["v"][0] = rng.normal(scale=0.5, size=(MAX_POINTS, 3))
    record["stamp_error"], record["clock_error"] = rng.uniform(0.0, 0.01, 2)
    return people


def slack(record: np.void) -> float:
    return 2.0 * float(record["stamp_error"] + record["clock_error"])


def has(record: np.void, p: int) -> bool:
    return bool(int(record["present"][0]) >> p & 1)


# ------------------------------------------------------------------------------------------------- readings


@pytest.mark.parametrize("range_m", [5.0, 10.0])
def test_points_and_errors_up_to_the_range_are_read(range_m: float) -> None:
    """What lies 5 m or 10 m away is exact: 3-4-5."""
    there = np.full((MAX_POINTS, 3), np.nan)
    for far, e_p, reason in (
        (range_m, range_m, None),
        (above(range_m), 0.0, RefusalReason.TOO_FAR),
        (range_m, above(range_m), RefusalReason.BAD_ERROR),
    ):
        there[Point.HEAD] = (0.6 * range_m, 0.8 * range_m, 0.0) if far == range_m else (0.0, far, 0.0)
        gate = Gate(ISO, settings(range_m=range_m, position_error_m=e_p))
        found = [refusal.reason for refusal in gate.admit(report(0.0, ("a", there)), 0.0).refusals]
        assert found == ([] if reason is None else [reason])


@pytest.mark.parametrize("e_p", [0.0, 0.25])
def test_limbs_of_exactly_the_length_that_somebody_has_are_read(e_p: float) -> None:
    """Both ends on one axis, one of them at 0, so that the distance is exact."""
    limits = ISO.limits[0]
    for limb in range(int(limits["n_limbs"])):
        a, b = (int(p) for p in limits["limb"][limb])
        shortest = float(limits["limb_min"][limb]) - 2.0 * e_p
        longest = float(limits["limb_max"][limb]) + 2.0 * e_p
        for length, read in (
            (shortest, True), (below(shortest), shortest <= 0.0), (longest, True), (above(longest), False),
        ):  # fmt: skip
            points = np.full((MAX_POINTS, 3), np.nan)
            points[[a, b]] = (0.0, 0.0, 1.0), (max(length, 0.0), 0.0, 1.0)
            gate = Gate(ISO, settings(position_error_m=e_p))
            refusals = gate.admit(report(0.0, ("a", points)), 0.0).refusals
            assert {r.point for r in refusals} == (set() if read else {Point(a), Point(b)})


# -------------------------------------------------------------------------------------------- contradictions


def test_what_lies_exactly_as_far_as_rounding_allows_agrees() -> None:
    """A point that was seen without any error, at the same instant: nothing but rounding is allowed."""
    points = standing()
    points[Point.L_WRIST] = 0.0
    there = only(points, Point.L_WRIST)
    samples = (np.zeros(1), there[None], np.zeros((1, MAX_POINTS)))
    for off, agrees in ((ROUNDING_M, True), (above(ROUNDING_M), False)):
        there[Point.L_WRIST] = off, 0.0, 0.0
        people, body = known(points, e_v=0.0), GENTLE.limits
        people["present"] = mask(Point.L_WRIST)
        p, q, distance, allowed = contradiction(people[0], 0, seen(there, 0.0), body[0])
        later = first_outside(people, 0, samples, (-1.0, 0.0), body)
        moved = first_accelerated(people, 0, samples, (-1.0, 0.0), body)
        history = np.zeros(1, dtype=HISTORY)
        belied = estimate_velocities(people.copy()[0], 0, seen(there, 0.0), history[0], body[0])
        assert belied == (-1 if agrees else Point.L_WRIST)
        if agrees:
            assert (p, q, distance, allowed) == (-1, -1, 0.0, 0.0)
            assert later == (-1, -1, -1, 0.0, 0.0) and moved == (-1, -1, 0.0)
        else:
            assert (p, q, distance, allowed) == (Point.L_WRIST, Point.L_WRIST, off, ROUNDING_M)
            assert later == (0, Point.L_WRIST, Point.L_WRIST, off, ROUNDING_M)
            assert moved == (0, Point.L_WRIST, off - ROUNDING_M)


def test_the_worst_pair_is_that_of_a_plain_twin(rng: np.random.Generator, count: Count) -> None:
    body, agreed, cases = ISO.limits[0], 0, count(20_000)
    for _ in range(cases):
        people = random_known(rng, ISO)
        record = people[0]
        shown = standing() + rng.normal(scale=rng.choice([0.01, 0.1]), size=(MAX_POINTS, 3))
        shown[rng.random(MAX_POINTS) < 0.2] = np.nan
        reading = seen(shown, float(rng.uniform(-0.02, 0.05)))
        reading["e_p"] = rng.uniform(0.0, 0.02, MAX_POINTS)
        distance = np.linalg.norm(shown[:, None] - record["xyz"][0][None], axis=2)
        elapsed = np.abs(reading["t_obs"] - record["t_obs"][0]) + slack(record)
        grown = record["e_p"][0] + body["speed"] * elapsed
        excess = distance - body["chain"] - grown[None] - reading["e_p"][:, None] - ROUNDING_M
        excess[:, [not has(record, q) for q in range(MAX_POINTS)]] = np.nan
        p, q, far, allowed = contradiction(record, 0, reading, body)
        worst = float(np.nanmax(excess))
        if worst <= 0.0:
            agreed += 1
            assert (p, q) == (-1, -1)
            continue
        assert (p, q) == np.unravel_index(np.nanargmax(excess), excess.shape)
        assert far == pytest.approx(distance[p, q], abs=1e-12)
        assert far - allowed == pytest.approx(worst, abs=1e-12)
    assert 0 < agreed < cases


# ---------------------------------------------------------------------------------------------- later samples


def later(rng: np.random.Generator, spread: float) -> tuple[tuple[Array, Array, Array], tuple[float, float]]:
    """Samples and a window, whose ends are often stamps of samples."""
    n = int(rng.integers(1, 6))
    stamps = np.sort(rng.uniform(0.0, 0.1, n))
    xyz = standing() + rng.normal(scale=spread, size=(n, MAX_POINTS, 3))
    xyz[rng.random((n, MAX_POINTS)) < 0.3] = np.nan
    ends = [float(rng.choice([*stamps, x])) for x in (-0.01, 0.2)]
    return (stamps, xyz, rng.uniform(0.0, 0.02, (n, MAX_POINTS))), (min(ends), max(ends))


def excess_of_speeds(
    record: np.void, body: np.void, x: Array, e_p: float, t: float, p: int
) -> list[tuple[int, float, float]]:
    """(q, distance, allowed) of every point of the row that sample point p is held against."""
    found = []
    for q in [p] if has(record, p) else range(MAX_POINTS):
        if has(record, q):
            elapsed = abs(t - record["stamp_error"] - record["t_obs"][0, q]) + slack(record)
            moved = body["speed"][q] * elapsed
            allowed = body["chain"][p, q] + moved + e_p + record["e_p"][0, q] + ROUNDING_M
            found.append((q, float(np.linalg.norm(x - record["xyz"][0, q])), float(allowed)))
    return found


def test_the_first_sample_outside_is_that_of_a_plain_twin(rng: np.random.Generator, count: Count) -> None:
    outside, none = 0, 0
    for _ in range(count(20_000)):
        people = random_known(rng, GENTLE)
        record, body = people[0], GENTLE.limits[0]
        samples, window = later(rng, float(rng.choice([0.03, 0.1])))
        expected = next(
            (
                (i, p, q, distance, allowed)
                for i, t in enumerate(samples[0])
                for p in range(MAX_POINTS)
                for q, distance, allowed in excess_of_speeds(
                    record, body, samples[1][i, p], samples[2][i, p], t, p
                )
                if window[0] < t <= window[1] and distance > allowed
            ),
            None,
        )
        found = first_outside(people, 0, samples, window, GENTLE.limits)
        if expected is None:
            none += 1
            assert found == (-1, -1, -1, 0.0, 0.0)
        else:
            outside += 1
            assert found[:3] == expected[:3] and found[3:] == pytest.approx(expected[3:], abs=1e-12)
    assert outside > 0 < none


@pytest.mark.parametrize("point", Point)
def test_a_point_that_was_seen_is_held_against_itself_alone(point: Point) -> None:
    """However far the others were then; one that was not is held against whichever there is."""
    away = standing(x=9.0)
    away[point] = standing()[point]
    there = only(standing(), point)
    samples = (np.zeros(1), there[None], np.zeros((1, MAX_POINTS)))
    assert first_outside(known(away), 0, samples, (-1.0, 0.0), ISO.limits) == (-1, -1, -1, 0.0, 0.0)
    alone = known(away)
    for other in set(Point) - {point}:
        alone["present"] = mask(other)
        assert first_outside(alone, 0, samples, (-1.0, 0.0), ISO.limits)[:3] == (0, point, other)


def excess_of_motion(record: np.void, body: np.void, x: Array, e_p: float, t_obs: float, p: int) -> float:
    """How far [m] a sample lies outside of where point p can have come; NaN: nothing is claimed."""
    if not (has(record, p) and record["e_v"][0, p] < math.inf):
        return math.nan
    elapsed = t_obs - record["t_obs"][0, p]
    longest, v = abs(elapsed) + slack(record), record["v"][0, p]
    off = np.linalg.norm(x - record["xyz"][0, p] - elapsed * v)
    allowed = record["e_p"][0, p] + e_p + record["e_v"][0, p] * longest
    allowed += 0.5 * body["acceleration"][p] * longest**2 + np.linalg.norm(v) * slack(record)
    return float(off - allowed - ROUNDING_M)


def test_the_first_accelerated_sample_is_that_of_a_plain_twin(rng: np.random.Generator, count: Count) -> None:
    outside, none = 0, 0
    for _ in range(count(20_000)):
        people = random_known(rng, GENTLE)
        record, body = people[0], GENTLE.limits[0]
        samples, window = later(rng, float(rng.choice([0.01, 0.03])))
        expected = next(
            (
                (i, p, excess)
                for i, t in enumerate(samples[0])
                for p in range(MAX_POINTS)
                if window[0] < t <= window[1]
                for excess in [
                    excess_of_motion(
                        record, body, samples[1][i, p], samples[2][i, p], t - record["stamp_error"], p
                    )
                ]
                if excess > 0.0
            ),
            None,
        )
        found = first_accelerated(people, 0, samples, window, GENTLE.limits)
        if expected is None:
            none += 1
            assert found == (-1, -1, 0.0)
        else:
            outside += 1
            assert found[:2] == expected[:2] and found[2] == pytest.approx(expected[2], abs=1e-12)
    assert outside > 0 < none


# ------------------------------------------------------------------------------------------------ velocities


class Velocities:
    """What is known about the velocity of each point: a plain twin of what the gate keeps."""

    def __init__(self, body: np.void) -> None:
        self.body = body
        self.kept = [deque[tuple[float, Array, float]](maxlen=HISTORY_DEPTH) for _ in range(MAX_POINTS)]

    def take(self, record: np.void, reading: np.void) -> tuple[int, dict[int, tuple[float, Array | None]]]:
        """The point that belies the row most, or -1; and bound and velocity of every point of the reading."""
        there = [p for p in range(MAX_POINTS) if int(reading["present"]) >> p & 1]
        excess = np.full(MAX_POINTS, -math.inf)
        for p in there:
            args = reading["xyz"][p], float(reading["e_p"][p]), float(reading["t_obs"]), p
            excess[p] = np.nan_to_num(excess_of_motion(record, self.body, *args), nan=-math.inf)
        belied = int(np.argmax(excess)) if excess.max() > 0.0 else -1
        if belied >= 0:
            for samples in self.kept:
                samples.clear()
        known = {p: self._best(record, reading, p) for p in there}
        for p in there:
            self.kept[p].append((float(reading["t_obs"]), reading["xyz"][p].copy(), float(reading["e_p"][p])))
        return belied, known

    def _best(self, record: np.void, reading: np.void, p: int) -> tuple[float, Array | None]:
        best: tuple[float, Array | None] = math.inf, None
        for t, x, e_p in self.kept[p]:
            apart = float(reading["t_obs"]) - t
            if apart <= 0.0:
                continue
            bound = (reading["e_p"][p] + e_p + self.body["speed"][p] * slack(record)) / apart
            bound += 0.5 * self.body["acceleration"][p] * (apart + slack(record))
            if bound < best[0]:
                best = float(bound), (reading["xyz"][p] - x) / apart
        return best


def test_velocities_are_those_of_a_plain_twin(rng: np.random.Generator, count: Count) -> None:
    """More readings than are kept; some late, some that accelerations do not allow, some points unseen."""
    belied = late = 0
    for trial in range(max(2, count(400))):
        people, history = known(standing(x=9.0), e_v=0.0), np.zeros(1, dtype=HISTORY)
        people["present"] = 0
        record, body = people[0], GENTLE.limits[0]
        record["stamp_error"], record["clock_error"] = rng.uniform(0.001, 0.002, 2) * (trial % 2)
        twin, t, x, v = Velocities(body), 0.0, standing(), rng.normal(scale=0.3, size=(MAX_POINTS, 3))
        for i in range(HISTORY_DEPTH + 8):
            step = -0.03 if i == 19 or rng.random() < 0.1 else 0.02
            t, late = t + step, late + (step < 0.0)
            if i == 17 or rng.random() < 0.05:
                v = rng.normal(scale=1.0, size=(MAX_POINTS, 3))
            x = x + step * v
            shown = np.where(rng.random((MAX_POINTS, 1)) < 0.8, x, np.nan)
            reading = seen(shown, t)
            reading["e_p"] = rng.uniform(0.0, 0.003, MAX_POINTS)
            before = record["v"][0].copy()
            worst, expected = twin.take(record, reading)
            assert estimate_velocities(record, 0, reading, history[0], body) == worst, i
            belied += worst >= 0
            for p in range(MAX_POINTS):
                bound, velocity = expected.get(p, (math.inf if worst >= 0 else record["e_v"][0, p], None))
                assert record["e_v"][0, p] == pytest.approx(bound, rel=1e-12)
                np.testing.assert_allclose(record["v"][0, p], before[p] if velocity is None else velocity)
            write_points(record, 0, reading)
    assert belied > 0 < late


def test_a_jolt_is_followed_by_the_velocity_of_what_came_after_it() -> None:
    """Readings 20 ms apart, all of them exact; the one that belies is the first of the new ones."""
    people, history, body = known(standing()), np.zeros(1, dtype=HISTORY), GENTLE.limits[0]
    record, v = people[0], np.array([1.0, 0.5, 0.0])
    for t, x in ((0.0, 0.0), (0.02, 0.02), (0.06, 0.6), (0.08, 0.62), (0.1, 0.64)):
        reading = seen(standing() + x * v, t)
        belied = estimate_velocities(record, 0, reading, history[0], body)
        write_points(record, 0, reading)
        assert (belied >= 0) == (t == 0.06)
        assert np.isinf(record["e_v"][0]).all() == (t in (0.0, 0.06))
        assert (record["e_v"][0] == pytest.approx(0.5 * 5.0 * 0.02)) == (t in (0.02, 0.08, 0.1))


# ------------------------------------------------------------------------------------------------------ rows

MODELS = {
    "iso13855": Iso13855(TUM, index=3),
    "articulated_velocity": ArticulatedVelocity(TUM, index=3),
    "articulated_acceleration": ArticulatedAcceleration(TUM, index=3),
    "articulated_position": ArticulatedPosition(TUM, index=3),
    "pedestrian": Pedestrian(TUM, floor_m=0.0, index=3),
}


@pytest.mark.parametrize("name", MODELS)
def test_every_part_has_the_option_that_costs_least(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    table = MODELS[name]._table[0]
    for _ in range(max(10, count(1_000))):
        present = mask(*(p for p in Point if rng.random() < rng.choice([0.2, 0.9])))
        t_obs = rng.choice([0.0, 0.01, 0.2, 3.0]) * rng.random(MAX_POINTS)
        picked, covers = np.zeros(MAX_PARTS, np.int64), np.full(MAX_PARTS, -1)
        n = choose_rows(present, t_obs, table, picked, covers)
        assert len(set(picked[:n].tolist())) == n
        newest = max((t_obs[p] for p in range(MAX_POINTS) if present >> p & 1), default=0.0)
        for part in Part:
            cost = {
                int(row): float(table["chain"][row])
                + 2.0 * (newest - min(t_obs[table["point"][row, : table["n_points"][row]]]))
                for row in table["option"][part, : table["n_options"][part]]
                if int(table["needs"][row]) & ~present == 0
            }
            own = [
                int(row) for row, covered in zip(picked[:n], covers[:n], strict=True) if covered >> part & 1
            ]
            assert len(own) == bool(cost)
            assert all(cost[row] == pytest.approx(min(cost.values()), abs=1e-12) for row in own)


def at_once(model: OptionModel, people: Block, *times: float) -> Block:
    """Rows on slices whose ends are ``times``, delays and errors of clocks 0."""
    plan, out = new_slices(), new_people_sets()
    plan["n"], plan["t"][0, : len(times)] = len(times) - 1, times
    out.view(np.uint8)[:] = 255
    model.occupy(people, plan, out)
    return out


@pytest.mark.parametrize("name", MODELS)
def test_a_slice_without_length_at_the_instant_of_seeing_has_rows_that_did_not_grow(name: str) -> None:
    """Without any error: the radii are those of bodies and chains alone."""
    model = MODELS[name]
    out = at_once(model, known(standing(), e_v=0.0), 0.0, 0.0)
    rows = int(out["n"][0])
    assert rows > 0 and out["first"][0, 1] == rows
    assert set(out["radius"][0, :rows]) <= set(model._table["radius"][0])
    covered = np.bitwise_or.reduce(out["covers"][0, :rows])
    assert int(covered) == model.proves
    assert (out["model"][0, :rows] == 3).all() and (out["speed_max"][0, :rows] == 2.46).all()


def expected_rows(
    model: OptionModel, record: np.void, k: int, span: tuple[float, float]
) -> list[tuple[int, float, Array]]:
    """Parts, radius and points of each row of somebody, looked at during ``span`` [s]."""
    table, moving = model._table[0], isinstance(model, ArticulatedAcceleration)
    picked, covers = np.zeros(MAX_PARTS, np.int64), np.zeros(MAX_PARTS, np.int64)
    n = choose_rows(int(record["present"][k]), record["t_obs"][k], table, picked, covers)
    found = []
    for row, covered in zip(picked[:n], covers[:n], strict=True):
        grown, ends = 0.0, []
        for p in table["point"][row, : table["n_points"][row]]:
            ages = [t - record["t_obs"][k, p] for t in span]
            longest, x, v = max(abs(age) for age in ages), record["xyz"][k, p], record["v"][k, p]
            growth = longest * table["speed"][p]
            if moving:
                growth = longest * record["e_v"][k, p] + 0.5 * TUM.acceleration[p] * longest**2
            grown = max(grown, float(record["e_p"][k, p] + growth))
            ends.append([x + age * v for age in ages] if moving else [x])
        points = np.swapaxes(np.array(ends), 0, 1).reshape(-1, 3)
        if isinstance(model, Pedestrian):
            points = np.array([[*points[0, :2], z] for z in model._ends])
        if grown < math.inf:
            found.append((int(covered), float(table["radius"][row]) + grown, points))
    return found


@pytest.mark.parametrize("name", MODELS)
def test_rows_are_those_of_a_plain_twin(name: str, rng: np.random.Generator, count: Count) -> None:
    """Two persons, seen before, during and after the slices; without numbers that are not usable."""
    model = MODELS[name]
    for _ in range(max(5, count(1_000))):
        people, other = random_known(rng, TUM), random_known(rng, TUM)[0]
        record = people[0]
        record["n"] = 2
        for field in ("present", "t_obs", "xyz", "e_p", "v", "e_v"):
            record[field][1] = other[field][0]
        plan, out = new_slices(), new_people_sets()
        times, delay = np.cumsum(rng.uniform(0.0, 0.1, 4)) - 0.3, np.sort(rng.uniform(0.0, 0.05, 2))
        plan["n"], plan["t"][0, :4], plan["delay"][0] = 3, times, delay
        out.view(np.uint8)[:] = 255
        model.occupy(people, plan, out)
        wanted = []
        for i in range(3):
            assert out["first"][0, i] == len(wanted)
            begin = times[i] + delay[0] - 2.0 * record["stamp_error"] - record["clock_error"]
            end = times[i + 1] + delay[1] + record["clock_error"]
            for k in range(2):
                wanted += [(i, k, *row) for row in expected_rows(model, record, k, (begin, end))]
        assert out["n"] == len(wanted) and (out["first"][0, 3:] == len(wanted)).all()
        for r, (i, k, covered, radius, points) in enumerate(wanted):
            assert (out["slice"][0, r], out["owner"][0, r], out["covers"][0, r]) == (i, k, covered)
            assert out["radius"][0, r] == pytest.approx(radius, abs=1e-12)
            np.testing.assert_allclose(out["points"][0, r, : out["n_points"][0, r]], points, atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_an_error_below_nothing_gives_no_row(name: str) -> None:
    assert at_once(MODELS[name], known(standing(), e_p=-1e-3, e_v=0.0), 0.0, 0.0)["n"] == 0


@pytest.mark.parametrize("name", MODELS)
def test_numbers_from_a_thousand_kilometres_on_give_no_row(name: str) -> None:
    """And smaller ones do: on the very bound, of position errors and of coordinates of either sign."""
    model = MODELS[name]
    for value, usable in ((below(LARGEST_M), True), (LARGEST_M, False)):
        for field in ("e_p", "xyz"):
            for axis in range(3 if field == "xyz" else 1):
                for sign in (1.0, -1.0) if field == "xyz" else (1.0,):
                    people = known(standing(), e_v=0.0)
                    where = (0, 0, slice(None), axis) if field == "xyz" else (0, 0)
                    people[field][where] = sign * value
                    assert (at_once(model, people, 0.0, 0.0)["n"][0] > 0) == usable


def test_points_that_come_too_far_within_a_slice_give_no_row() -> None:
    """At either end of it; 1 m/s, exactly known."""
    model = ArticulatedAcceleration(flat(TUM, 2.0, 0.0))
    for speed, ends, usable in (
        (1.0, (0.0, 8.0), True), (1.0, (0.0, 16.0), False), (-1.0, (-8.0, 0.0), True),
        (-1.0, (-16.0, 0.0), False),
    ):  # fmt: skip
        people = known(standing(), e_v=0.0)
        people["xyz"][0, 0, :, 1], people["v"][0, 0, :, 1] = LARGEST_M - 16.0, speed
        assert (at_once(model, people, *ends)["n"][0] > 0) == usable


# ------------------------------------------------------------------------------------------ unobserved space

BOX = Region.box((-2.0, -3.0, -1.0), (2.0, 3.0, 3.0))


def unlisted(t_complete: float = 0.0) -> Block:
    people = np.zeros(1, dtype=PEOPLE)
    people["unlisted"], people["t_complete"] = 1, t_complete
    return people


def front(
    people: Block, *times: float, detection: float = 0.0, boundary: float = 0.0, speed: float = 1.0
) -> Block:
    plan, out = new_slices(), new_people_sets()
    plan["n"], plan["t"][0, : len(times)] = len(times) - 1, times
    out.view(np.uint8)[:] = 255
    watched = Monitored("cell", BOX, detection, boundary)
    UnobservedSpace(watched, flat(TUM, speed, 5.0)).occupy(people, plan, out)
    return out


def test_a_front_at_the_instant_of_the_report_has_rows_that_did_not_grow() -> None:
    out = front(unlisted(), 0.0, 0.0, boundary=0.25)
    assert out["n"] == 6 and (out["radius"][0, :6] == 0.25 + ROUNDING_M).all()


def test_a_front_has_rows_up_to_the_farthest_that_it_may_have_come() -> None:
    """Slices whose front came too far have none, and those before and after them keep theirs."""
    assert FARTHEST_FRONT_M == 100.0
    last = 100.0 - ROUNDING_M
    assert front(unlisted(), last, last)["n"] == 6
    assert front(unlisted(), above(last + 1e-13), above(last + 1e-13))["n"] == 0
    out = front(unlisted(), 0.0, 99.0, 200.0, 300.0, 400.0)
    assert out["n"] == 6 and (out["first"][0, 1:] == 6).all()
    out = front(unlisted(300.0), 100.0, 201.0, 250.0, 300.0)
    assert out["n"] == 12 and list(out["first"][0, :4]) == [0, 0, 6, 12] and (out["first"][0, 3:] == 12).all()


def test_a_slice_that_ends_before_it_begins_has_no_front() -> None:
    assert front(unlisted(), 0.5, 0.25)["n"] == 0
