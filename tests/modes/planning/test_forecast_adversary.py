"""The closed loop with people who want a contact, and the worst forecasts: none while a link moves.

The mode is the only planner. What it is told of people is a lie of the worst kinds: that nobody is there,
that everybody goes away, or jumps about, or sits in the arm. It proposes accordingly; only time is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.arrt import PlannerSettings
from modes.planning.foresight import last_seen
from modes.planning.replan_settings import ReplanSettings, Target
from modes.planning.replanning import ProactiveAvoidance
from occupancy.body import MAX_POINTS, load_profile
from tests.conftest import Some
from tests.soundness.adversary import CYCLES, SHARP, Run, Total
from tests.soundness.adversary_arm import ROBOTS
from tests.soundness.adversary_scene import random_scene
from verifier.command import Command, State
from verifier.proposal import SceneView, Stop

Array = NDArray[np.float64]
ASKED_S = 0.1
RUNS = 250


class Nobody:
    """There is nobody, nor will there be."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def frames(self, view: SceneView) -> Sequence[Array]:
        return [np.full((1, MAX_POINTS, 3), np.nan)] * 11


class Leaving(Nobody):
    """Everybody is far away already, and goes farther."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        seen = last_seen(view)
        return [seen + 100.0 * (k + 1.0) * np.array([1.0, 0.0, 0.0]) for k in range(11)]


class Jumping(Nobody):
    """People are anywhere, another place each time."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        return [self.rng.normal(scale=2.0, size=(3, MAX_POINTS, 3)) for _ in range(11)]


class Mirrored(Nobody):
    """People are on the other side of the arm: it is sent towards them."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        return [last_seen(view) * (-1.0, -1.0, 1.0)]


class Huge(Nobody):
    """Numbers that no forecast has."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        return [np.full((1, MAX_POINTS, 3), 1e12), np.full((1, MAX_POINTS, 3), -1e12)]


LIARS = (Nobody, Leaving, Jumping, Mirrored, Huge)


class Lied(Run):
    """A run whose planner is the mode, told by a liar."""

    def __init__(self, scene: Any, seed: list[int], liar: type[Nobody]) -> None:
        super().__init__(scene, seed)
        n, limits = len(self.arm.joints), self.arm.limits
        here = self.robot[0]["last"][0, :n].copy()
        low = np.maximum(limits.position_lower, here - 1.2)
        high = np.minimum(limits.position_upper, here + 1.2)
        targets = [Target(tuple(self.rng.uniform(low, high)), 0.0) for _ in range(60)]
        settings = ReplanSettings(planner=PlannerSettings(nodes=100))
        self._mode = ProactiveAvoidance(
            self.arm, targets, load_profile("iso"), liar(np.random.default_rng(seed)), settings
        )

    def _propose(self, k: int, command: Command | None) -> None:
        self._next_idea = k + max(1, round(ASKED_S / self.scene.cycle))
        proposal = self._mode.propose(self.supervisor.view())
        if proposal is None:
            return
        refusal = self.supervisor.propose(proposal)
        if refusal is not None:
            self._mode.refused(refusal)
        self.total.events[f"{type(proposal).__name__}{' refused' if refusal is not None else ''}"] += 1
        self.total.events["stopped by itself"] += isinstance(proposal, Stop)


def all_runs(robot: str, seed: int, runs: int, liars: Sequence[type[Nobody]]) -> Total:
    total = Total()
    for number in range(runs):
        key = [seed, number, *robot.encode(), 9]
        scene = random_scene(np.random.default_rng(key), robot)
        if number % 3 == 0:
            scene = replace(scene, **SHARP)
        total.add(Lied(scene, key, liars[number % len(liars)]).go(CYCLES))
    print(f"\n{robot}: {total.summary()}")
    assert not total.failures, "\n".join(total.failures[:5])
    assert total.contacts == 0 and not total.excess.any()
    assert total.events["NewTrajectory"] > 0, "vacuous: the mode never went anywhere"
    assert total.share(State.EXECUTING) > 0.02
    return total


def test_the_worst_forecasts_cost_time_only(count: Callable[[int], int], seed: int) -> None:
    total = all_runs("panda", seed, max(2, count(RUNS)), LIARS)
    assert min(total.nearest) < 0.1, "vacuous: nobody comes near"


@pytest.mark.rarely("the same with one arm, in every run")
def test_the_worst_forecasts_cost_time_only_with_every_arm(
    some: Some, count: Callable[[int], int], seed: int
) -> None:
    for robot in some(ROBOTS):
        all_runs(robot, seed + 1, max(2, count(RUNS)), LIARS)
