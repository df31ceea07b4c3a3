"""What a short-term plan looks like, and what became of one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.braking import Braking
from failsafe.manoeuvre import Quantity
from failsafe.silence import Silence
from robots.errors import SetupError

Array = NDArray[np.float64]


class PlanOutcome(IntEnum):
    """Why there is a plan, or none."""

    READY = 0
    INVALID_STATE = 1
    """Path state not finite, clock too far from its epoch, path speed negative, other number of joints."""
    BEYOND_END = 2
    """The plan would run past the end of what is known of the trajectory."""
    STATE_BEYOND_LIMITS = 3
    """The intended piece itself exceeds a limit."""
    NO_STOP = 4
    """No stop was proven to keep the limits."""


class StopKind(IntEnum):
    """How the plan comes to rest."""

    NONE = 0
    PATH_CONSISTENT = 1
    JOINT_SPACE = 2
    MEASURED = 3
    """The robot's own, bounded by what was measured; no command of this software."""


class PlanResult(NamedTuple):
    """What became of a plan.

    ``t_*`` [s] on the cell's clock (by ``t_rest`` the robot's own reaction to silence, if it has one, has
    ended too), ``s_rest`` [s] path parameter at rest (NaN off the path), ``a_s`` [1/s], ``j_s`` [1/s²]. If
    the outcome is not READY: joint (-1: none), quantity, value and limit that it failed on.
    """

    outcome: PlanOutcome
    stop: StopKind = StopKind.NONE
    t_stop_begin: float = math.nan
    t_rest: float = math.nan
    s_rest: float = math.nan
    stop_time_s: float = math.nan
    a_s: float = math.nan
    j_s: float = math.nan
    joint: int = -1
    quantity: Quantity = Quantity.NONE
    value: float = math.nan
    limit: float = math.nan


class PlanError(SetupError):
    """Settings of a planner that cannot be used; one line that names value and rule."""


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """What a plan looks like.

    Attributes
    ----------
    cycle_s:
        Length of the intended piece [s].
    delay:
        Smallest and largest delay between command and robot [s].
    q_error, dq_error:
        ``(n,)`` bounds of the tracking error [rad, rad/s; m, m/s for prismatic joints].
    slice_s:
        Wanted length of a slice [s]; longer where 64 slices would not do.
    search_steps:
        Candidates for path acceleration and jerk per plan.
    allow_joint_space:
        Stop every joint on its own where no path-consistent stop is proven.
    check_position_limits:
        Hold piece and stop against the joints' position limits.
    silence:
        What the robot does by itself when no command comes, to be part of every plan; ``None``: it holds the
        plan, and drives its stop.
    braking:
        The plan ends with the robot's own stop, told at the end of the piece, bounded as it was measured;
        ``None``: with one of this software's. Only for :meth:`ShortTermPlanner.plan`.
    """

    cycle_s: float
    delay: tuple[float, float]
    q_error: Array
    dq_error: Array
    slice_s: float = 0.01
    search_steps: int = 12
    allow_joint_space: bool = True
    check_position_limits: bool = True
    silence: Silence | None = None
    braking: Braking | None = None

    def __post_init__(self) -> None:
        for name, value in (("cycle", self.cycle_s), ("slice", self.slice_s)):
            if not 0.0 < value < math.inf:
                raise PlanError(f"{name} of {value} s should be positive and finite")
        if not 0.0 <= self.delay[0] <= self.delay[1] < math.inf:
            raise PlanError(f"delay {self.delay} s should be two finite values, 0 <= smallest <= largest")
        for name, error in (("q_error", self.q_error), ("dq_error", self.dq_error)):
            if not (np.ndim(error) == 1 and np.isfinite(error).all() and np.min(error, initial=0.0) >= 0.0):
                raise PlanError(f"{name} {error} should be one finite value >= 0 per joint")
        if self.silence is not None and len(self.silence.deceleration) != len(self.q_error):
            given = len(self.silence.deceleration)
            raise PlanError(f"silence: {given} decelerations should be {len(self.q_error)}: one per joint")
        if self.braking is not None:
            if len(self.braking.fastest) != len(self.q_error):
                given = len(self.braking.fastest)
                raise PlanError(f"braking: {given} joints should be {len(self.q_error)}")
            if self.delay[1] > 0.0 or self.silence is not None:
                raise PlanError(
                    "braking: counts from when the robot is told: no delay and no silence beside it"
                )
        if self.search_steps < 1:
            raise PlanError(f"{self.search_steps} search steps should be at least 1")
