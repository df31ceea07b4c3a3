"""Where people of a file stand, seen from the origin of their frame: a wrong place or axis shows at once."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from verifier.recordings.people_report import ReportedPerson
from verifier.shown import shown

SHOWN = 5
"""Persons who are listed: those who come nearest."""


class Standing:
    """Least and largest height of everybody's points [m], and how near they come to the origin [m]."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], tuple[float, float, float]] = {}

    def add(self, frame: str, person: ReportedPerson) -> None:
        """Take in a person of a report; points that are NaN, infinite or zero are missing."""
        xyz: NDArray[np.float64] = person.xyz[np.isfinite(person.xyz).all(axis=1) & person.xyz.any(axis=1)]
        if not len(xyz):
            return
        low, high, near = self._seen.get((frame, person.id), (math.inf, -math.inf, math.inf))
        away = float(np.hypot(xyz[:, 0], xyz[:, 1]).min())
        heights = xyz[:, 2]
        self._seen[frame, person.id] = (
            min(low, float(heights.min())),
            max(high, float(heights.max())),
            min(near, away),
        )

    def lines(self, origin: str | None = None) -> Iterator[str]:
        """Yield a line for each person, nearest first; ``origin`` says what that of the frame is."""
        nearest = sorted(self._seen.items(), key=lambda each: each[1][2])
        for (frame, person), (low, high, near) in nearest[:SHOWN]:
            away = f"{near:.2f} m from {origin or f'the origin of frame {shown(frame)}'} (seen from above)"
            yield f"{shown(person)}: heights {low:.2f} to {high:.2f} m, nearest {away}"
        if len(nearest) > SHOWN:
            yield f"… and {len(nearest) - SHOWN} more people"
