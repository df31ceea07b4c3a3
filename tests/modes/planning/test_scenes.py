"""Trials of the planner: the same for the same seed, and what they are said to be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from modes.planning.arrt import Planner
from modes.planning.potential_field import Field
from modes.planning.scenes import FRAMES, KINDS, ROBOT, Scene, scenes
from occupancy.body import Point, load_profile
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.gaps import least_gaps

PROFILE = load_profile("iso")


@pytest.fixture(scope="module")
def trials(arm: Callable[[str], RobotModel]) -> tuple[Field, list[Scene]]:
    field = Field(arm(ROBOT))
    return field, scenes(field, PROFILE)


def test_the_same_seed_draws_the_same_scenes(trials: tuple[Field, list[Scene]]) -> None:
    field, first = trials
    for a, b in zip(scenes(field, PROFILE, 7), first[:7], strict=True):
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_array_equal(a.start, b.start)
    other = scenes(field, PROFILE, 7, seed=1)
    assert all(
        a.frames.shape != b.frames.shape or (a.frames != b.frames).any()
        for a, b in zip(other, first[:7], strict=True)
    )


def test_people_stand_walk_and_are_partly_seen(trials: tuple[Field, list[Scene]]) -> None:
    for k, scene in enumerate(trials[1]):
        assert scene.kind == KINDS[k % 3] and scene.frames.shape[0] == FRAMES
        pelvis = scene.frames[:, 0, Point.PELVIS]
        speed = float(np.linalg.norm(pelvis[-1] - pelvis[0])) / (0.1 * (FRAMES - 1))
        assert (0.2 <= speed <= 0.8) if scene.kind == "passing" else speed <= 0.1
        assert np.isnan(scene.frames).any() == (scene.kind == "occluded")


def test_most_places_are_free_and_most_straight_ways_are_not(trials: tuple[Field, list[Scene]]) -> None:
    """By other means: at nine of ten starts and goals nobody is near, and half way somebody is in most."""
    field, free, blocked = trials[0], 0, 0
    for scene in trials[1]:
        bodies = scene.bodies(PROFILE)
        ends = least_gaps(field.robot, np.array([scene.start, scene.goal]), bodies)
        free += bool((ends >= 0.25).all())
        goal = Planner(field).goals(scene.start, scene.goal)[0]
        line = scene.start + np.linspace(0.0, 1.0, 9)[:, None] * (goal - scene.start)
        blocked += bool((ends >= 0.25).all()) and bool(least_gaps(field.robot, line, bodies).min() < 0.245)
    assert 0.9 * len(trials[1]) <= free < len(trials[1])
    assert blocked >= 0.6 * len(trials[1])


@pytest.mark.parametrize(("count", "seed", "named"), [(0, 0, "count"), (3, -1, "seed")])
def test_what_cannot_be_drawn_is_refused(
    count: int, seed: int, named: str, trials: tuple[Field, list[Scene]]
) -> None:
    with pytest.raises(SetupError, match=f"scenes: {named}"):
        scenes(trials[0], PROFILE, count, seed)
