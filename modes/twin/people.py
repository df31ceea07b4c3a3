"""People of the twin: who stands and works, who walks past, and who was recorded. Where their points are.

Scripted people are made up: a body of one shape, gait as swinging legs and arms, hands that go from place to
place in straight lines (minimum jerk: Flash and Hogan 1985). Walking at 1 m/s no point of them is faster than
2 m/s; feet of people are. They are there to move past a robot, not to stand for how people move; recordings
are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from modes.quintics import rest_to_rest
from modes.settings import require_kind, require_number, require_numbers
from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]

_BODY: dict[Point, tuple[float, float, float]] = {
    Point.HEAD: (0.0, 0.0, 1.62), Point.NECK_BASE: (0.0, 0.0, 1.45), Point.THORAX: (0.0, 0.0, 1.22),
    Point.PELVIS: (0.0, 0.0, 0.95), Point.L_SHOULDER: (0.0, 0.18, 1.40), Point.R_SHOULDER: (0.0, -0.18, 1.40),
    Point.L_HIP: (0.0, 0.09, 0.91), Point.R_HIP: (0.0, -0.09, 0.91),
}  # fmt: skip
"""Of somebody of 1.75 m who faces along x, left to y [m]."""
_STATURE_M = 1.75
_UPPER_ARM_M, _FOREARM_M, _PALM_M, _FINGERS_M = 0.29, 0.25, 0.08, 0.09
_THIGH_M, _SHANK_M = 0.42, 0.40
_STRIDE_M, _USUAL_M_S = 1.4, 1.0
_LEG_RAD, _KNEE_RAD, _ARM_RAD, _ELBOW_RAD = 0.19, 0.25, 0.25, 0.3
_RAMP_S = 0.6
_ARMS = (
    (Point.L_SHOULDER, Point.L_ELBOW, Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    (Point.R_SHOULDER, Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
)
_LEGS = ((Point.L_HIP, Point.L_KNEE, Point.L_ANKLE), (Point.R_HIP, Point.R_KNEE, Point.R_ANKLE))


class Person(Protocol):
    """Somebody in the cell."""

    def at(self, t: float) -> Array:
        """Return the points ``(20, 3)`` [m, world] at ``t`` [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Stance:
    """Where somebody stands.

    Attributes
    ----------
    x_m, y_m, yaw_rad:
        Place of the pelvis over the floor, and where it faces.
    floor_z_m:
        Height of the floor.
    stature_m:
        Of the person; the body is scaled.

    Raises
    ------
    SetupError
        A number is none, or the stature is not from 1.2 to 2.2 m.
    """

    x_m: float
    y_m: float
    yaw_rad: float = 0.0
    floor_z_m: float = 0.0
    stature_m: float = _STATURE_M

    def __post_init__(self) -> None:
        for name in ("x_m", "y_m", "yaw_rad", "floor_z_m"):
            require_number(f"stance: {name}", getattr(self, name), -1e3, 1e3)
        require_number("stance: stature_m", self.stature_m, 1.2, 2.2)

    def in_world(self, points: Array) -> Array:
        """Return points (20, 3) of a body of 1.75 m at the origin, scaled, turned and moved."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        place = np.array([self.x_m, self.y_m, self.floor_z_m])
        return np.asarray((self.stature_m / _STATURE_M) * points @ turn.T + place)

    def from_world(self, place: Array) -> Array:
        """Return the place (3,) as the body of 1.75 m sees it; :meth:`in_world` undone."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        away = place - np.array([self.x_m, self.y_m, self.floor_z_m])
        return np.asarray((_STATURE_M / self.stature_m) * away @ turn)


@dataclass(frozen=True, slots=True)
class Standing:
    """Somebody who stands, and whose right hand goes from place to place.

    Attributes
    ----------
    stance:
        Where.
    hands:
        ``(t [s], (x, y, z) [m, world])``: when the right wrist is where, resting there; in between it moves.
        A place out of reach is reached for. Empty: arms hang down.

    Raises
    ------
    SetupError
        Instants do not increase.
    """

    stance: Stance
    hands: Sequence[tuple[float, tuple[float, float, float]]] = ()

    def __post_init__(self) -> None:
        require_kind("standing: stance", self.stance, Stance, written="Stance(x_m, y_m, ...)")
        for k, (t, place) in enumerate(self.hands):
            require_number(f"standing: instant {k}", t, -1e6, 1e6)
            require_numbers(f"standing: place {k}", place, (3,))
        for (before, _place), (after, _next) in pairwise(self.hands):
            if not after > before:
                raise SetupError(f"standing: instants {before:g} s and {after:g} s should increase")

    def at(self, t: float) -> Array:
        """Return the points ``(20, 3)`` [m, world] at ``t`` [s]."""
        points = _upright()
        for side in (0, 1):
            _swing_arm(points, side, 0.0)
            _swing_leg(points, side, 0.0, 0.0)
        if self.hands:
            _reach(points, self.stance.from_world(self._hand(t)))
        return self.stance.in_world(points)

    def _hand(self, t: float) -> Array:
        instants = [each for each, _place in self.hands]
        k = int(np.searchsorted(instants, t, side="right"))
        if k in {0, len(instants)}:
            return np.array(self.hands[max(k - 1, 0)][1])
        (begin, a), (end, b) = self.hands[k - 1], self.hands[k]
        u = (t - begin) / (end - begin)
        return np.asarray(np.array(a) + u**3 * (10.0 - 15.0 * u + 6.0 * u * u) * (np.array(b) - np.array(a)))


@dataclass(frozen=True, slots=True)
class Walking:
    """Somebody who walks straight from one place to another, and rests at both.

    Attributes
    ----------
    begin, end:
        ``(x, y)`` [m].
    speed_m_s:
        In between.
    start_s:
        When they set out [s].
    floor_z_m, stature_m:
        As for :class:`Stance`.

    Raises
    ------
    SetupError
        The places are no farther apart than it takes to get to the speed and to rest, or a number does not
        fit a :class:`Stance`.
    """

    begin: tuple[float, float]
    end: tuple[float, float]
    speed_m_s: float = _USUAL_M_S
    start_s: float = 0.0
    floor_z_m: float = 0.0
    stature_m: float = _STATURE_M

    def __post_init__(self) -> None:
        require_numbers("walking: begin", self.begin, (2,))
        require_numbers("walking: end", self.end, (2,))
        require_number("walking: speed_m_s", self.speed_m_s, 0.0, 3.0, above=True)
        require_number("walking: start_s", self.start_s, -1e6, 1e6)
        for x, y in (self.begin, self.end):
            Stance(x, y, 0.0, self.floor_z_m, self.stature_m)
        if self.length_m < _RAMP_S * self.speed_m_s:
            raise SetupError(
                f"walking: {self.length_m:.2f} m are too short for {self.speed_m_s:g} m/s: at least "
                f"{_RAMP_S * self.speed_m_s:.2f} m are needed"
            )

    @property
    def length_m(self) -> float:
        """How far they walk [m]."""
        return math.dist(self.begin, self.end)

    @property
    def duration_s(self) -> float:
        """How long they take [s]."""
        return self.length_m / self.speed_m_s + _RAMP_S

    def at(self, t: float) -> Array:
        """Return the points ``(20, 3)`` [m, world] at ``t`` [s]."""
        since = min(max(t - self.start_s, 0.0), self.duration_s)
        way, speed, _change = rest_to_rest(since, self.length_m, self.duration_s, _RAMP_S)
        share = way / self.length_m
        (x0, y0), (x1, y1) = self.begin, self.end
        yaw = math.atan2(y1 - y0, x1 - x0)
        stance = Stance(x0 + share * (x1 - x0), y0 + share * (y1 - y0), yaw, self.floor_z_m, self.stature_m)
        return stance.in_world(_walking(2.0 * math.pi * way / _STRIDE_M, speed / _USUAL_M_S))


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Somebody who was recorded; before and after the recording as at its ends.

    Attributes
    ----------
    t:
        ``(T,)`` instants [s].
    xyz:
        ``(T, 20, 3)`` points [m]; NaN: not seen then.
    place:
        ``(x, y, z)`` [m] that is added.

    Raises
    ------
    SetupError
        Instants do not increase, or shapes do not fit.
    """

    t: Array
    xyz: Array
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", require_numbers("recorded person: t", self.t, (-1,)))
        object.__setattr__(self, "xyz", np.asarray(self.xyz, dtype=float))
        require_numbers("recorded person: place", self.place, (3,))
        if len(self.t) == 0 or not (np.diff(self.t) > 0.0).all():
            raise SetupError("recorded person: instants should be at least one, and increase")
        if self.xyz.shape != (len(self.t), MAX_POINTS, 3):
            raise SetupError(f"recorded person: points of shape {self.xyz.shape} should be (T, 20, 3)")

    def at(self, t: float) -> Array:
        """Return the points ``(20, 3)`` [m, world] at ``t`` [s]: linear between samples, NaN beside NaN."""
        k = int(np.clip(np.searchsorted(self.t, t, side="right"), 1, max(len(self.t) - 1, 1)))
        if len(self.t) == 1:
            return np.asarray(self.xyz[0] + self.place)
        u = float(np.clip((t - self.t[k - 1]) / (self.t[k] - self.t[k - 1]), 0.0, 1.0))
        if u in {0.0, 1.0}:  # a sample beside NaN is one still
            return np.asarray(self.xyz[k - 1 + int(u)] + self.place)
        return np.asarray((1.0 - u) * self.xyz[k - 1] + u * self.xyz[k] + self.place)


def _upright() -> Array:
    points = np.full((MAX_POINTS, 3), np.nan)
    for point, place in _BODY.items():
        points[point] = place
    return points


def _walking(phase: float, vigour: float) -> Array:
    """Return a body of 1.75 m that walks along x, at a phase of its stride [rad]; ``vigour`` 0: stands."""
    points = _upright()
    for side, sign in enumerate((1.0, -1.0)):
        swing = sign * math.sin(phase)
        _swing_leg(points, side, vigour * _LEG_RAD * swing, vigour * max(sign * math.cos(phase), 0.0) ** 2)
        _swing_arm(points, side, -vigour * _ARM_RAD * swing)
    return points


def _hang(angle: float) -> Array:
    """Return the direction (3,) that hangs down, turned forwards by ``angle`` [rad]."""
    return np.array([math.sin(angle), 0.0, -math.cos(angle)])


def _swing_leg(points: Array, side: int, angle: float, bent: float) -> None:
    hip, knee, ankle = _LEGS[side]
    points[knee] = points[hip] + _THIGH_M * _hang(angle)
    points[ankle] = points[knee] + _SHANK_M * _hang(angle - _KNEE_RAD * bent)


def _swing_arm(points: Array, side: int, angle: float) -> None:
    shoulder, elbow, wrist, hand, fingertip = _ARMS[side]
    points[elbow] = points[shoulder] + _UPPER_ARM_M * _hang(angle)
    ahead = _hang(angle + _ELBOW_RAD)
    for point, far in ((wrist, 0.0), (hand, _PALM_M), (fingertip, _PALM_M + _FINGERS_M)):
        points[point] = points[elbow] + (_FOREARM_M + far) * ahead


def _reach(points: Array, place: Array) -> None:
    """Put the right wrist to ``place`` (3,), as far as the arm reaches; the elbow hangs."""
    shoulder, elbow, wrist, hand, fingertip = _ARMS[1]
    away = place - points[shoulder]
    far = float(np.linalg.norm(away))
    near, reach = 1.05 * abs(_UPPER_ARM_M - _FOREARM_M), 0.98 * (_UPPER_ARM_M + _FOREARM_M)
    ahead = away / far if far > 0.0 else np.array([1.0, 0.0, 0.0])
    far = min(max(far, near), reach)
    along = (_UPPER_ARM_M**2 - _FOREARM_M**2 + far**2) / (2.0 * far)
    down = np.array([0.0, 0.0, -1.0]) + ahead[2] * ahead
    length = float(np.linalg.norm(down))
    down = down / length if length > 1e-6 else np.array([-1.0, 0.0, 0.0])
    points[elbow] = points[shoulder] + along * ahead + math.sqrt(_UPPER_ARM_M**2 - along**2) * down
    points[wrist] = points[shoulder] + far * ahead
    forearm = (points[wrist] - points[elbow]) / _FOREARM_M
    points[hand] = points[wrist] + _PALM_M * forearm
    points[fingertip] = points[hand] + _FINGERS_M * forearm
