"""What comes of a trial: how it went, which of its stops were needed, and whether a clear way existed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.arrt import Planner, PlannerSettings
from modes.planning.potential_field import Bodies, Field, FieldSettings, Fixtures
from modes.planning.trials import END_S, PICK, PLACE, Trial
from modes.settings import require_choice
from modes.twin.people import Person
from occupancy.body import Profile
from robots.model import RobotModel

Array = NDArray[np.float64]

PROPOSERS = ("fixed", "present", "forecast")
_FRAME_S = 0.25
"""A person's whole motion is looked at so often, where the existence of a clear way is judged."""
_LONG_SEARCH = PlannerSettings(nodes=6000)


@dataclass(frozen=True, slots=True)
class Setting:
    """How a trial is run.

    Attributes
    ----------
    supervised:
        Whether the supervisor knows of the person; otherwise it is told that nobody is there.
    proposer:
        ``"fixed"``: the straight way, whoever is there; ``"present"``: the mode without forecasts;
        ``"forecast"``: with them.
    """

    supervised: bool
    proposer: str

    def __post_init__(self) -> None:
        require_choice("setting: proposer", self.proposer, PROPOSERS)


@dataclass(slots=True)
class Run:
    """How a trial went.

    Attributes
    ----------
    number, setting:
        Which trial, and how it was run.
    arrived_s:
        When the arm was at its goal [s]; inf: not in time.
    contacts:
        Cycles in which a moving link touched the person, by MuJoCo.
    moving_m, resting_m:
        Least gap between the person and a link that moved, and of one that rested [m]; inf: never within 1 m.
    halts, needed:
        How often the mode stopped the arm because of somebody near the way ahead, and how often the person
        would have come nearer than the clearance, had it gone on.
    ways, refused:
        How many ways it took, and how many of its proposals the supervisor refused at once.
    standstills:
        How often the arm came to rest before its goal.
    decisions_s:
        How long each decision of the mode took; those in which it planned are ``planning_s``, too.
    nodes, corners:
        Of each search that found a way: nodes of both trees, and corners of the path.
    places:
        ``(k, 3)`` where the tool was [m].
    """

    number: int
    setting: Setting
    arrived_s: float = math.inf
    contacts: int = 0
    moving_m: float = math.inf
    resting_m: float = math.inf
    halts: int = 0
    needed: int = 0
    ways: int = 0
    refused: int = 0
    standstills: int = 0
    decisions_s: list[float] = field(default_factory=list)
    planning_s: list[float] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    corners: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)

    @property
    def arrived(self) -> bool:
        """Whether the arm was at its goal in time."""
        return math.isfinite(self.arrived_s)


class Witness:
    """Judges with the truth, which neither mode nor supervisor knows.

    Parameters
    ----------
    robot, profile:
        The arm, and radii of people.
    fixtures:
        What else stands there.
    clearance_m:
        That is wanted [m].

    Attributes
    ----------
    field:
        Of that arm and clearance.
    """

    def __init__(
        self, robot: RobotModel, profile: Profile, fixtures: Fixtures, clearance_m: float = 0.25
    ) -> None:
        self.field = Field(robot, FieldSettings(clearance_m=clearance_m))
        self._planner = Planner(self.field, _LONG_SEARCH)
        self._profile, self._fixtures = profile, fixtures

    def needed(self, person: Person, t: float, way: IntendedTrajectory, s: float, ahead_s: float) -> bool:
        """Whether the person comes nearer than the clearance if the arm goes on along its way from ``s``."""
        for after in np.arange(0.0, ahead_s, 0.05).tolist():
            q = way.sample(min(s + after, way.s_end))[0]
            if not self.field.is_clear(q, self.bodies([person.at(t + after)])):
                return True
        return False

    def has_clear_way(self, trial: Trial) -> bool:
        """Whether a way that keeps the clearance is found with the truth, and a long search.

        Either beside everything that the person does, or, where the arm may rest at its start all the time,
        beside where the person is in the end. Others may exist.
        """
        return any(self._finds(frames) for frames in self.asked(trial))

    def asked(self, trial: Trial) -> list[list[Array]]:
        """Return beside which frames ``(20, 3)`` of a person a way is searched; one of them suffices."""
        whole = [trial.person.at(t) for t in np.arange(0.0, END_S, _FRAME_S).tolist()]
        waits = self.field.is_clear(np.array(PICK), self.bodies(whole))
        return [whole, whole[-1:]] if waits else [whole]

    def _finds(self, frames: Sequence[Array]) -> bool:
        bodies = self.all_of_it(frames)
        return self._planner.plan(np.array(PICK), np.array(PLACE), bodies).path is not None

    def all_of_it(self, frames: Sequence[Array]) -> Bodies:
        """Return the person in all frames, and what else stands there."""
        return self.bodies(frames).beside(self._fixtures, self.field.settings.clearance_m)

    def bodies(self, frames: Sequence[Array]) -> Bodies:
        """Return the person in all frames."""
        return Bodies.of_points([each[None] for each in frames], self._profile)


class Errors(NamedTuple):
    """Mean error of a forecast [m].

    Attributes
    ----------
    horizon_s, model, error_m:
        How far ahead, by which forecaster, and how far joints were from it on average.
    """

    horizon_s: float
    model: str
    error_m: float
