"""Cutting a recording into windows as its messages come."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from occupancy.report import RawMeasurement
from verifier.recordings.joint_state import NANO
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import PeopleReport
from verifier.recordings.people_stream import MAX_CLOCK_OFFSET_S, PeopleStream
from verifier.recordings.topic import JOINT_TOPIC

ARRIVED = attrgetter("arrived_ns")
MAX_LATE_NS = round(MAX_CLOCK_OFFSET_S * NANO)


@dataclass(frozen=True, slots=True)
class Window:
    """A stretch ``[start, end)`` of a recording with what surrounds it; times in s since the epoch.

    Attributes
    ----------
    start, end:
        The windows follow one another without gap; the last one ends with the last joint sample, inclusive,
        and is longer by up to ``after``, so that no short rest is left.
    t, q:
        Joint samples of ``[start - before, end + after]``: times, shape (T,), strictly increasing, and
        positions, shape (T, J) [rad or m], in the order that was asked for.
    people:
        Reports that arrived in ``[start, end)``, in order of arrival. Each report is in exactly one window:
        the first window also has what arrived before it, the last one what arrived after it.
    people_ahead:
        Reports that were seen by ``end + after`` but arrived only after ``end``.
    last:
        No window follows.
    ahead_s, ahead_at:
        By how much a joint sample is stamped after its message time at most, of those read so far, and its
        stamp.
    """

    start: float
    end: float
    t: NDArray[np.float64]
    q: NDArray[np.float64]
    people: tuple[RawMeasurement, ...]
    people_ahead: tuple[RawMeasurement, ...]
    last: bool
    ahead_s: float = 0.0
    ahead_at: float = 0.0


class WindowCutter:
    """Collects samples and reports and cuts windows from them.

    Attributes
    ----------
    finished:
        The last window has been cut.
    """

    def __init__(
        self, joints: JointStream, people: PeopleStream | None, epoch_ns: int, extent: tuple[int, int, int]
    ) -> None:
        self._epoch = epoch_ns
        self._length, self._before, self._after = extent
        self._start = self._epoch
        self._joints = joints
        self._people = people
        self._reports: list[PeopleReport] = []
        self.finished = False

    def take(self, message: Message) -> None:
        """Take the next message in log-time order."""
        if message.channel.topic == JOINT_TOPIC:
            self._joints.take(message)
        elif self._people is not None:
            report = self._people.report(message)
            if report is not None:
                self._reports.append(report)

    def is_complete(self, log_time: int) -> bool:
        """Whether nothing that is still to come belongs to the current window."""
        until = self._start + self._length + self._after
        late = until + MAX_LATE_NS
        return log_time > late and (self._joints.last_ns or self._epoch) > until

    def cut(self, *, at_end: bool = False) -> Window:
        """Return the current window and go on to the next."""
        start, end = self._start, self._start + self._length
        last_ns = self._joints.last_ns or self._epoch
        self.finished = at_end and end + self._after >= last_ns
        end = max(end, last_ns) if self.finished else end
        t_ns, q = self._joints.between(start - self._before, end + self._after)
        arrived = len(self._reports) if self.finished else bisect_left(self._reports, end, key=ARRIVED)
        ahead = [r for r in self._reports[arrived:] if r.seen_by_ns <= end + self._after]
        window = Window(
            (start - self._epoch) / NANO,
            (min(end, last_ns) - self._epoch) / NANO,
            (t_ns - self._epoch) / NANO,
            q,
            tuple(report.measurement(self._epoch) for report in self._reports[:arrived]),
            tuple(report.measurement(self._epoch) for report in ahead),
            self.finished,
            self._joints.ahead_ns / NANO,
            (self._joints.ahead_at_ns - self._epoch) / NANO,
        )
        del self._reports[:arrived]
        self._start = end
        self._joints.forget_before(end - self._before)
        return window
