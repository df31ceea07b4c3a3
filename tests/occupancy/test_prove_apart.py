"""The quick proof by boxes against a plain reading of its rule; rows that do not belong together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.ledger_kernels import prove_apart
from occupancy.sets import MAX_MODELS, MAX_PEOPLE
from robots.motion import Block
from tests.occupancy.scenes import blocks, write_row

Array = NDArray[np.float64]
Count = Callable[[int], int]
Rng = np.random.Generator
MARGIN = 1e-4
NAN, INF = float("nan"), float("inf")


def proven(
    links: Block, people: Block, ledger: Block, margin: float = MARGIN
) -> tuple[float, NDArray[np.int64]]:
    found = np.full(3, -1, dtype=np.int64)
    boxes = np.full((MAX_PEOPLE + 1, 2, 3), 1e3)  # whatever was there before
    return prove_apart(links, people, ledger, margin, boxes, found), found


def scattered(rng: Rng, n_slices: int, n_links: int, parts: list[int]) -> tuple[Block, Block, Block]:
    """Rows here and there; several of one person, with some of the parts each."""
    links, people, ledger = blocks(n_slices, n_links, parts)
    for i in range(n_slices):
        for link in range(n_links):
            points = rng.normal(size=(int(rng.integers(1, 5)), 3)) * 0.3
            write_row(links, points, rng.uniform(0.0, 0.2), i, link)
        for _ in range(int(rng.integers(0, 3 * len(parts) + 1))):
            owner = int(rng.integers(len(parts)))
            points = rng.normal(size=(int(rng.integers(1, 5)), 3)) * 0.3 + rng.uniform(-2.0, 2.0, 3)
            covers = int(rng.integers(1, 16))
            write_row(people, points, rng.uniform(0.0, 0.3), i, owner, covers, int(rng.integers(MAX_MODELS)))
    return links, people, ledger


def box(rows: np.void, which: Array) -> tuple[Array, Array]:
    low, high = np.full(3, INF), np.full(3, -INF)
    for row in which:
        points = rows["points"][row, : rows["n_points"][row]]
        low = np.minimum(low, points.min(axis=0) - rows["radius"][row])
        high = np.maximum(high, points.max(axis=0) + rows["radius"][row])
    return low, high


def test_cleared_is_what_boxes_around_all_rows_keep_apart(rng: Rng, count: Count) -> None:
    cleared = kept = partly = 0
    for _ in range(count(20_000)):
        n_slices, n_links = int(rng.integers(1, 4)), int(rng.integers(1, 4))
        parts = [int(each) for each in rng.integers(0, 16, int(rng.integers(1, 4)))]
        links, people, ledger = scattered(rng, n_slices, n_links, parts)
        before = ledger[0]["open"].copy()
        margin = float(rng.choice([0.0, MARGIN, 0.3]))
        least, found = proven(links, people, ledger, margin)
        arm, crowd, gaps = links[0], people[0], []
        for i, link, k in np.ndindex(n_slices, n_links, len(parts)):
            mine = np.flatnonzero((crowd["slice"][: crowd["n"]] == i) & (crowd["owner"][: crowd["n"]] == k))
            covered = int(np.bitwise_or.reduce(crowd["covers"][mine], initial=0))
            wanted, after = int(before[i, link, k]), int(ledger[0]["open"][i, link, k])
            gap = -INF
            if len(mine):
                (a, b), (c, d) = box(arm, np.array([i * n_links + link])), box(crowd, mine)
                gap = float(np.linalg.norm(np.maximum(np.maximum(c - b, a - d), 0.0)))
            if wanted and wanted & ~covered == 0 and gap > margin + 1e-9:
                assert after == 0
                gaps.append((gap, i, link, k))
                cleared += 1
            elif abs(gap - margin) > 1e-9:
                assert after == wanted
                kept += wanted != 0
                partly += wanted & ~covered != 0 and gap > margin
        if gaps:
            assert least <= min(gaps)[0] and least == pytest.approx(min(gaps)[0], abs=1e-9)
            assert tuple(found) == min(gaps)[1:]
        else:
            assert least == INF
    assert cleared > 0 and kept > 0 and partly > 0


def apart(n_slices: int = 1) -> tuple[Block, Block, Block]:
    """Two links and two persons far from each other on every slice."""
    links, people, ledger = blocks(n_slices, 2, [3, 3])
    for i in range(n_slices):
        for link in range(2):
            write_row(links, [[0.0, 0.0, 0.1 * link]], 0.1, i, link)
        for k in range(2):
            write_row(people, [[3.0 + k, 0.0, 0.0]], 0.1, i, k, 1)
            write_row(people, [[3.0 + k, 0.5, 0.0]], 0.1, i, k, 2)
    return links, people, ledger


def still_open(ledger: Block, n_slices: int = 1) -> NDArray[np.uint32]:
    return ledger[0]["open"][:n_slices, :2, :2].copy()


def test_what_is_far_apart_is_proven() -> None:
    links, people, ledger = apart(2)
    least, found = proven(links, people, ledger)
    assert not still_open(ledger, 2).any() and tuple(found) == (0, 0, 0)
    assert least == pytest.approx(2.8, abs=1e-9) and least <= 2.8


@pytest.mark.parametrize(("gap", "cleared"), [(MARGIN, False), (MARGIN + 1e-9, True), (0.0, False)])
def test_the_margin_must_be_exceeded(gap: float, cleared: bool) -> None:
    links, people, ledger = blocks(1, 1, [1])
    write_row(links, [[0.0, 0.0, 0.0]], 0.25)
    write_row(people, [[0.5 + gap, 0.0, 0.0]], 0.25)
    proven(links, people, ledger)
    assert bool(ledger[0]["open"][0, 0, 0] == 0) is cleared


@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e300])
@pytest.mark.parametrize("what", ["points", "radius"])
@pytest.mark.parametrize("whose", ["link", "first row", "last row"])
def test_numbers_that_are_none_prove_nothing(value: float, what: str, whose: str) -> None:
    links, people, ledger = apart()
    rows, row = (links[0], 0) if whose == "link" else (people[0], 0 if whose == "first row" else 1)
    if what == "points":
        rows["points"][row, 0, 1] = value
    else:
        rows["radius"][row] = value
    proven(links, people, ledger)
    left = still_open(ledger)[0]
    if whose == "link":
        assert (left[0] == 3).all() and not left[1].any()
    else:
        assert (left[:, 0] == 3).all() and not left[:, 1].any()


@pytest.mark.parametrize("points", [0, -1, 5])
@pytest.mark.parametrize("whose", ["link", "person"])
def test_rows_with_no_points_or_too_many_prove_nothing(points: int, whose: str) -> None:
    links, people, ledger = apart()
    (links if whose == "link" else people)[0]["n_points"][0] = points
    proven(links, people, ledger)
    left = still_open(ledger)[0]
    assert (left[0] == 3).all() if whose == "link" else (left[:, 0] == 3).all()


def test_a_negative_radius_proves_nothing() -> None:
    links, people, ledger = apart()
    people[0]["radius"][0] = -1e-9
    proven(links, people, ledger)
    assert (still_open(ledger)[0, :, 0] == 3).all()


BROKEN: dict[str, Callable[[np.void, np.void, np.void], None]] = {
    "a person's row of another slice": lambda _a, c, _b: c["slice"].__setitem__(1, 1),
    "of nobody": lambda _a, c, _b: c["owner"].__setitem__(1, -1),
    "of a person beyond the block": lambda _a, c, _b: c["owner"].__setitem__(1, MAX_PEOPLE),
    "of no model": lambda _a, c, _b: c["model"].__setitem__(1, -1),
    "of a model beyond the block": lambda _a, c, _b: c["model"].__setitem__(1, MAX_MODELS),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_row_that_belongs_elsewhere_leaves_its_slice_open(name: str) -> None:
    links, people, ledger = apart(2)
    BROKEN[name](links[0], people[0], ledger[0])
    proven(links, people, ledger)
    left = still_open(ledger, 2)
    assert (left[0] == 3).all() and not left[1].any()


@pytest.mark.parametrize("name", ["owner", "slice"])
def test_a_link_row_that_belongs_elsewhere_proves_nothing(name: str) -> None:
    links, people, ledger = apart(2)
    links[0][name][0] = 1
    proven(links, people, ledger)
    left = still_open(ledger, 2)
    assert (left[0, 0] == 3).all() and not left[0, 1].any() and not left[1].any()


@pytest.mark.parametrize(
    "name", ["link rows", "order of link rows", "order of people rows", "links", "people", "begin of links"]
)
def test_blocks_that_do_not_belong_together_prove_nothing(name: str) -> None:
    links, people, ledger = apart(2)
    book = ledger[0]
    if name == "link rows":
        links[0]["n"] = 3
    elif name == "order of link rows":
        links[0]["first"][1] = 5
    elif name == "order of people rows":
        people[0]["first"][1] = 9
    elif name == "begin of links":
        links[0]["first"][1] = 1
    else:
        book["n_" + name] = MAX_PEOPLE + 1 if name == "people" else -1
    least, _ = proven(links, people, ledger)
    left = still_open(ledger, 2)
    assert (left[1] == 3).all()
    assert least == INF or name == "begin of links"
