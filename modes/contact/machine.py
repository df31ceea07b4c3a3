"""Task, collision, collaboration: an explicit machine, a step of which takes what was measured.

=============== ========================================= =============================================
state           the arm                                   is left
=============== ========================================= =============================================
CHECK           waits                                     to TASK when the sensor has read the weight of
                                                          its tool for a while
TASK            follows the task, (5) and (6)             to COLLISION by a fast change, to COLLABORATION
                                                          by a soft contact at the end effector
COLLISION       waits                                     to TASK when nothing was detected for a while
COLLABORATION   yields, (19)                              to RETURN when nobody guides it, to COLLISION by
                                                          a fast change or the residual (18)
RETURN          goes back to where it was taken, (19)     to COLLABORATION when it is taken again, to
                                                          TASK after 4 s, to COLLISION as above
FAULT           waits                                     by ``reset`` alone
=============== ========================================= =============================================

What cannot be believed leads from every state to FAULT, with a reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.contact import kernels
from modes.contact.admittance import Admittance, CyclicTask
from modes.contact.detection import (
    TABLE_1,
    BodyContact,
    BodyDetector,
    CurrentThresholds,
    ForceThresholds,
    Residual,
    ToolContact,
    ToolDetector,
)
from modes.contact.filters import VARIANTS, Variant
from modes.contact.wrench import SensorFault, SensorLimits, SensorWatch, ToolLoad
from modes.settings import require_choice, require_kind, require_number, require_numbers
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]
Space = Literal["cartesian", "joint"]
SPACES: tuple[Space, ...] = ("cartesian", "joint")


class State(Enum):
    """What the arm is doing."""

    CHECK = "check"
    TASK = "task"
    COLLISION = "collision"
    COLLABORATION = "collaboration"
    RETURN = "return"
    FAULT = "fault"


class Why(Enum):
    """Why the arm left its task, apart from a fault of the sensor."""

    NOTHING = "nothing"
    BODY_COLLISION = "a motor current changed fast"
    TOOL_COLLISION = "the force at the end effector changed fast"
    RESIDUAL = "motor currents show more than the force at the end effector"
    SOFT_CONTACT = "somebody holds the end effector"
    LET_GO = "nobody holds the end effector any more"
    JOINTS = "joint positions or motor currents are not numbers"


Reason = Why | SensorFault
_UNTOUCHED = 1.0 / 3.0
"""Below this share of the threshold of a soft contact nobody is taken to hold the tool."""
_NOTHING: Array = np.empty(0)
_MOVES = frozenset({State.TASK, State.COLLABORATION, State.RETURN})


@dataclass(frozen=True, slots=True)
class Measured:
    """What a control step gets.

    Attributes
    ----------
    t:
        Its instant [s].
    currents:
        ``(n,)`` absolute motor currents [A].
    stamps, wrenches:
        ``(m,)`` [s] and ``(m, 6)`` [N, N m]: what the sensor has read since the last step, its axes.
    """

    t: float
    currents: Array
    stamps: Array
    wrenches: Array


@dataclass(frozen=True, slots=True, eq=False)
class ContactSettings:
    """How contacts are told, and what the arm does then; the paper's numbers.

    Attributes
    ----------
    residual:
        With the torque per current of each joint, which only their robot knows.
    load, sensor_m:
        What hangs on the sensor; where it is, in the frame of the last joint, whose axes it has (3,) [m].
    space:
        *cartesian*: the tool yields, (19); *joint*: every joint yields to its torque.
    joint_admittance:
        For the latter; compliance [rad/(s N m)], stiffness [N m/rad].
    task_gain, posture_gain:
        K of (6) and k_0 of (20) [1/s].
    clear_s, resume_s, check_s:
        So long nothing may be detected before the task goes on after a collision; so long nobody may guide
        the arm before it does; so long the sensor must read the weight of its tool at first [s].
    cap_m_s:
        The tool is never asked to be faster [m/s].
    acceleration_share:
        Speeds change by no more than this share of the joints' acceleration limits allows, except to stop:
        what a drive needs for a jump in speed looks like a collision.
    filters:
        As printed, or corrected.
    """

    residual: Residual
    currents: CurrentThresholds = TABLE_1
    forces: ForceThresholds = field(default_factory=ForceThresholds)
    sensor: SensorLimits = field(default_factory=SensorLimits)
    load: ToolLoad = field(default_factory=ToolLoad)
    sensor_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    admittance: Admittance = field(default_factory=Admittance)
    space: Space = "cartesian"
    joint_admittance: Admittance = field(default_factory=lambda: Admittance(0.05, 40.0))
    task_gain: float = 2.0
    posture_gain: float = 2.0
    clear_s: float = 1.0
    resume_s: float = 4.0
    check_s: float = 0.3
    cap_m_s: float = 0.25
    acceleration_share: float = 0.15
    filters: Variant = "corrected"

    def __post_init__(self) -> None:
        require_kind("contact: residual", self.residual, Residual, written="a Residual(gains_Nm_A)")
        for name, kind in (
            ("currents", CurrentThresholds), ("forces", ForceThresholds), ("sensor", SensorLimits),
            ("load", ToolLoad), ("admittance", Admittance), ("joint_admittance", Admittance),
        ):  # fmt: skip
            require_kind(f"contact: {name}", getattr(self, name), kind, written=f"a {kind.__name__}(…)")
        require_numbers("contact: sensor_m", self.sensor_m, (3,))
        if self.joint_admittance.compliance * self.joint_admittance.stiffness * self.period_s >= 1.0:
            raise SetupError(
                "contact: joint_admittance: compliance times stiffness should be below "
                f"1 / period_s = {1.0 / self.period_s:.4g} 1/s of admittance: joints would swing"
            )
        require_choice("contact: filters", self.filters, VARIANTS)
        require_choice("contact: space", self.space, SPACES)
        for name in ("task_gain", "posture_gain"):
            require_number(f"contact: {name}", getattr(self, name), 0.0, 50.0)
        for name in ("clear_s", "resume_s", "check_s", "cap_m_s"):
            require_number(f"contact: {name}", getattr(self, name), 0.0, 3600.0, above=True)
        require_number("contact: acceleration_share", self.acceleration_share, 0.0, 1.0, above=True)

    @property
    def period_s(self) -> float:
        """Time of a control step [s]."""
        return self.admittance.period_s


class Decision(NamedTuple):
    """What the machine has come to in a step.

    Attributes
    ----------
    state, reason:
        And why it is so; ``Why.NOTHING`` in TASK.
    dq:
        ``(n,)`` joint speeds that are wanted [rad/s].
    place, force:
        ``(3,)`` of the tool [m], and contact force on it, base axes [N].
    body, tool, residual:
        What was detected; ``None`` where it was not looked at.
    """

    state: State
    reason: Reason
    dq: Array
    place: Array
    force: Array
    body: BodyContact | None = None
    tool: ToolContact | None = None
    residual: Array | None = None


class _Step(NamedTuple):
    """Everything that the states look at."""

    t: float
    q: Array
    place: Array
    jacobian: Array
    wrench: Array
    currents: Array
    body: BodyContact
    tool: ToolContact


def _numbers(value: object) -> Array:
    """Return an array of numbers; an empty one of whatever is none."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        return _NOTHING
    return found.astype(np.float64) if found.dtype.kind in "fiu" else _NOTHING


class ContactMachine:
    """Tells contacts, and says how the joints should move.

    Parameters
    ----------
    robot:
        The arm.
    task:
        What it does while nobody is in contact.
    settings:
        Thresholds and gains.

    Attributes
    ----------
    state, reason:
        As of the last step.

    Raises
    ------
    SetupError
        Settings do not fit the arm.
    """

    def __init__(self, robot: RobotModel, task: CyclicTask, settings: ContactSettings) -> None:
        n = len(robot.joints)
        if len(settings.residual.gains_Nm_A) != n:
            raise SetupError(
                f"contact: residual has gains of {len(settings.residual.gains_Nm_A)} joints, "
                f"{robot.name} has {n}"
            )
        if settings.currents.joints > n:
            raise SetupError(
                f"contact: currents of {settings.currents.joints} joints are looked at, {robot.name} has {n}"
            )
        self.settings, self._task, self._n = settings, task, n
        self._frame = ToolFrame(robot, np.array(settings.sensor_m))
        self._fastest = 0.9 * robot.limits.velocity
        self._most = settings.acceleration_share * settings.period_s * robot.limits.acceleration
        self._soonest = 0.5 * settings.period_s
        self._untouched_N = _UNTOUCHED * settings.forces.low_N
        self._posture: Array | None = None
        self._done_s = 0.0
        self._acts: dict[State, Callable[[_Step, Array | None], Array]] = {
            State.CHECK: self._check,
            State.TASK: self._work,
            State.COLLISION: self._wait,
            State.COLLABORATION: self._guided,
            State.RETURN: self._guided,
        }
        self.reset()

    @property
    def commanded(self) -> Array:
        """Joint speeds that the last step wanted (n,) [rad/s]."""
        return self._dq.copy()

    def reset(self) -> None:
        """Begin anew with the check of the sensor; the task goes on where it was."""
        rate = 1.0 / self.settings.period_s
        self.state: State = State.CHECK
        self.reason: Reason = Why.NOTHING
        self._watch = SensorWatch(self.settings.sensor, rate)
        self._body = BodyDetector(self.settings.currents, self.settings.filters, rate)
        self._tool = ToolDetector(self.settings.forces, self.settings.filters, rate)
        self._since = self._before = np.nan
        self._sum, self._steps = np.zeros(3), 0
        self._dq, self._untouched = np.zeros(self._n), np.zeros(self._n)
        self._begin = self._begin_q = self._offset = np.empty(0)

    def step(self, q: Array, measured: Measured, dq: Array | None = None) -> Decision:
        """Take what was measured at configuration ``q`` (n,) [rad].

        ``dq`` (n,): speeds that the drives were given last [rad/s]; ``None``: those that were wanted.
        Whatever comes, nothing is raised: what cannot be used leads to ``FAULT``.
        """
        joints, currents = _numbers(q), _numbers(measured.currents)
        given = self._dq if dq is None else _numbers(dq)
        shape = (self._n,)
        shaped = joints.shape == shape and currents.shape == shape and given.shape == shape
        if not (shaped and kernels.are_finite(joints, currents, given)):
            return self._fault(Why.JOINTS, np.full(3, np.nan))
        q, self._dq = joints, given.copy()
        rotation, place, jacobian = self._frame.at(q)
        reading = self._read(measured)
        if isinstance(reading, SensorFault):
            return self._fault(reading, place)
        wrench = self.settings.load.contact(reading, rotation)
        if self.state is State.FAULT:
            return self._fault(self.reason, place)
        body, tool = self._body.step(currents, self._dq), self._tool.step(wrench[:3])
        now = _Step(measured.t, q, place, jacobian, wrench, np.abs(currents), body, tool)
        if self._posture is None:
            self._posture = q.copy()
        residual = self._residual_of(now)
        speeds = self._acts[self.state](now, residual)
        self._dq = self._capped(speeds, jacobian) if self.state in _MOVES else np.zeros(self._n)
        self._before = now.t
        if tool.low_N < self._untouched_N:
            self._untouched = now.currents
        return Decision(self.state, self.reason, self._dq.copy(), place, wrench[:3], body, tool, residual)

    def _read(self, measured: Measured) -> Array | SensorFault:
        """Return the mean reading of the sensor, or why there is none."""
        t, stamps, wrenches = measured.t, _numbers(measured.stamps), _numbers(measured.wrenches)
        if not (isinstance(t, (float, int)) and stamps.ndim == 1):
            return SensorFault.NOT_A_NUMBER
        if t - self._before < self._soonest:
            return SensorFault.CLOCK
        return self._watch.take(float(t), stamps, wrenches)

    def _fault(self, reason: Reason, place: Array) -> Decision:
        """Wait for ``reset``; the first reason stands."""
        if self.state is not State.FAULT:
            self.state, self.reason = State.FAULT, reason
        self._dq = np.zeros(self._n)
        return Decision(self.state, self.reason, self._dq.copy(), place, np.full(3, np.nan))

    def _enter(self, state: State, reason: Reason, now: _Step) -> None:
        self.state, self.reason, self._since = state, reason, now.t

    def _check(self, now: _Step, _residual: Array | None) -> Array:
        """Compare the reading with the weight of the tool, at rest."""
        if np.isnan(self._since):
            self._since = now.t
        self._sum += now.wrench[:3]
        self._steps += 1
        if now.t - self._since < self.settings.check_s:
            return np.zeros(self._n)
        if np.linalg.norm(self._sum / self._steps) > self.settings.sensor.weight_N:
            self._enter(State.FAULT, SensorFault.WEIGHT, now)
        else:
            self._enter(State.TASK, Why.NOTHING, now)
        return np.zeros(self._n)

    def _work(self, now: _Step, _residual: Array | None) -> Array:
        """Follow the task, unless a contact is detected."""
        if now.tool.collision:
            return self._collide(Why.TOOL_COLLISION, now)
        if now.body.collision:
            return self._collide(Why.BODY_COLLISION, now)
        if now.tool.lasts:
            self._begin, self._begin_q = now.place.copy(), now.q.copy()
            self._offset = self._untouched.copy()
            self._enter(State.COLLABORATION, Why.SOFT_CONTACT, now)
            return self._yielding(now)
        if math.isfinite(self._before):
            self._done_s += max(now.t - self._before, 0.0)
        wanted, velocity = self._task.at(self._done_s)
        assert self._posture is not None
        settings, out = self.settings, np.empty(self._n)
        kernels.follow(
            now.jacobian, now.place, wanted, velocity, settings.task_gain, self._posture, now.q,
            settings.posture_gain, out,
        )  # fmt: skip
        return out

    def _collide(self, why: Why, now: _Step) -> Array:
        self._enter(State.COLLISION, why, now)
        return np.zeros(self._n)

    def _wait(self, now: _Step, _residual: Array | None) -> Array:
        """Wait until nothing has been detected for a while."""
        found = now.tool.collision, now.tool.lasts, now.body.collision, now.body.lasts
        if any(found):
            self._since = now.t
        elif now.t - self._since >= self.settings.clear_s:
            self._enter(State.TASK, Why.NOTHING, now)
        return np.zeros(self._n)

    def _guided(self, now: _Step, residual: Array | None) -> Array:
        """Yield, while somebody guides the tool and for a while after."""
        if now.tool.collision:
            return self._collide(Why.TOOL_COLLISION, now)
        if residual is not None and self.settings.residual.alarms(residual):
            return self._collide(Why.RESIDUAL, now)
        held = now.tool.lasts
        if held and self.state is State.RETURN:
            self._enter(State.COLLABORATION, Why.SOFT_CONTACT, now)
        elif not held and self.state is State.COLLABORATION:
            self._enter(State.RETURN, Why.LET_GO, now)
        elif not held and now.t - self._since >= self.settings.resume_s:
            self._enter(State.TASK, Why.NOTHING, now)
        return self._yielding(now)

    def _yielding(self, now: _Step) -> Array:
        """Return (19)."""
        settings = self.settings
        if settings.space == "joint":
            torques = self._torques(now)
            return settings.joint_admittance.velocity(torques, self._begin_q, now.q)
        law, out = settings.admittance, np.empty(self._n)
        kernels.give_way(now.jacobian, now.wrench, self._begin, now.place, law.compliance, law.stiffness, out)
        return out

    def _torques(self, now: _Step) -> Array:
        """Return J'F (n,) [N m] of what acts on the tool."""
        out = np.empty(self._n)
        kernels.joint_torques(now.jacobian, now.wrench, out)
        return out

    def _residual_of(self, now: _Step) -> Array | None:
        """Return (18) while somebody guides the tool, and until the task goes on."""
        if self.state not in (State.COLLABORATION, State.RETURN):
            return None
        return self.settings.residual.of(now.currents, self._offset, self._torques(now))

    def _capped(self, dq: Array, jacobian: Array) -> Array:
        """Slow down all joints alike, as far as the cap of the tool and the joints' limits ask for.

        And change speeds no faster than is allowed, those of all joints by the same share.
        """
        out: Array = np.empty(self._n)
        kernels.limited(jacobian, dq, self._dq, self.settings.cap_m_s, self._fastest, self._most, out)
        return out
