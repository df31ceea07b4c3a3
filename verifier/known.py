"""What is known about people at an instant: the gate, and when a complete report last listed nobody."""

from __future__ import annotations

import math
import operator

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS
from occupancy.measurement import Gate
from occupancy.pace import Pace
from occupancy.report import Admission, RawMeasurement, RawPerson, Refusal, RefusalReason, is_complete
from verifier.cycle import Known

_POINTS, _ERRORS = (MAX_POINTS, 3), (MAX_POINTS,)
_FLOAT = np.dtype(np.float64)


class PeopleWatch:
    """Takes in reports and tells a check what is known.

    Parameters
    ----------
    gate:
        The only maker of measurements.
    stamp_doubt_s:
        By how much a stamp may be wrong against the cell's clock [s].
    pace:
        Holds people against where they were in the last half second; ``None``: nobody does, because later
        samples of a recording are held against every cycle.
    """

    def __init__(self, gate: Gate, stamp_doubt_s: float, pace: Pace | None = None) -> None:
        self.gate = gate
        self._pace = pace
        self._stamp_doubt_s = stamp_doubt_s
        self._reported = False
        self._nobody_since = -math.inf

    def admit(self, report: RawMeasurement, now: float) -> Admission:
        """Take in a report at ``now`` [s]; what is wrong with its numbers is returned.

        What is no report at all, a stamp that is no number or a person without points, raises what it raises
        in plain Python; a step takes that for a fault.

        The gate takes arrays of doubles in one piece that may be written to: for others functions would be
        compiled anew. What is none but says the same, a list of numbers for instance, is made one; of whoever
        has none, nothing can be read, and the first refusal says so: somebody is there, nobody knows where.
        """
        if type(report.people) is not tuple:
            # who is gone through once is there only once
            report = report._replace(people=tuple(report.people))
        unreadable: tuple[Refusal, ...] = ()
        for person, xyz, error, measured in report.people:
            if not (
                type(xyz) is np.ndarray
                and type(error) is np.ndarray
                and xyz.shape == _POINTS
                and error.shape == _ERRORS
                and xyz.dtype is _FLOAT
                and error.dtype is _FLOAT
                and xyz.flags.carray
                and error.flags.carray
                and type(measured) is int
                and type(person) is str
            ):
                report, unreadable = _as_arrays(report)
                break
        admission = self.gate.admit(report, now)
        if unreadable:
            admission = admission._replace(refusals=unreadable + admission.refusals)
        if self._pace is not None:
            outpaced = self._pace.hold(self.gate.people, self.gate.person_ids)
            if outpaced:
                admission = admission._replace(contradictions=admission.contradictions + outpaced)
        self._reported = True
        if is_complete(report) and not report.people:
            unusable = any(refusal.person == "" for refusal in admission.refusals)
            if not unusable:
                self._nobody_since = max(self._nobody_since, report.stamp - self._stamp_doubt_s)
        return admission

    def known(self) -> Known:
        """Return what is known now; the people block in it is the gate's own and changes with it."""
        gate = self.gate
        inconsistent = gate.contradicted or (self._pace is not None and self._pace.contradicted)
        return Known(gate.people, self._reported, self._nobody_since, inconsistent, gate.overflow)


def _as_arrays(report: RawMeasurement) -> tuple[RawMeasurement, tuple[Refusal, ...]]:
    """Return a report with arrays for everybody, and a refusal for each person who had none."""
    people, refusals = [], []
    for person in report.people:
        name = str(person.id)
        xyz, error = _numbers(person.xyz, _POINTS), _numbers(person.error_m, _ERRORS)
        measured = _bits(person.measured)
        if xyz is None or error is None or measured is None:
            refusals.append(Refusal(report.stamp, name, None, RefusalReason.SHAPE))
            xyz, error, measured = np.full(_POINTS, np.nan), np.full(_ERRORS, np.nan), 0
        people.append(RawPerson(name, xyz, error, measured))
    return report._replace(people=tuple(people)), tuple(refusals)


def _numbers(values: object, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return numbers as an array of this shape; ``None``: they are not, or some may be masked."""
    if type(values) not in (list, tuple, np.ndarray):
        return None
    try:
        found = np.asarray(values)
    except ValueError:  # rows of several lengths
        return None
    plain = found.shape == shape and found.dtype.kind in "iuf"
    return np.array(found, dtype=np.float64, order="C") if plain else None


def _bits(measured: int) -> int | None:
    """Return an integer of any kind as Python's; ``None``: it is none."""
    try:
        return operator.index(measured)
    except TypeError:
        return None
