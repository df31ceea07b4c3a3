"""Baselines and the count of errors, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from modes.forecasting.baselines import ConstantVelocity, DampedVelocity, Hold
from modes.forecasting.dataset import Windows
from modes.forecasting.errors import Errors, distances_ahead, errors_by_horizon, errors_of_filling, gaps
from modes.forecasting.network import Forecaster
from modes.forecasting.occlusion import HoldPlace
from modes.forecasting.skeleton import Joint
from modes.forecasting.synthetic import person
from robots.errors import SetupError

AHEAD = 0.1 * np.arange(1, 11)


@pytest.mark.parametrize("forecaster", [Hold(), ConstantVelocity(), DampedVelocity()])
@pytest.mark.parametrize("shape", [(30, 14, 3), (15, 3), (30, 15, 2), (0, 15, 3)])
def test_other_skeletons_are_refused_in_a_line(forecaster: Forecaster, shape: tuple[int, ...]) -> None:
    with pytest.raises(SetupError, match=r"should be (\(frames, 15, 3\): CLAV, C7|at least)") as refused:
        forecaster.forecast(np.zeros(shape))
    assert "\n" not in str(refused.value)


def test_a_damping_out_of_range_is_refused() -> None:
    with pytest.raises(SetupError, match="settle_s = 0 should be a number"):
        DampedVelocity(0)


def test_whom_one_velocity_carries_is_forecast_exactly(rng: np.random.Generator) -> None:
    place, velocity = rng.normal(size=(2, 15, 3))
    history = place + 0.1 * np.arange(-29, 1)[:, None, None] * velocity
    assert np.allclose(ConstantVelocity().forecast(history), place + AHEAD[:, None, None] * velocity)
    assert np.array_equal(Hold().forecast(history), np.repeat(history[-1:], 10, axis=0))
    for settle in (0.1, 0.3, 50.0):
        reach = np.array([quad(lambda t, s=settle: np.exp(-t / s), 0.0, end)[0] for end in AHEAD])
        assert np.allclose(DampedVelocity(settle).forecast(history), place + reach[:, None, None] * velocity)


def test_errors_are_distances_at_their_horizons(rng: np.random.Generator) -> None:
    """A person who is still until now, and then goes on at 1 m/s along x and y each."""
    history = np.repeat(rng.normal(size=(4, 1, 15, 3)), 30, axis=1)
    future = history[:, :10] + AHEAD[:, None, None] * np.array([1.0, 1.0, 0.0])
    future[1, :, Joint.LWPS] += (0.0, 0.0, 100.0)
    history[2, :, Joint.RHEE] = future[2, :, Joint.RHEE] = np.nan
    windows = Windows(history, future, ("some",) * 4)
    far = distances_ahead(Hold(), windows)
    assert np.isnan(far[2, :, Joint.RHEE]).all() and np.isnan(far).sum() == 10
    found = errors_by_horizon(Hold(), windows)
    for horizon, errors in found.items():
        usual, odd = np.sqrt(2.0) * horizon, np.sqrt(2.0 * horizon**2 + 100.0**2)
        assert errors.worst == pytest.approx(odd)
        assert errors.mean == pytest.approx((58 * usual + odd) / 59)
        assert errors.p95 == pytest.approx(usual)
    assert np.isnan(Errors.of(np.full(3, np.nan)).mean)


def test_only_hidden_joints_count_for_filling() -> None:
    """A hand that goes on at 1 m/s and is not seen in the last 5 frames is held up to 0.5 m behind."""
    history = np.repeat(person(1.0, 10.0, 0)[None, :1], 30, axis=1)
    history[0, :, Joint.RWPS, 0] += 0.1 * np.arange(30)
    hidden = np.zeros((1, 30, 15), dtype=bool)
    hidden[0, 25:, Joint.RWPS] = True
    whole, last = errors_of_filling(HoldPlace(), Windows(history, history[:, :10], ("a",)), hidden)
    assert whole.mean == pytest.approx(0.3) and whole.worst == pytest.approx(0.5)
    assert last.mean == pytest.approx(0.5)


def test_gaps_hide_some_and_never_all(rng: np.random.Generator) -> None:
    hidden = np.stack([gaps(30, rng) for _ in range(300)])
    assert (hidden.any(axis=(1, 2))).all() and not hidden.all(axis=2).any()
    assert 0.3 < hidden[:, -1].any(axis=1).mean() < 0.9
