"""An arm's motion from a table: our own columns, a UR controller's log (RTDE), or speeds and a flag only."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from verifier.recordings import csv_table, npz
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
from verifier.recordings.table import MAX_JOINT_STEP_S, check_unit, nanoseconds

SAFETY_MODES = ("safety_mode", "safety_status")
FLAGS = ("stop", "protective_stop", "emergency_stop", "Robot_ProtectiveStop")
SCALINGS = ("speed_scaling",)
STATES = (*SAFETY_MODES, *FLAGS, *SCALINGS)
_TRUE, _FALSE = ("true", "1", "1.0"), ("false", "0", "0.0")
OURS = "t,<joint>,…,<joint>_velocity,…,<joint>_command,…"


@dataclass(frozen=True, slots=True)
class Columns:
    """Where a kind of table has what; ``{}`` stands for the number of a joint, ``""``: it has none."""

    kind: str
    time: str
    q: str
    dq: str
    command_q: str = ""
    command_dq: str = ""

    def joints(self, header: Sequence[str]) -> int:
        """How many joints there are, numbered from 0."""
        first = self.q or self.dq
        count = 0
        while first.format(count) in header:
            count += 1
        return count


KNOWN = (
    Columns(
        "log of a UR controller", "timestamp", "actual_q_{}", "actual_qd_{}", "target_q_{}", "target_qd_{}"
    ),
    Columns("speeds without positions", "Timestamp", "", "Speed_J{}"),
)
"""Sources: Universal Robots, RTDE guide (names of its output fields, numbered as its recorder writes them);
UCI 963, Tyrovolas et al. 2024, doi 10.24432/C5J891."""


def read_csv(path: Path, robot_joints: tuple[str, ...] | None) -> RecordedMotion:
    """Read a CSV table; ``robot_joints``: those of the arm, ``None``: as the table names them.

    Raises
    ------
    RecordingError
        The file is not readable, lacks a column that is needed, or a number in it.
    """
    header, rows = csv_table.read_text(path)
    for name in header:
        if header.count(name) > 1:
            raise RecordingError(path, "line 1", f"has column {name} twice", "each column once")
    for known in KNOWN:
        count = known.joints(header)
        if known.time in header and count:
            return _numbered(path, known, count, robot_joints, _Cells(path, header, rows))
    if csv_table.TIME not in header:
        shown = ",".join(header[:6]) + (",…" if len(header) > 6 else "")
        wrong = f"has no column {csv_table.TIME}, and is no log that is known (it has {shown})"
        raise RecordingError(path, "line 1", wrong, f"the columns must be {OURS}, t in s")
    return _named(path, robot_joints, _Cells(path, header, rows))


class _Cells:
    """The cells of a table, column by column; rows in which a wanted one is empty are left out."""

    def __init__(self, path: Path, header: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> None:
        self.path, self.header, self._rows = path, header, rows
        self.left_out = 0

    def keep(self, columns: Sequence[str]) -> None:
        """Leave out the rows in which one of ``columns`` is empty."""
        places = [self.header.index(name) for name in columns]
        kept = [row for row in self._rows if all(row[1][i] for i in places)]
        self.left_out = len(self._rows) - len(kept)
        if not kept:
            raise RecordingError(self.path, "", f"no row has all of {', '.join(columns)}", "fill them in")
        self._rows = kept

    def numbers(self, column: str) -> FloatArray:
        """Return a column of finite numbers."""
        i = self.header.index(column)
        found = np.array([csv_table.number(self.path, line, column, row[i]) for line, row in self._rows])
        bad = np.flatnonzero(~np.isfinite(found))
        if len(bad):
            place = f"line {self._rows[int(bad[0])][0]}, column {column}"
            raise RecordingError(self.path, place, f"is {found[bad[0]]}", "it must be a number")
        return found

    def table(self, pattern: str, count: int) -> FloatArray | None:
        """Return the numbered columns (T, J); ``None``: they are not all there."""
        names = [pattern.format(i) for i in range(count)]
        if not pattern or not set(names) <= set(self.header):
            return None
        return np.column_stack([self.numbers(name) for name in names])

    def times(self, column: str) -> FloatArray:
        """Return a column of seconds, or of dates and times (ISO 8601), as seconds."""
        i = self.header.index(column)
        if not re.match(r"\d+-\d+-\d+[T ]", self._rows[0][1][i]):
            return self.numbers(column)
        found = []
        for line, row in self._rows:
            try:
                found.append(datetime.fromisoformat(row[i]).timestamp())
            except ValueError as error:
                place = f"line {line}, column {column}"
                raise RecordingError(
                    self.path, place, f"{row[i]!r} is no date and time", "write ISO 8601"
                ) from error
        return np.array(found)

    def flags(self, column: str) -> list[bool]:
        """Return a column of true and false, 1 and 0."""
        i, found = self.header.index(column), []
        for line, row in self._rows:
            cell = row[i].lower()
            if cell not in _TRUE + _FALSE:
                place = f"line {line}, column {column}"
                raise RecordingError(
                    self.path, place, f"{row[i]!r} is neither true nor false", "write true or false"
                )
            found.append(cell in _TRUE)
        return found

    def states(self, t: FloatArray) -> tuple[StateChannel, ...]:
        """Return what says when the arm is to stop."""
        found = [safety_modes(name, t, self.numbers(name)) for name in SAFETY_MODES if name in self.header]
        found += [stop_flags(name, t, self.flags(name)) for name in FLAGS if name in self.header]
        found += [falling_scale(name, t, self.numbers(name)) for name in SCALINGS if name in self.header]
        return tuple(found)


def _numbered(
    path: Path, known: Columns, count: int, robot_joints: tuple[str, ...] | None, cells: _Cells
) -> RecordedMotion:
    """A table that numbers its joints."""
    if robot_joints is not None and len(robot_joints) != count:
        raise RecordingError(
            path,
            "",
            f"has {count} joints, and the robot has {len(robot_joints)}: {', '.join(robot_joints)}",
            "choose the robot that was recorded",
        )
    first = [pattern.format(i) for pattern in (known.q, known.dq) if pattern for i in range(count)]
    states = [name for name in STATES if name in cells.header]
    cells.keep([known.time, *(name for name in first if name in cells.header), *states])
    t = _seconds(path, known.time, cells.times(known.time))
    notes = [f"{known.kind}: its joints are numbered, taken in that order"]
    if cells.left_out:
        notes.append(f"{cells.left_out} rows left out: a cell in them is empty")
    return RecordedMotion(
        path,
        None,
        robot_joints or tuple(f"joint {i}" for i in range(count)),
        t,
        cells.table(known.q, count),
        cells.table(known.dq, count),
        cells.table(known.command_q, count),
        cells.table(known.command_dq, count),
        cells.states(t),
        tuple(notes),
    )


def _named(path: Path, robot_joints: tuple[str, ...] | None, cells: _Cells) -> RecordedMotion:
    """A table of our own: ``t``, joints by their names, and what is known beside them."""
    others = (csv_table.TIME, *STATES)
    endings = ("_velocity", "_command")
    named = [name for name in cells.header if name not in others and not name.endswith(endings)]
    joints = robot_joints or tuple(named)
    missing = [name for name in joints if name not in named]
    if missing or not joints:
        wrong = f"lacks joint {', '.join(missing)} (it has {', '.join(named)})" if joints else "has no joint"
        raise RecordingError(path, "line 1", wrong, f"choose the robot that was recorded; columns: {OURS}")

    def beside(ending: str) -> FloatArray | None:
        names = [name + ending for name in joints]
        if not set(names) <= set(cells.header):
            return None
        return np.column_stack([cells.numbers(name) for name in names])

    t = _seconds(path, csv_table.TIME, cells.numbers(csv_table.TIME))
    q = np.column_stack([cells.numbers(name) for name in joints])
    return RecordedMotion(
        path, None, joints, t, q, beside("_velocity"), beside("_command"), None, cells.states(t)
    )


def _seconds(path: Path, column: str, t: FloatArray) -> FloatArray:
    """Times since the first one [s], checked as those of every table are."""
    t_ns = nanoseconds(path, column, t, float(t[0]))
    check_unit(path, column, t, MAX_JOINT_STEP_S, whole=True)
    seconds: FloatArray = t_ns / NANO
    return seconds


def read_npz(path: Path, robot_joints: tuple[str, ...] | None, run: int | None = None) -> RecordedMotion:
    """Read an NPZ archive of joints, with ``q_command (T, J)`` and the states ``(T,)`` where it has them.

    Raises
    ------
    RecordingError
        As :func:`verifier.recordings.npz.read_joints`; or it has another number of joints than the arm.
    """
    table = npz.read_joints(path, run)
    beside = npz.read_beside(path, ("q_command", *STATES), run)
    names = table.names or tuple(f"joint {i}" for i in range(table.q.shape[1]))
    notes: tuple[str, ...] = ()
    if robot_joints is not None and table.names is None and len(robot_joints) == table.q.shape[1]:
        names, notes = robot_joints, ("joints are not named: taken in the order of the model",)
    joints = robot_joints or names
    missing = [name for name in joints if name not in names]
    if missing:
        wrong = f"lacks joint {', '.join(missing)} (it has {', '.join(names)})"
        raise RecordingError(path, "", wrong, "choose the robot that was recorded")
    columns = [names.index(name) for name in joints]
    t = table.t_ns / NANO
    command = beside.get("q_command")
    return RecordedMotion(
        path,
        None,
        joints,
        t,
        table.q[:, columns],
        None if table.dq is None else table.dq[:, columns],
        None if command is None else command[:, columns],
        None,
        _archived_states(t, beside),
        notes,
    )


def _archived_states(t: FloatArray, beside: Mapping[str, FloatArray]) -> tuple[StateChannel, ...]:
    found = [safety_modes(name, t, beside[name]) for name in SAFETY_MODES if name in beside]
    found += [stop_flags(name, t, beside[name] != 0.0) for name in FLAGS if name in beside]
    found += [falling_scale(name, t, beside[name]) for name in SCALINGS if name in beside]
    return tuple(found)
