"""The planner of a simulation: from one seeded posture to the next, at rest in each."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from failsafe.waypoints import rest_to_rest
from robots.errors import SetupError
from robots.kernels import forward
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.command import Cause
from verifier.proposal import NewTrajectory
from verifier.setup import Supervised, build_check, build_profile
from verifier.supervisor import Supervisor, SupervisorSettings

Array = NDArray[np.float64]

_TRIES = 60
_WIDEST_RAD = 2.4
"""Joints that turn farther, or endlessly, are used within ± this."""
_SHARE = 0.7
"""Share of the limits that a motion uses; less if it is refused."""
_SLOWER = 0.8
_AT_FULL_SPEED = 40
"""After so many ways in vain slower ones are tried: from them a robot that stops by itself goes less far."""


class Planner:
    """Proposes motions that keep clear of floor, fixtures and the arm itself as far as the cell checks them.

    Parameters
    ----------
    cell, robot, parts:
        What the supervisor is made of.
    floor_m:
        Postures with a joint below this height [m] are taken only if no others are found.
    rng:
        Decides where to go.
    """

    def __init__(
        self, cell: Cell, robot: RobotModel, parts: Supervised, floor_m: float, rng: np.random.Generator
    ) -> None:
        self._robot, self._parts, self._rng, self._floor = robot, parts, rng, floor_m
        self._settings = SupervisorSettings(0.25 * cell.cycle_s)
        self._cycle = cell.cycle_s
        self._alone = (
            build_check(cell, robot, build_profile(cell), assume_nobody=True)
            if parts.check.robot_criteria
            else None
        )
        self._ahead: IntendedTrajectory | None = None
        self.proposed = 0

    def start(self) -> Array:
        """Return a posture (n,) from which there is a way.

        Raises
        ------
        SetupError
            None was found.
        """
        for _ in range(_TRIES):
            q = self._posture()
            self._ahead = self._way(q, 1.0, _SHARE)
            if self._ahead is not None:
                return q
        raise SetupError(
            f"no posture of {self._robot.name} was found from which a motion keeps clear of floor, fixtures "
            f"and itself ({_TRIES} were tried): look at [workspace] and criteria.self_collision of the cell"
        )

    def propose(self, supervisor: Supervisor, q: Array) -> None:
        """Propose a motion that begins at rest at ``q (n,)``.

        Raises
        ------
        SetupError
            None was found that is taken.
        """
        share, why = _SHARE, "every way that was tried leads into floor, fixtures or the arm itself"
        for attempt in range(_TRIES):
            path, self._ahead = self._ahead, None
            if path is None:
                slower = _SLOWER ** max(0, attempt - _AT_FULL_SPEED)
                path = self._way(q, 1.0 - 0.9 * attempt / _TRIES, share * slower)
            if path is None:
                continue
            refusal = supervisor.propose(NewTrajectory(path))
            if refusal is None:
                self.proposed += 1
                return
            why, share = refusal.text, share * _SLOWER
        raise SetupError(f"no motion of {self._robot.name} was found that may be followed: {why}")

    def _posture(self) -> Array:
        """Return a posture within the limits, above the floor if one is found."""
        limits = self._robot.limits
        n = len(limits.joints)
        inside = (limits.position_lower < _WIDEST_RAD) & (limits.position_upper > -_WIDEST_RAD)
        low = np.where(inside, np.maximum(limits.position_lower, -_WIDEST_RAD), limits.position_lower)
        high = np.where(inside, np.minimum(limits.position_upper, _WIDEST_RAD), limits.position_upper)
        turns, places = np.zeros((n, 3, 3)), np.zeros((n, 3))
        for _ in range(_TRIES):
            q: Array = low + (high - low) * self._rng.uniform(0.1, 0.9, n)
            forward(self._robot.kinematics, q, turns, places)
            if places[:, 2].min() > self._floor:
                break
        return q

    def _way(self, q: Array, far: float, share: float) -> IntendedTrajectory | None:
        """Return a way from ``q (n,)`` through one to three postures, a share of the way to each."""
        places = [q]
        for _ in range(int(self._rng.integers(1, 4))):
            places.append(places[-1] + far * (self._posture() - places[-1]))
        try:
            path = rest_to_rest(places, self._robot.limits, share=share)
        except TrajectoryError:
            return None
        return path if self._is_clear(path) else None

    def _is_clear(self, path: IntendedTrajectory) -> bool:
        """Go along a path with nobody there, if anything else can be in the way."""
        if self._alone is None:
            return True
        q = path.sample(path.s_begin)[0]
        supervisor = Supervisor(self._alone, self._parts.watch, self._parts.plans, self._settings, q)
        if supervisor.propose(NewTrajectory(path)) is not None:
            return True  # whether that may be followed is not asked here
        for k in range(10 + 2 * math.ceil((path.s_end - path.s_begin) / self._cycle)):
            command = supervisor.step(k * self._cycle)
            if supervisor.fault is not None:
                raise supervisor.fault
            if command.cause is not Cause.ADOPTED:
                return command.cause is Cause.RESTING
        return False
