"""What a step of the supervisor answers: the command, the state that the robot is in, and why."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.running_plan import RunningPlan
from verifier.verdict import Verdict

Array = NDArray[np.float64]


class State(IntEnum):
    """What the robot is made to do; transitions in docs/supervisor.md."""

    STOPPED = 0
    EXECUTING = 1
    FAILSAFE = 2
    RECOVERING = 3


class Cause(IntEnum):
    """Why a step had the outcome that it had."""

    ADOPTED = 0
    """The new plan was verified and adopted."""
    RESTING = 1
    """The robot rests, and nothing is intended."""
    NOT_VERIFIED = 2
    """The new plan was not verified: the verdict says why."""
    CLOCK = 3
    """``now`` did not advance, or is not a number."""
    FAULT = 4
    """Something raised an exception; ``Supervisor.fault`` is what."""
    LATCHED = 5
    """Nothing is verified any more: after a fault while reports were taken in, because what is known may be
    wrong; after a silence to which the robot reacts by itself, because where it is is not known."""
    WITHDRAWN = 6
    """The new plan was not handed over by its deadline, and is not adopted."""


class Command(NamedTuple):
    """What the robot is to do next.

    Attributes
    ----------
    t:
        Instant [s, caller's clock] at which the robot is to be at ``q``.
    deadline:
        Instant [s] by which the robot side must hold this command and its plan; else call ``withdraw``.
    q, dq, ddq:
        ``(n,)`` [rad, rad/s, rad/s²; m for prismatic joints].
    outcome, cause, verdict:
        State after this step, why, and the verdict on the plan that it made.
    missed:
        Cycles since the step before in which none was called.
    """

    t: float
    deadline: float
    q: Array
    dq: Array
    ddq: Array
    outcome: State
    cause: Cause
    verdict: Verdict
    missed: int


class Running(NamedTuple):
    """The plan that the last command belongs to, and when it began or begins [s, caller's clock]."""

    plan: RunningPlan
    begin: float
