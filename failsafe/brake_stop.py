"""Category 0: the drives are dropped, after a delay friction brakes take hold, gravity pulls all the while.

**Energy.** E is the kinetic energy. While brakes of torque τ_j slip, dE/dt = −Σ τ_j|dq_j| − dqᵀg(q) ≤
−Σ δ_j|dq_j| with δ_j = τ_j − max|g_j|. If every δ_j > 0:

- angle: Σ δ_j ∫|dq_j| dt ≤ E, so joint j turns by at most E/δ_j, and a point moves by at most E max_j
  ρ_j/δ_j;
- time: with y_j = δ_j|dq_j| and ‖v_p‖ ≤ Σ ρ_pj|dq_j| ≤ max_j(ρ_pj/δ_j) Σ y_j, E ≤ ½ Λ (Σ y_j)² for
  Λ = Σ_p m_p max_j(ρ_pj/δ_j)². Hence d√E/dt ≤ −1/√(2Λ), and rest is reached within √(2ΛE).

A joint at rest is held by its brake, which does no work. With some δ_j ≤ 0 nothing is bounded.

**Delay.** Until the brakes hold, dE/dt = −dqᵀg ≤ √(gᵀM⁻¹g) √(2E). With M = AᵀA, A the columns √m_p J_p, and g
= Aᵀb, gᵀM⁻¹g is the squared length of a projection of b: at most g² times the mass that can move up and
down. So √E grows by at most t g √(m/2). Speeds follow from the energy of the two bodies that a joint
connects: |dq_j| ≤ √(2E (zᵀI_j⁻¹z + zᵀI_i⁻¹z)), and ‖v‖ ≤ √(2E (1/m + d²/I_min)) at the distance d from
a body's centre.

Friction in gears, and what motors do while they coast, is left out: both only take energy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from failsafe import dynamics_kernels
from failsafe.bracket import Bracket, Ended, Witness
from failsafe.dynamics import ArmDynamics
from failsafe.stopping import STOP_ANGLE, STOP_TIME, STOP_WAY, ArmSearch, extends, speed_bracket
from robots.errors import SetupError
from robots.inertia import Body
from robots.limits import Array
from robots.motion import Block

_OUTWARD = 1.0 + 1e-9


@dataclass(frozen=True, eq=False)
class Brakes:
    """Brakes of all joints: ``torque (n,)`` [N m; N] that each has at least while it slips or holds, and the
    longest time ``delay_s`` from the loss of drive power until they do.

    Raises
    ------
    SetupError
        A torque that is not finite and above zero, or a delay that is not finite or negative.
    """

    torque: Array
    delay_s: float

    def __post_init__(self) -> None:
        torque = self.torque
        if not (np.ndim(torque) == 1 and np.isfinite(torque).all() and np.min(torque, initial=1.0) > 0.0):
            raise SetupError(f"brakes: torque {torque} must be finite and above zero for every joint")
        if not 0.0 <= self.delay_s < math.inf:
            raise SetupError(f"brakes: delay of {self.delay_s:g} s must be finite and not below zero")


@dataclass(frozen=True, eq=False)
class SimulatedStop:
    """A stop by brakes, step by step: ``rests`` within the time that was simulated; ``time`` [s], ``travel``
    and largest ``displacement (n,)`` [rad; m]; ``ways (P,)`` [m] of the watched points; energy [J] at the
    begin and at the end, highest kinetic energy, and what the brakes took."""

    rests: bool
    time: float
    travel: Array
    displacement: Array
    ways: Array
    begin: float
    end: float
    highest: float
    braked: float

    @property
    def imbalance(self) -> float:
        """Energy that is lost or made by the integration, as a share of the highest kinetic energy."""
        return abs(self.begin - self.end - self.braked) / max(self.highest, 1e-12)


@dataclass(frozen=True, eq=False)
class EnergyBound:
    """What no stop by brakes exceeds: ``time`` [s], ``angle (n,)`` [rad; m], ``way (P,)`` [m] of points;
    ``energy`` [J] when the brakes take hold. ``reason``: why there is no bound (then all are inf), else
    empty."""

    energy: float
    time: float
    angle: Array
    way: Array
    reason: str = ""


@dataclass(frozen=True, eq=False)
class BrakeStop:
    """Stop by brakes from joint speeds up to ``speed (n,)`` [rad/s; m/s]; a :class:`StopModel`.

    ``samples``: stops simulated from below; ``step_s``: of the integration, for ``longest_s`` at most.
    """

    dynamics: ArmDynamics
    brakes: Brakes
    speed: Array
    samples: int = 60
    step_s: float = 1e-3
    seed: int = 0
    longest_s: float = 20.0
    name: str = field(default="brakes", init=False)

    def __post_init__(self) -> None:
        n = len(self.dynamics.model.joints)
        for what, values in (("brake torques", self.brakes.torque), ("speeds", self.speed)):
            if len(values) != n:
                raise SetupError(
                    f"{self.dynamics.model.name}: {len(values)} {what}, but there are {n} joints"
                )

    def simulate(self, arm: ArmSearch, q: Array, dq: Array) -> SimulatedStop:
        """Simulate the stop from a state ``q, dq (n,)``; the points of ``arm`` are watched."""
        scratch: Block = np.zeros(1, dtype=dynamics_kernels.SCRATCH)
        outcome: Block = np.zeros(1, dtype=dynamics_kernels.OUTCOME)
        ways = np.zeros(len(arm.points))
        own = self.dynamics
        dynamics_kernels.brake(
            own.model.kinematics, own.points, np.array([q, dq]), self.brakes.torque, self.brakes.delay_s,
            own.gravity, self.step_s, self.longest_s, arm.points, ways, own.work, scratch, outcome,
        )  # fmt: skip
        out, n = outcome[0], len(q)
        return SimulatedStop(
            bool(out["rests"]), float(out["time"]), out["travel"][:n].copy(), out["displacement"][:n].copy(),
            ways, float(out["begin"]), float(out["end"]), float(out["highest"]), float(out["braked"]),
        )  # fmt: skip

    def bound(self, arm: ArmSearch, kinetic: float) -> EnergyBound:
        """Bound every stop that begins with a kinetic energy of at most ``kinetic`` [J]."""
        own, n = self.dynamics, len(self.speed)
        gravity = own.gravity_bound()
        left = self.brakes.torque - gravity
        if not (left > 0.0).all():
            j = int(np.argmin(left))
            reason = (
                f"the brake of joint {own.model.joints[j]}, {self.brakes.torque[j]:g}, is not above the "
                f"bound of what gravity asks of it, {gravity[j]:.3g}"
            )
            return _nothing(n, len(arm.points), reason)
        if not kinetic < math.inf:
            return _nothing(n, len(arm.points), "the kinetic energy is not bounded")
        fall = float(np.linalg.norm(own.gravity)) * math.sqrt(0.5 * self._falling_kg())
        energy = (math.sqrt(kinetic) + self.brakes.delay_s * fall) ** 2 * _OUTWARD
        coasting = self._coasting(energy)
        if not np.isfinite(coasting).all():
            j = int(np.argmax(~np.isfinite(coasting)))
            reason = f"joint {own.model.joints[j]} coasts for the delay, and its speed is not bounded"
            return _nothing(n, len(arm.points), reason)
        inertia = sum(float(p["mass"]) * float((p["reach"][:n] / left).max()) ** 2 for p in own.points)
        time = self.brakes.delay_s + math.sqrt(2.0 * inertia * energy)
        angle = self.brakes.delay_s * coasting + energy / left
        way = np.array([self._way(p, energy, left, coasting) for p in arm.points])
        return EnergyBound(energy, time * _OUTWARD, angle * _OUTWARD, way * _OUTWARD)

    def worst(self, arm: ArmSearch, extension_m: float = math.inf) -> tuple[Bracket, ...]:
        """Bracket every quantity; upper bounds hold for every extension, lower ones keep it at the begin."""
        model = self.dynamics.model
        fastest = arm.fastest(self.speed, extension_m)
        energy = self.dynamics.energy(self.speed, arm.effort)
        bound = self.bound(arm, energy.upper)
        begun = arm.effort.now()
        time, angle, way = (0.0, None), [(0.0, None)] * len(self.speed), (0.0, None, -1)
        best: tuple[float, Witness | None] = time
        angles: list[tuple[float, Witness | None]] = list(angle)
        longest: tuple[float, Witness | None, int] = way
        for q, dq in self._starts(arm, extension_m, [each for each in (energy.witness,) if each is not None]):
            if arm.effort.end(begun) is not None:
                break
            stop, witness = self.simulate(arm, q, dq), Witness(q, dq, np.zeros_like(q))
            if not stop.rests:
                continue
            best = max(best, (stop.time, witness), key=lambda each: each[0])
            for j, value in enumerate(stop.displacement):
                angles[j] = max(angles[j], (float(value), witness), key=lambda each: each[0])
            point = int(np.argmax(stop.ways))
            longest = max(longest, (float(stop.ways[point]), witness, point), key=lambda each: each[0])
        took = arm.effort.now() - begun
        method, ended = ("energy", energy.ended) if not bound.reason else ("none", Ended.UNBOUNDED)

        def bracket(
            quantity: str, part: str, unit: str, lower: float, upper: float, at: Witness | None
        ) -> Bracket:
            return Bracket(quantity, part, unit, lower, upper, at, method, ended, bound.reason, seconds=took)

        out = [bracket(STOP_TIME, "all joints", "s", best[0], bound.time, best[1])]
        for j, joint in enumerate(model.joints):
            unit = "m" if model.kinematics[0]["prismatic"][j] else "rad"
            out.append(bracket(STOP_ANGLE, joint, unit, angles[j][0], float(bound.angle[j]), angles[j][1]))
        out.append(speed_bracket(arm, fastest))
        part = arm.links[longest[2]] if longest[2] >= 0 else "none found"
        out.append(bracket(STOP_WAY, part, "m", longest[0], float(bound.way.max()), longest[1]))
        return (*out, energy)

    def _starts(
        self, arm: ArmSearch, extension_m: float, known: list[Witness]
    ) -> Iterator[tuple[Array, Array]]:
        """Known bad states, then random configurations at full speed."""
        rng = np.random.default_rng(self.seed)
        task = arm.box
        n = len(self.speed)
        states = [(each.q, each.dq) for each in known]
        states += [
            (rng.uniform(task[0], task[1]), rng.choice([-1.0, 1.0], n) * self.speed)
            for _ in range(self.samples)
        ]
        for q, dq in states:
            if extends(arm, q) <= extension_m:
                yield q, dq

    def _falling_kg(self) -> float:
        """Mass that can move along gravity: not what turns about an axis along it at the base."""
        own, tree = self.dynamics, self.dynamics.model.kinematics[0]
        total = 0.0
        for body in own.masses.bodies:
            axis = tree["rotation"][body.joint] @ tree["axis"][body.joint]
            along = np.linalg.norm(np.cross(axis, own.gravity)) <= 1e-12 * np.linalg.norm(own.gravity)
            still = tree["parent"][body.joint] < 0 and along and not tree["prismatic"][body.joint]
            total += 0.0 if still else body.mass_kg
        return total

    def _coasting(self, energy: float) -> Array:
        """Bound |dq| (n,) while the energy is at most ``energy``, inf where two bodies do not bound it."""
        own, tree = self.dynamics, self.dynamics.model.kinematics[0]
        if self.brakes.delay_s == 0.0:
            return np.zeros(len(self.speed))
        bodies = {body.joint: body for body in own.masses.bodies}
        bound = np.full(len(self.speed), math.inf)
        for j in range(len(bound)):
            if tree["prismatic"][j]:
                continue
            axis, parent = tree["axis"][j], int(tree["parent"][j])
            softness = _softness(bodies[j], axis)
            if parent >= 0:
                softness += _softness(bodies[parent], tree["rotation"][j] @ axis)
            bound[j] = math.sqrt(2.0 * energy * softness)
        return bound

    def _way(self, point: np.void, energy: float, left: Array, coasting: Array) -> float:
        """Bound the way of every point in a ball, coasting and braking."""
        own, tree, n = self.dynamics, self.dynamics.model.kinematics[0], len(left)
        turns = np.array([1.0 if tree["prismatic"][j] == 0 else 0.0 for j in range(n)])
        carried = np.isin(np.arange(n), point["chain"][: point["m"]])
        far = (point["reach"][:n] + float(point["ball"]) * turns) * carried
        braking = energy * float((far / left).max())
        if self.brakes.delay_s == 0.0:
            return braking
        body = own.masses.bodies[int(point["joint"])]
        away = float(np.linalg.norm(point["place"] - body.com_m)) + float(point["ball"])
        least = float(np.linalg.eigvalsh(body.inertia_kg_m2)[0])
        speed = float(far @ coasting)
        if least > 0.0:
            speed = min(speed, math.sqrt(2.0 * energy * (1.0 / body.mass_kg + away * away / least)))
        return self.brakes.delay_s * speed + braking


def _softness(body: Body, axis: Array) -> float:
    """Return zᵀI⁻¹z [1/(kg m²)], inf for a body without inertia."""
    if not float(np.linalg.eigvalsh(body.inertia_kg_m2)[0]) > 0.0:
        return math.inf
    return float(axis @ np.linalg.solve(body.inertia_kg_m2, axis))


def _nothing(n: int, points: int, reason: str) -> EnergyBound:
    return EnergyBound(math.inf, math.inf, np.full(n, math.inf), np.full(points, math.inf), reason)
