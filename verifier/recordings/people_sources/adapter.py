"""What an adapter for reports about people is."""

from __future__ import annotations

from typing import Protocol

from verifier.recordings.decoded import Decoded
from verifier.recordings.people_report import PeopleReport


class PeopleAdapter(Protocol):
    """Says what messages of some types say about people.

    Attributes
    ----------
    schemas:
        Types of the messages, in the spelling of ROS 2.
    """

    schemas: tuple[str, ...]

    def read(self, message: Decoded) -> PeopleReport | None:
        """Read one message, in the frame of the source; ``None``: it says nothing about people.

        Raises
        ------
        SourceError
            What is wrong, and what would be right.
        """
