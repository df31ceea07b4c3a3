"""How fast the joints of a recording are, sample by sample, and when all of them stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verifier.recordings.motion import RecordedMotion

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STANDSTILL_RAD_S = 0.01
"""Default of the speed below which a joint stands still [rad/s, m/s]."""
SPAN_S = 0.02
"""Speeds that are not recorded are those of the positions over this time [s], or one sample if that is more:
over less, encoder steps of 1e-4 rad would look like motion."""
REST_S = 0.1
"""All joints stand still for this long [s]: less may be a turning point."""


@dataclass(frozen=True, slots=True, eq=False)
class Speeds:
    """Speeds of a recorded motion.

    Attributes
    ----------
    v:
        ``(T, J)`` as recorded, else mean velocity on the window that begins with the sample [rad/s, m/s].
    last:
        ``(T,)`` index of the last sample on which ``v`` rests; the sample itself where ``v`` was recorded.
    moving:
        ``(T,)`` whether some joint moves, by the positions or by what was recorded as velocity.
    """

    v: FloatArray
    last: NDArray[np.intp]
    moving: BoolArray

    @property
    def fastest(self) -> FloatArray:
        """``(T,)`` speed of the fastest joint."""
        fastest: FloatArray = np.abs(self.v).max(axis=1)
        return fastest


def speeds(motion: RecordedMotion, standstill: float) -> Speeds:
    """Return the speeds of a motion; ``standstill`` [rad/s, m/s]: below it a joint stands still."""
    samples = np.arange(len(motion.t))
    moving = np.zeros(len(motion.t), np.bool_)
    v, last = motion.dq, samples
    if motion.q is not None:
        windowed, ends = over_windows(motion.t, motion.q)
        moving |= (np.abs(windowed) > standstill).any(axis=1)
        if v is None:
            v, last = windowed, ends
    if motion.dq is not None:
        moving |= (np.abs(motion.dq) > standstill).any(axis=1)
    assert v is not None, "a motion has positions or velocities"
    return Speeds(v, last, moving)


def over_windows(t: FloatArray, q: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the mean velocity (T, J) from each sample on, over ``SPAN_S`` or one step, and the last sample.

    The last samples, from which there is no whole window, have the velocity of the last window.
    """
    n = len(t)
    ends = np.maximum(np.searchsorted(t, t + SPAN_S), np.arange(n) + 1)
    whole = int(np.count_nonzero(ends < n))
    if whole == 0:
        return np.full(q.shape, np.inf), np.full(n, n - 1)  # too short to tell: it counts as moving
    ends[whole:] = n - 1
    begins = np.minimum(np.arange(n), whole - 1)
    v = (q[ends] - q[begins]) / (t[ends] - t[begins])[:, None]
    v[whole:] = v[whole - 1]
    return v, ends


def standstills(t: FloatArray, moving: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last sample of every stretch on which all joints stand still for ``REST_S``.

    One that the recording ends must be as long: the arm may have gone on after it.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(np.int8)))
    found = []
    for first, after in edges.reshape(-1, 2):
        if t[after - 1] - t[first] >= REST_S:
            found.append((int(first), int(after) - 1))
    return found
