"""Place, axes and Jacobian of a tool against pinocchio, for six and seven joints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from modes.tool_frame import ToolFrame
from robots.model import RobotModel
from tests.robots.pin_oracle import PinArm, urdf_of


@pytest.mark.parametrize("name", ["ra605", "panda", "ur5"])
def test_a_tool_is_where_pinocchio_has_it_and_moves_as_it_says(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    robot, pin = arm(name), PinArm(urdf_of(name))
    low, high = robot.limits.position_lower, robot.limits.position_upper
    for _ in range(count(1000)):
        local = rng.uniform(-0.2, 0.2, 3)
        frame = ToolFrame(robot, local)
        q, dq = rng.uniform(low, high), rng.normal(size=len(robot.joints))
        rotation, place, jacobian = frame.at(q)
        pin.place(dict(zip(robot.joints, q.tolist(), strict=True)), dict(zip(robot.joints, dq, strict=True)))
        pose = pin.pose(robot.joints[-1])
        np.testing.assert_allclose(rotation, pose.rotation, atol=1e-9)
        np.testing.assert_allclose(place, pose.act(local), atol=1e-9)
        angular, linear = pin.velocity(robot.joints[-1])
        moved = np.concatenate((linear + np.cross(angular, rotation @ local), angular))
        np.testing.assert_allclose(jacobian @ dq, moved, atol=1e-8)
        again, there = frame.pose(q)
        assert (again == rotation).all() and (there == place).all()
