"""``stopproof scenario speed-alteration``: the paper's simulations and experiments, also under the verifier.

The only file of the mode that uses the verifier beyond its protocol (docs/method.md, section 7).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.speed.alteration import SpeedAlteration, SpeedSettings
from modes.speed.cartesian import LastFrame, Line, follow_lines
from modes.speed.danger_index import Ellipsoids, danger_index
from modes.speed.experiments import experiment
from modes.speed.objective import Weights
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
from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson
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
DOWN = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
"""The paper's initial pose: flange at (368, 0, 668.5) mm, tool down."""
_FLANGE_M = 0.0865
_REPORT_S, _DECISION_S = 0.03, 0.1
_LATENCY_S = 0.05
_LONGER = 3.0
"""A scene under the verifier goes on for so many times as long as the motion alone takes, and no longer."""
_PERSON_M_S = 1.6
_WALK_M_S, _FAR_M = 1.0, 6.0
_ARM: dict[Point, tuple[float, float, float]] = {
    Point.R_FINGERTIP: (-0.07, 0.0, 0.0), Point.R_HAND: (0.0, 0.0, 0.0), Point.R_WRIST: (0.08, 0.0, 0.0),
    Point.R_ELBOW: (0.32, 0.0, -0.06), Point.R_SHOULDER: (0.5, 0.02, 0.16),
    Point.NECK_BASE: (0.56, 0.2, 0.22), Point.HEAD: (0.56, 0.2, 0.42), Point.THORAX: (0.58, 0.2, 0.0),
    Point.PELVIS: (0.6, 0.2, -0.3), Point.L_SHOULDER: (0.6, 0.38, 0.16), Point.L_ELBOW: (0.62, 0.42, -0.12),
    Point.L_WRIST: (0.6, 0.42, -0.36), Point.L_HAND: (0.6, 0.42, -0.44),
    Point.L_FINGERTIP: (0.6, 0.42, -0.52),
    Point.R_HIP: (0.6, 0.1, -0.34), Point.R_KNEE: (0.6, 0.1, -0.76), Point.R_ANKLE: (0.6, 0.1, -1.16),
    Point.L_HIP: (0.6, 0.3, -0.34), Point.L_KNEE: (0.6, 0.3, -0.76), Point.L_ANKLE: (0.6, 0.3, -1.16),
}  # fmt: skip
"""Somebody who reaches: how far beyond the hand, seen from the robot; to the side; above it [m]."""


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
        alone = _watch(scene, people=False, mode=False)
        stop = max((each for each in alone.stop_time_s if math.isfinite(each)), default=math.nan)
        for mode in (False, True):
            watched.append(_summary(scene, alone, _watch(scene, people=True, mode=mode), stop, mode))
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
    reaction = _LATENCY_S + 2.0 * 0.01
    lengths = Lengths(
        declared("S_h", _PERSON_M_S * (reaction + stop_time), "m"),
        declared("S_r", speed * reaction, "m"),
        declared("S_s", speed * stop_time, "m"),
        (Assumption("T_s", stop_time, "s", "the plans of the supervisor", Certainty.COMPUTED),),
    )
    error = declared("Z_d", 0.01, "m")
    allowances = Allowances(declared("C", 0.0, "m"), error, declared("Z_r", 0.001, "m"))
    return protective_separation(lengths, allowances).distance_m


@cache
def _arm() -> tuple[Cell, RobotModel]:
    cell = Cell.from_table(CELL)
    return cell, build_robot(cell)


def motion_of(scene: Scene, robot: RobotModel) -> tuple[Array, IntendedTrajectory]:
    """Return where the arm begins ``(6,)`` [rad], and the scene's route as joint motion."""
    frame = LastFrame(robot)
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
    duration_s: float
    stood_s: float
    verified: int


def _watch(scene: Scene, *, people: bool, mode: bool) -> _Course:
    """Let the supervisor follow the route of a scene, with its hand or nobody in sight."""
    cell, robot = _arm()
    q, path = motion_of(scene, robot)
    supervisor = Supervisor.from_cell(cell, q)
    proposer = SpeedAlteration(robot, SpeedSettings()) if mode else None
    scope = _Scope(robot, scene)
    course = _Course([], [], [], [], math.nan, path.s_end, 0.0, 0)
    refused = supervisor.propose(NewTrajectory(path))
    assert refused is None, refused
    h, before = cell.cycle_s, q
    per_report, per_decision = round(_REPORT_S / h), round(_DECISION_S / h)
    for k in range(round((_LONGER * path.s_end + 2.0) / h)):
        t = k * h
        reports = [_report(scene, t, people)] if k % per_report == 0 else []
        if proposer is not None and k % per_decision == 0:
            proposal = proposer.propose(supervisor.view())
            if proposal is not None:
                supervisor.propose(proposal)
        command = supervisor.step(t, reports)
        if supervisor.fault is not None:
            raise supervisor.fault
        scope.note(course, command, before, t, h, seen=people)
        before = command.q
        if supervisor.view().s >= path.s_end - 1e-6 and command.outcome is State.STOPPED:
            course.goal_s = t
            break
    return course


class _Scope:
    """Measures what the paper looks at, and what it does not, in each step."""

    def __init__(self, robot: RobotModel, scene: Scene) -> None:
        self._frame, self._scene = LastFrame(robot), scene

    def note(
        self, course: _Course, command: Command, before: Array, t: float, h: float, *, seen: bool
    ) -> None:
        """Note a step."""
        ball, earlier = self._ball(command.q), self._ball(before)
        speed = float(np.linalg.norm(ball - earlier)) / h
        hand = hand_at(self._scene, t + 2.0 * h)
        course.speed.append(speed)
        course.stop_time_s.append(command.verdict.stop_time_s)
        course.verified += command.verdict.status.name == "VERIFIED"
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


def hand_at(scene: Scene, t: float) -> Array:
    """Return the hand of a scene (3,) [m] at ``t`` [s] after sample 1.

    Before it comes into the paper's sight, and after it has left it, it is on its way from and to 6 m away:
    the supervisor has to see everybody, and does not forget who goes out of sight.
    """
    at, hands = t / scene.interval_s, scene.hands[:, 0]
    seen = np.flatnonzero(np.isfinite(hands).all(axis=1))
    place = np.array([np.interp(at, seen, hands[seen, axis]) for axis in range(3)])
    beyond = max(float(seen[0]) - at, at - float(seen[-1]), 0.0) * scene.interval_s
    if beyond > 0.0 and len(seen) < len(hands):
        outwards = np.array([place[0], place[1], 0.0]) / math.hypot(place[0], place[1])
        place = place + min(_WALK_M_S * beyond, _FAR_M) * outwards
    return place


def _report(scene: Scene, t: float, people: bool) -> RawMeasurement:
    """Return what arrives at ``t`` [s]: somebody who reaches to where the hand was before the latency."""
    stamp = t - _LATENCY_S
    hand = hand_at(scene, stamp)
    if not people:
        return RawMeasurement(stamp, t, "world", True, ())
    outwards = np.array([hand[0], hand[1], 0.0]) / math.hypot(hand[0], hand[1])
    points = np.full((MAX_POINTS, 3), np.nan)
    aside = np.array([-outwards[1], outwards[0], 0.0])
    for point, (beyond, side, above) in _ARM.items():
        points[point] = hand + beyond * outwards + side * aside + np.array([0.0, 0.0, above])
    measured = sum(1 << point for point in _ARM)
    who = RawPerson("p1", points, np.full(MAX_POINTS, 0.01), measured)
    return RawMeasurement(stamp, t, "world", True, (who,))


def _summary(scene: Scene, alone: _Course, course: _Course, stop: float, mode: bool) -> Watched:
    speed, gap = np.array(course.speed), np.array(course.separation_m)
    index = np.array(course.danger_index)
    moving = speed > 1e-3
    return Watched(
        scene=scene.name,
        mode=mode,
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
