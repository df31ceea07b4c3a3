"""Before the first step that counts: all that a supervisor may come to do, done by one of no account.

Compiled functions are made, or read from disk, at their first use. Within a loop that costs cycles at the
least favourable moment: when somebody first comes near. After a rehearsal in the same process they are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanSettings, StopKind
from failsafe.running_plan import RunningPlan
from failsafe.scaling import PathState, conservative_budget
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import rest_to_rest
from occupancy.body import MAX_POINTS
from occupancy.report import RawMeasurement, RawPerson
from robots.limits import JointLimits
from verifier.cell import Cell
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Proposal, Stop
from verifier.scripted_people import Place, ScriptedPeople
from verifier.setup import Supervised, build_live_watch, build_profile, build_supervised
from verifier.simulated_sensors import ALL_MEASURED
from verifier.supervisor import Supervisor, SupervisorSettings

Array = NDArray[np.float64]

_FAR_M, _NEAR_M, _WALK_M_S, _JUMP_M = 4.0, 0.0, 1.0, 3.0
_COMES_S = (_FAR_M - _NEAR_M) / _WALK_M_S
_REPORTS_HZ = 100.0
_ERROR_M = 0.01
_TURN, _SHARE, _LEGS = 0.3, 0.3, 12
"""Each joint turns by at most so much [rad; m], at a share of its limits, so many times to or fro."""
_SHARP = 1e5
"""Jerk [rad/s³; m/s³] of a path that cannot be followed any more: whoever comes to it leaves the path."""


@dataclass(frozen=True, slots=True)
class _Act:
    """One run: how long [s], how far somebody is away [m] at each instant, what is proposed when [s]."""

    seconds: float
    away_m: Callable[[float], float]
    proposals: Mapping[float, Proposal]


def rehearse(cell: Cell, q: Array) -> int:
    """Let supervisors of ``cell`` that begin at ``q (n,)`` go through what may become of them.

    To be called once in each process, before the loop begins, and again for another cell. Takes seconds, and
    minutes where the project has never run with such a cell. Keeps nothing but what was compiled; returns how
    many steps were made.

    Raises
    ------
    SetupError
        The cell or ``q`` cannot be used.
    """
    parts = build_supervised(cell)
    somebody = _somebody(cell)
    steps = sum(_play(act, cell, parts, q, somebody) for act in _acts(len(q)))
    _overlap(cell, parts, q, somebody)
    limits = parts.check.robot.limits
    conservative_budget(_to_and_fro(q, limits), limits, PathState(0.0, 1.0))
    _leave_the_path(limits, parts.plans, q)
    return steps


def _acts(n: int) -> tuple[_Act, ...]:
    """Return two: everything is proposed; somebody comes, goes, and is then elsewhere at once."""
    proposals: dict[float, Proposal] = {
        0.3: PathSpeed(0.5),
        0.6: PathSpeed(1.0),
        0.9: PathSpeed(-0.5),
        1.6: PathSpeed(1.0),
        2.4: JointVelocity(np.full(n, 0.05), 0.1),
        2.8: Stop(),
    }

    def comes_and_goes(t: float) -> float:
        if t > 2.0 * _COMES_S:
            return _FAR_M + _JUMP_M
        return _NEAR_M + _WALK_M_S * abs(t - _COMES_S)

    return _Act(3.2, lambda t: _FAR_M, proposals), _Act(2.0 * _COMES_S + 0.1, comes_and_goes, {})


def _play(act: _Act, cell: Cell, parts: Supervised, q: Array, somebody: Array) -> int:
    """Run one supervisor against a clock of its own; return its steps."""
    h, settings = cell.cycle_s, SupervisorSettings(0.25 * cell.cycle_s)
    supervisor = Supervisor(parts.check, build_live_watch(cell), parts.plans, settings, q)
    supervisor.propose(NewTrajectory(_to_and_fro(q, parts.check.robot.limits)))
    waiting, every, count = dict(act.proposals), max(1, round(1.0 / (_REPORTS_HZ * h))), 0
    for count in range(1, math.ceil(act.seconds / h) + 1):
        t = (count - 1) * h
        for due in [each for each in waiting if each <= t]:
            supervisor.propose(waiting.pop(due))
        there = somebody + np.array([act.away_m(t), 0.0, 0.0])
        supervisor.step(t, [] if count % every else [_report(t, there)])
        if supervisor.fault is not None:
            raise supervisor.fault
        if count == every:
            supervisor.withdraw()
    return count


def _overlap(cell: Cell, parts: Supervised, q: Array, somebody: Array) -> None:
    """Hold a plan whose links lie inside of somebody against every model by itself."""
    check, watch = parts.check, build_live_watch(cell)
    watch.admit(_report(0.0, somebody), 0.0)
    planner = ShortTermPlanner(check.robot.limits, parts.plans)
    path = _to_and_fro(q, check.robot.limits)
    plan, slices = planner.plan(path, 0.0, 0.5 * path.breaks[1]), planner.slices
    check.check(0.0, plan, slices, watch.known())
    people, arm = watch.known().people, check.links[0]
    for occupancy in check.occupancies:
        scene = check.scene(slices, people)._replace(occupancies=(occupancy,))
        rows = occupancy.sets[0]
        for i in np.flatnonzero(np.diff(rows["first"])):
            arm["points"][arm["first"][i] : arm["first"][i + 1]] = rows["points"][rows["first"][i], 0]
        check.open_obligations(slices, int(people["n"][0]))
        for criterion in check.criteria:
            criterion.check(scene, check.ledger)


def _to_and_fro(q: Array, limits: JointLimits) -> IntendedTrajectory:
    """Return a motion from ``q`` a little into each joint's range and back, again and again."""
    there = q + _into_range(q, limits)
    return rest_to_rest([there if leg % 2 else q for leg in range(_LEGS + 1)], limits, share=_SHARE)


def _into_range(q: Array, limits: JointLimits) -> Array:
    """Return a small displacement (n,) of every joint towards where it has more room."""
    below, above = q - limits.position_lower, limits.position_upper - q
    displacement: Array = np.where(above >= below, np.minimum(above, _TURN), -np.minimum(below, _TURN))
    return displacement


def _somebody(cell: Cell) -> Array:
    """Return the body points (20, 3) [m] of somebody who stands at the axis of the robot."""
    x, y, z = cell.robot.mount.xyz_m
    place = Place(np.array([x, y]), min(0.0, z), 1.0, 1.0)
    people = ScriptedPeople(build_profile(cell), 1, place, np.random.default_rng(0))
    points: Array = people.points(0.0)[0]
    points[:, :2] += [x, y] - points[:, :2].mean(axis=0)
    return points


def _report(t: float, xyz: Array) -> RawMeasurement:
    who = RawPerson("somebody", xyz, np.full(MAX_POINTS, _ERROR_M), ALL_MEASURED)
    return RawMeasurement(t, t, "world", True, (who,))


def _leave_the_path(limits: JointLimits, plans: PlanSettings, q: Array) -> None:
    """Stop every joint on its own just before a place where no stop along the path is proven."""
    if not plans.allow_joint_space:
        return
    cycle = plans.cycle_s
    velocity = _SHARE * limits.velocity * np.sign(_into_range(q, limits))
    coefficients = np.zeros((2, 6, len(q)))
    coefficients[:, 0] = q, q + 2.01 * cycle * velocity
    coefficients[:, 1] = velocity
    coefficients[1, 3] = _SHARP / 6.0
    path = IntendedTrajectory([0.0, 2.01 * cycle, 10.0], coefficients)
    planner = ShortTermPlanner(limits, replace(plans, silence=None))
    plan = planner.plan(path, 0.0, cycle)
    if plan.stop is StopKind.JOINT_SPACE:
        motion = RunningPlan(path, 0.0)
        motion.take(path, planner, plan)
        motion.motion(1.5 * cycle)
