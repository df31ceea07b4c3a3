"""Primitive shapes and swept parts lie in the hull of their balls."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import coal
import numpy as np
import pytest
from numpy.typing import NDArray

from robots.capsule import Capsule
from robots.errors import SetupError
from robots.shapes import (
    place,
    point_balls,
    primitive_balls,
    rotation_about,
    rotation_from_rpy,
    simplified,
    sweep,
)

Array = NDArray[np.float64]


def unit(rng: np.random.Generator, number: int) -> Array:
    x = rng.normal(size=(number, 3))
    return np.asarray(x / np.linalg.norm(x, axis=1)[:, None])


def support(balls: Array, directions: Array) -> Array:
    """Support function of the hull of the balls."""
    return np.asarray((balls[:, :3] @ directions.T + balls[:, 3:]).max(axis=0))


def exact_support(shape: Any, directions: Array) -> Array:
    """Support function of the shape itself, in closed form."""
    kind, z = type(shape).__name__, directions[:, 2]
    across = np.hypot(directions[:, 0], directions[:, 1])
    if kind == "Box":
        return np.asarray(np.abs(directions) @ np.asarray(shape.halfSide))
    if kind == "Sphere":
        return np.full(len(directions), shape.radius)
    return np.asarray(shape.radius * across + shape.halfLength * np.abs(z))


@pytest.mark.parametrize(
    "shape",
    [
        coal.Box(0.3, 0.2, 0.5),
        coal.Sphere(0.4),
        coal.Cylinder(0.2, 0.7),
    ],
)
def test_hull_of_the_balls_contains_the_shape_and_hardly_more(
    shape: Any, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    directions = unit(rng, count(100_000))
    found, exact = support(primitive_balls(shape), directions), exact_support(shape, directions)
    assert (found >= exact - 1e-12).all()
    assert (found <= exact + 0.0013 * 0.5).all()


def test_other_shapes_are_refused() -> None:
    with pytest.raises(SetupError, match=r"Ellipsoid.*not supported"):
        primitive_balls(coal.Ellipsoid(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("lower", "upper"), [(-0.3, 0.8), (0.0, 0.0), (1.0, 1.05), (-2.9, 2.9), (-np.inf, np.inf), (0.0, 7.0)]
)
def test_turning_points_stay_in_the_hull(
    lower: float, upper: float, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(1_000)):
        cloud = rng.uniform(-0.3, 0.3, (5, 3))
        axis = unit(rng, 1)[0]
        swept = sweep(point_balls(cloud), axis, lower, upper, prismatic=False)
        for point in cloud:
            angle = rng.uniform(max(lower, -np.pi), min(upper, np.pi))
            moved = rotation_about(axis, angle) @ point
            directions = unit(rng, 50)
            assert (support(swept, directions) >= directions @ moved - 1e-12).all()
        assert swept[:, 3].max() <= 0.0049 * 0.53, "the hull grows by the sagitta only"


def test_a_turning_point_is_within_a_radius_of_some_chord(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(20_000)):
        point, axis = rng.uniform(-0.3, 0.3, 3), unit(rng, 1)[0]
        swept = sweep(point_balls(point[None]), axis, -0.4, 0.9, prismatic=False)
        moved = rotation_about(axis, rng.uniform(-0.4, 0.9)) @ point
        chords = pairwise(swept)
        excess = [Capsule(a[:3], b[:3], a[3]).excess(np.array([[*moved, 0.0]])) for a, b in chords]
        assert min(excess) <= 1e-12


def test_a_sliding_part_is_the_hull_of_its_ends(rng: np.random.Generator) -> None:
    cloud, axis = rng.uniform(-0.3, 0.3, (20, 3)), unit(rng, 1)[0]
    swept = sweep(point_balls(cloud), axis, -0.1, 0.4, prismatic=True)
    directions = unit(rng, 500)
    ends = np.vstack([cloud - 0.1 * axis, cloud + 0.4 * axis])
    np.testing.assert_allclose(support(swept, directions), (ends @ directions.T).max(axis=0), atol=1e-12)


@pytest.mark.parametrize("squeeze", [(1.0, 1.0, 1.0), (1.0, 0.3, 0.01), (1.0, 1.0, 1e-5)])
def test_many_balls_are_replaced_by_few_around_them(
    squeeze: tuple[float, float, float], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for radius in (0.0, 0.05):
        centres = unit(rng, 6000) * squeeze * rng.uniform(0.1, 2.0) + rng.uniform(-1, 1, 3)
        balls = np.column_stack([centres, np.full(len(centres), radius)])
        few = simplified(balls)
        directions = unit(rng, count(20_000))
        wide, exact = support(few, directions), support(balls, directions)
        middle = directions @ centres.mean(axis=0)
        assert (wide >= exact - 1e-12).all()
        assert (wide - middle <= 1.05 * (exact - middle) + 1e-9).all()
        assert len(few) < 1000 and set(few[:, 3]) == {radius}


def test_each_radius_is_simplified_for_itself(rng: np.random.Generator) -> None:
    big = np.column_stack([unit(rng, 5000), np.full(5000, 0.1)])
    small = np.column_stack([2.0 * unit(rng, 300), np.full(300, 0.2)])
    few = simplified(np.vstack([big, small]))
    assert (few[few[:, 3] == 0.2] == small).all() and 100 < (few[:, 3] == 0.1).sum() < 1000
    assert (simplified(small) == small).all()


@pytest.mark.parametrize("flat", [(1.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_flat_sets_of_balls_are_kept(flat: tuple[float, float, float], rng: np.random.Generator) -> None:
    balls = point_balls(unit(rng, 5000) * flat)
    directions = unit(rng, 1000)
    np.testing.assert_allclose(support(simplified(balls), directions), support(balls, directions), atol=1e-12)


def test_an_endless_slide_is_refused() -> None:
    with pytest.raises(SetupError, match="finite limits"):
        sweep(point_balls(np.zeros((1, 3))), np.array([1.0, 0, 0]), -np.inf, np.inf, prismatic=True)


def test_swept_balls_keep_the_given_ones_as_they_were(rng: np.random.Generator) -> None:
    balls = point_balls(rng.normal(size=(30, 3)))
    before = balls.copy()
    sweep(balls, np.array([0, 0, 1.0]), -1.0, 1.0, prismatic=False)
    assert (balls == before).all()


def test_placing_moves_centres_and_keeps_radii() -> None:
    balls = np.array([[1.0, 0.0, 0.0, 0.3]])
    moved = place(balls, rotation_about(np.array([0, 0, 1.0]), np.pi / 2), np.array([0.0, 0.0, 5.0]))
    np.testing.assert_allclose(moved, [[0.0, 1.0, 5.0, 0.3]], atol=1e-15)


def test_roll_pitch_yaw_as_in_pinocchio(rng: np.random.Generator) -> None:
    import pinocchio

    for angles in rng.uniform(-7, 7, (200, 3)):
        np.testing.assert_allclose(rotation_from_rpy(*angles), pinocchio.rpy.rpyToMatrix(*angles), atol=1e-14)
