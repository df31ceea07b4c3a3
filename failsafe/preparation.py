"""Before a trajectory is taken over: does it keep the limits with a reserve, and can it be stopped anywhere?

Whatever is missed here is found by the check of every single plan, and then costs a stop (docs/method.md,
section 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.manoeuvre import Excess, come_to_rest
from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.scaling import bounds_of_stretches
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits

Array = NDArray[np.float64]

_MOST_PLACES = 20_000
"""A trajectory is looked at in no more places than this."""
_CLOSER = 64
"""Parts of a stretch of path whose bounds, which are wider than the motion, lie beyond a limit."""

_SURELY = 0.999
"""Share of the largest path speed that a refusal names: other stretches of the path have other bounds."""


class Objection(IntEnum):
    """Why a trajectory is not taken over."""

    NONE = 0
    OTHER_JOINTS = 1
    BEYOND_LIMITS = 2
    NO_STOP = 3
    NO_REST = 4
    JUMP = 5
    JOINS_TOO_EARLY = 6
    OUTDATED = 7
    NOT_AT_REST = 8
    NOT_A_NUMBER = 9
    NO_CONNECTOR = 10
    LATCHED = 11


class Refusal(NamedTuple):
    """Why a trajectory is not taken over, as a constraint that a planner can use.

    Attributes
    ----------
    objection, text:
        Kind of the reason, and a sentence.
    s:
        Path parameter [s] where it holds; for ``JOINS_TOO_EARLY`` the earliest one that is possible. NaN:
        nowhere in particular.
    joint:
        Joint concerned, -1: none.
    path_speed:
        Constant ṡ with which the path keeps limits and reserve, within 0.2 % of the largest such; from
        standstill the path stretched by its reciprocal is accepted as far as they go. A path that joins in
        motion needs about that much more time, and is to be made anew. NaN: unknown.
    """

    objection: Objection
    text: str
    s: float = math.nan
    joint: int = -1
    path_speed: float = math.nan


@dataclass(frozen=True, slots=True)
class Reserve:
    """What intended motion leaves to the manoeuvres that follow it (docs/method.md, section 2).

    Attributes
    ----------
    dynamic:
        Share of the acceleration and jerk limits that it may use.
    step_s:
        Distance of the places at which a stop is looked for [s].
    """

    dynamic: float = 0.8
    step_s: float = 0.02

    def __post_init__(self) -> None:
        if not 0.0 < self.dynamic <= 1.0:
            raise TrajectoryError(f"reserve: dynamic = {self.dynamic} should be above 0 and at most 1")
        if not 0.0 < self.step_s < math.inf:
            raise TrajectoryError(f"reserve: step of {self.step_s} s should be positive and finite")


class Preparation:
    """Looks at trajectories in the thread of whoever proposes them; no state is shared with the cycle."""

    def __init__(self, limits: JointLimits, settings: PlanSettings, reserve: Reserve) -> None:
        self.limits = limits
        self.reserve = reserve
        self._planner = ShortTermPlanner(limits, replace(settings, allow_joint_space=False))
        self._reserved = replace(
            limits, acceleration=reserve.dynamic * limits.acceleration, jerk=reserve.dynamic * limits.jerk
        )
        rounded = 1.0 + 1e-9  # what was made to keep the reserve may touch it
        allowed = (limits.velocity, rounded * self._reserved.acceleration, rounded * self._reserved.jerk)
        self._allowed = np.stack(allowed)

    @property
    def reserved(self) -> JointLimits:
        """Return the limits with the share of acceleration and jerk that intended motion may use."""
        return self._reserved

    def prepare(
        self, trajectory: IntendedTrajectory, since: float = -math.inf
    ) -> IntendedTrajectory | Refusal:
        """Return the trajectory, ending at rest, or why it is not taken over; looked at from ``since`` on."""
        n = len(self.limits.joints)
        if trajectory.n_joints != n:
            text = f"the trajectory has {trajectory.n_joints} joints, the robot {n}"
            return Refusal(Objection.OTHER_JOINTS, text)
        try:
            whole = come_to_rest(trajectory, self._reserved)
        except TrajectoryError as error:
            return Refusal(Objection.NO_REST, str(error), trajectory.s_end, error.joint)
        return self._beyond_limits(trajectory, since) or self._without_stop(whole, since) or whole

    def faster(self, trajectory: IntendedTrajectory, speed: float, since: float) -> Refusal | None:
        """Return why the rest of a prepared trajectory from ``since`` on cannot be followed at ``speed``."""
        return self._too_fast(trajectory, speed, since) or self._without_stop(trajectory, since, speed)

    def path_speed(
        self, trajectory: IntendedTrajectory, since: float = -math.inf
    ) -> tuple[float, float, int]:
        """Return the largest constant ṡ that keeps velocity, and acceleration and jerk with their reserve.

        With the path parameter [s] and the joint that decide. ṡ = v multiplies dq, ddq, dddq by v, v², v³.
        """
        begin, end = self._cells(trajectory, since)
        if len(begin) == 0:
            return math.inf, math.nan, -1
        speeds = self._speeds(trajectory, begin, end)
        if (slow := ~(speeds.min(axis=1) >= 1.0)).any():
            near, far = _closer(begin[slow], end[slow])
            begin = np.concatenate([begin[~slow], near])
            speeds = np.concatenate([speeds[~slow], self._speeds(trajectory, near, far)])
        cell = int(np.argmin(speeds.min(axis=1)))  # NaN counts as the smallest
        joint, slowest = int(np.argmin(speeds[cell])), float(speeds[cell].min())
        return slowest, float(begin[cell]), -1 if slowest == math.inf else joint

    def _speeds(self, trajectory: IntendedTrajectory, begin: Array, end: Array) -> Array:
        """Return for each stretch and joint ``(C, n)`` the largest constant ṡ."""
        lo, hi = bounds_of_stretches(trajectory, begin, end)
        largest = np.maximum(np.abs(lo[:, 1:]), np.abs(hi[:, 1:]))
        with np.errstate(divide="ignore", over="ignore"):
            speeds: Array = (self._allowed / largest) ** np.array([[1.0], [0.5], [1.0 / 3.0]])
        least: Array = speeds.min(axis=1)
        return least

    def _cells(self, trajectory: IntendedTrajectory, since: float) -> tuple[Array, Array]:
        """Begins and ends of stretches of the path, none across a break, whose bounds together are tight."""
        length = max(self.reserve.step_s, (trajectory.s_end - trajectory.s_begin) / _MOST_PLACES)
        edges: list[Array] = []
        for begin, b in zip(trajectory.breaks[:-1].tolist(), trajectory.breaks[1:].tolist(), strict=True):
            a = max(begin, since)
            if a < b:
                parts = math.ceil((b - a) / length)
                edges.append(np.array([a, b]) if parts <= 1 else np.linspace(a, b, parts + 1))
        if not edges:
            return np.zeros(0), np.zeros(0)
        return np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])

    def _beyond_limits(self, trajectory: IntendedTrajectory, since: float) -> Refusal | None:
        limits = self.limits
        begin, end = self._cells(trajectory, since)
        outside = self._outside(trajectory, begin, end)
        if outside.any():  # or only its bounds are, which are wider than the motion: look closer
            cells = outside.any(axis=1)
            begin, end = _closer(begin[cells], end[cells])
            outside = self._outside(trajectory, begin, end)
        if outside.any():
            cell, i = (int(each) for each in np.argwhere(outside)[0])
            text = f"joint {limits.joints[i]} would leave its position range after s = {begin[cell]:.3f} s"
            return Refusal(Objection.BEYOND_LIMITS, text, float(begin[cell]), i)
        return self._too_fast(trajectory, 1.0, since)

    def _outside(self, trajectory: IntendedTrajectory, begin: Array, end: Array) -> NDArray[np.bool_]:
        """Tell for each stretch and joint ``(C, n)`` whether bounds of q lie outside the position range."""
        lo, hi = bounds_of_stretches(trajectory, begin, end)
        inside: NDArray[np.bool_] = (lo[:, 0] >= self.limits.position_lower) & (
            hi[:, 0] <= self.limits.position_upper
        )
        return ~inside

    def _too_fast(self, trajectory: IntendedTrajectory, speed: float, since: float) -> Refusal | None:
        allowed, where, joint = self.path_speed(trajectory, since)
        if allowed >= speed:
            return None
        allowed *= _SURELY
        text = (
            f"joint {self.limits.joints[joint]} would exceed velocity, or {self.reserve.dynamic:g} times "
            f"acceleration or jerk, at s = {where:.3f} s; a path speed of {allowed:.3f} would not"
        )
        return Refusal(Objection.BEYOND_LIMITS, text, where, joint, allowed)

    def _without_stop(
        self, trajectory: IntendedTrajectory, since: float, speed: float = 1.0
    ) -> Refusal | None:
        places = np.arange(max(trajectory.s_begin, since), trajectory.s_end, self.reserve.step_s)
        step = max(1, math.ceil(len(places) / _MOST_PLACES))
        for s in places[::step].tolist():
            plan = self._planner.plan(trajectory, 0.0, s, speed)
            if plan.outcome is not PlanOutcome.READY:
                excess = Excess(plan.joint, plan.quantity, plan.value, plan.limit)
                return Refusal(Objection.NO_STOP, self._no_stop(s, excess), s, plan.joint)
        return None

    def _no_stop(self, s: float, excess: Excess) -> str:
        what = excess.quantity.name.lower()
        who = "the path" if excess.joint < 0 else f"joint {self.limits.joints[excess.joint]}"
        why = f": {what} of {who} would be {excess.value:.4g}, limit {excess.limit:.4g}"
        if not math.isfinite(excess.limit):  # there is no place on the path to stop at
            why = ""
        return f"no stop on the path keeps the limits at s = {s:.3f} s{why}; slow down there"


def _closer(begin: Array, end: Array) -> tuple[Array, Array]:
    """Cut each stretch into equal parts, whose bounds are tighter."""
    edges = np.linspace(begin, end, _CLOSER + 1)
    return edges[:-1].T.ravel(), edges[1:].T.ravel()


def splice(old: IntendedTrajectory, new: IntendedTrajectory, join: float) -> IntendedTrajectory:
    """Return ``old`` up to the path parameter ``join`` [s], then ``new`` from its begin on.

    Raises
    ------
    TrajectoryError
        ``join`` is outside of ``old``, q, q' or q'' jump there (docs/method.md, section 2), or the two have
        different numbers of joints.
    """
    if old.n_joints != new.n_joints:
        raise TrajectoryError(
            f"a trajectory of {new.n_joints} joints cannot be joined to one of {old.n_joints} joints"
        )
    if not old.s_begin <= join <= old.s_end:
        raise TrajectoryError(
            f"a trajectory cannot be joined at s = {join} s: the path goes from {old.s_begin:g} s to "
            f"{old.s_end:g} s"
        )
    kept = int(np.searchsorted(old.breaks, join, side="left"))
    breaks = np.concatenate([old.breaks[:kept], join + (new.breaks - new.s_begin)])
    coefficients = np.concatenate([old.coefficients[:kept], new.coefficients])
    return IntendedTrajectory(breaks, coefficients, new.end)
