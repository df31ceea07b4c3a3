"""Lines through waypoints: at rest in each, as quick as the limits allow, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from failsafe.trajectory import TrajectoryError
from failsafe.waypoints import from_motion, rest_to_rest
from tests.failsafe.motions import limits_of, random_limits

NAN = float("nan")
LIMITS = limits_of(np.full(2, 1.0), np.full(2, 5.0), np.full(2, 50.0), np.full(2, -3.0), np.full(2, 3.0))


@pytest.mark.parametrize(
    ("waypoints", "share", "message"),
    [
        ([[0.0, NAN], [0.0, 0.0]], 0.5, "waypoint 0"),
        ([[0.0, 0.0], [0.0, np.inf]], 0.5, "waypoint 1: joint joint_1"),
        ([[0.0, 0.0], [3.1, 0.0]], 0.5, "outside its position limits"),
        ([[0.0, 0.0]], 0.5, "W >= 2"),
        ([[0.0], [1.0]], 0.5, "(W, 2)"),
        ([[0.0, 0.0], [1.0, 0.0]], 0.0, "share 0.0"),
        ([[0.0, 0.0], [1.0, 0.0]], 1.1, "share 1.1"),
        ([[0.0, 0.0], [1.0, 0.0]], NAN, "share nan"),
    ],
)
def test_what_is_refused(waypoints, share, message):
    with pytest.raises(TrajectoryError) as error:
        rest_to_rest(waypoints, LIMITS, share=share)
    assert message in str(error.value)


def test_it_rests_in_every_waypoint_and_one_limit_is_used_up(rng, count):
    for _ in range(count(2_000)):
        n, w = int(rng.integers(1, 8)), int(rng.integers(2, 6))
        limits = random_limits(rng, n)
        q = rng.uniform(-3.0, 3.0, (w, n))
        share = min(1.0, float(rng.uniform(0.1, 1.2)))
        path = rest_to_rest(q, limits, share=share, begin=float(rng.uniform(-5, 5)))
        at = path.sample(path.breaks)
        np.testing.assert_allclose(at[0], q, atol=1e-9)
        np.testing.assert_allclose(at[1:3], 0.0, atol=1e-7)
        for a, b in zip(path.breaks[:-1], path.breaks[1:], strict=True):
            inside = path.sample(np.linspace(a, np.nextafter(b, a), 801))
            used = [
                (np.abs(inside[d]).max(axis=0) / limit).max()
                for d, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk))
            ]
            assert max(used) == pytest.approx(share, rel=1e-3)


def test_the_whole_of_the_limits_may_be_used():
    path = rest_to_rest([[0.0, 0.0], [1.0, 0.5]], LIMITS, share=1.0)
    used = [np.abs(path.sample(s)[1]).max() for s in np.linspace(path.s_begin, path.s_end, 1001)]
    assert max(used) == pytest.approx(1.0, rel=1e-3)


def test_waypoints_that_are_the_same_need_next_to_no_time():
    path = rest_to_rest([[1.0, 1.0], [1.0, 1.0]], LIMITS)
    assert path.s_end - path.s_begin == pytest.approx(1e-3)
    np.testing.assert_array_equal(path.sample(0.0005)[0], [1.0, 1.0])


def test_from_motion_to_rest(rng, count):
    """Six conditions, and one quintic that has them."""
    for _ in range(count(2_000)):
        n, begin = int(rng.integers(1, 8)), float(rng.uniform(-5.0, 5.0))
        duration = float(10.0 ** rng.uniform(-1.0, 1.0))
        start, goal = rng.normal(size=(3, n)), rng.normal(size=n)
        path = from_motion(tuple(start), goal, duration, begin)
        assert (path.s_begin, path.s_end, path.end) == (begin, begin + duration, "rest")
        size = 1.0 + np.abs(start).max() * (1.0 + duration) ** 2
        for i, found in enumerate(path.sample(begin)[:3]):
            np.testing.assert_allclose(found, start[i], atol=1e-9 * size)
        q, dq, ddq, _ = path.sample(np.nextafter(begin + duration, begin))
        np.testing.assert_allclose(q, goal, atol=1e-9 * size)
        np.testing.assert_allclose(dq, 0.0, atol=1e-8 * size / duration)
        np.testing.assert_allclose(ddq, 0.0, atol=1e-7 * size / duration**2)


@pytest.mark.parametrize(
    ("start", "goal", "duration", "message"),
    [
        (([0.0], [0.0], [0.0, 0.0]), [1.0], 1.0, "(1,), (1,), (2,), (1,), should be (n,) each"),
        (([[0.0]], [[0.0]], [[0.0]]), [[1.0]], 1.0, "should be (n,) each"),
        (([0.0], [NAN], [0.0]), [1.0], 1.0, "finite"),
        (([0.0], [0.0], [0.0]), [np.inf], 1.0, "finite"),
        (([0.0], [0.0], [0.0]), [1.0], 0.0, "duration of 0.0 s"),
        (([0.0], [0.0], [0.0]), [1.0], NAN, "duration of nan s"),
        (([0.0], [0.0], [0.0]), [1.0], np.inf, "duration of inf s"),
    ],
)
def test_what_is_refused_of_a_motion(start, goal, duration, message):
    with pytest.raises(TrajectoryError) as error:
        from_motion(start, goal, duration)
    assert message in str(error.value)
