"""From a motion to joint velocities that are wanted, held for a while, then to rest: one trajectory.

Every joint changes its velocity as quickly as its acceleration and jerk limits allow (ruckig, velocity
interface), and begins to brake early enough to rest within its position limits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.manoeuvre import VelocityProfile
from failsafe.trajectory import DEGREE, IntendedTrajectory, TrajectoryError
from robots.limits import JointLimits

Array = NDArray[np.float64]

_BELOW = 0.95
"""Share of the acceleration limit that is used, so that a check in intervals finds it kept."""
_BELOW_JERK = 0.5
"""The same of the jerk limit. Where q' and q'' are 0, a quick change of the path speed from 0 to 1 multiplies
the jerk of the path by up to 2.1."""
_BELOW_VELOCITY = 0.999
_ROOM = 1e-5
"""Rest is aimed at this much before a position limit [rad; m]."""
_HALVINGS = 40
_SHORTEST_S = 1e-3


class _State(NamedTuple):
    q: float
    v: float
    a: float = 0.0


class _Joint:
    """One joint: limits, and the segments of constant jerk that it goes through."""

    def __init__(self, profile: VelocityProfile, limits: JointLimits, i: int, start: _State) -> None:
        self._profile = profile
        self._a, self._j = _BELOW * float(limits.acceleration[i]), _BELOW_JERK * float(limits.jerk[i])
        self._lower = float(limits.position_lower[i]) + _ROOM
        self._upper = float(limits.position_upper[i]) - _ROOM
        self._name = limits.joints[i]
        self.end = start
        self.t = [0.0]
        self.rows: list[tuple[float, float, float, float]] = []

    def _change(self, start: _State, target: float) -> tuple[list[tuple[float, float]], _State, float]:
        """Return durations and jerks of a change of velocity, the state after it, and how long it takes."""
        profile = self._profile
        if not profile.calculate(start.v, start.a, target, self._a, self._j):
            raise TrajectoryError(f"joint {self._name} has no way from {start.v:.4g} to {target:.4g} rad/s")
        steps = [
            (d, j) for d, j in zip(profile.durations.tolist(), profile.jerks.tolist(), strict=True) if d > 0.0
        ]
        q, v, a = start
        for d, j in steps:
            q, v, a = q + d * (v + d * (a / 2.0 + d * j / 6.0)), v + d * (a + d * j / 2.0), a + d * j
        return steps, _State(q, target), math.fsum(d for d, _ in steps)

    def _rest_after(self, target: float) -> float:
        """Return where the joint rests if it goes to ``target``, and to rest at once."""
        _, reached, _ = self._change(self.end, target)
        _, rest, _ = self._change(reached, 0.0)
        return rest.q

    def _within(self, q: float) -> bool:
        return self._lower <= q <= self._upper

    def attainable(self, wanted: float) -> float:
        """Return ``wanted``, or what of it can still be braked before a position limit."""
        if self._within(self._rest_after(wanted)):
            return wanted
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._within(self._rest_after(middle * wanted)) else (low, middle)
        return low * wanted

    def go(self, velocity: float, until: float) -> None:
        """Change to ``velocity``, hold it until the time ``until`` [s] at most, and come to rest."""
        steps, reached, duration = self._change(self.end, velocity)
        self._append(steps)
        self.end = reached
        _, rest, _ = self._change(reached, 0.0)
        room = self._upper - rest.q if velocity > 0.0 else rest.q - self._lower
        held = max(0.0, until - duration)
        if velocity != 0.0:
            held = min(held, max(0.0, room / abs(velocity)))
            self._append([(held, 0.0)])
            self.end = _State(reached.q + held * velocity, velocity)
            steps, rest, _ = self._change(self.end, 0.0)
            self._append(steps)
            self.end = rest

    def _append(self, steps: list[tuple[float, float]]) -> None:
        q, v, a = self.end
        for d, j in steps:
            if d > 0.0:
                self.rows.append((q, v, a, j))
                self.t.append(self.t[-1] + d)
                q, v, a = q + d * (v + d * (a / 2.0 + d * j / 6.0)), v + d * (a + d * j / 2.0), a + d * j

    def powers(self, begin: Array, middle: Array) -> Array:
        """Return the coefficients ``(M, 4)`` on spans that begin and have their middle there."""
        rows = np.array([*self.rows, (self.end.q, 0.0, 0.0, 0.0)])
        t = np.array(self.t)
        k = np.searchsorted(t, middle, side="right") - 1
        x = begin - t[k]
        q, v, a, j = rows[k].T
        return np.stack(
            [
                q + x * (v + x * (a / 2.0 + x * j / 6.0)),
                v + x * (a + x * j / 2.0),
                (a + x * j) / 2.0,
                j / 6.0,
            ],
            axis=1,
        )


def to_joint_velocity(
    start: tuple[Array, Array, Array],
    velocity: Array,
    horizon_s: float,
    limits: JointLimits,
    begin: float = 0.0,
) -> IntendedTrajectory:
    """Return the motion from ``start`` to joint velocities, and to rest after ``horizon_s``.

    Parameters
    ----------
    start:
        q, dq, ddq ``(n,)`` [rad, rad/s, rad/s²; m for prismatic joints].
    velocity:
        ``(n,)`` [rad/s; m/s], of which at most 0.999 of the velocity limits is used. A joint that could not
        rest within its position limits any more takes as much of it as it can, and brakes earlier than the
        others.
    horizon_s:
        Time from the begin until the joints brake [s]; where the velocity is not reached by then, they brake
        as soon as it is.
    limits:
        Of acceleration and jerk a share is used.
    begin:
        Path parameter at the begin [s].

    Raises
    ------
    TrajectoryError
        The limits leave no such motion, or the horizon is not finite or negative.
    """
    if not 0.0 <= horizon_s < math.inf:
        raise TrajectoryError(f"horizon of {horizon_s} s should be finite and not negative")
    profile = VelocityProfile()
    most = _BELOW_VELOCITY * limits.velocity
    wanted = np.clip(velocity, -most, most)
    joints = []
    for i in range(len(limits.joints)):
        joint = _Joint(profile, limits, i, _State(*(float(each[i]) for each in start)))
        joint.go(joint.attainable(float(wanted[i])), horizon_s)
        joints.append(joint)
    times = np.unique(np.concatenate([joint.t for joint in joints]))
    # what is left out lets q'' jump by jerk times its length; nearer than this, breaks would coincide
    shortest = max(1e-12, 16.0 * np.finfo(np.float64).eps * abs(begin))
    times = times[np.append(True, np.diff(times) > shortest)]
    if len(times) < 2:
        times = np.array([0.0, _SHORTEST_S])
    coefficients = np.zeros((len(times) - 1, DEGREE + 1, len(joints)))
    middle = 0.5 * (times[:-1] + times[1:])
    for i, joint in enumerate(joints):
        coefficients[:, :4, i] = joint.powers(times[:-1], middle)
    return IntendedTrajectory(begin + times, coefficients, "rest")
