"""The loop around a supervisor: instants, deadlines, what the system grants (docs/supervisor.md).

The loop wakes up at every t_k, calls ``step`` and hands the command over. What was not handed over by its
deadline is withdrawn. It ends with the robot at rest: whoever stops it stops the robot along its path first.
Where the robot has been left to stop by itself, it ends at once.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import os
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.report import RawMeasurement
from robots.errors import SetupError
from verifier.command import Cause, Command, State
from verifier.proposal import Stop
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading
from verifier.verdict import Reason

FASTEST_HZ, SLOWEST_HZ = 1000.0, 10.0
"""Rates beyond these are refused: nothing shows that they can be kept, or that they are of use."""
_YOUNG_ONLY = 0
"""Generation of objects that is collected in idle time: what the last cycles left, no more."""


class Clock(Protocol):
    """Time as the loop sees it; the clock of all stamps."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep_until(self, t: float) -> None:
        """Return at ``t`` [s] or later; at once if that is past."""
        ...


class MonotonicClock:
    """The clock of this machine that never steps back."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Return at ``t`` [s] or later."""
        left = t - time.monotonic()
        if left > 0.0:
            time.sleep(left)


class Source(Protocol):
    """Where reports and readings come from. Neither call may block."""

    def measurements(self) -> Iterable[RawMeasurement]:
        """Return the reports about people that have arrived since the call before."""
        ...

    def joints(self) -> JointReading | None:
        """Return the newest reading of the joints; ``None`` if this robot reports none."""
        ...


class Sink(Protocol):
    """The robot side."""

    def send(self, command: Command) -> bool:
        """Hand a command and its plan over; return whether the robot side holds both by the deadline.

        Returns by ``command.deadline``. After ``False`` the robot side must not take them up later.
        """
        ...


class Histogram:
    """Counts of durations in fixed bins, evenly spaced on a logarithmic scale; nothing grows with time.

    Attributes
    ----------
    edges:
        ``(bins + 1,)`` [s]; what is below the first or above the last edge counts in the outermost bin.
    counts:
        ``(bins,)``.
    longest_s:
        Longest duration [s].
    """

    def __init__(self, shortest_s: float = 1e-6, longest_s: float = 1.0, bins: int = 120) -> None:
        self.edges: NDArray[np.float64] = np.geomspace(shortest_s, longest_s, bins + 1)
        self.counts: NDArray[np.int64] = np.zeros(bins, dtype=np.int64)
        self.longest_s = 0.0
        self._low = math.log(shortest_s)
        self._per_bin = bins / (math.log(longest_s) - self._low)

    def add(self, duration_s: float) -> None:
        """Count a duration [s]; what is not a number counts as longest."""
        last = len(self.counts) - 1
        if not duration_s > 0.0:
            place = 0 if duration_s <= 0.0 else last
        elif duration_s == math.inf:
            place = last
        else:
            place = min(max(int((math.log(duration_s) - self._low) * self._per_bin), 0), last)
        self.counts[place] += 1
        if not duration_s <= self.longest_s:
            self.longest_s = duration_s

    def quantile(self, share: float) -> float:
        """Return a duration [s] that at least ``share`` of all do not exceed; NaN if there are none."""
        total = int(self.counts.sum())
        if total == 0:
            return math.nan
        place = int(np.searchsorted(np.cumsum(self.counts), math.ceil(share * total)))
        return self.longest_s if place >= len(self.counts) - 1 else float(self.edges[place + 1])


@dataclass(frozen=True, slots=True)
class Granted:
    """What the operating system grants the process; asked for, then looked at.

    Attributes
    ----------
    memory_locked:
        Pages stay in memory.
    priority:
        Real-time priority, first in first out; ``None``: ordinary scheduling.
    refused:
        Why something was not granted, one line each.
    """

    memory_locked: bool = False
    priority: int | None = None
    refused: tuple[str, ...] = ()


def ask_for_real_time(priority: int = 50) -> Granted:
    """Ask for locked memory and a real-time priority; report what was granted, and why the rest was not.

    Neither makes a loop on an ordinary kernel a real-time one.
    """
    refused = []
    locked = _lock_memory()
    if locked is not None:
        refused.append(f"memory is not locked: {locked}")
    given: int | None = None
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        given = os.sched_getparam(0).sched_priority if os.sched_getscheduler(0) == os.SCHED_FIFO else None
    except (AttributeError, OSError, ValueError) as error:
        refused.append(f"no real-time priority: {error}")
    return Granted(locked is None, given, tuple(refused))


def _lock_memory() -> str | None:
    """Lock present and future pages; return why not."""
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if library.mlockall(3) == 0:  # MCL_CURRENT | MCL_FUTURE
            return None
        return os.strerror(ctypes.get_errno())
    except (AttributeError, OSError, TypeError) as error:
        return str(error)


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How the loop runs.

    Attributes
    ----------
    handover_s:
        Time [s] that the robot side needs to take up a command; a command that is ready later than this
        before its deadline is not sent.
    longest_stop_s:
        When the loop is told to stop, the robot rests after this [s] at the latest, or the loop ends all the
        same and leaves it to the plan that the robot side holds.
    collect_s:
        Least idle time [s] in a cycle for the garbage of the last cycles to be collected in it.
    """

    handover_s: float = 0.0
    longest_stop_s: float = 10.0
    collect_s: float = 0.001

    def __post_init__(self) -> None:
        for name in ("handover_s", "longest_stop_s", "collect_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise SetupError(f"{name} = {getattr(self, name)} should be finite and not negative")


@dataclass(slots=True)
class LoopReport:
    """What has happened so far.

    Attributes
    ----------
    cycles:
        Steps.
    missed:
        Cycles in which no step was called.
    late:
        Commands that were withdrawn because they were ready too late.
    not_taken:
        Commands that the robot side did not take by the deadline, or whose handing over failed.
    source_faults:
        Cycles in which reading reports or joints raised an exception.
    causes:
        Steps by ``Cause``.
    step_time, wake_up:
        From the call of a step until its command was handed over; from t_k until the loop was awake.
    at_rest:
        The last command lets the robot stand still.
    silence:
        The robot stops by itself, because it did not get a command: wait until it rests, then make a new
        supervisor and a new loop.
    fault:
        What a source or sink raised last.
    """

    cycles: int = 0
    missed: int = 0
    late: int = 0
    not_taken: int = 0
    source_faults: int = 0
    causes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Cause), dtype=np.int64))
    step_time: Histogram = field(default_factory=Histogram)
    wake_up: Histogram = field(default_factory=Histogram)
    at_rest: bool = True
    silence: bool = False
    fault: Exception | None = None


class Loop:
    """Calls a supervisor at a fixed rate until it is told to stop; :func:`verifier.rehearsal.rehearse` first.

    Parameters
    ----------
    supervisor:
        Its cycle is that of the loop.
    source, sink:
        Reports and readings; the robot side.
    settings, clock:
        As above; without a clock :class:`MonotonicClock`.

    Raises
    ------
    SetupError
        The cycle is shorter than 1 ms or longer than 0.1 s.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        source: Source,
        sink: Sink,
        settings: LoopSettings | None = None,
        clock: Clock | None = None,
    ) -> None:
        cycle = supervisor.cycle_s
        if not 1.0 / FASTEST_HZ <= cycle <= 1.0 / SLOWEST_HZ:
            raise SetupError(
                f"cycle of {cycle} s should be {1 / FASTEST_HZ:g} s to {1 / SLOWEST_HZ:g} s for a loop"
            )
        self.supervisor, self.source, self.sink = supervisor, source, sink
        self.settings = settings or LoopSettings()
        self.clock = clock or MonotonicClock()
        self.report = LoopReport()
        self._cycle = cycle
        self._origin, self._k = math.nan, 0
        self._stop = threading.Event()

    def stop(self) -> None:
        """Bring the robot to rest along its path, then let :meth:`run` return. From any thread or signal."""
        self._stop.set()

    def run(self, cycles: int | None = None) -> LoopReport:
        """Run until :meth:`stop`, or for a number of cycles, and then until the robot rests.

        Where a robot that stops by itself (``[robot.silence]``) did not get a command, nothing more is sent:
        the loop ends, and is of no further use. The robot is not at rest yet then.

        An exception that gets out of it ends the loop at once: the robot side goes on with the plan that it
        holds, and rests.
        """
        with _collector_held_off():
            ends_at = math.inf
            while True:
                self._wait()
                if self._stop.is_set() or (cycles is not None and self.report.cycles >= cycles):
                    if ends_at == math.inf:
                        ends_at = self.clock.now() + self.settings.longest_stop_s
                    self.supervisor.propose(Stop())  # in every cycle: somebody may propose something else
                command = self._one_cycle()
                if self.report.silence:
                    return self.report
                if ends_at < math.inf and (self.report.at_rest or self.clock.now() >= ends_at):
                    return self.report
                self._tidy(command.deadline)

    def _wait(self) -> None:
        """Sleep until the next instant, or go on at once if it is past by less than most of a cycle."""
        if math.isnan(self._origin):
            return
        late = (self.clock.now() - self._origin) / self._cycle
        due = self._origin + max(self._k + 1, math.ceil(late - 0.75)) * self._cycle
        self.clock.sleep_until(due)
        self.report.wake_up.add(self.clock.now() - due)

    def _one_cycle(self) -> Command:
        report, clock = self.report, self.clock
        begin = clock.now()
        measurements, joints = self._read(begin)
        now = clock.now()  # not before the last report has arrived
        if math.isnan(self._origin):
            self._origin = now
        self._k = math.floor((now - self._origin) / self._cycle + 0.25)
        command = self.supervisor.step(now, measurements, joints)
        report.silence = command.verdict.reason is Reason.SILENCE
        if not report.silence:
            command = self._hand_over(command)
            report.silence = self.supervisor.stops_by_itself
        report.step_time.add(clock.now() - begin)
        report.cycles += 1
        report.missed += command.missed
        report.causes[command.cause] += 1
        report.at_rest = command.outcome is State.STOPPED and not report.silence
        return command

    def _read(self, now: float) -> tuple[tuple[RawMeasurement, ...], JointReading | None]:
        """Ask the source; reports that cannot be read are none, joints that cannot be read do not follow."""
        reports: tuple[RawMeasurement, ...] = ()
        joints: JointReading | None = None
        try:
            reports = tuple(self.source.measurements())
            joints = self.source.joints()
        except Exception as error:
            self.report.source_faults += 1
            self.report.fault = error
            joints = JointReading(now, np.full(0, math.nan))
        return reports, joints

    def _hand_over(self, command: Command) -> Command:
        """Send a command in time, or withdraw it."""
        if not self.clock.now() + self.settings.handover_s <= command.deadline:
            self.report.late += 1
            return self.supervisor.withdraw()
        try:
            taken = self.sink.send(command)
        except Exception as error:
            self.report.fault = error
            taken = False
        if taken is True:
            return command
        self.report.not_taken += 1
        return self.supervisor.withdraw()

    def _tidy(self, deadline: float) -> None:
        """Collect what the last cycles left, if there is time until the next one."""
        if deadline - self.clock.now() >= self.settings.collect_s:
            gc.collect(_YOUNG_ONLY)


@contextlib.contextmanager
def _collector_held_off() -> Iterator[None]:
    """Let no collection begin by itself, and none look at what was there before."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()
