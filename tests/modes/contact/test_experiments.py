"""The paper's experiments on the twin: what is expected comes to pass, and not where something is off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from modes.contact.admittance import Admittance, CyclicTask
from modes.contact.course import Course, Loop
from modes.contact.detection import TABLE_1, ForceThresholds, Residual
from modes.contact.experiments import (
    BEGIN,
    END_S,
    EXPERIMENTS,
    GRIP,
    TIP,
    identified,
    observed,
    settings,
    task,
    touches,
)
from modes.contact.machine import ContactMachine, ContactSettings, State
from modes.contact.touches import Blow, Hand
from modes.contact.trials import (
    PEAKS_N,
    Arm,
    _delays_of,
    break_sensor,
    delays,
    false_alarms,
    faults,
    static_compliance,
)
from modes.contact.twin import Body, Twin
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel

BODY = Body()


@pytest.fixture(scope="module")
def whole(kr5: Arm) -> Course:
    return kr5.loop(0).run(END_S, touches())


@pytest.fixture(scope="module")
def kr5(arm: Callable[[str], RobotModel]) -> Arm:
    robot = arm("kr5_sixx")
    return Arm(robot, BODY, identified(robot, BODY))


def ran(kr5: Arm, changed: ContactSettings, begin: float, end: float) -> Course:
    """The same script with other settings, from ``begin`` on."""
    loop = Loop(Twin(kr5.robot, BEGIN, BODY), ContactMachine(kr5.robot, task(kr5.robot, BODY), changed))
    loop.twin.t = begin
    loop.measured = loop.twin.follow(np.zeros(6))
    return loop.run(end, touches())


@pytest.mark.parametrize("number", range(len(EXPERIMENTS)))
def test_each_of_the_papers_experiments_ends_as_expected(number: int, whole: Course) -> None:
    assert observed(EXPERIMENTS[number], whole) == EXPERIMENTS[number].expected


def test_softly_held_forces_stay_below_the_threshold_of_collisions(whole: Course) -> None:
    """Fig. 4: above 7 N low-passed, below 10 N high-passed."""
    held = [d.tool for t, d in zip(whole.t, whole.decisions, strict=True) if 16.0 <= t < 22.0]
    assert max(each.low_N for each in held if each is not None) > 7.0
    assert max(each.high_N for each in held if each is not None) < 10.0


def test_joint_2_does_not_notice_what_joint_1_does(whole: Course) -> None:
    """Fig. 7 and 8: link 4 is hit from the side."""
    hit = [d.body for t, d in zip(whole.t, whole.decisions, strict=True) if 46.0 <= t < 46.1]
    over = np.array([np.abs(each.high) > each.high_threshold for each in hit if each is not None])
    assert over[:, 0].any() and not over[:, 1].any()


@pytest.mark.parametrize(
    ("number", "change"),
    [
        (1, {"admittance": Admittance(compliance=1e-6)}),
        (1, {"resume_s": 0.05}),
        (2, {"forces": ForceThresholds(high_N=60.0)}),
        (2, {"clear_s": 0.05}),
        (3, {"forces": ForceThresholds(low_N=60.0), "currents": replace(TABLE_1, low_least=(5.0, 5.0, 5.0))}),
        (6, {"residual": Residual(BODY.gains_Nm_A, threshold_Nm=60.0)}),
        (6, {"residual": Residual(BODY.gains_Nm_A, variant="as_printed", threshold_Nm=3.0)}),
    ],
)
def test_with_other_thresholds_an_experiment_ends_otherwise(
    number: int, change: dict[str, object], kr5: Arm
) -> None:
    experiment = EXPERIMENTS[number]
    changed = replace(settings(BODY, kr5.load), **change)  # type: ignore[arg-type]  # settings by name
    course = ran(kr5, changed, experiment.begin_s - 1.2, experiment.end_s)
    assert observed(experiment, course) != experiment.expected


def test_what_ends_too_early_or_wanders_is_not_until_it_is_gone(kr5: Arm) -> None:
    experiment = EXPERIMENTS[3]
    course = ran(kr5, settings(BODY, kr5.load), 29.2, experiment.end_s)
    assert observed(experiment, course) == experiment.expected
    assert observed(replace(experiment, gone_s=40.0), course) == "collision (end effector) > task"
    k = next(k for k, t in enumerate(course.t) if t > 32.0)
    moved = course.decisions[k]._replace(place=course.decisions[k].place + 0.01)
    off = Course([*course.decisions[:k], moved, *course.decisions[k + 1 :]], course.t)
    assert observed(experiment, off) == "collision (end effector) > task"


def test_the_tool_yields_as_the_admittance_says(kr5: Arm) -> None:
    """1 / K = 3.33 mm/N."""
    assert static_compliance(kr5) == pytest.approx(1000.0 / 300.0, rel=0.01)


def test_nobody_who_is_not_there_is_noticed(kr5: Arm, count: Callable[[int], int]) -> None:
    """In full counts the hour that is asked for; printed filters bring signals nearer to thresholds."""
    hours = count(60) / 60.0
    found = false_alarms(kr5, hours, lambda share: None, seed=1)
    assert found.left_task == 0 and found.per_hour == 0.0 and found.hours == pytest.approx(hours, abs=1e-5)
    assert found.detected["corrected"] == 0 and found.largest_share["corrected"] < 0.9
    assert found.largest_share["as_printed"] > 1.2 * found.largest_share["corrected"]


def test_hard_blows_are_told_within_a_few_control_steps_and_soft_ones_are_not(
    kr5: Arm, count: Callable[[int], int]
) -> None:
    each_kind = count(40)
    found = delays(kr5, each_kind, lambda share: None, seed=2)
    assert [each.peak_N for each in found[: len(PEAKS_N)]] == list(PEAKS_N) and len(found) == 2 * len(PEAKS_N)
    for each in found:
        detected = len(each.delays_s)
        assert each.blows == each_kind and detected <= each_kind
        assert (each.delays_s > 0.0).all()
        if each.peak_N <= 10.0:
            assert detected == 0, each
        if each.spot == "end effector" and each.peak_N >= 50.0:
            assert detected == each_kind and each.delays_s.max() < 0.04, each


@pytest.mark.parametrize("number", range(len(faults(BODY))))
def test_a_broken_sensor_stops_the_arm_with_its_reason(number: int, kr5: Arm) -> None:
    fault = faults(BODY)[number]
    found = break_sensor(fault, kr5.loop(3))
    assert found.reason == found.expected == fault.expected.value
    assert found.told_s < (0.07 if fault.at_s > 0.0 else 0.4)
    assert found.rests_s < found.told_s + 0.15 and found.moved == (fault.at_s > 0.0)


def test_a_sensor_that_is_whole_is_not_said_to_be_broken(kr5: Arm) -> None:
    whole = faults(BODY)[0]._replace(spoil=lambda measured: measured)
    found = break_sensor(whole, kr5.loop(3))
    assert found.reason == "" and found.told_s == np.inf and found.moved


def test_states_are_told_in_turn() -> None:
    course = Course()
    assert course.changes() == [] and course.wanders(0.0, 1.0) == 0.0


def test_a_task_goes_on_where_it_was(kr5: Arm) -> None:
    """Nobody near: one check, then the task for as long as one likes."""
    here = ToolFrame(kr5.robot, np.array(BODY.flange_m)).pose(BEGIN)[1]
    course = kr5.loop(0, CyclicTask(np.array([here, here + 0.05]), 2.0)).run(6.0)
    assert [change.state for change in course.changes()] == [State.TASK]


def test_twin_and_machine_have_to_take_the_same_time_for_a_step(kr5: Arm) -> None:
    machine = kr5.loop(0).machine
    with pytest.raises(SetupError, match=r"of the twin is 0.01 s, of the machine 0.012 s"):
        Loop(Twin(kr5.robot, BEGIN, BODY, period_s=0.01), machine)


def test_a_blow_beyond_the_range_of_the_sensor_is_told_and_those_after_it_too(kr5: Arm) -> None:
    """The arm stops with a fault, which is a stop; the sensor is reset, so that none is missed for that."""
    small = replace(BODY, range_N=70.0)
    found = delays(Arm(kr5.robot, small, kr5.load), 3, lambda share: None, seed=4)
    for each in found[6 : len(PEAKS_N)]:
        assert len(each.delays_s) == 3, each


def test_alarms_that_are_raised_are_counted(kr5: Arm) -> None:
    """Currents whose noise is as large as the thresholds; and an arm that never begins, which is no hour."""
    noisy = Arm(kr5.robot, replace(BODY, current_noise_A=0.1), kr5.load)
    found = false_alarms(noisy, 0.005, lambda share: None, seed=1)
    assert found.left_task > 0 and found.per_hour > 100.0 and found.largest_share["corrected"] > 0.9
    other = Arm(kr5.robot, BODY, replace(kr5.load, mass_kg=kr5.load.mass_kg + 1.0))
    never = false_alarms(other, 0.002, lambda share: None, seed=1)
    assert never.hours == 0.0 and never.per_hour == np.inf


def test_a_delay_is_from_the_begin_of_a_blow_to_the_step_that_tells_it(kr5: Arm) -> None:
    """One blow, drawn as the trial draws it; the step is looked for in a course of the same arm."""
    random = np.random.default_rng(9)
    random_begin = 1.0 + random.uniform(0.0, 0.5, 1)[0]
    angle = random.uniform(0.0, 2.0 * np.pi, 1)[0]
    seed = int(random.integers(2**31))
    blow = Blow(TIP, float(random_begin), 80.0, 0.04, (float(np.cos(angle)), float(np.sin(angle)), 0.0))
    course = kr5.loop(seed).run(float(random_begin) + 1.0, (blow,))
    told = next(change.t for change in course.changes() if change.state is State.COLLISION)
    (found,) = [_delays_of(kr5, ("end effector", TIP), 80.0, 1, np.random.default_rng(9))]
    assert found.delays_s == pytest.approx([told - random_begin])


def test_an_arm_held_by_a_spring_as_stiff_as_a_persons_arm_comes_to_rest(
    kr5: Arm, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """300 to 5000 N/m: drives, sensor, limits of speed and of its change, and the delay of the loop in it.

    Thresholds are out of the way, so that it yields all the time; at 8000 N/m it swings, as the docs say.
    """
    for _ in range(count(100)):
        stiffness = float(np.exp(rng.uniform(np.log(300.0), np.log(5000.0))))
        assert swing(kr5, stiffness, rng) < 1e-3, stiffness
    assert swing(kr5, 8000.0, rng) > 5e-3


def swing(kr5: Arm, stiffness: float, rng: np.random.Generator) -> float:
    """How far the tool still goes [m] six seconds after a spring began to pull it with 20 N; inf: a fault."""
    away = rng.normal(size=3)
    away *= 20.0 / stiffness / np.linalg.norm(away)
    hand = Hand(GRIP, 1.0, 30.0, tuple(away.tolist()), 1.0, stiffness, 0.0)
    yielding = replace(
        settings(BODY, kr5.load), forces=ForceThresholds(1e5, 1e-3), residual=Residual(BODY.gains_Nm_A, 1e5)
    )
    twin = Twin(kr5.robot, BEGIN, BODY, seed=int(rng.integers(2**31)))
    course = Loop(twin, ContactMachine(kr5.robot, resting(kr5), yielding)).run(9.0, (hand,))
    if course.decisions[-1].state is State.FAULT:
        return np.inf
    assert course.decisions[-1].state is State.COLLABORATION
    return course.wanders(7.0, 9.0)


def resting(kr5: Arm) -> CyclicTask:
    """A task that stays where it begins."""
    here = ToolFrame(kr5.robot, np.array(BODY.flange_m)).pose(BEGIN)[1]
    return CyclicTask(np.array([here, here]), 3.0)
