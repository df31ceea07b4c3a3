"""What a planner is told of people: where they are, in their rows, and where they are forecast to be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.forecasting.baselines import ConstantVelocity
from modes.forecasting.skeleton import JOINTS
from modes.planning.foresight import OLD_S, Forecasts, Present, last_seen
from modes.twin.people import Stance, Standing, Walking
from occupancy.body import MAX_POINTS, Point
from verifier.proposal import SceneView, SeenPerson

Array = NDArray[np.float64]
WALKING = Walking((2.0, -3.0), (2.0, 3.0), start_s=-1.0, floor_z_m=-0.8)
STANDING = Standing(Stance(-1.0, 0.5, 0.3, -0.8))


def view(t: float, *people: SeenPerson) -> SceneView:
    zero = np.zeros(6)
    return SceneView(t, zero, zero, 0.0, 1.0, 0.0, "EXECUTING", dq_ds=zero, people=people)


def seen(name: str, stamp: float, points: Array) -> SeenPerson:
    there = np.isfinite(points).all(axis=1)
    return SeenPerson(name, np.where(there, stamp, np.nan), points, np.full(MAX_POINTS, 0.01))


def test_points_that_are_old_are_not_planned_with() -> None:
    points = STANDING.at(0.0)
    person = seen("p1", 5.0, points)
    person.t[Point.HEAD] = 5.0 - OLD_S - 0.01
    found = last_seen(view(5.0, person))
    assert np.isnan(found[0, Point.HEAD]).all()
    assert np.array_equal(found[0, Point.PELVIS], points[Point.PELVIS])
    assert Present().frames(view(5.0))[0].shape == (0, MAX_POINTS, 3)
    assert np.isnan(Present().frames(view(20.0, person))[0]).all()


def test_who_walks_straight_on_is_forecast_there_and_who_stands_stays() -> None:
    """Constant velocity: the pelvis of somebody who walks straight moves at their speed."""
    foresight = Forecasts(ConstantVelocity())
    for k in range(45):
        t = k / 15.0
        people = (seen("w", t, WALKING.at(t)), seen("s", t, STANDING.at(t)))
        frames = foresight.frames(view(t + 0.05, *people))
    assert len(frames) == 11 and frames[0].shape == (2, MAX_POINTS, 3)
    for k in range(11):
        truth = WALKING.at(t + 0.1 * k)
        assert frames[k][0, Point.PELVIS] == pytest.approx(truth[Point.PELVIS], abs=0.02)
        assert np.allclose(frames[k][1], STANDING.at(0.0), atol=1e-6)


def test_rows_of_the_same_name_are_followed_apart() -> None:
    foresight = Forecasts(ConstantVelocity())
    for k in range(45):
        t = k / 15.0
        people = (seen("p", t, STANDING.at(t)), seen("p", t, WALKING.at(t)))
        frames = foresight.frames(view(t, *people))
    assert np.allclose(frames[10][0], STANDING.at(0.0), atol=1e-6)
    assert frames[10][1, Point.PELVIS, 1] == pytest.approx(WALKING.at(t + 1.0)[Point.PELVIS, 1], abs=0.02)


def test_hidden_points_go_along_and_are_not_lost() -> None:
    foresight = Forecasts(ConstantVelocity())
    for k in range(45):
        t = k / 15.0
        points = WALKING.at(t)
        if t > 1.5:
            points[[Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP]] = np.nan
        frames = foresight.frames(view(t, seen("p", t, points)))
    hidden, elbow = (
        np.array([frames[k][0, point] - WALKING.at(t + 0.1 * k)[point] for k in range(11)])
        for point in (Point.L_WRIST, Point.L_ELBOW)
    )
    assert np.linalg.norm(hidden[0]) < 0.1
    assert (np.linalg.norm(hidden - elbow, axis=1) < 0.15).all(), "no farther off than what is seen"


def test_somebody_without_a_forecast_stays_where_they_were_seen() -> None:
    head = np.full((MAX_POINTS, 3), math.nan)
    head[Point.HEAD] = 1.0, 2.0, 0.8
    frames = Forecasts(ConstantVelocity()).frames(view(0.1, seen("p", 0.1, head)))
    assert len(frames) == 11
    assert all(np.array_equal(each[0], head, equal_nan=True) for each in frames)


def test_a_clock_that_goes_back_begins_anew() -> None:
    foresight = Forecasts(ConstantVelocity())
    for k in range(45):
        foresight.frames(view(k / 15.0, seen("p", k / 15.0, WALKING.at(k / 15.0))))
    frames = foresight.frames(view(0.0, seen("p", 0.0, STANDING.at(0.0))))
    assert np.allclose(frames[10][0], STANDING.at(0.0), atol=1e-6)


def test_a_forecast_that_is_no_number_holds_people_where_they_are() -> None:
    class Broken:
        name = "broken"

        def forecast(self, history: Array) -> Array:
            return np.full((10, JOINTS, 3), math.nan)

    foresight = Forecasts(Broken())
    for k in range(20):
        frames = foresight.frames(view(k / 15.0, seen("p", k / 15.0, STANDING.at(0.0))))
    assert np.allclose(frames[10][0], STANDING.at(0.0), atol=1e-9)


def test_points_of_the_future_are_not_planned_with() -> None:
    person = seen("p1", 5.0 + OLD_S + 0.01, STANDING.at(0.0))
    assert np.isnan(last_seen(view(5.0, person))).all()


def test_after_a_clock_that_went_back_people_are_followed_anew() -> None:
    foresight = Forecasts(ConstantVelocity())
    foresight.frames(view(1000.0, seen("w", 1000.0, STANDING.at(0.0))))
    for k in range(45):
        t = k / 15.0
        frames = foresight.frames(view(t, seen("w", t, WALKING.at(t))))
    assert frames[10][0, Point.PELVIS] == pytest.approx(WALKING.at(t + 1.0)[Point.PELVIS], abs=0.02)
