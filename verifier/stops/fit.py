"""A model of how an arm brakes, from stops that were measured: the worst of them, and what it is worth.

The model is :class:`failsafe.braking.Braking`. It is fitted so that at every sample of every stop each joint
is within its bound; times count from the last sample at which the arm had not been told, and a speed holds
until the next sample (or window) begins to say otherwise, so that a joint that slows down steadily is within
it between samples too. A joint below the speed of standstill stands. Of all delays that leave a model, the
one is taken with the shortest ways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from failsafe.braking import LONGEST_S, Braking
from robots.errors import SetupError
from verifier.stops.finding import END_OF_MOTION, Stop
from verifier.stops.measuring import Measured
from verifier.stops.recorded import AllStops, StopsOf

FloatArray = NDArray[np.float64]

MARGIN = 0.1
"""Default of the share by which every time of the model is longer than what was measured."""
SLOWEST = 5.0
"""Joints below this many times the speed of standstill tell nothing about braking."""
_SLOW = 0.5
"""A joint at no more than this share of its largest speed tells how long slow ones take."""
_DELAYS = 200
_ROUNDED = 1.0 - 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One joint in one stop, in one direction.

    Attributes
    ----------
    joint:
        Which one.
    top:
        Its largest speed from when the arm was told on [rad/s, m/s].
    x, speed:
        ``(K,)`` until when [s since it was told] it may have had which speed; 0 below that of standstill.
    measured:
        The stop.
    """

    joint: int
    top: float
    x: FloatArray
    speed: FloatArray
    measured: Measured

    def brakes_for(self, delay: float) -> float:
        """How long it brakes [s] at the steadiest braking that bounds it after ``delay`` [s]."""
        late = (self.x > delay) & (self.speed > 0.0)
        left = self.top - self.speed[late]
        if (left <= 0.0).any():
            return math.inf
        return self.top / float(np.min(left / (self.x[late] - delay), initial=math.inf))

    def excess(self, model: Braking) -> float:
        """By how much it is faster than the model allows [rad/s, m/s]; negative: the least by which not."""
        brakes = max(model.braking_time_s, self.top / float(model.deceleration[self.joint]))
        share = 1.0 - np.maximum(self.x - model.delay_s, 0.0) / max(brakes, 1e-300)
        return float(np.max(self.speed - self.top * np.maximum(share, 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A stop held against a model that was fitted without it.

    Attributes
    ----------
    each, measured:
        The recording and the stop.
    excess:
        By how much its worst joint is faster than the model allows, at some sample [rad/s, m/s].
    joint:
        Which joint that is.
    time_s, way:
        What the model says that it takes: until all joints rest [s], and the way of each joint [rad, m].
    """

    each: StopsOf
    measured: Measured
    excess: float
    joint: int
    time_s: float
    way: tuple[float, ...]

    @property
    def within(self) -> bool:
        """Whether no joint is faster than the model allows at any sample."""
        return self.excess <= 0.0


@dataclass(frozen=True, slots=True)
class Drift:
    """A joint that gets farther by one recording than by the first one, from the same speed."""

    recording: str
    joint: str
    speed: float
    first: float
    now: float


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A model, and what it is worth.

    Attributes
    ----------
    model:
        Fitted on all stops, with the margin.
    margin:
        Share by which its times are longer.
    stops:
        How many stops it is fitted on.
    causes:
        What told the arm to stop in them.
    held:
        Every second stop, held against a model of the others (with the margin); empty for a single stop.
    fitted_on:
        How many stops that model is of.
    drift:
        Joints that get farther by more than the margin.
    faster:
        By how much each joint was faster after it was told than just before, in one direction or the other
        [rad/s, m/s]. The model bounds it; a plan that does not intend it does not.
    """

    model: Braking
    margin: float
    stops: int
    causes: tuple[str, ...]
    held: tuple[Held, ...]
    fitted_on: int
    drift: tuple[Drift, ...]
    faster: tuple[float, ...]

    @property
    def in_doubt(self) -> bool:
        """Whether a stop that was held out exceeds the model of the others, or recordings differ."""
        return bool(self.drift) or not all(held.within for held in self.held)


def fit(found: AllStops, margin: float = MARGIN) -> Fit:
    """Fit a model on the stops that have positions or velocities, and a reason.

    Raises
    ------
    SetupError
        No stop tells enough: none is of a joint that is fast enough, or the samples are too far apart.
    """
    known = [pair for pair in found.stops if pair[1].stop.kind != END_OF_MOTION]
    standstill = found.settings.standstill
    if not known:
        raise SetupError("no model of a stop: an end of motion is none, nothing tells when it was asked for")
    n = len(known[0][0].motion.joints)

    def model_of(pairs: Sequence[tuple[StopsOf, Measured]]) -> Braking:
        traces = [trace for each, stop in pairs for trace in traces_of(each, stop, standstill)]
        return fitted(traces, n, SLOWEST * standstill)

    model = model_of(known).slower(margin)
    halves = known[::2], known[1::2]
    held: list[Held] = []
    if halves[1]:
        of_half = model_of(halves[0]).slower(margin)
        held = [_held(each, stop, of_half, standstill) for each, stop in halves[1]]
    causes = tuple(dict.fromkeys(stop.stop.kind for _, stop in known))
    drift = tuple(_drift(found, known, margin, model_of))
    faster = np.max([_faster(each, stop.stop) for each, stop in known], axis=0)
    return Fit(
        model, margin, len(known), causes, tuple(held), len(halves[0]), drift, tuple(map(float, faster))
    )


def _faster(each: StopsOf, stop: Stop) -> FloatArray:
    """By how much each joint (n,) got faster than when it was told, in its worse direction, at least 0."""
    seen = each.seen
    first = int(np.searchsorted(seen.last, stop.before))  # the first window that reaches it
    when_told, later = seen.v[first : stop.before + 1], seen.v[stop.at : stop.rest]
    rises = [
        np.max(sign * later, axis=0, initial=0.0) - np.max(sign * when_told, axis=0, initial=0.0)
        for sign in (1.0, -1.0)
    ]
    faster: FloatArray = np.maximum(0.0, np.max(rises, axis=0))
    return faster


def traces_of(each: StopsOf, measured: Measured, standstill: float) -> Iterator[Trace]:
    """Yield the joints that are fast enough in a stop, both ways; ``standstill``: speed of that."""
    stop, t, seen = measured.stop, each.motion.t, each.seen
    rows = np.arange(stop.before, stop.rest)
    until = t[seen.last[np.minimum(rows + 1, len(t) - 1)]] - stop.asked_after
    for joint in range(seen.v.shape[1]):
        for sign in (1.0, -1.0):
            speed = np.maximum(sign * seen.v[rows, joint], 0.0)
            top = float(speed.max())
            if top >= SLOWEST * standstill:
                yield Trace(joint, top, until, np.where(speed < standstill, 0.0, speed), measured)


def fitted(traces: Sequence[Trace], n: int, slowest: float) -> Braking:
    """Return the model with the shortest ways that bounds all traces; ``n`` joints.

    Raises
    ------
    SetupError
        There is none.
    """
    if not traces:
        raise SetupError(f"no model of a stop: no joint was faster than {slowest:g} rad/s when told to stop")
    fastest = np.full(n, slowest)
    for trace in traces:
        fastest[trace.joint] = max(fastest[trace.joint], trace.top)
    longest = min(max(float(trace.x[-1]) for trace in traces), LONGEST_S)
    models = (_with_delay(traces, fastest, delay) for delay in np.linspace(0.0, longest, _DELAYS + 1))
    possible = [model for model in models if model is not None]
    if not possible:
        raise SetupError(
            f"no model of a stop: what the samples show takes longer than {LONGEST_S:g} s, or does not brake"
        )
    return min(possible, key=lambda model: _ways(model, traces))


def _ways(model: Braking, traces: Sequence[Trace]) -> float:
    """Sum of the ways by a model, each over its speed."""
    brakes = [
        max(model.braking_time_s, trace.top / float(model.deceleration[trace.joint])) for trace in traces
    ]
    return len(traces) * model.delay_s + 0.5 * sum(brakes)


def _with_delay(traces: Sequence[Trace], fastest: FloatArray, delay: float) -> Braking | None:
    """The model with this delay [s], or ``None``."""
    brakes = [trace.brakes_for(delay) for trace in traces]
    if not max(brakes) <= LONGEST_S - delay:
        return None
    slow = [b for b, trace in zip(brakes, traces, strict=True) if trace.top <= _SLOW * fastest[trace.joint]]
    # where nothing slow was seen, slower joints are taken to need as long as the fast ones
    shortest = max(slow or brakes) / _ROUNDED
    deceleration = fastest / max(shortest, 1e-6)
    for b, trace in zip(brakes, traces, strict=True):
        if b > shortest:
            deceleration[trace.joint] = min(deceleration[trace.joint], _ROUNDED * trace.top / b)
    return Braking(float(delay), shortest, deceleration, fastest)


def _held(each: StopsOf, measured: Measured, model: Braking, standstill: float) -> Held:
    """A stop against a model that was fitted without it."""
    found = [(trace.excess(model), trace.joint) for trace in traces_of(each, measured, standstill)]
    excess, joint = max(found, default=(-math.inf, 0))
    speed = np.array(measured.speed)
    return Held(
        each, measured, excess, joint, float(model.time(speed).max()), tuple(map(float, model.way(speed)))
    )


def _drift(
    found: AllStops,
    known: Sequence[tuple[StopsOf, Measured]],
    margin: float,
    model_of: Callable[[Sequence[tuple[StopsOf, Measured]]], Braking],
) -> Iterator[Drift]:
    """Yield the joints that get farther by a recording than by the first one in which they are fast."""
    first: dict[int, tuple[Braking, float]] = {}
    for each in found.recordings:
        own = [pair for pair in known if pair[0] is each]
        try:
            model = model_of(own)
        except SetupError:
            continue  # a recording that tells nothing about braking cannot drift
        speeds = np.max([stop.speed for _, stop in own], axis=0)
        for joint, name in enumerate(each.motion.joints):
            if speeds[joint] < SLOWEST * found.settings.standstill:
                continue
            before, seen = first.setdefault(joint, (model, float(speeds[joint])))
            speed = np.full(len(speeds), min(seen, float(speeds[joint])))
            was, now = float(before.way(speed)[joint]), float(model.way(speed)[joint])
            if now > (1.0 + margin) * was:
                yield Drift(each.motion.path.name, name, float(speed[joint]), was, now)
