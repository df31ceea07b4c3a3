"""Corridors: every row of every plan lies in the cells of its path, for as long as they say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe import limit_kernels, path_kernels, stop_kernels
from failsafe.manoeuvre import SteadyStops
from failsafe.path_cells import PathCells
from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.scaling import limit_rows
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from occupancy import corridor_kernels
from occupancy.corridor import Corridor, CorridorSweep
from occupancy.hypotheses import PEOPLE
from occupancy.separation import LEDGER
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from robots.model import RobotModel
from robots.motion import MAX_SLICES, new_slices
from tests.failsafe.motions import random_motion
from tests.occupancy.arms import arm, axis_points, place
from tests.oracles.hulls import point_distance

Array = NDArray[np.float64]
Count = Callable[[int], int]
PARTS = 0xFFFF
ACROSS = np.array([[0.5, 0.0, 0.0, 0.5], [0.0, 0.5, 0.5, 0.0]])
"""Weights of the ends of an axis at both ends of a slice: where the hull is farthest from what is swept."""


class Setting:
    """An arm, a path within its limits, a planner, and the corridor."""

    def __init__(
        self, rng: np.random.Generator, name: str, cell_s: float, path: IntendedTrajectory | None = None
    ) -> None:
        self.model: RobotModel = arm(name, rng)
        n = len(self.model.joints)
        self.error = np.full(n, rng.choice([0.0, 0.003]))
        self.motion = random_motion(rng, self.model.limits, rng.uniform(0.3, 0.95))
        self.trajectory: IntendedTrajectory = self.motion.trajectory if path is None else path
        self.settings = PlanSettings(
            cycle_s=0.01,
            delay=(0.0, 0.01),
            q_error=self.error,
            dq_error=self.error,
            allow_joint_space=False,
            check_position_limits=False,
        )
        self.planner = ShortTermPlanner(self.model.limits, self.settings)
        self.sweep = CorridorSweep(self.model, self.settings.slice_s)
        self.corridor: Corridor = self.sweep.sweep(
            PathCells(self.trajectory, cell_s), (self.error, self.error)
        )

    def plans(self, begins: Array) -> NDArray[np.void]:
        stops = SteadyStops(12, (self.settings.slice_s, False))
        plans = np.zeros(len(begins), dtype=stop_kernels.PLANS)
        path = self.trajectory
        stop_kernels.plan_stops(
            begins,
            self.settings.cycle_s,
            path.kernel_breaks,
            path.kernel_coefficients,
            float(path.s_max),
            limit_rows(self.model.limits),
            *stops.settings,
            np.zeros(1, dtype=path_kernels.PATH),
            stops.ahead,
            np.zeros(1, dtype=limit_kernels.WORK),
            stops.search,
            plans,
        )
        return plans

    def envelop(
        self, plans: NDArray[np.void], begins: Array, people: NDArray[np.void]
    ) -> tuple[int, NDArray[np.void], NDArray[np.void], NDArray[np.void]]:
        links, slices, ledger = new_link_sets(), new_slices(), np.zeros(1, dtype=LEDGER)
        slices["delay"] = self.settings.delay
        corridor = self.corridor
        n = corridor_kernels.envelop(
            plans,
            begins,
            (corridor.begin, corridor.length, 1e-3),
            (corridor.points, corridor.radius),
            people,
            PARTS,
            links,
            slices,
            ledger,
        )
        return n, links, slices, ledger


def nobody() -> NDArray[np.void]:
    return np.zeros(1, dtype=PEOPLE)


def groups(rng: np.random.Generator, setting: Setting) -> Array:
    """Instants at which some neighbouring plans begin."""
    last = 0.7 * setting.trajectory.s_end
    return float(rng.uniform(0.0, last)) + 0.004 * np.arange(int(rng.integers(1, 5)))


@pytest.mark.parametrize("cell_s", [0.002, 0.02])
@pytest.mark.parametrize("name", ["one_turning", "about_its_middle", "planar", "six", "branches"])
def test_rows_of_every_plan_lie_in_the_cells_until_they_say(
    name: str, cell_s: float, rng: np.random.Generator, count: Count
) -> None:
    compared = 0
    for _ in range(count(200)):
        setting = Setting(rng, name, cell_s)
        compared += rows_inside(setting, groups(rng, setting), rng)
    assert compared > 0


@pytest.mark.parametrize("cell_s", [0.004, 0.02])
def test_what_turns_fast_about_its_middle_lies_in_its_cells(cell_s: float, rng: np.random.Generator) -> None:
    """The hull of a slice is far from the link then: across, between one end before and the other after."""
    path = IntendedTrajectory([0.0, 3.0], np.array([[[0.0], [2.5]]]))
    setting = Setting(rng, "about_its_middle", cell_s, path)
    assert rows_inside(setting, np.array([0.3, 0.304, 0.308]), rng) > 0


def rows_inside(setting: Setting, begins: Array, rng: np.random.Generator) -> int:
    """Hold rows of plans against the cells of all of them; return how many."""
    occupancy, rows, compared = LinkOccupancy(setting.model), new_link_sets(), 0
    plans = setting.plans(begins)
    ready = plans["outcome"] == stop_kernels.READY
    begins, plans = begins[ready], plans[ready]
    if not len(begins):
        return 0
    n, links, slices, _ = setting.envelop(plans, begins, nobody())
    if n == corridor_kernels.TOO_LONG:
        return 0
    assert n > 0
    n_links = len(setting.model.links)
    cells = links[0]["points"][: n * n_links].reshape(n, n_links, 4, 3)
    radius = links[0]["radius"][: n * n_links].reshape(n, n_links)
    until = slices[0]["t"][1 : n + 1]
    for begin in begins:
        result = setting.planner.plan(setting.trajectory, float(begin), float(begin))
        assert result.outcome is PlanOutcome.READY
        plan = setting.planner.slices
        occupancy.occupy(plan, rows)
        for row in rng.choice(int(rows[0]["n"]), 12):
            i, link = int(rows[0]["slice"][row]), int(rows[0]["owner"][row])
            there = until >= plan[0]["t"][i + 1]
            weights = np.vstack([np.eye(4), ACROSS, rng.dirichlet(np.ones(4), 4)])
            points = weights @ rows[0]["points"][row]
            room = radius[there, link] - rows[0]["radius"][row]
            apart = point_distance(points[None], cells[there, link][:, None])
            assert ((apart - room[:, None]).min(axis=0) <= 1e-9).all()
            compared += 1
    return compared


def test_until_when_a_cell_is_occupied(rng: np.random.Generator, count: Count) -> None:
    for _ in range(count(300)):
        setting = Setting(rng, "planar", 0.02)
        begins = groups(rng, setting)
        plans = setting.plans(begins)
        ready = plans["outcome"] == stop_kernels.READY
        begins, plans = begins[ready], plans[ready]
        if not len(begins):
            continue
        n, links, slices, ledger = setting.envelop(plans, begins, nobody())
        if n <= 0:
            continue
        first = int((begins[0] - 1e-9) / 0.02)
        for cell in range(n):
            low, high = (first + cell) * 0.02, (first + cell + 1) * 0.02
            ends = [
                begin + plan["t"][k + 1]
                for begin, plan in zip(begins, plans, strict=True)
                for k in range(plan["n"])
                if plan["s"][k] <= high and plan["s"][k + 1] >= low
            ]
            # one slice may touch a border that roundings put into the other cell
            assert max(ends) - 1e-9 <= slices[0]["t"][cell + 1] <= max(ends) + 0.011
        assert slices[0]["t"][0] == begins[0]
        assert slices[0]["n"] == ledger[0]["n_slices"] == n
        assert (links[0]["first"][: n + 1] == np.arange(n + 1) * len(setting.model.links)).all()


def test_an_arm_that_surely_moves_does(rng: np.random.Generator, count: Count) -> None:
    sure = 0
    for _ in range(count(200)):
        setting = Setting(rng, "six", float(rng.choice([0.002, 0.02])))
        corridor, local = setting.corridor, axis_points(setting.model, np.array([0.0, 1.0]))
        cell = int(rng.integers(0, len(corridor.speed) - 1))
        s = corridor.begin + corridor.length * (cell + rng.random(20))
        tiny = 1e-6
        ahead, behind = (
            place(setting.model, setting.motion.derivatives(s + sign * tiny)[0], local) for sign in (1, -1)
        )
        fastest = (np.linalg.norm(ahead - behind, axis=-1) / (2.0 * tiny)).reshape(len(s), -1).max(axis=1)
        assert corridor.speed[cell] <= fastest.min() + 1e-6
        sure += corridor.speed[cell] > 1e-3
    assert sure > 0


def test_people_seen_after_the_plans_begin_are_left_to_the_ordinary_check() -> None:
    setting = Setting(np.random.default_rng(1), "planar", 0.02)
    begins = np.array([0.5])
    plans = setting.plans(begins)
    assert plans["outcome"][0] == stop_kernels.READY
    people = nobody()
    people["n"], people["present"][0, 0] = 1, 1
    for seen, possible in ((0.4, True), (0.5, True), (np.nan, False), (9.0, False)):
        people["t_obs"][0, 0, 0] = seen
        n, *_, ledger = setting.envelop(plans, begins, people)
        assert (n > 0) == possible
        if possible:
            assert (ledger[0]["open"][:n, : len(setting.model.links), 0] == PARTS).all()
        else:
            assert n == corridor_kernels.COUNTED_BACK


def test_cells_that_make_no_sense_prove_nothing() -> None:
    setting = Setting(np.random.default_rng(1), "planar", 0.02)
    setting.sweep.forbid(setting.corridor, lambda _links, _slices: False)
    assert np.isnan(setting.corridor.radius).all()
    begins = np.array([0.5])
    n, links, *_ = setting.envelop(setting.plans(begins), begins, nobody())
    assert n > 0
    assert (links[0]["n_points"][: links[0]["n"]] == 0).all()
    plans = setting.plans(begins)
    plans["s"][0] = np.nan
    n, *_ = setting.envelop(plans, begins, nobody())
    assert n <= 0


def test_a_sliding_joint_and_too_many_cells_are_left_to_the_ordinary_check() -> None:
    rng = np.random.default_rng(1)
    assert not CorridorSweep(arm("scara", rng), 0.01).possible
    setting = Setting(rng, "planar", 0.001)
    begins = np.array([0.5, 0.6])
    plans = setting.plans(begins)
    assert plans["s_rest"][1] - 0.5 > 0.001 * MAX_SLICES
    assert setting.envelop(plans, begins, nobody())[0] == corridor_kernels.TOO_LONG
