"""S of ISO 13855 and S_p of ISO/TS 15066 against examples by hand, each with its arithmetic in mm and ms."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from robots.assumption import Assumption, Certainty
from verifier.required_distance import (
    Allowances,
    DistanceError,
    Edition,
    Lengths,
    RequiredDistance,
    SpeedBound,
    Times,
    constant_lengths,
    declared,
    least_sure,
    normal_approach,
    parallel_approach,
    protective_separation,
    separation_2024,
    unmonitored_person,
    varying_lengths,
)


def seconds(*parts: float) -> list[Assumption]:
    return [declared(f"t_{number}", value, "s") for number, value in enumerate(parts, 1)]


def metres(name: str, value: float) -> Assumption:
    return declared(name, value, "m")


def speed(name: str, value: float) -> Assumption:
    return declared(name, value, "m/s")


def curtain(t_ms: float, d_mm: float, over_mm: float | None = None) -> RequiredDistance:
    over = None if over_mm is None else metres("C_RO", over_mm / 1e3)
    return normal_approach(seconds(t_ms / 1e3), metres("d", d_mm / 1e3), over)


def floor(t_ms: float, h_mm: float, d_mm: float | None = None) -> RequiredDistance:
    return parallel_approach(
        seconds(t_ms / 1e3), metres("H", h_mm / 1e3), None if d_mm is None else metres("d", d_mm / 1e3)
    )


BAD = [float("nan"), float("inf"), -0.001]


@pytest.mark.parametrize("bad", BAD)
def test_numbers_that_are_none_are_refused(bad: float) -> None:
    zero = metres("Z", 0.0)
    with pytest.raises(DistanceError, match=r"t_1 = .* should be finite, not negative"):
        normal_approach(seconds(bad), metres("d", 0.014))
    with pytest.raises(DistanceError, match=r"d = "):
        normal_approach(seconds(0.1), metres("d", bad))
    with pytest.raises(DistanceError, match=r"C_RO = "):
        normal_approach(seconds(0.1), metres("d", 0.014), metres("C_RO", bad))
    with pytest.raises(DistanceError, match=r"H = "):
        parallel_approach(seconds(0.1), metres("H", bad))
    with pytest.raises(DistanceError, match=r"K = "):
        separation_2024(seconds(0.1), speed("K", bad), zero, zero)
    times = Times(declared("T_r", 0.1, "s"), declared("T_s", 0.1, "s"))
    with pytest.raises(DistanceError, match=r"v_r = "):
        constant_lengths(times, unmonitored_person(), speed("v_r", bad), metres("S_s", 0.1))
    lengths = constant_lengths(times, unmonitored_person(), speed("v_r", 1.0), metres("S_s", 0.1))
    with pytest.raises(DistanceError, match=r"Z_d = "):
        protective_separation(lengths, Allowances(zero, metres("Z_d", bad), zero))
    with pytest.raises(DistanceError):
        SpeedBound(np.array([0.0, 1.0]), np.array([bad]))
    with pytest.raises(DistanceError):
        SpeedBound(np.array([0.0, bad]), np.array([1.0]))


def test_units_and_words_are_refused() -> None:
    with pytest.raises(DistanceError, match="t = 100 is in ms, should be in s"):
        normal_approach([declared("t", 100.0, "ms")], metres("d", 0.014))
    with pytest.raises(DistanceError, match="T: no part of the response time"):
        normal_approach([], metres("d", 0.014))
    text = Assumption("d", "fine", "m", "", Certainty.DECLARED)
    with pytest.raises(DistanceError, match="d = 'fine' should be a number in m"):
        normal_approach(seconds(0.1), text)
    with pytest.raises(DistanceError, match=r"v_h = 1\.6 is in no unit"):
        times = Times(declared("T_r", 0.1, "s"), declared("T_s", 0.1, "s"))
        constant_lengths(times, declared("v_h", 1.6, ""), speed("v_r", 1.0), metres("S_s", 0.1))


@pytest.mark.parametrize(
    ("t", "v"),
    [([0.0, 1.0], [1.0, 1.0]), ([0.0], []), ([0.0, 0.0], [1.0]), ([1.0, 0.0], [1.0]), ([[0.0, 1.0]], [1.0])],
)
def test_speeds_over_time_that_make_no_sense_are_refused(t: object, v: object) -> None:
    with pytest.raises(DistanceError):
        SpeedBound(np.array(t), np.array(v))


def test_a_time_without_a_speed_is_refused() -> None:
    bound = SpeedBound(np.array([0.0, 1.0]), np.array([1.0]))
    for begin, end in ((-0.1, 0.5), (0.5, 1.1), (0.6, 0.5), (0.0, float("nan"))):
        with pytest.raises(DistanceError, match="no speed is known"):
            bound.length(begin, end)


@pytest.mark.parametrize(
    ("t_ms", "d_mm", "s_mm", "k_mm_s"),
    [
        (100, 14, 200, 2000),  # 2000 * 0.1 + 8 (14 - 14) = 200 + 0
        (20, 14, 100, 2000),  # 2000 * 0.02 + 0 = 40, at least 100
        (30, 10, 100, 2000),  # C = 8 (10 - 14) < 0, so 0; 60, at least 100
        (220, 20, 488, 2000),  # 2000 * 0.22 + 8 * 6 = 440 + 48
        (250, 14, 500, 2000),  # 500 + 0: not above 500
        (230, 20, 500, 1600),  # 460 + 48 = 508 > 500; 1600 * 0.23 + 48 = 416, at least 500
        (300, 30, 608, 1600),  # 600 + 128 = 728 > 500; 480 + 128
        (300, 40, 688, 1600),  # 600 + 208 > 500; 480 + 8 * 26 = 480 + 208
        (50, 40, 308, 2000),  # 100 + 208: the finer rule up to and with 40 mm
        (300, 50, 1330, 1600),  # d > 40: 480 + 850
        (0, 41, 850, 1600),  # 0 + 850
        (300, 70, 1330, 1600),
    ],
)
def test_normal_approach_by_hand(t_ms: float, d_mm: float, s_mm: float, k_mm_s: float) -> None:
    found = curtain(t_ms, d_mm)
    assert 1e3 * found.distance_m == pytest.approx(s_mm, abs=1e-9)
    assert 1e3 * found.term("K") == k_mm_s
    assert found.edition is Edition.ISO_13855_2010


def test_reaching_over_by_hand() -> None:
    # C = max(8 * 16 = 128, 500) = 500; 2000 * 0.1 + 500 = 700 > 500; 1600 * 0.1 + 500 = 660
    assert 1e3 * curtain(100, 30, 500).distance_m == pytest.approx(660.0)
    assert (
        curtain(100, 30, 100).distance_m == curtain(100, 30).distance_m
    )  # 100 < 128: reaching through decides
    assert curtain(100, 30, 500).term("C_RO") == 0.5


def test_a_coarse_resolution_is_beyond_the_rule() -> None:
    with pytest.raises(DistanceError, match=r"d = 0.071 m should be finite, not negative and at most 0.07 m"):
        curtain(100, 71)


@pytest.mark.parametrize(
    ("t_ms", "h_mm", "s_mm"),
    [
        (300, 300, 1560),  # 480 + 1200 - 0.4 * 300 = 480 + 1080
        (300, 0, 1680),  # a mat on the floor: 480 + 1200
        (300, 875, 1330),  # 480 + 1200 - 350 = 480 + 850
        (300, 1000, 1330),  # 1200 - 400 = 800, at least 850
    ],
)
def test_parallel_approach_by_hand(t_ms: float, h_mm: float, s_mm: float) -> None:
    assert 1e3 * floor(t_ms, h_mm).distance_m == pytest.approx(s_mm, abs=1e-9)


def test_the_height_of_a_field_must_fit_its_resolution() -> None:
    assert floor(300, 300, 70).distance_m == floor(300, 300).distance_m  # 15 (70 - 50) = 300
    with pytest.raises(DistanceError, match=r"H = 0.299 m should be at least 0.300 m"):
        floor(300, 299, 70)
    with pytest.raises(DistanceError, match="at most 1 m"):
        floor(300, 1001)


def test_2024_by_hand() -> None:
    # 1600 * (0.05 + 0.15 + 0.2) + 1200 + 100 = 640 + 1300
    found = separation_2024(seconds(0.05, 0.15, 0.2), speed("K", 1.6), metres("D_DS", 1.2), metres("Z", 0.1))
    assert 1e3 * found.distance_m == pytest.approx(1940.0)
    assert found.edition is Edition.ISO_13855_2024
    assert least_sure(found) is Certainty.DECLARED


def allowances(c: float, z_d: float, z_r: float) -> Allowances:
    return Allowances(metres("C", c), metres("Z_d", z_d), metres("Z_r", z_r))


def test_constant_protective_separation_by_hand() -> None:
    times = Times(declared("T_r", 0.1, "s"), declared("T_s", 0.3, "s"))
    # S_h = 1600 * (0.1 + 0.3) = 640; S_r = 1000 * 0.1 = 100; S_s = 150 as given; C = 0, Z_d = 30, Z_r = 40
    given = constant_lengths(times, unmonitored_person(), speed("v_r", 1.0), metres("S_s", 0.15))
    found = protective_separation(given, allowances(0.0, 0.03, 0.04))
    assert 1e3 * found.distance_m == pytest.approx(640 + 100 + 150 + 0 + 30 + 40)
    # S_s = 1000 * 0.3 = 300 where only the largest speed of the stop is known
    fast = constant_lengths(times, unmonitored_person(), speed("v_r", 1.0), speed("v_s", 1.0))
    assert 1e3 * protective_separation(fast, allowances(0.0, 0.03, 0.04)).distance_m == pytest.approx(1110.0)
    assert [found.term(name) for name in ("S_h", "S_r", "S_s", "C", "Z_d", "Z_r")] == pytest.approx(
        [0.64, 0.1, 0.15, 0.0, 0.03, 0.04]
    )
    assert (found.symbol, found.edition) == ("S_p", Edition.TS_15066_2016)


def test_varying_protective_separation_by_hand() -> None:
    """The robot at 1 m/s for 0.1 s, then in three steps to rest; the person at 2 m/s, then at 1 m/s."""
    robot = SpeedBound(np.array([5.0, 5.1, 5.2, 5.3, 5.4]), np.array([1.0, 0.9, 0.6, 0.3]))
    person = SpeedBound(np.array([5.0, 5.2, 6.0]), np.array([2.0, 1.0]))
    times = Times(declared("T_r", 0.1, "s"), declared("T_s", 0.3, "s"))
    lengths = varying_lengths(5.0, times, person, robot)
    # S_h = 2000 * 0.2 + 1000 * 0.2 = 600; S_r = 1000 * 0.1 = 100; S_s = (900 + 600 + 300) * 0.1 = 180
    found = protective_separation(lengths, allowances(0.1, 0.02, 0.01))
    assert 1e3 * found.distance_m == pytest.approx(600 + 100 + 180 + 100 + 20 + 10)
    assert 1e3 * found.term("S_s") == pytest.approx(180.0)


def test_constant_speeds_are_the_varying_ones_that_do_not_vary(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(2000)):
        t0, reaction, stop, v_h, v_r = rng.uniform(0.0, 2.0, 5)
        times = Times(declared("T_r", reaction, "s"), declared("T_s", stop, "s"))
        end = t0 + reaction + stop + 1.0
        one = constant_lengths(times, speed("v_h", v_h), speed("v_r", v_r), speed("v_s", v_r))
        other = varying_lengths(
            t0, times, SpeedBound.constant(v_h, t0, end), SpeedBound.constant(v_r, t0, end)
        )
        assert total(one) == pytest.approx(total(other), rel=1e-9, abs=1e-12)


def total(lengths: Lengths) -> float:
    return protective_separation(lengths, allowances(0.0, 0.0, 0.0)).distance_m


def test_a_length_is_the_exact_sum_of_the_steps(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """In rational numbers, step by step."""
    for _ in range(count(2000)):
        n = int(rng.integers(1, 12))
        t, v = np.cumsum(rng.uniform(0.01, 1.0, n + 1)), rng.uniform(0.0, 3.0, n)
        begin, end = np.sort(rng.uniform(t[0], t[-1], 2))
        exact = Fraction(0)
        for (a, b), each in zip(pairwise(t.tolist()), v.tolist(), strict=True):
            low, high = max(Fraction(a), Fraction(begin)), min(Fraction(b), Fraction(end))
            exact += max(Fraction(0), high - low) * Fraction(each)
        assert SpeedBound(t, v).length(begin, end) == pytest.approx(float(exact), rel=1e-12, abs=1e-14)


def test_more_of_anything_never_requires_less(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    for _ in range(count(20_000)):
        t, d, h = rng.uniform(0.0, 600.0), rng.uniform(0.0, 70.0), rng.uniform(0.0, 1000.0)
        more = rng.uniform(0.0, 50.0)
        assert curtain(t + more, d).distance_m >= curtain(t, d).distance_m - 1e-12
        assert curtain(t, min(70.0, d + more)).distance_m >= curtain(t, d).distance_m - 1e-12
        assert curtain(t, d, 100.0 + more).distance_m >= curtain(t, d, 100.0).distance_m - 1e-12
        assert floor(t + more, h).distance_m >= floor(t, h).distance_m
        assert floor(t, max(0.0, h - more)).distance_m >= floor(t, h).distance_m


def test_every_term_says_where_it_comes_from() -> None:
    times = Times(declared("T_r", 0.1, "s", "a trace"), declared("T_s", 0.3, "s"))
    lengths = constant_lengths(times, unmonitored_person(), speed("v_r", 1.0), metres("S_s", 0.15))
    for found in (
        curtain(300, 30), curtain(300, 50, 400), floor(300, 300, 30),
        protective_separation(lengths, allowances(0.0, 0.03, 0.04)),
    ):  # fmt: skip
        assert all(item.source and item.name and item.unit for item in found.terms)
        assert str(found.edition) in found.formula.source
        assert len({item.name for item in found.terms}) == len(found.terms)
    assert least_sure(curtain(300, 30)) is Certainty.UNVERIFIED
    assert least_sure(protective_separation(lengths, allowances(0.0, 0.03, 0.04))) is Certainty.DECLARED
    assert unmonitored_person().value == 1.6 and "Marvel" in unmonitored_person().source
    with pytest.raises(KeyError):
        curtain(300, 30).term("Z_q")
