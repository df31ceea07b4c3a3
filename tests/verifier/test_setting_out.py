"""A robot at rest beside somebody in reach stays at rest, at short cycles too; nobody near, it sets out."""

from __future__ import annotations

import numpy as np
import pytest

from failsafe.plan import PlanOutcome
from failsafe.short_term_plan import ShortTermPlanner
from occupancy.separation import Separation
from robots.kernels import forward
from robots.motion import MAX_JOINTS
from tests.verifier.supervised import PANDA, quintic, report
from verifier.cell import Cell
from verifier.command import Cause, State
from verifier.proposal import NewTrajectory, PathSpeed
from verifier.safety_state import SafetyProbe, look
from verifier.setting_out import LOOK_AHEAD_S
from verifier.setup import GJK_CALLS
from verifier.supervisor import Supervisor
from verifier.verdict import Reason, Status

SHORT = 0.001
HOME = np.array([0.0, -1.2, 1.3, -0.4, 0.3, 0.0])
UR3 = PANDA | {"robot": PANDA["robot"] | {"name": "ur3", "accept_assumed": ["limits"]}}


def run(x: float, steps: int, cycle: float = SHORT) -> tuple[list, Supervisor]:
    """A UR3 that wants to go away, and somebody who stands at ``x`` [m]; reports every 10 ms."""
    supervisor = Supervisor.from_cell(Cell.from_table(UR3 | {"cycle_s": cycle}), HOME)
    way = quintic([HOME, HOME + 1.0], supervisor.check.robot.limits)
    assert supervisor.propose(NewTrajectory(way)) is None
    commands = []
    for k in range(steps):
        t = k * cycle
        seen = [report(t - 0.001, x, arrived=t)] if k % max(1, round(0.01 / cycle)) == 0 else []
        commands.append(supervisor.step(t, seen))
    return commands, supervisor


@pytest.mark.parametrize("x", [3.0, 1.2, 0.9])
def test_plans_of_one_step_share_its_calls_of_the_distance_engine(x, monkeypatch):
    """Whoever is 0.9 m away lets the longer plan be asked for in every step; both share what a step has."""
    begun, most, renew, step = 0, 0, Separation.renew, Supervisor.step

    def counted(self):
        nonlocal begun
        begun += self.gjk_limit
        renew(self)

    def one_step(self, *given):
        nonlocal begun, most
        begun = 0
        command = step(self, *given)
        most = max(most, begun)
        return command

    monkeypatch.setattr(Separation, "renew", counted)
    monkeypatch.setattr(Supervisor, "step", one_step)
    run(x, 100)
    assert (GJK_CALLS if x == 0.9 else 1) <= most <= GJK_CALLS == 8


def test_it_does_not_creep_beside_somebody_in_reach():
    commands, supervisor = run(0.7, 300)
    assert {command.outcome for command in commands} == {State.STOPPED}
    assert all((command.q == HOME).all() and not command.dq.any() for command in commands)
    last = commands[-1]
    assert (last.cause, last.verdict.reason) == (Cause.NOT_VERIFIED, Reason.REACHABLE)
    # alone, the plan that would have been next counts as standing still
    planner = ShortTermPlanner(supervisor.check.robot.limits, supervisor._planner.settings)
    outlook = look(supervisor)
    plan = planner.follow(outlook.trajectory, outlook.begin, outlook.start, 1.0)
    assert plan.outcome is PlanOutcome.READY
    answer = supervisor.check.check(outlook.now, plan, planner.slices, outlook.known)
    assert answer.reason is Reason.AT_REST


@pytest.mark.parametrize("cycle", [SHORT, 0.004, 0.02])
def test_nobody_near_it_sets_out_at_once_and_arrives(cycle):
    commands, _ = run(5.0, round(1.0 / cycle), cycle)
    assert commands[0].cause is Cause.ADOPTED
    assert {command.verdict.status for command in commands} == {Status.VERIFIED}
    assert np.abs(commands[-1].q - HOME).max() > 0.05


@pytest.mark.parametrize("cycle", [SHORT, 0.002])
def test_who_comes_while_it_moves_sees_it_come_to_rest(cycle):
    """The end of a stop is below the standstill speed: it is not turned into a start again and again."""
    table = UR3 | {"cycle_s": cycle, "check": {"standstill_speed_m_s": 0.01}}
    supervisor = Supervisor.from_cell(Cell.from_table(table), HOME)
    way = quintic([HOME, HOME + 1.0], supervisor.check.robot.limits, load=0.15)
    assert supervisor.propose(NewTrajectory(way)) is None
    commands = []
    for k in range(round(1.3 / cycle)):
        t = k * cycle
        seen = [report(t - 0.001, max(0.5, 2.2 - 1.6 * t), arrived=t)]
        commands.append(supervisor.step(t, seen if k % round(0.01 / cycle) == 0 else []))
    assert State.EXECUTING in {command.outcome for command in commands}
    last = commands[-round(0.2 / cycle) :]
    assert {command.outcome for command in last} == {State.STOPPED}
    assert {command.verdict.reason for command in last} == {Reason.REACHABLE}
    assert np.abs(last[-1].q - way.sample(way.s_end)[0]).max() > 0.1


def lowest(robot, q: np.ndarray) -> float:
    """Height [m] of the lowest point of the capsules beyond the upper arm."""
    rotation, position = np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3))
    forward(robot.kinematics, np.append(q, np.zeros(MAX_JOINTS - len(q))), rotation, position)
    arm, heights = robot.enclosure[0], []
    for link in range(2, int(arm["n"])):
        joint = arm["joint"][link]
        ends = [(rotation[joint] @ arm[end][link] + position[joint])[2] for end in ("a", "b")]
        heights.append(min(ends) - arm["radius"][link])
    return min(heights)


@pytest.mark.parametrize(
    "nobody",
    [False, pytest.param(True, marks=pytest.mark.rarely("the same with somebody far away"))],
    ids=["somebody far away", "nobody"],
)
@pytest.mark.parametrize(
    ("cycle", "standstill", "speed"), [(0.05, 0.05, 0.03), (0.01, 0.05, 0.03), (0.2, 0.05, 0.03)]
)
def test_a_way_that_is_followed_slowly_does_not_lead_through_the_floor(cycle, standstill, speed, nobody):
    """Every plan counts as standing still; all of them are the way that is refused at its own speed."""
    floor = {"floor_z_m": 0.02, "floor_may_touch": ["shoulder_link", "upper_arm_link"]}
    table = UR3 | {"cycle_s": cycle, "check": {"standstill_speed_m_s": standstill}, "workspace": floor}
    supervisor = Supervisor.from_cell(Cell.from_table(table), HOME)
    robot = supervisor.check.robot
    way = quintic([HOME, HOME + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])], robot.limits, load=0.3)
    assert lowest(robot, way.sample(way.s_end)[0]) < 0.0
    supervisor.propose(NewTrajectory(way))
    supervisor.propose(PathSpeed(speed))
    seen = set()
    for k in range(round(1.2 * way.s_end / speed / cycle)):
        t = k * cycle
        told = report(t - 0.001, 6.0, arrived=t)
        command = supervisor.step(t, [told._replace(people=()) if nobody else told])
        seen.add(command.verdict.reason)
        assert lowest(robot, command.q) > 0.02
    assert (Reason.NOBODY_REPORTED if nobody else Reason.SEPARATED) in seen
    assert np.abs(command.q - HOME).max() > 0.05, "it goes as far as it may"
    assert (command.outcome, command.verdict.reason) == (State.STOPPED, Reason.FIXTURE_IN_REACH)


@pytest.mark.parametrize("cycle", [0.004, 0.02])
def test_a_slow_link_of_an_arm_that_is_faster_elsewhere_does_not_go_through_the_floor(cycle):
    """The last link turns at more than the standstill speed; the forearm comes down below it."""
    floor = {"floor_z_m": 0.02, "floor_may_touch": ["shoulder_link", "upper_arm_link"]}
    table = UR3 | {"cycle_s": cycle, "check": {"standstill_speed_m_s": 0.05}, "workspace": floor}
    start = HOME + np.array([0.0, 0.75, 0.0, np.pi, 0.0, 0.0])
    supervisor = Supervisor.from_cell(Cell.from_table(table), start)
    robot = supervisor.check.robot
    way = quintic([start, start + np.array([0.0, 0.25, 0.0, 0.0, 3.0, 0.0])], robot.limits, load=0.3)
    assert lowest(robot, way.sample(way.s_end)[0]) < 0.0 and lowest(robot, start) > 0.03
    supervisor.propose(NewTrajectory(way))
    supervisor.propose(PathSpeed(0.3))
    by_speed = set()
    for k in range(round(1.2 * way.s_end / 0.3 / cycle)):
        t = k * cycle
        command = supervisor.step(t, [report(t - 0.001, 6.0, arrived=t)])
        assert lowest(robot, command.q) > 0.02
        outlook = look(supervisor)
        plan = supervisor._planner.follow(outlook.trajectory, outlook.begin, outlook.start, 0.3)
        answer = supervisor.check.check(outlook.now, plan, supervisor._planner.slices, outlook.known)
        by_speed.add((answer.reason, supervisor.check.at_rest))
    assert (command.outcome, command.verdict.reason) == (State.STOPPED, Reason.FIXTURE_IN_REACH)
    assert by_speed >= {(Reason.SEPARATED, False)}, "in some plans the last link counts as moving"


@pytest.mark.parametrize(("jerk", "standstill", "cycle"), [(10.0, 0.05, 0.01), (5.0, 0.02, 0.004)])
def test_an_arm_that_starts_gently_does_not_go_on_in_bursts(jerk, standstill, cycle):
    """All of a tenth of a second is below the standstill speed."""
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    limits = {f"{joint}_joint": {"jerk_rad_s3": jerk} for joint in joints}
    robot = UR3["robot"] | {"limits": limits}
    table = UR3 | {"cycle_s": cycle, "robot": robot, "check": {"standstill_speed_m_s": standstill}}
    supervisor = Supervisor.from_cell(Cell.from_table(table), HOME)
    way = quintic([HOME, HOME + np.array([1.0, 0.3, 0.0, 0.0, 0.0, 0.0])], supervisor.check.robot.limits)
    assert supervisor.propose(NewTrajectory(way)) is None
    for k in range(round(2.0 / cycle)):
        command = supervisor.step(k * cycle, [report(k * cycle - 0.001, 0.6, arrived=k * cycle)])
        assert command.outcome is State.STOPPED and (command.q == HOME).all()
    assert command.verdict.reason is Reason.REACHABLE


@pytest.mark.parametrize(
    ("x", "joint", "moving"),
    [
        (0.6, 0, Reason.REACHABLE),
        (0.6, 5, Reason.REACHABLE),
        (5.0, 0, Reason.SEPARATED),
        (-0.62, 5, Reason.SEPARATED),
    ],
)
def test_links_that_a_plan_moves_count_as_moving_and_no_others(x, joint, moving):
    """Below the standstill speed; with the last joint the wrist moves, not the links beside somebody."""
    _, supervisor = run(x, 1, 0.01)
    check, limits = supervisor.check, supervisor.check.robot.limits
    way = np.zeros(6)
    way[joint] = 1e-4
    planner = ShortTermPlanner(limits, supervisor._planner.settings)
    path = quintic([HOME, HOME + way], limits, load=0.5)
    plan, known = planner.plan(path, 0.01, 0.5 * path.s_end, 0.02), supervisor.watch.known()
    assert plan.outcome is PlanOutcome.READY
    assert check.check(0.01, plan, planner.slices, known).reason is Reason.AT_REST
    assert check.check_moving(0.01, plan, planner.slices, known).reason is moving
    assert check.check(0.01, plan, planner.slices, known).reason is Reason.AT_REST


def test_it_sets_out_when_they_have_gone():
    commands, supervisor = run(0.7, 60)
    assert commands[-1].outcome is State.STOPPED
    later = [
        supervisor.step(
            k * SHORT, [report(k * SHORT - 0.001, 0.7 + 1.9 * (k - 60) * SHORT, arrived=k * SHORT)]
        )
        for k in range(60, 2_500)
    ]
    assert State.EXECUTING in {command.outcome for command in later}


def test_safety_state_and_step_agree_about_setting_out():
    for x in (0.7, 5.0):
        _, supervisor = run(x, 50)
        probe = SafetyProbe.from_cell(Cell.from_table(UR3 | {"cycle_s": SHORT}), robot=supervisor.check.robot)
        state = probe.state(look(supervisor))
        answer = supervisor.step(50 * SHORT).verdict
        assert state.verdict.reason is answer.reason
        assert state.verdict.gap_m == pytest.approx(answer.gap_m, nan_ok=True)
        if x < 1.0:
            assert state.allowed_path_speed < 0.5 and np.isnan(state.tolerable_latency_s)
            assert state.nearest is not None and state.refused is not None
    assert SHORT < LOOK_AHEAD_S
