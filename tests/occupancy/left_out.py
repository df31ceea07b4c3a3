"""Single terms that a model of people can be built without: what tests and ``python -m tests.terms`` leave
out.

Only what a model is *told* changes, never what is true. A term that is not needed would show as a set from
which nobody gets out although the term is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from occupancy.body import Profile
from occupancy.measurement import SensorFrame
from occupancy.region import Monitored
from robots.motion import Block

Forget = Callable[[Block, Block], None]
"""Changes people block and plan."""
T = TypeVar("T")


def nothing(people: Block, plan: Block) -> None:
    """Forget nothing."""


def unchanged(what: T) -> T:
    return what


# ------------------------------------------------------------------------------------------ people and plan


def no_position_error(people: Block, plan: Block) -> None:
    people["e_p"] = np.where(np.isfinite(people["e_p"]), 0.0, people["e_p"])


def no_velocity_error(people: Block, plan: Block) -> None:
    people["e_v"] = np.where(np.isfinite(people["e_v"]), 0.0, np.inf)


def no_velocity(people: Block, plan: Block) -> None:
    people["v"] = 0.0


def no_clock_error(people: Block, plan: Block) -> None:
    people["clock_error"] = 0.0


def no_stamp_error(people: Block, plan: Block) -> None:
    """Believe in stamps: points and complete reports count as seen when their stamp says."""
    people["t_obs"] += people["stamp_error"][0]
    people["t_complete"] += people["stamp_error"]
    people["stamp_error"] = 0.0


def no_delay(people: Block, plan: Block) -> None:
    plan["delay"] = 0.0


def fresher(people: Block, plan: Block) -> None:
    """Believe that what is known is 10 ms younger."""
    people["t_obs"] += 0.01
    people["t_complete"] += 0.01


def not_ahead(people: Block, plan: Block) -> None:
    """Believe that what was seen after the plan had begun was seen when it began."""
    begin = plan["t"][0, 0] + plan["delay"][0, 0]
    people["t_obs"] = np.minimum(people["t_obs"], begin)
    people["t_complete"] = np.minimum(people["t_complete"], begin)


# -------------------------------------------------------------------------------------------------- profile


def no_speed(profile: Profile) -> Profile:
    return replace(profile, speed=np.zeros_like(profile.speed))


def no_acceleration(profile: Profile) -> Profile:
    return replace(profile, acceleration=np.zeros_like(profile.acceleration))


def no_flesh(profile: Profile) -> Profile:
    return replace(profile, radius=np.zeros_like(profile.radius))


def no_chain(profile: Profile) -> Profile:
    """All distances between points of one person shrink to nothing, but keep their order."""
    return replace(profile, chain=1e-9 * profile.chain)


# ---------------------------------------------------------------------------------------------------- terms


@dataclass(frozen=True)
class LeftOut:
    """A term, and what a model is told in its absence.

    Attributes
    ----------
    what:
        What is left out, in words.
    data, profile, held, monitored, frame:
        Change what is known of people and plan, the profile, how far a held object reaches [m], a monitored
        region, a sensor's frame.
    own_error:
        Share of the position error that the gate is told.
    velocity:
        What is forgotten when velocities are found from reports: ``positions``, ``acceleration`` or
        ``times``.
    twin:
        Name of a term of :class:`tests.occupancy.arm_twin.Twin` that is left out there.
    """

    what: str
    data: Forget = nothing
    profile: Callable[[Profile], Profile] = unchanged
    held: Callable[[float], float] = unchanged
    monitored: Callable[[Monitored], Monitored] = unchanged
    frame: Callable[[SensorFrame], SensorFrame] = unchanged
    own_error: float = 1.0
    velocity: str = ""
    twin: str = ""


POSITION = LeftOut("e_p: the point is where it was seen", data=no_position_error)
CLOCKS = {
    "clock error": LeftOut("ε: both clocks agree", data=no_clock_error),
    "stamp error": LeftOut("σ: stamps are right", data=no_stamp_error),
    "delay": LeftOut("δ_min, δ_max: the robot follows at once", data=no_delay),
    "age": LeftOut("10 ms of the time since people were seen", data=fresher),
}
SIZES = {
    "body radius": LeftOut("flesh around the points", profile=no_flesh),
    "chain": LeftOut("distance of what was inferred from what was seen", profile=no_chain),
    "held object": LeftOut("what a hand holds", held=lambda held: 0.0),
}
SPEED = {
    "v Δt": LeftOut("v Δt: nobody moves", profile=no_speed),
    "v Δt before": LeftOut("v Δt: nobody moved until they were seen, if that was later", data=not_ahead),
}

TERMS: dict[str, dict[str, LeftOut]] = {
    "frame of a sensor": {
        "own error": LeftOut("e: the sensor is exact", own_error=0.0),
        "translation": LeftOut("e_translation", frame=lambda frame: replace(frame, translation_error_m=0.0)),
        "rotation": LeftOut(
            "2 sin(θ/2) times range", frame=lambda frame: replace(frame, rotation_error_rad=0.0)
        ),
    },
    "iso13855": {"e_p": POSITION, **SPEED, **CLOCKS, **SIZES},
    "articulated_velocity": {"e_p": POSITION, **SPEED, **CLOCKS, **SIZES},
    "articulated_position": {"e_p": POSITION, **SPEED, **CLOCKS, **SIZES},
    "articulated_acceleration": {
        "e_p": POSITION,
        "e_v": LeftOut("e_v Δ: the velocity is what was found", data=no_velocity_error),
        "v Δ": LeftOut("the centre moves on with the velocity", data=no_velocity),
        "a Δ²/2": LeftOut("the velocity stays what it was", profile=no_acceleration),
        "(e_1 + e_2)/τ": LeftOut("e_v: positions it was found from are exact", velocity="positions"),
        "a (τ + s)/2": LeftOut("e_v: the mean velocity is that of the end", velocity="acceleration"),
        "v s/τ": LeftOut("e_v: the time between two reports is exact", velocity="times"),
        **CLOCKS,
        **SIZES,
    },
    "arm_reach": {
        "e_p": LeftOut("e, e_S: the points are where they were seen", twin="e_p"),
        "IK error": LeftOut("asin(e/r): the direction is what was seen", twin="ik"),
        "ω T": LeftOut("the direction does not turn", twin="turn"),
        "v_r T": LeftOut("the forearm does not move about the shoulder", twin="speed"),
        "v_e T": LeftOut("the arm does not stretch", twin="extension"),
        "e_v": LeftOut("e_v Δ: the velocity is what was found", twin="e_v"),
        "a Δ²/2": LeftOut("the velocity stays what it was", twin="acceleration"),
        "sagitta": LeftOut("corners lie on the circle, not beyond it", twin="corners"),
        "shoulder": LeftOut("the shoulder stays where it was", twin="shoulder"),
        "half the forearm": LeftOut("from the forearm's middle to elbow and wrist", twin="forearm"),
        **{name: replace(left, data=nothing, twin=name.split()[0]) for name, left in CLOCKS.items()},
        "age": CLOCKS["age"],
        "body radius": SIZES["body radius"],
        "held object": SIZES["held object"],
    },
    "pedestrian": {"e_p": POSITION, **SPEED, **CLOCKS, **SIZES},
    "unobserved": {
        **SPEED,
        **CLOCKS,
        "detection time": LeftOut(
            "T_det: who is in the region is listed at once",
            monitored=lambda watched: replace(watched, detection_time_s=0.0),
        ),
        "boundary error": LeftOut(
            "the region ends where it is said to",
            monitored=lambda watched: replace(watched, boundary_error_m=0.0),
        ),
    },
}
"""Model or step -> term -> what to leave out. ``frame of a sensor`` is where the gate takes a point into the
world."""
