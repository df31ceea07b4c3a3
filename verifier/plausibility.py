"""Where people were in the world: a wrong pose, unit or axis shows before a verdict is believed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, POINT_NAMES, Point
from occupancy.conformance import LaterSamples
from occupancy.report import Refusal, RefusalReason
from verifier.reports.stretches import runs

Array = NDArray[np.float64]

STILL_S = 0.5
"""Coordinates that are exactly those of longer before than this [s] are more likely held than measured."""
FAR_M = 30.0
"""Somebody who never comes nearer than this [m] is more likely in another unit or frame."""
SHOWN = 5
"""Lines of one kind; a tracker that gives everybody a new name each second would fill pages."""
UPRIGHT = 0.3
"""Sine of the least angle between the ground and the line from the legs to the head of somebody upright."""
_KEY = 'refused as not measured; if it was (a simulation, rounding): people.repeated_points = "measured"'
LOW = (Point.PELVIS, Point.L_HIP, Point.R_HIP, Point.L_KNEE, Point.R_KNEE, Point.L_ANKLE, Point.R_ANKLE)
"""Points below the head of a person who stands or sits."""


@dataclass
class _Seen:
    lowest: float = math.inf
    highest: float = -math.inf
    nearest: float = math.inf
    compared: int = 0
    upright: int = 0
    refused: bool = False
    still: Array = field(default_factory=lambda: np.full(MAX_POINTS, np.nan))
    """How long before (20,) [s] a point had the coordinates that it has again, at most; NaN: never seen."""


class Whereabouts:
    """Collects where people were seen, window by window."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}

    def add(self, person: str, samples: LaterSamples, base: Array) -> None:
        """Take in samples of a person; ``base`` (3,) [m]: origin of the robot in the world."""
        seen = self._seen.setdefault(person, _Seen())
        xyz = samples.xyz
        there: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(xyz), axis=2)
        if not there.any():
            return
        heights = xyz[..., 2][there]
        seen.lowest = min(seen.lowest, float(heights.min()))
        seen.highest = max(seen.highest, float(heights.max()))
        away = np.linalg.norm(xyz[..., :2] - base[:2], axis=2)[there]
        seen.nearest = min(seen.nearest, float(away.min()))
        low: NDArray[np.bool_] = there[:, list(LOW)]
        both: NDArray[np.bool_] = there[:, Point.HEAD] & low.any(axis=1)
        middle = np.where(low[..., None], xyz[:, list(LOW)], 0.0).sum(axis=1)[both]
        middle /= low.sum(axis=1)[both, None]
        up = xyz[both, Point.HEAD] - middle
        seen.compared += len(up)
        seen.upright += int((up[:, 2] > UPRIGHT * np.linalg.norm(up, axis=1)).sum())

        self._add_still(seen, samples, there)

    def add_repeats(self, refusals: Iterable[Refusal]) -> None:
        """Take in what was refused because it stood exactly where it had stood before."""
        for refusal in refusals:
            if refusal.reason is RefusalReason.REPEATED and refusal.point is not None:
                seen = self._seen.setdefault(refusal.person, _Seen())
                seen.refused, still = True, seen.still
                still[refusal.point] = max(refusal.stamp - refusal.value, np.nan_to_num(still[refusal.point]))

    def _add_still(self, seen: _Seen, samples: LaterSamples, there: NDArray[np.bool_]) -> None:
        same: NDArray[np.bool_] = np.logical_and.reduce(samples.xyz[1:] == samples.xyz[:-1], axis=2)
        for point in np.flatnonzero(there.any(axis=0)):
            times = [samples.t[end] - samples.t[begin] for begin, end in runs(same[:, point])]
            seen.still[point] = max(0.0, *times, np.nan_to_num(seen.still[point]))

    def lines(self) -> Iterator[str]:
        """Yield what a reader should compare with the cell, and what can hardly be right.

        Of each kind of line there are at most ``SHOWN``, of those who came nearest to the robot.
        """
        readable = [(who, seen) for who, seen in self._seen.items() if math.isfinite(seen.nearest)]
        by_distance = sorted(readable, key=lambda each: each[1].nearest)
        for kind in (_place_lines, _posture_lines, _still_lines, _distance_lines):
            found = [line for who, seen in by_distance for line in kind(who, seen)]
            yield from found[:SHOWN]
            if len(found) > SHOWN:
                yield f"… and {len(found) - SHOWN} more like these"


def _place_lines(person: str, seen: _Seen) -> Iterator[str]:
    yield (
        f"{person} in the world: heights {seen.lowest:.2f} to {seen.highest:.2f} m, nearest "
        f"{seen.nearest:.2f} m from the robot's base (seen from above)"
    )


def _posture_lines(person: str, seen: _Seen) -> Iterator[str]:
    if seen.compared and seen.upright < 0.5 * seen.compared:
        share = 1.0 - seen.upright / seen.compared
        yield (
            f"{person}: the head is not above pelvis and legs in {share:.0%} of the readings; is z "
            "up, and are the frame's rpy_deg in degrees?"
        )


def _distance_lines(person: str, seen: _Seen) -> Iterator[str]:
    if seen.nearest > FAR_M:
        yield f"{person}: never nearer than {seen.nearest:.0f} m; are all poses in m, and of one frame?"


def _still_lines(person: str, seen: _Seen) -> Iterator[str]:
    """Yield what a tracker seems to have held: real coordinates have noise."""
    held = [point for point in Point if seen.still[point] > STILL_S]
    if not held:
        return
    longest = max(float(seen.still[point]) for point in held)
    if len(held) == int(np.isfinite(seen.still).sum()):
        unchanged = f"every point stood exactly where it had stood up to {longest:.2f} s before"
        yield f"{person}: {unchanged}; is the stream frozen?{_and_then(seen)}"
        return
    names = ", ".join(POINT_NAMES[point] for point in held)
    unchanged = f"{names} stood exactly where it had stood up to {longest:.2f} s before"
    yield f"{person}: {unchanged}; held by the tracker, not measured?{_and_then(seen)}"


def _and_then(seen: _Seen) -> str:
    """What became of coordinates that did not change."""
    return f" {_KEY}" if seen.refused else ""
