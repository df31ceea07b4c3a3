"""Thresholds, collisions and contacts from currents and forces, and the residual, printed and corrected."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter, lfilter_zi

from modes.contact.detection import (
    TABLE_1,
    BodyDetector,
    CurrentThresholds,
    ForceThresholds,
    Residual,
    ToolDetector,
)
from modes.contact.filters import RATE_HZ, current_high_pass, force_high_pass, force_low_pass
from robots.errors import SetupError

Array = NDArray[np.float64]
STILL = np.zeros(6)


def test_thresholds_are_those_of_table_1() -> None:
    """Facts: joint 1: 0.1 + 0.1 |v| / 200 + 0.2 |a| / 1200, deg/s and deg/s²; LPF 0.1 + 1.6 |v| / 200."""
    dq = np.deg2rad([50.0, -25.0, 40.0, 9.0, 9.0, 9.0])
    ddq = np.deg2rad([-600.0, 105.0, 0.0, 9.0, 9.0, 9.0])
    high = [0.1 + 0.1 * 0.25 + 0.2 * 0.5, 0.18 + 0.35 * 0.2 + 0.2 * 0.1, 0.16 + 0.25 * 0.4]
    low = [0.1 + 1.6 * 0.25, 0.96 + 1.3 * 0.2, 0.99 + 1.3 * 0.4]
    np.testing.assert_allclose(TABLE_1.high(dq, ddq), high)
    np.testing.assert_allclose(TABLE_1.low(dq, ddq), low)


def test_a_fast_change_of_a_current_is_a_collision_and_a_slow_one_is_not() -> None:
    """The same ampere within a step, and over two seconds."""
    for rise_s, wanted in ((0.0, True), (2.0, False)):
        detector, hit = BodyDetector(), False
        for k in range(400):
            share = float(k >= 100) if rise_s == 0.0 else min(max((k - 100) / (rise_s * RATE_HZ), 0.0), 1.0)
            found = detector.step(np.array([0.0, 0.3, 0.2 + 0.5 * share, 9.0, 9.0, 9.0]), STILL)
            hit |= found.collision
            assert k < 100 or hit or not wanted
        assert hit == wanted


def test_a_joint_that_is_not_looked_at_raises_nothing() -> None:
    detector = BodyDetector()
    for k in range(100):
        found = detector.step(np.array([0.0, 0.0, 0.0, 9.0 * (k % 2), 0.0, 0.0]), STILL)
        assert not found.collision and not found.lasts


def test_a_contact_that_lasts_is_seen_as_long_as_it_does_and_its_sign_does_not_matter() -> None:
    detector = BodyDetector()
    lasts = []
    for k in range(200):
        i = np.array([-0.5 if 50 <= k < 150 else 0.02, 0.3, 0.3])
        lasts.append(detector.step(i, STILL).lasts)
    assert not any(lasts[:50]) and all(lasts[53:150]) and not any(lasts[153:])


def test_accelerations_are_backward_differences_of_the_commanded_speeds(rng: np.random.Generator) -> None:
    detector, speeds = BodyDetector(), rng.normal(size=(50, 3))
    for k, dq in enumerate(speeds):
        found = detector.step(np.zeros(3), dq)
        ddq = np.zeros(3) if k == 0 else (dq - speeds[k - 1]) * RATE_HZ
        np.testing.assert_allclose(found.high_threshold, TABLE_1.high(dq, ddq))
        np.testing.assert_allclose(found.low_threshold, TABLE_1.low(dq, ddq))


def test_forces_are_filtered_as_lfilter_does(rng: np.random.Generator) -> None:
    detector, forces = ToolDetector(), 8.0 * rng.normal(size=(200, 3))
    found = [detector.step(each) for each in forces]
    for design, name in ((force_high_pass(), "high_N"), (force_low_pass(), "low_N")):
        state = lfilter_zi(design.b, design.a)[:, None] * forces[0]
        out, _ = lfilter(design.b, design.a, forces, axis=0, zi=state)
        np.testing.assert_allclose([getattr(each, name) for each in found], np.linalg.norm(out, axis=1))
    assert any(each.collision for each in found) and any(each.lasts for each in found)
    for each in found:
        assert each.collision == (each.high_N > 10.0) and each.lasts == (each.low_N > 7.0)


def test_a_soft_push_is_a_contact_and_a_blow_is_a_collision() -> None:
    """12 N over a second; 40 N within a step."""
    soft, hard = ToolDetector(), ToolDetector()
    for k in range(200):
        gentle = soft.step(np.array([0.0, 0.0, 12.0 * min(k / RATE_HZ, 1.0)]))
        assert not gentle.collision
        blow = hard.step(np.array([0.0, 40.0 * (k >= 100), 0.0]))
        assert blow.collision == (k == 100), (k, blow)
    assert gentle.lasts and blow.lasts


GAINS = (100.0, 100.0, 60.0, 40.0, 30.0, 20.0)


def test_the_printed_residual_alarms_of_negative_torques_and_the_corrected_one_does_not(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Nothing but a force at the end effector, whose torque is added to a current that keeps its sign."""
    printed, corrected = Residual(GAINS, variant="as_printed"), Residual(GAINS)
    alarms = 0
    for _ in range(count(10_000)):
        torques = rng.uniform(-30.0, 30.0, 6)
        offset = rng.uniform(2.0, 3.0, 6)
        currents = np.abs(offset + torques / GAINS)
        old, new = (each.of(currents, np.abs(offset), torques) for each in (printed, corrected))
        np.testing.assert_allclose(new, 0.0, atol=1e-9)
        np.testing.assert_allclose(old, np.where(torques < 0.0, 2.0 * np.abs(torques), 0.0), atol=1e-9)
        assert not corrected.alarms(new)
        alarms += printed.alarms(old)
    assert alarms > 0


def test_a_collision_with_the_body_beside_a_guiding_hand_is_seen(rng: np.random.Generator) -> None:
    """30 N m more on a joint than the force at the end effector explains."""
    residual = Residual(GAINS)
    for _ in range(1000):
        torques, offset = rng.uniform(5.0, 10.0, 6), rng.uniform(2.0, 3.0, 6)
        hit = np.zeros(6)
        hit[rng.integers(0, 3)] = 30.0
        r = residual.of(offset + (torques + hit) / GAINS, offset, torques)
        np.testing.assert_allclose(r, hit, atol=1e-9)
        assert residual.alarms(r)


def test_a_current_without_a_sign_hides_a_torque_that_turns_it_round() -> None:
    """Docs: i - i_off is the change only where the true current keeps its sign; -1 A to 1 A is no change."""
    offset = np.full(6, 1.0)
    true_change = 2.0 * np.array(GAINS)
    r = Residual(GAINS).of(np.abs(offset - 2.0), offset, -true_change)
    np.testing.assert_allclose(r, true_change)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: replace(TABLE_1, high_speed=(0.1,)), "high_speed has 1 numbers, high_least has 3"),
        (lambda: replace(TABLE_1, speed=(1.0, 0.0, 1.0)), "speed, joint 2 = 0.0 should be"),
        (lambda: replace(TABLE_1, low_speed=(1.0, -1.0, 1.0)), "low_speed, joint 2 = -1.0"),
        (lambda: replace(TABLE_1, high_least=(0.1, 0.1, math.nan)), "high_least, joint 3 = nan"),
        (lambda: CurrentThresholds(*[()] * 8), "high_least has 0 numbers"),
        (lambda: ForceThresholds(high_N=0.0), "high_N = 0.0 should be a number above 0"),
        (lambda: ForceThresholds(low_N=-1.0), "low_N = -1.0"),
        (
            lambda: Residual(GAINS, variant="other"),
            "variant = 'other' should be one of as_printed, corrected",
        ),
        (lambda: Residual((0.0,)), "gains_Nm_A, joint 1 = 0.0"),
        (lambda: Residual(GAINS, threshold_Nm=math.nan), "threshold_Nm = nan"),
        (lambda: BodyDetector(rate_hz=10.0), "rate_hz = 10.0"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make: Callable[[], object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        make()


def test_the_default_filters_are_the_corrected_ones() -> None:
    detector = BodyDetector()
    detector.step(np.zeros(3), STILL)
    first = detector.step(np.array([1.0, 0.0, 0.0]), STILL).high[0]
    assert first == pytest.approx(current_high_pass("corrected").b[0])
    assert abs(first) != pytest.approx(abs(current_high_pass("as_printed").b[0]), abs=0.1)


@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("kind", ["high", "low"])
def test_every_joint_is_held_against_its_own_threshold(joint: int, kind: str) -> None:
    """Only the threshold of this joint is low: a current above it is told, on this joint alone."""
    for where in range(3):
        own = tuple(0.1 if each == joint else 50.0 for each in range(3))
        detector = BodyDetector(replace(TABLE_1, **{f"{kind}_least": own, _OTHER[kind]: (50.0,) * 3}))
        rest, loud = np.zeros(3), np.zeros(3)
        loud[where] = 2.0
        found = [detector.step(x, np.zeros(3)) for x in (rest, rest, loud, loud, loud)]
        told = any(each.collision if kind == "high" else each.lasts for each in found)
        assert told == (where == joint)


_OTHER = {"high": "low_least", "low": "high_least"}
