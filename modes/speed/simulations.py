"""The paper's two simulations (section IV): an end effector on a line, a hand that goes up and down.

Everything is as in docs/speed.md, *What was filled in*: among others the centre of the end effector's ball,
44.43 mm above the flange, which two of the paper's own numbers give.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from modes.speed.comparison import Sign, hwang_speed, morato_speed
from modes.speed.danger_index import Ellipsoids, Index, danger_index, pair_quadratics
from modes.speed.exact import exact_speed
from modes.speed.genetic import Evolution, GeneticSettings, evolve
from modes.speed.objective import Goal, Weights
from modes.speed.prediction import make_prediction
from robots.errors import SetupError

Array = NDArray[np.float64]
Method = Literal["none", "proposed", "genetic", "hwang", "hwang_corrected", "morato"]
METHODS: tuple[Method, ...] = ("none", "proposed", "genetic", "hwang", "hwang_corrected", "morato")

RADIUS_M = 0.05
"""Of the hand and of the end effector."""
BALL_ABOVE_FLANGE_M = 0.04443
SAMPLES = 60
"""A run that has not come to its goal by then has not come to it."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A robot's ball on a route of straight lines and hands as balls, at samples from 1.

    Attributes
    ----------
    name:
        Of the scene.
    corners:
        ``(C, 3)``: the route of the flange, from its begin to its goal [m].
    programmed:
        Speed along the route, with the sign that the paper gives it [m/s].
    hands:
        ``(samples, hands, 3)``: where their centres are [m]; NaN: nobody is seen.
    waits:
        Corner -> samples for which the robot waits there.
    interval_s:
        Between samples.

    Raises
    ------
    SetupError
        There is no hand, or no way to go.
    """

    name: str
    corners: Array
    programmed: float
    hands: Array
    waits: dict[int, int] = field(default_factory=dict)
    interval_s: float = 0.1

    def __post_init__(self) -> None:
        shape = self.hands.shape
        if len(shape) != 3 or shape[2] != 3 or shape[1] == 0:
            raise SetupError(f"scene {self.name}: hands of shape {shape} should be (samples, hands, 3)")
        if len(self.corners) < 2 or not (np.diff(self.reached()) > 0.0).all():
            raise SetupError(f"scene {self.name}: its corners should be two or more, and apart")

    def reached(self) -> Array:
        """Return the way from the begin at which each corner is reached ``(C,)`` [m]."""
        legs = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        return np.concatenate(([0.0], np.cumsum(legs)))

    @property
    def sign(self) -> float:
        """1 or -1: a speed with this sign goes on along the route."""
        return math.copysign(1.0, self.programmed)

    def at(self, way: float) -> tuple[Array, Array]:
        """Return the flange (3,) [m] at ``way`` [m] of the route, and the direction (3,) onwards."""
        reached = self.reached()
        leg = min(max(int(np.searchsorted(reached, way + 1e-9, side="right")) - 1, 0), len(reached) - 2)
        line = self.corners[leg + 1] - self.corners[leg]
        direction = line / np.linalg.norm(line)
        return self.corners[leg] + (way - reached[leg]) * direction, direction


def simulation(number: int) -> Scene:
    """Return the paper's simulation 1 or 2; the second is the first one's mirror image."""
    side = {1: 1.0, 2: -1.0}[number]
    up = np.clip(np.arange(SAMPLES + 1), 0, 8)
    down = np.clip(np.arange(SAMPLES + 1) - 11, 0, 8)
    hands = np.empty((SAMPLES + 1, 1, 3))
    hands[:, 0] = np.column_stack(
        (np.full(len(up), 0.4), np.full(len(up), 0.14 * side), 0.62 + 0.01 * (up - down))
    )
    corners = np.array([[0.368, 0.0, 0.6685], [0.368, 0.12 * side, 0.6685]])
    return Scene(f"simulation {number}", corners, 0.05 * side, hands)


@dataclass(frozen=True, slots=True)
class Choice:
    """How speeds are chosen.

    Attributes
    ----------
    method:
        *none*: the programmed speed; *proposed*: the exact optimum of the paper's objective; *genetic*: what
        its algorithm finds.
    """

    method: Method = "proposed"
    weights: Weights = field(default_factory=Weights)
    index: Index = "transformed"
    prediction: str = "constant_velocity"
    genetic: GeneticSettings = field(default_factory=GeneticSettings)
    ball_above_flange_m: float = BALL_ABOVE_FLANGE_M
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What became of it; index 0 is sample 1.

    Attributes
    ----------
    danger_index:
        At each sample.
    speed:
        Chosen at each sample [m/s]; one fewer where the goal is reached.
    place:
        ``(samples, 3)``: centre of the robot's ball [m].
    gap:
        Between the surfaces at each sample [m].
    goal_sample:
        The sample at which the goal is reached; ``None``: it is not.
    first_evolution:
        Of the genetic algorithm, its first decision.
    """

    danger_index: Array
    speed: Array
    place: Array
    gap: Array
    goal_sample: int | None
    first_evolution: Evolution | None = None

    def jerk(self, first: int, last: int, interval_s: float = 0.1) -> Array:
        """Return (V(k) - 2 V(k - 1) + V(k - 2)) / Δt² [mm/s³] for the samples from ``first`` to ``last``.

        After the goal the speed is 0.
        """
        v = np.concatenate((self.speed, np.zeros(last)))[:last] * 1e3
        k = np.arange(first - 1, last)
        return np.asarray((v[k] - 2.0 * v[k - 1] + v[k - 2]) / interval_s**2)


def mean_and_deviation(jerk: Array) -> tuple[float, float]:
    """Return mean and sample standard deviation (ddof 1), as in the paper's Table 1."""
    return float(jerk.mean()), float(jerk.std(ddof=1))


def run(scene: Scene, choice: Choice | None = None) -> Run:
    """Go through a scene."""
    choice = choice or Choice()
    rng = np.random.default_rng(choice.seed)
    prediction = make_prediction(choice.prediction, scene.hands.shape[1])
    follower, h = _Follower(scene), scene.interval_s
    previous, first, reached = scene.programmed, None, None
    index, speeds, places, gaps = [], [], [], []
    for k, hands in enumerate(scene.hands):
        flange, onwards = scene.at(follower.way)
        place = flange + np.array([0.0, 0.0, choice.ball_above_flange_m])
        robot = Ellipsoids.balls(place[None], RADIUS_M)
        seen = np.isfinite(hands).all(axis=1)
        body = Ellipsoids.balls(hands[seen], RADIUS_M)
        index.append(float(danger_index(robot, body, choice.index).max(initial=0.0)))
        gaps.append(float(np.linalg.norm(body.centre - place, axis=1).min(initial=np.inf)) - 2.0 * RADIUS_M)
        places.append(place)
        if follower.has_arrived():
            reached = k + 1
            break
        prediction.observe(np.full(len(hands), k * h), hands)
        soon = Ellipsoids.balls(prediction.at((k + 1) * h)[seen], RADIUS_M)
        if follower.waits():
            speed, evolution = 0.0, None
        else:
            goal = Goal(scene.programmed, previous, weights=choice.weights)
            pairs = pair_quadratics(robot, h * scene.sign * onwards[None], soon, previous, choice.index)
            speed, evolution = _chosen(choice, pairs, goal, rng, _Where(follower, robot, body))
            previous = speed
        first = first or evolution
        follower.move(speed)
        speeds.append(speed)
    return Run(
        np.array(index), np.array(speeds), np.array(places), np.array(gaps), reached, first
    )  # fmt: skip


class _Follower:
    """Where a robot is on its route."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.way = 0.0
        self._reached = scene.reached()
        self._waited: dict[int, int] = {}

    def has_arrived(self) -> bool:
        """Whether the goal is reached, and has been waited at."""
        return self.way >= self._reached[-1] - 1e-6 and not self.waits()

    def waits(self) -> bool:
        """Whether the robot is at a corner at which it still has to wait."""
        for corner, samples in self.scene.waits.items():
            if abs(self.way - self._reached[corner]) < 1e-6 and self._waited.get(corner, 0) < samples:
                return True
        return False

    def move(self, speed: float) -> None:
        """Go on for an interval with a speed with its sign [m/s]; no farther than a corner with a wait."""
        if self.waits():
            for corner in self.scene.waits:
                if abs(self.way - self._reached[corner]) < 1e-6:
                    self._waited[corner] = self._waited.get(corner, 0) + 1
            return
        before = self.way
        way = before + speed * self.scene.sign * self.scene.interval_s
        for corner, samples in self.scene.waits.items():
            at = float(self._reached[corner])
            if before < at - 1e-6 <= way and self._waited.get(corner, 0) < samples:
                way = at
        self.way = min(max(way, 0.0), float(self._reached[-1]))

    def within(self) -> tuple[float, float]:
        """Return the speeds that leave the robot between begin and goal [m/s]."""
        ends = np.array([0.0, float(self._reached[-1])])
        low, high = np.sort(self.scene.sign * (ends - self.way) / self.scene.interval_s).tolist()
        return low, high


@dataclass(frozen=True, slots=True, eq=False)
class _Where:
    """The scene at a sample."""

    follower: _Follower
    robot: Ellipsoids
    body: Ellipsoids


def _chosen(
    choice: Choice, pairs: Array, goal: Goal, rng: np.random.Generator, where: _Where
) -> tuple[float, Evolution | None]:
    """Return the speed that a method chooses [m/s], and how the genetic algorithm came to it."""
    if choice.method == "none":
        return goal.programmed, None
    if choice.method == "proposed":
        return exact_speed(pairs, goal), None
    if choice.method == "genetic":
        found = evolve(pairs, goal, rng, choice.genetic)
        return found.speed, found
    if choice.method == "morato":
        away = where.body.centre[None] - where.robot.centre[:, None]
        return morato_speed(np.linalg.norm(away, axis=2), goal.programmed), None
    sign: Sign = "as_printed" if choice.method == "hwang" else "corrected"
    return hwang_speed(pairs, goal, sign, where.follower.within()), None
