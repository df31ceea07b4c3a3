"""The closed loop with people who want a contact, and this mode proposing: none while a link moves.

The mode is asked ten times a second beside a planner that wants something else now and then; whatever it
proposes is verified like any plan. A second mode lies: it proposes the speed that is most dangerous.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from modes.speed.alteration import SpeedAlteration, SpeedSettings
from modes.speed.objective import Weights
from tests.conftest import Some
from tests.soundness.adversary import CYCLES, SHARP, Run, Total
from tests.soundness.adversary_arm import ROBOTS
from tests.soundness.adversary_scene import random_scene
from verifier.command import Command, State
from verifier.proposal import PathSpeed, Proposal, SceneView

ASKED_S = 0.1
RUNS = 250
SETTINGS = (
    SpeedSettings(),
    SpeedSettings(cap_m_s=None, prediction="kalman"),
    SpeedSettings(index="transformed", optimiser="genetic"),
    SpeedSettings(cap_m_s=2.0, weights=Weights(penalty=0.0)),
)
"""As it is by default; by braking capability; as in the paper; and with no regard for danger."""


class Reckless(SpeedAlteration):
    """Chooses the opposite of what it finds: on, fast, where it should go back."""

    name = "reckless"

    def propose(self, view: SceneView) -> Proposal | None:
        found = super().propose(view)
        return PathSpeed(1.0 + abs(found.sdot - 1.0)) if isinstance(found, PathSpeed) else found


class WithMode(Run):
    """A run in which a mode proposes path speeds, too."""

    def __init__(self, scene: Any, seed: list[int], make: Callable[[Any], SpeedAlteration]) -> None:
        super().__init__(scene, seed)
        self._mode = make(self.arm)
        self._planner_next = 0

    def _propose(self, k: int, command: Command | None) -> None:
        if k >= self._planner_next or command is None or command.outcome is State.STOPPED:
            super()._propose(k, command)
            self._planner_next = self._next_idea
        proposal = self._mode.propose(self.supervisor.view())
        if proposal is not None:
            refusal = self.supervisor.propose(proposal)
            altered = isinstance(proposal, PathSpeed) and abs(proposal.sdot - 1.0) > 1e-6
            self.total.events[
                "mode refused" if refusal is not None else "altered" if altered else "kept"
            ] += 1
        self._next_idea = min(self._planner_next, k + max(1, round(ASKED_S / self.scene.cycle)))


def all_runs(
    robot: str, seed: int, runs: int, make: Callable[[int], Callable[[Any], SpeedAlteration]]
) -> Total:
    total = Total()
    for number in range(runs):
        key = [seed, number, *robot.encode(), 7]
        scene = random_scene(np.random.default_rng(key), robot)
        if number % 3 == 0:
            scene = replace(scene, **SHARP)
        total.add(WithMode(scene, key, make(number)).go(CYCLES))
    print(f"\n{robot}: {total.summary()}")
    assert not total.failures, "\n".join(total.failures[:5])
    assert total.contacts == 0 and not total.excess.any()
    assert total.events["altered"] > 0, "vacuous: the mode never altered anything"
    assert min(total.nearest) < 0.1, "vacuous: nobody comes near"
    assert total.share(State.EXECUTING) > 0.05
    return total


@pytest.mark.rarely("a mode that proposes the opposite, in every run")
def test_nobody_is_touched_while_the_mode_proposes(
    some: Some, count: Callable[[int], int], seed: int
) -> None:
    """At full counts 250 runs of each arm, a million cycles each; in small runs two of one of them."""
    for robot in some(ROBOTS):
        all_runs(
            robot, seed, count(RUNS), lambda n: lambda arm: SpeedAlteration(arm, SETTINGS[n % len(SETTINGS)])
        )


def test_a_mode_that_lies_costs_time_only(count: Callable[[int], int], seed: int) -> None:
    all_runs("panda", seed, max(1, count(RUNS) // 2), lambda n: Reckless)
