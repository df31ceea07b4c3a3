"""What the brute-force checker is told, and what it answers: people, motions, approaches, contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """A body part: all within ``radius`` [m] of the straight line between points ``start`` and ``end``."""

    name: str
    start: int
    end: int
    radius: float


@dataclass(frozen=True)
class Person:
    """What is true about one person.

    At the instant ``seen`` (P,) [s], point i was within ``slack[i]`` (P,) [m] of ``points[i]`` (P, 3) [m]; no
    point is ever faster than ``speed`` [m/s].
    """

    points: Array
    slack: Array
    seen: Array
    speed: float
    parts: tuple[Segment, ...]

    def growth(self, time: Array) -> Array:
        """How far (T, P) [m] each point may be from ``points`` at the instants ``time`` (T,) [s]."""
        return self.slack + self.speed * np.maximum(time[:, None] - self.seen, 0.0)


@dataclass(frozen=True)
class Motion:
    """What the arm does: joint positions ``q`` (T, n) at the instants ``time`` (T,) [s], at most 1 ms apart.

    ``free``: positions of joints that nobody commands.
    """

    time: Array
    q: Array
    free: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Approach:
    """The closest that anybody can come to a moving link.

    ``slack`` [m]: what is left between the link's surface and the farthest that a body part can get; if it is
    not positive, there is contact. ``sample``: row of the motion; ``share``: place on the part, 0 its start,
    1 its end; ``body_point`` (3,) [m]: where that place was measured.
    """

    slack: float
    sample: int
    time: float
    link: str
    link_point: Array
    person: int
    part: Segment
    share: float
    body_point: Array


@dataclass(frozen=True)
class Contact:
    """A contact that happened in a simulated motion of one person."""

    time: float
    link: str
    part: str
    depth: float
    fastest_point: float
    """Greatest speed of any body point in the simulation [m/s]."""
