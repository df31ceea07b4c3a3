"""Running numbers of the streams of a recording; the memory needed does not depend on its length."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occupancy.body import POINT_NAMES
from verifier.recordings import joint_state, people_report
from verifier.recordings.clock_estimate import ClockStretches
from verifier.recordings.joint_state import NANO
from verifier.recordings.likely_units import JointUnits, PeopleUnits
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import PeopleReport, ReportError
from verifier.recordings.standing import Standing
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC

FloatArray = NDArray[np.float64]

MAX_REMARKS = 20


@dataclass(frozen=True, slots=True)
class StreamFacts:
    """One topic, or one publisher of joints; times in s since the first message of the recording.

    Attributes
    ----------
    name, schema, encoding:
        What it is.
    messages, rate_hz:
        How many, and how many a second (NaN for a single one).
    first_s, last_s:
        Message times of the first and the last one.
    largest_gap_s, gap_at_s:
        Longest time between two messages in a row, and when it began.
    stamp_age_s:
        Message time minus stamp: least, mean, most; ``None`` for messages without stamps.
    """

    name: str
    schema: str
    encoding: str
    messages: int
    rate_hz: float
    first_s: float
    last_s: float
    largest_gap_s: float
    gap_at_s: float
    stamp_age_s: tuple[float, float, float] | None


@dataclass(slots=True)
class StreamSurvey:
    """Running numbers of one stream; times in ns."""

    name: str
    schema: str
    encoding: str
    messages: int = 0
    first: int = 0
    last: int = 0
    gap: int = 0
    gap_at: int = 0
    stamped: int = 0
    age_min: int = 0
    age_max: int = 0
    age_sum: int = 0

    def take(self, log_time: int, stamp: int | None) -> None:
        """Count one message."""
        if not self.messages:
            self.first = self.gap_at = log_time
        elif log_time - self.last > self.gap:
            self.gap, self.gap_at = log_time - self.last, self.last
        self.messages += 1
        self.last = log_time
        if stamp is not None:
            self.take_stamp(log_time, stamp)

    def take_stamp(self, log_time: int, stamp: int) -> None:
        """Count how old a message was when it arrived."""
        age = log_time - stamp
        self.age_min = min(age, self.age_min) if self.stamped else age
        self.age_max = max(age, self.age_max) if self.stamped else age
        self.age_sum += age
        self.stamped += 1

    def facts(self, start: int) -> StreamFacts:
        """Return the numbers, with times since ``start`` [ns]."""
        span = (self.last - self.first) / NANO
        ages = (self.age_min, self.age_sum / max(self.stamped, 1), self.age_max)
        return StreamFacts(
            self.name,
            self.schema,
            self.encoding,
            self.messages,
            (self.messages - 1) / span if span > 0.0 else math.nan,
            (self.first - start) / NANO if self.messages else math.nan,
            (self.last - start) / NANO if self.messages else math.nan,
            self.gap / NANO,
            (self.gap_at - start) / NANO if self.messages else math.nan,
            (ages[0] / NANO, ages[1] / NANO, ages[2] / NANO) if self.stamped else None,
        )


class JointSurvey:
    """What the joint messages hold."""

    def __init__(self) -> None:
        self.publishers: dict[tuple[str, ...], StreamSurvey] = {}
        self.remarks: list[str] = []
        self.clock = ClockStretches()
        self._units: dict[tuple[str, ...], JointUnits] = {}
        self._last_stamp: dict[tuple[str, ...], int] = {}

    def take(self, message: Message) -> int | None:
        """Look at one message; return its stamp [ns] if it has one."""
        try:
            layout = joint_state.layout(message.data)
        except joint_state.CdrError as error:
            self._remark(f"{JOINT_TOPIC}: message at {message.log_time} ns cannot be decoded: {error}")
            return None
        stamp = layout.stamp_ns(message.data)
        names = layout.names
        stream = self.publishers.setdefault(names, StreamSurvey(", ".join(names) or "without names", "", ""))
        stream.take(message.log_time, stamp or None)
        if stamp:
            self.clock.take(message.log_time, stamp)
        values = np.frombuffer(layout.position_bytes(message.data), layout.order + "f8")
        time = stamp or message.log_time
        if len(values) != len(names) and names:
            self._remark(f"{JOINT_TOPIC}: {len(values)} positions for {len(names)} joints at {time} ns")
        elif not np.isfinite(values).all():
            self._remark(f"{JOINT_TOPIC}: a position is NaN or infinite at {time} ns")
        else:
            self._look_at_units(names, time, values)
        if time <= self._last_stamp.get(names, time - 1):
            self._remark(f"{JOINT_TOPIC}: time repeats or runs backwards at {time} ns")
        self._last_stamp[names] = time
        return stamp or None

    def _look_at_units(self, names: tuple[str, ...], time_ns: int, values: FloatArray) -> None:
        names = names or tuple(f"joint {number}" for number in range(1, len(values) + 1))
        if names not in self._units:
            self._units[names] = JointUnits(names)
        self._units[names].add(np.array([time_ns]), values[None])

    def units(self) -> Iterator[str]:
        """Yield what looks like another unit."""
        for units in self._units.values():
            yield from units.remarks(JOINT_TOPIC)

    def _remark(self, text: str) -> None:
        if len(self.remarks) < MAX_REMARKS:
            self.remarks.append(text)


class PeopleSurvey:
    """What the reports about people hold."""

    def __init__(self) -> None:
        self.people: Counter[str] = Counter()
        self.clock = ClockStretches()
        self.measured = np.zeros(len(POINT_NAMES), np.int64)
        self.inferred = 0
        self.repeated = 0
        self.unknown: set[str] = set()
        self.frames: dict[str, None] = {}
        self.flaws: Counter[str] = Counter()
        self.standing = Standing()
        self._units = PeopleUnits()
        self._errors = (math.inf, -math.inf)
        self._last: dict[tuple[str, str], FloatArray] = {}

    def take(self, message: Message) -> int | None:
        """Look at one message; return its stamp [ns] if it is readable."""
        try:
            report = people_report.decode(message.data, message.log_time)
        except ReportError as error:
            self.flaws[str(error)] += 1
            return None
        self._count(report)
        if report.known_points or not report.people:  # else its source may have had no stamp
            self.clock.take(message.log_time, report.stamp_ns)
        return report.stamp_ns

    def _count(self, report: PeopleReport) -> None:
        self._units.add(report)
        self.frames[report.frame] = None
        self.unknown |= report.unknown_points
        self.flaws.update(flaw.reason for flaw in report.flaws)
        for person in report.people:
            self.people[person.id] += 1
            self.standing.add(report.frame, person)
            seen = np.isfinite(person.xyz).all(axis=1) & person.xyz.any(axis=1)
            measured = np.array([person.measured >> column & 1 for column in range(len(POINT_NAMES))], bool)
            self.measured += seen & measured
            self.inferred += int(np.count_nonzero(seen & ~measured))
            self._count_repeats((report.frame, person.id), person.xyz, seen & measured)
            stated = person.error_m[seen & np.isfinite(person.error_m)]
            if len(stated):
                self._errors = (
                    min(self._errors[0], float(stated.min())),
                    max(self._errors[1], float(stated.max())),
                )

    def _count_repeats(self, who: tuple[str, str], xyz: FloatArray, measured: NDArray[np.bool_]) -> None:
        """Count points (20, 3) that stand exactly where this person's last reading in this frame has them."""
        last = self._last.setdefault(who, np.full_like(xyz, np.nan))
        self.repeated += int(np.count_nonzero(measured & (xyz == last).all(axis=1)))
        last[measured] = xyz[measured]

    def shares(self) -> dict[str, float]:
        """Return for each point in how many of the persons reported it was measured."""
        total = max(self.people.total(), 1)
        return {name: float(n / total) for name, n in zip(POINT_NAMES, self.measured, strict=True) if n}

    def errors(self) -> tuple[float, float] | None:
        """Return the smallest and the largest stated position error [m]."""
        return self._errors if self._errors[0] <= self._errors[1] else None

    def units(self) -> Iterator[str]:
        """Yield what looks like another unit."""
        return self._units.remarks(PEOPLE_TOPIC)

    def remarks(self) -> Iterator[str]:
        """Yield the most frequent reasons why something was not readable."""
        for reason, count in self.flaws.most_common(5):
            yield f"{PEOPLE_TOPIC}: {count} × {reason}"
