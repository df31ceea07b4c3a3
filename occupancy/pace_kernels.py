"""Compiled comparison of people with where they were in the last half second."""

from __future__ import annotations

import numpy as np
from numba import njit

from occupancy.humans.kernels import ROUNDING_M, Array
from robots.motion import Block


@njit(cache=True, error_model="numpy")
def outpaced(people: Block, row: int, past: Block, speed: Array) -> tuple[int, int, float, float]:
    """Find the point of a row that went farthest beyond what its ``speed`` (20,) [m/s] allows.

    Blocks: PEOPLE and PAST. Point p contradicts a moment iff |x_p(t) - x_p(t')| > speed(p) |t - t'| + e_p +
    e_p' + what stamps may be wrong. Points that may be on the other side of the body have no past. Returns
    (p, moment, distance, allowed) [m]; p = -1: none.
    """
    seen, kept = people[0], past[0]
    slack = 2.0 * (seen.stamp_error + seen.clock_error)
    worst, worst_p, worst_m, worst_d, worst_allowed = 0.0, -1, -1, 0.0, 0.0
    for p in range(speed.shape[0]):
        if not ((seen.present[row] >> p) & 1 and speed[p] < np.inf):
            continue
        if not seen.e_p[row, p] <= seen.e_read[row, p]:
            kept.t[:, p] = np.nan
            continue
        x, t = seen.xyz[row, p], seen.t_obs[row, p]
        for m in range(kept.t.shape[0]):
            if not np.isfinite(kept.t[m, p]):
                continue
            y = kept.xyz[m, p]
            distance = np.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
            grown = speed[p] * (abs(t - kept.t[m, p]) + slack)
            allowed = grown + seen.e_p[row, p] + kept.e_p[m, p] + ROUNDING_M
            if not distance - allowed <= worst:
                worst, worst_p, worst_m, worst_d, worst_allowed = distance - allowed, p, m, distance, allowed
    return worst_p, worst_m, worst_d, worst_allowed


@njit(cache=True, error_model="numpy")
def keep_moment(people: Block, row: int, past: Block, least_s: float) -> None:
    """Keep where the points of a row are, if its newest was seen ``least_s`` [s] after the last moment kept.

    Takes the place of the oldest moment.
    """
    seen, kept = people[0], past[0]
    moments, newest = kept.t.shape[0], -np.inf
    for p in range(kept.t.shape[1]):
        if (seen.present[row] >> p) & 1:
            newest = max(newest, seen.t_obs[row, p])
    if not newest >= kept.newest + least_s:
        return
    kept.newest = newest
    m = kept.n % moments
    kept.n += 1
    for p in range(kept.t.shape[1]):
        own = (seen.present[row] >> p) & 1 and seen.e_p[row, p] <= seen.e_read[row, p]
        kept.t[m, p] = seen.t_obs[row, p] if own else np.nan
        kept.xyz[m, p] = seen.xyz[row, p]
        kept.e_p[m, p] = seen.e_p[row, p]
