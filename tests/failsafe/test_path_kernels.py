"""Segments of a path motion: their states against polynomials, their acceptance at every border."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from failsafe import path_kernels
from failsafe.manoeuvre import Acceptance
from failsafe.path_kernels import (
    MAX_SEGMENTS,
    PATH,
    append_profile,
    begin_path,
    cut_path,
    path_at,
    path_state,
)
from tests.failsafe.motions import path_of, random_limits, random_motion

NAN = math.nan
TINY = path_kernels.SHORTEST


def any_path(rng: np.random.Generator, n: int, anchored: int = -1) -> np.ndarray:
    """Segments that do not even fit together, so that one cannot be taken for another."""
    path = np.zeros(1, PATH)
    record = path[0]
    record["n"], record["anchored"] = n, anchored
    record["t"][: n + 1] = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, n))])
    record["t"][n + 1 :] = 99.0
    for name in ("s", "v", "a", "j"):
        record[name] = rng.normal(size=MAX_SEGMENTS)
    record["v"] += 9.0
    record["s_end"], record["v_end"] = rng.normal(), 9.0 + rng.normal()
    return path


def segment_of(record: Any, k: int) -> tuple[Polynomial, float]:
    """s of a segment as a polynomial, and the instant that it is about."""
    jerk = record["j"][k] / 6.0
    if k == record["anchored"]:
        return Polynomial([record["s_end"], record["v_end"], 0.0, jerk]), record["t"][k + 1]
    return Polynomial([record["s"][k], record["v"][k], record["a"][k] / 2.0, jerk]), record["t"][k]


@pytest.mark.parametrize("anchored", [-1, 0, 2, 3])
def test_the_state_on_a_segment_is_that_of_its_polynomial(anchored, rng, count):
    for _ in range(count(2_000)):
        path = any_path(rng, 4, anchored)
        for k in range(4):
            polynomial, origin = segment_of(path[0], k)
            for tau in (*path[0]["t"][k : k + 2], rng.uniform(*path[0]["t"][k : k + 2])):
                expected = [(polynomial.deriv(d) if d else polynomial)(tau - origin) for d in range(4)]
                assert path_state(path, k, tau) == pytest.approx(expected, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize(
    ("speed", "counts_as"),
    [(-0.5 * TINY, 0.0), (-TINY, 0.0), (-1.001 * TINY, -1.001 * TINY), (0.5 * TINY, 0.5 * TINY)],
)
def test_a_path_speed_a_rounding_below_zero_counts_as_none(speed, counts_as):
    path = np.zeros(1, PATH)
    begin_path(path, 1.0, speed, 0.0, 1.0)
    assert path_state(path, 0, 0.5)[1] == counts_as


def test_a_plan_begins_with_a_piece_of_constant_acceleration(rng, count):
    for _ in range(count(2_000)):
        path = any_path(rng, 4, 3)
        s, v, a, duration = *rng.uniform(0.5, 2.0, 2), rng.normal(), rng.uniform(0.1, 2.0)
        begin_path(path, s, v, a, duration)
        record = path[0]
        assert (record["n"], record["anchored"], record["t"][0], record["t"][1]) == (1, -1, 0.0, duration)
        whole = Polynomial([s, v, a / 2.0])
        for tau in (0.0, 0.3 * duration, duration):
            expected = [whole(tau), whole.deriv()(tau), a, 0.0]
            if expected[1] >= 0.0:
                assert path_state(path, 0, tau) == pytest.approx(expected, rel=1e-13, abs=1e-13)
        assert record["s_end"] == pytest.approx(whole(duration), rel=1e-13, abs=1e-13)
        assert record["v_end"] == pytest.approx(whole.deriv()(duration), rel=1e-13, abs=1e-13)


# Where the plan is at an instant


@pytest.mark.parametrize("v_end", [0.0, 0.4])
def test_an_instant_belongs_to_the_segment_that_begins_at_or_before_it(v_end, rng, count):
    out = np.zeros(3)
    for _ in range(count(500)):
        path = any_path(rng, 4)
        record = path[0]
        record["v_end"] = v_end
        ends = record["t"][:5].tolist()
        for tau in (
            *ends[:4],
            *(math.nextafter(each, 0.0) for each in ends[1:]),
            *rng.uniform(0.0, ends[4], 4),
        ):
            k = int(np.searchsorted(ends, tau, side="right")) - 1
            path_at(path, float(tau), out)
            assert tuple(out) == path_state(path, k, float(tau))[:3]
        path_at(path, ends[4], out)
        at_its_end = (record["s_end"], 0.0, 0.0) if v_end == 0.0 else path_state(path, 3, ends[4])[:3]
        assert tuple(out) == at_its_end
        for later in (math.nextafter(ends[4], 99.0), 1e9, math.inf):
            path_at(path, later, out)
            assert tuple(out) == (record["s_end"], 0.0, 0.0), "at rest beyond its end"


def test_nothing_is_known_before_the_begin_or_without_a_segment(rng):
    path, out = any_path(rng, 2), np.zeros(3)
    path[0]["t"][0] = 0.05
    for tau in (math.nextafter(0.05, 0.0), -1.0, NAN, -math.inf):
        out[:] = 1.0
        path_at(path, tau, out)
        assert np.isnan(out).all()
    path_at(path, 0.05, out)
    assert np.isfinite(out).all()
    path[0]["n"] = 0
    path_at(path, 0.05, out)
    assert np.isnan(out).all()


def test_the_motion_at_an_instant_is_the_chain_rule(rng, count):
    for _ in range(count(1_000)):
        n = int(rng.integers(1, 4))
        motion = random_motion(rng, random_limits(rng, n), 0.8)
        path = np.zeros(1, PATH)
        s, v, a = rng.uniform(0.0, 0.5) * motion.trajectory.s_end, rng.uniform(0.1, 1.0), rng.normal()
        begin_path(path, s, v, a, 0.05)
        state, out = np.zeros(3), np.zeros((4, n + 1))
        b, c = motion.trajectory.kernel_breaks, motion.trajectory.kernel_coefficients
        path_kernels.motion_at(path, b, c, 0.03, state, out)
        at, speed = s + 0.03 * v + 0.00045 * a, v + 0.03 * a
        assert tuple(state) == pytest.approx((at, speed, a), rel=1e-12)
        q, d1, d2, _ = (each[0] for each in motion.derivatives(np.array([at])))
        expected = np.array([q, d1 * speed, d2 * speed**2 + d1 * a])
        assert np.allclose(out[:3, :n], expected, rtol=1e-9, atol=1e-9 * (1.0 + np.abs(d2).max()))
        path_kernels.motion_at(path, b, c, -0.01, state, out)
        assert np.isnan(out[:, :n]).all() and np.isnan(state).all()
        assert (out[:, n] == 0.0).all(), "no joint but those of the trajectory"


# What is left of a plan after a cycle


def test_a_cut_plan_goes_on_at_constant_speed_where_its_segments_end_before(rng, count):
    out = np.zeros(3)
    for _ in range(count(1_000)):
        for n in range(4):
            path = any_path(rng, n, n - 1)
            whole = path[0].copy()
            if n == 0:
                path[0]["t"][0] = 5.0  # of the plan before
            end = whole["t"][n] if n else 0.0
            duration = end + float(rng.choice([2.0 * TINY, 0.3]))
            cut_path(path, duration, out)
            record = path[0]
            assert (record["n"], record["anchored"]) == (n + 1, -1)
            assert record["t"][0] == 0.0 and record["t"][n] == end and record["t"][n + 1] == duration
            for tau in (end, 0.5 * (end + duration), duration):
                expected = (whole["s_end"] + (tau - end) * whole["v_end"], whole["v_end"], 0.0, 0.0)
                assert path_state(path, n, tau) == pytest.approx(expected, rel=1e-13, abs=1e-13)
            assert tuple(out) == path_state(path, n, duration)[:3]
            assert (record["s_end"], record["v_end"]) == (out[0], out[1])
            for name in ("t", "s", "v", "a", "j"):
                assert (record[name][1:n] == whole[name][1:n]).all()


def test_a_plan_is_cut_within_a_segment(rng, count):
    out = np.zeros(3)
    for _ in range(count(1_000)):
        path = any_path(rng, 4, 3)
        whole = path[0].copy()
        k = int(rng.integers(0, 4))
        duration = float(rng.uniform(*whole["t"][k : k + 2]))
        cut_path(path, duration, out)
        record = path[0]
        assert (record["n"], record["anchored"], record["t"][k + 1]) == (k + 1, -1, duration)
        for name in ("s", "v", "a", "j"):
            assert (record[name][: k + 1] == whole[name][: k + 1]).all()
        assert tuple(out) == path_state(path, k, duration)[:3]
        assert (record["s_end"], record["v_end"]) == (out[0], out[1])


@pytest.mark.parametrize("off", [-0.9, 0.0, 0.9])
def test_a_cut_at_the_end_meets_the_target(off, rng):
    path, out = any_path(rng, 3), np.zeros(3)
    duration = float(path[0]["t"][3]) + off * TINY
    cut_path(path, duration, out)
    assert (path[0]["n"], path[0]["t"][3]) == (3, duration)
    assert out[0] == path_state(path, 2, duration)[0] == path[0]["s_end"]
    assert out[1] == path[0]["v_end"] != path_state(path, 2, duration)[1] and out[2] == 0.0


def test_a_cut_before_the_end_of_the_first_segment_keeps_it(rng):
    path, out = any_path(rng, 3), np.zeros(3)
    cut_path(path, 0.5 * TINY, out)
    assert (path[0]["n"], path[0]["t"][1]) == (1, 0.5 * TINY)


@pytest.mark.parametrize(("beyond", "n"), [(0.5, 1), (1.0, 1), (1.5, 2)])
def test_no_segment_remains_that_is_shorter_than_the_shortest(beyond, n):
    path, out = np.zeros(1, PATH), np.zeros(3)
    record = path[0]
    record["n"], record["t"][:4] = 3, (0.0, 0.0, 0.5, 1.0)
    record["t"][1] = 0.0  # instants near 0: their differences are exact
    record["t"][:4] = (-0.5, 0.0, 0.5, 1.0)
    cut_path(path, beyond * TINY, out)
    assert record["n"] == n and record["t"][n] == beyond * TINY


# The acceptance test at its borders


STOP = ((0.1, -40.0), (0.15, 0.0), (0.1, 40.0))
"""From ṡ = 1 to rest with s̈ down to -4."""


def accept(
    pairs, s=0.5, v=1.0, a=0.0, target=0.0, a_limit=5.0, j_limit=40.0, s_max=10.0, first=0, path=None
) -> tuple[Acceptance, Any]:
    path = np.zeros(1, PATH) if path is None else path
    path[0]["n"], path[0]["anchored"] = 7, 7
    durations, jerks = (np.array(each, dtype=float) for each in zip(*pairs, strict=True))
    found = append_profile(path, first, s, v, a, durations, jerks, target, a_limit, j_limit, s_max)
    if found != Acceptance.ACCEPTED:
        assert (path[0]["n"], path[0]["anchored"]) == (first, -1) or path[0]["n"] == first
    return Acceptance(found), path[0]


@pytest.mark.parametrize("first", [0, 1, 3])
def test_a_profile_follows_the_segments_before_it(first, rng):
    path = any_path(rng, first)
    if first == 0:
        path[0]["t"][0] = 5.0  # of the plan before
    before = path[0].copy()
    found, record = accept(((0.0, 9.0), STOP[0], (0.9 * TINY, 3.0), *STOP[1:]), first=first, path=path)
    assert found is Acceptance.ACCEPTED
    n = first + 3
    assert (record["n"], record["anchored"]) == (n, n - 1)
    begin = before["t"][first] if first else 0.0
    assert record["t"][first : n + 1] == pytest.approx(begin + np.array([0.0, 0.1, 0.25, 0.35]))
    assert record["j"][first:n].tolist() == [-40.0, 0.0, 40.0]
    for name in ("s", "v", "a", "j", "t"):
        assert (record[name][:first] == before[name][:first]).all()
    # by hand: 1 - 40/2 · 0.01 = 0.8 at s̈ = -4, down to 0.2, and the same to rest
    assert record["v"][first:n] == pytest.approx([1.0, 0.8, 0.2])
    assert record["a"][first:n] == pytest.approx([0.0, -4.0, -4.0])
    far = np.cumsum([0.1 - 40 / 6 * 1e-3, 0.15 * 0.8 - 2 * 0.15**2, 40 / 6 * 1e-3])
    assert record["s"][first:n] == pytest.approx([0.5, *(0.5 + far[:2])])
    assert (record["s_end"], record["v_end"]) == (pytest.approx(0.5 + far[2]), 0.0)
    assert path_state(path, n - 1, record["t"][n]) == (record["s_end"], 0.0, 0.0, 40.0)


def test_the_last_segment_meets_its_target_and_still_fits_to_the_one_before():
    for off in (-3e-10, 3e-10):
        path = np.zeros(1, PATH)
        found, record = accept(STOP, v=1.0 + off, path=path)
        assert found is Acceptance.ACCEPTED
        assert path_state(path, 2, record["t"][3])[1:3] == (0.0, 0.0)
        joint = float(record["t"][2])
        assert path_state(path, 2, joint) == pytest.approx((*path_state(path, 1, joint)[:3], 40.0), abs=1e-9)
        # forwards from its begin, as cut_path leaves it, it is the same motion
        ahead = [path_state(path, 2, float(tau)) for tau in np.linspace(joint, record["t"][3], 9)]
        record["anchored"] = -1
        again = [path_state(path, 2, float(tau)) for tau in np.linspace(joint, record["t"][3], 9)]
        assert np.allclose(ahead, again, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"s_max": 0.674}, Acceptance.BEYOND_PATH),
        ({"s_max": 0.676}, Acceptance.ACCEPTED),
        ({"a_limit": 4.0}, Acceptance.ACCEPTED),
        ({"a_limit": 3.999999}, Acceptance.PATH_ACCELERATION),
        ({"a_limit": 0.0}, Acceptance.BAD_LIMIT),
        ({"a_limit": -5.0}, Acceptance.BAD_LIMIT),
        ({"a_limit": math.inf}, Acceptance.BAD_LIMIT),
        ({"j_limit": 40.0 * (1.0 - 5e-10)}, Acceptance.ACCEPTED),
        ({"j_limit": 40.0 * (1.0 - 2e-9)}, Acceptance.BAD_LIMIT),
        ({"j_limit": 0.0}, Acceptance.BAD_LIMIT),
        ({"j_limit": -40.0}, Acceptance.BAD_LIMIT),
        ({"j_limit": math.inf}, Acceptance.BAD_LIMIT),
        ({"pairs": ((-1e-9, 1.0), *STOP)}, Acceptance.BAD_LIMIT),
        ({"v": 1.0 + 0.9e-9}, Acceptance.ACCEPTED),
        ({"v": 1.0 + 1.1e-9}, Acceptance.NOT_AT_TARGET),
        ({"v": 1.0 - 0.9e-9}, Acceptance.ACCEPTED),
        ({"v": 1.0 - 1.1e-9}, Acceptance.NOT_AT_TARGET),
        ({"target": 1.5, "v": 2.5 + 2.3e-9}, Acceptance.ACCEPTED),
        ({"target": 1.5, "v": 2.5 + 2.7e-9}, Acceptance.NOT_AT_TARGET),
    ],
)
def test_a_plain_stop_at_the_borders_of_acceptance(changes, verdict):
    assert accept(**({"pairs": STOP} | changes))[0] is verdict


@pytest.mark.parametrize("first", [STOP[0], (0.0, 0.0)])
def test_where_it_ends_counts_from_both_sides(first):
    """The anchor moves the end by as much as the rounded target: neither end may lie beyond the path."""
    steady = ((0.5, 0.0),)
    found, record = accept(steady, v=1.0, target=1.0)
    assert found is Acceptance.ACCEPTED and record["s_end"] == 1.0
    # 0.5 s at 1 + 4e-10 end 2e-10 after 1, at the target exactly at 1; and the other way round
    assert accept(steady, v=1.0 + 4e-10, target=1.0, s_max=1.0)[0] is Acceptance.BEYOND_PATH
    assert accept(steady, v=1.0 - 4e-10, target=1.0, s_max=1.0 - 1e-10)[0] is Acceptance.BEYOND_PATH
    assert accept(steady, v=1.0, target=1.0, s_max=1.0)[0] is Acceptance.ACCEPTED


@pytest.mark.parametrize(
    ("a", "verdict"),
    [
        (5.0, Acceptance.ACCEPTED),
        (5.0 * (1.0 + 5e-10), Acceptance.ACCEPTED),
        (5.0 * (1.0 + 2e-9), Acceptance.PATH_ACCELERATION),
        (6.0, Acceptance.PATH_ACCELERATION),
        (-6.0, Acceptance.PATH_ACCELERATION),
    ],
)
def test_the_first_acceleration_counts(a, verdict):
    """Also where there is no segment at all that has it."""
    d = abs(a) / 40.0
    v = 1.0 if a > 0.0 else 2.0
    pairs = ((d, -math.copysign(40.0, a)),)
    end = v + 0.5 * a * d
    assert accept(pairs, v=v, a=a, target=end)[0] is verdict


@pytest.mark.parametrize(
    ("left", "verdict"), [(4.9e-9, True), (5.1e-9, False), (-4.9e-9, True), (-5.1e-9, False)]
)
def test_an_acceleration_that_is_left_at_the_end_is_small(left, verdict):
    """Relative to the limit of 5."""
    assert (accept(((0.1, 0.0),), a=left, target=1.0 + 0.1 * left)[0] is Acceptance.ACCEPTED) is verdict
    tiny = left / 5.0
    found = accept(((0.1, 0.0),), a=tiny, target=1.0 + 0.1 * tiny, a_limit=0.2)[0]
    assert (found is Acceptance.ACCEPTED) is verdict


def test_a_speed_may_rise_by_what_the_first_acceleration_forces_on_it():
    """And by no more: 4²/(2·40) = 0.2 above the begin, before it falls."""
    rise = ((0.1, -40.0), *STOP)
    assert accept(rise, v=0.8, a=4.0)[0] is Acceptance.ACCEPTED
    # half the jerk lets it rise by twice as much, which a limit of 40 does not make necessary
    slowly = ((0.2, -20.0), *STOP)
    assert accept(slowly, v=0.6, a=4.0)[0] is Acceptance.SPEED_OVERSHOOT
    assert accept(slowly, v=0.6, a=4.0, j_limit=41.0)[0] is Acceptance.SPEED_OVERSHOOT
    # a negative one forces none: it may not rise at all
    assert accept(((0.05, 40.0), (0.1, 40.0), (0.1, -40.0), *STOP), v=0.65, a=-2.0)[0] is (
        Acceptance.SPEED_OVERSHOOT
    )
    # towards a larger target it may rise up to that
    up = tuple((d, -j) for d, j in STOP)
    assert accept(up, v=0.5, target=1.5)[0] is Acceptance.ACCEPTED
    over = (*up, (0.05, 0.0), *STOP[:1], STOP[2])
    assert accept(over, v=0.5, target=1.1)[0] is Acceptance.SPEED_OVERSHOOT


def test_a_speed_within_a_segment_counts():
    """It dips below 0 between the ends of a segment, where both ends are above."""
    # from 0.1 with s̈ = -4 and jerk 40: lowest at 0.1 s, 0.1 - 0.4 + 0.2 = -0.1
    assert accept(((0.2, 40.0), (0.1, -40.0)), v=0.1, a=-4.0, target=0.3)[0] is Acceptance.NEGATIVE_SPEED
    assert accept(((0.2, 40.0), (0.1, -40.0)), v=0.3, a=-4.0, target=0.5)[0] is Acceptance.ACCEPTED
    # and rises above what is allowed between them: highest at 0.1 s
    pairs = ((0.05, 40.0), (0.1, -40.0), (0.05, 40.0))
    assert accept(pairs, v=0.5, target=0.5)[0] is Acceptance.SPEED_OVERSHOOT


@pytest.mark.parametrize(("segments", "verdict"), [(20, Acceptance.ACCEPTED), (21, Acceptance.NOT_AT_TARGET)])
@pytest.mark.parametrize("first", [0, 4])
def test_as_many_segments_as_there_is_room_for(segments, verdict, first, rng):
    assert MAX_SEGMENTS == 20
    pairs = [(0.01, 0.0)] * (segments - first)
    path = any_path(rng, first)
    assert accept(pairs, target=1.0, first=first, path=path)[0] is verdict
    # what has no duration takes no room
    assert accept([*pairs, (0.0, 0.0)], target=1.0, first=first, path=path)[0] is verdict


def test_without_a_segment_there_is_nothing_but_where_it_begins():
    found, record = accept(((0.0, 1.0), (0.5 * TINY, 2.0), (TINY, 3.0)), target=1.0)
    assert (found, record["n"], record["s_end"], record["v_end"]) == (Acceptance.ACCEPTED, 0, 0.5, 1.0)
    assert record["anchored"] == -1
    assert accept(((0.0, 1.0),), target=1.0, s_max=0.4)[0] is Acceptance.BEYOND_PATH
    found, record = accept(((1.1 * TINY, 3.0),), target=1.0)
    assert (found, record["n"]) == (Acceptance.ACCEPTED, 1)


@pytest.mark.parametrize("anchored", [-1, 2])
def test_the_range_of_a_speed_is_that_of_its_samples(anchored, rng, count):
    for _ in range(count(5_000)):
        path = any_path(rng, 3, anchored)
        k = int(rng.integers(0, 3))
        t0, t1 = np.sort(rng.uniform(*path[0]["t"][k : k + 2], 2)).tolist()
        path[0]["a"][k] = -path[0]["j"][k] * rng.uniform(-0.2, 1.2)  # mostly it turns within the segment
        low, high = path_kernels.speed_range(path, k, t0, t1)
        speeds = [path_state(path, k, float(tau))[1] for tau in np.linspace(t0, t1, 60)]
        assert low <= min(speeds) + 1e-12 and high >= max(speeds) - 1e-12
        near = abs(path[0]["j"][k]) * ((t1 - t0) / 59.0) ** 2
        assert low >= min(speeds) - near - 1e-12 and high <= max(speeds) + near + 1e-12


def test_the_range_of_a_speed_keeps_nan():
    path = np.zeros(1, PATH)
    begin_path(path, 0.0, 1.0, 0.0, 1.0)
    for tau in ((NAN, 0.5), (0.2, NAN)):
        assert np.isnan(path_kernels.speed_range(path, 0, *tau)).all()


def test_integrated_anew_a_profile_is_the_same(rng, count):
    """Segments of random profiles, from their first state on, by other means."""
    for _ in range(count(500)):
        d = rng.uniform(0.01, 0.1, 3)
        peak = -rng.uniform(0.5, 4.0)
        pairs = ((d[0], peak / d[0]), (d[1], 0.0), (d[2], -peak / d[2]))
        v = -peak * (d[0] / 2 + d[1] + d[2] / 2)
        path = np.zeros(1, PATH)
        found, record = accept(pairs, v=v, j_limit=1e3, path=path)
        assert found is Acceptance.ACCEPTED
        for k in range(3):
            for tau in np.linspace(*record["t"][k : k + 2], 5)[1:-1].tolist():
                expected = [float(each[0]) for each in path_of(record, np.array([tau]))]
                assert path_state(path, k, tau) == pytest.approx(expected, abs=1e-11)
