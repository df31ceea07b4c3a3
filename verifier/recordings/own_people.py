"""Our own reports (``stopproof.People``) in the messages of others: as JSON, or as the text of a string."""

from __future__ import annotations

from verifier.recordings import people_schema
from verifier.recordings.decoded import Decoded, SourceError

STRING = "std_msgs/msg/String"
OWN = (people_schema.SCHEMA_NAME, STRING)
"""Types of messages that hold our own reports; text may say anything else as well."""


def own_text(message: Decoded) -> bytes:
    """Return the report in a string, to the letter: what it says is judged later.

    Raises
    ------
    SourceError
        The message holds no text.
    """
    text = getattr(message.value, "data", None)
    if not isinstance(text, str):
        raise SourceError(f"is no {STRING}: it holds no text; a report about people in JSON would be right")
    return text.encode()
