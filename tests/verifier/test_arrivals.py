"""When a report counts as arrived."""

from __future__ import annotations

import math

import numpy as np
import pytest

from occupancy.report import RawMeasurement
from verifier.arrivals import Arrivals


def raw(stamp: float, arrived: float, frame: str = "world") -> RawMeasurement:
    return RawMeasurement(stamp, arrived, frame, True, ())


def waiting(latency: float) -> Arrivals:
    return Arrivals(latency, lambda report: report.stamp > report.arrived + 0.1)


@pytest.mark.parametrize(
    ("stamp", "arrived", "latency", "known_at"),
    [
        (1.0, 1.03, 0.0, 1.03),  # the message itself came later than the declared latency
        (1.0, 1.03, 0.02, 1.03),
        (1.0, 1.03, 0.05, 1.05),  # the message came sooner than the declared latency allows
        (1.0, 1.0, 0.05, 1.05),
        (1.06, 1.0, 0.05, 1.11),  # stamped ahead, but not by more than the clocks may differ
        (2.0, 1.0, 0.05, 1.0),  # stamped ahead: to refuse it is the gate's business
    ],
)
def test_a_report_counts_from_the_later_of_arrival_and_latency(
    stamp: float, arrived: float, latency: float, known_at: float
) -> None:
    arrivals = waiting(latency)
    arrivals.expect([raw(stamp, arrived)])
    assert list(arrivals.until(np.nextafter(known_at, 0.0))) == []
    assert len(arrivals) == 1
    assert list(arrivals.until(known_at)) == [raw(stamp, arrived)]
    assert list(arrivals.until(100.0)) == []


def test_reports_come_in_the_order_of_their_arrival_and_equal_ones_as_added() -> None:
    arrivals = waiting(0.0)
    late, one, two, early = raw(1.0, 4.0), raw(2.0, 3.0, "one"), raw(1.5, 3.0, "two"), raw(0.5, 1.0)
    arrivals.expect([late, one])
    arrivals.expect([two, early])
    assert list(arrivals.until(3.5)) == [early, one, two]
    assert list(arrivals.until(4.0)) == [late]


@pytest.mark.parametrize(("stamp", "arrived"), [(math.nan, 1.0), (1.0, math.nan)])
def test_times_that_are_no_numbers_come_at_once(stamp: float, arrived: float) -> None:
    arrivals = waiting(0.05)
    arrivals.expect([raw(stamp, arrived)])
    assert len(list(arrivals.until(-1e9))) == 1
