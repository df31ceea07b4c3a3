"""Cells of a path and the one plan that stands for many: against plain readings of what they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.path_cells import PathCells
from failsafe.stop_kernels import PLANS
from occupancy import corridor_kernels
from occupancy.corridor import CorridorSweep
from occupancy.hypotheses import PEOPLE
from occupancy.separation import LEDGER, new_ledger
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from robots.model import RobotModel
from robots.motion import MAX_SLICES, Block, new_slices
from tests.failsafe.motions import random_motion
from tests.occupancy.arms import arm
from tests.occupancy.test_swept import plain_bounds

Array = NDArray[np.float64]
Count = Callable[[int], int]
SLICE_S = 0.01
PARTS = 0b1011


def acceleration(model: RobotModel, slices: Block, i: int, link: int) -> float:
    """Bound [m/s²] of points of a link on slice i, without tracking errors."""
    one = slices.copy()
    for name in ("dq_max", "ddq_max"):
        one[name][0, 0] = slices[name][0, i]
    return plain_bounds(model, one, link)[0]


def longest_slice(model: RobotModel) -> Block:
    """A slice as long as any, on which every joint does what it may."""
    slices, n = new_slices(), len(model.joints)
    slices["dq_max"][0, 0, :n], slices["ddq_max"][0, 0, :n] = model.limits.velocity, model.limits.acceleration
    return slices


@pytest.mark.parametrize("name", ["about_its_middle", "planar", "branches"])
@pytest.mark.parametrize("cell_s", [0.008, 0.03])
def test_cells_are_rows_of_a_sweep_grown_by_what_plans_may_add(
    name: str, cell_s: float, rng: np.random.Generator
) -> None:
    """By 2 h²/8 A for the hull of a slice, and a quarter of how far its axes turn, nearby cells included."""
    model = arm(name, rng)
    n_links, error = len(model.links), np.full(len(model.joints), 0.002)
    motion = random_motion(rng, model.limits, 0.7)
    cells = PathCells(motion.trajectory, cell_s)
    corridor = CorridorSweep(model, SLICE_S).sweep(cells, (error, error))
    slices, rows = new_slices(), new_link_sets()
    slices["q_error"][0, : len(error)] = slices["dq_error"][0, : len(error)] = error
    twist, plain, slowest = np.zeros((cells.count, n_links)), np.zeros((cells.count, n_links)), []
    bulge = [SLICE_S**2 / 8.0 * acceleration(model, longest_slice(model), 0, link) for link in range(n_links)]
    first = 0
    while first < cells.count:
        n = cells.write(first, slices)
        LinkOccupancy(model).occupy(slices, rows)
        ends = rows[0]["points"][: n * n_links].reshape(n, n_links, 2, 2, 3)
        np.testing.assert_array_equal(
            corridor.points[first : first + n].reshape(n, n_links, 2, 2, 3), ends, strict=True
        )
        plain[first : first + n] = rows[0]["radius"][: n * n_links].reshape(n, n_links)
        h = np.diff(slices["t"][0, : n + 1])[:, None]
        bound = np.array([[acceleration(model, slices, i, k) for k in range(n_links)] for i in range(n)])
        chords, axes = ends[:, :, 1] - ends[:, :, 0], ends[:, :, :, 1] - ends[:, :, :, 0]
        slowest += (np.linalg.norm(chords, axis=3).max(axis=2) / h - bound * h).max(axis=1).tolist()
        turned = np.linalg.norm(axes[:, :, 1] - axes[:, :, 0], axis=2) / h
        twist[first : first + n] = turned + 2.0 * bound * h
        first += n
    np.testing.assert_allclose(corridor.speed, np.maximum(slowest, 0.0), rtol=1e-9, atol=1e-9)
    reach = int(np.ceil(SLICE_S / cell_s))
    for cell in range(cells.count):
        near = twist[max(0, cell - reach) : cell + reach + 1].max(axis=0)
        grown = plain[cell] + 2.0 * np.array(bulge) + 0.25 * SLICE_S * near
        assert (grown < corridor.radius[cell]).all() and (corridor.radius[cell] < grown * (1.0 + 3e-5)).all()


def test_a_cell_that_is_not_usable_says_so_and_the_others_are_what_they_were(
    rng: np.random.Generator,
) -> None:
    model = arm("planar", rng)
    cells = PathCells(random_motion(rng, model.limits, 0.7).trajectory, 0.02)
    slices, rows, sweep = new_slices(), new_link_sets(), CorridorSweep(model, SLICE_S)
    n = cells.write(0, slices)
    LinkOccupancy(model).occupy(slices, rows)
    found = []
    for bad in (None, 2 * 3 + 1):
        if bad is not None:
            rows[0]["n_points"][bad] = 0
        points, radius, twist = np.zeros((n + 2, 2, 4, 3)), np.full((n + 2, 2), 7.0), np.full((n + 2, 2), 7.0)
        arrays = (points, radius, np.full(n + 2, 7.0), twist)
        arm_of = (model.kinematics, model.enclosure, sweep._fixed)
        corridor_kernels.keep_cells(rows, slices, *arm_of, sweep._bulge, 1, *arrays)
        assert (
            radius[0].tolist() == radius[-1].tolist() == twist[0].tolist() == twist[-1].tolist() == [7.0] * 2
        )
        found.append((radius, twist))
    for before, after in zip(*found, strict=True):
        assert np.isnan(after[1 + 3, 1])
        after[1 + 3, 1] = before[1 + 3, 1]
        np.testing.assert_array_equal(before, after)


def test_cells_are_placed_as_rows_of_their_slices(rng: np.random.Generator) -> None:
    points, radius = rng.normal(size=(9, 3, 4, 3)), rng.uniform(0.0, 1.0, (9, 3))
    radius[4, 1], radius[5, 0], radius[6, 2] = np.nan, 0.0, -1.0
    out = new_link_sets()
    for name in out.dtype.names or ():
        out[name] = 5
    corridor_kernels.place_cells(2, 6, points, radius, out)
    rows = out[0]
    assert rows["n"] == 18 and (rows["first"] == np.minimum(np.arange(MAX_SLICES + 1), 6) * 3).all()
    np.testing.assert_array_equal(rows["points"][:18], points[2:8].reshape(18, 4, 3))
    np.testing.assert_array_equal(rows["radius"][:18], radius[2:8].ravel())
    assert rows["n_points"][:18].tolist() == [4 if usable else 0 for usable in radius[2:8].ravel() >= 0.0]
    assert rows["slice"][:18].tolist() == np.repeat(range(6), 3).tolist()
    assert rows["owner"][:18].tolist() == [0, 1, 2] * 6
    assert not rows["covers"][:18].any() and not rows["model"][:18].any()
    assert np.isnan(rows["speed_max"][:18]).all() and (rows["n_points"][18:] == 5).all()


# -- the plans: everything on a grid of 1/8 s, so that nothing is rounded --

BEGIN_S, CELL_S, EIGHTH = 2.0, 0.25, 0.125


def random_plans(rng: np.random.Generator) -> tuple[Block, Array]:
    plans = np.zeros(int(rng.integers(1, 4)), dtype=PLANS)
    plans["t"], plans["s"] = np.nan, np.nan
    for plan in plans:
        n = int(rng.integers(1, 6))
        plan["n"] = n
        plan["t"][: n + 1] = np.cumsum([0, *rng.integers(1, 4, n)]) * EIGHTH
        steps = rng.integers(0, 4, n) * (rng.random() < 0.9)
        plan["s"][: n + 1] = BEGIN_S + np.cumsum([rng.integers(0, 9), *steps]) * EIGHTH
    return plans, np.cumsum(rng.integers(0, 3, len(plans))) * EIGHTH


def touched(low: float, high: float, n_cells: int) -> list[int]:
    """Cells that reach into a stretch, its borders included."""
    return [c for c in range(n_cells) if BEGIN_S + c * CELL_S <= high and low <= BEGIN_S + (c + 1) * CELL_S]


def plain_until(plans: Block, begins: Array, n_cells: int) -> tuple[list[int], list[float]]:
    """Cells that some plan is in, first to last, and until when."""
    until: dict[int, float] = {}
    for plan, begin in zip(plans, begins, strict=True):
        for k in range(plan["n"]):
            for cell in touched(plan["s"][k], plan["s"][k + 1], n_cells):
                until[cell] = max(until.get(cell, -np.inf), begin + plan["t"][k + 1])
    cells = list(range(min(until), max(until) + 1))
    return cells, np.maximum.accumulate([until.get(cell, -np.inf) for cell in cells]).tolist()


def ask(
    plans: Block, begins: Array, n_cells: int, people: Block, slices: Block
) -> tuple[int, Block, Block, Array]:
    radius = np.arange(2.0 * n_cells).reshape(n_cells, 2)
    points = np.zeros((n_cells, 2, 4, 3))
    links, ledger = new_link_sets(), new_ledger()
    corridor = (points, radius)
    cells = (BEGIN_S, CELL_S, 1e-3)
    found = corridor_kernels.envelop(plans, begins, cells, corridor, people, PARTS, links, slices, ledger)
    return found, links, ledger, radius


def test_one_plan_stands_for_many(rng: np.random.Generator, count: Count) -> None:
    for _ in range(max(100, count(10_000))):
        plans, begins = random_plans(rng)
        people, slices = np.zeros(1, dtype=PEOPLE), new_slices()
        people["n"] = int(rng.integers(0, 3))
        n_cells = int(rng.integers(9, 14))
        inside = all(p["s"][p["n"]] <= BEGIN_S + n_cells * CELL_S for p in plans)
        found, links, ledger, radius = ask(plans, begins, n_cells, people, slices)
        if not inside:
            assert found == corridor_kernels.OFF_PATH
            continue
        cells, until = plain_until(plans, begins, n_cells)
        assert found == slices["n"][0] == len(cells)
        assert slices["t"][0, : found + 1].tolist() == [begins[0], *until]
        assert links["n"][0] == 2 * found
        np.testing.assert_array_equal(links["radius"][0, : 2 * found], radius[cells].ravel())
        book = ledger[0]
        sizes = int(book["n_slices"]), int(book["n_links"]), int(book["n_people"])
        assert sizes == (found, 2, people["n"][0])
        expected = np.zeros_like(book["open"])
        expected[: sizes[0], : sizes[1], : sizes[2]] = PARTS
        np.testing.assert_array_equal(book["open"], expected)


def one_plan(*s: float) -> tuple[Block, Array]:
    plans = np.zeros(1, dtype=PLANS)
    plans["n"] = len(s) - 1
    plans["s"][0, : len(s)], plans["t"][0, : len(s)] = s, np.arange(len(s)) * EIGHTH
    return plans, np.zeros(1)


@pytest.mark.parametrize(
    ("s", "on_path"),
    [
        ((2.0, 3.0), True), ((2.0, 2.0), True), ((4.5, 4.5), True), ((2.5, 4.5), True),
        ((1.999, 3.0), False), ((2.5, 4.501), False), ((3.0, 2.5), False), ((2.0, 3.0, 2.5), False),
        ((np.nan, 3.0), False), ((2.5, np.nan), False), ((2.5, np.nan, 3.0), False), ((2.5, np.inf), False),
        ((3.0,), False),
    ],
)  # fmt: skip
def test_plans_that_leave_the_path_or_turn_back_have_no_cells(s: tuple[float, ...], on_path: bool) -> None:
    found, *_ = ask(*one_plan(*s), 10, np.zeros(1, dtype=PEOPLE), new_slices())
    assert (found > 0) == on_path and (found == corridor_kernels.OFF_PATH) == (not on_path)


def test_as_many_cells_as_slices_and_one_more() -> None:
    people = np.zeros(1, dtype=PEOPLE)
    for n, answer in ((MAX_SLICES, MAX_SLICES), (MAX_SLICES + 1, corridor_kernels.TOO_LONG)):
        plan = one_plan(BEGIN_S + 0.1, BEGIN_S + (n - 1) * CELL_S + 0.1)
        assert ask(*plan, 100, people, new_slices())[0] == answer
    full = one_plan(*np.full(MAX_SLICES + 1, 2.1))
    assert ask(*full, 100, people, new_slices())[0] == 1
    full[0]["n"] += 1
    assert ask(*full, 100, people, new_slices())[0] == corridor_kernels.OFF_PATH


def test_nobody_grows_backwards(rng: np.random.Generator) -> None:
    """All of a body's points, of everybody: no earlier than half of what lies between begin and first end."""
    for _ in range(200):
        people, slices = np.zeros(1, dtype=PEOPLE), new_slices()
        rows, plan = people[0], slices[0]
        plan["delay"] = rng.integers(0, 3), rng.integers(3, 5)
        rows["clock_error"], rows["stamp_error"], rows["n"] = *rng.integers(0, 3, 2), 2
        rows["t_obs"][:] = -50.0
        who, point = int(rng.integers(2)), int(rng.integers(rows["t_obs"].shape[1]))
        rows["present"][:2] = (1 << rows["t_obs"].shape[1]) - 1
        rows["t_obs"][who, point] = seen = float(rng.integers(-20, 20)) / 2.0
        begin = int(rng.integers(0, 4))
        plans, _ = one_plan(2.1, 2.2)
        plans["t"][0, 1] = 1.0
        first = begin + 1.0 + plan["delay"][1] + rows["clock_error"]
        earliest = begin + plan["delay"][0] - 2.0 * rows["stamp_error"] - rows["clock_error"]
        found, *_ = ask(plans, np.array([float(begin)]), 10, people, slices)
        assert found == (1 if first - seen >= seen - earliest else corridor_kernels.COUNTED_BACK)
        rows["present"][who] &= ~np.uint32(1 << point)
        assert ask(plans, np.array([float(begin)]), 10, people, slices)[0] == 1
    assert LEDGER["open"].shape[0] == MAX_SLICES


def test_an_arm_moves_at_its_begin_where_every_cell_there_does(rng: np.random.Generator) -> None:
    for _ in range(200):
        n_cells = int(rng.integers(1, 5))
        speed = rng.choice([0.0, 1e-3, 2e-3], n_cells)
        plans = np.zeros(4, dtype=PLANS)
        begins = BEGIN_S + rng.integers(-1, 2 * n_cells + 2, 4) * EIGHTH + rng.choice([-1e-10, 0.0, 1e-10], 4)
        begins[rng.random(4) < 0.1] = np.nan
        plans["s"][:, 0] = begins
        out = np.array([True, False, True, False])
        corridor_kernels.surely_move(plans, (BEGIN_S, CELL_S, 1e-3), speed, out)
        for s, said in zip(begins, out, strict=True):
            here = touched(s - 1e-9, s + 1e-9, n_cells)
            on_path = BEGIN_S <= s <= BEGIN_S + n_cells * CELL_S
            assert said == (on_path and all(speed[c] > 1e-3 for c in here))
