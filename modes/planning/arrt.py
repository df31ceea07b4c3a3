"""Two trees of configurations that grow towards each other: the paper's planner, and one that rewires.

The paper's A-RRT* is RRT-Connect: it has neither rewiring nor A*. ``"connect"`` is that, ``"rewired"`` goes
on after the first path and reconnects nodes where that makes ways shorter. Its (8) wraps every angle modulo
2π, which would turn joints with limits of ±360° through them; here no angle jumps, and every configuration
within the limits that is the goal plus whole turns is a goal; the nearest 16 are tried.

Every edge is proven clear, not sampled (:meth:`~modes.planning.potential_field.Field.is_clear_between`).
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.planning.avoided import Avoided
from modes.planning.lines import Lines, shortened
from modes.planning.potential_field import Bodies, Field
from modes.settings import require_choice, require_count, require_number, require_numbers
from robots.errors import SetupError

Array = NDArray[np.float64]
Variant = Literal["connect", "rewired"]
VARIANTS: tuple[Variant, ...] = ("connect", "rewired")

_GOALS = 16


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How the trees grow.

    Attributes
    ----------
    variant:
        ``"connect"``: the first path; ``"rewired"``: shorter ways until the nodes are used up.
    step_rad:
        Longest edge [rad]; twice as long where ways are led over a new node (``"rewired"``).
    goal_bias:
        Share of samples that are the goal; the paper's 10 %.
    spread_rad:
        Standard deviation of samples around the goal [rad]; the paper does not give it. Every second sample
        is drawn around a place between start and goal, so that what is far from the goal is reached as well.
    nodes:
        No more than so many in both trees.
    shortcuts:
        How often a piece of the path is replaced by a straight line, where that is clear.
    limit_margin_rad:
        Samples and turned goals keep this far from the position limits, so that an arm that is not quite
        where it should be does not leave them [rad].
    seed:
        Of the samples.
    """

    variant: Variant = "connect"
    step_rad: float = 0.8
    goal_bias: float = 0.1
    spread_rad: float = 1.0
    nodes: int = 2000
    shortcuts: int = 60
    limit_margin_rad: float = 0.01
    seed: int = 0

    def __post_init__(self) -> None:
        require_choice("planner: variant", self.variant, VARIANTS)
        require_number("planner: step_rad", self.step_rad, 1e-3, 10.0)
        require_number("planner: goal_bias", self.goal_bias, 0.0, 1.0)
        require_number("planner: spread_rad", self.spread_rad, 1e-3, 10.0)
        require_count("planner: nodes", self.nodes, 2, 1_000_000)
        require_count("planner: shortcuts", self.shortcuts, 0, 1_000_000)
        require_number("planner: limit_margin_rad", self.limit_margin_rad, 0.0, 1.0)
        require_count("planner: seed", self.seed, 0, 2**63 - 1)


class NoPath(Enum):
    """Why there is no path."""

    START_BEYOND_LIMITS = "the arm is beyond its position limits"
    START_NEAR = "somebody is nearer to the arm, where it is, than the clearance"
    GOAL_NEAR = "somebody is nearer to the goal than the clearance"
    GOAL_BEYOND_LIMITS = "the goal is beyond the position limits"
    GOAL_AVOIDED = "the goal is where no path may lead"
    NODES_USED_UP = "no path was found with so many nodes"


class Found(NamedTuple):
    """What came of planning.

    Attributes
    ----------
    path:
        ``(k, n)`` configurations from start to goal [rad; m], straight lines between; ``None``: none.
    reason:
        Why not.
    nodes:
        How many both trees had.
    """

    path: Array | None
    reason: NoPath | None
    nodes: int

    @property
    def length(self) -> float:
        """Length of the path [rad]; inf without one."""
        if self.path is None:
            return math.inf
        return float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())


@dataclass(slots=True)
class _Tree:
    """Configurations, each with the one it was reached from, and what the way costs [rad]."""

    q: Array
    parent: list[int] = field(default_factory=list)
    cost: list[float] = field(default_factory=list)

    @property
    def size(self) -> int:
        return len(self.parent)

    def add(self, q: Array, parent: int, cost: float) -> int:
        if self.size == len(self.q):
            self.q = np.concatenate((self.q, np.empty_like(self.q)))
        self.q[self.size] = q
        self.parent.append(parent)
        self.cost.append(cost)
        return self.size - 1

    def way(self, node: int) -> list[Array]:
        """Return configurations from ``node`` to its root."""
        found = []
        while node >= 0:
            found.append(self.q[node].copy())
            node = self.parent[node]
        return found


class Planner:
    """Plans for one arm among people.

    Parameters
    ----------
    field:
        How near is too near.
    settings:
        How the trees grow.
    """

    def __init__(self, field: Field, settings: PlannerSettings | None = None) -> None:
        self.field = field
        self.settings = PlannerSettings() if settings is None else settings
        limits = field.robot.limits
        self._low, self._high = limits.position_lower, limits.position_upper
        margin = np.minimum(self.settings.limit_margin_rad, 0.5 * (self._high - self._low))
        self._inner = self._low + margin, self._high - margin

    def plan(self, start: Array, goal: Array, bodies: Bodies, avoid: Avoided | None = None) -> Found:
        """Return a path from ``start`` to ``goal`` (n,) [rad; m] that keeps the clearance in all frames.

        ``avoid``: balls that no line enters. Those around the start are shrunk until it is outside, so that
        the arm can leave them; goals in them are none.

        Raises
        ------
        SetupError
            Start, goal or balls are not of this arm.
        """
        start, goal = self._configuration(start, "start"), self._configuration(goal, "goal")
        lines = Lines(self.field, bodies, self._avoided(avoid, start))
        if not ((self._low <= start) & (start <= self._high)).all():
            return Found(None, NoPath.START_BEYOND_LIMITS, 0)
        turned = self.goals(start, goal)
        goals = [each for each in turned if not lines.avoided.contains(each)]
        if not goals:
            return Found(None, NoPath.GOAL_AVOIDED if turned else NoPath.GOAL_BEYOND_LIMITS, 0)
        if not self.field.is_clear(start, bodies):
            return Found(None, NoPath.START_NEAR, 0)
        if not self.field.is_clear(goals[0], bodies):
            return Found(None, NoPath.GOAL_NEAR, 0)
        for each in goals:
            if lines.are_clear(start, each):
                return Found(np.array([start, each]), None, 2)
        search = _Search(self.settings, lines, start, goals, self._inner)
        path = search.run()
        if path is None:
            return Found(None, NoPath.NODES_USED_UP, search.nodes)
        return Found(shortened(path, lines, self.settings.shortcuts, self.settings.seed), None, search.nodes)

    def _configuration(self, q: Array, name: str) -> Array:
        return require_numbers(f"planner: {name}", q, (len(self.field.robot.joints),))

    def _avoided(self, avoid: Avoided | None, start: Array) -> Avoided:
        if avoid is None:
            return Avoided.nothing(len(start))
        if avoid.centre.shape[1] != len(start):
            raise SetupError(
                f"planner: avoided balls have {avoid.centre.shape[1]} coordinates, not {len(start)}"
            )
        return avoid.without(start)

    def goals(self, start: Array, goal: Array) -> list[Array]:
        """Return the goal, and it plus whole turns well within the limits, the nearest first."""
        prismatic = self.field.robot.kinematics[0]["prismatic"]
        best: list[tuple[float, tuple[float, ...]]] = [(0.0, ())]
        for j, (begin, end) in enumerate(zip(start.tolist(), goal.tolist(), strict=True)):
            turns = (
                [0] if prismatic[j] else [round((begin - end) / (2.0 * math.pi)) + k for k in range(-2, 3)]
            )
            places = [end + 2.0 * math.pi * k for k in turns]
            low, high = self._inner[0][j], self._inner[1][j]
            within = [each for each in places if low <= each <= high or self._is_given(each, end, j)]
            longer = [(way + (q - begin) ** 2, (*head, q)) for way, head in best for q in within]
            best = heapq.nsmallest(_GOALS, longer)
        return [np.array(q) for _way, q in best]

    def _is_given(self, q: float, goal: float, joint: int) -> bool:
        """Whether it is the goal itself, within the limits."""
        return q == goal and bool(self._low[joint] <= q <= self._high[joint])


class _Search:
    """One search: two trees that grow towards each other."""

    def __init__(
        self,
        settings: PlannerSettings,
        lines: Lines,
        start: Array,
        goals: list[Array],
        limits: tuple[Array, Array],
    ) -> None:
        self._settings, self._lines, self._limits = settings, lines, limits
        self._random = np.random.default_rng(settings.seed)
        self._start, self._goal = start, goals[0]
        n = len(start)
        self._trees = _Tree(np.empty((64, n))), _Tree(np.empty((64, n)))
        self._trees[0].add(start, -1, 0.0)
        for goal in goals:
            self._trees[1].add(goal, -1, 0.0)

    @property
    def nodes(self) -> int:
        """How many both trees have."""
        return self._trees[0].size + self._trees[1].size

    def run(self) -> list[Array] | None:
        """Grow until they meet, and in the variant ``"rewired"`` until the nodes are used up."""
        best: tuple[float, list[Array]] | None = None
        turn, tries = 0, 0
        while self.nodes < self._settings.nodes and tries < 20 * self._settings.nodes:
            tries += 1
            one, other = self._trees[turn], self._trees[1 - turn]
            new = self._extend(one, self._sample())
            if new is not None:
                met = self._connect(other, one.q[new])
                if met is not None:
                    cost = one.cost[new] + other.cost[met]
                    if best is None or cost < best[0]:
                        ways = one.way(new)[::-1], other.way(met)[1:]
                        path = [*ways[0], *ways[1]]
                        best = cost, path if turn == 0 else path[::-1]
                    if self._settings.variant == "connect":
                        break
            turn = 1 - turn
        return None if best is None else best[1]

    def _sample(self) -> Array:
        if self._random.uniform() < self._settings.goal_bias:
            return self._goal
        middle = self._goal
        if self._random.uniform() < 0.5:
            middle = self._start + self._random.uniform() * (self._goal - self._start)
        drawn = middle + self._settings.spread_rad * self._random.normal(size=len(middle))
        return np.clip(drawn, *self._limits)

    def _extend(self, tree: _Tree, towards: Array) -> int | None:
        """Add the node a step from the nearest one towards a sample; ``None``: the edge is not clear."""
        away = np.linalg.norm(tree.q[: tree.size] - towards, axis=1)
        near = int(np.argmin(away))
        if away[near] == 0.0:
            return near
        share = min(1.0, self._settings.step_rad / float(away[near]))
        q = tree.q[near] + share * (towards - tree.q[near]) if share < 1.0 else towards
        if not self._lines.are_clear(tree.q[near], q):
            return None
        if self._settings.variant == "rewired":
            return self._rewire(tree, q, near)
        return tree.add(q, near, tree.cost[near] + share * float(away[near]))

    def _connect(self, tree: _Tree, q: Array) -> int | None:
        """Grow a tree step by step as far as ``q``; ``None``: something is in the way."""
        while True:
            node = self._extend(tree, q)
            if node is None:
                return None
            if np.array_equal(tree.q[node], q):
                return node
            if self.nodes >= self._settings.nodes:
                return None

    def _rewire(self, tree: _Tree, q: Array, near: int) -> int:
        """Add ``q`` where the way to it is shortest; lead ways of its neighbours over it if shorter."""
        away = np.linalg.norm(tree.q[: tree.size] - q, axis=1)
        around = np.flatnonzero(away <= 2.0 * self._settings.step_rad)
        parent, cost = near, tree.cost[near] + float(away[near])
        for k in around.tolist():
            through = tree.cost[k] + float(away[k])
            if through < cost - 1e-9 and self._lines.are_clear(tree.q[k], q):
                parent, cost = k, through
        node = tree.add(q, parent, cost)
        for k in around.tolist():
            through = cost + float(away[k])
            shorter = tree.parent[k] >= 0 and through < tree.cost[k] - 1e-9
            if shorter and self._lines.are_clear(q, tree.q[k]):
                self._lead_over(tree, k, node, through)
        return node

    def _lead_over(self, tree: _Tree, child: int, parent: int, cost: float) -> None:
        """Give a node another parent, and all that hang on it the costs that follow."""
        saved = tree.cost[child] - cost
        tree.parent[child] = parent
        waiting = [child]
        while waiting:
            node = waiting.pop()
            tree.cost[node] -= saved
            waiting += [k for k in range(tree.size) if tree.parent[k] == node]
