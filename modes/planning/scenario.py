"""``stopproof scenario proactive``: the paper's trials in a digital twin, also under the verifier.

The only file of the mode that uses the verifier beyond its protocol (docs/method.md, section 7).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import AHEAD, RATE_HZ
from modes.forecasting.history import History
from modes.forecasting.network import DEFAULT, forecast_points, load_forecaster
from modes.forecasting.skeleton import joints_of_points
from modes.planning.foresight import Forecasts, Foresight, Present
from modes.planning.motion import motion_along
from modes.planning.outcomes import PROPOSERS, Errors, Run, Setting, Witness
from modes.planning.potential_field import Fixtures
from modes.planning.replan_settings import ReplanSettings, Target
from modes.planning.replanning import Decision, Doing, ProactiveAvoidance
from modes.planning.report import ProactiveReport
from modes.planning.trials import END_S, FLOOR_Z_M, PICK, PLACE, POST, Trial, trials
from modes.tool_frame import ToolFrame
from modes.twin.camera import Camera, CameraSettings
from modes.twin.cell import LINKS, CellTwin
from occupancy.body import Profile, load_profile
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.command import State
from verifier.proposal import NewTrajectory, Proposal, SceneView, SeenPerson
from verifier.scenario import ScenarioReport
from verifier.setup import build_robot
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]
Progress = Callable[[float], None]

CELL: dict[str, Any] = {
    "cycle_s": 0.01,
    "robot": {
        "name": "ur16e", "bare_flange": True, "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.002, "velocity_error_rad_s": 0.02},
    },
    "people": {"latency_s": 0.05, "repeated_points": "measured"},
    "workspace": {
        "floor_z_m": FLOOR_Z_M,
        "fixtures": {
            "post": {"kind": "capsule", "a_m": list(POST[0]), "b_m": list(POST[1]), "radius_m": POST[2]}
        },
    },
}  # fmt: skip
SETTINGS = tuple(Setting(supervised, proposer) for supervised in (False, True) for proposer in PROPOSERS)
FORECASTERS = ("hold", "constant_velocity", DEFAULT)
_PER_DECISION = 10
"""The mode decides every so many cycles: the paper's 10 Hz."""
_FAST_M_S = 0.01
"""A link that is faster moves."""
_AHEAD_S = 0.02
"""A command is for two cycles later."""


def scenario(progress: Progress) -> ScenarioReport:
    """Run the paper's 50 trials in all settings; ``progress`` is told the share that is done."""
    return run_scenario(trials(), progress)


def run_scenario(those: Sequence[Trial], progress: Progress) -> ProactiveReport:
    """Run some trials in all settings.

    Raises
    ------
    SetupError
        There is none.
    """
    if not those:
        raise SetupError("proactive scenario: there is no trial")
    witness = Witness(robot_of_cell(), profile_of_people(), fixtures())
    clear = frozenset(each.number for each in those if witness.has_clear_way(each))
    progress(0.05)
    runs: list[Run] = []
    for k, setting in enumerate(SETTINGS):
        for each in those:
            runs.append(run_trial(each, setting, witness))
            progress(0.05 + 0.85 * len(runs) / (len(SETTINGS) * len(those)))
        assert len(runs) == (k + 1) * len(those)
    errors = forecast_errors(those)
    progress(1.0)
    return ProactiveReport(
        trials=tuple(those),
        runs=tuple(runs),
        with_clear_way=clear,
        clearance_m=ReplanSettings().clearance_m,
        forecaster=DEFAULT,
        errors=errors,
        alone_s=_alone_s(),
    )


def fixtures() -> Fixtures:
    """Return the post behind the arm."""
    return Fixtures(np.array(POST[:1]), np.array(POST[1:2]), np.array(POST[2:]))


@cache
def _cell() -> Cell:
    return Cell.from_table(CELL)


@cache
def robot_of_cell() -> RobotModel:
    """Return the arm."""
    return build_robot(_cell())


@cache
def profile_of_people() -> Profile:
    """Return the profile that people have."""
    return load_profile("iso")


def _straight() -> NewTrajectory:
    return NewTrajectory(motion_along(np.array([PICK, PLACE]), robot_of_cell().limits))


def _alone_s() -> float:
    """Return how long the straight way takes [s]."""
    return _straight().trajectory.s_end


def foresight_of(setting: Setting) -> Foresight:
    """Return what the mode is told of people."""
    return Forecasts(load_forecaster()) if setting.proposer == "forecast" else Present()


def run_trial(trial: Trial, setting: Setting, witness: Witness, foresight: Foresight | None = None) -> Run:
    """Run a trial until the arm has arrived, or the time is over."""
    loop = _Loop(trial, setting, witness, foresight)
    while loop.goes_on:
        loop.step()
    return loop.run


@dataclass(slots=True)
class _Known:
    """The newest report that has arrived."""

    report: RawMeasurement | None = None

    def take_in(self, reports: Sequence[RawMeasurement]) -> None:
        for each in reports:
            if self.report is None or each.stamp > self.report.stamp:
                self.report = each

    def shown(self, view: SceneView) -> SceneView:
        """Return a view with the people of the newest report, which the supervisor was not told of."""
        if self.report is None:
            return view
        people = []
        for who in self.report.people:
            seen = np.isfinite(who.xyz).all(axis=1)
            t = np.where(seen, self.report.stamp, np.nan)
            people.append(SeenPerson(who.id, t, np.asarray(who.xyz), np.asarray(who.error_m)))
        return replace(view, people=tuple(people))


class _Loop:
    """Camera, mode, supervisor and twin, cycle by cycle."""

    def __init__(self, trial: Trial, setting: Setting, witness: Witness, foresight: Foresight | None) -> None:
        robot, q = robot_of_cell(), np.array(PICK)
        self.run = Run(trial.number, setting)
        self._trial, self._witness = trial, witness
        self._camera = Camera([trial.person], CameraSettings(seed=trial.number), trial.hidden)
        self._supervisor = Supervisor.from_cell(_cell(), q)
        self._twin = CellTwin(robot, q, 1, profile_of_people())
        self._frame, self._known, self._cycle = ToolFrame(robot), _Known(), 0
        self._way: NewTrajectory | None = None
        self._mode: ProactiveAvoidance | None = None
        self._moved = False
        if setting.proposer == "fixed":
            self._propose(_straight())
        else:
            told = foresight_of(setting) if foresight is None else foresight
            self._mode = ProactiveAvoidance(
                robot, [Target(PLACE)], profile_of_people(), told, fixtures=fixtures()
            )

    @property
    def goes_on(self) -> bool:
        """Whether the arm has not arrived, and there is time."""
        return not self.run.arrived and self._cycle * _cell().cycle_s < END_S

    def step(self) -> None:
        """Do a cycle."""
        t = self._cycle * _cell().cycle_s
        reports = self._camera.arrived(t)
        self._known.take_in(reports)
        if self._mode is not None and self._cycle % _PER_DECISION == 0 and self._cycle > 0:
            self._decide(self._mode, t)
        told = reports if self.run.setting.supervised else [RawMeasurement(t, t, "world", True, ())]
        command = self._supervisor.step(t, told)
        if self._supervisor.fault is not None:
            raise self._supervisor.fault
        self._twin.go(command.q, command.dq)
        self._cycle += 1
        self._note(t + _AHEAD_S, command.outcome, command.q)

    def _decide(self, mode: ProactiveAvoidance, t: float) -> None:
        view, run = self._supervisor.view(), self.run
        if not run.setting.supervised:
            view = self._known.shown(view)
        before = mode.decision.doing
        begin = time.perf_counter()
        proposal = mode.propose(view)
        taken = time.perf_counter() - begin
        decision = mode.decision
        run.decisions_s.append(taken)
        if decision.found is not None:
            run.planning_s.append(taken)
        if decision.doing is Doing.HALTING and before is not Doing.HALTING and self._way is not None:
            way, ahead_s = self._way.trajectory, mode.settings.ahead_s
            s = view.s if math.isfinite(view.s) else 0.0
            run.halts += 1
            run.needed += self._witness.needed(self._trial.person, t, way, s, ahead_s)
        if isinstance(proposal, NewTrajectory):
            self._note_way(decision)
            self._way = proposal
        if proposal is not None:
            self._propose(proposal)

    def _propose(self, proposal: Proposal) -> None:
        refusal = self._supervisor.propose(proposal)
        if refusal is None:
            return
        self.run.refused += 1
        if self._mode is not None:
            self._mode.refused(refusal)

    def _note_way(self, decision: Decision) -> None:
        self.run.ways += 1
        assert decision.found is not None
        self.run.nodes.append(decision.found.nodes)
        self.run.corners.append(0 if decision.found.path is None else len(decision.found.path) - 2)

    def _note(self, t: float, outcome: State, q: Array) -> None:
        run = self.run
        self._twin.put(self._trial.person.at(t)[None])
        moving = self._twin.moving(_FAST_M_S)
        near = self._twin.nearest(1.0, moving)
        if near.link >= 0:
            run.moving_m = min(run.moving_m, near.gap_m)
            run.contacts += near.gap_m <= 0.0
        near = self._twin.nearest(1.0, frozenset(range(LINKS)) - moving)
        if near.link >= 0:
            run.resting_m = min(run.resting_m, near.gap_m)
        if self._cycle % 2 == 0:
            run.places.append(self._frame.pose(self._twin.q)[1].copy())
        rests = outcome is State.STOPPED
        here = np.abs((q - np.array(PLACE) + np.pi) % (2.0 * np.pi) - np.pi).max() < 1e-3
        run.standstills += rests and self._moved and not here
        self._moved = not rests
        if here and rests:
            run.arrived_s = t


def forecast_errors(those: Sequence[Trial]) -> tuple[Errors, ...]:
    """Return mean errors of forecasts of the people of trials, seen as the camera sees them."""
    found = []
    for name in FORECASTERS:
        forecaster = load_forecaster(name)
        away = [
            _away(trial, history, stamp, forecast_points(history.points(), forecaster).points)
            for trial in those
            for history, stamp in _histories(trial)
        ]
        for k, each in enumerate(np.moveaxis(np.array(away), 1, 0)):
            known = each[np.isfinite(each)]
            found.append(Errors((k + 1) / RATE_HZ, name, float(known.mean()) if known.size else math.nan))
    return tuple(found)


def _histories(trial: Trial) -> list[tuple[History, float]]:
    """Return what is known of a person when 3 s have been seen; one for each trial."""
    camera, history = Camera([trial.person], CameraSettings(seed=trial.number), trial.hidden), History()
    for report in camera.arrived(3.0):
        history.add(report.stamp, np.asarray(report.people[0].xyz))
    return [(history, history.newest)]


def _away(trial: Trial, _history: History, stamp: float, points: Array) -> Array:
    """Return how far joints are from their forecasts ``(10, 15)`` [m]."""
    truth = np.array([trial.person.at(stamp + (k + 1) / RATE_HZ) for k in range(AHEAD)])
    return np.asarray(np.linalg.norm(joints_of_points(points) - joints_of_points(truth), axis=2))
