"""People who obey a profile and go for the arm: sizes, motion and what they are up to.

They slide over the floor, turn, and swing their stretched arms; every point keeps the speed and acceleration
of the profile, and their flesh fills the radii of the profile. One of them goes for the arm at a time, the
others keep away from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Part, Point, Profile
from occupancy.humans.options import HANDS, SEGMENTS
from verifier.command import State
from verifier.scripted_people_kernels import BOUNDS, MOST_PERSONS, SCRIPTED, points_at, set_out, state_at

Array = NDArray[np.float64]

DOWN_RAD, UP_RAD = 0.15, 2.3
"""Arms hang a little away from the body, and are raised above the shoulders at most so far."""
_SMALLEST = 0.8
"""People are this share as large as the largest of the profile, or larger."""
_NEAR_ENOUGH_M = 0.01
"""Who is this near to an arm that stands still does not press on."""
_LEFT = (Point.L_SHOULDER, Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP)
_RIGHT = (Point.R_SHOULDER, Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP)
_ARMS = (_LEFT, _RIGHT)
_LEGS = ((Point.L_HIP, Point.L_KNEE, Point.L_ANKLE), (Point.R_HIP, Point.R_KNEE, Point.R_ANKLE))


class Goal(NamedTuple):
    """Where to go: a point of the arm ``on_link`` (3,), the nearest point ``on_body`` (3,) [m], how far."""

    distance: float
    on_link: Array
    on_body: Array


@dataclass(frozen=True, slots=True)
class Place:
    """Where people are.

    Attributes
    ----------
    centre:
        (2,) axis of the robot [m].
    floor_m:
        Height of the floor [m].
    reach_m:
        How far the robot reaches from its axis [m].
    standstill_s:
        About how long the robot takes from a report until it rests [s]; decides how far they go away.
    """

    centre: Array
    floor_m: float
    reach_m: float
    standstill_s: float


class Flesh(NamedTuple):
    """Body parts of one person as capsules: parts and end points (numbers of points), radii [m]."""

    part: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    radius: Array


class _Mind(IntEnum):
    """What somebody is up to."""

    KEEP_AWAY = 0
    RETREAT = 1
    CHARGE = 2


@dataclass(slots=True)
class _Intent:
    """What one person wants for now; ``until`` [s] at the latest."""

    mind: _Mind = _Mind.KEEP_AWAY
    until: float = 0.0
    patience: float = 0.0
    since: float = -1.0
    walk: float = 1.0
    reach_from_m: float = 0.0
    arms: tuple[bool, bool] = (False, False)
    away_m: float = 0.0
    drift: float = 0.0


class ScriptedPeople:
    """Seeded people around an arm.

    Parameters
    ----------
    profile:
        What they obey, ``faster`` times over.
    count:
        How many there are, 0 to 8.
    place:
        Where.
    rng:
        Decides everything that is left to chance.
    faster:
        Factor on all speeds and accelerations; above 1 the profile is not obeyed.
    held_m:
        How far what they hold reaches beyond the hands [m].
    """

    def __init__(
        self,
        profile: Profile,
        count: int,
        place: Place,
        rng: np.random.Generator,
        *,
        faster: float = 1.0,
        held_m: float = 0.0,
    ) -> None:
        self._place, self._rng, self._count = place, rng, count
        self.floor_m = place.floor_m
        self._speed = float(profile.speed.min()) * faster
        self._fastest = faster * profile.speed
        self.block = np.zeros(1, dtype=SCRIPTED)
        rec = self.block[0]
        rec["n"] = count
        rec["arm"] = -1
        for number, arm in enumerate(_ARMS):
            rec["arm"][list(arm)] = number
        _set_bounds(self.block, profile, faster)
        self.flesh: list[Flesh] = []
        self._arm_m = np.zeros(count)
        for p in range(count):
            self._make_body(p, profile, held_m)
        self._intents = [_Intent() for _ in range(count)]
        self._active, self._turn_ends = 0, 0.0
        self._points = np.zeros((MOST_PERSONS, MAX_POINTS, 3))
        self._x = np.zeros((MOST_PERSONS, 5))
        self._wish = np.zeros((MOST_PERSONS, 5))

    @property
    def fastest_m_s(self) -> float:
        """Return a speed that no point exceeds [m/s]."""
        return float(self._fastest.max())

    def points(self, tau: float) -> Array:
        """Return the body points (count, 20, 3) [m] at ``tau`` [s] after the begin of the step."""
        points_at(self.block, tau, self._points)
        return self._points[: self._count].copy()

    def set_out(self, t: float, dt: float, goals: Sequence[Goal | None], state: State) -> None:
        """Begin a step of ``dt`` [s] at ``t`` [s]; ``goals``: per person, ``None``: too far to tell."""
        if self._count == 0:
            return
        state_at(self.block, float(self.block["step"][0]), self._x)
        self._take_turns(t)
        for p in range(self._count):
            self._decide(p, t, goals[p], state)
            self._wish[p] = self._wanted(p, goals[p], dt)
        set_out(self.block, self._wish, dt)

    def _make_body(self, p: int, profile: Profile, held_m: float) -> None:
        """Give somebody limbs that the profile allows, and a place to begin."""
        rec, rng, chain = self.block[0], self._rng, profile.chain
        share = rng.uniform(_SMALLEST, 0.99)
        offset, along = np.zeros((MAX_POINTS, 3)), np.zeros(MAX_POINTS)
        trunk = share * chain[Point.PELVIS, Point.NECK_BASE]
        offset[Point.THORAX, 2], offset[Point.NECK_BASE, 2] = 0.55 * trunk, trunk
        offset[Point.HEAD, 2] = trunk + share * chain[Point.NECK_BASE, Point.HEAD]
        for arm, side in zip(_ARMS, (1.0, -1.0), strict=True):
            shoulder, elbow, wrist, hand, tip = arm
            broad = share * chain[Point.NECK_BASE, shoulder]
            offset[list(arm)] = 0.0, side * broad, trunk
            along[elbow] = share * chain[shoulder, elbow]
            along[wrist] = along[elbow] + share * chain[elbow, wrist]
            palm = min(share * chain[wrist, tip], 0.9 * profile.radius[Part.L_HAND])
            along[hand], along[tip] = along[wrist] + 0.45 * palm, along[wrist] + palm
        for leg, side in zip(_LEGS, (1.0, -1.0), strict=True):
            hip, knee, ankle = leg
            thigh, shank = share * chain[hip, knee], share * chain[knee, ankle]
            offset[list(leg), 1] = side * share * chain[Point.PELVIS, hip]
            offset[knee, 2], offset[ankle, 2] = -thigh, -thigh - shank
        rec["offset"][p], rec["along"][p] = offset, along
        rec["height"][p] = self._place.floor_m + 0.08 - offset[Point.L_ANKLE, 2]
        self._arm_m[p] = along[Point.L_FINGERTIP]
        self.flesh.append(_flesh(profile, along, held_m))
        _set_levers(self.block, p)
        angle, far = rng.uniform(-math.pi, math.pi), self._far_away()
        rec["x"][p, :2] = self._place.centre + far * np.array([math.cos(angle), math.sin(angle)])
        rec["x"][p, 2:] = angle + math.pi, DOWN_RAD, DOWN_RAD

    def _far_away(self) -> float:
        """A distance [m] at which the arm has room to move."""
        way = self.fastest_m_s * self._place.standstill_s
        return self._place.reach_m + 0.8 + way * float(self._rng.uniform(1.0, 1.8))

    # What they are up to.

    def _take_turns(self, t: float) -> None:
        """Let somebody else go for the arm from time to time."""
        if t < self._turn_ends:
            return
        rng = self._rng
        self._intents[self._active].mind = _Mind.KEEP_AWAY
        self._intents[self._active].away_m = self._far_away()
        self._active = int(rng.integers(self._count))
        self._turn_ends = t + rng.uniform(5.0, 15.0)
        self._retreat(self._intents[self._active], t)

    def _retreat(self, intent: _Intent, t: float) -> None:
        rng = self._rng
        intent.mind, intent.until, intent.since = _Mind.RETREAT, t + rng.uniform(3.0, 8.0), -1.0
        intent.patience = rng.uniform(0.0, 1.5) * rng.uniform()
        intent.away_m, intent.arms = self._far_away(), (False, False)

    def _charge(self, intent: _Intent, t: float) -> None:
        rng = self._rng
        intent.mind, intent.until, intent.since = _Mind.CHARGE, t + rng.uniform(2.0, 6.0), -1.0
        intent.patience = rng.uniform(0.0, 1.0) ** 2
        kind = int(rng.integers(4))
        intent.arms = ((False, False), (True, False), (False, True), (True, True))[kind]
        intent.reach_from_m = rng.choice([0.3, 0.8, math.inf])
        intent.walk = 1.0 if kind == 0 else rng.uniform(0.3, 0.9)

    def _decide(self, p: int, t: float, goal: Goal | None, state: State) -> None:
        """Go for the arm while it moves, and away from it when it has stood still for long enough."""
        intent, rng = self._intents[p], self._rng
        if intent.mind is _Mind.KEEP_AWAY:
            if t >= intent.until:
                intent.until, intent.drift = t + rng.uniform(1.0, 4.0), rng.uniform(-1.0, 1.0)
                intent.away_m = intent.away_m or self._far_away()
            return
        waits_for = state is State.STOPPED if intent.mind is _Mind.CHARGE else state is State.EXECUTING
        if not waits_for:
            intent.since = -1.0
        elif intent.since < 0.0:
            intent.since = t
        if t >= intent.until or (waits_for and t - intent.since >= intent.patience):
            if intent.mind is _Mind.CHARGE:
                self._retreat(intent, t)
            else:
                self._charge(intent, t)

    def _wanted(self, p: int, goal: Goal | None, dt: float) -> Array:
        """Return the rates (5,) that somebody would like."""
        intent, x, wish = self._intents[p], self._x[p], np.zeros(5)
        out = x[:2] - self._place.centre
        off = max(float(np.hypot(*out)), 1e-9)
        arms, yaw = np.full(2, DOWN_RAD), math.atan2(-out[1], -out[0])
        if intent.mind is _Mind.CHARGE:
            ahead, near, height = -out, off, None
            if goal is not None:
                ahead, near, height = (goal.on_link - goal.on_body)[:2], goal.distance, goal.on_link[2]
                yaw = math.atan2(goal.on_link[1] - x[1], goal.on_link[0] - x[0])
            size = max(float(np.hypot(*ahead)), 1e-9)
            raised = near <= intent.reach_from_m
            if near > _NEAR_ENOUGH_M:
                wish[:2] = self._speed * (intent.walk if raised else 1.0) * ahead / size
            if raised and height is not None:
                arms = np.where(intent.arms, self._towards(p, float(height)), DOWN_RAD)
        elif off < intent.away_m:
            wish[:2] = self._speed * out / off
        elif intent.mind is _Mind.KEEP_AWAY:
            wish[:2] = 0.3 * self._speed * intent.drift * np.array([-out[1], out[0]]) / off
        turn = (yaw - x[2] + math.pi) % (2.0 * math.pi) - math.pi
        wish[2] = _rate_towards(turn, 2.0, dt)
        for side in range(2):
            wish[3 + side] = _rate_towards(arms[side] - x[3 + side], 0.8 * self._fastest_swing(p), dt)
        return wish

    def _towards(self, p: int, height: float) -> float:
        """Return the angle [rad] at which a stretched arm ends at a height [m]."""
        shoulder = float(self.block["height"][0, p] + self.block["offset"][0, p, Point.L_SHOULDER, 2])
        down = (shoulder - height) / float(self._arm_m[p])
        angle = math.acos(min(max(down, -1.0), 1.0))
        return min(max(angle, DOWN_RAD), UP_RAD)

    def _fastest_swing(self, p: int) -> float:
        return float(self._fastest[Point.L_FINGERTIP] / self._arm_m[p])


def _rate_towards(left: float, fastest: float, dt: float) -> float:
    """Return a rate that is gone when nothing is ``left``."""
    return math.copysign(min(fastest, 6.0 * abs(left), abs(left) / dt), left)


def _flesh(profile: Profile, along: Array, held_m: float) -> Flesh:
    """Return the parts of a body, each as large as the profile has it.

    A hand lies within its radius of each of its points, which leaves a narrow one around all of them.
    """
    rows: list[tuple[Part, Point, Point, float]] = []
    for part, (a, b) in SEGMENTS.items():
        radius = float(profile.radius[part])
        if part not in HANDS:
            rows.append((part, a, b, radius))
            continue
        wrist, hand, tip = HANDS[part]
        narrow = radius - float(along[tip] - along[wrist]) + held_m
        rows += [(part, wrist, hand, narrow), (part, hand, tip, narrow)]
    parts, begin, end = (np.array([int(row[i]) for row in rows]) for i in range(3))
    return Flesh(parts, begin, end, np.array([row[3] for row in rows]))


def _set_levers(people: NDArray[np.void], p: int) -> None:
    """Say how fast each point goes at most by walking, turning and swinging."""
    rec = people[0]
    lever = rec["lever"][p]
    middle = 0.5 * (rec["along"][p, [Point.L_ELBOW, Point.R_ELBOW]])
    middle = middle + 0.5 * rec["along"][p, [Point.L_WRIST, Point.R_WRIST]]
    for point in range(MAX_POINTS):
        arm, along = int(rec["arm"][point]), float(rec["along"][p, point])
        lever[point, 0] = 1.0
        lever[point, 1] = math.hypot(float(rec["offset"][p, point, 1]), along)
        if arm >= 0:
            lever[point, 2 + arm] = along
    for arm in range(2):
        angular, relative = lever[MAX_POINTS + arm], lever[MAX_POINTS + 2 + arm]
        angular[1] = angular[2 + arm] = 1.0
        relative[1] = relative[2 + arm] = middle[arm]
    lever[MAX_POINTS + 4, 1] = 1.0


def _set_bounds(people: NDArray[np.void], profile: Profile, faster: float) -> None:
    """Say what each row of ``lever`` must not exceed."""
    speed, acceleration = np.full(BOUNDS, np.inf), np.full(BOUNDS, np.inf)
    speed[:MAX_POINTS], acceleration[:MAX_POINTS] = profile.speed, profile.acceleration
    arm, n = profile.arm, MAX_POINTS
    if arm is not None:
        speed[n : n + 5] = *[arm.angular_speed] * 2, *[arm.relative_speed] * 2, arm.torso_rate
        acceleration[n : n + 4] = *[arm.angular_acceleration] * 2, *[arm.relative_acceleration] * 2
    people["speed"], people["acceleration"] = faster * speed, faster * acceleration
