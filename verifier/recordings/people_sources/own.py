"""Our own reports (``stopproof.People``): as JSON messages, or as text in ``std_msgs/msg/String``."""

from __future__ import annotations

import json

from verifier.recordings import people_report, people_schema
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_report import PeopleReport, ReportError

STRING = "std_msgs/msg/String"


class OwnPeople:
    """Reports in our own words."""

    schemas: tuple[str, ...] = (people_schema.SCHEMA_NAME, STRING)

    def read(self, message: Decoded) -> PeopleReport | None:
        """Read one report.

        Raises
        ------
        SourceError
            It is none.
        """
        try:
            return people_report.decode(own_json(message), message.log_time_ns)
        except ReportError as error:
            raise SourceError(f"is no {people_schema.SCHEMA_NAME}: {error}") from error


def own_json(message: Decoded) -> bytes:
    """Return the text of one of our own reports, which is kept to the letter: what it says is judged later.

    Raises
    ------
    SourceError
        The message holds no text.
    """
    if message.schema == STRING:
        text = getattr(message.value, "data", None)
        if not isinstance(text, str):
            raise SourceError(f"is no {STRING}")
        return text.encode()
    return json.dumps(message.value).encode()
