"""A million random admissible motions of bodies and more, for every model of people: none gets out of its
set.

A motion is that of a part of a body (hands and head among them, and parts that have to be inferred), of an
arm, of a whole body (pedestrian) or of a point of a body (unobserved space) through one plan: begin, end
and three instants inside of each of three slices. Speeds and accelerations are used up, directions change
at once, position errors are at their bounds. :mod:`tests.occupancy.crowds`,
:mod:`tests.occupancy.arm_crowds` and :mod:`tests.occupancy.entering` make them, apart from all code of the
models; reports that go through the gate, and bodies with a surface, are in the tests of each model, in
smaller numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.occupancy.inclusion import TRIALS
from tests.occupancy.left_out import LeftOut

Count = Callable[[int], int]
FULL = {False: 1_000_000, True: 500_000}
"""Motions of a full run, in all directions and aligned."""
FEWEST = 5_000
"""So many are needed for something to come near the boundary."""
SEEDS = 1_000_000_000
MODELS = tuple(name for name in TRIALS if name != "frame of a sensor")


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_admissible_motion_stays_inside(name: str, aligned: bool, seed: int, count: Count) -> None:
    wanted, made, near, trials, worst = max(FEWEST, count(FULL[aligned])), 0, 0, 0, -math.inf
    while made < wanted:
        outcome = TRIALS[name](seed * SEEDS + trials, aligned)
        assert outcome.excess_m <= 1e-9, f"outside by {outcome.excess_m} m: {outcome.witness}"
        trials, made = trials + 1, made + outcome.motions
        worst, near = max(worst, outcome.excess_m), near + (outcome.excess_m > -1e-4)
        assert made > 0 or trials < 100, "no motions are made"
    if aligned:
        assert worst > -1e-6, "nothing came near the boundary: the test shows nothing"
        assert near > 0.3 * trials, f"only {near} of {trials} crowds came within 0.1 mm of the boundary"


@pytest.mark.parametrize("name", TRIALS)
def test_a_trial_is_told_apart_by_its_seed(name: str, seed: int) -> None:
    first, second, other = (TRIALS[name](n, True) for n in (seed, seed, seed + 1))
    assert first == second and first != other


@pytest.mark.parametrize("name", MODELS)
def test_a_trial_notices_a_millimetre(name: str, seed: int) -> None:
    """Believed is a body a little thinner than the true one, or a boundary a little better known."""
    thinner = LeftOut(
        "a hundredth of the flesh, a tenth of the boundary's error",
        profile=lambda profile: replace(profile, radius=0.99 * profile.radius),
        monitored=lambda watched: replace(watched, boundary_error_m=0.9 * watched.boundary_error_m),
    )
    found = max(TRIALS[name](seed + k, True, thinner).excess_m for k in range(40))
    assert 5e-4 < found < 6e-3
