"""Largest point speed or kinetic energy over all configurations and joint speeds: best-first branch and
bound.

The speed of a point and the energy are convex in the joint speeds, so their maximum over a box of speeds lies
at a vertex; of two opposite vertices one does. Each vertex starts with the box of all configurations (a joint
that can turn round needs 2π of its range); the node with the largest bound is halved until that bound is
near enough to a value that was found (:mod:`failsafe.stopping_kernels`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import cast

import numpy as np
from numpy.typing import NDArray

from failsafe import box_kernels
from failsafe import stopping_kernels as kernels
from failsafe.bracket import Effort, Ended
from robots.errors import SetupError
from robots.kernels import forward
from robots.limits import Array
from robots.model import RobotModel
from robots.motion import MAX_JOINTS, Block

MAX_VERTICES = 1 << 12
"""More vertices of the box of speeds are not searched one by one."""
_STEPS = 2_000
"""Boxes halved between two looks at the clock."""
_RESERVE = 1 << 12
"""Slots for going to the end of one box after the other where the table may not grow."""
_COARSE = 0.1
"""Gap that is worth that."""
_CLIMBS = 40
_SAMPLES = 600


@dataclass(frozen=True, eq=False)
class Found:
    """Best value and where it is; proven bound; why it ended; how many boxes were looked at."""

    best: float
    bound: float
    q: Array
    dq: Array
    point: int
    ended: Ended
    boxes: int
    seconds: float


class BoxSearch:
    """Maximum over configurations and speeds, for points of the arm.

    Parameters
    ----------
    points:
        ``POINTS`` rows; for the energy their masses count, for the speed their balls.
    speed:
        ``(n,)`` largest |dq| of each joint [rad/s; m/s].
    energy:
        The kinetic energy of all points [J] instead of the speed of the fastest [m/s].
    extension:
        Only configurations in which no point is farther from the first axis of its chain [m].

    Raises
    ------
    SetupError
        A speed that is negative or not finite, no point, or a sliding joint without position limits.
    """

    def __init__(
        self,
        model: RobotModel,
        points: NDArray[np.void],
        speed: Array,
        *,
        energy: bool = False,
        extension: float = math.inf,
    ) -> None:
        n = len(model.joints)
        if not (np.shape(speed) == (n,) and np.isfinite(speed).all() and np.min(speed, initial=0.0) >= 0.0):
            raise SetupError(f"speeds {speed} must be {n} finite numbers, none below zero")
        if not len(points):
            raise SetupError("the arm has no point to be bounded")
        self.model, self.points = model, points
        self.task: Block = np.zeros(1, dtype=box_kernels.TASK)
        task = self.task[0]
        task["n"], task["energy"], task["extension"], task["points"] = n, energy, extension, len(points)
        task["speed"][:n] = speed
        task["lower"][:n], task["upper"][:n] = _range(model)
        self._work: Block = np.zeros(1, dtype=kernels.WORK)
        self._state: Block = np.zeros(1, dtype=box_kernels.STATE)

    def run(self, effort: Effort, quantity: str = "", seed: int = 0) -> Found:
        """Search until the gap is small enough or ``effort`` ends it; an interrupt ends it as well."""
        begun = effort.now()
        state = self._state[0]
        state["best"] = state["settled"] = 0.0
        state["open"] = state["used"] = state["free"] = state["evaluated"] = 0
        state["point"] = -1
        try:
            self._climb(seed)
            ended = self._branch(effort, quantity, begun)
        except KeyboardInterrupt:
            ended = Ended.INTERRUPTED
        bound = min(self._bound(), self.reach_bound())
        n = int(self.task["n"][0])
        return Found(
            float(state["best"]), max(bound, float(state["best"])), state["q"][:n].copy(),
            state["dq"][:n].copy(), int(state["point"]), ended, int(state["evaluated"]),
            effort.now() - begun,
        )  # fmt: skip

    def reach_bound(self) -> float:
        """Bound in closed form: every point at its reach from every joint, all at full speed."""
        n = int(self.task["n"][0])
        speed = self.task["speed"][0, :n]
        turns = np.array([self.model.kinematics[0]["prismatic"][j] == 0 for j in range(n)])
        total = 0.0
        for point in self.points:
            chain = point["chain"][: point["m"]]
            fast = float(point["reach"][chain] @ speed[chain])
            if self.task["energy"][0]:
                total += 0.5 * float(point["mass"]) * fast * fast
            else:
                fast += float(point["ball"]) * float((speed * turns)[chain].sum())
                total = max(total, fast)
        return total * (1.0 + 1e-9)

    def _climb(self, seed: int) -> None:
        """Climb from random states, the best of many, so that the search begins with a good value."""
        rng = np.random.default_rng(seed)
        task, state = self.task[0], self._state[0]
        points = [0] if task["energy"] else range(len(self.points))
        gradient = np.zeros(MAX_JOINTS)
        tries = []
        for p in points:
            for _ in range(max(1, _SAMPLES // len(points))):
                q = rng.uniform(task["lower"], task["upper"])
                dq = task["speed"] * rng.choice([-1.0, 1.0], MAX_JOINTS)
                value = box_kernels.value_at(
                    self.model.kinematics, self.points, self.task, p, q, dq, gradient, self._work
                )
                tries.append((value, p, q, dq))
        tries.sort(key=lambda each: -each[0])
        for _, p, q, dq in tries[:_CLIMBS]:
            if self._admitted(q):
                value = box_kernels.ascend(
                    self.model.kinematics, self.points, self.task, p, q, dq, 200, self._work
                )
                if value > state["best"]:
                    state["best"], state["point"], state["q"], state["dq"] = value, p, q, dq

    def _admitted(self, q: Array) -> bool:
        if not self.task["extension"][0] < math.inf:
            return True
        work, still = self._work, np.zeros(MAX_JOINTS)
        forward(self.model.kinematics, q, work["rotation"][0], work["position"][0])
        here, _ = kernels.extension(self.model.kinematics, self.points, still, work)
        return bool(here <= self.task["extension"][0])

    def _branch(self, effort: Effort, quantity: str, begun: float) -> Ended:
        roots = self._roots()
        if roots is None:
            self._state["settled"] = math.inf
            return Ended.FULL
        self._plant(roots, effort.gap)
        state, gap = self._state, effort.gap
        reserve = _RESERVE if effort.deadline_s < math.inf else 0
        while True:
            more = box_kernels.expand(
                self.model.kinematics, self.points, self.task, self._nodes, self._heap, self._free,
                1.0 / (1.0 - gap), _STEPS, reserve, self._work, state,
            )  # fmt: skip
            if effort.progress is not None:
                effort.progress(quantity, float(state["best"][0]), self._bound())
            if not more:
                return Ended.NARROW if gap == effort.gap else Ended.FULL
            why = effort.end(begun)
            if why is not None:
                return why
            room = int(state["free"][0]) + len(self._nodes) - int(state["used"][0])
            if room <= reserve and len(self._nodes) < effort.max_boxes:
                self._grow()
            elif room == 0:
                return Ended.FULL
            elif room <= reserve and gap == effort.gap:
                gap = max(gap, self._gap_within_reach())

    def _plant(self, roots: NDArray[np.void], gap: float) -> None:
        """Bound the first boxes and open them; until all are, nothing is bounded."""
        size, state = max(1 << 14, 2 * len(roots)), self._state
        self._nodes = np.zeros(size, dtype=box_kernels.NODES)
        self._nodes[: len(roots)] = roots
        self._heap, self._free = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64)
        for slot in range(len(roots)):
            box_kernels.evaluate(
                self.model.kinematics, self.points, self.task, self._nodes[slot], self._work, state
            )
        for slot in range(len(roots)):
            box_kernels.keep(self._nodes, self._heap, self._free, slot, 1.0 / (1.0 - gap), state)
        state["used"] = len(roots)

    def _grow(self) -> None:
        self._nodes, self._heap, self._free = (
            np.concatenate([each, np.zeros_like(each)]) for each in (self._nodes, self._heap, self._free)
        )

    def _gap_within_reach(self) -> float:
        """Gap for which it is worth going to the end of each open box, as no more can be open."""
        return min(_COARSE, 2.0 / 3.0 * (1.0 - float(self._state["best"][0]) / self._bound()))

    def _bound(self) -> float:
        """Proven bound so far."""
        state = self._state[0]
        if state["used"] == 0:
            return math.inf
        bound = max(float(state["settled"]), float(state["best"]))
        if state["open"] > 0:
            bound = max(bound, float(self._nodes["bound"][self._heap[0]]))
        return bound

    def _roots(self) -> NDArray[np.void] | None:
        """One node for each point and vertex of the speeds of its chain; None if there are too many."""
        task = self.task[0]
        n = int(task["n"])
        chains = (
            [(-1, list(range(n)))] if task["energy"]
            else [(p, list(point["chain"][: point["m"]])) for p, point in enumerate(self.points)]
        )  # fmt: skip
        rows = []
        for p, chain in chains:
            moving = [j for j in chain if task["speed"][j] > 0.0]
            if 1 << max(0, len(moving) - 1) > MAX_VERTICES:
                return None
            for turned in product((False, True), repeat=max(0, len(moving) - 1)):
                backwards = [j for j, back in zip(moving[1:], turned, strict=True) if back]
                rows.append((p, sum(1 << j for j in backwards), chain))
        nodes = np.zeros(len(rows), dtype=box_kernels.NODES)
        centre = 0.5 * (task["lower"] + task["upper"])
        half = 0.5 * (task["upper"] - task["lower"])
        for node, (p, signs, chain) in zip(nodes, rows, strict=True):
            node["bound"], node["point"], node["signs"], node["centre"] = math.inf, p, signs, centre
            for j in chain:
                first = self.model.kinematics[0]["parent"][j] < 0
                node["half"][j] = 0.0 if first else half[j] * (1.0 + 1e-12)
        return nodes


def _range(model: RobotModel) -> tuple[Array, Array]:
    """Box of configurations; 2π about the middle of its range for a joint that can turn round."""
    lower, upper = model.limits.position_lower.copy(), model.limits.position_upper.copy()
    for j, joint in enumerate(model.joints):
        if model.kinematics[0]["prismatic"][j]:
            if not (math.isfinite(lower[j]) and math.isfinite(upper[j])):
                raise SetupError(f"joint {joint} slides without end: its position limits must be finite")
        elif not upper[j] - lower[j] < 2.0 * math.pi:
            middle = 0.5 * (lower[j] + upper[j]) if math.isfinite(upper[j] - lower[j]) else 0.0
            if not math.isfinite(middle):
                middle = 0.0
            lower[j], upper[j] = middle - math.pi, middle + math.pi
    return lower, upper


def arm_points(model: RobotModel) -> tuple[NDArray[np.void], tuple[str, ...]]:
    """Return ``POINTS`` rows of the ends of all capsules, and the link of each.

    Speed is convex along a capsule's axis and in the ball around it: its fastest point is in one of the balls
    at the two ends.
    """
    capsules = model.enclosure[0]
    rows, names = [], []
    for i in range(int(capsules["n"])):
        ends = [capsules["a"][i]]
        if (capsules["a"][i] != capsules["b"][i]).any():
            ends.append(capsules["b"][i])
        for end in ends:
            rows.append(point_row(model, int(capsules["joint"][i]), end, float(capsules["radius"][i])))
            rows[-1]["reach"] = capsules["reach"][i]
            names.append(model.links[i])
    return np.array(rows, dtype=kernels.POINTS), tuple(names)


def point_row(model: RobotModel, joint: int, place: Array, ball: float = 0.0, mass: float = 0.0) -> np.void:
    """Return a ``POINTS`` row without its reach."""
    row = np.zeros(1, dtype=kernels.POINTS)[0]
    chain: list[int] = []
    k = joint
    while k >= 0:
        chain.insert(0, k)
        k = int(model.kinematics[0]["parent"][k])
    row["joint"], row["m"], row["place"], row["ball"], row["mass"] = joint, len(chain), place, ball, mass
    row["chain"][: len(chain)] = chain
    return cast(np.void, row)
