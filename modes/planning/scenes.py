"""Trials of the planner: an arm between two fixed places, with people around it; made up, by seed.

The paper ran three kinds of 10 to 20 trials each with a UR16e: somebody who stands near the base, somebody
who walks past, and some points of the body that are not seen. Where people and robot were is not given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies, Field
from modes.reaching_person import report_of
from modes.settings import require_count
from occupancy.body import Point, Profile

Array = NDArray[np.float64]
Kind = Literal["standing", "passing", "occluded"]
KINDS: tuple[Kind, ...] = ("standing", "passing", "occluded")

ROBOT = "ur16e"
PICK = np.array([-1.6, -1.3, 1.6, -1.8, -1.57, 0.0])
PLACE = np.array([1.6, -1.3, 1.6, -1.8, -1.57, 0.0])
FRAME_S, FRAMES = 0.1, 11
"""As they are, and forecasts up to 1 s."""

_AS_DRAWN, _DRAWS = 9, 100
_BETWEEN_RAD = 0.29
"""The azimuth half way between the tool at both places."""
_LIMBS = (
    (Point.L_HIP, Point.L_KNEE, Point.L_ANKLE, Point.R_HIP, Point.R_KNEE, Point.R_ANKLE),
    (Point.L_SHOULDER, Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    (Point.R_ELBOW, Point.R_HAND, Point.R_FINGERTIP),
)
"""Of which one is not seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One trial.

    Attributes
    ----------
    kind:
        What people do.
    start, goal:
        ``(6,)`` of a UR16e [rad].
    frames:
        ``(11, people, 20, 3)`` points [m], now first, then every 0.1 s as they are forecast; NaN: not seen.
    """

    kind: Kind
    start: Array
    goal: Array
    frames: Array

    def bodies(self, profile: Profile) -> Bodies:
        """Return capsules of the people in all frames."""
        return Bodies.of_points(list(self.frames), profile)


def scenes(field: Field, profile: Profile, count: int = 50, seed: int = 0) -> list[Scene]:
    """Return trials of all kinds in turn; the first ones of more are those of fewer.

    Nine of ten are drawn again, up to 100 times, until nobody is nearer to start and goal than the clearance.

    Raises
    ------
    SetupError
        ``count`` or ``seed`` is no whole number of its range.
    """
    require_count("scenes: count", count, 1, 100_000)
    require_count("scenes: seed", seed, 0, 2**63 - 1)
    return [_free(field, profile, k, np.random.default_rng([seed, k])) for k in range(count)]


def _free(field: Field, profile: Profile, k: int, random: np.random.Generator) -> Scene:
    scene = _scene(KINDS[k % len(KINDS)], random)
    for _ in range(0 if k % 10 == _AS_DRAWN else _DRAWS):
        bodies = scene.bodies(profile)
        if field.is_clear(scene.start, bodies) and field.is_clear(scene.goal, bodies):
            break
        scene = _scene(scene.kind, random)
    return scene


def _scene(kind: Kind, random: np.random.Generator) -> Scene:
    """Draw somebody before the arm, in most trials somebody else behind it, and the direction."""
    people = [_walking(random) if kind == "passing" else _standing(random)]
    if random.uniform() < 0.75:
        behind = _person(random.uniform(0.8, 1.0), _BETWEEN_RAD + math.pi + random.uniform(-0.3, 0.3), 0.7)
        people.append(np.repeat(behind[None], FRAMES, axis=0))
    frames = np.stack(people, axis=1)
    if kind == "occluded":
        hidden = _LIMBS[int(random.integers(len(_LIMBS)))]
        since = int(random.integers(0, 4))
        frames[since:, 0, list(hidden)] = np.nan
    start, goal = (PICK, PLACE) if random.uniform() < 0.5 else (PLACE, PICK)
    return Scene(kind, start.copy(), goal.copy(), frames)


def _person(far: float, azimuth: float, height: float) -> Array:
    """Return points (20, 3) of somebody who faces the base, the right hand at a place."""
    hand = np.array([far * math.cos(azimuth), far * math.sin(azimuth), height])
    return report_of(hand, 0.0, 0.0).people[0].xyz


def _standing(random: np.random.Generator) -> Array:
    """Return somebody who keeps the hand where the arm passes, and leans in by up to 0.1 m."""
    azimuth = _BETWEEN_RAD + random.uniform(-0.4, 0.3)
    far, height = random.uniform(0.6, 0.9), random.uniform(0.3, 0.9)
    inwards = -random.uniform(0.0, 0.1) * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    shares = np.linspace(0.0, 1.0, FRAMES)
    return _person(far, azimuth, height) + shares[:, None, None] * inwards


def _walking(random: np.random.Generator) -> Array:
    """Return somebody who walks past at 0.2 to 0.8 m/s, across the way of the arm."""
    azimuth, speed = _BETWEEN_RAD + random.uniform(-0.4, 0.3), random.uniform(0.2, 0.8)
    far, height = random.uniform(0.7, 0.95), random.uniform(0.4, 0.8)
    side = 1.0 if random.uniform() < 0.5 else -1.0
    along = side * speed * np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    t = FRAME_S * (np.arange(FRAMES) - 0.5 * (FRAMES - 1))
    return _person(far, azimuth, height) + t[:, None, None] * along
