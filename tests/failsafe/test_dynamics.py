"""Dynamics, gravity and torques: pinocchio, and bounds against random states."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio
import pytest

from failsafe.box_search import BoxSearch, Found
from failsafe.bracket import Effort, Ended
from failsafe.dynamics import ArmDynamics
from failsafe.dynamics_kernels import potential
from robots.catalog import load_masses
from robots.errors import SetupError
from robots.inertia import GRAVITY_M_S2, Body, MassModel, Payload
from tests.failsafe.arm_speeds import jacobians
from tests.failsafe.test_box_search import catalogue_arm, interrupt, planar
from tests.occupancy.arms import arm
from tests.robots.pin_oracle import urdf_of

ARMS = ("ur3", "ur5", "ur10", "panda")


def dynamics_of(name: str, kg: float = 0.0, com=(0.0, 0.0, 0.05)) -> ArmDynamics:
    payload = Payload(kg, np.array(com), kg * np.diag([0.002, 0.003, 0.004]))
    return ArmDynamics(catalogue_arm(name), load_masses(name, payload))


def pinocchio_arm(name: str, kg: float = 0.0, com=(0.0, 0.0, 0.05)):
    """The same arm in pinocchio, fingers locked, payload at the flange."""
    model = pinocchio.buildModelFromUrdf(str(urdf_of(name)))
    flange = model.frames[model.getFrameId("panda_link8" if name == "panda" else "tool0")]
    if kg > 0.0:
        inertia = pinocchio.Inertia(kg, np.array(com), kg * np.diag([0.002, 0.003, 0.004]))
        model.appendBodyToJoint(flange.parentJoint, inertia, flange.placement)
    fingers = [model.getJointId(each) for each in model.names if "finger" in each]
    model = pinocchio.buildReducedModel(model, fingers, pinocchio.neutral(model))
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY_M_S2])
    return model, model.createData()


def pinocchio_q(model, q):
    """Joints that turn endlessly are (cos, sin) there."""
    out = []
    for i, value in enumerate(q):
        out += [value] if model.joints[i + 1].nq == 1 else [math.cos(value), math.sin(value)]
    return np.array(out)


def with_masses(model, kg, places, inertia=0.0, gravity=(0.0, 0.0, -GRAVITY_M_S2)) -> ArmDynamics:
    """A made-up arm with a mass at a place in the frame of each joint."""
    bodies = tuple(
        Body(j, m, np.array(place), inertia * np.eye(3))
        for j, (m, place) in enumerate(zip(kg, places, strict=True))
    )
    return ArmDynamics(model, MassModel(model.name, bodies, np.array(gravity), Payload(0.0), ()))


def stretched(gravity=(0.0, 0.0, 0.0)) -> ArmDynamics:
    """Two links of 0.4 m in a plane, and 2 kg at the tip."""
    return with_masses(planar(), (0.0, 2.0), ([0.4, 0.0, 0.0],) * 2, gravity=gravity)


@pytest.mark.parametrize("name", ARMS)
def test_mass_matrix_bias_and_energy_are_those_of_pinocchio(name, rng, count):
    for kg in (0.0, 2.5):
        own, (model, data) = dynamics_of(name, kg), pinocchio_arm(name, kg)
        n = model.nv
        for _ in range(count(5_000)):
            q, dq = rng.uniform(-3.0, 3.0, n), rng.uniform(-3.0, 3.0, n)
            at = pinocchio_q(model, q)
            state = own.at(q, dq)
            mass = pinocchio.crba(model, data, at)
            mass = np.triu(mass) + np.triu(mass, 1).T
            assert np.allclose(state.mass, mass, rtol=1e-9, atol=1e-10)
            assert np.allclose(state.bias, pinocchio.rnea(model, data, at, dq, np.zeros(n)), atol=1e-9)
            assert state.kinetic == pytest.approx(0.5 * dq @ mass @ dq, rel=1e-9)
            height = potential(own.model.kinematics, own.points, q, own.gravity, own.work)
            assert height == pytest.approx(pinocchio.computePotentialEnergy(model, data, at), abs=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_no_state_asks_for_more_torque_than_its_bound(name, rng, count):
    own, (model, data) = dynamics_of(name, 2.0), pinocchio_arm(name, 2.0)
    limits = own.model.limits
    n = model.nv
    gravity, most = own.gravity_bound(), own.torque_bound(limits.velocity, limits.acceleration)
    brackets = own.torques(limits.velocity, limits.acceleration)
    assert [each.upper for each in brackets] == pytest.approx(most.tolist())
    seen = np.zeros(n)
    for _ in range(count(50_000)):
        q = rng.uniform(-math.pi, math.pi, n)
        at = pinocchio_q(model, q)
        seen = np.maximum(seen, np.abs(pinocchio.computeGeneralizedGravity(model, data, at)))
        dq = rng.choice([-1.0, 1.0], n) * limits.velocity
        ddq = rng.uniform(-1.0, 1.0, n) * limits.acceleration
        torque = np.abs(pinocchio.rnea(model, data, at, dq, ddq))
        assert (torque <= most).all()
    assert (seen <= gravity).all()
    assert seen[1] > 0.7 * gravity[1], "vacuous: the shoulder never comes near to its bound"
    for j, each in enumerate(brackets):
        at = each.witness
        torque = pinocchio.rnea(model, data, pinocchio_q(model, at.q), at.dq, at.ddq)
        assert abs(torque[j]) == pytest.approx(each.lower, rel=1e-9)


def test_energy_bracket_holds_what_random_states_have(rng, count):
    own, (model, data) = dynamics_of("ur5", 5.0), pinocchio_arm("ur5", 5.0)
    speed = own.model.limits.velocity
    found = own.energy(speed, Effort(gap=0.3, max_boxes=1 << 14))
    at = found.witness
    assert found.lower == pytest.approx(
        pinocchio.computeKineticEnergy(model, data, pinocchio_q(model, at.q), at.dq), rel=1e-9
    )
    seen = 0.0
    for _ in range(count(200_000)):
        q, dq = rng.uniform(-math.pi, math.pi, 6), rng.choice([-1.0, 1.0], 6) * speed
        seen = max(seen, pinocchio.computeKineticEnergy(model, data, pinocchio_q(model, q), dq))
    assert 0.5 * found.lower < seen <= found.upper
    assert found.gap < 0.6


def test_energy_that_is_remembered_is_of_the_same_proportion():
    """Two links in a plane, stretched: ½ · 2 kg · (0.8 V1 + 0.4 V2)²."""
    own = stretched()
    for speed in ([2.0, 2.0], [2.0, 1.2], [2.0, 1.24], [4.0, 2.4], [1.2, 2.0]):
        found, exact = own.energy(np.array(speed), Effort(gap=0.05)), (0.8 * speed[0] + 0.4 * speed[1]) ** 2
        assert found.lower == pytest.approx(exact, rel=1e-6)
        assert exact <= found.upper <= exact / 0.95 * (1.0 + 1e-6)


def test_the_energy_is_bounded_by_the_bound_of_the_search_and_not_by_what_it_found(monkeypatch):
    """As if the search had found half of ½ · 2 kg · (0.8 V1 + 0.4 V2)² only."""
    whole = BoxSearch.run

    def half_found(search: BoxSearch, *given: object) -> Found:
        found = whole(search, *given)
        return replace(found, best=0.5 * found.best, ended=Ended.DEADLINE)

    monkeypatch.setattr(BoxSearch, "run", half_found)
    exact, found = (0.8 * 2.0 + 0.4 * 1.2) ** 2, stretched().energy(np.array([2.0, 1.2]), Effort(gap=0.01))
    assert found.lower == pytest.approx(0.5 * exact, rel=1e-6) and found.ended is Ended.DEADLINE
    assert exact <= found.upper <= exact / 0.99 * (1.0 + 1e-6)


def test_a_search_for_the_energy_that_was_interrupted_is_not_remembered():
    own, speed = stretched(), np.array([2.0, 1.2])
    assert own.energy(speed, Effort(progress=interrupt)).ended is Ended.INTERRUPTED
    assert own.energy(speed, Effort()).ended is Ended.NARROW


@pytest.mark.parametrize("name", ("slide_then_turn", "gantry", "scara"))
def test_gravity_of_arms_that_slide(name, rng, count):
    """Jᵀ m g by the tests' own kinematics, of gravity in any direction; exact for a base that slides."""
    for _ in range(count(500)):
        model = arm(name, rng)
        n = len(model.joints)
        kg, places, gravity = rng.uniform(0.5, 3.0, n), rng.uniform(-0.4, 0.4, (n, 3)), rng.normal(size=3)
        bound = with_masses(model, kg, places, gravity=gravity).gravity_bound()
        q = rng.uniform(np.maximum(model.limits.position_lower, -np.pi), np.pi, (200, n))
        q = np.minimum(q, model.limits.position_upper)
        seen = np.abs(sum(m * gravity @ jacobians(model, q, j, places[j])[0] for j, m in enumerate(kg)))
        assert (seen.max(axis=0) <= bound).all()
        if model.kinematics[0]["prismatic"][0]:
            assert bound[0] == pytest.approx(seen[0, 0], rel=1e-6, abs=1e-6)


def test_torque_of_two_links_in_a_plane_term_by_term():
    """Stretched: the tip is drawn inwards by 0.4 V1² + 0.4 (V1 + V2)², braked by 0.8 a1 + 0.4 a2, and weighs.

    The bound adds the three as if they all pulled across each lever, of 0.8 and 0.4 m.
    """
    own, (v1, v2), (a1, a2) = stretched((9.0, 0.0, 0.0)), (1.5, 2.0), (3.0, 7.0)
    inwards, braked = 0.4 * v1**2 + 0.4 * (v1 + v2) ** 2, 0.8 * a1 + 0.4 * a2
    speed, deceleration, still = np.array([v1, v2]), np.array([a1, a2]), np.zeros(2)
    levers = 2.0 * np.array([0.8, 0.4])
    assert own.torque_bound(still, still) == pytest.approx(9.0 * levers, rel=1e-6)
    assert own.torque_bound(speed, still) == pytest.approx((9.0 + inwards) * levers, rel=1e-6)
    assert own.torque_bound(speed, deceleration) == pytest.approx((9.0 + inwards + braked) * levers, rel=1e-6)


def test_share_of_the_deceleration_that_is_allowed_everywhere_by_hand():
    """What the torque limits leave after the pull inwards, as a share of what braking asks for."""
    own, speed, deceleration = stretched(), np.array([1.5, 2.0]), np.array([3.0, 7.0])
    inwards, braked = 0.4 * 1.5**2 + 0.4 * 3.5**2, 0.8 * 3.0 + 0.4 * 7.0
    for shares, guaranteed, joint in (((0.5, 0.7), 0.5, 0), ((0.9, 0.4), 0.4, 1), ((-0.1, 0.7), 0.0, 0)):
        torque = 2.0 * np.array([0.8, 0.4]) * (inwards + np.array(shares) * braked)
        limits = replace(own.model.limits, torque=torque)
        limited = ArmDynamics(replace(own.model, limits=limits), own.masses)
        found = limited.worst_allowed_deceleration(speed, deceleration)
        assert found.guaranteed == pytest.approx(guaranteed, rel=1e-6, abs=1e-9)
        assert found.guaranteed <= guaranteed and found.joint == own.model.joints[joint]


def test_deceleration_that_torque_limits_allow(rng, count):
    own, (model, data) = dynamics_of("ur5", 5.0), pinocchio_arm("ur5", 5.0)
    limits = own.model.limits
    lowest = 1.0
    for _ in range(count(20_000)):
        q, dq = rng.uniform(-math.pi, math.pi, 6), rng.choice([-1.0, 1.0], 6) * limits.velocity
        at = pinocchio_q(model, q)
        share = own.allowed_deceleration(q, dq, limits.acceleration)
        ddq = -np.sign(dq) * limits.acceleration
        lowest = min(lowest, share)
        if share > 0.0:
            torque = np.abs(pinocchio.rnea(model, data, at, dq, share * ddq))
            assert (torque <= limits.torque * (1.0 + 1e-9)).all()
        if 0.0 < share < 1.0:
            torque = np.abs(pinocchio.rnea(model, data, at, dq, (share + 1e-6) * ddq))
            assert (torque > limits.torque * (1.0 - 1e-9)).any()
    worst = own.worst_allowed_deceleration(limits.velocity, limits.acceleration)
    assert 0.0 <= worst.guaranteed <= min(worst.found, lowest)
    slow = own.worst_allowed_deceleration(0.05 * limits.velocity, 0.3 * limits.acceleration)
    assert slow.guaranteed <= slow.found
    weak = own.worst_allowed_deceleration(0.01 * limits.velocity, 1e-3 * limits.acceleration)
    assert weak.joint in own.model.joints


def test_a_light_slow_stop_is_allowed_everywhere():
    own = dynamics_of("ur10")
    limits = own.model.limits
    worst = own.worst_allowed_deceleration(0.05 * limits.velocity, 0.05 * limits.acceleration)
    assert worst.guaranteed == pytest.approx(1.0, abs=1e-6) and worst.found == 1.0 and worst.witness is None


def test_masses_of_another_robot_and_unknown_torques_are_refused():
    with pytest.raises(SetupError, match=r"masses of ur5 .* do not fit ur10"):
        ArmDynamics(catalogue_arm("ur10"), load_masses("ur5", Payload(0.0)))
    model = catalogue_arm("ur3")
    model = replace(model, limits=replace(model.limits, torque=np.full(6, math.inf)))
    own = ArmDynamics(model, load_masses("ur3", Payload(0.0)))
    with pytest.raises(SetupError, match="ur3: no torque limit is known"):
        own.allowed_deceleration(np.zeros(6), np.ones(6), np.ones(6))
