"""The ISO 13855 model: inclusion of random admissible motion, laws, a plain twin, input that is no number."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from flint import arb

from occupancy.body import ALL_PARTS, MAX_POINTS, PART_NAMES, Part, Point, Profile, load_profile
from occupancy.humans.iso13855 import Iso13855, ModelError
from occupancy.measurement import Gate
from occupancy.sets import MAX_PEOPLE, new_people_sets
from robots.assumption import Certainty
from robots.motion import MAX_SLICES, Block, new_slices
from tests.occupancy.left_out import (
    Forget,
    fresher,
    no_clock_error,
    no_delay,
    no_position_error,
    no_stamp_error,
    not_ahead,
    nothing,
)
from tests.occupancy.moving_people import Known, Sensor, Trial, outside, unit
from tests.occupancy.people import ALL_POINTS, mask, only, report, settings, standing
from tests.oracles.hulls import exact_point_distance

ISO = load_profile("iso")
Array = np.ndarray


def slices(times: Array, delay: tuple[float, float] = (0.0, 0.0)) -> Block:
    block = new_slices()
    block["n"] = len(times) - 1
    block["t"][0, : len(times)] = times
    block["delay"] = delay
    return block


def gate_with(*people: tuple[str, Array], stamp: float = 0.0, **changes: object) -> Gate:
    gate = Gate(ISO, settings(**changes))
    gate.admit(report(stamp, *people), stamp)
    return gate


def occupy(model: Iso13855, people: Block, plan: Block) -> Block:
    out = new_people_sets()
    model.occupy(people, plan, out)
    return out


def rows(out: Block, i: int) -> list[int]:
    return list(range(int(out["first"][0, i]), int(out["first"][0, i + 1])))


def parts(covers: int) -> set[str]:
    return {name for bit, name in enumerate(PART_NAMES) if covers >> bit & 1}


# ------------------------------------------------------------------------------------------------- set-up


@pytest.mark.parametrize("speed", [math.nan, math.inf, -2.0, 0.0, 1.999])
def test_speed_below_what_reports_are_checked_against_is_refused(speed: float) -> None:
    with pytest.raises(ModelError, match=r"approach_speed .* not below 2.0 m/s"):
        Iso13855(ISO, approach_speed=speed)


@pytest.mark.parametrize("held", [math.nan, math.inf, -0.1])
def test_held_object_must_have_a_length(held: float) -> None:
    with pytest.raises(ModelError, match="held_object_m"):
        Iso13855(ISO, held_object_m=held)


@pytest.mark.parametrize("index", [-1, 8])
def test_index_must_fit_into_a_row(index: int) -> None:
    with pytest.raises(ModelError, match="index"):
        Iso13855(ISO, index=index)


def test_assumptions_state_speed_and_held_object_once() -> None:
    for model, speed, held in (
        (Iso13855(ISO), (2.0, Certainty.SOURCED), (0.0, Certainty.DEFAULT)),
        (
            Iso13855(ISO, approach_speed=2.5, held_object_m=0.3),
            (2.5, Certainty.DECLARED),
            (0.3, Certainty.DECLARED),
        ),
        (Iso13855(ISO.with_speed(1.6)), (1.6, Certainty.SOURCED), (0.0, Certainty.DEFAULT)),
    ):
        stated = {a.name: (a.value, a.certainty) for a in model.assumptions()}
        assert len(stated) == len(model.assumptions())
        assert stated["people.iso.speed.every_point"] == speed
        assert stated["people.held_object"] == held
        assert "people.iso.radius.hand" in stated


# --------------------------------------------------------------------------------------------- plain cases


def test_measured_body_is_enclosed_as_the_paper_says() -> None:
    """One row each: trunk, limbs, hands and feet; radius = body + e_p + v Δt to the end of the slice."""
    gate = gate_with(("a", standing()), clock_error_s=0.001, stamp_error_s=0.002)
    out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.1, 0.11, 0.13]), (0.004, 0.007)))
    assert out["n"] == 26 and list(out["first"][0, :4]) == [0, 13, 26, 26]
    expected = {
        ("head", "neck", "torso", "pelvis"): (0.35, ("pelvis", "thorax", "neck_base", "head")),
        **{(f"{s}_upper_arm",): (0.1, (f"{s}_shoulder", f"{s}_elbow")) for s in "lr"},
        **{(f"{s}_forearm",): (0.1, (f"{s}_elbow", f"{s}_wrist")) for s in "lr"},
        **{(f"{s}_hand",): (0.205, (f"{s}_wrist",)) for s in "lr"},
        **{(f"{s}_thigh",): (0.1, (f"{s}_hip", f"{s}_knee")) for s in "lr"},
        **{(f"{s}_shank",): (0.1, (f"{s}_knee", f"{s}_ankle")) for s in "lr"},
        **{(f"{s}_foot",): (0.3, (f"{s}_ankle",)) for s in "lr"},
    }
    body = standing()
    for i, end in enumerate((0.11, 0.13)):
        found = {}
        for k in rows(out, i):
            points = {tuple(p) for p in out["points"][0, k, : out["n_points"][0, k]]}
            found[frozenset(parts(int(out["covers"][0, k])))] = (float(out["radius"][0, k]), points)
            assert (out["slice"][0, k], out["owner"][0, k], out["model"][0, k]) == (i, 0, 0)
            assert out["speed_max"][0, k] == 2.0
        growth = 0.01 + 2.0 * (end + 0.007 - (0.0 - 0.002) + 0.001)
        assert found.keys() == {frozenset(key) for key in expected}
        for key, (radius, names) in expected.items():
            assert found[frozenset(key)][0] == pytest.approx(radius + growth, abs=1e-12)
            assert found[frozenset(key)][1] == {tuple(body[Point[name.upper()]]) for name in names}


def test_held_object_lengthens_the_hands_only() -> None:
    gate = gate_with(("a", standing()))
    plan = slices(np.array([0.0, 0.1]))
    bare, holding = (occupy(Iso13855(ISO, held_object_m=h), gate.people, plan) for h in (0.0, 0.4))
    for k in rows(bare, 0):
        grown = holding["radius"][0, k] - bare["radius"][0, k]
        hand = parts(int(bare["covers"][0, k])) & {"l_hand", "r_hand"}
        assert grown == pytest.approx(0.4 if hand else 0.0, abs=1e-12)


def test_measurement_later_than_the_slice_grows_backwards() -> None:
    """Seen at 1 s, looked at on [0.2, 0.3] s: the body was up to 0.8 s · 2 m/s away, errors added."""
    gate = gate_with(("a", standing()), stamp=1.0, clock_error_s=0.001, stamp_error_s=0.002)
    out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.2, 0.3])))
    [foot] = [k for k in rows(out, 0) if parts(int(out["covers"][0, k])) == {"l_foot"}]
    assert out["radius"][0, foot] == pytest.approx(0.3 + 0.01 + 2.0 * (0.8 + 0.002 + 0.001), abs=1e-12)


def test_each_hypothesis_and_person_has_rows_of_its_own() -> None:
    gate = gate_with(("a", standing()), ("b", standing(y=4.0)))
    gate.admit(report(0.01, ("a", standing(x=4.0))), 0.01)
    out = occupy(Iso13855(ISO, index=3), gate.people, slices(np.array([0.1, 0.2, 0.3])))
    for i in range(2):
        owners = [int(out["owner"][0, k]) for k in rows(out, i)]
        assert [owners.count(k) for k in range(3)] == [13, 13, 13]
        assert (out["slice"][0, rows(out, i)] == i).all() and (out["model"][0, rows(out, i)] == 3).all()
        for owner in range(3):
            covered = 0
            for k in rows(out, i):
                covered |= int(out["covers"][0, k]) if out["owner"][0, k] == owner else 0
            assert covered == ALL_PARTS


def test_most_rows_fit_into_the_block() -> None:
    gate = Gate(ISO, settings(max_people=MAX_PEOPLE))
    lone = mask(Point.L_ELBOW)
    for k in range(MAX_PEOPLE):
        xyz = only(standing(y=3.0 * k), Point.L_ELBOW)
        gate.admit(report(0.0, (str(k), xyz)), 0.0)
    assert (gate.people["present"] == lone).all()
    out = occupy(Iso13855(ISO), gate.people, slices(np.linspace(0.0, 1.0, MAX_SLICES + 1)))
    assert out["n"] <= MAX_SLICES * MAX_PEOPLE * 16
    for i in range(MAX_SLICES):
        covered = np.zeros(MAX_PEOPLE, np.uint32)
        np.bitwise_or.at(covered, out["owner"][0, rows(out, i)], out["covers"][0, rows(out, i)])
        assert (covered == ALL_PARTS).all()


def test_content_of_the_block_before_does_not_matter() -> None:
    gate = gate_with(("a", standing()))
    plan = slices(np.array([0.0, 0.1, 0.2]))
    fresh, used = new_people_sets(), new_people_sets()
    used.view(np.uint8)[:] = 255
    Iso13855(ISO).occupy(gate.people, plan, fresh)
    Iso13855(ISO).occupy(gate.people, plan, used)
    n = int(fresh["n"][0])
    assert used["n"] == n
    np.testing.assert_array_equal(fresh["first"], used["first"])
    for name in ("n_points", "radius", "slice", "owner", "covers", "model", "speed_max"):
        np.testing.assert_array_equal(fresh[name][0, :n], used[name][0, :n])
    for k in range(n):
        np.testing.assert_array_equal(*(b["points"][0, k, : b["n_points"][0, k]] for b in (fresh, used)))


def test_nobody_gives_no_rows() -> None:
    out = occupy(Iso13855(ISO), Gate(ISO, settings()).people, slices(np.array([0.0, 0.1])))
    assert out["n"] == 0 and (out["first"] == 0).all()


# ----------------------------------------------------------------------------------------------- inference


@pytest.mark.parametrize(
    ("seen", "inferred"),
    [
        (ALL_POINTS, set()),
        (ALL_POINTS & ~mask(Point.L_HAND, Point.L_FINGERTIP, Point.THORAX), set()),
        (ALL_POINTS & ~mask(Point.THORAX, Point.NECK_BASE), {"neck", "torso"}),
        (ALL_POINTS & ~mask(Point.L_WRIST), {"l_forearm"}),
        (ALL_POINTS & ~mask(Point.HEAD), {"head", "neck"}),
        (ALL_POINTS & ~mask(Point.PELVIS), {"pelvis", "torso"}),
        (ALL_POINTS & ~mask(Point.R_ANKLE), {"r_shank", "r_foot"}),
        (
            ALL_POINTS & ~mask(Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
            {"l_upper_arm", "l_forearm", "l_hand"},
        ),
        (mask(Point.HEAD), set(PART_NAMES) - {"head"}),
        (0, set()),
    ],
)
def test_parts_without_their_points_are_named_as_inferred(seen: int, inferred: set[str]) -> None:
    assert parts(Iso13855(ISO).inferred_parts(seen)) == inferred


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
def test_a_bent_neck_is_inside_where_only_head_and_pelvis_are_seen(angle: float) -> None:
    """The capsule from head to pelvis holds no neck base that is off the line; A1 has the torso around it."""
    pelvis = np.array([2.0, 0.0, 1.0])
    neck_base = pelvis + np.array([0.0, 0.0, 0.288 * 1.9])
    head = neck_base + 0.182 * 1.9 * np.array([math.sin(angle), 0.0, math.cos(angle)])
    xyz = np.full((MAX_POINTS, 3), np.nan)
    xyz[Point.PELVIS], xyz[Point.NECK_BASE], xyz[Point.HEAD] = pelvis, neck_base, head
    seen = {
        "two points": gate_with(("a", only(xyz, Point.PELVIS, Point.HEAD)), position_error_m=0.0),
        "an older neck base": gate_with(("a", xyz), position_error_m=0.0),
    }
    moved = only(xyz, Point.PELVIS, Point.HEAD) + 1e-4
    seen["an older neck base"].admit(report(0.01, ("a", moved)), 0.01)
    for what, gate in seen.items():
        out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.01, 0.0101])))
        for part in (Part.TORSO, Part.NECK):
            (row,) = (k for k in rows(out, 0) if int(out["covers"][0, k]) >> part & 1)
            hull = out["points"][0, row, : out["n_points"][0, row]]
            room = float(out["radius"][0, row]) - float(ISO.radius[part])
            assert exact_point_distance(neck_base, hull) <= room + 1e-12, (what, part)


def test_part_is_inferred_by_chain_from_the_nearest_point() -> None:
    """Elbow seen, wrist and hand not: forearm and hand may point anywhere; 0.146 and 0.108 of 1.90 m."""
    xyz = only(standing(), *[p for p in Point if p.name not in ("L_WRIST", "L_HAND", "L_FINGERTIP")])
    gate = gate_with(("a", xyz), position_error_m=0.0)
    out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.0, 0.0])))
    found = {
        name: k
        for k in rows(out, 0)
        for name in parts(int(out["covers"][0, k]))
        if name in ("l_forearm", "l_hand")
    }
    for name, radius in (("l_forearm", 0.146 * 1.9 + 0.1), ("l_hand", 0.146 * 1.9 + 0.205)):
        k = found[name]
        assert out["n_points"][0, k] == 1
        np.testing.assert_array_equal(out["points"][0, k, 0], xyz[Point.L_ELBOW])
        assert out["radius"][0, k] == pytest.approx(radius)


def test_stale_point_gives_way_to_a_fresh_neighbour() -> None:
    """A wrist not seen for 10 s would be a ball of 20 m; the elbow seen now bounds it by the forearm."""
    gate = gate_with(("a", standing()), trust_sides=True)
    fresh = standing()
    fresh[[Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP]] = np.nan
    gate.admit(report(10.0, ("a", fresh)), 10.0)
    model = Iso13855(ISO)
    out = occupy(model, gate.people, slices(np.array([10.0, 10.1])))
    assert max(out["radius"][0, rows(out, 0)]) < 1.0
    record = gate.people[0]
    late = model.inferred_parts(int(record["present"][0]), record["t_obs"][0])
    assert parts(late) == {"l_forearm", "l_hand"}
    assert model.inferred_parts(int(record["present"][0])) == 0


def _twin(profile: Profile, seen: list[int], age: Array, part: Part, held: float) -> tuple[float, float]:
    """Least chain + 2 m/s · age of all ways to enclose a part, and its radius: tries every pair."""
    hand = part in (Part.L_HAND, Part.R_HAND)
    ends = {
        Part.HEAD: ("HEAD", "HEAD"), Part.NECK: ("NECK_BASE", "HEAD"), Part.TORSO: ("PELVIS", "NECK_BASE"),
        Part.PELVIS: ("PELVIS", "PELVIS"), Part.L_UPPER_ARM: ("L_SHOULDER", "L_ELBOW"),
        Part.L_FOREARM: ("L_ELBOW", "L_WRIST"), Part.R_UPPER_ARM: ("R_SHOULDER", "R_ELBOW"),
        Part.R_FOREARM: ("R_ELBOW", "R_WRIST"), Part.L_THIGH: ("L_HIP", "L_KNEE"),
        Part.L_SHANK: ("L_KNEE", "L_ANKLE"), Part.R_THIGH: ("R_HIP", "R_KNEE"),
        Part.R_SHANK: ("R_KNEE", "R_ANKLE"),
        Part.L_FOOT: ("L_ANKLE", "L_ANKLE"), Part.R_FOOT: ("R_ANKLE", "R_ANKLE"),
        Part.L_HAND: ("L_WRIST", "L_WRIST"), Part.R_HAND: ("R_WRIST", "R_WRIST"),
    }[part]  # fmt: skip
    a, b = (Point[name] for name in ends)
    ways = []
    for m1 in seen:
        for m2 in seen if a != b else [m1]:
            chain = max(profile.chain[m1, a], profile.chain[m2, b])
            ways.append((chain, max(age[m1], age[m2])))
        if hand and Point(m1).name[:2] == a.name[:2] and Point(m1).name[2:] in ("HAND", "FINGERTIP"):
            ways.append((0.0, age[m1]))
    cost, chain = min((chain + 2.0 * old, chain) for chain, old in ways)
    return cost, float(profile.radius[part]) + (held if hand else 0.0) + chain


def test_rows_equal_those_of_a_plain_twin(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Presence and ages at random: the least cost among all pairs, the radius from the row's own points."""
    held = 0.13
    model = Iso13855(ISO, held_object_m=held)
    for _ in range(count(20_000)):
        gate = gate_with(("a", standing()), clock_error_s=0.002, stamp_error_s=0.003)
        block, record = gate.people, gate.people[0]
        seen = [p for p in range(MAX_POINTS) if rng.random() < rng.choice([0.2, 0.6, 0.95])] or [3]
        record["present"][0] = sum(1 << p for p in seen)
        age = rng.choice([0.0, 0.0, 0.05, 0.3, 2.0], MAX_POINTS)
        age -= age[seen].min()
        record["t_obs"][0], record["e_p"][0] = 1.0 - age, rng.uniform(0.0, 0.1, MAX_POINTS)
        end = float(rng.uniform(1.0, 2.0))
        out = occupy(model, block, slices(np.array([0.99, end]), (0.0, 0.01)))
        covered = 0
        for k in rows(out, 0):
            used = [_column(record, point) for point in out["points"][0, k, : out["n_points"][0, k]]]
            growth = max(
                record["e_p"][0, p]
                + 2.0 * max(end + 0.01 - (1.0 - age[p]) + 0.002, 1.0 - age[p] + 0.008 - 0.99)
                for p in used
            )
            for part in Part:
                if not int(out["covers"][0, k]) >> part & 1:
                    continue
                cost, radius = _twin(ISO, seen, age, part, held)
                chain = float(out["radius"][0, k]) - growth - float(ISO.radius[part])
                chain -= held if part in (Part.L_HAND, Part.R_HAND) else 0.0
                assert chain + 2.0 * max(age[p] for p in used) == pytest.approx(cost, abs=1e-9)
                if chain < 1e-9 or cost == pytest.approx(chain, abs=1e-9):
                    assert out["radius"][0, k] <= radius + growth + 1e-9
            covered |= int(out["covers"][0, k])
        assert covered == ALL_PARTS


def _column(record: np.void, point: Array) -> int:
    [column] = [p for p in range(MAX_POINTS) if (record["xyz"][0, p] == point).all()]
    return column


# ----------------------------------------------------------------------------------------------- inclusion


@cache
def model_for(held: float) -> Iso13855:
    return Iso13855(ISO, held_object_m=held)


def random_case(trial: Trial) -> tuple[Gate, Known] | None:
    """A person seen once or twice, in part: what the gate keeps, and the truth behind it."""
    rng, sensor = trial.rng, trial.sensor
    gate = Gate(
        trial.profile,
        settings(
            clock_error_s=sensor.clock_error, stamp_error_s=sensor.stamp_error, position_error_m=sensor.e_p
        ),
    )
    known = Known(trial.admissible(), np.zeros(MAX_POINTS), np.zeros(MAX_POINTS, bool))
    stamp, points = 10.0, known.points
    for _ in range(int(rng.integers(1, 3))):
        lost = rng.random(MAX_POINTS) < rng.choice([0.0, 0.2, 0.8])
        xyz, instant = trial.report(points, stamp)
        xyz[lost] = np.nan
        if gate.admit(report(stamp, ("a", xyz)), stamp + 1.0).contradictions:
            return None
        new = gate.people["t_obs"][0, 0] == stamp - sensor.stamp_error
        known.points[new], known.t[new] = points[new], instant
        known.seen |= new
        if not known.seen.any():
            return None
        stamp += float(rng.choice([0.01, 0.1, 0.5]))
        moved = trial.later(known, stamp)
        if moved is None:
            return None
        points = moved
    return gate, known


def worst_excess(
    rng: np.random.Generator,
    *,
    forget: Forget = nothing,
    aligned: bool,
) -> float:
    """Greatest distance [m] by which a part of one random person lies outside of its row; -inf: none made."""
    sensor = Sensor(
        float(rng.uniform(0.0, 0.05)), float(rng.uniform(0.0, 0.02)), float(rng.uniform(0.0, 0.02))
    )
    trial = Trial(rng, ISO, sensor, unit(rng, 1)[0] if aligned else None)
    case = random_case(trial)
    if case is None:
        return -math.inf
    gate, known = case
    held = float(rng.choice([0.0, 0.3]))
    begin = 10.0 + float(rng.choice([-0.2, 0.0, 0.4, 0.7]))
    delay = (float(rng.uniform(0.0, 0.01)), float(rng.uniform(0.01, 0.05)))
    times = begin + np.cumsum(rng.uniform(0.0, 0.03, int(rng.integers(2, 31))))
    plan = slices(times, delay)
    people = gate.people.copy()
    forget(people, plan)
    out = occupy(model_for(held), people, plan)
    worst = -math.inf
    for i in {int(rng.integers(len(times) - 1)), len(times) - 2}:
        span = (times[i] + delay[0], times[i + 1] + delay[1])
        points = trial.later(known, float(rng.choice([*span, rng.uniform(*span)])))
        if points is not None:
            worst = max(worst, worst_of_slice(trial, points, gate.people[0], out, i, held))
    return worst


def worst_of_slice(trial: Trial, points: Array, seen: np.void, out: Block, i: int, held: float) -> float:
    """Greatest distance [m] by which a part of the body at ``points`` lies outside of its row on slice i."""
    worst, covered = -math.inf, 0
    for k in rows(out, i):
        stands_on = out["points"][0, k, : out["n_points"][0, k]]
        used = {Point(p) for p in Point for x in stands_on if (seen["xyz"][0, p] == x).all()}
        for part in Part:
            if int(out["covers"][0, k]) >> part & 1:
                body = trial.surface(points, used, part, held)
                worst = max(worst, outside(body, stands_on, float(out["radius"][0, k])))
        covered |= int(out["covers"][0, k])
    assert covered == ALL_PARTS
    return worst


@pytest.mark.parametrize("aligned", [False, True])
def test_random_admissible_motion_stays_inside(
    rng: np.random.Generator, count: Callable[[int], int], aligned: bool
) -> None:
    """Through the gate, and over the whole surface of a body; a million motions are in test_inclusion."""
    worst, made, wanted = -math.inf, 0, count(2_000)
    for _ in range(20 * wanted):
        excess = worst_excess(rng, aligned=aligned)
        assert excess <= 1e-9
        made += excess > -math.inf
        worst = max(worst, excess)
        if made == wanted:
            break
    assert made == wanted
    if aligned:
        assert worst > -1e-6, "nothing came near the boundary: the test shows nothing"


@pytest.mark.parametrize(
    "forget", [no_position_error, no_clock_error, no_stamp_error, no_delay, fresher, not_ahead]
)
def test_every_term_is_needed(rng: np.random.Generator, forget: Forget) -> None:
    assert any(worst_excess(rng, forget=forget, aligned=True) > 1e-3 for _ in range(60))


def test_motion_above_the_speed_gets_out(rng: np.random.Generator) -> None:
    """The body of the trial obeys 2.4 m/s, the rows 2.0 m/s."""
    sensor = Sensor(0.01, 0.0, 0.0)
    worst = -math.inf
    for _ in range(30):
        trial = Trial(rng, ISO.with_speed(2.4), sensor, unit(rng, 1)[0])
        xyz, instant = trial.report(standing(), 0.0)
        gate = gate_with(("a", xyz))
        known = Known(standing(), np.full(MAX_POINTS, instant), np.ones(MAX_POINTS, bool))
        out = occupy(Iso13855(ISO), gate.people, slices(np.array([0.1, 0.3])))
        points = trial.later(known, 0.3)
        assert points is not None
        worst = max(worst, worst_of_slice(trial, points, gate.people[0], out, 0, 0.0))
    assert worst == pytest.approx(0.4 * 0.3, abs=1e-8)


def test_radii_agree_with_exact_arithmetic(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Rounding stays below 1e-13 m, a tenth of the slack that every certificate of separation subtracts."""
    for _ in range(count(2_000)):
        clock = float(rng.uniform(0.0, 0.1))
        gate = gate_with(("a", standing()), clock_error_s=clock)
        record = gate.people[0]
        record["e_p"][0] = rng.uniform(0.0, 0.1, MAX_POINTS)
        seen = float(rng.uniform(-1.0, 0.0))
        record["t_obs"][0] = seen
        plan = slices(np.cumsum(rng.uniform(0.0, 0.05, 5)), (0.001, 0.01))
        out = occupy(model_for(0.0), gate.people, plan)
        elapsed = arb(float(plan["t"][0, 4])) + arb(0.01) + arb(clock) - arb(seen)
        for k in rows(out, 3):
            used = [_column(record, point) for point in out["points"][0, k, : out["n_points"][0, k]]]
            part = min(p for p in Part if int(out["covers"][0, k]) >> p & 1)
            e_p = max(float(record["e_p"][0, p]) for p in used)
            exact = arb(float(ISO.radius[part])) + arb(e_p) + 2 * elapsed
            assert abs(exact - arb(float(out["radius"][0, k]))) < 1e-13


# -------------------------------------------------------------------------------------------------- laws


def later_plan(plan: Block, by: float) -> Block:
    moved = plan.copy()
    moved["t"] += by
    return moved


def test_more_speed_error_age_or_delay_never_shrinks_a_set(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Same rows around the same points, no radius smaller: nothing more can be proven."""
    for _ in range(count(10_000)):
        sensor = Sensor(0.02, 0.003, 0.002)
        case = random_case(Trial(rng, ISO, sensor, None))
        if case is None:
            continue
        gate, _ = case
        plan = slices(11.0 + np.cumsum(rng.uniform(0.0, 0.03, 12)), (0.001, 0.004))
        model = model_for(0.0)
        base = occupy(model, gate.people, plan)
        more, amount = gate.people.copy(), float(rng.uniform(0.0, 0.3))
        what = int(rng.integers(7))
        if what == 0:
            model = Iso13855(ISO, approach_speed=2.0 + 10.0 * amount)
        elif what == 1:
            more["e_p"] += amount * rng.random(more["e_p"].shape)
        elif what == 2:
            more["clock_error"] += amount
        elif what == 3:
            more["stamp_error"] += amount
        elif what == 4:
            plan = later_plan(plan, amount)
        elif what == 5:
            plan = plan.copy()
            plan["delay"][0, 1] += amount
        else:
            model = Iso13855(ISO, held_object_m=amount)
        grown = occupy(model, more, plan)
        n = int(base["n"][0])
        assert grown["n"] == n
        for name in ("slice", "owner", "covers", "n_points"):
            np.testing.assert_array_equal(base[name][0, :n], grown[name][0, :n])
        for k in range(n):
            np.testing.assert_array_equal(*(b["points"][0, k, : b["n_points"][0, k]] for b in (base, grown)))
        assert (grown["radius"][0, :n] >= base["radius"][0, :n]).all()


def test_moving_everybody_moves_the_rows(rng: np.random.Generator) -> None:
    shift = rng.normal(size=3)
    here, there = gate_with(("a", standing())), gate_with(("a", standing() + shift))
    plan = slices(np.array([0.1, 0.2]))
    one, two = (occupy(Iso13855(ISO), g.people, plan) for g in (here, there))
    for k in rows(one, 0):
        np.testing.assert_allclose(
            one["points"][0, k, : one["n_points"][0, k]] + shift, two["points"][0, k, : two["n_points"][0, k]]
        )
    np.testing.assert_allclose(one["radius"][0, rows(one, 0)], two["radius"][0, rows(two, 0)])


def test_left_and_right_are_alike() -> None:
    mirrored = standing()
    mirrored[:, 1] *= -1.0
    for lost in Point:
        body, other = standing(), mirrored.copy()
        body[lost] = np.nan
        name = lost.name
        twin = {"L_": "R_", "R_": "L_"}.get(name[:2])
        swapped = Point[twin + name[2:]] if twin else lost
        left_right = [
            Point[{"L_": "R_", "R_": "L_"}[p.name[:2]] + p.name[2:]] if p.name[1] == "_" else p for p in Point
        ]
        other = mirrored[left_right]
        other[swapped] = np.nan
        plan = slices(np.array([0.1, 0.2]))
        one, two = (occupy(Iso13855(ISO), gate_with(("a", b)).people, plan) for b in (body, other))
        assert sorted(one["radius"][0, rows(one, 0)]) == pytest.approx(sorted(two["radius"][0, rows(two, 0)]))


# ---------------------------------------------------------------------------------- input that is no number


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("field", ["xyz", "e_p", "t_obs", "clock_error", "stamp_error"])
def test_number_that_is_not_usable_in_the_people_block_gives_no_row(field: str, value: float) -> None:
    people = gate_with(("a", standing()), ("b", standing(y=3.0))).people
    if field in ("clock_error", "stamp_error"):
        people[field] = value
    else:
        people[field][0, 0] = value
    out = occupy(Iso13855(ISO), people, slices(np.array([0.1, 0.2])))
    owners = set(out["owner"][0, rows(out, 0)])
    assert 0 not in owners
    assert owners == (set() if field in ("clock_error", "stamp_error") else {1})


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("point", [Point.PELVIS, Point.L_WRIST, Point.R_KNEE])
@pytest.mark.parametrize("field", ["xyz", "e_p", "t_obs"])
def test_single_bad_point_never_stands_in_a_row(field: str, point: Point, value: float) -> None:
    people = gate_with(("a", standing())).people
    people[field][0, 0, point] = value
    out = occupy(Iso13855(ISO), people, slices(np.array([0.1, 0.2])))
    for k in rows(out, 0):
        assert np.isfinite(out["radius"][0, k]) and 0.0 < out["radius"][0, k] < 1e7
        assert (np.abs(out["points"][0, k, : out["n_points"][0, k]]) < 1e7).all()
        assert not (out["points"][0, k, : out["n_points"][0, k]] == standing()[point]).all(axis=1).any()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("field", ["t", "delay"])
@pytest.mark.parametrize("place", [0, 1])
def test_number_that_is_not_usable_in_the_slices_gives_no_row(field: str, place: int, value: float) -> None:
    plan = slices(np.array([0.1, 0.2]))
    plan[field][0, place] = value
    out = occupy(Iso13855(ISO), gate_with(("a", standing())).people, plan)
    assert out["n"] == 0 and (out["first"] == 0).all()


def test_negative_error_or_slice_that_ends_before_it_begins_gives_no_row() -> None:
    people = gate_with(("a", standing())).people
    assert occupy(Iso13855(ISO), people, slices(np.array([0.2, 0.1])))["n"] == 0
    people["e_p"] = -0.01
    assert occupy(Iso13855(ISO), people, slices(np.array([0.1, 0.2])))["n"] == 0
