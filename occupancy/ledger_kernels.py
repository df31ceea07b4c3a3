"""Compiled opening of obligations, and the quick proof of those that boxes already keep apart."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.kernels import LARGEST, ROUNDING, in_order
from occupancy.sets import MAX_MODELS
from robots.motion import Block

Array = NDArray[np.float64]
Record = Any


@njit(cache=True, error_model="numpy")
def open_moving(
    ledger: Block,
    links: Block,
    slices: Block,
    reach: Array,
    speed: float,
    error: float,
    n_people: int,
    parts: int,
    commanded: NDArray[np.uint8],
) -> int:
    """Open ``parts`` of every person for each slice and link that moves; return how many pairs were opened.

    A link rests on a slice iff it is not ``commanded`` (L,), no point of it can be faster than ``speed``
    [m/s], and tracking errors displace none by more than ``error`` [m]; ``reach (L, J)``: distances from the
    joints' axes [m]. What is NaN counts as moving. There must be one row for each slice and link, in that
    order.
    """
    book, arm, plan = ledger[0], links[0], slices[0]
    n_slices, n_joints = plan.n, plan.n_joints
    n_links = arm.n // n_slices
    book.n_slices, book.n_links, book.n_people = n_slices, n_links, n_people
    opened = 0
    for link in range(n_links):
        displaced = 0.0
        for j in range(n_joints):
            displaced += reach[link, j] * plan.q_error[j]
        steady = displaced <= error and commanded[link] == 0
        for i in range(n_slices):
            rests = steady and arm.speed_max[i * n_links + link] <= speed
            for k in range(n_people):
                book.open[i, link, k] = np.uint32(0 if rests else parts)
            opened += 0 if rests else n_people
    return opened


@njit(cache=True, error_model="numpy")
def count_people(people: Block) -> tuple[int, int]:
    """Rows of a people block; the same and one more where people may be there whom nobody lists."""
    rows = people[0]
    return rows.n, rows.n + (1 if rows.unlisted != 0 else 0)


@njit(cache=True, error_model="numpy")
def anything_open(ledger: Block) -> bool:
    """Whether some obligation is not proven."""
    book = ledger[0]
    left = np.uint32(0)
    for i in range(book.n_slices):
        for link in range(book.n_links):
            for k in range(book.n_people):
                left |= book.open[i, link, k]
    return bool(left != 0)


@njit(cache=True, error_model="numpy")
def _box_of_row(rows: Record, row: int, box: Array, union: bool) -> None:
    """Write the box around a row into ``box (2, 3)``, or widen it; NaN if the row is not usable."""
    count, radius = rows.n_points[row], rows.radius[row]
    usable = 1 <= count <= rows.points.shape[1] and 0.0 <= radius <= LARGEST
    for axis in range(3):
        low, high = np.inf, -np.inf
        for p in range(count if usable else 0):
            value = rows.points[row, p, axis]
            usable = usable and abs(value) <= LARGEST
            low, high = min(low, value), max(high, value)
        low, high = low - radius, high + radius
        if not usable:
            low = high = np.nan
        # NaN stays: what is not usable is nowhere in particular
        box[0, axis] = np.minimum(box[0, axis], low) if union else low
        box[1, axis] = np.maximum(box[1, axis], high) if union else high


@njit(cache=True, error_model="numpy")
def _box_gap(a: Array, b: Array) -> float:
    """Lower bound [m] on the distance of two boxes, 0 where they meet; NaN if one is not usable."""
    square, size = 0.0, 0.0
    for axis in range(3):
        apart = np.maximum(np.maximum(b[0, axis] - a[1, axis], a[0, axis] - b[1, axis]), 0.0)
        square += apart * apart
        for end in range(2):
            size = max(size, abs(a[end, axis]), abs(b[end, axis]))
    gap: float = np.sqrt(square) - 4.0 * ROUNDING * size
    return gap


@njit(cache=True, error_model="numpy")
def prove_apart(
    links: Block, people: Block, ledger: Block, margin: float, boxes: Array, found: NDArray[np.int64]
) -> float:
    """Clear the obligations for which the boxes around link and person are more than ``margin`` apart.

    A box encloses all rows of a person on a slice, of whatever model, so that every part that one of them
    covers is separated for all rows. ``boxes (K + 1, 2, 3)`` is scratch. Returns the smallest gap [m] that
    proved something, ``inf`` if none; ``found`` = its slice, link and person. The blocks must be in order
    (:func:`occupancy.kernels.classify`): else nothing is proven.
    """
    arm, crowd, book = links[0], people[0], ledger[0]
    n_slices, n_links, n_people = book.n_slices, book.n_links, book.n_people
    least = np.inf
    covered = np.zeros(boxes.shape[0], dtype=np.uint32)
    last = boxes.shape[0] - 1
    if not (
        in_order(arm.first, arm.n, n_slices, arm.radius.shape[0])
        and in_order(crowd.first, crowd.n, n_slices, crowd.radius.shape[0])
        and 0 <= n_links <= book.open.shape[1]
        and 0 <= n_people <= min(book.open.shape[2], last)
        and arm.n == n_slices * n_links
    ):
        return least
    for i in range(n_slices):
        begin, end = crowd.first[i], crowd.first[i + 1]
        if arm.first[i] != i * n_links:
            return least
        covered[:] = 0
        sound = True
        for b in range(begin, end):
            k = crowd.owner[b]
            sound = sound and crowd.slice[b] == i and 0 <= k < last and 0 <= crowd.model[b] < MAX_MODELS
            if sound:
                _box_of_row(crowd, b, boxes[k], covered[k] != 0)
                covered[k] |= crowd.covers[b]
        if not sound:
            continue
        for a in range(arm.first[i], arm.first[i] + n_links):
            link = arm.owner[a]
            if not (link == a - arm.first[i] and arm.slice[a] == i):
                continue
            _box_of_row(arm, a, boxes[last], False)
            for k in range(n_people):
                open_ = book.open[i, link, k]
                if open_ != 0 and open_ & ~covered[k] == 0:
                    gap = _box_gap(boxes[last], boxes[k])
                    if gap > margin:
                        book.open[i, link, k] = 0
                        if gap < least:
                            least = gap
                            found[0], found[1], found[2] = i, link, k
    return least
