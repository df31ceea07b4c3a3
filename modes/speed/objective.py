"""What a speed is chosen by, (11) and (12): closeness to the programmed one, smoothness, penalty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_number
from modes.speed import kernels
from robots.errors import SetupError

Array = NDArray[np.float64]

CAP_M_S = 0.25
"""The paper's limit, "ISO 10218-1": the reduced speed of the editions up to 2006; that of 2011 limits no
collaborative operation by it any more."""

SLOWEST_M_S, FASTEST_M_S = 1e-6, 100.0
"""Programmed speeds and caps outside of these are mistakes."""
_HEAVIEST = 1e6


@dataclass(frozen=True, slots=True)
class Weights:
    """P, D and R of (11) and (12); without unit.

    Raises
    ------
    SetupError
        P is not above 0, one is negative, or one is not a number up to 1e6 (P: from 1e-6 on).
    """

    closeness: float = 1.0
    smoothness: float = 1.0
    penalty: float = 10.0

    def __post_init__(self) -> None:
        for name in ("smoothness", "penalty"):
            require_number(f"speed alteration: weight {name}", getattr(self, name), 0.0, _HEAVIEST)
        if self.closeness == 0.0:
            raise SetupError(
                "speed alteration: weight closeness = 0 should be above 0: any speed would do, "
                "and the robot would never take up its programmed one again"
            )
        least = 1.0 / _HEAVIEST
        require_number("speed alteration: weight closeness", self.closeness, least, _HEAVIEST)


@dataclass(frozen=True, slots=True)
class Goal:
    """One decision.

    Attributes
    ----------
    programmed, previous:
        Speed along the path that is programmed, and the one that was chosen last [m/s].
    cap:
        Speeds in [-cap, cap] may be chosen [m/s].
    weights:
        P, D, R.

    Raises
    ------
    SetupError
        The programmed speed is 0 ((11) divides by it); it or the cap is not from 1e-6 to 100 m/s.
    """

    programmed: float
    previous: float
    cap: float = CAP_M_S
    weights: Weights = Weights()

    def __post_init__(self) -> None:
        if self.programmed == 0.0:
            raise SetupError(
                "speed alteration: programmed speed of 0 m/s: the objective (11) divides by it; "
                "a robot that is to wait has nothing to alter"
            )
        name, fastest = "speed alteration:", FASTEST_M_S
        require_number(f"{name} programmed speed [m/s]", self.programmed, -fastest, fastest)
        size = abs(self.programmed)
        require_number(f"{name} size of the programmed speed [m/s]", size, SLOWEST_M_S, fastest)
        require_number(f"{name} previous speed [m/s]", self.previous, -fastest, fastest)
        require_number(f"{name} cap [m/s]", self.cap, SLOWEST_M_S, fastest)

    @property
    def numbers(self) -> tuple[float, float, float, float, float, float]:
        """Return what kernels read."""
        w = self.weights
        return w.closeness, w.smoothness, w.penalty, self.programmed, self.previous, self.cap

    def array(self) -> Array:
        """Return the numbers as an array (6,)."""
        return np.array(self.numbers)

    def value(self, pairs: Array, v: float) -> float:
        """Return the objective with its penalty, (12), at speed ``v`` [m/s]."""
        return float(kernels.objective(pairs, self.array(), v))
