"""Segments from rest to rest, and at borders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robots.errors import SetupError
from verifier.program_segments import Stretch, at_borders, from_rest_to_rest


def flags(text: str) -> np.ndarray:
    return np.array([each == "." for each in text])


@pytest.mark.parametrize("border", [0.0, 1.0, -0.2, 1.5, float("nan"), float("inf"), 0.004])
def test_borders_outside_are_refused(border: float) -> None:
    with pytest.raises(SetupError, match=r"--border .* should lie between 0 s and 1 s"):
        at_borders([0.5, border], 0.01, Stretch(0, 100))


def test_borders_divide() -> None:
    assert at_borders([0.7, 0.25, 0.25], 0.01, Stretch(10, 100)) == (
        Stretch(10, 25), Stretch(25, 70), Stretch(70, 100),
    )  # fmt: skip
    assert at_borders([], 0.01, Stretch(10, 100)) == (Stretch(10, 100),)


@pytest.mark.parametrize(
    ("text", "borders"),
    [
        ("####..####", []),  # two cycles of 40 ms: 0.08 s is too short a rest
        ("###...####", [4]),
        ("...####...", []),  # before the first motion and after the last one
        ("##....##....##", [4, 10]),
        ("..............", []),
    ],
)
def test_rests_divide_in_their_middle(text: str, borders: list[int]) -> None:
    found = from_rest_to_rest(flags(text), 0.04, Stretch(0, len(text)))
    assert [each.first for each in found[1:]] == borders
    assert found[0].first == 0 and found[-1].end == len(text)


def test_segments_cover_the_window_once(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    for _ in range(count(5000)):
        n = int(rng.integers(1, 200))
        rests = np.repeat(rng.uniform(size=n) < 0.5, rng.integers(1, 30, n))
        first = int(rng.integers(0, len(rests)))
        whole = Stretch(first, int(rng.integers(first + 1, len(rests) + 1)))
        found = from_rest_to_rest(rests, 0.01, whole)
        assert [each.first for each in found] == [whole.first, *(each.end for each in found[:-1])]
        assert found[-1].end == whole.end and all(each.first < each.end for each in found)
        assert all(rests[each.first] for each in found[1:])
