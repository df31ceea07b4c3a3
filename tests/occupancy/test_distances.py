"""Certified gaps and engine distances against distances found by going through all features."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy import kernels
from occupancy.engines import CoalEngine, Engine, FclEngine
from occupancy.separation import Separation, new_scratch
from tests.occupancy.pairs import KINDS, MEETING
from tests.occupancy.scenes import pair
from tests.oracles.hulls import distance, pad, point_segment, segment_segment

Array = NDArray[np.float64]
Count = Callable[[int], int]

FULL = 120_000


def sample(kind: str, rng: np.random.Generator, n: int) -> tuple[list[tuple[Array, Array]], Array]:
    hulls = [KINDS[kind](rng) for _ in range(n)]
    exact = distance(np.array([pad(a) for a, _ in hulls]), np.array([pad(b) for _, b in hulls]))
    return hulls, np.zeros(n) if kind in MEETING else exact


@pytest.mark.parametrize("kind", KINDS)
def test_certified_gap_is_never_above_the_exact_one_and_clear_pairs_are_proven(
    kind: str, rng: np.random.Generator, count: Count
) -> None:
    hulls, exact = sample(kind, rng, count(FULL // len(KINDS)))
    separation = Separation(margin=1e-4)
    for (a, b), apart in zip(hulls, exact, strict=True):
        radius_a, radius_b = rng.uniform(0.0, 0.2, size=2) * rng.choice([0.0, 1.0])
        gap = apart - radius_a - radius_b
        links, people, ledger = pair(a, radius_a, b, radius_b)
        nearest = separation.check(links, people, ledger)
        assert nearest.gap_m <= gap + (1e-14 if kind in MEETING else 0.0), (a, b)  # placed up to rounding
        assert nearest.separated == (ledger[0]["open"][0, 0, 0] == 0)
        assert nearest.separated == (nearest.gap_m > 1e-4)
        if nearest.separated:
            assert gap > 1e-4, (a, b)
        if gap > 1e-4 + 1e-7 * (1.0 + apart):
            assert nearest.separated, (a, b)
        assert np.isfinite(nearest.gap_m), (a, b)
        if gap > 1e-6:
            assert nearest.gap_m >= gap - 1e-7 * (1.0 + apart), (a, b)


@pytest.mark.parametrize("engine", [CoalEngine(), FclEngine()], ids=lambda engine: engine.name)
@pytest.mark.parametrize("kind", KINDS)
def test_engines_agree_and_propose_directions_that_prove(
    kind: str, engine: Engine, rng: np.random.Generator, count: Count
) -> None:
    """Nothing that is proven is wrong, whatever the engine says; python-fcl is a little off now and then."""
    hulls, exact = sample(kind, rng, count(FULL // len(KINDS)))
    clear = proven = agreed = 0
    for (a, b), apart in zip(hulls, exact, strict=True):
        direction, claimed = engine.propose(a, b)
        agreed += abs(max(0.0, claimed) - apart) <= 1e-4 * (1.0 + apart)
        if apart > 1e-3:
            unit = direction / np.linalg.norm(direction)
            certified = kernels.certificate(a, len(a), b, len(b), *unit)[0]
            assert certified <= apart + 1e-12 * (1.0 + np.abs(a).max() + np.abs(b).max()), (a, b)
            clear += 1
            proven += bool(certified >= apart - 1e-3 * (1.0 + apart))
    share = 1.0 if engine.name == "coal" else 0.98
    assert agreed >= share * len(hulls)
    assert proven >= share * clear


def test_certificate_is_below_the_exact_projection(rng: np.random.Generator, count: Count) -> None:
    """In rational arithmetic: the slack covers rounding, also of a direction that is not quite unit."""
    for _ in range(max(200, count(5_000))):
        kind = rng.choice(list(KINDS))
        a, b = KINDS[str(kind)](rng)
        scale = 10.0 ** rng.uniform(-3, 3)
        a, b = a * scale, b * scale
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        size = float(np.abs(a).max() + np.abs(b).max())
        certified = Fraction(float(kernels.certificate(a, len(a), b, len(b), *n)[0])) - Fraction(
            kernels.ROUNDING * size
        )
        exact_n = [Fraction(float(x)) for x in n]
        length2 = sum(x * x for x in exact_n)
        low = min(sum(x * Fraction(float(y)) for x, y in zip(exact_n, p, strict=True)) for p in b)
        high = max(sum(x * Fraction(float(y)) for x, y in zip(exact_n, p, strict=True)) for p in a)
        between = low - high
        # certified <= between / |n|, without a square root
        if certified > 0:
            assert between > 0 and certified**2 * length2 <= between**2
        elif between < 0:
            assert certified**2 * length2 >= between**2


def test_segments(rng: np.random.Generator, count: Count) -> None:
    for kind in ("parallel", "collinear", "random", "degenerate", "swept"):
        for _ in range(count(20_000)):
            a, b = KINDS[kind](rng)
            a0, a1, b0, b1 = a[0], a[-1], b[0], b[-1]
            s, t = kernels.segment_parameters(a0, a1, b0, b1)
            assert 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0
            found = np.linalg.norm(a0 + s * (a1 - a0) - b0 - t * (b1 - b0))
            best = float(segment_segment(a0, a1, b0, b1))
            assert found == pytest.approx(best, abs=1e-5), (a0, a1, b0, b1)


@pytest.mark.parametrize(
    ("b0", "b1", "expected"),
    [
        ((0, 1, 0), (1, 1, 0), 1.0),  # parallel, side by side
        ((3, 0, 0), (5, 0, 0), 2.0),  # collinear, behind each other
        ((0.5, 0, 0), (5, 0, 0), 0.0),  # collinear, overlapping
        ((3, 4, 0), (2, 4, 0), np.hypot(1, 4)),  # parallel, opposite, beyond the end
        ((0.5, 2, -1), (0.5, 2, 1), 2.0),  # crossing at a distance
        ((4, 4, 0), (4, 4, 0), 5.0),  # a point
    ],
)
def test_segments_with_known_distance(b0: tuple[float, ...], b1: tuple[float, ...], expected: float) -> None:
    a0, a1 = np.zeros(3), np.array([1.0, 0.0, 0.0])
    c0, c1 = np.array(b0, dtype=float), np.array(b1, dtype=float)
    s, t = kernels.segment_parameters(a0, a1, c0, c1)
    assert np.linalg.norm(a0 + s * (a1 - a0) - c0 - t * (c1 - c0)) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("power", [-12, 12])
def test_segments_of_another_size_have_the_same_parameters(
    power: int, rng: np.random.Generator, count: Count
) -> None:
    """Powers of two change no rounding."""
    for kind in ("random", "parallel", "swept"):
        for _ in range(count(2_000)):
            a, b = KINDS[kind](rng)
            ends = np.array([a[0], a[-1], b[0], b[-1]])
            expected = kernels.segment_parameters(*ends)
            assert kernels.segment_parameters(*(ends * 2.0**power)) == expected


def test_first_guess_is_of_the_middle_of_a_swept_axis(rng: np.random.Generator, count: Count) -> None:
    s = new_scratch()[0]
    for _ in range(max(200, count(5_000))):
        n_a, n_b = (int(n) for n in rng.integers(1, 5, 2))
        a, b = rng.normal(size=(2, 4, 3))
        first, last = (0.5 * (a[0] + a[2]), 0.5 * (a[1] + a[3])) if n_a == 4 else (a[0], a[n_a - 1])
        kernels.witness(a, n_a, b, n_b, s)
        best = float(segment_segment(first, last, b[0], b[n_b - 1]))
        assert np.linalg.norm(s["point_b"] - s["point_a"]) == pytest.approx(best, abs=1e-7)
        assert point_segment(s["point_a"], first, last) < 1e-12
        assert point_segment(s["point_b"], b[0], b[n_b - 1]) < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_bracket_of_a_distance(kind: str, rng: np.random.Generator, count: Count) -> None:
    """Certified below, attained above, and hardly anything between; without radii."""
    separation = Separation()
    hulls, exact = sample(kind, rng, count(FULL // len(KINDS) // 4))
    for (a, b), apart in zip(hulls, exact, strict=True):
        blocks = pair(a, 0.1, b, 0.2)
        separation.check(*blocks)
        low, high = kernels.hull_distance(blocks[0], blocks[1], separation._pairs, 0, 0, separation._scratch)
        size = float(np.abs(a).max() + np.abs(b).max())
        assert 0.0 <= low <= apart + (1e-14 if kind in MEETING else 0.0), (a, b)
        assert apart - 1e-14 * size <= high <= low + 1e-9 * (1.0 + size), (a, b)


def test_bound_rows_equals_plain_numpy(rng: np.random.Generator) -> None:
    points, radius = rng.normal(size=(50, 4, 3)), rng.uniform(0, 1, 50)
    n_points = rng.integers(1, 5, 50).astype(np.int32)
    ball = np.empty((50, 5))
    kernels.bound_rows(points, n_points, radius, 50, ball)
    for row in range(50):
        used = points[row, : n_points[row]]
        centre = used.mean(axis=0)
        reach = np.linalg.norm(used - centre, axis=1).max() + radius[row]
        expected = [*centre, reach, np.abs(used).max() + radius[row]]
        np.testing.assert_allclose(ball[row], expected, rtol=1e-13, atol=1e-13)


def test_a_row_that_is_not_usable_leaves_the_others_what_they_are() -> None:
    points, radius = np.zeros((7, 4, 3)), np.full(7, 0.5)
    points[:, 0, 0] = np.arange(7)
    n_points = np.ones(7, dtype=np.int32)
    n_points[1], radius[2], points[4, 0, 2] = 0, -1.0, np.nan
    ball = np.full((8, 5), 7.0)
    kernels.bound_rows(points, n_points, radius, 6, ball)
    for row in (0, 3, 5):
        np.testing.assert_array_equal(ball[row], [row, 0.0, 0.0, 0.5, row + 0.5])
    assert np.isnan(ball[[1, 2, 4]]).all() and (ball[6:] == 7.0).all()


@pytest.mark.parametrize(("far", "usable"), [(1e9, True), (np.nextafter(1e9, 2e9), False)])
def test_what_is_beyond_the_largest_length_has_no_ball(far: float, usable: bool) -> None:
    assert kernels.LARGEST == 1e9
    points, ball = np.zeros((7, 4, 3)), np.zeros((7, 5))
    for axis in range(3):
        points[axis, 1, axis], points[3 + axis, 1, axis] = far, -far
    radius = np.array([0.0] * 6 + [far])
    kernels.bound_rows(points, np.full(7, 2, dtype=np.int32), radius, 7, ball)
    assert (np.isfinite(ball) == usable).all()


def below(gap: float, a: Array, b: Array, radii: Array) -> bool:
    """Whether a number is below the gap of two balls, in rational arithmetic."""
    square = sum((Fraction(float(y)) - Fraction(float(x))) ** 2 for x, y in zip(a, b, strict=True))
    reach = Fraction(gap) + sum(Fraction(float(r)) for r in radii)
    return reach <= 0 or reach**2 <= square


@pytest.mark.parametrize("far", [0.0, 1.0, 1e5, 1e8])
def test_gaps_of_points_are_below_the_exact_ones_and_near_them_also_far_from_the_origin(
    far: float, rng: np.random.Generator, count: Count
) -> None:
    separation = Separation(margin=0.0)
    for _ in range(max(100, count(2_000))):
        size = 10.0 ** rng.uniform(-3, 1)
        a, b = rng.normal(size=(2, 3)) * size + far * rng.choice([-1.0, 1.0], 3)
        radii = rng.uniform(0.0, 0.3, 2) * np.linalg.norm(b - a)
        blocks = pair(a, radii[0], b, radii[1])
        found = separation.check(*blocks)
        balls = separation._pairs[0]
        quick = kernels.ball_gap(balls["link_ball"][0], balls["people_ball"][0])
        asked = kernels.certified_gap(blocks[0], blocks[1], separation._pairs, 0, 0, b - a)
        exact = float(np.linalg.norm(b - a) - radii.sum())
        largest = np.abs([a, b]).max() + radii.max()
        for gap in (found.gap_m, quick, asked):
            assert below(gap, a, b, radii)
            assert gap > exact - 2.5e-12 * largest


def test_ball_gap_is_below_the_exact_gap(rng: np.random.Generator, count: Count) -> None:
    for kind in KINDS:
        hulls, exact = sample(kind, rng, count(10_000))
        for (a, b), apart in zip(hulls, exact, strict=True):
            ball = np.empty((2, 5))
            radius = rng.uniform(0, 0.3, 2)
            points = np.array([pad(a), pad(b)])
            n_points = np.array([len(a), len(b)], dtype=np.int32)
            kernels.bound_rows(points, n_points, radius, 2, ball)
            assert kernels.ball_gap(ball[0], ball[1]) <= apart - radius.sum()


def test_simplex_weights_against_all_sub_simplices(rng: np.random.Generator, count: Count) -> None:
    weights = np.empty(4)
    numbers = rng.integers(1, 5, count(20_000)).tolist()
    corners = rng.normal(size=(len(numbers), 4, 3)) + rng.normal(size=(len(numbers), 1, 3))
    padded = np.stack([pad(w[:n]) for w, n in zip(corners, numbers, strict=True)])
    all_exact = distance(np.zeros_like(padded), padded)
    for w, n, exact in zip(corners, numbers, all_exact.tolist(), strict=True):
        outside = kernels.simplex_weights(w, n, weights)
        if outside:
            assert weights[:n].sum() == pytest.approx(1.0) and (weights[:n] >= 0).all()
            assert np.linalg.norm(weights[:n] @ w[:n]) == pytest.approx(exact, abs=1e-9)
        else:
            assert exact == pytest.approx(0.0, abs=1e-9)


def test_simplices_on_a_grid(rng: np.random.Generator, count: Count) -> None:
    """Flat ones, corners that coincide, and an origin right on the border of two regions."""
    weights = np.empty(4)
    n = np.repeat([1, 2, 3, 4], max(300, count(10_000)))
    corners = rng.integers(-2, 3, (len(n), 4, 3)).astype(float)
    padded = np.stack([pad(w[:k]) for w, k in zip(corners, n, strict=True)])
    all_exact = distance(np.zeros_like(padded), padded)
    for w, k, exact in zip(corners, n.tolist(), all_exact.tolist(), strict=True):
        if kernels.simplex_weights(w, k, weights):
            assert (weights[:k] >= 0.0).all() and weights[:k].sum() == pytest.approx(1.0, abs=1e-12), w[:k]
            assert np.linalg.norm(weights[:k] @ w[:k]) == pytest.approx(exact, abs=1e-9), w[:k]
        else:
            assert k == 4 and exact == 0.0, w[:k]


def test_oracle_knows_easy_distances() -> None:
    box = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert distance(box, box + np.array([3.0, 0, 0])) == pytest.approx(2.0)
    assert distance(box, box * 0.1 + 0.1) == 0.0
    assert distance(box, pad(np.array([[1.0, 1, 1]]))) == pytest.approx(2 / np.sqrt(3))
    assert point_segment(np.array([2.0, 0, 0]), box[0], box[1]) == pytest.approx(1.0)
