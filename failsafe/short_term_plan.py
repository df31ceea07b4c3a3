"""The short-term plan: a piece of the intended trajectory, then the failsafe manoeuvre to standstill."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe import axis_kernels, limit_kernels, path_kernels, slice_kernels, trajectory_kernels
from failsafe.braking import Braking
from failsafe.manoeuvre import (
    Acceptance,
    Excess,
    JointSpaceStop,
    PathLimits,
    PathManoeuvre,
    Quantity,
    SteadyPlan,
)
from failsafe.plan import PlanError, PlanOutcome, PlanResult, PlanSettings, StopKind
from failsafe.scaling import PathState
from failsafe.trajectory import IntendedTrajectory
from robots.limits import JointLimits
from robots.motion import MAX_JOINTS, MAX_SLICES, Block, new_slices

Array = NDArray[np.float64]

LATEST_CLOCK_S = 1e8
"""Instants beyond this are refused: a double would resolve the length of a slice coarser than 2e-8 s."""


_QUICKER = 1.08
_GENTLER = (0.4, 0.15, 0.05, 0.015, 0.004, 0.001)
"""Shares of the quickest change of ṡ that are tried where no stop follows it. While moving there is just the
change of the cycle before: with less path acceleration than there is already none is accepted."""
_RELEASES = (16.0, 8.0, 4.0, 2.0, 1.5)
"""Where no change of ṡ to the wanted one is proven in the middle of a stop, the deceleration is brought to 0
with so many times the least path jerk that does it before ṡ = 0; the gentlest comes last."""
_ROUNDED = 1.0 + 1e-9
"""So that the s̈ that there is does not exceed the limit that is made of it."""
_LONGEST_PAUSE = 32
"""A stop quicker than the last one is tried first, after a pause in cycles that doubles while it does not
succeed, up to this."""


class PlanMemory(NamedTuple):
    """What :meth:`ShortTermPlanner.follow` tries first; a planner with the same memory makes the same plan.

    Path limits of the last change of ṡ, whether that was slower than it might be, path limits of the last
    stop, after how many cycles a quicker one is tried, and how many of them are left.
    """

    change: PathLimits | None = None
    gentle: bool = False
    stop: PathLimits | None = None
    pause: int = 1
    left: int = 1


class _Change(NamedTuple):
    """A change of ṡ that is wanted: from ``start`` at ``t`` [s] on, and the stops to try first after it."""

    trajectory: IntendedTrajectory
    t: float
    start: PathState
    target: float
    preferred: Sequence[PathLimits]


class ShortTermPlanner:
    """Plans piece and stop of one cycle; ``slices``, allocated once, holds them if the outcome is READY."""

    def __init__(self, limits: JointLimits, settings: PlanSettings) -> None:
        n = len(limits.joints)
        if n > MAX_JOINTS:
            raise PlanError(f"{n} joints are more than {MAX_JOINTS}")
        for name, error in (("q_error", settings.q_error), ("dq_error", settings.dq_error)):
            if np.shape(error) != (n,):
                raise PlanError(f"{name} has shape {np.shape(error)}, should be ({n},): one value per joint")
        self.settings = settings
        self.slices: Block = new_slices()
        record = self.slices[0]
        record["n_joints"] = n
        record["delay"] = settings.delay
        record["q_error"][:n] = settings.q_error
        record["dq_error"][:n] = settings.dq_error
        self._n = n
        self._limits = limits
        self._manoeuvre = PathManoeuvre(
            limits,
            steps=settings.search_steps,
            step_s=settings.slice_s,
            positions=settings.check_position_limits,
        )
        self._joint_space = JointSpaceStop(limits, positions=settings.check_position_limits)
        self.path_bytes: NDArray[np.uint8] = self.path.view(np.uint8)
        """``path`` for whoever copies it: field by field takes ten times as long."""
        self._work: Block = np.zeros(1, dtype=limit_kernels.WORK)
        self._end = np.zeros(3)
        self._change: PathLimits | None = None
        self._gentle = False
        self._last_stop: PathLimits | None = None
        self._pause = 1
        self._left = 1

    @property
    def path(self) -> Block:
        """Motion along the path of the plan in ``slices``; of a joint-space stop only the piece."""
        return self._manoeuvre.path

    @property
    def axes(self) -> Block:
        """Joint-space stop of the plan in ``slices``, if it has one."""
        return self._joint_space.axes

    @property
    def memory(self) -> PlanMemory:
        """What :meth:`follow` tries first; setting it makes the planner go on as another one would."""
        return PlanMemory(self._change, self._gentle, self._last_stop, self._pause, self._left)

    @memory.setter
    def memory(self, memory: PlanMemory) -> None:
        self._change, self._gentle, self._last_stop, self._pause, self._left = memory

    def plan(
        self, trajectory: IntendedTrajectory, t: float, s: float, sdot: float = 1.0, sddot: float = 0.0
    ) -> PlanResult:
        """Plan the piece [t, t + cycle] from the path state (s, ṡ, s̈), s̈ constant, and the stop after it.

        ``t`` [s] on the cell's clock. Fills ``slices`` if the outcome is READY and empties it otherwise.
        """
        self.slices["n"] = 0
        cycle = self.settings.cycle_s
        sdot_1, s_1 = sdot + sddot * cycle, s + cycle * (sdot + 0.5 * sddot * cycle)
        if not (
            abs(t) <= LATEST_CLOCK_S
            and math.isfinite(s_1)
            and sdot >= 0.0
            and sdot_1 >= 0.0
            and math.isfinite(sddot)
        ):
            return PlanResult(
                PlanOutcome.INVALID_STATE, quantity=Quantity.PATH_SPEED, value=min(sdot, sdot_1), limit=0.0
            )
        if trajectory.n_joints != self._n:
            return PlanResult(PlanOutcome.INVALID_STATE, value=trajectory.n_joints, limit=self._n)
        if not trajectory.s_begin <= s <= s_1 <= trajectory.s_max:
            return _beyond_end(s_1, trajectory)
        if self.settings.braking is not None:
            return self._as_measured(trajectory, t, PathState(s, sdot, sddot), self.settings.braking)
        manoeuvre = self._manoeuvre
        path_kernels.begin_path(manoeuvre.path, s, sdot, sddot, cycle)
        if not manoeuvre.proven(trajectory, manoeuvre.path, 0):
            return PlanResult(
                PlanOutcome.STATE_BEYOND_LIMITS, StopKind.NONE, t + cycle, *_FIVE_NAN, *manoeuvre.excess
            )
        return self._stop(trajectory, t, 1, PathState(s_1, sdot_1, sddot), ())

    def follow(self, trajectory: IntendedTrajectory, t: float, start: PathState, target: float) -> PlanResult:
        """Plan the first cycle of a change of ṡ from ``start`` to ``target``, and the stop after it.

        Where ṡ = ``target`` is reached within the cycle, it is kept. As :meth:`plan` otherwise, but what
        succeeded in the cycle before is tried first: made for a loop, where the state hardly changes from
        one cycle to the next.
        """
        self.slices["n"] = 0
        if (
            not (abs(t) <= LATEST_CLOCK_S and start.sdot >= 0.0 and 0.0 <= target < math.inf)
            or trajectory.n_joints != self._n
            or self.settings.braking is not None
        ):
            return PlanResult(PlanOutcome.INVALID_STATE)
        if not trajectory.s_begin <= start.s <= trajectory.s_max:
            return _beyond_end(start.s, trajectory)
        manoeuvre, end = self._manoeuvre, self._end
        preferred = self._preferred_stops()
        if start.sdot == target and start.sddot == 0.0:
            for stop in preferred:
                steady = SteadyPlan(t, self.settings.cycle_s, stop, self.settings.slice_s)
                if manoeuvre.steady_then(trajectory, start, steady, self.slices, end):
                    return self._remember(self._ready(t))
        wanted = _Change(trajectory, t, start, target, preferred)
        plan = self._changed(wanted)
        if plan.outcome in _PERHAPS_GENTLER or plan.stop is StopKind.JOINT_SPACE:
            gentler = self._gently(wanted) or self._released(wanted)
            if gentler is not None:
                return self._remember(gentler)
            if plan.stop is StopKind.JOINT_SPACE:  # what was tried since has overwritten it
                plan = self._changed(wanted)
        return self._remember(plan)

    def _changed(self, wanted: _Change) -> PlanResult:
        """Plan the quickest change of ṡ that is proven, and the stop after one cycle of it."""
        trajectory, t, start, target, preferred = wanted
        manoeuvre = self._manoeuvre
        if not self._change_speed(trajectory, start, target):
            if manoeuvre.acceptance is Acceptance.BEYOND_PATH:
                return _beyond_end(math.inf, trajectory)
            t_stop = t + self.settings.cycle_s
            return PlanResult(
                PlanOutcome.STATE_BEYOND_LIMITS, StopKind.NONE, t_stop, *_FIVE_NAN, *manoeuvre.excess
            )
        first = int(manoeuvre.path["n"][0])
        return self._stop(trajectory, t, first, PathState(*self._end.tolist()), preferred)

    def _gently(self, wanted: _Change) -> PlanResult | None:
        """Plan a slower change of ṡ: the quickest may end its cycle with an s̈ that nothing stops in time.

        Or its first cycle alone, enclosed in other stretches than the whole, is not proven: at the very limit
        that depends on where they begin. Without it, a robot that rests just before a sharp place of its path
        would never set out again.
        """
        start = wanted.start
        if self._change is None or (start.sdot == wanted.target and start.sddot == 0.0):
            return None
        a, j = self._change
        for share in _GENTLER if start.sdot == 0.0 else (1.0 / _QUICKER,):
            change = (share * a, share * j)
            if self._begins_with(wanted, change):
                self._change, self._gentle = change, True
                return self._path_consistent(wanted.trajectory, wanted.t)
        return None

    def _released(self, wanted: _Change) -> PlanResult | None:
        """Plan to decelerate no further, where from the middle of a stop no change to ``target`` is proven.

        A change to a larger ṡ has a path acceleration that the deceleration of the stop forces upon it, and
        may keep no limits with that; the speed at which the deceleration is just gone asks for none.
        """
        v, a = wanted.start.sdot, wanted.start.sddot
        if not (v > 0.0 > a):
            return None
        for times in _RELEASES:
            reached, jerk = v * (1.0 - 1.0 / times), times * a * a / (2.0 * v)
            towards = wanted._replace(target=reached)
            if reached <= wanted.target and self._begins_with(towards, (-a * _ROUNDED, jerk)):
                return self._path_consistent(wanted.trajectory, wanted.t)
        return None

    def _begins_with(self, wanted: _Change, limits: PathLimits) -> bool:
        """Put the first cycle of a change of ṡ, and a stop, into the path; tell whether all is proven."""
        trajectory, _, start, target, preferred = wanted
        manoeuvre = self._manoeuvre
        if not manoeuvre.candidate(trajectory, 0, start, target, *limits):
            return False
        if not self._cut_to_cycle(trajectory):
            return False
        first = int(manoeuvre.path["n"][0])
        return manoeuvre.search(trajectory, first, PathState(*self._end.tolist()), 0.0, preferred)

    def _remember(self, plan: PlanResult) -> PlanResult:
        """Keep what to try first in the next cycle."""
        found = (plan.a_s, plan.j_s) if plan.stop is StopKind.PATH_CONSISTENT else None
        if found is not None and self._last_stop is not None and found[0] > self._last_stop[0]:
            self._pause = self._left = 1
        self._last_stop = found
        return plan

    def _preferred_stops(self) -> tuple[PathLimits, ...]:
        """What to try before a search: the last stop, now and then a quicker one first; else a slower one."""
        if self._last_stop is None:
            return ()
        a, j = self._last_stop
        self._left -= 1
        if self._left > 0:
            return (a, j), (a / _QUICKER, j / _QUICKER)
        self._pause = self._left = min(2 * self._pause, _LONGEST_PAUSE)
        return (_QUICKER * a, _QUICKER * j), (a, j), (a / _QUICKER, j / _QUICKER)

    def _change_speed(self, trajectory: IntendedTrajectory, start: PathState, target: float) -> bool:
        """Put the first cycle of a change of ṡ into the path; tell whether it is proven."""
        manoeuvre = self._manoeuvre
        if start.sdot == target and start.sddot == 0.0:
            ok = manoeuvre.steady(trajectory, start, self.settings.cycle_s, self._end)
            if not self._end[0] <= trajectory.s_max:
                manoeuvre.acceptance = Acceptance.BEYOND_PATH
                return False
            return ok
        if not manoeuvre.search(trajectory, 0, start, target, self._preferred_changes()):
            self._change = None
            return False
        found = (manoeuvre.a_s, manoeuvre.j_s)
        self._gentle = self._gentle and self._change is not None and found[0] <= _QUICKER * self._change[0]
        self._change = found
        return self._cut_to_cycle(trajectory)

    def _preferred_changes(self) -> tuple[PathLimits, ...]:
        """What to try before a search: the last change of ṡ, quicker than it where that was a gentle one."""
        if self._change is None:
            return ()
        a, j = self._change
        return ((_QUICKER * a, _QUICKER * j), (a, j)) if self._gentle else ((a, j),)

    def _cut_to_cycle(self, trajectory: IntendedTrajectory) -> bool:
        """Keep one cycle of the motion in the path, and its end in ``_end``; tell whether that is proven."""
        manoeuvre = self._manoeuvre
        path_kernels.cut_path(manoeuvre.path, self.settings.cycle_s, self._end)
        if not self._end[0] <= trajectory.s_max:
            manoeuvre.acceptance = Acceptance.BEYOND_PATH
            return False
        return manoeuvre.proven(trajectory, manoeuvre.path, 0)

    def _stop(
        self,
        trajectory: IntendedTrajectory,
        t: float,
        first: int,
        start: PathState,
        prefer: Sequence[PathLimits],
    ) -> PlanResult:
        """Append the stop that begins with ``start`` behind the ``first`` segments, and write the slices."""
        manoeuvre = self._manoeuvre
        if manoeuvre.search(trajectory, first, start, 0.0, prefer):
            return self._path_consistent(trajectory, t)
        if manoeuvre.acceptance is Acceptance.BEYOND_PATH:
            return _beyond_end(math.inf, trajectory)
        if self.settings.allow_joint_space:
            return self._leave_path(trajectory, t, first, start)
        begin = t + self.settings.cycle_s
        return PlanResult(PlanOutcome.NO_STOP, StopKind.NONE, begin, *_FIVE_NAN, *manoeuvre.excess)

    def _path_consistent(self, trajectory: IntendedTrajectory, t: float) -> PlanResult:
        manoeuvre, settings, end = self._manoeuvre, self.settings, self._end
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        if not slice_kernels.slice_path(
            manoeuvre.path, b, c, manoeuvre.limits, t, settings.slice_s, self.slices, self._work, end
        ):
            return PlanResult(PlanOutcome.NO_STOP)
        return self._ready(t)

    def _ready(self, t: float) -> PlanResult:
        """Describe the path-consistent plan in ``slices``, whose end was written to ``_end``."""
        duration, s_rest = self._end.tolist()[:2]
        cycle = self.settings.cycle_s
        return self._with_silence(
            PlanResult(
                PlanOutcome.READY,
                StopKind.PATH_CONSISTENT,
                t + cycle,
                t + duration,
                s_rest,
                duration - cycle,
                self._manoeuvre.a_s,
                self._manoeuvre.j_s,
            )
        )

    def _with_silence(self, plan: PlanResult) -> PlanResult:
        """Let the slices of a plan stand for the robot's reaction to silence, if it has one."""
        silence = self.settings.silence
        if silence is None:
            return plan
        if not silence.widen(self.slices, plan.t_stop_begin):
            return PlanResult(PlanOutcome.NO_STOP)
        record = self.slices[0]
        return plan._replace(t_rest=float(record["t"][record["n"]]))

    def _as_measured(
        self, trajectory: IntendedTrajectory, t: float, start: PathState, braking: Braking
    ) -> PlanResult:
        """Plan the piece, and the robot's own stop, told at its end, as it was measured."""
        cycle, told = self.settings.cycle_s, t + self.settings.cycle_s
        whole = cycle + braking.delay_s
        s_end = start.s + whole * (start.sdot + 0.5 * start.sddot * whole)
        if not start.sdot + start.sddot * whole >= 0.0:
            return PlanResult(PlanOutcome.INVALID_STATE, quantity=Quantity.PATH_SPEED)
        if not s_end <= trajectory.s_max:
            return _beyond_end(s_end, trajectory)
        if not self._write_intended(trajectory, t, start, whole, MAX_SLICES):
            excess: Excess = self._manoeuvre.excess
            return PlanResult(PlanOutcome.STATE_BEYOND_LIMITS, StopKind.NONE, told, *_FIVE_NAN, *excess)
        up, down = self._speeds_from(told)
        fastest = np.maximum(up, down)
        joint = int(np.argmax(fastest / braking.fastest))
        if not fastest[joint] <= braking.fastest[joint]:
            seen = float(braking.fastest[joint])
            beyond = Excess(joint, Quantity.VELOCITY, float(fastest[joint]), seen)
            return self._no_stop(told, beyond)
        if not self._write_intended(trajectory, t, start, cycle, MAX_SLICES - _BRAKING_SLICES):
            return self._no_stop(told, self._manoeuvre.excess)
        record = self.slices[0]
        q = record["q"][int(record["n"]), : self._n].copy()
        if self.settings.check_position_limits:
            ends = np.stack([q - braking.way(down), q + braking.way(up)])
            beyond_limits = self._beyond_positions(ends)
            if beyond_limits is not None:
                return self._no_stop(told, beyond_limits)
        lasts = braking.append(self.slices, up, down, self.settings.slice_s)
        if not lasts >= 0.0:
            return self._no_stop(told, self._manoeuvre.excess)
        return PlanResult(
            PlanOutcome.READY, StopKind.MEASURED, told, float(record["t"][record["n"]]), math.nan, lasts
        )

    def _no_stop(self, begin: float, excess: Excess) -> PlanResult:
        self.slices["n"] = 0
        return PlanResult(PlanOutcome.NO_STOP, StopKind.NONE, begin, *_FIVE_NAN, *excess)

    def _write_intended(
        self, trajectory: IntendedTrajectory, t: float, start: PathState, duration: float, most: int
    ) -> bool:
        """Write slices of the intended motion alone; tell whether it is proven to keep the limits."""
        manoeuvre, b, c = self._manoeuvre, trajectory.kernel_breaks, trajectory.kernel_coefficients
        path = manoeuvre.path
        path_kernels.begin_path(path, start.s, start.sdot, start.sddot, duration)
        self.slices["n"] = 0
        if not manoeuvre.proven(trajectory, path, 0):
            return False
        length = slice_kernels.slice_length(path["t"][0], 1, most, self.settings.slice_s)
        slice_kernels.write_path_slices(path, b, c, manoeuvre.limits, t, length, self.slices, self._work)
        return bool(self.slices["n"][0] > 0)

    def _speeds_from(self, told: float) -> tuple[Array, Array]:
        """Largest speeds (n,) forwards and backwards on the slices that do not end before ``told`` [s]."""
        record, n = self.slices[0], self._n
        rows = int(record["n"])
        t, dq = record["t"][: rows + 1], record["dq"][: rows + 1, :n]
        change = 0.5 * np.diff(t)[:, None] * record["ddq_max"][:rows, :n]
        late = t[1:] >= told - 1e-9
        high = (np.maximum(dq[:-1], dq[1:]) + change)[late].max(axis=0)
        low = (np.minimum(dq[:-1], dq[1:]) - change)[late].min(axis=0)
        error = self.settings.dq_error
        return np.maximum(high, 0.0) + error, np.maximum(-low, 0.0) + error

    def _beyond_positions(self, ends: Array) -> Excess | None:
        """Which joint may leave its position limits, by its lowest and highest position ``ends (2, n)``."""
        lower, upper = self._limits.position_lower, self._limits.position_upper
        for joint in np.flatnonzero(~((ends[0] >= lower) & (ends[1] <= upper))):
            side = 0 if not ends[0, joint] >= lower[joint] else 1
            limit = (lower, upper)[side][joint]
            return Excess(int(joint), Quantity.POSITION, float(ends[side, joint]), float(limit))
        return None

    def _leave_path(
        self, trajectory: IntendedTrajectory, t: float, first: int, start: PathState
    ) -> PlanResult:
        begin = t + self.settings.cycle_s
        state = np.zeros((4, MAX_JOINTS))
        derivatives = np.zeros((4, MAX_JOINTS))
        n = self._n
        trajectory_kernels.evaluate(
            trajectory.kernel_breaks, trajectory.kernel_coefficients, start.s, derivatives
        )
        limit_kernels.chain_rule(derivatives, start.sdot, start.sddot, 0.0, n, state)
        stop = self._joint_space
        if not stop.plan(state[0, :n], state[1, :n], state[2, :n]):
            excess: Excess = stop.excess
            return PlanResult(PlanOutcome.NO_STOP, StopKind.NONE, begin, *_FIVE_NAN, *excess)
        path = self._manoeuvre.path
        path["n"], path["anchored"] = first, -1
        path["s_end"], path["v_end"] = start.s, start.sdot
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        limits = self._manoeuvre.limits
        duration = stop.duration()
        times = np.append(path["t"][0, : first + 1], self.settings.cycle_s + duration)
        length = slice_kernels.slice_length(times, first + 1, MAX_SLICES, self.settings.slice_s)
        slice_kernels.write_path_slices(path, b, c, limits, t, length, self.slices, self._work)
        if self.slices["n"][0] == 0:
            return PlanResult(PlanOutcome.NO_STOP)
        axis_kernels.write_axes_slices(stop.axes, n, begin, length, self.slices)
        return self._with_silence(
            PlanResult(PlanOutcome.READY, StopKind.JOINT_SPACE, begin, begin + duration, math.nan, duration)
        )


_BRAKING_SLICES = 32
"""Slices that are kept for a stop as it was measured."""
_FIVE_NAN = (math.nan,) * 5
_PERHAPS_GENTLER = (PlanOutcome.NO_STOP, PlanOutcome.STATE_BEYOND_LIMITS)


def _beyond_end(s: float, trajectory: IntendedTrajectory) -> PlanResult:
    return PlanResult(PlanOutcome.BEYOND_END, quantity=Quantity.PATH_END, value=s, limit=trajectory.s_max)
