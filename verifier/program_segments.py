"""A recorded motion in segments, from rest to rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError

REST_S = 0.1
"""The arm rests between two segments for at least this long [s]."""
STILL = 0.005
"""It rests while no joint is faster than this share of its largest velocity."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Cycles ``first`` to ``end - 1``."""

    first: int
    end: int


def from_rest_to_rest(rests: NDArray[np.bool_], cycle_s: float, whole: Stretch) -> tuple[Stretch, ...]:
    """Divide the cycles of ``whole`` in the middle of each rest.

    Parameters
    ----------
    rests:
        (N,) whether the arm rests at each cycle; every cycle of ``whole`` is among them.
    cycle_s:
        Time between two cycles [s].
    whole:
        What is divided.
    """
    at_least = math.ceil(REST_S / cycle_s - 1e-9)
    middles = [
        (rest.first + rest.end) // 2
        for rest in _runs(rests)
        if rest.end - rest.first >= at_least and whole.first < rest.first and rest.end < whole.end
    ]
    return _divided(whole, middles)


def at_borders(borders_s: Sequence[float], cycle_s: float, whole: Stretch) -> tuple[Stretch, ...]:
    """Divide the cycles of ``whole`` at instants [s] since cycle 0.

    Raises
    ------
    SetupError
        An instant is not within ``whole``.
    """
    places = []
    for border in borders_s:
        place = round(border / cycle_s) if np.isfinite(border) else -1
        if not whole.first < place < whole.end:
            raise SetupError(
                f"--border {border:g}: should lie between {whole.first * cycle_s:g} s and "
                f"{whole.end * cycle_s:g} s, where cycles are looked at"
            )
        places.append(place)
    return _divided(whole, sorted(set(places)))


def _divided(whole: Stretch, places: Sequence[int]) -> tuple[Stretch, ...]:
    return tuple(Stretch(*pair) for pair in pairwise([whole.first, *places, whole.end]))


def _runs(flags: NDArray[np.bool_]) -> Iterator[Stretch]:
    """Yield the unbroken runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    for first, end in edges.reshape(-1, 2).tolist():
        yield Stretch(first, end)
