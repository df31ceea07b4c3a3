"""Which obligations are opened: against a plain reading of what counts as moving."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occupancy.ledger_kernels import anything_open, open_moving
from occupancy.separation import new_ledger
from occupancy.sets import new_link_sets
from robots.motion import new_slices

Count = Callable[[int], int]
NAN = float("nan")


def scene(rng, n_slices, n_links, n_joints):
    links, slices = new_link_sets(), new_slices()
    slices["n"], slices["n_joints"] = n_slices, n_joints
    slices["q_error"][0, :n_joints] = rng.choice([0.0, 0.001, 0.01], n_joints) * (rng.random() < 0.5)
    links["n"] = n_slices * n_links
    links["speed_max"][0, : n_slices * n_links] = rng.choice([0.0, 0.001, 0.2], n_slices * n_links) * (
        rng.random() < 0.7
    )
    return links, slices, rng.uniform(0.0, 1.0, (24, 16))


def test_what_moves_or_errs_is_opened(rng: np.random.Generator, count: Count) -> None:
    some = none = 0
    for _ in range(count(20_000)):
        n_slices, n_links, n_joints, n_people = (int(rng.integers(1, m)) for m in (9, 9, 8, 5))
        links, slices, reach = scene(rng, n_slices, n_links, n_joints)
        ledger, parts = new_ledger(), int(rng.integers(1, 1 << 16))
        ledger[0]["open"][:] = 7
        opened = open_moving(ledger, links, slices, reach, 0.001, 0.005, n_people, parts)
        expected = np.zeros((n_slices, n_links, n_people), dtype=np.uint32)
        for i, link in np.ndindex(n_slices, n_links):
            error = sum(reach[link, j] * slices["q_error"][0, j] for j in range(n_joints))
            if links["speed_max"][0, i * n_links + link] > 0.001 or error > 0.005:
                expected[i, link] = parts
        book = ledger[0]
        assert (book["n_slices"], book["n_links"], book["n_people"]) == expected.shape
        np.testing.assert_array_equal(book["open"][:n_slices, :n_links, :n_people], expected)
        assert opened == np.count_nonzero(expected)
        assert anything_open(ledger) == (opened > 0)
        some, none = some + (opened > 0), none + (opened == 0)
    assert some > 0 and none > 0


@pytest.mark.parametrize("where", ["speed", "error", "reach"])
def test_what_is_not_a_number_moves(rng: np.random.Generator, where: str) -> None:
    links, slices, reach = scene(rng, 2, 2, 3)
    links["speed_max"][:], slices["q_error"][:] = 0.0, 0.0
    assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1) == 0
    if where == "speed":
        links["speed_max"][0, 1] = NAN
        assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1) == 1
        return
    if where == "error":
        slices["q_error"][0, 1] = NAN
    else:
        reach[:, 1] = NAN
    assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1) == 4


def test_one_open_bit_anywhere_is_seen(rng: np.random.Generator) -> None:
    ledger = new_ledger()
    book = ledger[0]
    book["n_slices"], book["n_links"], book["n_people"] = 5, 4, 3
    assert not anything_open(ledger)
    for index in np.ndindex(5, 4, 3):
        book["open"][index] = 1 << int(rng.integers(0, 32))
        assert anything_open(ledger)
        book["open"][index] = 0
    book["open"][5:], book["open"][:, 4:], book["open"][:, :, 3:] = 1, 1, 1
    assert not anything_open(ledger)
