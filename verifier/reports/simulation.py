"""What a simulation came to: numbers, JSON and text."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption
from verifier.command import Cause, Command, State
from verifier.reports.assumptions import assumption_dicts, assumption_lines
from verifier.reports.text import DISCLAIMER
from verifier.shown import LONGEST_VALUE, shown
from verifier.simulated_sensors import SensorSettings
from verifier.verdict import STATUS_OF_REASON, Reason, Status

NEAR_M = 0.05
"""A run in which nobody comes so near to a moving link shows nothing about contacts [m]."""
BINS_M = np.array([0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, np.inf])
"""Upper ends of the bins of distances to moving links [m]; the first one holds contacts."""
_SCRIPTED = (
    "people are scripted: they slide, turn and swing stretched arms, walk through fixtures, and are always "
    "reported as people; what real ones do may be worse"
)


class SimulatedContact(NamedTuple):
    """An unbroken time in which a person overlaps a moving link.

    ``t`` [s]: its begin, with the part and link of then; ``depth_m``: deepest overlap; ``speed_m_s``: of the
    fastest point of the link.
    """

    t: float
    person: str
    part: str
    link: str
    depth_m: float
    speed_m_s: float


class Approach(NamedTuple):
    """How near somebody came to a moving link, and when [s]."""

    t: float
    distance_m: float
    link: str
    person: str
    part: str


@dataclass(slots=True)
class Tally:
    """What the supervisor did, counted while it runs; nothing grows with time.

    Attributes
    ----------
    adopted_at, last_at, contradicted_at:
        When the first plan began that was adopted, of when the last command is, and when the first
        contradiction was seen [s]; NaN: never.
    path_s:
        Path time gone through [s].
    given_up:
        Motions that could not be gone on with after a stop, though nobody was in the way.
    stops, standstills, recoveries:
        How often a failsafe manoeuvre began, how many came to rest, how often the robot set out again.
    lost, own_stops:
        Commands that did not reach the robot, and how often it stopped by itself then.
    ended:
        When and why the run ended before its time; empty: it did not.
    """

    cycles: int = 0
    states: Counter[State] = field(default_factory=Counter)
    causes: Counter[Cause] = field(default_factory=Counter)
    reasons: Counter[Reason] = field(default_factory=Counter)
    stops: int = 0
    standstills: int = 0
    recoveries: int = 0
    adopted_at: float = math.nan
    last_at: float = math.nan
    contradicted_at: float = math.nan
    path_s: float = 0.0
    given_up: int = 0
    lost: int = 0
    own_stops: int = 0
    ended: str = ""
    state: State = State.STOPPED

    def note(self, t: float, command: Command) -> None:
        """Count the step at ``t`` [s]."""
        self.cycles += 1
        self.last_at = command.t
        self.states[command.outcome] += 1
        self.causes[command.cause] += 1
        self.reasons[command.verdict.reason] += 1
        began = command.outcome is not self.state
        stopped = began and command.outcome is State.STOPPED
        at_once = stopped and self.state is not State.FAILSAFE and not _verified(command)
        self.stops += at_once or (began and command.outcome is State.FAILSAFE)
        self.standstills += at_once or (stopped and self.state is State.FAILSAFE)
        self.recoveries += began and command.outcome is State.RECOVERING
        self.state = command.outcome
        if math.isnan(self.adopted_at) and command.cause is Cause.ADOPTED:
            self.adopted_at = command.deadline
        if math.isnan(self.contradicted_at) and command.verdict.status is Status.CONTRADICTED:
            self.contradicted_at = t

    def count(self, status: Status) -> int:
        """Return how many steps had a verdict of this status."""
        return sum(n for reason, n in self.reasons.items() if STATUS_OF_REASON[reason] is status)


@dataclass(frozen=True, slots=True)
class SimulationReport:
    """The result of a simulation; docs/simulate.schema.json describes ``to_dict()``.

    Attributes
    ----------
    assumptions:
        Every number that the result rests on.
    floor:
        Height at which people stand [m], and whether the cell declares it.
    histogram:
        ``(len(BINS_M),)`` cycles in which a link moved, by the nearest approach in them.
    moving:
        Cycles in which a link moved.
    limits_exceeded, largest_share:
        Per quantity, how often a command exceeded the limit, and the largest share of the limit.
    motions:
        Trajectories that were proposed.
    reports:
        Looks of the sensors, and how many of the reports got lost.
    lost:
        Share of the commands that were not to reach the robot.
    """

    robot: str
    profile: str
    models: tuple[str, ...]
    waived: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    not_checked_criteria: tuple[str, ...]
    cycle_s: float
    seed: int
    people: int
    faster: float
    floor: tuple[float, bool]
    tally: Tally
    contacts: tuple[SimulatedContact, ...]
    declared_touches: tuple[int, float]
    nearest: Approach | None
    histogram: NDArray[np.int64]
    moving: int
    limits_exceeded: dict[str, int]
    largest_share: dict[str, float]
    motions: int
    reports: tuple[int, int]
    sensors: SensorSettings
    lost: float
    real_time_factor: float

    @property
    def time_lost_s(self) -> float:
        """Time since the first plan was adopted, minus the path time gone through [s]; NaN: none was."""
        return self.tally.last_at - self.tally.adopted_at - self.tally.path_s

    @property
    def vacuous(self) -> bool:
        """Whether nobody came so near to a moving link that the run shows anything about contacts."""
        return self.nearest is None or not self.nearest.distance_m <= NEAR_M

    @property
    def shows_nothing(self) -> bool:
        """Whether the run is vacuous, and nobody was ever why the robot was held back either."""
        held_back = any(self.tally.reasons[reason] for reason in (Reason.REACHABLE, Reason.UNRESOLVED))
        return self.vacuous and not held_back

    @property
    def exit_status(self) -> int:
        """Return the exit status of the command.

        1: contact, limit exceeded, contradicted, never moved, ended early, or it shows nothing about people;
        3: under waivers; else 0.
        """
        wrong = bool(self.contacts) or any(self.limits_exceeded.values()) or bool(self.tally.ended)
        idle = math.isnan(self.tally.adopted_at) or self.shows_nothing
        if wrong or idle or self.tally.count(Status.CONTRADICTED):
            return 1
        return 3 if self.waived else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON; NaN becomes ``None``."""
        tally, sensors = self.tally, self.sensors
        return {
            "robot": self.robot,
            "profile": self.profile,
            "models": list(self.models),
            "waived": list(self.waived),
            "assumptions": assumption_dicts(self.assumptions),
            "criteria_not_checked": list(self.not_checked_criteria),
            "disclaimer": DISCLAIMER,
            "seed": self.seed,
            "people": self.people,
            "faster": self.faster,
            "floor_z_m": self.floor[0],
            "cycles": tally.cycles,
            "cycle_s": self.cycle_s,
            **{status.name.lower(): tally.count(status) for status in Status},
            "reasons": {reason.name.lower(): n for reason, n in sorted(tally.reasons.items())},
            "causes": {cause.name.lower(): n for cause, n in sorted(tally.causes.items())},
            "states": {state.name.lower(): tally.states[state] / tally.cycles for state in State},
            "contacts_while_moving": len(self.contacts),
            "contacts": [contact._asdict() for contact in self.contacts],
            "declared_touches": self.declared_touches[0],
            "fastest_declared_m_s": _or_none(self.declared_touches[1]),
            "limits_exceeded": self.limits_exceeded,
            "largest_share": self.largest_share,
            "vacuous": self.vacuous,
            "nearest": None if self.nearest is None else self.nearest._asdict(),
            "cycles_moving": self.moving,
            "approach": [
                {"up_to_m": float(edge) if math.isfinite(edge) else None, "cycles": int(n)}
                for edge, n in zip(BINS_M, self.histogram, strict=True)
            ],
            "first_contradiction_s": _or_none(tally.contradicted_at),
            "time_lost_s": _or_none(self.time_lost_s),
            "path_s": tally.path_s,
            "stops": tally.stops,
            "standstills": tally.standstills,
            "recoveries": tally.recoveries,
            "motions": self.motions,
            "given_up": tally.given_up,
            "commands_lost": tally.lost,
            "own_stops": tally.own_stops,
            "ended": tally.ended,
            "sensors": {
                "rate_hz": sensors.rate_hz,
                "latency_s": [sensors.latency_s, sensors.latency_s + sensors.jitter_s],
                "position_error_m": sensors.position_error_m,
                "stamp_error_s": sensors.stamp_error_s,
                "reports": self.reports[0],
                "lost": self.reports[1],
            },
            "real_time_factor": self.real_time_factor,
        }

    def lines(self) -> list[str]:
        """Return the report as text, one line each, most important first."""
        tally = self.tally
        waived = "; ".join(shown(text, LONGEST_VALUE) for text in self.waived) if self.waived else "nothing"
        return [
            f"stop: path-consistent (this software's) · profile: {self.profile} · "
            f"models: {', '.join(self.models)} · waived: {waived}",
            self._scene_line(),
            *([f"the run ended early, {self.tally.ended}"] if self.tally.ended else []),
            *self._contact_lines(),
            self._limits_line(),
            *self._approach_lines(),
            self._time_line(),
            f"stops begun {tally.stops}, to standstill {tally.standstills} · recoveries {tally.recoveries} · "
            + " · ".join(
                f"{state.name.lower()} {100.0 * tally.states[state] / tally.cycles:.1f} %" for state in State
            ),
            "why the steps went as they did: "
            + ", ".join(
                f"{cause.name.lower().replace('_', ' ')} {n}" for cause, n in tally.causes.most_common()
            ),
            "verdicts on the plans that were made, cycle by cycle:",
            *(
                f"  {STATUS_OF_REASON[reason].name.lower().replace('_', ' '):<13}{n:>9}  {reason.text}"
                for reason, n in tally.reasons.most_common()
            ),
            *self._contradiction_lines(),
            *self._given_up_lines(),
            *self._lost_lines(),
            self._sensor_line(),
            f"not checked: {', '.join(self.not_checked_criteria)}",
            *assumption_lines(self.assumptions),
            f"note: {_SCRIPTED}",
            *self._floor_lines(),
            f"real-time factor {self.real_time_factor:.1f}",
            DISCLAIMER,
        ]

    def _scene_line(self) -> str:
        who = {0: "nobody", 1: "1 person"}.get(self.people, f"{self.people} people")
        pace = ""
        if self.people and self.faster > 1.0:
            pace = f", {self.faster:g} times as fast as the profile allows"
        elif self.people and self.faster < 1.0:
            pace = f", at {self.faster:g} of the profile's speeds"
        return (
            f"simulated: {self.robot} beside {who}{pace}, {_many(self.tally.cycles, 'cycle')} of "
            f"{1e3 * self.cycle_s:g} ms, {_many(self.motions, 'motion')}, seed {self.seed}"
        )

    def _contact_lines(self) -> list[str]:
        found = [
            f"  {c.person} ({c.part}) and {c.link} at {c.t:.3f} s, {1e3 * c.depth_m:.1f} mm deep, "
            f"the link at up to {c.speed_m_s:.3f} m/s"
            for c in self.contacts[:6]
        ]
        if len(self.contacts) > len(found):
            found.append(f"  … and {len(self.contacts) - len(found)} more")
        looks, speed = self.declared_touches
        if looks:
            found.append(
                f"  not counted: at {looks} looks a pair touched that the cell lets touch, the link at up to "
                f"{speed:.3f} m/s"
            )
        return [f"contacts while moving, in the model: {len(self.contacts)}", *found]

    def _limits_line(self) -> str:
        largest = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in self.largest_share.items())
        wrong = ", ".join(f"{name} {n} times" for name, n in self.limits_exceeded.items() if n)
        return f"limits exceeded: {wrong or 'none'} (largest share of each: {largest})"

    def _approach_lines(self) -> list[str]:
        if self.people == 0:
            return ["nobody was there: this run shows nothing about people, and does not count as verified"]
        lines, advice = [], "; take more --seconds or another --seed"
        if self.tally.count(Status.CONTRADICTED):
            advice = ": the robot rests since an assumption was contradicted"
        if self.nearest is not None:
            near = self.nearest
            lines.append(
                f"nearest to a moving link: {1e3 * near.distance_m:.1f} mm, {near.person} ({near.part}) and "
                f"{near.link} at {near.t:.3f} s"
            )
        if self.shows_nothing:
            lines.append(
                "this run shows nothing about people, and does not count as verified: nobody came within "
                f"{1e3 * NEAR_M:.0f} mm of a moving link or near enough to hold the robot back{advice}"
            )
        elif self.vacuous:
            lines.append(
                f"this run is vacuous: nobody came within {1e3 * NEAR_M:.0f} mm of a moving link, so that no "
                f"contact was found shows little{advice}; cautious models never let anybody so near"
            )
        lines.append(f"nearest approach in each of the {self.moving} cycles in which a link moved:")
        for i, n in enumerate(self.histogram.tolist()):
            if i == 0:
                name = "contact"
            elif math.isfinite(BINS_M[i]):
                name = f"up to {1e3 * BINS_M[i]:.0f} mm"
            else:
                name = f"more than {1e3 * BINS_M[i - 1]:.0f} mm"
            share = 100.0 * n / max(1, self.moving)
            lines.append(f"  {name:<18}{n:>9}  {share:5.1f} %")
        return lines

    def _time_line(self) -> str:
        if math.isnan(self.time_lost_s):
            return "no plan was ever adopted: the robot stood still all the time"
        elapsed = self.tally.last_at - self.tally.adopted_at
        share = 100.0 * self.time_lost_s / elapsed if elapsed > 0.0 else 0.0
        return f"time lost: {self.time_lost_s:.2f} s of {elapsed:.2f} s since the first plan, {share:.0f} %"

    def _contradiction_lines(self) -> list[str]:
        seen = self.tally.contradicted_at
        if math.isnan(seen):
            return []
        first = self.contacts[0].t if self.contacts else math.inf
        when = "before the first contact" if seen <= first else f"{seen - first:.3f} s after the first one"
        return [
            f"an assumption was first contradicted at {seen:.3f} s"
            + (f", {when}" if self.contacts else ", and there was no contact")
        ]

    def _floor_lines(self) -> list[str]:
        height, declared = self.floor
        if declared or self.people == 0:
            return []
        return [f"note: people stand at z = {height:g} m (default): the cell declares no workspace.floor_z_m"]

    def _given_up_lines(self) -> list[str]:
        n = self.tally.given_up
        if not n:
            return []
        return [
            f"note: {n} of the motions could not be gone on with after a stop, though nobody was in the way: "
            "they were given up for others"
        ]

    def _lost_lines(self) -> list[str]:
        if not self.lost:
            return []
        tally = self.tally
        then = (
            f"the robot stopped by itself after {tally.own_stops} of them"
            if tally.own_stops
            else ("the robot went on with the plan that it held")
        )
        return [f"commands that did not reach the robot: {tally.lost}; {then}"]

    def _sensor_line(self) -> str:
        sensors = self.sensors
        latest = sensors.latency_s + sensors.jitter_s
        return (
            f"reports: {self.reports[0]} at {sensors.rate_hz:g} Hz, {self.reports[1]} lost, "
            f"{1e3 * sensors.latency_s:.0f} to {1e3 * latest:.0f} ms late, points up to "
            f"{1e3 * sensors.position_error_m:g} mm wrong"
        )


def _verified(command: Command) -> bool:
    return command.verdict.status is Status.VERIFIED


def _many(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
