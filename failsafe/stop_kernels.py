"""Compiled stops from a steady path speed (s̈ = 0): profile, search, proof in one call, for one plan or many.

Offline every cycle starts like that. The profile is then three segments in closed form; it is held against
the same acceptance test and the same proof as one that ruckig returns (docs/method.md, section 2).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from failsafe.limit_kernels import NOT_PROVEN, append_and_prove, proven
from failsafe.path_kernels import ACCEPTED, BEYOND_PATH, begin_path, path_state
from failsafe.search_kernels import Record, conservative_budget, look_ahead, predict_quickest
from failsafe.slice_kernels import slice_length, slices_of
from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]

NO_PROFILE = 7
"""As manoeuvre.Acceptance.NO_PROFILE: nothing was tried, or the last pair of limits has no profile."""

SEARCH = np.dtype(
    [
        ("a", np.float64),
        ("j", np.float64),
        ("candidates", np.int64),
        ("witness", np.int64),
        ("pair", np.float64, (2,)),
        ("durations", np.float64, (3,)),
        ("jerks", np.float64, (3,)),
    ]
)
"""Result of a search: path acceleration and jerk of the stop, how many candidates were tried, whether the
proof of one left a witness; and scratch."""

READY, STATE_BEYOND_LIMITS, ELSE = 0, 1, 2
"""Of plan_stops: a plan; the piece exceeds a limit; anything else, to be found out by a plan of its own."""


@njit(cache=True, error_model="numpy")
def profile_from_steady(v: float, a_s: float, j_s: float, durations: Array, jerks: Array) -> bool:
    """Write the time-optimal stop from ṡ = ``v``, s̈ = 0 with |s̈| <= ``a_s``, |s⃛| <= ``j_s``: three segments.

    ``durations, jerks (3,)`` [s, 1/s²]: build-up, hold and release of the deceleration. False: there is none.
    """
    if not (v >= 0.0 and 0.0 < a_s < np.inf and 0.0 < j_s < np.inf):
        return False
    build, hold = np.sqrt(v / j_s), 0.0
    if build * j_s > a_s:
        build = a_s / j_s
        hold = max(v / a_s - build, 0.0)
    durations[0], durations[1], durations[2] = build, hold, build
    jerks[0], jerks[1], jerks[2] = -j_s, 0.0, j_s
    return True


@njit(cache=True, error_model="numpy")
def _candidate(
    path: Block,
    first: int,
    start: tuple[float, float, float],
    breaks: Array,
    coefficients: Array,
    limits: Array,
    proof: tuple[float, bool],
    work: Block,
    search: Block,
) -> int:
    """Try the pair of limits in ``search``; return the verdict of append_and_prove, or ``NO_PROFILE``.

    ``start`` = (s, ṡ, s_max), ``proof`` = (step [s], whether positions are held against their limits).
    """
    found = search[0]
    a_s, j_s = found.pair[0], found.pair[1]
    found.candidates += 1
    if not profile_from_steady(start[1], a_s, j_s, found.durations, found.jerks):
        return NO_PROFILE
    verdict = append_and_prove(
        path,
        first,
        (start[0], start[1], 0.0),
        (0.0, a_s, j_s, start[2]),
        (found.durations, found.jerks),
        breaks,
        coefficients,
        limits,
        proof[0],
        proof[1],
        work,
    )
    if verdict == NOT_PROVEN:
        found.witness = 1
    if verdict == ACCEPTED:
        found.a, found.j = a_s, j_s
    return verdict


@njit(cache=True, error_model="numpy")
def search_stop(
    path: Block,
    first: int,
    start: tuple[float, float, float],
    breaks: Array,
    coefficients: Array,
    limits: Array,
    proof: tuple[float, bool],
    shares: tuple[Array, Array, int],
    ahead: Block,
    work: Block,
    search: Block,
) -> int:
    """Put the first proven stop from a steady speed into ``path`` behind its ``first`` segments.

    ``start`` = (s, ṡ, s_max); ``shares`` = shares of the joint limits that candidates are predicted to keep:
    those below 1 in their order, those to be tried where not even the first of them is predicted, and how
    many candidates at most. Returns the verdict on the last candidate, ``ACCEPTED`` if it is in ``path``.
    """
    found = search[0]
    found.a = found.j = np.nan
    found.candidates = found.witness = 0
    s, v, s_max = start
    look_ahead(breaks, coefficients, s, v, 0.0, 0.0, limits, ahead, work)
    tighter, looser, left = shares
    predicted = predict_quickest(v, 0.0, 0.0, limits, tighter[0], ahead, found.pair)
    margins = tighter if predicted else looser
    verdict = NO_PROFILE
    for k in range(margins.shape[0]):
        if left == 0:
            break
        known = predicted and k == 0
        if not (known or predict_quickest(v, 0.0, 0.0, limits, margins[k], ahead, found.pair)):
            continue
        left -= 1
        verdict = _candidate(path, first, start, breaks, coefficients, limits, proof, work, search)
        if verdict in (ACCEPTED, BEYOND_PATH):
            return verdict
    if conservative_budget(breaks, coefficients, s, v, 0.0, s_max, limits, work, found.pair):
        return _candidate(path, first, start, breaks, coefficients, limits, proof, work, search)
    return verdict


PLANS = np.dtype(
    [
        ("outcome", np.int64),
        ("duration", np.float64),
        ("s_rest", np.float64),
        ("longest", np.float64),
        ("n", np.int64),
        ("t", np.float64, (MAX_SLICES + 1,)),
        ("s", np.float64, (MAX_SLICES + 1,)),
    ]
)
"""A plan without its joint motion: duration [s], s at rest, longest slice [s]; at its ``n`` + 1 slice ends
the instants [s, from the begin of the plan] and s."""


@njit(cache=True, error_model="numpy")
def plan_stops(
    begins: Array,
    cycle: float,
    breaks: Array,
    coefficients: Array,
    s_max: float,
    limits: Array,
    proof: tuple[float, bool],
    shares: tuple[Array, Array, int],
    path: Block,
    ahead: Block,
    work: Block,
    search: Block,
    plans: Block,
) -> None:
    """Plan piece [s, s + cycle] at ṡ = 1 and stop for every s of ``begins (N,)`` into ``plans (N,)``.

    The same pieces, stops and slices as ShortTermPlanner.plan with ṡ = 1: the same code makes them. Every s
    and the piece from it on must lie on the path.
    """
    for row in range(begins.shape[0]):
        s = begins[row]
        out = plans[row]
        out.outcome, out.n = ELSE, 0
        begin_path(path, s, 1.0, 0.0, cycle)
        if not proven(path, 0, 1, breaks, coefficients, limits, proof[0], proof[1], work):
            out.outcome = STATE_BEYOND_LIMITS
            continue
        start = (s + cycle * (1.0 + 0.5 * 0.0 * cycle), 1.0, s_max)
        verdict = search_stop(
            path, 1, start, breaks, coefficients, limits, proof, shares, ahead, work, search
        )
        if verdict == ACCEPTED and _slice_ends(path, proof[0], out):
            out.outcome = READY


@njit(cache=True, error_model="numpy")
def _slice_ends(path: Block, wanted: float, out: Record) -> bool:
    """Write instants and s at the slice ends of a plan; False if it has more than there may be.

    They are those of slice_kernels.slice_path.
    """
    rec = path[0]
    length = slice_length(rec.t, rec.n, MAX_SLICES, wanted)
    row = 0
    out.longest = 0.0
    for k in range(rec.n):
        t0, t1 = rec.t[k], rec.t[k + 1]
        parts = slices_of(t1 - t0, length)
        if row + parts > MAX_SLICES:
            return False
        for part in range(parts):
            tau = t0 + (t1 - t0) * part / parts
            out.t[row] = tau
            out.s[row] = path_state(path, k, tau)[0]
            row += 1
        out.longest = max(out.longest, (t1 - t0) / parts * (1.0 + 1e-9))
    out.t[row], out.s[row] = rec.t[rec.n], path_state(path, rec.n - 1, rec.t[rec.n])[0]
    out.n = row
    out.duration, out.s_rest = rec.t[rec.n], rec.s_end
    return row > 0
