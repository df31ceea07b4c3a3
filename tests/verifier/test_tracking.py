"""Assumption A2 held against readings: who follows passes, who does not is found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from failsafe.plan import PlanOutcome
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


@pytest.mark.parametrize("delay", [(0.0, 0.0), (0.03, 0.03), (0.0, 0.03), (0.01, 0.011)])
def test_a_path_between_commands_may_leave_them_by_jerk_and_where_delays_vary_by_acceleration(delay):
    """A cubic from rest to rest, and half a parabola: h = 1/2 makes h³/96 = 1/768 and h²/8 = 1/32."""
    found = between_commands(np.array([32.0, 64.0]), np.array([768.0, 1536.0]), 0.5, delay)
    np.testing.assert_allclose(found, [1.0, 2.0] if delay[0] == delay[1] else [2.0, 4.0], rtol=1e-15)


@pytest.mark.parametrize("delay", [(0.0, 0.0), (0.013, 0.013)])
@pytest.mark.parametrize("between", [None, np.array([1e-5, 3e-5])])
def test_between_commands_the_cubic_through_both_counts_within_error_bound_and_rounding(
    delay, between, rng, count
):
    """Against scipy; each piece has a cubic of its own."""
    q_error = np.array([1e-4, 2e-4])
    for _ in range(count(2_000)):
        monitor = TrackingMonitor(q_error, delay, 0.01, between)
        instants = np.cumsum(rng.uniform(0.004, 0.02, int(rng.choice([1, 2, 3, 12]))))
        q, dq = rng.normal(size=(2, len(instants), 2))
        for t, *command in zip(instants, q, dq, strict=True):
            monitor.note(t, *command)
        path = CubicHermiteSpline(instants, q, dq) if len(instants) > 1 else lambda _, q=q: q[0]
        allowed = q_error + 1e-9 + (0.0 if between is None else between)
        for t in (*rng.uniform(instants[0], instants[-1], 5), rng.choice(instants)):
            joint, sign = rng.integers(2), rng.choice([-1.0, 1.0])
            off, reading = sign * np.eye(2)[joint], t + delay[0]
            assert monitor.check(JointReading(reading, path(t) + off * (allowed - 1e-10))) is None
            found = monitor.check(JointReading(reading, path(t) + off * (allowed + 3e-6)))
            assert found == (reading, joint, pytest.approx(3e-6, abs=1e-10))


def test_a_reading_at_the_very_bound_agrees():
    monitor = TrackingMonitor(np.full(1, 0.25), (0.0, 0.0), 0.01)
    monitor.note(0.0, np.zeros(1), np.zeros(1))
    for sign in (-1.0, 1.0):
        assert monitor.check(JointReading(0.0, np.array([sign * (0.25 + 1e-9)]))) is None
        assert monitor.check(JointReading(0.0, np.array([sign * (0.25 + 2e-9)]))) is not None


def test_where_the_delay_varies_the_robot_may_be_at_a_turning_point_in_between():
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.025), 0.01)
    for k, place in enumerate((5.0, 0.0, 1.0, 0.0, -1.0, 0.0, 5.0)):
        monitor.note(0.01 * k, np.array([place]), np.zeros(1))
    for t, places, beyond in ((0.036, (0.0, 1.0), 1.01), (0.056, (0.0, -1.0), -1.01)):
        assert all(monitor.check(JointReading(t, np.array([each]))) is None for each in places)
        assert monitor.check(JointReading(t, np.array([beyond]))).by == pytest.approx(0.01, abs=1e-8)


@pytest.mark.parametrize("delay", [(0.0, 0.05), (0.012, 0.031)])
def test_with_a_delay_that_varies_every_command_in_between_may_be_where_the_robot_is(delay, rng, count):
    """Joints that only go up: from where they were to where they are, and nothing beyond."""
    q_error = np.array([1e-4, 2e-4])
    for _ in range(count(2_000)):
        monitor = TrackingMonitor(q_error, delay, 0.01)
        rates = rng.uniform(0.2, 1.0, 2)
        for k in range(12):
            monitor.note(0.01 * k, rates * 0.01 * k, rates)
        t = rng.uniform(delay[1], 0.11 + delay[0])
        first, last = (min(t - each, 0.11) for each in (delay[1], delay[0]))
        for j in range(2):
            for place, beyond, agrees in (
                (first, -1e-4, True), (first, -3e-4, False), (last, 1e-4, True), (last, 3e-4, False),
                (rng.uniform(first, last), 0.0, True),
            ):  # fmt: skip
                q = rates * rng.uniform(first, last)
                q[j] = rates[j] * place + np.sign(beyond) * ((abs(beyond) - 2e-4) + q_error[j])
                found = monitor.check(JointReading(t, q))
                q_limit = abs(beyond) - 2e-4 - 1e-9
                assert found is None if agrees else found == (t, j, pytest.approx(q_limit, abs=1e-10))


def test_the_joint_that_is_farthest_out_is_named():
    monitor = TrackingMonitor(np.array([0.1, 0.5, 0.0]), (0.0, 0.0), 0.01)
    monitor.note(0.0, np.zeros(3), np.zeros(3))
    assert monitor.check(JointReading(0.0, np.array([0.3, -0.6, 0.1]))) == (0.0, 0, pytest.approx(0.2))
    assert monitor.check(JointReading(0.0, np.array([0.3, -0.9, 0.1]))) == (0.0, 1, pytest.approx(0.4))
    assert monitor.check(JointReading(0.0, np.array([0.3, -0.9, 0.5]))) == (0.0, 2, pytest.approx(0.5))


def test_outside_of_what_was_commanded_the_first_and_the_last_command_count():
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01)
    for k in range(3):
        monitor.note(0.01 * k, np.array([1.0 * k]), np.array([100.0]))
    for t, place in ((-0.004, 0.0), (0.0, 0.0), (0.02, 2.0), (0.024, 2.0)):
        assert monitor.check(JointReading(t, np.array([place]))) is None
        assert monitor.check(JointReading(t, np.array([place + 0.01]))).by == pytest.approx(0.01, abs=1e-8)
        assert monitor.check(JointReading(t, np.array([place - 0.01]))).by == pytest.approx(0.01, abs=1e-8)


@pytest.mark.parametrize("resting", [False, True])
def test_a_reading_that_tells_nothing_about_now_does_not_agree(resting):
    """Nor one of a robot that rested then where it is said to be now."""
    cycle, oldest = 0.0625, 0.125
    monitor = TrackingMonitor(np.zeros(1), (0.0, 0.0), cycle, oldest_s=oldest)
    for k in range(20 if resting else 3):  # with three commands, none of the past has been forgotten
        monitor.note(cycle * k, np.zeros(1), np.zeros(1))
    newest = cycle * (19 if resting else 2)
    for since, agrees in ((-0.25, True), (-0.2501, False), (-5.0, False), (0.0625, True), (0.0626, False)):
        found = monitor.check(JointReading(newest + since, np.zeros(1)))
        assert found == (None if agrees else (newest + since, -1, math.inf))


@pytest.mark.parametrize(("delay", "oldest"), [(0.0, 0.1), (0.25, 0.1), (0.25, 0.0), (0.0, 0.0)])
def test_as_many_commands_are_kept_as_the_oldest_reading_needs(delay, oldest):
    """One before it, to interpolate; and no more than a few that nobody needs."""
    cycle = 0.0625
    monitor = TrackingMonitor(np.zeros(1), (0.0, delay), cycle, oldest_s=oldest)
    for k in range(1000):
        monitor.note(cycle * k, np.array([cycle * k]), np.ones(1))
    now = cycle * 999
    for t in (now - oldest, now):
        assert monitor.check(JointReading(t, np.array([t - delay]))) is None
        assert monitor.check(JointReading(t, np.array([t - delay - 1e-6]))) is not None
    assert (delay + oldest) / cycle + 4 <= monitor.rows < (delay + oldest) / cycle + 5


def test_readings_of_any_age_that_is_not_negative_can_be_asked_for():
    for oldest in (0.0, 1.5):
        TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.01, oldest_s=oldest)
    assert TrackingMonitor(np.zeros(1), (0.0, 0.0), 0.0625).rows == 8, "a quarter of a second"
