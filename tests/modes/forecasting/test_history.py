"""Measurements that come at odd times, against what one who moves straight did."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.forecasting.history import History, Taken
from occupancy.body import Point
from robots.errors import SetupError

Array = NDArray[np.float64]


def straight(t: float) -> Array:
    """Points that each go their own way at their own speed."""
    k = np.arange(20.0)[:, None]
    return np.asarray(
        np.concatenate((k, 0.1 * k, 1.0 - 0.0 * k), axis=1) + t * np.array([0.3, -1.0, 0.05]) * (1.0 + k)
    )


def test_a_gap_out_of_range_is_refused() -> None:
    with pytest.raises(SetupError, match="longest_gap_s = 0"):
        History(0)


def test_what_is_no_news_is_said_and_changes_nothing() -> None:
    history = History()
    assert history.add(1.0, np.full((20, 3), np.nan)) is Taken.NO_POINT
    assert history.add(float("nan"), straight(0.0)) is Taken.STAMP_NOT_FINITE
    assert history.add(1.0, straight(0.0)[:14]) is Taken.OTHER_SHAPE
    assert len(history) == 0 and np.isnan(history.newest) and np.isnan(history.points()).all()
    assert history.add(1.0, straight(1.0)) is Taken.TAKEN
    before = history.points()
    for stamp in (1.0, 0.5, -1.0):
        assert history.add(stamp, straight(9.0)) is Taken.NOT_NEWER
    assert np.array_equal(history.points(), before, equal_nan=True) and history.newest == 1.0


def test_jittered_measurements_are_where_the_person_was(rng: np.random.Generator) -> None:
    for _ in range(20):
        history, t = History(), 100.0
        for _ in range(200):
            history.add(t, straight(t))
            t += float(rng.uniform(0.005, 0.09))
        at = history.newest + 0.1 * np.arange(-29, 1)
        assert np.allclose(history.points(), np.stack([straight(each) for each in at]), atol=1e-9)


def test_one_measurement_is_the_newest_frame_only() -> None:
    history = History()
    history.add(3.0, straight(3.0))
    found = history.points()
    assert np.array_equal(found[-1], straight(3.0)) and np.isnan(found[:-1]).all()


def test_across_a_gap_and_before_the_first_nothing_was_seen() -> None:
    history = History(longest_gap_s=0.2)
    for t in (*np.arange(1.0, 2.0, 0.05), *np.arange(2.5, 3.0, 0.05)):
        history.add(float(t), straight(float(t)))
    at = history.newest + 0.1 * np.arange(-29, 1)
    inside = ((at >= 1.0) & (at <= 1.95 + 1e-9)) | (at >= 2.5 - 1e-9)
    found = history.points()
    assert np.allclose(found[inside], np.stack([straight(each) for each in at[inside]]), atol=1e-9)
    assert np.isnan(found[~inside]).all()


def test_each_point_has_gaps_of_its_own() -> None:
    history = History()
    for k in range(100):
        points = straight(0.03 * k)
        if 60 <= k < 80:
            points[Point.L_WRIST, 1] = np.nan
        history.add(0.03 * k, points)
    found = history.points()
    at = history.newest + 0.1 * np.arange(-29, 1)
    hidden = (at > 0.03 * 59 + 1e-9) & (at < 0.03 * 80 - 1e-9)
    assert np.isnan(found[hidden][:, Point.L_WRIST]).all() and hidden.sum() >= 5
    assert np.isfinite(found[~hidden & (at >= 0.0)]).all()
    assert np.isfinite(found[hidden][:, Point.R_WRIST]).all()


def test_what_is_older_than_needed_is_forgotten() -> None:
    history = History()
    for k in range(1000):
        history.add(0.01 * k, straight(0.01 * k))
    assert len(history) < 330
