"""The momentum observer beside simulated dynamics: pinocchio's forward dynamics, finely integrated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from modes.contact.momentum import MomentumObserver
from robots.errors import SetupError
from tests.robots.pin_oracle import urdf_of

Array = NDArray[np.float64]
T = 0.001


def advanced(
    acceleration: Callable[[float, Array], Array], t: float, q: Array, dq: Array
) -> tuple[Array, Array]:
    """One step of Runge and Kutta's method of order 4."""

    def rate(at: float, y: Array) -> Array:
        return np.concatenate((y[6:], acceleration(at, y)))

    y = np.concatenate((q, dq))
    k1 = rate(t, y)
    k2 = rate(t + 0.5 * T, y + 0.5 * T * k1)
    k3 = rate(t + 0.5 * T, y + 0.5 * T * k2)
    k4 = rate(t + T, y + T * k3)
    y = y + T / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return y[:6], y[6:]


def run(push: Callable[[float], Array], seconds: float, gain: float = 50.0) -> tuple[Array, Array]:
    """A UR5 that swings under smooth torques and a contact; residuals and contact torques, every 1 ms."""
    model = pinocchio.buildModelFromUrdf(str(urdf_of("ur5")))
    data = model.createData()
    q, dq = np.array([0.3, -1.2, 1.0, -0.5, 0.4, 0.2]), np.zeros(6)
    observer, found, true = MomentumObserver(model, gain, T), [], []
    held = np.zeros(6)
    for k in range(round(seconds / T)):
        torque = pinocchio.rnea(model, data, q, dq, np.zeros(6)) + 6.0 * np.sin(2.0 * k * T + np.arange(6.0))
        found.append(observer.step(q, dq, held))
        held = torque
        true.append(push(k * T))
        q, dq = advanced(
            lambda at, y, held=torque: pinocchio.aba(model, data, y[:6], y[6:], held + push(at)), k * T, q, dq
        )
    return np.array(found), np.array(true)


def test_without_a_contact_the_residual_stays_at_nothing_while_the_arm_swings() -> None:
    found, _true = run(lambda t: np.zeros(6), 2.0)
    assert np.abs(found).max() < 0.01


def test_a_contact_shows_with_the_lag_that_is_stated() -> None:
    """A step of torques on three joints: r is 1 - exp(-K t) of it."""
    pushed = np.array([8.0, -12.0, 0.0, 3.0, 0.0, 0.0])
    found, _true = run(lambda t: pushed * (t >= 0.5), 1.0)
    since = T * np.arange(len(found)) - 0.5
    wanted = np.where(since > 0.0, -np.expm1(-50.0 * np.maximum(since, 0.0)), 0.0)[:, None] * pushed
    np.testing.assert_allclose(found, wanted, atol=0.3)
    np.testing.assert_allclose(found[-1], pushed, atol=0.05)


def test_a_slow_contact_is_followed() -> None:
    found, true = run(lambda t: np.array([5.0, 5.0, 5.0, 1.0, 1.0, 1.0]) * np.sin(3.0 * t), 1.5)
    lag = 20
    np.testing.assert_allclose(found[200:], true[200 - lag : -lag], atol=0.15)


def test_what_cannot_be_used_is_refused_by_name() -> None:
    model = pinocchio.buildModelFromUrdf(str(urdf_of("ur5")))
    with pytest.raises(SetupError, match=r"gain = 2000.0 should be a number at least 0.001 and at most 1000"):
        MomentumObserver(model, 2000.0, T)
    with pytest.raises(SetupError, match="period_s = 0"):
        MomentumObserver(model, 50.0, 0)
    free = pinocchio.buildModelFromUrdf(str(urdf_of("ur5")), pinocchio.JointModelFreeFlyer())
    with pytest.raises(SetupError, match="13 positions of 12 speeds"):
        MomentumObserver(free)
