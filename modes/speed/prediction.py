"""Where body points will be: constant velocity as in the paper, (9) and (10), or a Kalman filter.

Predictions shape proposals only. Nothing here reaches occupancy or criteria (docs/method.md, section 7).
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_choice, require_number

Array = NDArray[np.float64]
PredictionName = Literal["constant_velocity", "kalman"]
PREDICTIONS: tuple[PredictionName, ...] = ("constant_velocity", "kalman")

_LEAST_S, _FORGET_S = 0.01, 1.0
"""Velocities are not told from measurements that are nearer in time, or farther apart."""


class Prediction(Protocol):
    """Follows some points."""

    def observe(self, t: Array, xyz: Array) -> None:
        """Take in where points were seen, ``xyz (P, 3)`` [m] at ``t (P,)`` [s]; NaN: not seen."""
        ...

    def at(self, t: float) -> Array:
        """Return where the points ``(P, 3)`` will be at ``t`` [s]; NaN: never seen."""
        ...


class ConstantVelocity:
    """P(k + 1) = P(k) + (P(k) - P(k - 1)): the last two measurements of each point, (9) and (10).

    Of those that come faster than every 10 ms, the velocity is that between two that are 10 ms apart: a
    centimetre of noise within a millisecond is no speed.
    """

    def __init__(self, points: int) -> None:
        self._t, self._before = np.full(points, np.nan), np.full(points, np.nan)
        self._xyz, self._earlier = np.full((points, 3), np.nan), np.full((points, 3), np.nan)
        self._velocity = np.zeros((points, 3))

    def observe(self, t: Array, xyz: Array) -> None:
        """Take in where points were seen; what is not newer than what is known is passed over."""
        newer = np.isfinite(t) & np.isfinite(xyz).all(axis=1) & ~(t <= self._t)
        step = t - self._before
        soon = newer & (step < _LEAST_S)
        known = newer & ~soon & (t - self._t < _FORGET_S)
        velocity = (xyz - self._earlier) / np.where(known, step, 1.0)[:, None]
        fresh = np.where(known[:, None], velocity, 0.0)
        self._velocity = np.where((newer & ~soon)[:, None], fresh, self._velocity)
        self._before = np.where(newer & ~soon, t, self._before)
        self._earlier = np.where((newer & ~soon)[:, None], xyz, self._earlier)
        self._t = np.where(newer, t, self._t)
        self._xyz = np.where(newer[:, None], xyz, self._xyz)

    def at(self, t: float) -> Array:
        """Return where the points will be."""
        return np.asarray(self._xyz + self._velocity * (t - self._t)[:, None])


class Kalman:
    """A constant-velocity Kalman filter for each point, driven by white acceleration; axes are independent.

    Parameters
    ----------
    points:
        How many.
    acceleration_m_s2:
        Standard deviation of the acceleration over a step [m/s²]; 5: a hand that changes its mind.
    error_m:
        Standard deviation of a measurement [m].
    """

    def __init__(self, points: int, acceleration_m_s2: float = 5.0, error_m: float = 0.01) -> None:
        for name, value in (("acceleration_m_s2", acceleration_m_s2), ("error_m", error_m)):
            require_number(f"Kalman prediction: {name}", value, 1e-9, 1e6)
        self._q, self._r = acceleration_m_s2**2, error_m**2
        self._t = np.full(points, np.nan)
        self._state = np.full((points, 2, 3), np.nan)
        self._covariance = np.zeros((points, 2, 2))

    def observe(self, t: Array, xyz: Array) -> None:
        """Take in where points were seen; what is not newer than what is known is passed over."""
        for i in np.flatnonzero(np.isfinite(t) & np.isfinite(xyz).all(axis=1) & ~(t <= self._t)):
            h = t[i] - self._t[i]
            if not h < _FORGET_S:
                self._state[i] = xyz[i], np.zeros(3)
                self._covariance[i] = np.diag((self._r, self._q))
            else:
                step = np.array([[1.0, h], [0.0, 1.0]])
                noise = self._q * np.array([[h**4 / 4, h**3 / 2], [h**3 / 2, h**2]])
                state, covariance = step @ self._state[i], step @ self._covariance[i] @ step.T + noise
                gain = covariance[:, 0] / (covariance[0, 0] + self._r)
                self._state[i] = state + gain[:, None] * (xyz[i] - state[0])
                self._covariance[i] = covariance - np.outer(gain, covariance[0])
            self._t[i] = t[i]

    def at(self, t: float) -> Array:
        """Return where the points will be."""
        return np.asarray(self._state[:, 0] + self._state[:, 1] * (t - self._t)[:, None])


def make_prediction(name: str, points: int) -> Prediction:
    """Return a prediction by its name.

    Raises
    ------
    SetupError
        There is none of that name.
    """
    require_choice("prediction", name, PREDICTIONS)
    return Kalman(points) if name == "kalman" else ConstantVelocity(points)
