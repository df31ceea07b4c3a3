"""The cycle that an instant is in, against whole numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from failsafe.short_term_plan import LATEST_CLOCK_S
from verifier.grid import Grid

CYCLE, EARLY, TICK = 32.0 / 4096.0, 8.0 / 4096.0, 1.0 / 4096.0
"""All of them binary fractions [s], so that sums and quotients are exact."""


def test_nothing_is_known_before_the_first_step() -> None:
    grid = Grid(CYCLE, EARLY)
    assert grid.k == -1 and math.isnan(grid.origin) and not grid.went_back


def test_cycles_are_counted_from_the_first_step_on(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """A cycle has 32 ticks, and a step that comes up to 8 of them early is the one of the next cycle."""
    for _ in range(count(5_000)):
        grid, first = Grid(CYCLE, EARLY), int(rng.integers(-10_000, 10_000))
        assert grid.advance(first * TICK) == 1 and not grid.went_back
        ticks, k = first, 0
        for _ in range(30):
            before, ticks = (
                ticks,
                ticks + int(rng.choice([-40, -8, -1, 0, 1, 8, 23, 24, 25, 31, 32, 33, 200])),
            )
            expected = max(0, (ticks - first + 8) // 32 - k)
            assert grid.advance(ticks * TICK) == expected
            k += expected
            assert (grid.k, grid.origin, grid.went_back) == (k, first * TICK, ticks < before)


@pytest.mark.parametrize(
    "now", [math.nan, math.inf, -math.inf, 1.001 * LATEST_CLOCK_S, -2.0 * LATEST_CLOCK_S]
)
def test_an_instant_that_cannot_be_used_is_no_step(now: float) -> None:
    fresh = Grid(CYCLE, EARLY)
    assert fresh.advance(now) == 0 and fresh.k == -1 and math.isnan(fresh.origin)
    grid = Grid(CYCLE, EARLY)
    grid.advance(1.0)
    assert grid.advance(now) == 0 and (grid.k, grid.origin) == (0, 1.0)
    assert grid.went_back == (now < 0.0)
    assert grid.advance(1.0 + 3.0 * CYCLE) == 3 and not grid.went_back, "it is not kept as the latest one"


@pytest.mark.parametrize("now", [LATEST_CLOCK_S, -LATEST_CLOCK_S])
def test_the_latest_instant_of_all_can_be_used(now: float) -> None:
    assert Grid(CYCLE, EARLY).advance(now) == 1
