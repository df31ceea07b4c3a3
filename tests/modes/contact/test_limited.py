"""What limits speeds and their changes, against the same in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from modes.contact import kernels

Array = NDArray[np.float64]


def twin(jacobian: Array, wanted: Array, before: Array, cap: float, fastest: Array, most: Array) -> Array:
    """The plain way."""
    tool = float(np.linalg.norm(jacobian[:3] @ wanted))
    wanted = wanted / max(1.0, tool / cap, float((np.abs(wanted) / fastest).max()))
    change = wanted - before
    found = before + change / max(1.0, float((np.abs(change) / most).max()))
    tool = float(np.linalg.norm(jacobian[:3] @ found))
    return np.asarray(found / max(1.0, tool / cap, float((np.abs(found) / fastest).max())))


def test_speeds_are_limited_as_in_numpy_and_keep_every_limit(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(20_000)):
        n = int(rng.integers(1, 8))
        jacobian, fastest = rng.normal(size=(6, n)), rng.uniform(0.1, 3.0, n)
        wanted = rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 2.0)
        before = rng.uniform(-1.0, 1.0, n) * fastest
        most, cap = 10.0 ** rng.uniform(-3.0, 1.0, n), 10.0 ** rng.uniform(-2.0, 1.0)
        out = np.empty(n)
        kernels.limited(jacobian, wanted, before, cap, fastest, most, out)
        expected = twin(jacobian, wanted, before, cap, fastest, most)
        np.testing.assert_allclose(out, expected, rtol=1e-11, atol=1e-12)
        assert (np.abs(out) <= fastest * (1.0 + 1e-12)).all()
        assert np.linalg.norm(jacobian[:3] @ out) <= cap * (1.0 + 1e-9)
        if np.linalg.norm(jacobian[:3] @ before) <= cap:
            assert (np.abs(out - before) <= most * (1.0 + 1e-9) + 1e-12).all()
        reached = np.empty(n)
        kernels.limited(jacobian, wanted, before, cap, fastest, np.full(n, 1e9), reached)
        np.testing.assert_allclose(reached * np.abs(wanted).max(), wanted * np.abs(reached).max(), rtol=1e-9)


def test_the_way_round_is_a_quintic_for_each_side(rng: np.random.Generator) -> None:
    """From corner to corner, at rest in each; its speed is its derivative."""
    corners = rng.normal(size=(4, 3))

    def at(t: float) -> tuple[Array, Array]:
        place, velocity = np.empty(3), np.empty(3)
        kernels.cycle(corners, 2.0, t, place, velocity)
        return place, velocity

    for k in range(9):
        place, velocity = at(2.0 * k)
        np.testing.assert_allclose(place, corners[k % 4], atol=1e-12)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
    for t in rng.uniform(0.0, 16.0, 200):
        behind, ahead = at(t - 1e-6)[0], at(t + 1e-6)[0]
        np.testing.assert_allclose((ahead - behind) / 2e-6, at(t)[1], atol=1e-5)
    for t in rng.uniform(0.0, 2.0, 50):
        share = (at(t)[0] - corners[0]) @ (corners[1] - corners[0]) / np.sum((corners[1] - corners[0]) ** 2)
        u = 0.5 * t
        assert abs(share - (10 * u**3 - 15 * u**4 + 6 * u**5)) < 1e-12
