"""What an adapter for an arm's joints is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_state import JointState


@dataclass(frozen=True, slots=True)
class JointSample:
    """Where the joints were, and where they were commanded to be at that stamp, if the source says so."""

    state: JointState
    reference: JointState | None = None


class JointAdapter(Protocol):
    """Says what messages of some types say about an arm's joints.

    Attributes
    ----------
    schemas:
        Types of the messages, in the spelling of ROS 2.
    """

    schemas: tuple[str, ...]

    def read(self, message: Decoded) -> JointSample:
        """Read one message.

        Raises
        ------
        SourceError
            What is wrong, and what would be right.
        """
