"""Volumes of sphere-swept volumes: closed forms, flat hulls, and the share of random points inside."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.sets import distance_to_hull
from occupancy.volume import volume

R = 0.3
BALL = 4.0 / 3.0 * math.pi * R**3


def turned(rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
    """The same hull, turned and moved, its points in another order."""
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(rng.permutation(points @ rotation.T + rng.normal(size=3)))


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], float)
BOX = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(8.0)
CASES = {
    "point": (np.zeros((1, 3)), BALL),
    "one point four times": (np.zeros((4, 3)), BALL),
    "segment": (np.array([[0, 0, 0], [0, 0, 2.0]]), BALL + 2.0 * math.pi * R**2),
    "points on a line": (np.array([[0, 0, z] for z in (0, 0.3, 2, 1)], float), BALL + 2.0 * math.pi * R**2),
    "triangle": (
        np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], float),
        BALL + 12.0 * R + 0.5 * math.pi * 12.0 * R**2,
    ),
    "rectangle": (SQUARE, BALL + 4.0 * R + 0.5 * math.pi * 6.0 * R**2),
    "point in a triangle": (
        np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0.5, 0.5, 0]], float),
        BALL + 12.0 * R + 0.5 * math.pi * 12.0 * R**2,
    ),
    "box": (BOX, BALL + 6.0 + 22.0 * R + math.pi * 6.0 * R**2),
    "regular tetrahedron": (
        TETRAHEDRON,
        BALL + 1.0 / (6.0 * math.sqrt(2.0)) + math.sqrt(3.0) * R + 3.0 * math.acos(-1.0 / 3.0) * R**2,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_known_volumes(name: str, rng: np.random.Generator) -> None:
    points, expected = CASES[name]
    for _ in range(5):
        assert volume(turned(rng, points), R) == pytest.approx(expected, rel=1e-9)


def test_nearly_flat_hulls_are_not_smaller_than_flat_ones(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(5_000)):
        thickness = 10.0 ** rng.uniform(-16.0, -2.0)
        points = SQUARE + thickness * rng.normal(size=(4, 3)) * (0.0, 0.0, 1.0)
        found = volume(turned(rng, points), R)
        assert 1.0 - 1e-9 <= found / CASES["rectangle"][1] <= 1.0 + 1e-4 + 10.0 * thickness


@pytest.mark.parametrize("thickness", [1e-8, 1e-7, 9e-7, 1e-5])
def test_thin_boxes_are_not_smaller_than_they_are(thickness: float, rng: np.random.Generator) -> None:
    t, points = thickness, BOX * (1.0, 1.0, thickness / 3.0)
    expected = BALL + 2.0 * t + (4.0 + 6.0 * t) * R + math.pi * (3.0 + t) * R**2
    for _ in range(5):
        assert 1.0 - 1e-13 <= volume(turned(rng, points), R) / expected <= 1.0 + 1e-4


def test_a_flat_hull_with_tips_is_not_smaller_than_it_is(rng: np.random.Generator) -> None:
    """Its corners stay where they are when it is projected, and the tips do not."""
    h = 1e-7
    points = np.vstack([SQUARE, [[0.5, 1.0, h], [0.5, 1.0, -h]]])
    pyramids = 2.0 * 2.0 * h / 3.0
    for _ in range(5):
        assert pyramids <= volume(turned(rng, points), 0.0) <= 4.0 * pyramids
        found = volume(turned(rng, points), R)
        assert CASES["rectangle"][1] + pyramids <= found <= CASES["rectangle"][1] * (1.0 + 1e-4)


@pytest.mark.parametrize("size", [1e-4, 1e4])
@pytest.mark.parametrize("name", CASES)
def test_volumes_of_another_size(name: str, size: float) -> None:
    points, expected = CASES[name]
    assert volume(size * points, size * R) == pytest.approx(size**3 * expected, rel=1e-9)


def test_hulls_of_many_points_against_random_points(rng: np.random.Generator) -> None:
    for n in (4, 8, 32):
        points = rng.normal(size=(n, 3))
        low, high = points.min(axis=0) - R, points.max(axis=0) + R
        tried = rng.uniform(low, high, (4_000, 3))
        share = np.mean([distance_to_hull(points, p) <= R for p in tried])
        expected = float(np.prod(high - low)) * share
        deviation = float(np.prod(high - low)) * math.sqrt(share * (1.0 - share) / len(tried))
        assert volume(points, R) == pytest.approx(expected, abs=5.0 * deviation)
