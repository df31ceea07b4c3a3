"""S_p of ISO/TS 15066 held against the separation of a recorded arm from recorded people (docs/limits.md).

It says how a speed and separation monitoring that only knows distances and speeds would have seen a
recording; :mod:`verifier.replay` looks at where everybody can come to, and is the finer of the two. For each
cycle, link and person:

- *separation*: between the link where the robot is at the beginning, its largest delay granted, and the
  person where the newest of their points was seen; older points have grown until then as the models of the
  cell say. Errors of position are not subtracted: they are Z_d and Z_r.
- T_r: from that sighting over two periods of the cycle and the largest delay to the begin of the stop; T_s:
  the stop that `verify` plans. S_h = v_h (T_r + T_s). S_r and S_s: integrals of the largest speed that any
  point of the link can have, slice by slice, tracking errors included. Speeds are taken as if both went
  straight towards each other.
- Z_d: the largest position error of the person's points. Z_r: how far tracking errors displace the link.

Links that do not move in a cycle are not held against anybody, as in `verify`. People whom nobody reports,
and body parts that cannot be enclosed, are no matter of a distance: cycles with such a person are not
compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanResult
from failsafe.short_term_plan import ShortTermPlanner
from occupancy.body import MAX_POINTS
from occupancy.separation import new_ledger
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.model import RobotModel
from robots.motion import Block, new_slices
from verifier.cell import Cell
from verifier.criteria import Scene
from verifier.cycle import Known
from verifier.judge import Judge
from verifier.opened import open_placed
from verifier.recordings import Reading, Recording
from verifier.reported import lacks_errors
from verifier.required_distance import (
    Allowances,
    RequiredDistance,
    SpeedBound,
    Times,
    protective_separation,
    varying_lengths,
)
from verifier.section import LEAD_S, TAIL_S, WINDOW_S, Section, Sections
from verifier.setup import build_profile, build_robot

Array = NDArray[np.float64]

_ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True)
class MonitoringSettings:
    """What the technical specification leaves to whoever applies it.

    Attributes
    ----------
    person_speed:
        v_h [m/s]; ``None``: the largest speed of the cell's profile.
    intrusion:
        C [m]; ``None``: 0, shown as default. It is 0 where the sensor reports hands, or their space is
        enclosed, as it is here.
    """

    person_speed: Assumption | None = None
    intrusion: Assumption | None = None

    def __post_init__(self) -> None:
        for name, item, unit in (("v_h", self.person_speed, "m/s"), ("C", self.intrusion, "m")):
            value = 0.0 if item is None else item.value
            if isinstance(value, str) or not 0.0 <= value < math.inf or (item and item.unit != unit):
                raise SetupError(f"{name} = {value} should be a number in {unit}, finite and not negative")


ENCLOSURES = "enclosures (of parts not seen too)"
"""Between what separations are measured."""


@dataclass(frozen=True, slots=True)
class Instant:
    """One cycle: the pair of link and person with the least room.

    Attributes
    ----------
    t:
        Since the start of the overlap [s].
    link, person:
        Which pair.
    separation_m:
        How far their enclosures are apart [m], those of body parts that were not seen too; negative: they
        overlap by about as much.
    required:
        S_p with its terms.
    """

    t: float
    link: str
    person: str
    separation_m: float
    required: RequiredDistance

    @property
    def room_m(self) -> float:
        """Separation less S_p [m]; negative: too close."""
        return self.separation_m - self.required.distance_m


@dataclass(frozen=True, eq=False)
class SeparationHistory:
    """Separation and S_p over a recording.

    Attributes
    ----------
    recording, robot, profile:
        Of what.
    t:
        (N,) s, the cycles, since the start of the overlap.
    separation_m, required_m:
        (N,) m, of the pair with the least room in each cycle; NaN where nothing was compared.
    worst:
        The cycle with the least room; ``None``: none was compared.
    default_error:
        Whether a point came without an error of its own, so that the cell's may have been used.
    """

    recording: str
    robot: str
    profile: str
    t: Array
    separation_m: Array
    required_m: Array
    worst: Instant | None
    default_error: bool

    @property
    def compared(self) -> int:
        """Number of cycles in which a moving link was held against somebody."""
        return int(np.count_nonzero(np.isfinite(self.required_m)))

    @property
    def too_close(self) -> int:
        """Number of cycles with less separation than S_p."""
        return int(np.count_nonzero(self.separation_m < self.required_m))


def separation_history(
    recording: Recording | str | Path,
    cell: Cell,
    settings: MonitoringSettings | None = None,
    *,
    window_s: tuple[float, float] = (0.0, math.inf),
    progress: Callable[[float], None] | None = None,
    cache_dir: Path | None = None,
) -> SeparationHistory:
    """Hold S_p against the separation in every cycle of a recording.

    Parameters
    ----------
    recording, cell, settings:
        What is looked at, and by which numbers.
    window_s:
        Cycles from the first to before the second instant are compared [s since the start of the overlap].
    progress:
        Told the share that is done.
    cache_dir:
        Where enclosures are kept; ``None``: the user's cache folder.

    Raises
    ------
    SetupError
        As :func:`verifier.replay.verify`.
    """
    source, cell = open_placed(recording, cell)
    robot = build_robot(cell, source.robot, cache_dir)
    reading = Reading(source, robot.joints, point_names=cell.people.point_names)
    run = _Run(reading, cell, robot, settings or MonitoringSettings(), window_s)
    run.go(progress)
    return run.history()


class _Moment(NamedTuple):
    """What one cycle is about: the plan from the largest delay before ``t`` on, and its slices."""

    t: float
    plan: PlanResult
    slices: Block
    known: Known


class _Run:
    """One pass over a recording."""

    def __init__(
        self,
        reading: Reading,
        cell: Cell,
        robot: RobotModel,
        settings: MonitoringSettings,
        window_s: tuple[float, float],
    ) -> None:
        self._reading, self._cell, self._robot = reading, cell, robot
        self._window_s = window_s
        self._start, end = reading.overlap
        cycles = max(0, math.floor((end - self._start) / cell.cycle_s + 1e-9))
        if cycles == 0:
            raise SetupError(
                f"{reading.path}: {end - self._start:.3f} s of overlap is shorter than a cycle of "
                f"{cell.cycle_s} s"
            )
        self._judge = Judge(cell, robot, self._start, cycles, assume_nobody=False)
        self._sections = Sections(reading.path, cell, robot, self._judge.gate)
        self._pairs = _Pairs(self._judge, cell, robot, settings)
        self._t = cell.cycle_s * np.arange(cycles, dtype=np.float64)
        self._separation, self._required = np.full(cycles, np.nan), np.full(cycles, np.nan)
        self._worst: Instant | None = None
        self._default_error = False

    def go(self, progress: Callable[[float], None] | None) -> None:
        k, cycles, judge = 0, len(self._t), self._judge
        for window in self._reading.windows(WINDOW_S, LEAD_S, TAIL_S):
            section = self._sections.next(window)
            planner = self._planner(section)
            judge.arrivals.expect(window.people)
            self._default_error = self._default_error or lacks_errors(window.people)
            while k < cycles and (window.last or judge.instant(k) < window.end):
                self._look(k, section, planner)
                k += 1
                if progress is not None and k % 256 == 0:
                    progress(k / cycles)
        if progress is not None:
            progress(1.0)

    def history(self) -> SeparationHistory:
        return SeparationHistory(
            self._reading.path.name, self._robot.name, self._judge.profile_text,
            self._t, self._separation, self._required, self._worst,
            self._default_error,
        )  # fmt: skip

    def _planner(self, section: Section) -> ShortTermPlanner:
        """Make what plans from the largest delay before an instant to the same stop as `verify`."""
        plans = section.planner.settings
        return ShortTermPlanner(
            self._robot.limits, replace(plans, cycle_s=2.0 * plans.cycle_s + plans.delay[1])
        )

    def _look(self, k: int, section: Section, planner: ShortTermPlanner) -> None:
        t = self._judge.instant(k)
        self._judge.admit_until(t)
        if not self._window_s[0] <= self._t[k] + _ROUNDING_S < self._window_s[1]:
            return
        begin = t - self._cell.robot.tracking.delay_max_s
        plan = replace(section, planner=planner).plan(begin - planner.settings.cycle_s)
        if plan.outcome is not PlanOutcome.READY:
            return
        found = self._pairs.nearest(_Moment(t, plan, planner.slices, self._judge.known()))
        if found is None:
            return
        found = replace(found, t=float(self._t[k]))
        self._separation[k], self._required[k] = found.separation_m, found.required.distance_m
        if self._worst is None or found.room_m < self._worst.room_m:
            self._worst = found


class _Pairs:
    """Finds, for one cycle, the pair of link and person with the least room."""

    def __init__(self, judge: Judge, cell: Cell, robot: RobotModel, settings: MonitoringSettings) -> None:
        self._judge, self._check, self._robot = judge, judge.check, robot
        self._reach = robot.enclosure["reach"][0]
        self._n_links = int(robot.enclosure["n"][0])
        self._sweep = LinkOccupancy(robot)
        self._moving, self._there = new_link_sets(), new_link_sets()
        self._still: Block = new_slices()
        self._ledger = new_ledger()
        self._delay = cell.robot.tracking.delay_max_s
        profile = build_profile(cell)
        self._speed = settings.person_speed or Assumption(
            "v_h", float(profile.speed.max()), "m/s", f"largest of profile {profile.name}", Certainty.COMPUTED
        )
        self._intrusion = settings.intrusion or Assumption(
            "C", 0.0, "m", "hands are reported or their space is enclosed", Certainty.DEFAULT
        )

    def nearest(self, moment: _Moment) -> Instant | None:
        """Return the pair with the least room; ``None``: nothing moves, or nobody can be compared."""
        known = moment.known
        n = int(known.people["n"][0])
        if not known.reported or n == 0 or known.overflow:
            return None
        self._sweep.occupy(moment.slices, self._moving)
        links = list(self._moving_links(moment.slices))
        best: Instant | None = None
        for row in range(n):
            found = self._beside(row, moment, links)
            if found is None and links:
                return None
            if found is not None and (best is None or found.room_m < best.room_m):
                best = found
        return best

    def _moving_links(self, slices: Block) -> Iterator[int]:
        """Yield the links that do not rest throughout, as `verify` sees it."""
        rest = self._check.settings.standstill
        speed = self._speeds(slices)
        displaced = self._reach[: self._n_links] @ slices["q_error"][0]
        for link in range(self._n_links):
            if not (displaced[link] <= rest.error_m and (speed[:, link] <= rest.speed_m_s).all()):
                yield link

    def _speeds(self, slices: Block) -> Array:
        """Return the largest speed (slices, links) [m/s] of any point of each link on each slice."""
        n = int(slices["n"][0])
        speeds: Array = self._moving["speed_max"][0, : n * self._n_links].reshape(n, self._n_links)
        return speeds

    def _beside(self, row: int, moment: _Moment, links: list[int]) -> Instant | None:
        """Return the link with the least room beside one row of the people block."""
        people, slices = moment.known.people.copy(), moment.slices[0]
        seen = (int(people["present"][0, row]) >> np.arange(MAX_POINTS)) & 1 == 1
        if not seen.any():
            return None
        sighted = float(people["t_obs"][0, row, seen].max())
        error = float(people["e_p"][0, row, seen].max())
        earliest = sighted - float(people["clock_error"][0])
        people["e_p"][0, row, seen] = 0.0
        people["clock_error"] = people["stamp_error"] = 0.0
        self._stand(slices, sighted)
        self._sweep.occupy(self._still, self._there)
        for occupancy in self._check.occupancies:
            occupancy.begin(people, self._still)
        scene = Scene(self._still, self._there, people, self._check.occupancies)
        least = self._gap(scene, links, row)
        if not math.isfinite(least):
            return None
        motion = _Motion(moment.slices[0], self._speeds(moment.slices), self._delay)
        lengths = self._reach[: self._n_links] @ slices["q_error"] + motion.path_lengths
        best, nearest, room = -1, math.nan, math.inf
        for link in sorted(links, key=lambda each: -lengths[each]):
            if least - lengths[link] >= room:
                break  # no other link needs more, and none is nearer
            gap = self._gap(scene, [link], row)
            if gap - lengths[link] < room:
                best, nearest, room = link, gap, gap - float(lengths[link])
        if best < 0:
            return None
        person = self._judge.gate.person_ids[int(people["person"][0, row])]
        required = self._required(moment, motion, best, _Sighting(earliest, error))
        return Instant(moment.t, self._robot.links[best], person, nearest, required)

    def _stand(self, slices: np.void, t: float) -> None:
        """Let the robot stand at ``t`` where the plan begins."""
        still = self._still[0]
        still["n"], still["n_joints"], still["t"][:2] = 1, slices["n_joints"], t
        still["q"][:2] = slices["q"][0]

    def _gap(self, scene: Scene, links: list[int], row: int) -> float:
        """Return how far the nearest of some links is from a person [m]; infinite: nobody knows."""
        book = self._ledger[0]
        book["n_slices"], book["n_links"], book["n_people"] = 1, self._n_links, scene.people["n"][0]
        book["open"][0] = 0
        book["open"][0, links, row] = self._check.settings.parts
        gap = math.inf
        for criterion in self._check.criteria:
            gap = criterion.check(scene, self._ledger).gap_m
        return float(gap)

    def _required(self, moment: _Moment, motion: _Motion, link: int, sighting: _Sighting) -> RequiredDistance:
        """Return S_p of a link and a person."""
        plan, rest = moment.plan, motion.rest
        begin = min(sighting.earliest, motion.begin)
        stop_begin = min(plan.t_stop_begin + self._delay, rest)
        since = _T_R.format(moment.t - begin)
        times = Times(
            Assumption("T_r", stop_begin - begin, "s", since, Certainty.COMPUTED),
            Assumption("T_s", rest - stop_begin, "s", "this software's stop", Certainty.COMPUTED),
        )
        until = math.nextafter(rest, math.inf) + 1e-9  # sums of times may be a rounding beyond it
        person = SpeedBound.constant(float(self._speed.value), begin, until)
        lengths = varying_lengths(begin, times, person, motion.bound(link, begin, until))
        displaced = float(self._reach[link] @ moment.slices["q_error"][0])
        return protective_separation(
            replace(lengths, given=(*lengths.given, self._speed)),
            Allowances(
                self._intrusion,
                Assumption(
                    "Z_d", sighting.error_m, "m", "largest position error of the person", Certainty.COMPUTED
                ),
                Assumption("Z_r", displaced, "m", "tracking errors at this link", Certainty.COMPUTED),
            ),
        )


class _Sighting(NamedTuple):
    """When a person was seen at the earliest [s], and how far their points may be from there [m]."""

    earliest: float
    error_m: float


class _Motion:
    """How fast each link can be when, at the largest delay."""

    def __init__(self, slices: np.void, speeds: Array, delay: float) -> None:
        self._t: Array = slices["t"][: len(speeds) + 1] + delay
        self._speeds = speeds
        self.begin, self.rest = float(self._t[0]), float(self._t[-1])

    @property
    def path_lengths(self) -> Array:
        """Largest length of the path of any point of each link (links,) [m]."""
        lengths: Array = np.diff(self._t) @ self._speeds
        return lengths

    def bound(self, link: int, begin: float, until: float) -> SpeedBound:
        """Return the speed of a link from ``begin`` on; until the plan begins its place is known."""
        t, speeds = np.append(self._t, until), np.append(self._speeds[:, link], 0.0)
        if begin < t[0]:
            t, speeds = np.append(begin, t), np.append(0.0, speeds)
        return SpeedBound(t, speeds)


_T_R = "{:.3f} s since the person was seen, two periods of the cycle, the largest delay"
