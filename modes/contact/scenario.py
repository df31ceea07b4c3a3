"""``stopproof scenario contact``: the paper's experiments on a simulated arm, also under the verifier.

The only file of the mode that uses the verifier beyond its protocol (docs/method.md, section 7).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.contact.course import Course, Spoil, Touches, believe
from modes.contact.experiments import (
    BEGIN,
    END_S,
    EXPERIMENTS,
    GRIP,
    identified,
    observed,
    settings,
    task,
    touches,
)
from modes.contact.guided import Guest
from modes.contact.machine import Decision, Measured
from modes.contact.mode import ContactMode
from modes.contact.report import ContactReport, Declared, Done, Guided, Tracked
from modes.contact.trials import Arm, Broken, break_sensor, delays, false_alarms, faults, static_compliance
from modes.contact.twin import Body, Twin
from occupancy.report import RawMeasurement
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.command import Cause, Command
from verifier.command import State as Outcome
from verifier.safety_state import SafetyProbe, look
from verifier.scenario import ScenarioReport
from verifier.setup import build_contact, build_profile, build_robot
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]
Progress = Callable[[float], None]
Reports = Callable[[float], Sequence[RawMeasurement]]

_MOVING = ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "tool:handle")
HELD_LINKS = ("link_4", "link_5", "link_6", "tool:handle")
"""A hand that holds the tool is within reach of these: with the tool alone declared the arm would stand."""
HELD_PARTS = ("l_hand", "l_forearm", "r_hand", "r_forearm")
CELL: dict[str, Any] = {
    "cycle_s": 0.012,
    "robot": {
        "name": "kr5_sixx", "tool": "handle.toml", "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.004, "velocity_error_rad_s": 0.02},
    },
    "people": {"latency_s": 0.03, "repeated_points": "measured"},
}  # fmt: skip


def contact_of(links: tuple[str, ...]) -> dict[str, Any]:
    """Return tables of a cell: power and force limiting for a hand that holds the tool, beside ``links``.

    This arm's capsules are a guess, and close its own gaps.
    """
    table = {"links": list(links), "parts": list(HELD_PARTS), "person_speed": "neglected"}
    gaps = [list(pair) for pair in combinations(_MOVING, 2)]
    return {
        "workspace": {"floor_z_m": -0.8},
        "criteria": {"accept_unverified": True, "gaps_by_design": gaps, "contact": [table]},
    }


@dataclass(frozen=True, slots=True)
class Size:
    """How much of everything is run.

    Attributes
    ----------
    hours:
        Of operation without anybody near.
    blows:
        Of each kind and strength.
    """

    hours: float = 1.0
    blows: int = 20


def scenario(progress: Progress) -> ScenarioReport:
    """Run everything; ``progress`` is told the share that is done."""
    return run_scenario(Size(), progress)


def run_scenario(size: Size, progress: Progress) -> ContactReport:
    """Run everything in that size."""
    body = Body()
    _cell, robot = cell_of()
    arm = Arm(robot, body, identified(robot, body))
    compliance = static_compliance(arm)
    course = arm.loop(0).run(END_S, touches())
    progress(0.02)
    watched, tracked = _under_the_verifier(arm, _within(progress, 0.02, 0.2))
    broken = tuple(_broken(arm, number) for number in range(len(faults(body))))
    progress(0.25)
    guided = []
    for number, setting in enumerate(_SETTINGS):
        guided.append(_guided(arm, setting))
        progress(0.25 + 0.2 * (number + 1) / len(_SETTINGS))
    hits = tuple(delays(arm, size.blows, _within(progress, 0.45, 0.6)))
    alarms = false_alarms(arm, size.hours, _within(progress, 0.6, 1.0))
    return ContactReport(
        compliance_mm_N=compliance,
        alarms=alarms,
        experiments=_done(course),
        watched=_done(watched),
        tracked=tracked,
        hits=hits,
        broken=broken,
        guided=tuple(guided),
        declared=_declared(),
        load=arm.load,
        body=body,
        course=course,
    )


def _within(progress: Progress, begin: float, end: float) -> Progress:
    """Return a report of progress for a part of the work."""
    return lambda share: progress(begin + (end - begin) * share)


def _declared() -> Declared:
    """Return who may touch whom in the cell with contact, and how fast links may then be."""
    cell, robot = cell_of(HELD_LINKS)
    stated = build_contact(cell, robot, build_profile(cell)).assumptions()
    limits = {
        each.name.rpartition(".")[2]: float(each.value)
        for each in stated
        if ".limit." in each.name and isinstance(each.value, float)
    }
    return Declared(tuple(cell.criteria.contact[0].links), limits)


def _done(course: Course) -> tuple[Done, ...]:
    return tuple(Done(each.name, each.expected, observed(each, course), each.figures) for each in EXPERIMENTS)


@cache
def cell_of(links: tuple[str, ...] = (), latency_s: float = 0.03) -> tuple[Cell, RobotModel]:
    """Return the cell and its robot; whoever holds the tool may touch ``links``."""
    people = {**CELL["people"], "latency_s": latency_s}
    table = {**CELL, "people": people, **(contact_of(links) if links else {})}
    cell = Cell.from_table(table, folder=Path(__file__).parent)
    return cell, build_robot(cell)


def nobody(t: float) -> Sequence[RawMeasurement]:
    """Return a report in which nobody is seen, every control step."""
    return [RawMeasurement(t, t, "world", True, ())]


class Supervised:
    """Twin and mode with the supervisor in between.

    Parameters
    ----------
    arm, cell:
        Which arm, and what it is verified against.
    twin:
        The simulated one.
    reports:
        What the camera says at an instant.
    """

    def __init__(self, arm: Arm, cell: Cell, twin: Twin, reports: Reports = nobody) -> None:
        self.twin, self._reports = twin, reports
        self.spoil: Spoil = believe
        self.supervisor = Supervisor.from_cell(cell, BEGIN)
        self.mode = ContactMode(
            arm.robot, task(arm.robot, arm.body), settings(arm.body, arm.load), self._read
        )
        self.measured: Measured = self.twin.go(BEGIN, np.zeros(6))
        self.command: Command | None = None
        self.refused = 0

    def _read(self) -> Measured:
        return self.spoil(self.measured)

    def step(self, touches: Touches = ()) -> Decision:
        """Let the mode propose, the supervisor verify, and the arm move for a control step."""
        proposal = self.mode.propose(self.supervisor.view())
        if proposal is not None and self.supervisor.propose(proposal) is not None:
            self.refused += 1
        t = self.measured.t
        self.command = command = self.supervisor.step(t, self._reports(t))
        if self.supervisor.fault is not None:
            raise self.supervisor.fault
        self.measured = self.twin.go(command.q, command.dq, touches)
        assert self.mode.decision is not None
        return self.mode.decision


def _twin(arm: Arm) -> Twin:
    return Twin(arm.robot, BEGIN, arm.body)


def _under_the_verifier(arm: Arm, progress: Progress) -> tuple[Course, Tracked]:
    """Run the experiments with the supervisor in between; nobody is in sight of its camera."""
    cell, _robot = cell_of()
    drive, course = Supervised(arm, cell, _twin(arm)), Course()
    script, errors = touches(), _Errors()
    while drive.twin.t < END_S:
        t = drive.measured.t
        course.note(t, drive.step(script))
        errors.note(drive)
        progress(min(1.0, drive.twin.t / END_S))
    return course, errors.tracked


class _Errors:
    """What the drives made of the commands, against what the cell declares."""

    def __init__(self) -> None:
        tracking = CELL["robot"]["tracking"]
        self._position, self._velocity = tracking["position_error_rad"], tracking["velocity_error_rad_s"]
        self._largest, self._beyond = np.zeros(2), 0

    def note(self, drive: Supervised) -> None:
        """Note a control step."""
        assert drive.command is not None
        off = np.abs(drive.twin.q - drive.command.q).max()
        slow = np.abs(drive.twin.dq - drive.command.dq).max()
        self._largest = np.maximum(self._largest, (off, slow))
        self._beyond += bool(off > self._position or slow > self._velocity)

    @property
    def tracked(self) -> Tracked:
        """What has been noted."""
        position, velocity = self._largest.tolist()
        return Tracked(position, velocity, self._beyond, self._position, self._velocity)


def _broken(arm: Arm, number: int) -> Broken:
    """Break the sensor in one of the ways, with the supervisor in between."""
    cell, _robot = cell_of()
    return break_sensor(faults(arm.body)[number], Supervised(arm, cell, _twin(arm)))


@dataclass(frozen=True, slots=True)
class _Setting:
    """How the tool is guided: which links may be touched, and how late reports are."""

    links: tuple[str, ...]
    latency_s: float
    seen_after: int


_SETTINGS = (
    _Setting(HELD_LINKS, 0.03, 2),
    _Setting(HELD_LINKS, 0.05, 4),
    _Setting(("tool:handle",), 0.03, 2),
    _Setting((), 0.03, 2),
)
_GUIDED_END_S, _HELD_S = 22.0, 9.0


def _guided(arm: Arm, setting: _Setting, end_s: float = _GUIDED_END_S) -> Guided:
    """Let somebody walk up and guide the tool; until ``end_s`` [s]."""
    cell, robot = cell_of(setting.links, setting.latency_s)
    twin = _twin(arm)
    guest = Guest(twin, seen_after=setting.seen_after)
    drive, course = Supervised(arm, cell, twin, guest.reports), Course()
    probe, lacking = SafetyProbe.from_cell(cell, robot=robot), ""
    hand, outcomes, places = guest.hand, Counter[Outcome](), []
    errors = _Errors()
    while twin.t < end_s:
        t = drive.measured.t
        course.note(t, drive.step((hand,)))
        assert drive.command is not None
        errors.note(drive)
        places.append(twin.where(GRIP))
        if not hand.begin_s <= t < hand.end_s:
            continue
        outcomes[drive.command.outcome] += 1
        if not lacking and t > _HELD_S and drive.command.cause is Cause.NOT_VERIFIED:
            refused = probe.state(look(drive.supervisor)).refused
            lacking = (
                "" if refused is None else f"{refused.link} from {refused.other}: {refused.lacking_m:.3f} m"
            )
    path, t_of = np.array(places), np.array(course.t)
    held = (t_of >= hand.begin_s) & (t_of < hand.end_s)
    count = outcomes.total()
    return Guided(
        links=setting.links,
        latency_s=setting.latency_s,
        wanted_m=float(np.linalg.norm(hand.away_m)),
        led_m=float(np.linalg.norm(path[held][-1] - path[held][0])),
        stood=outcomes[Outcome.STOPPED] / count,
        on_stop=outcomes[Outcome.FAILSAFE] / count,
        lacking=lacking,
        states=" > ".join(change.state.value for change in course.changes(_HELD_S - 1.0)),
        tracked=errors.tracked,
        t=t_of,
        place_m=path,
    )
