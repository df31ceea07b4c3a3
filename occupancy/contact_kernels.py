"""Compiled part of power and force limiting: which obligations a slow link does not have."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robots.motion import Block

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def clear_slow(links: Block, ledger: Block, speed: Array) -> bool:
    """Clear the parts that a link may touch on a slice; whether any bit was cleared.

    ``speed`` (L, P) [m/s]: a link may touch a part if no point of it is faster on the slice; NaN and
    ``-inf`` permit nothing. Rows that do not belong to their slice and link prove nothing.
    """
    arm, book = links[0], ledger[0]
    n_slices, n_links = book.n_slices, book.n_links
    cleared = False
    if not (arm.n == n_slices * n_links and 0 <= n_links <= speed.shape[0]):
        return cleared
    for i in range(n_slices):
        for link in range(n_links):
            row = i * n_links + link
            if not (arm.slice[row] == i and arm.owner[row] == link and arm.n_points[row] > 0):
                continue
            may = np.uint32(0)
            for part in range(speed.shape[1]):
                if arm.speed_max[row] <= speed[link, part]:
                    may |= np.uint32(1) << np.uint32(part)
            for k in range(book.n_people):
                if book.open[i, link, k] & may != 0:
                    book.open[i, link, k] &= ~may
                    cleared = True
    return cleared
