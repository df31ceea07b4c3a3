"""Depth around a pixel: holes, edges between two surfaces, units, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from modes.forecasting.depth import DepthOutcome, DepthSettings, sample
from robots.errors import SetupError

SETTINGS = DepthSettings()


def plane(depth_m: float) -> np.ndarray:
    return np.full((60, 80), depth_m)


def test_an_even_surface_is_read_as_it_is() -> None:
    found = sample(plane(1.5), 1.0, 40.0, 30.0, SETTINGS)
    assert found == (DepthOutcome.READ, 1.5, 0.0)
    millimetres = (1000.0 * plane(1.5)).astype(np.uint16)
    assert sample(millimetres, 0.001, 40.0, 30.0, SETTINGS).depth_m == pytest.approx(1.5)


@pytest.mark.parametrize("hole", [0.0, math.nan, math.inf, -1.0, 60.0, 0.1])
def test_holes_are_not_read(hole: float, rng: np.random.Generator) -> None:
    depth = plane(1.5)
    depth[rng.uniform(size=depth.shape) < 0.6] = hole
    assert sample(depth, 1.0, 40.0, 30.0, SETTINGS).depth_m == 1.5
    assert sample(plane(hole), 1.0, 40.0, 30.0, SETTINGS).outcome is DepthOutcome.HOLE


def test_a_few_pixels_are_no_surface() -> None:
    depth = plane(0.0)
    depth[30, 36:45] = 1.5
    assert sample(depth, 1.0, 40.0, 30.0, SETTINGS).outcome is DepthOutcome.HOLE
    depth[:, :] = 2.0
    depth[30, 36:45] = 1.5
    assert sample(depth, 1.0, 40.0, 30.0, SETTINGS)[1:] == (2.0, 0.0)


@pytest.mark.parametrize("edge", [34, 40, 46])
def test_before_background_the_nearer_surface_is_read(edge: int) -> None:
    depth = plane(4.0)
    depth[:, :edge] = 1.5
    assert sample(depth, 1.0, 40.0, 30.0, SETTINGS) == (DepthOutcome.READ, 1.5, 0.0)


def test_two_surfaces_of_one_body_make_the_error_as_large_as_the_gap() -> None:
    depth = plane(1.9)
    depth[:, :41] = 1.5
    found = sample(depth, 1.0, 40.0, 30.0, SETTINGS)
    assert found.depth_m == 1.5 and found.spread_m == pytest.approx(0.4)


def test_a_slanted_surface_adds_the_spread_of_its_middle_half() -> None:
    """40 cm over 80 columns; the window of 17 columns spreads over 85 mm, and half of that."""
    depth = np.tile(np.linspace(1.0, 1.4, 80, endpoint=False), (60, 1))
    found = sample(depth, 1.0, 40.0, 30.0, SETTINGS)
    assert found.depth_m == pytest.approx(1.2)
    assert found.spread_m == pytest.approx(0.04, abs=0.005)


@pytest.mark.parametrize(
    ("u", "v"),
    [(-1.0, 5.0), (80.0, 5.0), (5.0, 60.0), (5.0, -0.6), (math.nan, 5.0), (5.0, math.inf), (1e300, 5.0)],
)
def test_pixels_outside_are_not_read(u: float, v: float) -> None:
    assert sample(plane(1.5), 1.0, u, v, SETTINGS).outcome is DepthOutcome.OUTSIDE


def test_corners_are_read() -> None:
    for u in (0.0, 79.0):
        for v in (0.0, 59.0):
            assert sample(plane(1.5), 1.0, u, v, SETTINGS).depth_m == 1.5


def test_errors_grow_with_the_square_of_the_depth() -> None:
    bare = DepthSettings(bias_m=0.0, bias_share=0.0, noise_m=0.0, noise_per_m=0.002, sigmas=3.0)
    assert bare.error_m(2.0) == pytest.approx(3.0 * 0.002 * 4.0)
    assert SETTINGS.error_m(2.0) == pytest.approx(0.011 + 0.002 + 3.0 * (0.017 + 0.004))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("window_px", 0),
        ("window_px", 2.5),
        ("least_share", 0.0),
        ("jump_m", math.nan),
        ("body_depth_m", 0.01),
        ("nearest_m", -1.0),
        ("farthest_m", 0.1),
        ("bias_m", -0.1),
        ("noise_m", "1"),
        ("sigmas", math.inf),
    ],
)
def test_wrong_settings_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SetupError, match=f"^depth: {name} [^\n]+$"):
        DepthSettings(**{name: value})
