"""What a stop report says, as plain data."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from failsafe.bracket import Bracket
from failsafe.dynamics import Allowed
from failsafe.stop_grid import StopGrid
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY
from robots.assumption import Assumption
from verifier.inputs import InputFile
from verifier.protective_separation import SeparationHistory
from verifier.required_distance import RequiredDistance

Array = NDArray[np.float64]

JOINT_SPACE, PATH_CONSISTENT, MEASURED, BRAKES = "joint_space", "path_consistent", "measured", "brakes"
ANY_MOTION, RECORDED = "any motion", "this recording"
"""Over what a case is the worst."""
WORDS = {
    JOINT_SPACE: "each joint on its own, as quickly as its limits allow (category 1 or 2)",
    PATH_CONSISTENT: "on the path (category 1 or 2)",
    MEASURED: "the robot's own, as it was measured",
    BRAKES: "by brakes, drives dropped (category 0)",
}


@dataclass(frozen=True, slots=True)
class Missing:
    """What is not known: ``what``, why, and how it can be stated (empty: not here)."""

    what: str
    why: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class Window:
    """Where in a recording a bracket was reached: instant of the cycle [s since the start of the overlap]."""

    t: float


@dataclass(frozen=True, eq=False)
class StopCase:
    """Worst cases of one stop.

    Attributes
    ----------
    stop:
        Whose, a key of ``WORDS``.
    over:
        ``ANY_MOTION`` or ``RECORDED``.
    brackets:
        One per quantity and joint or link.
    instants:
        Of each bracket, where it was reached in the recording; ``None``: not in a recording.
    guessed:
        Brakes that nobody has declared: nothing of it goes into the answer.
    """

    stop: str
    over: str
    brackets: tuple[Bracket, ...]
    instants: tuple[Window | None, ...]
    guessed: bool = False

    @property
    def over_text(self) -> str:
        """Over what it is the worst, in words."""
        if self.over != ANY_MOTION:
            return "the motion of this recording"
        return "any motion up to the speeds that were measured" if self.stop == MEASURED else "any motion"

    def largest(self, quantity: str) -> Bracket | None:
        """Return the bracket of a quantity with the largest upper number, of those the largest lower one."""
        found = [each for each in self.brackets if each.quantity == quantity]
        return max(found, key=lambda each: (each.upper, each.lower), default=None)

    def of(self, quantity: str) -> tuple[Bracket, ...]:
        """Return the brackets of a quantity."""
        return tuple(each for each in self.brackets if each.quantity == quantity)


@dataclass(frozen=True, eq=False)
class Grid:
    """Brackets of one stop at shares of load, speed and extension, reaction and braking apart.

    Attributes
    ----------
    stop, categories:
        Whose, and which stop categories it stands for.
    grid:
        The cells; their brackets are the braking.
    speed:
        (n,) joint speeds at 100 % [rad/s; m/s].
    load_kg:
        Payload at 100 % [kg]; ``None``: the load does not matter.
    guessed:
        As in :class:`StopCase`.
    """

    stop: str
    categories: tuple[int, ...]
    grid: StopGrid
    speed: Array
    load_kg: float | None
    guessed: bool = False


@dataclass(frozen=True, eq=False)
class Reaction:
    """From when somebody is where the robot must stop until its stop begins: the parts [s], and their sum."""

    parts: tuple[Assumption, ...]

    @property
    def seconds(self) -> float:
        """The sum [s]."""
        return sum(float(part.value) for part in self.parts)


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance that a standard requires with a stop: ``required``, or which of its terms are missing."""

    stop: str
    over: str
    edition: str
    form: str
    known: tuple[Assumption, ...]
    required: RequiredDistance | None
    missing: tuple[Missing, ...]


@dataclass(frozen=True, eq=False)
class Profile:
    """A stop over time: ``t (N,)`` [s], ``way, speed (N, n)`` [rad, rad/s; m, m/s] of each joint."""

    stop: str
    over: str
    t: Array
    way: Array
    speed: Array


@dataclass(frozen=True, eq=False)
class RecordedStops:
    """The stop of each cycle of a recording.

    Attributes
    ----------
    t, stop_time_s:
        (N,) cycles [s since the start of the overlap], and how long their stop takes [s]; NaN: none.
    planned, without_stop, beyond_end, looked_at:
        Cycles that have a stop; for which none was proven to keep the limits; whose motion is not known to
        the end of the stop; that were looked at at all.
    off_path:
        Cycles whose stop leaves the path.
    case, profile:
        The worst of them; ``None``: no cycle has a stop.
    residual:
        (n,) how far samples leave the path [rad; m]; ``None``: declared.
    """

    t: Array
    stop_time_s: Array
    planned: int
    without_stop: int
    beyond_end: int
    looked_at: int
    off_path: int
    case: StopCase | None
    profile: Profile | None
    residual: Array | None


@dataclass(frozen=True, eq=False)
class TorqueCheck:
    """What torque limits leave of the deceleration of the model, at one load [kg]."""

    load_kg: float
    allowed: Allowed
    brackets: tuple[Bracket, ...]


@dataclass(frozen=True, eq=False)
class Pose:
    """A state of the arm as a picture needs it.

    Attributes
    ----------
    title, stop:
        What is the worst there, and with which stop.
    q, dq:
        (n,) configuration and joint speeds [rad, rad/s; m, m/s].
    links:
        Names of the capsules.
    ends, radius:
        (L, 2, 3), (L,) axes and radii of the capsules [m].
    axes:
        (n, 3) origins of the joints [m].
    fastest, velocity, link:
        (3,) the fastest point at that state [m] and its velocity (3,) [m/s]; the link that it is on.
    """

    title: str
    stop: str
    q: Array
    dq: Array
    links: tuple[str, ...]
    ends: Array
    radius: Array
    axes: Array
    fastest: Array
    velocity: Array
    link: str


@dataclass(frozen=True, eq=False)
class PoseToMeasure:
    """A stop to be measured on the real robot, and what the model says of it.

    ``where``: an index of the grid's cell, or an instant of the recording; ``load_kg``: ``None``: the model
    has no load.
    """

    stop: str
    bracket: Bracket
    load_kg: float | None
    guessed: bool
    instant: float | None = None


@dataclass(frozen=True, eq=False)
class StopReport:
    """Worst-case stops of an arm; docs/stop-report.schema.json describes its JSON.

    ``answer``: the case that the first page is about; ``speeds, answer_speeds``: (n,) joint speeds at 100 %,
    and up to which the answer holds [rad/s; m/s]; ``separation``: ``None`` without a recording of people.
    ``interrupted``: brackets hold, but are as they had been reached by then, and what was not begun is
    missing.
    """

    robot: str
    tool: str | None
    joints: tuple[str, ...]
    units: tuple[str, ...]
    recording: str | None
    cell_hash: str
    version: str
    waived: tuple[str, ...]
    speed: float
    speeds: Array
    answer_speeds: Array
    reaction: Reaction
    answer: StopCase
    cases: tuple[StopCase, ...]
    grids: tuple[Grid, ...]
    distances: tuple[Distance, ...]
    recorded: RecordedStops | None
    separation: SeparationHistory | None
    profile: Profile
    torques: tuple[TorqueCheck, ...]
    poses: tuple[Pose, ...]
    to_measure: tuple[PoseToMeasure, ...]
    missing: tuple[Missing, ...]
    assumptions: tuple[Assumption, ...]
    inputs: tuple[InputFile, ...]
    interrupted: bool
    seconds: float

    @property
    def limited(self) -> bool:
        """Whether joints can be faster than in any stop that the answer was measured from."""
        return self.answer.stop == MEASURED and bool((self.answer_speeds < self.speeds).any())

    @property
    def total_s(self) -> float | None:
        """T: reaction and upper number of the longest stop of the answer [s]; ``None``: not bounded."""
        longest = self.answer.largest(STOP_TIME)
        if longest is None or not longest.upper < math.inf:
            return None
        return self.reaction.seconds + longest.upper

    @property
    def exit_status(self) -> int:
        """0 nothing waived, 1 ended before everything was looked at, 3 under waivers."""
        if self.interrupted:
            return 1
        return 3 if self.waived else 0

    def numbered(self) -> Iterator[tuple[int, StopCase, Bracket, Window | None]]:
        """Yield every bracket with its number in ``worst_case`` of the JSON, its case and its instant."""
        number = 0
        for case in self.cases:
            for bracket, instant in zip(case.brackets, case.instants, strict=True):
                yield number, case, bracket, instant
                number += 1


QUANTITIES = (STOP_TIME, STOP_ANGLE, POINT_SPEED, STOP_WAY)
"""Of a stop, in the order in which they are shown."""
