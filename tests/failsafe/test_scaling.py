"""Enclosures of derivatives and of the executed motion, and the proof that limits are kept."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq, fmpq_poly

from failsafe import limit_kernels, path_kernels, search_kernels, trajectory_kernels
from failsafe.manoeuvre import Acceptance, PathManoeuvre, VelocityProfile
from failsafe.scaling import PathState, conservative_budget, derivative_bounds, limit_rows
from failsafe.trajectory import IntendedTrajectory
from tests.failsafe.motions import (
    excess,
    executed,
    instants,
    limits_of,
    random_cases,
    random_limits,
    random_motion,
)
from tests.oracles.intervals import Interval, outward

NAN = math.nan


def rational(x: float) -> fmpq:
    fraction = Fraction(float(x))
    return fmpq(fraction.numerator, fraction.denominator)


def exact_derivatives(trajectory: IntendedTrajectory, span: int, joint: int) -> list[fmpq_poly]:
    """q … q''' of one span as polynomials with the very coefficients, no rounding."""
    polynomial = fmpq_poly([rational(c) for c in trajectory.coefficients[span, :, joint]])
    out = [polynomial]
    for _ in range(3):
        out.append(out[-1].derivative())
    return out


@pytest.mark.parametrize("spans", [1, 2, 5, 8])
def test_a_span_is_found_by_its_begin(spans):
    """Outside it is the first or the last one; what lies behind the breaks in memory is not looked at."""
    memory = np.concatenate([np.arange(spans + 1.0), np.zeros(9)])
    breaks = memory[: spans + 1]
    for s in (-1.0, *np.arange(0.0, spans + 1.5, 0.5), *(math.nextafter(each, -9.0) for each in breaks), 1e9):
        expected = min(max(math.floor(s), 0), spans - 1)
        assert trajectory_kernels.locate(breaks, float(s)) == expected


def test_derivative_bounds_contain_exact_values(rng, count):
    """Rational arithmetic, no tolerance; intervals of width 0, within a span and over several."""
    for _ in range(count(5_000)):
        trajectory = random_motion(rng, random_limits(rng, 2), rng.uniform(0.1, 3.0)).trajectory
        length = trajectory.s_end * rng.choice([0.0, 1e-6, 0.01, 0.3])
        s0 = rng.uniform(0.0, trajectory.s_end - length)
        s1 = s0 + length
        lo, hi = derivative_bounds(trajectory, s0, s1)
        for s in {s0, s1, *rng.uniform(s0, s1, 4)}:
            m = min(int(np.searchsorted(trajectory.breaks, s, side="right")) - 1, trajectory.spans - 1)
            x = rational(s) - rational(trajectory.breaks[m])
            for joint in range(2):
                for d, polynomial in enumerate(exact_derivatives(trajectory, m, joint)):
                    value = polynomial(x)
                    assert rational(lo[d, joint]) <= value <= rational(hi[d, joint])


def test_derivative_bounds_are_no_wider_than_interval_arithmetic(rng, count):
    """Against codac: Horner's scheme in intervals about the centre, with the coefficients about it."""
    for _ in range(count(5_000)):
        trajectory = random_motion(rng, random_limits(rng, 1), 0.8).trajectory
        m = int(rng.integers(0, trajectory.spans))
        b0, b1 = trajectory.breaks[m : m + 2]
        s0, s1 = np.sort(rng.uniform(b0, b1, 2))
        lo, hi = derivative_bounds(trajectory, s0, s1)
        centre = 0.5 * (s0 + s1)
        for d, polynomial in enumerate(exact_derivatives(trajectory, m, 0)):
            about = polynomial(fmpq_poly([rational(centre) - rational(b0), 1]))
            terms = [float(Fraction(int(c.p), int(c.q))) for c in reversed(about.coeffs())]
            with outward():
                w = Interval(s0 - centre, s1 - centre)
                enclosure = Interval(0.0)
                for term in terms:
                    enclosure = enclosure * w + Interval(term)
                low, high = enclosure.lb(), enclosure.ub()
            slack = 1e-9 * max(abs(low), abs(high), 1e-9)
            assert lo[d, 0] >= low - slack and hi[d, 0] <= high + slack


def test_derivative_bounds_are_exact_up_to_second_order(rng, count):
    """What they are too wide by is at most (s1 - s0)² times the largest second derivative."""
    for _ in range(count(5_000)):
        trajectory = random_motion(rng, random_limits(rng, 1), 0.8).trajectory
        m = int(rng.integers(0, trajectory.spans))
        x0, x1 = np.sort(rng.uniform(*(trajectory.breaks[m : m + 2] - trajectory.breaks[m]), 2))
        lo, hi = derivative_bounds(trajectory, trajectory.breaks[m] + x0, trajectory.breaks[m] + x1)
        x = np.linspace(x0, x1, 400)
        p = np.polynomial.Polynomial(trajectory.coefficients[m, :, 0])
        for d in range(4):
            values, bend = p.deriv(d)(x) if d else p(x), np.abs(p.deriv(d + 2)(x)).max()
            too_wide = (hi[d, 0] - values.max()) + (values.min() - lo[d, 0])
            assert too_wide <= (x1 - x0) ** 2 * bend + 1e-9 * np.abs(values).max()


def test_derivative_bounds_twin(rng, count):
    """The same Taylor form in plain NumPy."""
    for _ in range(count(5_000)):
        trajectory = random_motion(rng, random_limits(rng, 3), 0.8).trajectory
        s0, s1 = np.sort(rng.uniform(0.0, trajectory.s_end, 2))
        lo, hi = derivative_bounds(trajectory, s0, s1)
        low, high = np.full((4, 3), np.inf), np.full((4, 3), -np.inf)
        for m in range(trajectory.spans):
            x0, x1 = np.clip([s0, s1], *trajectory.breaks[m : m + 2]) - trajectory.breaks[m]
            if x1 <= x0:
                continue
            w = (x1 - x0) / 2
            for j in range(3):
                p = np.polynomial.Polynomial(trajectory.coefficients[m, :, j])
                for d in range(4):
                    taylor = [
                        (p.deriv(d + k)((x0 + x1) / 2) if d + k else p((x0 + x1) / 2)) / math.factorial(k)
                        for k in range(6 - d)
                    ]
                    odd = sum(abs(c) * w**k for k, c in enumerate(taylor) if k % 2)
                    up = sum(max(c, 0) * w**k for k, c in enumerate(taylor) if k and k % 2 == 0)
                    down = sum(min(c, 0) * w**k for k, c in enumerate(taylor) if k and k % 2 == 0)
                    low[d, j] = min(low[d, j], taylor[0] + down - odd)
                    high[d, j] = max(high[d, j], taylor[0] + up + odd)
        scale = 1e-9 * (np.abs(low) + np.abs(high) + 1e-6)
        assert (np.abs(lo - low) <= scale).all() and (np.abs(hi - high) <= scale).all()


@pytest.mark.parametrize(("s0", "s1"), [(NAN, 1.0), (0.0, NAN), (-1.0, 1.0), (1.0, 0.5), (0.0, 1e9)])
def test_no_derivative_bounds_outside_what_is_known(s0, s1, rng):
    trajectory = random_motion(rng, random_limits(rng, 2), 0.8).trajectory
    lo, hi = derivative_bounds(trajectory, s0, s1)
    assert np.isnan(lo).all() and np.isnan(hi).all()


# Executed motion


def a_stop(case) -> np.ndarray | None:
    """A path record with some stop, whether it keeps the limits or not."""
    v, a = case.state.sdot, case.state.sddot
    profile, path = VelocityProfile(), np.zeros(1, path_kernels.PATH)
    pair = (max(abs(a), 1.0) * 2.0, 60.0)
    if not profile.calculate(v, a, 0.0, *pair):
        return None
    verdict = path_kernels.append_profile(
        path, 0, *case.state, profile.durations, profile.jerks, 0.0, *pair, case.motion.trajectory.s_max
    )
    return path if verdict == Acceptance.ACCEPTED and path["n"][0] > 0 else None


def test_enclosures_contain_the_executed_motion(rng, count):
    checked = 0
    for case in random_cases(rng, "accelerated", count(20_000)):
        path = a_stop(case)
        if path is None:
            continue
        work = np.zeros(1, limit_kernels.WORK)
        trajectory = case.motion.trajectory
        n = trajectory.n_joints
        for k in range(int(path["n"][0])):
            tau0, tau1 = np.sort(rng.uniform(*path["t"][0, k : k + 2], 2))
            s0 = path_kernels.path_state(path, k, tau0)[0]
            b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
            limit_kernels.bound_motion(path, k, tau0, tau1, b, c, trajectory_kernels.locate(b, s0), work)
            motion = executed(case.motion, path[0], np.linspace(tau0, tau1, 50))
            enclosures = [(work["lo"][0, 0], work["hi"][0, 0])]
            enclosures += [work[name][0] for name in ("dq", "ddq", "dddq")]
            for values, (low, high) in zip(motion, enclosures, strict=True):
                slack = 1e-7 * (np.abs(values).max(axis=0) + 1e-6)
                assert (values >= low[:n] - slack).all() and (values <= high[:n] + slack).all()
            checked += 1
    assert checked > 0


def chain_rule_in_intervals(states, lo, hi) -> dict[str, tuple[float, float]]:
    """Bounds of dq, ddq, dddq from states (T, 4) of s, ṡ, s̈, s⃛ and bounds of q … q''' (4,)."""
    with outward():
        v = Interval(states[:, 1].min(), states[:, 1].max())
        a = Interval(states[:, 2].min(), states[:, 2].max())
        j = Interval(states[0, 3])
        d1, d2, d3 = (Interval(lo[d], hi[d]) for d in (1, 2, 3))
        found = {
            "dq": d1 * v,
            "ddq": d2 * (v * v) + d1 * a,
            "dddq": d3 * (v * v * v) + 3.0 * d2 * (v * a) + d1 * j,
        }
        return {name: (x.lb(), x.ub()) for name, x in found.items()}


def test_chain_rule_agrees_with_interval_arithmetic(rng, count):
    """Against codac with the same enclosures of q', q'', q''', ṡ and s̈: neither narrower nor much wider."""
    for case in random_cases(rng, "accelerated", count(5_000)):
        path = a_stop(case)
        if path is None:
            continue
        work = np.zeros(1, limit_kernels.WORK)
        trajectory = case.motion.trajectory
        b, c = trajectory.kernel_breaks, trajectory.kernel_coefficients
        t0, t1 = path["t"][0, :2]
        tau0, tau1 = t0 + 0.3 * (t1 - t0), t0 + 0.6 * (t1 - t0)
        states = np.array([path_kernels.path_state(path, 0, x) for x in np.linspace(tau0, tau1, 200)])
        limit_kernels.bound_motion(
            path, 0, tau0, tau1, b, c, trajectory_kernels.locate(b, states[0, 0]), work
        )
        for i in range(trajectory.n_joints):
            theirs = chain_rule_in_intervals(states, work["lo"][0, :, i], work["hi"][0, :, i])
            for name, (least, most) in theirs.items():
                low, high = work[name][0, :, i]
                near = 1e-4 * (abs(low) + abs(high) + 1e-9)  # ṡ between the instants
                assert low <= least + near and high >= most - near
                assert low >= least - near and high <= most + near


def test_what_is_proven_keeps_the_limits_and_what_is_not_comes_close(rng, count):
    proven = refused = 0
    for kind in ("curved", "near_limits", "rough", "accelerated"):
        for case in random_cases(rng, kind, count(20_000)):
            path = a_stop(case)
            if path is None:
                continue
            planner = PathManoeuvre(case.limits, steps=1, step_s=0.01, positions=False)
            _, *motion = executed(case.motion, path[0], instants(path[0], 200))
            used = excess(case.limits, *motion)
            if planner.proven(case.motion.trajectory, path, 0):
                proven += 1
                assert used <= 1.0 + 1e-9
            else:
                refused += 1
                assert used > 0.97
                joint, quantity, value, limit = planner.excess
                bound = (case.limits.velocity, case.limits.acceleration, case.limits.jerk)[quantity - 1]
                assert limit == bound[joint] and abs(value) > limit
    assert proven > 0 and refused > 0


def test_nothing_is_proven_with_nan_in(rng):
    case = next(random_cases(rng, "curved", 1))
    trajectory = case.motion.trajectory
    huge = np.full(trajectory.n_joints, 1e9)
    limits = limit_rows(limits_of(huge, huge, huge))
    case = type(case)(case.limits, case.motion, PathState(0.4 * trajectory.s_end, 0.9, 0.3))
    path = a_stop(case)
    assert path is not None
    n = int(path["n"][0])
    good = (path, 0, n, trajectory.kernel_breaks, trajectory.kernel_coefficients, limits, 0.01, True)
    assert limit_kernels.proven(*good, np.zeros(1, limit_kernels.WORK))
    for name in ("t", "s", "v", "a", "j", "s_end", "v_end"):
        for k in range(n if path.dtype[name].shape else 1):
            spoilt = path.copy()
            spoilt[name][(0, k) if path.dtype[name].shape else 0] = NAN
            if name in ("s", "v", "a") and k == n - 1:
                continue  # the last segment is evaluated from its end
            assert not limit_kernels.proven(spoilt, *good[1:], np.zeros(1, limit_kernels.WORK)), (name, k)
    m = trajectory_kernels.locate(good[3], path["s"][0, 0])
    for power in range(6):
        for joint in range(trajectory.n_joints):
            coefficients = good[4].copy()
            coefficients[m, power, joint] = NAN
            coefficients.setflags(write=False)  # as the trajectory's: no second compilation
            assert not limit_kernels.proven(
                *good[:4], coefficients, *good[5:], np.zeros(1, limit_kernels.WORK)
            )
    breaks = good[3].copy()
    breaks[m] = NAN
    breaks.setflags(write=False)
    assert not limit_kernels.proven(*good[:3], breaks, *good[4:], np.zeros(1, limit_kernels.WORK))
    for row in range(5):
        for joint in range(trajectory.n_joints):
            tight = limits.copy()
            tight[row, joint] = NAN
            assert not limit_kernels.proven(*good[:5], tight, *good[6:], np.zeros(1, limit_kernels.WORK))
    assert not limit_kernels.proven(*good[:6], NAN, True, np.zeros(1, limit_kernels.WORK))


@pytest.mark.parametrize("spoilt", range(3))
def test_no_conservative_budget_from_nan(spoilt, rng):
    case = next(random_cases(rng, "curved", 1))
    state = list(case.state)
    state[spoilt] = NAN
    assert conservative_budget(case.motion.trajectory, case.limits, PathState(*state)) is None


@pytest.mark.parametrize("spoilt", range(3))
def test_no_prediction_from_nan(spoilt, rng):
    """Predictions prove nothing, but must neither hang nor read beyond their table."""
    case = next(random_cases(rng, "curved", 1))
    planner = PathManoeuvre(case.limits, steps=12, step_s=0.01, positions=False)
    state = list(case.state)
    state[spoilt] = NAN
    assert not planner.search(case.motion.trajectory, 0, PathState(*state), 0.0)


def test_closed_form_of_the_prediction_is_the_profile(rng, count):
    """Duration of build-up, hold and release against ruckig."""
    for _ in range(count(20_000)):
        v, target = rng.uniform(0.0, 1.2), rng.choice([0.0, 1.0])
        a_s, j_s = 10.0 ** rng.uniform(-1, 2), 10.0 ** rng.uniform(0, 4)
        a = rng.uniform(-a_s, a_s)
        profile = VelocityProfile()
        assert profile.calculate(v, a, target, a_s, j_s)
        _, peak, *phases = search_kernels._phases(v, a, target, a_s, j_s)
        assert sum(phases) == pytest.approx(profile.durations.sum(), rel=1e-6, abs=1e-9)
        assert peak <= a_s
