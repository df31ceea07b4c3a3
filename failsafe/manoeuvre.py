"""Failsafe manoeuvres: path-consistent stop, recovery, joint-space stop. The only file that knows ruckig.

Ruckig accepts impossible starts and still answers with a profile: with s̈ above the limit ṡ overshoots,
with a jerk limit that has shrunk ṡ becomes negative. Whatever it returns is therefore integrated anew and
held against the acceptance test of docs/method.md, section 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from itertools import chain
from typing import NamedTuple

import numpy as np
import ruckig
from numpy.typing import NDArray

from failsafe import axis_kernels, limit_kernels, path_kernels, search_kernels, slice_kernels, stop_kernels
from failsafe.scaling import LOOSER, TIGHTER, AccelerationSearch, PathState, limit_rows
from failsafe.trajectory import DEGREE, IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits
from robots.motion import Block

Array = NDArray[np.float64]
PathLimits = tuple[float, float]
"""Path acceleration [1/s] and path jerk [1/s²]."""


class Acceptance(IntEnum):
    """Verdict on one profile of the path speed."""

    ACCEPTED = path_kernels.ACCEPTED
    BAD_LIMIT = path_kernels.BAD_LIMIT
    PATH_ACCELERATION = path_kernels.PATH_ACCELERATION
    NEGATIVE_SPEED = path_kernels.NEGATIVE_SPEED
    SPEED_OVERSHOOT = path_kernels.SPEED_OVERSHOOT
    NOT_AT_TARGET = path_kernels.NOT_AT_TARGET
    BEYOND_PATH = path_kernels.BEYOND_PATH
    NO_PROFILE = 7


ACCEPTANCES = tuple(Acceptance)


class Quantity(IntEnum):
    """What a plan exceeds."""

    POSITION = limit_kernels.POSITION
    VELOCITY = limit_kernels.VELOCITY
    ACCELERATION = limit_kernels.ACCELERATION
    JERK = limit_kernels.JERK
    PATH_END = limit_kernels.PATH_END
    PATH_SPEED = limit_kernels.PATH_SPEED
    NONE = 6


class Excess(NamedTuple):
    """The joint, quantity, value and limit that a manoeuvre failed on; joint -1: the path itself."""

    joint: int = -1
    quantity: Quantity = Quantity.NONE
    value: float = math.nan
    limit: float = math.nan


_REMEMBERED = 128
"""Profiles that are kept; a loop at constant path speed asks for the same few again and again."""


class VelocityProfile:
    """Time-optimal change of the speed of one axis with limited acceleration and jerk, by ruckig."""

    def __init__(self) -> None:
        self._generator = ruckig.Ruckig(1)
        self._trajectory = ruckig.Trajectory(1)
        self._input = ruckig.InputParameter(1)
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.current_position = [0.0]
        self._input.target_acceleration = [0.0]
        self.durations: Array = np.zeros(9)
        self.jerks: Array = np.zeros(9)
        self._remembered: dict[tuple[float, float, float, float, float], tuple[Array, Array]] = {}

    def calculate(self, v: float, a: float, target: float, a_limit: float, j_limit: float) -> bool:
        """Set ``durations, jerks`` (two of the brake, seven of the profile); tell whether there is one.

        The arrays are not to be written: the same question gets the same arrays again.
        """
        asked = (v, a, target, a_limit, j_limit)
        known = self._remembered.get(asked)
        if known is not None:
            self.durations, self.jerks = known
            return True
        if not self._ask(v, a, target, a_limit, j_limit):
            return False
        if len(self._remembered) >= _REMEMBERED:
            self._remembered.clear()
        self._remembered[asked] = self.durations, self.jerks
        return True

    def _ask(self, v: float, a: float, target: float, a_limit: float, j_limit: float) -> bool:
        """Let ruckig calculate the profile."""
        request = self._input
        request.current_velocity = [v]
        request.current_acceleration = [a]
        request.target_velocity = [target]
        request.max_acceleration = [a_limit]
        request.max_jerk = [j_limit]
        try:
            if self._generator.calculate(request, self._trajectory) < 0:
                return False
        except ruckig.RuckigError:
            return False
        profile = self._trajectory.profiles[0][0]
        brake = profile.brake
        self.durations = np.array([*brake.t, *profile.t])
        self.jerks = np.array([*brake.j, *profile.j])
        return True


class SteadyPlan(NamedTuple):
    """A plan that keeps its path speed for ``duration_s`` [s], then stops with the path limits ``stop``.

    ``begin``: of the plan on the clock of its slices, which are to be ``slice_s`` long [s].
    """

    begin: float
    duration_s: float
    stop: PathLimits
    slice_s: float


class SteadyStops:
    """Settings and scratch of the compiled search for stops that begin with s̈ = 0.

    Parameters
    ----------
    steps:
        Candidates per stop, besides the conservative budget.
    proof:
        Step of the proof [s], and whether positions are held against their limits.
    """

    def __init__(self, steps: int, proof: tuple[float, bool]) -> None:
        self.settings = (proof, (np.array(TIGHTER), np.array(LOOSER), steps))
        self.ahead: Block = np.zeros(1, dtype=search_kernels.AHEAD)
        self.search: Block = np.zeros(1, dtype=stop_kernels.SEARCH)


class PathManoeuvre:
    """Changes the path speed on the path: to 0 is the path-consistent stop, to 1 the recovery."""

    def __init__(self, limits: JointLimits, *, steps: int, step_s: float, positions: bool) -> None:
        self.limits = limit_rows(limits)
        self.path: Block = np.zeros(1, dtype=path_kernels.PATH)
        self.a_s = math.nan
        self.j_s = math.nan
        self.excess = Excess()
        self.acceptance = Acceptance.NO_PROFILE
        self.candidates = 0
        self._work: Block = np.zeros(1, dtype=limit_kernels.WORK)
        self._profile = VelocityProfile()
        self._search = AccelerationSearch(self.limits, steps)
        self._steady = SteadyStops(steps, (step_s, positions))
        self._step = step_s
        self._positions = positions

    def proven(self, trajectory: IntendedTrajectory, path: Block, first: int) -> bool:
        """Tell whether the segments of ``path`` from ``first`` on keep all limits; else set ``excess``."""
        end = int(path["n"][0])
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        if limit_kernels.proven(path, first, end, b, c, self.limits, self._step, self._positions, self._work):
            return True
        self._keep_excess()
        return False

    def steady(self, trajectory: IntendedTrajectory, start: PathState, duration: float, out: Array) -> bool:
        """Begin a plan with ``duration`` [s] at constant ṡ; tell whether it is proven.

        Writes s, ṡ, s̈ of its end into ``out (3,)``.
        """
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        self.acceptance = Acceptance.ACCEPTED
        if limit_kernels.prove_steady(
            self.path,
            start.s,
            start.sdot,
            duration,
            b,
            c,
            self.limits,
            self._step,
            self._positions,
            self._work,
            out,
        ):
            return True
        self._keep_excess()
        return False

    def steady_then(
        self, trajectory: IntendedTrajectory, start: PathState, plan: SteadyPlan, slices: Block, out: Array
    ) -> bool:
        """Put a piece at constant ṡ and one candidate of a stop after it into path and ``slices``.

        What :meth:`steady`, :meth:`candidate` and the slicing do one after another, in one compiled call.
        False, with ``slices`` empty, if any of it fails: nothing is said about which. ``out (3,)``:
        duration of the plan [s], s at its end.
        """
        a_s, j_s = plan.stop
        profile = self._profile
        self.acceptance = Acceptance.NO_PROFILE
        if not profile.calculate(start.sdot, 0.0, 0.0, a_s, j_s):
            return False
        ready = slice_kernels.steady_plan(
            self.path,
            (start.s, start.sdot, plan.duration_s, trajectory.s_max),
            (a_s, j_s, plan.begin, plan.slice_s),
            (profile.durations, profile.jerks),
            trajectory.kernel_breaks,
            trajectory.kernel_coefficients,
            self.limits,
            self._step,
            self._positions,
            slices,
            self._work,
            out,
        )
        if ready:
            self.a_s, self.j_s = plan.stop
            self.acceptance = Acceptance.ACCEPTED
        return bool(ready)

    def _keep_excess(self) -> None:
        rec = self._work[0]
        self.excess = Excess(
            int(rec["joint"]), Quantity(int(rec["quantity"])), float(rec["value"]), float(rec["limit"])
        )

    def search(
        self,
        trajectory: IntendedTrajectory,
        first: int,
        start: PathState,
        target: float,
        prefer: Sequence[PathLimits] = (),
    ) -> bool:
        """Put the first proven manoeuvre from ``start`` into ``path`` behind its ``first`` segments.

        ``prefer``: path acceleration and jerk [1/s, 1/s²] to try before anything is predicted. Returns False,
        with ``excess`` and ``acceptance`` of the last candidate, if none is proven.
        """
        self.a_s = self.j_s = math.nan
        self.candidates = 0
        self.excess = Excess()
        if target == 0.0 and start.sddot == 0.0 and not prefer:
            return self._stop_from_steady(trajectory, first, start)
        for a_s, j_s in chain(prefer, self._search.candidates(trajectory, start, target)):
            self.candidates += 1
            if self.candidate(trajectory, first, start, target, a_s, j_s):
                self.a_s, self.j_s = a_s, j_s
                return True
            if self.acceptance is Acceptance.BEYOND_PATH:
                return False
        return False

    def _stop_from_steady(self, trajectory: IntendedTrajectory, first: int, start: PathState) -> bool:
        """As :meth:`search` for a stop that begins with s̈ = 0: everything in one compiled call."""
        steady = self._steady
        found = stop_kernels.search_stop(
            self.path,
            first,
            (float(start.s), float(start.sdot), float(trajectory.s_max)),
            trajectory.kernel_breaks,
            trajectory.kernel_coefficients,
            self.limits,
            *steady.settings,
            steady.ahead,
            self._work,
            steady.search,
        )
        record = steady.search[0]
        self.a_s, self.j_s = float(record["a"]), float(record["j"])
        self.candidates = int(record["candidates"])
        if record["witness"] and found != path_kernels.ACCEPTED:
            self._keep_excess()
        self.acceptance = Acceptance.ACCEPTED if found == limit_kernels.NOT_PROVEN else ACCEPTANCES[found]
        return bool(found == path_kernels.ACCEPTED)

    def candidate(
        self,
        trajectory: IntendedTrajectory,
        first: int,
        start: PathState,
        target: float,
        a_s: float,
        j_s: float,
    ) -> bool:
        """Tell whether the manoeuvre with one pair of limits is accepted and proven."""
        profile = self._profile
        self.acceptance = Acceptance.NO_PROFILE
        if not profile.calculate(start.sdot, start.sddot, target, a_s, j_s):
            return False
        found = limit_kernels.append_and_prove(
            self.path,
            first,
            (float(start.s), float(start.sdot), float(start.sddot)),
            (target, a_s, j_s, float(trajectory.s_max)),
            (profile.durations, profile.jerks),
            trajectory.kernel_breaks,
            trajectory.kernel_coefficients,
            self.limits,
            self._step,
            self._positions,
            self._work,
        )
        if found == limit_kernels.NOT_PROVEN:
            self.acceptance = Acceptance.ACCEPTED
            self._keep_excess()
            return False
        self.acceptance = ACCEPTANCES[found]
        return found == path_kernels.ACCEPTED


class JointSpaceStop:
    """Stops every joint on its own, as fast as its limits allow; leaves the path."""

    def __init__(self, limits: JointLimits, *, positions: bool) -> None:
        self.limits = limit_rows(limits)
        self.axes: Block = np.zeros(1, dtype=axis_kernels.AXES)
        self.excess = Excess()
        self._n = self.limits.shape[1]
        self._positions = positions
        self._work: Block = np.zeros(1, dtype=limit_kernels.WORK)
        self._start = np.zeros(3)
        self._profile = VelocityProfile()

    def plan(self, q: Array, dq: Array, ddq: Array) -> bool:
        """Fill ``axes`` with the stop from q, dq, ddq ``(n,)``; False, with ``excess``, if none."""
        self.excess = Excess()
        self.axes["n"] = self._n
        for i in range(self._n):
            a_limit, j_limit = self.limits[3, i], self.limits[4, i]
            self._start[:] = q[i], dq[i], ddq[i]
            if not self._profile.calculate(float(dq[i]), float(ddq[i]), 0.0, a_limit, j_limit):
                self.excess = Excess(i, Quantity.VELOCITY, float(dq[i]), float(self.limits[2, i]))
                return False
            if not axis_kernels.append_axis(
                self.axes,
                i,
                self._start,
                self._profile.durations,
                self._profile.jerks,
                self.limits,
                self._positions,
                self._work,
            ):
                rec = self._work[0]
                self.excess = Excess(
                    i, Quantity(int(rec["quantity"])), float(rec["value"]), float(rec["limit"])
                )
                return False
        return True

    def duration(self) -> float:
        """Return the time until the last joint rests [s]."""
        rec = self.axes[0]
        n = self._n
        return float(rec["t"][rec["segments"][:n], np.arange(n)].max())


def come_to_rest(trajectory: IntendedTrajectory, limits: JointLimits) -> IntendedTrajectory:
    """Return the trajectory with a joint-space stop within ``limits`` appended, so that it ends at rest.

    Raises
    ------
    TrajectoryError
        If the last state is beyond the limits, or the stop would leave the position range.
    """
    if trajectory.end == "rest":
        return trajectory
    q, dq, ddq, _ = trajectory.sample(trajectory.s_end)
    stop = JointSpaceStop(limits, positions=True)
    if not stop.plan(q, dq, ddq):
        excess = stop.excess
        raise TrajectoryError(
            f"trajectory cannot come to rest after its end: {excess.quantity.name.lower()} of joint"
            f" {limits.joints[excess.joint]} would be {excess.value:.4g}, limit {excess.limit:.4g}",
            excess.joint,
        )
    rec = stop.axes[0]
    n = trajectory.n_joints
    switches = [rec["t"][: rec["segments"][i] + 1, i] for i in range(n)]
    times = np.unique(np.concatenate(switches))
    # what is left out lets q'' jump by jerk times its length; nearer than this, breaks would coincide
    shortest = max(1e-12, 16.0 * np.finfo(np.float64).eps * abs(trajectory.s_end))
    times = times[np.append(True, np.diff(times) > shortest)]
    if times.shape[0] < 2:
        return IntendedTrajectory(trajectory.breaks, trajectory.coefficients, "rest")
    added = np.zeros((times.shape[0] - 1, DEGREE + 1, n))
    for m, begin in enumerate(times[:-1]):
        for i in range(n):
            k = int(np.searchsorted(switches[i], 0.5 * (begin + times[m + 1]), side="right")) - 1
            added[m, :3, i] = axis_kernels.axis_state(stop.axes, i, begin)
            added[m, 2, i] *= 0.5
            added[m, 3, i] = rec["j"][k, i] / 6.0 if k < rec["segments"][i] else 0.0
    breaks = np.append(trajectory.breaks, trajectory.s_end + times[1:])
    return IntendedTrajectory(breaks, np.concatenate([trajectory.coefficients, added]), "rest")
