"""The elite real-coded genetic algorithm of the paper (section III B, figure 1).

As described: an initial population that is uniform over the cap, the two best kept, uniform arithmetic
crossover, random mutation, a fixed number of generations. How parents are chosen is not said; here one by
linear ranking and its mate from the whole population, so that the two sides of a boundary meet. With both by
ranking the end of a free interval is missed by up to 2 mm/s. It is reported as it is; ``polish`` is a setting
of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from modes.settings import require_count, require_number
from modes.speed import kernels
from modes.speed.objective import Goal

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GeneticSettings:
    """The paper's numbers; population 50 in its simulations, 100 in its experiments.

    Attributes
    ----------
    polish:
        Go down to the nearest local minimum from the best speed of the last generation; not in the paper.

    Raises
    ------
    SetupError
        A number is out of its range.
    """

    population: int = 50
    crossover: float = 0.8
    mutation: float = 0.1
    generations: int = 100
    polish: bool = False

    def __post_init__(self) -> None:
        require_count("genetic algorithm: population (two are elite)", self.population, 3, 100_000)
        require_count("genetic algorithm: generations", self.generations, 1, 100_000)
        for name in ("crossover", "mutation"):
            require_number(f"genetic algorithm: probability {name}", getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Evolution:
    """What the algorithm found.

    Attributes
    ----------
    speed:
        The best one [m/s].
    track:
        ``(generations + 1, 2)``: best speed [m/s] and its objective after each generation, from the initial
        population on (the paper's figures 11 c and d).
    """

    speed: float
    track: Array


def evolve(
    pairs: Array, goal: Goal, rng: np.random.Generator, settings: GeneticSettings | None = None
) -> Evolution:
    """Run the algorithm on pairs ``(K, 3)``."""
    settings = settings or GeneticSettings()
    draws = rng.random((settings.generations + 1, settings.population, 6))
    track = np.empty((settings.generations + 1, 2))
    speed = float(kernels.evolve(pairs, goal.array(), draws, settings.crossover, settings.mutation, track))
    return Evolution(_polished(pairs, goal, speed) if settings.polish else speed, track)


def _polished(pairs: Array, goal: Goal, speed: float) -> float:
    """Return the local minimum beside ``speed``, or it if that is no better."""
    near = 0.02 * goal.cap
    bounds = max(speed - near, -goal.cap), min(speed + near, goal.cap)
    found = minimize_scalar(
        lambda v: goal.value(pairs, v), bounds=bounds, method="bounded", options={"xatol": 1e-9}
    )
    return float(found.x) if found.fun < goal.value(pairs, speed) else speed
