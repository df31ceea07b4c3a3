"""Forward kinematics and velocities against pinocchio and a plain NumPy twin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from robots.catalog import RobotSetup, load_robot, robot_names
from robots.kernels import forward, velocities
from robots.model import Mount, RobotModel
from tests.robots.made_up import full_limits, random_tree
from tests.robots.pin_oracle import FILES, OWN, PinArm, urdf_of

Array = NDArray[np.float64]


def rodrigues(axis: Array, angle: float) -> Array:
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)


def twin(model: RobotModel, q: Array) -> tuple[Array, Array]:
    """What `forward` computes, joint by joint with matrices."""
    tree = model.kinematics[0]
    rotations, positions = np.zeros((len(q), 3, 3)), np.zeros((len(q), 3))
    for i, parent in enumerate(tree["parent"][: tree["n"]]):
        turn, at = (np.eye(3), np.zeros(3)) if parent < 0 else (rotations[parent], positions[parent])
        turn, at = turn @ tree["rotation"][i], at + turn @ tree["translation"][i]
        if tree["prismatic"][i]:
            at = at + turn @ tree["axis"][i] * q[i]
        else:
            turn = turn @ rodrigues(tree["axis"][i], q[i])
        rotations[i], positions[i] = turn, at
    return rotations, positions


def compare(model: RobotModel, oracle: PinArm, rng: np.random.Generator, number: int) -> None:
    n = len(model.joints)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    angular, linear = np.zeros((n, 3)), np.zeros((n, 3))
    for _ in range(number):
        q, dq = rng.uniform(-7, 7, n), rng.uniform(-3, 3, n)
        forward(model.kinematics, q, rotations, positions)
        velocities(model.kinematics, dq, rotations, positions, angular, linear)
        for found, expected in zip((rotations, positions), twin(model, q), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)
        oracle.place(dict(zip(model.joints, q, strict=True)), dict(zip(model.joints, dq, strict=True)))
        for i, joint in enumerate(model.joints):
            np.testing.assert_allclose(rotations[i], oracle.pose(joint).rotation, atol=1e-12)
            np.testing.assert_allclose(positions[i], oracle.pose(joint).translation, atol=1e-11)
            expected_angular, expected_linear = oracle.velocity(joint)
            np.testing.assert_allclose(angular[i], expected_angular, atol=1e-11)
            np.testing.assert_allclose(linear[i], expected_linear, atol=1e-10)


@pytest.mark.parametrize("name", sorted((*FILES, *OWN)))
def test_every_arm_of_the_catalogue_moves_as_in_pinocchio(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    assert name in robot_names()
    compare(arm(name), PinArm(urdf_of(name)), rng, count(10_000))


def test_all_arms_of_the_catalogue_are_compared() -> None:
    assert robot_names() == tuple(sorted((*FILES, *OWN)))
    ur = {"ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e"}
    assert ur | {"panda", "fr3", "kr5_sixx", "lwa4p", "ra605"} == {*FILES, *OWN}


def test_made_up_trees_on_a_mount_move_as_in_pinocchio(
    write_urdf: Callable[[str], Path], cache_dir: Path, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(300)):
        path = write_urdf(random_tree(rng, int(rng.integers(1, 8))))
        xyz, rpy = rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3)
        turn = pinocchio.rpy.rpyToMatrix(*np.deg2rad(rpy))
        oracle = PinArm(path, pinocchio.SE3(turn, xyz))
        joints = list(oracle.model.names)[1:]
        slides = ["P" in oracle.model.joints[i + 1].shortname() for i in range(len(joints))]
        setup = RobotSetup(
            limits=full_limits(joints, slides), mount=Mount.from_xyz_rpy(xyz, rpy), cache_dir=cache_dir
        )
        compare(load_robot(path, setup=setup), oracle, rng, 5)


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_value_that_is_no_number_spreads_to_all_links_after_it(
    joint: int, arm: Callable[[str], RobotModel]
) -> None:
    model = arm("ur5")
    q = np.zeros(6)
    q[joint] = np.nan
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    forward(model.kinematics, q, rotations, positions)
    assert np.isnan(rotations[joint:]).any(axis=(1, 2)).all()
    assert np.isnan(positions[joint + 1 :]).any(axis=1).all()
    assert np.isfinite(rotations[:joint]).all() and np.isfinite(positions[: joint + 1]).all()


def test_a_speed_that_is_no_number_spreads_to_all_links_after_it(arm: Callable[[str], RobotModel]) -> None:
    model = arm("ur5")
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    angular, linear = np.zeros((6, 3)), np.zeros((6, 3))
    forward(model.kinematics, np.zeros(6), rotations, positions)
    velocities(model.kinematics, np.array([0, 0, np.nan, 0, 0, 0.0]), rotations, positions, angular, linear)
    assert np.isnan(angular[2:]).any(axis=1).all() and np.isfinite(angular[:2]).all()
    assert np.isnan(linear[3:]).any(axis=1).all() and np.isfinite(linear[:3]).all()
