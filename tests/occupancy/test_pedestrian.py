"""The pedestrian model: one point is enough, and nothing of a body ever lies outside of its capsule."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import ALL_PARTS, MAX_POINTS, Part, Point, Profile, load_profile
from occupancy.humans.pedestrian import ModelError, Pedestrian
from occupancy.sets import new_people_sets
from robots.motion import Block
from tests.occupancy.left_out import (
    Forget,
    no_clock_error,
    no_delay,
    no_position_error,
    no_stamp_error,
    nothing,
)
from tests.occupancy.moving_people import SEGMENTS, Known, Sensor, Trial, outside, unit
from tests.occupancy.people import mask, only, report, standing
from tests.occupancy.test_iso13855 import gate_with, random_case, slices

ISO, TUM = load_profile("iso"), load_profile("tum")
Array = np.ndarray


def occupy(model: Pedestrian, people: Block, plan: Block) -> Block:
    out = new_people_sets()
    model.occupy(people, plan, out)
    return out


def reach_by_hand(profile: Profile, q: Point, held: float) -> float:
    """Longest distance of anything of the body from q: over all parts, by the longest chains."""
    ends = {**SEGMENTS, Part.L_HAND: (Point.L_WRIST,) * 2, Part.R_HAND: (Point.R_WRIST,) * 2}
    return max(
        max(profile.chain[q, a], profile.chain[q, b])
        + profile.radius[part]
        + (held if part in (Part.L_HAND, Part.R_HAND) else 0.0)
        for part, (a, b) in ends.items()
    )


# --------------------------------------------------------------------------------------------- plain cases


@pytest.mark.parametrize("profile", [ISO, TUM], ids=["iso", "tum"])
def test_one_row_around_one_point(profile: Profile) -> None:
    gate = gate_with(("a", only(standing(), Point.PELVIS)), clock_error_s=0.001, stamp_error_s=0.002)
    model = Pedestrian(profile, floor_m=-0.1, held_object_m=0.2, index=2)
    out = occupy(model, gate.people, slices(np.array([0.1, 0.11, 0.13]), (0.004, 0.007)))
    assert model.name == "pedestrian" and model.proves == ALL_PARTS
    assert out["n"] == 2 and list(out["first"][0, :4]) == [0, 1, 2, 2]
    top = -0.1 + profile.radius[Part.L_FOOT] + reach_by_hand(profile, Point.L_ANKLE, 0.2)
    for i, end in enumerate((0.11, 0.13)):
        assert out["covers"][0, i] == ALL_PARTS and out["n_points"][0, i] == 2
        assert (out["slice"][0, i], out["owner"][0, i], out["model"][0, i]) == (i, 0, 2)
        np.testing.assert_allclose(out["points"][0, i, :2], [[2.0, 0.0, -0.1], [2.0, 0.0, top]], atol=1e-12)
        growth = 0.01 + profile.speed.max() * (end + 0.007 + 0.002 + 0.001)
        reach = reach_by_hand(profile, Point.PELVIS, 0.2)
        assert out["radius"][0, i] == pytest.approx(reach + growth, abs=1e-12)
        assert out["speed_max"][0, i] == profile.speed.max()


def test_any_point_will_do_and_the_shortest_reach_wins() -> None:
    model = Pedestrian(ISO)
    for point in Point:
        gate = gate_with(("a", only(standing(), point)), position_error_m=0.0)
        out = occupy(model, gate.people, slices(np.array([0.0, 0.0])))
        assert out["n"] == 1 and out["covers"][0, 0] == ALL_PARTS
        assert out["radius"][0, 0] == pytest.approx(reach_by_hand(ISO, point, 0.0))
        assert model.inferred_parts(mask(point)) == ALL_PARTS
    out = occupy(model, gate_with(("a", standing()), position_error_m=0.0).people, slices(np.zeros(2)))
    assert out["n"] == 1
    assert out["radius"][0, 0] == pytest.approx(min(reach_by_hand(ISO, p, 0.0) for p in Point))


def test_floor_may_be_a_whole_number() -> None:
    people, plan = gate_with(("a", standing())).people, slices(np.array([0.0, 0.2]))
    whole, decimal = (occupy(Pedestrian(ISO, floor_m=floor), people, plan) for floor in (0, 0.0))
    np.testing.assert_array_equal(whole["points"][0, 0, :2], decimal["points"][0, 0, :2])
    assert whole["n"] == 1 and whole["points"][0, 0, 0, 2] == 0.0


def test_height_of_the_point_does_not_matter() -> None:
    plan = slices(np.array([0.0, 0.2]))
    made = []
    for height in (-0.9, 3.0):
        lifted = only(standing(), Point.PELVIS)
        lifted[:, 2] += height
        made.append(occupy(Pedestrian(ISO), gate_with(("a", lifted)).people, plan))
    one, other = made
    assert one["n"] == other["n"] == 1
    np.testing.assert_array_equal(one["points"][0, 0, :2], other["points"][0, 0, :2])
    assert one["radius"][0, 0] == other["radius"][0, 0]


def test_stale_point_gives_way_to_a_fresh_one() -> None:
    gate = gate_with(("a", standing()), trust_sides=True)
    gate.admit(report(5.0, ("a", only(standing(x=3.0), Point.R_ANKLE))), 5.0)
    out = occupy(Pedestrian(ISO), gate.people, slices(np.array([5.0, 5.1])))
    assert out["points"][0, 0, 0, 0] == 3.0 and out["radius"][0, 0] < 4.0


def test_hypotheses_and_persons_have_a_row_each() -> None:
    gate = gate_with(("a", standing()), ("b", standing(y=4.0)))
    gate.admit(report(0.01, ("a", standing(x=9.0))), 0.01)
    out = occupy(Pedestrian(ISO), gate.people, slices(np.array([0.1, 0.2])))
    assert out["n"] == 3 and sorted(out["owner"][0, :3]) == [0, 1, 2]


def test_somebody_without_points_has_no_row() -> None:
    gate = gate_with(("a", np.full((MAX_POINTS, 3), np.nan)), ("b", standing()))
    out = occupy(Pedestrian(ISO), gate.people, slices(np.array([0.1, 0.2])))
    assert out["n"] == 1 and out["owner"][0, 0] == 1


@pytest.mark.parametrize("field", ["xyz", "e_p", "t_obs", "clock_error", "stamp_error"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_number_that_is_none_gives_no_row(field: str, value: float) -> None:
    people = gate_with(("a", only(standing(), Point.PELVIS))).people.copy()
    people[field] = value
    assert occupy(Pedestrian(ISO), people, slices(np.array([0.1, 0.2])))["n"] == 0


@pytest.mark.parametrize("changes", [{"floor_m": math.nan}, {"floor_m": 51.0}, {"held_object_m": -1.0}])
def test_what_is_not_usable_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ModelError, match="pedestrian: .*" + next(iter(changes))):
        Pedestrian(ISO, **changes)


def test_assumptions_name_the_floor_only_if_there_is_one() -> None:
    assert {a.name for a in Pedestrian(ISO, floor_m=0.3).assumptions()} - {
        a.name for a in Pedestrian(ISO).assumptions()
    } == {"people.floor"}


# ----------------------------------------------------------------------------------------------- inclusion


def body_points(trial: Trial, points: Array, held: float) -> Array:
    """Points (n, 3) on the surface of every part."""
    return np.vstack([trial.surface(points, set(), part, held) for part in Part])


def worst_excess(
    rng: np.random.Generator,
    *,
    forget: Forget = nothing,
    model: Callable[[float], Pedestrian] = lambda held: Pedestrian(ISO, held_object_m=held),
    aligned: bool,
) -> tuple[float, int]:
    """Greatest distance [m] by which a random person lies outside of their row, and the number of points."""
    sensor = Sensor(*(float(rng.uniform(0.0, top)) for top in (0.05, 0.02, 0.02)))
    trial = Trial(rng, ISO, sensor, unit(rng, 1)[0] * (1.0, 1.0, 0.0) if aligned else None)
    if aligned:
        assert trial.along is not None
        trial = Trial(rng, ISO, sensor, trial.along / np.linalg.norm(trial.along))
    case = random_case(trial)
    if case is None:
        return -math.inf, 0
    gate, known = case
    held = float(rng.choice([0.0, 0.3]))
    delay = (float(rng.uniform(0.0, 0.01)), float(rng.uniform(0.01, 0.05)))
    times = 10.0 + float(rng.choice([-0.2, 0.0, 0.4, 0.7])) + np.cumsum(rng.uniform(0.0, 0.03, 8))
    people, plan = gate.people.copy(), slices(times, delay)
    forget(people, plan)
    out = occupy(model(held), people, plan)
    assert out["n"] == len(times) - 1
    worst, checked = -math.inf, 0
    for i in range(len(times) - 1):
        span = (times[i] + delay[0], times[i + 1] + delay[1])
        points = trial.later(known, float(rng.choice([*span, rng.uniform(*span)])))
        if points is None:
            continue
        if aligned:
            points = stretched(trial, points, known, people, out, i)
        body = body_points(trial, points, held)
        checked += len(body)
        worst = max(worst, outside(body, out["points"][0, i, :2], float(out["radius"][0, i])))
    return worst, checked


def stretched(trial: Trial, points: Array, known: Known, people: Block, out: Block, i: int) -> Array:
    """The same instant, with every point as far along the common direction as its chain allows."""
    assert trial.along is not None
    seen = people["xyz"][0, 0]
    [column] = [p for p in Point if (seen[p, :2] == out["points"][0, i, 0, :2]).all()][:1]
    chain = ISO.chain[column][:, None]
    stretched: Array = points[column] + chain * trial.along
    return stretched


@pytest.mark.parametrize("aligned", [False, True])
def test_random_admissible_motion_stays_inside(
    rng: np.random.Generator, count: Callable[[int], int], aligned: bool
) -> None:
    """Through the gate, and over the whole surface of a body; a million bodies are in test_inclusion."""
    least = 10_000 if aligned else 2_000  # so many are needed for something to come near the boundary
    worst, made, wanted = -math.inf, 0, max(least, count(200_000))
    while made < wanted:
        excess, checked = worst_excess(rng, aligned=aligned)
        assert excess <= 1e-9
        worst, made = max(worst, excess), made + checked
    if aligned:
        assert worst > -0.01, "nothing came near the boundary: the test shows nothing"


@pytest.mark.parametrize("forget", [no_position_error, no_clock_error, no_stamp_error, no_delay])
def test_every_term_is_needed(rng: np.random.Generator, forget: Forget) -> None:
    assert any(worst_excess(rng, forget=forget, aligned=True)[0] > 1e-3 for _ in range(60))


@pytest.mark.parametrize("speed", [2.0, 1.6])
def test_held_object_and_speed_are_needed(rng: np.random.Generator, speed: float) -> None:
    def forgetful(held: float) -> Pedestrian:
        return Pedestrian(ISO.with_speed(speed), held_object_m=held if speed < 2.0 else 0.0)

    assert any(worst_excess(rng, model=forgetful, aligned=True)[0] > 1e-2 for _ in range(60))


def test_nobody_who_stands_on_the_floor_reaches_above_the_capsule(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """One foot touches the floor, the rest of the body hangs on it in any way, above the floor."""
    held, floor, highest = 0.3, -0.4, -math.inf
    model = Pedestrian(ISO, floor_m=floor, held_object_m=held)
    for k in range(count(100_000) // 20):
        trial = Trial(rng, ISO, Sensor(0.01, 0.0, 0.0), np.array([0.0, 0.0, 1.0]) if k % 2 else None)
        points = trial.admissible()
        if k % 2:
            points = ISO.chain[Point.L_ANKLE][:, None] * (0.0, 0.0, 1.0) + points[Point.L_ANKLE]
        ankle = min(points[Point.L_ANKLE, 2], points[Point.R_ANKLE, 2])
        points[:, 2] += floor + ISO.radius[Part.L_FOOT] * (1.0 if k % 2 else rng.random()) - ankle
        gate = gate_with(("a", only(points, Point.PELVIS)), position_error_m=0.0)
        out = occupy(model, gate.people, slices(np.zeros(2)))
        body = body_points(trial, points, held)
        body = body[body[:, 2] >= floor]
        assert outside(body, out["points"][0, 0, :2], float(out["radius"][0, 0])) <= 1e-9
        assert body[:, 2].max() <= out["points"][0, 0, 1, 2] + 1e-9
        highest = max(highest, body[:, 2].max() - out["points"][0, 0, 1, 2])
    assert highest > -0.01, "nobody reached up: the test shows nothing"


def test_more_speed_error_or_age_never_shrinks_a_row(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    walker, faster = Pedestrian(ISO), Pedestrian(ISO.with_speed(2.2))
    holding = Pedestrian(ISO, held_object_m=0.1)
    rows = same = 0
    for _ in range(count(3_000)):
        case = random_case(Trial(rng, ISO, Sensor(0.02, 0.003, 0.002), None))
        if case is None:
            continue
        people, plan = case[0].people, slices(np.array([10.7, 10.8]), (0.0, 0.01))
        base = occupy(walker, people, plan)
        wider, later, slower = people.copy(), plan.copy(), plan.copy()
        wider["e_p"] += 0.01
        later["t"] += 0.02
        slower["delay"][0, 1] += 0.02
        for out in (
            occupy(walker, wider, plan),
            occupy(walker, people, later),
            occupy(walker, people, slower),
            occupy(faster, people, plan),
            occupy(holding, people, plan),
        ):
            # about whichever point makes it least: of each the radius grows, and so does the least of them
            assert out["radius"][0, 0] >= base["radius"][0, 0]
            same += bool((base["points"][0, 0, :2] == out["points"][0, 0, :2]).all())
            rows += 1
    assert same > 0.99 * rows
