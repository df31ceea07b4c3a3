"""The proof that joint limits are kept: exact enclosures, borders, and what must not be missed."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from flint import fmpq

from failsafe import limit_kernels
from failsafe.limit_kernels import (
    ACCELERATION,
    JERK,
    NOT_PROVEN,
    POSITION,
    VELOCITY,
    WORK,
    append_and_prove,
    bound_motion,
    chain_rule,
    prove_steady,
    proven,
    within_limits,
)
from failsafe.path_kernels import (
    ACCEPTED,
    BEYOND_PATH,
    NOT_AT_TARGET,
    PATH,
    PATH_ACCELERATION,
    begin_path,
    path_state,
)
from failsafe.trajectory_kernels import locate
from tests.failsafe.motions import random_limits, random_motion, unwritable
from tests.failsafe.test_scaling import exact_derivatives, rational

NAN = math.nan
FREE = np.array([[-np.inf], [np.inf], [np.inf], [np.inf], [np.inf]])


def work() -> np.ndarray:
    return np.zeros(1, WORK)


def line(slope: float = 1.0, joints: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """q = slope · s for every joint, as breaks and coefficients."""
    coefficients = np.zeros((1, 6, joints))
    coefficients[0, 1] = slope
    return unwritable(np.array([0.0, 100.0]), coefficients)


def segment(s: float, v: float, a: float = 0.0, j: float = 0.0, duration: float = 1.0) -> np.ndarray:
    path = np.zeros(1, PATH)
    begin_path(path, s, v, a, duration)
    path[0]["j"][0] = j
    return path


# Enclosures


def some_segment(rng: np.random.Generator, length: float) -> tuple[np.ndarray, int]:
    """A segment on which ṡ stays positive, or one that ends at rest and is evaluated from there."""
    path = segment(
        rng.uniform(0.0, 0.5) * length, rng.uniform(0.6, 1.0), rng.normal(), 3.0 * rng.normal(), 0.2
    )
    if rng.random() < 0.3:
        record = path[0]
        record["n"], record["anchored"] = 2, 1
        record["t"][1:3] = 0.1, 0.3
        record["j"][1], record["v_end"] = rng.uniform(0.0, 20.0), rng.choice([0.0, 0.3])
        record["s_end"] = rng.uniform(0.3, 0.6) * length
        return path, 1
    return path, 0


@pytest.mark.parametrize("width", [0.0, 1e-9, 0.01, 0.1])
def test_enclosures_hold_the_exact_chain_rule_of_every_state(width, rng, count):
    """Rational arithmetic, no tolerance; at one instant they are no wider than some roundings."""
    for _ in range(count(3_000)):
        trajectory = random_motion(rng, random_limits(rng, 2), rng.uniform(0.1, 3.0)).trajectory
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        path, k = some_segment(rng, trajectory.s_end)
        tau0 = float(path[0]["t"][k]) + rng.uniform(0.0, 0.1)
        if rng.random() < 0.3:
            tau0 = float(path[0]["t"][k + 1]) - width
        tau1, scratch = tau0 + width, work()
        first = locate(b, path_state(path, k, tau0)[0])
        last = bound_motion(path, k, tau0, tau1, b, c, first, scratch)
        assert last == locate(b, path_state(path, k, tau1)[0])
        record = scratch[0]
        for tau in {tau0, tau1, float(rng.uniform(tau0, tau1))}:
            s, v, a, j = (rational(each) for each in path_state(path, k, tau))
            m = locate(b, float(path_state(path, k, tau)[0]))
            for joint in range(2):
                x = s - rational(trajectory.breaks[m])
                q, d1, d2, d3 = (each(x) for each in exact_derivatives(trajectory, m, joint))
                exact = (q, d1 * v, d2 * v * v + d1 * a, d3 * v * v * v + 3 * d2 * v * a + d1 * j)
                parts = (q, d1 * v, abs(d2 * v * v) + abs(d1 * a))
                parts = (*parts, abs(d3 * v * v * v) + abs(3 * d2 * v * a) + abs(d1 * j))
                bounds = [(record["lo"][0, joint], record["hi"][0, joint])]
                bounds += [tuple(record[name][:, joint]) for name in ("dq", "ddq", "dddq")]
                for value, size, (low, high) in zip(exact, parts, bounds, strict=True):
                    assert rational(low) <= value <= rational(high)
                    if width == 0.0:
                        most = fmpq(1, 10**10) * (1 + abs(size))
                        assert rational(high) - rational(low) <= most


@pytest.mark.parametrize("slope", [1.0, -1.0])
@pytest.mark.parametrize("v", [1.0, 0.0])
def test_roundings_are_on_the_outer_side_where_nothing_else_is(slope, v):
    """Straight on at constant speed: dq is ±v and ddq and dddq are 0, which is what is widened."""
    b, c = line(slope)
    scratch = work()
    bound_motion(segment(2.0, v), 0, 0.25, 0.75, b, c, 0, scratch)
    record = scratch[0]
    for name, value, wide in (("dq", slope * v, 1e-13), ("ddq", 0.0, 1e-13), ("dddq", 0.0, 1e-25)):
        low, high = record[name][:, 0]
        assert value - wide <= low <= value <= high <= value + wide
        assert low < value < high or name == "dddq"
    s = sorted((slope * (2.0 + 0.25 * v), slope * (2.0 + 0.75 * v)))
    assert s[0] - 1e-12 <= record["lo"][0, 0] < s[0] and s[1] < record["hi"][0, 0] <= s[1] + 1e-12


@pytest.mark.parametrize("slope", [1.0, -1.0])
def test_roundings_of_every_derivative_are_on_the_outer_side(slope):
    """Straight on with s̈ and s⃛ that are exact: at an instant the bounds are the value and a rounding."""
    b, c = line(slope)
    scratch = work()
    bound_motion(segment(2.0, 0.5, 0.25, 2.0), 0, 0.0, 0.0, b, c, 0, scratch)
    for name, value in (("dq", slope * 0.5), ("ddq", slope * 0.25), ("dddq", slope * 2.0)):
        low, high = scratch[0][name][:, 0]
        assert value - 1e-13 < low < value < high < value + 1e-13


@pytest.mark.parametrize("bend", [1.0, -1.0])
def test_at_rest_on_a_curve_nothing_moves(bend):
    b, c = (each.copy() for each in line())
    c[0, 2] = bend
    unwritable(b, c)
    scratch = work()
    bound_motion(segment(2.0, 0.0), 0, 0.0, 1.0, b, c, 0, scratch)
    for name in ("dq", "ddq", "dddq"):
        low, high = scratch[0][name][:, 0]
        assert -1e-13 < low <= 0.0 <= high < 1e-13


def products(*bounds: tuple[float, float]) -> tuple[float, float]:
    """The smallest and largest product of numbers from intervals: at their ends."""
    ends = [math.prod(each) for each in itertools.product(*bounds)]
    return min(ends), max(ends)


def test_the_chain_rule_in_intervals_is_that_of_their_ends(rng, count):
    """Every sign of every factor: neither narrower than the products of all ends, nor wider."""
    for _ in range(count(30_000)):
        random = rng.normal(size=(1, 6, 2)) * rng.choice([0.1, 1.0, 10.0], (1, 6, 2))
        b, c = unwritable(np.array([0.0, 9.0]), random)
        v, a = float(rng.choice([0.3, 3.0])), float(rng.choice([0.2, 2.0]) * rng.normal())
        path = segment(0.2, v, a, float(rng.choice([0.0, 1.0, 10.0]) * rng.normal()))
        t0, t1 = np.sort(rng.uniform(0.0, 0.4, 2)).tolist()
        states = np.array([path_state(path, 0, float(x)) for x in np.linspace(t0, t1, 200)])
        if states[:, 1].min() < 0.0:
            continue
        scratch = work()
        bound_motion(path, 0, t0, t1, b, c, 0, scratch)
        record = scratch[0]
        v_range, a_range = ((states[:, k].min(), states[:, k].max()) for k in (1, 2))
        j = (states[0, 3],) * 2
        v2, v3 = ((v_range[0] ** k, v_range[1] ** k) for k in (2, 3))
        for i in range(2):
            p, r, u = ((record["lo"][k, i], record["hi"][k, i]) for k in (1, 2, 3))
            parts = {
                "dq": [products(p, v_range)],
                "ddq": [products(r, v2), products(p, a_range)],
                "dddq": [
                    products(u, v3),
                    products((3.0, 3.0), r, products(v_range, a_range)),
                    products(p, j),
                ],
            }
            for name, terms in parts.items():
                size = sum(max(abs(low), abs(high)) for low, high in terms)
                near = 1e-4 * size + 1e-14  # between the instants ṡ may be a little beyond
                assert record[name][0, i] == pytest.approx(sum(low for low, _ in terms), abs=near)
                assert record[name][1, i] == pytest.approx(sum(high for _, high in terms), abs=near)


def test_the_chain_rule_joint_by_joint(rng):
    d, out = rng.normal(size=(4, 5)), np.full((4, 5), 7.0)
    v, a, j = 0.7, -1.3, 2.1
    chain_rule(d, v, a, j, 3, out)
    expected = [
        d[0], d[1] * v, d[2] * v**2 + d[1] * a, d[3] * v**3 + 3.0 * d[2] * v * a + d[1] * j,
    ]  # fmt: skip
    assert np.allclose(out[:, :3], np.array(expected)[:, :3], rtol=1e-14)
    assert (out[:, 3:] == 7.0).all()


# Enclosures against limits


def filled(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Limits, and enclosures well within them; what is beyond the joints is not a number."""
    limits = np.stack([-rng.uniform(1.0, 2.0, n), *rng.uniform(1.0, 2.0, (4, n))])
    scratch = work()
    for name, rows in (("lo", 4), ("hi", 4), ("dq", 2), ("ddq", 2), ("dddq", 2)):
        scratch[0][name][:rows] = NAN
        scratch[0][name][:rows, :n] = rng.uniform(-0.5, 0.5, (rows, n))
    return limits, scratch


FIELDS = (
    (POSITION, ("lo", 0), 0, -1.0), (POSITION, ("hi", 0), 1, 1.0),
    (VELOCITY, ("dq", 0), 2, -1.0), (VELOCITY, ("dq", 1), 2, 1.0),
    (ACCELERATION, ("ddq", 0), 3, -1.0), (ACCELERATION, ("ddq", 1), 3, 1.0),
    (JERK, ("dddq", 0), 4, -1.0), (JERK, ("dddq", 1), 4, 1.0),
)  # fmt: skip


@pytest.mark.parametrize(("quantity", "field", "row", "side"), FIELDS)
@pytest.mark.parametrize("joint", [0, 2])
def test_a_bound_may_touch_its_limit_and_no_more(quantity, field, row, side, joint, rng):
    limits, scratch = filled(rng, 3)
    name, end = field
    border = limits[row, joint] if quantity == POSITION else side * limits[row, joint]
    scratch[0][name][end, joint] = border
    assert within_limits(limits, True, scratch)
    beyond = math.nextafter(border, side * math.inf)
    scratch[0][name][end, joint] = beyond
    assert not within_limits(limits, True, scratch)
    record = scratch[0]
    found = (record["joint"], record["quantity"], record["value"], record["limit"])
    assert found == (joint, quantity, beyond, limits[row, joint])
    assert within_limits(limits, False, scratch) is (quantity == POSITION)
    for bad in (NAN, side * math.inf):
        scratch[0][name][end, joint] = bad
        assert not within_limits(limits, True, scratch)


def test_the_first_bound_beyond_a_limit_is_the_witness(rng, count):
    """Positions first, joint by joint, then one quantity after the other; the worse end of an enclosure."""
    for _ in range(count(20_000)):
        limits, scratch = filled(rng, 3)
        positions = bool(rng.random() < 0.7)
        expected: list[tuple[tuple[int, int, int], float, float]] = []
        for quantity, (name, end), row, side in FIELDS:
            for joint in range(3):
                if rng.random() > 0.1:
                    continue
                scratch[0][name][end, joint] = side * rng.uniform(2.1, 3.0)
                low, high = (scratch[0][each][:, joint] for each in ("lo", "hi"))
                if quantity != POSITION:
                    low, high = scratch[0][name][:2, joint]
                    worst = high if high >= -low else low
                    expected.append(((1, quantity, joint), worst, limits[row, joint]))
                elif positions:
                    value = scratch[0][name][end, joint]
                    expected.append(((0, joint, end if name == "hi" else -1), value, limits[row, joint]))
        kept = within_limits(limits, positions, scratch)
        assert kept is (not expected)
        if expected:
            order = min(each[0] for each in expected)
            _, _, limit = next(each for each in expected if each[0] == order)
            quantity, joint = (POSITION, order[1]) if order[0] == 0 else order[1:]
            record = scratch[0]
            assert (record["joint"], record["quantity"], record["limit"]) == (joint, quantity, limit)
            name = ("", "dq", "ddq", "dddq")[quantity]
            if name:
                low, high = record[name][:2, joint]
                assert record["value"] == (high if high >= -low else low)
            else:
                assert record["value"] in (record["lo"][0, joint], record["hi"][0, joint])


BEYOND = (
    (0, POSITION, 0.75, 0.75, math.inf), (1, POSITION, 0.75, 0.75, -math.inf),
    (2, VELOCITY, 0.5, 0.5, -math.inf), (3, ACCELERATION, 0.25, 0.25, -math.inf),
    (4, JERK, 2.0, 2.0, -math.inf),
)  # fmt: skip


@pytest.mark.parametrize(("row", "quantity", "value", "border", "towards"), BEYOND)
@pytest.mark.parametrize("slope", [1.0, -1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_an_instant_beyond_a_limit_is_its_own_witness(row, quantity, value, border, towards, slope, joint):
    """q = ±s at s = 0.75, ṡ = 0.5, s̈ = 0.25, s⃛ = 2: every number is exact."""
    if quantity == POSITION and slope < 0.0:
        row, value, border, towards = 1 - row, -value, -border, -towards
    b, c = line(slope, 2)
    path = segment(0.75, 0.5, 0.25, 2.0)
    limits = np.repeat(FREE, 2, axis=1)
    limits[row, joint] = border
    for positions in (False, True):
        assert not limit_kernels._beyond_at(path, 0, 0.0, b, c, limits, positions, work())
    limits[row, joint] = math.nextafter(border, towards)
    scratch = work()
    assert limit_kernels._beyond_at(path, 0, 0.0, b, c, limits, True, scratch)
    found = tuple(scratch[0][name] for name in ("joint", "quantity", "value", "limit"))
    signed = value if quantity == POSITION else slope * value
    assert found == (joint, quantity, signed, limits[row, joint])
    alone = limit_kernels._beyond_at(path, 0, 0.0, b, c, limits, False, work())
    assert alone is (quantity != POSITION)


# What must not be missed, and what must be found kept


def spike(rng: np.random.Generator, quantity: int, begin: float, width: float) -> tuple[Any, Any]:
    """At rest but for one short span, on which one derivative is ±2."""
    breaks, coefficients = np.array([0.0, begin, begin + width, 10.0]), np.zeros((3, 6, 2))
    joint = int(rng.integers(2))
    coefficients[1, quantity, joint] = rng.choice([-2.0, 2.0]) / math.factorial(quantity)
    return unwritable(breaks, coefficients)


@pytest.mark.parametrize("quantity", [POSITION, VELOCITY, ACCELERATION, JERK])
def test_no_excess_is_too_short_to_be_seen(quantity, rng, count):
    """Wherever it is, however long the stretches are and on whichever segment it falls."""
    limits = np.tile(np.array([[-1.0], [1.0], [1.0], [1.0], [1.0]]), 2)
    path = np.zeros(1, PATH)
    for _ in range(count(10_000)):
        ends = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 1.0, 3)), [1.0]])
        record = path[0]
        record["n"], record["anchored"], record["t"][:5] = 4, -1, ends
        record["s"][:4], record["v"][:4], record["a"][:4], record["j"][:4] = ends[:4], 1.0, 0.0, 0.0
        record["s_end"], record["v_end"] = 1.0, 1.0
        begin = rng.uniform(1e-6, 1.0 - 1e-4)
        b, c = spike(rng, quantity, begin, 10.0 ** rng.uniform(-6.0, -4.0))
        step = 10.0 ** rng.uniform(-3.0, 0.0)
        scratch = work()
        assert not proven(path, 0, 4, b, c, limits, step, True, scratch)
        assert scratch[0]["quantity"] == quantity and 0.0 <= scratch[0]["time"] <= 1.0
        assert proven(path, 0, 4, b, 0.4 * c, limits, step, True, work())
        assert proven(path, 0, 4, b, c, limits, step, False, work()) is (quantity == POSITION)
        # only the segments that are asked for
        holds = int(np.searchsorted(ends, begin, side="right")) - 1
        if begin + 1e-4 < ends[holds + 1]:
            for k in range(4):
                assert proven(path, k, k + 1, b, c, limits, step, True, work()) is (k != holds)
            assert proven(path, 0, holds, b, c, limits, step, True, work())
            assert not proven(path, holds, 4, b, c, limits, step, True, work())


@pytest.mark.parametrize("step", [0.003, 0.02, 0.1])
def test_a_motion_just_within_its_limits_is_proven_and_one_just_beyond_is_not(step, rng, count):
    """Whatever the stretches: they are halved until it can be told."""
    for _ in range(count(1_000)):
        trajectory = random_motion(rng, random_limits(rng, 1), 0.9).trajectory
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        s, duration = 0.2 * trajectory.s_end, min(0.5, 0.5 * trajectory.s_end)
        path = segment(s, 1.0, duration=duration)
        derivatives = trajectory.sample(s + np.linspace(0.0, duration, 4_000))
        peaks = [float(np.abs(each).max()) for each in derivatives]
        roomy = np.array([[-np.inf], [np.inf], [1.002 * peaks[1]], [1.002 * peaks[2]], [1.002 * peaks[3]]])
        assert proven(path, 0, 1, b, c, roomy, step, True, work())
        for row in (2, 3, 4):
            tight = roomy.copy()
            tight[row] = 0.99 * peaks[row - 1]
            scratch = work()
            assert not proven(path, 0, 1, b, c, tight, step, True, scratch)
            record = scratch[0]
            assert (record["joint"], record["quantity"], record["limit"]) == (0, row - 1, tight[row, 0])
            assert abs(record["value"]) > tight[row, 0]
            near = np.abs(s + np.linspace(0.0, duration, 4_000) - s - record["time"]) <= 2.0 * step
            assert np.abs(derivatives[row - 1][near]).max() > 0.97 * peaks[row - 1] * 0.99


def test_the_witness_is_near_the_instant_at_which_the_limit_is_crossed():
    """ṡ = 0.5 + t crosses 1 after half a second."""
    b, c = line()
    limits = FREE.copy()
    limits[2] = 1.0
    for step in (0.01, 0.1):
        scratch = work()
        assert not proven(segment(0.0, 0.5, 1.0), 0, 1, b, c, limits, step, True, scratch)
        record = scratch[0]
        assert 0.5 - step / 64.0 <= record["time"] <= 1.0
        assert record["value"] == pytest.approx(0.5 + record["time"], abs=step)
        assert 1.0 < record["value"] <= 1.5 + 1e-9


def test_no_time_is_no_proof():
    b, c = line()
    path = segment(0.0, 1.0)
    assert proven(path, 0, 1, b, c, FREE, 0.1, True, work())
    assert proven(path, 1, 1, b, c, FREE, 0.1, True, work()), "no segment, nothing to exceed a limit"
    for step in (0.0, -0.1, NAN):
        assert not proven(path, 0, 1, b, c, FREE, step, True, work())
    for begin, end in ((1.0, 0.5), (0.0, math.inf), (NAN, 1.0), (0.0, NAN)):
        path[0]["t"][:2] = begin, end
        assert not proven(path, 0, 1, b, c, FREE, 0.1, True, work())
    path[0]["t"][:2] = 0.5, 0.5
    assert proven(path, 0, 1, b, c, FREE, 0.1, True, work())


# Profiles and pieces


STOP = (np.array([0.1, 0.15, 0.1]), np.array([-40.0, 0.0, 40.0]))
"""From ṡ = 1 to rest with s̈ down to -4."""


@pytest.mark.parametrize(
    ("row", "limit", "kept"),
    [
        (2, 1.001, True), (2, 0.999, False), (3, 4.001, True), (3, 3.999, False), (4, 40.01, True),
        (4, 39.99, False), (1, 0.676, True), (1, 0.674, False), (0, 0.499, True), (0, 0.501, False),
    ],
)  # fmt: skip
def test_a_profile_is_held_against_the_limits_from_where_it_begins(row, limit, kept):
    """It moves from 0.5 to 0.675; the piece before it may be as it likes, it has been looked at."""
    b, c = line()
    limits, scratch = FREE.copy(), work()
    limits[row] = limit
    path = segment(70.0, 2.0, duration=0.3)
    given = (path, 1, (0.5, 1.0, 0.0), (0.0, 5.0, 40.0, 10.0), STOP, b, c, limits, 0.01)
    assert append_and_prove(*given, True, scratch) == (ACCEPTED if kept else NOT_PROVEN)
    assert (path[0]["n"], path[0]["t"][1], path[0]["t"][4]) == (4, 0.3, pytest.approx(0.65))
    if not kept:
        assert scratch[0]["limit"] == limit
    unheld = append_and_prove(*given, False, work())
    assert unheld == (ACCEPTED if kept or row < 2 else NOT_PROVEN)


@pytest.mark.parametrize(
    ("start", "change", "verdict"),
    [
        ((0.5, 1.0, 0.0), (0.0, 5.0, 40.0, 0.6), BEYOND_PATH),
        ((0.5, 1.0, 0.0), (0.0, 3.0, 40.0, 9.0), PATH_ACCELERATION),
        ((0.5, 1.1, 0.0), (0.0, 5.0, 40.0, 9.0), NOT_AT_TARGET),
        ((0.5, 1.0, 0.1), (0.0, 5.0, 40.0, 9.0), NOT_AT_TARGET),
        ((0.5, 1.0, 0.0), (0.1, 5.0, 40.0, 9.0), NOT_AT_TARGET),
    ],
)
def test_a_profile_that_is_not_accepted_is_not_proven_either(start, change, verdict):
    b, c = line()
    path = segment(0.0, 1.0)
    assert append_and_prove(path, 0, start, change, STOP, b, c, FREE, 0.01, True, work()) == verdict


@pytest.mark.parametrize("kept", [False, True])
def test_a_steady_piece_is_proven_and_its_end_is_told(kept):
    b, c = line()
    limits, path, out = FREE.copy(), segment(3.0, 3.0), np.full(3, 9.0)
    limits[2] = 0.81 if kept else 0.79
    assert prove_steady(path, 0.5, 0.8, 0.25, b, c, limits, 0.01, True, work(), out) is kept
    assert out.tolist() == [pytest.approx(0.7), 0.8, 0.0]
    assert (path[0]["n"], path[0]["s_end"], path[0]["v_end"]) == (1, out[0], 0.8)
    limits[2], limits[1] = 1.0, 0.6
    assert not prove_steady(path, 0.5, 0.8, 0.25, b, c, limits, 0.01, True, work(), out)
    assert prove_steady(path, 0.5, 0.8, 0.25, b, c, limits, 0.01, False, work(), out)
