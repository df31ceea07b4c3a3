"""Later samples against what a model assumes besides speeds: accelerations, and the limits of the arm."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point, load_profile
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedVelocity
from occupancy.humans.model import Belied
from occupancy.measurement import Gate
from robots.motion import Block
from tests.occupancy.people import Array, report, settings, standing

TUM = load_profile("tum")
E_P = 0.004
LEFT = (Point.L_SHOULDER, Point.L_ELBOW, Point.L_WRIST)


def arm(direction: float, middle: float = 0.45) -> Array:
    """A standing person; the left forearm's middle is ``middle`` [m] from the shoulder, in a direction."""
    points = standing()
    along = np.array([math.cos(direction), math.sin(direction), 0.0])
    shoulder = points[Point.L_SHOULDER]
    points[Point.L_ELBOW] = shoulder + (middle - 0.13) * along
    points[Point.L_WRIST] = shoulder + (middle + 0.13) * along
    points[Point.L_HAND] = points[Point.L_FINGERTIP] = points[Point.L_WRIST]
    return points


def known(xyz: Array, *, seen: int = 1, rate: float = 100.0) -> Block:
    """People block after ``seen`` equal reports, the last one at 0 s."""
    gate = Gate(TUM, settings(position_error_m=E_P))
    for i in range(seen - 1, -1, -1):
        gate.admit(report(-i / rate, ("a", xyz)), -i / rate)
    return gate.people


def belied(
    model: ArmReach | ArticulatedVelocity | ArticulatedAcceleration,
    people: Block,
    xyz: Array,
    t: float = 0.05,
) -> Belied | None:
    samples = (np.array([t]), xyz[None], np.full((1, MAX_POINTS), E_P))
    return model.belied(people, 0, samples, (0.0, 1.0))


def limited(**limits: float) -> ArmReach:
    """Arm reach under limits of its own."""
    assert TUM.arm is not None
    return ArmReach(replace(TUM, arm=replace(TUM.arm, **limits)))


def test_a_turn_is_held_against_the_angular_speed() -> None:
    model = limited(angular_speed=4.0, relative_speed=100.0, extension_speed=100.0)
    # both directions are known within asin(2 e / r), and an offset within 2 e of the sample may be meant
    turn = math.asin(2.0 * E_P / 0.45) + 4.0 * 0.05
    room = math.asin(2.0 * E_P / 0.45)
    assert belied(model, known(arm(0.0)), arm(turn + room - 1e-3)) is None
    found = belied(model, known(arm(0.0)), arm(turn + room + 1e-2))
    assert found is not None and found.point is Point.L_WRIST
    assert found.excess_m == pytest.approx(0.45 * math.sin(room + 1e-2) - 2.0 * E_P, abs=1e-6)


def test_a_stretch_is_held_against_its_speed() -> None:
    model = limited(extension_speed=1.0, relative_speed=100.0)
    grown = 2.0 * E_P + 1.0 * 0.05
    assert belied(model, known(arm(0.0, 0.35)), arm(0.0, 0.35 + grown + 2.0 * E_P - 1e-6)) is None
    found = belied(model, known(arm(0.0, 0.35)), arm(0.0, 0.35 + grown + 2.0 * E_P + 1e-3))
    assert found is not None and found.excess_m == pytest.approx(1e-3, abs=1e-6)


def test_a_jolt_is_held_against_the_relative_acceleration() -> None:
    gentle = limited(relative_acceleration=1.0)
    people = known(arm(0.0, 0.35), seen=20)
    assert np.isfinite(people["e_v"][0, 0, list(LEFT)]).all()
    e_v = 2.0 * float(people["e_v"][0, 0, LEFT[0]])
    grown = 2.0 * E_P + e_v * 0.05 + 0.5 * 0.05**2
    assert belied(gentle, people, arm(0.0, 0.35 + grown + 2.0 * E_P - 1e-6)) is None
    assert grown < 2.0 * E_P + 2.46 * 0.05, "else speed would be the narrower limit"
    assert belied(gentle, people, arm(0.0, 0.35 + grown + 2.0 * E_P + 1e-3)) is not None


def test_only_the_window_and_whole_arms_are_looked_at() -> None:
    model = limited(angular_speed=0.1, relative_speed=0.1)
    people = known(arm(0.0))
    turned = arm(1.0)
    assert belied(model, people, turned) is not None
    assert belied(model, people, turned, t=1.5) is None
    assert belied(model, people, turned, t=0.0) is None
    for point in LEFT:
        partly = turned.copy()
        partly[point] = np.nan
        assert belied(model, people, partly) is None
    unseen = people.copy()
    unseen["present"][0, 0] &= ~np.uint32(1 << LEFT[1])
    assert belied(model, unseen, turned) is None


def test_the_published_face_and_the_speed_model_claim_nothing_more() -> None:
    people = known(arm(0.0))
    assert belied(ArmReach(TUM, face="as_published"), people, arm(2.0)) is None
    assert belied(ArticulatedVelocity(TUM), people, arm(2.0)) is None


def test_accelerations_are_held_against_every_point() -> None:
    people = known(standing(), seen=20)
    moved = standing()
    moved[Point.R_KNEE, 0] += 0.5
    found = belied(ArticulatedAcceleration(TUM), people, moved)
    assert found is not None and found.point is Point.R_KNEE
    assert belied(ArticulatedAcceleration(TUM), people, standing()) is None
