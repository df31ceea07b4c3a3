"""What a recording holds beside joints and people: commands, and the arm's description of itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verifier.recordings.containers.container import Container
from verifier.recordings.decoded import SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.measured_tracking import MeasuredTracking
from verifier.recordings.neutral import Opened
from verifier.recordings.recorded_tracking import tracking_of_recording
from verifier.recordings.recording import Recording
from verifier.recordings.robot_sources.robot_description import SCHEMA, TOPIC, RobotDescription
from verifier.recordings.robot_sources.robot_description import read_description as description_in
from verifier.recordings.topic import COMMAND_TOPIC
from verifier.shown import shown


@dataclass(frozen=True, slots=True)
class Beside:
    """What was found; ``None``: it is not there. ``remarks``: why it could not be read."""

    tracking: MeasuredTracking | None
    description: RobotDescription | None
    remarks: tuple[str, ...]


NOTHING_BESIDE = Beside(None, None, ())


def look_beside(container: Container, opened: Opened) -> Beside:
    """Look for commands and a description; what cannot be read is told, not raised.

    ``opened``: the recording in our words.
    """
    remarks: list[str] = []
    tracking = None
    if any(channel.topic == COMMAND_TOPIC for channel in opened.file.channels.values()):
        try:
            tracking = tracking_of_recording(Recording.of(opened))
        except RecordingError as error:
            remarks.append(f"the tracking error was not measured: {error.place}: {error.wrong}")
    try:
        described = read_description(container)
    except RecordingError as error:
        described = None
        remarks.append(f"{error.place}: {error.wrong}")
    return Beside(tracking, described, tuple(remarks))


def read_description(container: Container) -> RobotDescription | None:
    """Return the first description on ``/robot_description``, also in a namespace; ``None``: there is none.

    Raises
    ------
    RecordingError
        It is no URDF, or there are two that differ.
    """
    found: RobotDescription | None = None
    topics = {topic.name for topic in container.topics if topic.name.endswith(TOPIC)}
    for record in container.records(topics) if topics else ():
        topic = record.channel.topic
        if record.channel.schema != SCHEMA or record.channel.encoding not in ("cdr", "ros1"):
            raise RecordingError(container.path, topic, "is of another type", f"it must be {SCHEMA}")
        try:
            each = description_in(container.decode(record))
        except SourceError as error:
            raise RecordingError(container.path, topic, str(error)) from error
        if found is not None and each.content != found.content:
            raise RecordingError(
                container.path, topic, "describes two arms", "record one arm, or name its URDF"
            )
        found = each
    return found


def tracking_lines(found: MeasuredTracking) -> Iterator[str]:
    """Yield a measured tracking error as text."""
    if found.delay_s is None:
        yield f"tracking error, measured from commands: no one delay explains it; {found.samples} samples"
    else:
        yield (
            f"tracking error, measured from commands: a delay of {1e3 * found.delay_s:.1f} ms explains most "
            f"of it; {found.samples} samples"
        )
    rows = zip(found.joints, found.error, found.at_s, found.without_delay, strict=True)
    for name, error, at, plain in rows:
        without = "" if found.delay_s is None else f", {plain:.3g} without the delay"
        yield f"  {shown(name)}: at most {error:.3g} rad (m where it slides), at {at:.3f} s{without}"
