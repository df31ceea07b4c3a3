"""Joints, points and bones: there and back again, and what moves along with what."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.skeleton import (
    BONES,
    JOINTS,
    ROOT,
    Joint,
    bones_of,
    joints_of_bones,
    joints_of_points,
    points_of_joints,
)
from modes.reaching_person import report_of
from occupancy.body import Point
from robots.errors import SetupError

Array = NDArray[np.float64]


def somebody() -> Array:
    """Points (20, 3) of a person who reaches for a place."""
    return report_of(np.array([0.6, 0.1, 0.9]), 0.0, 0.0).people[0].xyz


def moved(points: Array, rotation: Rotation, way: Array) -> Array:
    return rotation.apply(points) + way


def test_every_joint_but_the_root_ends_one_bone() -> None:
    assert sorted(end for _begin, end in BONES) == sorted(set(Joint) - {ROOT})
    reached = {ROOT}
    for begin, end in BONES:
        assert begin in reached
        reached.add(end)


def test_bones_and_joints_there_and_back(rng: np.random.Generator) -> None:
    joints = rng.normal(size=(5, 7, JOINTS, 3))
    unit, length = bones_of(joints)
    assert np.allclose(np.linalg.norm(unit, axis=-1), 1.0)
    assert np.allclose(joints_of_bones(joints[..., ROOT, :], 3.0 * unit, length), joints, atol=1e-12)


def test_a_person_who_turns_and_walks_takes_all_points_along(rng: np.random.Generator) -> None:
    """Heads and hands are no joints; a rigid motion takes them along exactly but for the head's turn."""
    points = somebody()
    for _ in range(20):
        turned = Rotation.from_euler("z", rng.uniform(-3.0, 3.0))
        way = rng.normal(size=3)
        there = moved(points, turned, way)
        found = points_of_joints(joints_of_points(there)[None], points)[0]
        exact = [point for point in Point if point.name not in {"HEAD", "THORAX"}]
        tilted = [point for point in exact if "HAND" in point.name or "FINGER" in point.name]
        others = [point for point in exact if point not in tilted and point != Point.PELVIS]
        assert np.allclose(found[others], there[others], atol=1e-9)
        kept = np.linalg.norm(
            found[tilted] - found[[Point.L_WRIST, Point.L_WRIST, Point.R_WRIST, Point.R_WRIST]], axis=1
        )
        was = np.linalg.norm(
            there[tilted] - there[[Point.L_WRIST, Point.L_WRIST, Point.R_WRIST, Point.R_WRIST]], axis=1
        )
        assert np.allclose(kept, was)
    there = points + np.array([0.3, -0.2, 0.1])
    assert np.allclose(points_of_joints(joints_of_points(there)[None], points)[0], there)


def test_a_hand_turns_with_its_forearm() -> None:
    points = somebody()
    joints = joints_of_points(points)[None].copy()
    turned = Rotation.from_rotvec((0.0, 0.7, 0.0))
    elbow = joints[0, Joint.RAEL]
    joints[0, Joint.RWPS] = elbow + turned.apply(joints[0, Joint.RWPS] - elbow)
    found = points_of_joints(joints, points)[0]
    away = points[Point.R_HAND] - points[Point.R_ELBOW]
    lever = points[Point.R_WRIST] - points[Point.R_ELBOW]
    angle = np.arccos(away @ lever / np.linalg.norm(away) / np.linalg.norm(lever))
    now, arm = found[Point.R_HAND] - elbow, found[Point.R_WRIST] - elbow
    assert np.arccos(now @ arm / np.linalg.norm(now) / np.linalg.norm(arm)) == pytest.approx(angle)


def test_the_chest_is_before_and_the_seventh_vertebra_behind_the_neck() -> None:
    """Somebody who faces along x, left to y."""
    points = np.full((20, 3), np.nan)
    points[Point.NECK_BASE], points[Point.PELVIS] = (0.0, 0.0, 1.5), (0.0, 0.0, 1.0)
    points[Point.L_SHOULDER], points[Point.R_SHOULDER] = (0.0, 0.2, 1.45), (0.0, -0.2, 1.45)
    joints = joints_of_points(points)
    assert np.allclose(joints[Joint.CLAV], (0.06, 0.0, 1.5))
    assert np.allclose(joints[Joint.C7], (-0.06, 0.0, 1.5))
    assert np.allclose(joints[Joint.L3], (0.0, 0.0, 1.125))


def test_what_is_not_seen_stays_unknown() -> None:
    points = somebody()
    joints = joints_of_points(points)[None]
    points[Point.HEAD] = points[Point.L_ELBOW] = np.nan
    assert np.isnan(joints_of_points(points)[Joint.LAEL]).all()
    found = points_of_joints(joints, points)[0]
    assert np.isnan(found[[Point.HEAD, Point.L_ELBOW]]).all()
    assert np.isfinite(found[Point.R_WRIST]).all()


@pytest.mark.parametrize("shape", [(14, 3), (15, 2), (15,), (2, 16, 3)])
def test_other_skeletons_are_refused_by_what_they_should_be(shape: tuple[int, ...]) -> None:
    with pytest.raises(SetupError, match=r"should end with \(15, 3\): CLAV, C7"):
        bones_of(np.zeros(shape))


def test_other_points_are_refused() -> None:
    with pytest.raises(SetupError, match=r"\(14, 3\) should be \(..., 20, 3\)"):
        joints_of_points(np.zeros((14, 3)))
