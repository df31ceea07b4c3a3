"""The simulated arm against pinocchio, statics by hand, and the sensor that it carries."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from modes.contact.experiments import BEGIN, FOREARM, GRIP, identified
from modes.contact.touches import Blow, Hand, Push, Spot
from modes.contact.twin import Body, Twin
from modes.contact.wrench import ToolLoad
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel
from tests.robots.pin_oracle import urdf_of

Array = NDArray[np.float64]
QUIET = Body(
    coulomb_Nm=(0.0,) * 6, current_noise_A=0.0, force_noise_N=0.0, moment_noise_Nm=0.0, bias=np.zeros(6)
)  # fmt: skip
REST = np.zeros(6)


@pytest.fixture
def kr5(arm: Callable[[str], RobotModel]) -> RobotModel:
    return arm("kr5_sixx")


def bar(a: Array, b: Array, radius: float, mass: float) -> pinocchio.Inertia:
    """A capsule's inertia as pinocchio has it, put where its axis is."""
    middle, axis = 0.5 * (a + b), (b - a) / np.linalg.norm(b - a)
    turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix()
    inertia = pinocchio.Inertia.FromCapsule(mass, radius, float(np.linalg.norm(b - a)))
    return pinocchio.SE3(turn, middle).act(inertia)


def rigid(robot: RobotModel, body: Body) -> pinocchio.Model:
    """The same arm in pinocchio, from its URDF."""
    model = pinocchio.buildModelFromUrdf(str(urdf_of("kr5_sixx")))
    capsules = robot.enclosure[0]
    for j in range(6):
        own = bar(capsules["a"][j], capsules["b"][j], float(capsules["radius"][j]), body.link_kg[j])
        model.inertias[j + 1] = own
    flange = np.array(body.flange_m)
    tip = flange + body.tool_m * np.array(body.axis)
    model.inertias[6] = model.inertias[6] + bar(flange, tip, body.tool_radius_m, body.tool_kg)
    model.armature = np.array(body.rotor_kg_m2)
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    return model


def test_drives_hold_the_weight_that_pinocchio_finds(
    kr5: RobotModel, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    model = rigid(kr5, QUIET)
    data = model.createData()
    for _ in range(count(200)):
        q = rng.uniform(-1.0, 1.0, 6)
        twin = Twin(kr5, q, QUIET)
        for _step in range(20):
            twin.go(q, REST)
        weight = pinocchio.computeGeneralizedGravity(model, data, twin.q)
        np.testing.assert_allclose(twin.torques, weight, atol=2e-2)


def test_motion_takes_the_torques_that_pinocchio_finds(kr5: RobotModel, rng: np.random.Generator) -> None:
    """Inverse dynamics of a step: inertia, rotors, Coriolis, weight and viscous friction."""
    model, twin = rigid(kr5, QUIET), Twin(kr5, BEGIN, QUIET, period_s=0.001)
    data, largest, fastest = model.createData(), np.zeros(6), np.zeros(6)
    phase, amplitude = rng.uniform(0.0, 6.0, 6), np.array([0.6, 0.4, 0.5, 0.8, 0.8, 0.8])
    for k in range(2000):
        q, dq = twin.q, twin.dq
        twin.follow(amplitude * np.sin(2.0 * (0.001 * k) + phase) * min(1.0, k / 500))
        acceleration = np.array(twin._data.qacc)  # of the state before
        expected = pinocchio.rnea(model, data, q, dq, acceleration)  # rotors are in it
        expected += np.array(QUIET.viscous_Nm_s) * dq
        largest = np.maximum(largest, np.abs(twin.torques - expected))
        fastest = np.maximum(fastest, np.abs(acceleration))
    assert (largest < 1e-6).all() and (fastest > 0.5).all(), (largest, fastest)


def test_an_untouched_sensor_reads_the_weight_of_its_tool(kr5: RobotModel, rng: np.random.Generator) -> None:
    bias = rng.uniform(-1.0, 1.0, 6)
    body = replace(QUIET, bias=bias)
    load = ToolLoad(body.tool_kg, np.array([0.0, 0.0, -0.5 * body.tool_m]), bias)
    for _ in range(10):
        q = rng.uniform(-1.5, 1.5, 6)
        twin = Twin(kr5, q, body)
        measured = [twin.go(q, REST) for _step in range(40)][-1]
        rotation = ToolFrame(kr5, np.array(body.flange_m)).pose(twin.q)[0]
        expected = np.tile(load.unloaded(rotation), (12, 1))
        np.testing.assert_allclose(measured.wrenches, expected, atol=5e-3)
        assert measured.stamps == pytest.approx(measured.t - 0.001 * np.arange(12)[::-1])


def test_the_load_is_identified_through_noise(kr5: RobotModel) -> None:
    body = Body()
    load = identified(kr5, body)
    assert load.mass_kg == pytest.approx(body.tool_kg, abs=5e-3)
    np.testing.assert_allclose(load.centre_m, [0.0, 0.0, -0.1], atol=2e-3)
    np.testing.assert_allclose(load.bias, body.bias, atol=0.02)


@pytest.mark.parametrize("spot", [GRIP, FOREARM])
def test_a_push_is_felt_by_the_drives_and_only_on_the_tool_by_the_sensor(kr5: RobotModel, spot: Spot) -> None:
    """By hand: drives give -J'f more, J at the spot; the sensor reads f in its axes, and its moment."""
    force = np.array([3.0, 8.0, -5.0])
    push = Push(spot, 0.0, 1e3, float(np.linalg.norm(force)), 0.01, tuple(force.tolist()))
    twin = Twin(kr5, BEGIN, QUIET)
    free = [twin.go(BEGIN, REST) for _ in range(40)][-1]
    before, begin = twin.torques, twin.q
    touched = [twin.go(BEGIN, REST, (push,)) for _ in range(80)][-1]
    joint = 3 if spot is FOREARM else 5
    local = np.array(spot.local_m) + (0.0 if spot is FOREARM else np.array(QUIET.flange_m))
    rotation, place, jacobian = _at(kr5, twin.q, joint, local)
    assert twin.where(spot) == pytest.approx(place, abs=1e-9)
    np.testing.assert_allclose(twin.torques - before, -jacobian.T @ force, atol=0.1)
    assert np.abs(twin.q - begin).max() > 1e-5
    change = (touched.wrenches - free.wrenches).mean(axis=0)
    expected = np.zeros(6)
    if spot is GRIP:
        expected[:3] = rotation.T @ force
        expected[3:] = np.cross(spot.local_m, expected[:3])
    np.testing.assert_allclose(change, expected, atol=0.03)


def _at(robot: RobotModel, q: Array, joint: int, local: Array) -> tuple[Array, Array, Array]:
    """Rotation, place and linear Jacobian of a point on a link, by pinocchio."""
    model = pinocchio.buildModelFromUrdf(str(urdf_of("kr5_sixx")))
    frame = pinocchio.Frame("spot", joint + 1, 0, pinocchio.SE3(np.eye(3), local), pinocchio.OP_FRAME)
    number = model.addFrame(frame)
    data = model.createData()
    kind = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    jacobian = pinocchio.computeFrameJacobian(model, data, q, number, kind)
    pinocchio.framesForwardKinematics(model, data, q)
    pose = data.oMf[number]
    return pose.rotation, pose.translation, jacobian[:3]


def test_currents_have_no_sign_and_noise_of_the_declared_size(kr5: RobotModel) -> None:
    body = replace(QUIET, current_noise_A=0.01)
    twin = Twin(kr5, BEGIN, body)
    currents = np.array([twin.go(BEGIN, REST).currents for _ in range(400)])[50:]
    assert (currents >= 0.0).all() and twin.torques[1] < -5.0
    held = np.abs(twin.torques / np.array(body.gains_Nm_A))
    np.testing.assert_allclose(currents[:, 1:3].mean(axis=0), held[1:3], atol=3e-3)
    np.testing.assert_allclose(currents[:, 1:3].std(axis=0), 0.01, rtol=0.2)


def test_the_sensor_ends_where_it_is_said_to(kr5: RobotModel) -> None:
    body = replace(QUIET, range_N=20.0, range_Nm=1.0)
    twin = Twin(kr5, BEGIN, body)
    measured = [twin.go(BEGIN, REST, (Blow(GRIP, 0.0, 200.0),)) for _ in range(2)][-1]
    assert np.abs(measured.wrenches[:, :3]).max() == 20.0 and np.abs(measured.wrenches[:, 3:]).max() == 1.0


def test_the_same_seed_gives_the_same_course_and_another_one_other_noise(kr5: RobotModel) -> None:
    runs = [Twin(kr5, BEGIN, seed=seed).go(BEGIN, REST).wrenches for seed in (0, 0, 1)]
    assert (runs[0] == runs[1]).all() and (runs[0] != runs[2]).any()


def test_drives_follow_what_they_are_given(kr5: RobotModel) -> None:
    twin = Twin(kr5, BEGIN, QUIET)
    for k in range(100):
        twin.follow(np.array([0.3, 0.0, 0.0, 0.2, 0.0, 0.5]) * min(1.0, k / 20.0))
    assert twin.dq == pytest.approx([0.3, 0.0, 0.0, 0.2, 0.0, 0.5], abs=0.02)
    for _ in range(60):
        twin.go(BEGIN, REST)
    assert twin.q == pytest.approx(BEGIN, abs=2e-3)


def test_a_hand_pulls_towards_where_it_goes_and_lets_go(kr5: RobotModel) -> None:
    hand = Hand(GRIP, 0.0, 4.0, (0.0, 0.1, 0.0), moving_s=1.0, stiffness_N_m=100.0)
    here = np.array([0.5, 0.0, 0.4])
    assert hand.force(0.0, here, REST[:3]) == pytest.approx([0.0, 0.0, 0.0])
    assert hand.force(2.0, here, REST[:3]) == pytest.approx([0.0, 10.0, 0.0])
    assert hand.force(2.0, here + np.array([0.0, 0.1, 0.0]), np.array([0.1, 0.0, 0.0])) == pytest.approx(
        [-2.0, 0.0, 0.0]
    )
    assert np.abs(hand.force(4.0 - 1e-9, here, REST[:3])).max() < 1e-6


def test_a_push_and_a_blow_have_the_size_and_the_time_that_they_say() -> None:
    blow, push = Blow(GRIP, 1.0, 50.0, 0.04), Push(GRIP, 1.0, 3.0, 20.0, 0.5, (2.0, 0.0, 0.0))
    t = np.linspace(1.0, 1.04, 401)
    sizes = np.array([blow.force(each, here, here)[1] for each in t for here in (np.zeros(3),)])
    assert sizes.max() == pytest.approx(50.0) and sizes.mean() == pytest.approx(100.0 / np.pi, rel=1e-2)
    assert blow.end_s == pytest.approx(1.04)
    assert [push.force(each, REST, REST)[0] for each in (1.0, 1.25, 1.5, 2.0, 2.75)] == pytest.approx(
        [0.0, 10.0, 20.0, 20.0, 10.0]
    )


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Blow(GRIP, 0.0, -1.0), "peak_N"),
        (lambda: Blow(GRIP, 0.0, 1.0, 0.0), "lasts_s"),
        (lambda: Blow(GRIP, 0.0, 1.0, direction=(0.0, 0.0, 0.0)), "direction"),
        (lambda: Push(GRIP, 0.0, 1.0, float("nan")), "force_N"),
        (lambda: Push(GRIP, 0.0, 1.0, 1.0, rise_s=0.6), "rise_s"),
        (lambda: Hand(GRIP, 0.0, 1.0, (0.0, 0.0, 0.0), moving_s=2.0), "moving_s"),
        (lambda: Hand(GRIP, 0.0, 1.0, (0.0, 0.0, 0.0), stiffness_N_m=-1.0), "stiffness_N_m"),
    ],
)
def test_touches_that_cannot_be_are_refused_by_name(make: Callable[[], object], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        make()


def test_arms_that_it_cannot_simulate_are_refused(
    arm: Callable[[str], RobotModel], kr5: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SetupError, match="panda is no chain of six revolute joints"):
        Twin(arm("panda"), np.zeros(7))
    with pytest.raises(SetupError, match="period_s"):
        Twin(kr5, BEGIN, period_s=float("nan"))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SetupError, match=r"mujoco, which is not installed: pip install 'stopproof\[twin\]'"):
        Twin(kr5, BEGIN)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda robot: Twin(robot, BEGIN * np.nan), "q = .* should be 6 finite numbers"),
        (lambda robot: Twin(robot, BEGIN[:5]), "q = .* should be 6 finite numbers"),
        (lambda robot: Twin(robot, BEGIN, period_s=0.0125), "whole number of milliseconds"),
        (lambda robot: Twin(robot, BEGIN, Body(link_kg=(1.0, 1.0, 1.0))), "link_kg has 3 numbers"),
        (lambda robot: Twin(robot, BEGIN, Body(stiffness_Nm=(0.0,) * 6)), "stiffness_Nm, joint 1 = 0.0"),
        (lambda robot: Twin(robot, BEGIN, Body(axis=(0.0, np.inf, 0.0))), "axis = "),
        (lambda robot: Twin(robot, BEGIN).follow(np.full(6, np.nan)), "dq = .* should be 6 finite numbers"),
        (lambda robot: Twin(robot, BEGIN).go(REST, np.zeros(5)), "dq = .* should be 6 finite numbers"),
        (lambda robot: Twin(robot, BEGIN).where(Spot("link_9")), "link_9.* should be on link_1 to link_6"),
        (
            lambda robot: Twin(robot, BEGIN).follow(REST, (Blow(Spot("hand"), 0.0, 1.0),)),
            "hand.* should be on link_1 to link_6",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused_by_name(
    make: Callable[[RobotModel], object], named: str, kr5: RobotModel
) -> None:
    with pytest.raises(SetupError, match=named):
        make(kr5)
