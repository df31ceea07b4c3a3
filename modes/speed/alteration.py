"""Speed alteration as a mode: a path speed that keeps the danger index of the next interval below 1.

What the paper leaves open is filled in by docs/speed.md. More than the paper: all links and parts of several
people; any path, since speeds are those along the path parameter; braking capability in the place of a fixed
cap; a Kalman filter in the place of constant velocity.

It proposes. Whether the robot may go as fast is the supervisor's business, which knows nothing of all this.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_choice, require_count, require_kind, require_number
from modes.speed.bodies import UPPER_BODY, Arm, BodyEllipsoids, LinkEllipsoids, require_parts
from modes.speed.danger_index import INDICES, Ellipsoids, Index, index_of, pair_quadratics
from modes.speed.exact import exact_speed
from modes.speed.genetic import GeneticSettings, evolve
from modes.speed.objective import CAP_M_S, FASTEST_M_S, Goal, Weights
from modes.speed.prediction import PREDICTIONS, Prediction, PredictionName, make_prediction
from occupancy.body import MAX_POINTS, Part, load_profile
from robots.model import RobotModel
from verifier.proposal import PathSpeed, Proposal, SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Optimiser = Literal["exact", "genetic"]
OPTIMISERS: tuple[Optimiser, ...] = ("exact", "genetic")

_SLOW_M_S = 1e-4
"""Where the programmed motion is slower there is no speed to alter: it begins or ends, or is at rest."""
_OLD_S = 1.0
"""Points that were not seen for so long are no longer looked at."""
_MOST_TIMES = 5.0
"""No more than so many times the programmed speed, either way: the paper's 250 mm/s beside its 50 mm/s."""
_OF_ACCELERATION = 0.5
"""Share of the joint accelerations with which the arm is taken to brake along its path."""
_BRAKING_STEPS = 16
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the time to brake: when it is looked whether anybody is met."""


@dataclass(frozen=True, slots=True)
class SpeedSettings:
    """How a speed is chosen.

    Attributes
    ----------
    weights:
        P, D, R.
    cap_m_s:
        Greatest speed of the end of the last link, and of the middles of all [m/s]; ``None``: no fixed one,
        but braking capability. The paper's 0.25 m/s is the reduced speed of ISO 10218-1 up to its edition of
        2006.
    interval_s:
        How far ahead it is looked [s].
    index, prediction, parts, profile:
        Which danger index, which forecast, which parts of the body, and whose radii.
    optimiser, genetic, seed:
        The exact minimum, or what the genetic algorithm finds.

    Raises
    ------
    SetupError
        A setting cannot be used; it names it.
    """

    weights: Weights = field(default_factory=Weights)
    cap_m_s: float | None = CAP_M_S
    interval_s: float = 0.1
    index: Index = "exact"
    prediction: PredictionName = "constant_velocity"
    optimiser: Optimiser = "exact"
    genetic: GeneticSettings = field(default_factory=GeneticSettings)
    seed: int = 0
    parts: tuple[Part, ...] = UPPER_BODY
    profile: str = "iso"

    def __post_init__(self) -> None:
        name = "speed alteration:"
        require_kind(
            f"{name} weights", self.weights, Weights, written="Weights(closeness, smoothness, penalty)"
        )
        require_kind(f"{name} genetic", self.genetic, GeneticSettings, written="GeneticSettings(...)")
        require_parts(self.parts)
        if self.cap_m_s is not None:
            require_number(f"{name} cap_m_s (or None)", self.cap_m_s, 0.001, FASTEST_M_S)
        require_number(f"{name} interval_s", self.interval_s, 0.001, 10.0)
        require_count(f"{name} seed", self.seed, 0, 2**63 - 1)
        require_choice(f"{name} index", self.index, INDICES)
        require_choice(f"{name} prediction", self.prediction, PREDICTIONS)
        require_choice(f"{name} optimiser", self.optimiser, OPTIMISERS)


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """What was chosen, and why.

    Attributes
    ----------
    speed, programmed:
        Along the path, of the end of the last link or the middle of any, whichever is the fastest [m/s].
    path_speed:
        The same as a path speed.
    danger_index:
        The largest one at the end of the interval with the chosen speed; 0: nobody is known. With the exact
        index an upper bound of it, which is reached at the speed that the arm has.
    at_programmed:
        The same at the programmed speed.
    cap:
        That was used [m/s].
    """

    speed: float
    programmed: float
    path_speed: float
    danger_index: float
    at_programmed: float
    cap: float


class SpeedAlteration:
    """The mode: one decision per call.

    Parameters
    ----------
    robot:
        The supervisor's.
    settings:
        How a speed is chosen.

    Attributes
    ----------
    decision:
        The one that the last proposal came from; ``None``: there was none, since nothing was proposed, or the
        programmed motion is at rest.

    Raises
    ------
    SetupError
        A setting cannot be used.
    """

    name = "speed-alteration"
    needs_robot = True

    def __init__(self, robot: RobotModel, settings: SpeedSettings | None = None) -> None:
        self.settings = settings = SpeedSettings() if settings is None else settings
        require_kind("speed alteration: settings", settings, SpeedSettings, written="SpeedSettings(...)")
        require_kind("speed alteration: robot", robot, RobotModel, written="the supervisor's robot")
        self.decision: Decision | None = None
        self._limits = robot.limits
        self._arm = LinkEllipsoids(robot)
        self._body = BodyEllipsoids(load_profile(settings.profile), settings.parts)
        self._seen: dict[tuple[str, int, int], tuple[Prediction, Mask]] = {}
        self._t = -math.inf
        self._rng = np.random.default_rng(settings.seed)

    def propose(self, view: SceneView) -> Proposal | None:
        """Return the chosen path speed; 1 where the programmed motion is at rest, ``None`` off the path.

        ``None``, too, where the view is of an arm with another number of joints, or has what is not finite.
        """
        n = (len(self._limits.joints),)
        self.decision = None
        if view.q.shape != n or view.dq_ds.shape != n:
            return None
        if not all(np.isfinite(each).all() for each in ((view.s, view.sdot, view.t), view.q, view.dq_ds)):
            return None
        arm = self._arm.at(view.q, view.dq_ds)
        if arm.speed_per_path > FASTEST_M_S:
            return None
        if not arm.speed_per_path > _SLOW_M_S:
            return PathSpeed(1.0)
        self.decision = decision = self.decide(arm, view)
        return PathSpeed(decision.path_speed)

    def decide(self, arm: Arm, view: SceneView) -> Decision:
        """Choose a speed for an arm whose programmed motion is not at rest."""
        settings, h = self.settings, self.settings.interval_s
        programmed = arm.speed_per_path
        cap = self._fastest(view.dq_ds) * programmed if settings.cap_m_s is None else settings.cap_m_s
        cap = min(cap, _MOST_TIMES * programmed)
        previous = min(max(view.sdot * programmed, -cap), cap)
        self._take_in(view)
        pairs = self._pairs(arm, self._foretold(view.t + h), h, previous)
        goal = Goal(programmed, previous, cap, settings.weights)
        if settings.optimiser == "exact":
            speed = exact_speed(pairs, goal)
        else:
            speed = evolve(pairs, goal, self._rng, settings.genetic).speed
        if settings.cap_m_s is None:
            speed = self._stoppable(arm, view, speed)
        chosen, unaltered = (float(index_of(pairs, v).max(initial=0.0)) for v in (speed, programmed))
        return Decision(speed, programmed, speed / programmed, chosen, unaltered, cap)

    def _pairs(self, arm: Arm, body: Ellipsoids, h: float, at_speed: float) -> Array:
        """Return the quadratics of all pairs in the speed of the tip, ``h`` [s] from now."""
        per_speed = arm.per_path * (h / arm.speed_per_path)
        return pair_quadratics(arm.links, per_speed, body, at_speed, self.settings.index)

    def _take_in(self, view: SceneView) -> None:
        """Go on following who is known and was seen of late."""
        if view.t < self._t:  # another clock, or another supervisor
            self._seen = {}
        self._t = view.t
        rows, of_id = Counter[str](), Counter(person.id for person in view.people)
        kept: dict[tuple[str, int, int], tuple[Prediction, Mask]] = {}
        for person in view.people:
            key = person.id, rows[person.id], of_id[person.id]  # rows move up when one goes
            rows[person.id] += 1
            with np.errstate(invalid="ignore"):
                recent = np.abs(view.t - person.t) < _OLD_S
            if not recent.any():
                continue
            known = self._seen.get(key)
            prediction = make_prediction(self.settings.prediction, MAX_POINTS) if known is None else known[0]
            prediction.observe(np.where(recent, person.t, np.nan), person.xyz)
            kept[key] = prediction, recent
        self._seen = kept

    def _foretold(self, t: float) -> Ellipsoids:
        """Return the ellipsoids of everybody at ``t`` [s]."""
        points = [np.empty((0, MAX_POINTS, 3))]
        for prediction, recent in self._seen.values():
            points.append(np.where(recent[:, None], prediction.at(t), np.nan)[None])
        return self._body.around(np.concatenate(points))

    def _fastest(self, dq_ds: Array) -> float:
        """Return the greatest path speed at which no joint is faster than it may be."""
        with np.errstate(divide="ignore"):
            return float(np.min(self._limits.velocity / np.abs(dq_ds)))

    def _stoppable(self, arm: Arm, view: SceneView, speed: float) -> float:
        """Return a speed, not above ``speed``, from which the arm brakes before anybody's ellipsoid is met.

        After the interval at v the arm brakes along its path in |v| / a, over v |v| / (2 a); people go on as
        they were foretold. Of 16 speeds from ``speed`` down to 0 the first that never touches is taken; where
        all of them do, the one that does so the least.
        """
        with np.errstate(divide="ignore"):
            braking = _OF_ACCELERATION * float(np.min(self._limits.acceleration / np.abs(view.dq_ds)))
        a = braking * arm.speed_per_path
        best, least = 0.0, math.inf
        for v in (speed * k / _BRAKING_STEPS for k in range(_BRAKING_STEPS, -1, -1)):
            worst = max(self._index_after(arm, view, v, a, share) for share in _SHARES)
            if worst < 1.0:
                return v
            if worst < least:
                best, least = v, worst
        return best

    def _index_after(self, arm: Arm, view: SceneView, v: float, a: float, share: float) -> float:
        """Return the danger index at speed ``v`` when ``share`` of the time to brake from it is over."""
        pairs = self._after(arm, view, self.settings.interval_s, abs(v), a, share)
        return float(index_of(pairs, v).max(initial=0.0))

    def _after(self, arm: Arm, view: SceneView, h: float, v: float, a: float, share: float) -> Array:
        """Return the quadratics in the speed when ``share`` of the time to brake from ``v`` [m/s] is over."""
        t = share * v / a
        body = self._foretold(view.t + h + t)
        return self._pairs(arm, body, h + t * (1.0 - 0.5 * share), v)
