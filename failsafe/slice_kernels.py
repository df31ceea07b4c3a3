"""Compiled slices of a proven path motion: joint states at their ends, bounds of dq and ddq in between."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.limit_kernels import (
    ACCELERATION_LIMIT,
    VELOCITY_LIMIT,
    append_and_prove,
    bound_motion,
    chain_rule,
    prove_steady,
)
from failsafe.path_kernels import ACCEPTED, path_state
from failsafe.trajectory_kernels import evaluate, locate
from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def slice_length(times: Array, segments: int, most: int, length: float) -> float:
    """Return the slice length >= ``length`` [s] for which ``segments`` fill no more than ``most`` slices."""
    total = times[segments] - times[0]
    if not 0.0 <= total < np.inf:
        return length
    needed = 0
    for k in range(segments):
        needed += max(1, int(np.ceil((times[k + 1] - times[k]) / length)))
    if needed <= most:
        return length
    return float(max(length, total / (most - segments)))


@njit(cache=True, error_model="numpy")
def slices_of(duration: float, length: float) -> int:
    """Return how many slices of about ``length`` [s] a segment makes; more than there may be: too many."""
    if not duration / length <= MAX_SLICES:
        return MAX_SLICES + 1
    return max(1, int(np.ceil(duration / length * (1.0 - 1e-12))))


@njit(cache=True, error_model="numpy")
def write_path_slices(
    path: Block,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    begin: float,
    length: float,
    slices: Block,
    work: Block,
) -> None:
    """Cut a proven path motion into slices of about ``length`` [s] that straddle no switch of the path jerk.

    ``begin`` [s] is the begin of the plan on the slices' clock. The bounds are those of the enclosures, or
    the joint limits ``(5, n)`` where these are smaller: ``proven`` has shown that they hold. No slices if
    there would be more than the block holds, or a bound is not finite.
    """
    rec, out = path[0], slices[0]
    n = coefficients.shape[2]
    row = 0
    out.n = 0
    for k in range(rec.n):
        t0, t1 = rec.t[k], rec.t[k + 1]
        parts = slices_of(t1 - t0, length)
        if row + parts > MAX_SLICES:
            return
        m = locate(breaks, path_state(path, k, t0)[0])
        for part in range(parts):
            tau0 = t0 + (t1 - t0) * part / parts
            tau1 = t1 if part == parts - 1 else t0 + (t1 - t0) * (part + 1) / parts
            m = bound_motion(path, k, tau0, tau1, breaks, coefficients, m, work)
            out.t[row] = begin + tau0
            for i in range(n):
                out.dq_max[row, i] = np.minimum(
                    np.maximum(-work[0].dq[0, i], work[0].dq[1, i]), limits[VELOCITY_LIMIT, i]
                )
                out.ddq_max[row, i] = np.minimum(
                    np.maximum(-work[0].ddq[0, i], work[0].ddq[1, i]), limits[ACCELERATION_LIMIT, i]
                )
                if not (out.dq_max[row, i] < np.inf and out.ddq_max[row, i] < np.inf):
                    return
            _write_node(path, k, tau0, breaks, coefficients, row, slices, work)
            row += 1
    out.n = row
    out.t[row] = begin + rec.t[rec.n]
    _write_node(path, rec.n - 1, rec.t[rec.n], breaks, coefficients, row, slices, work)


@njit(cache=True, error_model="numpy")
def slice_path(
    path: Block,
    breaks: Array,
    coefficients: Array,
    limits: Array,
    begin: float,
    wanted: float,
    slices: Block,
    work: Block,
    out: Array,
) -> int:
    """Cut a proven path motion into slices of ``wanted`` [s], longer where there would be too many.

    Returns how many there are, 0 if it cannot be done; ``out`` = duration of the plan [s], s at its end.
    """
    rec = path[0]
    length = slice_length(rec.t, rec.n, MAX_SLICES, wanted)
    write_path_slices(path, breaks, coefficients, limits, begin, length, slices, work)
    out[0], out[1] = rec.t[rec.n], rec.s_end
    return int(slices[0].n)


@njit(cache=True, error_model="numpy")
def steady_plan(
    path: Block,
    piece: tuple[float, float, float, float],
    stop: tuple[float, float, float, float],
    profile: tuple[Array, Array],
    breaks: Array,
    coefficients: Array,
    limits: Array,
    step: float,
    positions: bool,
    slices: Block,
    work: Block,
    out: Array,
) -> bool:
    """Make a plan of constant ṡ and a stop; tell whether it is accepted, proven and in ``slices``.

    ``piece`` = (s, ṡ, duration, s_max), ``stop`` = (a_s, j_s, begin of the plan, slice length), ``profile``
    as in append_profile. ``out`` = duration of the plan, s at its end. If any of it fails, no slice is left.
    """
    s, v, duration, s_max = piece
    a_s, j_s, begin, wanted = stop
    slices[0].n = 0
    if not prove_steady(path, s, v, duration, breaks, coefficients, limits, step, positions, work, out):
        return False
    if not out[0] <= s_max:
        return False
    first, start, change = path[0].n, (out[0], v, 0.0), (0.0, a_s, j_s, s_max)
    verdict = append_and_prove(
        path, first, start, change, profile, breaks, coefficients, limits, step, positions, work
    )
    if verdict != ACCEPTED:
        return False
    return slice_path(path, breaks, coefficients, limits, begin, wanted, slices, work, out) > 0


@njit(cache=True, error_model="numpy")
def _write_node(
    path: Block, k: int, tau: float, breaks: Array, coefficients: Array, row: int, slices: Block, work: Block
) -> None:
    out, rec = slices[0], work[0]
    s, v, a, j = path_state(path, k, tau)
    evaluate(breaks, coefficients, s, rec.lo)
    chain_rule(rec.lo, max(v, 0.0), a, j, coefficients.shape[2], rec.hi)
    for i in range(coefficients.shape[2]):
        out.q[row, i], out.dq[row, i], out.ddq[row, i] = rec.hi[0, i], rec.hi[1, i], rec.hi[2, i]
