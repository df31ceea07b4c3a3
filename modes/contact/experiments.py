"""The paper's experiments (section IV), scripted: when somebody touches the arm, where, and what is expected.

The paper's instants are kept where it gives them. How hard and how long its people pushed is not said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.contact.admittance import CyclicTask
from modes.contact.course import Change, Course
from modes.contact.detection import Residual
from modes.contact.filters import Variant
from modes.contact.machine import ContactSettings, Reason, State, Why
from modes.contact.touches import Blow, Hand, Push, Spot, Touch
from modes.contact.twin import Body, Twin
from modes.contact.wrench import SensorLimits, ToolLoad, identify_load
from modes.tool_frame import ToolFrame
from robots.model import RobotModel

Array = NDArray[np.float64]

BEGIN = np.deg2rad([0.0, 20.0, -10.0, 0.0, 60.0, 0.0])
"""Where the task begins: tool half a metre before the base, pointing down and ahead."""
END_S = 82.0
TIP = Spot("tool", (0.0, 0.0, -0.05))
GRIP = Spot("tool", (0.0, 0.0, -0.19))
FOREARM = Spot("link_4", (0.0, 0.0, -0.15))
_SIDES = np.array([[0.0, 0.0, 0.0], [0.0, 0.12, 0.0], [0.05, 0.12, 0.1], [0.05, 0.0, 0.1]])
_LEG_S = 3.0
_TILTS = np.deg2rad([[0, 0], [60, 0], [-60, 90], [90, 45], [-90, -45], [120, 90]])

_SHORT: dict[Reason, str] = {
    Why.NOTHING: "",
    Why.BODY_COLLISION: " (arm)",
    Why.TOOL_COLLISION: " (end effector)",
    Why.RESIDUAL: " (residual)",
    Why.SOFT_CONTACT: "",
    Why.LET_GO: "",
}
_LAG_S, _STILL_M = 0.2, 3e-3
"""A collision is to be told, and the arm to come to rest, within this time [s] each; it rests when it goes no
farther than this [m] from there, since drives that are pushed give way a little."""
_CLEAR_S, _RESUME_S = 1.0, 4.0
"""Waits of the machine after a contact and after guidance [s]."""
_LED, _BACK_M = 0.2, 5e-3
"""A tool is led when it goes this share of the hand's way; back when it is so near where it was taken [m]."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Something that is done to the arm.

    Attributes
    ----------
    name:
        What is done.
    begin_s, end_s:
        When; until the next one.
    hit_s, gone_s:
        When the arm is hit, if it is; when nobody touches it any more [s].
    expected:
        States that are entered, with reasons, as :func:`observed` writes them.
    figures:
        Of the paper; empty: none.
    away_m:
        Where a hand leads the tool, if one does [m].
    """

    name: str
    begin_s: float
    end_s: float
    hit_s: float
    gone_s: float
    expected: str
    figures: str
    away_m: tuple[float, float, float] | None = None


_TOLD = "collision{}, until it is gone > task"
_FIRST, _LAST = (0.0, 0.06, 0.06), (0.0, -0.08, 0.05)
EXPERIMENTS = (
    Experiment("nobody is near", 0.0, 16.0, 0.0, 0.0, "task", ""),
    Experiment(
        "a hand guides the end effector", 16.0, 22.4, 16.0, 18.0,
        "collaboration, led > return, back for 4 s > task", "4", _FIRST,
    ),
    Experiment(
        "a blow on the end effector", 22.4, 30.4, 22.4, 22.44, _TOLD.format(" (end effector)"), "5"
    ),
    Experiment(
        "a contact at the end effector that lasts 4 s", 30.4, 46.0, 30.4, 34.4,
        _TOLD.format(" (end effector)"), "6",
    ),
    Experiment("a blow on link 4", 46.0, 58.0, 46.0, 46.04, _TOLD.format(" (arm)"), "7, 8"),
    Experiment(
        "a contact with link 4 that lasts 3 s", 58.0, 67.0, 58.0, 61.0, _TOLD.format(" (arm)"), "7, 8"
    ),
    Experiment(
        "a blow on link 4 while a hand guides the end effector", 67.0, END_S, 71.0, 73.0,
        "collaboration, led > collision (residual), until it is gone > task", "9", _LAST,
    ),
)  # fmt: skip


def touches() -> tuple[Touch, ...]:
    """Return everything that touches the arm."""
    return (
        Hand(GRIP, 16.0, 18.0, _FIRST, moving_s=1.0),
        Blow(TIP, 22.4, 60.0),
        Blow(TIP, 30.4, 60.0),
        Push(TIP, 30.4, 34.4, 20.0, rise_s=0.05),
        Blow(FOREARM, 46.0, 80.0),
        Blow(FOREARM, 58.0, 80.0),
        Push(FOREARM, 58.0, 61.0, 40.0, rise_s=0.05),
        Hand(GRIP, 68.0, 73.0, _LAST, moving_s=2.0),
        Push(FOREARM, 71.0, 71.4, 110.0, rise_s=0.1),
    )


def task(robot: RobotModel, body: Body) -> CyclicTask:
    """Return the paper's kind of task: four points, straight lines, at rest in each."""
    place = ToolFrame(robot, np.array(body.flange_m)).pose(BEGIN)[1]
    return CyclicTask(place + _SIDES, _LEG_S)


def settings(body: Body, load: ToolLoad, filters: Variant = "corrected") -> ContactSettings:
    """Return the paper's thresholds and gains."""
    return ContactSettings(
        Residual(tuple(body.gains_Nm_A)),
        load=load,
        sensor=SensorLimits(range_N=body.range_N, range_Nm=body.range_Nm),
        sensor_m=body.flange_m,
        filters=filters,
    )


def identified(robot: RobotModel, body: Body, seed: int = 0) -> ToolLoad:
    """Return the load that :func:`~modes.contact.wrench.identify_load` finds on a twin in six poses."""
    twin = Twin(robot, BEGIN, body, seed=seed)
    frame = ToolFrame(robot, np.array(body.flange_m))
    readings, rotations = [], []
    for bend, turn in _TILTS:
        q = BEGIN + np.array([0.0, 0.0, 0.0, turn, bend - BEGIN[4], 0.0])
        twin.place(q)
        samples = [twin.go(q, np.zeros(6)).wrenches.mean(axis=0) for _ in range(20)]
        readings.append(np.mean(samples, axis=0))
        rotations.append(frame.pose(twin.q)[0])
    return identify_load(np.array(readings), np.array(rotations))


def observed(experiment: Experiment, course: Course) -> str:
    """Return the states that were entered, as ``collaboration, led > return, back for 4 s > task``.

    ``led`` stands behind a collaboration that lasts until the hand lets go or the arm is hit, in which the
    tool goes a fifth of the hand's way at least; ``back for 4 s`` behind a return at whose end the tool is
    where it was taken, 4 s later; ``until it is gone`` behind a collision that is told within 0.2 s of the
    blow and not before it, in which the arm rests, and which ends a second after the contact, not before.
    """
    changes = course.changes(experiment.begin_s, experiment.end_s)
    return " > ".join(
        _written(k, [*changes, Change(experiment.end_s, State.TASK, Why.NOTHING)], experiment, course)
        for k in range(len(changes))
    )


def _written(k: int, changes: list[Change], experiment: Experiment, course: Course) -> str:
    change, left = changes[k], changes[k + 1].t
    said = change.state.value + _SHORT.get(change.reason, f" ({change.reason.value})")
    if change.state is State.COLLISION:
        told = 0.0 <= change.t - experiment.hit_s <= _LAG_S
        rests = left > change.t + _LAG_S and course.wanders(change.t + _LAG_S, left) < _STILL_M
        waits = left >= experiment.gone_s + 0.9 * _CLEAR_S
        return said + (", until it is gone" if told and rests and waits else "")
    if change.state is State.COLLABORATION and experiment.away_m is not None:
        away = np.array(experiment.away_m)
        way = course.place(left) - course.place(change.t)
        hit = experiment.hit_s > experiment.begin_s
        held = left >= (experiment.hit_s if hit else experiment.gone_s - 2.0 * _LAG_S)
        return said + (", led" if held and way @ away >= _LED * (away @ away) else "")
    if change.state is State.RETURN and k > 0:
        taken = course.place(changes[k - 1].t)
        back = np.linalg.norm(course.place(left) - taken) < _BACK_M
        return said + (", back for 4 s" if back and abs(left - change.t - _RESUME_S) < 0.1 else "")
    return said
