"""What a recording shows of people: every reading, and which of them are no motion of a person."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Profile
from occupancy.conformance import LaterSamples
from occupancy.measurement import Gate
from occupancy.report import GateSettings, RawMeasurement, RawPerson, Refusal, RefusalReason

MISSING = (
    RefusalReason.INFERRED,
    RefusalReason.NOT_FINITE,
    RefusalReason.ZERO,
    RefusalReason.REPEATED,
    RefusalReason.UNCOMPARED,
)
"""A point that is not there is no error of the recording."""


@dataclass(frozen=True, eq=False)
class Track:
    """One person of a recording.

    Attributes
    ----------
    samples:
        What was read of them, one sample for each report with a readable point.
    marked:
        (T,) samples that the gate marks: something was refused, or no profile allows it after what was seen
        before.
    """

    samples: LaterSamples
    marked: NDArray[np.bool_]

    @property
    def marks_before(self) -> NDArray[np.int64]:
        """(T + 1,) number of marked samples before each."""
        return np.concatenate(([0], np.cumsum(self.marked))).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Recorded:
    """The people of a recording.

    Attributes
    ----------
    reports:
        In order of stamp, each arriving when it was seen.
    settings:
        Of the gate that read them.
    tracks:
        By person, those of whom something could be read.
    refused:
        How many points the gate refused, by reason.
    """

    reports: tuple[RawMeasurement, ...]
    settings: GateSettings
    tracks: dict[str, Track]
    refused: dict[RefusalReason, int]


_LARGER = 1.5
"""Longest limbs that are read, as a multiple of the longest ones of the bundled profiles."""


def widest(profiles: Sequence[Profile]) -> Profile:
    """Return the last profile with the greatest speed of any: what contradicts it, no profile allows.

    People may be larger than any profile has them, as far as their limbs are read at all: how large they are
    is what conformance shows and identification finds.
    """
    speed = np.max([profile.speed for profile in profiles], axis=0)
    limits = profiles[-1].limits.copy()
    limits["speed"] = speed
    limits["chain"] *= _LARGER
    limits["acceleration"] = np.inf
    return replace(profiles[-1], speed=speed, limits=limits)


def read_people(
    reports: Iterable[RawMeasurement],
    profiles: Sequence[Profile],
    position_error_m: float,
    *,
    believe_repeats: bool = False,
) -> Recorded:
    """Read a recording as a gate does that knows its clock exactly.

    Parameters
    ----------
    reports:
        In any order.
    profiles:
        A sample is marked if none of them allows it.
    position_error_m:
        Of points whose report states none [m].
    believe_repeats:
        Whether a point whose coordinates do not change at all counts as measured anew.

    Raises
    ------
    GateError
        If the position error is negative or not finite.
    """
    ordered = sorted((report for report in reports if math.isfinite(report.stamp)), key=lambda r: r.stamp)
    arrived = tuple(report._replace(arrived=report.stamp) for report in ordered)
    settings = GateSettings(
        clock_error_s=0.0,
        stamp_error_s=0.0,
        position_error_m=position_error_m,
        believe_repeats=believe_repeats,
    )
    gate = Gate(widest(profiles), settings)
    found: dict[str, _Samples] = {}
    refused: Counter[RefusalReason] = Counter()
    for report in arrived:
        refusals = gate.admit(report, report.stamp).refusals
        refused.update(each.reason for each in refusals)
        for person in report.people:
            samples = found.setdefault(person.id, _Samples())
            samples.add(gate, report, person, [each for each in refusals if each.person == person.id])
    return Recorded(
        arrived, settings, {name: each.track() for name, each in found.items() if each.t}, dict(refused)
    )


class _Samples:
    """Samples of a person while they are collected."""

    def __init__(self) -> None:
        self.t: list[float] = []
        self._xyz: list[NDArray[np.float64]] = []
        self._e_p: list[NDArray[np.float64]] = []
        self._marked: list[bool] = []

    def add(self, gate: Gate, report: RawMeasurement, person: RawPerson, refusals: list[Refusal]) -> None:
        """Add what can be read; of several samples with one stamp the first one stays, marked."""
        reading = gate.read(report, person)
        if reading is None:
            return
        for refusal in refusals:
            passed_on = refusal.reason in (RefusalReason.REPEATED, RefusalReason.UNCOMPARED)
            if passed_on and refusal.point is not None:
                reading.xyz[refusal.point], reading.e_p[refusal.point] = math.nan, math.nan
        if not np.isfinite(reading.xyz).any():
            return
        if self.t and self.t[-1] == report.stamp:
            self._marked[-1] = True
            return
        self.t.append(report.stamp)
        self._xyz.append(reading.xyz)
        self._e_p.append(reading.e_p)
        refused = any(each.reason not in MISSING for each in refusals)
        self._marked.append(refused or _rows(gate, person.id) != 1)

    def track(self) -> Track:
        samples = LaterSamples(np.array(self.t), np.array(self._xyz), np.array(self._e_p))
        return Track(samples, np.array(self._marked))


def _rows(gate: Gate, person: str) -> int:
    """Number of hypotheses about a person; 0 for one for whom there was no room."""
    if person not in gate.person_ids:
        return 0
    people = gate.people[0]
    return int(np.count_nonzero(people["person"][: people["n"]] == gate.person_ids.index(person)))
