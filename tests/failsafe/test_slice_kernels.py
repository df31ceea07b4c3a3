"""Slices of a path motion: how many, where they end, and bounds neither too small nor too wide."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe import path_kernels, stop_kernels
from failsafe.limit_kernels import WORK
from failsafe.path_kernels import PATH, begin_path, path_state
from failsafe.slice_kernels import slice_length, slice_path, slices_of, steady_plan, write_path_slices
from robots.motion import MAX_SLICES, new_slices
from tests.failsafe.motions import random_limits, random_motion, unwritable

NAN = math.nan
STOP = (np.array([0.1, 0.15, 0.1]), np.array([-40.0, 0.0, 40.0]))
"""From ṡ = 1 to rest with s̈ down to -4."""


def work() -> np.ndarray:
    return np.zeros(1, WORK)


def lines(slopes: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """q = 0.3 + slope · s, joint by joint."""
    coefficients = np.zeros((1, 6, len(slopes)))
    coefficients[0, 0], coefficients[0, 1] = 0.3, slopes
    return unwritable(np.array([0.0, 100.0]), coefficients)


def limits_of(n: int, v: float = math.inf, a: float = math.inf) -> np.ndarray:
    return np.repeat(np.array([[-np.inf], [np.inf], [v], [a], [np.inf]]), n, axis=1)


def piece_and_stop(duration: float = 0.045) -> np.ndarray:
    """ṡ = 1 for a while, then the stop, from s = 2 on."""
    path = np.zeros(1, PATH)
    begin_path(path, 2.0, 1.0, 0.0, duration)
    found = path_kernels.append_profile(path, 1, 2.0 + duration, 1.0, 0.0, *STOP, 0.0, 5.0, 40.0, 10.0)
    assert found == path_kernels.ACCEPTED
    return path


# How many


@pytest.mark.parametrize("length", [0.01, 0.1, 1.0 / 3.0])
def test_a_segment_of_whole_slices_makes_as_many(length):
    for k in range(1, MAX_SLICES + 1):
        assert slices_of(k * length, length) == k
        assert slices_of(k * length * (1.0 - 1e-9), length) == k
        assert slices_of(k * length * (1.0 + 1e-9), length) in (k + 1, MAX_SLICES + 1)
        assert slices_of((k - 0.5) * length, length) == k
    assert slices_of(MAX_SLICES * length * (1.0 + 1e-9), length) > MAX_SLICES
    assert slices_of(0.0, length) == slices_of(1e-12, length) == 1


@pytest.mark.parametrize("duration", [NAN, math.inf, 1e300, 0.7])
def test_more_slices_than_there_may_be_are_too_many(duration):
    assert slices_of(duration, 0.01) > MAX_SLICES
    for none in (NAN, 0.0, 5e-324):
        assert slices_of(0.5, none) > MAX_SLICES


@pytest.mark.parametrize("most", [MAX_SLICES, 30])
def test_slices_are_as_long_as_is_wanted_where_there_is_room_and_else_no_longer_than_needed(most, rng, count):
    longer = 0
    for _ in range(count(50_000)):
        segments = int(rng.integers(1, 12))
        times = rng.uniform(-5.0, 5.0) + np.concatenate(
            [
                [0.0],
                np.cumsum(rng.choice([0.01, 0.03, 0.1, 1e-4], segments) * rng.uniform(0.5, 2.0, segments)),
            ]
        )
        wanted = 10.0 ** rng.uniform(-4.0, 0.0)
        parts = np.diff(times)
        length = slice_length(np.append(times, 77.0), segments, most, wanted)
        needed = np.maximum(np.ceil(parts / wanted), 1).sum()
        filled = sum(slices_of(float(each), length) for each in parts)
        assert filled <= most
        if needed <= most:
            assert length == wanted
        else:
            longer += 1
            assert length >= wanted
            assert filled >= most - segments, "longer than needed"
    assert longer > 0


@pytest.mark.parametrize("bad", [NAN, math.inf, -1.0])
def test_from_times_that_are_none_no_length_is_made(bad):
    assert slice_length(np.array([0.0, bad]), 1, MAX_SLICES, 0.01) == 0.01
    assert slice_length(np.array([0.0, 0.0]), 1, MAX_SLICES, 0.01) == 0.01
    assert slice_length(np.array([0.0, 6.3]), 1, MAX_SLICES, 0.01) == pytest.approx(0.1)


def test_as_many_slices_as_there_may_be_and_one_more():
    exactly = np.array([0.0, 0.32, 0.64])
    assert slice_length(exactly, 2, MAX_SLICES, 0.01) == 0.01
    assert slice_length(exactly + np.array([0.0, 0.0, 0.002]), 2, MAX_SLICES, 0.01) > 0.01


# Where they end, and what they hold


def test_slices_of_straight_motion_in_closed_form():
    """q' is constant: what bounds dq and ddq are ṡ at the begin of a slice and s̈ at its ends."""
    slopes = [1.0, -2.0, 0.0]
    b, c = lines(slopes)
    path, slices = piece_and_stop(), new_slices()
    write_path_slices(path, b, c, limits_of(3), 50.0, 0.01, slices, work())
    record = slices[0]
    # 4.5 slices in the piece, 10, 15 and 10 in the segments of the stop
    ends = [*np.linspace(0.0, 0.045, 6), *np.linspace(0.045, 0.145, 11)[1:]]
    ends += [*np.linspace(0.145, 0.295, 16)[1:], *np.linspace(0.295, 0.395, 11)[1:]]
    n = int(record["n"])
    assert n == len(ends) - 1 == 40
    assert record["t"][: n + 1] == pytest.approx(50.0 + np.array(ends), abs=1e-12)
    rows = [0] * 5 + [1] * 10 + [2] * 15 + [3] * 10
    for row, k in enumerate([*rows, 3]):
        s, v, a, _ = path_state(path, k, ends[row])
        for i, slope in enumerate(slopes):
            expected = (0.3 + slope * s, slope * v, slope * a)
            found = tuple(record[name][row, i] for name in ("q", "dq", "ddq"))
            assert found == pytest.approx(expected, abs=1e-11)
    for row, k in enumerate(rows):
        v = path_state(path, k, ends[row])[1]
        a = max(abs(path_state(path, k, tau)[2]) for tau in ends[row : row + 2])
        for i, slope in enumerate(slopes):
            assert abs(slope) * v <= record["dq_max"][row, i] <= abs(slope) * v + 1e-11
            assert abs(slope) * a <= record["ddq_max"][row, i] <= abs(slope) * a + 1e-11


def test_bounds_are_no_wider_than_what_is_between_the_instants(rng, count):
    """On curved paths: above all samples, and by no more than what a derivative changes within a slice."""
    for _ in range(count(1_000)):
        motion = random_motion(rng, random_limits(rng, 2), 0.8)
        b, c = motion.trajectory.kernel_breaks, motion.trajectory.kernel_coefficients
        s, duration = 0.3 * motion.trajectory.s_end, 0.03
        path, slices = np.zeros(1, PATH), new_slices()
        begin_path(path, s, 1.0, 0.0, duration)
        write_path_slices(path, b, c, limits_of(2), 0.0, 0.001, slices, work())
        assert slices[0]["n"] == 30
        for row in range(30):
            d = [abs(each) for each in motion.derivatives(s + np.linspace(row, row + 1, 20) * 0.001)]
            for name, k in (("dq_max", 1), ("ddq_max", 2)):
                most, bound = d[k].max(axis=0), slices[0][name][row, :2]
                assert (bound >= most * (1.0 - 1e-9) - 1e-12).all()
                assert (bound <= most + 0.01 * d[k + 1].max(axis=0) * 0.001 + 1e-4 * (1.0 + most)).all()


@pytest.mark.parametrize(("v", "a"), [(0.7, math.inf), (math.inf, 3.0), (0.7, 3.0)])
def test_a_bound_above_the_limit_is_the_limit(v, a):
    """Of each joint its own: the plan has been proven to keep it."""
    b, c = lines([1.0, 0.5])
    free, slices = new_slices(), new_slices()
    write_path_slices(piece_and_stop(), b, c, limits_of(2), 0.0, 0.01, free, work())
    limits = limits_of(2, v, a)
    limits[2:, 1] /= 3.0
    write_path_slices(piece_and_stop(), b, c, limits, 0.0, 0.01, slices, work())
    n = int(free["n"][0])
    assert slices["n"][0] == n
    for name, row in (("dq_max", 2), ("ddq_max", 3)):
        expected = np.minimum(free[name][0, :n, :2], limits[row])
        assert (slices[name][0, :n, :2] == expected).all()
        if math.isfinite((v, a)[row - 2]):
            assert (expected < free[name][0, :n, :2]).any(axis=0).all()


@pytest.mark.parametrize("row", [2, 3])
@pytest.mark.parametrize("joint", [0, 1])
def test_no_slices_where_a_bound_is_none(row, joint):
    b, c = lines([1.0, 0.5])
    slices = new_slices()
    slices["n"] = 5
    limits = limits_of(2)
    limits[row, joint] = NAN
    write_path_slices(piece_and_stop(), b, c, limits, 0.0, 0.01, slices, work())
    assert slices["n"][0] == 0
    for bad in (NAN, math.inf, 1e308):  # from the last one comes a bound that is infinite, not NaN
        spoilt, slices = c.copy(), new_slices()
        spoilt[0, row - 1, joint] = bad
        write_path_slices(piece_and_stop(), *unwritable(b, spoilt), limits_of(2), 0.0, 0.01, slices, work())
        assert slices["n"][0] == 0


def test_no_slices_where_there_would_be_too_many():
    b, c = lines([1.0])
    for length, n in ((0.01, 64), (0.00999, 0), (1e-6, 0)):
        path, slices = np.zeros(1, PATH), new_slices()
        begin_path(path, 2.0, 1.0, 0.0, 0.32)
        path[0]["n"], path[0]["t"][2] = 2, 0.64
        path[0]["s"][1], path[0]["v"][1] = 2.32, 1.0
        slices["n"] = 7
        write_path_slices(path, b, c, limits_of(1), 0.0, length, slices, work())
        assert slices["n"][0] == n


def test_a_path_speed_a_rounding_below_zero_moves_no_joint_backwards():
    """Such as the acceptance test admits, at the begin of a segment that is evaluated from its end."""
    b, c = lines([1.0, -2.0])
    path, slices = np.zeros(1, PATH), new_slices()
    assert path_kernels.append_profile(
        path, 0, 2.0, -5e-13, 1e-12, np.ones(1), np.array([-1e-12]), 0.0, 1.0, 1.0, 9.0
    ) == (path_kernels.ACCEPTED)
    assert path_state(path, 0, 0.0)[1] < 0.0
    write_path_slices(path, b, c, limits_of(2), 0.0, 0.1, slices, work())
    assert (slices[0]["n"], slices[0]["dq"][0].any()) == (10, False)


@pytest.mark.parametrize("wanted", [0.01, 1e-3, 1e-5])
def test_a_plan_is_cut_into_longer_slices_where_there_would_be_too_many(wanted):
    b, c = lines([1.0])
    slices, out, path = new_slices(), np.zeros(3), piece_and_stop()
    n = slice_path(path, b, c, limits_of(1), 3.0, wanted, slices, work(), out)
    assert n == slices["n"][0] and 0 < n <= MAX_SLICES
    assert n > MAX_SLICES - 8 or wanted == 0.01
    assert out[:2].tolist() == [path[0]["t"][4], path[0]["s_end"]]
    assert slices["t"][0, n] == pytest.approx(3.0 + out[0])


# Piece and stop in one call


def steady(b, c, limits, block, *, s_max=10.0, v=1.0, stop=(5.0, 40.0), positions=True):
    """Piece of 0.045 s from s = 2 on, and the stop."""
    out = np.zeros(3)
    profile = STOP if v else (np.zeros(3), np.zeros(3))
    ready = steady_plan(
        np.zeros(1, PATH), (2.0, v, 0.045, s_max), (*stop, 50.0, 0.01), profile, b, c, limits, 0.01,
        positions, block, work(), out,
    )  # fmt: skip
    return ready, out


def test_a_steady_plan_is_piece_and_stop():
    b, c = lines([1.0, -2.0])
    block, expected = new_slices(), new_slices()
    ready, out = steady(b, c, limits_of(2), block)
    write_path_slices(piece_and_stop(), b, c, limits_of(2), 50.0, 0.01, expected, work())
    assert ready and block.tobytes() == expected.tobytes()
    # half of 0.35 s at ṡ = 1 on average
    assert out[:2].tolist() == [pytest.approx(0.395), pytest.approx(2.22)]


@pytest.mark.parametrize(
    "changes",
    [
        {"s_max": 2.044}, {"s_max": 2.219}, {"stop": (3.9, 40.0)}, {"stop": (5.0, 39.0)}, {"s_max": NAN},
        {"row": (2, 1.999)}, {"row": (3, 7.999)}, {"row": (4, 79.0)}, {"row": (0, -4.13)}, {"row": (1, 2.5)},
    ],
)  # fmt: skip
def test_of_a_steady_plan_that_fails_nothing_is_left(changes):
    b, c = lines([1.0, -2.0])
    limits, block = limits_of(2), new_slices()
    row = changes.pop("row", None)
    if row:
        limits[row[0]] = row[1]
    block["n"] = 9
    assert not steady(b, c, limits, block, **changes)[0]
    assert block["n"][0] == 0
    if row and row[0] < 2:
        assert steady(b, c, limits, block, positions=False)[0]


@pytest.mark.parametrize(("s_max", "ready"), [(2.0, True), (1.999, False)])
def test_a_steady_plan_may_rest_where_its_path_ends(s_max, ready):
    b, c = lines([1.0])
    block = new_slices()
    assert steady(b, c, limits_of(1), block, v=0.0, s_max=s_max)[0] is ready
    assert bool(block["n"][0] > 0) is ready


def test_the_slice_ends_without_their_joint_motion_are_the_same(rng, count):
    """stop_kernels tells instants and s of the slices that slice_path makes."""
    for _ in range(count(2_000)):
        path, wanted = piece_and_stop(float(rng.uniform(0.001, 0.2))), 10.0 ** rng.uniform(-3.0, -0.5)
        b, c = lines([1.0])
        slices, out, plans = new_slices(), np.zeros(3), np.zeros(1, stop_kernels.PLANS)
        n = slice_path(path, b, c, limits_of(1), 0.0, wanted, slices, work(), out)
        assert stop_kernels._slice_ends(path, wanted, plans[0])
        record = plans[0]
        assert (record["n"], record["duration"], record["s_rest"]) == (n, out[0], out[1])
        assert (record["t"][: n + 1] == slices["t"][0, : n + 1]).all()
        assert record["s"][: n + 1] == pytest.approx(slices["q"][0, : n + 1, 0] - 0.3, abs=1e-12)
        widest = float(np.diff(slices["t"][0, : n + 1]).max())
        assert widest <= record["longest"] <= widest * (1.0 + 1e-8)
