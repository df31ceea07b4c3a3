"""Masses of an arm and its payload: pinocchio alone, hand arithmetic, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pinocchio
import pytest

from robots.catalog import RobotSetup, load_masses
from robots.errors import SetupError
from robots.inertia import GRAVITY_M_S2, Body, Payload
from tests.robots.made_up import joint, link, robot, shape
from tests.robots.pin_oracle import urdf_of

BALL = shape('<sphere radius="0.1"/>')


def massive(name: str, mass: float, inertia: str = 'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"') -> str:
    inside = f'<inertial><origin xyz="0 0 0.5"/><mass value="{mass}"/><inertia {inertia}/></inertial>'
    return link(name, BALL + inside)


@pytest.mark.parametrize("name", ("ur3", "ur5", "ur10", "panda", "ur3e", "ur5e", "ur10e", "ur16e", "fr3"))
def test_bodies_are_those_of_pinocchio(name):
    masses = load_masses(name, Payload(0.0))
    model = pinocchio.buildModelFromUrdf(str(urdf_of(name)))
    fingers = [model.getJointId(each) for each in model.names if "finger" in each]
    model = pinocchio.buildReducedModel(model, fingers, pinocchio.neutral(model))
    assert len(masses.bodies) == model.njoints - 1
    for body in masses.bodies:
        inertia = model.inertias[body.joint + 1]
        assert body.mass_kg == pytest.approx(inertia.mass, rel=1e-12)
        assert np.allclose(body.com_m, inertia.lever, atol=1e-12)
        assert np.allclose(body.inertia_kg_m2, inertia.inertia, atol=1e-12)
    assert masses.moving_kg == pytest.approx(sum(each.mass for each in list(model.inertias)[1:]))
    assert masses.gravity.tolist() == [0.0, 0.0, -GRAVITY_M_S2]
    stated = {each.name: each for each in masses.assumptions}
    assert stated[f"robot.{name}.mass.payload"].value == 0.0
    assert len(stated) == len(masses.bodies) + 1


def test_point_masses_move_like_the_body(rng, count):
    for _ in range(count(2_000)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        moment = turn @ np.diag(rng.choice([0.0, 1.0], 3) * rng.random(3)) @ turn.T
        inertia = np.trace(moment) * np.eye(3) - moment
        body = Body(0, float(rng.uniform(0.1, 9.0)), rng.normal(size=3), inertia)
        places, mass = body.point_masses()
        away = places - body.com_m
        assert mass.sum() == pytest.approx(body.mass_kg)
        assert np.allclose(mass @ places, body.mass_kg * body.com_m)
        assert np.allclose(np.einsum("p,pi,pj->ij", mass, away, away), moment, atol=1e-12)


def test_a_payload_does_not_change_what_the_file_says_of_its_links():
    bare, loaded = (load_masses("ur5", Payload(kg)) for kg in (0.0, 4.0))
    assert loaded.bodies[5].mass_kg == pytest.approx(bare.bodies[5].mass_kg + 4.0)
    stated = [{each.name: each.value for each in masses.assumptions} for masses in (bare, loaded)]
    assert [of.pop("robot.ur5.mass.payload") for of in stated] == [0.0, 4.0]
    assert stated[0] == stated[1]


def test_a_payload_is_added_at_the_flange():
    """UR5: two bodies of wrist 3 become one, by the rule of Steiner."""
    bare = load_masses("ur5", Payload(0.0)).bodies[5]
    inertia = np.diag([0.02, 0.03, 0.04])
    held = load_masses("ur5", Payload(2.0, np.array([0.0, 0.0, 0.1]), inertia))
    full = held.bodies[5]
    assert full.mass_kg == pytest.approx(bare.mass_kg + 2.0)
    model = pinocchio.buildModelFromUrdf(str(urdf_of("ur5")))
    frame = model.frames[model.getFrameId("tool0")]
    added = pinocchio.Inertia(2.0, np.array([0.0, 0.0, 0.1]), inertia)
    expected = pinocchio.Inertia(bare.mass_kg, bare.com_m, bare.inertia_kg_m2) + frame.placement.act(added)
    assert np.allclose(full.com_m, expected.lever) and np.allclose(full.inertia_kg_m2, expected.inertia)
    assert held.moving_kg == pytest.approx(load_masses("ur5", Payload(0.0)).moving_kg + 2.0)
    half = Payload(2.0, np.array([0.0, 0.0, 0.1]), inertia).scaled(0.5)
    assert half.mass_kg == 1.0 and np.allclose(half.inertia_kg_m2, 0.5 * inertia)


@pytest.mark.parametrize(
    ("name", "payload", "rated", "said"),
    [
        ("ur5", None, None, "ur5: payload mass is not known; state it in kg"),
        ("ur5", Payload(5.5), None, "payload of 5.5 kg is beyond the rated payload of 5 kg"),
        ("ur3", Payload(3.1), None, "beyond the rated payload of 3 kg"),
        ("ur10", Payload(9.0), 8.0, "payload of 9 kg is beyond the rated payload of 8 kg"),
        ("ur5", Payload(1.0, frame="nose"), None, "no link is called 'nose'"),
        ("ur5", Payload(1.0, frame="base_link"), None, "moves with no joint"),
        ("lwa4p", Payload(0.0), None, "arm_1_joint moves a mass of 0 kg in lwa4p.urdf; it must be known"),
    ],
)
def test_what_is_not_known_or_too_heavy_is_refused_in_one_line(name, payload, rated, said):
    with pytest.raises(SetupError, match=said) as caught:
        load_masses(name, payload, rated_kg=rated)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Payload(math.nan), "mass nan kg must be a number"),
        (lambda: Payload(-1.0), "mass -1.0 kg must be"),
        (lambda: Payload(True), "mass True kg must be"),
        (lambda: Payload(1.0, np.array([0.0, math.inf, 0.0])), "centre of mass"),
        (lambda: Payload(1.0, np.zeros(2)), "centre of mass"),
        (lambda: Payload(1.0, np.zeros(3), np.diag([1.0, 0.1, 0.1])), "no body has it"),
        (lambda: Payload(1.0, np.zeros(3), np.zeros((2, 2))), "3 x 3"),
    ],
)
def test_payloads_that_no_body_has_are_refused(make, said):
    with pytest.raises(SetupError, match=said):
        make()


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (link("b", BALL), "link b has no mass"),
        (massive("b", 0.0), "moves a mass of 0 kg|no mass"),
        (massive("b", 1.0, 'ixx="1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"'), "inertia is impossible"),
    ],
)
def test_urdfs_without_possible_masses_are_refused(second, said, tmp_path):
    path = tmp_path / "made_up.urdf"
    path.write_text(
        robot(link("base"), massive("a", 1.0), second, joint("j", "base", "a"), joint("k", "a", "b"))
    )
    with pytest.raises(SetupError, match=said):
        load_masses(path, Payload(0.0))
    path.write_text(robot(link("base"), massive("a", 1.0), joint("j", "base", "a")))
    masses = load_masses(path, Payload(0.0), setup=RobotSetup())
    assert masses.bodies[0].com_m.tolist() == [0.0, 0.0, 0.5]
    with pytest.raises(SetupError, match="no flange is known"):
        load_masses(path, Payload(1.0))
