"""Copies of what the next step of a supervisor begins with, for whoever asks beside the loop."""

from __future__ import annotations

from typing import NamedTuple

from failsafe.plan import PlanResult
from failsafe.running_plan import RunningPlan
from failsafe.scaling import PathState
from failsafe.short_term_plan import PlanMemory
from failsafe.trajectory import IntendedTrajectory
from robots.motion import Block
from verifier.command import Command
from verifier.cycle import Known


class Made(NamedTuple):
    """A plan that was made, whatever became of it.

    Attributes
    ----------
    result, slices:
        As a planner leaves them.
    motion:
        The plan as it would be executed; ``None`` if there is none.
    begin:
        When it would begin [s after the epoch].
    """

    result: PlanResult
    slices: Block
    motion: RunningPlan | None
    begin: float


class Outlook(NamedTuple):
    """What the next step would begin with if nothing new arrived: copies, for a planner's questions.

    Attributes
    ----------
    epoch:
        All other times are counted from here [s, caller's clock].
    now, begin:
        Instant of the next step, and of the plan that it makes [s].
    trajectory, start, target:
        What that plan follows, its path state at ``begin``, and the wanted path speed.
    memory:
        What the planner would try first.
    known, ids:
        What is known about people, and their ids.
    command, latched:
        The last command; nothing is verified any more.
    made:
        The plan of the last step, where that was not verified.
    """

    epoch: float
    now: float
    begin: float
    trajectory: IntendedTrajectory
    start: PathState
    target: float
    memory: PlanMemory
    known: Known
    ids: tuple[str, ...]
    command: Command
    latched: bool
    made: Made | None
