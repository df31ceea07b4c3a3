"""From an arm, a cell and perhaps a recording to a stop report."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from failsafe.axis_stop import Start, motion_during, stop_axis
from failsafe.bracket import Bracket, Effort
from failsafe.brake_stop import BrakeStop
from failsafe.stopping import (
    POINT_SPEED,
    STOP_WAY,
    ArmSearch,
    JerkLimitedStop,
    PathConsistentStop,
)
from robots.assumption import Assumption
from robots.limits import Array
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.inputs import input_files
from verifier.judge import build_checks
from verifier.opened import open_placed
from verifier.protective_separation import SeparationHistory, separation_history
from verifier.recordings import Reading, Recording
from verifier.setup import build_robot, content_hash
from verifier.stated import measured_tracking, stated_assumptions, stop_assumptions, waivers
from verifier.stop_report.distances import check_device, distances_of, reaction_of
from verifier.stop_report.grids import grid_of, no_extension
from verifier.stop_report.loads import loads_of
from verifier.stop_report.own_stop import OwnStop, own_stop
from verifier.stop_report.poses import pose_of, poses_to_measure
from verifier.stop_report.recorded import joint_units, stops_over
from verifier.stop_report.report import (
    ANY_MOTION,
    BRAKES,
    JOINT_SPACE,
    MEASURED,
    PATH_CONSISTENT,
    Grid,
    Missing,
    Pose,
    Profile,
    RecordedStops,
    StopCase,
    StopReport,
    TorqueCheck,
)
from verifier.stop_report.settings import GAP, StopReportSettings, Work

_NO_RECORDING = Missing(
    "stops on the path, worst over a motion", "how long they take depends on the path", "--recording R"
)
_POINTS = 200
"""Instants of a profile."""


def stop_report(
    cell: Cell,
    recording: Recording | str | Path | None = None,
    settings: StopReportSettings | None = None,
    work: Work | None = None,
    cache_dir: Path | None = None,
) -> StopReport:
    """Return the worst-case stops of the arm of a cell, and of a recording if there is one.

    Parameters
    ----------
    cell, recording, settings:
        Which arm, whose motion, and the numbers that neither has.
    work:
        Clock, whether to end early, and who is told how far it is; ``None``: nobody, and to the end.
    cache_dir:
        Where enclosures are kept; ``None``: the user's cache folder.

    Raises
    ------
    SetupError
        Recording, cell, robot or settings cannot be used; one line that says what is wrong.
    """
    source = None
    if recording is not None:
        source, cell = open_placed(recording, cell)
    robot = build_robot(cell, None if source is None else source.robot, cache_dir)
    nobody = Work(time.perf_counter, lambda: False, lambda _share: None)
    return _Maker(cell, source, robot, settings or StopReportSettings(), work or nobody, cache_dir).report()


class _Ended(Exception):  # noqa: N818 - it is no error: somebody has asked for what there is
    """Somebody wants what there is by now."""


class _Maker:
    """Everything that one report needs."""

    def __init__(
        self,
        cell: Cell,
        recording: Recording | None,
        robot: RobotModel,
        settings: StopReportSettings,
        work: Work,
        cache_dir: Path | None,
    ) -> None:
        self._cell, self._recording, self._robot = cell, recording, robot
        self._settings, self._work, self._cache = settings, work, cache_dir
        self._begun = work.clock()
        check_device(settings)
        self._inputs = input_files(None if recording is None else recording.path, cell)
        self._check = build_checks(cell, robot, assume_nobody=False)[0]
        effort = Effort(gap=GAP, clock=work.clock, deadline_s=settings.deadline_s, should_end=work.should_end)
        self._arm = ArmSearch(robot, effort)
        self._loads = loads_of(cell, robot, settings)
        self._own = own_stop(cell, robot, settings.speed)
        self._missing: list[Missing] = []
        self._stated: list[Assumption] = []

    def report(self) -> StopReport:
        """Make everything, the most important first."""
        work, robot = self._work, self._robot
        compile_search(robot, work)
        free = JerkLimitedStop(robot.limits, self._settings.speed, Start.ANY)
        cases = [self._case(JOINT_SPACE, free.worst(self._arm)), self._on_the_path()]
        work.progress(0.2)
        recorded = self._over_recording()
        work.progress(0.3)
        measured = self._measured()
        if measured is not None:
            cases.append(self._case(MEASURED, measured.at(1.0).worst(self._arm)))
        if recorded is not None and recorded.case is not None:
            cases.append(recorded.case)
        grids = self._grids(measured)
        cases += [
            self._case(BRAKES, brackets, guessed=each.guessed)
            for each in grids
            if each.stop == BRAKES and (brackets := _at_full(each))
        ]
        work.progress(0.7)
        separation = self._separation()
        work.progress(0.95)
        answer = self._answer(cases)
        reaction = reaction_of(self._cell)
        torques = self._torques()
        found = StopReport(
            robot=robot.name,
            tool=robot.tool,
            joints=robot.joints,
            units=joint_units(robot),
            recording=None if self._recording is None else self._recording.path.name,
            cell_hash=self._cell.content_hash(robot.content_hash, content_hash(self._check, self._cell)),
            version=version("stopproof"),
            waived=waivers(self._cell, robot, assume_nobody=False).texts,
            speed=self._settings.speed,
            speeds=free.speed,
            answer_speeds=_speeds_of(answer, free, measured),
            reaction=reaction,
            answer=answer,
            cases=tuple(cases),
            grids=tuple(grids),
            distances=distances_of(_first(answer, cases), reaction, self._settings),
            recorded=recorded,
            separation=separation,
            profile=self._profile(answer, recorded, free, measured),
            torques=torques,
            poses=self._poses(answer),
            to_measure=poses_to_measure(grids, None if recorded is None else recorded.case),
            missing=tuple(self._missing),
            assumptions=tuple(self._assumptions()),
            inputs=self._inputs,
            interrupted=work.should_end(),
            seconds=work.clock() - self._begun,
        )
        work.progress(1.0)
        return found

    @staticmethod
    def _case(stop: str, brackets: tuple[Bracket, ...], *, guessed: bool = False) -> StopCase:
        return StopCase(stop, ANY_MOTION, brackets, (None,) * len(brackets), guessed)

    def _on_the_path(self) -> StopCase:
        stop = PathConsistentStop(self._robot.limits, self._settings.speed)
        return self._case(PATH_CONSISTENT, stop.worst(self._arm))

    def _measured(self) -> OwnStop | None:
        """Return the robot's own stop, and note where it is known at lower speeds only."""
        own = self._own
        if own is not None and own.limited:
            self._missing.append(
                Missing(
                    "the robot's own stop at full speed", "it was measured, and is given, at lower speeds",
                    "measure faster stops, then `stopproof stops --model`",
                )
            )  # fmt: skip
        return own

    def _over_recording(self) -> RecordedStops | None:
        source = self._recording
        if source is None:
            self._missing.append(_NO_RECORDING)
            return None
        reading = Reading(
            source, self._robot.joints, people=source.has_people, point_names=self._cell.people.point_names
        )
        progress = self._work.progress
        found = stops_over(
            reading, self._cell, self._arm, self._work.should_end, lambda share: progress(0.2 + 0.1 * share)
        )
        if found.case is None:
            self._missing.append(Missing("stops of this recording", "no cycle of it has a stop"))
        if found.residual is not None:
            self._stated += measured_tracking(self._robot, found.residual)
        return found

    def _separation(self) -> SeparationHistory | None:
        """Hold S_p against the separation, if there is somebody."""
        source = self._recording
        if source is None or not source.has_people:
            why = "no recording of people"
            self._missing.append(Missing("S_p against the separation", why, "--recording R"))
            return None
        progress, should_end = self._work.progress, self._work.should_end

        def told(share: float) -> None:
            if should_end():
                raise _Ended
            progress(0.7 + 0.25 * share)

        try:
            told(0.0)
            found = separation_history(source, self._cell, progress=told, cache_dir=self._cache)
        except _Ended:
            self._missing.append(
                Missing("S_p against the separation", "ended before all cycles were compared")
            )
            return None
        if found.worst is not None:
            terms = found.worst.required.terms
            self._stated += [
                replace(item, name=f"S_p.{item.name}") for item in terms if item.name in ("C", "v_h")
            ]
        return found

    def _grids(self, measured: OwnStop | None) -> list[Grid]:
        """Make the grids; an arm whose first joint slides has no extension."""
        robot, share = self._robot, self._settings.speed
        why = no_extension(robot)
        if why:
            self._missing.append(Missing("grids of extension", why))
        limits = robot.limits
        grid = grid_of(
            self._arm, lambda speed, _load: JerkLimitedStop(limits, share * speed), load_matters=False
        )
        grids = [Grid(JOINT_SPACE, (1, 2), grid, share * limits.velocity, None)]
        if measured is not None:
            own = grid_of(self._arm, lambda speed, _load: measured.at(speed), load_matters=False)
            grids.append(Grid(MEASURED, (), own, measured.at(1.0).speed, None))
        self._work.progress(0.5)
        grids += self._category_0()
        return grids

    def _category_0(self) -> list[Grid]:
        loads = self._loads
        if isinstance(loads, Missing):
            self._missing.append(loads)
            return []
        self._missing += loads.missing
        self._stated += loads.assumptions
        if loads.brakes is None:
            why = "nobody has stated brakes, and there are no torque limits to guess them from"
            self._missing.append(Missing("category 0", why))
            return []
        if self._work.should_end():
            self._missing.append(Missing("category 0", "ended before it was begun"))
            return []
        brakes, velocity = loads.brakes, self._settings.speed * self._robot.limits.velocity
        seed = self._settings.seed

        def stop_at(speed: float, load: float) -> BrakeStop:
            self._arm.interrupted |= self._work.should_end()
            return BrakeStop(loads.at(load), brakes, speed * velocity, seed=seed)

        resting = np.zeros(len(velocity))
        stop_at(1.0, 1.0).simulate(self._arm, resting, resting)  # compiles outside of the time of a search
        grid = grid_of(self._arm, stop_at, load_matters=True)
        return [Grid(BRAKES, (0,), grid, velocity, loads.payload_kg, loads.guessed)]

    def _torques(self) -> tuple[TorqueCheck, ...]:
        """Hold the torque limits against the deceleration of the model, at each load."""
        loads, robot = self._loads, self._robot
        if isinstance(loads, Missing) or self._work.should_end():
            return ()
        if not np.isfinite(robot.limits.torque).any():
            self._missing.append(Missing("torques of the stop", "no torque limit is known"))
            return ()
        speed, found = self._settings.speed * robot.limits.velocity, []
        for share in (0.33, 0.66, 1.0):
            dynamics = loads.at(share)
            seed, hardest = self._settings.seed, robot.limits.acceleration
            found.append(
                TorqueCheck(
                    share * loads.payload_kg,
                    dynamics.worst_allowed_deceleration(speed, hardest, seed),
                    dynamics.torques(speed, hardest, seed),
                )
            )
        return tuple(found)

    def _answer(self, cases: list[StopCase]) -> StopCase:
        """Choose what the first page is about: the stop that the cell names, where it is bounded."""
        for case in cases:
            if case.stop == MEASURED and case.over == ANY_MOTION:
                return case
        for case in cases:
            if case.over != ANY_MOTION:
                return case
        return cases[0]

    def _profile(
        self,
        answer: StopCase,
        recorded: RecordedStops | None,
        free: JerkLimitedStop,
        measured: OwnStop | None,
    ) -> Profile:
        """Return the worst stop over time."""
        if answer.over != ANY_MOTION and recorded is not None and recorded.profile is not None:
            return recorded.profile
        n = len(self._robot.joints)
        if answer.stop == MEASURED and measured is not None:
            own = measured.at(1.0)
            t = np.linspace(0.0, max(own.time(j).value for j in range(n)), _POINTS)
            way, speed = (np.array([of(j, t) for j in range(n)]).T for of in (own.way, own.fastest))
            return Profile(MEASURED, ANY_MOTION, t, way, speed)
        worst = [free.time(j) for j in range(n)]
        t = np.linspace(0.0, max(each.value for each in worst), _POINTS)
        moved = [
            motion_during(
                stop_axis(each.velocity, each.acceleration, free.axis(j)), each.velocity, each.acceleration, t
            )
            for j, each in enumerate(worst)
        ]
        ways, speeds = (np.array(each).T for each in zip(*moved, strict=True))
        return Profile(JOINT_SPACE, ANY_MOTION, t, np.abs(ways), np.abs(speeds))

    def _poses(self, answer: StopCase) -> tuple[Pose, ...]:
        titles = {STOP_WAY: "begin of the longest way of a point", POINT_SPEED: "fastest point"}
        found = []
        for quantity, title in titles.items():
            bracket = answer.largest(quantity)
            if bracket is not None and bracket.witness is not None:
                found.append(pose_of(self._arm, title, answer.stop, bracket.witness))
        return tuple(found)

    def _assumptions(self) -> list[Assumption]:
        robot = self._robot
        if self._recording is not None and self._recording.has_people:
            found = list(stated_assumptions(self._cell, self._check))
        else:
            of_people = [item for item in self._cell.assumptions() if not _of_people(item)]
            found = [*of_people, *stop_assumptions(self._cell, robot), *robot.assumptions]
        if self._recording is not None:
            found += self._recording.assumptions
        found += self._stated
        return list({item.name: item for item in found}.values())


def compile_search(robot: RobotModel, work: Work) -> None:
    """Search once at next to no cost: what it takes to compile is not taken from the time of a search."""
    effort = Effort(gap=GAP, clock=work.clock, deadline_s=1e-9, should_end=work.should_end)
    speed = np.zeros(len(robot.joints))
    speed[0] = 1.0
    ArmSearch(robot, effort).fastest(speed)


def _speeds_of(answer: StopCase, free: JerkLimitedStop, measured: OwnStop | None) -> Array:
    """Return the joint speeds (n,) up to which the answer holds."""
    if answer.stop == MEASURED and measured is not None:
        return measured.intended
    return free.speed


def _first(answer: StopCase, cases: list[StopCase]) -> list[StopCase]:
    return [answer, *(case for case in cases if case is not answer)]


def _of_people(item: Assumption) -> bool:
    """Whether an assumption is about people, who do not matter without a recording of them."""
    people = item.name.startswith(("cell.people.", "cell.criteria.", "cell.check.", "cell.workspace."))
    return people and item.name != "cell.people.latency_s"


def _at_full(grid: Grid) -> tuple[Bracket, ...]:
    """Return the brackets at full load, speed and extension; none where the work was ended before."""
    for cell in grid.grid.cells:
        if cell.load == cell.speed == cell.extension == 1.0:
            return cell.brackets
    return ()
