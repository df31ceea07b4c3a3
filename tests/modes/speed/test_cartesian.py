"""Lines of the tool against pinocchio's kinematics and finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from modes.speed.cartesian import RAMP_S, Line, follow_lines
from modes.tool_frame import ToolFrame
from robots.errors import SetupError
from robots.model import RobotModel
from tests.robots.pin_oracle import PinArm, urdf_of

BEGIN = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
ALONG_Y = Line(np.array([0.0, 0.12, 0.0]), 0.05)


def test_the_tool_goes_straight_at_its_speed(arm: Callable[[str], RobotModel]) -> None:
    robot, pin = arm("ra605"), PinArm(urdf_of("ra605"))
    path = follow_lines(robot, BEGIN, (ALONG_Y, Line(np.zeros(3), 0.0, 0.3), Line(-ALONG_Y.way, 0.05)))
    duration = 0.12 / 0.05 + RAMP_S
    assert path.s_end == pytest.approx(2 * duration + 0.3)
    for s in np.linspace(0.0, path.s_end, 333):
        q, dq, _ddq, _ = path.sample(s)
        pin.place(dict(zip(robot.joints, q.tolist(), strict=True)), dict(zip(robot.joints, dq, strict=True)))
        pose = pin.pose(robot.joints[-1])
        np.testing.assert_allclose(pose.translation[[0, 2]], [0.368, 0.755], atol=2e-6)
        np.testing.assert_allclose(pose.rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=2e-5)
        assert -1e-6 <= pose.translation[1] <= 0.12 + 1e-6
        speed = np.linalg.norm(pin.velocity(robot.joints[-1])[1])
        if RAMP_S <= s <= duration - RAMP_S:
            assert speed == pytest.approx(0.05, abs=1e-4)
            assert pose.translation[1] == pytest.approx(0.05 * (s - RAMP_S / 2), abs=1e-5)
    for s in (0.0, duration + 0.1, path.s_end):
        assert np.abs(path.sample(s)[1]).max() < 1e-9


def test_between_the_ramps_the_tool_is_not_accelerated(arm: Callable[[str], RobotModel]) -> None:
    """Difference quotients of its velocity beside every knot."""
    robot, pin = arm("ra605"), PinArm(urdf_of("ra605"))
    path = follow_lines(robot, BEGIN, (ALONG_Y,))

    def velocity(s: float) -> np.ndarray:
        q, dq, _, _ = path.sample(s)
        pin.place(dict(zip(robot.joints, q.tolist(), strict=True)), dict(zip(robot.joints, dq, strict=True)))
        return np.asarray(pin.velocity(robot.joints[-1])[1])

    for s in path.breaks[6:-6].tolist():
        change = (velocity(s + 1e-4) - velocity(s - 1e-4)) / 2e-4
        assert np.abs(change).max() < 1e-3, s


def test_derivatives_of_the_share_are_those_of_its_value() -> None:
    t, h = np.linspace(0.01, ALONG_Y.duration - 0.01, 300), 1e-5
    for x in t.tolist():
        before, at, after = ALONG_Y.share(x - h), ALONG_Y.share(x), ALONG_Y.share(x + h)
        assert (after[0] - before[0]) / (2 * h) == pytest.approx(at[1], abs=1e-6)
        assert (after[1] - before[1]) / (2 * h) == pytest.approx(at[2], abs=1e-3)
    assert ALONG_Y.share(0.0) == (0.0, 0.0, 0.0)
    assert ALONG_Y.share(ALONG_Y.duration) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


def test_the_papers_second_experiment_is_within_reach(arm: Callable[[str], RobotModel]) -> None:
    """(594.5, -266, 404.9) mm, down to 105 mm, and to y = 174 mm (section V B)."""
    frame = ToolFrame(arm("ra605"))
    rotation, place = frame.pose(BEGIN)
    flange = place - (0.0, 0.0, 0.0865)
    for to in ((0.5945, -0.266, 0.4049), (0.5945, -0.266, 0.105), (0.5945, 0.174, 0.105)):
        q = frame.solve(rotation, place + np.array(to) - flange, BEGIN)
        np.testing.assert_allclose(frame.pose(q)[1] - (0, 0, 0.0865), to, atol=1e-9)


def test_what_cannot_be_followed_is_refused(arm: Callable[[str], RobotModel]) -> None:
    robot = arm("ra605")
    with pytest.raises(SetupError, match="no configuration is found at"):
        follow_lines(robot, BEGIN, (Line(np.array([0.6, 0.0, 0.0]), 0.2),))
    with pytest.raises(SetupError, match=r"a line of 0\.001 m at 0\.05 m/s is too short"):
        follow_lines(robot, BEGIN, (Line(np.array([0.0, 0.001, 0.0]), 0.05),))
    with pytest.raises(SetupError, match="panda has 7 joints: poses are solved for arms of six"):
        ToolFrame(arm("panda")).solve(np.eye(3), np.zeros(3), np.zeros(7))
    frame = ToolFrame(robot)
    turned = frame.pose(np.array([math.pi, 0.0, 0.0, 0.0, -math.pi / 2, 0.0]))
    with pytest.raises(SetupError, match="joint ra605_joint_1 is beyond its limits"):
        frame.solve(*turned, np.array([3.0, 0.0, 0.0, 0.0, -math.pi / 2, 0.0]))
