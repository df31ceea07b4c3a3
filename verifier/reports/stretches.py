"""Stretches of consecutive cycles with the same outcome: when, rather than how often."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from verifier.verdict import Reason, Status

if TYPE_CHECKING:
    from verifier.reports.verification import PerCycle


class Stretch(NamedTuple):
    """Cycles ``first`` … ``last`` in a row with one status; the reason is that of most of them."""

    first: int
    last: int
    status: Status
    reason: Reason

    @property
    def cycles(self) -> int:
        """How many."""
        return self.last - self.first + 1


def stretches(rows: PerCycle, wanted: Sequence[Status]) -> list[Stretch]:
    """Return the stretches with a status in ``wanted``, in order of time."""
    found = [
        Stretch(begin, end - 1, status, _most_frequent(rows.reason[begin:end]))
        for status in wanted
        for begin, end in runs(rows.status == int(status))
    ]
    return sorted(found)


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end (exclusive) of every run of True in ``mask`` (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _most_frequent(reasons: NDArray[Any]) -> Reason:
    values, counts = np.unique(reasons, return_counts=True)
    return Reason(int(values[np.argmax(counts)]))
