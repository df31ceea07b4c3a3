"""How far a clock of stamps is from the clock of the message times: what arrival times prove, and what not.

A message that was stamped ``s`` and recorded at ``a`` took ``λ = a - s - o``, where ``o`` is what has to be
added to its stamp. Nothing arrives before it is there, so ``o ≤ a - s`` for each message: proven. From below
nothing bounds ``o`` but a statement about ``λ``: that all messages take ``least`` or more, and that one of
every stretch takes ``most`` or less. Let ``m`` be the smallest ``a - s`` of a stretch, and ``o`` change by
at most ``drift`` times the time that goes by. At the message that has it ``o ≤ m - least``; at the one that
took ``most`` or less, which may be another, ``o ≥ m - most`` (docs/clocks.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from robots.errors import SetupError
from verifier.recordings.clock_offset import in_words
from verifier.recordings.joint_state import NANO

STRETCH_S = 5.0
"""One message of every stretch of this length [s], by time of arrival, is taken to be quick."""
DRIFT = 5e-4
"""Largest change of the offset per time. *Assumed*: quartz clocks differ by up to 1e-4, and daemons that
discipline clocks turn them by up to 5e-4 unless they step; steps beyond what was stated are found by
:meth:`ClockStretches.bounds`."""
DIGITS = 6
MAX_LATENCY_S = 10.0


@dataclass(frozen=True, slots=True)
class Latency:
    """From its stamp to being recorded a message takes ``least_s``, one of every stretch at most ``most_s``.

    Raises
    ------
    SetupError
        It is negative, NaN, above 10 s, or the least is above the most.
    """

    least_s: float
    most_s: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.least_s <= self.most_s <= MAX_LATENCY_S:
            raise SetupError(
                f"latency {self.least_s:g} to {self.most_s:g} s: it must be two numbers of seconds, "
                f"the least first, from 0 to {MAX_LATENCY_S:g}"
            )


@dataclass(frozen=True, slots=True)
class Quickest:
    """What is stated about the quickest messages; ``None``: nothing."""

    people: Latency | None = None
    joints: Latency | None = None


NOTHING_STATED = Quickest()


@dataclass(frozen=True, slots=True)
class OffsetBounds:
    """Everything that the offset can be, over the whole recording, as a middle and the distance from it [s].

    ``contradiction``: what in the data cannot be, if all that was stated holds.
    """

    offset_s: float
    error_s: float
    contradiction: str | None


@dataclass(slots=True)
class _Stretch:
    """The smallest age in a stretch, its stamp, and the first and last stamp in it [ns]."""

    age: int
    stamp: int
    first: int
    last: int

    def take(self, age: int, stamp: int) -> None:
        if age < self.age:
            self.age, self.stamp = age, stamp
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)

    @property
    def reach_s(self) -> float:
        """Longest time from a message of it to the one of the smallest age [s]."""
        return max(self.stamp - self.first, self.last - self.stamp) / NANO

    @property
    def span_s(self) -> float:
        """Longest time between two messages of it [s]."""
        return (self.last - self.first) / NANO


class ClockStretches:
    """The quickest messages of a stream; a few numbers for every stretch are kept."""

    def __init__(self) -> None:
        self._stretches: dict[int, _Stretch] = {}
        self.first: tuple[int, int] | None = None

    def take(self, arrived_ns: int, stamp_ns: int) -> None:
        """Take the times of a message [ns]."""
        self.first = self.first or (stamp_ns, arrived_ns)
        age, number = arrived_ns - stamp_ns, arrived_ns // round(STRETCH_S * NANO)
        known = self._stretches.get(number)
        if known is None:
            self._stretches[number] = _Stretch(age, stamp_ns, stamp_ns, stamp_ns)
        else:
            known.take(age, stamp_ns)

    @property
    def quickest_s(self) -> tuple[float, float] | None:
        """Message time minus stamp of the quickest message: its least and most over the stretches [s]."""
        ages = [each.age for each in self._stretches.values()]
        return (min(ages) / NANO, max(ages) / NANO) if ages else None

    def bounds(self, latency: Latency, added_s: float = 0.0) -> OffsetBounds:
        """Return what the offset can be if one message of every stretch was as quick as ``latency`` says.

        It contains the true offset at every message, if that holds and the clocks drift by at most
        :data:`DRIFT`. ``added_s``: what was added to the stamps before, and counts.
        """
        stretches = sorted(self._stretches.values(), key=lambda each: each.stamp)
        base = stretches[0].age  # differences are exact, seconds since 1970 as doubles are not
        ages = [(each.age - base) / NANO for each in stretches]
        both = list(zip(ages, stretches, strict=True))
        lower = min(age - DRIFT * each.span_s for age, each in both) - latency.most_s
        upper = max(age + DRIFT * each.reach_s for age, each in both) - latency.least_s
        exact = base / NANO + added_s + 0.5 * (lower + upper)
        offset = round(exact, DIGITS)
        rounding = abs(offset - exact) + 4.0 * math.ulp(abs(base) / NANO + abs(added_s))
        error = 0.5 * (upper - lower) + rounding
        return OffsetBounds(offset, _up(error), self._contradiction(stretches, latency))

    def _contradiction(self, stretches: list[_Stretch], latency: Latency) -> str | None:
        free = latency.most_s - latency.least_s
        for before, after in pairwise(stretches):
            step = (after.age - before.age) / NANO
            apart = (max(before.last, after.last) - min(before.first, after.first)) / NANO
            if abs(step) > free + DRIFT * apart:
                begin, end = before.stamp / NANO, after.stamp / NANO
                return (
                    f"from stamp {begin:.3f} s to {end:.3f} s the quickest message comes {abs(step):.6g} s "
                    f"{'later' if step > 0.0 else 'sooner'}: a clock was set, or the quickest took "
                    "longer than stated"
                )
        return None


def _up(value: float) -> float:
    return float(math.ceil(value * 1e6) / 1e6)


@dataclass(frozen=True, slots=True)
class ClockFacts:
    """What is known about the clock of a stream.

    Attributes
    ----------
    stream:
        ``people`` or ``joints``.
    added_s:
        Offset that was stated, and has been added to its stamps [s].
    first_stamp_s, first_message_s:
        Stamp, with that, and message time of the first message [s].
    quickest_s:
        Message time minus stamp of the quickest message of a stretch: least and most of all stretches [s].
    latency_s:
        What was stated about it [s].
    offset_s, error_s:
        Offset that follows, with what was added already, and its error [s]; ``None``: nothing was stated,
        or it is contradicted.
    contradiction:
        How the data contradict what was stated.
    """

    stream: str
    added_s: float
    first_stamp_s: float
    first_message_s: float
    quickest_s: tuple[float, float]
    latency_s: tuple[float, float] | None = None
    offset_s: float | None = None
    error_s: float | None = None
    contradiction: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON has it."""
        return {key: getattr(self, key) for key in self.__dataclass_fields__}

    def lines(self) -> Iterator[str]:
        """Yield what must be known about the clock; nothing of it is taken over."""
        least, most = self.quickest_s
        seen = (
            f"clock of {self.stream}: the quickest message of every {STRETCH_S:g} s is recorded "
            f"{1e3 * least:.4g} to {1e3 * most:.4g} ms after its stamp"
        )
        if max(abs(least), abs(most)) > MAX_LATENCY_S:
            stamp, message = (in_words(round(t * NANO)) for t in (self.first_stamp_s, self.first_message_s))
            yield f"clock of {self.stream}: another one: a stamp is {stamp}, its message time {message}"
        elif least < 0.0:
            yield f"{seen}: another clock, since nothing arrives before it is there"
        else:
            yield f"{seen}: that may be one clock, and proves nothing"
        yield f"  proven: when that was least, the offset was at most {least + self.added_s:.6f} s"
        yield from self._bounds()

    def _bounds(self) -> Iterator[str]:
        if self.latency_s is None:
            option = "--latency" if self.stream == "people" else "--joints-latency"
            what = f"what the quickest of every {STRETCH_S:g} s takes"
            yield f"  from below: `inspect {option} LEAST MOST`, {what}"
            return
        if self.offset_s is None or self.error_s is None:
            yield f"  contradicted: {self.contradiction}"
            return
        offset, error = f"{self.offset_s:.{DIGITS}f}", f"{self.error_s:.{DIGITS}f}"
        least, most = self.latency_s
        yield (
            f"  if the quickest takes {least:g} to {most:g} s, and clocks drift by at most {DRIFT:g} "
            f"(assumed): {offset} s ± {error} s"
        )
        if self.stream == "people":
            yield f"  to use it: --time-offset {offset}±{error}, or in the cell:"
            yield f"  [recording] time_offset_s = {offset}, and [people] clock_error_s = {error}"
        else:
            yield f"  to use it, in the cell: [recording] joints_time_offset_s = {offset},"
            yield f"  and [people] clock_error_s = {error}, with the error of the people's offset added"


def clock_facts(
    stream: str, added_s: float, seen: ClockStretches, latency: Latency | None
) -> ClockFacts | None:
    """Return what is known about a clock; ``None``: no message has a stamp."""
    quickest = seen.quickest_s
    if seen.first is None or quickest is None:
        return None
    stamp_s, message_s = (time_ns / NANO for time_ns in seen.first)
    facts = (stream, added_s, stamp_s, message_s, quickest)
    if latency is None:
        return ClockFacts(*facts)
    found, stated = seen.bounds(latency, added_s), (latency.least_s, latency.most_s)
    if found.contradiction is not None:
        return ClockFacts(*facts, stated, contradiction=found.contradiction)
    return ClockFacts(*facts, stated, found.offset_s, found.error_s)
