"""Who is faster than the profile, over the last half second; whoever keeps to it is never said to be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.hypotheses import PEOPLE
from occupancy.measurement import Gate
from occupancy.pace import LEAST_S, MOMENTS, PAST, Pace
from occupancy.pace_kernels import keep_moment, outpaced
from occupancy.report import Contradiction
from tests.occupancy.people import only, report, settings, standing

Array = np.ndarray
Count = Callable[[int], int]
ISO, TUM = load_profile("iso"), load_profile("tum")
V = float(ISO.speed[Point.HEAD])


class Watched:
    """A gate, and the pace beside it."""

    def __init__(self, profile=ISO, **changes: object) -> None:
        self.gate, self.pace = Gate(profile, settings(**changes)), Pace(profile)

    def see(self, t: float, *people: tuple[str, Array]) -> tuple[Contradiction, ...]:
        """Take in a report."""
        self.gate.admit(report(t, *people), t)
        return self.pace.hold(self.gate.people, self.gate.person_ids)


def walking(speed: float, t: float) -> Array:
    return standing(1.0, speed * t)


# Who is too fast


@pytest.mark.parametrize("rate", [20.0, 60.0, 200.0, 1000.0])
@pytest.mark.parametrize("times", [1.03, 1.1, 1.5])
def test_it_shows_as_soon_as_the_errors_do_not_hide_it(times: float, rate: float) -> None:
    """After T the way is 2 e longer than allowed, T = 2 e / (speed - v): at 3 % in a third of a second."""
    watched, hidden = Watched(), 2.0 * 0.01 / ((times - 1.0) * V)
    assert hidden < MOMENTS * LEAST_S
    for k in range(int(rate)):
        found = watched.see(k / rate, ("a", walking(times * V, k / rate)))
        if watched.gate.contradicted:  # from one report to the next, already
            assert times * V > V + 0.02 * rate
            return
        if found:
            break
    assert hidden < k / rate <= hidden + LEAST_S + 2.0 / rate
    [one] = found
    assert (one.person, one.point, one.stamp) == ("a", one.earlier, pytest.approx(k / rate))
    assert one.allowed_m == pytest.approx(V * one.elapsed_s + 0.02, abs=1e-8)
    assert one.distance_m == pytest.approx(times * V * one.elapsed_s) and one.distance_m > one.allowed_m
    assert watched.pace.contradicted


@pytest.mark.parametrize(
    ("times", "rate"), [(0.5, 60.0), (1.0, 20.0), (1.0, 60.0), (1.0, 1000.0), (1.01, 60.0), (1.01, 1000.0)]
)
def test_as_fast_as_is_allowed_is_not_too_fast(times: float, rate: float) -> None:
    """One per cent more would take a second to show, which is not kept."""
    watched = Watched()
    for k in range(int(2.0 * rate)):
        assert watched.see(k / rate, ("a", walking(times * V, k / rate))) == ()


def test_it_is_over_when_nothing_that_is_kept_shows_it_any_more() -> None:
    watched, rate = Watched(), 60.0
    fast = [bool(watched.see(k / rate, ("a", walking(1.2 * V, k / rate)))) for k in range(60)]
    rest = [bool(watched.see((60 + k) / rate, ("a", walking(1.2 * V, 1.0)))) for k in range(60)]
    assert fast[-1] and not any(rest[int(rate * MOMENTS * LEAST_S) + 2 :])


def test_one_of_several_points_of_one_of_several_people_is_enough() -> None:
    watched = Watched()
    for k in range(30):
        t, there = k / 60.0, standing(3.0)
        there[Point.R_WRIST :, 0] += 1.3 * V * t
        hand = only(there, Point.R_WRIST)
        found = watched.see(t, ("a", standing(-3.0)), ("b", hand), ("c", standing(6.0)))
        if found:
            break
    assert [(each.person, each.point) for each in found] == [("b", Point.R_WRIST)]


@pytest.mark.parametrize(
    ("times", "error", "rate"), [(1.2, 0.02, 30.0), (1.5, 0.01, 200.0), (2.0, 0.02, 200.0)]
)
def test_who_is_seen_in_parts_by_two_sensors_in_turn_shows_in_every_report(
    times: float, error: float, rate: float, rng: np.random.Generator
) -> None:
    """Their reports contradict each other at times, so that rows come and go."""
    watched, rows = Watched(position_error_m=error), set()
    legs = [point for point in Point if point.name.endswith(("HIP", "KNEE", "ANKLE", "PELVIS"))]
    halves = [point for point in Point if point not in legs], legs
    hidden = 2.0 * error / ((times - 1.0) * V) + 2.0 * LEAST_S + 4.0 / rate
    assert hidden < MOMENTS * LEAST_S
    for k in range(int(2.0 * rate)):
        t = k / rate
        there = walking(times * V, t) + rng.uniform(-0.5, 0.5, (MAX_POINTS, 3)) * error
        found = watched.see(t, ("a", only(there, *halves[k % 2])))
        rows.add(int(watched.gate.people["n"][0]))
        assert found or watched.gate.contradicted or t <= hidden
    assert rows == {1, 2}


# Who is not


def admissible(rng: np.random.Generator, t: Array, speed: float) -> Array:
    """Places (T, 3) of something that goes to and fro with at most ``speed``, mostly with all of it."""
    turns = np.sort(rng.uniform(t[0], t[-1], 6))
    ways = rng.normal(size=(7, 3))
    ways *= speed * rng.choice([1.0, rng.random()]) / np.linalg.norm(ways, axis=1, keepdims=True)
    at = np.concatenate([[t[0]], turns, [t[-1]]])
    knots = np.vstack([np.zeros(3), np.cumsum(ways * np.diff(at)[:, None], axis=0)])
    return np.column_stack([np.interp(t, at, knots[:, axis]) for axis in range(3)])


@pytest.mark.parametrize("profile", [ISO, TUM], ids=["iso", "tum"])
@pytest.mark.parametrize("sides", ["as named", "may be exchanged"])
def test_nobody_is_too_fast_who_keeps_to_the_profile(profile, sides, rng, count: Count) -> None:
    """Errors, stamps and missing points as bad as is declared; hands whose names change when they meet."""
    exchanged = admitted = 0
    for _ in range(count(3_000)):
        clock, stamp, error = rng.choice([0.0, 0.01], 3) * rng.random(3)
        watched = Watched(
            profile, clock_error_s=clock, stamp_error_s=stamp, position_error_m=error,
            trust_sides=sides == "as named",
        )  # fmt: skip
        t = np.cumsum(rng.choice([0.001, 0.01, 0.03, 0.2], 60) * rng.uniform(0.5, 1.5, 60))
        v = float(profile.speed[[Point.L_WRIST, Point.R_WRIST]].min())
        hands = np.stack([admissible(rng, t, v), 0.3 * rng.normal(size=3) + admissible(rng, t, v)], axis=1)
        swapped = False
        for k, now in enumerate(t):
            off = rng.normal(size=(2, 3))
            off *= error * (1.0 - 1e-9) / np.linalg.norm(off, axis=1, keepdims=True)
            seen = hands[k] + off
            meet = np.linalg.norm(np.subtract(*seen)) < 0.5 * error
            if sides != "as named" and meet and rng.random() < 0.5:
                swapped, exchanged = not swapped, exchanged + 1
            xyz = np.full((MAX_POINTS, 3), np.nan)
            xyz[[Point.L_WRIST, Point.R_WRIST]] = seen[::-1] if swapped else seen
            if rng.random() < 0.2:
                xyz[rng.choice([Point.L_WRIST, Point.R_WRIST])] = np.nan
            told = now + rng.choice([-1.0, 1.0]) * (clock + stamp) * (1.0 - 1e-9)
            found = watched.see(float(told), ("a", xyz))
            if watched.gate.contradicted:
                break  # the hands were farther apart than arms are long
            admitted += 1
            assert found == ()
    assert admitted > 10 * count(3_000)


def test_what_may_be_the_other_side_has_no_past() -> None:
    people, past = np.zeros(1, PEOPLE), np.zeros(1, PAST)
    past["t"], past["newest"] = np.nan, -np.inf
    row = people[0]
    row["n"], row["present"][0] = 1, 1 << Point.L_WRIST | 1 << Point.HEAD
    row["e_p"] = row["e_read"] = 0.01
    keep_moment(people, 0, past, LEAST_S)
    row["t_obs"][0], row["xyz"][0, :, 0] = 0.1, 5.0
    assert outpaced(people, 0, past, ISO.speed)[0] >= 0
    row["e_p"][0, Point.L_WRIST] = 0.5
    p, *_ = outpaced(people, 0, past, ISO.speed)
    assert p == Point.HEAD and np.isnan(past["t"][0, :, Point.L_WRIST]).all()
    keep_moment(people, 0, past, LEAST_S)
    assert past["n"][0] == 2 and np.isnan(past["t"][0, 1, Point.L_WRIST])
    assert past["t"][0, 1, Point.HEAD] == 0.1


def test_who_has_left_and_comes_back_elsewhere_has_no_past() -> None:
    watched, x = Watched(), standing()
    watched.see(0.0, ("a", x), ("b", standing(5.0)))
    watched.see(0.1, ("b", standing(5.0)))
    assert watched.see(0.2, ("a", standing(9.0)), ("b", standing(5.0))) == ()
    assert not watched.pace.contradicted


def test_two_who_have_one_name_contradict_the_gate_and_are_not_compared() -> None:
    watched = Watched()
    watched.see(0.0, ("a", standing()))
    assert watched.see(0.1, ("a", standing(9.0))) == ()
    assert watched.gate.contradicted and watched.gate.people["n"][0] == 2


def test_speeds_without_a_limit_are_never_too_high() -> None:
    people, past = np.zeros(1, PEOPLE), np.zeros(1, PAST)
    past["t"], past["newest"] = np.nan, -np.inf
    people["n"], people["present"] = 1, 1
    for _ in range(2):  # no time has passed: 0 times infinity is no number
        assert outpaced(people, 0, past, np.full(MAX_POINTS, np.inf))[0] == -1
        keep_moment(people, 0, past, LEAST_S)


# What is kept


def test_moments_are_not_closer_than_that_and_the_oldest_goes() -> None:
    people, past = np.zeros(1, PEOPLE), np.zeros(1, PAST)
    past["t"], past["newest"] = np.nan, -np.inf
    people["n"], people["present"], kept = 1, 1 << Point.HEAD, []
    for k in range(600):
        people["t_obs"][0, 0, Point.HEAD] = t = 0.004 * k
        people["xyz"][0, 0, Point.HEAD] = k
        if not kept or t >= kept[-1] + LEAST_S:
            kept.append(t)
        keep_moment(people, 0, past, LEAST_S)
    assert past["n"][0] == len(kept) > 2 * MOMENTS
    assert sorted(past["t"][0, :, Point.HEAD]) == kept[-MOMENTS:]
    assert np.allclose(past["xyz"][0, :, Point.HEAD, 0], past["t"][0, :, Point.HEAD] / 0.004)
    assert np.isnan(past["t"][0, :, Point.PELVIS]).all()


def plain(people: Array, past: Array, speed: Array) -> float:
    """Largest excess [m] of the first row, at least 0."""
    seen, kept = people[0], past[0]
    there = (seen["present"][0] >> np.arange(MAX_POINTS) & 1).astype(bool) & np.isfinite(speed)
    there &= seen["e_p"][0] <= seen["e_read"][0]
    way = np.linalg.norm(seen["xyz"][0] - kept["xyz"], axis=2)
    elapsed = np.abs(seen["t_obs"][0] - kept["t"]) + 2.0 * (seen["stamp_error"] + seen["clock_error"])
    with np.errstate(invalid="ignore"):
        excess = way - (speed * elapsed + seen["e_p"][0] + kept["e_p"] + 1e-9)
    excess[~(np.isfinite(kept["t"]) & there)] = -np.inf
    return max(0.0, float(excess.max()))


def test_excess_twin(rng: np.random.Generator, count: Count) -> None:
    people, past = np.zeros(1, PEOPLE), np.zeros(1, PAST)
    met = 0
    for _ in range(count(20_000)):
        row, kept = people[0], past[0]
        row["n"], row["present"][0] = 1, rng.integers(1 << MAX_POINTS)
        row["clock_error"], row["stamp_error"] = rng.choice([0.0, 0.01], 2)
        row["t_obs"][0] = rng.uniform(0.5, 0.6, MAX_POINTS)
        row["xyz"][0] = rng.normal(0.0, rng.choice([0.1, 0.3]), (MAX_POINTS, 3))
        row["e_read"][0] = row["e_p"][0] = rng.uniform(0.0, 0.1, MAX_POINTS)
        row["e_p"][0] += np.where(rng.random(MAX_POINTS) < 0.2, 0.1, 0.0)
        there = rng.random((MOMENTS, MAX_POINTS)) < rng.choice([0.02, 0.7])
        kept["t"] = np.where(there, rng.random((MOMENTS, MAX_POINTS)), np.nan)
        kept["xyz"] = rng.normal(0.0, 0.1, (MOMENTS, MAX_POINTS, 3))
        kept["e_p"] = rng.uniform(0.0, 0.1, (MOMENTS, MAX_POINTS))
        speed = np.where(rng.random(MAX_POINTS) < 0.1, np.inf, rng.uniform(0.5, 3.0, MAX_POINTS))
        wanted = plain(people, past, speed)
        p, moment, distance, allowed = outpaced(people, 0, past, speed)
        assert (p >= 0) == (wanted > 0.0)
        if p >= 0:
            met += 1
            assert distance - allowed == pytest.approx(wanted, abs=1e-12)
            way = np.linalg.norm(row["xyz"][0, p] - kept["xyz"][moment, p])
            assert distance == pytest.approx(float(way), abs=1e-12)
    assert 0.1 < met / count(20_000) < 0.9
