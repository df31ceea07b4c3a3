"""Pieces of sphere-swept volumes: their union is the outline of the set, no more and no less."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.sets import SphereSweptVolume
from verifier.scene_sets import Pieces, pieces

Array = NDArray[np.float64]


def onto(corners: Array, points: Array) -> Array:
    """Distances of points (N, 3) from triangles (T, 3, 3), the smallest each: by projection and edges."""
    best = np.full(len(points), np.inf)
    for a, b, c in corners:
        basis = np.column_stack([b - a, c - a])
        weights, *_ = np.linalg.lstsq(basis, (points - a).T, rcond=None)
        inside = (weights >= -1e-9).all(axis=0) & (weights.sum(axis=0) <= 1.0 + 1e-9)
        off = np.linalg.norm((points - a).T - basis @ weights, axis=0)
        best = np.where(inside, np.minimum(best, off), best)
    return best


def from_axes(axes: Array, points: Array) -> Array:
    """Distances of points (N, 3) from segments (C, 2, 3), the smallest each."""
    best = np.full(len(points), np.inf)
    for a, b in axes:
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - (a + along[:, None] * (b - a)), axis=1))
    return best


def off_the_surface(found: Pieces, points: Array) -> Array:
    """How far points are from the nearest surface that is drawn."""
    axes = from_axes(found.cylinders, points) if len(found.cylinders) else np.full(len(points), np.inf)
    centres = np.min(np.linalg.norm(points[:, None] - found.spheres, axis=2), axis=1)
    return np.minimum(np.abs(np.minimum(axes, centres) - found.radius), onto(found.triangles, points))


def outline(judged: SphereSweptVolume, directions: Array) -> Array:
    """Where rays from the middle of a set leave it, found by bisection with the set's own distance."""
    middle, found = judged.points.mean(axis=0), []
    for direction in directions:
        near, far = 0.0, 20.0
        for _ in range(50):
            half = 0.5 * (near + far)
            near, far = (half, far) if judged.excess(middle + half * direction) <= 0.0 else (near, half)
        found.append(middle + near * direction)
    return np.array(found)


SHAPES = {"ball": 1, "capsule": 2, "triangle": 3, "tetrahedron": 4, "hull": 20, "the largest": 32}


@pytest.mark.parametrize("n", SHAPES.values(), ids=SHAPES.keys())
def test_what_is_drawn_is_the_outline_of_what_is_judged(n: int, rng: np.random.Generator, count) -> None:
    for _ in range(count(200)):
        points, radius = rng.normal(size=(n, 3)), rng.uniform(0.05, 0.5)
        judged, drawn = SphereSweptVolume(points, radius), pieces(points, radius)
        assert drawn.radius == radius
        directions = rng.normal(size=(8, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        assert off_the_surface(drawn, outline(judged, directions)).max() < 1e-6
        for centre in drawn.spheres:
            assert judged.contains(SphereSweptVolume(centre[None], radius))
        for axis in drawn.cylinders:
            assert judged.contains(SphereSweptVolume(axis, radius))
        for corner in drawn.triangles.reshape(-1, 3):
            assert judged.contains(corner, tolerance=1e-8)


@pytest.mark.parametrize("n", [3, 4, 9])
def test_points_in_a_plane_or_in_a_line_are_drawn_too(n: int, rng: np.random.Generator, count) -> None:
    for _ in range(count(100)):
        a, b, c = rng.normal(size=(3, 3))
        weights = rng.uniform(-1.0, 1.0, size=(n, 2))
        flat, thin = a + weights @ np.array([b, c]), a + weights[:, :1] * b
        directions = rng.normal(size=(8, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        for points in (flat, thin, np.repeat(a[None], n, axis=0)):
            drawn = pieces(points, 0.1)
            judged = SphereSweptVolume(points, 0.1)
            assert off_the_surface(drawn, outline(judged, directions)).max() < 1e-6
            assert np.isfinite(drawn.triangles).all()


def test_a_capsule_has_two_spheres_and_a_cylinder_of_one_radius() -> None:
    found = pieces(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]), 0.25)
    assert (len(found.spheres), len(found.cylinders), len(found.triangles)) == (2, 1, 0)
    assert np.allclose(found.cylinders[0], [[0, 0, 0], [0, 0, 2]])
