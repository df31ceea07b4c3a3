"""Separation by several models of people: one after the other while anything is open."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from occupancy.separation import Nearest, Separation
from occupancy.sets import new_people_sets
from robots.assumption import Certainty
from robots.motion import Block
from tests.occupancy.scenes import blocks, write_row
from verifier.criteria import Scene, SeparationCriterion

RADIUS = 0.1
"""Of every row [m]: two that are d apart have a gap of d - 0.2 m."""


def sets(*rows: tuple[int, int, float], model: int = 0) -> Block:
    """People rows of one model, each (slice, parts, distance from the arm [m])."""
    block = new_people_sets()
    for of_slice, covers, distance in rows:
        write_row(block, [distance, 0.0, 0.0], RADIUS, of_slice, covers=covers, model=model)
    return block


def scene(n_slices: int, parts: int, *models: Block) -> tuple[Scene, Block]:
    """A link at the origin on every slice, another 50 m beside it, and a person with ``parts`` open."""
    links, _, ledger = blocks(n_slices, 2, [parts])
    for i in range(n_slices):
        write_row(links, [0.0, 0.0, 0.0], RADIUS, i)
        write_row(links, [0.0, 50.0, 0.0], RADIUS, i, owner=1)
    occupancies = [SimpleNamespace(sets=each) for each in models]
    return Scene(links, links, links, occupancies), ledger


class Recording(Separation):
    """Keeps what was open, per call: the slices."""

    def __init__(self) -> None:
        super().__init__()
        self.slices: list[list[int]] = []

    def check(self, links: Block, people: Block, ledger: Block) -> Nearest:
        opened = ledger[0]["open"][: ledger[0]["n_slices"]]
        self.slices.append(np.flatnonzero(opened.any(axis=(1, 2))).tolist())
        return super().check(links, people, ledger)


@pytest.fixture
def criterion() -> SeparationCriterion:
    return SeparationCriterion(Separation(), 1e-4)


def left(ledger: Block) -> list[int]:
    return [int(x) for x in ledger[0]["open"][: ledger[0]["n_slices"], 0, 0]]


@pytest.mark.parametrize(("first", "second"), [(3.2, 5.2), (5.2, 3.2)])
def test_what_one_model_leaves_open_another_closes_and_the_tightest_proof_counts(
    criterion: SeparationCriterion, first: float, second: float
) -> None:
    one = sets((0, 0b01, first), (0, 0b10, 0.1), model=0)
    other = sets((0, 0b11, second), model=1)
    found = criterion.check(*(given := scene(1, 0b11, one, other)))
    assert found.separated and left(given[1]) == [0]
    assert found.gap_m == pytest.approx(min(first, second) - 2.0 * RADIUS, abs=1e-9)
    assert found.model == (0 if first < second else 1)


def test_a_model_that_closes_everything_is_the_last_one_asked(criterion: SeparationCriterion) -> None:
    given = scene(1, 0b1, sets((0, 0b1, 2.2)), sets((0, 0b1, 1.2), model=1))
    found = criterion.check(*given)
    assert (found.separated, found.model) == (True, 0)
    assert found.gap_m == pytest.approx(2.0, abs=1e-9)


def test_a_model_that_proves_nothing_is_never_the_tightest(criterion: SeparationCriterion) -> None:
    found = criterion.check(*scene(1, 0b1, sets((0, 0b1, 0.1)), sets((0, 0b1, 4.2), model=1)))
    assert found.separated and found.model == 1 and found.gap_m == pytest.approx(4.0, abs=1e-9)


@pytest.mark.parametrize("swapped", [False, True])
def test_what_stays_open_is_told_of_the_first_slice_by_the_model_that_comes_closest(
    criterion: SeparationCriterion, swapped: bool
) -> None:
    deep = sets((0, 0b1, 9.0), (1, 0b1, 0.05), (2, 0b1, 0.19), (3, 0b1, 9.0), model=3)
    shallow = sets((0, 0b1, 0.1), (1, 0b1, 0.12), (2, 0b1, 0.01), (3, 0b1, 9.0), model=4)
    models = (shallow, deep) if swapped else (deep, shallow)
    given = scene(4, 0b1, *models)
    found = criterion.check(*given)
    assert left(given[1]) == [0, 1, 1, 0]
    assert (found.separated, found.slice, found.model) == (False, 1, 4)
    assert found.gap_m == pytest.approx(0.12 - 2.0 * RADIUS, abs=1e-6)


def test_each_model_is_asked_once_and_once_more_about_the_first_open_slice_only() -> None:
    separation = Recording()
    near = sets(*((i, 0b1, 9.0 if i == 0 else 0.1) for i in range(4)))
    given = scene(4, 0b1, near, near)
    SeparationCriterion(separation, 1e-4).check(*given)
    assert separation.slices == [[0, 1, 2, 3], [1, 2, 3], [1], [1]]
    assert left(given[1]) == [0, 1, 1, 1]
    separation.slices.clear()
    SeparationCriterion(separation, 1e-4).check(*scene(4, 0b1, near))
    assert separation.slices == [[0, 1, 2, 3]]


def test_one_model_alone_answers_for_itself(criterion: SeparationCriterion) -> None:
    given = scene(2, 0b1, sets((0, 0b1, 9.0), (1, 0b1, 0.1), model=2))
    found = criterion.check(*given)
    assert (found.separated, found.slice, found.model) == (False, 1, 2) and left(given[1]) == [0, 1]


def test_a_limit_on_calls_is_one_per_scene() -> None:
    class Counting(Separation):
        renewed = 0

        def renew(self) -> None:
            self.renewed += 1
            super().renew()

    separation = Counting(gjk_limit=3)
    criterion = SeparationCriterion(separation, 1e-4)
    first, second = scene(1, 0b1, sets((0, 0b1, 9.0))), scene(1, 0b1, sets((0, 0b1, 9.0)))
    for given, renewed in ((first, 1), (first, 1), (second, 2), (first, 3)):
        criterion.check(*given)
        assert separation.renewed == renewed


def test_the_margin_is_listed() -> None:
    (found,) = SeparationCriterion(Separation(), 0.003).assumptions()
    assert (found.name, found.value, found.unit) == ("check.margin_m", 0.003, "m")
    assert found.certainty is Certainty.DECLARED
