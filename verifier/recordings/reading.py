"""Reading a recording for replay: windows of joint motion, and the reports about people that arrived in them.

Time is in seconds since the *epoch*, the first joint sample. The time of a joint sample is its header stamp,
or the message time where the stamp is zero; a report was seen at its ``stamp`` and arrived at its message
time.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from verifier.recordings.clock_offset import MOVED_BY
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.joint_stream import JointStream, OtherJoints, check_clock
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import NO_NAMES
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.recording import Recording
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC
from verifier.recordings.window import Window, WindowCutter
from verifier.recordings.windowed import JointPosition


@dataclass(frozen=True, slots=True)
class Span:
    """First and last instant of a stream [ns]."""

    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True)
class NotTaken:
    """A report (``person`` empty), a person or a point that is not readable; ``stamp`` [s since epoch]."""

    stamp: float
    person: str
    point: str | None
    reason: str


class Reading:
    """A recording opened for replay with a choice of joints; one pass of :meth:`windows` at a time.

    Parameters
    ----------
    recording:
        What to read.
    joints:
        Names of the joints to take, in the order in which they are wanted.
    people:
        Whether reports about people are taken; if so, there must be some.
    point_names:
        Maps point names of the recording to ours.

    Attributes
    ----------
    recording, joints:
        What is read.
    extra_joints:
        Joints of the recording that are not taken.
    assumed_order:
        The recording does not name its joints; they are taken to be in the order of ``joints``.
    epoch_ns:
        Stamp of the first joint sample [ns].
    joint_span, people_span:
        Stamps of the first and last sample and report; of the first report its arrival, where that is
        earlier. ``people_span`` is ``None`` without people.
    overlap:
        From the later of the first sample and the first report to the last sample [s since the epoch]: who
        was reported once does not disappear when the reports end. Without people: joints.
    decode_seconds:
        Time spent on reading and decoding so far [s].

    Raises
    ------
    RecordingError
        None of the joints is there, or only some of them; there are no reports, none is readable, or no
        person has a known point name; joints and people do not overlap in time; stamps and message times are
        on different clocks.
    """

    def __init__(
        self,
        recording: Recording,
        joints: tuple[str, ...],
        *,
        people: bool = True,
        point_names: Mapping[str, str] = NO_NAMES,
    ) -> None:
        began = time.perf_counter()
        self.recording = recording
        self.joints = joints
        self.extra_joints = tuple(name for name in recording.joint_names if name not in joints)
        self.assumed_order = not recording.joint_names
        self.joint_span = self._joint_span()
        self.epoch_ns = self.joint_span.first_ns
        names = recording.left_to_map(point_names)
        self._people = PeopleStream(recording.file, names, recording.regions) if people else None
        self._joints: JointStream | None = None
        self.people_span = self._people_span(self._people) if self._people else None
        self.overlap = self._overlap()
        self.decode_seconds = time.perf_counter() - began

    @property
    def path(self) -> Path:
        """The file that is read."""
        return self.recording.path

    @property
    def not_taken(self) -> tuple[NotTaken, ...]:
        """What of the reports so far was not readable: the first 1000, each listed."""
        flaws = self._people.flaws if self._people else []
        return tuple(
            NotTaken((flaw.stamp_ns - self.epoch_ns) / NANO, flaw.person or "", flaw.point, flaw.reason)
            for flaw in flaws
        )

    @property
    def not_taken_count(self) -> int:
        """How much of the reports so far was not readable."""
        return self._people.flaw_count if self._people else 0

    @property
    def joints_behind_s(self) -> float:
        """By how much every joint sample of the windows so far is stamped before it was recorded [s]."""
        return self._joints.behind_ns / NANO if self._joints else 0.0

    @property
    def unknown_points(self) -> frozenset[str]:
        """Point names met so far that are neither ours nor mapped."""
        return frozenset(self._people.unknown_points if self._people else ())

    @property
    def unused_point_names(self) -> tuple[str, ...]:
        """Names that are mapped and that no report so far has; of a translation, which maps them, none."""
        if self._people is None or self.recording.translated:
            return ()
        return tuple(name for name in self._people.point_names if name not in self._people.mapped_points)

    def windows(self, length_s: float, before_s: float, after_s: float) -> Iterator[Window]:
        """Yield the recording in windows; see :class:`Window`.

        Raises
        ------
        RecordingError
            A joint value is NaN or infinite, time repeats or runs backwards, a message lacks some of the
            joints, or the file is damaged.
        """
        if not (length_s > 0.0 and before_s >= 0.0 and after_s >= 0.0):
            raise ValueError(f"a window of {length_s} s with {before_s} s before and {after_s} s after it")
        extent = round(length_s * NANO), round(before_s * NANO), round(after_s * NANO)
        self._joints = joints = JointStream(self.recording, self.joints)
        cutter = WindowCutter(joints, self._people, self.epoch_ns, extent)
        topics = [JOINT_TOPIC, PEOPLE_TOPIC] if self._people else [JOINT_TOPIC]
        began = time.perf_counter()
        for message in self.recording.file.messages(topics):
            cutter.take(message)
            while cutter.is_complete(message.log_time):
                window = cutter.cut()
                self.decode_seconds += time.perf_counter() - began
                yield window
                began = time.perf_counter()
        while not cutter.finished:
            window = cutter.cut(at_end=True)
            self.decode_seconds += time.perf_counter() - began
            yield window
            began = time.perf_counter()

    def positions_of(self, joints: Collection[str]) -> Iterator[JointPosition]:
        """Yield what the whole recording says of these joints, in the order of its messages.

        Stamps are not looked at: what is NaN or runs backwards is yielded as it stands.

        Raises
        ------
        RecordingError
            The file is damaged.
        """
        stream = OtherJoints(self.recording, joints)
        for message in self.recording.file.messages([JOINT_TOPIC] if joints else []):
            for name, time_ns, q in stream.positions(message):
                yield JointPosition(name, (time_ns - self.epoch_ns) / NANO, q)

    def longest_step(self) -> tuple[float, float]:
        """Return when the longest time between two joint samples begins [s since the epoch], and its length.

        Reads the whole recording. The length is in s.
        """
        stream = JointStream(self.recording, self.joints)
        messages = self.recording.file.messages([JOINT_TOPIC])
        times = (time_ns for message in messages if (time_ns := stream.time_ns(message)) is not None)
        step, begin = max((after - before, before) for before, after in pairwise(times))
        return (begin - self.epoch_ns) / NANO, step / NANO

    def _joint_span(self) -> Span:
        file = self.recording.file
        first = self._first_ns(file.messages([JOINT_TOPIC]))
        last = self._first_ns(file.last(JOINT_TOPIC))
        if first == last:
            raise self._refuse(JOINT_TOPIC, "has one sample only", "a motion takes at least two")
        return Span(first, last)

    def _first_ns(self, messages: Iterator[Message]) -> int:
        stream = JointStream(self.recording, self.joints)
        for message in messages:
            time_ns = stream.time_ns(message)
            if time_ns is not None:
                check_clock(self.recording.path, time_ns, message.log_time)
                return time_ns
        raise self._refuse(
            JOINT_TOPIC,
            f"has none of {', '.join(self.joints)} (it has {', '.join(self.recording.joint_names)})",
            "choose the robot that was recorded",
        )

    def _people_span(self, people: PeopleStream) -> Span:
        if not self.recording.has_people:
            raise self._refuse(
                "",
                f"has no messages on {PEOPLE_TOPIC}",
                "record people, or state with verify --assume-nobody that nobody is there",
            )
        first, last = people.span()
        return Span(first.seen_by_ns, last.stamp_ns)

    def _overlap(self) -> tuple[float, float]:
        joints, people = self.joint_span, self.people_span or self.joint_span
        first, last = max(joints.first_ns, people.first_ns), joints.last_ns
        if first > last or people.last_ns < joints.first_ns:
            raise self._refuse(
                "",
                f"joints ({self._text(joints)}) and people ({self._text(people)}) do not overlap in time",
                "both must be on one clock; times are seconds since the first joint sample; "
                f"if their clocks differ: {MOVED_BY['people']}",
            )
        return (first - self.epoch_ns) / NANO, (last - self.epoch_ns) / NANO

    def _text(self, span: Span) -> str:
        first, last = (span.first_ns - self.epoch_ns) / NANO, (span.last_ns - self.epoch_ns) / NANO
        return f"{first:.6g} … {last:.6g} s"

    def _refuse(self, place: str, wrong: str, right: str) -> RecordingError:
        return RecordingError(self.recording.path, place, wrong, right)
