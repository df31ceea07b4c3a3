"""Lines and curves past balls that are put where the arm passes: what is said to be clear is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.motion import motion_along
from modes.planning.potential_field import Bodies, Field, FieldSettings
from robots.model import RobotModel
from tests.modes.planning.gaps import least_gaps, placed
from tests.modes.planning.test_potential_field import configurations

Array = NDArray[np.float64]
WANTED_M, SLACK_M = 0.1, 0.005


def beside(robot: RobotModel, q: Array, rng: np.random.Generator, frames: int) -> Bodies:
    """A ball 0.1 to 0.4 m beside a joint at ``q`` (n,), which is elsewhere in each frame but one."""
    place = placed(robot, q[None])[1][int(rng.integers(2, len(q)))][0]
    away = rng.normal(size=3)
    away *= rng.uniform(0.1, 0.4) / np.linalg.norm(away)
    centre = np.tile(place + away, (frames, 1)) + rng.normal(scale=0.4, size=(frames, 3))
    centre[int(rng.integers(frames))] = place + away
    return Bodies(centre[:, None], centre[:, None], np.array([0.05]))


@pytest.mark.parametrize("frames", [1, 4])
@pytest.mark.parametrize("name", ["ur16e", "panda"])
def test_lines_that_are_said_to_be_clear_are(
    name: str,
    frames: int,
    arm: Callable[[str], RobotModel],
    rng: np.random.Generator,
    count: Callable[[int], int],
) -> None:
    field, told = Field(arm(name), FieldSettings(clearance_m=WANTED_M)), set()
    for _ in range(count(10_000)):
        a, b = configurations(field.robot, rng, 2)
        b = a + rng.uniform(0.1, 1.0) * (b - a)
        bodies = beside(field.robot, a + rng.uniform(0.0, 1.0) * (b - a), rng, frames)
        q = a + np.linspace(0.0, 1.0, 81)[:, None] * (b - a)
        least = float(least_gaps(field.robot, q, bodies).min())
        said = field.is_clear_between(a, b, bodies, SLACK_M)
        told.add(said)
        assert least >= WANTED_M - SLACK_M if said else least < WANTED_M + 0.01
    assert told == {True, False}


@pytest.mark.parametrize("frames", [1, 4])
def test_curves_that_are_said_to_be_clear_are(
    frames: int, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    field, told = Field(arm("ur16e"), FieldSettings(clearance_m=WANTED_M)), set()
    for _ in range(count(4000)):
        points = configurations(field.robot, rng, 1) + np.cumsum(0.4 * rng.normal(size=(3, 6)), axis=0)
        motion = motion_along(points, field.robot.limits)
        q = motion.sample(np.linspace(0.0, motion.s_end, 201))[0]
        bodies = beside(field.robot, q[int(rng.integers(len(q)))], rng, frames)
        least = float(least_gaps(field.robot, q, bodies).min())
        said = field.is_clear_along(motion, bodies, 2.0 * SLACK_M)
        told.add(said)
        assert least >= WANTED_M - 2.0 * SLACK_M if said else least < WANTED_M + 0.01
    assert told == {True, False}
