"""Neighbouring cycles proven together: one plan that contains theirs, against what they all know of people.

Cycles between two reports know the same people block and drive nearly the same stretch of path. Their plans
lie in cells of one corridor (:mod:`occupancy.corridor`), each until some instant; that is one plan more which
contains them all. If it is apart from everybody, so is each of them, and the ordinary check would have proven
it: rows that it compares lie inside of those compared here. What is not proven here is left to the ordinary
check, one cycle at a time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from failsafe import limit_kernels, path_kernels, stop_kernels
from failsafe.manoeuvre import SteadyStops
from failsafe.path_cells import PathCells
from failsafe.scaling import limit_rows
from failsafe.trajectory import LATEST_S, IntendedTrajectory
from occupancy import corridor_kernels
from occupancy.corridor import Corridor, CorridorSweep
from occupancy.humans.articulated import ArticulatedVelocity
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.model import HumanModel, Occupancy
from occupancy.separation import LEDGER, Separation
from occupancy.sets import MAX_PEOPLE, new_link_sets
from robots.enclosure import MAX_LINKS
from robots.model import RobotModel
from robots.motion import Block, new_slices
from verifier.cell import Cell
from verifier.criteria import WorkspaceCriterion
from verifier.cycle import CycleCheck, Known
from verifier.section import Section

Array = NDArray[np.float64]

MOST_CYCLES = 64
"""Cycles that are proven together."""
CELL_S = 0.02
"""Length of the cells of a corridor [s of path]."""
_WORTH_SPLITTING_M = -0.05
"""A group that lacks more than this [m] is not tried again in two halves."""
_APART, _NOT_APART = 1, 2
_SURELY = 1.0 + 1e-6
_PLAIN_MODELS: tuple[type[HumanModel], ...] = (Iso13855, ArticulatedVelocity)
"""Models whose rows only grow with time: those of a long slice contain those of every part of it."""


@dataclass(frozen=True, slots=True)
class Plans:
    """Plans of cycles in the order of time: which ones (N,), their begins (N,) [s], their blocks (PLANS)."""

    which: NDArray[np.intp]
    begins: Array
    blocks: Block

    def chosen(self, of: slice | NDArray[np.bool_]) -> Plans:
        """Return some of the plans."""
        return Plans(self.which[of], self.begins[of], self.blocks[of])


@dataclass(frozen=True, slots=True)
class Proven:
    """Plans that were proven together, and a certified lower bound of the gap of each [m]."""

    plans: Plans
    gap_m: float


def _apart(criterion: WorkspaceCriterion, n_links: int) -> Callable[[Block, Block], bool]:
    """Return what tells whether all rows of the links are apart from every fixture."""
    active = np.zeros(MAX_LINKS, dtype=np.uint8)
    active[:n_links] = 1
    return lambda links, slices: criterion.check(links, slices, active) is None


class QuickProof:
    """Plans and proves cycles of one cell, many in one call.

    Attributes
    ----------
    possible:
        Whether anything can be proven so: every joint turns, the model of people that is asked first only
        grows with time, and nothing has to be looked at besides people but fixtures: no reaction to silence,
        no stop that was measured.
    """

    def __init__(self, cell: Cell, robot: RobotModel, check: CycleCheck) -> None:
        self._cycle_s, self._margin = cell.cycle_s, cell.check.margin_m
        self._parts = check.settings.parts
        self._moves = check.settings.standstill.speed_m_s * _SURELY + 1e-9
        self._workspaces = [each for each in check.robot_criteria if isinstance(each, WorkspaceCriterion)]
        self._sweep = CorridorSweep(robot, cell.stop.slice_s)
        self._slice_s = cell.stop.slice_s
        model = check.occupancies[0].model
        self.possible = (
            self._sweep.possible
            and not check.settings.assume_nobody
            and not cell.check.cross_check
            and cell.robot.silence is None
            and cell.stop.model == "path_consistent"
            and isinstance(model, _PLAIN_MODELS)
            and len(self._workspaces) == len(check.robot_criteria)
        )
        self._occupancy = Occupancy(model)
        self._separation = Separation(self._margin, gjk_limit=0, boxes_first=True)
        self._limits = limit_rows(robot.limits)
        self._stops: SteadyStops | None = None
        self._path: Block = np.zeros(1, dtype=path_kernels.PATH)
        self._work: Block = np.zeros(1, dtype=limit_kernels.WORK)
        self._plans: Block = np.zeros(MOST_CYCLES, dtype=stop_kernels.PLANS)
        self._links: Block = new_link_sets()
        self._slices: Block = new_slices()
        self._ledger: Block = np.zeros(1, dtype=LEDGER)
        self._trajectories: tuple[IntendedTrajectory, ...] = ()
        self._corridors: list[Corridor] = []
        self._chosen = 0

    def begin(self, section: Section) -> None:
        """Sweep the paths of a section; what is asked from now on is about it."""
        record = section.planner.slices[0]
        n = int(record["n_joints"])
        self._slices["delay"], self._slices["n_joints"] = record["delay"], n
        self._trajectories = section.trajectories
        settings = section.planner.settings
        proof = settings.slice_s, settings.check_position_limits
        self._stops = SteadyStops(settings.search_steps, proof)
        self._corridors = []
        for trajectory in section.trajectories:
            cells = PathCells(trajectory, CELL_S)
            corridor = self._sweep.sweep(cells, (record["q_error"][:n], record["dq_error"][:n]))
            for criterion in self._workspaces:
                self._sweep.forbid(corridor, _apart(criterion, len(corridor.radius[0])))
            self._corridors.append(corridor)

    def plan(self, t: Array) -> Plans:
        """Plan the cycles at ``t`` (N,) [s, increasing], at most 64, with ṡ = 1.

        Left out are those without a plan, and those whose plan must be made by itself: not on one path with
        the first, or with slices longer than wanted.
        """
        begins = t + self._cycle_s
        self._chosen = bisect_right(self._trajectories, begins[0], key=attrgetter("s_begin")) - 1
        if self._chosen < 0 or self._stops is None:
            return Plans(np.arange(0), begins[:0], self._plans[:0])
        path, corridor = self._trajectories[self._chosen], self._corridors[self._chosen]
        later = self._trajectories[self._chosen + 1 : self._chosen + 2]
        ends = begins + self._cycle_s
        on_path = (ends <= path.s_max) & (ends <= LATEST_S)
        if later:
            on_path &= begins < later[0].s_begin
        which = np.flatnonzero(on_path)
        plans = Plans(which, begins[which], self._plans[: len(which)])
        stop_kernels.plan_stops(
            plans.begins,
            self._cycle_s,
            path.kernel_breaks,
            path.kernel_coefficients,
            float(path.s_max),
            self._limits,
            *self._stops.settings,
            self._path,
            self._stops.ahead,
            self._work,
            self._stops.search,
            plans.blocks,
        )
        useful = np.zeros(len(which), dtype=np.bool_)
        corridor_kernels.surely_move(plans.blocks, self._cells(corridor), corridor.speed, useful)
        useful &= plans.blocks["outcome"] == stop_kernels.READY
        useful &= plans.blocks["longest"] <= self._slice_s * _SURELY
        return plans if useful.all() else plans.chosen(useful)

    def proven(self, plans: Plans, known: Known) -> Iterator[Proven]:
        """Yield which of the plans are proven apart from everybody, together or in smaller groups."""
        if self._answerable(known):
            yield from self._proven(plans, known)

    def _answerable(self, known: Known) -> bool:
        """Whether the ordinary check would look at pairs of links and people, and at nothing else."""
        people = known.people[0]
        plain = known.reported and not known.inconsistent and not known.overflow
        return plain and 0 < int(people["n"]) <= MAX_PEOPLE and not people["unlisted"]

    def _proven(self, plans: Plans, known: Known) -> Iterator[Proven]:
        count = len(plans.which)
        if count == 0:
            return
        answer, gap = self._apart(plans, known)
        if answer == _APART:
            yield Proven(plans, gap)
        elif count > 1 and (answer == corridor_kernels.TOO_LONG or gap > _WORTH_SPLITTING_M):
            yield from self._proven(plans.chosen(slice(0, count // 2)), known)
            yield from self._proven(plans.chosen(slice(count // 2, count)), known)

    def _apart(self, plans: Plans, known: Known) -> tuple[int, float]:
        """Hold the plan that contains ``plans`` against everybody; return the answer and its gap [m]."""
        corridor = self._corridors[self._chosen]
        cells = corridor_kernels.envelop(
            plans.blocks,
            plans.begins,
            self._cells(corridor),
            (corridor.points, corridor.radius),
            known.people,
            self._parts,
            self._links,
            self._slices,
            self._ledger,
        )
        if cells <= 0:
            return cells, -math.inf
        self._occupancy.begin(known.people, self._slices)
        found = self._separation.check(self._links, self._occupancy.sets, self._ledger)
        return _APART if found.separated else _NOT_APART, found.gap_m

    def _cells(self, corridor: Corridor) -> tuple[float, float, float]:
        return corridor.begin, corridor.length, self._moves
