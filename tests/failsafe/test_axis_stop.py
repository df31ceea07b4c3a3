"""The closed-form stop of one axis: ruckig, integration step by step, and every admitted state."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.axis_stop import (
    AxisLimits,
    Start,
    fastest_during,
    motion_during,
    stop_axis,
    worst_angle,
    worst_time,
)
from failsafe.manoeuvre import VelocityProfile
from robots.errors import SetupError


def random_limits(rng: np.random.Generator) -> AxisLimits:
    return AxisLimits(*(10.0 ** rng.uniform((-1.0, -0.5, 0.5), (1.0, 1.5, 4.0))).tolist())


def random_state(rng: np.random.Generator, limits: AxisLimits) -> tuple[float, float]:
    """Speed and acceleration within the limits, now and after the acceleration has been released."""
    # more than 2 √(V J) ends beyond V from -V already: most draws of a large limit would be refused
    largest = min(limits.acceleration, 2.0 * math.sqrt(limits.velocity * limits.jerk))
    while True:
        a = float(rng.choice([0.0, -1.0, 1.0, rng.uniform(-1.0, 1.0)])) * largest
        v = float(rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)])) * limits.velocity
        if rng.random() < 0.3:
            v = math.copysign(limits.velocity, a) - a * abs(a) / (2.0 * limits.jerk)
        after = v + a * abs(a) / (2.0 * limits.jerk)
        if abs(v) <= limits.velocity and abs(after) <= limits.velocity * (1.0 + 1e-12):
            return v, a


def integrated(v: float, a: float, durations, jerks) -> tuple[float, float, float, float]:
    """Time, displacement, speed and acceleration at the end of segments of constant jerk."""
    t, x = 0.0, 0.0
    for d, j in zip(durations, jerks, strict=True):
        t, x, v, a = t + d, x + v * d + a * d**2 / 2 + j * d**3 / 6, v + a * d + j * d**2 / 2, a + j * d
    return t, x, v, a


def test_analytic_solutions():
    """Worked by hand: with and without hold, with acceleration, and where the acceleration alone is left."""
    # V = 1, A = 2, J = 4: build-up and release 0.5 s each take 1 m/s: no hold
    stop = stop_axis(1.0, 0.0, AxisLimits(1.0, 2.0, 4.0))
    assert stop.durations == pytest.approx((0.5, 0.0, 0.5), abs=1e-12)
    assert (stop.time, stop.angle) == pytest.approx((1.0, 0.5), abs=1e-9)
    # V = 3: 2/2 s of hold more; the profile is symmetric, so the angle is V T / 2
    stop = stop_axis(3.0, 0.0, AxisLimits(3.0, 2.0, 4.0))
    assert (stop.time, stop.angle) == pytest.approx((2.0, 3.0), abs=1e-9)
    # accelerating with 2 at 0.5: the release takes 0.5 s and ends at 1.0 after 0.5·0.5 + 0.25 - 4/6·0.125
    stop = stop_axis(0.5, 2.0, AxisLimits(1.0, 2.0, 4.0))
    assert (stop.time, stop.angle) == pytest.approx((1.5, 0.25 + 0.25 - 1.0 / 12.0 + 0.5), abs=1e-9)
    # decelerating so that the release alone ends at rest: v = a²/(2J)
    stop = stop_axis(0.5, -2.0, AxisLimits(1.0, 2.0, 4.0))
    assert (stop.time, stop.angle) == pytest.approx((0.5, 0.25 - 0.25 + 1.0 / 12.0), abs=1e-9)
    # driving backwards with too much acceleration forwards: -0.25 and 2 ends at +0.25, so it turns round
    stop = stop_axis(-0.25, 2.0, AxisLimits(1.0, 2.0, 4.0))
    assert stop.lowest < 0.0 < stop.highest == pytest.approx(stop.angle)
    # it turns where 0.25 - 2 x + 2 x² is 0; the mirrored stop turns at the same time
    x = (2.0 - math.sqrt(2.0)) / 4.0
    back = -0.25 * x + x**2 - 4.0 / 6.0 * x**3
    mirrored = stop_axis(0.25, -2.0, AxisLimits(1.0, 2.0, 4.0))
    assert (stop.lowest, mirrored.highest) == pytest.approx((back, -back), abs=1e-12)


def test_ruckig_and_integration_agree(rng, count):
    profile = VelocityProfile()
    for _ in range(count(200_000)):
        limits = random_limits(rng)
        v, a = random_state(rng, limits)
        sign = 1.0 if rng.random() < 0.5 else -1.0
        v, a = sign * v, sign * a
        stop = stop_axis(v, a, limits)
        t, x, end, rest = integrated(v, a, stop.durations, stop.jerks)
        scale = max(1.0, limits.velocity)
        assert abs(end) <= 1e-9 * scale and abs(rest) <= 1e-9 * max(1.0, limits.acceleration)
        assert stop.time == pytest.approx(t, rel=1e-9, abs=1e-9)
        assert stop.angle == pytest.approx(x, rel=1e-9, abs=1e-9)
        assert profile.calculate(v, a, 0.0, limits.acceleration, limits.jerk)
        t, x, *_ = integrated(v, a, profile.durations, profile.jerks)
        assert stop.time == pytest.approx(t, rel=1e-9, abs=1e-9)
        assert stop.angle == pytest.approx(x, rel=1e-9, abs=1e-9)


def test_no_admitted_state_is_worse_and_one_is_as_bad(rng, count):
    for _ in range(count(3_000)):
        limits = random_limits(rng)
        for start in Start:
            times, angles = worst_time(limits, start), worst_angle(limits, start)
            for worst, key in ((times, "time"), (angles, "angle")):
                reached = stop_axis(worst.velocity, worst.acceleration, limits)
                assert getattr(reached, key) == pytest.approx(worst.value, rel=1e-9)
            longest = largest = 0.0
            t = np.linspace(0.0, times.value * 1.1, 60)
            envelope = fastest_during(limits, start, t)
            assert (np.diff(envelope) <= 1e-12).all()
            for _ in range(40):
                v, a = random_state(rng, limits)
                if start is Start.STEADY:
                    a = 0.0
                stop = stop_axis(v, a, limits)
                longest = max(longest, stop.time)
                largest = max(largest, -stop.lowest, stop.highest)
                excess = np.abs(motion_during(stop, v, a, t)[1]) - envelope
                assert excess.max() <= 1e-9 * limits.velocity
            assert longest <= times.value * (1.0 + 1e-9)
            assert largest <= angles.value * (1.0 + 1e-9)
            assert longest > 0.5 * times.value, "vacuous"


def test_extremes_on_the_way(rng, count):
    for _ in range(count(5_000)):
        limits = random_limits(rng)
        v, a = random_state(rng, limits)
        stop = stop_axis(v, a, limits)
        t = np.linspace(0.0, stop.time, 2_001)
        exact, speed = motion_during(stop, v, a, t)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
        near = 1e-5 * max(1.0, limits.velocity * stop.time)
        assert abs(way.min() - stop.lowest) <= near and abs(way.max() - stop.highest) <= near
        assert abs(exact[-1] - stop.angle) <= 1e-9 * max(1.0, abs(stop.angle))
        assert np.abs(way - exact).max() <= near


@pytest.mark.parametrize(
    ("state", "limits", "said"),
    [
        ((1.0, 0.0), (1.0, 0.0, 1.0), "acceleration limit 0 must be finite and above zero"),
        ((1.0, 0.0), (1.0, 1.0, math.nan), "jerk limit nan"),
        ((1.0, 0.0), (math.inf, 1.0, 1.0), "velocity limit inf"),
        ((math.nan, 0.0), (1.0, 1.0, 1.0), "speed nan must be finite"),
        ((1.0, 1.5), (1.0, 1.0, 1.0), "acceleration 1.5 must be within its limit 1"),
        ((1.0, math.nan), (1.0, 1.0, 1.0), "acceleration nan must be within"),
    ],
)
def test_what_cannot_be_stopped_is_refused_in_one_line(state, limits, said):
    with pytest.raises(SetupError, match=said) as caught:
        stop_axis(*state, AxisLimits(*limits))
    assert "\n" not in str(caught.value)
