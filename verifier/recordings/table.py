"""What a table of joint motion or of body points holds, whichever file it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO

FloatArray = NDArray[np.float64]
TimeArray = NDArray[np.int64]

MAX_TIME_S = 4.0e9
"""Times beyond this [s] (the year 2096 as seconds since 1970) are taken for another unit."""
MAX_SPAN_S = 1e6
"""So are times that go on for longer than this [s], eleven days."""
MAX_JOINT_STEP_S = 2.0
"""So are joint samples that are mostly farther apart than this [s], more than any cell allows …"""
WHOLE_NUMBERS = 10
"""… and this many or more of them that are all whole numbers."""
MAX_PEOPLE_STEP_S = 10.0
"""So are points of people that are mostly farther apart than this [s]."""
MAX_TABLE_BYTES = 1 << 30
"""The numbers of one file may take this much memory."""


@dataclass(frozen=True, slots=True)
class JointTable:
    """Joint motion.

    Attributes
    ----------
    path:
        Where it comes from.
    t_ns:
        Times since the first sample, shape (T,) [ns], strictly increasing from 0.
    names:
        Joint names; ``None``: the file has none.
    q, dq, tau, command, command_dq:
        Positions, velocities, torques, commanded positions and velocities, shape (T, J); all but ``q`` may be
        ``None``.
    assumptions:
        What reading it assumed.
    begins_s:
        Time of the first sample in the file [s].
    """

    path: Path
    t_ns: TimeArray
    names: tuple[str, ...] | None
    q: FloatArray
    dq: FloatArray | None = None
    tau: FloatArray | None = None
    command: FloatArray | None = None
    command_dq: FloatArray | None = None
    assumptions: tuple[Assumption, ...] = ()
    begins_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Track:
    """One person's points.

    Attributes
    ----------
    person:
        Name in the file; ``None``: the file knows one person, without a name.
    t_ns:
        Times since the file's first row, shape (T,) [ns], strictly increasing.
    names:
        Point names, as in the file.
    xyz:
        Positions, shape (T, P, 3) [m]; NaN: missing.
    """

    person: str | None
    t_ns: TimeArray
    names: tuple[str, ...]
    xyz: FloatArray


@dataclass(frozen=True, slots=True)
class PeopleTable:
    """Points of one or more persons on one clock, with the position error [m] if the file states it, what
    reading it assumed, and the time of its first row in the file [s]."""

    path: Path
    tracks: tuple[Track, ...]
    position_error_m: float | None = None
    assumptions: tuple[Assumption, ...] = ()
    begins_s: float = 0.0


def nanoseconds(path: Path, place: str, t: FloatArray, start: float) -> TimeArray:
    """Turn times [s] into nanoseconds since ``start``.

    Raises
    ------
    RecordingError
        A time is no number, repeats, runs backwards or is not in seconds.
    """
    bad = np.flatnonzero(~(np.abs(t) < MAX_TIME_S))
    if len(bad):
        row = int(bad[0])
        raise RecordingError(
            path, f"{place}, sample {row}", f"time is {t[row]}", "times must be numbers of seconds"
        )
    t_ns = np.rint((t - start) * NANO).astype(np.int64)
    steps = np.diff(t_ns)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        wrong = "repeats" if steps[row - 1] == 0 else "runs backwards"
        raise RecordingError(
            path,
            f"{place}, sample {row}",
            f"time {wrong}: {t[row]} s after {t[row - 1]} s",
            "times must increase",
        )
    span = float(t[-1] - t[0]) if len(t) else 0.0
    if span > MAX_SPAN_S:
        wrong = f"times go on for {span:g} s, more than {MAX_SPAN_S:g} s"
        raise RecordingError(path, place, wrong, "times must be in seconds")
    return t_ns


def check_unit(path: Path, place: str, t: FloatArray, longest_s: float, *, whole: bool = False) -> None:
    """Refuse increasing times that look like milliseconds: mostly farther apart than ``longest_s`` [s].

    Parameters
    ----------
    whole:
        Whether times that are all whole numbers are refused as well.

    Raises
    ------
    RecordingError
        They do.
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if step > longest_s or (whole and len(t) >= WHOLE_NUMBERS and (t == np.rint(t)).all()):
        wrong = f"times are {step:g} apart, which does not look like seconds"
        raise RecordingError(path, place, wrong, "times must be in seconds")


def check_joints(path: Path, place: str, names: Sequence[str] | None, t: FloatArray, q: FloatArray) -> None:
    """Check joint names and positions.

    Raises
    ------
    RecordingError
        A name stands twice, or a position is NaN or infinite.
    """
    for name in names or ():
        if list(names or ()).count(name) > 1:
            raise RecordingError(
                path, place, f"joint {name} stands there twice", "each joint must have one column"
            )
    bad = np.argwhere(~np.isfinite(q))
    if len(bad):
        row, column = (int(index) for index in bad[0])
        joint = names[column] if names else f"number {column + 1}"
        raise RecordingError(
            path,
            f"{place}, t = {t[row]} s",
            f"joint {joint} is {q[row, column]}",
            "every position must be a number",
        )
