"""Predictions against closed forms, and against each other under noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from modes.speed.prediction import ConstantVelocity, Kalman, make_prediction
from robots.errors import SetupError


def moving(t: np.ndarray) -> np.ndarray:
    """Two points on straight lines, (T, 2, 3)."""
    v = np.array([[0.1, 0.0, -1.0], [0.0, 2.0, 0.3]])
    return np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 1.0]]) + t[:, None, None] * v


@pytest.mark.parametrize("name", ["constant_velocity", "kalman"])
def test_who_goes_straight_on_is_foretold(name: str) -> None:
    prediction, t = make_prediction(name, 2), np.arange(20) * 0.1
    for at, xyz in zip(t, moving(t), strict=True):
        prediction.observe(np.full(2, at), xyz)
    ahead = np.array([2.0])
    np.testing.assert_allclose(prediction.at(2.0), moving(ahead)[0], atol=1e-9 if name[0] == "c" else 2e-3)


def test_the_last_two_places_decide_as_in_the_paper() -> None:
    """P(k + 1) = 2 P(k) - P(k - 1), (9) and (10)."""
    prediction = ConstantVelocity(1)
    for k, x in enumerate((0.0, 0.5, 0.7)):
        prediction.observe(np.array([0.1 * k]), np.array([[x, 0.0, 0.0]]))
    assert prediction.at(0.3)[0, 0] == pytest.approx(2 * 0.7 - 0.5)


@pytest.mark.parametrize("name", ["constant_velocity", "kalman"])
def test_what_is_missing_old_or_forgotten(name: str) -> None:
    prediction = make_prediction(name, 2)
    assert np.isnan(prediction.at(0.0)).all()
    prediction.observe(np.array([0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]))
    assert prediction.at(1.0)[0].tolist() == [0.0, 0.0, 0.0] and np.isnan(prediction.at(1.0)[1]).all()
    prediction.observe(np.array([0.1, np.nan]), np.array([[0.1, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    there = prediction.at(0.2)
    prediction.observe(np.array([0.1, 0.05]), np.full((2, 3), 9.0))  # not newer; new for the second
    assert prediction.at(0.2)[0].tolist() == there[0].tolist() and (prediction.at(0.2)[1] == 9.0).all()
    prediction.observe(np.array([5.0, np.nan]), np.array([[7.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert prediction.at(5.1)[0].tolist() == [7.0, 0.0, 0.0]  # nothing is known of its velocity


def test_under_noise_the_filter_is_nearer(rng: np.random.Generator) -> None:
    """A hand at 1 m/s, seen with 10 mm of noise: the last two places double the noise."""
    t, errors = np.arange(200) / 30.0, {}
    seen = moving(t) + rng.normal(scale=0.01, size=(200, 2, 3))
    for name in ("constant_velocity", "kalman"):
        prediction, off = make_prediction(name, 2), []
        for k in range(len(t)):
            if k > 20:
                off.append(prediction.at(t[k] + 0.1) - moving(t[k : k + 1] + 0.1)[0])
            prediction.observe(np.full(2, t[k]), seen[k])
        errors[name] = np.sqrt(np.mean(np.square(off)))
    assert errors["kalman"] < 0.6 * errors["constant_velocity"]


def test_the_filter_settles_at_the_gain_of_its_riccati_equation() -> None:
    """Long at rest, then seen 1 m away: it believes that by the steady gain, of place and velocity."""
    h, q, r = 0.1, 5.0**2, 0.01**2
    step = np.array([[1.0, h], [0.0, 1.0]])
    noise = q * np.array([[h**4 / 4, h**3 / 2], [h**3 / 2, h**2]])
    seen = np.array([[1.0], [0.0]])
    covariance = solve_discrete_are(step.T, seen, noise, np.array([[r]]))
    gain = covariance[:, 0] / (covariance[0, 0] + r)
    prediction = Kalman(1)
    for k in range(200):
        prediction.observe(np.array([h * k]), np.zeros((1, 3)))
    prediction.observe(np.array([h * 200]), np.array([[1.0, 0.0, 0.0]]))
    assert prediction.at(h * 200)[0, 0] == pytest.approx(gain[0], rel=1e-6)
    assert prediction.at(h * 200 + 1.0)[0, 0] == pytest.approx(gain[0] + gain[1], rel=1e-6)


def test_measurements_that_come_too_fast_make_no_speed() -> None:
    """1 m/s, seen every millisecond with a millimetre of noise to and fro: no more than 1.2 m/s."""
    prediction = ConstantVelocity(1)
    for k in range(200):
        noise = 0.001 * (-1) ** k
        prediction.observe(np.array([0.001 * k]), np.array([[0.001 * k + noise, 0.0, 0.0]]))
        if k > 20:
            ahead = prediction.at(0.001 * k + 1.0)[0, 0] - (0.001 * k + noise)
            assert 0.8 <= ahead <= 1.2, k
    late = prediction.at(0.199)
    prediction.observe(np.array([2.0]), np.zeros((1, 3)))
    np.testing.assert_allclose(prediction.at(3.0), np.zeros((1, 3)))
    assert late[0, 0] == pytest.approx(0.199 - 0.001), "the newest measurement is where it is"


def test_what_cannot_be_used_is_refused_by_name() -> None:
    with pytest.raises(SetupError, match="prediction = 'lstm' should be one of constant_velocity, kalman"):
        make_prediction("lstm", 1)
    with pytest.raises(SetupError, match=r"acceleration_m_s2 = 0\.0 should be a number at least 1e-09"):
        Kalman(1, acceleration_m_s2=0.0)
    with pytest.raises(SetupError, match="error_m = nan should be a number"):
        Kalman(1, error_m=float("nan"))
