"""Blocks of rows for tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from occupancy.separation import new_ledger, open_obligations
from occupancy.sets import new_link_sets, new_people_sets
from robots.motion import Block


def write_row(
    block: Block,
    points: ArrayLike,
    radius: float,
    of_slice: int = 0,
    owner: int = 0,
    covers: int = 1,
    model: int = 0,
) -> int:
    """Append a row; rows must come in the order of their slices. Returns its index."""
    rows = block[0]
    row = int(rows["n"])
    points = np.atleast_2d(np.asarray(points, dtype=float))
    rows["points"][row, : len(points)] = points
    rows["n_points"][row], rows["radius"][row] = len(points), radius
    rows["slice"][row], rows["owner"][row], rows["covers"][row], rows["model"][row] = (
        of_slice,
        owner,
        covers,
        model,
    )
    rows["n"] = row + 1
    rows["first"][of_slice + 1 :] = row + 1
    return row


def blocks(n_slices: int, n_links: int, parts: Sequence[int]) -> tuple[Block, Block, Block]:
    """Empty link rows, empty people rows and an open ledger."""
    ledger = new_ledger()
    open_obligations(ledger, n_slices, n_links, parts)
    return new_link_sets(), new_people_sets(), ledger


def pair(a: ArrayLike, radius_a: float, b: ArrayLike, radius_b: float) -> tuple[Block, Block, Block]:
    """One link row and one people row on one slice."""
    links, people, ledger = blocks(1, 1, [1])
    write_row(links, a, radius_a)
    write_row(people, b, radius_b)
    return links, people, ledger
