"""Joint-space stops: states against polynomials, acceptance at its borders, slices that contain all axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from failsafe import axis_kernels
from failsafe.axis_kernels import AXES, append_axis, axes_at, axis_state, write_axes_slices
from failsafe.limit_kernels import WORK
from failsafe.manoeuvre import Quantity
from failsafe.path_kernels import MAX_SEGMENTS
from robots.motion import MAX_SLICES, new_slices

NAN = math.nan
TINY = 1e-12
STOP = ((0.1, -40.0), (0.15, 0.0), (0.1, 40.0))
"""From dq = 1 to rest with ddq down to -4, within 0.175 of q."""


def any_axes(rng: np.random.Generator, segments: list[int]) -> np.ndarray:
    """Segments that do not even fit together, so that one cannot be taken for another."""
    axes = np.zeros(1, AXES)
    record = axes[0]
    record["n"] = len(segments)
    record["t"][:] = 99.0
    for name in ("q", "v", "a", "j"):
        record[name][:] = rng.normal(size=record[name].shape)
    record["q_end"][:] = rng.normal(size=record["q_end"].shape)
    for i, n in enumerate(segments):
        record["segments"][i] = n
        record["t"][: n + 1, i] = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, n))])
    return axes


def segment_of(record: Any, i: int, k: int) -> tuple[Polynomial, float]:
    """q of a segment as a polynomial, and the instant that it is about: the last one ends at rest."""
    jerk = record["j"][k, i] / 6.0
    if k == record["segments"][i] - 1:
        return Polynomial([record["q_end"][i], 0.0, 0.0, jerk]), record["t"][k + 1, i]
    return Polynomial([record["q"][k, i], record["v"][k, i], record["a"][k, i] / 2.0, jerk]), record["t"][
        k, i
    ]


def test_the_state_of_an_axis_is_that_of_its_segment(rng, count):
    for _ in range(count(1_000)):
        axes = any_axes(rng, [3, 1, 0, 4])
        record = axes[0]
        out = np.full((3, 5), 7.0)
        for i, n in enumerate((3, 1, 0, 4)):
            rest = (record["q_end"][i], 0.0, 0.0)
            ends = record["t"][: n + 1, i].tolist()
            for k in range(n):
                polynomial, origin = segment_of(record, i, k)
                for tau in (ends[k], math.nextafter(ends[k + 1], 0.0), float(rng.uniform(*ends[k : k + 2]))):
                    expected = [(polynomial.deriv(d) if d else polynomial)(tau - origin) for d in range(3)]
                    assert axis_state(axes, i, tau) == pytest.approx(expected, rel=1e-13, abs=1e-13)
            for tau in (ends[n] if n else 0.0, 99.5, 1e9):
                assert axis_state(axes, i, tau) == rest
        tau = float(rng.uniform(0.0, 1.0))
        axes_at(axes, 4, tau, out)
        assert all(tuple(out[:, i]) == axis_state(axes, i, tau) for i in range(4))
        assert (out[:, 4] == 7.0).all()


@pytest.mark.parametrize("last", [False, True])
def test_the_range_of_an_axis_is_that_of_its_samples(last, rng, count):
    """Positions, also where dq changes its sign once or twice within; velocity; acceleration."""
    turns = 0
    for _ in range(count(10_000)):
        axes = any_axes(rng, [1 if last else 2])
        record = axes[0]
        if not last:  # mostly with a place of its own at which dq is 0, or two
            x = rng.uniform(-0.2, 1.2, 2)
            j = rng.choice([rng.normal(), 0.0], p=[0.9, 0.1])
            record["j"][0, 0], record["a"][0, 0] = j, -j * x.sum() / 2.0
            record["v"][0, 0] = j * x.prod() / 2.0 if j else rng.normal()
            if j == 0.0:
                record["a"][0, 0] = rng.choice([0.0, rng.normal()])
        t0, t1 = np.sort(rng.uniform(0.0, record["t"][1, 0], 2)).tolist()
        if rng.random() < 0.2:
            t0 = 0.0
        low, high, v_max, a_max = axis_kernels._axis_range(axes, 0, 0, t0, t1)
        states = np.array([axis_kernels._axis_at(axes, 0, 0, float(x)) for x in np.linspace(t0, t1, 80)])
        q, v, a = states.T
        near = np.abs(a).max() * ((t1 - t0) / 79.0) ** 2 + 1e-12
        bend = abs(float(record["j"][0, 0])) * ((t1 - t0) / 79.0) ** 2 + 1e-12
        assert low < q.min() and high > q.max(), "roundings are on the outer side"
        assert low >= q.min() - near and high <= q.max() + near
        assert np.abs(v).max() < v_max <= np.abs(v).max() + bend
        assert a_max == pytest.approx(np.abs(a).max(), rel=1e-12)
        turns += int((np.diff(np.sign(v)) != 0).sum() == 2)
    assert turns > 0 or last or count(10_000) < 100


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [0.0, 1e-300, 1e-18, -1e-18])
def test_a_turn_is_found_where_the_axis_begins_without_speed(speed, sign):
    """dq = -a x + j x²/2 is 0 again at x = 2 a / j, where q has changed by -2/3 a³/j²: nothing cancels."""
    a, j = 0.5, 40.0
    axes = any_axes(np.random.default_rng(0), [2])
    record = axes[0]
    record["t"][:2, 0] = 0.0, 0.1
    for name, value in (("q", 0.0), ("v", speed), ("a", -a), ("j", j)):
        record[name][0, 0] = sign * value
    low, high, _, _ = axis_kernels._axis_range(axes, 0, 0, 0.0, 0.1)
    farthest, end = sign * -2.0 / 3.0 * a**3 / j**2, sign * (j * 0.1**3 / 6.0 - a * 0.1**2 / 2.0)
    assert (low, high) == pytest.approx((min(farthest, end), max(farthest, end)), rel=1e-9)


# Acceptance at its borders


def limits_of(v: float, a: float, j: float, lower: float, upper: float, n: int = 1) -> np.ndarray:
    return np.repeat(np.array([[lower], [upper], [v], [a], [j]]), n, axis=1)


def accept(pairs, start=(0.5, 1.0, 0.0), *, limits=(2.0, 5.0, 40.0, -3.0, 3.0), positions=True, i=1):
    axes, work = np.zeros(1, AXES), np.zeros(1, WORK)
    axes[0]["t"][:] = 99.0
    durations, jerks = (np.array(each, dtype=float) for each in zip(*pairs, strict=True))
    rows = limits_of(1e-3, 1e-3, 1e-3, 9.0, -9.0, 3)  # what no other axis would keep
    rows[:, i] = limits_of(*limits)[:, 0]
    found = append_axis(axes, i, np.array(start), durations, jerks, rows, positions, work)
    record = work[0]
    witness = (int(record["joint"]), Quantity(int(record["quantity"])), record["value"], record["limit"])
    return found, witness, axes


def test_a_stop_of_one_axis_by_hand():
    found, _, axes = accept(((0.0, 9.0), STOP[0], (0.9 * TINY, 3.0), *STOP[1:]))
    assert found
    record = axes[0]
    assert record["segments"].tolist() == [0, 3, *[0] * (len(record["segments"]) - 2)]
    assert record["t"][:4, 1] == pytest.approx([0.0, 0.1, 0.25, 0.35])
    assert record["j"][:3, 1].tolist() == [-40.0, 0.0, 40.0]
    assert record["v"][:3, 1] == pytest.approx([1.0, 0.8, 0.2])
    assert record["a"][:3, 1] == pytest.approx([0.0, -4.0, -4.0])
    far = np.cumsum([0.1 - 40 / 6 * 1e-3, 0.15 * 0.8 - 2 * 0.15**2, 40 / 6 * 1e-3])
    assert record["q"][:3, 1] == pytest.approx([0.5, *(0.5 + far[:2])])
    assert record["q_end"][1] == pytest.approx(0.675)
    for joint in (0.1, 0.25):
        before = axis_state(axes, 1, math.nextafter(joint, 0.0))
        assert axis_state(axes, 1, math.nextafter(joint, 1.0)) == pytest.approx(before, abs=1e-9)
    assert axis_state(axes, 1, 0.35) == (record["q_end"][1], 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "quantity", "value", "limit"),
    [
        ({"limits": (2.0, 5.0, 39.9, -3.0, 3.0)}, Quantity.JERK, -40.0, 39.9),
        ({"limits": (2.0, 3.9, 40.0, -3.0, 3.0)}, Quantity.ACCELERATION, 4.0, 3.9),
        ({"limits": (0.9, 5.0, 40.0, -3.0, 3.0)}, Quantity.VELOCITY, 1.0, 0.9),
        ({"limits": (2.0, 5.0, 40.0, -3.0, 0.67)}, Quantity.POSITION, 0.675, 0.67),
        ({"limits": (2.0, 5.0, 40.0, 0.51, 3.0)}, Quantity.POSITION, 0.5, 0.51),
        ({"start": (0.5, 1.01, 0.0)}, Quantity.VELOCITY, 0.01, 0.0),
        ({"start": (0.5, 0.99, 0.0)}, Quantity.VELOCITY, -0.01, 0.0),
        ({"start": (0.5, 1.0 - 0.35 * 0.01, 0.01)}, Quantity.ACCELERATION, 0.01, 0.0),
        ({"start": (0.5, 1.0 + 0.35 * 0.01, -0.01)}, Quantity.ACCELERATION, -0.01, 0.0),
        ({"pairs": ((-1e-9, 1.0), *STOP)}, Quantity.JERK, 1.0, 40.0),
        ({"pairs": ((NAN, 1.0), *STOP)}, Quantity.JERK, 1.0, 40.0),
    ],
)
def test_what_a_stop_fails_on_is_told(changes, quantity, value, limit):
    for i in (0, 2):
        found, witness, _ = accept(**({"pairs": STOP} | changes), i=i)
        assert not found
        assert witness[:2] == (i, quantity) and witness[2:] == (pytest.approx(value, abs=1e-8), limit)
    free = accept(**({"pairs": STOP} | changes), positions=False)[0]
    assert free is (quantity is Quantity.POSITION)


def mirrored(pairs):
    return tuple((d, -j) for d, j in pairs)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("limits", "off", "accepted"),
    [
        ((1.0, 4.0, 40.0), 0.0, True),
        ((1.0 - 2e-9, 4.0, 40.0), 0.0, False),
        ((1.0, 4.0 - 8e-9, 40.0), 0.0, False),
        ((1.0, 4.0, 40.0 - 8e-8), 0.0, False),
        ((1.0, 4.0, 40.0), 0.9e-9, True),
        ((1.0, 4.0, 40.0), 1.1e-9, False),
        ((1.0, 4.0, 40.0), -0.9e-9, True),
        ((1.0, 4.0, 40.0), -1.1e-9, False),
        ((3.0, 4.0, 40.0), 2.9e-9, True),
        ((3.0, 4.0, 40.0), 3.1e-9, False),
    ],
)
def test_limits_may_be_touched_and_rest_is_rest(limits, off, accepted, sign):
    pairs = STOP if sign > 0.0 else mirrored(STOP)
    room = (-0.7, -0.49) if sign < 0.0 else (0.49, 0.7)
    start = (sign * 0.5, sign * (1.0 + off), 0.0)
    assert accept(pairs, start, limits=(*limits, *room))[0] is accepted


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("left", "accepted"), [(4.9e-9, True), (5e-9, True), (5.1e-9, False)])
def test_what_is_left_at_the_end_is_small(left, accepted, sign):
    """Relative to the limit of 5, or to 1."""
    wait = ((1e-3, 0.0),)
    assert accept(wait, (0.5, 0.0, sign * left))[0] is accepted
    assert accept(wait, (0.5, sign * left, 0.0), limits=(5.0, 5.0, 40.0, -3.0, 3.0))[0] is accepted
    tiny = sign * left / 5.0
    assert accept(wait, (0.5, 0.0, tiny), limits=(2.0, 0.5, 40.0, -3.0, 3.0))[0] is accepted
    assert accept(wait, (0.5, tiny, 0.0), limits=(0.5, 5.0, 40.0, -3.0, 3.0))[0] is accepted


def test_a_stop_begins_where_the_joint_is():
    """Also one of a single segment, whose dq would not quite end at 0."""
    for off in (-1.9e-9, 1.9e-9):
        found, _, axes = accept(((0.1, 40.0),), (0.7, 0.2 + off, -4.0))
        assert found and axis_state(axes, 1, 0.0)[0] == pytest.approx(0.7, abs=1e-14)
        assert axes[0]["q_end"][1] == pytest.approx(0.7 + 0.2 / 30.0, abs=1e-14)


def test_the_limits_of_a_position_hold_within_segments_and_at_their_ends():
    """Moves on for a while although its acceleration is against it: 0.2 at -4, highest 0.005 above."""
    pairs = ((0.1, 40.0),)
    start = (0.0, 0.2, -4.0)
    assert accept(pairs, start, limits=(2.0, 5.0, 40.0, -1.0, 1.0))[0]
    # v²/… by hand: dq = 20 (0.1 - x)² never changes its sign, it ends at 0.2/30
    assert accept(pairs, start, limits=(2.0, 5.0, 40.0, -1.0, 0.0067))[0]
    assert not accept(pairs, start, limits=(2.0, 5.0, 40.0, -1.0, 0.0066))[0]
    assert not accept(pairs, start, limits=(2.0, 5.0, 40.0, 1e-9, 1.0))[0]


def test_more_segments_than_there_is_room_for_do_not_come_to_rest():
    """What has no room is left out, and what is left is held against rest."""
    wait = [(0.01, 0.0)] * (MAX_SEGMENTS - 3)
    assert accept((*STOP[:2], STOP[2], *wait))[0]
    assert not accept((STOP[0], STOP[1], *wait, (0.01, 0.0), STOP[2]))[0]


def test_without_a_segment_an_axis_rests_where_it_is():
    found, _, axes = accept(((0.0, 1.0), (0.5 * TINY, 2.0), (TINY, 3.0)), (0.5, 0.0, 0.0))
    assert found and axes[0]["segments"][1] == 0 and axes[0]["q_end"][1] == 0.5
    assert axis_state(axes, 1, 0.0) == (0.5, 0.0, 0.0)
    assert accept(((1.1 * TINY, 0.0),), (0.5, 0.0, 0.0))[2][0]["segments"][1] == 1


# Slices


def some_stops(rng: np.random.Generator, n: int) -> np.ndarray:
    """Stops of ``n`` axes of different duration, one of them at rest from the begin on."""
    axes, work = np.zeros(1, AXES), np.zeros(1, WORK)
    limits = limits_of(9.0, 50.0, 1e3, -9.0, 9.0, n)
    for i in range(n):
        d = np.zeros(3) if i == 1 else rng.uniform(0.01, 0.1, 3)
        peak = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 4.0)
        jerks = np.array([peak / d[0], 0.0, -peak / d[2]]) if i != 1 else np.zeros(3)
        v = -peak * (d[0] / 2 + d[1] + d[2] / 2) if i != 1 else 0.0
        assert append_axis(axes, i, np.array([rng.normal(), v, 0.0]), d, jerks, limits, True, work)
    return axes


@pytest.mark.parametrize("before", [0, 3, MAX_SLICES - 2])
def test_slices_of_stops_of_several_axes_contain_them_closely(before, rng, count):
    for _ in range(count(1_000)):
        n = 3
        axes, slices = some_stops(rng, n), new_slices()
        record = axes[0]
        end = max(float(record["t"][record["segments"][i], i]) for i in range(n) if record["segments"][i])
        kept = slices[0]
        for name in ("t", "q", "dq", "ddq", "dq_max", "ddq_max"):
            kept[name][:] = 77.0
        kept["n"] = before
        length = float(rng.choice([0.01, end, end / 5.0, 2.0 * end, 1e-3]))
        write_axes_slices(axes, n, 20.0, length, slices)
        rows = int(kept["n"]) - before
        needed = max(1, round(end / length) if length in (end, end / 5.0) else math.ceil(end / length))
        assert rows == min(needed, MAX_SLICES - before)
        nodes = 20.0 + np.linspace(0.0, end, rows + 1)
        assert kept["t"][before : before + rows + 1] == pytest.approx(nodes, abs=1e-12)
        assert kept["t"][before + rows] == 20.0 + end
        for name in ("t", "q", "dq", "ddq", "dq_max", "ddq_max"):
            assert (kept[name][:before] == 77.0).all(), "what there was before stays"
            at_ends = name in ("t", "q", "dq", "ddq")
            assert (kept[name][before + rows + at_ends :] == 77.0).all()
        for row in range(rows + 1):
            tau = end if row == rows else end * row / rows
            for i in range(n):
                found = tuple(kept[name][before + row, i] for name in ("q", "dq", "ddq"))
                assert found == axis_state(axes, i, tau)
        for row in range(rows):
            inner = np.linspace(end * row / rows, end * (row + 1) / rows, 60)
            for i in range(n):
                v, a = np.array([axis_state(axes, i, float(x))[1:] for x in inner]).T
                j = float(np.abs(record["j"][: record["segments"][i], i]).max(initial=0.0))
                step = inner[1] - inner[0]
                for name, values, steep in (("dq_max", v, 4.0), ("ddq_max", a, j)):
                    most, bound = float(np.abs(values).max()), kept[name][before + row, i]
                    assert most <= bound <= most + steep * step + 1e-9


@pytest.mark.parametrize("parts", [2, 4])
def test_bounds_hold_at_both_ends_also_where_segments_do_not_quite_fit(parts, rng, count):
    """The last segment is evaluated from its end, and may begin a rounding beside the one before it."""
    for _ in range(count(5_000)):
        axes, slices = any_axes(rng, [2, 1]), new_slices()
        axes[0]["t"][:3, 0], axes[0]["t"][:2, 1] = (0.0, 0.5, 1.0), (0.0, 0.5)
        write_axes_slices(axes, 2, 0.0, 1.0 / parts, slices)
        record = slices[0]
        assert record["n"] == parts
        for name in ("dq", "ddq"):
            ends, bound = np.abs(record[name][: parts + 1, :2]), record[name + "_max"][:parts, :2]
            assert (bound >= ends[:-1]).all() and (bound >= ends[1:]).all()


def test_axes_that_rest_already_make_no_slice_but_an_end(rng):
    axes, slices = np.zeros(1, AXES), new_slices()
    axes[0]["q_end"][:2] = 0.3, -0.2
    slices["n"] = 4
    write_axes_slices(axes, 2, 20.0, 0.01, slices)
    record = slices[0]
    assert (record["n"], record["t"][4]) == (4, 20.0)
    assert record["q"][4, :2].tolist() == [0.3, -0.2]
    assert not record["dq"][4].any() and not record["ddq"][4].any()
