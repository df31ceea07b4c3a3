"""Every state and every way between them, with an arm that follows at once and contacts that are scripted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.contact.admittance import CyclicTask
from modes.contact.detection import Residual
from modes.contact.machine import ContactMachine, ContactSettings, Decision, Measured, State, Why
from modes.contact.wrench import SensorFault, ToolLoad
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]
T = 0.012
BEGIN = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
GAINS = (100.0, 100.0, 60.0, 40.0, 30.0, 20.0)
REST_A = np.array([0.05, 0.6, 0.5, 0.1, 0.1, 0.05])
LOAD = ToolLoad(0.5, np.array([0.0, 0.0, 0.05]), np.array([1.0, -2.0, 0.5, 0.05, 0.0, -0.02]))
SETTINGS = ContactSettings(Residual(GAINS), load=LOAD, sensor_m=(0.02, 0.0, 0.03))


@dataclass
class Push:
    """A force on the tool and torques of a contact with the body, from ``begin`` to ``end`` [s]."""

    begin: float
    end: float
    force: Callable[[float], tuple[float, float, float]] = lambda since: (0.0, 0.0, 0.0)
    body_Nm: tuple[float, ...] = (0.0,) * 6


class Arm:
    """Follows at once; a sensor at 1 kHz with noise; currents from the torques of what touches it."""

    def __init__(
        self, robot: RobotModel, settings: ContactSettings, pushes: tuple[Push, ...], seed: int
    ) -> None:
        self.frame = ToolFrame(robot, np.array(settings.sensor_m))
        place = self.frame.pose(BEGIN)[1]
        corners = place + np.array([[0, 0, 0], [0, 0.06, 0], [0, 0.06, -0.05], [0, 0, -0.05]])
        self.machine = ContactMachine(robot, CyclicTask(corners, 2.0), settings)
        self.settings, self.pushes, self.q, self.k = settings, pushes, BEGIN.copy(), 0
        self.noise_of = np.repeat((0.1, 0.002), 3)
        self.noise = np.random.default_rng(seed).normal(size=(97, 12, 6)) * self.noise_of
        self.rest_A = REST_A
        self.spoil: Callable[[Measured], Measured] = lambda measured: measured

    def step(self) -> tuple[float, Decision]:
        self.k += 1
        t = T * self.k
        stamps = t - 0.001 * np.arange(12)[::-1]
        rotation, _place, jacobian = self.frame.at(self.q)
        forces, torques = np.zeros((12, 3)), np.zeros(6)
        for push in self.pushes:
            for i in np.flatnonzero((push.begin <= stamps) & (stamps < push.end)):
                forces[i] += push.force(stamps[i] - push.begin)
            if push.begin <= t < push.end:
                torques += push.body_Nm
        torques += jacobian[:3].T @ forces[-1]
        wrenches = self.settings.load.unloaded(rotation) + self.noise[self.k % 97]
        wrenches[:, :3] += forces @ rotation
        currents = np.abs(self.rest_A + torques / GAINS + 0.005 * self.noise[self.k % 89, 0] / self.noise_of)
        decision = self.machine.step(self.q, self.spoil(Measured(t, currents, stamps, wrenches)))
        self.q = self.q + T * decision.dq
        return t, decision

    def until(self, end: float) -> Iterator[tuple[float, Decision]]:
        while T * self.k < end:
            yield self.step()


@pytest.fixture
def make(arm: Callable[[str], RobotModel], seed: int) -> Callable[..., Arm]:
    def made(*pushes: Push, **changed: Any) -> Arm:
        return Arm(arm("ra605"), replace(SETTINGS, **changed), pushes, seed)

    return made


def soft(x: float, y: float, z: float, rise: float = 1.0) -> Callable[[float], tuple[float, float, float]]:
    """A push that rises in ``rise`` seconds."""

    def force(since: float) -> tuple[float, float, float]:
        share = min(since / rise, 1.0)
        return share * x, share * y, share * z

    return force


def states(run: Iterator[tuple[float, Decision]]) -> list[tuple[float, State, Any]]:
    """When each state begins, and why."""
    found: list[tuple[float, State, Any]] = []
    for t, decision in run:
        if not found or found[-1][1] is not decision.state:
            found.append((t, decision.state, decision.reason))
    return found


def test_undisturbed_the_task_is_followed(make: Callable[..., Arm]) -> None:
    arm = make()
    off = []
    for t, decision in arm.until(20.0):
        assert decision.state is (State.CHECK if t <= 0.3 else State.TASK), t
        if t > 0.5:
            off.append(np.linalg.norm(decision.place - arm.machine._task.at(arm.machine._done_s)[0]))
    assert max(off) < 1.5e-3
    assert np.abs(arm.q - BEGIN).max() < 0.5


def test_a_soft_push_is_followed_and_the_arm_comes_back_and_goes_on_after_four_seconds(
    make: Callable[..., Arm],
) -> None:
    """15 N along x from 2 s to 6 s: 50 mm away; back where it was; the task goes on 4 s later."""
    arm = make(Push(2.0, 6.0, soft(15.0, 0.0, 0.0)))
    run, begin, pushed = list(arm.until(14.0)), None, None
    for t, decision in run:
        if decision.state is State.COLLABORATION:
            begin = decision.place if begin is None else begin
            pushed = decision.place if t < 5.9 else pushed
    found = states(iter(run))
    assert [state.value for _t, state, _why in found] == ["check", "task", "collaboration", "return", "task"]
    assert 2.4 < found[2][0] < 2.7 and found[2][2] is Why.SOFT_CONTACT and 6.0 < found[3][0] < 6.2
    assert found[4][0] - found[3][0] == pytest.approx(4.0, abs=0.02)
    assert begin is not None and pushed is not None
    assert pushed[0] - begin[0] == pytest.approx(15.0 / 300.0, abs=2e-3)
    np.testing.assert_allclose(pushed[1:], begin[1:], atol=2e-3)
    last = [decision.place for _t, decision in run if decision.state is State.RETURN][-1]
    np.testing.assert_allclose(last, begin, atol=1e-3)


def test_taken_again_while_it_goes_back_it_yields_again(make: Callable[..., Arm]) -> None:
    arm = make(Push(2.0, 4.0, soft(12.0, 0.0, 0.0)), Push(6.0, 8.0, soft(0.0, 12.0, 0.0)))
    names = [state.value for _t, state, _why in states(arm.until(14.0))]
    assert names == ["check", "task", "collaboration", "return", "collaboration", "return", "task"]


def test_a_blow_to_the_tool_stops_the_arm_and_it_goes_on_when_the_contact_is_gone(
    make: Callable[..., Arm],
) -> None:
    """40 N at once for 3 s: the wait lasts until a second after it is gone."""
    arm = make(Push(2.0, 5.0, soft(0.0, 40.0, 0.0, rise=1e-6)))
    found = []
    for t, decision in arm.until(8.0):
        found.append((t, decision))
        if decision.state is State.COLLISION:
            assert not decision.dq.any()
    changes = states(iter(found))
    assert [state.value for _t, state, _why in changes] == ["check", "task", "collision", "task"]
    assert 2.0 < changes[2][0] <= 2.0 + 3 * T and changes[2][2] is Why.TOOL_COLLISION
    assert 6.0 < changes[3][0] < 6.3


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_blow_to_the_body_stops_the_arm(make: Callable[..., Arm], joint: int) -> None:
    body = np.zeros(6)
    body[joint] = 60.0
    arm = make(Push(2.0, 2.5, body_Nm=tuple(body.tolist())))
    changes = states(arm.until(5.0))
    assert [state.value for _t, state, _why in changes] == ["check", "task", "collision", "task"]
    assert 2.0 <= changes[2][0] <= 2.0 + 3 * T and changes[2][2] is Why.BODY_COLLISION
    assert changes[3][0] > 3.5


@pytest.mark.parametrize("joint", [0, 1, 2, 3, 4])
def test_a_collision_of_the_body_while_somebody_guides_the_tool_stops_the_arm(
    make: Callable[..., Arm], joint: int
) -> None:
    body = np.zeros(6)
    body[joint] = 45.0
    arm = make(Push(2.0, 9.0, soft(0.0, 10.0, 0.0)), Push(5.0, 6.0, body_Nm=tuple(body.tolist())))
    changes = states(arm.until(9.0))
    assert [state.value for _t, state, _why in changes[:4]] == ["check", "task", "collaboration", "collision"]
    assert 5.0 <= changes[3][0] <= 5.0 + 2 * T and changes[3][2] is Why.RESIDUAL


def test_a_blow_to_the_tool_while_somebody_guides_it_stops_the_arm(make: Callable[..., Arm]) -> None:
    arm = make(Push(2.0, 9.0, soft(0.0, 10.0, 0.0)), Push(5.0, 5.1, soft(-60.0, 0.0, 0.0, rise=1e-6)))
    changes = states(arm.until(6.0))
    assert [state.value for _t, state, _why in changes[:4]] == ["check", "task", "collaboration", "collision"]
    assert changes[3][2] is Why.TOOL_COLLISION


def test_the_printed_residual_stops_a_guided_arm_for_nothing(make: Callable[..., Arm]) -> None:
    """A push that joint 1 feels as negative: 20 N at 0.4 m are 8 N m, shown as 16; with ε_r = 12 an alarm."""
    hold = Push(2.0, 6.0, soft(0.0, -22.0, 0.0, rise=2.0))
    for variant, wanted in (("as_printed", "collision"), ("corrected", "return")):
        arm = make(hold, residual=Residual(GAINS, 12.0, variant))
        arm.rest_A = np.array([1.0, 0.6, 0.5, 0.4, 0.4, 0.4])
        changes = states(arm.until(7.0))
        assert [state.value for _t, state, _why in changes[:4]] == ["check", "task", "collaboration", wanted]


def test_in_joint_space_every_joint_yields_to_its_torque(make: Callable[..., Arm]) -> None:
    arm = make(Push(2.0, 8.0, soft(0.0, 10.0, 0.0)), space="joint")
    begin = None
    for _t, decision in arm.until(7.9):
        if decision.state is State.COLLABORATION and begin is None:
            begin = arm.q.copy()
    assert begin is not None and decision.state is State.COLLABORATION
    jacobian = arm.frame.at(arm.q)[2]
    wanted = jacobian.T @ np.array([0.0, 10.0, 0.0, 0.0, 0.0, 0.0]) / 40.0
    np.testing.assert_allclose(arm.q - begin, wanted, atol=5e-3)


def test_the_tool_is_never_asked_to_be_faster_than_the_cap(make: Callable[..., Arm]) -> None:
    arm = make(Push(2.0, 4.0, soft(0.0, 70.0, 30.0, rise=0.6)))
    fastest = 0.0
    for _t, decision in arm.until(4.0):
        fastest = max(fastest, float(np.linalg.norm(arm.frame.at(arm.q)[2][:3] @ decision.dq)))
    assert 0.24 < fastest < 0.26


def spoiled(column: int, value: float) -> Callable[[Measured], Measured]:
    def change(measured: Measured) -> Measured:
        wrenches = measured.wrenches.copy()
        wrenches[5, column] = value
        return replace(measured, wrenches=wrenches)

    return change


def frozen(measured: Measured) -> Measured:
    return replace(measured, wrenches=np.tile(LOAD.bias, (12, 1)))


FAULTS: list[tuple[str, Callable[[Measured], Measured], object]] = [
    ("not a number", spoiled(2, math.nan), SensorFault.NOT_A_NUMBER),
    ("saturation", spoiled(1, 145.0), SensorFault.SATURATED),
    ("frozen", frozen, SensorFault.FROZEN),
    ("dropped", lambda m: replace(m, stamps=m.stamps[:0], wrenches=m.wrenches[:0]), SensorFault.DROPPED),
    ("clock", lambda m: replace(m, stamps=m.stamps - 3.0), SensorFault.CLOCK),
    ("currents", lambda m: replace(m, currents=np.full(6, np.nan)), Why.JOINTS),
    ("one current less", lambda m: replace(m, currents=m.currents[:5]), Why.JOINTS),
]


@pytest.mark.parametrize(("name", "spoil", "reason"), FAULTS, ids=[each[0] for each in FAULTS])
@pytest.mark.parametrize(
    "when", ["task", pytest.param("guided", marks=pytest.mark.rarely("the same faults during the task"))]
)
def test_what_cannot_be_believed_stops_the_arm_with_a_reason_until_it_is_reset(
    make: Callable[..., Arm], name: str, spoil: Callable[[Measured], Measured], reason: object, when: str
) -> None:
    arm = make(*([Push(2.0, 30.0, soft(0.0, 10.0, 0.0))] if when == "guided" else []))
    list(arm.until(4.0))
    assert arm.machine.state is (State.COLLABORATION if when == "guided" else State.TASK)
    arm.spoil = spoil
    seen = states(arm.until(4.3))
    if name == "frozen":  # what was read last changes at once to what does not change any more
        seen = [each for each in seen if each[1] is not State.COLLISION]
    assert seen[-1][1:] == (State.FAULT, reason) and seen[-1][0] < 4.12
    arm.spoil = lambda measured: measured
    for _t, decision in arm.until(6.0):
        assert decision.state is State.FAULT and decision.reason is reason and not decision.dq.any()
    arm.pushes = ()
    arm.machine.reset()
    assert [state.value for _t, state, _why in states(arm.until(8.0))] == ["check", "task"]


def test_a_swapped_axis_is_found_before_the_arm_moves(make: Callable[..., Arm]) -> None:
    """The load's bias and weight in the wrong axes: 4.9 N of weight where 0 is expected."""
    arm = make()
    arm.spoil = lambda m: replace(m, wrenches=m.wrenches[:, [2, 1, 0, 5, 4, 3]])
    for _t, decision in arm.until(2.0):
        assert not decision.dq.any()
    assert (decision.state, decision.reason) == (State.FAULT, SensorFault.WEIGHT)


def test_a_bad_configuration_is_refused(make: Callable[..., Arm]) -> None:
    arm = make()
    list(arm.until(1.0))
    arm.q = np.full(6, np.nan)
    _t, decision = arm.step()
    assert (decision.state, decision.reason) == (State.FAULT, Why.JOINTS) and not decision.dq.any()


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (
            {"residual": Residual((1.0,) * 7)},
            "residual has gains of 7 joints, .* has 6",
        ),
        ({"space": "null"}, "space = 'null' should be one of cartesian, joint"),
        ({"clear_s": 0.0}, "clear_s = 0.0 should be a number above 0"),
        ({"cap_m_s": -0.1}, "cap_m_s = -0.1"),
        ({"task_gain": math.nan}, "task_gain = nan"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_name(
    make: Callable[..., Arm], changed: dict[str, Any], text: str
) -> None:
    with pytest.raises(SetupError, match=text):
        make(**changed)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"residual": (1.0, 2.0)}, "contact: residual = .* should be a Residual"),
        ({"currents": None}, "contact: currents = None should be a CurrentThresholds"),
        ({"forces": 7.0}, "contact: forces = 7.0 should be a ForceThresholds"),
        ({"load": 0.5}, "contact: load = 0.5 should be a ToolLoad"),
        ({"admittance": (0.008, 300.0)}, "contact: admittance = .* should be a Admittance"),
        ({"filters": "exakt"}, "contact: filters = 'exakt' should be one of as_printed, corrected, exact"),
        ({"sensor_m": (0.0, 0.0)}, "contact: sensor_m = .* should be 3 finite numbers"),
        ({"sensor_m": (0.0, 0.0, float("nan"))}, "contact: sensor_m = .* should be 3 finite numbers"),
        ({"acceleration_share": 0.0}, "contact: acceleration_share = 0.0 should be a number above 0"),
    ],
)
def test_settings_of_another_kind_are_refused_by_name(change: dict[str, Any], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        replace(SETTINGS, **change)


def test_speeds_change_slowly_except_to_stop(arm: Callable[[str], RobotModel]) -> None:
    """By 0.15 of 10 rad/s² in 12 ms; a collision stops at once."""
    run = Arm(arm("ra605"), SETTINGS, (Push(3.0, 3.2, lambda since: (0.0, 60.0, 0.0)),), 0)
    before, largest, stopped = np.zeros(6), 0.0, False
    for _t, decision in run.until(6.5):
        change = float(np.abs(decision.dq - before).max())
        if decision.state is State.COLLISION:
            stopped = stopped or change > 0.018
            assert not decision.dq.any()
        else:
            largest = max(largest, change)
        before = decision.dq
    assert stopped and 0.01 < largest <= 0.15 * 10.0 * T + 1e-12


def test_guided_back_it_is_stopped_by_a_blow_and_by_the_residual(make: Callable[..., Arm]) -> None:
    led = Push(2.0, 4.0, soft(15.0, 0.0, 0.0))
    blow = make(led, Push(5.0, 5.1, soft(0.0, 60.0, 0.0, rise=1e-6)))
    found = states(blow.until(6.0))
    assert [(s, why) for _t, s, why in found[3:5]] == [
        (State.RETURN, Why.LET_GO),
        (State.COLLISION, Why.TOOL_COLLISION),
    ]
    body = make(led, Push(5.0, 5.6, body_Nm=(40.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    found = states(body.until(6.0))
    assert [(s, why) for _t, s, why in found[3:5]] == [
        (State.RETURN, Why.LET_GO),
        (State.COLLISION, Why.RESIDUAL),
    ]


def test_the_residual_counts_from_currents_of_before_anybody_pushed(make: Callable[..., Arm]) -> None:
    """Force and currents rise over a second; the offset is of its begin, within noise, not of its end."""
    arm = make(Push(2.0, 6.0, soft(12.0, 0.0, 0.0, rise=1.0)))
    guided = next(d for _t, d in arm.until(5.0) if d.residual is not None)
    assert guided.residual is not None
    np.testing.assert_allclose(arm.machine._offset, REST_A, atol=0.02)
    torques = np.abs(arm.frame.at(arm.q)[2][:3].T @ guided.force)
    assert torques.max() > 2.2 and np.abs(guided.residual).max() < 1.8


@pytest.mark.parametrize("push", [soft(0.0, 100.0, 0.0, rise=1e-6), None])
def test_reset_forgets_what_filters_had_seen(
    arm: Callable[[str], RobotModel], push: Callable[[float], tuple[float, float, float]] | None
) -> None:
    """It is pushed, or its currents are large, while the sensor breaks; after it nothing is left of that."""
    contact = Push(0.9, 1.0, push) if push is not None else Push(0.9, 1.0, body_Nm=(300.0,) * 6)
    run = Arm(arm("ra605"), replace(SETTINGS, check_s=0.02), (contact,), 0)
    list(run.until(0.95))
    run.spoil = lambda m: replace(m, wrenches=np.full_like(m.wrenches, np.nan))
    assert {decision.state for _t, decision in run.until(1.1)} == {State.FAULT}
    run.spoil = lambda m: m
    run.machine.reset()
    found = states(run.until(2.0))
    assert [state for _t, state, _why in found] == [State.CHECK, State.TASK]


def test_a_clock_that_stands_or_runs_too_fast_is_a_fault(make: Callable[..., Arm]) -> None:
    for t in (0.0, 0.3 * T):
        arm = make()
        list(arm.until(1.0))
        now = T * arm.k
        measured = Measured(now + t, REST_A, np.empty(0), np.empty((0, 6)))
        assert arm.machine.step(arm.q, measured).reason is SensorFault.CLOCK


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: replace(m, t=None),
        lambda m: replace(m, t="now"),
        lambda m: replace(m, stamps=None),
        lambda m: replace(m, stamps=m.stamps[:, None]),
        lambda m: replace(m, wrenches=None),
        lambda m: replace(m, wrenches=[["a"] * 6] * 12),
        lambda m: replace(m, wrenches=m.wrenches.astype(complex)),
        lambda m: replace(m, currents=None),
        lambda m: replace(m, currents="abc"),
        lambda m: replace(m, currents=m.currents[:5]),
        lambda m: replace(m, currents=m.currents.astype(complex)),
    ],
)
def test_whatever_is_measured_a_step_raises_nothing(
    make: Callable[..., Arm], spoil: Callable[[Measured], Measured]
) -> None:
    arm = make()
    list(arm.until(1.0))
    arm.spoil = spoil
    _t, decision = arm.step()
    assert decision.state is State.FAULT and not decision.dq.any()
    assert decision.reason in (Why.JOINTS, SensorFault.NOT_A_NUMBER, SensorFault.CLOCK)


@pytest.mark.parametrize("dq", [np.full(6, np.nan), np.full(6, np.inf), np.zeros(5), np.zeros(2), "fast"])
def test_speeds_of_the_drives_that_are_none_are_a_fault(make: Callable[..., Arm], dq: Any) -> None:
    arm = make()
    list(arm.until(1.0))
    t = T * (arm.k + 1)
    stamps = t - 0.001 * np.arange(12)[::-1]
    wrenches = arm.settings.load.unloaded(arm.frame.at(arm.q)[0]) + arm.noise[0]
    decision = arm.machine.step(arm.q, Measured(t, REST_A, stamps, wrenches), dq)
    assert (decision.state, decision.reason) == (State.FAULT, Why.JOINTS) and not decision.dq.any()


def test_the_cap_holds_whatever_speeds_the_drives_had(make: Callable[..., Arm]) -> None:
    arm = make()
    list(arm.until(1.0))
    t = T * (arm.k + 1)
    stamps = t - 0.001 * np.arange(12)[::-1]
    wrenches = arm.settings.load.unloaded(arm.frame.at(arm.q)[0]) + arm.noise[0]
    fast = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    decision = arm.machine.step(arm.q, Measured(t, REST_A, stamps, wrenches), fast)
    assert decision.state in (State.TASK, State.COLLISION)
    assert np.linalg.norm(arm.frame.at(arm.q)[2][:3] @ decision.dq) <= 0.25 * (1.0 + 1e-9)


def test_joints_stay_below_their_speed_limits(arm: Callable[[str], RobotModel]) -> None:
    """A task that asks for more than the joints can, with caps out of the way."""
    robot = arm("ra605")
    place = ToolFrame(robot, np.array(SETTINGS.sensor_m)).pose(BEGIN)[1]
    far = CyclicTask(np.array([place, place + np.array([0.0, 0.3, 0.0])]), 0.02)
    machine = ContactMachine(robot, far, replace(SETTINGS, cap_m_s=3600.0, acceleration_share=1.0))
    machine._most = np.full(6, 1e9)
    fastest, frame = 0.0, ToolFrame(robot, np.array(SETTINGS.sensor_m))
    for k in range(1, 200):
        stamps = T * k - 0.001 * np.arange(12)[::-1]
        noise = 1e-3 * np.sin(np.arange(12) + k)[:, None]
        reading = SETTINGS.load.unloaded(frame.at(BEGIN)[0]) + noise
        decision = machine.step(BEGIN, Measured(T * k, REST_A, stamps, reading))
        share = np.abs(decision.dq) / robot.limits.velocity
        fastest = max(fastest, float(share.max()))
    assert fastest == pytest.approx(0.9)
