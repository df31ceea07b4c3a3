"""The separation criterion on rows with up to 32 points, with arm reach and against exact distances."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, Part
from occupancy.engines import MOST_POINTS, CoalEngine, Engine, FclEngine
from occupancy.humans.arm_reach import ArmReach
from occupancy.separation import Separation
from occupancy.sets import (
    MAX_PEOPLE,
    MAX_REACH_POINTS,
    MAX_REACH_SETS,
    PEOPLE_SETS,
    REACH_SETS,
    new_people_sets,
    new_reach_sets,
)
from robots.motion import MAX_SLICES
from tests.occupancy.arm_scenes import person, slices
from tests.occupancy.moving_arms import TUM
from tests.occupancy.moving_people import unit
from tests.occupancy.people import standing
from tests.occupancy.scenes import blocks, write_row
from tests.oracles.optimal import hull_distance

Array = NDArray[np.float64]
Count = Callable[[int], int]
ENGINES = [CoalEngine(), FclEngine()]


def test_block_is_one_of_people_rows_with_room_for_all_arms() -> None:
    assert REACH_SETS.names == PEOPLE_SETS.names
    assert REACH_SETS["points"].shape == (MAX_SLICES * MAX_REACH_SETS, MAX_REACH_POINTS, 3)
    assert MAX_REACH_SETS == 4 * MAX_PEOPLE and MAX_REACH_POINTS <= MOST_POINTS
    assert new_reach_sets()[0]["n"] == 0


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_gaps_of_large_hulls_are_never_above_the_exact_ones(
    engine: Engine, rng: np.random.Generator, count: Count
) -> None:
    separation, proven, clear = Separation(engine=engine), 0, 0
    people = new_reach_sets()
    for _ in range(count(20_000)):
        links, _, ledger = blocks(1, 1, [1])
        people[0]["n"] = 0
        a = rng.normal(size=(4, 3)) * 0.3
        n = int(rng.integers(5, MAX_REACH_POINTS + 1))
        b = unit(rng, n) * rng.uniform(0.1, 0.6) * [1.0, 1.0, rng.choice([0.0, 0.3, 1.0])]
        b = b + unit(rng, 1) * rng.uniform(0.3, 1.8)
        radii = rng.uniform(0.0, 0.2, 2)
        write_row(links, a, radii[0])
        write_row(people, b, radii[1])
        gap = hull_distance(a, b) - radii.sum()
        nearest = separation.check(links, people, ledger)
        assert nearest.gap_m <= gap + 1e-12 and nearest.separated == (nearest.gap_m > 1e-4)
        assert nearest.separated == (ledger[0]["open"][0, 0, 0] == 0)
        clear += gap > 1e-3
        proven += nearest.separated
    assert proven == clear or proven >= (0.98 if engine.name == "python-fcl" else 1.0) * clear
    assert clear > 0


@pytest.mark.parametrize("second", ENGINES, ids=lambda engine: engine.name)
def test_engines_agree_on_rows_of_arm_reach(second: Engine, rng: np.random.Generator, count: Count) -> None:
    """A link beside a person: proven iff it is farther from each row than the margin."""
    model, rows = ArmReach(TUM), new_reach_sets()
    separation = Separation(engine=CoalEngine(), cross_check=second)
    arms = [Part.L_UPPER_ARM, Part.L_FOREARM, Part.L_HAND, Part.R_UPPER_ARM, Part.R_FOREARM, Part.R_HAND]
    answers = set()
    for _ in range(count(10_000)):
        times = np.array([0.0, float(rng.uniform(0.01, 0.12))])
        model.occupy(person(), slices(times), rows)
        assert rows["n"] == 4
        links, _, ledger = blocks(1, 1, [sum(1 << part for part in arms)])
        axis = standing()[4] + unit(rng, 1) * rng.uniform(0.2, 2.0) + rng.normal(size=(2, 3)) * 0.1
        write_row(links, axis, 0.08)
        nearest = separation.check(links, rows, ledger)
        open_parts = int(ledger[0]["open"][0, 0, 0])
        assert nearest.disagreement_m < 1e-3
        for k in range(4):
            points = rows["points"][0, k, : rows["n_points"][0, k]]
            gap = hull_distance(axis, points) - float(rows["radius"][0, k]) - 0.08
            if abs(gap - 1e-4) > 1e-6:
                assert bool(open_parts & int(rows["covers"][0, k])) == (gap <= 1e-4)
            answers.add(gap > 1e-4)
    assert answers == {True, False}


def test_part_without_a_row_is_not_proven_and_another_model_may_prove_it() -> None:
    rows, others, separation = new_reach_sets(), new_people_sets(), Separation()
    ArmReach(TUM, index=1).occupy(person(), slices(np.array([0.0, 0.05])), rows)
    links, _, ledger = blocks(1, 1, [ALL_PARTS])
    write_row(links, [[30.0, 0.0, 0.0]], 0.1)
    proves = ArmReach(TUM).proves
    assert not separation.check(links, rows, ledger).separated
    assert int(ledger[0]["open"][0, 0, 0]) == ALL_PARTS & ~proves
    write_row(others, [[1.0, 0.0, 0.0]], 0.5, covers=ALL_PARTS & ~proves)
    assert separation.check(links, others, ledger).separated


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
@pytest.mark.parametrize("point", [0, 10, 31])
def test_a_number_that_is_not_usable_among_many_points_proves_nothing(point: int, value: float) -> None:
    links, _, ledger = blocks(1, 1, [1])
    people = new_reach_sets()
    write_row(links, [[9.0, 0.0, 0.0]], 0.1)
    row = write_row(people, np.tile([0.1, 0.2, 0.3], (32, 1)), 0.1)
    people[0]["points"][row, point, 1] = value
    assert not Separation().check(links, people, ledger).separated
    people[0]["points"][row, point, 1] = 0.2
    people[0]["n_points"][row] = 33
    assert not Separation().check(links, people, ledger).separated
    people[0]["n_points"][row] = 32
    assert Separation().check(links, people, ledger).separated
