"""The sensors of a simulation: they see people late, inexactly and not always, as the cell declares."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS
from occupancy.report import RawMeasurement, RawPerson

Array = NDArray[np.float64]
ALL_MEASURED = (1 << MAX_POINTS) - 1


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """How people are seen.

    Attributes
    ----------
    rate_hz:
        Looks a second.
    latency_s, jitter_s:
        A report arrives ``latency_s`` after the look at least, ``jitter_s`` later at most.
    dropped:
        Share of the reports that get lost.
    position_error_m:
        Largest error of a point.
    stamp_error_s:
        Largest error of a stamp.
    """

    rate_hz: float
    latency_s: float
    jitter_s: float
    dropped: float
    position_error_m: float
    stamp_error_s: float


class Sensors:
    """Looks at people at a steady rate and hands the reports over when they arrive.

    Every report is complete: it lists everybody.
    """

    def __init__(self, settings: SensorSettings, rng: np.random.Generator) -> None:
        self.settings, self._rng = settings, rng
        self._next = 0.0
        self._post: list[RawMeasurement] = []
        self.seen = self.lost = 0

    def look(self, t: float, cycle_s: float, points: Callable[[float], Array]) -> None:
        """Look at what happens in the cycle from ``t`` [s] on; ``points``: bodies (n, 20, 3) [m] so long [s]
        after its begin.
        """
        settings, rng = self.settings, self._rng
        while self._next < t + cycle_s:
            seen, self._next = self._next, self._next + 1.0 / settings.rate_hz
            self.seen += 1
            people = tuple(self._person(number, xyz) for number, xyz in enumerate(points(max(0.0, seen - t))))
            late = settings.latency_s + settings.jitter_s * rng.uniform()
            stamp = seen + settings.stamp_error_s * rng.uniform(-1.0, 1.0)
            if rng.uniform() < settings.dropped:
                self.lost += 1
                continue
            self._post.append(RawMeasurement(stamp, seen + late, "world", True, people))

    def arrived(self, now: float) -> Iterator[RawMeasurement]:
        """Yield the reports that have arrived by ``now`` [s], each once, in the order of their arrival."""
        if not self._post:
            return
        due = sorted((r for r in self._post if r.arrived <= now), key=lambda report: report.arrived)
        if due:
            self._post = [report for report in self._post if report.arrived > now]
        yield from due

    def _person(self, number: int, xyz: Array) -> RawPerson:
        way = self._rng.normal(size=xyz.shape)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        off = self.settings.position_error_m * (1.0 - 1e-9) * self._rng.uniform(size=(MAX_POINTS, 1))
        return RawPerson(f"p{number + 1}", xyz + off * way, np.full(MAX_POINTS, np.nan), ALL_MEASURED)
