"""Where an import takes joint motion from: a table, or a recording whose messages are kept as they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from mcap.records import Schema

from robots.assumption import Assumption
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.containers import is_container
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO, JointState
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.likely_units import JointUnits
from verifier.recordings.mcap_file import Message
from verifier.recordings.motion_table import read_joint_csv, read_joint_npz
from verifier.recordings.neutral import JOINTS
from verifier.recordings.reading import Reading
from verifier.recordings.recording import Recording
from verifier.recordings.table_joints import Commanded, TableJoints
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC, VERDICT_TOPIC

CHECKED_AT_ONCE = 1000
"""Samples of an MCAP."""
KINDS = "it must end in .npz, .csv, .csv.gz, .mcap, .bag or .db3, or be the folder of a ROS 2 bag"


class JointSource(Protocol):
    """Joint motion to import.

    Attributes
    ----------
    first_ns, last_ns:
        Time of the first and last sample [ns].
    begins_s:
        Time of the first sample on the file's own clock [s].
    names:
        Every joint of the source.
    assumptions:
        What had to be assumed to read it.
    samples, left_out:
        Samples of the robot's joints so far that were yielded, and those outside of the stretch asked for.
    units:
        What the positions of the robot's joints look like, once all were read.
    """

    first_ns: int
    last_ns: int
    begins_s: float
    names: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    samples: int
    left_out: int
    units: JointUnits

    def items(self, first_ns: int, last_ns: int) -> Iterator[tuple[int, JointState | Commanded | Message]]:
        """Yield what is to be written of ``[first_ns, last_ns]``, with its message time [ns], in order."""

    def schema(self, message: Message) -> Schema | None:
        """Return the schema of a message to copy."""


class RecordedJoints:
    """Joint motion of a recording with messages.

    Every topic but ``/people`` and ``/verdict`` is copied, times unchanged.

    All samples are checked as verify checks them, also those that are not copied: messages are written in
    order of time, so that nobody would see afterwards that time ran backwards.
    """

    def __init__(self, path: Path, robot_joints: tuple[str, ...], choice: Choice) -> None:
        recording = Recording(path, replace(choice, arm=robot_joints), everything=True, wanted=(JOINTS,))
        self._recording = recording
        reading = Reading(recording, robot_joints, people=False)
        self._file = recording.file
        self._stream = JointStream(recording, robot_joints)
        self._waiting = 0
        self.units = JointUnits(robot_joints)
        self.samples = self.left_out = 0
        self.first_ns = reading.joint_span.first_ns
        self.begins_s = self.first_ns / NANO
        self.last_ns = reading.joint_span.last_ns
        self.names = recording.joint_names or robot_joints
        self.assumptions = recording.assumptions

    def items(self, first_ns: int, last_ns: int) -> Iterator[tuple[int, JointState | Commanded | Message]]:
        """Yield the joint samples of ``[first_ns, last_ns]``, and what else was logged between these.

        Raises
        ------
        RecordingError
            A sample anywhere in the file is what verify refuses.
        """
        topics = {channel.topic for channel in self._file.channels.values()} - {PEOPLE_TOPIC, VERDICT_TOPIC}
        for message in self._file.messages(topics):
            sampled = self._checked(message) if message.channel.topic == JOINT_TOPIC else None
            if first_ns <= (message.log_time if sampled is None else sampled) <= last_ns:
                self.samples += sampled is not None
                yield message.log_time, message
            else:
                self.left_out += sampled is not None
        self.units.add(*self._stream.drain())

    def _checked(self, message: Message) -> int | None:
        """Time of a joint message [ns]; ``None``: none of our joints."""
        sampled = self._stream.take(message)
        self._waiting += 1
        if self._waiting >= CHECKED_AT_ONCE:
            self.units.add(*self._stream.drain())
            self._waiting = 0
        return sampled

    def schema(self, message: Message) -> Schema | None:
        """Return the schema of one of the file's messages."""
        return self._file.schemas.get(message.channel.schema_id)


def open_joints(
    path: Path,
    robot: str,
    robot_joints: tuple[str, ...],
    run: int | None,
    choice: Choice = NOTHING_SAID,
) -> JointSource:
    """Open a file of joint motion by its ending; ``choice``: which topics and joints of a bag are meant.

    Raises
    ------
    RecordingError
        The file is of no known kind, is refused, or lacks a joint of the robot.
    """
    if path.suffix == ".npz":
        return TableJoints(read_joint_npz(path, run), robot, robot_joints)
    if run is not None:
        raise RecordingError(path, "", f"has no runs, so no run {run}", "leave --run away")
    if path.name.endswith((".csv", ".csv.gz")):
        return TableJoints(read_joint_csv(path), robot, robot_joints)
    if is_container(path):
        return RecordedJoints(path, robot_joints, choice)
    raise RecordingError(
        path, "", f"is no kind of file that holds joints ({path.suffix or 'no ending'})", KINDS
    )
