"""What a recording of joints and people is read from, window by window."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

from verifier.recordings.window import Window


class JointPosition(NamedTuple):
    """One joint in one sample: its name, time [s] and position [rad or m]."""

    joint: str
    t: float
    q: float


class Windowed(Protocol):
    """A recording that can be read more than once."""

    @property
    def path(self) -> Path:
        """Its name."""
        ...

    @property
    def overlap(self) -> tuple[float, float]:
        """First and last instant [s] at which joints and people are known."""
        ...

    def windows(self, length_s: float, before_s: float, after_s: float) -> Iterator[Window]:
        """Yield the recording in windows."""
        ...

    def positions_of(self, joints: Collection[str]) -> Iterator[JointPosition]:
        """Yield what the whole recording says of these joints, which the windows leave out."""
        ...
