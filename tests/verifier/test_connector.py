"""After a stop that left the path: back to where it was left, from rest to rest, and on along the path."""

from __future__ import annotations

import numpy as np
import pytest

from failsafe.plan import StopKind
from failsafe.preparation import Objection
from tests.verifier.supervised import AWAY_AND_BACK, CYCLE, HOME, scripted, steps
from tests.verifier.test_joint_velocity_and_way_back import one_curve
from tests.verifier.test_supervisor import verified
from verifier import supervisor as module
from verifier.command import Cause, Command, State
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed
from verifier.supervisor import Supervisor


def off_path(begun: int = 20) -> tuple[Supervisor, list[Command]]:
    """A supervisor whose robot rests beside its path: for some cycles no stop along the path was found."""
    supervisor = scripted(joint_space=True)
    assert supervisor.propose(NewTrajectory(AWAY_AND_BACK)) is None
    commands = steps(supervisor, begun)
    commands += leaves_its_path(supervisor, begun)
    return supervisor, commands


def leaves_its_path(supervisor: Supervisor, first: int, wanted: float | None = None) -> list[Command]:
    """Steps number ``first`` and on: no stop along the path is found; one beside it is made to its end.

    ``wanted``: a path speed that is proposed meanwhile.
    """
    manoeuvre = supervisor._planner._manoeuvre
    search = manoeuvre.search
    manoeuvre.search = lambda *args, **more: args[3] != 0.0 and search(*args, **more)
    manoeuvre.steady_then = lambda *_: False
    commands = steps(supervisor, 2, first=first)
    assert supervisor.plan.stop is StopKind.JOINT_SPACE
    supervisor.check.reason = verified(False)
    commands += steps(supervisor, 2, first=first + 2)
    assert wanted is None or supervisor.propose(PathSpeed(wanted)) is None
    commands += steps(supervisor, 28, first=first + 4)
    manoeuvre.search = search
    del manoeuvre.steady_then
    assert commands[-1].outcome is State.STOPPED
    return commands


def beside(q: np.ndarray) -> float:
    """How far from the straight line of the path [rad]."""
    share = (q - HOME) / [1.5, 1.0]
    return float(abs(share[0] - share[1]))


def test_the_robot_comes_back_to_its_path_and_goes_on():
    supervisor, commands = off_path()
    left = beside(commands[-1].q)
    assert left > 1e-4, "vacuous: the stop stayed on the path"
    supervisor.check.reason = verified(True)
    before = supervisor.check.plans
    commands += steps(supervisor, 520, first=len(commands))
    one_curve(commands)
    after = commands[52:]
    assert after[0].outcome is State.RECOVERING and after[0].cause is Cause.ADOPTED
    off = [beside(c.q) for c in after]
    joined = next(i for i, each in enumerate(off) if each <= 1e-9)
    assert {c.outcome for c in after[:joined]} == {State.RECOVERING}
    assert max(off[joined:]) <= 1e-9 and max(off) <= left + 1e-9
    assert supervisor.check.plans >= before + joined, "every plan of it is checked"
    assert State.EXECUTING in {c.outcome for c in after}
    assert commands[-1].outcome is State.STOPPED and np.allclose(commands[-1].q, HOME, atol=1e-9)


def test_a_connector_that_is_not_verified_waits():
    supervisor, commands = off_path()
    rest = commands[-1].q
    commands += steps(supervisor, 50, first=len(commands))
    assert {c.cause for c in commands[-50:]} == {Cause.NOT_VERIFIED}
    assert all(np.array_equal(c.q, rest) for c in commands[-50:])
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 5, first=len(commands))
    supervisor.check.reason = verified(False)
    commands += steps(supervisor, 60, first=len(commands))
    assert commands[-1].outcome is State.STOPPED
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 520, first=len(commands))
    one_curve(commands)
    assert np.allclose(commands[-1].q, HOME, atol=1e-9)


def test_where_there_is_no_connector_the_robot_rests_and_takes_another_trajectory(monkeypatch):
    def none(*_args, **_more):
        raise module.TrajectoryError("planted")

    monkeypatch.setattr(module, "rest_to_rest", none)
    supervisor, commands = off_path()
    assert supervisor.refusal.objection is Objection.NO_CONNECTOR and "planted" in supervisor.refusal.text
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 20, first=len(commands))
    assert commands[-1].outcome is State.STOPPED
    assert supervisor.fault is None
    assert supervisor.propose(JointVelocity(np.array([0.3, -0.3]), 0.5)) is None
    commands += steps(supervisor, 30, first=len(commands))
    one_curve(commands)
    assert np.allclose(commands[-1].dq, [0.3, -0.3], atol=1e-9)


@pytest.mark.parametrize("sdot", [0.0, 0.4, -0.5])
def test_a_path_speed_on_the_connector_is_followed_in_the_end(sdot):
    supervisor, commands = off_path()
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 4, first=len(commands))
    assert supervisor.propose(PathSpeed(sdot)) is None
    commands += steps(supervisor, 100, first=len(commands))
    assert supervisor.propose(PathSpeed(1.0)) is None
    commands += steps(supervisor, 520, first=len(commands))
    one_curve(commands)
    assert commands[-1].outcome is State.STOPPED and np.allclose(commands[-1].q, HOME, atol=1e-9)


def test_who_turns_round_on_the_connector_can_turn_once_more_and_go_on():
    supervisor, commands = off_path()
    rest = commands[-1].q
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 5, first=len(commands))
    assert 0.0 < beside(commands[-1].q) < beside(rest), "vacuous: not on the connector"
    assert supervisor.propose(PathSpeed(-1.0)) is None
    commands += steps(supervisor, 100, first=len(commands))
    assert commands[-1].outcome is State.STOPPED and np.allclose(commands[-1].q, rest, atol=1e-9)
    assert supervisor.propose(PathSpeed(1.0)) is None
    again = steps(supervisor, 620, first=len(commands))
    one_curve(commands + again)
    off = [beside(c.q) for c in again]
    joined = next(i for i, each in enumerate(off) if each <= 1e-9)
    assert {c.outcome for c in again[:joined]} == {State.RECOVERING}
    assert max(off[joined:]) <= 1e-9 and State.EXECUTING in {c.outcome for c in again[joined:]}
    assert again[-1].outcome is State.STOPPED and np.allclose(again[-1].q, HOME, atol=1e-9)


def test_a_stop_that_leaves_the_connector_is_followed_by_another_one():
    supervisor, commands = off_path()
    for begun in (8, 5):
        supervisor.check.reason = verified(True)
        commands += steps(supervisor, begun, first=len(commands))
        assert commands[-1].outcome is State.RECOVERING and np.abs(commands[-1].dq).max() > 0.0
        commands += leaves_its_path(supervisor, len(commands))
    supervisor.check.reason = verified(True)
    commands += steps(supervisor, 620, first=len(commands))
    one_curve(commands)
    assert commands[-1].outcome is State.STOPPED and np.allclose(commands[-1].q, HOME, atol=1e-9)


def test_a_plan_of_the_connector_that_is_withdrawn_is_not_adopted():
    supervisor, commands = off_path()
    rest = commands[-1].q
    supervisor.check.reason = verified(True)
    for k in range(len(commands), len(commands) + 10):
        supervisor.step(k * CYCLE)
        withdrawn = supervisor.withdraw()
        assert withdrawn.outcome is State.STOPPED and np.array_equal(withdrawn.q, rest)


@pytest.mark.parametrize("later", [[1.0], [1.0, -1.0, 1.0], [-1.0, 1.0]])
def test_whatever_is_wanted_while_the_stop_leaves_the_path_it_goes_on_in_the_end(later):
    supervisor = scripted(joint_space=True)
    assert supervisor.propose(NewTrajectory(AWAY_AND_BACK)) is None
    commands = steps(supervisor, 20)
    commands += leaves_its_path(supervisor, len(commands), wanted=-1.0)
    assert beside(commands[-1].q) > 1e-6, "vacuous: the stop stayed on the path"
    supervisor.check.reason = verified(True)
    for sdot in later:
        commands += steps(supervisor, 4, first=len(commands))
        assert supervisor.propose(PathSpeed(sdot)) is None
    commands += steps(supervisor, 300, first=len(commands))
    supervisor.propose(PathSpeed(1.0))
    commands += steps(supervisor, 620, first=len(commands))
    one_curve(commands)
    assert commands[-1].outcome is State.STOPPED and beside(commands[-1].q) <= 1e-9
    assert np.allclose(commands[-1].q, HOME, atol=1e-9)
