"""The quick way of taking in a reading does what the general one does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, load_profile
from occupancy.gate_kernels import read_person
from occupancy.hypotheses import READING, Hypotheses
from occupancy.measurement import Gate
from robots.motion import Block
from tests.occupancy.people import settings, standing

Count = Callable[[int], int]
FIELDS = ("n", "person", "present", "t_obs", "xyz", "e_p", "e_read", "v", "e_v")


def a_reading(rng: np.random.Generator, places: np.ndarray, t: float) -> Block:
    """Some points near where they were, now and then one that is too far away."""
    block = np.zeros(1, dtype=READING)
    out = block[0]
    there = rng.random(MAX_POINTS) < 0.8
    out["xyz"] = np.where(there[:, None], places + rng.normal(0.0, 0.01, places.shape), np.nan)
    if rng.random() < 0.05:
        out["xyz"][int(rng.integers(MAX_POINTS))] += rng.uniform(0.5, 3.0)
    out["e_p"] = np.where(there, rng.uniform(0.0, 0.03, MAX_POINTS), np.nan)
    out["present"] = sum(1 << int(p) for p in np.flatnonzero(there))
    out["measured"], out["t_obs"] = out["present"], t
    return block


@pytest.mark.parametrize("profile", ["iso", "tum"])
@pytest.mark.parametrize("trust_sides", [False, True])
def test_rows_are_the_same(profile: str, trust_sides: bool, rng: np.random.Generator, count: Count) -> None:
    limits = load_profile(profile).limits
    agreed = disagreed = 0
    for _ in range(count(300)):
        quick, plain = (
            Hypotheses(limits, 4, clock_error_s=0.001, stamp_error_s=0.002, trust_sides=trust_sides)
            for _ in range(2)
        )
        for each in (quick, plain):
            each.add_person(0)
        places = standing(float(rng.uniform(0.5, 3.0)))
        for i in range(20):
            reading = a_reading(rng, places, 0.05 * i)
            twin = reading.copy()
            found, wanted = quick.take(0, reading), plain.update(0, twin[0])
            assert found == wanted
            for name in FIELDS:
                np.testing.assert_array_equal(quick.people[name], plain.people[name], err_msg=name)
            for name in ("n", "t", "xyz", "e_p"):
                np.testing.assert_array_equal(quick._history[name], plain._history[name], err_msg=name)
            assert (quick.contradicted, quick.overflow) == (plain.contradicted, plain.overflow)
            agreed, disagreed = agreed + (found is None), disagreed + (found is not None)
    assert agreed > disagreed > 0


@pytest.mark.parametrize("rows", [19, 21, 200])
def test_nothing_is_written_beyond_a_reading(rows: int) -> None:
    """Of other than 20 points there is no record: what lies beyond the one at hand stays as it is."""
    profile = load_profile("iso")
    frame = Gate(profile, settings())._frames["world"]
    readings = np.zeros(3, dtype=READING)
    readings[:] = np.frombuffer(bytes([0x5A]) * READING.itemsize, dtype=READING)[0]
    beside = readings[[0, 2]].tobytes()
    xyz, error = np.full((rows, 3), 0.5), np.full(rows, 0.01)
    assert read_person(xyz, error, (1 << MAX_POINTS) - 1, 0.0, frame, profile.limits, readings[1:2]) == 0
    assert readings[[0, 2]].tobytes() == beside
    assert np.isnan(readings[1]["xyz"]).all() and np.isnan(readings[1]["e_p"]).all()
    assert np.isnan(readings[1]["seen"]).all()


@pytest.mark.parametrize("point", range(MAX_POINTS))
@pytest.mark.parametrize("profile", ["iso", "tum"])
def test_whichever_point_disagrees_nothing_is_written_over(profile: str, point: int) -> None:
    """One point is two metres off after 10 ms: the row before stays as it was, beside a new one."""
    limits = load_profile(profile).limits
    kept = Hypotheses(limits, 4, clock_error_s=0.0, stamp_error_s=0.0, trust_sides=True)
    kept.add_person(0)
    first = np.zeros(1, dtype=READING)
    first["xyz"], first["e_p"], first["t_obs"] = standing(), 0.005, 0.0
    first["present"] = first["measured"] = (1 << MAX_POINTS) - 1
    assert kept.take(0, first) is None
    second = first.copy()
    second["t_obs"] = 0.01
    second["xyz"][0, point] += [2.0, 0.0, 0.0]
    assert kept.take(0, second) is not None and kept.contradicted
    rows = kept.people[0]
    assert rows["n"] == 2
    assert any(np.array_equal(rows["xyz"][k], standing()) for k in range(2))
    assert any(np.array_equal(rows["xyz"][k], second["xyz"][0]) for k in range(2))
