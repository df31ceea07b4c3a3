"""The mode beside a supervisor: an arm that is guided, hit, and left alone, all of it verified."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.contact.detection import TABLE_1
from modes.contact.machine import ContactSettings, Measured, State
from modes.contact.mode import ContactMode
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from tests.modes.contact.test_machine import BEGIN, SETTINGS, Arm, Push, T, soft
from verifier.cell import Cell
from verifier.command import Command
from verifier.command import State as Outcome
from verifier.proposal import JointVelocity, Stop
from verifier.setup import build_robot
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]
CELL = {
    "cycle_s": T,
    "robot": {
        "name": "ra605", "bare_flange": True, "accept_assumed": ["limits", "enclosure"],
        "tracking": {"position_error_rad": 0.001},
    },
    "people": {"latency_s": 0.05, "repeated_points": "measured"},
}  # fmt: skip


class Guided:
    """The arm of the machine's tests, moved by a supervisor instead of at once."""

    def __init__(self, *pushes: Push, settings: ContactSettings = SETTINGS, seed: int = 0) -> None:
        cell = Cell.from_table(CELL)
        robot = build_robot(cell)
        self.supervisor = Supervisor.from_cell(cell, BEGIN)
        self.arm = Arm(robot, settings, pushes, seed)
        self.measured: Measured | None = None
        self.mode = ContactMode(robot, self.arm.machine._task, settings, lambda: self.measured)
        self.arm.machine.step = self._take  # type: ignore[method-assign]  # the supervisor moves the arm
        self.refused = 0
        self.proposals: list[object] = []

    def _take(self, q: Array, measured: Measured) -> object:
        """Stand in the place of the machine: propose to the supervisor what the mode does."""
        self.measured = measured
        proposal = self.mode.propose(self.supervisor.view())
        self.proposals.append(proposal)
        if proposal is not None:
            self.refused += self.supervisor.propose(proposal) is not None
        self.command = self.supervisor.step(
            measured.t, [RawMeasurement(measured.t, measured.t, "world", True, ())]
        )
        decision = self.mode.decision
        assert decision is not None
        return decision._replace(dq=(self.command.q - q) / T)

    def run(self, end: float) -> list[tuple[float, State, Command]]:
        found = []
        while T * self.arm.k < end:
            t, decision = self.arm.step()
            assert self.supervisor.fault is None
            found.append((t, decision.state, self.command))
        return found


@pytest.mark.rarely("an arm that is guided, in every run: it follows its task before and after")
def test_the_task_is_followed_and_every_command_is_verified() -> None:
    guided = Guided()
    run = guided.run(6.0)
    assert guided.refused == 0
    states = {state for t, state, _c in run if t > 0.5}
    assert states == {State.TASK}
    assert {c.outcome for t, _s, c in run if t > 1.0} <= {Outcome.EXECUTING, Outcome.RECOVERING}
    places = np.array([guided.arm.frame.pose(c.q)[1] for _t, _s, c in run])
    assert np.ptp(places[:, 1]) > 0.05 and np.ptp(places[:, 2]) > 0.04


def test_a_guided_arm_goes_where_it_is_pushed_and_back() -> None:
    """15 N for 5 s: 50 mm within some millimetres, although each velocity joins after a verified stop."""
    guided = Guided(Push(2.0, 7.0, soft(15.0, 0.0, 0.0)))
    run = guided.run(12.5)
    begin = next(c.q for _t, s, c in run if s is State.COLLABORATION)
    last = next(c.q for t, s, c in run if t > 6.9)
    frame = guided.arm.frame
    away = frame.pose(last)[1] - frame.pose(begin)[1]
    assert away[0] == pytest.approx(0.05, abs=6e-3) and np.abs(away[1:]).max() < 6e-3
    assert [s for _t, s, _c in run][-1] is State.TASK
    assert {s for _t, s, _c in run} == {State.CHECK, State.TASK, State.COLLABORATION, State.RETURN}


def test_a_blow_brings_the_arm_to_rest_on_a_verified_stop() -> None:
    guided = Guided(Push(3.0, 4.0, soft(0.0, 40.0, 0.0, rise=1e-6)))
    run = guided.run(4.0)
    hit = next(t for t, s, _c in run if s is State.COLLISION)
    assert 3.0 < hit < 3.05
    rest = next(t for t, s, c in run if t > hit and not c.dq.any())
    assert rest - hit < 0.25
    assert all(not c.dq.any() for t, _s, c in run if t > rest)


def test_nothing_is_proposed_where_nothing_was_measured_and_the_arm_comes_to_rest() -> None:
    guided = Guided()
    guided.run(3.0)
    guided.measured = None
    assert guided.mode.propose(guided.supervisor.view()) is None
    for k in range(60):
        t = T * (guided.arm.k + 1 + k)
        command = guided.supervisor.step(t, [RawMeasurement(t, t, "world", True, ())])
    assert command.outcome is Outcome.STOPPED and not command.dq.any()


def test_where_it_waits_it_proposes_a_stop_and_elsewhere_a_velocity() -> None:
    guided = Guided(Push(1.0, 1.1, soft(0.0, 50.0, 0.0, rise=1e-6)))
    run = guided.run(2.5)
    assert len(run) == len(guided.proposals)
    for (_t, state, _command), proposal in zip(run, guided.proposals, strict=True):
        assert isinstance(proposal, Stop if state in (State.CHECK, State.COLLISION) else JointVelocity)
    assert {state for _t, state, _c in run} == {State.CHECK, State.TASK, State.COLLISION}
    assert guided.measured is not None
    proposal = guided.mode.propose(guided.supervisor.view())
    assert isinstance(proposal, Stop) and guided.mode.decision is not None
    assert guided.mode.decision.state is State.FAULT, "the same samples once more: a clock that stands"


def test_a_horizon_that_cannot_be_kept_is_refused() -> None:
    robot = build_robot(Cell.from_table(CELL))
    task = Guided().arm.machine._task
    for horizon in (0.001, 2.0, float("nan")):
        with pytest.raises(SetupError, match="horizon_s"):
            ContactMode(robot, task, SETTINGS, lambda: None, horizon)


def test_thresholds_count_with_the_speeds_that_the_supervisor_commanded() -> None:
    """(8) with backward differences of ``view.dq``, which is not what the mode had asked for."""
    guided = Guided()
    views, differs = [], 0.0
    for _k in range(200):
        views.append(guided.supervisor.view().dq.copy())
        wanted = guided.mode.machine.commanded
        differs = max(differs, float(np.abs(views[-1] - wanted).max()))
        guided.run(T * (guided.arm.k + 1) - 1e-9)
        body = guided.mode.decision.body if guided.mode.decision is not None else None
        if len(views) > 1 and body is not None:
            change = (views[-1] - views[-2]) / T
            np.testing.assert_allclose(body.high_threshold, TABLE_1.high(views[-1], change), rtol=1e-9)
    assert differs > 1e-3
