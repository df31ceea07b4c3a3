"""Stops by brakes: hand arithmetic, energy balance, pinocchio's own steps, and the energy bound against
all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from failsafe.bracket import Effort, Ended
from failsafe.brake_stop import Brakes, BrakeStop
from failsafe.dynamics import ArmDynamics
from failsafe.stop_grid import stop_grid
from failsafe.stopping import STOP_ANGLE, STOP_TIME, STOP_WAY, ArmSearch, of
from robots.catalog import RobotSetup, load_masses, load_robot
from robots.errors import SetupError
from robots.inertia import GRAVITY_M_S2, Body, MassModel, Payload
from tests.failsafe.test_box_search import planar
from tests.failsafe.test_dynamics import dynamics_of, pinocchio_arm, pinocchio_q, with_masses
from tests.occupancy.arms import arm as made_up_arm
from tests.robots.made_up import full_limits, joint, link, robot
from tests.robots.test_inertia import massive

ROUGH = Effort(gap=0.4, max_boxes=1 << 13)


def stop_of(
    name: str, kg: float = 0.0, delay_s: float = 0.0, factor: float = 1.5
) -> tuple[BrakeStop, ArmSearch]:
    """Brakes that hold ``factor`` times what gravity can ask, and at least 5 N m."""
    own = dynamics_of(name, kg)
    torque = np.maximum(factor * own.gravity_bound(), 5.0)
    torque[0] = torque[1]
    return BrakeStop(own, Brakes(torque, delay_s), own.model.limits.velocity, samples=6), ArmSearch(
        own.model, ROUGH
    )


def one_joint(tmp_path, axis=(0, 0, 1), torque=4.0, delay_s=0.0):
    """One link: 2 kg at 0.5 m along the axis, inertia 1 about the centre."""
    path = tmp_path / "one.urdf"
    path.write_text(robot(link("base"), massive("a", 2.0), joint("j", "base", "a", axis=axis)))
    setup = RobotSetup(bare_flange=True, limits=full_limits(["j"], [False]), cache_dir=tmp_path)
    model = load_robot(path, setup=setup)
    own = ArmDynamics(model, load_masses(path, Payload(0.0)))
    return BrakeStop(own, Brakes(np.array([torque]), delay_s), np.array([2.0])), ArmSearch(model, ROUGH)


def test_one_joint_about_the_vertical_by_hand(tmp_path):
    """I = 1 kg m², 2 rad/s, 4 N m: 0.5 s, 0.5 rad; 0.1 s of delay adds 0.2 rad. Gravity does nothing."""
    for delay in (0.0, 0.1):
        stop, arm = one_joint(tmp_path, delay_s=delay)
        out = stop.simulate(arm, np.zeros(1), np.array([2.0]))
        assert out.rests and out.imbalance < 1e-9
        assert out.time == pytest.approx(0.5 + delay, rel=1e-6)
        assert out.travel[0] == pytest.approx(0.5 + 2.0 * delay, rel=1e-6)
        assert out.displacement[0] == pytest.approx(0.5 + 2.0 * delay, rel=1e-6)
        bound = stop.bound(arm, 0.5 * 1.0 * 4.0)
        assert bound.energy == pytest.approx(2.0, rel=1e-6)
        assert bound.angle[0] == pytest.approx(0.5 + 2.0 * delay, rel=1e-6), "exact for one joint"
        assert out.time <= bound.time * (1.0 + 1e-6) and bound.time <= 1.01 * out.time


def test_a_joint_that_swings_back_while_it_coasts(tmp_path):
    """A pendulum of 1.5 kg m² hangs, and passes at 2 rad/s: ½ 1.5 · 2² = m g l (1 - cos φ), without brakes.

    A point 0.5 m from the axis goes half as far as the joint turns.
    """
    stop, arm = one_joint(tmp_path, axis=(1, 0, 0), torque=40.0, delay_s=1.0)
    arm.points["place"][0] = [0.1, 0.3, 0.4]
    out = stop.simulate(arm, np.array([math.pi]), np.array([2.0]))
    highest = math.acos(1.0 - 3.0 / (2.0 * GRAVITY_M_S2 * 0.5))
    assert out.rests and out.displacement[0] == pytest.approx(highest, rel=1e-5)
    assert 1.3 * highest < out.travel[0] < 2.0 * highest
    assert out.ways[0] == pytest.approx(0.5 * out.travel[0], rel=1e-5)


def test_a_stop_that_was_not_followed_to_its_end_does_not_count(tmp_path):
    """It takes 0.5 s by hand, and is followed for 0.4 s."""
    stop, arm = one_joint(tmp_path)
    short = replace(stop, longest_s=0.4)
    out = short.simulate(arm, np.zeros(1), np.array([2.0]))
    assert not out.rests and out.time == pytest.approx(0.4, abs=2e-3)
    for each in short.worst(arm):
        assert each.quantity not in (STOP_TIME, STOP_ANGLE, STOP_WAY) or each.lower == 0.0


def test_bounds_term_by_term_by_hand(tmp_path):
    """Two links of 2 kg, 1 kg m² about centres 0.5 m away; the first turns about the vertical, so that only
    the second falls. What a bound would lose by leaving one term out is more than a percent of it."""
    path = tmp_path / "two.urdf"
    joints = (
        joint("j", "base", "a"),
        joint("k", "a", "b", xyz=(0.0, 0.0, 0.4), axis=(1, 0, 0)),
    )
    path.write_text(robot(link("base"), massive("a", 2.0), massive("b", 2.0), *joints))
    setup = RobotSetup(bare_flange=True, limits=full_limits(["j", "k"], [False] * 2), cache_dir=tmp_path)
    model = load_robot(path, setup=setup)
    own = ArmDynamics(model, load_masses(path, Payload(0.0)))
    g, delay, kinetic = float(np.linalg.norm(own.gravity)), 0.1, 3.0
    assert own.gravity_bound() == pytest.approx([0.0, 2.0 * g * 0.5], rel=1e-6, abs=1e-6)
    stop = BrakeStop(own, Brakes(np.array([20.0, 30.0]), delay), np.array([2.0, 2.0]))
    arm = ArmSearch(model, ROUGH)
    bound = stop.bound(arm, kinetic)
    energy = (math.sqrt(kinetic) + delay * g * math.sqrt(0.5 * 2.0)) ** 2
    assert bound.energy == pytest.approx(energy, rel=1e-6)
    left = np.array([20.0, 30.0 - g])
    coasting = np.sqrt(2.0 * energy * np.array([1.0, 1.0 + 1.0]))  # 1/I of the body, and of the one before
    assert bound.angle == pytest.approx(delay * coasting + energy / left, rel=1e-6)
    for point, way in zip(arm.points, bound.way, strict=True):
        moved_by = point["chain"][: point["m"]]
        far = np.zeros(2)
        far[moved_by] = point["reach"][moved_by] + float(point["ball"])
        away = abs(float(point["place"][2]) - 0.5) + float(point["ball"])  # from the centre of its body
        fast = min(float(far @ coasting), math.sqrt(2.0 * energy * (0.5 + away**2)))
        assert way == pytest.approx(delay * fast + energy * float((far / left).max()), rel=1e-6)
        assert float(point["ball"]) > 0.0 and np.abs(point["place"][:2]).max() < 1e-9


def test_the_bound_is_that_of_the_energy_that_is_never_exceeded(tmp_path, monkeypatch):
    """Not that of the largest one found: 2 J, of which half is found, turn it by 0.5 rad."""
    stop, arm = one_joint(tmp_path)
    whole = ArmDynamics.energy

    def half_found(own: ArmDynamics, *given: object):
        bracket = whole(own, *given)
        return replace(bracket, lower=0.5 * bracket.lower, ended=Ended.DEADLINE)

    monkeypatch.setattr(ArmDynamics, "energy", half_found)
    found = stop.worst(arm)
    angle, time = of(found, STOP_ANGLE)[0], of(found, STOP_TIME)[0]
    assert 0.5 * (1.0 - 1e-6) <= angle.upper <= 0.5 * (1.0 + 1e-2)
    assert time.upper >= 0.5 * (1.0 - 1e-6)
    for each in (angle, time, of(found, STOP_WAY)[0]):
        assert each.ended is Ended.DEADLINE, "the search for the energy was not finished, nor is this"


def test_what_hangs_on_a_vertical_axis_may_fall():
    """The second axis is vertical, but the first one is not: 2 kg gain speed for the whole delay.

    Started downwards, nearly as much as a mass that falls freely: √E grows by t g √(m/2).
    """
    model = planar()
    model.kinematics[0]["axis"][0] = [0.0, 1.0, 0.0]
    own = with_masses(model, (0.01, 2.0), ([0.2, 0.0, 0.0], [0.4, 0.0, 0.0]), inertia=0.01)
    arm = ArmSearch(model, ROUGH)
    stop = BrakeStop(own, Brakes(np.array([60.0, 60.0]), 0.1), np.ones(2))
    q, dq = np.zeros(2), np.array([1.0, 0.0])
    out, kinetic = stop.simulate(arm, q, dq), own.at(q, dq).kinetic
    bound = stop.bound(arm, kinetic)
    assert out.rests and out.highest <= bound.energy
    assert math.sqrt(bound.energy) - math.sqrt(kinetic) <= 1.05 * (
        math.sqrt(out.highest) - math.sqrt(kinetic)
    )


def test_speed_that_the_energy_leaves_a_point_of_a_body(rng, count):
    """A body alone in space, by its eigenvalues: no place in a ball at a point of it is faster.

    With ½ (m v² + ωᵀ I ω) = E the fastest v + ω × d is √(2 E λ), λ the largest eigenvalue of 1/m + D I⁻¹ Dᵀ.
    """
    model, closest = planar(), 0.0
    arm = ArmSearch(model, ROUGH)
    for _ in range(count(1_000)):
        turned = Rotation.random(random_state=rng).as_matrix()
        a, b, c = rng.uniform(0.01, 1.0, 3)  # Σ m x² along three axes: the moments are sums of two
        inertia = turned @ np.diag([b + c, a + c, a + b]) @ turned.T
        body = Body(1, float(rng.uniform(0.5, 5.0)), rng.uniform(-0.3, 0.3, 3), inertia)
        masses = MassModel(model.name, (replace(body, joint=0), body), np.zeros(3), Payload(0.0), ())
        own, fast = ArmDynamics(model, masses), np.full(2, 1e9)
        stops = [BrakeStop(own, Brakes(np.ones(2), delay), np.ones(2)) for delay in (1.0, 0.0)]
        point = arm.points[-1]
        later, at_once = (each._way(point, 3.0, np.ones(2), fast) for each in stops)
        away = rng.normal(size=(40, 3))
        away *= float(point["ball"]) / np.linalg.norm(away, axis=1)[:, None]
        for d in point["place"] - body.com_m + away:
            across = np.cross(np.eye(3), d)
            most = np.linalg.eigvalsh(np.eye(3) / body.mass_kg + across @ np.linalg.solve(inertia, across.T))
            speed = math.sqrt(2.0 * 3.0 * most[-1])
            assert speed <= (later - at_once) * (1.0 + 1e-9)
            closest = max(closest, speed / (later - at_once))
    assert closest > 0.9, "vacuous"


@pytest.mark.parametrize("name", ("turn_then_slide", "planar"))
def test_what_coasts_without_a_bound_bounds_nothing(name, rng):
    """A sliding joint, and a body without inertia: the energy does not limit their speed during the delay."""
    model = made_up_arm(name, rng)
    own = with_masses(model, (1.0, 1.0), rng.uniform(-0.3, 0.3, (2, 3)), inertia=0.1 * (name != "planar"))
    arm, brakes = ArmSearch(model, ROUGH), 2.0 * own.gravity_bound() + 5.0
    at_once = BrakeStop(own, Brakes(brakes, 0.0), np.ones(2)).bound(arm, 1.0)
    assert not at_once.reason and at_once.time < math.inf
    later = BrakeStop(own, Brakes(brakes, 0.01), np.ones(2)).bound(arm, 1.0)
    assert "coasts for the delay" in later.reason
    assert np.isinf(later.angle).all() and np.isinf(later.way).all() and later.time == math.inf


def test_energy_balance(rng, count):
    for name, kg in (("ur5", 5.0), ("panda", 0.0)):
        stop, arm = stop_of(name, kg, delay_s=0.02)
        n = len(stop.speed)
        for _ in range(count(500)):
            q, dq = rng.uniform(-2.0, 2.0, n), rng.choice([-1.0, 1.0], n) * stop.speed
            out = stop.simulate(arm, q, dq)
            assert out.rests and out.imbalance <= 1e-4


def test_the_simulation_against_pinocchio_step_by_step(rng, count):
    """Until the first joint rests: aba with the brake torques, in steps ten times as small."""
    stop, arm = stop_of("ur5", 5.0, delay_s=0.01)
    model, data = pinocchio_arm("ur5", 5.0)
    for _ in range(count(300)):
        q0, dq0 = rng.uniform(-2.0, 2.0, 6), rng.choice([-1.0, 1.0], 6) * stop.speed
        q, dq, t, h = q0.copy(), dq0.copy(), 0.0, 1e-4
        while t < 0.03:
            brakes = np.zeros(6) if t < 0.01 - 1e-9 else -np.sign(dq) * stop.brakes.torque
            ahead = dq + h * pinocchio.aba(model, data, pinocchio_q(model, q), dq, brakes)
            if (ahead * dq <= 0.0).any():
                break
            q, dq, t = q + 0.5 * h * (dq + ahead), ahead, t + h
        short = BrakeStop(stop.dynamics, stop.brakes, stop.speed, step_s=1e-4, longest_s=t - 1e-9)
        out = short.simulate(arm, q0, dq0)
        assert out.displacement == pytest.approx(np.abs(q - q0), rel=0.02, abs=2e-3)


@pytest.mark.parametrize(("name", "kg"), [("ur3", 3.0), ("ur5", 0.0), ("ur5", 5.0), ("panda", 1.0)])
def test_no_simulated_stop_exceeds_the_energy_bound(name, kg, rng, count):
    closest = 0.0
    for delay in (0.0, 0.03):
        stop, arm = stop_of(name, kg, delay, factor=float(rng.choice([1.2, 3.0])))
        n = len(stop.speed)
        lower, upper = arm.box
        for _ in range(count(1_500)):
            q = rng.uniform(lower, upper)
            dq = (
                rng.uniform(-1.0, 1.0, n) * stop.speed
                if rng.random() < 0.5
                else (rng.choice([-1.0, 1.0], n) * stop.speed)
            )
            out = stop.simulate(arm, q, dq)
            bound = stop.bound(arm, stop.dynamics.at(q, dq).kinetic * (1.0 + 1e-12))
            assert not bound.reason
            assert out.rests and out.imbalance <= 1e-3
            assert (out.travel <= bound.angle).all() and out.time <= bound.time
            assert (out.ways <= bound.way).all()
            assert out.highest <= bound.energy * (1.0 + 1e-6)
            if delay == 0.0:
                closest = max(closest, float((out.travel / bound.angle).max()))
                spent = float((stop.brakes.torque - stop.dynamics.gravity_bound()) @ out.travel)
                assert spent <= bound.energy
    assert closest > 0.2, "vacuous: no stop comes near to its bound"


def test_brackets_of_a_stop_by_brakes():
    stop, arm = stop_of("ur5", 5.0)
    found = stop.worst(arm)
    assert {each.quantity for each in found} >= {STOP_TIME, STOP_ANGLE, STOP_WAY, "kinetic energy"}
    assert len(of(found, STOP_ANGLE)) == 6
    for each in found:
        assert 0.0 < each.lower <= each.upper < math.inf
    time = of(found, STOP_TIME)[0]
    again = stop.simulate(arm, time.witness.q, time.witness.dq)
    assert again.time == time.lower


def test_a_brake_that_gravity_may_overcome_bounds_nothing():
    stop, arm = stop_of("ur5", 5.0)
    torque = stop.brakes.torque.copy()
    torque[2] = 0.9 * stop.dynamics.gravity_bound()[2]
    weak = BrakeStop(stop.dynamics, Brakes(torque, 0.0), stop.speed, samples=2)
    for each in weak.worst(arm):
        if each.quantity in (STOP_TIME, STOP_ANGLE, STOP_WAY):
            assert each.upper == math.inf and each.ended is Ended.UNBOUNDED
            assert "brake of joint elbow_joint" in each.reason and "gravity" in each.reason
    assert weak.bound(arm, math.inf).time == math.inf


def test_more_torque_and_less_load_never_lengthen_the_bound():
    heavy, arm = stop_of("ur5", 5.0, 0.02)
    light = BrakeStop(dynamics_of("ur5", 1.0), heavy.brakes, heavy.speed)
    strong = BrakeStop(heavy.dynamics, Brakes(2.0 * heavy.brakes.torque, 0.02), heavy.speed)
    base = heavy.bound(arm, 100.0)
    for other in (light.bound(arm, 100.0), strong.bound(arm, 100.0), heavy.bound(arm, 50.0)):
        assert other.time < base.time and (other.way[-1] < base.way[-1])


def test_grid_over_load():
    _, arm = stop_of("ur5")
    brakes = stop_of("ur5", 5.0)[0].brakes

    def stop_at(speed: float, load: float) -> BrakeStop:
        own = dynamics_of("ur5", 5.0 * load)
        return BrakeStop(own, brakes, speed * own.model.limits.velocity, samples=2)

    grid = stop_grid(arm, stop_at, load_matters=True, shares=(0.5, 1.0))
    assert len(grid.cells) == 8 and grid.stop == "brakes"
    low, high = (of(grid.at(1.0, 1.0, load).brackets, STOP_TIME)[0] for load in (0.5, 1.0))
    assert low.upper < high.upper


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda own: Brakes(np.array([1.0, 0.0]), 0.0), "torque .* above zero"),
        (lambda own: Brakes(np.array([1.0, math.nan]), 0.0), "torque .* must be finite"),
        (lambda own: Brakes(np.ones(6), -0.1), "delay of -0.1 s"),
        (lambda own: Brakes(np.ones(6), math.inf), "delay of inf s"),
        (lambda own: BrakeStop(own, Brakes(np.ones(5), 0.0), np.ones(6)), "5 brake torques, but there are 6"),
        (lambda own: BrakeStop(own, Brakes(np.ones(6), 0.0), np.ones(7)), "7 speeds, but there are 6"),
    ],
)
def test_brakes_that_make_no_sense_are_refused_in_one_line(make, said):
    own = dynamics_of("ur3")
    with pytest.raises(SetupError, match=said) as caught:
        make(own)
    assert "\n" not in str(caught.value)
