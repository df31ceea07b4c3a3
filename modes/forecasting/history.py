"""What was seen of one person in the last 3 s, at 10 Hz, from measurements that come as they come."""

from __future__ import annotations

from collections import deque
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import RATE_HZ, SEEN
from modes.settings import require_number
from occupancy.body import MAX_POINTS

Array = NDArray[np.float64]

_KEPT = 2000
"""Measurements that are kept at most: 3 s at more than 600 Hz."""


class Taken(Enum):
    """What became of a measurement."""

    TAKEN = "taken"
    NOT_NEWER = "not newer than the last one"
    NO_POINT = "no point was seen"
    STAMP_NOT_FINITE = "the stamp is not finite"
    OTHER_SHAPE = "not 20 points"


class History:
    """Points of one person over the last 3 s.

    Parameters
    ----------
    longest_gap_s:
        Between measurements of a point that are farther apart, the point was not seen [s].

    Raises
    ------
    SetupError
        The gap is out of its range.
    """

    def __init__(self, longest_gap_s: float = 0.25) -> None:
        require_number("history: longest_gap_s", longest_gap_s, 0.01, SEEN / RATE_HZ)
        self._gap = longest_gap_s
        self._t: deque[float] = deque(maxlen=_KEPT)
        self._points: deque[Array] = deque(maxlen=_KEPT)

    def __len__(self) -> int:
        return len(self._t)

    @property
    def newest(self) -> float:
        """Stamp of the newest measurement [s]; NaN: there is none."""
        return self._t[-1] if self._t else float("nan")

    def add(self, stamp: float, points: Array) -> Taken:
        """Take in points ``(20, 3)`` [m] that were seen at ``stamp`` [s]; a row with NaN: not seen."""
        if points.shape != (MAX_POINTS, 3):
            return Taken.OTHER_SHAPE
        if not np.isfinite(stamp):
            return Taken.STAMP_NOT_FINITE
        if self._t and stamp <= self._t[-1]:
            return Taken.NOT_NEWER
        seen = np.asarray(np.isfinite(points).all(axis=1))
        if not seen.any():
            return Taken.NO_POINT
        self._t.append(float(stamp))
        self._points.append(np.where(seen[:, None], points, np.nan))
        oldest = stamp - (SEEN - 1) / RATE_HZ - self._gap
        while self._t[0] < oldest:
            self._t.popleft()
            self._points.popleft()
        return Taken.TAKEN

    def points(self) -> Array:
        """Return points ``(30, 20, 3)`` [m] at 10 Hz, the last at the newest stamp.

        Straight between measurements of a point that are near in time. NaN: not seen then; all of it is NaN
        before the first measurement.
        """
        out = np.full((SEEN, MAX_POINTS, 3), np.nan)
        if not self._t:
            return out
        t, points = np.array(self._t), np.array(self._points)
        at = t[-1] + np.arange(1 - SEEN, 1) / RATE_HZ
        at[-1] = t[-1]
        for k in range(MAX_POINTS):
            rows = np.flatnonzero(np.isfinite(points[:, k, 0]))
            if len(rows):
                out[:, k] = _between(t[rows], points[rows, k], at, self._gap)
        return out


def _between(t: Array, xyz: Array, at: Array, gap: float) -> Array:
    """Return one point ``(frames, 3)`` at ``at``, straight between measurements at most ``gap`` apart."""
    after = np.searchsorted(t, at, side="left")
    met = (after < len(t)) & (t[np.minimum(after, len(t) - 1)] == at)
    inside = (after > 0) & (after < len(t))
    b = np.clip(after, 1, max(len(t) - 1, 1))
    a = b - 1
    b = np.minimum(b, len(t) - 1)
    width = np.where(b > a, t[b] - t[a], 1.0)
    share = ((at - t[a]) / width)[:, None]
    out = np.where((inside & (width <= gap))[:, None], xyz[a] * (1.0 - share) + xyz[b] * share, np.nan)
    return np.asarray(np.where(met[:, None], xyz[np.minimum(after, len(t) - 1)], out))
