"""An arm's motion from a recording with messages: joints, commands, and what says when it is to stop."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from verifier.recordings import joint_state
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.mcap_file import Message
from verifier.recordings.motion import (
    FloatArray,
    RecordedMotion,
    StateChannel,
    falling_scale,
    safety_modes,
    stop_flags,
)
from verifier.recordings.recording import Recording
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC

BOOL, FLOAT = "std_msgs/msg/Bool", "std_msgs/msg/Float64"
SAFETY_MODE = "ur_dashboard_msgs/msg/SafetyMode"
FLAG_TOPICS = ("stop", "protective_stop", "emergency_stop")
"""Last parts of the names of topics with a flag that stops the arm …"""
SCALING_TOPIC = "speed_scaling"
"""… and with its speed scaling."""

HEAD = {"cdr": joint_state.ENCAPSULATION, "ros1": 0}
"""Encodings of messages, and how many bytes of each stand before the first field."""
_BYTE, _DOUBLE = struct.Struct("<B"), {0: struct.Struct(">d"), 1: struct.Struct("<d")}
_Decode = Callable[[bytes, bytes], float]
"""From what stands before the first field, and what follows, to a number."""
_Maker = Callable[[str, FloatArray, FloatArray], StateChannel]


def read_mcap(
    path: Path, robot_joints: tuple[str, ...] | None, choice: Choice = NOTHING_SAID
) -> RecordedMotion:
    """Read a recording; ``robot_joints``: those of the arm, ``None``: all that the messages name.

    Raises
    ------
    RecordingError
        The recording is refused as ``verify`` refuses it, or a message on a topic that is read is damaged.
    """
    arm = robot_joints or choice.arm
    recording = Recording(path, replace(choice, arm=arm), everything=True)
    joints = robot_joints or recording.joint_names
    if not joints:
        raise RecordingError(
            path, JOINT_TOPIC, "does not name its joints", "say which robot it is, with --robot"
        )
    t_ns, q = joint_samples(recording, joints)
    t = (t_ns - t_ns[0]) / NANO
    notes = [] if recording.joint_names else ["joints are not named: taken in the order of the model"]
    command = _commands(recording, joints, t_ns)
    return RecordedMotion(
        path, recording.robot, joints, t, q, None, command, None, _states(recording, t_ns), tuple(notes)
    )


def joint_samples(recording: Recording, joints: tuple[str, ...]) -> tuple[np.ndarray, FloatArray]:
    """Return times (T,) [ns] and positions (T, J) of ``joints``.

    Raises
    ------
    RecordingError
        None of them is there, or a sample is refused.
    """
    stream = JointStream(recording, joints)
    for message in recording.file.messages([JOINT_TOPIC]):
        stream.take(message)
    t_ns, q = stream.drain()
    if not len(t_ns):
        raise RecordingError(
            recording.path,
            JOINT_TOPIC,
            f"has none of {', '.join(joints)} (it has {', '.join(recording.joint_names)})",
            "choose the robot that was recorded",
        )
    return t_ns, q


def _commands(recording: Recording, joints: tuple[str, ...], t_ns: np.ndarray) -> FloatArray | None:
    """Positions commanded at or before each sample (T, J); ``None``: no commands for all of it."""
    named, (stamps, rows) = command_samples(recording, joints)
    if named != joints or not len(stamps) or stamps[0] > t_ns[0]:
        return None
    return rows[np.searchsorted(stamps, t_ns, side="right") - 1]


def command_samples(
    recording: Recording, joints: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[np.ndarray, FloatArray]]:
    """Return which of ``joints`` are commanded, when (K,) [ns] and where to (K, J); nothing, where commands
    are not finite or do not increase in time.

    Raises
    ------
    RecordingError
        A message cannot be read.
    """
    named = commanded_joints(recording, joints)
    messages = recording.file.messages([COMMAND_TOPIC])
    found = [each for message in messages if (each := command_of(recording, message, named)) is not None]
    stamps, rows = [stamp for stamp, _ in found], [row for _, row in found]
    if not rows or (np.diff(stamps) <= 0).any() or not np.isfinite(rows).all():
        return named, (np.zeros(0, np.int64), np.zeros((0, len(named))))
    return named, (np.array(stamps), np.array(rows))


def commanded_joints(recording: Recording, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return which of ``joints`` the first command that has any of them is for.

    Raises
    ------
    RecordingError
        A message cannot be read.
    """
    for message in recording.file.messages([COMMAND_TOPIC]):
        with _decoding(recording, message):
            names = joint_state.decode(message.data).names
        named = tuple(name for name in joints if name in names)
        if named:
            return named
    return ()


def command_of(
    recording: Recording, message: Message, joints: tuple[str, ...]
) -> tuple[int, FloatArray] | None:
    """Return when [ns] and where to (J,) ``joints`` are commanded; ``None``: the message is for others.

    Raises
    ------
    RecordingError
        The message cannot be read.
    """
    with _decoding(recording, message):
        state = joint_state.decode(message.data)
    if not joints or not set(joints) <= set(state.names) or len(state.position) != len(state.names):
        return None
    position = state.position[[state.names.index(name) for name in joints]]
    return state.stamp_ns or message.log_time, position


@contextmanager
def _decoding(recording: Recording, message: Message) -> Iterator[None]:
    """Turn what decoding raises into the refusal of a recording."""
    try:
        yield
    except (joint_state.CdrError, struct.error, IndexError) as error:
        place = f"{message.channel.topic}, message at {message.log_time} ns"
        raise RecordingError(
            recording.path, place, f"cannot be read ({error})", "it must be plain CDR"
        ) from error


def _states(recording: Recording, t_ns: np.ndarray) -> tuple[StateChannel, ...]:
    return tuple(
        maker(topic, np.array([(at - t_ns[0]) / NANO for at, _ in values]), np.array([v for _, v in values]))
        for topic, maker, decode in _wanted(recording)
        if (values := list(_decoded(recording, topic, decode)))
    )


def _wanted(recording: Recording) -> Iterator[tuple[str, _Maker, _Decode]]:
    """Topics that say when the arm is to stop, what they make, and how they are read."""
    for entry in recording.topics:
        last = entry.name.rsplit("/", 1)[-1]
        if entry.encoding not in HEAD or not entry.messages:
            continue
        if entry.schema == SAFETY_MODE:
            yield entry.name, safety_modes, _byte
        elif entry.schema == BOOL and last in FLAG_TOPICS:
            yield entry.name, _flags, _byte
        elif entry.schema == FLOAT and last == SCALING_TOPIC:
            yield entry.name, falling_scale, _double


def _decoded(recording: Recording, topic: str, decode: _Decode) -> Iterable[tuple[int, float]]:
    for message in recording.file.messages([topic]):
        with _decoding(recording, message):
            start = HEAD[message.channel.message_encoding]
            value = decode(message.data[:start], message.data[start:])
        yield message.log_time, value


def _flags(name: str, t: FloatArray, flags: FloatArray) -> StateChannel:
    return stop_flags(name, t, flags != 0.0)


def _byte(_head: bytes, body: bytes) -> float:
    return float(_BYTE.unpack_from(body)[0])


def _double(head: bytes, body: bytes) -> float:
    little = not head or head[1] & 1
    return float(_DOUBLE[int(little)].unpack_from(body)[0])
