"""Which obligations are opened, and which of them boxes close: against plain readings of the rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from occupancy.ledger_kernels import anything_open, open_moving, prove_apart
from occupancy.separation import new_ledger
from occupancy.sets import MAX_MODELS, MAX_PEOPLE, new_link_sets
from robots.enclosure import MAX_LINKS
from robots.motion import new_slices
from tests.occupancy.scenes import blocks, pair, write_row

Count = Callable[[int], int]
NAN = float("nan")
NOT_COMMANDED = np.zeros(MAX_LINKS, dtype=np.uint8)


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
        commanded = (rng.random(MAX_LINKS) < rng.choice([0.0, 0.3])).astype(np.uint8)
        opened = open_moving(ledger, links, slices, reach, 0.001, 0.005, n_people, parts, commanded)
        expected = np.zeros((n_slices, n_links, n_people), dtype=np.uint32)
        for i, link in np.ndindex(n_slices, n_links):
            error = sum(reach[link, j] * slices["q_error"][0, j] for j in range(n_joints))
            if commanded[link] or links["speed_max"][0, i * n_links + link] > 0.001 or error > 0.005:
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
    assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1, NOT_COMMANDED) == 0
    if where == "speed":
        links["speed_max"][0, 1] = NAN
        assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1, NOT_COMMANDED) == 1
        return
    if where == "error":
        slices["q_error"][0, 1] = NAN
    else:
        reach[:, 1] = NAN
    assert open_moving(new_ledger(), links, slices, reach, 0.001, 0.005, 1, 1, NOT_COMMANDED) == 4


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


# -- what boxes keep apart --


def by_boxes(links, people, ledger, margin=1e-4):
    found = np.full(3, -7, dtype=np.int64)
    return prove_apart(links, people, ledger, margin, np.zeros((MAX_PEOPLE + 1, 2, 3)), found), found.tolist()


def crowd_in_boxes(rng):
    """Rows of several people, points and radii on a grid of 1/8 m, so that boxes touch and gaps are exact."""
    n_slices, n_links, n_people = (int(rng.integers(1, m)) for m in (5, 4, 4))
    links, people, ledger = blocks(n_slices, n_links, rng.integers(0, 8, n_people).tolist())
    for i in range(n_slices):
        for link in range(n_links):
            write_row(
                links,
                rng.integers(-4, 5, (int(rng.integers(1, 5)), 3)) / 8.0,
                rng.integers(0, 3) / 8.0,
                i,
                link,
            )
        for _ in range(int(rng.integers(0, 2 * n_people + 1))):
            points = rng.integers(-4, 5, (int(rng.integers(1, 5)), 3)) / 8.0 + rng.integers(-12, 13, 3) / 8.0
            owner, model = int(rng.integers(n_people)), int(rng.integers(MAX_MODELS))
            row = write_row(
                people, points, rng.integers(0, 3) / 8.0, i, owner, int(rng.integers(1, 8)), model
            )
            if rng.random() < 0.05:
                people[0]["points"][row, 0, int(rng.integers(3))] = NAN
    return links, people, ledger


def box(rows, chosen):
    """Corners (2, 3) of the box around some rows."""
    points = [(rows["points"][r, : rows["n_points"][r]], rows["radius"][r]) for r in chosen]
    lows, highs = ([p.min(axis=0) - r for p, r in points], [p.max(axis=0) + r for p, r in points])
    return np.min(lows, axis=0), np.max(highs, axis=0)


def expected_by_boxes(links, people, ledger, margin):
    """What boxes close, by the rule itself: open bits that are left, and the gaps of what was closed."""
    book, gaps = ledger[0], {}
    left = book["open"].copy()
    for i, link, k in np.ndindex(*(int(book[name]) for name in ("n_slices", "n_links", "n_people"))):
        rows = [b for b in range(people[0]["n"]) if (people[0]["slice"][b], people[0]["owner"][b]) == (i, k)]
        covered = np.bitwise_or.reduce(people[0]["covers"][rows]) if rows else 0
        if not left[i, link, k] or left[i, link, k] & ~np.uint32(covered):
            continue
        (low_a, high_a), (low_b, high_b) = (
            box(links[0], [i * int(book["n_links"]) + link]),
            box(people[0], rows),
        )
        gap = float(np.linalg.norm(np.maximum(np.maximum(low_b - high_a, low_a - high_b), 0.0)))
        if gap > margin:
            left[i, link, k], gaps[i, link, k] = 0, gap
    return left, gaps


@pytest.mark.parametrize("margin", [0.0, 1e-4, 0.2])
def test_boxes_close_what_they_keep_apart_and_nothing_else(
    margin: float, rng: np.random.Generator, count: Count
) -> None:
    closed = kept = 0
    for _ in range(count(20_000)):
        links, people, ledger = crowd_in_boxes(rng)
        left, gaps = expected_by_boxes(links, people, ledger, margin)
        least, found = by_boxes(links, people, ledger, margin)
        np.testing.assert_array_equal(ledger[0]["open"], left)
        if not gaps:
            assert least == np.inf and found == [-7, -7, -7]
            kept += 1
            continue
        assert min(gaps.values()) * (1.0 - 1e-9) < least < min(gaps.values())
        assert gaps[tuple(found)] == pytest.approx(least, abs=1e-9)
        closed += 1
    assert closed > 0 and kept > 0


def test_boxes_that_are_as_far_apart_as_the_margin_close_nothing() -> None:
    largest, _ = by_boxes(*pair([0, 0, 0], 0.1, [9, 0, 0], 0.2), 0.0)
    assert by_boxes(*pair([0, 0, 0], 0.1, [9, 0, 0], 0.2), largest)[0] == np.inf
    assert by_boxes(*pair([0, 0, 0], 0.1, [9, 0, 0], 0.2), float(np.nextafter(largest, 0.0)))[0] == largest


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("far", [0.0, 1e8])
def test_a_gap_of_boxes_is_below_the_exact_one_also_far_from_the_origin(
    axis: int, side: float, far: float, rng: np.random.Generator, count: Count
) -> None:
    for _ in range(count(5_000)):
        a, b = rng.uniform(-1.0, 1.0, (2, 3)) + far * rng.choice([-1.0, 1.0], 3)
        b[axis] = a[axis] + side * rng.uniform(1.0, 2.0)
        radii = rng.uniform(0.0, 0.2, 2)
        least, _ = by_boxes(*pair(a, radii[0], b, radii[1]))
        each = [
            abs(Fraction(x) - Fraction(y)) - Fraction(radii[0]) - Fraction(radii[1])
            for x, y in zip(a, b, strict=True)
        ]
        square = sum(max(x, Fraction(0)) ** 2 for x in each)
        assert least > 0.0 and Fraction(least) ** 2 < square
        assert least > math.sqrt(square) - 4.1e-12 * (np.abs([a, b]).max() + radii.max())


def test_a_link_and_a_person_of_each_number_find_their_own_boxes() -> None:
    links, people, ledger = blocks(3, 4, [1] * MAX_PEOPLE)
    for i in range(3):
        for link in range(4):
            write_row(links, [10.0 * link, 0, 0], 0.5, i, link)
        for k in range(MAX_PEOPLE):
            write_row(people, [10.0 * k, 0, 0], 0.5, i, k)
    least, _ = by_boxes(links, people, ledger)
    assert least == pytest.approx(9.0, abs=1e-9)
    for i, link, k in np.ndindex(3, 4, MAX_PEOPLE):
        assert ledger[0]["open"][i, link, k] == (link == k)


@pytest.mark.parametrize(
    "wrong", ["slice of a link", "owner of a link", "begin of a slice", "a row too many"]
)
def test_links_out_of_place_are_not_closed(wrong: str) -> None:
    links, people, ledger = blocks(2, 2, [1])
    for i in range(2):
        for link in range(2):
            write_row(links, [0, 0, 0], 0.1, i, link)
        write_row(people, [9, 0, 0], 0.1, i)
    if wrong == "slice of a link":
        links[0]["slice"][3] = 0
    elif wrong == "owner of a link":
        links[0]["owner"][3] = 0
    elif wrong == "begin of a slice":
        links[0]["first"][1] = 1
    else:
        write_row(links, [0, 0, 0], 0.1, 1, 1)
    by_boxes(links, people, ledger)
    left = ledger[0]["open"][:2, :2, 0].tolist()
    everything, last_slice, last_row = [[1, 1], [1, 1]], [[0, 0], [1, 1]], [[0, 0], [0, 1]]
    assert left == {"begin of a slice": last_slice, "a row too many": everything}.get(wrong, last_row)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("owner", -1), ("owner", MAX_PEOPLE), ("owner", MAX_PEOPLE + 1), ("model", -1), ("model", MAX_MODELS),
        ("slice", 1), ("slice", -1),
    ],
)  # fmt: skip
def test_one_row_of_people_that_makes_no_sense_keeps_its_whole_slice_open(field: str, value: int) -> None:
    links, people, ledger = blocks(2, 1, [1])
    for i in range(2):
        write_row(links, [0, 0, 0], 0.1, i)
        for _ in range(2):
            write_row(people, [9, 0, 0], 0.1, i)
    people[0][field][1] = value
    by_boxes(links, people, ledger)
    assert ledger[0]["open"][:2, 0, 0].tolist() == [1, 0]


@pytest.mark.parametrize(("far", "usable"), [(1e9, True), (np.nextafter(1e9, 2e9), False)])
def test_what_is_beyond_the_largest_length_is_nowhere(far: float, usable: bool) -> None:
    points = pair([0, 0, 0], 0.1, [[far, 0, 0], [far - 1.0, 0, 0]], 0.1)
    assert np.isfinite(by_boxes(*points)[0]) == usable
    radius = pair([2.1e9, 0, 0], 0.1, [0, 0, 0], far)
    radius[0][0]["points"][0, 0, 0] = 1e9
    radius[1][0]["points"][0, 0, 0] = -1e9
    assert np.isfinite(by_boxes(*radius)[0]) == usable


def test_more_links_than_a_ledger_holds_close_nothing() -> None:
    links, people, ledger = blocks(1, MAX_LINKS, [1])
    for link in range(MAX_LINKS + 1):
        write_row(links, [0, 0, 0], 0.1, 0, link)
    write_row(people, [9, 0, 0], 0.1)
    ledger[0]["n_links"] = MAX_LINKS + 1
    assert by_boxes(links, people, ledger)[0] == np.inf and ledger[0]["open"][0, :, 0].all()


def test_scratch_for_fewer_people_than_there_are_closes_nothing() -> None:
    links, people, ledger = blocks(1, 1, [1] * 3)
    write_row(links, [0, 0, 0], 0.1)
    for k in range(2):
        write_row(people, [9, 0, 0], 0.1, owner=k)
    found = np.full(3, -7, dtype=np.int64)
    assert prove_apart(links, people, ledger, 1e-4, np.zeros((3, 2, 3)), found) == np.inf
    assert ledger[0]["open"][0, 0, :3].all()
    assert prove_apart(links, people, ledger, 1e-4, np.zeros((4, 2, 3)), found) < np.inf
