"""Trials of the paper's three scenarios: a pick and place of the UR16e, and somebody beside it.

The paper says *static human standing near robot base*, *human walking past the robot* and *partial occlusion
of human joints*; where, how fast and which joints, it does not say. All of that is drawn here, by seed.
Behind the arm stands a post, so that it cannot just turn the other way round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_count
from modes.twin.camera import Hidden, nothing_hidden
from modes.twin.people import Person, Stance, Standing, Walking
from occupancy.body import MAX_POINTS, Point

Array = NDArray[np.float64]

PICK = (1.2, -1.25, 1.55, -1.87, -1.571, 0.0)
"""Configuration with the tool at the left of the arm [rad], pointing down."""
PLACE = (-1.7, -1.25, 1.55, -1.87, -1.571, 0.0)
"""The same at its right."""
POST = ((-0.62, 0.0, -0.8), (-0.62, 0.0, 1.2), 0.12)
"""Ends and radius of a post behind the arm [m]."""
FLOOR_Z_M = -0.8
"""The arm stands on a pedestal of this height."""
END_S = 12.0
"""A trial in which the arm has not arrived by then has not succeeded."""
_LEFT_ARM = (Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP)
_RIGHT_ARM = (Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP)
_LEGS = (Point.L_HIP, Point.L_KNEE, Point.L_ANKLE, Point.R_HIP, Point.R_KNEE, Point.R_ANKLE)


class Kind(Enum):
    """The paper's scenarios."""

    STANDING = "stands near the base"
    WALKING = "walks past"
    OCCLUDED = "walks up, partly hidden"


class Trial(NamedTuple):
    """One trial.

    Attributes
    ----------
    number, kind:
        Which.
    person:
        Who is there.
    hidden:
        Which points the camera does not see.
    """

    number: int
    kind: Kind
    person: Person
    hidden: Hidden


def trials(count: int = 50, seed: int = 0) -> list[Trial]:
    """Return so many trials, a third of each kind.

    Raises
    ------
    SetupError
        ``count`` or ``seed`` is no whole number of its range.
    """
    require_count("trials: count", count, 1, 100_000)
    require_count("trials: seed", seed, 0, 2**63 - 1)
    kinds = tuple(Kind)
    found = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        kind = kinds[number % len(kinds)]
        person = _standing(random) if kind is Kind.STANDING else _walking(random)
        hidden = _occluded(random) if kind is Kind.OCCLUDED else nothing_hidden
        found.append(Trial(number, kind, person, hidden))
    return found


def _standing(random: np.random.Generator) -> Standing:
    """Return somebody before the arm, half of them with a hand at work between them and the arm."""
    x, y = random.uniform(0.85, 1.5), random.uniform(-0.6, 0.6)
    stance = Stance(x, y, math.atan2(-y, -x), FLOOR_Z_M, random.uniform(1.6, 1.9))
    if random.uniform() < 0.5:
        return Standing(stance)
    hands = []
    t = 0.0
    while t < END_S:
        away, aside, above = random.uniform(0.35, 0.5), random.uniform(-0.3, 0.3), random.uniform(0.1, 0.5)
        hands.append((t, (x - away, y + aside, above)))
        t += random.uniform(1.2, 2.5)
    return Standing(stance, tuple(hands))


def _walking(random: np.random.Generator) -> Walking:
    """Return somebody who walks past before the arm, from one side or the other."""
    side = 1.0 if random.uniform() < 0.5 else -1.0
    near, far = random.uniform(0.85, 1.3), random.uniform(0.85, 1.5)
    speed = random.uniform(0.6, 1.0)
    start = random.uniform(-1.5, 0.5)
    return Walking((near, -2.5 * side), (far, 2.5 * side), speed, start, FLOOR_Z_M, random.uniform(1.6, 1.9))


@dataclass(frozen=True, slots=True)
class _Occlusion:
    """Points that are hidden for a while."""

    points: tuple[Point, ...]
    begin_s: float
    end_s: float

    def __call__(self, t: float, _person: int) -> NDArray[np.bool_]:
        """Return which points are hidden at ``t``."""
        mask = np.zeros(MAX_POINTS, dtype=bool)
        if self.begin_s <= t < self.end_s:
            mask[list(self.points)] = True
        return mask


def _occluded(random: np.random.Generator) -> _Occlusion:
    which = (_LEFT_ARM, _RIGHT_ARM, _LEGS)[int(random.integers(3))]
    begin = random.uniform(0.0, 2.0)
    return _Occlusion(which, begin, begin + random.uniform(0.5, 2.0))
