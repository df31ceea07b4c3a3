"""Which obligations a slow link does not have, against a plain reading of the rule."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import MAX_PARTS
from occupancy.contact_kernels import clear_slow
from occupancy.sets import MAX_PEOPLE
from robots.enclosure import MAX_LINKS
from robots.motion import MAX_SLICES, Block
from tests.occupancy.scenes import blocks, write_row

Array = NDArray[np.float64]
Count = Callable[[int], int]
SPEEDS = np.array([0.0, 0.1, 0.2, 0.3])
LIMITS = np.array([*SPEEDS, np.nan, -np.inf, -0.1])


def scene(rng: np.random.Generator, n_slices: int, n_links: int, n_people: int) -> tuple[Block, Block, Array]:
    """Rows with speeds, some of which cannot be used, random obligations, and limits."""
    links, _, ledger = blocks(n_slices, n_links, [0] * n_people)
    for i in range(n_slices):
        for link in range(n_links):
            row = write_row(links, [0, 0, 0], 0.1, i, link)
            links[0]["speed_max"][row] = rng.choice([*SPEEDS, np.nan])
            if rng.random() < 0.2:
                field, value = [("slice", i + 1), ("owner", link + 1), ("n_points", 0)][int(rng.integers(3))]
                links[0][field][row] = value
    ledger[0]["open"][:] = rng.integers(0, 1 << 16, ledger[0]["open"].shape)
    return links, ledger, rng.choice(LIMITS, (MAX_LINKS, MAX_PARTS))


def plain(links: Block, ledger: Block, speed: Array) -> NDArray[np.uint32]:
    rows, book = links[0], ledger[0]
    left = book["open"].copy()
    n_links = int(book["n_links"])
    for i, link, k in np.ndindex(int(book["n_slices"]), n_links, int(book["n_people"])):
        row = i * n_links + link
        if (rows["slice"][row], rows["owner"][row]) == (i, link) and rows["n_points"][row] > 0:
            for part in range(MAX_PARTS):
                if rows["speed_max"][row] <= speed[link, part]:
                    left[i, link, k] &= ~np.uint32(1 << part)
    return left


def test_slow_links_lose_obligations_and_no_others_do(rng: np.random.Generator, count: Count) -> None:
    some = none = 0
    for _ in range(max(60, count(5_000))):
        sizes = tuple(int(rng.integers(1, m)) for m in (4, 4, 3))
        links, ledger, speed = scene(rng, *sizes)
        if rng.random() < 0.3:
            ledger[0]["open"][:] &= rng.integers(0, 2, ledger[0]["open"].shape, dtype=np.uint32)
        before, left = ledger[0]["open"].copy(), plain(links, ledger, speed)
        assert clear_slow(links, ledger, speed) == (left != before).any()
        np.testing.assert_array_equal(ledger[0]["open"], left)
        some, none = some + (left != before).any(), none + (left == before).all()
    assert some > 0 and none > 0


def test_a_ledger_of_full_size(rng: np.random.Generator) -> None:
    links, ledger, speed = scene(rng, MAX_SLICES, MAX_LINKS, MAX_PEOPLE)
    speed[:, 3:] = np.nan
    ledger[0]["open"] &= 7
    left = ledger[0]["open"].copy()
    rows = links[0]
    for i, link in np.ndindex(MAX_SLICES, MAX_LINKS):
        row = i * MAX_LINKS + link
        if (rows["slice"][row], rows["owner"][row]) == (i, link) and rows["n_points"][row] > 0:
            may = sum(1 << part for part in range(3) if rows["speed_max"][row] <= speed[link, part])
            left[i, link] &= ~np.uint32(may)
    assert clear_slow(links, ledger, speed)
    np.testing.assert_array_equal(ledger[0]["open"], left)


@pytest.mark.parametrize("wrong", ["a row too few", "a row too many", "a link too many", "no links"])
def test_rows_that_do_not_belong_together_clear_nothing(wrong: str, rng: np.random.Generator) -> None:
    links, ledger, speed = scene(rng, 2, 3, 1)
    speed[:] = 1.0
    if wrong == "a link too many":
        speed = speed[:2]
    elif wrong == "no links":
        links["n"], ledger["n_links"] = 0, 0
    else:
        links["n"] += 1 if wrong == "a row too many" else -1
    before = ledger.copy()
    assert not clear_slow(links, ledger, speed) and ledger.tobytes() == before.tobytes()
    if wrong == "a link too many":
        assert clear_slow(links, ledger, np.ones((3, MAX_PARTS)))
