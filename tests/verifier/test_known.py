"""When a report says that nobody is there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from occupancy.body import load_profile
from occupancy.measurement import Gate
from occupancy.report import RawMeasurement
from tests.occupancy.people import settings
from verifier.known import PeopleWatch


def nobody_since(complete: object, frame: str = "world") -> float:
    watch = PeopleWatch(Gate(load_profile("iso"), settings()), 0.25)
    watch.admit(RawMeasurement(5.0, 5.0, frame, complete, ()), 5.0)
    assert watch.known().reported
    return watch.known().nobody_since


@pytest.mark.parametrize("complete", [True, np.bool_(True)])
def test_a_complete_report_that_lists_nobody_counts_from_its_earliest_instant(complete: object) -> None:
    assert nobody_since(complete) == 4.75


@pytest.mark.parametrize("complete", [False, "true", "false", 1, 1.0, math.nan, None])
def test_whatever_else_only_counts_as_true_says_nothing_about_who_is_there(complete: object) -> None:
    assert nobody_since(complete) == -math.inf


def test_a_report_that_cannot_be_used_says_nothing_about_who_is_there() -> None:
    assert nobody_since(True, "nowhere") == -math.inf
