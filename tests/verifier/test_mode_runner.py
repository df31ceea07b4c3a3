"""Modes that raise, block or lie cost productivity only."""

from __future__ import annotations

import importlib.metadata
import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from failsafe.preparation import Objection
from failsafe.trajectory import IntendedTrajectory
from robots.errors import SetupError
from tests.verifier.supervised import AWAY, CYCLE, HOME, LIMITS, quintic, scripted
from verifier.command import State
from verifier.mode_runner import GROUP, ModeReport, ModeRunner, Proposals, load_mode, mode_names
from verifier.proposal import NewTrajectory, PathSpeed, Stop
from verifier.supervisor import Supervisor


class Told:
    """A mode that does what it is told, again and again."""

    name = "told"

    def __init__(self, *answers: object) -> None:
        self.answers, self.calls = answers, 0

    def propose(self, view):
        answer = self.answers[self.calls % len(self.answers)]
        self.calls += 1
        return answer(view) if callable(answer) else answer


def lie(view) -> NewTrajectory:
    """Passes on first sight, and is changed behind the back of the supervisor."""
    trajectory = quintic([view.q, np.zeros(2)], LIMITS, 0.3)
    threading.Timer(0.001, spoil, (trajectory,)).start()
    return NewTrajectory(trajectory)


def spoil(trajectory: IntendedTrajectory) -> None:
    trajectory.kernel_coefficients.setflags(write=True)
    trajectory.kernel_coefficients[:] = 1e9


class NoTrajectory:
    """Has what a trajectory has, and nothing of it fits together."""

    breaks, coefficients, end, n_joints, s_end = np.array([0.0, -1.0]), np.zeros((3, 2)), "never", 2, math.nan


def broken(view) -> None:
    raise ZeroDivisionError("planted")


WORTHLESS = [
    broken,
    lambda view: PathSpeed(math.nan),
    lambda view: PathSpeed("fast"),
    lambda view: NewTrajectory(NoTrajectory()),
    lambda view: NewTrajectory(None),
    lambda view: NewTrajectory(AWAY, math.nan),
    lambda view: NewTrajectory(quintic([HOME + 1.0, HOME], LIMITS)),
    lambda view: NewTrajectory(quintic([view.q, HOME], LIMITS, 5.0)),
    lambda view: "go",
    lambda view: view.q.fill(math.nan),
    lie,
    None,
]


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan, math.inf])
def test_unusable_periods_are_refused(period):
    with pytest.raises(SetupError, match="period"):
        ModeRunner(Proposals(scripted()), Told(None), period)


def moving() -> Supervisor:
    supervisor = scripted()
    assert supervisor.propose(NewTrajectory(AWAY)) is None
    for k in range(20):
        supervisor.step(k * CYCLE)
    return supervisor


@pytest.mark.parametrize("mode", [object(), SimpleNamespace(name="x"), SimpleNamespace(name=3, propose=len)])
def test_what_is_no_mode_is_refused(mode):
    with pytest.raises(SetupError, match="is no mode: give it a `name` and a method"):
        ModeRunner(Proposals(scripted()), mode, 0.01)


@pytest.mark.parametrize("answer", WORTHLESS)
def test_a_worthless_mode_changes_no_command(answer):
    supervisor, alone = moving(), moving()
    proposals, report, mode = Proposals(supervisor), ModeReport(), Told(answer)
    for k in range(20, 200):
        proposals.ask(mode, report)
        command, own = supervisor.step(k * CYCLE), alone.step(k * CYCLE)
        if command.outcome is State.STOPPED:
            break
        assert np.array_equal(command.q, own.q) and command.outcome is own.outcome
    assert report.calls == mode.calls > 50 and supervisor.fault is None


def test_what_a_mode_does_is_counted():
    supervisor = moving()
    proposals, report = Proposals(supervisor), ModeReport()
    for answer in (broken, PathSpeed(float("nan")), PathSpeed(0.5), Stop(), None, "go"):
        proposals.ask(Told(answer), report)
    assert (report.calls, report.handed_on, report.refused, report.faults) == (6, 2, 1, 2)
    assert report.refusal.objection is Objection.NOT_A_NUMBER
    assert "str is no proposal" in str(report.fault)


def test_a_mode_that_wants_to_know_is_told_of_refusals_at_once():
    proposals, report, told = Proposals(moving()), ModeReport(), []
    mode = Told(PathSpeed(math.nan), PathSpeed(0.5))
    mode.refused = told.append
    for _ in range(2):
        proposals.ask(mode, report)
    assert told == [report.refusal] and (report.refused, report.handed_on) == (1, 1)


def test_a_mode_that_fails_when_it_is_told_of_a_refusal_is_counted():
    proposals, report = Proposals(moving()), ModeReport()
    mode = Told(PathSpeed(math.nan))
    mode.refused = broken
    proposals.ask(mode, report)
    assert report.faults == 1 and isinstance(report.fault, ZeroDivisionError)


def test_a_mode_runs_beside_the_loop():
    supervisor = moving()
    runner = ModeRunner(Proposals(supervisor), Told(PathSpeed(0.25)), 0.001)
    runner.start()
    until = time.monotonic() + 30.0
    while runner.report.handed_on == 0 and time.monotonic() < until:
        time.sleep(0.001)
    for k in range(20, 60):
        supervisor.step(k * CYCLE)
    assert supervisor.view().sdot == 0.25
    assert runner.stop(30.0)


def test_a_mode_that_blocks_is_left_behind():
    supervisor, alone = moving(), moving()
    release = threading.Event()
    runner = ModeRunner(Proposals(supervisor), Told(lambda view: release.wait()), 0.001)
    other = ModeRunner(Proposals(supervisor), Told(None), 0.001)
    runner.start()
    other.start()
    for k in range(20, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, alone.step(k * CYCLE).q)
    assert not runner.stop(0.01)
    assert other.stop(30.0)
    release.set()
    assert runner.stop(30.0)


def test_many_worthless_modes_at_once_do_not_disturb_the_cycle():
    supervisor, alone = moving(), moving()
    proposals = Proposals(supervisor)
    runners = [ModeRunner(proposals, Told(answer), 0.0005) for answer in WORTHLESS]
    for runner in runners:
        runner.start()
    for k in range(20, 60):
        assert np.array_equal(supervisor.step(k * CYCLE).q, alone.step(k * CYCLE).q)
        time.sleep(0.002)
    ended = [runner.stop(30.0) for runner in runners]
    assert all(ended)
    assert supervisor.fault is None and all(runner.report.calls > 0 for runner in runners)


# Entry points


def planted(monkeypatch, **modes: object) -> None:
    class Entry:
        def __init__(self, made: object) -> None:
            self.made = made

        def load(self):
            return self.made

    class Entries(dict):
        names = property(set)

    def find(group: str, name: str | None = None):
        assert group == GROUP
        return Entries(modes) if name is None else [Entry(modes[name])] if name in modes else []

    monkeypatch.setattr("verifier.plug_ins.entry_points", find)


def test_modes_are_found_by_name(monkeypatch):
    planted(monkeypatch, told=lambda: Told(None), other=broken)
    assert mode_names() == ("other", "told")
    assert load_mode("told").name == "told"
    with pytest.raises(SetupError, match="known: other, told"):
        load_mode("third")
    with pytest.raises(SetupError, match="cannot be made: TypeError"):
        load_mode("other")


def test_what_has_no_proposals_is_no_mode(monkeypatch):
    planted(monkeypatch, empty=object)
    with pytest.raises(SetupError, match="no method propose"):
        load_mode("empty")


@pytest.mark.parametrize("name", [None, 3])
def test_what_has_no_name_is_no_mode(name, monkeypatch):
    nameless = type("Nameless", (), {"propose": lambda self, view: None} | ({"name": name} if name else {}))
    planted(monkeypatch, nameless=nameless)
    with pytest.raises(SetupError, match="has no name"):
        load_mode("nameless")


def test_the_real_entry_points_are_read():
    assert set(mode_names()) == set(importlib.metadata.entry_points(group=GROUP).names)
