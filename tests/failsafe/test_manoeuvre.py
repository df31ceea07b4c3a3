"""Path-consistent stop, recovery and joint-space stop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from failsafe import axis_kernels, limit_kernels, path_kernels, stop_kernels
from failsafe.manoeuvre import Acceptance, JointSpaceStop, PathManoeuvre, Quantity, VelocityProfile
from failsafe.scaling import PathState, conservative_budget, limit_rows
from failsafe.trajectory import IntendedTrajectory
from tests.failsafe.motions import (
    KINDS,
    Motion,
    excess,
    executed,
    instants,
    limits_of,
    path_of,
    random_cases,
    random_limits,
)

NAN = math.nan


def manoeuvre(limits, **changes) -> PathManoeuvre:
    return PathManoeuvre(limits, **({"steps": 12, "step_s": 0.01, "positions": False} | changes))


def speeds_of(profile: VelocityProfile, v: float, a: float) -> np.ndarray:
    """ṡ of a profile as ruckig returns it, densely."""
    out = [v]
    for d, j in zip(profile.durations, profile.jerks, strict=True):
        x = np.linspace(0.0, d, 200)
        out.extend(v + a * x + j * x**2 / 2)
        v, a = v + a * d + j * d**2 / 2, a + j * d
    return np.array(out)


def accept(
    v: float, a: float, a_s: float, j_s: float, target: float = 0.0, s_max: float = 10.0
) -> Acceptance:
    profile, path = VelocityProfile(), np.zeros(1, path_kernels.PATH)
    if not profile.calculate(v, a, target, a_s, j_s):
        return Acceptance.NO_PROFILE
    return Acceptance(
        path_kernels.append_profile(
            path, 0, 0.0, v, a, profile.durations, profile.jerks, target, a_s, j_s, s_max
        )
    )


def test_a_profile_that_is_remembered_is_the_one_that_ruckig_gives(rng, count):
    """Questions asked again, in between others: as from a generator that was never asked anything else."""
    remembers = VelocityProfile()
    questions = [
        tuple(row) for row in (np.abs(rng.normal(size=(8, 5))) + np.array([0.5, 0, 0, 2, 10])).tolist()
    ]
    for k in rng.integers(0, len(questions), count(2_000)):
        fresh = VelocityProfile()
        assert fresh.calculate(*questions[k]) and remembers.calculate(*questions[k])
        assert (fresh.durations == remembers.durations).all() and (fresh.jerks == remembers.jerks).all()
        if rng.random() < 0.2:  # one that was not asked before
            remembers.calculate(1.0, 0.0, 0.0, float(rng.uniform(1.0, 9.0)), 40.0)
    assert len(remembers._remembered) <= 128


def test_every_answer_has_a_number_of_its_own():
    """Kernels tell verdicts and quantities by number: none may stand for two."""
    assert [each.value for each in Quantity] == list(range(len(Quantity.__members__))) == list(range(7))
    assert [each.value for each in Acceptance] == list(range(len(Acceptance.__members__))) == list(range(8))
    assert limit_kernels.NOT_PROVEN not in list(Acceptance)
    assert stop_kernels.NO_PROFILE == Acceptance.NO_PROFILE
    outcomes = {stop_kernels.READY, stop_kernels.STATE_BEYOND_LIMITS, stop_kernels.ELSE}
    assert len(outcomes) == 3
    rows = [limit_kernels.LOWER, limit_kernels.UPPER, limit_kernels.VELOCITY_LIMIT]
    rows += [limit_kernels.ACCELERATION_LIMIT, limit_kernels.JERK_LIMIT]
    limits = limits_of(*(np.full(1, each) for each in (3.0, 4.0, 5.0)), [1.0], [2.0])
    assert limit_rows(limits)[rows, 0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


# What ruckig does, and what is not accepted


def test_ruckig_overshoots_from_an_acceleration_above_the_limit_and_we_refuse():
    profile = VelocityProfile()
    assert profile.calculate(0.9, 6.5, 0.0, 5.0, 40.0)
    assert speeds_of(profile, 0.9, 6.5).max() > 1.4
    assert accept(0.9, 6.5, 5.0, 40.0) is Acceptance.PATH_ACCELERATION


def test_ruckig_goes_backwards_when_the_jerk_limit_has_shrunk_and_we_refuse():
    profile = VelocityProfile()
    assert profile.calculate(0.2, -4.0, 0.0, 5.0, 20.0)
    assert speeds_of(profile, 0.2, -4.0).min() < -0.19
    assert accept(0.2, -4.0, 5.0, 20.0) is Acceptance.NEGATIVE_SPEED


def test_ruckig_accepts_infinite_limits_and_we_refuse():
    profile = VelocityProfile()
    assert profile.calculate(0.9, 0.0, 0.0, 8.0, math.inf)
    assert accept(0.9, 0.0, 8.0, math.inf) is Acceptance.BAD_LIMIT
    assert accept(0.9, 0.0, math.inf, 40.0) is Acceptance.BAD_LIMIT


@pytest.mark.parametrize(
    ("v", "a", "a_s", "j_s"),
    [
        (NAN, 0, 8, 40),
        (0.9, NAN, 8, 40),
        (0.9, 0, NAN, 40),
        (0.9, 0, 8, NAN),
        (0.9, 0, -8, 40),
        (0.9, 0, 8, 0),
    ],
)
def test_no_profile_from_values_that_are_not_numbers_or_not_positive(v, a, a_s, j_s):
    assert accept(v, a, a_s, j_s) is Acceptance.NO_PROFILE


def test_a_plain_stop_is_accepted_and_one_beyond_the_path_is_not():
    assert accept(1.0, 0.0, 8.0, 40.0) is Acceptance.ACCEPTED
    assert accept(1.0, 0.0, 8.0, 40.0, s_max=0.1) is Acceptance.BEYOND_PATH
    assert accept(1.0, 2.0, 8.0, 40.0) is Acceptance.ACCEPTED
    assert accept(0.0, 0.0, 8.0, 40.0) is Acceptance.ACCEPTED


def segments(*pairs: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    durations, jerks = np.zeros(9), np.zeros(9)
    for i, (d, j) in enumerate(pairs):
        durations[i], jerks[i] = d, j
    return durations, jerks


STOP = ((0.1, -40.0), (0.15, 0.0), (0.1, 40.0))
"""From ṡ = 1 to rest with s̈ down to -4."""
DIP = ((0.1, -40.0), (0.225, 0.0), (0.1, 40.0), (0.05, 40.0), (0.025, 0.0), (0.05, -40.0))
"""From ṡ = 1.15 to rest by way of -0.15."""


@pytest.mark.parametrize(
    ("pairs", "v", "verdict"),
    [
        (STOP, 1.0, Acceptance.ACCEPTED),
        (STOP, 1.01, Acceptance.NOT_AT_TARGET),
        (STOP[:2], 1.0, Acceptance.NOT_AT_TARGET),
        (((0.1, 40.0), (0.1, -40.0), *STOP), 0.6, Acceptance.SPEED_OVERSHOOT),
        (DIP, 1.15, Acceptance.NEGATIVE_SPEED),
        (((0.05, -80.0), (0.2, 0.0), (0.05, 80.0)), 1.0, Acceptance.BAD_LIMIT),
        (((0.2, -40.0), (0.2, 40.0)), 1.6, Acceptance.PATH_ACCELERATION),
        (((-0.1, 40.0), *STOP), 1.0, Acceptance.BAD_LIMIT),
        (((0.0, 9.0), *STOP, (-0.0, 7.0)), 1.0, Acceptance.ACCEPTED),
    ],
)
def test_profiles_made_by_hand_are_held_against_every_condition(pairs, v, verdict):
    path = np.zeros(1, path_kernels.PATH)
    durations, jerks = segments(*pairs)
    found = path_kernels.append_profile(path, 0, 0.0, v, 0.0, durations, jerks, 0.0, 5.0, 40.0, 10.0)
    assert Acceptance(found) is verdict


ARGUMENTS = ("s", "v", "a", "durations", "jerks", "target", "a_limit", "j_limit", "s_max")


@pytest.mark.parametrize("name", ARGUMENTS)
def test_no_acceptance_with_nan_in(name):
    profile = VelocityProfile()
    assert profile.calculate(1.0, 0.0, 0.0, 8.0, 40.0)
    values = dict(
        zip(ARGUMENTS, (0.0, 1.0, 0.0, profile.durations, profile.jerks, 0.0, 8.0, 40.0, 10.0), strict=True)
    )
    path = np.zeros(1, path_kernels.PATH)
    assert path_kernels.append_profile(path, 0, *values.values()) == Acceptance.ACCEPTED
    if name in ("durations", "jerks"):
        for i in range(9):
            spoilt = values[name].copy()
            spoilt[i] = NAN
            assert (
                path_kernels.append_profile(path, 0, *(values | {name: spoilt}).values())
                != Acceptance.ACCEPTED
            )
    else:
        assert path_kernels.append_profile(path, 0, *(values | {name: NAN}).values()) != Acceptance.ACCEPTED


def test_acceptance_against_a_plain_integration(rng, count):
    """Twin of the acceptance test: dense integration decides the same, away from the limits themselves."""
    seen = set()
    for _ in range(count(100_000)):
        v, a = rng.uniform(-0.1, 1.2), rng.normal() * 3.0
        a_s, j_s, s_max = (
            10.0 ** rng.uniform(-0.5, 1.5),
            10.0 ** rng.uniform(0.0, 3.0),
            10.0 ** rng.uniform(-2, 1),
        )
        profile, path = VelocityProfile(), np.zeros(1, path_kernels.PATH)
        assert profile.calculate(v, a, 0.0, a_s, j_s)
        verdict = path_kernels.append_profile(
            path, 0, 0.0, v, a, profile.durations, profile.jerks, 0.0, a_s, j_s, s_max
        )
        speed = speeds_of(profile, v, a)
        length = 0.0
        state = (v, a)
        for d, j in zip(profile.durations, profile.jerks, strict=True):
            length += d * state[0] + d**2 / 2 * state[1] + d**3 / 6 * j
            state = (state[0] + d * state[1] + d**2 / 2 * j, state[1] + d * j)
        allowed = v + max(a, 0.0) ** 2 / (2 * j_s)
        good = abs(a) <= a_s and speed.min() >= -1e-12 and speed.max() <= allowed + 1e-9 and length <= s_max
        near = abs(abs(a) - a_s) < 1e-6 or -1e-6 < speed.min() < 0 or abs(length - s_max) < 1e-6
        assert near or (verdict == Acceptance.ACCEPTED) == good
        seen.add(verdict)
    assert Acceptance.ACCEPTED in seen and len(seen) > 2


# Random states


@pytest.mark.parametrize("kind", KINDS)
def test_stops_keep_all_limits_stay_on_the_path_and_end_at_rest(kind, rng, count):
    stopped = tried = 0
    for case in random_cases(rng, kind, count(30_000)):
        tried += 1
        planner = manoeuvre(case.limits)
        if not planner.search(case.motion.trajectory, 0, case.state, 0.0):
            assert (
                planner.acceptance is not Acceptance.ACCEPTED or planner.excess.quantity is not Quantity.NONE
            )
            continue
        stopped += 1
        check_manoeuvre(case.limits, case.motion, planner.path[0], case.state, 0.0)
    assert stopped > 0.8 * tried


def check_manoeuvre(limits, motion: Motion, record: np.void, state: PathState, target: float) -> None:
    """Dense sampling of the executed motion, with the segments integrated anew and the spline of scipy."""
    tau = instants(record)
    if tau.size == 0:
        assert state.sdot == target and state.sddot == 0.0
        return
    s, v, a, _ = path_of(record, tau)
    assert np.allclose([s[0], v[0]], state[:2], atol=1e-5)
    assert abs(a[0] - state.sddot) <= 1e-8 * max(1e3, float(np.abs(a).max())), "relative to what is reached"
    assert v.min() >= -1e-9
    assert abs(v[-1] - target) < 1e-8 and abs(a[-1]) < 1e-6
    q, dq, ddq, dddq = executed(motion, record, tau)
    assert excess(limits, dq, ddq, dddq) <= 1.0 + 1e-9
    # as the kernels evaluate it: on the path, never backwards, exactly at rest
    path = np.array([record])
    n = int(record["n"])
    k = np.clip(np.searchsorted(record["t"][: n + 1], tau, side="right") - 1, 0, n - 1)
    ours = np.array([path_kernels.path_state(path, i, x) for i, x in zip(k, tau, strict=True)])
    assert np.abs(ours[:, 0] - s).max() < 1e-9 and np.abs(motion.derivatives(ours[:, 0])[0] - q).max() < 1e-8
    assert ours[:, 1].min() >= 0.0
    assert path_kernels.path_state(path, n - 1, record["t"][n])[1:3] == (target, 0.0)


def test_recovery_keeps_all_limits_and_ends_at_full_speed(rng, count):
    recovered = 0
    for case in random_cases(rng, "accelerated", count(20_000)):
        planner = manoeuvre(case.limits)
        if planner.search(case.motion.trajectory, 0, case.state, 1.0):
            recovered += 1
            check_manoeuvre(case.limits, case.motion, planner.path[0], case.state, 1.0)
    assert recovered > 0.5 * count(20_000)


def test_search_finds_a_stop_wherever_the_conservative_budget_does(rng, count):
    for kind in KINDS:
        for case in random_cases(rng, kind, count(10_000)):
            planner = manoeuvre(case.limits)
            found = planner.search(case.motion.trajectory, 0, case.state, 0.0)
            budget = conservative_budget(case.motion.trajectory, case.limits, case.state)
            if budget is not None and planner.candidate(case.motion.trajectory, 0, case.state, 0.0, *budget):
                assert found


def test_conservative_budget_keeps_all_limits(rng, count):
    for case in random_cases(rng, "curved", count(10_000)):
        budget = conservative_budget(case.motion.trajectory, case.limits, case.state)
        planner = manoeuvre(case.limits)
        profile = VelocityProfile()
        if budget is None or not profile.calculate(case.state.sdot, case.state.sddot, 0.0, *budget):
            continue
        s_max = case.motion.trajectory.s_max
        verdict = path_kernels.append_profile(
            planner.path, 0, *case.state, profile.durations, profile.jerks, 0.0, *budget, s_max
        )
        assert verdict == Acceptance.ACCEPTED
        check_manoeuvre(case.limits, case.motion, planner.path[0], case.state, 0.0)


def test_position_limits_count_on_the_path():
    """A joint that moves at 1 rad/s towards its stop, 0.05 rad away."""
    trajectory = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
    roomy = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]), [-9.0], [9.0])
    tight = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]), [-9.0], [1.05])
    state = PathState(1.0, 1.0)
    assert manoeuvre(roomy, positions=True).search(trajectory, 0, state, 0.0)
    assert manoeuvre(tight, positions=False).search(trajectory, 0, state, 0.0)
    planner = manoeuvre(tight, positions=True)
    assert not planner.search(trajectory, 0, state, 0.0)
    assert planner.excess.joint == 0 and planner.excess.quantity is Quantity.POSITION
    assert planner.excess.limit == 1.05 and planner.excess.value > 1.05


def test_straight_motion_stops_about_as_fast_as_one_axis_can():
    """Closed form for one joint at constant speed: v/a + a/j."""
    trajectory = IntendedTrajectory([0.0, 5.0], [[[0.0], [1.0]]])
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))
    planner = manoeuvre(limits)
    assert planner.search(trajectory, 0, PathState(1.0, 1.0), 0.0)
    duration = planner.path["t"][0, planner.path["n"][0]]
    assert 0.125 <= duration < 0.125 * 1.02


# Joint-space stop


def test_joint_space_stops_keep_all_limits_and_end_at_rest(rng, count):
    accepted = 0
    for _ in range(count(100_000)):
        n = int(rng.integers(1, 8))
        limits = random_limits(rng, n)
        limits = limits_of(
            limits.velocity, limits.acceleration, limits.jerk, np.full(n, -2.0), np.full(n, 2.0)
        )
        q = rng.uniform(-2.0, 2.0, n) * 0.8
        dq, ddq = limits.velocity * rng.uniform(-0.9, 0.9, n), limits.acceleration * rng.uniform(-1.0, 1.0, n)
        stop = JointSpaceStop(limits, positions=True)
        good, motion = plain_stop(limits, q, dq, ddq)
        if not stop.plan(q, dq, ddq):
            assert not good
            assert stop.excess.joint >= 0 and stop.excess.quantity is not Quantity.NONE
            continue
        accepted += 1
        assert good
        for i in range(n):
            t, positions = (x[::10] for x in motion[i])
            ours = np.array([axis_kernels.axis_state(stop.axes, i, x) for x in t])
            assert np.abs(ours[:, 0] - positions).max() < 1e-9
            end = stop.axes["q_end"][0, i]
            assert axis_kernels.axis_state(stop.axes, i, stop.duration()) == (end, 0.0, 0.0)
    assert accepted > 0


def plain_stop(limits, q, dq, ddq):
    """Whether the quickest stop of each axis keeps the limits (1e-9), by closed form and dense sampling."""
    good, motion = True, []
    for i in range(len(q)):
        x, v, a = q[i], dq[i], ddq[i]
        a_max, j = limits.acceleration[i], limits.jerk[i]
        direction = -1.0 if v + a * abs(a) / (2 * j) > 0 else 1.0
        peak = min(a_max, math.sqrt(max(direction * -v * j + a * a / 2, 0.0)))
        build, release = (peak - direction * a) / j, peak / j
        hold = (direction * -v + a * a / (2 * j) - peak**2 / j) / peak if peak == a_max else 0.0
        times, positions, t = [], [], 0.0
        for d, jerk in ((build, direction * j), (max(hold, 0.0), 0.0), (release, -direction * j)):
            y = np.linspace(0.0, d, 100)
            places = x + v * y + a * y**2 / 2 + jerk * y**3 / 6
            times.extend(t + y)
            positions.extend(places)
            speeds = v + a * y + jerk * y**2 / 2
            good &= bool(np.abs(speeds).max() <= limits.velocity[i] + 1e-9)
            good &= bool(places.min() >= -2.0 - 1e-6 and places.max() <= 2.0 + 1e-6)
            x, v, a, t = places[-1], speeds[-1], a + jerk * d, t + d
        assert abs(v) < 1e-8 and abs(a) < 1e-6
        motion.append((np.array(times), np.array(positions)))
    return good, motion


@pytest.mark.parametrize(("beyond", "accepted"), [(0.999, False), (1.001, True)])
def test_position_limits_count_where_a_joint_turns_back(beyond, accepted):
    """It still moves up while its acceleration pulls it back: the highest point lies inside a segment."""
    v, a, j = 0.05, -8.0, 400.0
    # dq = v + a x + j x²/2 = 0
    x = (-a - math.sqrt(a * a - 2 * j * v)) / j
    highest = v * x + a * x**2 / 2 + j * x**3 / 6
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([j]), [-1.0], [beyond * highest])
    stop = JointSpaceStop(limits, positions=True)
    assert stop.plan(np.zeros(1), np.array([v]), np.array([a])) is accepted
    if not accepted:
        assert stop.excess.quantity is Quantity.POSITION and stop.excess.value == pytest.approx(highest)


@pytest.mark.parametrize("spoilt", [0, 1, 2])
def test_no_joint_space_stop_from_nan(spoilt):
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]))
    state = [np.zeros(1), np.ones(1), np.zeros(1)]
    stop = JointSpaceStop(limits, positions=True)
    assert stop.plan(*state)
    state[spoilt] = np.array([NAN])
    assert not stop.plan(*state)


def test_no_joint_space_stop_from_beyond_a_limit():
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([400.0]), [-1.0], [1.0])
    stop = JointSpaceStop(limits, positions=True)
    for state, quantity in (
        ((0.0, 2.1, 0.0), Quantity.VELOCITY),
        ((0.0, 0.0, 10.1), Quantity.ACCELERATION),
        ((0.0, 1.9, 10.0), Quantity.VELOCITY),
        ((0.95, 1.0, 0.0), Quantity.POSITION),
    ):
        assert not stop.plan(*(np.array([x]) for x in state))
        assert stop.excess.joint == 0 and stop.excess.quantity is quantity


@pytest.mark.parametrize(
    "off", [0.0, *(sign * x for x in (1e-18, 3e-16, 9e-13, 2e-12, 1e-6) for sign in (1, -1))]
)
def test_a_cut_leaves_no_segment_that_is_too_short_to_be_one(off, rng, count):
    """Also where a switch of the path jerk falls on the end of the cycle, or a rounding beside it."""
    profile, out = VelocityProfile(), np.zeros(3)
    for _ in range(count(2_000)):
        path = np.zeros(1, path_kernels.PATH)
        v, target = rng.uniform(0.0, 1.0, 2)
        a_s, j_s = 10.0 ** rng.uniform(0, 2), 10.0 ** rng.uniform(1, 4)
        assert profile.calculate(v, 0.0, target, a_s, j_s)
        given = (profile.durations, profile.jerks, target, a_s, j_s, math.inf)
        assert path_kernels.append_profile(path, 0, 2.0, v, 0.0, *given) == path_kernels.ACCEPTED
        whole = path[0].copy()
        ends = whole["t"][1 : whole["n"] + 1]
        duration = max(float(rng.choice(ends)) + off, 1e-9)
        path_kernels.cut_path(path, duration, out)
        n = int(path["n"][0])
        assert path["t"][0, 0] == 0.0 and path["t"][0, n] == duration
        assert (np.diff(path["t"][0, : n + 1]) > 1e-12 * (1.0 - 1e-3)).all()
        expected = [float(each[0]) for each in path_of(whole, np.array([min(duration, ends[-1])]))[:3]]
        expected[0] += max(0.0, duration - ends[-1]) * target
        assert out == pytest.approx(expected, abs=3e-12 * j_s)
        if duration >= ends[-1] - 1e-12:
            assert (out[1], out[2]) == (target, 0.0), "the next cycle begins at the target, not beside it"
