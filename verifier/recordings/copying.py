"""Copying a recording with verdicts added."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from pathlib import Path
from typing import Any

from verifier.recordings.mcap_file import Message
from verifier.recordings.recording import Recording
from verifier.recordings.recording_writer import new_recording
from verifier.recordings.topic import VERDICT_TOPIC


def copy_with_verdicts(
    recording: Recording,
    out: str | Path,
    verdicts: Iterable[tuple[int, Mapping[str, Any]]],
    *,
    force: bool = False,
) -> None:
    """Copy a recording with all that is in it and add ``/verdict``; verdicts of an earlier run are replaced.

    Parameters
    ----------
    recording:
        What to copy.
    out:
        The new file.
    verdicts:
        Time of the cycle [ns, as in the recording] and its verdict, in order of time; NaN has no place in
        JSON.
    force:
        Overwrite ``out`` if it is there.

    Raises
    ------
    OutputExistsError, RecordingError
        ``out`` is there or cannot be written, or the recording is damaged.
    """
    file = recording.file
    topics = {channel.topic for channel in file.channels.values()} - {VERDICT_TOPIC}
    old: Iterator[tuple[int, Message | Mapping[str, Any]]] = (
        (message.log_time, message) for message in file.messages(topics)
    )
    with new_recording(out, force=force) as writer:
        for name, values in file.metadata:
            writer.copy_metadata(name, values)
        for attachment in file.attachments():
            writer.copy_attachment(attachment)
        for time_ns, item in heapq.merge(old, verdicts, key=itemgetter(0)):
            if isinstance(item, Message):
                writer.copy(item, file.schemas.get(item.channel.schema_id))
            else:
                writer.verdict(time_ns, item)
