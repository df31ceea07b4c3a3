"""Joint motion of a table, as what is to be written into a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.records import Schema

from robots.assumption import Assumption, Certainty
from verifier.recordings import csv_table
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import JointState
from verifier.recordings.likely_units import JointUnits
from verifier.recordings.mcap_file import Message
from verifier.recordings.motion_table import read_joint_csv, read_joint_npz
from verifier.recordings.recording_writer import RecordingWriter
from verifier.recordings.robot_logs import kind_of
from verifier.recordings.table import JointTable

ENDINGS = (".csv", ".csv.gz", ".npz")


def is_table(path: str | Path) -> bool:
    """Whether the ending of a file says that it is a table."""
    return Path(path).name.endswith(ENDINGS)


@dataclass(frozen=True, slots=True)
class Commanded:
    """What the joints were commanded to do; ``state``: as their own state has it."""

    state: JointState


class TableJoints:
    """Joint motion of an NPZ or CSV table; starts at 0."""

    def __init__(self, table: JointTable, robot: str, robot_joints: tuple[str, ...]) -> None:
        self._table = table
        self.samples = self.left_out = 0
        self.begins_s = table.begins_s
        self.first_ns = 0
        self.last_ns = int(table.t_ns[-1])
        self.names = table.names or robot_joints
        self.assumptions = table.assumptions
        if not table.names:
            self.assumptions = (*table.assumptions, _catalogue_order(table, robot, robot_joints))
        missing = [name for name in robot_joints if name not in self.names]
        if missing:
            raise RecordingError(
                table.path,
                "",
                f"lacks joint {', '.join(missing)} of {robot} (it has {', '.join(self.names)})",
                "choose the robot that was recorded, or rename the joints",
            )
        self.units = JointUnits(robot_joints)
        self.units.add(table.t_ns, table.q[:, [self.names.index(name) for name in robot_joints]])

    def items(self, first_ns: int, last_ns: int) -> Iterator[tuple[int, JointState | Commanded | Message]]:
        """Yield the samples of ``[first_ns, last_ns]``, and what was commanded."""
        table = self._table
        for row, time in enumerate(table.t_ns.tolist()):
            if not first_ns <= time <= last_ns:
                self.left_out += 1
            else:
                rates = {
                    name: values[row]
                    for name, values in (("velocity", table.dq), ("effort", table.tau))
                    if values is not None
                }
                self.samples += 1
                yield time, JointState(time, self.names, table.q[row], **rates)
                if table.command is not None:
                    speed = {} if table.command_dq is None else {"velocity": table.command_dq[row]}
                    yield time, Commanded(JointState(time, self.names, table.command[row], **speed))

    def schema(self, message: Message) -> Schema | None:
        """Raise TypeError: a table has no messages."""
        raise TypeError(f"a table has no messages, so none on {message.channel.topic}")


def _catalogue_order(table: JointTable, robot: str, robot_joints: tuple[str, ...]) -> Assumption:
    """The assumption that stands in for names that a table does not have."""
    if table.q.shape[1] != len(robot_joints):
        raise RecordingError(
            table.path,
            "",
            f"has {table.q.shape[1]} joints without names",
            f"{robot} has {len(robot_joints)}: {', '.join(robot_joints)}",
        )
    return Assumption(
        "recording.joint_order",
        ", ".join(robot_joints),
        "",
        f"{table.path.name} does not name its joints: order of the model of {robot}",
        Certainty.ASSUMED,
    )


def write_table(path: Path, arm: tuple[str, ...], stream: BinaryIO) -> None:
    """Write a table of joint motion as a recording without people; ``arm``: the joints of the arm.

    Raises
    ------
    RecordingError
        The table is refused, is of people, or is of another arm; or nobody says of which arm it is.
    """
    if path.suffix != ".npz":
        header = csv_table.read_header(path)
        if kind_of(header) is None and csv_table.PERSON in header:
            right = "`stopproof import` puts people beside joints"
            raise RecordingError(path, "", "holds points of people, and no joints", right)
    if not arm:
        right = "name it with --robot, or name or urdf in [robot] of the cell"
        raise RecordingError(path, "", "is a table, which does not say of which arm it is", right)
    table = read_joint_npz(path, None) if path.suffix == ".npz" else read_joint_csv(path)
    motion = TableJoints(table, "the arm", arm)
    writer = RecordingWriter(stream)
    for _time, item in motion.items(motion.first_ns, motion.last_ns):
        if isinstance(item, Commanded):
            writer.commands(item.state)
        elif isinstance(item, JointState):
            writer.joints(item)
    writer.describe({}, motion.assumptions)
    writer.finish()
