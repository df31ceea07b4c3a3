"""What the brute-force checker finds when the verifier leaves something out.

Each test takes one thing away from what the verifier is given, never from what is true. People then stand as
near as that verifier lets them, and somebody must touch a moving link within a seeded number of cells, in a
simulated motion that obeys every assumption; the whole verifier refuses the same cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from failsafe.plan import PlanResult
from occupancy.body import Part, Point, Profile
from robots.model import RobotModel
from robots.motion import MAX_SLICES, Block
from tests.soundness.cells import Bounds, profile_of, random_cell
from tests.soundness.contacts import closest, describe, verified
from tests.soundness.persons import HANDS, Truth
from tests.soundness.trials import Alteration, Trial, Unaltered, closest_verified

CELLS = 300
HALVINGS = 12
EXACT = Bounds(
    latency_s=(0.0, 0.02),
    delay_s=(0.0, 0.0),
    q_error=(0.0, 0.0),
    error_m=(0.0, 0.0),
    clock_s=(0.0, 0.0),
    fitted=0.0,
    legs=(False,),
    held=(0.0,),
    people=(1,),
)
"""Cells in which nothing but what a test adds gives the verifier room."""


class HalfSpeed(Unaltered):
    """People are believed to move at half their speed."""

    def profile(self, profile: Profile) -> Profile:
        return profile_of(0.5 * float(profile.speed.max()))


class NoLatency(Unaltered):
    """Reports count as seen at the instant of the check."""

    def people(self, people: Block, t: float) -> None:
        people["t_obs"][np.isfinite(people["t_obs"])] = t


@dataclass
class WithoutLink(Unaltered):
    """One link has no capsule: the one at ``place`` (0 first, 1 last)."""

    place: float

    def robot(self, robot: RobotModel) -> RobotModel:
        enclosure = robot.enclosure.copy()
        n = int(enclosure["n"][0])
        gone = round(self.place * (n - 1))
        for name in ("joint", "a", "b", "radius", "reach", "certainty"):
            enclosure[name][0, gone : n - 1] = enclosure[name][0, gone + 1 : n]
        enclosure["n"] = n - 1
        return replace(robot, enclosure=enclosure, links=robot.links[:gone] + robot.links[gone + 1 :])


def keep_slices(slices: Block, first: int, last: int) -> None:
    """Keep slices first … last - 1."""
    number = last - first
    for name in ("t", "q", "dq", "ddq"):
        slices[name][0, : number + 1] = slices[name][0, first : last + 1].copy()
    for name in ("dq_max", "ddq_max"):
        slices[name][0, :number] = slices[name][0, first:last].copy()
    slices["n"] = number
    assert 0 < number <= MAX_SLICES


class PieceUnchecked(Unaltered):
    """Only the stop is checked, not the intended piece before it."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        n = int(slices["n"][0])
        first = int(np.searchsorted(slices["t"][0, : n + 1], plan.t_stop_begin - 1e-9))
        assert first > 0
        keep_slices(slices, first, n)


class StopUnchecked(Unaltered):
    """Only the intended piece is checked, not the stop after it."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        n = int(slices["n"][0])
        keep_slices(slices, 0, int(np.searchsorted(slices["t"][0, : n + 1], plan.t_stop_begin - 1e-9)))


class NoDelay(Unaltered):
    """The arm is believed to do at once what it is commanded."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        slices["delay"] = 0.0


class NoTrackingError(Unaltered):
    """The arm is believed to be exactly where it is commanded."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        slices["q_error"] = 0.0


class NoSilence(Unaltered):
    """The arm is believed to drive the stop of the plan, whether it gets it or not."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        slices["q_spread"] = slices["dq_spread"] = 0.0
        t = slices["t"][0, : int(slices["n"][0]) + 1]
        slices["n"] = int(np.argmax(t >= plan.t_stop_begin + plan.stop_time_s - 1e-9))


class HalfHands(Unaltered):
    """Hands are believed to be half as large."""

    def profile(self, profile: Profile) -> Profile:
        radius = profile.radius.copy()
        radius[[Part.L_HAND, Part.R_HAND]] *= 0.5
        return replace(profile, radius=radius)


class NoPositionError(Unaltered):
    """Measurements are believed to be exact."""

    def people(self, people: Block, t: float) -> None:
        people["e_p"][np.isfinite(people["e_p"])] = 0.0


class NoClockError(Unaltered):
    """Clocks are believed to agree, and stamps to be exact."""

    def people(self, people: Block, t: float) -> None:
        people["t_obs"] += people["stamp_error"][0]
        people["clock_error"] = people["stamp_error"] = 0.0


class FirstPersonOnly(Unaltered):
    """All but one person are forgotten."""

    def people(self, people: Block, t: float) -> None:
        people["n"] = 1


class ThinCapsules(Unaltered):
    """Links are believed to be 5 cm thinner."""

    def robot(self, robot: RobotModel) -> RobotModel:
        enclosure = robot.enclosure.copy()
        n = int(enclosure["n"][0])
        enclosure["radius"][0, :n] = np.maximum(enclosure["radius"][0, :n] - 0.05, 0.001)
        return replace(robot, enclosure=enclosure)


def only_hands(truth: Truth) -> Truth:
    """Of each hand the wrist is seen."""
    seen = truth.seen.copy()
    seen[:, [p for hand in HANDS for p in hand[1:]]] = False
    seen[:, [hand[0] for hand in HANDS]] |= seen.any(axis=1)[:, None]
    return replace(truth, seen=seen)


ONE_HAND = replace(EXACT, visibility=only_hands, parts=1 << Part.R_HAND, nearest=(Point.R_WRIST,))


CASES: dict[str, tuple[Alteration, Bounds]] = {
    "half speed": (HalfSpeed(), Bounds()),
    "latency ignored": (NoLatency(), Bounds(latency_s=(0.1, 0.2))),
    "forearm left out": (WithoutLink(0.4), Bounds(robots=("ur3", "ur5", "ur10"))),
    "hand and fingers left out": (WithoutLink(1.0), Bounds(robots=("panda",))),
    "first link left out": (WithoutLink(0.0), Bounds()),
    "piece unchecked": (
        PieceUnchecked(),
        replace(ONE_HAND, cycle_s=(0.2,), speeds=(0.1,), pace=(0.8, 1.2), behind=True),
    ),
    "stop unchecked": (StopUnchecked(), Bounds(cycle_s=(0.01,))),
    "delay ignored": (NoDelay(), replace(EXACT, delay_s=(0.08, 0.2))),
    "tracking error ignored": (NoTrackingError(), replace(EXACT, q_error=(0.05, 0.1))),
    "silence ignored": (NoSilence(), replace(EXACT, silence=1.0)),
    "hands half as large": (HalfHands(), ONE_HAND),
    "position error ignored": (NoPositionError(), replace(EXACT, error_m=(0.05, 0.1))),
    "clock error ignored": (NoClockError(), replace(EXACT, clock_s=(0.05, 0.1))),
    "others forgotten": (FirstPersonOnly(), Bounds(people=(2, 3))),
    "capsules too thin": (ThinCapsules(), EXACT),
}


@pytest.mark.parametrize("name", CASES)
def test_leaving_something_out_lets_somebody_touch_the_arm(
    name: str, seed: int, record_property: Callable[[str, object], None]
) -> None:
    alteration, bounds = CASES[name]
    for number in range(CELLS):
        rng = np.random.default_rng([seed, number, *name.encode()])
        cell = random_cell(rng, bounds)
        weakened = Trial(cell, alteration)
        distance = closest_verified(weakened, HALVINGS)
        if distance is None:
            continue
        found = closest(weakened, distance, rng, executed=1)
        if found is not None and found.contact is not None:
            assert found.contact.fastest_point <= float(cell.profile.speed.max()) * (1.0 + 1e-4)
            assert not verified(Trial(cell).judge(distance)), "the whole verifier lets this pass too"
            record_property("cell", number)
            print(f"\n{name}: " + describe(found, cell, distance, f"cell {number} of seed {seed}"))
            return
    pytest.fail(
        f"{name}: no contact in {CELLS} cells; the tests would not notice if the verifier left it out"
    )
