"""A closed loop of the supervisor with scripted people: what it does before anything is connected.

People obey the profile of the cell and go for the arm; sensors and robot err as much as the cell declares.
Contacts are told by the true bodies and links (:mod:`verifier.simulated_world`), not by what was reported.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Profile
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.command import Cause, Command, State
from verifier.reports.simulation import SimulationReport, Tally
from verifier.scripted_people import Place, ScriptedPeople
from verifier.scripted_people_kernels import MOST_PERSONS
from verifier.scripted_planner import Planner
from verifier.setup import (
    DEFAULT_POSITION_ERROR_M,
    Supervised,
    build_live_watch,
    build_profile,
    build_robot,
    build_silence,
    build_supervised,
    require_cell,
)
from verifier.simulated_robot import SimulatedRobot
from verifier.simulated_sensors import Sensors, SensorSettings
from verifier.simulated_silence import OwnStop
from verifier.simulated_world import World
from verifier.stated import stated_assumptions, waivers
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.tracking import JointReading
from verifier.verdict import Reason, criterion_names

Array = NDArray[np.float64]
Progress = Callable[[float], None]

DEFAULT_S, LONGEST_S = 60.0, 86_400.0
_BENCH_M = 0.8
"""Where no floor is declared, people stand so much below the base of the robot, and not above z = 0."""
_JITTER = 0.3
"""Reports arrive later than the latency by at most this share of it."""
_PATIENCE_S = 0.5
"""A motion that cannot be gone on with, whoever is there, is given up after so long."""
_OF_THE_MOTION = frozenset(
    (
        Reason.NO_STOP_WITHIN_LIMITS, Reason.STATE_BEYOND_LIMITS, Reason.BEYOND_END, Reason.EMPTY_PLAN,
        Reason.FIXTURE_IN_REACH, Reason.LINKS_IN_REACH,
    )
)  # fmt: skip
_STOPPING_S = 0.6
"""About how long an arm takes to stop; decides how far people go away, and nothing else."""


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """What is simulated.

    Attributes
    ----------
    seconds:
        How long [s].
    seed:
        Decides everything that is left to chance: the same seed gives the same result.
    people:
        How many people there are, 0 to 8.
    faster:
        Factor by which they are faster than the profile.
    rate_hz, dropped:
        Reports a second, and the share of them that get lost.
    lost:
        Share of the commands that do not reach the robot.

    Raises
    ------
    SetupError
        A number is outside its range.
    """

    seconds: float = DEFAULT_S
    seed: int = 0
    people: int = 1
    faster: float = 1.0
    rate_hz: float = 30.0
    dropped: float = 0.02
    lost: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds <= LONGEST_S:
            raise SetupError(f"--seconds {self.seconds:g}: should be above 0 and at most {LONGEST_S:g}")
        if self.seed < 0:
            raise SetupError(f"--seed {self.seed}: should not be negative")
        if not 0 <= self.people <= MOST_PERSONS:
            raise SetupError(f"--people {self.people}: should be 0 to {MOST_PERSONS}")
        if not 0.1 <= self.faster <= 20.0:
            raise SetupError(f"--faster {self.faster:g}: should be 0.1 to 20 times the profile's speeds")
        if not 1.0 <= self.rate_hz <= 1000.0:
            raise SetupError(f"--report-rate {self.rate_hz:g}: should be 1 to 1000 Hz")
        if not 0.0 <= self.dropped < 1.0:
            raise SetupError(f"--dropped {self.dropped:g}: should be a share, 0 or more and below 1")
        if not 0.0 <= self.lost < 1.0:
            raise SetupError(f"--lost {self.lost:g}: should be a share, 0 or more and below 1")


def simulate(
    cell: Cell,
    settings: SimulationSettings,
    *,
    progress: Progress | None = None,
    parts: Supervised | None = None,
) -> SimulationReport:
    """Run the loop; ``parts``: what the supervisor is made of, ``None``: what the cell says.

    Raises
    ------
    SetupError
        The cell cannot be used, or no motion for its robot is found; one line that says what is wrong.
    """
    run = _Run(cell, settings, parts)
    run.go(progress or _ignore)
    return run.report()


def _ignore(_share: float) -> None:
    """Nobody wants to know."""


class _Chance(NamedTuple):
    """Random numbers for each part of the simulation: none depends on how often another one draws."""

    people: np.random.Generator
    planner: np.random.Generator
    robot: np.random.Generator
    sensors: np.random.Generator
    handing_over: np.random.Generator


class _Run:
    """One simulation."""

    def __init__(self, cell: Cell, settings: SimulationSettings, parts: Supervised | None) -> None:
        require_cell(cell)
        self._cell, self._settings = cell, settings
        self._cycles = math.floor(settings.seconds / cell.cycle_s + 1e-9)
        if self._cycles < 1:
            raise SetupError(
                f"--seconds {settings.seconds:g}: is shorter than a cycle, {cell.cycle_s:g} s in {cell.where}"
            )
        self._model = robot = build_robot(cell)
        self._parts = parts = build_supervised(cell, robot) if parts is None else parts
        self._profile = build_profile(cell)
        seeds = np.random.SeedSequence(settings.seed).spawn(len(_Chance._fields))
        chance = _Chance(*(np.random.default_rng(seed) for seed in seeds))
        place = _place(cell, robot, settings)
        self._planner = Planner(cell, robot, parts, place.floor_m, chance.planner)
        q = self._planner.start()
        self._chance, self._silence = chance.handing_over, build_silence(cell, robot)
        self._own: OwnStop | None = None
        self._held = State.STOPPED
        self._supervisor = self._supervise(q)
        self._planner.propose(self._supervisor, q)
        self._robot = SimulatedRobot(robot.limits, cell.robot.tracking, cell.cycle_s, q, chance.robot)
        self._sensors = Sensors(_sensor_settings(cell, settings), chance.sensors)
        self._people = ScriptedPeople(
            self._profile, settings.people, place, chance.people,
            faster=settings.faster, held_m=cell.people.held_object_m,
        )  # fmt: skip
        self._world = World(cell, robot, self._robot, self._people)
        self._tally = Tally()
        self._counted: IntendedTrajectory | None = None
        self._stuck_since = math.nan
        self._seconds = 0.0

    def _supervise(self, q: Array) -> Supervisor:
        """Make a supervisor of a robot that rests at ``q (n,)``."""
        parts, settings = self._parts, SupervisorSettings(0.25 * self._cell.cycle_s)
        return Supervisor(parts.check, build_live_watch(self._cell), parts.plans, settings, q)

    def _propose(self, t: float, q: Array) -> None:
        """Propose a motion of a robot that rests at ``q (n,)``; where none is found the run ends."""
        try:
            self._planner.propose(self._supervisor, q)
        except SetupError as error:
            self._tally.ended = f"at {t:.2f} s: {error}"

    def go(self, progress: Progress) -> None:
        """Run all cycles."""
        began, h = time.perf_counter(), self._cell.cycle_s
        for k in range(self._cycles):
            t = k * h
            self._robot.next_cycle(k)
            outcome = self._step(t) if self._own is None else self._goes_on_alone(t, self._own)
            self._people.set_out(t, h, self._world.goals, outcome)
            self._sensors.look(t, h, self._people.points)
            self._world.advance(t, h)
            if self._tally.ended:
                break
            if k % 64 == 0:
                progress(k / self._cycles)
        self._world.end()
        self._count_path()
        self._seconds = time.perf_counter() - began
        progress(1.0)

    def _step(self, t: float) -> State:
        """One step of the supervisor at ``t`` [s], and what the robot gets of it."""
        supervisor, h = self._supervisor, self._cell.cycle_s
        reading = JointReading(t, self._robot.at(t).q)
        command = supervisor.step(t, self._sensors.arrived(t), reading)
        if supervisor.fault is not None:
            raise supervisor.fault
        lost = self._chance.random() < self._settings.lost
        if lost:
            self._tally.lost += 1
            command = supervisor.withdraw()
        self._tally.note(t, command)
        if lost and self._silence is not None and self._held is not State.STOPPED:
            limits = self._model.limits
            self._own = OwnStop(self._silence, limits, t + h, self._robot.newest, self._chance)
            self._tally.own_stops += 1
            self._robot.go_on(self._own, t + h)
            return State.FAILSAFE
        self._robot.hold(supervisor.running, t + h)
        self._held = command.outcome
        if command.cause is Cause.RESTING or self._gives_up(t, command):
            self._count_path()
            self._propose(t, command.q)
        return command.outcome

    def _goes_on_alone(self, t: float, own: OwnStop) -> State:
        """The robot stops by itself; once it surely rests, there is a new supervisor."""
        h = self._cell.cycle_s
        self._robot.go_on(own, t + h)
        if t < own.end + self._cell.robot.tracking.delay_max_s + h:
            return State.FAILSAFE
        self._count_path()
        self._own, self._held = None, State.STOPPED
        q = self._robot.newest.q.copy()
        self._supervisor = self._supervise(q)
        self._propose(t, q)
        return State.STOPPED

    def _count_path(self) -> None:
        """Add what was gone through of the present trajectory, once."""
        path = self._supervisor.running.plan.trajectory
        if path is not self._counted:
            self._tally.path_s += min(self._supervisor.view().s, path.s_end) - path.s_begin
            self._counted = path

    def _gives_up(self, t: float, command: Command) -> bool:
        """Whether the robot has stood still for long on a motion that nobody is in the way of."""
        stuck = command.outcome is State.STOPPED and command.verdict.reason in _OF_THE_MOTION
        if not stuck or math.isnan(self._stuck_since):
            self._stuck_since = t if stuck else math.nan
            return False
        if t - self._stuck_since < _PATIENCE_S:
            return False
        self._stuck_since = math.nan
        self._tally.given_up += 1
        return True

    def report(self) -> SimulationReport:
        """Return what was found."""
        cell, settings, world, sensors = self._cell, self._settings, self._world, self._sensors
        return SimulationReport(
            robot=self._model.name,
            profile=_named(self._profile),
            models=cell.people.models,
            waived=waivers(cell, self._model, assume_nobody=False).texts,
            assumptions=stated_assumptions(cell, self._parts.check),
            not_checked_criteria=criterion_names(self._parts.check.not_checked),
            cycle_s=cell.cycle_s,
            seed=settings.seed,
            people=settings.people,
            faster=settings.faster,
            floor=(self._people.floor_m, cell.workspace.floor_z_m is not None),
            tally=self._tally,
            contacts=tuple(sorted(world.contacts, key=lambda each: each.t)),
            declared_touches=(world.declared, world.fastest_declared_m_s),
            nearest=world.nearest,
            histogram=world.histogram,
            moving=world.moving,
            limits_exceeded=dict(self._robot.exceeded),
            largest_share=dict(self._robot.worst),
            motions=self._planner.proposed,
            reports=(sensors.seen, sensors.lost),
            sensors=sensors.settings,
            lost=settings.lost,
            real_time_factor=self._cycles * cell.cycle_s / max(self._seconds, 1e-9),
        )


def _named(profile: Profile) -> str:
    return f"{profile.name} ({profile.speed.max():g} m/s)"


def _place(cell: Cell, robot: RobotModel, settings: SimulationSettings) -> Place:
    n = len(robot.links)
    reach = robot.enclosure["reach"][0, :n, 0] + robot.enclosure["radius"][0, :n]
    floor = cell.workspace.floor_z_m
    seen = cell.people.latency_s * (1.0 + _JITTER) + 1.0 / settings.rate_hz
    return Place(
        centre=np.array(cell.robot.mount.xyz_m[:2]),
        floor_m=min(0.0, cell.robot.mount.xyz_m[2] - _BENCH_M) if floor is None else floor,
        reach_m=float(reach.max()),
        standstill_s=_STOPPING_S + seen + 2.0 * cell.cycle_s,
    )


def _sensor_settings(cell: Cell, settings: SimulationSettings) -> SensorSettings:
    people = cell.people
    stated = people.position_error_m
    return SensorSettings(
        rate_hz=settings.rate_hz,
        latency_s=people.latency_s,
        jitter_s=_JITTER * people.latency_s,
        dropped=settings.dropped,
        position_error_m=DEFAULT_POSITION_ERROR_M if stated is None else stated,
        stamp_error_s=people.stamp_error_s + people.clock_error_s,
    )
