"""Logs of arms as CSV tables: which kinds there are, and how they are read.

Sources: Universal Robots, RTDE guide (names of its output fields, numbered as its recorder writes them, with
blanks between the columns; ``timestamp`` counts from when the controller was switched on); libfranka,
src/log.cpp (``time`` in whole ms); UCI 963, Tyrovolas et al. 2024, doi 10.24432/C5J891.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from robots.assumption import Assumption, Certainty
from verifier.recordings import csv_table
from verifier.recordings.csv_table import Columns, Reader, finite
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.motion import (
    FloatArray,
    RecordedMotion,
    StateChannel,
    falling_scale,
    safety_modes,
    stop_flags,
)
from verifier.recordings.table import MAX_JOINT_STEP_S, JointTable, check_unit, nanoseconds

_TRUE, _FALSE = ("true", "1", "1.0"), ("false", "0", "0.0")
PAYLOAD = "payload"
"""Column of a UR controller's log: the mass that it was told [kg]."""


def seconds(path: Path, line: int, column: str, cell: str) -> float:
    """Return a cell of seconds, or of date and time (ISO 8601), as seconds.

    Raises
    ------
    RecordingError
        It is neither.
    """
    if not re.match(r"\d+-\d+-\d+[T ]", cell):
        return finite(path, line, column, cell)
    try:
        return datetime.fromisoformat(cell).timestamp()
    except (ValueError, OverflowError) as error:
        place = f"line {line}, column {column}"
        raise RecordingError(path, place, f"{cell!r} is no date and time", "write ISO 8601") from error


def milliseconds(path: Path, line: int, column: str, cell: str) -> float:
    """Return a cell of whole milliseconds as seconds.

    Raises
    ------
    RecordingError
        It is no whole number: libfranka writes no other, so that this one is of another unit.
    """
    value = finite(path, line, column, cell)
    if value != round(value):
        place = f"line {line}, column {column}"
        wrong = f"is {cell}, which is no whole number of ms, as libfranka writes them"
        raise RecordingError(path, place, wrong, "give the log as libfranka wrote it, or t in s")
    return value / 1e3


def flag(path: Path, line: int, column: str, cell: str) -> float:
    """Return 1 for a cell of true, 0 for one of false.

    Raises
    ------
    RecordingError
        It is neither.
    """
    if cell.lower() not in _TRUE + _FALSE:
        place = f"line {line}, column {column}"
        raise RecordingError(
            path, place, f"{cell!r} is neither true nor false", "write true or false, or 1 or 0"
        )
    return float(cell.lower() in _TRUE)


def _flags(name: str, t: FloatArray, flags: FloatArray) -> StateChannel:
    return stop_flags(name, t, flags != 0.0)


_SAFETY_MODES = ("safety_mode", "safety_status")
FLAGS = ("stop", "protective_stop", "emergency_stop", "Robot_ProtectiveStop")
_SCALINGS = ("speed_scaling",)
STATES: Mapping[str, Reader] = {
    **dict.fromkeys((*_SAFETY_MODES, *_SCALINGS), finite),
    **dict.fromkeys(FLAGS, flag),
}
"""Columns that say when the arm is to stop, and how they are read."""
_MAKERS: Mapping[str, Callable[[str, FloatArray, FloatArray], StateChannel]] = {
    **dict.fromkeys(_SAFETY_MODES, safety_modes),
    **dict.fromkeys(FLAGS, _flags),
    **dict.fromkeys(_SCALINGS, falling_scale),
}


def states(t: FloatArray, values: Mapping[str, FloatArray]) -> tuple[StateChannel, ...]:
    """Return what says when the arm is to stop, of the columns in ``values``."""
    return tuple(maker(name, t, values[name]) for name, maker in _MAKERS.items() if name in values)


NUMBER = "(0|[1-9][0-9]{0,2})"
"""Of a joint in the name of its column, as logs write it: 01 is another name."""


@dataclass(frozen=True, slots=True)
class LogKind:
    """Where a kind of table has what; ``{}`` stands for the number of a joint, ``""``: it has none."""

    name: str
    time: str
    read_time: Reader
    q: str
    dq: str
    command_q: str = ""
    command_dq: str = ""

    @property
    def first(self) -> str:
        """Pattern of the columns that there must be."""
        return self.q or self.dq

    def fits(self, header: Sequence[str]) -> bool:
        """Whether a table with these columns is of this kind."""
        patterns = (self.q, self.dq, self.command_q, self.command_dq)
        return self.time in header and any(each.format(0) in header for each in patterns if each)

    def numbered(self, path: Path, header: Sequence[str], pattern: str) -> tuple[str, ...]:
        """Return the columns of a pattern in their order; empty: there are none.

        Raises
        ------
        RecordingError
            One is left out.
        """
        number = re.compile(re.escape(pattern).replace(re.escape("{}"), NUMBER)) if pattern else None
        found = {int(match[1]) for name in header if number and (match := number.fullmatch(name))}
        missing = sorted(set(range(max(found, default=-1) + 1)) - found)
        if missing:
            column = pattern.format(missing[0])
            raise RecordingError(path, "line 1", f"lacks column {column}", "a log has all joints, from 0")
        return tuple(pattern.format(each) for each in sorted(found))


KINDS = (
    LogKind(
        "log of a UR controller",
        "timestamp",
        seconds,
        "actual_q_{}",
        "actual_qd_{}",
        "target_q_{}",
        "target_qd_{}",
    ),
    LogKind(
        "log of libfranka",
        "time",
        milliseconds,
        "state.q[{}]",
        "state.dq[{}]",
        "state.q_d[{}]",
        "state.dq_d[{}]",
    ),
    LogKind("speeds without positions", "Timestamp", seconds, "", "Speed_J{}"),
)
"""Of libfranka the command is ``state.q_d``: what stands in ``cmd.q_d`` is that of the sample before, and 0
where the arm is commanded by torques or poses."""


def kind_of(header: Sequence[str]) -> LogKind | None:
    """Return which kind of log has these columns; ``None``: none that is known."""
    return next((kind for kind in KINDS if kind.fits(header)), None)


def read_log(path: Path, kind: LogKind, robot_joints: tuple[str, ...] | None) -> RecordedMotion:
    """Read a log; ``robot_joints``: those of the arm in the order of its model, ``None``: not known.

    Raises
    ------
    RecordingError
        The file is not readable, lacks a column that is needed, or a number in it; it is of another arm.
    """
    columns, names = _read(path, kind, robot_joints)
    t = columns.values[kind.time]
    t_ns = nanoseconds(path, kind.time, t, float(t[0]))
    check_unit(path, kind.time, t, MAX_JOINT_STEP_S, whole=True)
    since = t_ns / NANO
    notes = [f"{kind.name}: its joints are numbered, taken in that order"]
    if columns.left_out:
        notes.append(f"{columns.left_out} rows left out: a cell in them is empty")
    payload = columns.values.get(PAYLOAD)
    if payload is not None:
        stated = dict.fromkeys((float(payload.min()), float(payload.max())))
        notes.append(f"payload that the controller was told: {' … '.join(f'{each:g}' for each in stated)} kg")
    q, dq, command_q, command_dq = (columns.table(each) for each in names[1:])
    return RecordedMotion(
        path,
        None,
        robot_joints or tuple(f"joint {i}" for i in range(len(names[0]))),
        since,
        q,
        dq,
        command_q,
        command_dq,
        states(since, columns.values),
        tuple(notes),
        float(t[0]),
    )


def _read(
    path: Path, kind: LogKind, robot_joints: tuple[str, ...] | None
) -> tuple[Columns, tuple[tuple[str, ...], ...]]:
    """The columns, and the names of those that must be there, of q, dq, command_q and command_dq."""
    names: tuple[tuple[str, ...], ...] = ()

    def choose(header: list[str]) -> dict[str, Reader]:
        nonlocal names
        csv_table.check_names(path, header)
        patterns = (kind.first, kind.q, kind.dq, kind.command_q, kind.command_dq)
        names = tuple(kind.numbered(path, header, pattern) for pattern in patterns)
        if not names[0]:
            wrong = f"has no column {kind.first.format(0)}, as a {kind.name} has it"
            raise RecordingError(path, "line 1", wrong, "record what the joints did, not only commands")
        for pattern, found in zip(patterns, names, strict=True):
            if len(found) not in (0, len(names[0])):
                there, other = kind.first.format("N"), pattern.format("N")
                wrong = f"has {len(names[0])} columns {there} and {len(found)} {other}"
                raise RecordingError(path, "line 1", wrong, "a log has one of each for a joint")
        if robot_joints is not None and len(robot_joints) != len(names[0]):
            robot = f"the robot has {len(robot_joints)}: {', '.join(robot_joints)}"
            wrong = f"has {len(names[0])} joints, and {robot}"
            raise RecordingError(path, "", wrong, "choose the robot that was recorded")
        numbers = {name: finite for found in names for name in found}
        if PAYLOAD in header:
            numbers[PAYLOAD] = finite
        return {kind.time: kind.read_time, **numbers, **{k: v for k, v in STATES.items() if k in header}}

    return csv_table.read_columns(path, choose, skip_empty=True), names


def joint_table(motion: RecordedMotion, kind: LogKind) -> JointTable:
    """Return a log that does not know its joints as a table of joint motion.

    Raises
    ------
    RecordingError
        It has no positions.
    """
    if motion.q is None:
        raise RecordingError(motion.path, "line 1", "has speeds and no positions", "record positions")
    source = Assumption(
        "recording.joint_source",
        kind.name,
        "",
        f"columns {kind.q.format(0)} … {kind.q.format(motion.q.shape[1] - 1)} of {motion.path.name}",
        Certainty.SOURCED,
    )
    return JointTable(
        motion.path,
        np.rint(motion.t * NANO).astype(np.int64),
        None,
        motion.q,
        motion.dq,
        None,
        motion.command_q,
        motion.command_dq,
        (source,),
        motion.begins_s,
    )
