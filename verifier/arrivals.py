"""Reports about people in the order in which they become known."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator

from occupancy.report import RawMeasurement


class Arrivals:
    """Reports that are still to come: each arrives at its message time, but not before stamp + latency.

    Parameters
    ----------
    latency_s:
        Shortest time from seeing to arriving [s].
    """

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._heap: list[tuple[float, int, RawMeasurement]] = []
        self._expected = 0

    def expect(self, reports: Iterable[RawMeasurement]) -> None:
        """Add reports; of those that arrive together the one added first comes first.

        A report whose times are not numbers comes at once: to refuse it is the gate's business.
        """
        for report in reports:
            arrival = max(report.arrived, report.stamp + self._latency_s)
            if math.isnan(report.arrived) or math.isnan(report.stamp):
                arrival = -math.inf
            heapq.heappush(self._heap, (arrival, self._expected, report))
            self._expected += 1

    def until(self, t: float) -> Iterator[RawMeasurement]:
        """Yield the reports that have arrived by ``t`` [s], each once."""
        while self._heap and self._heap[0][0] <= t:
            yield heapq.heappop(self._heap)[2]
