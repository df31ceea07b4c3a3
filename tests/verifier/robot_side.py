"""What a robot does that holds the last plan (assumption A4), told from outside of the supervisor."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits
from tests.failsafe.motions import path_of
from verifier.command import Cause, Command
from verifier.supervisor import Supervisor
from verifier.verdict import Status, Verdict

Array = NDArray[np.float64]

_ROUNDING_S = 1e-6
"""Since 1970 a double is 2.4e-7 s coarse."""
_PER_CYCLE = 6
"""Instants of a cycle at which the robot is looked at."""


class Plan(NamedTuple):
    """A plan that was found verified: when, from when on, and its motion."""

    found: float
    begin: float
    record: np.void
    trajectory: IntendedTrajectory

    @property
    def end(self) -> float:
        """When the robot rests [s]."""
        return self.begin + float(self.record["t"][self.record["n"]])

    def motion(self, t: float) -> tuple[Array, Array, Array]:
        """q, dq, ddq at ``t``: path segments integrated from their first state, chain rule."""
        q, dq, ddq = self.motions(np.array([t]))
        return q[0], dq[0], ddq[0]

    def motions(self, t: Array) -> tuple[Array, Array, Array]:
        """As above for instants ``t (n,)``."""
        end = float(self.record["t"][self.record["n"]])
        tau = t - self.begin
        s, v, a, _ = path_of(self.record, np.minimum(tau, end))
        v, a = (np.where(tau >= end, 0.0, x)[:, None] for x in (v, a))
        s = np.maximum(s, self.trajectory.s_begin)
        assert s.max() <= self.trajectory.s_max, "the robot is where nothing is known of the trajectory"
        q, d1, d2 = (polynomial(s) for polynomial in derivatives_of(self.trajectory))
        return q, d1 * v, d2 * v**2 + d1 * a


@lru_cache(maxsize=32)
def derivatives_of(trajectory: IntendedTrajectory) -> tuple[PPoly, PPoly, PPoly]:
    """q, q', q'' as scipy evaluates them."""
    highest_first = np.moveaxis(trajectory.kernel_coefficients, 1, 0)[::-1]
    q = PPoly(np.ascontiguousarray(highest_first), trajectory.kernel_breaks)
    return q, q.derivative(1), q.derivative(2)


class Recorder:
    """Stands before the check, remembers every plan that it verifies, and fails when it is told to."""

    def __init__(self, check) -> None:
        self.inner, self.robot, self.not_checked = check, check.robot, check.not_checked
        self.supervisor: Supervisor
        self.found: Plan | None = None
        self.refuse = self.fail = False

    @property
    def at_rest(self) -> bool:
        return self.inner.at_rest

    def check(self, t: float, plan, slices, known) -> Verdict:
        return self._ask(self.inner.check, t, plan, slices, known)

    def check_moving(self, t: float, plan, slices, known) -> Verdict:
        return self._ask(self.inner.check_moving, t, plan, slices, known)

    def _ask(self, judge, t: float, plan, slices, known) -> Verdict:
        if self.fail:
            raise RuntimeError("planted")
        answer = judge(t, plan, slices, known)
        if answer.status is Status.VERIFIED and not self.refuse:
            planner = self.supervisor._planner
            begin = float(slices["t"][0, 0])
            self.found = Plan(t, begin, planner.path[0].copy(), self.supervisor._running.trajectory)
        return answer._replace(status=Status.NOT_VERIFIED) if self.refuse else answer


class RobotSide:
    """Holds the plan that was handed over last, drives it into its stop, and keeps what it did.

    Times are those of the supervisor's clock less its epoch.
    """

    def __init__(self, recorder: Recorder, q: Array) -> None:
        self.recorder, self.q = recorder, q
        self.held: Plan | None = None
        self.next: Plan | None = None
        self.t = math.nan
        self.trace: list[tuple[float, Array, Array, Array]] = []

    def motion(self, t: float) -> tuple[Array, Array, Array]:
        """q, dq, ddq at ``t`` if nothing newer is handed over."""
        plan = self.next if self.next is not None and t >= self.next.begin else self.held
        if plan is None:
            return self.q, np.zeros_like(self.q), np.zeros_like(self.q)
        return plan.motion(t)

    def take(self, command: Command) -> None:
        """Hold what the command belongs to; a plan that was withdrawn is forgotten."""
        if command.cause is Cause.ADOPTED:
            assert self.recorder.found is not None, "adopted without a check"
            assert command.verdict.status is Status.VERIFIED
            assert self.recorder.found.begin > self.t, "adopted after its begin"
            if self.next is not None and self.next.begin <= self.t + _ROUNDING_S:
                self.held = self.next
            self.next = self.recorder.found
        elif command.cause is Cause.WITHDRAWN:
            self.next = None
        self.recorder.found = None

    def go_to(self, t: float) -> None:
        """Let time go on [s]."""
        begin = t if math.isnan(self.t) else self.t
        at = np.append(np.linspace(begin, t, _PER_CYCLE, endpoint=False)[1:], t)
        later = at >= (math.inf if self.next is None else self.next.begin)
        self._drive(at[~later])
        if later.any():
            self.held, self.next = self.next, None
            self._drive(at[later])
        self.t = t

    def _drive(self, at: Array) -> None:
        if self.held is None:
            rest = np.zeros_like(self.q)
            self.trace += [(t, self.q, rest, rest) for t in at.tolist()]
        elif len(at) > 0:
            self.trace += list(zip(at.tolist(), *self.held.motions(at), strict=True))

    @property
    def rests(self) -> bool:
        return not self.trace[-1][2].any() and not self.trace[-1][3].any()

    def moved_within(self, limits: JointLimits) -> None:
        """Assert that q, dq, ddq kept the limits and did not jump (jerk bounds every difference)."""
        t = np.array([row[0] for row in self.trace])
        q, dq, ddq = (np.array([row[i] for row in self.trace]) for i in (1, 2, 3))
        slack = 1.0 + 1e-6
        assert (np.abs(dq) <= limits.velocity * slack).all()
        assert (np.abs(ddq) <= limits.acceleration * slack).all()
        h = np.diff(t)[:, None]
        assert (np.abs(np.diff(ddq, axis=0)) <= limits.jerk * h * slack + 1e-6).all(), "acceleration jumps"
        turn = np.diff(dq, axis=0) - h * (ddq[1:] + ddq[:-1]) / 2.0
        assert (np.abs(turn) <= limits.jerk * h**2 / 4.0 + 1e-7).all(), "velocity jumps"
        way = np.diff(q, axis=0) - h * (dq[1:] + dq[:-1]) / 2.0
        assert (np.abs(way) <= limits.jerk * h**3 / 12.0 + 1e-9).all(), "position jumps"
