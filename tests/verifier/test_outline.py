"""Outlines of sphere-swept volumes against support functions and hull distances."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.sets import distance_to_hull
from verifier.outline import SIDES, STEP_M, edge_of_union, inside, outline, project

Array = np.ndarray
BEYOND = 1.0 / math.cos(math.pi / SIDES) - 1.0
"""How much farther than a circle the polygon around it reaches, as a share of the radius."""


def sideways(rng: np.random.Generator) -> Array:
    angle = rng.uniform(-math.pi, math.pi)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def volumes(rng: np.random.Generator, n: int) -> list[tuple[Array, float]]:
    """Random sets of points near each other, with radii; some points coincide or lie on a line."""
    found = []
    for _ in range(n):
        points = rng.normal(scale=0.3, size=(rng.integers(1, 7), 3))
        if len(points) > 2 and rng.random() < 0.3:
            points[1:] = points[0] + rng.uniform(-1.0, 1.0, (len(points) - 1, 1)) * rng.normal(size=3)
        if rng.random() < 0.2:
            points[-1] = points[0]
        found.append((points, float(rng.uniform(0.05, 0.8))))
    return found


def test_the_outline_has_the_support_function_of_the_volume(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """In space, of hull and ball: the greatest of n · p over the points, and the radius."""
    for points, radius in volumes(rng, count(3_000)):
        along, shift = sideways(rng), rng.normal(scale=10.0, size=3)
        corners = outline(project(points + shift, along), radius)
        angle = rng.uniform(-math.pi, math.pi, 50)
        in_plane = np.column_stack([np.cos(angle), np.sin(angle)])
        in_space = in_plane[:, :1] * along + in_plane[:, 1:] * (0.0, 0.0, 1.0)
        exact = (in_space @ (points + shift).T).max(axis=1) + radius
        drawn = (in_plane @ corners.T).max(axis=1)
        assert (drawn >= exact - 1e-9).all(), (points, radius)
        assert (drawn <= exact + BEYOND * radius + 1e-9).all(), (points, radius)


def test_outlines_are_convex_and_counter_clockwise(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for points, radius in volumes(rng, count(1_000)):
        corners = outline(points[:, :2], radius)
        a, b = (
            np.roll(corners, -1, axis=0) - corners,
            np.roll(corners, -2, axis=0) - np.roll(corners, -1, axis=0),
        )
        assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0.0).all()
        assert inside(points[:, :2], corners, radius - 1e-9).all()


def test_a_set_without_a_radius_is_drawn_too() -> None:
    for points in (np.zeros((1, 2)), np.array([[0.0, 0.0], [1.0, 1.0]])):
        corners = outline(points, 0.0)
        assert inside(points, corners).all() and np.abs(corners).max() < 1.001


def test_no_distance_is_longer_in_the_view(rng: np.random.Generator) -> None:
    points, along = rng.normal(size=(40, 3)), sideways(rng)
    seen = project(points, along)
    np.testing.assert_array_equal(seen[:, 1], points[:, 2])
    assert (
        np.linalg.norm(seen - seen[0], axis=1) <= np.linalg.norm(points - points[0], axis=1) + 1e-12
    ).all()
    np.testing.assert_allclose(project(np.array([3.0 * along]), along), [[3.0, 0.0]], atol=1e-12)


def test_the_edge_of_a_union_is_what_lies_in_no_other_set(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Edges are sampled here by themselves; what is inside of another set is told by its hull distance."""
    for _ in range(count(300)):
        sets = [(points * (1.0, 1.0, 0.0), radius) for points, radius in volumes(rng, rng.integers(1, 5))]
        outlines = [outline(points[:, :2], radius) for points, radius in sets]
        drawn = np.vstack([*edge_of_union(outlines), np.full((1, 2), np.inf)])
        for i, corners in enumerate(outlines):
            for share in np.linspace(0.0, 1.0, 5):
                for p in ((1.0 - share) * corners + share * np.roll(corners, -1, axis=0))[::20]:
                    deep = [
                        r - distance_to_hull(hull, [*p, 0.0]) for j, (hull, r) in enumerate(sets) if j != i
                    ]
                    deepest = max(deep, default=-1.0)
                    off = float(np.linalg.norm(drawn - p, axis=1).min())
                    if deepest < -STEP_M:
                        assert off < STEP_M
                    elif deepest > 2.0 * STEP_M:
                        assert off > 0.5 * STEP_M


def test_of_sets_that_coincide_one_edge_is_drawn() -> None:
    corners = outline(np.zeros((1, 2)), 0.5)
    (line,) = edge_of_union([corners, corners.copy()])
    assert len(line) > SIDES
    np.testing.assert_array_equal(line[0], line[-1])
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(math.pi, rel=1e-3)
    (line,) = edge_of_union([outline(np.zeros((1, 2)), 0.2), corners])
    assert np.linalg.norm(line, axis=1).min() > 0.49
