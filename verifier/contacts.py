"""Where recorded people touched the links of an arm that moved otherwise than it was recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, Profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.hypotheses import PEOPLE
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement, Reading
from occupancy.separation import LEDGER, Separation
from occupancy.sets import LINK_SETS
from occupancy.swept import LinkOccupancy
from robots.model import RobotModel
from robots.motion import Block, new_slices
from verifier.criteria import Standstill

Array = NDArray[np.float64]

_HARDLY_MOVES_M_S = 1e-9
"""A profile needs a speed; over no time at all this one moves nobody."""


class RecordedContacts:
    """Compares the commanded pose at the stamp of a report with the bodies in it, nothing grown.

    Bodies are those of ISO 13855 around the points as measured, without their errors and without parts that
    were not measured; links are their enclosures. A link that rests touches nobody: contact at standstill is
    not what is counted.
    """

    def __init__(self, robot: RobotModel, gate: Gate, profile: Profile, standstill: Standstill) -> None:
        self._gate = gate
        self._standstill = standstill
        self._model = Iso13855(profile.with_speed(_HARDLY_MOVES_M_S))
        self._sets = self._model.new_sets()
        self._separation = Separation(margin=0.0)
        self._sweep = LinkOccupancy(robot)
        self._slices = new_slices()
        self._links: Block = np.zeros(1, dtype=LINK_SETS)
        self._ledger: Block = np.zeros(1, dtype=LEDGER)
        self._n_links = int(robot.enclosure["n"][0])
        plan = self._slices[0]
        plan["n"], plan["n_joints"] = 1, len(robot.joints)

    def touching(self, report: RawMeasurement, q: Array, dq: Array) -> list[tuple[str, float]]:
        """Return who of a report touches a moving link, and how deep [m], with the arm at ``q, dq (n,)``."""
        found = []
        for person in report.people:
            reading = self._gate.read(report, person)
            if reading is not None and reading.present:
                gap = self._gap(report.stamp, reading, q, dq)
                if gap <= 0.0:
                    found.append((person.id, -gap))
        return found

    def _gap(self, stamp: float, reading: Reading, q: Array, dq: Array) -> float:
        plan, n = self._slices[0], len(q)
        plan["t"][:2] = stamp
        plan["q"][:2, :n], plan["dq"][:2, :n] = q, dq
        plan["dq_max"][0, :n] = np.abs(dq)
        self._sweep.occupy(self._slices, self._links)
        self._model.occupy(_standing(stamp, reading), self._slices, self._sets)
        moving = self._links["speed_max"][0, : self._n_links] > self._standstill.speed_m_s
        book = self._ledger[0]
        book["n_slices"], book["n_links"], book["n_people"] = 1, self._n_links, 1
        written = self._sets["covers"][0, : self._sets["n"][0]]
        inferred = self._model.inferred_parts(reading.present)
        parts = int(np.bitwise_or.reduce(written, initial=np.uint32(0))) & ALL_PARTS & ~inferred
        book["open"][0, : self._n_links, 0] = np.where(moving, np.uint32(parts), np.uint32(0))
        return self._separation.check(self._links, self._sets, self._ledger).gap_m


def _standing(stamp: float, reading: Reading) -> Block:
    """Return a people block with one person exactly where a reading has them."""
    people: Block = np.zeros(1, dtype=PEOPLE)
    people["n"] = 1
    people["present"][0, 0] = reading.present
    people["xyz"][0, 0], people["t_obs"][0, 0] = reading.xyz, stamp
    people["e_v"][0, 0] = np.inf
    return people
