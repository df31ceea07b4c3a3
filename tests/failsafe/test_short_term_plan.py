"""The short-term plan: outcomes, slices, and that slices contain the executed motion."""

from __future__ import annotations

import numpy as np

from failsafe.short_term_plan import PlanOutcome, PlanSettings, ShortTermPlanner, StopKind
from tests.failsafe.motions import executed, random_limits, random_motion


def settings(n: int, **changes: object) -> PlanSettings:
    values = {"cycle_s": 0.01, "delay": (0.0, 0.01), "q_error": np.zeros(n), "dq_error": np.zeros(n)}
    return PlanSettings(**(values | changes))


def test_slices_contain_the_executed_motion(rng, count):
    ready = 0
    for _ in range(count(10_000)):
        n = int(rng.integers(1, 8))
        limits = random_limits(rng, n)
        motion = random_motion(rng, limits, rng.uniform(0.2, 0.95))
        planner = ShortTermPlanner(limits, settings(n, allow_joint_space=False))
        s = rng.uniform(0.0, 0.8 * motion.trajectory.s_end)
        t = rng.uniform(-100.0, 100.0)
        result = planner.plan(motion.trajectory, t, s)
        if result.outcome is not PlanOutcome.READY:
            continue
        ready += 1
        assert result.stop is StopKind.PATH_CONSISTENT
        slices, record = planner.slices[0], planner._manoeuvre.path[0]
        rows = int(slices["n"])
        assert slices["t"][0] == t and abs(slices["t"][rows] - result.t_rest) < 1e-12
        for i in range(rows):
            tau = np.linspace(slices["t"][i], slices["t"][i + 1], 12) - t
            q, dq, ddq, _ = executed(motion, record, tau)
            assert np.allclose(q[0], slices["q"][i, :n], atol=1e-9, rtol=0)
            assert np.allclose(dq[0], slices["dq"][i, :n], atol=1e-8, rtol=0)
            assert (np.abs(dq) <= slices["dq_max"][i, :n] + 1e-9).all()
            assert (np.abs(ddq) <= slices["ddq_max"][i, :n] + 1e-6).all()
        assert (slices["dq"][rows, :n] == 0.0).all() and (slices["ddq"][rows, :n] == 0.0).all()
    assert ready > 0
