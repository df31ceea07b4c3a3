"""The worst stop of a recording: the plan of every cycle, as `verify` makes it, and what its stop takes.

Of each stop, from when it begins to rest, in the commanded motion:

- time: of the plan.
- angle of a joint: from below the largest displacement at the ends of slices. From above h²/8 max|ddq| more
  on each slice of length h (a curve is no farther from its chord), and what other motions the slice stands
  for.
- way of a point: from above the largest speed of any point of each link, slice by slice, times the length of
  the slice. From below chords between the ends of slices.
- speed of the fastest point: from above as before; from below a chord by the time that it took, or the point
  of the capsules that is the fastest when that stop begins.

Plans whose stop is the robot's own (measured) are bounds, and nothing of them is reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from failsafe.bracket import Bracket, Ended, Witness
from failsafe.plan import PlanOutcome, PlanResult, StopKind
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY, ArmSearch
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.recordings import Reading
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Sections
from verifier.setup import build_watch
from verifier.stop_report.poses import fastest_at
from verifier.stop_report.report import (
    MEASURED,
    PATH_CONSISTENT,
    RECORDED,
    Array,
    Profile,
    RecordedStops,
    StopCase,
    Window,
)

_METHOD = "plan of every cycle, bounds over its slices"
_OUTWARD = 1.0 + 1e-9


def stops_over(
    reading: Reading,
    cell: Cell,
    arm: ArmSearch,
    should_end: Callable[[], bool],
    progress: Callable[[float], None],
) -> RecordedStops:
    """Find the worst stop of a recording.

    Raises
    ------
    SetupError
        The recording is shorter than a cycle, or its samples cannot be used.
    """
    start, end = reading.overlap
    cycles = max(0, math.floor((end - start) / cell.cycle_s + 1e-9))
    if cycles == 0:
        raise SetupError(
            f"{reading.path}: {end - start:.3f} s of overlap is shorter than a cycle of {cell.cycle_s} s"
        )
    worst = _Worst(arm, start)
    sections = Sections(reading.path, cell, arm.model, build_watch(cell).gate)
    times, k = np.full(cycles, np.nan), 0
    for window in reading.windows(WINDOW_S, LEAD_S, TAIL_S):
        section = sections.next(window)
        while k < cycles and (window.last or start + k * cell.cycle_s < window.end):
            if should_end():
                return worst.result(cell.cycle_s, times, k, sections.residual)
            t = start + k * cell.cycle_s
            plan = section.plan(t)
            worst.take(t, plan, section.planner.slices[0], section.planner.slices)
            times[k] = plan.stop_time_s if plan.outcome is PlanOutcome.READY else math.nan
            k += 1
            if k % 256 == 0:
                progress(k / cycles)
    progress(1.0)
    return worst.result(cell.cycle_s, times, k, sections.residual)


@dataclass
class _Extreme:
    """Largest bound so far, and the largest value that was reached, with state and instant."""

    upper: float = 0.0
    lower: float = 0.0
    witness: Witness | None = None
    t: float = math.nan
    part: int = -1

    def raise_to(self, upper: float, lower: float, witness: Witness, t: float, part: int) -> None:
        self.upper = max(self.upper, upper)
        if lower > self.lower or self.witness is None:
            self.lower, self.witness, self.t, self.part = lower, witness, t, part


@dataclass
class _Counts:
    planned: int = 0
    without: int = 0
    beyond: int = 0
    off_path: int = 0


@dataclass
class _Worst:
    """The worst of the stops that were taken in."""

    arm: ArmSearch
    start: float
    counts: _Counts = field(default_factory=_Counts)
    profile: Profile | None = None

    def __post_init__(self) -> None:
        model = self.arm.model
        self._sweep, self._links = LinkOccupancy(model), new_link_sets()
        self._time, self._way, self._speed = _Extreme(), _Extreme(), _Extreme()
        self._angles = [_Extreme() for _ in model.joints]
        self._slowest, self._own = -1.0, False

    def take(self, t: float, plan: PlanResult, slices: np.void, block: np.ndarray) -> None:
        """Take in the plan of the cycle at ``t`` [s]."""
        if plan.outcome is not PlanOutcome.READY:
            beyond = plan.outcome is PlanOutcome.BEYOND_END
            self.counts.beyond += beyond
            self.counts.without += not beyond
            return
        self.counts.planned += 1
        self.counts.off_path += plan.stop is StopKind.JOINT_SPACE
        own = plan.stop is StopKind.MEASURED
        self._own |= own
        n, j = int(slices["n"]), len(self.arm.model.joints)
        times = slices["t"][: n + 1]
        first = min(n, int(np.searchsorted(times, plan.t_stop_begin - 1e-9)))
        q, dq = slices["q"][first : n + 1, :j], slices["dq"][first : n + 1, :j]
        witness = Witness(q[0].copy(), dq[0].copy(), slices["ddq"][first, :j].copy())
        t -= self.start
        self._time.raise_to(plan.stop_time_s, 0.0 if own else plan.stop_time_s, witness, t, -1)
        if plan.stop_time_s > self._slowest:
            self._slowest = plan.stop_time_s
            stop = MEASURED if own else PATH_CONSISTENT
            self.profile = Profile(stop, RECORDED, times[first:] - times[first], np.abs(q - q[0]), np.abs(dq))
        h = np.diff(times[first:])
        self._turned(t, slices, (first, n), h, witness, own=own)
        self._travelled(t, block, (first, n), h, witness, own=own)

    def _turned(
        self, t: float, slices: np.void, span: tuple[int, int], h: Array, witness: Witness, *, own: bool
    ) -> None:
        first, n = span
        j = len(self._angles)
        moved = np.abs(slices["q"][first : n + 1, :j] - slices["q"][first, :j])
        bend = (h * h / 8.0)[:, None] * slices["ddq_max"][first:n, :j] + slices["q_spread"][first:n, :j]
        above = np.maximum(moved[:-1], moved[1:]) + bend
        upper = above.max(axis=0, initial=0.0) * _OUTWARD
        for joint, extreme in enumerate(self._angles):
            reached = 0.0 if own else float(moved[:, joint].max())
            extreme.raise_to(float(upper[joint]), reached, witness, t, joint)

    def _travelled(
        self, t: float, block: np.ndarray, span: tuple[int, int], h: Array, witness: Witness, *, own: bool
    ) -> None:
        """Bound way and speed of the points; they are followed only where that may be the worst."""
        first, n = span
        self._sweep.occupy(block, self._links)
        links = len(self.arm.model.links)
        speeds = self._links["speed_max"][0, : n * links].reshape(n, links)[first:]
        upper = float((h @ speeds).max(initial=0.0)) * _OUTWARD
        fastest = float(speeds.max(initial=0.0))
        reached, quickest, point = 0.0, 0.0, -1
        if not own and (upper > self._way.lower or fastest > self._speed.lower) and len(h):
            chords = np.linalg.norm(
                np.diff(
                    self.arm.places(np.ascontiguousarray(block["q"][0, first : n + 1, : len(witness.q)])),
                    axis=0,
                ),
                axis=2,
            )
            lengths = chords.sum(axis=0)
            point = int(np.argmax(lengths))
            reached, quickest = float(lengths[point]), float((chords / h[:, None]).max())
        self._way.raise_to(upper, reached, witness, t, point)
        self._speed.raise_to(fastest, quickest, witness, t, point)

    def result(self, cycle_s: float, times: Array, looked_at: int, residual: Array | None) -> RecordedStops:
        """Return what was found in the first cycles."""
        counts = self.counts
        case = None
        if counts.planned:
            brackets, instants = self._brackets(complete=looked_at == len(times), of=len(times), at=looked_at)
            case = StopCase(MEASURED if self._own else PATH_CONSISTENT, RECORDED, brackets, instants)
        return RecordedStops(
            cycle_s * np.arange(len(times), dtype=np.float64), times, counts.planned, counts.without,
            counts.beyond, looked_at, counts.off_path, case, self.profile, residual,
        )  # fmt: skip

    def _brackets(
        self, *, complete: bool, of: int, at: int
    ) -> tuple[tuple[Bracket, ...], tuple[Window | None, ...]]:
        model = self.arm.model
        if self._speed.witness is not None and self._speed.lower > 0.0:
            there = float(np.linalg.norm(fastest_at(self.arm, self._speed.witness)[1]))
            self._speed.lower = min(max(self._speed.lower, there), self._speed.upper)
        ended = Ended.CLOSED_FORM if complete else Ended.INTERRUPTED
        reason = "" if complete else f"ended when {at} of {of} cycles had been looked at"
        rows = [(STOP_TIME, "all joints", "s", self._time)]
        for joint, extreme in zip(model.joints, self._angles, strict=True):
            slides = bool(model.kinematics[0]["prismatic"][model.joints.index(joint)])
            rows.append((STOP_ANGLE, joint, "m" if slides else "rad", extreme))
        rows.append((POINT_SPEED, self._link(self._speed), "m/s", self._speed))
        rows.append((STOP_WAY, self._link(self._way), "m", self._way))
        brackets = tuple(
            Bracket(
                quantity, part, unit, each.lower, max(each.upper, each.lower) if complete else math.inf,
                each.witness, _METHOD if complete else "none", ended, reason, 0.0,
            )
            for quantity, part, unit, each in rows
        )  # fmt: skip
        instants = tuple(Window(each.t) for *_names, each in rows)
        return brackets, instants

    def _link(self, extreme: _Extreme) -> str:
        return self.arm.links[extreme.part] if extreme.part >= 0 else "any link"


def joint_units(model: RobotModel) -> tuple[str, ...]:
    """Return the unit of each joint."""
    sliding = model.kinematics[0]["prismatic"]
    return tuple("m" if sliding[j] else "rad" for j in range(len(model.joints)))
