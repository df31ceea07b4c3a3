"""The paper's two simulations (section IV): an end effector on a line, a hand that goes up and down.

Everything is as in docs/speed.md, *What was filled in*: among others the centre of the end effector's ball,
44.43 mm above the flange, which two of the paper's own numbers give.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from modes.speed.comparison import Sign, hwang_speed, morato_speed
from modes.speed.danger_index import Ellipsoids, Index, danger_index, pair_quadratics, surface_gap
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
    """A robot's ball on a straight path and hands as balls, at samples from 1.

    Attributes
    ----------
    name:
        Of the scene.
    begin, goal:
        (3,) of the flange [m].
    programmed:
        Speed from begin to goal with its sign as the paper has it, along +y [m/s].
    hands:
        ``(samples, hands, 3)``: where their centres are [m].
    interval_s:
        Between samples.
    """

    name: str
    begin: Array
    goal: Array
    programmed: float
    hands: Array
    interval_s: float = 0.1

    def __post_init__(self) -> None:
        if self.hands.ndim != 3 or self.hands.shape[2] != 3 or self.hands.shape[1] == 0:
            raise SetupError(
                f"scene {self.name}: hands of shape {self.hands.shape} should be (samples, hands, 3)"
            )

    @property
    def axis(self) -> Array:
        """Direction (3,) of a positive speed."""
        way = self.goal - self.begin
        return np.asarray(way / np.linalg.norm(way) * np.sign(self.programmed))

    @property
    def length(self) -> float:
        """Way from begin to goal [m]."""
        return float(np.linalg.norm(self.goal - self.begin))


def simulation(number: int) -> Scene:
    """Return the paper's simulation 1 or 2; the second is the first one's mirror image."""
    side = {1: 1.0, 2: -1.0}[number]
    up = np.clip(np.arange(SAMPLES + 1), 0, 8)
    down = np.clip(np.arange(SAMPLES + 1) - 11, 0, 8)
    hands = np.empty((SAMPLES + 1, 1, 3))
    hands[:, 0] = np.column_stack(
        (np.full(len(up), 0.4), np.full(len(up), 0.14 * side), 0.62 + 0.01 * (up - down))
    )
    return Scene(
        f"simulation {number}", np.array([0.368, 0.0, 0.6685]), np.array([0.368, 0.12 * side, 0.6685]),
        0.05 * side, hands,
    )  # fmt: skip


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
        Way from the begin at each sample [m], along +y.
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
        v = np.concatenate((self.speed, np.zeros(SAMPLES + 3)))[: SAMPLES + 3] * 1e3
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
    above = np.array([0.0, 0.0, choice.ball_above_flange_m])
    h, axis = scene.interval_s, scene.axis
    place, previous, first = 0.0, scene.programmed, None
    index, speeds, places, gaps = [], [], [], []
    reached = None
    for k in range(len(scene.hands)):
        robot = Ellipsoids.balls((scene.begin + above + place * axis)[None], RADIUS_M)
        body = Ellipsoids.balls(scene.hands[k], RADIUS_M)
        index.append(float(danger_index(robot, body, choice.index).max()))
        gaps.append(float(surface_gap(robot, body).min()))
        places.append(place)
        if abs(place) >= scene.length - 1e-6:
            reached = k + 1
            break
        prediction.observe(np.full(len(scene.hands[k]), k * h), scene.hands[k])
        soon = Ellipsoids.balls(prediction.at((k + 1) * h), RADIUS_M)
        goal = Goal(scene.programmed, previous, weights=choice.weights)
        pairs = pair_quadratics(robot, h * axis[None], soon, previous, choice.index)
        v, evolution = _chosen(choice, pairs, goal, rng, _Where(scene, place, robot, body))
        first = first or evolution
        place += v * h
        speeds.append(v)
        previous = v
    return Run(
        np.array(index), np.array(speeds), np.array(places), np.array(gaps), reached, first
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Where:
    """The scene at a sample."""

    scene: Scene
    place: float
    robot: Ellipsoids
    body: Ellipsoids

    def within(self) -> tuple[float, float]:
        """Return the speeds that leave the robot between begin and goal [m/s]."""
        ends = np.array([0.0, self.scene.length * np.sign(self.scene.programmed)])
        low, high = np.sort((ends - self.place) / self.scene.interval_s).tolist()
        return low, high


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
    return hwang_speed(pairs, goal, sign, where.within()), None
