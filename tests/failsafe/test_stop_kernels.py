"""Stops from a steady speed in one call: the profile against ruckig, the search against its parts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from failsafe import limit_kernels, path_kernels, search_kernels, stop_kernels
from failsafe.manoeuvre import PathManoeuvre, SteadyStops, VelocityProfile
from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.scaling import AccelerationSearch, PathState, limit_rows
from failsafe.short_term_plan import ShortTermPlanner
from tests.failsafe.motions import KINDS, Case, random_cases

Count = Callable[[int], int]
STEP_S = 0.01


def profile(v: float, a_s: float, j_s: float) -> tuple[bool, np.ndarray, np.ndarray]:
    durations, jerks = np.zeros(3), np.zeros(3)
    return stop_kernels.profile_from_steady(v, a_s, j_s, durations, jerks), durations, jerks


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1.0, 0.0])
def test_limits_that_are_none_have_no_profile(bad: float) -> None:
    assert not profile(1.0, bad, 10.0)[0]
    assert not profile(1.0, 10.0, bad)[0]
    if bad != 0.0 and not math.isinf(bad):
        assert not profile(bad, 10.0, 10.0)[0]


def test_the_profile_is_the_one_that_ruckig_finds(rng: np.random.Generator, count: Count) -> None:
    other = VelocityProfile()
    for _ in range(count(100_000)):
        v = rng.choice([1.0, rng.uniform(0.0, 1.0)])
        a_s, j_s = 10.0 ** rng.uniform(-3.0, 3.0), 10.0 ** rng.uniform(-1.0, 6.0)
        found, durations, jerks = profile(v, a_s, j_s)
        assert found and other.calculate(v, 0.0, 0.0, a_s, j_s)
        assert durations.sum() == pytest.approx(other.durations.sum(), rel=1e-9)
        # integrated by hand: at rest at the end, never beyond either limit
        speed = v + jerks[0] * durations[0] ** 2 / 2.0
        peak = jerks[0] * durations[0]
        speed += peak * durations[1]
        speed += peak * durations[2] + jerks[2] * durations[2] ** 2 / 2.0
        assert abs(speed) <= 1e-12 and abs(peak) <= a_s * (1.0 + 1e-12)
        assert abs(jerks).max() <= j_s


def part_by_part(case: Case) -> tuple[PathManoeuvre, bool]:
    """Search as for any other change of speed: candidates one by one, each with ruckig's profile."""
    manoeuvre = PathManoeuvre(case.limits, steps=12, step_s=STEP_S, positions=True)
    search = AccelerationSearch(limit_rows(case.limits), 12)
    trajectory, state = case.motion.trajectory, case.state
    for number, (a_s, j_s) in enumerate(search.candidates(trajectory, state, 0.0), 1):
        manoeuvre.candidates = number
        if manoeuvre.candidate(trajectory, 0, state, 0.0, a_s, j_s):
            manoeuvre.a_s, manoeuvre.j_s = a_s, j_s
            return manoeuvre, True
        if manoeuvre.acceptance.name == "BEYOND_PATH":
            break
    return manoeuvre, False


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "accelerated"])
def test_the_search_is_that_of_its_parts(kind: str, rng: np.random.Generator, count: Count) -> None:
    stopped = 0
    for case in random_cases(rng, kind, count(4000)):
        expected, possible = part_by_part(case)
        ours = PathManoeuvre(case.limits, steps=12, step_s=STEP_S, positions=True)
        assert ours.search(case.motion.trajectory, 0, case.state, 0.0) == possible
        assert ours.acceptance == expected.acceptance
        assert ours.candidates == expected.candidates
        if possible:
            stopped += 1
            assert (ours.a_s, ours.j_s) == (expected.a_s, expected.j_s)
            a, b = ours.path[0], expected.path[0]
            assert a["t"][a["n"]] == pytest.approx(b["t"][b["n"]], rel=1e-9)
            assert a["s_end"] == pytest.approx(b["s_end"], rel=1e-9)
        else:
            assert ours.excess.joint == expected.excess.joint
    assert stopped > 0


def test_many_plans_are_those_made_one_by_one(rng: np.random.Generator, count: Count) -> None:
    ready = 0
    for case in random_cases(rng, "near_limits", count(2000)):
        trajectory, n = case.motion.trajectory, len(case.limits.joints)
        cycle = rng.choice([0.001, 0.01])
        settings = PlanSettings(
            cycle_s=cycle,
            delay=(0.0, 0.0),
            q_error=np.zeros(n),
            dq_error=np.zeros(n),
            allow_joint_space=False,
        )
        planner = ShortTermPlanner(case.limits, settings)
        begins = case.state.s + cycle * np.arange(4)
        begins = begins[begins + cycle <= trajectory.s_max]
        stops = SteadyStops(12, (settings.slice_s, True))
        plans = np.zeros(len(begins), dtype=stop_kernels.PLANS)
        stop_kernels.plan_stops(
            begins,
            cycle,
            trajectory.kernel_breaks,
            trajectory.kernel_coefficients,
            float(trajectory.s_max),
            limit_rows(case.limits),
            *stops.settings,
            np.zeros(1, dtype=path_kernels.PATH),
            stops.ahead,
            np.zeros(1, dtype=limit_kernels.WORK),
            stops.search,
            plans,
        )
        for s, plan in zip(begins, plans, strict=True):
            result = planner.plan(trajectory, float(s), float(s))
            assert (plan["outcome"] == stop_kernels.READY) == (result.outcome is PlanOutcome.READY)
            if result.outcome is PlanOutcome.READY:
                ready += 1
                slices = planner.slices[0]
                assert plan["n"] == slices["n"]
                assert s + plan["duration"] == result.t_rest
                assert plan["s_rest"] == result.s_rest
                ends = slices["t"][: slices["n"] + 1]
                assert np.array_equal(s + plan["t"][: plan["n"] + 1], ends)
                assert plan["longest"] >= np.diff(ends).max() - 1e-12
                at = [trajectory.sample(float(each))[0] for each in plan["s"][: plan["n"] + 1]]
                assert np.allclose(at, slices["q"][: slices["n"] + 1, :n], rtol=0.0, atol=1e-12)
    assert ready > 0


def predicted(v: float, a_s: float, j_s: float, limits: np.ndarray, margin: float, ahead: np.void) -> bool:
    """The 17 instants of a stop from ṡ = v in plain NumPy, each from the begin."""
    direction = -1.0 if v > 0.0 else 1.0
    peak = math.sqrt(j_s * v)
    hold = 0.0 if peak <= a_s else v / a_s - a_s / j_s
    peak = min(peak, a_s)
    build = peak / j_s
    phases = [(j_s * direction, build, 5), (0.0, hold, 7), (-j_s * direction, build, 5)]
    x, speed, acceleration = 0.0, v, 0.0
    for j, duration, points in phases:
        for tau in np.linspace(0.0, duration, points):
            at = x + tau * (speed + tau * (0.5 * acceleration + tau * j / 6.0))
            v_at, a_at = speed + tau * (acceleration + 0.5 * tau * j), acceleration + tau * j
            if not 0.0 <= at <= ahead["length"]:
                return False
            place = (len(ahead["d"]) - 1) * math.sqrt(at / ahead["length"])
            k = min(int(place), len(ahead["d"]) - 2)
            n = limits.shape[1]
            d = (ahead["d"][k] + (place - k) * (ahead["d"][k + 1] - ahead["d"][k]))[:, :n]
            used = [
                abs(d[0] * v_at) / limits[2],
                abs(d[1] * v_at**2 + d[0] * a_at) / limits[3],
                abs(d[2] * v_at**3 + 3.0 * d[1] * v_at * a_at + d[0] * j) / limits[4],
            ]
            if not np.max(used) <= margin:
                return False
        x += duration * (speed + duration * (0.5 * acceleration + duration * j / 6.0))
        speed += duration * (acceleration + 0.5 * duration * j)
        acceleration += duration * j
    return True


def test_predictions_are_those_of_plain_numpy(rng: np.random.Generator, count: Count) -> None:
    answers = []
    for case in random_cases(rng, "curved", count(2000)):
        limits, trajectory = limit_rows(case.limits), case.motion.trajectory
        ahead, work = np.zeros(1, dtype=search_kernels.AHEAD), np.zeros(1, dtype=limit_kernels.WORK)
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        s, v = case.state.s, case.state.sdot
        search_kernels.look_ahead(b, c, s, v, 0.0, 0.0, limits, ahead, work)
        share = (np.arange(65) / 64.0) ** 2 * ahead[0]["length"]
        for k in (0, 13, 40, 64):
            there = min(s + share[k], trajectory.breaks[-1])
            d = [each[0] for each in case.motion.derivatives(np.array([there]))[1:]]
            n = limits.shape[1]
            scale = 1.0 + np.abs(d).max()
            assert np.allclose(ahead[0]["d"][k, :, :n], d, rtol=0.0, atol=1e-6 * scale)
        for _ in range(20):
            a_s, j_s = 10.0 ** rng.uniform(-1.0, 2.0), 10.0 ** rng.uniform(0.0, 4.0)
            margin = rng.uniform(0.3, 2.0)
            ours = search_kernels._predicted(v, 0.0, 0.0, a_s, j_s, limits, margin, ahead)
            answers.append(ours)
            if ours != predicted(v, a_s, j_s, limits, margin, ahead[0]):
                # on the very border roundings decide
                near = {predicted(v, a_s, j_s, limits, margin * f, ahead[0]) for f in (1 - 1e-9, 1 + 1e-9)}
                assert near == {True, False}
    assert 0.02 < np.mean(answers) < 0.98


def test_nan_plans_nothing() -> None:
    (case,) = random_cases(np.random.default_rng(3), "curved", 1)
    manoeuvre = PathManoeuvre(case.limits, steps=12, step_s=STEP_S, positions=True)
    for state in (PathState(math.nan, 1.0), PathState(0.1, math.nan), PathState(0.1, -1.0)):
        assert not manoeuvre.search(case.motion.trajectory, 0, state, 0.0)
