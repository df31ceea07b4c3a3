"""Assumption A2 held against readings: who follows passes, who does not is found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe.short_term_plan import PlanOutcome
from robots.errors import SetupError
from tests.failsafe.motions import executed, random_cases
from tests.failsafe.test_running_plan import planner_of
from verifier.tracking import Deviation, JointReading, TrackingMonitor, between_commands

CYCLE = 0.004
NAN = math.nan


def monitored(rng, delay: tuple[float, float], q_error: float, motion, until: float) -> TrackingMonitor:
    """A monitor that knows the commands of ``motion`` (t -> q, dq, ddq) up to ``until``."""
    limits, function = motion
    between = between_commands(limits.acceleration, limits.jerk, CYCLE, delay)
    monitor = TrackingMonitor(np.full(len(limits.joints), q_error), delay, CYCLE, between)
    for k in range(round(until / CYCLE) + 1):
        q, dq, _ = function(np.array([k * CYCLE]))
        monitor.note(k * CYCLE, q[0], dq[0])
    return monitor


def stops(rng, kind: str, count: int):
    """Limits and motion of piece and stop, both ends at hand."""
    for case in random_cases(rng, kind, count):
        planner = planner_of(case, allow_joint_space=False)
        plan = planner.plan(case.motion.trajectory, 0.0, *case.state)
        if plan.outcome is PlanOutcome.READY:
            record = planner.path[0].copy()
            end = float(record["t"][record["n"]])

            def motion(t, record=record, case=case, end=end):
                return executed(case.motion, record, np.clip(t, 0.0, end))[:3]

            yield (case.limits, motion), end


# Bad input


@pytest.mark.parametrize("oldest", [-0.1, NAN, math.inf])
def test_unusable_ages_are_refused(oldest):
    with pytest.raises(SetupError, match="oldest"):
        TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01, oldest_s=oldest)


@pytest.mark.parametrize(
    "reading",
    [
        JointReading(0.02, np.array([NAN, 0.0])),
        JointReading(0.02, np.array([math.inf, 0.0])),
        JointReading(NAN, np.zeros(2)),
        JointReading(math.inf, np.zeros(2)),
        JointReading(0.02, np.zeros(3)),
        JointReading(0.02, np.zeros(0)),
        JointReading(0.02, np.zeros((1, 2))),
    ],
)
@pytest.mark.parametrize("commands", [0, 5])
def test_readings_that_are_none_deviate(reading, commands):
    monitor = TrackingMonitor(np.full(2, 1e3), (0.0, 0.0), 0.01)
    for k in range(commands):
        monitor.note(0.01 * k, np.zeros(2), np.zeros(2))
    found = monitor.check(reading)
    assert found.joint == -1 and found.by == math.inf


def test_before_the_first_command_nothing_is_compared():
    monitor = TrackingMonitor(np.zeros(2), (0.0, 0.0), 0.01)
    assert monitor.check(JointReading(0.0, np.ones(2))) is None


@pytest.mark.parametrize("spoilt", ["q", "dq"])
def test_commands_that_are_none_agree_with_nothing(spoilt):
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01)
    for k in range(4):
        bad = np.full(1, NAN)
        good = np.zeros(1)
        monitor.note(0.01 * k, bad if spoilt == "q" else good, bad if spoilt == "dq" else good)
    assert monitor.check(JointReading(0.015, np.zeros(1))) is not None


# Who follows, and who does not


@pytest.mark.parametrize("kind", ["curved", "near_limits", "rough"])
@pytest.mark.parametrize("delay", [(0.0, 0.0), (0.002, 0.002), (0.0, 0.011), (0.003, 0.02)])
def test_every_admissible_robot_passes(kind, delay, rng, count):
    """Any delay in its range at every instant, the error at its bound: no false alarm."""
    for motion, end in stops(rng, kind, count(2_000)):
        q_error = 10.0 ** rng.uniform(-6, -2)
        monitor = monitored(rng, delay, q_error, motion, min(end, 0.2))
        n = len(motion[0].joints)
        newest = CYCLE * round(min(end, 0.2) / CYCLE)
        for t in rng.uniform(0.0, newest, 20):
            one = rng.choice([delay[0], delay[1], rng.uniform(*delay)])
            q = motion[1](np.array([max(0.0, t - one)]))[0][0]
            assert monitor.check(JointReading(t, q + q_error * rng.choice([-1.0, 1.0], n))) is None


@pytest.mark.parametrize("kind", ["curved", "near_limits", "rough"])
@pytest.mark.parametrize("delay", [(0.0, 0.0), (0.0, 0.011)])
def test_who_is_farther_away_than_any_delay_explains_is_found(kind, delay, rng, count):
    for motion, end in stops(rng, kind, count(2_000)):
        limits, function = motion
        q_error = 1e-4
        monitor = monitored(rng, delay, q_error, motion, min(end, 0.2))
        between = between_commands(limits.acceleration, limits.jerk, CYCLE, delay)
        newest = CYCLE * round(min(end, 0.2) / CYCLE)
        for t in rng.uniform(delay[1], max(newest, delay[1]), 10):
            if t > newest:
                continue
            places = function(np.linspace(t - delay[1], t - delay[0], 200))[0]
            j = int(rng.integers(len(limits.joints)))
            beyond = q_error + 2.0 * between[j] + limits.velocity[j] * 1e-4 + 2e-9
            q = places[0].copy()
            q[j] = places[:, j].max() + beyond if rng.random() < 0.5 else places[:, j].min() - beyond
            found = monitor.check(JointReading(t, q))
            assert found is not None and found.joint == j and found.t == t
            assert 0.0 < found.by <= beyond


def test_half_the_bound_between_commands_would_raise_false_alarms():
    """A jerk that changes its sign in the middle of a cycle uses up most of the bound."""
    jerk, h = 1000.0, 0.01
    limits_jerk = np.array([jerk])

    def q(t: float) -> tuple[float, float]:
        # +J, -J, -J, +J over the quarters: from rest to rest in q' and q''
        state, at = np.zeros(3), 0.0
        for k, sign in enumerate((1.0, -1.0, -1.0, 1.0)):
            d = min(max(t - k * h / 4, 0.0), h / 4)
            j = sign * jerk
            state = np.array(
                [
                    state[0] + d * state[1] + d**2 / 2 * state[2] + d**3 / 6 * j,
                    state[1] + d * state[2] + d**2 / 2 * j,
                    state[2] + d * j,
                ]
            )
            at += d
        return float(state[0]), float(state[1])

    full = between_commands(np.array([10.0]), limits_jerk, h, (0.0, 0.0))
    for between, agrees in ((full, True), (full / 8.0, False)):
        monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), h, between)
        for t in (0.0, h):
            monitor.note(t, np.array([q(t)[0]]), np.array([q(t)[1]]))
        answers = [monitor.check(JointReading(t, np.array([q(t)[0]]))) for t in np.linspace(0, h, 81)]
        assert all(each is None for each in answers) is agrees


def test_a_command_is_replaced_by_one_of_the_same_instant():
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01)
    for k in range(5):
        monitor.note(0.01 * k, np.zeros(1), np.zeros(1))
    monitor.note(0.04, np.ones(1), np.zeros(1))
    assert monitor.check(JointReading(0.04, np.ones(1))) is None
    assert monitor.check(JointReading(0.03, np.zeros(1))) is None
    assert monitor.check(JointReading(0.04, np.zeros(1))).joint == 0


def test_also_the_first_command_of_all_is_replaced():
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01)
    monitor.note(0.0, np.zeros(1), np.zeros(1))
    monitor.note(0.0, np.ones(1), np.zeros(1))
    assert monitor.check(JointReading(0.0, np.ones(1))) is None
    assert monitor.check(JointReading(0.0, np.zeros(1))) == Deviation(0.0, 0, pytest.approx(1.0, abs=1e-6))


def test_only_the_recent_past_is_kept():
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.02), 0.01, oldest_s=0.1)
    for k in range(1000):
        monitor.note(0.01 * k, np.full(1, 0.01 * k), np.ones(1))
    assert monitor.check(JointReading(9.9, np.array([9.89]))) is None
    assert monitor.check(JointReading(9.9, np.array([9.86]))) is not None
    assert monitor.check(JointReading(5.0, np.array([5.0]))) is not None
