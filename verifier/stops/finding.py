"""Where in a recording the arm was told to stop, and where it stood still after that.

Both are known to one sample. What told it lies between the last sample that does not show it and the first
that does; standstill began between the last sample that moves and the first that does not.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from verifier.recordings.motion import RecordedMotion, StateChannel
from verifier.stops.speeds import SPAN_S, Speeds, over_windows, standstills

END_OF_MOTION = "end of motion"
"""The arm comes to rest, and nothing that was recorded says why."""
COMMAND = "command"
"""The command stands still at once while the arm still moves."""
_BEFORE_EDGE_S = 0.2
_STEEP = 0.5
"""A command that stands still at once was this share of its largest speed of the last 0.2 s just before."""
SLOWER = 0.95
"""An arm has begun to slow down when its fastest joint has less than this share of its largest speed."""
AGAIN_S = 0.5
"""What was released before the arm stood still has begun the stop that something tells within this time [s]
after: a button that is let go, and the safety mode that follows from it."""
_NOISE = 0.05
"""A speed that falls by no more than this share from one sample to the next, going back, still counts as
rising."""


class Unmeasured(StrEnum):
    """Why something that told the arm to stop is no stop that can be measured."""

    AT_REST = "the arm stood still already"
    BEFORE = "it had been told before the recording says so first"
    UNFINISHED = "the recording ends before the arm stands still"
    RELEASED = "it was released before the arm stood still"


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop.

    Attributes
    ----------
    causes:
        What told the arm to stop, the first first.
    asked_after, asked_by:
        It was told after the one and by the other [s since the first sample].
    before, at, rest:
        Samples: the last one before it was told; the first one at which it had been; the first of standstill.
    """

    causes: tuple[str, ...]
    asked_after: float
    asked_by: float
    before: int
    at: int
    rest: int

    @property
    def kind(self) -> str:
        """What told the arm first."""
        return self.causes[0]


@dataclass(frozen=True, slots=True)
class Found:
    """What was found in a recording: its stops in order of time, and what could not be measured."""

    stops: tuple[Stop, ...]
    ends_of_motion: tuple[Stop, ...]
    unmeasured: dict[Unmeasured, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Event:
    """Something that tells the arm to stop: between ``after`` and ``by`` [s], until ``released``."""

    by: float
    after: float
    released: float
    cause: str
    needs_motion: bool


def find_stops(motion: RecordedMotion, seen: Speeds) -> Found:
    """Find the stops of a motion; ``seen``: its speeds."""
    still = standstills(motion.t, seen.moving)
    stops: list[Stop] = []
    unmeasured: Counter[Unmeasured] = Counter()
    let_go: list[_Event] = []
    events = sorted(_events(motion, seen), key=lambda event: event.by)
    for event in events:
        if stops and event.after < motion.t[stops[-1].rest]:
            if not event.needs_motion or event.by < motion.t[stops[-1].rest]:
                stops[-1] = _also(stops[-1], event.cause)
            continue
        found = _stop_after(motion, seen, still, event)
        if let_go and event.by > let_go[-1].released + AGAIN_S:
            let_go.clear()
        if isinstance(found, Stop):
            stops.append(_since(motion, let_go, found))
            unmeasured[Unmeasured.RELEASED] -= sum(not each.needs_motion for each in let_go)
            let_go.clear()
            continue
        if found is Unmeasured.RELEASED:
            let_go.append(event)
        if not event.needs_motion:
            unmeasured[found] += 1
    told = {stop.rest for stop in stops}
    if any(_told_before(motion, seen, channel) for channel in motion.states):
        unmeasured[Unmeasured.BEFORE] += 1
        told.update(first for first, _ in still[:1])
    ends = [_end_of_motion(motion, seen, first) for first, _ in still if first > 0 and first not in told]
    return Found(tuple(stops), tuple(ends), dict(+unmeasured))


def _since(motion: RecordedMotion, let_go: list[_Event], stop: Stop) -> Stop:
    """A stop from the first of what had told it and was released again."""
    if not let_go:
        return stop
    before, at = _samples(motion, let_go[0])
    causes = tuple(dict.fromkeys([*(each.cause for each in let_go), *stop.causes]))
    return Stop(causes, let_go[0].after, let_go[0].by, before, min(at, stop.rest), stop.rest)


def _samples(motion: RecordedMotion, event: _Event) -> tuple[int, int]:
    """The last sample before the arm was told, and the first at which it had been."""
    t = motion.t
    before = max(bisect_right(t, event.after) - 1, 0)
    return before, min(max(bisect_left(t, event.by), before + 1), len(t) - 1)


def _also(stop: Stop, cause: str) -> Stop:
    causes = stop.causes if cause in stop.causes else (*stop.causes, cause)
    return Stop(causes, stop.asked_after, stop.asked_by, stop.before, stop.at, stop.rest)


def _events(motion: RecordedMotion, seen: Speeds) -> Iterator[_Event]:
    for channel in motion.states:
        yield from _channel_events(channel)
    yield from _command_events(motion, seen)


def _channel_events(channel: StateChannel) -> Iterator[_Event]:
    """The beginnings of what stops the arm."""
    sampled = channel.sampled
    for k in range(len(channel.t)):
        if not channel.cause[k] or (channel.cause[k - 1] if k else _began_before(channel)):
            continue
        by = float(channel.t[k])
        later = (float(channel.t[i]) for i in range(k, len(channel.t)) if not channel.cause[i])
        after = float(channel.t[k - 1]) if sampled else by
        yield _Event(by, after, next(later, np.inf), channel.cause[k], channel.needs_motion)


def _began_before(channel: StateChannel) -> bool:
    """Whether the arm had been told when the channel begins; one that is written where it changes may begin
    with that."""
    return bool(channel.cause[0]) and (channel.sampled or float(channel.t[0]) <= 0.0)


def _told_before(motion: RecordedMotion, seen: Speeds, channel: StateChannel) -> bool:
    """Whether it was told before a channel begins, and moves at its begin all the same."""
    if not channel.cause or channel.needs_motion or not _began_before(channel):
        return False
    return bool(seen.moving[max(bisect_right(motion.t, float(channel.t[0])) - 1, 0)])


def _command_events(motion: RecordedMotion, seen: Speeds) -> Iterator[_Event]:
    """Where the command, at speed just before, stands still for long enough while the arm moves."""
    t, speed = motion.t, motion.command_dq
    if speed is None and motion.command_q is not None:
        speed = over_windows(t, motion.command_q)[0]
    if speed is None:
        return
    fastest = np.abs(speed).max(axis=1)
    for first, last in standstills(t, fastest > 0.0):
        if first == 0 or not seen.moving[first]:
            continue
        near, far = (np.searchsorted(t, t[first] - each) for each in (2.0 * SPAN_S, _BEFORE_EDGE_S))
        just_before = fastest[min(near, first - 1) : first].max()
        if just_before >= _STEEP * fastest[min(far, first - 1) : first].max():
            released = float(t[last + 1]) if last + 1 < len(t) else np.inf
            yield _Event(float(t[first]), float(t[first - 1]), released, COMMAND, True)


def _stop_after(
    motion: RecordedMotion, seen: Speeds, still: list[tuple[int, int]], event: _Event
) -> Stop | Unmeasured:
    """The stop that an event asks for, or why there is none that can be measured."""
    t = motion.t
    before, at = _samples(motion, event)
    if not seen.moving[before : at + 1].any() or (event.needs_motion and not seen.moving[at]):
        return Unmeasured.AT_REST
    rest = next((first for first, _ in still if first > before), None)
    if rest is None:
        return Unmeasured.UNFINISHED
    if event.released < t[rest]:
        return Unmeasured.RELEASED
    return Stop((event.cause,), event.after, event.by, before, min(at, rest), rest)


def _end_of_motion(motion: RecordedMotion, seen: Speeds, rest: int) -> Stop:
    """The last slowing down before a standstill of which nothing says why."""
    fastest, t = seen.fastest, motion.t
    first = rest - 1
    while first > 0 and fastest[first - 1] > (1.0 - _NOISE) * fastest[first]:
        first -= 1
    stretch = fastest[first:rest]
    before = first + int(np.flatnonzero(stretch >= SLOWER * stretch.max())[-1])
    at = min(before + 1, rest)
    return Stop((END_OF_MOTION,), float(t[before]), float(t[at]), before, at, rest)
