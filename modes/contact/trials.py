"""Trials on the twin: compliance, false alarms, delays of detection, and sensors that break."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from modes.contact.admittance import CyclicTask
from modes.contact.course import Loop, Spoil, Touches, believe
from modes.contact.detection import BodyDetector, ToolDetector
from modes.contact.experiments import BEGIN, FOREARM, TIP, settings, task
from modes.contact.filters import VARIANTS, Variant
from modes.contact.machine import ContactMachine, Decision, Measured, State
from modes.contact.touches import Blow, Push, Spot
from modes.contact.twin import Body, Twin
from modes.contact.wrench import SensorFault, ToolLoad
from modes.tool_frame import ToolFrame
from robots.model import RobotModel

Array = NDArray[np.float64]
Progress = Callable[[float], None]

PEAKS_N = tuple(range(10, 101, 10))
SPOTS = {"end effector": TIP, "link 4": FOREARM}
_NEXT_S, _WATCHED_S, _BLOW_S = 2.4, 0.3, 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """What a trial is made with.

    Attributes
    ----------
    robot, body:
        The arm, and what it is made of.
    load:
        What was identified of its tool.
    """

    robot: RobotModel
    body: Body
    load: ToolLoad

    def loop(
        self,
        seed: int,
        task_: CyclicTask | None = None,
        filters: Variant = "corrected",
        spoil: Spoil = believe,
    ) -> Loop:
        """Return an arm that rests where its task begins."""
        machine = ContactMachine(
            self.robot, task(self.robot, self.body) if task_ is None else task_,
            settings(self.body, self.load, filters),
        )  # fmt: skip
        return Loop(Twin(self.robot, BEGIN, self.body, seed=seed), machine, spoil)


def static_compliance(arm: Arm, force_N: float = 15.0) -> float:
    """Return how far the tool yields at rest per newton [mm/N], the mean along three axes.

    The force is that which acts on the tool; 8 s are nineteen time constants.
    """
    found = []
    for direction in np.eye(3):
        push = Push(TIP, 1.0, 9.5, force_N, direction=tuple(direction.tolist()))
        here = ToolFrame(arm.robot, np.array(arm.body.flange_m)).pose(BEGIN)[1]
        loop = arm.loop(0, CyclicTask(np.array([here, here]), 3.0))
        course = loop.run(9.0, (push,))
        begin = next(c.t for c in course.changes() if c.state is State.COLLABORATION)
        places = np.array([d.place for d in course.decisions])
        first = places[course.t.index(begin)]
        found.append(1e3 * float((places[-1] - first) @ direction) / force_N)
    return float(np.mean(found))


class Alarms(NamedTuple):
    """False alarms while nobody touches the arm.

    Attributes
    ----------
    hours:
        Of simulated operation, in the task.
    left_task:
        How often the machine left its task.
    detected:
        Variant of the filters -> how often one of its detectors came to see a contact that is none.
    largest_share:
        Variant -> the largest share of a threshold that a filtered signal reached.
    """

    hours: float
    left_task: int
    detected: dict[Variant, int]
    largest_share: dict[Variant, float]

    @property
    def per_hour(self) -> float:
        """How often per hour the machine left its task; inf where it never began."""
        return self.left_task / self.hours if self.hours > 0.0 else math.inf


class _Listener:
    """Detectors of one variant, beside the machine, on the same signals."""

    def __init__(self, variant: Variant) -> None:
        self._body, self._tool = BodyDetector(variant=variant), ToolDetector(variant=variant)
        self.found, self.share, self._before = 0, 0.0, False

    def hear(self, currents: Array, dq: Array, force: Array) -> None:
        """Take what the machine got in a step of its task."""
        body, tool = self._body.step(currents, dq), self._tool.step(force)
        thresholds = self._tool.thresholds
        self.share = max(
            self.share, float((np.abs(body.high) / body.high_threshold).max()),
            tool.high_N / thresholds.high_N, tool.low_N / thresholds.low_N,
        )  # fmt: skip
        now = body.collision or tool.collision or tool.lasts
        self.found += now and not self._before
        self._before = now


def false_alarms(arm: Arm, hours: float, progress: Progress, seed: int = 0) -> Alarms:
    """Let the arm follow tasks that are drawn, a new one every five minutes, while nobody is near."""
    random = np.random.default_rng(seed)
    rounds = max(1, round(hours * 12))
    period = settings(arm.body, arm.load).period_s
    steps = round(3600.0 * hours / rounds / period)
    detected, shares = dict.fromkeys(VARIANTS, 0), dict.fromkeys(VARIANTS, 0.0)
    left = watched = 0
    here = ToolFrame(arm.robot, np.array(arm.body.flange_m)).pose(BEGIN)[1]
    for k in range(rounds):
        corners = here + random.uniform((-0.1, -0.2, -0.1), (0.05, 0.2, 0.1), (4, 3))
        loop = arm.loop(seed + k, CyclicTask(corners, random.uniform(2.5, 4.0)))
        listeners = {name: _Listener(name) for name in VARIANTS}
        before = State.CHECK
        while watched < (k + 1) * steps and loop.twin.t < 2.0 * steps * period:
            measured, dq = loop.measured, loop.machine.commanded
            decision = loop.step()
            if before is State.TASK:
                watched += 1
                left += decision.state is not State.TASK
                for listener in listeners.values():
                    if decision.state is not State.FAULT:
                        listener.hear(measured.currents, dq, decision.force)
            before = decision.state
            if before is State.FAULT:
                loop.machine.reset()
        for name, each in listeners.items():
            detected[name] += each.found
            shares[name] = max(shares[name], each.share)
        progress((k + 1) / rounds)
    return Alarms(watched * period / 3600.0, left, detected, shares)


class Delays(NamedTuple):
    """How long blows of one kind took to be detected.

    Attributes
    ----------
    spot, peak_N:
        Where, and how hard.
    blows:
        How many.
    delays_s:
        From the begin of each that was detected within 0.3 s to the control step that tells it [s].
    """

    spot: str
    peak_N: float
    blows: int
    delays_s: Array


def delays(arm: Arm, blows: int, progress: Progress, seed: int = 0) -> list[Delays]:
    """Hit the arm during its task, level and from a side that is drawn, ``blows`` times for each kind."""
    random = np.random.default_rng(seed)
    found = []
    for i, (name, spot) in enumerate(SPOTS.items()):
        for j, peak in enumerate(PEAKS_N):
            found.append(_delays_of(arm, (name, spot), float(peak), blows, random))
            progress((i * len(PEAKS_N) + j + 1) / (len(SPOTS) * len(PEAKS_N)))
    return found


def _delays_of(
    arm: Arm, where: tuple[str, Spot], peak: float, blows: int, random: np.random.Generator
) -> Delays:
    begins = 1.0 + _NEXT_S * np.arange(blows) + random.uniform(0.0, 0.5, blows)
    angles = random.uniform(0.0, 2.0 * np.pi, blows)
    touches = [
        Blow(where[1], float(t), peak, _BLOW_S, (float(np.cos(a)), float(np.sin(a)), 0.0))
        for t, a in zip(begins, angles, strict=True)
    ]
    told = _told(arm.loop(int(random.integers(2**31))), float(begins[-1]) + 1.0, touches)
    after = [min((t - begin for t in told if t > begin), default=np.inf) for begin in begins]
    return Delays(where[0], peak, blows, np.array([each for each in after if each <= _WATCHED_S]))


def _told(loop: Loop, end_s: float, touches: Touches) -> list[float]:
    """Return when the arm was stopped because of a contact; where the sensor was at its end, it is reset."""
    found, before = [], State.CHECK
    while loop.twin.t < end_s:
        t = loop.measured.t
        decision = loop.step(touches)
        if decision.state is not before and decision.state in (State.COLLISION, State.FAULT):
            found.append(t)
        before = decision.state
        if decision.state is State.FAULT:
            loop.machine.reset()
    return found


@dataclass(slots=True)
class _Broken:
    """A sensor that breaks at ``at_s``."""

    how: Spoil
    at_s: float

    def __call__(self, measured: Measured) -> Measured:
        """Return what arrives."""
        return self.how(measured) if measured.t >= self.at_s else measured


class _Frozen:
    """Gives the first sample that it sees for all later ones."""

    def __init__(self) -> None:
        self._sample: Array | None = None

    def __call__(self, measured: Measured) -> Measured:
        """Return what arrives."""
        if self._sample is None:
            self._sample = measured.wrenches[0].copy()
        return replace(measured, wrenches=np.tile(self._sample, (len(measured.stamps), 1)))


def _nan(measured: Measured) -> Measured:
    spoiled = measured.wrenches.copy()
    spoiled[len(spoiled) // 2, 2] = np.nan
    return replace(measured, wrenches=spoiled)


def _dropped(measured: Measured) -> Measured:
    return replace(measured, stamps=measured.stamps[:0], wrenches=measured.wrenches[:0])


def _swapped(first: int, second: int) -> Spoil:
    order = np.arange(6)
    order[[first, second, 3 + first, 3 + second]] = second, first, 3 + second, 3 + first

    def spoil(measured: Measured) -> Measured:
        return replace(measured, wrenches=measured.wrenches[:, order])

    return spoil


def _saturated(range_N: float) -> Spoil:
    def spoil(measured: Measured) -> Measured:
        spoiled = measured.wrenches.copy()
        spoiled[:, 2] = range_N
        return replace(measured, wrenches=spoiled)

    return spoil


class Fault(NamedTuple):
    """A way in which a sensor breaks.

    Attributes
    ----------
    name:
        What breaks.
    at_s:
        When [s]; 0: before the arm moves.
    spoil:
        What becomes of measurements from then on.
    expected:
        The reason that the machine should give.
    """

    name: str
    at_s: float
    spoil: Spoil
    expected: SensorFault


def faults(body: Body) -> tuple[Fault, ...]:
    """Return the ways in which the sensor breaks; each has its own memory."""
    at = 4.0
    return (
        Fault("saturated", at, _Broken(_saturated(body.range_N), at), SensorFault.SATURATED),
        Fault("dropped samples", at, _Broken(_dropped, at), SensorFault.DROPPED),
        Fault("not a number", at, _Broken(_nan, at), SensorFault.NOT_A_NUMBER),
        Fault("frozen", at, _Broken(_Frozen(), at), SensorFault.FROZEN),
        *(
            Fault(f"swapped axes {'xyz'[i]} and {'xyz'[j]}", 0.0, _swapped(i, j), SensorFault.WEIGHT)
            for i, j in ((0, 1), (0, 2), (1, 2))
        ),
    )


class Broken(NamedTuple):
    """What became of an arm whose sensor broke.

    Attributes
    ----------
    fault, expected, reason:
        What broke; the reason that was expected, and the one that was given (empty: none).
    told_s, rests_s:
        From the fault until it was told, and until the arm rests for good [s]; inf: never.
    moved:
        Whether the task had begun.
    """

    fault: str
    expected: str
    reason: str
    told_s: float
    rests_s: float
    moved: bool

    @property
    def as_expected(self) -> bool:
        """Whether the arm was stopped for the reason that was expected, within half a second."""
        return self.reason == self.expected and max(self.told_s, self.rests_s) < 0.5


class Drive(Protocol):
    """An arm whose mode is in the loop, with a supervisor in between or without."""

    twin: Twin
    spoil: Spoil

    def step(self, touches: Touches = ()) -> Decision:
        """Do a control step."""
        ...


_AFTER_S, _RESTS_RAD = 1.0, 1e-4


def break_sensor(fault: Fault, drive: Drive) -> Broken:
    """Let the sensor of an arm break while it follows its task."""
    drive.spoil = fault.spoil
    told, reason, moved = math.inf, "", False
    places, period = [], 0.0
    while drive.twin.t < fault.at_s + _AFTER_S:
        begin = drive.twin.t
        decision = drive.step()
        period = drive.twin.t - begin
        places.append(drive.twin.q)
        moved = moved or decision.state is State.TASK
        if decision.state is State.FAULT and not math.isfinite(told):
            told, reason = drive.twin.t - period - fault.at_s, decision.reason.value
    path = np.array(places)
    away = np.abs(path - path[-1]).max(axis=1) > _RESTS_RAD
    rests = (int(np.flatnonzero(away)[-1]) + 2) * period - fault.at_s if away.any() else 0.0
    return Broken(fault.name, fault.expected.value, reason, told, rests, moved)
