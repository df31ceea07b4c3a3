"""What truly happens in a simulation: who is how near to which link, and who touches one that moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from occupancy.body import PART_NAMES
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.reports.simulation import BINS_M, NEAR_M, Approach, SimulatedContact
from verifier.scripted_people import Goal, ScriptedPeople
from verifier.simulated_contacts import Arm, Distances, Pair
from verifier.simulated_robot import SimulatedRobot
from verifier.simulated_touch import allowed_speeds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FAR_M = 2.0
"""Whoever is farther than this from every link is not measured in each cycle."""


class World:
    """The arm and the people, from cycle to cycle.

    Attributes
    ----------
    goals:
        Per person the nearest pair, of moving links if there are any; ``None``: far away.
    contacts:
        Of people with moving links, those left out that the cell lets touch at the speed of the link.
    declared, fastest_declared_m_s:
        Looks at which a moving link touched a part that the cell lets it touch, no faster than it may be, and
        the greatest speed of such a link; NaN where there was none.
    nearest:
        The nearest approach to a moving link; ``None``: no link ever moved near anybody.
    histogram:
        ``(len(BINS_M),)`` cycles in which a link moved, by the nearest approach in them.
    """

    def __init__(
        self, cell: Cell, robot: RobotModel, follower: SimulatedRobot, people: ScriptedPeople
    ) -> None:
        self._links, self._robot, self._people = robot.links, follower, people
        self._distances = Distances(robot, people.flesh, people.points(0.0))
        self._standstill = cell.check.standstill_speed_m_s
        self._allowed = allowed_speeds(cell, robot.links, people.flesh)
        self._counted = [allowed == -math.inf for allowed in self._allowed]
        reach = robot.enclosure["reach"][0, : len(robot.links), : len(robot.joints)]
        self._fastest = people.fastest_m_s + float((reach @ robot.limits.velocity).max())
        n = len(people.flesh)
        self.goals: list[Goal | None] = [None] * n
        self.contacts: list[SimulatedContact] = []
        self.declared, self.fastest_declared_m_s = 0, math.nan
        self.nearest: Approach | None = None
        self.histogram = np.zeros(len(BINS_M), dtype=np.int64)
        self.moving = 0
        self._open: list[SimulatedContact | None] = [None] * n
        self._gaps = np.full(n, -math.inf)
        self._moved = np.zeros(len(robot.links), dtype=bool)

    def advance(self, t: float, cycle_s: float) -> None:
        """Look at the cycle that begins at ``t`` [s]."""
        arm = self._arm(t + cycle_s)
        moving = arm.speed > self._standstill
        moved = moving | self._moved
        self._moved = moving
        closing = self._fastest * cycle_s
        points = self._people.points(cycle_s) if len(self.goals) else np.zeros((0, 20, 3))
        least = math.inf
        for p, xyz in enumerate(points):
            before = self._gaps[p]
            if before - closing > _FAR_M:
                self._gaps[p], self.goals[p] = before - closing, None
                continue
            pair = self._measure(arm, p, xyz, moved)
            gap = min(before, self._gaps[p])
            if moved.any() and gap - closing < NEAR_M:
                least = min(least, self._look_closely(t, cycle_s, p))
                continue
            self._close(p)
            if pair is not None:
                least = min(least, pair.distance)
                self._note_nearest(t + cycle_s, p, pair)
        if moved.any():
            self.moving += 1
            self.histogram[int(np.searchsorted(BINS_M, max(least, 0.0)))] += 1

    def end(self) -> None:
        """Close what is still open."""
        for p in range(len(self.goals)):
            self._close(p)

    def _arm(self, t: float) -> Arm:
        return self._distances.arm(*self._robot.at(t))

    def _measure(self, arm: Arm, p: int, xyz: Array, moved: Mask) -> Pair | None:
        """Note how far somebody is, and what is nearest; return the nearest pair with a link that moved."""
        counted = self._counted[p]
        pair = self._distances.nearest(arm, p, xyz, np.ones_like(counted))
        assert pair is not None, "there are links and parts"
        self._gaps[p] = pair.distance
        of_moved: Pair | None = None
        if moved.any():
            of_moved = self._distances.nearest(arm, p, xyz, moved[:, None] & counted)
        aim = of_moved or pair
        self.goals[p] = Goal(aim.distance, aim.on_link, aim.on_body)
        return of_moved

    def _look_closely(self, t: float, cycle_s: float, p: int) -> float:
        """Look within the cycle for contacts of somebody; return the nearest approach [m]."""
        least, parts = math.inf, self._robot.parts
        for part in range(1, parts + 1):
            tau = cycle_s * part / parts
            arm, xyz = self._arm(t + tau), self._people.points(tau)[p]
            moving, allowed = (arm.speed > self._standstill)[:, None], self._allowed[p]
            too_fast = arm.speed[:, None] > allowed
            pair = self._distances.nearest(arm, p, xyz, moving & too_fast)
            self._note_declared(arm, p, xyz, moving & ~too_fast & np.isfinite(allowed))
            if pair is None:
                self._close(p)
                continue
            least = min(least, pair.distance)
            self._note_nearest(t + tau, p, pair)
            if pair.distance > 0.0:
                self._close(p)
            else:
                self._touch(t + tau, p, pair, float(arm.speed[pair.link]))
        return least

    def _note_declared(self, arm: Arm, p: int, xyz: Array, pairs: Mask) -> None:
        """Note a touch of pairs that may touch as they move now."""
        touching = self._distances.nearest(arm, p, xyz, pairs, 0.0) if pairs.any() else None
        if touching is not None:
            self.declared += 1
            speed = float(arm.speed[touching.link])
            self.fastest_declared_m_s = float(np.fmax(self.fastest_declared_m_s, speed))

    def _note_nearest(self, t: float, p: int, pair: Pair) -> None:
        if self.nearest is None or pair.distance < self.nearest.distance_m:
            self.nearest = Approach(
                t, pair.distance, self._links[pair.link], f"p{p + 1}", PART_NAMES[pair.part]
            )

    def _touch(self, t: float, p: int, pair: Pair, speed: float) -> None:
        """Begin a contact, or go on with it."""
        earlier = self._open[p]
        if earlier is None:
            earlier = SimulatedContact(
                t, f"p{p + 1}", PART_NAMES[pair.part], self._links[pair.link], 0.0, 0.0
            )
        self._open[p] = earlier._replace(
            depth_m=max(earlier.depth_m, -pair.distance), speed_m_s=max(earlier.speed_m_s, speed)
        )

    def _close(self, p: int) -> None:
        contact = self._open[p]
        if contact is not None:
            self.contacts.append(contact)
            self._open[p] = None
