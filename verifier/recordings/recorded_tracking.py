"""The tracking error of a recording that holds commands beside positions, whichever file it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from verifier.recordings.joint_state import NANO
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.measured_tracking import (
    LONGEST_DELAY_S,
    LONGEST_STEP_S,
    FloatArray,
    MeasuredTracking,
    Samples,
    measure_blocks,
    measure_tracking,
)
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.motion_mcap import command_of, commanded_joints
from verifier.recordings.recording import Recording
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC

BLOCK_SAMPLES = 20_000
"""Samples of joints that are looked at together."""


def tracking_of_motion(motion: RecordedMotion) -> MeasuredTracking | None:
    """Return what a table says; ``None``: it has no positions, no commands, or too few of them."""
    if motion.q is None or motion.command_q is None:
        return None
    return measure_tracking(motion.joints, Samples(motion.t, motion.q), Samples(motion.t, motion.command_q))


def tracking_of_recording(recording: Recording) -> MeasuredTracking | None:
    """Return what a recording says; ``None``: no named joint has both positions and commands, or too few.

    Raises
    ------
    RecordingError
        Samples or commands cannot be read.
    """
    stretches = CommandedStretches.of(recording)
    return None if stretches is None else measure_blocks(stretches.joints, lambda: stretches)


class CommandedStretches:
    """Positions beside commands of a recording, stretch by stretch, in s since its first sample.

    Iterating may raise RecordingError: samples or commands cannot be read.

    Attributes
    ----------
    joints:
        Those that are commanded.
    """

    def __init__(self, recording: Recording, joints: tuple[str, ...], before_s: float) -> None:
        self._recording = recording
        self._before_s = before_s
        self.joints = joints

    @classmethod
    def of(cls, recording: Recording, longest_delay_s: float = LONGEST_DELAY_S) -> CommandedStretches | None:
        """Return the stretches, with the commands of ``longest_delay_s`` [s] before each.

        ``None``: no named joint has both, or commands are no numbers, fewer than two, or do not increase in
        time.

        Raises
        ------
        RecordingError
            Commands cannot be read.
        """
        if not any(topic.name == COMMAND_TOPIC and topic.messages for topic in recording.topics):
            return None
        joints = commanded_joints(recording, recording.joint_names)
        last, commands = -(2**63), 0
        for message in recording.file.messages([COMMAND_TOPIC]):
            found = command_of(recording, message, joints)
            if found is None:
                continue
            if found[0] <= last or not np.isfinite(found[1]).all():
                return None
            last, commands = found[0], commands + 1
        return cls(recording, joints, longest_delay_s + LONGEST_STEP_S) if joints and commands > 1 else None

    def __iter__(self) -> Iterator[tuple[Samples, Samples]]:
        """Yield measured samples, and the commands around them."""
        stream, commands = (
            JointStream(self._recording, self.joints),
            _Commands(len(self.joints), self._before_s),
        )
        t, q = np.zeros(0), np.zeros((0, len(self.joints)))
        waiting, origin = 0, None
        for message in self._recording.file.messages([JOINT_TOPIC, COMMAND_TOPIC]):
            if message.channel.topic == COMMAND_TOPIC:
                commands.add(command_of(self._recording, message, self.joints))
                continue
            waiting += stream.take(message) is not None
            if waiting >= BLOCK_SAMPLES:
                origin, t, q = _joined(origin, t, q, stream)
                now = int(np.searchsorted(t, commands.until(origin), side="right"))
                now = len(t) if len(t) > 2 * BLOCK_SAMPLES else now  # commands that ended, or are late
                if now:
                    yield Samples(t[:now], q[:now]), commands.since(origin, t[0])
                t, q, waiting = t[now:], q[now:], 0
        origin, t, q = _joined(origin, t, q, stream)
        if len(t):
            yield Samples(t, q), commands.since(origin, t[0])


def _joined(
    origin: int | None, t: FloatArray, q: FloatArray, stream: JointStream
) -> tuple[int, FloatArray, FloatArray]:
    """Samples that wait, and those that have come since, from the first of all on."""
    t_ns, more = stream.drain()
    if origin is None:
        origin = int(t_ns[0]) if len(t_ns) else 0
    return origin, np.concatenate([t, (t_ns - origin) / NANO]), np.concatenate([q, more])


class _Commands:
    """The commands of the last stretch and since."""

    def __init__(self, joints: int, before_s: float) -> None:
        self._before_s = before_s
        self._t_ns: list[int] = []
        self._rows: list[FloatArray] = []
        self._joints = joints

    def add(self, found: tuple[int, FloatArray] | None) -> None:
        """Take in a command."""
        if found is not None:
            self._t_ns.append(found[0])
            self._rows.append(found[1])

    def until(self, origin: int) -> float:
        """Time of the last command [s]."""
        return (self._t_ns[-1] - origin) / NANO if self._t_ns else -np.inf

    def since(self, origin: int, begin: float) -> Samples:
        """Return the commands from a little before ``begin`` [s] on, and forget those before."""
        t = (np.array(self._t_ns, np.int64) - origin) / NANO
        first = max(0, int(np.searchsorted(t, begin - self._before_s)) - 1)
        self._t_ns, self._rows = self._t_ns[first:], self._rows[first:]
        rows = np.array(self._rows) if self._rows else np.zeros((0, self._joints))
        return Samples(t[first:], rows)
