"""One sample of an arm: what was measured, and what was commanded where the source says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.joint_state import NANO, JointState

FloatArray = NDArray[np.float64]

FARTHEST = 1e3
"""No joint is farther from 0 than this [rad, m], as ``verify`` has it."""


@dataclass(frozen=True, slots=True)
class JointSample:
    """A sample.

    Attributes
    ----------
    state:
        As measured.
    reference:
        As commanded at the same stamp, for the same joints in the same order; ``None``: the source does not
        say.
    """

    state: JointState
    reference: JointState | None = None


class JointAdapter(Protocol):
    """Reads one kind of message; ``schemas``: its names."""

    @property
    def schemas(self) -> tuple[str, ...]:
        """Message types that it reads."""

    def read(self, message: Decoded) -> JointSample:
        """Return what a message says.

        Raises
        ------
        SourceError
            It says nothing usable; one line: what is wrong, and what would be right.
        """


@dataclass(frozen=True, slots=True)
class Names:
    """Joints of a message, with its stamp: what the lists of numbers beside them must fit.

    Raises
    ------
    SourceError
        A name is empty, or stands there twice.
    """

    stamp_ns: int
    joints: tuple[str, ...]
    frame: str = ""

    def __post_init__(self) -> None:
        for name in self.joints:
            if not name:
                raise SourceError("a joint has no name; name every joint")
            if self.joints.count(name) > 1:
                raise SourceError(f"joint {name} stands there twice; each joint must stand there once")

    def state(self, position: ArrayLike, velocity: ArrayLike, effort: ArrayLike, what: str) -> JointState:
        """Return a state of these joints; ``what`` says whose numbers they are.

        Raises
        ------
        SourceError
            There is not one position for each joint, a position is NaN, infinite or beyond 1000, or there
            are velocities or efforts, but not one for each joint.
        """
        q, dq, tau = (_numbers(values, what) for values in (position, velocity, effort))
        number = len(self.joints) or len(q)
        if len(q) != number or not number:
            raise SourceError(f"{what} has {len(q)} positions for {number} joints; one for each")
        for kind, values in (("velocities", dq), ("efforts", tau)):
            if len(values) not in (0, number):
                raise SourceError(
                    f"{what} has {len(values)} {kind} for {number} joints; one for each, or none"
                )
        bad = np.flatnonzero(~(np.abs(q) <= FARTHEST))
        if len(bad):
            joint = self.joints[bad[0]] if self.joints else f"number {bad[0] + 1}"
            right = f"beyond {FARTHEST:g} a path loses digits; give rad, or m"
            if not np.isfinite(q[bad[0]]):
                right = "every position must be a number"
            raise SourceError(f"{what}: joint {joint} is {q[bad[0]]:g}; {right}")
        return JointState(self.stamp_ns, self.joints, q, dq, tau, self.frame)


def names_of(message: Decoded, joints: Any) -> Names:
    """Return the joints of a message; where the stamp is 0, its time is when it arrived.

    Raises
    ------
    SourceError
        It has no usable stamp, or what should be the names is no list.
    """
    if isinstance(joints, str) or not isinstance(joints, Sequence):
        raise SourceError(f"its names are {type(joints).__name__}; they must be a list of texts")
    frame = str(field(message, field(message, message.value, "header"), "frame_id"))
    return Names(stamp_ns(message), tuple(map(str, joints)), frame)


def is_stamped(message: Decoded) -> bool:
    """Whether a message that was read has a header stamp of its own."""
    stamp = field(message, field(message, message.value, "header"), "stamp")
    return bool(field(message, stamp, "sec") or field(message, stamp, "nanosec"))


def stamp_ns(message: Decoded) -> int:
    """Return the header stamp [ns]; where that is 0, when the message arrived.

    Raises
    ------
    SourceError
        There is none, it lies before 1970, or its nanoseconds are no part of a second.
    """
    stamp = field(message, field(message, message.value, "header"), "stamp")
    seconds, nanoseconds = field(message, stamp, "sec"), field(message, stamp, "nanosec")
    whole = isinstance(seconds, int) and isinstance(nanoseconds, int)
    if not (whole and seconds >= 0 and 0 <= nanoseconds < NANO):
        raise SourceError(
            f"its stamp is {seconds} s and {nanoseconds} ns; whole seconds since 1970 and less than 1e9 ns"
        )
    return int(seconds) * NANO + int(nanoseconds) or message.log_time_ns


def field(message: Decoded, value: Any, *names: str) -> Any:
    """Return the first of the fields ``names`` that the message has; definitions change with versions.

    Raises
    ------
    SourceError
        It has none of them.
    """
    for name in names:
        if hasattr(value, name):
            return getattr(value, name)
    raise SourceError(
        f"a {message.schema} without {' or '.join(names)}; this version of the message is not known"
    )


def _numbers(values: ArrayLike, what: str) -> FloatArray:
    try:
        found = np.array(values, dtype=np.float64)  # a copy: messages may lend their buffer
    except (TypeError, ValueError) as error:
        raise SourceError(f"{what} holds no numbers; one for each joint") from error
    if found.ndim != 1:
        raise SourceError(f"{what} holds numbers of shape {found.shape}; one for each joint")
    return found
