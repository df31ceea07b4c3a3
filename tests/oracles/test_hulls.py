"""The exact distance of a point from a hull, against closed forms and against the quick one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.oracles.hulls import exact_point_distance, pad, point_distance

CORNERS = np.array([[0.0, 0, 0], [2.0, 0, 0], [0.0, 2.0, 0], [0.0, 0, 2.0]])


@pytest.mark.parametrize(
    ("p", "distance"),
    [
        ([0.1, 0.1, 0.1], 0.0),
        ([0.0, 0.0, 0.0], 0.0),
        ([0.5, 0.5, -3.0], 3.0),
        ([-3.0, -4.0, 0.0], 5.0),
        ([5.0, 0.0, 0.0], 3.0),
        ([1.0, -2.0, 0.0], 2.0),
        ([2.0, 2.0, 2.0], 4.0 / math.sqrt(3.0)),
        ([2.0, 2.0, 0.0], math.sqrt(2.0)),
    ],
)
def test_distances_from_a_tetrahedron(p, distance):
    assert exact_point_distance(np.array(p), CORNERS) == pytest.approx(distance, abs=1e-15)


def test_on_hulls_that_are_not_flat_the_quick_distance_is_the_same(rng, count):
    for _ in range(count(5_000)):
        hull = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 5)), 3))
        p = rng.uniform(-1.5, 1.5, 3)
        assert exact_point_distance(p, hull) == pytest.approx(float(point_distance(p, pad(hull))), abs=1e-9)


def test_on_flat_hulls_the_quick_distance_is_never_smaller(rng, count):
    """A point between the corners is inside of the exact hull but for the rounding of its coordinates."""
    worst = 0.0
    for _ in range(count(20_000)):
        a, b = rng.uniform(-1.0, 1.0, (2, 3))
        hull = np.array([a, b, a + rng.normal(size=3) * 1e-6, b + rng.normal(size=3) * 1e-6])
        p = rng.dirichlet(np.ones(4)) @ hull
        exact, quick = exact_point_distance(p, hull), float(point_distance(p, hull))
        assert exact <= 1e-15 and exact <= quick
        worst = max(worst, quick - exact)
    assert worst > 1e-12
