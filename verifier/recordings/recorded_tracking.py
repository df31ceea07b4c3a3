"""The tracking error of a recording that holds commands beside positions, whichever file it is."""

from __future__ import annotations

from pathlib import Path

from verifier.recordings.joint_state import NANO
from verifier.recordings.measured_tracking import MeasuredTracking, Samples, measure_tracking
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.motion_mcap import command_samples, joint_samples
from verifier.recordings.recording import Recording
from verifier.recordings.topic import COMMAND_TOPIC


def tracking_of_motion(motion: RecordedMotion) -> MeasuredTracking | None:
    """Return what a table says; ``None``: it has no positions, no commands, or too few of them."""
    if motion.q is None or motion.command_q is None:
        return None
    return measure_tracking(motion.joints, Samples(motion.t, motion.q), Samples(motion.t, motion.command_q))


def tracking_of_recording(recording: Recording) -> MeasuredTracking | None:
    """Return what an MCAP says; ``None``: no named joint has both positions and commands, or too few.

    Raises
    ------
    RecordingError
        Samples or commands cannot be read.
    """
    found = samples_of_recording(recording)
    return None if found is None else measure_tracking(*found)


def samples_of_recording(recording: Recording) -> tuple[tuple[str, ...], Samples, Samples] | None:
    """Return joints, positions and commands on the recording's clock, since its first sample; ``None``: no
    named joint has both.

    Raises
    ------
    RecordingError
        Samples or commands cannot be read.
    """
    if not any(topic.name == COMMAND_TOPIC and topic.messages for topic in recording.topics):
        return None
    joints, commands = command_samples(recording, recording.joint_names)
    if len(commands[0]) < 2:
        return None
    t_ns, q = joint_samples(recording, joints)
    seconds = [(times - t_ns[0]) / NANO for times in (t_ns, commands[0])]
    return joints, Samples(seconds[0], q), Samples(seconds[1], commands[1])


def tracking_of(path: Path) -> MeasuredTracking | None:
    """Return what an MCAP says; ``None``: it has no commands beside positions.

    Raises
    ------
    RecordingError
        It is no recording, or samples or commands cannot be read.
    """
    return tracking_of_recording(Recording(path))
