"""Monitored regions: membership by brute force, depth as the radius of a ball inside, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from occupancy.region import Monitored, Region, RegionError
from tests.occupancy.moving_people import unit

Array = np.ndarray
FLOOR_PLAN = [(-2.0, -1.0), (1.0, -2.0), (3.0, 0.5), (0.5, 2.5), (-1.5, 1.5)]
FIELD = {"horizontal": 1.2, "vertical": 0.8, "near": 0.5, "far": 4.0}


def rotation(rng: np.random.Generator) -> Array:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def by_rays(x: Array) -> bool:
    """Whether a ray from (x, y) leaves the floor plan once more than it enters."""
    crossings = 0
    for (x0, y0), (x1, y1) in zip(FLOOR_PLAN, FLOOR_PLAN[1:] + FLOOR_PLAN[:1], strict=True):
        if (y0 > x[1]) != (y1 > x[1]) and x[0] < x0 + (x[1] - y0) / (y1 - y0) * (x1 - x0):
            crossings += 1
    return crossings % 2 == 1


def in_sight(x: Array, eye: Array, axes: Array) -> bool:
    forwards, left, up = axes.T @ (x - eye)
    across = abs(math.atan2(left, forwards)) < 0.5 * FIELD["horizontal"]
    height = abs(math.atan2(up, forwards)) < 0.5 * FIELD["vertical"]
    return FIELD["near"] < forwards < FIELD["far"] and across and height


def cases(rng: np.random.Generator) -> list[tuple[Region, Callable[[Array], bool]]]:
    eye, axes = rng.uniform(-1.0, 1.0, 3), rotation(rng)
    low, high = np.array([-1.0, -2.0, 0.0]), np.array([2.0, 1.0, 2.5])
    turned = FLOOR_PLAN[::-1] if rng.random() < 0.5 else FLOOR_PLAN
    return [
        (Region.box(low, high), lambda x: bool(((low < x) & (x < high)).all())),
        (Region.prism(turned, -0.5, 1.5), lambda x: -0.5 < x[2] < 1.5 and by_rays(x)),
        (Region.frustum(eye, axes, **FIELD), lambda x: in_sight(x, eye, axes)),
    ]


def test_membership_is_that_of_brute_force(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    inside = np.zeros(3, int)
    for _ in range(count(2_000)):
        for which, (region, contains) in enumerate(cases(rng)):
            points = rng.uniform(-4.0, 4.0, (30, 3))
            for x, depth in zip(points, region.depth(points), strict=True):
                if abs(depth) > 1e-9:
                    assert contains(x) == (depth > 0.0)
                    inside[which] += depth > 0.0
    assert (inside > 10).all()


def test_depth_is_a_ball_inside(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    checked = 0
    for _ in range(count(2_000)):
        for region, contains in cases(rng):
            points = rng.uniform(-2.0, 2.0, (20, 3))
            for x, depth in zip(points, region.depth(points), strict=True):
                if depth > 0.0:
                    assert all(contains(x + (depth - 1e-9) * n) for n in unit(rng, 10))
                    beyond = region.normal * (depth + 1e-9)
                    assert not all(contains(x + step) for step in beyond)
                    checked += 1
    assert checked > 20


def test_depth_of_what_is_no_number_is_none() -> None:
    depth = Region.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)).depth(np.full((2, 3), math.nan))
    assert np.isnan(depth).all() and not (depth >= -1e9).any()


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Region.box((0, 0, 0), (1, 1, 0)), "below upper"),
        (lambda: Region.box((0, 0, NAN), (1, 1, 1)), "finite"),
        (lambda: Region.box((0, 0), (1, 1)), "three finite numbers"),
        (lambda: Region.box((0, 0, 0), (1, 1, 1e-4)), "empty"),
        (lambda: Region.box((0, 0, 0), (1, 1, 101.0)), "within 100 m"),
        (lambda: Region.box((0, 0, 0), (1, INF, 1)), "finite"),
        (lambda: Region.prism([(0, 0), (1, 0)], 0, 1), "corners"),
        (lambda: Region.prism([(0, 0), (1, 0), (2, 0)], 0, 1), "convex"),
        (lambda: Region.prism([(0, 0), (2, 0), (2, 2), (1, 0.5), (0, 2)], 0, 1), "convex"),
        (lambda: Region.prism([(0, 0), (0, 0), (1, 0), (0, 1)], 0, 1), "convex"),
        (lambda: Region.prism([(math.cos(a), math.sin(a)) for a in (0, 2.5, 5, 1.2, 3.7)], 0, 1), "convex"),
        (lambda: Region.prism([(0, 0), (1, 0), (0, NAN)], 0, 1), "finite"),
        (lambda: Region.prism([(0, 0), (1, 0), (0, 1)], 1, 1), "lower height"),
        (lambda: Region.prism([(0, 0), (1, 0), (0, 1)], 0, NAN), "lower height"),
        (lambda: Region.frustum((0, 0, 0), 1.1 * np.eye(3), **FIELD), "orthonormal"),
        (lambda: Region.frustum((0, 0, 0), np.full((3, 3), NAN), **FIELD), "orthonormal"),
        (lambda: Region.frustum((0, 0, 0), np.diag([1.0, 1.0, -1.0]), **FIELD), "mirror"),
        (lambda: Region.frustum((0, 0, 0), np.eye(3), **{**FIELD, "horizontal": math.pi}), "horizontal"),
        (lambda: Region.frustum((0, 0, 0), np.eye(3), **{**FIELD, "vertical": NAN}), "vertical"),
        (lambda: Region.frustum((0, 0, 0), np.eye(3), **{**FIELD, "near": 5.0}), "near < far"),
        (lambda: Region.frustum((0, 0, 0), np.eye(3), **{**FIELD, "near": -0.1}), "near < far"),
        (lambda: Region(np.eye(3), np.zeros(2)), "normals"),
        (lambda: Region(np.zeros((0, 3)), np.zeros(0)), "faces"),
        (lambda: Region(2.0 * np.eye(3), np.ones(3)), "unit vectors"),
        (lambda: Region(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([0.0, -1.0])), "empty"),
        (lambda: Region(np.tile(np.eye(3), (11, 1)), np.ones(33)), "faces"),
        (lambda: Monitored("a", Region(np.eye(3), np.ones(3)), NAN), "detection_time_s"),
        (lambda: Monitored("a", Region(np.eye(3), np.ones(3)), -0.1), "detection_time_s"),
        (lambda: Monitored("a", Region(np.eye(3), np.ones(3)), 0.1, INF), "boundary_error_m"),
    ],
)
def test_what_is_no_region_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(RegionError, match=message):
        make()


def test_region_does_not_change_with_the_arrays_it_was_made_of() -> None:
    normal, offset = np.eye(3), np.ones(3)
    region = Region(normal, offset)
    offset[:] = 5.0
    assert (region.offset == 1.0).all()
    with pytest.raises(ValueError, match="read-only"):
        region.offset[0] = 2.0


def polygon(corners: int) -> list[tuple[float, float]]:
    turns = 2.0 * math.pi * np.arange(corners) / corners
    return [(math.cos(turn), math.sin(turn)) for turn in turns]


def test_what_is_just_a_region_is_taken() -> None:
    """As few and as many faces as there may be, as far away, as thin, and from the camera's eye on."""
    wall = Region(np.array([[1.0, 0.0, 0.0]]), np.array([-100.0]))
    assert wall.depth(np.array([[-101.0, 0.0, 0.0], [-99.0, 7.0, 7.0]])).tolist() == [1.0, -1.0]
    for side in (-100.0, 100.0):
        assert Region(np.eye(3), np.full(3, side)).depth(np.full(3, side - 2.0)) == 2.0
        with pytest.raises(RegionError, match="within 100 m"):
            Region(np.eye(3), np.full(3, np.nextafter(side, 2.0 * side)))
    for corners in (3, 30):
        assert Region.prism(polygon(corners), 0.0, 1.0).depth((0.0, 0.0, 0.1)) == pytest.approx(0.1)
    for corners in (2, 31):
        with pytest.raises(RegionError, match="corners"):
            Region.prism(polygon(corners), 0.0, 1.0)
    sight = Region.frustum((0, 0, 0), np.eye(3), **{**FIELD, "near": 0.0})
    assert sight.depth((1e-3, 0.0, 0.0)) > 0.0 > sight.depth((-1e-3, 0.0, 0.0))
    assert len(Region.box((0, 0, 0), (1, 1, 2.1e-3)).offset) == 6
    with pytest.raises(RegionError, match="empty"):
        Region.box((0, 0, 0), (1, 1, 1.9e-3))
    assert Monitored("a", sight, 0.0, 0.0).detection_time_s == 0.0
