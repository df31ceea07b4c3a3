"""An arm's motion from a table: our own columns, an NPZ, or a log of a controller."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from verifier.recordings import csv_table, npz, robot_logs
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.robot_logs import STATES, states
from verifier.recordings.table import JointTable


def read_csv(path: Path, robot_joints: tuple[str, ...] | None) -> RecordedMotion:
    """Read a CSV table; ``robot_joints``: those of the arm, ``None``: as the table names them.

    Raises
    ------
    RecordingError
        The file is not readable, lacks a column that is needed, or a number in it.
    """
    header = csv_table.read_header(path)
    kind = robot_logs.kind_of(header)
    if kind is not None:
        return robot_logs.read_log(path, kind, robot_joints)
    if csv_table.TIME not in header:
        shown = ",".join(header[:6]) + (",…" if len(header) > 6 else "")
        wrong = f"has no column {csv_table.TIME}, and is no log that is known (it has {shown})"
        right = f"the columns must be {csv_table.JOINT_COLUMNS}, t in s"
        raise RecordingError(path, "line 1", wrong, right)
    table, columns = csv_table.read_joints_beside(path, robot_joints, STATES)
    t = table.t_ns / NANO
    joints = table.names or ()
    return RecordedMotion(
        path, None, joints, t, table.q, table.dq, table.command, None, states(t, columns.values)
    )


def read_joint_csv(path: Path) -> JointTable:
    """Read a CSV table of joint motion with positions, of our own columns or a log that is known.

    Raises
    ------
    RecordingError
        As :func:`read_csv`; or there are no positions.
    """
    header = csv_table.read_header(path)
    kind = robot_logs.kind_of(header)
    if kind is None:
        return csv_table.read_joints_beside(path, None, STATES)[0]
    return robot_logs.joint_table(robot_logs.read_log(path, kind, None), kind)


def read_joint_npz(path: Path, run: int | None) -> JointTable:
    """Read an NPZ archive of joints, with ``q_command (T, J)`` where it has it.

    Raises
    ------
    RecordingError
        As :func:`verifier.recordings.npz.read_joints`.
    """
    beside = npz.read_beside(path, ("q_command",), run)
    return replace(npz.read_joints(path, run), command=beside.get("q_command"))


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
        states(t, beside),
        notes,
    )
