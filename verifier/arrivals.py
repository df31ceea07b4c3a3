"""Reports about people in the order in which they become known."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator

from occupancy.report import RawMeasurement


def arrival(report: RawMeasurement, latency_s: float, is_ahead: Callable[[RawMeasurement], bool]) -> float:
    """Return when a report becomes known [s]; see :class:`Arrivals`. One without times comes at once."""
    if math.isnan(report.arrived) or math.isnan(report.stamp):
        return -math.inf
    if is_ahead(report):
        return report.arrived
    return max(report.arrived, report.stamp + latency_s)


class Arrivals:
    """Reports that are still to come: each arrives at its message time, but not before stamp + latency.

    Parameters
    ----------
    latency_s:
        Shortest time from seeing to arriving [s].
    is_ahead:
        Whether the gate will refuse a report because its stamp lies ahead of its arrival. To wait for such a
        stamp would hide whoever is in the report, so it arrives at its message time.
    """

    def __init__(self, latency_s: float, is_ahead: Callable[[RawMeasurement], bool]) -> None:
        self._latency_s = latency_s
        self._is_ahead = is_ahead
        self._heap: list[tuple[float, int, RawMeasurement]] = []
        self._expected = 0

    def __len__(self) -> int:
        """How many have not arrived yet."""
        return len(self._heap)

    @property
    def next(self) -> float:
        """When the next of those expected so far arrives [s]; infinite: none."""
        return self._heap[0][0] if self._heap else math.inf

    def expect(self, reports: Iterable[RawMeasurement]) -> None:
        """Add reports; of those that arrive together the one added first comes first.

        A report whose times are not numbers comes at once: to refuse it is the gate's business.
        """
        for report in reports:
            heapq.heappush(
                self._heap, (arrival(report, self._latency_s, self._is_ahead), self._expected, report)
            )
            self._expected += 1

    def until(self, t: float) -> Iterator[RawMeasurement]:
        """Yield the reports that have arrived by ``t`` [s], each once."""
        while self._heap and self._heap[0][0] <= t:
            yield heapq.heappop(self._heap)[2]
