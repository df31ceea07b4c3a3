"""Left and right exchanged: where that is possible, errors contain both readings, else it contradicts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.humans.kernels import widen_exchanged
from occupancy.hypotheses import READING
from occupancy.measurement import Gate
from tests.occupancy.moving_people import unit
from tests.occupancy.people import only, report, rows_of, settings, standing

ISO, EXTREME = load_profile("iso"), load_profile("extreme")
Array = np.ndarray
E_P = 0.01
PAIRS = [(point, Point["R" + point.name[1:]]) for point in Point if point.name.startswith("L_")]
WRISTS = (Point.L_WRIST, Point.R_WRIST)


def hands(apart: float) -> Array:
    """Somebody who holds both wrists in front, ``apart`` [m] from each other."""
    xyz = standing()
    for side, wrist, elbow in zip((0.5, -0.5), WRISTS, (Point.L_ELBOW, Point.R_ELBOW), strict=True):
        xyz[wrist] = 1.75, side * apart, 1.1
        xyz[elbow] = 1.95, side * (apart + 0.3), 1.1
    return only(xyz, *WRISTS, Point.L_ELBOW, Point.R_ELBOW, Point.HEAD)


def exchanged(xyz: Array, *pairs: tuple[Point, Point]) -> Array:
    out = xyz.copy()
    for left, right in pairs:
        out[[left, right]] = xyz[[right, left]]
    return out


def errors(of: Gate) -> Array:
    [row] = rows_of(of, "a")
    found: Array = of.people["e_p"][0, row]
    return found


def gate(**changes: object) -> Gate:
    return Gate(ISO, settings(**changes))


def test_there_are_eight_pairs() -> None:
    assert len(PAIRS) == 8 and len({point for pair in PAIRS for point in pair}) == 16


@pytest.mark.parametrize(("apart", "widened"), [(0.03, True), (0.0399, True), (0.0401, False), (0.3, False)])
def test_errors_contain_both_readings_where_an_exchange_is_possible(apart: float, widened: bool) -> None:
    """10 ms at 2 m/s and 1 cm on both sides: up to 4 cm."""
    of = gate()
    for stamp in (1.0, 1.01):
        of.admit(report(stamp, ("a", hands(apart))), stamp)
    assert errors(of)[list(WRISTS)] == pytest.approx(apart + E_P if widened else E_P)
    assert errors(of)[Point.HEAD] == E_P and not of.contradicted


def test_a_trusted_source_keeps_its_errors() -> None:
    of = gate(trust_sides=True)
    for stamp in (1.0, 1.01):
        of.admit(report(stamp, ("a", hands(0.03))), stamp)
    assert errors(of)[list(WRISTS)] == pytest.approx(E_P)


def test_a_first_reading_is_taken_as_named() -> None:
    of = gate()
    of.admit(report(1.0, ("a", hands(0.01))), 1.0)
    assert errors(of)[Point.L_WRIST] == E_P


def test_what_was_widened_does_not_widen_for_ever() -> None:
    of = gate()
    for i in range(60):
        stamp = 1.0 + 0.01 * i
        of.admit(report(stamp, ("a", hands(0.02 + 0.005 * i))), stamp)
        assert (errors(of)[Point.L_WRIST] > E_P) == (0 < i <= 4), (
            "wrists as far as 4 cm from each other before"
        )


@pytest.mark.parametrize(("larger", "smaller"), [WRISTS, WRISTS[::-1]])
def test_larger_error_of_one_side_is_that_of_the_other_too(larger: Point, smaller: Point) -> None:
    of = gate()
    of.admit(report(1.0, ("a", hands(0.03))), 1.0)
    raw = report(1.01, ("a", hands(0.03)))
    stated = raw.people[0].error_m.copy()
    stated[larger] = 0.05
    of.admit(raw._replace(people=(raw.people[0]._replace(error_m=stated),)), 1.01)
    assert errors(of)[smaller] == pytest.approx(0.03 + 0.05)
    assert errors(of)[larger] == pytest.approx(max(0.05, 0.03 + E_P))


@pytest.mark.parametrize(("apart", "widened"), [(0.03, True), (0.05, False)])
def test_a_point_that_is_reported_alone_contains_where_it_can_have_gone(apart: float, widened: bool) -> None:
    of = gate()
    of.admit(report(1.0, ("a", hands(apart))), 1.0)
    alone = hands(apart)
    alone[Point.R_WRIST] = np.nan
    alone[Point.L_WRIST, 0] += 0.005
    of.admit(report(1.01, ("a", alone)), 1.01)
    assert errors(of)[Point.L_WRIST] == pytest.approx(0.005 + E_P + 0.02 if widened else E_P)


def test_nothing_is_farther_from_its_counterpart_than_the_longest_chain() -> None:
    of = gate()
    of.admit(report(1.0, ("a", hands(0.3))), 1.0)
    alone = hands(0.3)
    alone[Point.R_WRIST] = np.nan
    of.admit(report(9.0, ("a", alone)), 9.0)
    chain = ISO.chain[Point.L_WRIST, Point.R_WRIST]
    assert errors(of)[Point.L_WRIST] == pytest.approx(chain + E_P) and chain < 2.5


def test_one_side_that_was_never_seen_does_not_rule_an_exchange_out() -> None:
    of = gate()
    alone = hands(0.03)
    alone[Point.R_WRIST] = np.nan
    of.admit(report(1.0, ("a", alone)), 1.0)
    of.admit(report(1.01, ("a", hands(0.03))), 1.01)
    assert errors(of)[list(WRISTS)] == pytest.approx(0.03 + E_P)


def test_an_exchange_from_afar_is_a_contradiction_and_both_places_stay() -> None:
    of = gate()
    of.admit(report(1.0, ("a", standing())), 1.0)
    found = of.admit(report(1.01, ("a", exchanged(standing(), *PAIRS))), 1.01)
    assert found.contradictions and len(rows_of(of, "a")) == 2
    assert (of.people["e_p"][0, :2] == E_P).all()


def holds(of: Gate, truth: Array, t: float) -> bool:
    """Whether some row of the person allows every point of the truth (20, 3) at t."""
    record = of.people[0]
    for k in rows_of(of, "a"):
        there = np.isfinite(record["t_obs"][k])
        grown = record["e_p"][k] + ISO.speed * np.abs(t - record["t_obs"][k])
        far = np.linalg.norm(truth - record["xyz"][k], axis=1)
        if (far[there] <= grown[there] + 1e-9).all():
            return True
    return False


def arms_in_front(half: float) -> Array:
    """Points (20, 3) of somebody whose wrists are at ``half`` [m] to the left and right of the middle."""
    xyz = standing()
    for side, sign in (("L", 1.0), ("R", -1.0)):
        xyz[Point[f"{side}_ELBOW"]] = 2.0, 0.22 * sign, 1.1
        for name, x in (("WRIST", 1.75), ("HAND", 1.67), ("FINGERTIP", 1.58)):
            xyz[Point[f"{side}_{name}"]] = x, half * sign, 1.1
    return xyz


def rightly_known(of: Gate, pair: tuple[Point, Point], history: dict[float, Array]) -> bool:
    """Whether every row of the person has both points of a pair as they were seen, under their own names."""
    record = of.people[0]
    rows = rows_of(of, "a") if of.person_ids else []
    return bool(rows) and all(
        int(record["present"][k]) >> p & 1
        and np.array_equal(record["xyz"][k, p], history[float(record["t_obs"][k, p])][p])
        for k in rows
        for p in pair
    )


def crossing(rng: np.random.Generator, *, trust: bool) -> tuple[int, int, int]:
    """Hands that meet, cross and part; a report may have any pairs exchanged that were right before.

    Returns how often some report was exchanged, after how many no row held, how many contradicted.
    """
    of, t, half, way = gate(trust_sides=trust), 0.0, 0.2, -1.0
    wrong = lost = contradicted = 0
    place, history = np.zeros(3), dict[float, Array]()
    for _ in range(60):
        step = float(rng.choice([0.008, 0.033, 0.1]))
        t += step
        way = -np.sign(half) if abs(half) > 0.25 else way * rng.choice([1.0, 1.0, -1.0])
        half += 1.0 * step * way * rng.random()
        place = place + 0.5 * step * rng.random() * unit(rng, 1)[0]
        truth = arms_in_front(half) + place
        seen = truth + E_P * rng.random() * unit(rng, MAX_POINTS)
        seen[rng.random(MAX_POINTS) < rng.choice([0.0, 0.3])] = np.nan
        may = [pair for pair in PAIRS if rightly_known(of, pair, history)]
        pairs = [pair for pair in may if rng.random() < 0.3] if rng.random() < 0.4 else []
        history[t] = seen
        wrong += bool(pairs)
        found = of.admit(report(t, ("a", exchanged(seen, *pairs))), t)
        contradicted += bool(pairs and found.contradictions)
        if not of.overflow and np.isfinite(seen).any():
            lost += not (holds(of, truth, t) and holds(of, truth, t + 0.1))
    return wrong, lost, contradicted


def test_some_row_always_holds_whatever_is_exchanged(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    wrong = contradicted = 0
    for _ in range(count(1_000)):
        exchanges, lost, contradictions = crossing(rng, trust=False)
        assert lost == 0
        wrong, contradicted = wrong + exchanges, contradicted + contradictions
    assert wrong > contradicted > 0, "some exchanges contradict, and some do not"


def test_without_the_widening_somebody_is_lost(rng: np.random.Generator) -> None:
    assert sum(crossing(rng, trust=True)[1] for _ in range(30)) > 0


def twin(of: Gate, row: int, reading: np.void, limits: np.void) -> Array:
    """Errors (20,) after widening, in plain NumPy."""
    record = of.people[0]
    slack = 2.0 * float(record["stamp_error"] + record["clock_error"])
    out = reading["e_read"].copy()
    xyz, e = reading["xyz"], reading["e_read"]
    for left, right in PAIRS:
        said = [p for p in (left, right) if int(reading["present"]) >> p & 1]
        known = [p for p in (left, right) if int(record["present"][row]) >> p & 1]
        grown = {
            p: record["e_read"][row, p]
            + limits["speed"][p] * (abs(reading["t_obs"] - record["t_obs"][row, p]) + slack)
            for p in known
        }
        crossed = [(a, b) for a, b in ((left, right), (right, left)) if a in said and b in known]
        near = [np.linalg.norm(xyz[a] - record["xyz"][row, b]) <= e[a] + grown[b] + 1e-9 for a, b in crossed]
        if len(said) == 2 and known and all(near):
            apart = np.linalg.norm(xyz[left] - xyz[right])
            out[left], out[right] = max(e[left], apart + e[right]), max(e[right], apart + e[left])
        elif len(said) == 1 and len(known) == 2 and all(near):
            [a] = said
            gone = np.linalg.norm(xyz[a] - record["xyz"][row, a]) + grown[a]
            out[a] = max(e[a], min(gone, limits["chain"][left, right] + e[a]))
    return out


def test_errors_equal_those_of_a_plain_twin(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    changed = 0
    for _ in range(count(5_000)):
        profile = (ISO, EXTREME)[int(rng.integers(2))]
        of = gate(
            clock_error_s=float(rng.choice([0.0, 0.003])), stamp_error_s=float(rng.choice([0.0, 0.002]))
        )
        seen = standing() + rng.uniform(-0.2, 0.2, (MAX_POINTS, 3))
        seen[rng.random(MAX_POINTS) < 0.2] = np.nan
        if not np.isfinite(seen).any():
            continue
        of.admit(report(1.0, ("a", seen)), 1.1)
        reading = np.zeros(1, dtype=READING)[0]
        reading["t_obs"] = 1.0 + rng.uniform(-0.2, 0.2)  # a late one may agree with some rows only
        reading["xyz"] = np.where(np.isfinite(seen), seen, standing())
        reading["xyz"] += rng.uniform(-0.2, 0.2, (MAX_POINTS, 3))
        reading["present"] = int(rng.integers(1 << MAX_POINTS))
        reading["e_read"] = reading["e_p"] = rng.uniform(0.0, rng.choice([0.05, 0.5]), MAX_POINTS)
        wanted = twin(of, 0, reading, profile.limits[0])
        widen_exchanged(of.people[0], 0, reading, profile.limits[0])
        assert reading["e_p"] == pytest.approx(wanted, abs=1e-12)
        changed += bool((wanted > reading["e_read"]).any())
    assert changed > 0


@pytest.mark.parametrize("name", ["xyz", "e_read", "t_obs"])
def test_what_is_no_number_rules_no_exchange_out(name: str) -> None:
    of = gate()
    of.admit(report(1.0, ("a", hands(0.3))), 1.0)
    of.people[name][0, 0, Point.R_WRIST] = np.nan
    reading = np.zeros(1, dtype=READING)[0]
    reading["t_obs"], reading["xyz"], reading["e_read"], reading["e_p"] = 1.01, hands(0.03), E_P, E_P
    reading["xyz"][list(WRISTS)] = of.people["xyz"][0, 0, Point.L_WRIST] + ((0.0, 0.0, 0.0), (0.0, 0.03, 0.0))
    reading["present"] = sum(1 << point for point in WRISTS)
    widen_exchanged(of.people[0], 0, reading, ISO.limits[0])
    assert reading["e_p"][list(WRISTS)] == pytest.approx(0.03 + E_P)
