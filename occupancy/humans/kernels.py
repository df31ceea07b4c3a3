"""Compiled reading of reports, and compiled occupancy of people.

Every test is written so that NaN fails it: a number that is not finite is never admitted and never gives a
row.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, MAX_PARTS, MAX_POINTS, Point
from robots.motion import Block

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Record = Any
"""One record of a block: its fields are attributes in compiled code."""

READ, INFERRED, NOT_FINITE, ZERO, BAD_ERROR, TOO_FAR, LIMB, REPEATED, UNCOMPARED, SHAPE = range(10)
"""Why a point of a report is not a measurement; ``READ``: it is one, or it was not reported at all."""
ROUNDING_M = 1e-9
"""Reports on the very edge of what is possible do not contradict because of rounding [m]."""
SIDES = np.array([[point, Point["R" + point.name[1:]]] for point in Point if point.name.startswith("L_")])
"""Points on the left and their counterparts on the right."""
LARGEST_M = 1e6
"""Coordinates, errors and radii beyond this give no row [m]; keeps all arithmetic far from overflow."""

BODIES: Final = np.dtype(
    [
        ("e_p", np.float64, (MAX_POINTS,)),
        ("grown", np.float64, (MAX_POINTS,)),
        ("ends", np.float64, (2, MAX_POINTS, 3)),
        ("n", np.int64),
        ("n_points", np.int64, (MAX_PARTS,)),
        ("point", np.int64, (MAX_PARTS, 4)),
        ("radius", np.float64, (MAX_PARTS,)),
        ("covers", np.int64, (MAX_PARTS,)),
    ]
)
"""Somebody on one slice: each point lies within ``grown`` [m, NaN: not usable] of its place, or of the line
between two for points that move on (``ends``); and the rows that the table has for what was seen."""


@njit(cache=True, error_model="numpy")
def read_points(xyz: Array, error: Array, frame: Record, body: Record, out: Record) -> None:
    """Read the points of one person of one report into ``out`` (a READING record).

    ``xyz`` (20, 3) [m, sensor frame], NaN = missing; ``error`` (20,) [m], NaN = not stated; ``out.measured``
    says on entry which points the tracker measured. Writes world coordinates, position errors including those
    of the frame (|x_true - x| <= e + |Δt| + |R_true - R| |p|, docs/method.md, section 1, A6), ``present`` and
    the reason for which each other point was refused. Of arrays of another shape nothing is read.
    """
    points = out.reason.shape[0]
    shaped = xyz.shape[0] == points and xyz.shape[1] == 3 and error.shape[0] == points
    for p in range(points):
        if shaped:
            out.reason[p] = _read_point(xyz[p], error[p], frame, out, p)
        else:
            out.reason[p] = SHAPE
            out.xyz[p, :] = np.nan
            out.seen[p, :] = np.nan
            out.e_p[p] = np.nan
        out.value[p] = np.nan
    _refuse_limbs(body, out)
    present = 0
    for p in range(points):
        if out.reason[p] == READ and out.xyz[p, 0] == out.xyz[p, 0]:
            present |= 1 << p
        else:
            out.xyz[p, :] = np.nan
            out.e_p[p] = np.nan
    out.present = present


@njit(cache=True, error_model="numpy")
def mark_too_far_apart(reading: Record, body: Record) -> None:
    """Note in a reading which points are farther from another one than the profile's sizes allow."""
    mask = 0
    for p in range(reading.reason.shape[0]):
        for q in range(p if (reading.present >> p) & 1 else 0):
            if (reading.present >> q) & 1:
                allowed = body.chain[p, q] + reading.e_p[p] + reading.e_p[q] + ROUNDING_M
                if not _distance(reading.xyz[p], reading.xyz[q]) <= allowed:
                    mask |= 1 << p | 1 << q
    reading.too_far_apart = mask


@njit(cache=True, error_model="numpy")
def farthest_apart(body: Record, xyz: Array, e_p: Array) -> tuple[int, int, float, float]:
    """Return the pair of points ``xyz`` (20, 3) [m] that exceeds by most what the profile's sizes allow.

    ``e_p`` (20,) [m]; NaN where there is none. Returns (p, q, distance, allowed) [m]; p = -1: none does.
    """
    worst, worst_p, worst_q, worst_d, worst_allowed = 0.0, -1, -1, 0.0, 0.0
    for p in range(xyz.shape[0]):
        for q in range(p):
            distance = _distance(xyz[p], xyz[q])
            allowed = body.chain[p, q] + e_p[p] + e_p[q] + ROUNDING_M
            if distance - allowed > worst:
                worst, worst_p, worst_q = distance - allowed, p, q
                worst_d, worst_allowed = distance, allowed
    return worst_p, worst_q, worst_d, worst_allowed


@njit(cache=True, error_model="numpy")
def _read_point(x: Array, error: float, frame: Record, out: Record, p: int) -> int:
    """Write world coordinates and error [m] of point p, seen at ``x`` (3,); NaN unless it was read.

    ``out.seen``: its world coordinates whether or not they were measured; NaN unless it is in range.
    """
    out.xyz[p, :] = np.nan
    out.seen[p, :] = np.nan
    out.e_p[p] = np.nan
    finite = np.isfinite(x[0]) and np.isfinite(x[1]) and np.isfinite(x[2])
    zero = x[0] == 0.0 and x[1] == 0.0 and x[2] == 0.0
    distance = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    near = finite and not zero and distance <= frame.range
    if near:
        for r in range(3):
            value = frame.translation[r]
            for c in range(3):
                value += frame.rotation[r, c] * x[c]
            out.seen[p, r] = value
    if not (out.measured >> p) & 1:
        return INFERRED if finite else READ
    if not finite:
        return NOT_FINITE
    if not near:
        return ZERO if zero else TOO_FAR
    own = frame.default_error if np.isnan(error) else error
    total = own + frame.translation_error + frame.chord * distance
    if not (own >= 0.0 and total <= frame.range):
        return BAD_ERROR
    out.xyz[p] = out.seen[p]
    out.e_p[p] = total
    return READ


@njit(cache=True, error_model="numpy")
def _refuse_limbs(body: Record, out: Record) -> None:
    """Refuse both ends of every limb whose measured length no person has, position errors allowed for."""
    for i in range(body.n_limbs):
        a, b = body.limb[i, 0], body.limb[i, 1]
        length = _distance(out.xyz[a], out.xyz[b])
        slack = out.e_p[a] + out.e_p[b]
        if length < body.limb_min[i] - slack or length > body.limb_max[i] + slack:
            for p in (a, b):
                out.reason[p] = LIMB
                out.value[p] = length


@njit(cache=True, error_model="numpy")
def _distance(a: Array, b: Array) -> float:
    """Euclidean distance [m] of two points (3,)."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(np.sqrt(x * x + y * y + z * z))


@njit(cache=True, error_model="numpy")
def refuse_repeats(reading: Record, known: Block) -> None:
    """Refuse the points of a reading that stand exactly where one of the ``known`` (LAST) places is.

    What was measured has noise: coordinates that do not change at all are passed on from before. Such a point
    counts as not measured, so that what was read first keeps growing from when it was seen. A place that was
    met again is the last to be given up. While a place is infinite, which stands for one that was forgotten,
    any other may be it.
    """
    for p in range(reading.reason.shape[0]):
        if not (reading.present >> p) & 1:
            continue
        first, forgotten = np.inf, False
        for i in range(known.shape[0]):
            forgotten = forgotten or np.isinf(known[i].xyz[p, -1, 0])
            place = _place_of(reading.xyz[p], known[i], p)
            if place >= 0:
                first = min(first, float(known[i].stamp[p, place]))
                _put_first(known[i], p, place, reading.xyz[p], known[i].stamp[p, place])
        if first < np.inf or forgotten:
            reading.reason[p] = REPEATED if first < np.inf else UNCOMPARED
            reading.value[p] = first if first < np.inf else np.nan
            reading.present &= ~(1 << p)
            reading.xyz[p, :] = np.nan
            reading.e_p[p] = np.nan


@njit(cache=True, error_model="numpy")
def note_reading(reading: Record, stamp: float, taken: Record, aside: Record) -> None:
    """Note what was seen, for :func:`refuse_repeats`; ``stamp`` [s] of its report.

    Points that were read, or would have been had nothing been forgotten, go to ``taken``, all others to
    ``aside`` (LAST): what was inferred, or refused for its error or as a limb, is seen too, and passed on
    later it is no new reading.
    """
    for p in range(reading.reason.shape[0]):
        if not np.isfinite(reading.seen[p, 0]) or reading.reason[p] == REPEATED:
            continue
        if reading.reason[p] in (READ, UNCOMPARED):
            _note(taken, p, reading.seen[p], stamp)
        else:
            _note(aside, p, reading.seen[p], stamp)


@njit(cache=True, error_model="numpy")
def _note(last: Record, p: int, x: Array, stamp: float) -> None:
    """Note that point p was seen at ``x`` (3,), in the stead of the place that was not met for longest."""
    place = _place_of(x, last, p)
    if place >= 0:
        _put_first(last, p, place, x, last.stamp[p, place])
    else:
        _put_first(last, p, last.stamp.shape[1] - 1, x, stamp)


@njit(cache=True, error_model="numpy")
def _place_of(x: Array, last: Record, p: int) -> int:
    """Which of the places of point p is exactly ``x`` (3,); -1: none."""
    for place in range(last.stamp.shape[1]):
        same = True
        for axis in range(3):
            same = same and x[axis] == last.xyz[p, place, axis]
        if same:
            return place
    return -1


@njit(cache=True, error_model="numpy")
def _put_first(last: Record, p: int, place: int, x: Array, stamp: float) -> None:
    """Put ``x`` (3,) in front of the places of point p; the one at ``place`` goes."""
    for i in range(place, 0, -1):
        last.xyz[p, i] = last.xyz[p, i - 1]
        last.stamp[p, i] = last.stamp[p, i - 1]
    last.xyz[p, 0] = x
    last.stamp[p, 0] = stamp


@njit(cache=True, error_model="numpy")
def widen_exchanged(people: Record, row: int, reading: Record, body: Record) -> None:
    """Widen errors of points of a reading whose left and right may be exchanged, given what a row says.

    If the names of a pair (l, r) are exchanged, then each belongs to the other: x_l is within reach of where
    the row has r, and x_r of where it has l, by the errors ``e_read`` with which they were read. Where both
    hold (or the row lacks one of them), ``e_p`` of l becomes so large that it contains what x_r says, and the
    other way round; so each is right whichever of them is which. Where one of them, a, is reported alone and
    may be the other, ``e_p`` of a becomes so large that it contains wherever a can be: after what the row
    says, or from where the other is by the longest chain between both. What is new to the row is taken as
    named.
    """
    for i in range(SIDES.shape[0]):
        left, right = SIDES[i, 0], SIDES[i, 1]
        reported = (reading.present >> left) & 1, (reading.present >> right) & 1
        if reported[0] and reported[1]:
            known = ((people.present[row] >> left) | (people.present[row] >> right)) & 1
            either = _may_be(people, row, right, reading, left, body)
            if known and either and _may_be(people, row, left, reading, right, body):
                apart = _distance(reading.xyz[left], reading.xyz[right])
                reading.e_p[left] = max(reading.e_p[left], apart + reading.e_read[right])
                reading.e_p[right] = max(reading.e_p[right], apart + reading.e_read[left])
        elif reported[0] or reported[1]:
            a, b = (left, right) if reported[0] else (right, left)
            known = (people.present[row] >> left) & (people.present[row] >> right) & 1
            if known and _may_be(people, row, b, reading, a, body):
                moved = _distance(reading.xyz[a], people.xyz[row, a])
                gone = moved + _grown(people, row, a, reading, body)
                reading.e_p[a] = max(reading.e_p[a], min(gone, body.chain[a, b] + reading.e_read[a]))


@njit(cache=True, error_model="numpy")
def _may_be(people: Record, row: int, q: int, reading: Record, p: int, body: Record) -> bool:
    """Whether point p of a reading may be point q of a row, by the errors with which both were read."""
    if not (people.present[row] >> q) & 1:
        return True
    allowed = reading.e_read[p] + _grown(people, row, q, reading, body) + ROUNDING_M
    return not _distance(reading.xyz[p], people.xyz[row, q]) > allowed


@njit(cache=True, error_model="numpy")
def _grown(people: Record, row: int, p: int, reading: Record, body: Record) -> float:
    """How far [m] point p may be from where the row read it, when the reading was seen."""
    slack = 2.0 * (people.stamp_error + people.clock_error)
    elapsed = abs(reading.t_obs - people.t_obs[row, p]) + slack
    return float(people.e_read[row, p] + body.speed[p] * elapsed)


@njit(cache=True, error_model="numpy")
def contradiction(people: Record, row: int, reading: Record, body: Record) -> tuple[int, int, float, float]:
    """Find the pair of points by which a reading contradicts a row most.

    A reading agrees with a row iff for every point p that it has and every point q of the row
    |x_p - x_q| <= chain(p, q) + speed(q) Δt + e_p + e_q, with Δt between the instants at which both were
    seen, stamp and clock errors added; chain is 0 for p = q. Returns (p, q, distance, allowed) [m]; p = -1:
    agreement.
    """
    worst, worst_p, worst_q, worst_d, worst_allowed = 0.0, -1, -1, 0.0, 0.0
    slack = 2.0 * (people.stamp_error + people.clock_error)
    points = reading.reason.shape[0]
    for q in range(points):
        if not (people.present[row] >> q) & 1:
            continue
        grown = people.e_p[row, q] + body.speed[q] * (abs(reading.t_obs - people.t_obs[row, q]) + slack)
        for p in range(points):
            if not (reading.present >> p) & 1:
                continue
            distance = _distance(reading.xyz[p], people.xyz[row, q])
            allowed = body.chain[p, q] + grown + reading.e_p[p] + ROUNDING_M
            excess = distance - allowed
            if not excess <= worst:
                worst, worst_p, worst_q, worst_d, worst_allowed = excess, p, q, distance, allowed
    return worst_p, worst_q, worst_d, worst_allowed


@njit(cache=True, error_model="numpy")
def write_points(people: Record, row: int, reading: Record) -> None:
    """Write the points of a reading over those of a row."""
    for p in range(reading.reason.shape[0]):
        if (reading.present >> p) & 1:
            people.xyz[row, p] = reading.xyz[p]
            people.e_p[row, p] = reading.e_p[p]
            people.e_read[row, p] = reading.e_read[p]
            people.t_obs[row, p] = reading.t_obs
    people.present[row] = people.present[row] | reading.present


@njit(cache=True, error_model="numpy")
def choose_rows(present: int, t_obs: Array, table: Record, picked: Indices, covers: Indices) -> int:
    """Choose for every part the row of the table that encloses it; return the number of different rows.

    A row needs all its points; the one with the shortest chain wins, where a point that is older than the
    newest one counts as farther away by age times ``table.ageing`` [m/s]. Any choice encloses the part. This
    one depends on nothing but presence, age and the profile's sizes, so that larger errors, speeds or
    latencies never change it.
    """
    newest = -np.inf
    for p in range(t_obs.shape[0]):
        if (present >> p) & 1 and t_obs[p] > newest:
            newest = t_obs[p]
    n = 0
    for part in range(table.n_options.shape[0]):
        best, best_row = np.inf, -1
        for o in range(table.n_options[part]):
            row = table.option[part, o]
            if table.chain[row] >= best:
                break
            if (table.needs[row] & present) != table.needs[row]:
                continue
            oldest = newest
            for i in range(table.n_points[row]):
                oldest = min(oldest, float(t_obs[table.point[row, i]]))
            cost = table.chain[row] + table.ageing * (newest - oldest)
            if cost < best:
                best, best_row = cost, row
        if best_row < 0:
            continue
        i = 0
        while i < n and picked[i] != best_row:
            i += 1
        if i == n:
            picked[n], covers[n] = best_row, 0
            n += 1
        covers[i] |= 1 << part
    return n


@njit(cache=True, error_model="numpy")
def occupy_speed(people: Block, slices: Block, table: Block, out: Block) -> None:
    """Write the rows of docs/method.md, section 4.1 for every people row and slice; blocks as their dtypes
    say.

    On slice i a body that was seen at t_obs is looked at on [t_i + delay_0, t_i+1 + delay_1], so its points
    have moved by at most speed * Δt, Δt the greatest difference between the instant of seeing, itself known
    to [t_obs - ε, t_obs + 2 stamp error + ε], and any instant of that interval: before or after it.
    """
    _occupy(people, slices, table, table[0].speed, False, out)


@njit(cache=True, error_model="numpy")
def occupy_upright(
    people: Block, slices: Block, table: Block, heights: tuple[float, float], out: Block
) -> None:
    """Write rows as :func:`occupy_speed` does, of one point each, that becomes a vertical line.

    ``heights`` [m] of its ends: docs/method.md, section 4.4.
    """
    _occupy(people, slices, table, table[0].speed, False, out)
    written = out[0]
    for n in range(written.n):
        for end in range(2):
            written.points[n, end, 0] = written.points[n, 0, 0]
            written.points[n, end, 1] = written.points[n, 0, 1]
            written.points[n, end, 2] = heights[end]
        written.n_points[n] = 2


@njit(cache=True, error_model="numpy")
def occupy_acceleration(people: Block, slices: Block, table: Block, acceleration: Array, out: Block) -> None:
    """Write rows of points that move on with their velocities (docs/method.md, section 4.3).

    ``acceleration`` (20,) [m/s²]. Instants as for :func:`occupy_speed`. A row whose points have no bounded
    velocity is left out.
    """
    _occupy(people, slices, table, acceleration, True, out)


@njit(cache=True, error_model="numpy")
def _occupy(people: Block, slices: Block, table: Block, limit: Array, moving: bool, out: Block) -> None:
    """Write rows for every slice; ``limit`` (20,) [m/s], or [m/s²] of points that are ``moving`` on."""
    seen, plan, rows, written = people[0], slices[0], table[0], out[0]
    bodies = np.empty(seen.n, BODIES)
    for k in range(seen.n):
        _read_body(seen, k, rows, bodies[k])
    n = 0
    for i in range(plan.n):
        written.first[i] = n
        begin = plan.t[i] + plan.delay[0] - 2.0 * seen.stamp_error - seen.clock_error
        end = plan.t[i + 1] + plan.delay[1] + seen.clock_error
        for k in range(seen.n):
            if not begin <= end:
                break
            if moving:
                _move(seen, k, limit, (begin, end), bodies[k])
            else:
                _grow(seen, k, limit, (begin, end), bodies[k])
            n = _write_rows(bodies[k], 2 if moving else 1, rows, written, (n, i, k))
    for i in range(plan.n, written.first.shape[0]):
        written.first[i] = n
    written.n = n


@njit(cache=True, error_model="numpy")
def _read_body(seen: Record, k: int, rows: Record, body: Record) -> None:
    """Write what no slice changes about people row k: points, errors [m], chosen rows of the table."""
    for p in range(body.e_p.shape[0]):
        usable = seen.e_p[k, p] >= 0.0
        for axis in range(3):
            body.ends[0, p, axis] = seen.xyz[k, p, axis]
            usable = usable and abs(seen.xyz[k, p, axis]) < LARGEST_M
        body.e_p[p] = seen.e_p[k, p] if usable else np.nan
    picked = np.empty(rows.n_options.shape[0], np.int64)
    body.n = choose_rows(int(seen.present[k]), seen.t_obs[k], rows, picked, body.covers)
    for j in range(body.n):
        row = picked[j]
        body.n_points[j], body.radius[j] = rows.n_points[row], rows.radius[row]
        for m in range(body.n_points[j]):
            body.point[j, m] = rows.point[row, m]


@njit(cache=True, error_model="numpy")
def _grow(seen: Record, k: int, speed: Array, span: tuple[float, float], body: Record) -> None:
    """Write how far each point may be on a slice from where it was seen [m]; ``span``: its first and last
    instant [s]."""
    for p in range(body.e_p.shape[0]):
        after, before = span[1] - seen.t_obs[k, p], seen.t_obs[k, p] - span[0]
        body.grown[p] = body.e_p[p] + speed[p] * max(after, before)


@njit(cache=True, error_model="numpy")
def _move(seen: Record, k: int, acceleration: Array, span: tuple[float, float], body: Record) -> None:
    """Write where each point would be at both ends of ``span``, and how far from there it may be [m]."""
    for p in range(body.e_p.shape[0]):
        first, last = span[0] - seen.t_obs[k, p], span[1] - seen.t_obs[k, p]
        longest, usable = max(abs(first), abs(last)), True
        for axis in range(3):
            x, v = seen.xyz[k, p, axis], seen.v[k, p, axis]
            begin, end = x + v * first, x + v * last
            usable = usable and abs(begin) < LARGEST_M and abs(end) < LARGEST_M
            body.ends[0, p, axis], body.ends[1, p, axis] = begin, end
        grown = body.e_p[p] + longest * (seen.e_v[k, p] + 0.5 * acceleration[p] * longest)
        body.grown[p] = grown if usable else np.nan


@njit(cache=True, error_model="numpy")
def _write_rows(body: Record, ends: int, rows: Record, written: Record, at: tuple[int, int, int]) -> int:
    """Write the rows of one person and slice, as far as their numbers are usable; return the next row.

    ``ends``: how many of its ends belong to a row; ``at``: first row, slice, people row.
    """
    n, i, k = at
    for j in range(body.n):
        if n == written.radius.shape[0]:
            break
        growth, usable, points = 0.0, True, body.n_points[j]
        for m in range(points):
            p = body.point[j, m]
            usable = usable and body.grown[p] < LARGEST_M
            growth = max(growth, body.grown[p])
            for axis in range(3):
                written.points[n, m, axis] = body.ends[0, p, axis]
            if ends == 2:
                for axis in range(3):
                    written.points[n, points + m, axis] = body.ends[1, p, axis]
        if usable:
            written.n_points[n] = ends * points
            written.radius[n] = body.radius[j] + growth
            written.slice[n], written.owner[n], written.covers[n] = i, k, body.covers[j]
            written.model[n], written.speed_max[n] = rows.model, rows.speed_max
            n += 1
    return n


@njit(cache=True, error_model="numpy")
def occupy_unobserved(
    people: Block,
    slices: Block,
    faces: Array,
    rule: tuple[float, float, float, float],
    model: int,
    out: Block,
) -> None:
    """Write the rows of docs/method.md, section 4.5: for every slice and face one, of person ``people.n``.

    ``faces`` (F, 4, 3) [m]: what each row stands on; ``rule``: detection time [s], constant growth [m], speed
    [m/s], farthest growth [m]. Instants as for :func:`occupy_speed`, from the newest complete report less the
    detection time.
    """
    seen, plan, written = people[0], slices[0], out[0]
    detection, constant, speed, farthest = rule
    n = 0
    for i in range(plan.n):
        written.first[i] = n
        begin = plan.t[i] + plan.delay[0] - 2.0 * seen.stamp_error - seen.clock_error
        end = plan.t[i + 1] + plan.delay[1] + seen.clock_error
        after, before = end - (seen.t_complete - detection), seen.t_complete - begin
        growth = constant + speed * max(after, before)
        usable = seen.unlisted != 0 and after + before >= 0.0 and constant <= growth <= farthest
        if not usable or n + faces.shape[0] > written.radius.shape[0]:
            continue
        for f in range(faces.shape[0]):
            for corner in range(4):
                for axis in range(3):
                    written.points[n, corner, axis] = faces[f, corner, axis]
            written.n_points[n] = 4
            written.radius[n] = growth
            written.slice[n], written.owner[n], written.model[n] = i, seen.n, model
            written.covers[n] = ALL_PARTS
            written.speed_max[n] = speed
            n += 1
    for i in range(plan.n, written.first.shape[0]):
        written.first[i] = n
    written.n = n


@njit(cache=True, error_model="numpy")
def estimate_velocities(people: Record, row: int, reading: Record, history: Record, body: Record) -> int:
    """Write v and e_v of the points of a reading that will replace those of ``row``; note it in ``history``.

    With two positions known within e_1 and e_2, seen τ apart, τ known within s, and an acceleration of at
    most a, the velocity at the later instant is (x_2 - x_1) / τ within (e_1 + e_2) / τ + a (τ + s) / 2 + v s
    / τ: the mean velocity is that of some instant in between, and |x_2 - x_1| differs from what belongs to τ
    by at most v s (docs/method.md, section 4.3). The kept sample with the smallest bound is used.

    A reading that the velocity and acceleration of the row do not allow belies them: nothing is known about
    velocities then, and the history starts anew. Returns the point that does so most, or -1.
    """
    worst, worst_p = 0.0, -1
    slack = 2.0 * (people.stamp_error + people.clock_error)
    points = reading.reason.shape[0]
    for p in range(points):
        if (reading.present >> p) & 1 and (people.present[row] >> p) & 1 and people.e_v[row, p] < np.inf:
            excess = _excess_of_motion(people, row, p, reading.xyz[p], reading.e_p[p], reading.t_obs, body)
            if not excess <= worst:
                worst, worst_p = excess, p
    if worst_p >= 0:
        history.n[row] = 0
        people.e_v[row] = np.inf
    depth = history.t.shape[2]
    for p in range(points):
        if not (reading.present >> p) & 1:
            continue
        best = np.inf
        for i in range(min(depth, history.n[row, p])):
            apart = reading.t_obs - history.t[row, p, i]
            bound = (reading.e_p[p] + history.e_p[row, p, i] + body.speed[p] * slack) / apart
            bound += 0.5 * body.acceleration[p] * (apart + slack)
            if apart > 0.0 and bound < best:
                best = bound
                for axis in range(3):
                    people.v[row, p, axis] = (reading.xyz[p, axis] - history.xyz[row, p, i, axis]) / apart
        people.e_v[row, p] = best
        place = history.n[row, p] % depth
        history.t[row, p, place] = reading.t_obs
        history.xyz[row, p, place] = reading.xyz[p]
        history.e_p[row, p, place] = reading.e_p[p]
        history.n[row, p] += 1
    return worst_p


@njit(cache=True, error_model="numpy")
def _excess_of_motion(
    people: Record, row: int, p: int, xyz: Array, e_p: float, t_obs: float, body: Record
) -> float:
    """How far [m] a sample lies outside of where point p of a row can have come by velocity and acceleration.

    The time between is known within the slack of both stamps, so the centre is off by at most |v| slack.
    """
    slack = 2.0 * (people.stamp_error + people.clock_error)
    elapsed = t_obs - people.t_obs[row, p]
    longest = abs(elapsed) + slack
    speed = away = 0.0
    for axis in range(3):
        v = people.v[row, p, axis]
        off = xyz[axis] - people.xyz[row, p, axis] - v * elapsed
        speed += v * v
        away += off * off
    growth = longest * (people.e_v[row, p] + 0.5 * body.acceleration[p] * longest)
    allowed = people.e_p[row, p] + e_p + growth + np.sqrt(speed) * slack + ROUNDING_M
    return float(np.sqrt(away) - allowed)


@njit(cache=True, error_model="numpy")
def first_accelerated(
    people: Block, row: int, samples: tuple[Array, Array, Array], window: tuple[float, float], body: Block
) -> tuple[int, int, float]:
    """Find the first later point that velocity and acceleration of a row do not allow.

    ``samples`` and ``window`` as for :func:`first_outside`. Returns (sample, p, excess) [m]; sample = -1:
    none. Points of the row without a bounded velocity claim nothing.
    """
    seen, limits = people[0], body[0]
    stamps, xyz, e_p = samples
    for i in range(np.searchsorted(stamps, window[0], side="right"), stamps.shape[0]):
        if not stamps[i] <= window[1]:
            break
        for p in range(limits.speed.shape[0]):
            if np.isfinite(xyz[i, p, 0]) and (int(seen.present[row]) >> p) & 1 and seen.e_v[row, p] < np.inf:
                t_obs = stamps[i] - seen.stamp_error
                excess = _excess_of_motion(seen, row, p, xyz[i, p], e_p[i, p], t_obs, limits)
                if not excess <= 0.0:
                    return i, p, excess
    return -1, -1, 0.0


@njit(cache=True, error_model="numpy")
def first_too_large(
    samples: tuple[Array, Array, Array], window: tuple[float, float], body: Block
) -> tuple[int, int, int, float, float]:
    """Find the first sample in which points are farther apart than the profile's sizes allow.

    ``samples`` and ``window`` as for :func:`first_outside`. Returns (sample, p, q, distance, allowed) [m], of
    the pair with the largest excess; sample = -1: none.
    """
    stamps, xyz, e_p = samples
    for i in range(np.searchsorted(stamps, window[0], side="right"), stamps.shape[0]):
        if not stamps[i] <= window[1]:
            break
        p, q, distance, allowed = farthest_apart(body[0], xyz[i], e_p[i])
        if p >= 0:
            return i, p, q, distance, allowed
    return -1, -1, -1, 0.0, 0.0


@njit(cache=True, error_model="numpy")
def first_outside(
    people: Block, row: int, samples: tuple[Array, Array, Array], window: tuple[float, float], body: Block
) -> tuple[int, int, int, float, float]:
    """Find the first later point that was not where a row said it could be.

    ``samples``: stamps (T,) [s, increasing], points (T, 20, 3) [m] with NaN where none, position errors (T,
    20) [m]; those with window[0] < stamp <= window[1] are looked at. Point p at stamp t contradicts point q
    of the row iff |x_p - x_q| > chain(p, q) + speed(q) Δt + e_p + e_q: for q = p if the row has p, otherwise
    for all that it has, from which p was inferred. Returns (sample, p, q, distance, allowed) [m]; sample =
    -1: none.
    """
    seen, limits = people[0], body[0]
    stamps, xyz, e_p = samples
    points = limits.speed.shape[0]
    slack = 2.0 * (seen.stamp_error + seen.clock_error)
    present = int(seen.present[row])
    for i in range(np.searchsorted(stamps, window[0], side="right"), stamps.shape[0]):
        if not stamps[i] <= window[1]:
            break
        t_obs = stamps[i] - seen.stamp_error
        for p in range(points):
            if not np.isfinite(xyz[i, p, 0]):
                continue
            known = (present >> p) & 1
            for q in range(p if known else 0, p + 1 if known else points):
                if not (present >> q) & 1:
                    continue
                distance = _distance(xyz[i, p], seen.xyz[row, q])
                moved = limits.speed[q] * (abs(t_obs - seen.t_obs[row, q]) + slack)
                allowed = limits.chain[p, q] + moved + e_p[i, p] + seen.e_p[row, q] + ROUNDING_M
                if distance > allowed:
                    return i, p, q, distance, allowed
    return -1, -1, -1, 0.0, 0.0
