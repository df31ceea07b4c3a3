"""Bounds against fixtures and between links: as large as they can be, and never larger."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy import workspace
from occupancy.self_collision import SelfCollision
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from occupancy.workspace import Blocked, Workspace
from robots.model import RobotModel
from robots.motion import Block, new_slices
from tests.occupancy.arms import axis_points, place, random_motion
from tests.occupancy.scenes import write_row
from tests.occupancy.test_self_collision import pair_gaps, slim
from tests.occupancy.test_workspace import Solid, random_solid
from tests.oracles.hulls import distance, pad

Array = NDArray[np.float64]
Count = Callable[[int], int]
Bounds = dict[tuple[int, int], tuple[float, float]]
"""Pair of links -> bound of its gap over a slice [m], and what was subtracted."""
EVERY = np.ones(24, dtype=np.uint8)
FAR = 1e3
"""A margin [m] that nothing keeps, so that the smallest bound is reported."""


def gaps_of(solid: Solid, hulls: Array) -> Array:
    """Gaps (R,) [m] of hulls of four points (R, 4, 3) and a solid; of hulls that meet at most 0."""
    if solid.plane is not None:
        at, normal = solid.plane
        between = ((hulls - at) @ normal).min(axis=-1)
    elif solid.segment is not None:
        between = distance(hulls, pad(solid.segment))
    else:
        assert solid.tetrahedra is not None
        between = distance(hulls[:, None], solid.tetrahedra).min(axis=-1)
    gaps: Array = between - solid.radius
    return gaps


def rows_of(rng: np.random.Generator, n_slices: int, n_links: int) -> tuple[Block, Block]:
    links, slices = new_link_sets(), new_slices()
    slices["n"] = n_slices
    for i in range(n_slices):
        for link in range(n_links):
            points = rng.normal(size=3) + rng.normal(size=(4, 3)) * 0.2
            write_row(links, points, rng.uniform(0.0, 0.1), i, link)
    return links, slices


def test_gap_of_rows_and_fixtures_is_the_exact_one(rng: np.random.Generator, count: Count) -> None:
    """The smallest of the first slice on which some gap is not above the margin, and no other is reported."""
    seen = {"apart": 0, "first": 0, "later": 0}
    for _ in range(max(40, count(400))):
        n_slices, n_links, n_solids = (int(n) for n in rng.integers(1, 4, 3))
        links, slices = rows_of(rng, n_slices, n_links)
        solids = [random_solid(rng, f"f{k}") for k in range(n_solids)]
        rows = links[0]
        hulls, radii = rows["points"][: rows["n"]], rows["radius"][: rows["n"]]
        gaps = np.stack([gaps_of(solid, hulls) - radii for solid in solids], axis=-1)
        gaps = gaps.reshape(n_slices, n_links, n_solids)
        apart = gaps + rows["radius"][: rows["n"]].reshape(n_slices, n_links, 1) > 1e-6
        margin = max(0.0, float(rng.choice(gaps.ravel())) + float(rng.choice([-1e-6, 1e-6, 0.3])))
        found = Workspace([each.fixture for each in solids], ["link"] * n_links, {}, margin).check(
            links, slices, EVERY
        )
        blocked = [i for i in range(n_slices) if gaps[i].min() <= margin]
        if not blocked:
            assert found is None, "no gap is lost"
            seen["apart"] += 1
            continue
        assert found is not None and found.slice == blocked[0]
        seen["first" if found.slice == 0 else "later"] += 1
        here = gaps[found.slice]
        exact = here[found.link, int(found.other[1:])]
        assert found.gap_m <= min(exact, margin)
        if apart[found.slice].all():
            assert found.gap_m == pytest.approx(here.min(), abs=1e-7) == pytest.approx(exact, abs=1e-7)
            assert np.linalg.norm(found.other_point - found.link_point) == pytest.approx(abs(exact), abs=1e-5)
        other = solids[int(found.other[1:])]
        assert found.lost_m == 0.0 and found.other_radius_m == pytest.approx(other.radius, abs=2e-9)
    assert min(seen.values()) > 0, seen


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("far", [0.0, 1e5])
def test_gap_of_a_plane_is_below_the_exact_one_also_far_away(
    axis: int, far: float, rng: np.random.Generator
) -> None:
    for _ in range(50):
        links, slices = rows_of(rng, 1, 1)
        rows, height, error = links[0], far + rng.uniform(-2.0, 2.0), rng.uniform(0.0, 0.1)
        rows["points"][0, :, axis] += far
        point, normal = rng.uniform(-1.0, 1.0, 3), np.eye(3)[axis]
        point[axis] = height
        floor = workspace.half_space("floor", point, normal, error)
        found = Workspace([floor], ["link"], {}, FAR).check(links, slices, EVERY)
        assert found is not None
        low = min(Fraction(float(x)) for x in rows["points"][0, :, axis])
        exact = low - Fraction(height) - Fraction(float(rows["radius"][0])) - Fraction(error)
        assert Fraction(found.gap_m) < exact < Fraction(found.gap_m) + Fraction(1e-11) * int(far + 10)


def test_rows_that_do_not_belong_together_name_no_pair() -> None:
    links, slices = rows_of(np.random.default_rng(0), 1, 2)
    links["n"] = 1
    box = workspace.half_space("floor", (0, 0, 0), (0, 0, 1))
    found = Workspace([box], ["one", "other"], {}, 1e-4).check(links, slices, EVERY)
    assert found is not None and (found.slice, found.link, found.other) == (0, 0, "")
    assert found.gap_m == -np.inf and (found.other_radius_m, found.lost_m) == (0.0, 0.0)
    assert np.isnan([found.link_point, found.other_point]).all()


# -- two links --


def relative(model: RobotModel, slices: Block, link: int, other: int) -> tuple[float, float]:
    """Speed and tracking error of a link as seen from another: of the joints that move it alone."""
    tree, plan, reach = model.kinematics[0], slices[0], model.enclosure[0]["reach"][link]
    chains = []
    for each in (link, other):
        j, chain = int(model.enclosure[0]["joint"][each]), set()
        while j >= 0:
            chain.add(j)
            j = int(tree["parent"][j])
        chains.append(chain)
    own = chains[0] - chains[1]
    rho = {j: 1.0 if tree["prismatic"][j] else reach[j] for j in own}
    speed = sum(rho[j] * plan["dq_max"][0, j] for j in own)
    return speed, sum(rho[j] * (plan["q_error"][j] + plan["q_spread"][0, j]) for j in own)


def bounds(
    model: RobotModel, pairs: SelfCollision, slices: Block
) -> dict[tuple[int, int], tuple[float, float]]:
    """By pair: what the gaps at both ends of the slice leave over it, and what was subtracted."""
    plan, n = slices[0], len(model.joints)
    ends, h = pair_gaps(model, plan["q"][:2, :n]), float(plan["t"][1] - plan["t"][0])
    found = {}
    for names in pairs.pairs:
        a, b = (model.links.index(each) for each in names)
        (v_a, e_a), (v_b, e_b) = relative(model, slices, a, b), relative(model, slices, b, a)
        lost = 0.5 * h * (v_a + v_b) + e_a + e_b
        found[a, b] = float(ends[:, a, b].mean()) - lost, lost
    return found


def with_margin(pairs: SelfCollision, margin: float) -> SelfCollision:
    pairs._margin = margin
    return pairs


def holds(found: Blocked, model: RobotModel, expected: Bounds) -> None:
    pair = found.link, model.links.index(found.other)
    least, _ = min(expected.values())
    assert found.gap_m == pytest.approx(least, abs=1e-8) and found.gap_m <= least + 1e-12
    assert expected[pair][0] == pytest.approx(least, abs=1e-8)
    assert found.lost_m == pytest.approx(expected[pair][1], rel=1e-9) and found.slice == 0
    assert found.other_radius_m == model.enclosure[0]["radius"][pair[1]]


@pytest.mark.parametrize("name", ["scara", "six", "branches", "slide_between"])
def test_gap_of_two_links_over_a_slice_is_that_of_its_ends_less_what_moves(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    for _ in range(max(25, count(1_000))):
        model = slim(name, rng)
        n, slices, links = len(model.joints), random_motion(model, rng).slices(), new_link_sets()
        slices[0]["t"][:] += rng.uniform(-5.0, 5.0)
        slices[0]["q_spread"][0, :n] = rng.uniform(0.0, 0.01, n)
        slices[0]["q"][:2, :n][:, model.kinematics[0]["prismatic"][:n].astype(bool)] *= 0.1
        LinkOccupancy(model).occupy(slices, links)
        pairs = SelfCollision(model, [], 0.0)
        expected = bounds(model, pairs, slices)
        found = with_margin(pairs, FAR).check(links, slices, EVERY)
        assert found is not None
        holds(found, model, expected)
        least = min(expected.values())[0]
        assert with_margin(pairs, least - 1e-7).check(links, slices, EVERY) is None
        found = with_margin(pairs, least + 1e-7).check(links, slices, EVERY)
        assert found is not None
        holds(found, model, expected)


def test_close_points_of_two_links_are_those_where_the_slice_begins(rng: np.random.Generator) -> None:
    for _ in range(50):
        model = slim("six", rng)
        slices, links = random_motion(model, rng).slices(), new_link_sets()
        LinkOccupancy(model).occupy(slices, links)
        found = with_margin(SelfCollision(model, [], 0.0), FAR).check(links, slices, EVERY)
        assert found is not None
        a, b = found.link, model.links.index(found.other)
        gap = pair_gaps(model, slices[0]["q"][:1, :6])[0, a, b]
        assert np.linalg.norm(found.other_point - found.link_point) == pytest.approx(abs(gap), abs=1e-6)
        axes = place(model, slices[0]["q"][0, :6], axis_points(model, np.linspace(0.0, 1.0, 200)))
        for link, point in ((a, found.link_point), (b, found.other_point)):
            off = np.linalg.norm(axes[link] - point, axis=1).min()
            assert off == pytest.approx(model.enclosure[0]["radius"][link], abs=2e-3)
