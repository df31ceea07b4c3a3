"""What the compiled pass leaves open: the engine's part in it, and the answer about hulls that meet."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occupancy import kernels
from occupancy.engines import CoalEngine
from occupancy.separation import Separation
from robots.motion import MAX_SLICES
from tests.occupancy.pairs import KINDS
from tests.occupancy.scenes import blocks, pair, write_row
from tests.occupancy.test_separation import undecide

Array = NDArray[np.float64]


class Scripted(CoalEngine):
    """Proposes what it was given, and keeps what it was asked."""

    def __init__(self, direction: Array) -> None:
        super().__init__()
        self.direction = direction
        self.asked: list[tuple[Array, Array]] = []

    def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
        self.asked.append((points_a.copy(), points_b.copy()))
        return self.direction, 1e6


def test_of_pairs_that_roundings_leave_undecided_the_engine_proves_what_it_can(
    rng: np.random.Generator,
) -> None:
    """The margin is the gap that the search certifies; another length of its direction certifies more."""
    asked = 0
    for _ in range(300):
        a, b = (0.1 * points for points in KINDS["swept"](rng))
        plain = Separation(margin=0.0)
        links, people, ledger = pair(a, 0.01, b, 0.02)
        margin = plain.check(links, people, ledger).gap_m
        if not margin > 0.0:
            continue
        lengths = np.linspace(1.0, 2.0, 30)
        directions = lengths[:, None] * plain.check(*pair(a, 0.01, b, 0.02)).direction
        gaps = [kernels.certified_gap(links, people, plain._pairs, 0, 0, n) for n in directions]
        engine = Scripted(directions[int(np.argmax(gaps))])
        found = Separation(margin=margin, engine=engine).check(*pair(a, 0.01, b, 0.02))
        assert found.gjk_calls == len(engine.asked) <= 1 and found.unresolved == 0
        assert found.separated == (found.gap_m > margin)
        if engine.asked and max(gaps) > margin:
            assert found.gap_m == max(gaps)
            asked += 1
    assert asked > 0


def test_the_engine_is_asked_about_each_pair_with_the_points_of_both(monkeypatch: pytest.MonkeyPatch) -> None:
    links, people, ledger = blocks(3, 2, [1] * 3)
    wanted = []
    for i in range(3):
        of_links = [np.array([[0.0, link, i], [0.1, link, i]]) for link in range(2)]
        of_people = [np.array([[9.0, k, i]]) for k in range(3 if i != 1 else 2)]
        for link, points in enumerate(of_links):
            write_row(links, points, 0.1, i, link)
        for k, points in enumerate(of_people):
            write_row(people, points, 0.1, i, k)
        wanted += list(product(of_links, of_people))
    engine = Scripted(np.array([1.0, 0.0, 0.0]))
    undecide(Separation(), monkeypatch)
    found = Separation(engine=engine).check(links, people, ledger)
    assert found.gjk_calls == len(wanted) == len(engine.asked) == 16
    for (a, b), (of_link, of_person) in zip(engine.asked, wanted, strict=True):
        np.testing.assert_array_equal(a, of_link)
        np.testing.assert_array_equal(b, of_person)
    assert ledger[0]["open"][:3, :2, :3].ravel().tolist() == [0] * 6 + [0, 0, 1] * 2 + [0] * 6


class Claims(CoalEngine):
    """Claims another distance than there is: that of nearby pairs and of others is off by so much."""

    def __init__(self, near: float, far: float) -> None:
        super().__init__()
        self.near, self.far = near, far

    def propose(self, points_a: Array, points_b: Array) -> tuple[Array, float]:
        direction, apart = super().propose(points_a, points_b)
        return direction, apart + (self.near if apart < 0.25 else self.far)


@pytest.mark.parametrize(
    ("first", "second", "worst"),
    [
        ((0.1, 0.0), (0.1, 0.0), 0.1),
        ((-0.1, 0.0), (-0.1, 0.0), 0.1),
        ((0.1, 0.0), (-0.05, 0.0), 0.15),
        ((-0.05, 0.0), (0.1, 0.0), 0.15),
        ((0.0, 0.1), (0.0, -0.05), 0.15),
        ((0.1, 0.0), (0.1, 0.05), 0.1),
        ((0.05, 0.1), (0.05, 0.1), 0.1),
        ((0.0, 0.0), (0.0, 0.0), 0.0),
        ((-9.0, 0.0), (-0.2, 0.0), 0.2),
        ((np.nan, 0.0), (0.0, 0.0), np.inf),
        ((0.0, 0.0), (np.nan, 0.0), np.inf),
        ((np.nan, np.nan), (np.nan, np.nan), np.inf),
    ],
)
def test_disagreement_is_the_worst_of_both_engines_and_of_what_is_certified(
    first: tuple[float, float], second: tuple[float, float], worst: float
) -> None:
    """Two pairs are near enough to be compared, 0.2 and 0.3 m apart but for the radii, one is not."""
    links, people, ledger = blocks(MAX_SLICES, 1, [1])
    for i in range(MAX_SLICES):
        write_row(links, [0.0, 0.0, 0.0], 0.25, i)
        write_row(people, [{0: 0.2, MAX_SLICES - 1: 0.3}.get(i, 9.0), 0.0, 0.0], 0.25, i)
    separation = Separation(engine=Claims(*first), cross_check=Claims(*second), gjk_limit=0)
    found = separation.check(links, people, ledger)
    assert found.disagreement_m == pytest.approx(worst, abs=1e-6)


# -- where hulls meet, the answer names the direction in which they part soonest --

CORNERS = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
"""Of a regular tetrahedron; its faces are at 1 / sqrt(3) from the middle."""
INNER = 1.0 / np.sqrt(3.0)
ALONG_X, ALONG_Y = np.array([[-1.0, 0, 0], [1, 0, 0]]), np.array([[0.0, -1, 0], [0, 1, 0]])


def turned(rng: np.random.Generator, *points: Array) -> list[Array]:
    turn = Rotation.random(random_state=rng)
    return [turn.apply(each) for each in points]


def met(separation: Separation, a: Array, b: Array, depth: float, normal: Array) -> None:
    """Hold the answer against a known direction, and depth without radii."""
    found = separation.check(*pair(a, 0.1, b, 0.2))
    assert not found.separated
    assert found.gap_m == pytest.approx(-depth - 0.3, abs=1e-9) and found.gap_m <= -depth - 0.3 + 1e-12
    np.testing.assert_allclose(found.direction, normal, atol=1e-9)
    apart = float((found.people_point - found.link_point) @ normal)
    assert apart == pytest.approx(found.gap_m, abs=1e-9)
    assert float((found.link_point - 0.1 * normal) @ normal) == pytest.approx((a @ normal).max(), abs=1e-9)
    assert float((found.people_point + 0.2 * normal) @ normal) == pytest.approx((b @ normal).min(), abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_axes_that_cross_part_along_their_common_normal(side: float, rng: np.random.Generator) -> None:
    """No engine is asked. The link is swept away from the side on which they part."""
    swept = np.vstack([ALONG_X, np.add(ALONG_X, [0, 0, -side])])
    a, b, normal = turned(rng, swept, np.add(ALONG_Y, [0, 0, -0.02 * side]), np.array([0, 0, side]))
    met(Separation(gjk_limit=0), a, b, 0.02, normal)


def test_middles_part_hulls_where_one_is_right_behind_a_face(rng: np.random.Generator) -> None:
    for face in range(4):
        normal = -CORNERS[face] / np.sqrt(3.0)
        a, b, normal = turned(rng, CORNERS, 0.9 * INNER * normal[None], normal)
        met(Separation(gjk_limit=0), a, b, 0.1 * INNER, normal)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_axes_that_touch_part_on_the_side_where_the_rest_of_the_person_is(
    side: float, rng: np.random.Generator
) -> None:
    """The search has no direction to begin with: its first two points are one."""
    person = np.array([[0.0, -1, 0], [0.4, -0.5, 0.3 * side], [0.4, 0.5, 0.3 * side], [0, 1, 0]])
    a, b, normal = turned(rng, ALONG_X, person, np.array([0, 0, side]))
    met(Separation(gjk_limit=0), a, b, 0.0, normal)


def test_from_middle_to_middle_is_a_direction_too(rng: np.random.Generator) -> None:
    """The person is on the middle axis of the link, 0.1 m deep along it."""
    for _ in range(20):
        shift = rng.normal(size=3)
        a, b = (shift + each for each in turned(rng, CORNERS, np.array([[0.0, 0.9, 0.0]])))
        found = Separation(gjk_limit=0).check(*pair(a, 0.1, b, 0.2))
        assert not found.separated and found.gap_m > -0.1 - 0.3 - 1e-9


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_axes_of_the_world_part_hulls_too(axis: int) -> None:
    """A point on a segment has no other direction to offer."""
    along = np.zeros((2, 3))
    others = [k for k in range(3) if k != axis]
    along[:, others] = [[-1.0, -1.0], [1.0, 1.0]]
    found = Separation(gjk_limit=0).check(*pair(along, 0.1, [0.0, 0, 0], 0.2))
    assert found.gap_m == pytest.approx(-0.3, abs=1e-9) and found.direction[axis] == 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_an_engine_proposes_parts_hulls_either_way(sign: float, rng: np.random.Generator) -> None:
    normal = -CORNERS[0] / np.sqrt(3.0)
    place = 0.9 * INNER * normal + 0.2 * np.array([1.0, -1.0, 0.0])
    a, b, normal = turned(rng, CORNERS, place[None], normal)
    met(Separation(engine=Scripted(3.0 * sign * normal)), a, b, 0.1 * INNER, normal)
