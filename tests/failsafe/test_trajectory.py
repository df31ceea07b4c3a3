"""The intended trajectory and its fit to samples."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_lsq_spline

from failsafe.manoeuvre import come_to_rest
from failsafe.trajectory import FitSettings, IntendedTrajectory, TrajectoryError, fit_breaks, fit_samples
from robots.limits import JointLimits
from tests.failsafe.motions import limits_of, random_limits, random_motion

NAN = math.nan


def irregular(rng: np.random.Generator, samples: int, gaps: float = 0.02) -> np.ndarray:
    """Sample times with jitter and gaps of up to a second."""
    step = rng.exponential(0.005, samples) + 1e-4
    return np.cumsum(step + np.where(rng.random(samples) < gaps, rng.uniform(0.1, 1.0, samples), 0.0))


# Bad input


@pytest.mark.parametrize("spacing", [0.0, -1.0, NAN, math.inf])
def test_knot_spacing_must_be_positive_and_finite(spacing):
    with pytest.raises(TrajectoryError, match="knot spacing"):
        FitSettings(knot_spacing_s=spacing)


@pytest.mark.parametrize("degree", [2, 6, 0])
def test_degree_must_be_3_to_5(degree):
    with pytest.raises(TrajectoryError, match=f"degree {degree}"):
        FitSettings(degree=degree)


def spoilt(**changes):
    t, q = np.linspace(0.0, 1.0, 50), np.zeros((50, 2))
    for name, (index, value) in changes.items():
        {"t": t, "q": q}[name][index] = value
    return t, q


@pytest.mark.parametrize(
    ("t", "q", "message"),
    [
        (*spoilt(q=((7, 1), NAN)), "joint 1 at .* s is not finite"),
        (*spoilt(q=((7, 0), math.inf)), "joint 0 at .* s is not finite"),
        (*spoilt(t=(3, NAN)), "sample time 3 is not finite"),
        (*spoilt(t=(3, 0.0)), "should increase, but"),
        (np.linspace(1.0, 0.0, 50), np.zeros((50, 2)), "should increase, but"),
        (np.linspace(0.0, 1.0, 5), np.zeros((5, 2)), "5 samples are too few"),
        (np.linspace(0.0, 1.0, 50), np.zeros((49, 2)), "shapes"),
        (np.linspace(0.0, 1.0, 50), np.zeros(50), "shapes"),
        (np.linspace(0.0, 1.0, 50), np.zeros((50, 0)), "shapes"),
        (1.7e9 + np.linspace(0.0, 1.0, 50), np.zeros((50, 2)), "near epoch"),
    ],
)
def test_unusable_samples_are_refused_in_one_line(t, q, message):
    with pytest.raises(TrajectoryError, match=message) as caught:
        fit_samples(t, q)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("breaks", "coefficients", "end", "message"),
    [
        ([0.0], np.zeros((0, 6, 1)), "cut", "breaks .* shape"),
        ([0.0, 1.0], np.zeros((2, 6, 1)), "cut", "coefficients .* shape"),
        ([0.0, 1.0], np.zeros((1, 7, 1)), "cut", "coefficients .* shape"),
        ([0.0, 1.0], np.zeros((1, 6, 0)), "cut", "coefficients .* shape"),
        ([0.0, NAN], np.zeros((1, 6, 1)), "cut", "finite"),
        ([0.0, 1.0], np.full((1, 6, 1), NAN), "cut", "finite"),
        ([0.0, 1.0, 1.0], np.zeros((2, 6, 1)), "cut", "should increase"),
        ([0.0, 2e9], np.zeros((1, 6, 1)), "cut", "near epoch"),
        ([0.0, 1.0], np.zeros((1, 6, 1)), "stop", "'cut' or 'rest'"),
        ([0.0, 1.0, 2.0], [[[0.0], [0.0]], [[1.0], [0.0]]], "cut", "q of joint 0 jumps by 1 at s = 1 s"),
        ([0.0, 1.0, 2.0], [[[0.0], [0.0]], [[0.0], [1.0]]], "cut", "q' of joint 0 jumps"),
        ([0.0, 1.0, 2.0], [[[0.0], [0.0], [0.0]], [[0.0], [0.0], [1.0]]], "cut", "q'' of joint 0 jumps by 2"),
        ([0.0, 1.0], [[[0.0], [1.0]]], "rest", "q' of joint 0 is 1 at the end"),
        ([0.0, 1.0], [[[0.0], [-2.0], [1.0]]], "rest", "q'' of joint 0 is 2 at the end"),
    ],
)
def test_impossible_trajectories_are_refused_in_one_line(breaks, coefficients, end, message):
    with pytest.raises(TrajectoryError, match=message) as caught:
        IntendedTrajectory(breaks, coefficients, end)
    assert "\n" not in str(caught.value)


# The trajectory


def test_sample_agrees_with_the_spline(rng):
    for degree in (3, 4, 5):
        motion = random_motion(rng, random_limits(rng, 4), 0.8, degree)
        s = np.sort(rng.uniform(0.0, motion.trajectory.s_end, 500))
        for ours, theirs in zip(motion.trajectory.sample(s), motion.derivatives(s), strict=True):
            assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


def test_nothing_is_known_outside_a_cut_trajectory(rng):
    trajectory = random_motion(rng, random_limits(rng, 2), 0.8).trajectory
    for s in (-1e-9, trajectory.s_end + 1e-9, NAN, math.inf):
        assert all(np.isnan(d).all() for d in trajectory.sample(s))


def test_a_trajectory_that_ends_at_rest_is_constant_beyond():
    # 10 x³ - 15 x⁴ + 6 x⁵ goes from rest to rest
    trajectory = IntendedTrajectory([0.0, 1.0], np.array([0.0, 0, 0, 10, -15, 6]).reshape(1, 6, 1), "rest")
    q, dq, ddq, _ = trajectory.sample([1.0, 1.5, 1e5])
    assert np.array_equal(q, np.ones((3, 1))) and not dq.any() and not ddq.any()
    assert trajectory.s_max == math.inf and trajectory.breaks.tolist() == [0.0, 1.0]
    assert trajectory.coefficients.shape == (1, 6, 1)


def test_come_to_rest_continues_smoothly_within_the_limits(rng, count):
    joined = 0
    for _ in range(count(2_000)):
        n = int(rng.integers(1, 8))
        limits = random_limits(rng, n)
        cut = random_motion(rng, limits, 0.9).trajectory
        try:
            rest = come_to_rest(cut, limits)
        except TrajectoryError as error:  # it may be about to exceed its velocity
            assert "velocity of joint" in str(error)
            continue
        joined += 1
        assert rest.end == "rest"
        s = np.linspace(cut.s_end, rest.s_end, 400)
        _, dq, ddq, dddq = rest.sample(s)
        assert (np.abs(dq) <= limits.velocity * (1 + 1e-6)).all()
        assert (np.abs(ddq) <= limits.acceleration * (1 + 1e-6)).all()
        assert (np.abs(dddq) <= limits.jerk * (1 + 1e-6)).all()
        assert np.allclose(
            np.array(rest.sample(cut.s_end)[:3]), np.array(cut.sample(cut.s_end)[:3]), atol=1e-8
        )
        assert np.allclose(rest.sample(rest.s_end + 1.0)[0], rest.sample(rest.s_end)[0], atol=1e-12)
        assert come_to_rest(rest, limits) is rest
    assert joined > 0.7 * count(2_000)


def test_come_to_rest_refuses_a_state_beyond_the_limits():
    moving = IntendedTrajectory([0.0, 1.0], [[[0.0], [3.0]]])
    limits = limits_of(np.array([2.0]), np.array([10.0]), np.array([100.0]))
    with pytest.raises(TrajectoryError, match=r"velocity of joint joint_0 would be 3, limit 2"):
        come_to_rest(moving, limits)
    near = limits_of(np.array([4.0]), np.array([10.0]), np.array([100.0]), upper=np.array([3.1]))
    with pytest.raises(TrajectoryError, match=r"position of joint joint_0 would be"):
        come_to_rest(moving, near)


# The fit


def test_polynomials_up_to_degree_5_are_fitted_exactly(rng, count):
    for _ in range(count(10_000)):
        t = irregular(rng, int(rng.integers(6, 300)), rng.choice([0.0, 0.02, 0.3]))
        c = rng.normal(size=(6, 3))
        x = (t - t[0]) / (t[-1] - t[0])
        fit = fit_samples(t, np.vander(x, 6) @ c, FitSettings(10.0 ** rng.uniform(-2, 0)))
        u = np.linspace(0.0, 1.0, 400)
        q = fit.trajectory.sample(np.clip(t[0] + u * (t[-1] - t[0]), t[0], t[-1]))[0]
        assert fit.residual.max() < 1e-9
        if fit.longest_gap_s < 0.5 * (t[-1] - t[0]):  # else the samples themselves say too little
            assert np.abs(q - np.vander(u, 6) @ c).max() < 1e-9


def test_splines_on_the_same_knots_are_fitted_exactly(rng, count):
    for _ in range(count(2_000)):
        t = irregular(rng, int(rng.integers(50, 800)))
        settings = FitSettings(10.0 ** rng.uniform(-1.5, -0.5), int(rng.integers(3, 6)))
        k = settings.degree
        breaks = fit_breaks(t, settings)
        knots = np.concatenate([np.repeat(breaks[0], k), breaks, np.repeat(breaks[-1], k)])
        truth = BSpline(knots, rng.normal(size=(knots.shape[0] - k - 1, 2)), k)
        fit = fit_samples(t, truth(t), settings)
        u = np.linspace(t[0], t[-1], 3000)
        assert np.abs(fit.trajectory.sample(u)[0] - truth(u)).max() < 1e-9
        assert fit.residual.max() < 1e-14  # what the refinement is for


def test_fit_is_the_least_squares_spline(rng):
    """Against scipy's own fit, over more samples than one chunk holds."""
    t = np.cumsum(rng.uniform(0.0007, 0.0013, 20_000))
    q = np.cumsum(rng.normal(size=(20_000, 2)), axis=0) * 1e-3
    fit = fit_samples(t, q)
    knots = np.concatenate([np.repeat(t[0], 5), fit.trajectory.breaks, np.repeat(t[-1], 5)])
    theirs = make_lsq_spline(t, q, knots, 5)
    assert np.abs(fit.trajectory.sample(t)[0] - theirs(t)).max() < 1e-9
    assert np.array_equal(fit.residual, np.abs(fit.residual_samples).max(axis=0))
    assert np.abs(fit.residual_samples - (q - theirs(t))).max() < 1e-9
    assert np.allclose(fit.residual_rms, np.sqrt(np.mean((q - theirs(t)) ** 2, axis=0)))


def test_single_precision_samples_are_taken_as_they_are(rng):
    t = np.linspace(0.0, 2.0, 2000)
    q = np.sin(t)[:, None].astype(np.float32)
    fit = fit_samples(t, q)
    assert np.abs(fit.residual_samples - (q.astype(float) - fit.trajectory.sample(t)[0])).max() < 1e-12


def test_knots_keep_their_spacing_where_samples_are_dense(rng):
    t = np.cumsum(rng.uniform(0.0007, 0.0013, 5000))
    lengths = np.diff(fit_breaks(t, FitSettings(0.05)))
    assert np.abs(lengths[1:-1] - 0.05).max() < 0.002
    assert np.abs(lengths[[0, -1]] - 0.15).max() < 0.006


def test_knots_widen_around_a_gap_and_the_fit_stays_sane(rng):
    t = np.concatenate([np.arange(0.0, 2.0, 0.001), np.arange(2.4, 4.0, 0.001)])
    q = np.sin(3.0 * t)[:, None] + rng.uniform(-5e-5, 5e-5, (t.shape[0], 1))
    fit = fit_samples(t, q)
    lengths = np.diff(fit.trajectory.breaks)
    assert lengths.max() > 0.4 and lengths.min() > 0.03
    inside = lengths[1:-1]
    assert (inside[1:] / inside[:-1]).max() < 2.5 and (inside[:-1] / inside[1:]).max() < 2.5
    u = np.linspace(0.0, 4.0, 4000)
    u = u[u <= t[-1]]
    assert np.abs(fit.trajectory.sample(u)[0][:, 0] - np.sin(3.0 * u)).max() < 2e-3
    assert fit.longest_gap_s == pytest.approx(0.401, abs=2e-3)


def test_every_span_has_samples(rng, count):
    for _ in range(count(10_000)):
        t = irregular(rng, int(rng.integers(6, 500)), rng.choice([0.0, 0.05, 0.5]))
        breaks = fit_breaks(t, FitSettings(10.0 ** rng.uniform(-3, 0)))
        held = np.histogram(t, breaks)[0]
        assert breaks[0] == t[0] and breaks[-1] == t[-1] and (np.diff(breaks) > 0).all()
        assert t.shape[0] >= breaks.shape[0] - 1 + 5
        assert held.min() >= 1


# Real recordings


def panda_limits() -> JointLimits:
    """Velocity, acceleration, jerk of the Franka Panda as its maker publishes them (libfranka
    documentation)."""
    return limits_of(
        np.array([2.175] * 4 + [2.61] * 3),
        np.array([15, 7.5, 10, 12.5, 15, 20, 20]),
        np.array([7500, 3750, 5000, 6250, 7500, 10000, 10000]),
    )


@pytest.mark.real_data
def test_panda_recording_is_fitted_within_its_jitter(real_data):
    data = np.load(real_data / "robot" / "franka_panda_exciting_trajectory.npz")
    t, q = data["t"], data["q"].astype(float)
    fit = fit_samples(t, q)
    assert fit.longest_gap_s == pytest.approx(8.8e-3, abs=1e-4)
    assert fit.residual.max() < 7e-3 and np.sqrt(np.mean(fit.residual_samples**2)) < 5e-4
    # what is left is jitter of the receive times: one shift of time per sample, common to all joints,
    # explains it down to the rounding of q
    velocity = fit.trajectory.sample(t)[1]
    shift = (fit.residual_samples * velocity).sum(axis=1) / (velocity**2).sum(axis=1)
    unexplained = fit.residual_samples - shift[:, None] * velocity
    assert np.abs(unexplained).max() < 1e-4
    moving = np.abs(velocity).max(axis=1) > 0.1
    assert np.abs(shift[moving]).max() < 8.8e-3
    # the derivatives are those of a robot that keeps its limits, and agree with the measured velocity
    s = np.linspace(t[0], t[-1], 50_000)
    _, dq, ddq, dddq = fit.trajectory.sample(s)
    limits = panda_limits()
    assert (np.abs(dq) < limits.velocity).all()
    assert (np.abs(ddq) < limits.acceleration).all()
    assert (np.abs(dddq) < limits.jerk).all()
    assert np.sqrt(np.mean((velocity - data["dq"]) ** 2)) < 0.02


@pytest.mark.real_data
def test_schunk_runs_are_fitted_closely_up_to_their_ends(real_data):
    data = np.load(real_data / "robot" / "schunk_lwa_250hz_100x_repeated_motion.npz")
    for run in (1, 25, 60):
        rows = data["run"] == run
        t, q = data["t"][rows], data["q"][rows].astype(float)
        fit = fit_samples(t, q)
        assert fit.residual.max() < 1e-3
        assert np.sqrt(np.mean((fit.trajectory.sample(t)[1] - data["dq"][rows]) ** 2)) < 0.02
        assert np.abs(fit.trajectory.sample(np.linspace(t[0], t[-1], 5000))[2]).max() < 10.0


def test_the_way_back_is_the_same_path(rng, count):
    for _ in range(max(20, count(2_000))):
        motion = smooth_motion(rng)
        back = motion.backwards()
        s = rng.uniform(motion.s_begin, motion.s_end, 50)
        there, here = motion.sample(s), back.sample(-s)
        size = 1.0 + np.abs(motion.coefficients).max()
        for d in range(4):
            assert np.abs(there[d] - (-1.0) ** d * here[d]).max() <= 1e-11 * size
        assert (back.s_begin, back.s_end, back.end) == (-motion.s_end, -motion.s_begin, "cut")
        assert np.abs(back.backwards().coefficients - motion.coefficients).max() <= 1e-11 * size


def test_what_is_left_since_a_place_is_the_same(rng):
    motion = smooth_motion(rng)
    for s in (
        motion.s_begin - 1.0,
        *motion.breaks,
        0.5 * (motion.breaks[1] + motion.breaks[2]),
        motion.s_max,
    ):
        left = motion.since(float(s))
        assert left.s_begin <= max(s, motion.s_begin) and left.s_end == motion.s_end
        places = rng.uniform(left.s_begin, left.s_end, 20)
        assert np.array_equal(left.sample(places)[0], motion.sample(places)[0])
        held = int(np.searchsorted(motion.breaks, s, side="right")) - 1
        assert left.spans == motion.spans - min(max(held, 0), motion.spans - 1)


def test_a_trajectory_may_last_longer_than_it_moves(rng):
    motion = smooth_motion(rng)
    assert motion.lasting(motion.s_end) is motion
    cut = IntendedTrajectory(motion.breaks, motion.coefficients, "cut")
    with pytest.raises(TrajectoryError, match="nothing is known"):
        cut.lasting(cut.s_end + 1.0)
    longer = motion.lasting(motion.s_end + 1.0)
    assert longer.s_end == motion.s_end + 1.0
    s = np.linspace(motion.s_begin, motion.s_end + 2.0, 100)
    assert all(np.array_equal(a, b) for a, b in zip(longer.sample(s), motion.sample(s), strict=True))


def smooth_motion(rng: np.random.Generator) -> IntendedTrajectory:
    """Quintics through random points, at rest at the end."""
    spans, breaks = int(rng.integers(3, 7)), [float(rng.uniform(-5.0, 5.0))]
    state = [rng.normal(size=3) for _ in range(3)]
    rows = []
    for m in range(spans):
        T = float(rng.uniform(0.3, 2.0))
        goal = [rng.normal(size=3) * (1.0 if d == 0 or m < spans - 1 else 0.0) for d in range(3)]
        A = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
        q, v, a = state
        right = [goal[0] - q - v * T - a * T**2 / 2, goal[1] - v - a * T, goal[2] - a]
        rows.append(np.concatenate([[q, v, a / 2], np.linalg.solve(A, np.array(right))]))
        state = [sum(rows[-1][p] * T**p for p in range(6)), goal[1], goal[2]]
        breaks.append(breaks[-1] + T)
    return IntendedTrajectory(breaks, np.array(rows), "rest")


@pytest.mark.parametrize("derivative", [1, 2])
@pytest.mark.parametrize(("pieces", "ok"), [(500, True), (5_000, False)])
def test_jumps_that_are_rounding_one_by_one_must_be_so_in_all(derivative, pieces, ok):
    """No bound of a velocity or acceleration sees what is moved between pieces."""
    c = np.zeros((pieces, 6, 1))
    c[:, derivative, 0] = 0.45e-9 * np.arange(pieces) / derivative
    h = 1e-6 / pieces
    breaks = h * np.arange(pieces + 1)
    for m in range(1, pieces):  # what is below stays continuous
        c[m, 0] = c[m - 1, 0] + h * c[m - 1, 1] + h * h * c[m - 1, 2]
        if derivative == 2:
            c[m, 1] = c[m - 1, 1] + 2.0 * h * c[m - 1, 2]
    if ok:
        IntendedTrajectory(breaks, c)
    else:
        with pytest.raises(TrajectoryError, match=rf"q{chr(39) * derivative} of joint 0 jumps by .* in all"):
            IntendedTrajectory(breaks, c)


@pytest.mark.parametrize("copied", [lambda each: pickle.loads(pickle.dumps(each)), copy.deepcopy])
def test_a_copy_is_fixed_as_the_original_is(copied, rng):
    """One that came from another process would have its kernels compiled anew, within a cycle."""
    own = random_motion(rng, random_limits(rng, 3), 0.9).trajectory
    sent = copied(own)
    for array in (sent.kernel_breaks, sent.kernel_coefficients):
        assert not array.flags.writeable
    s = np.linspace(0.0, own.s_end, 50)
    for ours, theirs in zip(own.sample(s), sent.sample(s), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert (sent.end, sent.s_max, sent.spans) == (own.end, own.s_max, own.spans)
