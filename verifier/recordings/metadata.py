"""The record ``stopproof`` of an MCAP file: what a recording says of itself."""

from __future__ import annotations

from collections.abc import Mapping

from robots.assumption import Assumption, Certainty
from verifier.recordings import json_text
from verifier.recordings.errors import RecordingError, one_line
from verifier.recordings.mcap_file import McapFile

METADATA = "stopproof"
MAX_SHOWN = 200
"""Characters that are shown of metadata that are not what they should be."""


def own_metadata(file: McapFile) -> Mapping[str, str]:
    """Return the record ``stopproof`` of a file; empty without one.

    Raises
    ------
    RecordingError
        There are several, and they do not say the same.
    """
    records = [values for name, values in file.metadata if name == METADATA]
    if any(values != records[0] for values in records):
        wrong, right = "several records contradict each other", "one recording of one robot has one"
        raise RecordingError(file.path, f"metadata {METADATA}", wrong, right)
    return records[0] if records else {}


def noted_assumptions(metadata: Mapping[str, str]) -> tuple[Assumption, ...]:
    """Read the assumptions that an import has noted; what is not readable as such is shown as unreadable."""
    text = metadata.get("assumptions")
    if text is None:
        return ()
    try:
        return tuple(
            Assumption(
                str(entry["name"]),
                entry["value"] if isinstance(entry["value"], float) else str(entry["value"]),
                str(entry["unit"]),
                str(entry["source"]),
                Certainty(entry["certainty"]),
            )
            for entry in json_text.loads(text)
        )
    except (ValueError, LookupError, TypeError, RecursionError):
        shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
        source = "metadata of the file: not a readable list of assumptions"
        return (Assumption("recording.assumptions", one_line(shown), "", source, Certainty.UNVERIFIED),)
