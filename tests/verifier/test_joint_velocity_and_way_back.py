"""Joint velocities and path speeds of any sign, proposed to a supervisor."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from failsafe.preparation import Objection
from tests.verifier.supervised import (
    AWAY,
    AWAY_AND_BACK,
    CYCLE,
    HOME,
    LIMITS,
    panda,
    panda_supervisor,
    report,
    scripted,
    steps,
)
from tests.verifier.test_supervisor import branch, moving, on_path, verified
from verifier.command import Cause, Command, State
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Stop
from verifier.supervisor import Supervisor

NAN = math.nan


def one_curve(commands: list[Command], limits=LIMITS) -> None:
    """Trapezoid rule: with a jerk of at most J the error is at most J h³/12 in q and J h²/4 in dq."""
    for a, b in itertools.pairwise(commands):
        h = b.t - a.t
        assert h == pytest.approx(CYCLE, abs=1e-6)
        assert (np.abs(b.dq) <= limits.velocity * (1.0 + 1e-9)).all()
        assert (np.abs(b.ddq) <= limits.acceleration * (1.0 + 1e-9)).all()
        assert (np.abs(b.q - a.q - h * (a.dq + b.dq) / 2) <= limits.jerk * h**3 / 12 + 1e-6).all()
        assert (np.abs(b.dq - a.dq - h * (a.ddq + b.ddq) / 2) <= limits.jerk * h**2 / 4 + 1e-4).all()


# Bad input


@pytest.mark.parametrize(
    ("dq", "horizon", "objection"),
    [
        (np.array([NAN, 0.0]), 0.1, Objection.NOT_A_NUMBER),
        (np.array([0.0, math.inf]), 0.1, Objection.NOT_A_NUMBER),
        (np.zeros(3), 0.1, Objection.OTHER_JOINTS),
        (np.zeros((2, 1)), 0.1, Objection.OTHER_JOINTS),
        (0.0, 0.1, Objection.OTHER_JOINTS),
        ("fast", 0.1, Objection.NOT_A_NUMBER),
        (None, 0.1, Objection.OTHER_JOINTS),
        (np.zeros(2), -0.001, Objection.NOT_A_NUMBER),
        (np.zeros(2), NAN, Objection.NOT_A_NUMBER),
        (np.zeros(2), math.inf, Objection.NOT_A_NUMBER),
        (np.array([0.0, -3.001]), 0.1, Objection.BEYOND_LIMITS),
    ],
)
@pytest.mark.parametrize("going", [False, True])
def test_what_is_no_joint_velocity_is_refused(dq, horizon, objection, going):
    supervisor = moving() if going else scripted()
    refusal = supervisor.propose(JointVelocity(dq, horizon))
    assert refusal.objection is objection and refusal.text
    assert steps(supervisor, 1, first=30)[0].outcome is (State.EXECUTING if going else State.STOPPED)


def test_a_velocity_beyond_the_limits_says_what_share_of_it_would_not_be():
    refusal = scripted().propose(JointVelocity(np.array([0.0, -4.0]), 0.1))
    assert refusal.joint == 1 and refusal.path_speed == pytest.approx(0.75)


# Joint velocities


def test_from_standstill_to_a_velocity_and_to_rest_when_nothing_follows():
    supervisor = scripted()
    assert supervisor.propose(JointVelocity(np.array([0.4, -0.8]), 0.5)) is None
    commands = steps(supervisor, 120)
    one_curve(commands)
    assert np.allclose(commands[30].dq, [0.4, -0.8], atol=1e-9)
    assert commands[-1].outcome is State.STOPPED and not commands[-1].dq.any()
    # about horizon times velocity: ramps up and down take as long as each other
    assert commands[-1].q - HOME == pytest.approx(np.array([0.4, -0.8]) * 0.5, rel=0.03)


def test_from_a_motion_to_a_velocity_after_the_running_stop():
    supervisor = moving()
    stop = supervisor.plan.stop_time_s
    before = supervisor.view()
    assert supervisor.propose(JointVelocity(np.array([-0.5, 0.5]), 0.6)) is None
    commands = steps(supervisor, 200, first=30)
    one_curve(commands)
    reached = next(i for i, c in enumerate(commands) if np.allclose(c.dq, [-0.5, 0.5], atol=1e-6))
    change = float((np.abs(before.dq - [-0.5, 0.5]) / LIMITS.acceleration).max())
    assert (reached - 4) * CYCLE <= stop + 2.0 * change + 0.1
    assert supervisor.refusal is None and {c.cause for c in commands[:40]} == {Cause.ADOPTED}
    assert commands[-1].outcome is State.STOPPED


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("late", [0, 1, 3])
def test_a_stream_is_followed_and_the_robot_rests_when_it_ceases(every, late):
    """50 and 100 Hz, looked at for some cycles before it is handed over; the delay is about a stop."""
    supervisor, wanted, commands, refusals = scripted(), [], [], 0
    prepare = supervisor._proposals._look_at

    def slow(*args, **more):
        for _ in range(late):
            one_cycle()
        return prepare(*args, **more)

    supervisor._proposals._look_at = slow

    def one_cycle() -> None:
        nonlocal refusals
        k = len(commands)
        wanted.append(0.3 * np.array([math.sin(2.0 * k * CYCLE), math.cos(3.0 * k * CYCLE)]))
        commands.append(supervisor.step(k * CYCLE))
        refusals += supervisor.refusal is not None and k > 20

    one_cycle()
    while len(commands) < 400:
        supervisor.propose(JointVelocity(wanted[-1], 0.1))
        for _ in range(max(1, every - late)):
            one_cycle()
    one_curve(commands)
    assert refusals == 0
    lag = min(
        range(60),
        key=lambda d: np.abs(followed(commands)[200:] - np.array(wanted)[200 - d : -d or None]).sum(),
    )
    off = followed(commands)[200:] - np.array(wanted)[200 - lag : -lag or None]
    assert lag <= 8 + 2 * late and np.abs(off).max() <= 0.3 * 3.0 * CYCLE * (2 + every + late)
    while len(commands) < 440:
        one_cycle()
    assert commands[-1].outcome is State.STOPPED and not commands[-1].dq.any()
    assert supervisor._running.trajectory.spans <= 120, "what lies behind is let go"


def followed(commands: list[Command]) -> np.ndarray:
    return np.array([command.dq for command in commands])


def test_the_later_of_two_velocities_counts():
    supervisor = moving()
    supervisor.propose(JointVelocity(np.array([-0.5, 0.5]), 0.6))
    supervisor.propose(JointVelocity(np.array([0.2, 0.1]), 0.6))
    commands = steps(supervisor, 80, first=30)
    one_curve(commands)
    assert any(np.allclose(c.dq, [0.2, 0.1], atol=1e-9) for c in commands)
    assert not any(np.allclose(c.dq, [-0.5, 0.5], atol=1e-3) for c in commands)


def test_a_velocity_that_waits_for_one_that_waits_is_taken_either_way():
    """Prepared while an earlier one waits: it fits whether or not the step takes the earlier one first."""
    for taken in (False, True):
        supervisor = moving()
        supervisor.propose(JointVelocity(np.array([-0.2, 0.5]), 0.6))
        look = supervisor._proposals._look_at

        def meanwhile(*args, _of=supervisor, _taken=taken, _look=look, **more):
            if _taken:
                _of.step(30 * CYCLE)
            return _look(*args, **more)

        supervisor._proposals._look_at = meanwhile
        assert supervisor.propose(JointVelocity(np.array([0.3, 0.3]), 0.6)) is None
        commands = steps(supervisor, 60, first=31 if taken else 30)
        assert supervisor.refusal is None
        one_curve(commands)
        assert any(np.allclose(c.dq, [0.3, 0.3], atol=1e-9) for c in commands)


def test_what_was_prepared_for_a_later_place_is_outdated():
    supervisor = moving()
    supervisor.propose(JointVelocity(np.array([-0.2, 0.5]), 0.6))
    (waiting,) = supervisor._proposals._trajectories
    beyond = waiting.trajectory.since(waiting.trajectory.s_end)
    supervisor._proposals._trajectories.append(waiting._replace(trajectory=beyond))
    assert steps(supervisor, 1, first=30)[0].cause is Cause.ADOPTED
    assert supervisor.refusal.objection is Objection.OUTDATED


def test_position_limits_are_kept_by_braking_in_time():
    supervisor = scripted()
    supervisor.propose(JointVelocity(np.array([2.0, -0.1]), 20.0))
    commands = steps(supervisor, 300)
    one_curve(commands)
    assert max(c.q[0] for c in commands) <= LIMITS.position_upper[0]
    assert commands[-1].q[0] == pytest.approx(LIMITS.position_upper[0], abs=1e-4)
    assert commands[-1].dq[1] == pytest.approx(-0.1)


def test_a_velocity_that_is_not_verified_any_more_stops_on_the_path():
    supervisor = scripted()
    supervisor.propose(JointVelocity(np.array([0.4, -0.8]), 1.0))
    steps(supervisor, 30)
    supervisor.check.reason = verified(False)
    commands = steps(supervisor, 60, first=30)
    assert commands[-1].outcome is State.STOPPED
    supervisor.propose(JointVelocity(np.array([-0.4, 0.8]), 1.0))
    supervisor.check.reason = verified(True)
    again = steps(supervisor, 40, first=90)
    one_curve([*commands, *again])
    assert np.allclose(again[-1].dq, [-0.4, 0.8], atol=1e-9)


def test_a_real_arm_is_guided():
    supervisor, limits = panda_supervisor(), panda()[0].robot.limits
    commands = []
    for k in range(150):
        now = k * CYCLE
        if k < 100:
            dq = 0.3 * np.sin(1.3 * now + np.arange(7.0))
            supervisor.propose(JointVelocity(dq, 0.1))
        commands.append(supervisor.step(now, [report(now - 0.02, 3.0, arrived=now)] if k % 2 == 0 else []))
        assert supervisor.fault is None
    one_curve(commands, limits)
    assert sum(c.outcome is State.EXECUTING for c in commands) > 90
    assert commands[-1].outcome is State.STOPPED


# Back along the path


def test_a_negative_path_speed_stops_first_and_goes_back_along_the_path():
    supervisor = moving()
    there = steps(supervisor, 30, first=30)
    assert supervisor.propose(PathSpeed(-0.5)) is None
    back = steps(supervisor, 400, first=60)
    one_curve([*there, *back])
    on_path([*there, *back])
    rest = next(i for i, c in enumerate(back) if c.outcome is State.STOPPED)
    assert rest <= 40 and back[rest + 5].outcome is State.RECOVERING
    speeds = [float(c.dq[0]) for c in back[rest:]]
    assert max(speeds) <= 0.0 and min(speeds) < -0.1
    assert back[-1].outcome is State.STOPPED and np.allclose(back[-1].q, HOME, atol=1e-9)


def test_there_is_no_way_back_from_where_nothing_began():
    supervisor = scripted()
    assert supervisor.propose(PathSpeed(-0.5)) is None
    assert {(c.outcome, c.cause) for c in steps(supervisor, 5)} == {(State.STOPPED, Cause.RESTING)}


def test_back_and_forth():
    supervisor = moving()
    commands = steps(supervisor, 20, first=30)
    for sdot in (-1.0, 0.7, -0.3, -0.6, 1.0):
        assert supervisor.propose(PathSpeed(sdot)) is None
        commands += steps(supervisor, 40, first=30 + len(commands))
        assert supervisor.refusal is None
        assert supervisor.view().sdot == pytest.approx(abs(sdot), abs=1e-9)
    one_curve(commands)
    on_path(commands)


def test_from_the_end_of_the_path_back_to_its_begin_and_forward_again():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY))
    commands = steps(supervisor, 300)
    for sdot, end in ((-1.0, HOME), (1.0, HOME + np.array([1.5, 1.0])), (-1.0, HOME)):
        assert supervisor.propose(PathSpeed(sdot)) is None
        commands += steps(supervisor, 300, first=len(commands))
        assert np.allclose(commands[-1].q, end, atol=1e-9) and commands[-1].outcome is State.STOPPED
    one_curve(commands)
    on_path(commands)


def test_a_path_that_begins_in_motion_goes_back_to_a_rest_before_its_begin():
    supervisor = scripted()
    q, v, a, _ = AWAY_AND_BACK.sample(0.3)
    part = AWAY_AND_BACK.since(0.0)
    supervisor.propose(NewTrajectory(part))
    steps(supervisor, 30)
    join = supervisor.view().s_rest + 0.05
    assert supervisor.propose(JointVelocity(np.array([0.3, 0.3]), 0.5)) is None
    commands = steps(supervisor, 60, first=30)
    assert supervisor.propose(PathSpeed(-1.0)) is None
    commands += steps(supervisor, 300, first=90)
    one_curve(commands)
    assert commands[-1].outcome is State.STOPPED and join > 0.0
    assert np.isfinite([q, v, a]).all()


def test_a_stop_on_the_way_back_is_a_stop_and_a_trajectory_ends_it():
    supervisor = moving()
    steps(supervisor, 20, first=30)
    supervisor.propose(PathSpeed(-1.0))
    commands = steps(supervisor, 40, first=50)
    supervisor.propose(Stop())
    commands += steps(supervisor, 40, first=90)
    assert commands[-1].outcome is State.STOPPED
    supervisor.propose(PathSpeed(-1.0))
    commands += steps(supervisor, 10, first=130)
    join = supervisor.view().s_rest + 0.05
    new = branch(supervisor._running.trajectory, join)
    assert supervisor.propose(NewTrajectory(new, join)) is None
    commands += steps(supervisor, 300, first=140)
    one_curve(commands)
    assert supervisor.refusal is None
    assert np.allclose(commands[-1].q, new.sample(new.s_end)[0], atol=1e-9)


def test_a_way_back_along_another_trajectory_is_outdated():
    supervisor = moving()
    supervisor.propose(PathSpeed(-1.0))
    join = supervisor.view().s_rest + 0.3
    supervisor.propose(NewTrajectory(branch(AWAY_AND_BACK, join), join))
    commands = steps(supervisor, 60, first=30)
    assert supervisor.refusal.objection is Objection.OUTDATED
    assert commands[-1].outcome is State.STOPPED
    assert supervisor.propose(PathSpeed(-1.0)) is None
    commands += steps(supervisor, 60, first=90)
    one_curve(commands)
    assert State.EXECUTING in {c.outcome for c in commands[61:]}


def test_path_speeds_above_one_are_refused_where_the_limits_do_not_allow_them():
    supervisor = scripted()
    slow = AWAY_AND_BACK.stretched(2.0)
    supervisor.propose(NewTrajectory(slow))
    commands = steps(supervisor, 30)
    refusal = supervisor.propose(PathSpeed(4.0))
    assert refusal.objection is Objection.BEYOND_LIMITS and 1.9 < refusal.path_speed < 4.0
    assert supervisor.propose(PathSpeed(1.9)) is None
    commands += steps(supervisor, 60, first=30)
    assert supervisor.view().sdot == pytest.approx(1.9)
    refusal = supervisor.propose(PathSpeed(-4.0))
    assert refusal.objection is Objection.BEYOND_LIMITS
    assert supervisor.propose(PathSpeed(-1.9)) is None
    commands += steps(supervisor, 200, first=90)
    one_curve(commands)
    on_path(commands)
    assert np.allclose(commands[-1].q, HOME, atol=1e-9)


def test_what_is_withdrawn_on_the_way_round_is_not_adopted():
    supervisor: Supervisor = moving()
    supervisor.propose(PathSpeed(-1.0))
    commands, k = [], 30
    while k < 200:
        command = supervisor.step(k * CYCLE)
        if k % 7 == 0:
            command = supervisor.withdraw()
        commands.append(command)
        k += 1
    one_curve(commands)
    on_path(commands)
