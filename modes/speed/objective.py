"""What a speed is chosen by, (11) and (12): closeness to the programmed one, smoothness, penalty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.speed import kernels
from robots.errors import SetupError

Array = NDArray[np.float64]

CAP_M_S = 0.25
"""The paper's limit, "ISO 10218-1": the reduced speed of the editions up to 2006; that of 2011 limits no
collaborative operation by it any more."""


@dataclass(frozen=True, slots=True)
class Weights:
    """P, D and R of (11) and (12); without unit.

    Raises
    ------
    SetupError
        P is not above 0, or one is negative or not finite.
    """

    closeness: float = 1.0
    smoothness: float = 1.0
    penalty: float = 10.0

    def __post_init__(self) -> None:
        for name in ("closeness", "smoothness", "penalty"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise SetupError(f"speed alteration: weight {name} = {value} should be 0 or more and finite")
        if self.closeness == 0.0:
            raise SetupError(
                "speed alteration: weight closeness = 0 should be above 0: any speed would do, "
                "and the robot would never take up its programmed one again"
            )


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
        The programmed speed is 0 or not finite ((11) divides by it), or the cap is not above 0.
    """

    programmed: float
    previous: float
    cap: float = CAP_M_S
    weights: Weights = Weights()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.programmed) and self.programmed != 0.0):
            raise SetupError(
                f"speed alteration: programmed speed of {self.programmed} m/s should be finite and not 0: "
                "the objective (11) divides by it; a robot that is to wait has nothing to alter"
            )
        if not math.isfinite(self.previous):
            raise SetupError(f"speed alteration: previous speed of {self.previous} m/s should be finite")
        if not 0.0 < self.cap < math.inf:
            raise SetupError(f"speed alteration: cap of {self.cap} m/s should be above 0 and finite")

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
