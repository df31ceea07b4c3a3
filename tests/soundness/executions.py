"""How an arm may execute a plan: own integration of the stop, with delays and tracking errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from failsafe.plan import PlanResult, StopKind
from failsafe.silence import Silence
from failsafe.trajectory import IntendedTrajectory
from tests.oracles.situation import Motion
from tests.oracles.stop_profile import fastest_stop
from tests.soundness.cells import STEP_S, Cell

Array = NDArray[np.float64]

SILENCES = 6
"""How often the arm stops by itself, in a cell where it does that."""


def command(cell: Cell, plan: PlanResult) -> tuple[Array, Array]:
    """Instants (T,) [s] and commanded positions (T, n) from the plan's begin to its rest; own integration."""
    s, sdot, sddot = cell.state
    cycle = cell.settings.cycle_s
    s_1, sdot_1 = s + sdot * cycle + 0.5 * sddot * cycle**2, sdot + sddot * cycle
    path = cell.path
    if plan.stop is StopKind.PATH_CONSISTENT:
        stop = fastest_stop(s_1, sdot_1, sddot, plan.a_s, plan.j_s)
        duration = stop.duration
    else:
        path = _commanded(cell.trajectory)
        q, dq, ddq = (path(np.array([s_1]), d)[0] for d in range(3))
        dq, ddq = dq * sdot_1, ddq * sdot_1**2 + dq * sddot
        limits = cell.robot.limits
        axes = [
            fastest_stop(*state) for state in zip(q, dq, ddq, limits.acceleration, limits.jerk, strict=True)
        ]
        duration = max(axis.duration for axis in axes)
    rests = plan.t_stop_begin + plan.stop_time_s
    if abs(cell.t + cycle + duration - rests) > 1e-6:
        raise AssertionError(f"the plan rests at {rests}, own integration at {cell.t + cycle + duration}")
    end = cycle + duration
    time = np.linspace(0.0, end, int(end / STEP_S) + 2)
    before, after = time[time <= cycle], time[time > cycle] - cycle
    piece = path(s + sdot * before + 0.5 * sddot * before**2)
    if plan.stop is StopKind.PATH_CONSISTENT:
        rest = path(stop.sample(after)[0])
    else:
        rest = np.stack([axis.sample(after)[0] for axis in axes], axis=1)
    return cell.t + time, np.concatenate([piece, rest])


def _commanded(trajectory: IntendedTrajectory) -> PPoly:
    """The trajectory that the planner was given, evaluated by scipy."""
    return PPoly(np.moveaxis(trajectory.coefficients, 1, 0)[::-1], trajectory.breaks)


def executions(
    cell: Cell, plan: PlanResult, rng: np.random.Generator, number: int, drifting: float = 0.3
) -> list[Motion]:
    """Ways in which the arm may execute the plan: the command itself, then delays and errors at random.

    The first has the longest delay and no error. Joint errors are at their bounds (both signs at random) or
    within them, and swing no faster than their velocity may; delays are at their ends, between, or, in the
    share ``drifting``, change: joints may be faster then than their velocity error allows.
    """
    time, q = command(cell, plan)
    delay = cell.settings.delay
    error = cell.error if plan.stop is StopKind.PATH_CONSISTENT else cell.settings.q_error
    joints = {joint.name: (joint.lower, joint.upper) for joint in cell.arm.free}
    motions = [Motion(time + delay[1], q, {name: high for name, (_, high) in joints.items()})]
    for _ in range(number):
        lag = delay[0] + (delay[1] - delay[0]) * rng.choice([0.0, 1.0, rng.random()], p=[0.2, 0.5, 0.3])
        drift = (delay[1] - lag) * np.sin(rng.uniform(0.0, 20.0) * (time - time[0])) ** 2
        sign = rng.choice([-1.0, 1.0], len(error)) * (1.0 if rng.random() < 0.7 else rng.random(len(error)))
        quickest = cell.dq_error / np.maximum(error, 1e-9)
        swing = np.cos(rng.uniform(0.0, 1.0, len(error)) * quickest * (time - time[0])[:, None])
        free = {name: float(rng.uniform(*span)) for name, span in joints.items()}
        at = time + lag + (drift if rng.random() < drifting else 0.0)
        motions.append(_resampled(at, q + error * sign * swing, free))
    if cell.settings.silence is not None:
        begins = [cycle := cell.settings.cycle_s, cycle, *rng.uniform(cycle, time[-1] - cell.t, SILENCES - 2)]
        for number, begin in enumerate(begins):
            alone, held = silent(cell.settings.silence, time, q, cell.t + begin, rng if number else None)
            motions.append(Motion(alone + delay[1], held, motions[0].free))
    return motions


def hurried(cell: Cell, plan: PlanResult, rng: np.random.Generator) -> Motion:
    """The arm goes from behind the command to ahead of it: every joint is too fast at some instant."""
    time, q = command(cell, plan)
    error = cell.error if plan.stop is StopKind.PATH_CONSISTENT else cell.settings.q_error
    fast = int(rng.integers(1, len(time)))
    ahead = np.sign(q[fast] - q[fast - 1]) * cell.dq_error * (time[:, None] - time[fast])
    joints = {joint.name: joint.upper for joint in cell.arm.free}
    return Motion(time + cell.settings.delay[1], q + np.clip(ahead, -error, error), joints)


def silent(
    silence: Silence, time: Array, q: Array, begin: float, rng: np.random.Generator | None
) -> tuple[Array, Array]:
    """What an arm does that is commanded ``q`` (T, n) at ``time`` (T,) [s] until ``begin`` [s], then nothing.

    Each joint by itself goes on for as long as it may and brakes as little as it may; with ``rng``, for less
    long and harder, or not.
    """
    k = int(np.clip(np.searchsorted(time, begin), 1, len(time) - 2))
    h = time[k + 1] - time[k]
    dq, ddq = (q[k + 1] - q[k - 1]) / (2.0 * h), (q[k + 1] - 2.0 * q[k] + q[k - 1]) / h**2
    hold, brake = np.full(q.shape[1], silence.hold_s), silence.deceleration
    if rng is not None:
        hold = hold * rng.choice([0.0, 1.0, rng.random()], q.shape[1])
        brake = brake * rng.choice([1.0, 1.3, 50.0], q.shape[1])
    ddq = ddq if silence.extrapolates else np.zeros_like(ddq)
    fastest = dq + ddq * hold
    x = np.arange(1, int(((hold + np.abs(fastest) / brake).max() + h) / STEP_S) + 2)[:, None] * STEP_S
    before, after = np.minimum(x, hold), np.minimum(np.maximum(x - hold, 0.0), np.abs(fastest) / brake)
    place = q[k] + dq * before + 0.5 * ddq * before**2
    place += fastest * after - 0.5 * np.sign(fastest) * brake * after**2
    return np.append(time[: k + 1], time[k] + x[:, 0]), np.concatenate([q[: k + 1], place])


def _resampled(at: Array, q: Array, free: dict[str, float]) -> Motion:
    """The motion at instants that are close enough together; delays may have stretched or folded them."""
    later = np.append(True, np.diff(np.maximum.accumulate(at)) > 1e-6)
    at, q = at[later], q[later]
    time = np.linspace(at[0], at[-1], int((at[-1] - at[0]) / STEP_S) + 2)
    return Motion(time, np.stack([np.interp(time, at, column) for column in q.T], axis=1), free)
