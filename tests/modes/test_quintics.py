"""Quintics through known states keep them."""

from __future__ import annotations

import numpy as np

from modes.quintics import quintics


def test_states_at_the_knots_are_those_that_were_given(rng: np.random.Generator) -> None:
    t = np.cumsum(rng.uniform(0.1, 0.5, 6)) - 0.1
    values = [tuple(rng.normal(size=(3, 4))) for _ in t]
    rest = np.zeros(4)
    values[-1] = (values[-1][0], rest, rest)
    motion = quintics(t - t[0], values)  # type: ignore[arg-type]  # rows of an array
    q, dq, ddq, _dddq = motion.sample((t - t[0])[:-1])
    for k in range(len(t) - 1):
        np.testing.assert_allclose((q[k], dq[k], ddq[k]), values[k], atol=1e-9)
