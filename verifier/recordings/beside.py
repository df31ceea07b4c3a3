"""What a recording holds beside joints and people: commands, and the arm's description of itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verifier.recordings.decoded import SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.measured_tracking import MeasuredTracking
from verifier.recordings.recorded_tracking import tracking_of
from verifier.recordings.robot_sources.robot_description import (
    SCHEMA,
    TOPIC,
    RobotDescription,
    description,
    text_of_cdr,
)
from verifier.recordings.topic import COMMAND_TOPIC
from verifier.shown import shown


@dataclass(frozen=True, slots=True)
class Beside:
    """What was found; ``None``: it is not there. ``remarks``: why it could not be read."""

    tracking: MeasuredTracking | None
    description: RobotDescription | None
    remarks: tuple[str, ...]


NOTHING_BESIDE = Beside(None, None, ())


def look_beside(file: McapFile) -> Beside:
    """Look for commands and a description; what cannot be read is told, not raised."""
    remarks: list[str] = []
    tracking = None
    if any(channel.topic == COMMAND_TOPIC for channel in file.channels.values()):
        try:
            tracking = tracking_of(file.path)
        except RecordingError as error:
            remarks.append(f"the tracking error was not measured: {error.place}: {error.wrong}")
    try:
        described = read_description(file)
    except RecordingError as error:
        described = None
        remarks.append(f"{TOPIC}: {error.wrong}")
    return Beside(tracking, described, tuple(remarks))


def read_description(file: McapFile) -> RobotDescription | None:
    """Return the first description on ``/robot_description``; ``None``: there is none.

    Raises
    ------
    RecordingError
        It is no URDF, or there are two that differ.
    """
    found: RobotDescription | None = None
    for message in file.messages([TOPIC]):
        schema = file.schemas.get(message.channel.schema_id)
        if message.channel.message_encoding != "cdr" or schema is None or schema.name != SCHEMA:
            raise RecordingError(file.path, TOPIC, "is of another type", f"it must be {SCHEMA} in cdr")
        try:
            each = description(text_of_cdr(message.data))
        except SourceError as error:
            raise RecordingError(file.path, TOPIC, str(error)) from error
        if found is not None and each.content != found.content:
            raise RecordingError(file.path, TOPIC, "describes two arms", "record one arm, or name its URDF")
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
