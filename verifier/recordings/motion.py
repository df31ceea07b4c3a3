"""What was recorded of an arm's motion, in one piece: samples, commands, and what told it to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verifier.recordings.errors import RecordingError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

FARTHEST = 1e3
"""No joint is farther from 0 than this, nor faster [rad, rad/s; m, m/s]: as ``verify`` has it."""
STANDING_SCALE = 0.01
"""A speed scaling below this is a standstill."""

UR_SAFETY_MODES = {
    3: "protective stop",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "robot emergency stop",
    8: "violation",
    9: "fault",
    12: "automatic mode safeguard stop",
    13: "three-position enabling stop",
}
"""Safety modes that stop a UR arm; 1 normal, 2 reduced, 4 recovery and others do not. Source:
UniversalRobots/Universal_Robots_ROS2_Driver, ur_dashboard_msgs/msg/SafetyMode.msg."""


@dataclass(frozen=True, slots=True, eq=False)
class StateChannel:
    """A channel that says when the arm is to stop.

    Attributes
    ----------
    name:
        Column or topic.
    t:
        ``(K,)`` times [s since the first sample of the motion], increasing.
    cause:
        ``(K,)`` what stops the arm then; ``""``: nothing does.
    needs_motion:
        A beginning at which the arm rests already is no stop (a speed scaling that follows the motion).
    """

    name: str
    t: FloatArray
    cause: tuple[str, ...]
    needs_motion: bool = False

    @property
    def sampled(self) -> bool:
        """Whether the state is written again and again, and not only where it changes."""
        return any(now == after for now, after in zip(self.cause, self.cause[1:], strict=False))


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """An arm's motion.

    Attributes
    ----------
    path:
        The file.
    robot:
        Which arm the file says that it is; ``None``: it does not.
    joints:
        Names, in the order of the columns below.
    t:
        ``(T,)`` times since the first sample [s], increasing.
    q, dq, command_q, command_dq:
        ``(T, J)`` positions and velocities as measured and as commanded [rad, rad/s; m, m/s for prismatic
        joints]; ``None``: not recorded. At least one of ``q`` and ``dq`` is.
    states:
        What says when the arm is to stop.
    notes:
        What had to be assumed, or was left out.
    begins_s:
        Time of the first sample in the file [s].

    Raises
    ------
    RecordingError
        There are fewer than two samples, or a number is NaN, infinite or beyond 1000.
    """

    path: Path
    robot: str | None
    joints: tuple[str, ...]
    t: FloatArray
    q: FloatArray | None
    dq: FloatArray | None
    command_q: FloatArray | None = None
    command_dq: FloatArray | None = None
    states: tuple[StateChannel, ...] = ()
    notes: tuple[str, ...] = ()
    begins_s: float = 0.0

    def __post_init__(self) -> None:
        if len(self.t) < 2:
            raise RecordingError(self.path, "", "has one sample only", "a motion takes at least two")
        for name in ("q", "dq", "command_q", "command_dq"):
            values = getattr(self, name)
            if values is not None and not np.isfinite(values).all():
                row, column = np.argwhere(~np.isfinite(values))[0]
                place = f"{name} of joint {self.joints[column]}, t = {self.t[row]:g} s"
                raise RecordingError(self.path, place, "is NaN or infinite", "it must be a number")
            if values is not None and not np.abs(values).max(initial=0.0) <= FARTHEST:
                row, column = np.argwhere(~(np.abs(values) <= FARTHEST))[0]
                place = f"{name} of joint {self.joints[column]}, t = {self.t[row]:g} s"
                wrong = f"is {values[row, column]:.4g}, beyond {FARTHEST:g}"
                raise RecordingError(self.path, place, wrong, "give rad and rad/s (m, m/s where it slides)")


def safety_modes(name: str, t: FloatArray, modes: Sequence[float] | FloatArray) -> StateChannel:
    """Return the channel that safety modes of a UR arm make."""
    return StateChannel(name, t, tuple(UR_SAFETY_MODES.get(int(mode), "") for mode in modes))


def stop_flags(name: str, t: FloatArray, flags: Sequence[bool] | BoolArray) -> StateChannel:
    """Return the channel that a flag makes which is set while the arm is to stop."""
    cause = name.strip("/").rsplit("/", 1)[-1].replace("_", " ")
    return StateChannel(name, t, tuple(cause if flag else "" for flag in flags))


def falling_scale(name: str, t: FloatArray, scale: FloatArray) -> StateChannel:
    """Return the channel that a speed scaling makes: set from where it begins to fall to a standstill.

    ``scale (K,)``: of any unit, as long as its largest value stands for full speed.
    """
    full = float(np.max(scale, initial=0.0))
    down = np.zeros(len(scale), np.bool_)
    for k in np.flatnonzero(scale <= STANDING_SCALE * full) if full > 0.0 else ():
        down[k] = True
        while k > 0 and scale[k - 1] > scale[k]:
            down[k] = True
            k -= 1
    return StateChannel(name, t, tuple("speed scaling" if each else "" for each in down), needs_motion=True)
