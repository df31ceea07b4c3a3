"""Articulated models: whatever obeys speed and acceleration stays inside, and gets out without any term."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Part, Point, Profile, load_profile
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedPosition, ArticulatedVelocity
from occupancy.humans.kernels import estimate_velocities, first_accelerated, write_points
from occupancy.humans.options import ModelError
from occupancy.hypotheses import HISTORY, HISTORY_DEPTH, PEOPLE, READING
from occupancy.measurement import Gate
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block, new_slices
from tests.occupancy.crowds import flat
from tests.occupancy.left_out import Forget, no_delay, no_velocity, no_velocity_error, nothing
from tests.occupancy.moving_people import HANDS, SEGMENTS
from tests.occupancy.moving_points import Array, Motions, bang_bang, directions, to_hull
from tests.occupancy.people import ALL_POINTS, mask, only, report, settings, standing

PROFILES = {name: load_profile(name) for name in ("iso", "tum", "extreme")}
POINTS_OF = {**SEGMENTS, **{hand: (points[0],) for hand, points in HANDS.items()}}


# --------------------------------------------------------------------------------------------- inclusion


@dataclass
class Crowd:
    """A full people block of points that move on their own, and the truth about them."""

    profile: Profile
    motions: Motions
    people: Block
    e_p: float
    stamp_error: float
    clock_error: float
    last_instant: float
    """When the newest reading was really taken [s]."""

    def reading(self, rng: np.random.Generator, instant: float, towards: Array) -> Block:
        """What a sensor says that looks at ``instant``, off by e_p ``towards`` (n, 3)."""
        stamp = instant + rng.choice([-1.0, 0.0, 1.0]) * (self.stamp_error + self.clock_error)
        x, _ = self.motions.at(instant)
        read = np.zeros(MAX_PEOPLE, dtype=READING)
        seen = x + self.e_p * towards
        for k in range(MAX_PEOPLE):
            read[k]["present"], read[k]["t_obs"] = ALL_POINTS, stamp - self.stamp_error
            read[k]["xyz"] = seen[k * MAX_POINTS : (k + 1) * MAX_POINTS]
            read[k]["e_p"] = self.e_p
        return read


def crowd(rng: np.random.Generator, profile: Profile, rate: float, aligned: bool) -> Crowd:
    """16 persons of 20 points each, seen a few times at ``rate`` [Hz] before 0 s.

    ``aligned``: motion and errors point the same way, so that bounds are nearly attained.
    """
    n = MAX_PEOPLE * MAX_POINTS
    speed, acceleration = (np.tile(each, MAX_PEOPLE) for each in (profile.speed, profile.acceleration))
    acceleration = np.where(np.isfinite(acceleration), acceleration, 1e4)
    change_hz = 0.0 if aligned else float(rng.choice([0.0, 3.0, 30.0, 300.0]))
    seen = int(rng.integers(1, 8))
    motions = bang_bang(rng, -seen / rate - 0.05, 0.5, speed, acceleration, change_hz)
    errors = [float(rng.choice([0.0, high])) for high in (0.003, 0.002)]
    people = np.zeros(1, dtype=PEOPLE)
    made = Crowd(profile, motions, people, float(rng.choice([0.0, 0.004, 0.03])), *errors, 0.0)
    record = people[0]
    record["n"], record["stamp_error"], record["clock_error"] = MAX_PEOPLE, *errors
    record["person"], record["e_v"] = np.arange(MAX_PEOPLE), np.inf
    record["t_obs"], record["xyz"], record["e_p"] = np.nan, np.nan, np.nan
    history = np.zeros(1, dtype=HISTORY)
    _, v = motions.at(0.0)
    ahead = v / np.maximum(np.linalg.norm(v, axis=1), 1e-9)[:, None]
    for i in range(seen, 0, -1):
        made.last_instant = -(i - 1) / rate
        towards = (-ahead if i == 1 else ahead) if aligned else directions(rng, n)
        read = made.reading(rng, made.last_instant, towards)
        for k in range(MAX_PEOPLE):
            belied = estimate_velocities(record, k, read[k], history[0], profile.limits[0])
            assert belied < 0, "an admissible motion must not belie itself"
            write_points(record, k, read[k])
    return made


def worst_excess(
    rng: np.random.Generator,
    model: Callable[[Profile], ArticulatedVelocity | ArticulatedAcceleration],
    profile: Profile,
    forget: Forget = nothing,
    *,
    aligned: bool = False,
) -> float:
    """How far [m] a point of a crowd gets out of its rows, at worst, over three slices."""
    made = crowd(rng, profile, float(rng.choice([30.0, 120.0, 250.0])), aligned)
    begin = made.last_instant + float(rng.uniform(0.0, 0.2))
    ends = begin + np.cumsum([0.0, *rng.uniform(0.002, 0.05, 3)])
    plan = new_slices()
    record = plan[0]
    record["n"], record["t"][:4] = 3, ends
    record["delay"] = sorted(rng.uniform(0.0, 0.02, 2)) if rng.random() < 0.5 else (0.0, 0.0)
    delay = record["delay"].copy()
    forget(made.people, plan)
    person = model(profile)
    out = person.new_sets()
    person.occupy(made.people, plan, out)
    rows, worst = out[0], -math.inf
    for i in range(3):
        mine = np.arange(rows["first"][i], rows["first"][i + 1])
        for t in np.linspace(ends[i] + delay[0], ends[i + 1] + delay[1], 7):
            x, _ = made.motions.at(float(t))
            worst = max(worst, _outside(rows, mine, x, profile))
    return worst


def _outside(rows: np.void, mine: Array, x: Array, profile: Profile) -> float:
    """How far [m] the points of parts lie outside of what their rows have for them."""
    worst = -math.inf
    for part, points in POINTS_OF.items():
        of_part = mine[(rows["covers"][mine] >> int(part)) & 1 == 1]
        n = len(points) if len(points) < 2 or points[0] != points[1] else 1
        # rows whose points are those of the part itself; the trunk's have more
        of_part = of_part[np.isin(rows["n_points"][of_part], (n, 2 * n))]
        if not len(of_part):
            continue
        moving = rows["n_points"][of_part] == 2 * n
        for j in range(n):
            ends = rows["points"][of_part][:, [j, j]]
            ends[moving, 1] = rows["points"][of_part[moving], n + j]
            truth = x[rows["owner"][of_part] * MAX_POINTS + int(points[j])]
            room = rows["radius"][of_part] - profile.radius[part]
            worst = max(worst, float((to_hull(ends, truth) - room).max()))
    return worst


MODELS = {
    "velocity, tum": (ArticulatedVelocity, PROFILES["tum"]),
    "velocity, extreme": (ArticulatedVelocity, PROFILES["extreme"]),
    "acceleration, tum": (ArticulatedAcceleration, PROFILES["tum"]),
    "acceleration, extreme": (ArticulatedAcceleration, PROFILES["extreme"]),
    "acceleration, gentle": (ArticulatedAcceleration, flat(PROFILES["tum"], 3.0, 5.0)),
}
PER_CROWD = MAX_PEOPLE * MAX_POINTS


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_admissible_points_stay_inside(
    rng: np.random.Generator, count: Callable[[int], int], name: str, aligned: bool
) -> None:
    """Velocities found as the gate does, motion in steps of 1 ms; a million more are in test_inclusion."""
    model, profile = MODELS[name]
    telling = aligned and name == "acceleration, gentle"
    crowds = max(20 if telling else 4, count(100_000) // PER_CROWD // 2)
    worst = max(worst_excess(rng, model, profile, aligned=aligned) for _ in range(crowds))
    assert worst <= 1e-9
    if telling:
        assert worst > -0.05, "nothing came near the boundary: the test shows nothing"


@pytest.mark.parametrize(
    "forget",
    [
        no_velocity_error,
        no_velocity,
        pytest.param(no_delay, marks=pytest.mark.rarely("tests/test_terms.py, articulated_acceleration")),
    ],
)
def test_terms_of_the_acceleration_model_are_needed(rng: np.random.Generator, forget: Forget) -> None:
    profile = flat(PROFILES["tum"], 6.0, 20.0)
    assert any(
        worst_excess(rng, ArticulatedAcceleration, profile, forget, aligned=bool(i % 2)) > 1e-4
        for i in range(60)
    )


def test_acceleration_is_needed(rng: np.random.Generator) -> None:
    """The points accelerate with 20 m/s², the model believes in half of that."""
    profile = flat(PROFILES["tum"], 6.0, 20.0)

    def gentle(_profile: Profile) -> ArticulatedAcceleration:
        return ArticulatedAcceleration(flat(PROFILES["tum"], 6.0, 1.0))

    assert any(worst_excess(rng, gentle, profile, aligned=bool(i % 2)) > 1e-3 for i in range(60))


def test_position_error_is_needed() -> None:
    """A point at rest, seen 3 cm off: without e_p it is outside at once."""
    model = ArticulatedAcceleration(PROFILES["tum"])
    people = known([(0.0, standing()), (0.1, standing())], e_p=0.03)
    people["e_p"] = 0.0
    people["e_v"] = 0.0
    out, plan = model.new_sets(), slices(0.1, 0.1)
    model.occupy(people, plan, out)
    row = int(np.flatnonzero(out["covers"][0] >> int(Part.HEAD) & 1)[0])
    off = standing()[Point.HEAD] + np.array([0.03, 0.0, 0.0])
    distance = to_hull(out["points"][0, row : row + 1, :2], off[None])[0]
    assert distance > out["radius"][0, row] - PROFILES["tum"].radius[Part.HEAD] + 0.02


# --------------------------------------------------------------------------------------------- velocities


def known(reports: list[tuple[float, Array]], profile: Profile = PROFILES["tum"], **changes: object) -> Block:
    """People block of a gate that has admitted reports about one person."""
    e_p = float(changes.pop("e_p", 0.004))
    gate = Gate(profile, settings(position_error_m=e_p, **changes))
    for stamp, xyz in reports:
        admission = gate.admit(report(stamp, ("a", xyz)), stamp)
        assert not admission.contradictions
    return gate.people


def slices(begin: float, end: float) -> Block:
    plan = new_slices()
    plan["n"], plan["t"][0, :2] = 1, (begin, end)
    return plan


def test_a_first_measurement_has_no_velocity() -> None:
    people = known([(0.0, standing())])
    assert np.isinf(people["e_v"][0, 0]).all()
    out = ArticulatedAcceleration(PROFILES["tum"]).new_sets()
    ArticulatedAcceleration(PROFILES["tum"]).occupy(people, slices(0.0, 0.1), out)
    assert out["n"][0] == 0


@pytest.mark.parametrize(("e_p", "a", "tau"), [(0.004, 50.0, 0.01), (0.004, 50.0, 0.02), (0.01, 5.0, 0.1)])
def test_the_bound_is_that_of_the_best_pair(e_p: float, a: float, tau: float) -> None:
    profile = flat(PROFILES["tum"], 2.0, a)
    step = np.array([1.0, 0.0, 0.0])
    times = [i * tau for i in range(6)]
    people = known([(t, standing() + t * step) for t in times], profile, e_p=e_p)
    bounds = [2.0 * e_p / (i * tau) + 0.5 * a * i * tau for i in range(1, 6)]
    np.testing.assert_allclose(people["e_v"][0, 0], min(bounds), rtol=1e-9)
    np.testing.assert_allclose(people["v"][0, 0], np.tile(step, (MAX_POINTS, 1)), atol=1e-9)


def test_errors_of_stamps_widen_the_bound() -> None:
    profile = flat(PROFILES["tum"], 2.0, 50.0)
    people = known([(0.0, standing()), (0.02, standing())], profile, stamp_error_s=0.001, clock_error_s=0.002)
    slack = 2.0 * 0.003
    expected = (2.0 * 0.004 + 2.0 * slack) / 0.02 + 0.5 * 50.0 * (0.02 + slack)
    np.testing.assert_allclose(people["e_v"][0, 0], expected, rtol=1e-9)


def test_an_old_point_keeps_the_velocity_it_had() -> None:
    step = np.array([1.0, 0.0, 0.0])
    moving = [(0.02 * i, standing() + 0.02 * i * step) for i in range(3)]
    people = known([*moving, (0.06, only(standing() + 0.06 * step, Point.HEAD))])
    assert people["t_obs"][0, 0, Point.L_WRIST] == pytest.approx(0.04)
    assert people["v"][0, 0, Point.L_WRIST, 0] == pytest.approx(1.0)
    assert people["t_obs"][0, 0, Point.HEAD] == pytest.approx(0.06)


def test_more_samples_than_are_kept_are_no_trouble() -> None:
    profile = flat(PROFILES["tum"], 2.0, 1e-3)
    times = np.arange(3 * HISTORY_DEPTH) * 0.01
    people = known([(float(t), standing()) for t in times], profile)
    longest = HISTORY_DEPTH * 0.01
    np.testing.assert_allclose(people["e_v"][0, 0], 0.008 / longest + 0.5e-3 * longest, rtol=1e-9)


def test_a_profile_without_accelerations_has_no_velocities() -> None:
    people = known([(0.02 * i, standing()) for i in range(4)], PROFILES["iso"])
    assert np.isinf(people["e_v"][0, 0]).all()
    with pytest.raises(ModelError, match="iso limits no accelerations"):
        ArticulatedAcceleration(PROFILES["iso"])


def test_a_contradiction_forgets_every_velocity() -> None:
    gate = Gate(PROFILES["tum"], settings(position_error_m=0.004))
    for i in range(4):
        gate.admit(report(0.02 * i, ("a", standing())), 0.02 * i)
    assert np.isfinite(gate.people["e_v"][0, 0]).all()
    gate.admit(report(0.08, ("a", standing(x=3.0))), 0.08)
    assert gate.contradicted
    assert np.isinf(gate.people["e_v"][0, 1]).all()
    gate.admit(report(0.8, ("a", standing(x=2.5))), 0.8)
    assert not gate.contradicted
    assert np.isinf(gate.people["e_v"][0, 0]).all()


def test_a_jolt_belies_the_velocities_and_nothing_else() -> None:
    """Within the speed of the profile, but not within its acceleration: 1 m/s forth, then 1.9 m/s back."""
    profile = flat(PROFILES["tum"], 2.0, 5.0)
    gate = Gate(profile, settings(position_error_m=0.0))
    step = np.array([1.0, 0.0, 0.0])
    for i in range(5):
        gate.admit(report(0.02 * i, ("a", standing() + 0.02 * i * step)), 0.02 * i)
    assert (gate.people["e_v"][0, 0] < 0.1).all()
    admission = gate.admit(report(0.18, ("a", standing() + (0.08 - 0.19) * step)), 0.18)
    assert not admission.contradictions and not gate.contradicted
    assert np.isinf(gate.people["e_v"][0, 0]).all()


def test_later_samples_are_held_against_velocity_and_acceleration() -> None:
    profile = flat(PROFILES["tum"], 20.0, 10.0)
    people = known([(0.0, standing()), (0.1, standing())], profile, trust_sides=True)
    e_v = float(people["e_v"][0, 0, 0])
    moved = 0.004 + 0.004 + e_v * 0.2 + 0.5 * 10.0 * 0.2**2
    stamps, e_p = np.array([0.3]), np.full((1, MAX_POINTS), 0.004)
    for off, found in ((moved - 1e-6, -1), (moved + 1e-6, 0)):
        xyz = standing()[None].copy()
        xyz[0, Point.R_WRIST, 1] += off
        sample, point, excess = first_accelerated(people, 0, (stamps, xyz, e_p), (0.1, 0.3), profile.limits)
        assert sample == found
        if found >= 0:
            assert Point(point) is Point.R_WRIST and excess == pytest.approx(1e-6, rel=1e-2)
    assert first_accelerated(people, 0, (stamps, xyz, e_p), (0.1, 0.29), profile.limits)[0] == -1


# ------------------------------------------------------------------------------------------------- position


def test_the_position_model_knows_the_shoulder_only() -> None:
    model = ArticulatedPosition(PROFILES["extreme"])
    chain = float(PROFILES["extreme"].chain[Point.L_SHOULDER, Point.L_WRIST])
    people = known([(0.0, only(standing(), Point.L_SHOULDER))], PROFILES["extreme"])
    out = model.new_sets()
    model.occupy(people, slices(0.0, 0.1), out)
    row = int(np.flatnonzero(out["covers"][0, : out["n"][0]] >> int(Part.L_HAND) & 1)[0])
    assert out["radius"][0, row] == pytest.approx(0.205 + chain + 0.004 + 5.0 * 0.1)
    np.testing.assert_array_equal(out["points"][0, row, 0], standing()[Point.L_SHOULDER])
    assert not model.proves >> int(Part.TORSO) & 1 and not model.proves >> int(Part.PELVIS) & 1


def test_the_position_model_does_not_look_at_the_limb_itself() -> None:
    model = ArticulatedPosition(PROFILES["extreme"])
    limbs = {
        Part.L_HAND: (Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
        Part.R_FOOT: (Point.R_KNEE, Point.R_ANKLE),
        Part.HEAD: (Point.HEAD,),
    }
    for part, points in limbs.items():
        people = known([(0.0, only(standing(), *points))], PROFILES["extreme"])
        out = model.new_sets()
        model.occupy(people, slices(0.0, 0.1), out)
        covered = np.bitwise_or.reduce(out["covers"][0, : out["n"][0]], initial=np.uint32(0))
        assert not int(covered) >> int(part) & 1


def test_people_who_obey_the_profile_stay_in_the_position_model(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """A hand anywhere on its chain from a shoulder that moves as fast as it may; through the gate."""
    profile = PROFILES["extreme"]
    model, out = ArticulatedPosition(profile), ArticulatedPosition(profile).new_sets()
    worst = -math.inf
    for _ in range(max(20, count(100_000) // 200)):
        people = known([(0.0, standing())], profile)
        end = float(rng.uniform(0.01, 0.3))
        model.occupy(people, slices(0.0, end), out)
        rows = out[0]
        row = int(np.flatnonzero(rows["covers"][: rows["n"]] >> int(Part.L_HAND) & 1)[0])
        n = 200
        shoulder = (
            standing()[Point.L_SHOULDER]
            + 0.004 * directions(rng, n)
            + 5.0 * end * rng.uniform(0.5, 1.0, (n, 1)) * directions(rng, n)
        )
        elbow = shoulder + profile.chain[Point.L_SHOULDER, Point.L_ELBOW] * directions(rng, n)
        wrist = elbow + profile.chain[Point.L_ELBOW, Point.L_WRIST] * directions(rng, n)
        away = np.linalg.norm(wrist - rows["points"][row, 0], axis=1)
        worst = max(worst, float((away - rows["radius"][row] + 0.205).max()))
    assert -0.2 < worst <= 1e-9


def test_bad_numbers_give_no_row() -> None:
    for model in (ArticulatedVelocity, ArticulatedAcceleration, ArticulatedPosition):
        person = model(PROFILES["tum"])
        clean, out = person.new_sets(), person.new_sets()
        people = known([(0.0, standing()), (0.02, standing())])
        person.occupy(people, slices(0.02, 0.1), clean)
        for field in ("xyz", "e_p", "t_obs", "v", "e_v"):
            if field in ("v", "e_v") and model is not ArticulatedAcceleration:
                continue
            for value in (math.nan, math.inf, -math.inf):
                if field in ("e_v",) and value == -math.inf:
                    continue
                bad = people.copy()
                bad[field][0, 0, Point.L_SHOULDER] = value
                person.occupy(bad, slices(0.02, 0.1), out)
                n = int(out["n"][0])
                # another row may take its place, made of other points
                assert n <= clean["n"][0] - (field != "t_obs"), (model, field, value)
                assert np.isfinite(out["radius"][0, :n]).all() and np.isfinite(out["points"][0, :n, :2]).all()


def test_masks_of_present_points_are_respected() -> None:
    person = ArticulatedVelocity(PROFILES["tum"])
    people = known([(0.0, standing())])
    people["present"][0, 0] = mask(Point.HEAD)
    out = person.new_sets()
    person.occupy(people, slices(0.0, 0.1), out)
    assert person.inferred_parts(mask(Point.HEAD)) == person.proves & ~(1 << int(Part.HEAD))
    assert (out["points"][0, : out["n"][0], 0] == standing()[Point.HEAD]).all()
