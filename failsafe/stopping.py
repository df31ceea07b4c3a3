"""Worst-case stops: time and angle of each joint, speed of the fastest point of the arm, its way to rest.

**Point speed.** F(w), the largest speed of a point over all configurations and all joint speeds |dq_j| ≤ w_j,
is bracketed by branch and bound (:mod:`failsafe.box_search`). It grows with w, in proportion, and F(w + w') ≤
F(w) + F(w').

**Way.** While a stop runs, |dq_j(t)| ≤ s_j(t) V_j with s_j falling from 1 to 0, so no point goes farther than
∫ F(s(t) V) dt. At each instant sort the joints by s_j; s V is the sum of the layers (s_(m) − s_(m+1)) times V
of the m joints with the largest s_j, so F(sV) ≤ Σ_m (s_(m) − s_(m+1)) F(V of those joints). With s taken at
the begin of each time step that is an upper sum. From below, stops from states near the fastest one are
followed, and chords between instants added up: no way is shorter than its chords.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from failsafe.axis_stop import (
    AxisLimits,
    Start,
    WorstStop,
    fastest_during,
    motion_during,
    stop_axis,
    worst_angle,
    worst_time,
)
from failsafe.box_search import BoxSearch, Found, arm_points
from failsafe.bracket import Bracket, Effort, Ended, Witness
from robots.errors import SetupError
from robots.kernels import forward
from robots.limits import Array, JointLimits
from robots.model import RobotModel

STOP_TIME, STOP_ANGLE = "stop time", "stop angle"
POINT_SPEED, STOP_WAY = "fastest point speed", "longest way of a point"
_OUTWARD = 1.0 + 1e-12
_STEPS = 1_000
_CHORDS = 200
_STARTS = 9
_WORTH = 0.02
"""A layer below this share of the way is bounded in closed form."""


class StopModel(Protocol):
    """How the robot stops, and what is the worst of it."""

    @property
    def name(self) -> str:
        """Name of the stop in results."""

    def worst(self, arm: ArmSearch, extension_m: float = math.inf) -> tuple[Bracket, ...]:
        """Bracket every quantity, from configurations in which no point is farther from the first axis."""


class ArmSearch:
    """Largest point speeds of an arm; what was searched once is remembered.

    Parameters
    ----------
    effort:
        For each search. After an interrupt everything else is bounded in closed form.
    """

    def __init__(self, model: RobotModel, effort: Effort | None = None) -> None:
        self.model = model
        self.effort = effort or Effort()
        self.points, self.links = arm_points(model)
        self.interrupted = False
        self._found: dict[tuple[object, ...], Found] = {}

    def fastest(self, speed: Array, extension_m: float = math.inf) -> Found:
        """Search the fastest point at joint speeds up to ``speed (n,)`` [rad/s; m/s]."""
        scale = float(np.max(speed))
        if not scale > 0.0:
            return self._closed(speed, extension_m)
        key = (tuple(np.round(np.asarray(speed) / scale, 12)), extension_m)
        if key not in self._found:
            if self.interrupted:
                return self._closed(speed, extension_m)
            found = BoxSearch(self.model, self.points, np.asarray(speed) / scale, extension=extension_m).run(
                self.effort, POINT_SPEED
            )
            self.interrupted = found.ended is Ended.INTERRUPTED
            self._found[key] = found
        one = self._found[key]
        return Found(
            scale * one.best, scale * one.bound * _OUTWARD, one.q, scale * one.dq, one.point, one.ended,
            one.boxes, one.seconds,
        )  # fmt: skip

    def closed_bound(self, speed: Array) -> float:
        """Bound the point speed [m/s] in closed form."""
        return BoxSearch(self.model, self.points, speed).reach_bound()

    def largest_extension(self) -> Found:
        """Search how far [m] a point can be from the first axis: its speed where that joint alone has 1
        rad/s.

        Raises
        ------
        SetupError
            The first joint slides.
        """
        if self.model.kinematics[0]["prismatic"][0]:
            raise SetupError(f"joint {self.model.joints[0]} slides: the arm has no extension about it")
        speed = np.zeros(len(self.model.joints))
        speed[0] = 1.0
        return self.fastest(speed)

    @property
    def box(self) -> tuple[Array, Array]:
        """Box of configurations (n,), (n,) that stands for all of them."""
        n = len(self.model.joints)
        task = BoxSearch(self.model, self.points, np.zeros(n)).task[0]
        return task["lower"][:n].copy(), task["upper"][:n].copy()

    def places(self, q: Array) -> Array:
        """Return the places (N, P, 3) [m] of all points at the configurations ``q (N, n)``."""
        n = len(self.model.joints)
        rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
        out = np.zeros((len(q), len(self.points), 3))
        for row, each in zip(out, q, strict=True):
            forward(self.model.kinematics, np.ascontiguousarray(each), rotations, positions)
            joint = self.points["joint"]
            row[:] = positions[joint] + np.einsum("pij,pj->pi", rotations[joint], self.points["place"])
        return out

    def _closed(self, speed: Array, extension_m: float) -> Found:
        search = BoxSearch(self.model, self.points, speed, extension=extension_m)
        n = len(self.model.joints)
        return Found(0.0, search.reach_bound(), np.zeros(n), np.zeros(n), -1, Ended.INTERRUPTED, 0, math.nan)


@dataclass(frozen=True, eq=False)
class JerkLimitedStop:
    """Each joint stops on its own, as quickly as acceleration and jerk limits allow (category 1 or 2).

    ``share``: speeds up to this share of the velocity limits; ``start``: see :class:`Start`.
    """

    limits: JointLimits
    share: float = 1.0
    start: Start = Start.STEADY
    name: str = field(default="joint_space", init=False)

    def __post_init__(self) -> None:
        _check_share(self.share)

    @property
    def speed(self) -> Array:
        """Largest |dq| (n,)."""
        return self.share * self.limits.velocity

    def axis(self, j: int) -> AxisLimits:
        """Return the limits of a joint."""
        return AxisLimits(
            float(self.speed[j]), float(self.limits.acceleration[j]), float(self.limits.jerk[j])
        )

    def time(self, j: int) -> WorstStop:
        """Longest time to rest of a joint [s]."""
        return worst_time(self.axis(j), self.start)

    def angle(self, j: int) -> WorstStop:
        """Largest displacement of a joint [rad; m]."""
        return worst_angle(self.axis(j), self.start)

    def fastest(self, j: int, t: Array) -> Array:
        """Bound |dq| (N,) of a joint at times ``t (N,)``; falls."""
        return fastest_during(self.axis(j), self.start, t)

    def way(self, j: int, t: Array) -> Array:
        """Displacement (N,) of a joint in the stop from its full speed."""
        axis = self.axis(j)
        return motion_during(stop_axis(axis.velocity, 0.0, axis), axis.velocity, 0.0, t)[0]

    def worst(self, arm: ArmSearch, extension_m: float = math.inf) -> tuple[Bracket, ...]:
        """Bracket every quantity; see :class:`StopModel`."""
        return axis_brackets(arm, self, extension_m)


@dataclass(frozen=True, eq=False)
class ConstantDeceleration:
    """Each joint goes on for ``delay_s`` at most, then brakes with at least ``deceleration (n,)``.

    ``speed (n,)``: largest |dq|. Units rad/s, rad/s²; m/s, m/s² for prismatic joints.

    Raises
    ------
    SetupError
        A number that is not finite, or not of the sign that it must have.
    """

    speed: Array
    deceleration: Array
    delay_s: float = 0.0
    name: str = "constant_deceleration"

    def __post_init__(self) -> None:
        for what, values in (("speed", self.speed), ("deceleration", self.deceleration)):
            if not (np.ndim(values) == 1 and np.isfinite(values).all() and np.min(values, initial=1.0) > 0.0):
                raise SetupError(f"stop {self.name}: {what} {values} must be finite and above zero")
        if len(self.speed) != len(self.deceleration):
            raise SetupError(
                f"stop {self.name}: {len(self.deceleration)} decelerations for {len(self.speed)} speeds"
            )
        if not 0.0 <= self.delay_s < math.inf:
            raise SetupError(f"stop {self.name}: delay of {self.delay_s:g} s must be finite, not below zero")

    def time(self, j: int) -> WorstStop:
        """Longest time to rest of a joint [s]."""
        v = float(self.speed[j])
        return WorstStop(self.delay_s + v / float(self.deceleration[j]), v, 0.0)

    def angle(self, j: int) -> WorstStop:
        """Largest displacement of a joint [rad; m]."""
        v = float(self.speed[j])
        return WorstStop(v * (self.delay_s + 0.5 * v / float(self.deceleration[j])), v, 0.0)

    def fastest(self, j: int, t: Array) -> Array:
        """Bound |dq| (N,) of a joint at times ``t (N,)``; falls."""
        v = float(self.speed[j])
        return np.clip(v - float(self.deceleration[j]) * (t - self.delay_s), 0.0, v)

    def way(self, j: int, t: Array) -> Array:
        """Displacement (N,) of a joint in the stop from its full speed."""
        v, a = float(self.speed[j]), float(self.deceleration[j])
        braking = np.clip(t - self.delay_s, 0.0, v / a)
        return v * np.clip(t, 0.0, self.delay_s) + braking * (v - 0.5 * a * braking)

    def worst(self, arm: ArmSearch, extension_m: float = math.inf) -> tuple[Bracket, ...]:
        """Bracket every quantity; see :class:`StopModel`."""
        return axis_brackets(arm, self, extension_m)


@dataclass(frozen=True, eq=False)
class PathConsistentStop:
    """The stop on the path that this software plans: how long it takes depends on the path.

    From below: paths on which one joint moves alone, or all at once in proportion. From above nothing holds
    for every path; over a recording there is a worst one.
    """

    limits: JointLimits
    share: float = 1.0
    name: str = field(default="path_consistent", init=False)

    def __post_init__(self) -> None:
        _check_share(self.share)

    def worst(self, arm: ArmSearch, extension_m: float = math.inf) -> tuple[Bracket, ...]:
        """Bracket every quantity; see :class:`StopModel`."""
        free = JerkLimitedStop(self.limits, self.share)
        reason = "depends on the path: look for the worst over a recording"
        straight = ConstantRatioStop(self.limits, self.share)
        out = []
        for each in axis_brackets(arm, free, extension_m):
            if each.quantity == POINT_SPEED:
                out.append(each)
                continue
            lower, witness = each.lower, each.witness
            if each.quantity == STOP_WAY:
                found = arm.fastest(straight.speed, extension_m)
                lower, witness, _ = _followed(arm, straight, found, extension_m)
            out.append(
                Bracket(
                    each.quantity, each.part, each.unit, lower, math.inf, witness, "none", Ended.UNBOUNDED,
                    reason, each.seconds,
                )
            )  # fmt: skip
        return tuple(out)


@dataclass(frozen=True, eq=False)
class ConstantRatioStop:
    """Stop on a straight path in joint space, all joints in proportion; how tests of stops are driven."""

    limits: JointLimits
    share: float = 1.0

    @property
    def speed(self) -> Array:
        """Largest |dq| (n,)."""
        return self.share * self.limits.velocity

    def axis(self) -> AxisLimits:
        """Return speed, acceleration and jerk limits of the path."""
        speed = self.speed
        return AxisLimits(
            1.0, float(np.min(self.limits.acceleration / speed)), float(np.min(self.limits.jerk / speed))
        )

    def time(self, j: int) -> WorstStop:
        """Time to rest of every joint [s]."""
        return worst_time(self.axis(), Start.STEADY)

    def way(self, j: int, t: Array) -> Array:
        """Displacement (N,) of a joint in the stop from its full speed."""
        axis = self.axis()
        return float(self.speed[j]) * motion_during(stop_axis(1.0, 0.0, axis), 1.0, 0.0, t)[0]


class _Ways(Protocol):
    @property
    def speed(self) -> Array: ...

    def time(self, j: int) -> WorstStop: ...

    def way(self, j: int, t: Array) -> Array: ...


class _Axes(_Ways, Protocol):
    def angle(self, j: int) -> WorstStop: ...

    def fastest(self, j: int, t: Array) -> Array: ...


def axis_brackets(arm: ArmSearch, stop: _Axes, extension_m: float = math.inf) -> tuple[Bracket, ...]:
    """Bracket the quantities of a stop in which each joint brakes on its own."""
    model = arm.model
    n = len(model.joints)
    if len(stop.speed) != n:
        raise SetupError(f"{model.name}: a stop for {len(stop.speed)} joints, but there are {n}")
    out = []
    room = model.limits.position_upper - model.limits.position_lower
    for quantity, worst in ((STOP_TIME, stop.time), (STOP_ANGLE, stop.angle)):
        for j, joint in enumerate(model.joints):
            slides = bool(model.kinematics[0]["prismatic"][j])
            unit = "s" if quantity == STOP_TIME else "m" if slides else "rad"
            bracket = _closed_form(model, quantity, joint, unit, worst(j), j)
            out.append(bracket if stop.angle(j).value <= room[j] else _not_reached(bracket))
    found = arm.fastest(stop.speed, extension_m)
    out.append(speed_bracket(arm, found))
    out.append(_way_bracket(arm, stop, found, extension_m))
    return tuple(out)


def _not_reached(bracket: Bracket) -> Bracket:
    """A stop for which the range of its joint is too short: only that it is not exceeded is known."""
    method = f"{bracket.method}; no joint position leaves room for this stop"
    return replace(bracket, lower=0.0, witness=None, method=method)


def speed_bracket(arm: ArmSearch, found: Found) -> Bracket:
    """Bracket of the fastest point's speed [m/s] from a search."""
    part = arm.links[found.point] if found.point >= 0 else "none found"
    witness = None if found.point < 0 else Witness(found.q, found.dq, np.zeros_like(found.q))
    method = f"branch and bound with second derivatives, {found.boxes} boxes"
    return Bracket(
        POINT_SPEED, part, "m/s", found.best, found.bound, witness, method, found.ended, seconds=found.seconds
    )


def _closed_form(
    model: RobotModel, quantity: str, joint: str, unit: str, worst: WorstStop, j: int
) -> Bracket:
    n = len(model.joints)
    q = np.clip(np.zeros(n), model.limits.position_lower, model.limits.position_upper)
    dq, ddq = np.zeros(n), np.zeros(n)
    dq[j], ddq[j] = worst.velocity, worst.acceleration
    witness = Witness(q, dq, ddq)
    upper = worst.value * _OUTWARD
    return Bracket(
        quantity, joint, unit, worst.value, upper, witness, "closed form", Ended.CLOSED_FORM, seconds=0.0
    )


def _way_bracket(arm: ArmSearch, stop: _Axes, found: Found, extension_m: float) -> Bracket:
    """Bracket of the longest way of a point until rest [m].

    The arm may extend while it stops, so the upper bound takes the point speeds of every configuration.
    """
    begun = arm.effort.now()
    layers = _layers(arm, stop)
    upper = sum(layer.weight * layer.bound for layer in layers)
    early = (layer.ended for layer in layers if layer.ended not in (Ended.NARROW, Ended.CLOSED_FORM))
    ended = next(early, found.ended)
    lower, witness, point = _followed(arm, stop, found, extension_m)
    return Bracket(
        STOP_WAY, arm.links[point] if point >= 0 else "none found", "m", lower, upper * _OUTWARD, witness,
        "speeds of branch and bound, layer by layer over the time of the stop", ended,
        seconds=arm.effort.now() - begun,
    )  # fmt: skip


class _Layer(NamedTuple):
    """Part of the way: ``weight`` [s] times ``bound`` of the point speed [m/s]; why the search ended."""

    weight: float
    bound: float
    ended: Ended


def _layers(arm: ArmSearch, stop: _Axes) -> list[_Layer]:
    """Return the layers that make up the way."""
    n = len(stop.speed)
    speed = np.asarray(stop.speed)
    end = max(stop.time(j).value for j in range(n))
    t = np.linspace(0.0, end, _STEPS, endpoint=False)
    share = np.array([stop.fastest(j, t) for j in range(n)]) / speed[:, None]
    weights: dict[frozenset[int], float] = {}
    for column in share.T:
        order = np.argsort(-column, kind="stable")
        sorted_share = np.append(column[order], 0.0)
        for m in range(n):
            layer = float(sorted_share[m] - sorted_share[m + 1])
            if layer > 0.0:
                joints = frozenset(order[: m + 1].tolist())
                weights[joints] = weights.get(joints, 0.0) + layer * end / _STEPS
    everything = arm.fastest(speed)
    total = everything.bound * sum(weights.values())
    out = []
    for joints, weight in weights.items():
        part = np.where([j in joints for j in range(n)], speed, 0.0)
        bound, ended = min(everything.bound, arm.closed_bound(part)), everything.ended
        if len(joints) < n and weight * bound > _WORTH * total:
            found = arm.fastest(part)
            bound, ended = min(bound, found.bound), found.ended
        out.append(_Layer(weight, bound, ended))
    return out


def _followed(
    arm: ArmSearch, stop: _Ways, found: Found, extension_m: float
) -> tuple[float, Witness | None, int]:
    """Follow stops that begin before, at and behind the fastest state; the longest way found, from where, of
    which point."""
    best: tuple[float, Witness | None, int] = (0.0, None, -1)
    if found.point < 0:
        return best
    limits = arm.model.limits
    n = len(stop.speed)
    t = np.linspace(0.0, max(stop.time(j).value for j in range(n)), _CHORDS)
    way = np.array([stop.way(j, t) for j in range(n)]).T * np.sign(found.dq)
    for back in np.linspace(0.0, 1.0, _STARTS):
        q = found.q - back * way[-1] + way
        q = _within(q, limits)
        if q is None or not extends(arm, q[0]) <= extension_m:
            continue
        places = arm.places(q)
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0)
        point = int(np.argmax(lengths))
        if lengths[point] > best[0]:
            best = (float(lengths[point]), Witness(q[0].copy(), found.dq, np.zeros(n)), point)
    return best


def extends(arm: ArmSearch, q: Array) -> float:
    """Largest distance [m] of a point from the first axis, balls included."""
    tree = arm.model.kinematics[0]
    axis = tree["rotation"][0] @ tree["axis"][0]
    away = np.cross(axis, arm.places(q[None])[0] - tree["translation"][0])
    return float((np.linalg.norm(away, axis=1) + arm.points["ball"]).max())


def _within(q: Array, limits: JointLimits) -> Array | None:
    """Move the way (N, n) by whole turns into the position limits; None if that is impossible."""
    lower, upper = limits.position_lower, limits.position_upper
    low, high = q.min(axis=0), q.max(axis=0)
    turns = np.where(low < lower, np.ceil((lower - low) / (2.0 * math.pi)), 0.0)
    turns = np.where(high > upper, -np.ceil((high - upper) / (2.0 * math.pi)), turns)
    moved: Array = q + 2.0 * math.pi * np.where(np.isfinite(turns), turns, 0.0)
    inside = (moved >= lower).all() and (moved <= upper).all()
    return moved if inside else None


def _check_share(share: float) -> None:
    if not 0.0 < share <= 1.0:
        raise SetupError(f"speed share {share:g} must be above 0 and at most 1")


def of(brackets: Sequence[Bracket], quantity: str) -> tuple[Bracket, ...]:
    """Return the brackets of one quantity."""
    return tuple(each for each in brackets if each.quantity == quantity)
