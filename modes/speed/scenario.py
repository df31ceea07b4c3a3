"""``stopproof scenario speed-alteration``: the paper's simulations and experiments, also under the verifier.

The only file of the mode that uses the verifier beyond its protocol (docs/method.md, section 7).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.speed.alteration import SpeedAlteration, SpeedSettings
from modes.speed.cartesian import Line, follow_lines
from modes.speed.danger_index import Ellipsoids, danger_index
from modes.speed.experiments import experiment
from modes.speed.objective import Weights
from modes.speed.reaching import LATENCY_S, hand_at, report_at
from modes.speed.report import SpeedReport, Watched
from modes.speed.simulations import (
    BALL_ABOVE_FLANGE_M,
    METHODS,
    RADIUS_M,
    Choice,
    Method,
    Scene,
    run,
    simulation,
)
from modes.tool_frame import ToolFrame
from robots.assumption import Assumption, Certainty
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.command import Command, State
from verifier.proposal import NewTrajectory
from verifier.required_distance import Allowances, Lengths, declared, protective_separation
from verifier.scenario import ScenarioReport
from verifier.setup import build_robot
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]
Progress = Callable[[float], None]

CELL = {
    "cycle_s": 0.01,
    "robot": {
        "name": "ra605", "bare_flange": True, "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.001},
    },
    "people": {"latency_s": 0.05, "repeated_points": "measured"},
}  # fmt: skip
_LINKS = ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6")
CONTACT_CELL = {
    **CELL,
    "robot": {
        "name": "ra605", "bare_flange": True, "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.001, "velocity_error_rad_s": 0.001},
    },
    "workspace": {"floor_z_m": -0.8},
    "criteria": {
        "accept_unverified": True,
        "gaps_by_design": [list(pair) for pair in combinations(_LINKS, 2)],
        "contact": [{
            "links": list(_LINKS),
            "parts": ["l_hand", "l_forearm", "l_upper_arm", "r_hand", "r_forearm", "r_upper_arm"],
            "person_speed": "neglected",
        }],
    },
}  # fmt: skip
"""Power and force limiting for hands and arms. This arm's capsules are a guess, and close its own gaps."""
DOWN = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
"""The paper's initial pose: flange at (368, 0, 668.5) mm, tool down."""
_FLANGE_M = 0.0865
_REPORT_S, _DECISION_S = 0.03, 0.1
_LONGER = 3.0
"""A scene under the verifier goes on for so many times as long as the motion alone takes, and no longer."""
_PERSON_M_S = 1.6


def scenario(progress: Progress) -> ScenarioReport:
    """Run everything; ``progress`` is told the share that is done."""
    return run_scenario((simulation(1), simulation(2), experiment(1), experiment(2)), progress)


def run_scenario(scenes: tuple[Scene, ...], progress: Progress) -> SpeedReport:
    """Run the simulations and experiments, and ``scenes`` under the verifier."""
    simulations = {
        number: {method: run(simulation(number), Choice(method)) for method in METHODS} for number in (1, 2)
    }
    sweeps = {
        (name, value): run(simulation(1), Choice("proposed", _weights(name, value)))
        for name in ("penalty", "closeness", "smoothness")
        for value in (1.0, 10.0, 100.0)
    }
    chosen: tuple[Method, ...] = ("proposed", "none")
    experiments = {n: {method: run(experiment(n), Choice(method)) for method in chosen} for n in (1, 2)}
    progress(0.1)
    watched = []
    for number, scene in enumerate(scenes):
        alone = _watch(scene, Setting(people=False))
        stop = max((each for each in alone.stop_time_s if math.isfinite(each)), default=math.nan)
        for setting in (Setting(), Setting(mode=True), Setting(contact=True), Setting(True, True)):
            watched.append(_summary(scene, setting, alone, _watch(scene, setting), stop))
        progress(0.1 + 0.9 * (number + 1) / len(scenes))
    return SpeedReport(
        simulations=simulations,
        sweeps=sweeps,
        experiments=experiments,
        watched=tuple(watched),
        required_m=required_distance(abs(scenes[0].programmed), watched[0].stop_time_s),
        hands={number: simulation(number).hands[:, 0] for number in (1, 2)},
    )


def _weights(name: str, value: float) -> Weights:
    return {
        "penalty": Weights(penalty=value),
        "closeness": Weights(closeness=value),
        "smoothness": Weights(smoothness=value),
    }[name]


def required_distance(speed: float, stop_time: float) -> float:
    """Return S_p of ISO/TS 15066 [m] of an arm at ``speed`` [m/s] that stops in ``stop_time`` [s].

    T_r: latency and two cycles; S_s as if the speed were kept until rest; no intrusion distance; errors as
    the cell has them. A person's 1.6 m/s.
    """
    reaction = LATENCY_S + 2.0 * 0.01

    def length(name: str, value: float) -> Assumption:
        return Assumption(name, value, "m", "speed and time", Certainty.COMPUTED)

    lengths = Lengths(
        length("S_h", _PERSON_M_S * (reaction + stop_time)),
        length("S_r", speed * reaction),
        length("S_s", speed * stop_time),
        (Assumption("T_s", stop_time, "s", "the plans of the supervisor", Certainty.COMPUTED),),
    )
    error = declared("Z_d", 0.01, "m")
    allowances = Allowances(declared("C", 0.0, "m"), error, declared("Z_r", 0.001, "m"))
    return protective_separation(lengths, allowances).distance_m


@dataclass(frozen=True, slots=True)
class Setting:
    """How a scene is run under the supervisor.

    Attributes
    ----------
    mode:
        The mode proposes speeds.
    contact:
        Power and force limiting is declared for hands and arms.
    people:
        Somebody is there.
    """

    mode: bool = False
    contact: bool = False
    people: bool = True


@cache
def _arm(contact: bool) -> tuple[Cell, RobotModel]:
    cell = Cell.from_table(CONTACT_CELL if contact else CELL)
    return cell, build_robot(cell)


def motion_of(scene: Scene, robot: RobotModel) -> tuple[Array, IntendedTrajectory]:
    """Return where the arm begins ``(6,)`` [rad], and the scene's route as joint motion."""
    frame = ToolFrame(robot)
    rotation, place = frame.pose(DOWN)
    away = scene.corners[0] - (place - (0.0, 0.0, _FLANGE_M))
    q = frame.solve(rotation, place + away, DOWN)
    lines: list[Line] = []
    for corner, (here, there) in enumerate(zip(scene.corners[:-1], scene.corners[1:], strict=True)):
        if corner in scene.waits:
            lines.append(Line(np.zeros(3), 0.0, scene.waits[corner] * scene.interval_s))
        lines.append(Line(there - here, abs(scene.programmed)))
    return q, follow_lines(robot, q, tuple(lines))


@dataclass(slots=True)
class _Course:
    """What happened, step by step."""

    speed: list[float]
    danger_index: list[float]
    separation_m: list[float]
    stop_time_s: list[float]
    goal_s: float
    stood_s: float


def _watch(scene: Scene, setting: Setting) -> _Course:
    """Let the supervisor follow the route of a scene, with its hand or nobody in sight."""
    cell, robot = _arm(setting.contact)
    q, path = motion_of(scene, robot)
    supervisor = Supervisor.from_cell(cell, q)
    proposer = SpeedAlteration(robot, SpeedSettings()) if setting.mode else None
    scope = _Scope(robot, scene)
    course = _Course([], [], [], [], math.nan, 0.0)
    refused = supervisor.propose(NewTrajectory(path))
    assert refused is None, refused
    h, before = cell.cycle_s, q
    per_report, per_decision = round(_REPORT_S / h), round(_DECISION_S / h)
    for k in range(round((_LONGER * path.s_end + 2.0) / h)):
        t = k * h
        reports = [report_at(scene, t, people=setting.people)] if k % per_report == 0 else []
        if proposer is not None and k % per_decision == 0:
            proposal = proposer.propose(supervisor.view())
            if proposal is not None:
                supervisor.propose(proposal)
        command = supervisor.step(t, reports)
        if supervisor.fault is not None:
            raise supervisor.fault
        scope.note(course, command, before, t, h, seen=setting.people)
        before = command.q
        if supervisor.view().s >= path.s_end - 1e-6 and command.outcome is State.STOPPED:
            course.goal_s = t
            break
    return course


class _Scope:
    """Measures what the paper looks at, and what it does not, in each step."""

    def __init__(self, robot: RobotModel, scene: Scene) -> None:
        self._frame, self._scene = ToolFrame(robot), scene

    def note(
        self, course: _Course, command: Command, before: Array, t: float, h: float, *, seen: bool
    ) -> None:
        """Note a step."""
        ball, earlier = self._ball(command.q), self._ball(before)
        speed = float(np.linalg.norm(ball - earlier)) / h
        hand = hand_at(self._scene, t + 2.0 * h)
        course.speed.append(speed)
        course.stop_time_s.append(command.verdict.stop_time_s)
        course.stood_s += h * (speed < 1e-6)
        if not seen:
            course.danger_index.append(0.0)
            course.separation_m.append(math.inf)
            return
        robot, body = Ellipsoids.balls(ball[None], RADIUS_M), Ellipsoids.balls(hand[None], RADIUS_M)
        course.danger_index.append(float(danger_index(robot, body)[0, 0]))
        course.separation_m.append(float(np.linalg.norm(ball - hand)) - 2.0 * RADIUS_M)

    def _ball(self, q: Array) -> Array:
        """Return the centre of the ball around the end effector [m]."""
        rotation, place = self._frame.pose(q)
        return np.asarray(place + rotation @ np.array([_FLANGE_M - BALL_ABOVE_FLANGE_M, 0.0, 0.0]))


def _summary(scene: Scene, setting: Setting, alone: _Course, course: _Course, stop: float) -> Watched:
    speed, gap = np.array(course.speed), np.array(course.separation_m)
    index = np.array(course.danger_index)
    moving = speed > 1e-3
    return Watched(
        scene=scene.name,
        mode=setting.mode,
        contact=setting.contact,
        alone_s=alone.goal_s,
        goal_s=course.goal_s,
        stood_s=course.stood_s,
        stop_time_s=stop,
        nearest_moving_m=float(gap[moving].min(initial=math.inf)),
        highest_index=float(index.max(initial=0.0)),
        highest_index_moving=float(index[moving].max(initial=0.0)),
        contacts_while_moving=int((gap[moving] <= 0.0).sum()),
        speed_m_s=speed,
        danger_index=index,
        separation_m=gap,
        required_m=np.array([required_distance(float(v), stop) if v > 1e-3 else 0.0 for v in speed]),
    )
