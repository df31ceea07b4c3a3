"""Compiled steps of the gate for the usual case, in one call each: blocks in place of records are quicker."""

from __future__ import annotations

from numba import njit

from occupancy.humans.kernels import (
    Array,
    contradiction,
    estimate_velocities,
    mark_too_far_apart,
    note_reading,
    read_points,
    refuse_repeats,
    widen_exchanged,
    write_points,
)
from robots.motion import Block


@njit(cache=True, error_model="numpy")
def read_person(
    xyz: Array, error: Array, measured: int, t_obs: float, frame: Block, body: Block, reading: Block
) -> int:
    """Read the points of one person into ``reading`` (READING); return which are present.

    As :func:`occupancy.humans.kernels.read_points`, with ``measured`` and ``t_obs`` [s] written first.
    """
    out = reading[0]
    out.measured = measured
    out.t_obs = t_obs
    read_points(xyz, error, frame[0], body[0], out)
    return int(out.present)


@njit(cache=True, error_model="numpy")
def any_refused(reading: Block) -> bool:
    """Whether some point of a reading was refused."""
    out = reading[0]
    refused = 0
    for p in range(out.reason.shape[0]):
        refused += out.reason[p] != 0
    return bool(refused > 0)


@njit(cache=True, error_model="numpy")
def refuse_and_note(reading: Block, places: Block, stamp: float, noted: int, aside: int) -> bool:
    """Refuse points that stand where one of ``places`` (LAST) stood, and note the others in ``noted``.

    Returns whether any point of the reading is refused, for whatever reason.
    """
    refuse_repeats(reading[0], places)
    note_reading(reading[0], stamp, places[noted], places[aside])
    return any_refused(reading)


@njit(cache=True, error_model="numpy")
def take_agreeing(
    people: Block, row: int, reading: Block, history: Block, body: Block, moving: bool, trust_sides: bool
) -> bool:
    """Write a reading over the only row of a person if it agrees with it; else change no row.

    What :meth:`occupancy.hypotheses.Hypotheses.update` does where nothing is in doubt.
    """
    rows, out = people[0], reading[0]
    mark_too_far_apart(out, body[0])
    if contradiction(rows, row, out, body[0])[0] >= 0:
        return False
    for p in range(out.reason.shape[0]):
        out.e_read[p] = out.e_p[p]
    if not trust_sides:
        widen_exchanged(rows, row, out, body[0])
    if moving:
        estimate_velocities(rows, row, out, history[0], body[0])
    write_points(rows, row, out)
    return True
