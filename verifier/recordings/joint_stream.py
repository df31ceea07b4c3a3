"""The joint samples of a recording: choosing the joints by name, checking and collecting them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verifier.recordings.clock_offset import MOVED_BY, in_words
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO, Layout
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_stream import MAX_CLOCK_OFFSET_S
from verifier.recordings.recording import Recording
from verifier.recordings.sources import JOINTS
from verifier.recordings.topic import JOINT_TOPIC

MAX_LAYOUTS = 16
"""Layouts that are remembered; publishers that share the topic have one each."""

Columns = NDArray[np.intp]


def check_clock(path: Path, stamp_ns: int, log_time: int) -> None:
    """Refuse a joint sample whose stamp [ns] is on another clock than the message time [ns]."""
    apart = abs(log_time - stamp_ns) / NANO
    if apart > MAX_CLOCK_OFFSET_S:
        raise RecordingError(
            path,
            JOINT_TOPIC,
            f"stamps and message times are {apart:.6g} s apart: {in_words(stamp_ns)}, and "
            f"{in_words(log_time)}",
            f"both must be on one clock, at most {MAX_CLOCK_OFFSET_S:g} s apart; {MOVED_BY[JOINTS]}",
        )


class JointStream:
    """Collects the samples of the chosen joints from messages in log-time order.

    Attributes
    ----------
    joints:
        Names in the order in which they are wanted.
    assumed_order:
        The recording does not name its joints; they are taken to be in the order of ``joints``.
    first_ns, last_ns:
        Time of the first and of the latest sample taken [ns]; ``None`` before the first.
    skipped:
        Messages so far that hold none of the joints.
    ahead_ns, ahead_at_ns:
        By how much a stamp so far lies after its message time at most [ns], and that stamp; 0: none does.
    behind_ns:
        By how much every stamp so far lies before its message time at least [ns]; 0: one does not, or there
        is none.
    """

    def __init__(self, recording: Recording, joints: tuple[str, ...]) -> None:
        self.recording = recording
        self.joints = joints
        self.assumed_order = not recording.joint_names
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.skipped = 0
        self.ahead_ns, self.ahead_at_ns, self.behind_ns = 0, 0, 0
        self._layouts: list[tuple[Layout, Columns | None]] = []
        self._current: tuple[Layout, Columns] | None = None
        self._place_in_file = (-1, -1)
        self._checked_ns: int | None = None
        self._stamps: list[int] = []
        self._positions: list[bytes] = []
        self._t_ns: NDArray[np.int64] = np.zeros(0, np.int64)
        self._q: NDArray[np.float64] = np.zeros((0, len(joints)))

    def time_ns(self, message: Message) -> int | None:
        """Return the time of a message [ns], its stamp unless that is zero; ``None``: none of our joints."""
        layout, columns = self._place(message)
        return None if columns is None else layout.stamp_ns(message.data) or message.log_time

    def take(self, message: Message) -> int | None:
        """Take one message; return its time [ns] as :meth:`time_ns` does.

        Raises
        ------
        RecordingError
            It cannot be decoded, has some of the joints but not all, stands before one of an earlier time, or
            its stamp is on another clock than its message time.
        """
        layout, columns = self._place(message)
        if columns is None:
            self.skipped += 1
            return None
        self._check_order(message)
        if self._current is None or self._current[0] is not layout:
            self._flush()
            self._current = layout, columns
        stamp = layout.stamp_ns(message.data) or message.log_time
        check_clock(self.recording.path, stamp, message.log_time)
        if stamp - message.log_time > self.ahead_ns:
            self.ahead_ns, self.ahead_at_ns = stamp - message.log_time, stamp
        behind_ns = max(0, message.log_time - stamp)
        if self.first_ns is None:
            self.first_ns, self.behind_ns = stamp, behind_ns
        self.behind_ns = min(self.behind_ns, behind_ns)
        self.last_ns = stamp
        self._stamps.append(stamp)
        self._positions.append(layout.position_bytes(message.data))
        return stamp

    def between(self, first_ns: int, last_ns: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return times [ns] and positions of the collected samples in ``[first_ns, last_ns]``.

        Raises
        ------
        RecordingError
            A value is NaN or infinite, or time repeats or runs backwards.
        """
        self._flush()
        first, last = np.searchsorted(self._t_ns, [first_ns, last_ns + 1])
        return self._t_ns[first:last], self._q[first:last]

    def drain(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return times [ns] and positions of all collected samples, and forget them.

        Raises
        ------
        RecordingError
            As :meth:`between`.
        """
        self._flush()
        taken = self._t_ns, self._q
        self._t_ns, self._q = self._t_ns[:0], self._q[:0]
        return taken

    def forget_before(self, time_ns: int) -> None:
        """Drop the samples before ``time_ns``."""
        self._flush()
        first = int(np.searchsorted(self._t_ns, time_ns))
        self._t_ns, self._q = self._t_ns[first:].copy(), self._q[first:].copy()

    def _flush(self) -> None:
        """Turn the collected bytes into checked arrays."""
        if not self._stamps or self._current is None:
            return
        layout, columns = self._current
        values = np.frombuffer(b"".join(self._positions), layout.order + "f8")
        t_ns = np.array(self._stamps, np.int64)
        q = values.reshape(len(t_ns), -1)[:, columns].astype(np.float64)
        self._stamps, self._positions = [], []
        self._check(t_ns, q)
        self._t_ns = np.concatenate([self._t_ns, t_ns])
        self._q = np.concatenate([self._q, q])

    def _check_order(self, message: Message) -> None:
        """Messages come sorted by message time: that must not hide that time ran backwards."""
        if message.place < self._place_in_file:
            raise RecordingError(
                self.recording.path,
                f"{JOINT_TOPIC}, message at {message.log_time} ns",
                "time runs backwards: a message before it in the file is of a later time",
                "message times must increase",
            )
        self._place_in_file = message.place

    def _check(self, t_ns: NDArray[np.int64], q: NDArray[np.float64]) -> None:
        bad = np.argwhere(~np.isfinite(q))
        if len(bad):
            row, column = bad[0]
            raise RecordingError(
                self.recording.path,
                f"{JOINT_TOPIC}, {self._at(int(t_ns[row]))}",
                f"joint {self.joints[column]} is {q[row, column]}",
                "every position must be a number",
            )
        before = int(t_ns[0]) - 1 if self._checked_ns is None else self._checked_ns
        self._checked_ns = int(t_ns[-1])
        steps = np.diff(t_ns, prepend=before)
        if (steps <= 0).any():
            row = int(np.argmax(steps <= 0))
            now = int(t_ns[row])
            wrong = "repeats" if steps[row] == 0 else f"runs backwards by {-steps[row] / NANO:.9g} s"
            raise RecordingError(
                self.recording.path,
                f"{JOINT_TOPIC}, {self._at(now)}",
                f"time {wrong}",
                "stamps must increase",
            )

    def _at(self, time_ns: int) -> str:
        return f"{(time_ns - (self.first_ns or 0)) / NANO:.6f} s after the first sample"

    def _place(self, message: Message) -> tuple[Layout, Columns | None]:
        """Where our joints are in a message; ``None``: it has none of them."""
        data = message.data
        for known in self._layouts:
            if known[0].fits(data):
                return known
        layout = self.recording.layout(message)
        entry = layout, self._choose(layout, message)
        self._layouts = [*self._layouts[1 - MAX_LAYOUTS :], entry]
        return entry

    def _choose(self, layout: Layout, message: Message) -> Columns | None:
        names, values = layout.names, layout.position[1]
        wrong = right = ""
        if self.assumed_order and not names:
            names = self.joints
            right = f"the robot has {len(names)}: {', '.join(names)}; name the joints in the messages"
        if not set(self.joints) & set(names):
            return None
        missing = [name for name in self.joints if name not in names]
        twice = [name for name in self.joints if names.count(name) > 1]
        if missing:
            wrong = f"lacks joint {', '.join(missing)} (it has {', '.join(names)})"
            right = "a message with one of the robot's joints must have all of them"
        elif twice:
            wrong = f"has joint {twice[0]} twice"
            right = "each joint must stand there once"
        elif values != len(names):
            wrong = f"has {values} positions for {len(names)} joints"
            right = right or "there must be one for each joint"
        if wrong:
            place = f"{JOINT_TOPIC}, message at {message.log_time} ns"
            raise RecordingError(self.recording.path, place, wrong, right)
        return np.array([names.index(name) for name in self.joints])


class OtherJoints:
    """Reads what messages say of joints that may stand in only some of them."""

    def __init__(self, recording: Recording, joints: Collection[str]) -> None:
        self._recording, self._wanted = recording, frozenset(joints)
        self._layouts: list[tuple[Layout, tuple[tuple[str, int], ...]]] = []

    def positions(self, message: Message) -> Iterator[tuple[str, int, float]]:
        """Yield joint, time [ns] and position [rad or m] of those that a message holds, whatever they are.

        Raises
        ------
        RecordingError
            The message cannot be decoded.
        """
        layout, places = self._place(message)
        if not places:
            return
        values = np.frombuffer(layout.position_bytes(message.data), layout.order + "f8")
        time_ns = layout.stamp_ns(message.data) or message.log_time
        for name, place in places:
            yield name, time_ns, float(values[place])

    def _place(self, message: Message) -> tuple[Layout, tuple[tuple[str, int], ...]]:
        for known in self._layouts:
            if known[0].fits(message.data):
                return known
        layout = self._recording.layout(message)
        named = enumerate(layout.names[: layout.position[1]])
        entry = layout, tuple((name, place) for place, name in named if name in self._wanted)
        self._layouts = [*self._layouts[1 - MAX_LAYOUTS :], entry]
        return entry
