"""A scene to measure the supervisor in: a Panda at work, people walking up to it and away again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.recordings import ALL_MEASURED
from failsafe.trajectory import IntendedTrajectory
from failsafe.waypoints import rest_to_rest
from occupancy.body import MAX_POINTS
from occupancy.report import RawMeasurement, RawPerson
from robots.limits import JointLimits
from tests.occupancy.people import standing
from verifier.cell import Cell

Array = NDArray[np.float64]

CYCLE_S = 0.001
LATENCY_S = 0.02
NEAREST_M, FARTHEST_M, PERIOD_S = 1.1, 3.1, 6.0
"""People walk between these distances from the base; their greatest speed is 1.05 m/s."""


@dataclass(frozen=True, slots=True)
class Step:
    """What one step is called with."""

    now: float
    reports: tuple[RawMeasurement, ...]


def panda_cell(*, all_models: bool = False, silence: bool = False) -> Cell:
    """Return a cell with a Panda at 1 kHz, and the ISO model or all that profile ``tum`` has.

    ``silence``: the robot stops by itself when no command comes.
    """
    people: dict[str, object] = {"latency_s": LATENCY_S}
    if all_models:
        people["profile"] = "tum"
        people["models"] = (
            "iso13855", "articulated_velocity", "articulated_acceleration", "arm_reach",
            "articulated_position", "pedestrian",
        )  # fmt: skip
    robot: dict[str, object] = {
        "name": "panda",
        "bare_flange": True,
        "accept_assumed": ["limits"],
        "tracking": {"position_error_rad": 0.001},
    }
    if silence:
        robot["silence"] = {"hold_s": 0.005, "goes_on_with": "velocity", "deceleration_rad_s2": 5.0}
    return Cell.from_table(
        {
            "cycle_s": CYCLE_S,
            "robot": robot,
            "stop": {"slice_s": 0.025},
            "people": people,
        }
    )


def work(limits: JointLimits, seed: int) -> IntendedTrajectory:
    """Return a path through 40 seeded waypoints."""
    rng = np.random.default_rng(seed)
    low, high = limits.position_lower, limits.position_upper
    return rest_to_rest(low + (high - low) * rng.uniform(0.25, 0.75, (40, len(low))), limits, share=0.7)


def steps(count: int, people: int, every: int, seed: int, stands_at_m: float | None = None) -> Iterator[Step]:
    """Yield the calls of ``count`` steps with a report about everybody every so many steps.

    ``stands_at_m``: people stand so far from the base [m], and do not walk.
    """
    rng = np.random.default_rng(seed)
    for k in range(count):
        now = k * CYCLE_S
        if k % every == 0:
            persons = tuple(
                person(number, people, now - LATENCY_S, rng, stands_at_m) for number in range(people)
            )
            yield Step(now, (RawMeasurement(now - LATENCY_S, now, "world", True, persons),))
        else:
            yield Step(now, ())


def person(
    number: int, people: int, t: float, rng: np.random.Generator, stands_at_m: float | None = None
) -> RawPerson:
    """Return where one of them is at ``t`` [s], measured with 1 mm of noise."""
    middle, swing = 0.5 * (NEAREST_M + FARTHEST_M), 0.5 * (FARTHEST_M - NEAREST_M)
    walks = middle + swing * math.cos(2.0 * math.pi * (t / PERIOD_S + number / people))
    away = walks if stands_at_m is None else stands_at_m
    angle = 2.0 * math.pi * number / people
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    xyz = standing(away)
    xyz[:, :2] = xyz[:, :2] @ turn.T
    xyz += rng.uniform(-0.001, 0.001, xyz.shape)
    return RawPerson(f"p{number + 1}", xyz, np.full(MAX_POINTS, 0.005), ALL_MEASURED)
