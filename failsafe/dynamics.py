"""Dynamics of an arm with its payload: torques of a stop, and what torque limits leave of its deceleration.

**One state.** With M ddq + h = τ and ddq = λ u, |τ_j| ≤ τ_max,j for all j is an interval of λ.

**All states.** |τ_j| ≤ Σ_p m_p ρ_pj (Σ_k ρ_pk |ddq_k| + B_p + g): every point mass at its reach ρ_pj from
each axis (:mod:`robots.reach`), B_p ≥ ‖b_p‖ as in :mod:`occupancy.swept` from the speeds. That holds
everywhere and is wide: masses are not at their reach from all axes at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe import dynamics_kernels, stopping_kernels
from failsafe.box_search import BoxSearch, Found, point_row
from failsafe.bracket import Bracket, Effort, Ended, Witness
from robots.errors import SetupError
from robots.inertia import MassModel
from robots.limits import Array
from robots.model import RobotModel
from robots.motion import MAX_JOINTS, Block
from robots.reach import reach

TORQUE, ENERGY = "torque of the stop", "kinetic energy"
_OUTWARD = 1.0 + 1e-9
_SAMPLES = 400


class Torques(NamedTuple):
    """M (n, n) [kg m²], h (n,) [N m] of M ddq + h = τ, and the kinetic energy [J]; kg, N for sliding
    joints."""

    mass: Array
    bias: Array
    kinetic: float


class ArmDynamics:
    """Dynamics of a robot whose bodies are known.

    Raises
    ------
    SetupError
        The masses belong to another robot.
    """

    def __init__(self, model: RobotModel, masses: MassModel) -> None:
        n = len(model.joints)
        if masses.robot != model.name or len(masses.bodies) != n:
            raise SetupError(
                f"masses of {masses.robot} ({len(masses.bodies)} joints) do not fit {model.name} ({n} joints)"
            )
        self.model, self.masses = model, masses
        self.points = _points(model, masses)
        self.gravity: Array = np.array(masses.gravity, dtype=np.float64)
        self.work: Block = np.zeros(1, dtype=stopping_kernels.WORK)
        self._searched: dict[tuple[float, ...], Found] = {}

    def at(self, q: Array, dq: Array) -> Torques:
        """Return mass matrix, bias torques and kinetic energy in a state ``q, dq (n,)``."""
        n = len(self.model.joints)
        mass, bias = np.zeros((MAX_JOINTS, MAX_JOINTS)), np.zeros(MAX_JOINTS)
        kinetic = dynamics_kernels.dynamics(
            self.model.kinematics, self.points, q, dq, self.gravity, mass, bias, self.work
        )
        return Torques(mass[:n, :n], bias[:n], float(kinetic))

    def energy(self, speed: Array, effort: Effort | None = None) -> Bracket:
        """Bracket the kinetic energy [J] over all configurations and speeds up to ``speed (n,)``.

        It grows with the square of the speeds: what was searched for speeds in the same proportion is used
        again, unless it was interrupted.
        """
        scale = float(np.max(speed)) or 1.0
        share = np.asarray(speed) / scale
        key = tuple(np.round(share, 12).tolist())
        found = self._searched.get(key)
        if found is None:
            search = BoxSearch(self.model, self.points, share, energy=True)
            found = search.run(effort or Effort(gap=0.1), ENERGY)
            if found.ended is not Ended.INTERRUPTED:
                self._searched[key] = found
        witness = Witness(found.q, scale * found.dq, np.zeros_like(found.q))
        method = f"branch and bound with second derivatives, {found.boxes} boxes"
        lower, upper = (scale * scale * each for each in (found.best, found.bound * _OUTWARD))
        return Bracket(
            ENERGY, "arm and payload", "J", lower, upper, witness, method, found.ended, seconds=found.seconds
        )

    def gravity_bound(self) -> Array:
        """Bound the torque (n,) [N m; N] that gravity asks of each joint, over all configurations.

        A joint at the base keeps its axis: only the part of gravity across it (along it, if it slides)
        counts.
        """
        model, tree = self.model, self.model.kinematics[0]
        lower, upper = model.limits.position_lower, model.limits.position_upper
        size = float(np.linalg.norm(self.gravity))
        bound = np.zeros(len(model.joints))
        for body in self.masses.bodies:
            far = reach(model.kinematics, lower, upper, body.joint, np.atleast_2d(body.com_m))
            bound += body.mass_kg * size * far[: len(bound)]
        for j in range(len(bound)):
            if tree["parent"][j] < 0 and size > 0.0:
                axis = tree["rotation"][j] @ tree["axis"][j]
                along = float(axis @ self.gravity) / size
                across = math.sqrt(max(0.0, 1.0 - along * along))
                bound[j] *= abs(along) if tree["prismatic"][j] else across
        rounding = 1e-9 * size * self.masses.moving_kg
        result: Array = bound * _OUTWARD + rounding
        return result

    def torque_bound(self, speed: Array, deceleration: Array) -> Array:
        """Bound the torque (n,) over all configurations, |dq| ≤ ``speed`` and |ddq| ≤ ``deceleration
        (n,)``."""
        tree, n = self.model.kinematics[0], len(self.model.joints)
        bound = self.gravity_bound()
        for point in self.points:
            chain = point["chain"][: point["m"]]
            far, dq = point["reach"][chain], speed[chain]
            turns = (tree["prismatic"][chain] == 0).astype(np.float64)
            turned = np.concatenate([[0.0], np.cumsum(turns * dq)[:-1]])
            pull = float(far @ deceleration[chain] + (far * dq * (turns * dq + 2.0 * turned)).sum())
            bound[chain] += float(point["mass"]) * far * pull
        result: Array = bound[:n] * _OUTWARD
        return result

    def torques(self, speed: Array, deceleration: Array, seed: int = 0) -> tuple[Bracket, ...]:
        """Bracket the torque of each joint in a stop from up to ``speed`` with up to ``deceleration (n,)``.

        From below random states are looked at, each joint braked against its own speed.
        """
        n = len(self.model.joints)
        upper, best = self.torque_bound(speed, deceleration), np.zeros(n)
        witnesses: list[Witness | None] = [None] * n
        for q, dq in _states(self, speed, seed):
            state, ddq = self.at(q, dq), -np.sign(dq) * deceleration
            torque = np.abs(state.mass @ ddq + state.bias)
            for j in np.flatnonzero(torque > best):
                best[j], witnesses[j] = torque[j], Witness(q, dq, ddq)
        method = "every mass at its reach from each axis"
        units = ["N" if self.model.kinematics[0]["prismatic"][j] else "N m" for j in range(n)]
        return tuple(
            Bracket(
                TORQUE, joint, units[j], float(best[j]), float(upper[j]), witnesses[j], method,
                Ended.CLOSED_FORM, seconds=0.0,
            )
            for j, joint in enumerate(self.model.joints)
        )  # fmt: skip

    def allowed_deceleration(self, q: Array, dq: Array, deceleration: Array) -> float:
        """Return the largest share λ in [0, 1] of ``deceleration (n,)`` that torque limits allow in one
        state.

        Every joint brakes against its own speed with λ times its deceleration. 0 where nothing of it is
        allowed; then another way to brake may still be.
        """
        limit = self._known_limits()
        state = self.at(q, dq)
        change = state.mass @ (-np.sign(dq) * deceleration)
        low, high = 0.0, 1.0
        for c, h, most in zip(change, state.bias, limit, strict=True):
            if c == 0.0:
                low, high = (low, high) if abs(h) <= most else (1.0, 0.0)
                continue
            ends = sorted(((-most - h) / c, (most - h) / c))
            low, high = max(low, ends[0]), min(high, ends[1])
        return float(high) if low <= high else 0.0

    def worst_allowed_deceleration(self, speed: Array, deceleration: Array, seed: int = 0) -> Allowed:
        """Bracket the smallest share that torque limits allow over all configurations and speeds."""
        limit = self._known_limits()
        rest = self.torque_bound(speed, np.zeros_like(speed))
        change = self.torque_bound(speed, deceleration) - rest
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(limit >= rest, (limit - rest) / change, 0.0)
        guaranteed = float(np.clip(np.min(shares), 0.0, 1.0)) / _OUTWARD
        found, witness = 1.0, None
        for q, dq in _states(self, speed, seed):
            here = self.allowed_deceleration(q, dq, deceleration)
            if here < found:
                found, witness = here, Witness(q, dq, -np.sign(dq) * deceleration)
        worst = int(np.argmin(shares))
        return Allowed(min(guaranteed, found), found, self.model.joints[worst], witness)

    def _known_limits(self) -> Array:
        limit = self.model.limits.torque
        if not np.isfinite(limit).any():
            raise SetupError(f"{self.model.name}: no torque limit is known; state one")
        return limit


@dataclass(frozen=True, eq=False)
class Allowed:
    """Share of a deceleration that torque limits allow in every state: at least ``guaranteed``, at most
    ``found``, which is what they allow at ``witness``; ``joint`` limits what is guaranteed."""

    guaranteed: float
    found: float
    joint: str
    witness: Witness | None


def _points(model: RobotModel, masses: MassModel) -> NDArray[np.void]:
    rows = []
    for body in masses.bodies:
        places, mass = body.point_masses()
        for place, kg in zip(places, mass, strict=True):
            row = point_row(model, body.joint, place, mass=float(kg))
            row["reach"] = reach(
                model.kinematics, model.limits.position_lower, model.limits.position_upper, body.joint,
                place[None],
            )  # fmt: skip
            rows.append(row)
    return np.array(rows, dtype=stopping_kernels.POINTS)


def _states(dynamics: ArmDynamics, speed: Array, seed: int) -> list[tuple[Array, Array]]:
    """Random configurations with speeds at random vertices."""
    rng = np.random.default_rng(seed)
    task = BoxSearch(dynamics.model, dynamics.points, speed, energy=True).task[0]
    n = len(speed)
    return [
        (rng.uniform(task["lower"][:n], task["upper"][:n]), rng.choice([-1.0, 1.0], n) * speed)
        for _ in range(_SAMPLES)
    ]
