"""Braking as it was measured: what follows from the bound of the speed, against integration and by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.braking import Braking
from robots.errors import SetupError

ONE = np.array([1.0])


def random_braking(rng: np.random.Generator, n: int) -> Braking:
    fastest = rng.uniform(0.5, 3.0, n)
    return Braking(
        float(rng.choice([0.0, rng.uniform(0.0, 0.3)])),
        float(rng.choice([0.0, rng.uniform(0.0, 0.5)])),
        rng.uniform(1.0, 20.0, n),
        fastest,
    )


def test_way_and_time_are_what_the_speed_adds_up_to(rng, count):
    for _ in range(count(1_000)):
        braking = random_braking(rng, 4)
        speed = braking.fastest * rng.uniform(0.0, 1.0, 4)
        end = float(braking.time(speed).max())
        x = np.linspace(0.0, end, 4001)
        v = np.array([braking.speed(speed, float(each)) for each in x])
        assert (np.diff(v, axis=0) <= 1e-12).all() and (v >= 0.0).all()
        way = np.trapezoid(v, x, axis=0)
        assert way == pytest.approx(braking.way(speed), abs=1e-5 + 1e-3 * end / 4)
        assert v[-1] == pytest.approx(np.zeros(4), abs=1e-9)
        early = 0.9 * braking.time(speed)
        for j in np.flatnonzero((speed > 0.01) & (braking.brakes_for(speed) > 1e-3)):
            assert braking.speed(speed, float(early[j]))[j] > 0.0


def test_by_hand():
    braking = Braking(0.1, 0.5, np.array([2.0, 2.0]), np.array([9.0, 9.0]))
    speed = np.array([0.5, 2.0])  # the slow one takes the braking time, the fast one its deceleration
    assert braking.time(speed) == pytest.approx([0.6, 1.1])
    assert braking.way(speed) == pytest.approx([0.05 + 0.125, 0.2 + 1.0])
    assert braking.speed(speed, 0.1) == pytest.approx(speed)
    assert braking.speed(speed, 0.35) == pytest.approx([0.25, 1.5])
    assert not braking.speed(np.zeros(2), 0.2).any()
    slower = braking.slower(0.5)
    assert slower.time(speed) == pytest.approx(1.5 * braking.time(speed))
    assert slower.way(speed) == pytest.approx(1.5 * braking.way(speed))
    at_once = Braking(0.0, 0.0, ONE, ONE)
    assert not at_once.speed(np.zeros(1), 0.1).any()


@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf, 11.0])
def test_times_that_cannot_be_used(bad):
    for given in ((bad, 0.1), (0.1, bad)):
        with pytest.raises(SetupError, match="braking"):
            Braking(*given, ONE, ONE)
    with pytest.raises(SetupError, match="margin"):
        Braking(0.1, 0.1, ONE, ONE).slower(bad)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_numbers_of_joints_that_cannot_be_used(bad):
    wrong = np.array([1.0, bad])
    with pytest.raises(SetupError, match="deceleration"):
        Braking(0.1, 0.1, wrong, np.ones(2))
    with pytest.raises(SetupError, match="fastest"):
        Braking(0.1, 0.1, np.ones(2), wrong)
    with pytest.raises(SetupError, match="1 decelerations and 2 speeds"):
        Braking(0.1, 0.1, ONE, np.ones(2))
