"""The ledger: what one check may clear, what NaN and broken blocks may not, and what the answer says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy import kernels
from occupancy.engines import CoalEngine, FclEngine
from occupancy.separation import (
    LEDGER,
    Nearest,
    Separation,
    SeparationSettingError,
    new_ledger,
    open_obligations,
)
from occupancy.sets import (
    LINK_SETS,
    MAX_MODELS,
    MAX_PEOPLE,
    MAX_PEOPLE_SETS,
    PEOPLE_SETS,
    new_link_sets,
    new_people_sets,
)
from robots.enclosure import MAX_LINKS
from robots.motion import MAX_SLICES, Block
from tests.occupancy.pairs import KINDS
from tests.occupancy.scenes import blocks, pair, write_row

Array = NDArray[np.float64]
Count = Callable[[int], int]

FAR, HERE = [[9.0, 0, 0], [9.0, 1, 0]], [[0.05, 0, 0], [0.05, 1, 0]]
AXIS = [[0.0, 0, 0], [0.0, 1, 0], [0.0, 0, 0.01], [0.0, 1, 0.01]]


def still_open(ledger: Block) -> NDArray[np.uint32]:
    book = ledger[0]
    used: NDArray[np.uint32] = book["open"][: book["n_slices"], : book["n_links"], : book["n_people"]]
    return used


@pytest.fixture(scope="module")
def separation() -> Separation:
    return Separation()


@pytest.fixture(scope="module", params=[False, True], ids=["pairs", "boxes first"])
def either(request: pytest.FixtureRequest) -> Separation:
    return Separation(boxes_first=request.param)


def test_a_far_person_is_separated(separation: Separation) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    nearest = separation.check(links, people, ledger)
    assert nearest.separated and not still_open(ledger).any()
    assert (nearest.slice, nearest.link, nearest.people_row, nearest.person, nearest.parts) == (0, 0, 0, 0, 1)
    assert nearest.gap_m == pytest.approx(8.7, abs=1e-9) and nearest.gap_m <= 8.7
    np.testing.assert_allclose(nearest.direction, [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(nearest.link_point[0], 0.1, atol=1e-9)
    np.testing.assert_allclose(nearest.people_point[0], 8.8, atol=1e-9)
    assert np.isnan(nearest.disagreement_m) and nearest.gjk_calls == 0


def test_a_near_person_is_not(separation: Separation) -> None:
    links, people, ledger = pair(AXIS, 0.1, HERE, 0.2)
    nearest = separation.check(links, people, ledger)
    assert not nearest.separated and still_open(ledger)[0, 0, 0] == 1
    assert nearest.gap_m == pytest.approx(-0.25, abs=1e-6)
    assert nearest.unresolved == 0


@pytest.mark.parametrize("gap", [0.5e-4, 0.99e-4, 1.01e-4, 2e-4])
def test_the_margin_decides(gap: float) -> None:
    links, people, ledger = pair([[0, 0, 0]], 0.1, [[0.3 + gap, 0, 0]], 0.2)
    assert Separation(margin=1e-4).check(links, people, ledger).separated == (gap > 1e-4)


@pytest.mark.parametrize("link", [AXIS[:2], [[0.0, 0, 0]]])
@pytest.mark.parametrize("person", [FAR, [[9.0, 0, 0]]])
def test_a_gap_as_large_as_the_margin_is_not_enough(
    link: list[list[float]], person: list[list[float]]
) -> None:
    largest = Separation(margin=0.0).check(*pair(link, 0.1, person, 0.2)).gap_m
    links, people, ledger = pair(link, 0.1, person, 0.2)
    found = Separation(margin=largest).check(links, people, ledger)
    assert not found.separated and still_open(ledger)[0, 0, 0] == 1
    assert largest - 1e-14 < found.gap_m <= largest and found.gjk_calls == 0, "no direction is better"
    a_little_less = float(np.nextafter(largest, 0.0))
    assert Separation(margin=a_little_less).check(*pair(link, 0.1, person, 0.2)).separated


def expected_open(links: Block, people: Block, ledger: Block, apart: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """Plain reading of the rule; ``apart`` (link rows, people rows) says which rows are separated."""
    result = still_open(ledger).copy()
    rows, crowd = links[0], people[0]
    for i, link, k in np.ndindex(result.shape):
        of_link = [a for a in range(rows["n"]) if rows["slice"][a] == i and rows["owner"][a] == link]
        of_person = [b for b in range(crowd["n"]) if crowd["slice"][b] == i and crowd["owner"][b] == k]
        for part in range(16):
            for model in range(MAX_MODELS):
                holding = [
                    b for b in of_person if crowd["model"][b] == model and crowd["covers"][b] >> part & 1
                ]
                if holding and of_link and all(apart[a, b] for a in of_link for b in holding):
                    result[i, link, k] &= ~np.uint32(1 << part)
    return result


def test_ledger_against_a_plain_reading_of_the_rule(
    separation: Separation, rng: np.random.Generator, count: Count
) -> None:
    separated = 0
    for _ in range(count(10_000)):
        n_slices, n_links, n_people = (int(rng.integers(1, m)) for m in (4, 4, 4))
        links, people, ledger = blocks(n_slices, n_links, [0] * n_people)
        still_open(ledger)[:] = rng.integers(0, 8, still_open(ledger).shape)
        sides: list[Array] = [[], []]
        for i in range(n_slices):
            for _ in range(int(rng.integers(0, 5))):
                near = rng.random() < 0.15
                write_row(links, [[0, 0, 0.0 if near else 50.0]], 0.1, i, int(rng.integers(n_links)))
                sides[0].append(near)
            for _ in range(int(rng.integers(0, 6))):
                near = rng.random() < 0.3
                covers, model = int(rng.integers(1, 8)), int(rng.integers(0, 3))
                owner = int(rng.integers(n_people))
                write_row(people, [[0, 0, 0.0 if near else 9.0]], 0.1, i, owner, covers, model)
                sides[1].append(near)
        apart = ~np.outer(np.array(sides[0], bool), np.array(sides[1], bool))
        before = still_open(ledger).copy()
        expected = expected_open(links, people, ledger, apart)
        nearest = separation.check(links, people, ledger)
        np.testing.assert_array_equal(still_open(ledger), expected)
        assert nearest.separated == (not expected.any())
        separated += nearest.separated and bool(before.any())
        check_answer(nearest, before, expected, people)
    assert separated > 0


def check_answer(
    nearest: Nearest, before: NDArray[np.uint32], after: NDArray[np.uint32], people: Block
) -> None:
    if not before.any():
        assert nearest.gap_m == np.inf and nearest.people_row == -1
        return
    bits = before & ~after if nearest.separated else after
    assert nearest.parts & int(bits[nearest.slice, nearest.link, nearest.person])
    if not nearest.separated:
        assert nearest.slice == np.argwhere(after)[0][0]
        assert nearest.gap_m <= 1e-4
    if nearest.people_row >= 0:
        assert people[0]["owner"][nearest.people_row] == nearest.person
        assert people[0]["slice"][nearest.people_row] == nearest.slice
        assert np.isfinite(nearest.gap_m)
    else:
        assert nearest.gap_m == -np.inf


def scattered(rng: np.random.Generator) -> tuple[Block, Block, Block]:
    """Links near each other, people with rows of several models at many distances, parts left out."""
    n_slices, n_links, n_people = (int(rng.integers(1, m)) for m in (5, 5, 4))
    links, people, ledger = blocks(n_slices, n_links, rng.integers(1, 8, n_people).tolist())
    places = rng.uniform(-1, 1, (n_people, 3)) + rng.uniform(0, 4, (n_people, 1)) * np.array([1.0, 0, 0])
    for i in range(n_slices):
        for link in range(n_links):
            write_row(links, rng.uniform(-0.5, 0.5, (4, 3)), 0.1, i, link)
        for k in range(n_people):
            for _ in range(int(rng.integers(0, 4))):
                points = places[k] + rng.uniform(-0.3, 0.3, (int(rng.integers(1, 4)), 3))
                covers, model = int(rng.integers(1, 8)), int(rng.integers(0, 3))
                write_row(people, points, float(rng.uniform(0, 0.3)), i, k, covers, model)
    return links, people, ledger


def test_boxes_first_prove_the_same_with_a_gap_that_is_no_larger(
    separation: Separation, rng: np.random.Generator, count: Count
) -> None:
    quick = Separation(boxes_first=True)
    both = separated = 0
    for _ in range(count(20_000)):
        links, people, ledger = scattered(rng)
        twin = ledger.copy()
        exact, coarse = separation.check(links, people, ledger), quick.check(links, people, twin)
        np.testing.assert_array_equal(still_open(twin), still_open(ledger))
        assert coarse.separated == exact.separated
        if exact.separated:
            assert separation.margin < coarse.gap_m <= exact.gap_m
            separated += 1
            both += coarse.people_row >= 0
        else:
            assert (coarse.slice, coarse.link, coarse.person) == (exact.slice, exact.link, exact.person)
            assert coarse.gap_m == pytest.approx(exact.gap_m, nan_ok=True)
    assert separated > both and separated > 0


def test_boxes_leave_to_the_pairs_what_they_cannot_keep_apart() -> None:
    quick = Separation(boxes_first=True)
    diagonal = [[0.0, 0, 0], [2.0, 2.0, 0.0]]
    links, people, ledger = pair(diagonal, 0.1, [[2.0, 0.5, 0]], 0.1)
    assert quick.check(links, people, ledger).people_row == 0
    links, people, ledger = pair(diagonal, 0.1, [[2.5, 0.5, 0]], 0.1)
    found = quick.check(links, people, ledger)
    assert found.separated and found.people_row == -1 and found.gap_m == pytest.approx(0.3, abs=1e-9)
    assert (found.slice, found.link, found.person, found.model, found.parts) == (0, 0, 0, -1, 0)
    assert (found.gjk_calls, found.unresolved) == (0, 0) and np.isnan(found.disagreement_m)
    assert np.isnan([found.direction, found.link_point, found.people_point]).all()


def test_slice_link_and_person_are_named_each_in_its_place(either: Separation) -> None:
    links, people, ledger = blocks(2, 3, [1] * 4)
    for i in range(2):
        for link in range(3):
            write_row(links, [0.0, 0.0, -10.0 * (2 - link) - 100.0 * (1 - i)], 0.1, i, link)
        for k in range(4):
            write_row(people, [0.0, 0.0, 2.0 + 10.0 * (3 - k)], 0.2, i, k)
    nearest = either.check(links, people, ledger)
    assert nearest.separated and (nearest.slice, nearest.link, nearest.person) == (1, 2, 3)
    assert nearest.gap_m == pytest.approx(1.7, abs=1e-9)


def test_the_tightest_pair_is_found(separation: Separation, rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(5_000)):
        n_slices, n_links = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        links, people, ledger = blocks(n_slices, n_links, [1])
        gaps = []
        for i in range(n_slices):
            centres = rng.uniform(-1, 1, (n_links, 3))
            for link in range(n_links):
                write_row(links, centres[link], 0.1, i, link)
            for _ in range(int(rng.integers(1, 5))):
                at = rng.uniform(-1, 1, 3) + np.array([4, 0, 0])
                write_row(people, at, 0.2, i)
                gaps += [(np.linalg.norm(at - c) - 0.3, i, link) for link, c in enumerate(centres)]
        nearest = separation.check(links, people, ledger)
        gap, i, link = min(gaps)
        assert nearest.separated
        assert (nearest.slice, nearest.link) == (i, link)
        assert gap - 1e-9 <= nearest.gap_m <= gap


def test_nearest_blocking_pair_of_the_first_open_slice(separation: Separation) -> None:
    links, people, ledger = blocks(3, 1, [3])
    for i, depths in enumerate([(1.0, 1.0), (0.25, 0.2), (0.0, 0.1)]):
        write_row(links, [[0, 0, 0]], 0.1, i)
        for part, distance in enumerate(depths):
            write_row(people, [[distance, 0, 0]], 0.2, i, covers=1 << part)
    nearest = separation.check(links, people, ledger)
    assert not nearest.separated
    assert (nearest.slice, nearest.parts, nearest.people_row) == (1, 2, 3)
    assert nearest.gap_m == pytest.approx(-0.1, abs=1e-9)
    np.testing.assert_array_equal(still_open(ledger)[:, 0, 0], [0, 3, 3])


def test_one_model_suffices_and_two_halves_do_not(either: Separation) -> None:
    links, people, ledger = blocks(1, 1, [0b11])
    write_row(links, AXIS, 0.1)
    for model, (first, second) in enumerate([(HERE, FAR), (FAR, HERE)]):
        write_row(people, first, 0.1, covers=0b01, model=model)
        write_row(people, second, 0.1, covers=0b11, model=model)
    assert not either.check(links, people, ledger).separated
    # part 0 has a near row in each model; part 1 has one only in the second
    assert still_open(ledger)[0, 0, 0] == 0b01


def test_nobody_in_the_rows_proves_nothing(either: Separation) -> None:
    links, people, ledger = blocks(2, 1, [5])
    write_row(links, AXIS, 0.1, 0)
    write_row(links, AXIS, 0.1, 1)
    nearest = either.check(links, people, ledger)
    assert not nearest.separated and (still_open(ledger) == 5).all()
    assert nearest.people_row == -1 and nearest.gap_m == -np.inf
    assert (nearest.slice, nearest.link, nearest.person, nearest.parts) == (0, 0, 0, 5)


def test_no_link_rows_prove_nothing(either: Separation) -> None:
    links, people, ledger = blocks(1, 1, [1])
    write_row(people, FAR, 0.1)
    assert not either.check(links, people, ledger).separated


def test_a_part_in_no_row_stays_open(either: Separation) -> None:
    links, people, ledger = blocks(1, 1, [0b111])
    write_row(links, AXIS, 0.1)
    write_row(people, FAR, 0.1, covers=0b101)
    assert not either.check(links, people, ledger).separated
    assert still_open(ledger)[0, 0, 0] == 0b010


def test_links_with_nothing_open_are_skipped(separation: Separation) -> None:
    links, people, ledger = blocks(1, 2, [1])
    write_row(links, AXIS, 0.1, owner=0)
    write_row(links, np.array(AXIS) + np.array([50, 0, 0]), 0.1, owner=1)
    write_row(people, HERE, 0.1)
    still_open(ledger)[0, 0, 0] = 0
    nearest = separation.check(links, people, ledger)
    assert nearest.separated and nearest.link == 1


# -- nothing is ever proven from input that is not a number --

ROW_FIELDS = [
    ("points", (0, 0, 0)),
    ("points", (0, 1, 1)),
    ("points", (0, 0, 2)),
    ("radius", (0,)),
]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize(("field", "index"), ROW_FIELDS)
@pytest.mark.parametrize("side", ["links", "people"])
def test_a_number_that_is_not_usable_proves_nothing(
    either: Separation, side: str, field: str, index: tuple[int, ...], value: float
) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    (links if side == "links" else people)[0][field][index] = value
    nearest = either.check(links, people, ledger)
    assert not nearest.separated and still_open(ledger)[0, 0, 0] == 1
    assert nearest.gap_m == -np.inf


@pytest.mark.parametrize("side", ["links", "people"])
@pytest.mark.parametrize(
    ("field", "index", "value"),
    [
        ("n_points", (0,), 0),
        ("n_points", (0,), -1),
        ("n_points", (0,), 5),
        ("radius", (0,), -0.1),
        ("slice", (0,), 1),
        ("owner", (0,), -1),
        ("owner", (0,), 1),
        ("owner", (0,), 1000),
        ("first", (0,), 1),
        ("first", (1,), 0),
        ("first", (1,), 2),
        ("first", (1,), -1),
        ("n", (), 0),
        ("n", (), 2),
        ("n", (), -1),
        ("n", (), 10**9),
    ],
)
def test_broken_rows_prove_nothing(
    either: Separation, side: str, field: str, index: tuple[int, ...], value: int
) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    record = (links if side == "links" else people)[0]
    if index:
        record[field][index] = value
    else:
        record[field] = value
    assert not either.check(links, people, ledger).separated
    assert still_open(ledger)[0, 0, 0] == 1


@pytest.mark.parametrize("model", [-1, MAX_MODELS, 127])
def test_unknown_models_prove_nothing(either: Separation, model: int) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    people[0]["model"][0] = model
    assert not either.check(links, people, ledger).separated


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *[("n_slices", MAX_SLICES + 1), ("n_links", MAX_LINKS + 1), ("n_people", 17)],
        *[("n_slices", -1), ("n_links", -1), ("n_people", -1)],
    ],
)
def test_a_ledger_that_does_not_fit_the_rows_keeps_its_bits(
    either: Separation, field: str, value: int
) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    ledger[0]["open"][:] = 1
    ledger[0][field] = value
    assert not either.check(links, people, ledger).separated
    assert (ledger[0]["open"] == 1).all()


@pytest.mark.parametrize("lacking", ["n_links", "n_people"])
def test_without_links_or_people_nothing_is_undecided(lacking: str) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    ledger[0][lacking] = 0
    separation = Separation()
    assert kernels.classify(links, people, ledger, 1e-4, separation._pairs, separation._scratch) == 0
    nearest = separation.check(links, people, ledger)
    assert nearest.separated and nearest.gap_m == np.inf and nearest.people_row == -1


def test_which_rows_are_in_order(rng: np.random.Generator, count: Count) -> None:
    """Those that lie slice by slice from 0 on, as many as are said to be there and no more than fit."""
    seen = {True: 0, False: 0}
    for _ in range(max(2_000, count(100_000))):
        n_slices, n_max = int(rng.integers(-1, 7)), int(rng.integers(0, 5))
        first = np.cumsum([0, *rng.integers(0, 2, 5)]) + np.where(rng.random(6) < 0.1, -1, 0)
        n = int(first[n_slices] if 0 <= n_slices < 6 and rng.random() < 0.8 else rng.integers(-1, 5))
        rows = [range(first[i], first[i + 1]) for i in range(min(n_slices, 5))]
        expected = 0 <= n_slices < 6 and 0 <= n <= n_max and first[0] == 0 and first[max(n_slices, 0)] == n
        expected = expected and all(r.start <= r.stop for r in rows)
        assert kernels.in_order(first, n, n_slices, n_max) == expected, (first, n, n_slices, n_max)
        seen[bool(expected)] += 1
    assert min(seen.values()) > 100, seen


def test_rows_of_an_earlier_plan_are_refused(either: Separation) -> None:
    links, people, ledger = blocks(2, 1, [1])
    write_row(links, AXIS, 0.1)
    write_row(people, FAR, 0.1)
    links[0]["first"][2:], people[0]["first"][2:] = 2, 2  # as if slice 1 still had its old row
    assert not either.check(links, people, ledger).separated
    assert (still_open(ledger) == 1).all()


def test_a_ledger_of_full_size(either: Separation) -> None:
    links, people, ledger = blocks(MAX_SLICES, MAX_LINKS, [1] * MAX_PEOPLE)
    for i in range(MAX_SLICES):
        for link in range(MAX_LINKS):
            write_row(links, AXIS, 0.1, i, link)
        for k in range(MAX_PEOPLE):
            write_row(people, FAR, 0.1, i, k)
    nearest = either.check(links, people, ledger)
    assert nearest.separated and not ledger[0]["open"].any()
    people[0]["points"][people[0]["n"] - 1, :2] = HERE
    ledger[0]["open"][-1] = 1
    nearest = either.check(links, people, ledger)
    assert not nearest.separated and nearest.slice == MAX_SLICES - 1
    assert (ledger[0]["open"][-1] == [0] * (MAX_PEOPLE - 1) + [1]).all() and not ledger[0]["open"][:-1].any()


@pytest.mark.parametrize(("owner", "instead"), [(-1, MAX_PEOPLE - 1), (MAX_PEOPLE, 0)])
def test_a_row_of_nobody_stands_for_nobody(either: Separation, owner: int, instead: int) -> None:
    links, people, ledger = blocks(1, 1, [1] * MAX_PEOPLE)
    write_row(links, AXIS, 0.1)
    for k in range(MAX_PEOPLE):
        write_row(people, FAR, 0.1, owner=owner if k == instead else k)
    assert not either.check(links, people, ledger).separated
    assert still_open(ledger)[0, 0, instead] == 1


def test_a_row_of_no_link_stands_for_none(either: Separation) -> None:
    links, people, ledger = blocks(1, MAX_LINKS, [1])
    for link in range(MAX_LINKS):
        write_row(links, AXIS, 0.1, owner=link if link < MAX_LINKS - 1 else -1)
    write_row(people, FAR, 0.1)
    assert not either.check(links, people, ledger).separated
    assert still_open(ledger)[0, MAX_LINKS - 1, 0] == 1


@pytest.mark.parametrize("one_more", [0, 1])
@pytest.mark.parametrize("of_links", [(MAX_SLICES * MAX_LINKS,), (MAX_SLICES * MAX_LINKS - 1, 1)])
def test_as_many_pairs_as_there_is_room_for_and_some_more(
    separation: Separation, of_links: tuple[int, ...], one_more: int
) -> None:
    links, people, ledger = blocks(len(of_links), 1, [1])
    of_people = [*[MAX_PEOPLE_SETS] * (len(of_links) - 1), MAX_PEOPLE_SETS + one_more]
    for block, numbers, points in ((links, of_links, AXIS[:2]), (people, of_people, FAR)):
        rows, n = block[0], sum(numbers)
        rows["n"], rows["first"][1:] = n, n
        rows["first"][: len(numbers) + 1] = np.cumsum([0, *numbers])
        rows["slice"][:n] = np.repeat(np.arange(len(numbers)), numbers)
        rows["points"][:n, :2], rows["n_points"][:n], rows["radius"][:n], rows["covers"][:n] = (
            points,
            2,
            0.1,
            1,
        )
    assert separation.check(links, people, ledger).separated == (one_more == 0)
    assert still_open(ledger)[-1, 0, 0] == one_more


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_kernels_on_numbers_that_are_not_usable(bad: float) -> None:
    a, b = np.array(AXIS), np.array(FAR)
    for side in (a, b):
        for index in np.ndindex(side.shape):
            kept, side[index] = side[index], bad
            assert np.isnan(kernels.certificate(a, 4, b, 2, 1.0, 0.0, 0.0)[0])
            side[index] = kept
    for n in ([bad, 0, 0], [0, bad, 0], [0, 0, bad]):
        assert not kernels.certificate(a, 4, b, 2, *n)[0] > 0.0
    whole = np.array([0.0, 0, 0, 1, 1])
    for k in range(5):
        broken = np.array([9.0, 0, 0, 1, 1])
        broken[k] = np.nan
        assert not kernels.ball_gap(whole, broken) > 0.0
        assert not kernels.ball_gap(broken, whole) > 0.0


@pytest.mark.parametrize(
    "direction",
    # the square of 2.7e-162 is rounded by a third: the length would come out too small, and the gap too large
    [(np.nan, 0, 0), (0, 0, 0), (np.inf, 0, 0), (1e-200, 0, 0), (2.7e-162, 0, 0), (-1, 0, 0)],
)
def test_a_proposed_direction_that_is_no_good_proves_nothing(
    separation: Separation, direction: tuple[float, ...]
) -> None:
    links, people, ledger = pair(AXIS, 0.1, FAR, 0.2)
    separation.check(links, people, ledger)
    gap = kernels.certified_gap(links, people, separation._pairs, 0, 0, np.array(direction, dtype=float))
    assert not gap > 0.0
    twice = kernels.certified_gap(links, people, separation._pairs, 0, 0, np.array([2.0, 0, 0]))
    assert 8.7 - 1e-9 < twice <= 8.7


@pytest.mark.parametrize("margin", [np.nan, np.inf, -1e-4])
def test_margins_that_are_refused(margin: float) -> None:
    with pytest.raises(SeparationSettingError, match="margin"):
        Separation(margin=margin)


def test_other_settings_that_are_refused() -> None:
    with pytest.raises(SeparationSettingError, match="GJK calls"):
        Separation(gjk_limit=-1)
    for n_slices, n_links, parts in ((65, 1, [1]), (1, 25, [1]), (1, 1, [1] * 17), (-1, 1, [1])):
        with pytest.raises(SeparationSettingError, match="a ledger holds"):
            open_obligations(new_ledger(), n_slices, n_links, parts)


@pytest.mark.parametrize("sizes", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (3, 2, 2)])
def test_a_ledger_that_is_opened_again_has_no_other_obligations(sizes: tuple[int, int, int]) -> None:
    ledger = new_ledger()
    open_obligations(ledger, MAX_SLICES, MAX_LINKS, [7] * MAX_PEOPLE)
    assert (ledger[0]["open"] == 7).all()
    open_obligations(ledger, sizes[0], sizes[1], [4] * sizes[2])
    assert ledger[0]["open"].sum() == 4 * np.prod(sizes) and still_open(ledger).shape == sizes


# -- what is left to the engine --


class Blind(CoalEngine):
    """Proposes a fixed direction and counts how often it is asked."""

    def __init__(self, direction: Array) -> None:
        super().__init__()
        self.direction, self.asked = direction, 0

    def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
        self.asked += 1
        return self.direction, 1e6


def undecide(separation: Separation, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave every pair to the engine, as if the compiled pass had found no direction."""
    compiled = kernels.classify

    def classify(
        links: Block, people: Block, ledger: Block, margin: float, pairs: Block, scratch: Block
    ) -> int:
        compiled(links, people, ledger, margin, pairs, scratch)
        n = int(pairs[0]["offset"][-1])
        pairs[0]["state"][:n] = np.where(pairs[0]["state"][:n] > 0, kernels.UNDECIDED, 0)
        pairs[0]["gap"][:n] = -np.inf
        return int((pairs[0]["state"][:n] == kernels.UNDECIDED).sum())

    monkeypatch.setattr(kernels, "classify", classify)


def three_slices(first_is_far: bool = True) -> tuple[Block, Block, Block]:
    links, people, ledger = blocks(3, 1, [1])
    for i in range(3):
        write_row(links, AXIS, 0.1, i)
        write_row(people, FAR if first_is_far or i else HERE, 0.1, i)
    return links, people, ledger


def test_a_bad_proposal_costs_the_proof_and_a_good_one_gives_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for direction, proven in (
        ([1.0, 0, 0], True),
        ([0, 1.0, 0], False),
        ([np.nan] * 3, False),
        ([0.0] * 3, False),
    ):
        separation = Separation(engine=Blind(np.array(direction)))
        with monkeypatch.context() as patch:
            undecide(separation, patch)
            nearest = separation.check(*three_slices())
        assert nearest.separated == proven
        assert nearest.unresolved == 0 and nearest.gjk_calls == 3


def test_a_single_pair_that_is_undecided_is_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    separation = Separation(engine=Blind(np.array([1.0, 0, 0])))
    undecide(separation, monkeypatch)
    nearest = separation.check(*pair(AXIS, 0.1, FAR, 0.2))
    assert nearest.separated and (nearest.gjk_calls, nearest.unresolved) == (1, 0)


@pytest.mark.parametrize("side", [0, 1])
def test_the_engine_is_not_asked_about_rows_that_are_not_usable(side: int) -> None:
    """They prove nothing, and where they meet cannot be improved."""
    engine = Blind(np.array([1.0, 0, 0]))
    separation = Separation(engine=engine, gjk_limit=1)
    across = [[-0.05, 0.5, 0], [0.05, 0.5, 0]]
    blocks_of = pair(AXIS, 0.1, across, 0.2)
    blocks_of[side]["radius"][0, 0] = np.nan
    nearest = separation.check(*blocks_of)
    assert not nearest.separated and nearest.gap_m == -np.inf and engine.asked == 0
    assert not np.isfinite(nearest.direction).any()
    separation.check(*pair(AXIS, 0.1, across, 0.2))
    assert engine.asked == 1, "where usable rows meet it is"


def test_no_more_calls_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    for limit in (0, 1, 2, 3):
        separation = Separation(engine=Blind(np.array([1.0, 0, 0])), gjk_limit=limit)
        with monkeypatch.context() as patch:
            undecide(separation, patch)
            nearest = separation.check(*three_slices())
        assert nearest.gjk_calls == limit and nearest.unresolved == 3 - limit
        assert nearest.separated == (limit == 3)


def test_calls_that_were_used_up_come_back_when_they_are_renewed(monkeypatch: pytest.MonkeyPatch) -> None:
    separation = Separation(engine=Blind(np.array([1.0, 0, 0])), gjk_limit=4)
    undecide(separation, monkeypatch)
    for calls in (3, 1, 0):
        nearest = separation.check(*three_slices())
        assert nearest.gjk_calls == calls and nearest.separated == (calls == 3)
    separation.renew()
    assert separation.check(*three_slices()).separated


def test_slices_after_the_first_open_one_are_worked_on_too(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = Blind(np.array([1.0, 0, 0]))
    separation = Separation(engine=engine)
    undecide(separation, monkeypatch)
    links, people, ledger = three_slices(first_is_far=False)
    nearest = separation.check(links, people, ledger)
    assert nearest.gjk_calls == 3 and nearest.slice == 0 and nearest.unresolved == 0
    assert still_open(ledger).ravel().tolist() == [1, 0, 0]
    proven = separation.proven()
    assert proven.slice in (1, 2) and proven.gap_m > 0.0 and not proven.separated


def test_both_engines_at_run_time(rng: np.random.Generator) -> None:
    separation = Separation(cross_check=FclEngine())
    for kind in ("swept", "crossing", "random"):
        a, b = KINDS[kind](rng)
        nearest = separation.check(*pair(a, 0.05, b, 0.05))
        assert 0.0 <= nearest.disagreement_m < 1e-3

    class Wrong(FclEngine):
        def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
            direction, distance = super().propose(points_a, points_b)
            return direction, distance + 0.25

    nearest = Separation(cross_check=Wrong()).check(*pair(AXIS, 0.1, [[1.0, 0, 0], [1, 1, 0]], 0.1))
    assert nearest.separated and nearest.disagreement_m == pytest.approx(0.25, abs=1e-4)
    links, people, ledger = blocks(3, 1, [1])
    for i, distance in enumerate((9.0, 9.0, 1.0)):  # what is far is not compared
        write_row(links, AXIS, 0.1, i)
        write_row(people, [[distance, 0, 0], [distance, 1, 0]], 0.1, i)
    nearest = Separation(cross_check=Wrong()).check(links, people, ledger)
    assert nearest.separated and nearest.disagreement_m == pytest.approx(0.25, abs=1e-4)


@pytest.mark.parametrize(
    ("person", "radius", "asked"),
    [
        ([[0.2, 0.5, 0.0]], 0.2, 0),  # overlap of 0.1 m, but the hulls are 0.2 m apart
        ([[0.2, 0.5, 0.0]], np.nan, 0),
        ([[0.05, np.nan, 0.0]], 0.2, 0),
        ([[-0.5, 0.5, 0.005], [0.5, 0.5, 0.005]], 0.2, 1),
        ([[0.0, 0.5, 0.005]], 0.0, 1),
    ],
)
def test_the_engine_is_asked_once_about_hulls_that_meet_and_about_no_others(
    person: list[list[float]], radius: float, asked: int
) -> None:
    engine = Blind(np.array([1.0, 0, 0]))
    assert not Separation(engine=engine).check(*pair(AXIS, 0.1, person, radius)).separated
    assert engine.asked == asked
    for limit in (0, 1):
        limited = Blind(np.array([1.0, 0, 0]))
        Separation(engine=limited, gjk_limit=limit).check(*pair(AXIS, 0.1, person, radius))
        assert limited.asked == min(limit, asked)


@pytest.mark.parametrize("depth", [0.0, 0.05])
def test_crossing_segments_part_soonest_along_their_common_normal(
    separation: Separation, depth: float
) -> None:
    along_x, along_y = [[-1.0, 0, 0], [1.0, 0, 0]], [[0, -1.0, depth], [0, 1.0, depth]]
    nearest = separation.check(*pair(along_x, 0.1, along_y, 0.2))
    assert nearest.gap_m == pytest.approx(depth - 0.3, abs=1e-9) and nearest.gap_m <= depth - 0.3
    up = nearest.direction[2]
    np.testing.assert_allclose(np.abs(nearest.direction), [0, 0, 1], atol=1e-9)
    assert nearest.link_point[2] == pytest.approx(0.1 * up, abs=1e-9)
    assert nearest.people_point[2] == pytest.approx(depth - 0.2 * up, abs=1e-9)


# -- metamorphic laws --


def test_larger_rows_never_prove_more(separation: Separation, rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(10_000)):
        a, b = KINDS["swept"](rng)
        small = separation.check(*pair(a, 0.05, b, 0.1))
        large = separation.check(*pair(a, 0.05, b, 0.1 + rng.uniform(0, 0.2)))
        assert small.separated or not large.separated


def test_turning_everything_changes_nothing(
    separation: Separation, rng: np.random.Generator, count: Count
) -> None:
    from scipy.spatial.transform import Rotation

    for _ in range(count(10_000)):
        a, b = KINDS["swept"](rng)
        turn = Rotation.random(random_state=rng)
        still = separation.check(*pair(a, 0.05, b, 0.1))
        turned = separation.check(*pair(turn.apply(a), 0.05, turn.apply(b), 0.1))
        if abs(still.gap_m - 1e-4) > 1e-8:
            assert turned.separated == still.separated
        if still.separated:
            assert turned.gap_m == pytest.approx(still.gap_m, abs=1e-8)


def test_blocks_are_what_the_interface_says() -> None:
    assert LINK_SETS.names == PEOPLE_SETS.names
    assert LINK_SETS["points"].shape == (MAX_SLICES * MAX_LINKS, 4, 3)
    assert LEDGER["open"].shape == (MAX_SLICES, MAX_LINKS, MAX_PEOPLE)
    assert new_link_sets()[0]["n"] == 0 and new_people_sets()[0]["n"] == 0
