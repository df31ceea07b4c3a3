"""Inverse answers: how fast, how late, how near may it be for every cycle to be verified? (docs/limits.md)

Each answer is searched for with the verifier itself in the loop (:mod:`verifier.bracket`,
:mod:`verifier.trial_runs`), so that what is answered has been verified, cycle by cycle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.barriers import AWAY_M, Barrier, Boundary, with_fence, with_scanner
from verifier.bracket import Bracket, Scale, Search
from verifier.cell import Cell
from verifier.judge import Checks, build_checks
from verifier.opened import open_placed
from verifier.program_segments import Stretch, at_borders, from_rest_to_rest
from verifier.protective_separation import SeparationHistory, separation_history
from verifier.recordings import Reading, Recording
from verifier.reports.limits import LimitsReport, Line, Segment
from verifier.setup import build_profile, build_robot, content_hash
from verifier.stated import measured_tracking, stated_assumptions, waivers
from verifier.trial_runs import Asked, Nobody, TrialRuns

ANSWERS = ("speed", "latency", "line", "separation")
DEFAULT_DETECTION_S = 0.1
"""Used, and shown as *default*, where nobody states how long a scanner takes to report somebody."""
_SPEED_STEP, _LATENCY_STEP_S, _LINE_STEP_M = 1.0 / 64.0, 0.001, 0.01
_NEAREST_M = 0.1


@dataclass(frozen=True, slots=True)
class LimitsSettings:
    """What is asked, and how far is tried.

    Attributes
    ----------
    answers:
        Some of :data:`ANSWERS`.
    window_s:
        First and last instant that is looked at [s since the start of the overlap].
    borders_s:
        Where segments of the program begin [s]; empty: in the middle of each rest of the arm.
    fastest:
        Largest path speed that is tried; 1: as recorded.
    latency_bound_s:
        Largest latency that is tried [s].
    angles_deg:
        Direction from the base to each line, about z from the world's x axis [deg]; empty: a circle around
        the base.
    farthest_m:
        Largest distance of circle or line that is tried [m].
    barrier:
        What keeps people beyond circle or line.
    detection_time_s:
        A scanner reports at the latest after this who has come over the line [s]; ``None``: 0.1 s, shown as
        default.

    Raises
    ------
    SetupError
        A number is not usable, or an answer is not known.
    """

    answers: tuple[str, ...] = ANSWERS
    window_s: tuple[float, float] = (0.0, math.inf)
    borders_s: tuple[float, ...] = ()
    fastest: float = 2.0
    latency_bound_s: float = 0.5
    angles_deg: tuple[float, ...] = ()
    farthest_m: float = 5.0
    barrier: Barrier = Barrier.SCANNER
    detection_time_s: float | None = None

    def __post_init__(self) -> None:
        unknown = [each for each in self.answers if each not in ANSWERS]
        if unknown or not self.answers:
            raise SetupError(f"--only {', '.join(unknown) or '(none)'}: known are {', '.join(ANSWERS)}")
        begin, end = self.window_s
        if not 0.0 <= begin < end:
            raise SetupError(
                f"--from {begin:g} --to {end:g}: should be 0 or more, and the end after the begin"
            )
        for option, value, least, most in (
            ("--fastest", self.fastest, _SPEED_STEP, 10.0),
            ("--latency-bound", self.latency_bound_s, _LATENCY_STEP_S, 10.0),
            ("--farthest", self.farthest_m, _NEAREST_M + _LINE_STEP_M, 0.5 * AWAY_M),
            ("--detection-time", self.detection_time_s or 0.0, 0.0, 10.0),
        ):
            if not least <= value <= most:
                raise SetupError(f"{option} {value:g}: should be {least:g} to {most:g}")
        for angle in self.angles_deg:
            if not -360.0 <= angle <= 360.0:
                raise SetupError(f"--line {angle:g}: should be an angle in degrees, -360 to 360")


def find_limits(
    recording: Recording | str | Path,
    cell: Cell,
    settings: LimitsSettings | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    cache_dir: Path | None = None,
) -> LimitsReport:
    """Return the largest path speeds, the largest latency and the nearest lines at which all is verified.

    Raises
    ------
    SetupError
        Recording, cell, robot or settings cannot be used; one line that says what is wrong.
    """
    settings = settings or LimitsSettings()
    source, cell = open_placed(recording, cell)
    robot = build_robot(cell, source.robot, cache_dir)
    return _Answers(source, cell, robot, settings, progress or _ignore).report()


def _ignore(_share: float) -> None:
    """Nobody wants to know."""


def _detection(stated_s: float | None) -> Assumption:
    """Return how long somebody who has come over the line may go unreported."""
    name = "line.detection_time"
    if stated_s is None:
        return Assumption(name, DEFAULT_DETECTION_S, "s", "nobody has stated it", Certainty.DEFAULT)
    return Assumption(name, stated_s, "s", "stated by the user", Certainty.DECLARED)


class _Answers:
    """Everything that is asked about one recording."""

    def __init__(
        self,
        recording: Recording,
        cell: Cell,
        robot: RobotModel,
        settings: LimitsSettings,
        progress: Callable[[float], None],
    ) -> None:
        self._recording, self._cell, self._robot, self._settings = recording, cell, robot, settings
        self._waived = waivers(cell, robot, assume_nobody=False).texts
        self._checks = build_checks(cell, robot, assume_nobody=False)
        asked = {"speed", "latency", "separation"} & set(settings.answers)
        self._reading = Reading(
            recording,
            robot.joints,
            people=bool(asked) or recording.has_people,  # so that all answers count time from one instant
            point_names=cell.people.point_names,
        )
        self._runs = TrialRuns(self._reading, cell, robot)
        self._detection = _detection(settings.detection_time_s)
        self._done, self._most, self._progress = 0, 1, progress
        self._stated: list[Assumption] = []
        self._default_error = False

    def report(self) -> LimitsReport:
        """Answer what is asked."""
        asked, settings, cell = self._settings.answers, self._settings, self._cell
        speeds = Scale(
            0.0, settings.fastest, _SPEED_STEP, max(1, round(0.25 * settings.fastest / _SPEED_STEP))
        )
        latency = self._scale(0.0, settings.latency_bound_s, _LATENCY_STEP_S)
        lines = self._scale(settings.farthest_m, _NEAREST_M, _LINE_STEP_M)
        angles: tuple[float | None, ...] = settings.angles_deg or (None,)
        self._most = (
            ("speed" in asked) * speeds.most_trials
            + ("latency" in asked) * latency.most_trials
            + ("line" in asked) * len(angles) * lines.most_trials
            + ("separation" in asked)
        )
        profile = build_profile(cell)
        found = LimitsReport(
            recording=self._recording.path.name,
            robot=self._robot.name,
            stop_model=cell.stop.model,
            profile=f"{profile.name} ({profile.speed.max():g} m/s)",
            cell_hash=cell.content_hash(self._robot.content_hash, content_hash(self._checks[0], cell)),
            version=version("stopproof"),
            waived=self._waived,
            segments=self._segments(speeds) if "speed" in asked else None,
            latency=self._latency(latency) if "latency" in asked else None,
            lines=tuple(self._line(lines, each) for each in angles) if "line" in asked else None,
            separation=self._separation() if "separation" in asked else None,
            assumptions=tuple(self._assumptions()),
            window_s=self._looked_at(),
        )
        self._progress(1.0)
        return found

    @staticmethod
    def _scale(easiest: float, hardest: float, step: float) -> Scale:
        """Return a scale that is gone through in a quarter of its length at first."""
        return Scale(easiest, hardest, step, max(1, math.ceil(abs(hardest - easiest) / step / 4.0)))

    def _segments(self, scale: Scale) -> tuple[Segment, ...]:
        """Search the largest path speed of all segments at once."""
        runs = self._runs
        whole, borders = self._window(runs), self._settings.borders_s
        if borders:
            stretches = at_borders(borders, runs.cycle_s, whole)
        else:
            stretches = from_rest_to_rest(runs.rests(self._cell), runs.cycle_s, whole)
        searches = [Search(scale) for _ in stretches]
        while any(search.next is not None for search in searches):
            live = [
                (each, search)
                for each, search in zip(stretches, searches, strict=True)
                if search.next is not None
            ]
            asked = [Asked(stretch, search.next or 0.0) for stretch, search in live]
            outcomes = runs.run(self._cell, asked, checks=self._checks)
            for (_, search), outcome in zip(live, outcomes, strict=True):
                search.tell(outcome.verified, outcome.failure)
            self._step()
        return tuple(
            Segment(each.first * runs.cycle_s, each.end * runs.cycle_s, search.bracket)
            for each, search in zip(stretches, searches, strict=True)
        )

    def _latency(self, scale: Scale) -> Bracket:
        """Search the largest ``people.latency_s``."""
        runs = self._runs
        whole = self._window(runs)

        def with_latency(value: float) -> tuple[Cell, Checks | None]:
            people = self._cell.people.model_copy(update={"latency_s": value})
            return self._cell.model_copy(update={"people": people}), self._checks

        return self._searched(runs, whole, scale, with_latency)

    def _line(self, scale: Scale, angle_deg: float | None) -> Line:
        """Search the nearest circle, or line in one direction, beyond which people may be."""
        motion = Reading(self._recording, self._robot.joints, people=False)
        runs = TrialRuns(Nobody(motion, self._reading.overlap, self._cell), self._cell, self._robot)

        def with_line(value: float) -> tuple[Cell, Checks | None]:
            boundary = Boundary(self._base, value, angle_deg)
            if self._settings.barrier is Barrier.FENCE:
                return with_fence(self._cell, boundary), None
            return with_scanner(self._cell, boundary, float(self._detection.value)), None

        bracket = self._searched(runs, self._window(runs), scale, with_line)
        return Line(angle_deg, self._base[:2], str(self._settings.barrier), bracket)

    def _searched(
        self,
        runs: TrialRuns,
        whole: Stretch,
        scale: Scale,
        changed: Callable[[float], tuple[Cell, Checks | None]],
    ) -> Bracket:
        """Search along a scale, judging the whole window with what is changed for each value."""
        search = Search(scale)
        while (value := search.next) is not None:
            cell, checks = changed(value)
            (outcome,) = runs.run(cell, [Asked(whole, 1.0)], checks)
            search.tell(outcome.verified, outcome.failure)
            self._step()
        return search.bracket

    def _separation(self) -> SeparationHistory:
        """Hold S_p against the separation, and list what it rests on besides."""
        window = self._settings.window_s
        found = separation_history(self._recording, self._cell, window_s=window)
        self._default_error = self._default_error or found.default_error
        if found.worst is not None:
            terms = found.worst.required.terms
            self._stated += [
                replace(item, name=f"S_p.{item.name}") for item in terms if item.name in ("C", "v_h")
            ]
        self._step()
        return found

    @property
    def _base(self) -> tuple[float, float, float]:
        return self._cell.robot.mount.xyz_m

    def _window(self, runs: TrialRuns) -> Stretch:
        """Return the cycles that are looked at."""
        begin, end = self._settings.window_s
        first = math.ceil(begin / runs.cycle_s - 1e-9)
        behind = runs.cycles if math.isinf(end) else min(runs.cycles, math.ceil(end / runs.cycle_s - 1e-9))
        if not first < behind:
            raise SetupError(
                f"--from {begin:g} --to {end:g}: no cycle lies there; the recording has "
                f"{runs.cycles * runs.cycle_s:g} s"
            )
        return Stretch(first, behind)

    def _looked_at(self) -> tuple[float, float | None]:
        begin, end = self._settings.window_s
        return begin, None if math.isinf(end) else end

    def _step(self) -> None:
        self._done += 1
        self._progress(min(1.0, self._done / self._most))

    def _assumptions(self) -> Iterator[Assumption]:
        yield from stated_assumptions(
            self._cell, self._checks[0], default_error=self._default_error or self._runs.default_error
        )
        yield from self._recording.assumptions
        if self._runs.residual is not None:
            yield from measured_tracking(self._robot, self._runs.residual)
        yield from self._stated
        if "line" in self._settings.answers:
            yield from self._about_the_line()

    def _about_the_line(self) -> Iterator[Assumption]:
        """List what the answer about a circle or line rests on, whatever the recording says of people."""
        assumed = [
            ("people_inside", "nobody, as each report says that is complete", "A5"),
            ("above_and_below", "nobody comes from there, nor from behind of a line", "assumed"),
        ]
        if self._settings.barrier is Barrier.FENCE:
            assumed.append(("fence", "nobody reaches through or over it", "assumed; see ISO 13857"))
        else:
            yield self._detection
        for name, value, source in assumed:
            yield Assumption(f"line.{name}", value, "", source, Certainty.ASSUMED)
