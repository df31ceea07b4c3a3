"""Motion along lines and corners: on the path, within the limits, from rest to rest, as fast as it may."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.motion import RoundedPath, motion_along
from modes.planning.timing import in_time
from robots.limits import JointLimits
from robots.model import RobotModel

Array = NDArray[np.float64]


@pytest.fixture
def limits(arm: Callable[[str], RobotModel]) -> JointLimits:
    return arm("panda").limits


def drawn_path(rng: np.random.Generator, n: int, rounding: float) -> RoundedPath:
    points = np.cumsum(rng.uniform(-1.0, 1.0, (int(rng.integers(2, 7)), n)), axis=0)
    return RoundedPath(points, rounding)


def sampled(motion: IntendedTrajectory, per_piece: int = 40) -> tuple[Array, ...]:
    places = np.concatenate(
        [np.linspace(a, b, per_piece) for a, b in itertools.pairwise(motion.breaks.tolist())]
    )
    return motion.sample(places)


def used(motion: IntendedTrajectory, limits: JointLimits) -> Array:
    """Largest shares of the limits of velocity, acceleration and jerk."""
    _q, dq, ddq, dddq = sampled(motion)
    pairs = ((dq, limits.velocity), (ddq, limits.acceleration), (dddq, limits.jerk))
    return np.array([float((np.abs(x) / limit).max()) for x, limit in pairs])


def test_motion_keeps_the_limits_and_lies_on_the_path(
    limits: JointLimits, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(400)):
        path = drawn_path(rng, 7, float(rng.uniform(0.01, 0.5)))
        motion = in_time(path.breaks, path.coefficients, limits)
        assert (used(motion, limits) <= 1.0 + 1e-9).all()
        q, dq, ddq, _dddq = motion.sample([0.0, motion.s_end])
        assert np.allclose(q[0], path.at(0.0)[0]) and np.allclose(q[1], path.at(path.length)[0])
        assert np.allclose(dq, 0.0, atol=1e-9) and np.allclose(ddq, 0.0, atol=1e-7)
        on_path = np.array([path.at(s)[0] for s in np.linspace(0.0, path.length, 3000)])
        for each in sampled(motion, 5)[0][::7]:
            away = np.linalg.norm(on_path - each, axis=1).min()
            assert away < path.length / 3000


def test_a_single_line_takes_what_the_closed_form_says(limits: JointLimits) -> None:
    """From rest to rest with a trapezoid of acceleration: v/a + a/j + L/v where all of it is reached."""
    far = np.zeros(7)
    far[0] = 2.5
    path = RoundedPath(np.array([np.zeros(7), far]), 0.3)
    motion = in_time(path.breaks, path.coefficients, limits)
    v, a, j = limits.velocity[0], limits.acceleration[0], limits.jerk[0]
    assert v * (v / a + a / j) < 2.5
    assert motion.s_end == pytest.approx(v / a + a / j + 2.5 / v)
    near = RoundedPath(np.array([np.zeros(7), 1e-5 * far]), 0.3)
    brief = in_time(near.breaks, near.coefficients, limits)
    assert brief.s_end == pytest.approx(4.0 * np.cbrt(0.5 * 2.5e-5 / j))


def test_lower_limits_take_longer(limits: JointLimits, rng: np.random.Generator) -> None:
    for _ in range(20):
        path = drawn_path(rng, 7, 0.2)
        quick = in_time(path.breaks, path.coefficients, limits).s_end
        for name in ("velocity", "acceleration", "jerk"):
            lower = replace(limits, **{name: 0.2 * getattr(limits, name)})
            assert in_time(path.breaks, path.coefficients, lower).s_end > quick
        slower = replace(
            limits, velocity=0.5 * limits.velocity, acceleration=0.25 * limits.acceleration,
            jerk=0.125 * limits.jerk,
        )  # fmt: skip
        assert in_time(path.breaks, path.coefficients, slower).s_end == pytest.approx(2.0 * quick)


def test_some_limit_is_used_up_on_every_piece(limits: JointLimits, rng: np.random.Generator) -> None:
    """Nothing is slower than its ramps: on each piece velocity, acceleration or jerk is at its limit."""
    for _ in range(20):
        path = drawn_path(rng, 7, 0.2)
        motion = in_time(path.breaks, path.coefficients, limits)
        largest = used(motion, limits)
        assert largest.max() == pytest.approx(1.0, rel=1e-6)


def test_small_lines_and_roundings_are_no_less_smooth(
    limits: JointLimits, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """The trajectory itself refuses what is not C²: paths that turn back, creep, round little."""
    for number in range(count(4000)):
        k = int(rng.integers(2, 9))
        steps = rng.normal(size=(k, 7)) * 10.0 ** rng.uniform(-8.0, 0.0, (k, 1)) ** (number % 2)
        kind = number % 5
        if kind == 1:
            steps = np.outer(rng.choice([-1.0, 1.0], k) * 10.0 ** rng.uniform(-6.0, 0.0, k), steps[0])
        elif kind == 2:
            steps = np.eye(7)[rng.integers(0, 7, k)] * rng.uniform(0.1, 2.0, (k, 1))
        elif kind == 3:
            steps[1:] = 1e-9 * steps[1:] - steps[:-1]
        points = rng.uniform(-2.0, 2.0, 7) + np.cumsum(np.vstack((np.zeros((1, 7)), steps)), axis=0)
        motion = motion_along(points, limits, float(rng.choice([0.3, 1e-3, 1e-6, 1e-9])))
        assert (used(motion, limits) <= (0.75 + 1e-9, 0.75 + 1e-9, 0.5 + 1e-9)).all()
        assert np.allclose(motion.sample([0.0, motion.s_end])[0], points[[0, -1]], atol=1e-9)
