"""No verified cycle allows a contact that the brute-force checker can find.

In every random cell the people are moved towards the arm, half the way each time, until they are as near as
the verifier lets them. There the plan is executed in several ways, and people who obey the assumptions try to
touch a moving link. Nor may the certified gap be larger than what brute force leaves between them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from tests.oracles.arms import ARMS
from tests.soundness.cells import Bounds, random_cell
from tests.soundness.contacts import closest, describe, touches, verified
from tests.soundness.trials import Trial, closest_verified
from verifier.verdict import Verdict

HALVINGS = 14
NEAR_M = 0.05


CASES = {name: Bounds(robots=(name,)) for name in ARMS} | {
    "made_up, slow people, long slices": Bounds(
        robots=("made_up",),
        speeds=(0.02,),
        cycle_s=(0.2,),
        slice_s=(0.1, 0.2),
        latency_s=(0.0, 0.02),
        delay_s=(0.0, 0.0),
        q_error=(0.0, 0.01),
        error_m=(0.0, 0.0),
        pace=(0.9, 1.2),
        busy=2,
    ),
    "silence": Bounds(
        fitted=0.0,
        silence=1.0,
        pace=(0.1, 0.4),
        latency_s=(0.0, 0.05),
        q_error=(0.0, 0.005),
        error_m=(0.0, 0.01),
        clock_s=(0.0, 0.005),
    ),
}
"""The case of a made-up arm leaves room for hardly anything but what the arm sweeps within a slice; that of
silence for hardly more than how far each joint by itself may go on."""


@pytest.mark.parametrize("name", CASES)
def test_nobody_touches_a_moving_link_in_a_verified_cycle(
    name: str, count: Callable[[int], int], seed: int, record_property: Callable[[str, object], None]
) -> None:
    bounds = CASES[name]
    judged: Counter[str] = Counter()
    slacks: list[float] = []
    for number in range(max(10, count(1_000))):
        where = f"cell {number} of seed {seed}"
        rng = np.random.default_rng([seed, number, *name.encode()])
        cell = random_cell(rng, bounds)
        trial = Trial(cell)
        accepted: list[float] = []

        def keep(distance: float, verdict: Verdict, accepted: list[float] = accepted) -> None:
            judged[verdict.reason.name] += 1
            judged["verified" if verified(verdict) else "not verified"] += 1
            if verified(verdict):
                accepted.append(distance)

        nearest = closest_verified(trial, HALVINGS, keep)
        judged[f"stop {trial.plan.stop.name}"] += 1
        if nearest is None:
            judged["never verified"] += 1
            continue
        found = closest(trial, nearest, rng, executed=2)
        if found is None:
            judged["nothing moves"] += 1
            continue
        assert found.contact is None, describe(found, cell, nearest, where)
        slacks.append(found.approach.slack)
        gap = trial.judge(nearest).gap_m
        assert not gap > found.approach.slack + 1e-6, (
            f"{where}: gap {gap} m is above {found.approach.slack} m"
        )
        judged[f"link {found.approach.link}"] += 1
        judged[f"part {found.approach.part.name}"] += 1
        farther = [distance for distance in accepted if distance > nearest]
        if farther:
            distance = float(rng.choice(farther))
            assert touches(cell, trial, distance) is None, f"{where}: contact with people at {distance} m"
    assert slacks, f"vacuous: {judged}"
    near = np.array(slacks)
    record_property("judged", dict(judged))
    record_property("nearest_m", float(near.min()))
    record_property("median_m", float(np.median(near)))
    print(
        f"\n{name}: {len(near)} cells, {judged}, nearest {near.min():.4f} m, median {np.median(near):.4f} m"
    )
    share = judged["verified"] / (judged["verified"] + judged["not verified"])
    assert 0.3 < share < 0.8, "about half of the cycles should be verified"
    assert np.mean(near < NEAR_M) > 0.1, "vacuous: nobody comes near"
    assert judged["never verified"] + judged["nothing moves"] < 0.2 * len(near) + 2
    if len(near) >= 50:
        assert sum(key.startswith("link ") for key in judged) >= 4
        assert sum(key.startswith("part ") for key in judged) >= 6
        assert judged["stop JOINT_SPACE"] > 0 and judged["stop PATH_CONSISTENT"] > 0
