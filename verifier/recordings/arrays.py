"""A recording as arrays: joint samples and points of people, without a file."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from occupancy.body import MAX_POINTS
from robots.errors import SetupError
from verifier.recordings.joint_state import NANO
from verifier.recordings.people_report import WORLD, PeopleReport, ReportedPerson
from verifier.recordings.people_stream import MAX_CLOCK_OFFSET_S
from verifier.recordings.window import ARRIVED, Window
from verifier.recordings.windowed import JointPosition

Array = NDArray[np.float64]

LATEST_STAMP_S = 9e9
"""Times beyond this [s] do not fit into 64 bits of nanoseconds."""
_ALL_POINTS = (1 << MAX_POINTS) - 1


class ArrayError(SetupError):
    """Arrays that are no recording; one line that names array, place and rule."""


@dataclass(frozen=True, eq=False)
class JointSamples:
    """Measured or intended joint motion.

    Attributes
    ----------
    t:
        (T,) s, on any epoch; rounded to whole nanoseconds, as in a recording.
    q:
        (T, J) rad or m, in the order of the robot's joints.

    Raises
    ------
    ArrayError
        Shapes do not agree, there are fewer than two samples, a value is not finite, times do not increase.
    """

    t: Array
    q: Array
    t_ns: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        t, q = _numbers("joints: t", self.t), _numbers("joints: q", self.q)
        if t.ndim != 1 or q.ndim != 2 or len(q) != len(t):
            raise ArrayError(f"joints: t {t.shape} and q {q.shape} should be (T,) and (T, J)")
        if len(t) < 2:
            raise ArrayError(f"joints: {len(t)} samples; a motion takes at least two")
        t_ns = _nanoseconds("joints: t", t)
        if not np.isfinite(q).all():
            row, joint = (int(i) for i in np.argwhere(~np.isfinite(q))[0])
            raise ArrayError(f"joints: q[{row}, {joint}] is {q[row, joint]}, should be finite")
        _increasing("joints: t", t, t_ns, strictly=True)
        _keep(self, t=t, q=q, t_ns=t_ns)


@dataclass(frozen=True, eq=False)
class PeoplePoints:
    """Reports about people, one row each; what stands in ``/people`` of a recording (docs/recordings.md).

    Attributes
    ----------
    t:
        (R,) s, when each was seen, on the clock of the joints.
    xyz:
        (R, P, 20, 3) m, in the world; points in the order of :class:`occupancy.body.Point`; NaN: missing.
    arrived:
        (R,) s, when each arrived, not decreasing; ``None``: at once.
    error_m:
        Position error [m]: one number, (R, P, 20), NaN where not stated, or ``None``: nowhere stated.
    measured:
        (R, P) bits of the points that were measured and not inferred; ``None``: all.
    listed:
        (R, P) whether a report lists a person at all; ``None``: every report lists everybody.
    complete:
        (R,) whether nobody else is in the monitored region, or one answer for all.
    ids:
        Names of the P persons; ``None``: p1, p2, ...

    Raises
    ------
    ArrayError
        Shapes do not agree, there is no report, times are not finite or not in order, stamp and arrival are
        more than 10 s apart, a point is infinite, names are empty or stand there twice.
    """

    t: Array
    xyz: Array
    arrived: Array | None = None
    error_m: float | Array | None = None
    measured: NDArray[np.integer] | None = None
    listed: NDArray[np.bool_] | None = None
    complete: bool | NDArray[np.bool_] = False
    ids: tuple[str, ...] | None = None
    reports: tuple[PeopleReport, ...] = field(init=False)

    def __post_init__(self) -> None:
        t, xyz = _numbers("people: t", self.t), _numbers("people: xyz", self.xyz)
        if t.ndim != 1 or xyz.ndim != 4 or xyz.shape[0] != len(t) or xyz.shape[2:] != (MAX_POINTS, 3):
            raise ArrayError(
                f"people: t {t.shape} and xyz {xyz.shape} should be (R,) and (R, P, {MAX_POINTS}, 3)"
            )
        if len(t) == 0:
            raise ArrayError("people: there is no report; state one that lists nobody if nobody is there")
        if np.isinf(xyz).any():
            row, person, point, _ = (int(i) for i in np.argwhere(np.isinf(xyz))[0])
            raise ArrayError(f"people: xyz[{row}, {person}, {point}] is infinite; a missing point is NaN")
        table = _Table(len(t), xyz.shape[1])
        arrived = t if self.arrived is None else table.rows("arrived", self.arrived, np.float64)
        stamp_ns, arrived_ns = _nanoseconds("people: t", t), _nanoseconds("people: arrived", arrived)
        _increasing("people: arrived", arrived, arrived_ns, strictly=False)
        apart = np.abs(arrived - t)
        if not (apart <= MAX_CLOCK_OFFSET_S).all():
            row = int(np.argmax(apart))
            raise ArrayError(
                f"people: t[{row}] = {t[row]:.6g} s and arrived[{row}] = {arrived[row]:.6g} s are more than "
                f"{MAX_CLOCK_OFFSET_S:g} s apart; both must be on one clock"
            )
        error = table.errors(self.error_m)
        measured = table.persons("measured", _ALL_POINTS if self.measured is None else self.measured, "iu")
        listed = table.persons("listed", True if self.listed is None else self.listed, "b")
        complete = table.answers(self.complete)
        ids = table.ids(self.ids)
        reports = tuple(
            PeopleReport(
                int(stamp_ns[r]),
                int(arrived_ns[r]),
                WORLD,
                bool(complete[r]),
                tuple(
                    ReportedPerson(ids[p], xyz[r, p], error[r, p], int(measured[r, p]))
                    for p in range(len(ids))
                    if listed[r, p]
                ),
            )
            for r in range(len(t))
        )
        _keep(self, t=t, xyz=xyz, arrived=arrived, ids=ids, reports=reports)


@dataclass(frozen=True, slots=True)
class _Table:
    """R reports about P persons: arrays that are one row or one value for each."""

    reports: int
    persons_: int

    def rows(self, name: str, value: ArrayLike, dtype: type) -> Array:
        found: Array = np.ascontiguousarray(value, dtype=dtype)
        if found.shape != (self.reports,):
            raise ArrayError(f"people: {name} {found.shape} should be ({self.reports},)")
        return found

    def persons(self, name: str, value: ArrayLike, kinds: str) -> NDArray[np.integer]:
        found = np.asarray(value)
        if found.dtype.kind not in kinds:
            what = "truth values" if kinds == "b" else "integers, one bit for each point"
            raise ArrayError(f"people: {name} is an array of {found.dtype}, should be {what}")
        if found.ndim == 0:
            return np.broadcast_to(found, (self.reports, self.persons_))
        if found.shape != (self.reports, self.persons_):
            raise ArrayError(f"people: {name} {found.shape} should be ({self.reports}, {self.persons_})")
        return found

    def answers(self, value: ArrayLike) -> NDArray[np.bool_]:
        found = np.asarray(value)
        if found.dtype != np.bool_ or found.shape not in ((), (self.reports,)):
            raise ArrayError(
                f"people: complete, {found.dtype} {found.shape}, should be True or False, for all or "
                f"for each ({self.reports},)"
            )
        return np.broadcast_to(found, (self.reports,))

    def errors(self, value: float | Array | None) -> Array:
        found = np.asarray(np.nan if value is None else value, dtype=np.float64)
        shape = (self.reports, self.persons_, MAX_POINTS)
        if found.ndim == 0:
            return np.broadcast_to(found, shape).copy()
        if found.shape != shape:
            raise ArrayError(f"people: error_m {found.shape} should be one number or {shape}")
        return np.ascontiguousarray(found)

    def ids(self, given: tuple[str, ...] | None) -> tuple[str, ...]:
        ids = tuple(f"p{p + 1}" for p in range(self.persons_)) if given is None else tuple(given)
        if len(ids) != self.persons_ or len(set(ids)) != len(ids) or not all(ids):
            raise ArrayError(f"people: ids {ids} should be {self.persons_} different names")
        return ids


class ArraySource:
    """Arrays in the place of a file that is read window by window; see :class:`verifier.recordings.Reading`.

    Raises
    ------
    ArrayError
        The samples have another number of joints than the robot, or joints and people do not overlap.
    """

    path = Path("arrays")

    def __init__(self, joints: JointSamples, people: PeoplePoints, robot_joints: tuple[str, ...]) -> None:
        if joints.q.shape[1] != len(robot_joints):
            raise ArrayError(
                f"joints: q has {joints.q.shape[1]} columns, the robot has {len(robot_joints)} joints: "
                f"{', '.join(robot_joints)}"
            )
        self._joints, self._reports = joints, people.reports
        self._epoch, self._last = int(joints.t_ns[0]), int(joints.t_ns[-1])
        first = max(self._epoch, self._reports[0].seen_by_ns)
        if first > self._last or self._reports[-1].stamp_ns < self._epoch:
            raise ArrayError(
                f"joints ({joints.t[0]:.6g} … {joints.t[-1]:.6g} s) and people ({people.t[0]:.6g} … "
                f"{people.t[-1]:.6g} s) do not overlap in time: both must be on one clock"
            )
        self.overlap = ((first - self._epoch) / NANO, (self._last - self._epoch) / NANO)

    def positions_of(self, _joints: Collection[str]) -> Iterator[JointPosition]:
        """Yield nothing: the arrays are of the commanded joints."""
        return iter(())

    def longest_step(self) -> tuple[float, float]:
        """Return begin and length [s] of the longest time between two joint samples."""
        steps = np.diff(self._joints.t_ns)
        begin = int(np.argmax(steps))
        return float(self._joints.t_ns[begin] - self._epoch) / NANO, float(steps[begin]) / NANO

    def windows(self, length_s: float, before_s: float, after_s: float) -> Iterator[Window]:
        """Yield the windows in which a file with these samples and reports would be read."""
        length, before, after = (round(value * NANO) for value in (length_s, before_s, after_s))
        t_ns, q, reports = self._joints.t_ns, self._joints.q, self._reports
        start, given, last = self._epoch, 0, False
        while not last:
            end = start + length
            last = end + after >= self._last
            end = max(end, self._last) if last else end
            a, b = np.searchsorted(t_ns, [start - before, end + after + 1])
            arrived = len(reports) if last else bisect_left(reports, end, key=ARRIVED)
            ahead = [report for report in reports[arrived:] if report.seen_by_ns <= end + after]
            yield Window(
                (start - self._epoch) / NANO,
                (min(end, self._last) - self._epoch) / NANO,
                (t_ns[a:b] - self._epoch) / NANO,
                q[a:b],
                tuple(report.measurement(self._epoch) for report in reports[given:arrived]),
                tuple(report.measurement(self._epoch) for report in ahead),
                last,
            )
            start, given = end, arrived


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        return np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"{name} should be an array of numbers: {error}") from error


def _nanoseconds(name: str, t: Array) -> NDArray[np.int64]:
    ok = np.abs(t) <= LATEST_STAMP_S
    if not ok.all():
        row = int(np.argmin(ok))
        raise ArrayError(f"{name}[{row}] is {t[row]} s, should be finite and at most {LATEST_STAMP_S:g} s")
    return np.round(t * NANO).astype(np.int64)


def _increasing(name: str, t: Array, t_ns: NDArray[np.int64], *, strictly: bool) -> None:
    wrong = np.diff(t_ns) < (1 if strictly else 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        rule = "increase" if strictly else "not decrease"
        raise ArrayError(f"{name} should {rule}, but {t[row]:.9g} s is followed by {t[row + 1]:.9g} s")


def _keep(owner: object, **values: object) -> None:
    for name, value in values.items():
        object.__setattr__(owner, name, value)
