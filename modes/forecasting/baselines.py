"""What every forecast has to be better than: nobody moves, and everybody goes on as before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import AHEAD, RATE_HZ
from modes.forecasting.occlusion import require_history
from modes.settings import require_number
from robots.errors import SetupError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hold:
    """Everything stays where it is."""

    name: str = "hold"

    def forecast(self, history: Array) -> Array:
        """Return where joints are, ten times."""
        require_frames(history, 1)
        return np.repeat(history[-1:], AHEAD, axis=0)


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """Every joint goes on as between the last two frames; bones do not keep their lengths."""

    name: str = "constant_velocity"

    def forecast(self, history: Array) -> Array:
        """Return where joints get in 0.1 … 1.0 s."""
        require_frames(history, 2)
        ahead = np.arange(1, AHEAD + 1)[:, None, None]
        return np.asarray(history[-1] + ahead * (history[-1] - history[-2]))


@dataclass(frozen=True, slots=True)
class DampedVelocity:
    """Every joint goes on as between the last two frames, and slows down exponentially.

    Attributes
    ----------
    settle_s:
        Time in which the velocity falls to 1/e [s]; 0.3 is about the best among the people trained on.
    """

    settle_s: float = 0.3
    name: str = "damped_velocity"

    def __post_init__(self) -> None:
        require_number("damped velocity: settle_s", self.settle_s, 0.01, 100.0)

    def forecast(self, history: Array) -> Array:
        """Return where joints get in 0.1 … 1.0 s."""
        require_frames(history, 2)
        return np.asarray(history[-1] + self.reach()[:, None, None] * (history[-1] - history[-2]))

    def reach(self) -> Array:
        """Return how many of the last steps lie between now and each frame ahead ``(10,)``."""
        t = np.arange(1, AHEAD + 1) / RATE_HZ
        return np.asarray(RATE_HZ * self.settle_s * (1.0 - np.exp(-t / self.settle_s)))


def require_frames(history: Array, least: int) -> None:
    """Refuse another skeleton, or fewer frames.

    Raises
    ------
    SetupError
        It is so.
    """
    require_history(history)
    if len(history) < least:
        raise SetupError(f"history: {len(history)} frames should be at least {least}")
