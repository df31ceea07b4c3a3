"""How far an arm was from what it was commanded to do: measured from a recording of both.

Assumption A2 (docs/method.md) says that the robot follows its command with a delay in [δ_min, δ_max] and a
joint error of at most e_j. A delay of the arm as a whole makes most of the distance between the two; it is
fitted first, one for all joints, and what is left is the error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

FloatArray = NDArray[np.float64]

LONGEST_DELAY_S = 0.25
"""Delays up to this [s] are tried …"""
STEPS = 200
"""… this many of them, at least one every quarter of a sample, before the best one is refined."""
FITTED_SAMPLES = 20_000
"""Samples that the fit takes, evenly from a stretch; the errors are of all."""
FINEST_S = 1e-5
"""Delays are found to about this [s], and shorter ones are none."""
EXPLAINS = 0.5
"""A delay counts where it takes away this share of the sum of squares."""
LONGEST_STEP_S = 0.1
"""Between commands farther apart than this [s] nobody knows what was commanded."""
FEWEST_SAMPLES = 10


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Positions ``q (T, J)`` at ``t (T,)`` [s], increasing; of measured joints, or of commanded ones."""

    t: FloatArray
    q: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """Return positions at other instants, linear between samples; NaN where there is none near."""
        right = np.clip(np.searchsorted(self.t, t, side="left"), 1, len(self.t) - 1)
        near = (self.t[right] - self.t[right - 1] <= LONGEST_STEP_S) | (self.t[right] == t)
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        found = np.column_stack([np.interp(t, self.t, column) for column in self.q.T])
        found[~(near & inside)] = np.nan
        return found


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTracking:
    """What was found.

    Attributes
    ----------
    joints:
        Their names (J).
    samples:
        How many samples could be compared with a command.
    delay_s:
        The delay of all joints that explains most of the distance [s]; ``None``: none does.
    error:
        Largest distance of each joint from its command at that delay (J,) [rad; m].
    at_s:
        When it had it (J,) [s since the first sample].
    without_delay:
        The same without a delay (J,).
    """

    joints: tuple[str, ...]
    samples: int
    delay_s: float | None
    error: FloatArray
    at_s: FloatArray
    without_delay: FloatArray

    @property
    def worst(self) -> int:
        """Number of the joint with the largest error."""
        return int(np.argmax(self.error))

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON has it."""
        rows = zip(self.joints, self.error, self.at_s, self.without_delay, strict=True)
        return {
            "samples": self.samples,
            "delay_s": self.delay_s,
            "joints": [
                {"name": name, "error": float(error), "at_s": float(at), "error_without_delay": float(plain)}
                for name, error, at, plain in rows
            ],
        }


Blocks = Callable[[], Iterable[tuple[Samples, Samples]]]
"""Gives stretches of a recording in order of time: measured samples, and the commands around them."""


def measure_tracking(
    joints: tuple[str, ...], measured: Samples, commanded: Samples
) -> MeasuredTracking | None:
    """Fit one delay and measure the errors; ``None``: fewer than ten samples lie beside commands."""
    origin = measured.t[0]
    block = Samples(measured.t - origin, measured.q), Samples(commanded.t - origin, commanded.q)
    return measure_blocks(joints, lambda: [block])


def measure_blocks(joints: tuple[str, ...], blocks: Blocks) -> MeasuredTracking | None:
    """Fit one delay to the stretch farthest from its commands, and measure the errors of all.

    ``blocks`` is asked twice; no more than two stretches are kept. ``None``: fewer than ten samples lie
    beside commands.
    """
    plain, most = _Worst(len(joints)), -1.0
    farthest: tuple[Samples, Samples] | None = None
    for measured, commanded in blocks():
        squares = plain.add(measured.t, measured.q - commanded.at(measured.t))
        if squares > most:
            most, farthest = squares, (measured, commanded)
    if farthest is None or plain.samples < FEWEST_SAMPLES:
        return None
    delay = _fit(*farthest)
    worst = plain
    if delay is not None:
        worst = _Worst(len(joints))
        for measured, commanded in blocks():
            worst.add(measured.t, measured.q - commanded.at(measured.t - delay))
    if not worst.samples:
        return None
    return MeasuredTracking(joints, worst.samples, delay, worst.error, worst.at_s, plain.error)


class _Worst:
    """The largest distance of each joint from its command so far, and when it had it."""

    def __init__(self, joints: int) -> None:
        self.samples = 0
        self.error = np.full(joints, -1.0)
        self.at_s = np.zeros(joints)

    def add(self, t: FloatArray, away: FloatArray) -> float:
        """Take in a stretch, ``away (T, J)``, NaN where there is no command; return its sum of squares."""
        known = np.isfinite(away).all(axis=1)
        self.samples += int(np.count_nonzero(known))
        if not known.any():
            return -1.0
        error, times = np.abs(away[known]), t[known]
        rows = np.argmax(error, axis=0)
        largest = error[rows, np.arange(error.shape[1])]
        more = largest > self.error
        self.error[more], self.at_s[more] = largest[more], times[rows][more]
        return float((error**2).sum())


def _fit(measured: Samples, commanded: Samples) -> float | None:
    """The delay [s] that leaves the smallest sum of squares over all joints; ``None``: none explains it."""
    longest = min(LONGEST_DELAY_S, 0.25 * float(commanded.t[-1] - commanded.t[0]))
    early = measured.t >= commanded.t[0] + longest  # samples that every delay can be tried on
    rows = np.flatnonzero(early & (measured.t <= commanded.t[-1]))
    rows = rows[:: max(1, len(rows) // FITTED_SAMPLES)]
    if len(rows) < FEWEST_SAMPLES or longest <= 0.0:
        return None
    t, q = measured.t[rows], measured.q[rows]

    def left(delay: float) -> float:
        squares = (q - commanded.at(t - delay)) ** 2
        return float(np.nanmean(squares)) if np.isfinite(squares).any() else np.inf

    step = min(longest / STEPS, 0.25 * float(np.median(np.diff(measured.t))))
    tried = np.linspace(0.0, longest, max(STEPS, min(4 * STEPS, int(longest / step))) + 1)
    sums = np.array([left(delay) for delay in tried])
    best = int(np.argmin(sums))
    if best == len(tried) - 1:
        return None
    bounds = float(tried[max(best - 1, 0)]), float(tried[best + 1])
    found = minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": FINEST_S})
    least, delay = min((float(found.fun), float(found.x)), (float(sums[best]), float(tried[best])))
    return delay if delay > FINEST_S and least <= (1.0 - EXPLAINS) * sums[0] else None


def outside_commands(measured: Samples, commanded: Samples, delay: tuple[float, float]) -> FloatArray:
    """Return how far each sample lies outside of what was commanded within the delays (T, J) [rad; m].

    A joint is within e_j of some command between t - ``delay[1]`` and t - ``delay[0]`` iff its number is at
    most e_j: the rule of :class:`verifier.tracking.TrackingMonitor`. NaN where nobody knows the commands.
    """
    begin, end = measured.t - delay[1], measured.t - delay[0]
    first, last = commanded.at(begin), commanded.at(end)
    low, high = np.minimum(first, last), np.maximum(first, last)
    inside = np.column_stack(
        [np.searchsorted(commanded.t, begin, "left"), np.searchsorted(commanded.t, end, "right")]
    )
    some = inside[:, 1] > inside[:, 0]
    if some.any():
        places = inside[some].ravel()
        padded = np.vstack([commanded.q, commanded.q[-1:]])  # an end may stand behind the last command
        low[some] = np.minimum(low[some], np.minimum.reduceat(padded, places, axis=0)[::2])
        high[some] = np.maximum(high[some], np.maximum.reduceat(padded, places, axis=0)[::2])
    away: FloatArray = np.maximum(np.maximum(low - measured.q, measured.q - high), 0.0)
    return away
