"""The choice of items that tests look at in a run: all of them at full counts, some of them otherwise."""

from __future__ import annotations

import math

import pytest

from tests.conftest import Some, share_of

ITEMS = [f"item {k}" for k in range(40)]


def test_at_full_counts_all_items_are_chosen_in_their_order() -> None:
    assert share_of(ITEMS, 1, 1.0, 0) == ITEMS
    assert share_of(ITEMS, 1, 3.0, 5) == ITEMS


@pytest.mark.parametrize(
    ("scale", "least", "n"), [(0.01, 1, 1), (0.01, 3, 3), (0.1, 1, 4), (0.11, 1, 5), (0.01, 99, 40)]
)
def test_otherwise_a_share_but_never_fewer_than_asked_for(scale: float, least: int, n: int) -> None:
    chosen = share_of(ITEMS, least, scale, 0)
    assert len(set(chosen)) == len(chosen) == n
    assert chosen == sorted(chosen, key=ITEMS.index)
    assert share_of(ITEMS, least, scale, 0) == chosen, "the same seed, the same items"


def test_over_the_seeds_every_item_is_looked_at() -> None:
    seen = {share_of(ITEMS, 1, 0.01, seed)[0] for seed in range(400)}
    assert seen == set(ITEMS)


def test_of_nothing_nothing_is_chosen() -> None:
    assert share_of([], 1, 0.01, 0) == []


def test_the_fixture_has_the_scale_and_the_seed_of_this_run(
    some: Some, request: pytest.FixtureRequest
) -> None:
    scale, seed = float(request.config.getoption("--scale")), int(request.config.getoption("--seed"))
    assert some(ITEMS) == share_of(ITEMS, 1, scale, seed)
    assert len(some(ITEMS, 2)) == min(len(ITEMS), max(2, math.ceil(scale * len(ITEMS))))
