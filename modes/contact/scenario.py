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
CONTACT: dict[str, Any] = {
    "workspace": {"floor_z_m": -0.8},
    "criteria": {
        "accept_unverified": True,
        "gaps_by_design": [list(pair) for pair in combinations(_MOVING, 2)],
        "contact": [
            {"links": list(HELD_LINKS), "parts": list(HELD_PARTS), "person_speed": "neglected"}
        ],
    },
}  # fmt: skip
"""Power and force limiting for a hand that holds the tool. This arm's capsules are a guess, and close its own
gaps."""


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
    _cell, robot = cell_of(contact=False)
    arm = Arm(robot, body, identified(robot, body))
    compliance = static_compliance(arm)
    course = arm.loop(0).run(END_S, touches())
    progress(0.05)
    watched, tracked = _under_the_verifier(arm)
    progress(0.1)
    broken = tuple(_broken(arm, number) for number in range(len(faults(body))))
    progress(0.15)
    guided = tuple(_guided(arm, setting) for setting in _SETTINGS)
    progress(0.25)
    hits = tuple(delays(arm, size.blows, lambda share: progress(0.25 + 0.25 * share)))
    alarms = false_alarms(arm, size.hours, lambda share: progress(0.5 + 0.5 * share))
    return ContactReport(
        compliance_mm_N=compliance,
        alarms=alarms,
        experiments=_done(course),
        watched=_done(watched),
        tracked=tracked,
        hits=hits,
        broken=broken,
        guided=guided,
        declared=_declared(),
        load=arm.load,
        body=body,
        course=course,
    )


def _declared() -> Declared:
    """Return who may touch whom in the cell with contact, and how fast links may then be."""
    cell, robot = cell_of(contact=True)
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
def cell_of(*, contact: bool, latency_s: float = 0.03) -> tuple[Cell, RobotModel]:
    """Return the cell, with or without contact declared for who holds the tool, and its robot."""
    people = {**CELL["people"], "latency_s": latency_s}
    table = {**CELL, "people": people, **(CONTACT if contact else {})}
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


def _under_the_verifier(arm: Arm) -> tuple[Course, Tracked]:
    """Run the experiments with the supervisor in between; nobody is in sight of its camera."""
    cell, _robot = cell_of(contact=False)
    drive, course = Supervised(arm, cell, _twin(arm)), Course()
    script, off, slow = touches(), 0.0, 0.0
    while drive.twin.t < END_S:
        t = drive.measured.t
        course.note(t, drive.step(script))
        off, slow = _farther(drive, off, slow)
    return course, Tracked(off, slow)


def _farther(drive: Supervised, off: float, slow: float) -> tuple[float, float]:
    """Return the larger of the errors so far and of those now: of positions [rad], of speeds [rad/s]."""
    assert drive.command is not None
    q, dq = np.abs(drive.twin.q - drive.command.q), np.abs(drive.twin.dq - drive.command.dq)
    return max(off, float(q.max())), max(slow, float(dq.max()))


def _broken(arm: Arm, number: int) -> Broken:
    """Break the sensor in one of the ways, with the supervisor in between."""
    cell, _robot = cell_of(contact=False)
    return break_sensor(faults(arm.body)[number], Supervised(arm, cell, _twin(arm)))


@dataclass(frozen=True, slots=True)
class _Setting:
    """How the tool is guided: contact declared or not, and how late reports are."""

    contact: bool
    latency_s: float
    seen_after: int


_SETTINGS = (_Setting(True, 0.03, 2), _Setting(True, 0.05, 4), _Setting(False, 0.03, 2))
_GUIDED_END_S, _HELD_S = 22.0, 9.0


def _guided(arm: Arm, setting: _Setting) -> Guided:
    """Let somebody walk up and guide the tool."""
    cell, robot = cell_of(contact=setting.contact, latency_s=setting.latency_s)
    twin = _twin(arm)
    guest = Guest(twin, seen_after=setting.seen_after)
    drive, course = Supervised(arm, cell, twin, guest.reports), Course()
    probe, lacking = SafetyProbe.from_cell(cell, robot=robot), ""
    hand, outcomes, places = guest.hand, Counter[Outcome](), []
    off = slow = 0.0
    while twin.t < _GUIDED_END_S:
        t = drive.measured.t
        course.note(t, drive.step((hand,)))
        assert drive.command is not None
        off, slow = _farther(drive, off, slow)
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
        contact=setting.contact,
        latency_s=setting.latency_s,
        wanted_m=float(np.linalg.norm(hand.away_m)),
        led_m=float(np.linalg.norm(path[held][-1] - path[held][0])),
        stood=outcomes[Outcome.STOPPED] / count,
        on_stop=outcomes[Outcome.FAILSAFE] / count,
        lacking=lacking,
        states=" > ".join(change.state.value for change in course.changes(_HELD_S - 1.0)),
        tracked=Tracked(off, slow),
        t=t_of,
        place_m=path,
    )
