"""Two trees of configurations that grow towards each other: the paper's planner, and one that rewires.

The paper's A-RRT* is RRT-Connect: it has neither rewiring nor A*. ``"connect"`` is that, ``"rewired"`` goes
on after the first path and reconnects nodes where that makes ways shorter. Its (8) wraps every angle modulo
2π, which would turn joints with limits of ±360° through them; here no angle jumps, and every configuration
within the limits that is the goal plus whole turns is a goal.

Every edge is proven clear, not sampled (:meth:`~modes.planning.potential_field.Field.is_clear_between`).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies, Field
from modes.settings import require_choice, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
Variant = Literal["connect", "rewired"]
VARIANTS: tuple[Variant, ...] = ("connect", "rewired")

_GOALS = 16
_SLACK_M = 0.005


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How the trees grow.

    Attributes
    ----------
    variant:
        ``"connect"``: the first path; ``"rewired"``: shorter ways until the nodes are used up.
    step_rad:
        Longest edge [rad].
    goal_bias:
        Share of samples that are the goal; the paper's 10 %.
    spread_rad:
        Standard deviation of samples around the goal [rad]; the paper does not give it. Every second sample
        is drawn around a place between start and goal, so that what is far from the goal is reached as well.
    nodes:
        No more than so many in both trees.
    shortcuts:
        How often a piece of the path is replaced by a straight line, where that is clear.
    seed:
        Of the samples.
    """

    variant: Variant = "connect"
    step_rad: float = 0.4
    goal_bias: float = 0.1
    spread_rad: float = 1.0
    nodes: int = 2000
    shortcuts: int = 60
    seed: int = 0

    def __post_init__(self) -> None:
        require_choice("planner: variant", self.variant, VARIANTS)
        require_number("planner: step_rad", self.step_rad, 1e-3, 10.0)
        require_number("planner: goal_bias", self.goal_bias, 0.0, 1.0)
        require_number("planner: spread_rad", self.spread_rad, 1e-3, 10.0)
        require_number("planner: nodes", self.nodes, 2, 1_000_000)
        require_number("planner: shortcuts", self.shortcuts, 0, 1_000_000)


class NoPath(Enum):
    """Why there is no path."""

    START_NEAR = "somebody is nearer to the arm, where it is, than the clearance"
    GOAL_NEAR = "somebody is nearer to the goal than the clearance"
    GOAL_BEYOND_LIMITS = "the goal is beyond the position limits"
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
        self._endless = np.isinf(self._low) & np.isinf(self._high)

    def plan(self, start: Array, goal: Array, bodies: Bodies) -> Found:
        """Return a path from ``start`` to ``goal`` (n,) [rad; m] that keeps the clearance in all frames.

        Raises
        ------
        SetupError
            Start or goal is no configuration of the arm.
        """
        self._require(start, "start")
        self._require(goal, "goal")
        goals = self._goals(start, goal)
        if not goals:
            return Found(None, NoPath.GOAL_BEYOND_LIMITS, 0)
        if not self.field.is_clear(start, bodies):
            return Found(None, NoPath.START_NEAR, 0)
        if not self.field.is_clear(goals[0], bodies):
            return Found(None, NoPath.GOAL_NEAR, 0)
        for each in goals:
            if self._clear(start, each, bodies):
                return Found(np.array([start, each]), None, 2)
        search = _Search(self, start, goals, bodies)
        path = search.run()
        if path is None:
            return Found(None, NoPath.NODES_USED_UP, search.nodes)
        return Found(self._shortened(path, bodies), None, search.nodes)

    def _require(self, q: Array, name: str) -> None:
        n = len(self.field.robot.joints)
        if np.shape(q) != (n,) or not np.isfinite(q).all():
            raise SetupError(f"planner: {name} should be {n} finite numbers, not {np.asarray(q).tolist()!r}")

    def _goals(self, start: Array, goal: Array) -> list[Array]:
        """Return the goal plus whole turns, within the limits, the nearest first."""
        turns = []
        prismatic = self.field.robot.kinematics[0]["prismatic"]
        for j in range(len(goal)):
            near = goal[j]
            if not prismatic[j]:
                near = goal[j] - 2.0 * math.pi * round((goal[j] - start[j]) / (2.0 * math.pi))
            choices = (near,) if prismatic[j] else (near, near - 2.0 * math.pi, near + 2.0 * math.pi)
            turns.append([each for each in choices if self._low[j] <= each <= self._high[j]][:2])
        found = [np.array(each) for each in itertools.islice(itertools.product(*turns), 64)]
        return sorted(found, key=lambda q: float(np.linalg.norm(q - start)))[:_GOALS]

    def _clear(self, a: Array, b: Array, bodies: Bodies) -> bool:
        return self.field.is_clear_between(a, b, bodies, _SLACK_M)

    def _shortened(self, path: list[Array], bodies: Bodies) -> Array:
        """Replace pieces of a path by straight lines where these are clear."""
        random = np.random.default_rng([self.settings.seed, 1])
        points = path
        for _ in range(self.settings.shortcuts):
            if len(points) < 3:
                break
            (i, s), (j, t) = sorted(_drawn(random, len(points)) for _k in range(2))
            if j == i:
                continue
            a = points[i] + s * (points[i + 1] - points[i])
            b = points[j] + t * (points[j + 1] - points[j])
            if self._clear(a, b, bodies):
                points = [*points[: i + 1], a, b, *points[j + 1 :]]
        return np.array([points[0], *(q for p, q in itertools.pairwise(points) if (p != q).any())])


def _drawn(random: np.random.Generator, count: int) -> tuple[int, float]:
    return int(random.integers(count - 1)), float(random.uniform())


class _Search:
    """One search: two trees that grow towards each other."""

    def __init__(self, planner: Planner, start: Array, goals: list[Array], bodies: Bodies) -> None:
        self._planner, self._settings, self._bodies = planner, planner.settings, bodies
        self._random = np.random.default_rng(self._settings.seed)
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
        return np.clip(drawn, self._planner._low, self._planner._high)

    def _extend(self, tree: _Tree, towards: Array) -> int | None:
        """Add the node a step from the nearest one towards a sample; ``None``: the edge is not clear."""
        away = np.linalg.norm(tree.q[: tree.size] - towards, axis=1)
        near = int(np.argmin(away))
        if away[near] == 0.0:
            return near
        share = min(1.0, self._settings.step_rad / float(away[near]))
        q = tree.q[near] + share * (towards - tree.q[near])
        if not self._planner._clear(tree.q[near], q, self._bodies):
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
            if through < cost - 1e-9 and self._planner._clear(tree.q[k], q, self._bodies):
                parent, cost = k, through
        node = tree.add(q, parent, cost)
        for k in around.tolist():
            through = cost + float(away[k])
            shorter = tree.parent[k] >= 0 and through < tree.cost[k] - 1e-9
            if shorter and self._planner._clear(q, tree.q[k], self._bodies):
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
