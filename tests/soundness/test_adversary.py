"""The closed loop with people who want a contact: there is none while a link moves, and no limit is exceeded.

The long run is `python -m tests.adversary`; what it measures stands in docs/results/adversary.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.soundness.adversary import CYCLES, CYCLES_IN_ALL, Run, Total, one_run
from tests.soundness.adversary_ablations import ABLATIONS, EXACT, mode_weights
from tests.soundness.adversary_arm import ROBOTS
from tests.soundness.adversary_scene import random_scene
from tests.soundness.adversary_truth_kernels import NEAR_M
from verifier.command import State

ABLATION_RUNS = 60


@pytest.mark.parametrize("robot", ROBOTS)
def test_nobody_is_touched_by_a_moving_link_and_no_limit_is_exceeded(
    robot: str, count: Callable[[int], int], seed: int, record_property: Callable[[str, object], None]
) -> None:
    total = Total()
    for number in range(max(3, count(CYCLES_IN_ALL) // (CYCLES * len(ROBOTS)))):
        total.add(one_run(robot, seed, number))
    record_property("nearest_m", min(total.nearest))
    record_property("histogram", total.histogram.tolist())
    print(f"\n{robot}: {total.summary()}")
    assert not total.failures, "\n".join(total.failures[:5])
    assert total.contacts == 0 and not total.excess.any()
    many = total.runs >= 20
    assert min(total.nearest) < (NEAR_M if many else 2.0 * NEAR_M), "vacuous: nobody comes near"
    assert total.share(State.EXECUTING) > 0.1
    assert total.share(State.FAILSAFE) > 0.05, "of all arms together it is above 0.1: tests/adversary.py"
    assert total.worst[:3].min() > 0.5, "vacuous: limits are not used"


LONG = {"forearm left out": "tests/soundness/test_ablations.py, forearm left out"}
"""Thousands of cycles pass before it shows; what is looked at in their place in small runs."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.rarely(LONG[name])) if name in LONG else name
        for name in ABLATIONS
    ],
)
def test_what_is_left_out_is_noticed(
    name: str, seed: int, record_property: Callable[[str, object], None]
) -> None:
    ablation = ABLATIONS[name]
    for number in range(ABLATION_RUNS):
        rng = np.random.default_rng([seed, number, *name.encode()])
        scene = random_scene(rng, str(rng.choice(ablation.robots)))
        scene = replace(scene, **ablation.changes)
        key = [seed, number, *name.encode()]
        total = Run(scene, key, ablation.alteration).until_contact(ablation.cycles)
        if total.contacts if ablation.contacts else total.excess.any():
            whole = Run(scene, key, ablation.control).go(ablation.cycles)
            assert not whole.failures, "the whole supervisor lets this pass too"
            cycles = number * ablation.cycles + total.cycles
            record_property("cycles", cycles)
            print(f"\n{name}: after {cycles} cycles, {total.failures[0][:160]}")
            return
    pytest.fail(f"{name}: nothing in {ABLATION_RUNS} runs; the adversary would not notice it")


@pytest.mark.parametrize("error", [0.0, 0.02])
@pytest.mark.parametrize("factor", [1.5, 2.0, 3.0])
def test_people_faster_than_the_profile_are_reported(
    factor: float, error: float, seed: int, count: Callable[[int], int]
) -> None:
    """Sensors are exact, whatever is declared: errors hide the speed between two reports, not for long."""
    touched, runs = 0, max(2, count(6))
    for number in range(runs):
        rng = np.random.default_rng([seed, number, 5])
        changes = EXACT | {"period": 0.033, "true_speed": factor, "weights": mode_weights(chase=1.0)}
        changes |= {"position_error": error, "kind_error": 3}
        scene = replace(random_scene(rng, str(rng.choice(ROBOTS))), **changes)
        run = Run(scene, [seed, number, 5])
        total = run.go(1_000)
        assert run.contradicted_at, f"run {number}: nobody noticed"
        late = 2 + int(2.0 * scene.period / scene.cycle)
        if total.contacts:
            touched += 1
            assert run.contradicted_at[0] <= run.first_contact + late, f"run {number}: noticed too late"
        assert not total.excess.any()
    print(f"\n{factor} times as fast: {touched} of {runs} touched a moving link")
