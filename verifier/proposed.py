"""What was proposed, made ready in the proposer's thread, until the next step takes it over.

Nothing here is believed by the cycle: it looks again at whether what was prepared fits the plan that runs by
then (``Supervisor``), and every plan that comes of it is verified.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from numbers import Real
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from failsafe.joint_velocity import to_joint_velocity
from failsafe.plan import PlanSettings
from failsafe.preparation import Objection, Preparation, Refusal, Reserve, splice
from failsafe.running_plan import RunningPlan
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits
from verifier.number import as_float
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Proposal, Stop

Array = NDArray[np.float64]
Waiting = TypeVar("Waiting")

_MOST_BASES = 4
"""What waits may itself wait for others that wait, this deep."""
BEHIND_S = 10.0
"""So much path [s] is kept behind the robot where a trajectory joins; what lies farther back is let go."""
LONGEST_HORIZON_S = 60.0
"""Of joint velocities."""


class Prepared(NamedTuple):
    """A trajectory that was looked at.

    Attributes
    ----------
    trajectory:
        Where it joins, the path up to there included.
    bases:
        Trajectories that it equals up to a path parameter [s]: it may take the place of any one of them, if
        the running stop ends before that.
    from_rest:
        It begins where the robot rests; then the path parameters of ``bases`` are NaN.
    """

    trajectory: IntendedTrajectory
    bases: tuple[tuple[IntendedTrajectory, float], ...]
    from_rest: bool

    def join_on(self, running: IntendedTrajectory) -> float | None:
        """Return up to where it equals ``running`` [s]; ``None``: it was made for another trajectory."""
        return next((join for base, join in self.bases if base is running), None)


class WayBack(NamedTuple):
    """A path in the other direction, and the one that it is the other direction of."""

    trajectory: IntendedTrajectory
    of: IntendedTrajectory


class Proposals:
    """Prepares proposals in the thread that calls ``propose``; ``take`` is for the cycle.

    Of several path speeds, and of several trajectories, the last one before ``take`` counts.

    Parameters
    ----------
    limits, plans, reserve:
        As of the supervisor.
    cycle_number:
        Returns the number of the cycle that runs; how long a preparation takes is counted in cycles.
    """

    def __init__(
        self, limits: JointLimits, plans: PlanSettings, reserve: Reserve, cycle_number: Callable[[], int]
    ) -> None:
        self._limits = limits
        self._cycle_s = plans.cycle_s
        self._cycle_number = cycle_number
        self._preparation = Preparation(limits, plans, reserve)
        self._lasts = 0
        # of one element: what is put in and taken out by two threads is neither lost nor taken twice
        self._speeds: deque[float] = deque(maxlen=1)
        self._ways_back: deque[WayBack] = deque(maxlen=1)
        self._trajectories: deque[Prepared] = deque(maxlen=1)

    def take(self) -> tuple[float | None, WayBack | None, Prepared | None]:
        """Return the path speed, the way back that it may need and the trajectory that wait; forget them."""
        # the speed first: it is put in after the way back that it needs
        return _pop(self._speeds), _pop(self._ways_back), _pop(self._trajectories)

    def propose(
        self, proposal: Proposal, running: RunningPlan, heading: int, rest: Array | None
    ) -> Refusal | None:
        """Prepare a proposal for the plan that runs; return why it is refused, if that can be said already.

        ``heading``: 1 along the path, -1 back along it. ``rest (n,)``: where the robot rests, if it does.
        """
        if isinstance(proposal, Stop):
            self._speeds.append(0.0)
            return None
        if isinstance(proposal, PathSpeed):
            return self._path_speed(as_float(proposal.sdot), running, heading)
        if not isinstance(proposal, NewTrajectory | JointVelocity):
            kind = type(proposal).__name__
            raise TypeError(f"{kind} is no proposal: give NewTrajectory, PathSpeed, JointVelocity or Stop")
        try:
            if isinstance(proposal, JointVelocity):
                return self._joint_velocity(proposal, running, rest)
            return self._trajectory(proposal, running)
        except TrajectoryError as error:
            join = proposal.join_s if isinstance(proposal, NewTrajectory) else None
            return Refusal(Objection.JUMP, str(error), as_float(join), error.joint)

    def _path_speed(self, sdot: float, running: RunningPlan, heading: int) -> Refusal | None:
        if not math.isfinite(sdot):
            return Refusal(Objection.NOT_A_NUMBER, f"path speed {sdot} should be a finite number")
        path, since = running.trajectory, running.path_state(0.0).s
        if sdot * heading < 0.0:
            back = self._preparation.prepare(path.backwards())
            if isinstance(back, Refusal):
                return back
            self._ways_back.append(WayBack(back, path))
            path, since = back, -math.inf
        if abs(sdot) > 1.0 and (refusal := self._preparation.faster(path, abs(sdot), since)):
            return refusal
        self._speeds.append(sdot)
        return None

    def _trajectory(self, proposal: NewTrajectory, running: RunningPlan) -> Refusal | None:
        new, join, present = proposal.trajectory, proposal.join_s, running.trajectory
        if not isinstance(new, IntendedTrajectory):
            raise TypeError(f"{type(new).__name__} is no trajectory: give an IntendedTrajectory")
        if not (join is None or isinstance(join, Real)):
            return Refusal(Objection.NOT_A_NUMBER, f"join_s = {join} should be a path parameter, or None")
        if join is None:
            # a copy: whoever proposes it may change his own
            whole = IntendedTrajectory(new.breaks, new.coefficients, new.end)
            return self._look_at(whole, ((present, math.nan),), from_rest=True)
        join, begin = as_float(join), running.path_state(0.0).s
        if not math.isfinite(begin):  # in a stop that leaves the path
            return self._look_at(splice(present, new, join), ((present, join),))
        kept = present.since(begin - BEHIND_S)
        return self._look_at(splice(kept, new, join), ((present, join),), since=begin)

    def _joint_velocity(
        self, proposal: JointVelocity, running: RunningPlan, rest: Array | None
    ) -> Refusal | None:
        began, wanted = self._cycle_number(), self._velocities(proposal)
        if isinstance(wanted, Refusal):
            return wanted
        horizon, limits = as_float(proposal.horizon_s), self._preparation.reserved
        still = np.zeros_like(wanted)
        if rest is not None:
            whole = to_joint_velocity((rest, still, still), wanted, horizon, limits)
            return self._look_at(whole, ((running.trajectory, math.nan),), from_rest=True)
        begin, s_rest = running.path_state(0.0).s, running.s_rest
        if not (math.isfinite(begin) and math.isfinite(s_rest)):
            return Refusal(Objection.NOT_AT_REST, "the robot comes to rest off its path, and must rest first")
        present, bases = self._present(running.trajectory)
        # as many cycles later as the last preparation took, the running stop will end this much later
        join = max([s_rest + (1 + self._lasts) * self._cycle_s, *(join for _, join in bases[:1])])
        kept = present.since(begin).lasting(join)
        q, v, a, _ = kept.sample(join)
        whole = splice(kept, to_joint_velocity((q, v, a), wanted, horizon, limits, join), join)
        refusal = self._look_at(whole, ((present, join), *bases), since=begin)
        self._lasts = max(self._cycle_number() - began, self._lasts - 1)
        return refusal

    def _velocities(self, proposal: JointVelocity) -> Array | Refusal:
        """Return what is wanted ``(n,)``, or why it is no velocity."""
        limits, horizon = self._limits, as_float(proposal.horizon_s)
        try:
            dq = np.array(proposal.dq, dtype=np.float64)
        except (TypeError, ValueError) as error:
            return Refusal(Objection.NOT_A_NUMBER, f"joint velocities: {error}")
        n = len(limits.joints)
        if dq.shape != (n,):
            return Refusal(
                Objection.OTHER_JOINTS, f"joint velocities have shape {dq.shape}, should be ({n},)"
            )
        if not np.isfinite(dq).all():
            i = int(np.argmin(np.isfinite(dq)))
            text = f"velocity of joint {limits.joints[i]} is {dq[i]}"
            return Refusal(Objection.NOT_A_NUMBER, text, joint=i)
        if not 0.0 <= horizon <= LONGEST_HORIZON_S:
            text = f"horizon_s = {proposal.horizon_s} should be 0 to {LONGEST_HORIZON_S:g}"
            return Refusal(Objection.NOT_A_NUMBER, text)
        share = np.abs(dq) / limits.velocity
        i = int(np.argmax(share))
        if share[i] <= 1.0:
            return dq
        text = f"joint {limits.joints[i]} would move at {dq[i]:.4g}, limit {limits.velocity[i]:.4g}"
        return Refusal(Objection.BEYOND_LIMITS, text, joint=i, path_speed=float(1.0 / share[i]))

    def _present(
        self, running: IntendedTrajectory
    ) -> tuple[IntendedTrajectory, tuple[tuple[IntendedTrajectory, float], ...]]:
        """Return what to join: the trajectory that waits for the next step, if it will fit, or that runs."""
        for prepared in tuple(self._trajectories):
            fits = not prepared.from_rest and prepared.join_on(running) is not None
            if fits and len(prepared.bases) < _MOST_BASES:
                return prepared.trajectory, prepared.bases
        return running, ()

    def _look_at(
        self,
        whole: IntendedTrajectory,
        bases: tuple[tuple[IntendedTrajectory, float], ...],
        *,
        from_rest: bool = False,
        since: float = -math.inf,
    ) -> Refusal | None:
        prepared = self._preparation.prepare(whole, since)
        if isinstance(prepared, Refusal):
            return prepared
        self._trajectories.append(Prepared(prepared, bases, from_rest))
        return None


def _pop(waiting: deque[Waiting]) -> Waiting | None:
    # only the cycle takes out: what is there stays there until it is taken, or replaced
    return waiting.pop() if waiting else None
