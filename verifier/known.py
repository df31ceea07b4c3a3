"""What is known about people at an instant: the gate, and when a complete report last listed nobody."""

from __future__ import annotations

import math

from occupancy.measurement import Gate
from occupancy.report import Admission, RawMeasurement, is_complete
from verifier.cycle import Known


class PeopleWatch:
    """Takes in reports and tells a check what is known.

    Parameters
    ----------
    gate:
        The only maker of measurements.
    stamp_doubt_s:
        By how much a stamp may be wrong against the cell's clock [s].
    """

    def __init__(self, gate: Gate, stamp_doubt_s: float) -> None:
        self.gate = gate
        self._stamp_doubt_s = stamp_doubt_s
        self._reported = False
        self._nobody_since = -math.inf

    def admit(self, report: RawMeasurement, now: float) -> Admission:
        """Take in a report at ``now`` [s]; what is wrong with it is returned, never raised."""
        admission = self.gate.admit(report, now)
        self._reported = True
        if is_complete(report) and not report.people:
            unusable = any(refusal.person == "" for refusal in admission.refusals)
            if not unusable:
                self._nobody_since = max(self._nobody_since, report.stamp - self._stamp_doubt_s)
        return admission

    def known(self) -> Known:
        """Return what is known now; the people block in it is the gate's own and changes with it."""
        gate = self.gate
        return Known(gate.people, self._reported, self._nobody_since, gate.contradicted, gate.overflow)
