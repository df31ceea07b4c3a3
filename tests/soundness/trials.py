"""The cycle check on random cells: judged with the people anywhere, as it is or with something left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from failsafe.plan import PlanResult
from occupancy.body import Profile
from occupancy.measurement import Gate
from occupancy.separation import Separation
from robots.model import RobotModel
from robots.motion import Block
from tests.soundness.cells import FAR_M, STANDSTILL_M_S, Cell, human_model, planned
from tests.soundness.persons import report
from verifier.criteria import ContactCriterion, SeparationCriterion, Standstill
from verifier.cycle import CycleCheck, CycleSettings, Known
from verifier.verdict import Status, Verdict


class Alteration(Protocol):
    """What a test changes in the verifier, never in what is true."""

    def profile(self, profile: Profile) -> Profile:
        """Change what is believed about people."""
        ...

    def robot(self, robot: RobotModel) -> RobotModel:
        """Change what is believed about the arm."""
        ...

    def slices(self, slices: Block, plan: PlanResult) -> None:
        """Change the motion that is checked."""
        ...

    def people(self, people: Block, t: float) -> None:
        """Change what is known about people."""
        ...


class Unaltered:
    """The verifier as it is."""

    def profile(self, profile: Profile) -> Profile:
        return profile

    def robot(self, robot: RobotModel) -> RobotModel:
        return robot

    def slices(self, slices: Block, plan: PlanResult) -> None: ...

    def people(self, people: Block, t: float) -> None: ...


class Trial:
    """One cell with its plan, ready to be judged with the people anywhere; ``contact``: what may touch."""

    def __init__(
        self, cell: Cell, alteration: Alteration | None = None, contact: ContactCriterion | None = None
    ) -> None:
        self.cell = cell
        self._alteration = Unaltered() if alteration is None else alteration
        self.planner, self.plan = planned(cell)
        self._alteration.slices(self.planner.slices, self.plan)
        self.profile = self._alteration.profile(cell.profile)
        self.check = CycleCheck(
            self._alteration.robot(cell.robot),
            [human_model(self.profile, cell.held)],
            [SeparationCriterion(Separation(1e-4), 1e-4)],
            CycleSettings(cell.parts, Standstill(STANDSTILL_M_S, 2e-3), 0.1, assume_nobody=False),
            contact=contact,
        )
        self.gate = Gate(self.profile, cell.gate)

    def admit(self, distance: float) -> Known:
        """Report the people at ``distance`` [m] to a new gate."""
        cell = self.cell
        self.gate = Gate(cell.profile, cell.gate)
        people = cell.placed(distance)
        for number, stamp in enumerate(cell.stamps):
            admission = self.gate.admit(report(people, number, stamp, stamp), cell.t)
            if admission.refusals or admission.contradictions:
                raise AssertionError(f"the people of this cell are not what they should be: {admission}")
        self._alteration.people(self.gate.people, cell.t)
        return Known(self.gate.people, True, -np.inf, self.gate.contradicted, self.gate.overflow)

    def judge(self, distance: float) -> Verdict:
        """Judge the plan with the people at ``distance`` [m]."""
        return self.check.check(self.cell.t, self.plan, self.planner.slices, self.admit(distance))


def closest_verified(
    trial: Trial, steps: int, judged: Callable[[float, Verdict], None] | None = None
) -> float | None:
    """Halve the distance of the people between far and here, ``steps`` times; the closest verified [m].

    None if they are not even verified far away. ``judged`` is told every distance and verdict.
    """
    low, high, found = 0.0, FAR_M, None
    for step in range(steps):
        distance = FAR_M if step == 0 else 0.5 * (low + high)
        verdict = trial.judge(distance)
        if judged is not None:
            judged(distance, verdict)
        if verdict.status is Status.VERIFIED:
            found = high = distance
        elif step == 0:
            return None
        else:
            low = distance
    return found
