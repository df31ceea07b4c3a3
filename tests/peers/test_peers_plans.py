"""Wrong turns that concern plans and stops; the numbers are those of docs/wrong_turns.md."""

from __future__ import annotations

import numpy as np
import pytest

from failsafe.manoeuvre import PathManoeuvre
from failsafe.plan import (
    PlanOutcome,
    PlanResult,
    PlanSettings,
    StopKind,
)
from failsafe.scaling import PathState
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from occupancy.separation import Separation
from occupancy.workspace import Workspace, capsule
from robots.motion import new_slices
from tests.failsafe.motions import executed, path_of, random_cases
from tests.oracles.arms import arm as oracle_arm
from tests.verifier.fault_rig import Moment, Rig, parts_of
from tests.verifier.supervised import PANDA_HOME, quintic, report
from verifier.command import Cause, State
from verifier.criteria import SeparationCriterion, WorkspaceCriterion
from verifier.cycle import CycleCheck, Known
from verifier.proposal import NewTrajectory
from verifier.verdict import Reason, Status


def known_far_away() -> Known:
    rig = Rig()
    rig.supervisor.watch.admit(report(1.0, 4.0), 1.0)
    return rig.supervisor.watch.known()


def test_peer_07_a_plan_without_slices_is_not_verified():
    """No time, no interval, nothing that fails: verified, and the last interval has the index -1."""
    parts, _ = parts_of(False)
    settings = parts.plans
    planner = ShortTermPlanner(parts.check.robot.limits, settings)
    path = quintic([PANDA_HOME, PANDA_HOME + 0.3], parts.check.robot.limits)
    plan = planner.plan(path, 1.0, 0.5)
    assert parts.check.check(1.0, plan, planner.slices, known_far_away()).status is Status.VERIFIED
    for n in (0, -1):
        planner.slices["n"] = n
        answer = parts.check.check(1.0, plan, planner.slices, known_far_away())
        assert answer.status is Status.NOT_VERIFIED and answer.reason is Reason.EMPTY_PLAN
    ready = PlanResult(PlanOutcome.READY, stop_time_s=0.0)
    empty = new_slices()
    empty["n_joints"] = 7
    assert parts.check.check(1.0, ready, empty, known_far_away()).reason is Reason.EMPTY_PLAN
    resting = planner.follow(path, 1.0, PathState(path.s_end, 0.0, 0.0), 0.0)
    assert resting.outcome is PlanOutcome.READY and planner.slices["n"][0] > 0
    assert planner.slices["t"][0, planner.slices["n"][0]] >= 1.0 + settings.cycle_s - 1e-12


def test_peer_08_the_intended_piece_is_checked():
    """Only the stop is checked: what stands in the way of the piece before it is driven into.

    A post stands where the flange passes in the piece, far from where the stop begins. The place comes from
    the kinematics of the tests.
    """
    parts, _ = parts_of(False)
    robot = parts.check.robot
    turn = np.zeros(7)
    turn[0] = 2.0
    settings = PlanSettings(1.2, (0.0, 0.0), np.zeros(7), np.zeros(7), slice_s=0.05, allow_joint_space=False)
    planner = ShortTermPlanner(robot.limits, settings)
    path = quintic([PANDA_HOME - 0.5 * turn, PANDA_HOME + 0.5 * turn], robot.limits, 0.5)
    s = 0.5 * path.s_end - 0.6
    plan = planner.plan(path, 1.0, s)
    assert plan.outcome is PlanOutcome.READY and plan.stop is StopKind.PATH_CONSISTENT
    slices = planner.slices
    n = int(slices["n"][0])
    assert slices["t"][0, 0] == 1.0 and (np.diff(slices["t"][0, : n + 1]) > 0.0).all()
    q_middle = path.sample(0.5 * path.s_end)[0]
    hand = flange(q_middle)
    stop_begin = flange(path.sample(s + 1.2)[0])
    assert np.linalg.norm(hand - stop_begin) > 0.3
    up, aside = np.array([0.0, 0.0, 0.3]), np.array([5.0, 0.0, 0.0])
    post = capsule("post", hand, hand + up, 0.02, 0.0)
    away = capsule("post", hand + aside, hand + aside + up, 0.02, 0.0)
    for fixture, expected in ((post, Reason.FIXTURE_IN_REACH), (away, Reason.SEPARATED)):
        criterion = WorkspaceCriterion(Workspace((fixture,), robot.links, {}, 1e-4), 1e-4)
        check = CycleCheck(
            robot,
            [each.model for each in parts.check.occupancies],
            [SeparationCriterion(Separation(1e-4), 1e-4)],
            parts.check.settings,
            [criterion],
        )
        assert check.check(1.0, plan, slices, known_far_away()).reason is expected


def flange(q: np.ndarray) -> np.ndarray:
    arm = oracle_arm("panda")
    place: np.ndarray = arm.poses(np.asarray(q)[None])[1][arm.links.index("panda_hand"), 0]
    return place


def branch(old: IntendedTrajectory, s: float, goal: np.ndarray) -> IntendedTrajectory:
    """From where ``old`` is at ``s``, with its q, q', q'', to rest in ``goal`` (n,)."""
    q, v, a, _ = old.sample(s)
    T = 3.0
    rows = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
    right = np.stack([goal - q - v * T - a * T**2 / 2, -v - a * T, -a])
    c = np.concatenate([np.stack([q, v, a / 2]), np.linalg.solve(rows, right)])
    return IntendedTrajectory([0.0, T], c[None], "rest")


def test_peer_09_replanning_in_motion_does_not_jump(seed):
    """The new path begins where the arm is, but not as fast: the jump is hidden by clamping the output."""
    rng = np.random.default_rng(seed)
    rig = Rig()
    rig.until(State.EXECUTING)
    joined = 0
    for _ in range(30):
        rig.steps(int(rng.integers(3, 25)))
        old, view = rig.supervisor._running.trajectory, rig.supervisor.view()
        join = min(view.s_rest + rng.uniform(0.03, 0.2), old.s_end)
        whole = branch(old, join, PANDA_HOME + rng.uniform(-0.4, 0.4, 7))
        if rig.supervisor.propose(NewTrajectory(whole, join)) is not None:
            continue
        # not smooth where it joins: refused at once
        shifted = IntendedTrajectory(
            whole.breaks, whole.coefficients + 1e-4 * np.eye(6)[1][None, :, None], "cut"
        )
        assert rig.supervisor.propose(NewTrajectory(shifted, join)) is not None
        rig.steps(1)
        joined += rig.supervisor.refusal is None
    assert joined >= 5
    rig.steps(60)
    rig.robot.moved_within(rig.limits)


@pytest.mark.parametrize("kind", ["curved", "accelerated", "near_limits", "rough"])
def test_peer_10_stops_keep_the_limits(kind, rng, count):
    """The stop brakes on each axis by a law of its own: 2.5 times the jerk, 1.4 times the acceleration."""
    found = 0
    for case in random_cases(rng, kind, count(2_000)):
        n = len(case.limits.joints)
        planner = ShortTermPlanner(
            case.limits, PlanSettings(0.004, (0.0, 0.0), np.zeros(n), np.zeros(n), allow_joint_space=False)
        )
        plan = planner.plan(case.motion.trajectory, 0.0, *case.state)
        if plan.outcome is not PlanOutcome.READY:
            continue
        found += 1
        record = planner.path[0]
        tau = np.linspace(0.0, float(record["t"][record["n"]]), 200)
        for name, value in zip(
            ("velocity", "acceleration", "jerk"), executed(case.motion, record, tau)[1:], strict=True
        ):
            assert (np.abs(value) <= getattr(case.limits, name) * (1.0 + 1e-9) + 1e-9).all(), name
    assert found > 0


def test_peer_10_stops_of_the_loop_keep_the_limits_on_the_robot_side(seed):
    """Measured on what the robot does, by differences, with stops that begin and are left at random."""
    rng = np.random.default_rng(seed)
    rig = Rig()
    rig.until(State.EXECUTING)
    for _ in range(400):
        if rng.random() < 0.1:
            rig.recorder.refuse = rng.random() < 0.5
        rig.step()
    rig.robot.moved_within(rig.limits)


@pytest.mark.parametrize("moment", [Moment.EXECUTING, Moment.RECOVERING], ids=lambda m: m.name)
def test_peer_17_an_exception_is_named_and_what_was_moving_stops(moment):
    """One handler for everything logs a line and gives out the motion that was there: nobody can know."""
    rig = Rig()
    rig.go_to(moment, 5)
    rig.recorder.fail = True
    commands = rig.steps(60)
    assert {command.cause for command in commands} == {Cause.FAULT}
    assert {command.verdict.status for command in commands} == {Status.NOT_CHECKED}
    assert {command.verdict.reason for command in commands} == {Reason.FAULT}
    assert isinstance(rig.supervisor.fault, RuntimeError)
    speeds = [float(np.abs(command.dq).max()) for command in commands]
    assert commands[-1].outcome is State.STOPPED and speeds[-1] == 0.0
    assert rig.robot.rests


@pytest.mark.parametrize(
    ("sdot", "sddot"), [(0.9, 4.0), (1.0, 30.0), (1.0, -30.0), (0.05, 0.0), (0.4, -3.0), (1.0, 1e3)]
)
def test_peer_21_a_stop_is_never_faster_than_what_it_begins_with(sdot, sddot):
    """Asked to stop from a state that it cannot handle, a generator of profiles answers with 14 m/s."""
    parts, _ = parts_of(False)
    limits = parts.check.robot.limits
    far = quintic([PANDA_HOME, PANDA_HOME + np.array([1.2, 0.4, -0.3, 0.4, 0.4, 0.3, 0.5])], limits)
    planner = ShortTermPlanner(limits, parts.plans)
    for s in np.linspace(0.05, 0.9, 12) * far.s_end:
        plan = planner.plan(far, 0.0, s, sdot, sddot)
        if plan.outcome is not PlanOutcome.READY:
            assert plan.outcome in (
                PlanOutcome.NO_STOP, PlanOutcome.STATE_BEYOND_LIMITS, PlanOutcome.INVALID_STATE
            )  # fmt: skip
            assert planner.slices["n"][0] == 0
            continue
        record = planner.path[0]
        tau = np.linspace(0.0, float(record["t"][record["n"]]), 400)
        _, v, _, _ = path_of(record, tau)
        begin = sdot + sddot * parts.plans.cycle_s
        most = max(sdot, begin + max(0.0, sddot) ** 2 / (2.0 * plan.j_s))
        assert (v >= -1e-9).all() and (v <= most + 1e-9).all() and v[-1] <= 1e-9
        q = far.sample(path_of(record, tau)[0])
        assert (np.abs(q[1] * v[:, None]) <= limits.velocity * (1.0 + 1e-9)).all()


@pytest.mark.parametrize(
    ("sdot", "sddot", "a_s", "j_s"), [(0.9, 6.5, 5.0, 40.0), (0.2, -4.0, 5.0, 20.0), (0.9, 0.0, 8.0, 40.0)]
)
def test_peer_21_what_a_generator_answers_is_integrated_before_it_is_taken(sdot, sddot, a_s, j_s):
    """The first two answers of the generator overshoot and run backwards; the last one is sound."""
    limits = parts_of(False)[0].check.robot.limits
    path = quintic([PANDA_HOME, PANDA_HOME + 0.1], limits, 0.05)
    stop = PathManoeuvre(limits, steps=12, step_s=0.01, positions=True)
    s = 0.5 * path.s_end
    taken = stop.candidate(path, 0, PathState(s, sdot, sddot), 0.0, a_s, j_s)
    assert taken is (sddot == 0.0)
    if taken:
        record = stop.path[0]
        _, v, _, _ = path_of(record, np.linspace(0.0, float(record["t"][record["n"]]), 400))
        assert (v >= -1e-9).all() and (v <= sdot + 1e-9).all() and abs(v[-1]) <= 1e-9
