"""The robot side: a plan that is held is driven to its end, whatever becomes of who sent it."""

from __future__ import annotations

import math
import os
import signal
import time
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest

from failsafe.running_plan import Motion
from robots.errors import SetupError
from tests.verifier.supervised import AWAY_AND_BACK, CYCLE, HOME, LIMITS, scripted
from verifier.command import Cause, Running
from verifier.held_plan import PlanHolder, new_setpoints, setpoints_dtype, write_setpoints
from verifier.mailbox import Mailbox
from verifier.proposal import NewTrajectory
from verifier.verdict import Reason

ROWS, PARTS = 400, 10


def holder(guard: float = 0.001) -> PlanHolder:
    return PlanHolder(HOME, guard, 1e-6, ROWS)


# Bad input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.array([math.nan]), 0.0, 0.0, 9), "q ="),
        ((np.zeros((1, 2)), 0.0, 0.0, 9), "q ="),
        ((np.zeros(2), -0.1, 0.0, 9), "guard_s"),
        ((np.zeros(2), 0.0, math.nan, 9), "jump"),
        ((np.zeros(2), 0.0, 0.0, 1), "rows"),
    ],
)
def test_unusable_holders_are_refused(arguments, message):
    with pytest.raises(SetupError, match=message):
        PlanHolder(*arguments)


def a_plan(number: int = 1, begin: float = 1.0, n: int = 20):
    """From HOME 0.1 rad further, within 19 steps."""
    plan = new_setpoints(ROWS, 2)
    plan["number"], plan["begin"], plan["step"], plan["n"] = number, begin, 0.01, n
    plan["q"][0, :n] = HOME + 0.1 * np.linspace(0.0, 1.0, n)[:, None]
    plan["dq"][0, 1 : n - 1] = 0.1 / 0.19
    return plan


def spoilt(name: str):
    plan = a_plan()
    record = plan[0]
    match name:
        case "late":
            record["begin"] = 0.0005
        case "begin":
            record["begin"] = math.nan
        case "never":
            record["begin"] = math.inf
        case "step":
            record["step"] = math.nan
        case "backwards":
            record["step"] = -0.01
        case "short":
            record["n"] = 1
        case "long":
            record["n"] = ROWS + 1
        case "q":
            record["q"][7, 1] = math.nan
        case "dq":
            record["dq"][7, 1] = math.inf
        case "moving":
            record["dq"][19, 0] = 0.1
        case "jump":
            record["q"][0] += 1e-5
        case "number":
            record["number"] = 0
    return plan


@pytest.mark.parametrize(
    "name",
    ["late", "begin", "never", "step", "backwards", "short", "long", "q", "dq", "moving", "jump", "number"],
)
def test_plans_that_cannot_be_followed_are_refused(name):
    robot = holder()
    assert not robot.offer(spoilt(name), 0.0)
    assert (robot.setpoint(2.0).q == HOME).all() and robot.setpoint(3.0).resting
    assert robot.offer(a_plan(begin=5.0), 4.0)


def test_a_plan_for_another_robot_is_refused():
    assert not holder().offer(new_setpoints(ROWS, 3), 0.0)


def test_a_plan_is_taken_once_and_not_before_the_one_before_it_has_begun():
    robot = holder()
    assert robot.offer(a_plan(1, 1.0), 0.0)
    assert not robot.offer(a_plan(1, 1.0), 0.0)
    assert not robot.offer(a_plan(2, 1.0), 0.0)
    assert robot.number == 1 and (robot.setpoint(0.999).q == HOME).all()
    later = a_plan(2, 3.0)
    later["q"][0, :20] += 0.1
    assert robot.offer(later, 1.5) and robot.number == 2


def test_it_goes_through_the_setpoints_and_rests_at_the_last_one():
    robot = holder()
    assert robot.offer(a_plan(), 0.0)
    plan = a_plan()[0]
    for i in range(20):
        place = robot.setpoint(1.0 + 0.01 * i + 1e-12)
        assert np.allclose(place.q, plan["q"][i], atol=1e-9)
    for t in (1.19 + 1e-9, 5.0, 1e9):
        assert robot.setpoint(t).resting and np.array_equal(robot.setpoint(t).q, plan["q"][19])


# With a supervisor


def test_setpoints_are_the_running_plan(rng):
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    robot, plan = holder(), new_setpoints(ROWS, 2)
    for k in range(300):
        now = 1000.0 + k * CYCLE
        found = Reason.REACHABLE if k > 100 and rng.random() < 0.2 else Reason.SEPARATED
        supervisor.check.reason = lambda found=found: found
        for share in (0.1, 0.6):
            place = robot.setpoint(now + share * CYCLE)
            assert (np.abs(place.dq) <= LIMITS.velocity).all()
        command = supervisor.step(now)
        if command.cause is Cause.ADOPTED:
            if rng.random() < 0.1:
                supervisor.withdraw()  # not handed over: the robot goes on with what it holds
            else:
                assert write_setpoints(supervisor, PARTS, plan)
                plan["number"] = k + 1
                assert plan["begin"][0] == pytest.approx(command.deadline)
                assert robot.offer(plan, now + 0.5 * CYCLE)
        held = supervisor._last
        ahead = np.zeros(2) + robot_at(robot, held.t)
        assert np.abs(ahead - held.q).max() <= 1e-7


def test_the_last_setpoint_rests_however_the_duration_is_rounded():
    """A plan that ends just after a multiple of the step, by less than the quotient of the two shows."""
    plan, step, early = new_setpoints(ROWS, 2), CYCLE / PARTS, 0
    for steps in range(PARTS, 300):
        end = math.nextafter(steps * step, math.inf)
        moving = SimpleNamespace(
            duration_s=end, motion=lambda tau, end=end: Motion(HOME, np.full(2, float(tau < end)), HOME)
        )
        asked = SimpleNamespace(cycle_s=CYCLE, running=Running(moving, 0.0))
        assert write_setpoints(asked, PARTS, plan)
        n = int(plan["n"][0])
        early += (n - 1) * step < end
        assert plan["dq"][0, : n - 2].all() and not plan["dq"][0, n - 1].any()
    assert early > 0, "vacuous: no last step is rounded to before the end"


def robot_at(robot: PlanHolder, t: float) -> np.ndarray:
    """Where the robot will be at ``t`` if nothing newer comes, without telling it that time goes on."""
    from verifier import held_plan

    plan = robot._next if robot._next["n"][0] and t >= robot._next["begin"][0] else robot._held
    return held_plan._at(plan, t).q


def test_after_silence_the_robot_rests_where_the_plan_does():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    robot, plan = holder(), new_setpoints(ROWS, 2)
    for k in range(40):
        supervisor.step(k * CYCLE)
        write_setpoints(supervisor, PARTS, plan)
        plan["number"] = k + 1
        assert robot.offer(plan, k * CYCLE + 0.001)
    s_rest = supervisor.view().s_rest
    path = [robot.setpoint(40 * CYCLE + 0.001 * i) for i in range(1000)]
    assert not path[0].resting and path[-1].resting
    assert np.allclose(path[-1].q, AWAY_AND_BACK.sample(s_rest)[0], atol=1e-9)
    q = np.array([each.q for each in path])
    assert np.abs(np.diff(q, 2, axis=0)).max() <= 1.01 * LIMITS.acceleration.max() * 1e-6
    begin = float(plan["begin"][0])
    assert 40 * CYCLE + 0.001 * [p.resting for p in path].index(True) <= begin + ROWS * CYCLE / PARTS


def test_a_plan_without_room_is_not_handed_over():
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    for k in range(40):
        supervisor.step(k * CYCLE)
    small = new_setpoints(12, 2)
    small["n"] = 5
    assert not write_setpoints(supervisor, PARTS, small) and small["n"][0] == 0
    assert not holder().offer(small, 0.0)


# The mailbox


@pytest.fixture
def mailbox():
    made = Mailbox(f"stopproof-test-{os.getpid()}", setpoints_dtype(ROWS, 2), create=True)
    yield made
    made.close()
    made.unlink()


def test_a_mailbox_hands_over_records_and_receipts(mailbox):
    plan, out = a_plan(7), new_setpoints(ROWS, 2)
    assert not mailbox.get(out)
    mailbox.put(plan)
    assert mailbox.get(out) and out["number"][0] == 7 and mailbox.signed == 0
    mailbox.sign(7)
    assert mailbox.signed == 7


def test_a_record_that_was_left_half_written_is_none(mailbox):
    mailbox.put(a_plan())
    mailbox._counters[0] += 1  # the writer died within a record
    assert not mailbox.get(new_setpoints(ROWS, 2))


def test_names_are_checked(mailbox):
    with pytest.raises(SetupError, match="shared memory"):
        Mailbox(f"stopproof-test-{os.getpid()}", setpoints_dtype(ROWS, 2), create=True)
    with pytest.raises(SetupError, match="shared memory"):
        Mailbox("stopproof-there-is-none", setpoints_dtype(ROWS, 2), create=False)


def write_for_ever(name: str) -> None:
    box, plan = Mailbox(name, setpoints_dtype(ROWS, 2), create=False), new_setpoints(ROWS, 2)
    number = 0
    while True:
        number += 1
        plan["number"] = number
        plan["q"] = number
        box.put(plan)


def test_no_record_is_ever_read_half_written(mailbox):
    """Another process writes as fast as it can, and is killed."""
    writer = get_context("spawn").Process(target=write_for_ever, args=(f"stopproof-test-{os.getpid()}",))
    writer.start()
    out, numbers = new_setpoints(ROWS, 2), []
    until = time.monotonic() + 60.0
    while len(numbers) < 50 and time.monotonic() < until:
        if mailbox.get(out) and int(out["number"][0]) not in numbers[-1:]:
            numbers.append(int(out["number"][0]))
            assert (out["q"] == numbers[-1]).all()
    os.kill(writer.pid, signal.SIGKILL)
    writer.join()
    assert len(numbers) == 50 and numbers == sorted(numbers)
