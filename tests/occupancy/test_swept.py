"""Swept link rows against densely sampled motion with the tests' own kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import arb, arb_series, ctx
from numpy.typing import NDArray

from occupancy.kernels import stroke_excess
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy, SweepError, chains_and_strokes
from robots.catalog import RobotSetup, load_robot, robot_names
from robots.kernels import forward
from robots.model import RobotModel
from robots.motion import MAX_JOINTS, SLICES, Block
from tests.conftest import Some
from tests.occupancy.arms import ARMS, STROKE, Motion, arm, axis_points, place, poses, random_motion
from tests.oracles.hulls import exact_point_distance, point_distance
from tests.robots.enclosures import cache_dir

__all__ = ["cache_dir"]

Array = NDArray[np.float64]
Count = Callable[[int], int]

ROUNDING = 1e-12
"""[m] Of placing a point by products of rotations; allowances for curvature reach 1e-2."""


@pytest.fixture(scope="module")
def catalogue(cache_dir: Path, some: Some) -> dict[str, RobotModel]:
    """Arms of the catalogue: all at full counts, else a seeded choice."""
    setup = RobotSetup(bare_flange=True, cache_dir=cache_dir)
    return {name: load_robot(name, setup=setup) for name in some(robot_names(), 5)}


def swept_rows(model: RobotModel, slices: Block) -> np.void:
    out = new_link_sets()
    LinkOccupancy(model).occupy(slices, out)
    return out[0]


def largest_excess(
    model: RobotModel, occupancy: LinkOccupancy, motion: Motion, out: Block, samples: int
) -> Array:
    """How far [m] each link's axis leaves its row less the link's radius, over the slice; <= 0 is inside.

    Feature distances in double precision are off by up to 1e-7 where a row is very flat, always upward; so
    whatever seems to be outside is asked once more in rational numbers.
    """
    occupancy.occupy(motion.slices(), out)
    rows, n = out[0], int(model.enclosure[0]["n"])
    room = rows["radius"][:n] - model.enclosure[0]["radius"][:n]
    local = axis_points(model, np.array([0.0, 0.37, 1.0]))
    points = place(model, motion.actual(np.linspace(0.0, motion.h, samples)[:, None]), local)
    apart = point_distance(points, rows["points"][:n, None, :, :])
    for at, link, k in np.argwhere(apart > room[None, :, None] + ROUNDING):
        apart[at, link, k] = exact_point_distance(points[at, link, k], rows["points"][link])
    worst: Array = apart.max(axis=(0, 2)) - room
    return worst


def check_inclusion(model: RobotModel, rng: np.random.Generator, number: int) -> None:
    occupancy, out = LinkOccupancy(model), new_link_sets()
    for _ in range(number):
        motion = random_motion(model, rng)
        excess = largest_excess(model, occupancy, motion, out, 9)
        assert (excess <= ROUNDING).all(), (motion, excess)


@pytest.mark.parametrize("name", ARMS)
def test_rows_contain_random_motion(name: str, rng: np.random.Generator, count: Count) -> None:
    for _ in range(4):
        check_inclusion(arm(name, rng), rng, count(10_000) // 4)


def test_rows_contain_random_motion_of_catalogue_robots(
    catalogue: dict[str, RobotModel], rng: np.random.Generator, count: Count
) -> None:
    for model in catalogue.values():
        check_inclusion(model, rng, count(5_000))


def circle(rng: np.random.Generator, h: float) -> tuple[RobotModel, Motion]:
    """One link that turns at constant speed, for which the chord bound is nearly attained."""
    model = arm("one_turning", rng)
    coefficients = np.array([[0.3], [2.5], [0.0], [0.0]])
    return model, Motion(h, coefficients, np.zeros(1), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize("h", [0.004, 0.01, 0.05])
def test_allowance_for_curvature_is_not_larger_than_it_must_be(h: float, rng: np.random.Generator) -> None:
    model, motion = circle(rng, h)
    rows = swept_rows(model, motion.slices())
    allowance = rows["radius"][0] - model.enclosure[0]["radius"][0]
    sagitta = 0.4 * (1.0 - np.cos(2.5 * h / 2.0))
    assert sagitta < allowance < 1.01 * sagitta


def test_half_the_allowance_would_be_too_small(rng: np.random.Generator) -> None:
    """The inclusion test can fail: with h²/16 instead of h²/8 the same sampling finds the link outside."""
    model, motion = circle(rng, 0.02)
    occupancy, out = LinkOccupancy(model), new_link_sets()
    excess = largest_excess(model, occupancy, motion, out, 9)
    allowance = out[0]["radius"][0] - model.enclosure[0]["radius"][0]
    assert excess[0] <= ROUNDING < 1e-6 < excess[0] + 0.5 * allowance


def speeds(model: RobotModel, motion: Motion, local: Array, t: float | Array) -> Array:
    """Speed (L, P) of link points by central differences; (T, L, P) at instants (T, 1)."""
    step = 1e-6
    before = place(model, motion.actual(t - step), local)
    after = place(model, motion.actual(t + step), local)
    return np.linalg.norm(after - before, axis=-1) / (2.0 * step)


def surface_points(model: RobotModel, rng: np.random.Generator) -> Array:
    """Points (L, P, 3) on the surface of the capsules."""
    axis = axis_points(model, np.array([0.0, 0.5, 1.0]))
    direction = rng.normal(size=axis.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    radius = model.enclosure[0]["radius"][: len(axis), None, None]
    points: Array = axis + radius * direction
    return points


def check_speed(model: RobotModel, rng: np.random.Generator, number: int) -> None:
    occupancy, out = LinkOccupancy(model), new_link_sets()
    for _ in range(number):
        motion = random_motion(model, rng)
        occupancy.occupy(motion.slices(), out)
        bound = out[0]["speed_max"][: int(model.enclosure[0]["n"])]
        local = surface_points(model, rng)
        found = speeds(model, motion, local, np.linspace(0.0, motion.h, 5)[:, None]).max(axis=(0, 2))
        assert (found <= bound + 1e-6).all(), (motion, found, bound)


@pytest.mark.parametrize("name", ARMS)
def test_no_link_point_is_faster_than_its_row_says(name: str, rng: np.random.Generator, count: Count) -> None:
    for _ in range(4):
        check_speed(arm(name, rng), rng, count(10_000) // 4)


def test_no_link_point_of_catalogue_robots_is_faster(
    catalogue: dict[str, RobotModel], rng: np.random.Generator, count: Count
) -> None:
    for model in catalogue.values():
        check_speed(model, rng, count(5_000))


def test_speed_bound_is_close_on_short_slices(rng: np.random.Generator) -> None:
    model = arm("six", rng)
    ratios = []
    for _ in range(50):
        motion = replace(random_motion(model, rng), h=0.004)
        motion = replace(motion, error=np.zeros_like(motion.error))
        rows = swept_rows(model, motion.slices())
        local = axis_points(model, np.array([0.0, 1.0]))
        slim = model.enclosure[0]["radius"][5] * np.abs(motion.command(0.0)[1]).sum()
        found = max(speeds(model, motion, local, t).max(axis=1)[5] for t in (0.0, 0.002, 0.004))
        if found > 0.1:
            ratios.append(rows["speed_max"][5] / (found + slim))
    assert np.median(ratios) < 1.15


def test_a_position_error_alone_makes_points_faster(rng: np.random.Generator) -> None:
    """Two equal links folded back: the tip is on the first axis and stands still, unless the elbow is off."""
    model = arm("planar", rng)
    model.enclosure[0]["a"][1] = [0.4, 0.0, 0.0]
    error = np.array([0.0, 0.02])
    folded = np.array([[0.0, np.pi], [2.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    motion = Motion(1e-4, folded, error, np.zeros(2), np.full(2, np.pi / 2))
    rows = swept_rows(model, motion.slices())
    tip = np.array([[[0.0, 0, 0]], [[0.4, 0, 0]]])
    found = speeds(model, motion, tip, 0.0)[1, 0]
    assert found == pytest.approx(2.0 * 0.4 * 0.02, rel=1e-3)
    radius = model.enclosure[0]["radius"][1]
    assert found <= rows["speed_max"][1] - radius * 2.0 <= 1.2 * found


@pytest.mark.parametrize("name", ARMS)
def test_acceleration_bound_against_second_differences(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    """On a tiny slice the allowance divided by h²/8 is the acceleration bound at that state."""
    step = 1e-4
    for _ in range(4):
        model = arm(name, rng)
        occupancy, out = LinkOccupancy(model), new_link_sets()
        local, n = axis_points(model, np.array([0.0, 1.0])), len(model.joints)
        for _ in range(count(5_000)):
            motion = replace(random_motion(model, rng), h=2 * step, error=np.zeros(n))
            occupancy.occupy(motion.slices(), out)
            allowance = out[0]["radius"][:n] - model.enclosure[0]["radius"][:n]
            placed = [place(model, motion.command(t)[0], local) for t in (0.0, step, 2 * step)]
            bend = np.linalg.norm(placed[0] - 2 * placed[1] + placed[2], axis=-1).max(axis=1)
            # second difference / step² <= A, and allowance = (2 step)²/8 A = step²/2 A
            assert (0.5 * bend <= allowance).all(), (motion, bend, allowance)


def test_chord_bound_in_ball_arithmetic(rng: np.random.Generator, count: Count) -> None:
    """Enclosures of the whole curve, not samples; they are up to 0.4 % too wide."""
    ctx.prec, ctx.cap = 80, 2
    for name in ("one_turning", "planar", "turn_then_slide", "scara"):
        model = arm(name, rng)
        for _ in range(max(1, count(100))):
            motion = replace(random_motion(model, rng), h=0.05, error=np.zeros(len(model.joints)))
            rows = swept_rows(model, motion.slices())
            for link in range(len(model.joints)):
                allowance = rows["radius"][link] - model.enclosure[0]["radius"][link]
                assert _largest_distance_from_chord(model, motion, link) <= 1.01 * allowance


def _largest_distance_from_chord(model: RobotModel, motion: Motion, link: int, pieces: int = 40) -> float:
    """Upper bound over all instants, piece by piece in mean value form: value in the middle, slope, width."""
    h = arb(motion.h)
    first, last = (_place_arb(model, motion, link, arb_series([t])) for t in (arb(0), h))
    slope = [(b[0] - a[0]) / h for a, b in zip(first, last, strict=True)]
    worst = 0.0
    for piece in range(pieces):
        middle = h * arb((piece + 0.5) / pieces)
        around = middle + h * arb(0, 0.5 / pieces * (1 + 1e-9))
        values = _place_arb(model, motion, link, arb_series([middle]))
        slopes = _place_arb(model, motion, link, arb_series([around, 1]))
        square = arb(0)
        for value, change, a, v in zip(values, slopes, first, slope, strict=True):
            off = value[0] - a[0] - middle * v + (change[1] - v) * (around - middle)
            square += off * off
        worst = max(worst, float(square.upper().sqrt().upper()))
    return worst


def _place_arb(model: RobotModel, motion: Motion, link: int, t: arb_series) -> list[arb_series]:
    """World position of a link's second axis end as a power series about t: value and first derivative."""
    tree, c = model.kinematics[0], motion.coefficients
    point = [arb_series([float(x)]) for x in model.enclosure[0]["b"][link]]
    j = int(model.enclosure[0]["joint"][link])
    while j >= 0:
        c0, c1, c2, c3 = (arb(float(c[k, j])) for k in range(4))
        q = c0 + t * (c1 + t * (c2 + t * c3))
        axis = [arb(float(x)) for x in tree["axis"][j]]
        if tree["prismatic"][j]:
            point = [p + q * a for p, a in zip(point, axis, strict=True)]
        else:
            point = _turned(point, axis, q)
        rows = [[arb(float(x)) for x in row] for row in tree["rotation"][j]]
        shift = [arb(float(x)) for x in tree["translation"][j]]
        point = [
            r[0] * point[0] + r[1] * point[1] + r[2] * point[2] + d for r, d in zip(rows, shift, strict=True)
        ]
        j = int(tree["parent"][j])
    return point


def _turned(p: list[arb_series], axis: list[arb], q: arb_series) -> list[arb_series]:
    """Rodrigues' formula."""
    along = axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]
    cos, sin = q.cos(), q.sin()
    turned = []
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        cross = axis[k] * p[m] - axis[m] * p[k]
        turned.append(cos * p[i] + sin * cross + (1 - cos) * along * axis[i])
    return turned


def plain_bounds(model: RobotModel, slices: Block, link: int) -> tuple[float, ...]:
    """The sums, pair by pair: coupling is ρ of the later joint if the earlier one turns, else 0."""
    tree, plan, chain = model.kinematics[0], slices[0], []
    j = int(model.enclosure[0]["joint"][link])
    while j >= 0:
        chain.insert(0, j)
        j = int(tree["parent"][j])
    rho = {j: float(model.enclosure[0]["reach"][link, j]) for j in chain}
    turns = {j: not tree["prismatic"][j] for j in chain}
    dq, ddq = plan["dq_max"][0], plan["ddq_max"][0]
    e, de = plan["q_error"] + plan["q_spread"][0], plan["dq_error"] + plan["dq_spread"][0]
    acceleration = sum(rho[j] * ddq[j] for j in chain)
    velocity_error = sum(rho[j] * de[j] for j in chain)
    for i in chain:
        for j in chain:
            coupling = rho[max(i, j)] if turns[min(i, j)] else 0.0
            acceleration += coupling * dq[i] * dq[j]
            velocity_error += coupling * e[i] * dq[j]
    spinning = [j for j in chain if turns[j]]
    pairs = [(i, j) for i in spinning for j in spinning if i < j]
    turning = sum(ddq[j] for j in spinning) + sum(dq[i] * dq[j] for i, j in pairs)
    turn_error = sum(de[j] for j in spinning) + sum(e[i] * dq[j] for i, j in pairs)
    return acceleration, sum(rho[j] * e[j] for j in chain), velocity_error, turning, turn_error


@pytest.mark.parametrize("name", ARMS)
def test_motion_bounds_equal_the_plain_sums(name: str, rng: np.random.Generator) -> None:
    for _ in range(20):
        model = arm(name, rng)
        capsules = model.enclosure[0]
        slices = random_motion(model, rng).slices()
        slices[0]["q"][:] = 0.0  # inside every stroke
        slices[0]["q_error"][:] = rng.uniform(0, 0.1, MAX_JOINTS)
        slices[0]["dq_error"][:] = rng.uniform(0, 0.1, MAX_JOINTS)
        for spread in ("q_spread", "dq_spread"):
            slices[0][spread][0] = rng.uniform(0, 0.1, MAX_JOINTS)
        rows, h = swept_rows(model, slices), float(slices[0]["t"][1])
        n = int(capsules["n"])
        spin, speed = end_speeds(model, slices)
        for link in range(n):
            a, moved, v, turning, w = plain_bounds(model, slices, link)
            radius = capsules["radius"][link]
            grown = radius + h * h / 8 * a + moved
            assert grown < rows["radius"][link] < grown * (1.0 + 1e-10)
            fastest = speed[link] + a * h / 2 + v + radius * (spin[link] + turning * h / 2 + w)
            assert rows["speed_max"][link] == pytest.approx(fastest, rel=1e-7)


def plain_excess(model: RobotModel, slices: Block, link: int) -> float:
    """By how much a link's prismatic joints may be beyond their strokes, one joint after the other."""
    plan, tree, total = slices[0], model.kinematics[0], 0.0
    j = int(model.enclosure[0]["joint"][link])
    while j >= 0:
        if tree["prismatic"][j]:
            h = plan["t"][1] - plan["t"][0]
            around = plan["dq_max"][0, j] * h / 2 + plan["q_error"][j] + plan["q_spread"][0, j]
            low, high = plan["q"][:2, j].min() - around, plan["q"][:2, j].max() + around
            total += max(0.0, high - STROKE, -STROKE - low)
        j = int(tree["parent"][j])
    return total


def test_how_far_joints_may_leave_their_strokes(rng: np.random.Generator, count: Count) -> None:
    inside = below = above = 0
    for _ in range(max(40, count(2_000))):
        model = arm(str(rng.choice(["turn_then_slide", "gantry", "slide_between"])), rng)
        n, slices = len(model.joints), random_motion(model, rng).slices()
        plan = slices[0]
        plan["t"][:2] = rng.uniform(-1.0, 0.0), rng.uniform(0.0, 0.2)
        plan["q"][:2, :n] = rng.uniform(-0.6, 0.6, (2, n)) * rng.choice([0.1, 1.0], n)
        for name, size in (("dq_max", 1.0), ("q_spread", 0.05)):
            plan[name][0, :n] = rng.uniform(0.0, size, n)
        plan["q_error"][:n] = rng.uniform(0.0, 0.05, n)
        tree, fixed = model.kinematics[0], chains_and_strokes(model)[0]
        for link in range(n):
            found = stroke_excess(tree, fixed["chain"][link], fixed["stroke"], plan, 0)
            assert found == pytest.approx(plain_excess(model, slices, link), abs=1e-14)
            inside, above = inside + (found == 0.0), above + (found > 0.0)
            below += plan["q"][:2, :n].min() < -STROKE
    assert min(inside, below, above) > 0


@pytest.mark.parametrize("field", ["dq_max", "q_error", "q_spread"])
def test_strokes_that_cannot_be_compared_are_no_bound(field: str, rng: np.random.Generator) -> None:
    model = arm("turn_then_slide", rng)
    slices = random_motion(model, rng).slices()
    slices[0][field][(1,) if field == "q_error" else (0, 1)] = np.nan
    fixed = chains_and_strokes(model)[0]
    assert np.isnan(stroke_excess(model.kinematics[0], fixed["chain"][1], fixed["stroke"], slices[0], 0))


def test_a_slice_without_length_holds_the_arm_at_its_instant(rng: np.random.Generator) -> None:
    model = arm("six", rng)
    motion = replace(random_motion(model, rng), h=0.0, error=np.full(6, 0.01), frequency=np.zeros(6))
    rows, ends = swept_rows(model, motion.slices()), axis_points(model, np.array([0.0, 1.0]))
    placed = place(model, motion.command(0.0)[0], ends)
    for link in range(6):
        assert rows["n_points"][link] == 4
        for side in range(2):
            np.testing.assert_allclose(
                rows["points"][link, 2 * side : 2 * side + 2], placed[link], rtol=0.0, atol=1e-12
            )
        moved = 0.01 * model.enclosure[0]["reach"][link].sum()
        assert rows["radius"][link] == pytest.approx(model.enclosure[0]["radius"][link] + moved, rel=1e-10)


def end_speeds(model: RobotModel, slices: Block) -> tuple[Array, Array]:
    """Spin and fastest axis end of each link at the faster slice end, by differences of poses."""
    plan, n, step = slices[0], len(model.joints), 1e-6
    spins, fastest, ends = [], [], axis_points(model, np.array([0.0, 1.0]))
    for i in range(2):
        around = [plan["q"][i, :n] + s * step * plan["dq"][i, :n] for s in (-1, 1)]
        before, after = (place(model, q, ends) for q in around)
        fastest.append(np.linalg.norm(after - before, axis=-1).max(axis=1) / (2 * step))
        turn = [poses(model, q)[0] for q in around]
        rate = np.einsum("lij,lkj->lik", turn[1], turn[0]) - np.einsum("lij,lkj->lik", turn[0], turn[1])
        spins.append(np.linalg.norm(rate[:, [2, 0, 1], [1, 2, 0]], axis=1) / (4 * step))
    return np.max(spins, axis=0), np.max(fastest, axis=0)


def test_compiled_code_that_is_out_of_date_is_noticed(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other_kinematics(kinematics: Block, q: Array, rotations: Array, positions: Array) -> None:
        forward(kinematics, -q, rotations, positions)

    monkeypatch.setattr("occupancy.swept.forward", other_kinematics)
    with pytest.raises(SweepError, match="compiled code of occupancy does not match"):
        LinkOccupancy(arm("scara", rng))


def test_row_fields(rng: np.random.Generator) -> None:
    model = arm("scara", rng)
    slices = random_motion(model, rng).slices()
    slices[0]["n"] = 3
    slices[0]["t"][:] = np.arange(65) * 0.01
    slices[0]["q"][2:, :4] = slices[0]["q"][1, :4]
    rows = swept_rows(model, slices)
    assert rows["n"] == 12
    np.testing.assert_array_equal(rows["first"][:5], [0, 4, 8, 12, 12])
    assert (rows["first"][3:] == 12).all()
    np.testing.assert_array_equal(rows["slice"][:12], np.repeat(np.arange(3), 4))
    np.testing.assert_array_equal(rows["owner"][:12], np.tile(np.arange(4), 3))
    assert not rows["covers"].any() and not rows["model"].any(), "no part of anybody"
    ends = axis_points(model, np.array([0.0, 1.0]))
    for side in range(2):
        placed = place(model, slices[0]["q"][side, :4], ends)
        np.testing.assert_allclose(rows["points"][:4, 2 * side : 2 * side + 2], placed, atol=1e-12)


def test_a_prismatic_joint_beyond_its_stroke_has_a_larger_reach(rng: np.random.Generator) -> None:
    model = arm("turn_then_slide", rng)
    coefficients = np.zeros((4, 2))
    coefficients[1] = [2.0, 0.0]
    inside, outside = coefficients.copy(), coefficients.copy()
    inside[0, 1], outside[0, 1] = 0.4, 1.4
    near, far = (
        swept_rows(model, Motion(0.02, c, np.zeros(2), np.zeros(2), np.zeros(2)).slices())
        for c in (inside, outside)
    )
    grown = (far["radius"][1] - near["radius"][1]) / (0.02**2 / 8.0 * 2.0**2)
    assert grown == pytest.approx(1.0, abs=1e-6)


BROKEN = [
    ("q", (0, 1), np.nan),
    ("q", (1, 0), np.inf),
    ("dq", (0, 1), np.nan),
    ("dq_max", (0, 2), np.nan),
    ("dq_max", (0, 0), -1.0),
    ("ddq_max", (0, 1), np.nan),
    ("ddq_max", (0, 1), -1.0),
    ("ddq_max", (0, 1), np.inf),
    ("q_error", (0,), np.nan),
    ("q_error", (1,), -1e-3),
    ("dq_error", (2,), np.nan),
    ("dq_error", (2,), -1.0),
    ("q_spread", (0, 0), np.nan),
    ("q_spread", (0, 1), -1e-3),
    ("dq_spread", (0, 0), np.nan),
    ("dq_spread", (0, 2), -1e-3),
    ("t", (0,), np.nan),
    ("t", (1,), -1.0),
    ("t", (1,), np.inf),
]


@pytest.mark.parametrize(("field", "place_", "value"), BROKEN)
def test_input_that_makes_no_sense_leaves_rows_with_which_nothing_is_proven(
    field: str, place_: tuple[int, ...], value: float, rng: np.random.Generator
) -> None:
    model = arm("six", rng)
    slices = random_motion(model, rng).slices()
    slices[0]["q_error"][:6] = 1e-3
    slices[0][field][place_] = value
    rows = swept_rows(model, slices)
    assert rows["n"] == 6
    last = 5
    proves_nothing = rows["n_points"][last] == 0 or not np.isfinite(rows["points"][last]).all()
    if field not in ("dq", "dq_error"):  # velocities do not move the rows, only their speeds
        assert proves_nothing
    assert np.isnan(rows["speed_max"][last])


@pytest.mark.parametrize(("field", "value"), [("n_joints", 5), ("n", -1), ("n", 65), ("n", 0)])
def test_blocks_of_the_wrong_size(field: str, value: int, rng: np.random.Generator) -> None:
    model = arm("six", rng)
    slices = random_motion(model, rng).slices()
    slices[0][field] = value
    rows = swept_rows(model, slices)
    assert not rows["n_points"][: int(rows["n"])].any()
    assert rows["n"] == (6 if field == "n_joints" else 0)


def test_rows_of_an_earlier_plan_do_not_remain(rng: np.random.Generator) -> None:
    model, out = arm("planar", rng), new_link_sets()
    occupancy, slices = LinkOccupancy(model), random_motion(arm("planar", rng), rng).slices()
    slices[0]["n"] = 5
    slices[0]["t"][:] = np.arange(65) * 0.01
    occupancy.occupy(slices, out)
    slices[0]["n"] = 2
    occupancy.occupy(slices, out)
    assert out[0]["n"] == 4 and (out[0]["first"][2:] == 4).all()


@pytest.mark.parametrize(
    ("field", "place_", "value", "message"),
    [
        ("reach", (1, 0), np.nan, "link_1: reach from joint joint_0"),
        ("reach", (1, 0), -0.1, "link_1: reach from joint joint_0"),
        ("reach", (3, 2), 0.5, "at least 1"),
        ("joint", (2,), 7, "link link_2 hangs on joint 7, but there are 4 joints"),
    ],
)
def test_models_that_cannot_be_swept_are_refused(
    field: str, place_: tuple[int, ...], value: float, message: str, rng: np.random.Generator
) -> None:
    model = arm("scara", rng)
    model.enclosure[0][field][place_] = value
    with pytest.raises(SweepError, match=message):
        LinkOccupancy(model)


def test_joints_out_of_order_are_refused(rng: np.random.Generator) -> None:
    model = arm("scara", rng)
    model.kinematics[0]["parent"][1] = 2
    with pytest.raises(SweepError, match="joint joint_1 must come after its parent"):
        LinkOccupancy(model)


def test_block_sizes() -> None:
    assert SLICES["q"].shape[1] == MAX_JOINTS
