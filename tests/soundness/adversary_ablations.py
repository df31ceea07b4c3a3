"""What the adversary's supervisor is deprived of, and scenes in which that matters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from failsafe.plan import PlanOutcome, PlanResult
from occupancy.body import Part, Profile
from occupancy.report import Admission, RawMeasurement
from robots.model import RobotModel
from robots.motion import Block
from tests.soundness.adversary import Alteration
from tests.soundness.adversary_people_kernels import AWAY, CHASE, FLICKER, MODES, POUNCE, WANDER
from tests.soundness.adversary_scene import Scene
from tests.soundness.test_ablations import keep_slices
from verifier.cycle import Known
from verifier.setup import GJK_CALLS_OF_A_PLAN, Supervised, build_check, build_gate, build_profile
from verifier.verdict import Verdict

FOREARMS = (1 << Part.L_FOREARM) | (1 << Part.R_FOREARM)
SLOW_M_S = 0.1


def mode_weights(**shares: float) -> tuple[float, ...]:
    """Likelihood of each mode of people."""
    names = {"away": AWAY, "chase": CHASE, "flicker": FLICKER, "pounce": POUNCE, "wander": WANDER}
    found = np.zeros(MODES)
    for name, share in shares.items():
        found[names[name]] = share
    return tuple(float(x) for x in found)


EXACT: dict[str, Any] = {
    "persons": 1, "dropped": 0.0, "missing": 0.0, "position_error": 0.0, "doubt": (0.0, 0.0),
    "complete": False, "late": 0.0, "missed": 0.0, "withdrawn": 0.0, "renamed": 0.0, "silent": 0.0,
    "q_error": 1e-4, "q_error_rate": 0.0, "delay": (0.0, 0.0), "latency": (0.0, 0.0), "period": 0.008,
    "cycle": 0.004, "models": ("iso13855",), "in_order": True, "readings": 0.0, "wrists_only": True,
    "weights": mode_weights(away=0.3, chase=0.6, flicker=0.1),
}  # fmt: skip
"""Nothing errs, so that there is no room but what an ablation makes."""


def rebuilt(parts: Supervised, scene: Scene, robot: RobotModel | None, profile: Profile | None) -> Supervised:
    """The same, but with another belief about the arm or about people."""
    cell = scene.cell()
    check = build_check(
        cell,
        parts.check.robot if robot is None else robot,
        build_profile(cell) if profile is None else profile,
        assume_nobody=False,
        gjk_limit=GJK_CALLS_OF_A_PLAN,
    )
    return replace(parts, check=check)


def half_speed(parts: Supervised, scene: Scene) -> Supervised:
    """People are believed to move at half their speed."""
    return rebuilt(parts, scene, None, build_profile(scene.cell()).with_speed(0.5 * scene.speed))


def no_latency(parts: Supervised, scene: Scene) -> Supervised:
    """Reports count as seen when they arrive."""
    watch = parts.watch
    admit = watch.admit

    def at_arrival(report: RawMeasurement, now: float) -> Admission:
        return admit(report._replace(stamp=report.arrived), now)

    watch.admit = at_arrival
    return parts


def no_delay(parts: Supervised, scene: Scene) -> Supervised:
    """The robot is believed to do at once what it is commanded."""
    return replace(parts, plans=replace(parts.plans, delay=(0.0, 0.0)))


def without_link(parts: Supervised, scene: Scene) -> Supervised:
    """One link has no capsule: the forearm."""
    robot = parts.check.robot
    enclosure = robot.enclosure.copy()
    n = int(enclosure["n"][0])
    gone = next(place for place, link in enumerate(robot.links) if "forearm" in link or link == "panda_link5")
    for name in ("joint", "a", "b", "radius", "reach", "certainty"):
        enclosure[name][0, gone : n - 1] = enclosure[name][0, gone + 1 : n]
    enclosure["n"] = n - 1
    links = robot.links[:gone] + robot.links[gone + 1 :]
    return rebuilt(parts, scene, replace(robot, enclosure=enclosure, links=links), None)


def double_limits(parts: Supervised, scene: Scene) -> Supervised:
    """The robot is believed to stop with twice the acceleration and jerk that it has."""
    robot = parts.check.robot
    limits = replace(robot.limits, acceleration=2.0 * robot.limits.acceleration, jerk=2.0 * robot.limits.jerk)
    return rebuilt(parts, scene, replace(robot, limits=limits), None)


def slow_people(parts: Supervised, scene: Scene) -> Supervised:
    """People are believed, rightly, to be slow."""
    cell = scene.cell()
    profile = build_profile(cell).with_speed(SLOW_M_S)
    parts = rebuilt(parts, scene, None, profile)
    parts.watch.gate = build_gate(cell, profile)
    return parts


def piece_unchecked(parts: Supervised, scene: Scene) -> Supervised:
    """Only the stop is checked, not the intended piece before it; people are slow, and known to be."""
    parts = slow_people(parts, scene)
    whole = parts.check._judge

    def stop_only(t: float, plan: PlanResult, slices: Block, known: Known, *, going_on: bool) -> Verdict:
        if plan.outcome is PlanOutcome.READY:
            n = int(slices["n"][0])
            keep_slices(slices, int(np.searchsorted(slices["t"][0, : n + 1], plan.t_stop_begin - 1e-9)), n)
        return whole(t, plan, slices, known, going_on=going_on)

    parts.check._judge = stop_only
    return parts


@dataclass(frozen=True)
class Ablation:
    """What is taken away, in which scenes, and whether it shows as contacts or as excess of limits."""

    alteration: Alteration
    changes: dict[str, Any]
    robots: tuple[str, ...] = ("ur5", "panda")
    contacts: bool = True
    cycles: int = 1_500
    """In one run."""
    control: Alteration | None = None
    """With this instead of the alteration nothing may be found."""


ABLATIONS = {
    "people half as fast": Ablation(half_speed, EXACT),
    "latency ignored": Ablation(no_latency, EXACT | {"latency": (0.15, 0.0)}),
    "delay ignored": Ablation(no_delay, EXACT | {"delay": (0.15, 0.15)}),
    "forearm left out": Ablation(without_link, EXACT, robots=("ur5", "ur10", "panda")),
    "limits doubled": Ablation(double_limits, {"load": 0.75}, contacts=False),
    "piece unchecked": Ablation(
        piece_unchecked,
        EXACT
        | {
            "cycle": 0.4,
            "slice_s": 0.05,
            "parts": FOREARMS,
            "distance": (0.4, 0.9),
            "true_speed": 0.9 * SLOW_M_S / 2.0,
            "speed": 2.0,
            "load": 0.75,
            "weights": mode_weights(chase=0.7, wander=0.3),
        },
        cycles=300,
        control=slow_people,
    ),
}
