"""Arms made from published figures: Denavit-Hartenberg tables, reach, weights; a recorded tool centre."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.assumption import Certainty
from robots.catalog import load_masses
from robots.errors import SetupError
from robots.inertia import Payload
from robots.kernels import forward
from robots.model import RobotModel
from tests.conftest import Some

Array = NDArray[np.float64]
DEGREE = np.pi / 180

UR = {
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
}
"""d1, a2, a3, d4, d5, d6 [m]: Universal Robots, DH parameters for calculations of kinematics and dynamics."""
FR3 = (
    (0, 0.333, 0),
    (0, 0, -1),
    (0, 0.316, 1),
    (0.0825, 0, 1),
    (-0.0825, 0.384, -1),
    (0, 0, 1),
    (0.088, 0, 1),
)
"""a [m], d [m], alpha [π/2] after Craig, then a flange at 0.107 m: Franka's documentation of the FR3."""
RA605 = (
    (0, 0, 0.375),
    (-1, 0.03, 0),
    (0, 0.34, 0),
    (-1, 0.04, 0.338),
    (1, 0, 0),
    (-1, 0, 0.0865),
)
"""alpha [π/2], a [m], d [m] after Craig: HIWIN's lengths; axis 2 is at -π/2 where ours is at 0.

Joints 2, 3, 5 turn the other way there: positive lifts, as in the maker's URDF."""
KR5_SIXX = (
    (0, 0.335, 0.075, -1),
    (-1, 0, 0.27, 0),
    (0, 0, 0.09, 1),
    (0, -0.295, 0, -1),
    (0, 0, 0, 1),
    (0, -0.08, 0, 2),
)
"""Offset [π/2], d [m], a [m], alpha [π/2] after Denavit and Hartenberg: ARTE, parameters.m."""
WITH_MASSES = (*UR, "fr3")
ARMS = (*WITH_MASSES, "kr5_sixx", "ra605")


def screw(axis: int, angle: float, along: float) -> Array:
    """Turn by ``angle`` [rad] about a coordinate axis and shift by ``along`` [m] on it."""
    pose = np.eye(4)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    pose[j, j] = pose[k, k] = np.cos(angle)
    pose[k, j] = np.sin(angle)
    pose[j, k] = -np.sin(angle)
    pose[axis, 3] = along
    return pose


def flange_of_ur(name: str, q: Array) -> Array:
    """Pose (4, 4) of the flange in the controller's base: Rz(q) Tz(d) Tx(a) Rx(alpha), joint by joint."""
    d1, a2, a3, d4, d5, d6 = UR[name]
    d, a = (d1, 0, 0, d4, d5, d6), (0, a2, a3, 0, 0, 0)
    pose = np.eye(4)
    for j, quarter in enumerate((1, 0, 0, 1, -1, 0)):
        pose = pose @ screw(2, q[j], d[j]) @ screw(0, quarter * np.pi / 2, a[j])
    return pose


def flange_of_fr3(q: Array) -> Array:
    """Pose (4, 4) of the flange in the base: Rx(alpha) Tx(a) Rz(q) Tz(d), joint by joint."""
    pose = np.eye(4)
    for j, (a, d, quarter) in enumerate(FR3):
        pose = pose @ screw(0, quarter * np.pi / 2, a) @ screw(2, q[j], d)
    return pose @ screw(2, 0.0, 0.107)


def flange_of_ra605(q: Array) -> Array:
    """Pose (4, 4) of the flange in the base: Rx(alpha) Tx(a) Rz(q) Tz(d), joint by joint."""
    pose = np.eye(4)
    turned = q * (1, -1, -1, 1, -1, 1) - (0, np.pi / 2, 0, 0, 0, 0)
    for angle, (quarter, a, d) in zip(turned, RA605, strict=True):
        pose = pose @ screw(0, quarter * np.pi / 2, a) @ screw(2, angle, d)
    return pose


def flange_of_kr5_sixx(q: Array) -> Array:
    """Pose (4, 4) of the flange in the base: Rz(q + offset) Tz(d) Tx(a) Rx(alpha), joint by joint."""
    pose = np.eye(4)
    for angle, (offset, d, a, quarter) in zip(q, KR5_SIXX, strict=True):
        pose = pose @ screw(2, angle + offset * np.pi / 2, d) @ screw(0, quarter * np.pi / 2, a)
    return pose


def published(name: str, q: Array) -> Array:
    """Pose of the flange in the frame of our base; a UR's looks the other way than its controller's."""
    if name == "ra605":
        return flange_of_ra605(q)
    if name == "kr5_sixx":
        return flange_of_kr5_sixx(q)
    return flange_of_fr3(q) if name == "fr3" else screw(2, np.pi, 0.0) @ flange_of_ur(name, q)


def ours(model: RobotModel, q: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and place (3,) of the flange."""
    n = len(model.joints)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    forward(model.kinematics, q, rotations, positions)
    flange = np.eye(4)
    if model.name == "fr3":
        flange = screw(2, 0.0, 0.107)
    elif model.name == "ra605":  # along x of its last joint, tool down where that points down
        flange = screw(0, 0.0, 0.0865) @ screw(1, -np.pi / 2, 0.0) @ screw(0, np.pi, 0.0)
    elif model.name == "kr5_sixx":
        flange = screw(2, 0.0, -0.08) @ screw(0, np.pi, 0.0)
    return rotations[-1] @ flange[:3, :3], positions[-1] + rotations[-1] @ flange[:3, 3]


@pytest.mark.parametrize("name", ARMS)
def test_the_flange_is_where_the_published_parameters_put_it(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    model = arm(name)
    for _ in range(count(20_000)):
        q = rng.uniform(-15.0, 15.0, len(model.joints))
        pose, (rotation, place) = published(name, q), ours(model, q)
        np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose(place, pose[:3, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "velocity", "torque"),
    [
        ("ur3e", [180, 180, 180, 360, 360, 360], [54, 54, 28, 9, 9, 9]),
        ("ur5e", [180] * 6, [150, 150, 150, 28, 28, 28]),
        ("ur10e", [120, 120, 180, 180, 180, 180], [330, 330, 150, 54, 54, 54]),
        ("ur16e", [120, 120, 180, 180, 180, 180], [330, 330, 150, 54, 54, 54]),
    ],
)
def test_published_limits_of_the_e_series(
    name: str, velocity: list[float], torque: list[float], arm: Callable[[str], RobotModel]
) -> None:
    """Figures of the maker's ROS 2 description; wrist 3 of the UR3e turns endlessly."""
    model = arm(name)
    np.testing.assert_allclose(model.limits.velocity / DEGREE, velocity)
    np.testing.assert_allclose(model.limits.torque, torque)
    np.testing.assert_allclose(model.limits.position_upper[:5] / DEGREE, [360, 360, 180, 360, 360])
    assert model.limits.position_upper[5] == (np.inf if name == "ur3e" else pytest.approx(2 * np.pi))
    assert (model.limits.position_lower == -model.limits.position_upper).all()
    assert model.assumed_limits == ("acceleration", "jerk") and model.assumed_enclosure


def test_published_limits_of_the_ra605(arm: Callable[[str], RobotModel]) -> None:
    """Figures of the maker's ROS description."""
    model = arm("ra605")
    limits = model.limits
    np.testing.assert_allclose(limits.position_lower / DEGREE, [-165, -125, -55, -190, -115, -360])
    np.testing.assert_allclose(limits.position_upper / DEGREE, [165, 85, 185, 190, 115, 360])
    np.testing.assert_allclose(limits.velocity / DEGREE, [360, 288, 420, 444, 450, 720])
    np.testing.assert_allclose(limits.torque, [56, 56, 56, 8.4, 8.4, 5.56])
    assert model.assumed_limits == ("acceleration", "jerk") and model.assumed_enclosure


def test_the_ra605_holds_its_tool_down_where_the_paper_begins(arm: Callable[[str], RobotModel]) -> None:
    """Chan and Tsai 2020, section IV A: (368, 0, 668.5) mm, roll 180 degrees; and a reach of 710 mm."""
    rotation, place = ours(arm("ra605"), np.deg2rad([0, 0, 0, 0, -90, 0]))
    np.testing.assert_allclose(place, [0.368, 0.0, 0.6685], atol=1e-12)
    np.testing.assert_allclose(rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    stretched = np.zeros(6)
    stretched[1] = -np.pi / 2
    stretched[2] = np.pi / 2 - np.arctan2(0.04, 0.338)
    wrist = ours(arm("ra605"), stretched)[1] - ours(arm("ra605"), stretched)[0] @ [0.0, 0.0, 0.0865]
    assert np.hypot(*wrist[:2]) == pytest.approx(0.71, abs=1e-3)


def test_the_kr5_sixx_has_the_speeds_and_the_reach_of_its_source(arm: Callable[[str], RobotModel]) -> None:
    """ARTE's; at zero the upper arm is upright, and R650 is what the name says its wrist reaches."""
    model = arm("kr5_sixx")
    np.testing.assert_allclose(model.limits.velocity / DEGREE, [375, 300, 375, 410, 410, 660])
    assert np.isinf(model.limits.torque).all()
    assert model.assumed_limits == ("acceleration", "jerk") and model.assumed_enclosure
    np.testing.assert_allclose(ours(model, np.zeros(6))[1], [0.45, 0.0, 0.695], atol=1e-12)
    stretched = np.zeros(6)
    stretched[2] = -np.arctan2(0.295, 0.09)
    rotation, place = ours(model, stretched)
    wrist = place - rotation @ [0.0, 0.0, 0.08] - (0.075, 0.0, 0.335)
    assert 0.075 + np.linalg.norm(wrist) == pytest.approx(0.65, abs=4e-3)


def test_limits_of_the_kr5_sixx_count_from_where_the_maker_counts(arm: Callable[[str], RobotModel]) -> None:
    """ARTE has -190 to 45 and -119 to 165 degrees; the maker's zero: upper arm and forearm level."""
    model = arm("kr5_sixx")
    level = np.array([0.0, 90.0, -90.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        model.limits.position_lower / DEGREE - level, [-170, -190, -119, -190, -120, -358]
    )
    np.testing.assert_allclose(model.limits.position_upper / DEGREE - level, [170, 45, 165, 190, 120, 358])
    _rotation, place = ours(model, level * DEGREE)
    np.testing.assert_allclose(place, [0.075 + 0.27 + 0.295 + 0.08, 0.0, 0.335 + 0.09], atol=1e-12)
    behind = level.copy()
    behind[1] -= 190.0
    n = len(model.joints)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    forward(model.kinematics, behind * DEGREE, rotations, positions)
    assert positions[2, 2] == pytest.approx(0.335 - 0.27 * np.sin(10.0 * DEGREE)), "behind, ten degrees down"


OLDER = (
    (0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35),
    (-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
    (2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
)
NEWER = (
    (0.6599, 0.2517, 0.2000, 0.3533, 0.5757, 0.4878, 0.4628),
    (-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508),
    (2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508),
)
"""Velocity offset [rad/s], ends of the range [rad]: libfranka, rate_limiting.h; Franka's documentation."""
BRAKING = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
FASTEST = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)


@pytest.mark.parametrize("edition", [OLDER, NEWER], ids=["older", "newer"])
def test_the_fr3_admits_its_velocity_on_all_of_its_range(
    edition: tuple[tuple[float, ...], ...], arm: Callable[[str], RobotModel], rng: np.random.Generator
) -> None:
    """The maker's formula for the largest velocity at a position, as he publishes it and as he did before."""
    limits = arm("fr3").limits
    share = np.vstack([np.zeros(7), np.ones(7), rng.random((1000, 7))])
    q = limits.position_lower + share * (limits.position_upper - limits.position_lower)
    (offset, lower, upper), braking, fastest = map(np.array, edition), np.array(BRAKING), np.array(FASTEST)
    for room in (upper - q, q - lower):
        admitted = np.minimum(fastest, -offset + np.sqrt(2.0 * braking * room))
        smallest = admitted.min(axis=0)
        assert (smallest >= limits.velocity - 2e-4).all(), smallest
        if edition is OLDER:
            assert (smallest <= 1.06 * limits.velocity).all(), "smaller than it must be"
    assert arm("fr3").assumed_limits == () and arm("fr3").assumed_enclosure


@pytest.mark.parametrize(
    ("name", "reach"), [("ur3e", 0.5), ("ur5e", 0.85), ("ur10e", 1.3), ("ur16e", 0.9), ("fr3", 0.855)]
)
def test_the_published_reach_lies_between_the_stretched_arm_and_its_flange(
    name: str, reach: float, arm: Callable[[str], RobotModel], rng: np.random.Generator
) -> None:
    """Makers' data sheets, as recalled [m]. A UR's is rounded, and ends about at the wrist.

    The FR3's is its flange, from where axes 1 and 2 meet.
    """
    model = arm(name)
    low = np.maximum(model.limits.position_lower, -np.pi)
    high = np.minimum(model.limits.position_upper, np.pi)
    shoulder = np.array([0.0, 0.0, 0.333 if name == "fr3" else UR[name][0]])

    def away(q: Array) -> float:
        return float(np.linalg.norm(ours(model, q)[1] - shoulder))

    best = max((rng.uniform(low, high) for _ in range(200)), key=away)
    for step in np.geomspace(0.5, 1e-3, 1500):
        trial = np.clip(best + rng.normal(scale=step, size=len(best)), low, high)
        best = max(best, trial, key=away)
    if name == "fr3":
        assert away(best) == pytest.approx(reach, abs=0.01)
    else:
        stretched = -UR[name][1] - UR[name][2]
        assert stretched < reach < away(best)


@pytest.mark.parametrize(
    ("name", "weight"), [("ur3e", 11.2), ("ur5e", 20.6), ("ur10e", 33.5), ("ur16e", 33.1), ("fr3", 17.8)]
)
def test_what_moves_is_most_of_the_weight_of_the_arm(name: str, weight: float) -> None:
    """Makers' data sheets, as recalled [kg]: the base does not move, and the cable is not modelled."""
    assert 0.75 * weight < load_masses(name, Payload(0.0)).moving_kg < weight


@pytest.mark.parametrize(
    ("name", "rated"), [("ur3e", 3.0), ("ur5e", 5.0), ("ur10e", 12.5), ("ur16e", 16.0), ("fr3", 3.0)]
)
def test_more_than_the_rated_payload_is_refused(name: str, rated: float) -> None:
    assert load_masses(name, Payload(rated)).payload.mass_kg == rated
    with pytest.raises(SetupError, match=f"beyond the rated payload of {rated:g} kg"):
        load_masses(name, Payload(1.01 * rated))


def axes(model: RobotModel, q: Array) -> Array:
    """Points (L, 21, 3) [m] along the axis of each capsule in the world."""
    n = len(model.joints)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    forward(model.kinematics, q, rotations, positions)
    rows, share = model.enclosure[0], np.linspace(0.0, 1.0, 21)[:, None]
    placed = []
    for i in range(rows["n"]):
        joint, local = rows["joint"][i], rows["a"][i] + share * (rows["b"][i] - rows["a"][i])
        placed.append(local @ rotations[joint].T + positions[joint])
    return np.array(placed)


@pytest.mark.parametrize("name", WITH_MASSES)
def test_links_hold_their_centres_of_mass_and_each_other(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Two sources agree: one has the masses, another one the capsules; here without what was added.

    The maker's masses of the FR3 make its torques, not its shape: that of link 7 lies 7 cm below its mesh.
    """
    model, masses = arm(name), load_masses(name, Payload(0.0))
    rows = model.enclosure[0]
    bare = rows["radius"][: rows["n"]] - (0.04 if name in ("ur10e", "ur16e") else 0.02)
    assert list(rows["joint"][: rows["n"]]) == list(range(len(model.joints))) and (bare > 0.03).all()
    assert {a.certainty for a in model.assumptions if ".enclosure." in a.name} == {Certainty.ASSUMED}
    for body, a, b, radius in zip(masses.bodies, rows["a"], rows["b"], bare, strict=False):
        along = np.clip((body.com_m - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0.0, 1.0)
        outside = np.linalg.norm(body.com_m - a - along * (b - a)) >= radius
        assert outside == (model.joints[body.joint] == "fr3_joint7"), model.joints[body.joint]
    for _ in range(count(500)):
        placed = axes(model, rng.uniform(-np.pi, np.pi, len(model.joints)))
        for i, (here, there) in enumerate(pairwise(placed)):
            gap = np.linalg.norm(here[:, None] - there, axis=2).min() - bare[i] - bare[i + 1]
            assert gap < 0.0, (model.links[i], gap)


def test_the_e_series_lies_where_the_series_before_it_does(
    arm: Callable[[str], RobotModel], rng: np.random.Generator, some: Some
) -> None:
    """The enclosures of the older arms are proven around their meshes, in link frames of another description.

    Both stand on the same base but for d1; what else differs, d4 to d6 above all, is below 0.06 m.
    """
    older_d1 = {"ur3": 0.1519, "ur5": 0.089159, "ur10": 0.1273}
    for older in some(sorted(older_d1)):
        newer = arm(f"{older}e")
        higher = np.array([0.0, 0.0, UR[newer.name][0] - older_d1[older]])
        for _ in range(20):
            q = rng.uniform(-np.pi, np.pi, 6)
            away = axes(newer, q).mean(axis=1) - axes(arm(older), q).mean(axis=1) - higher
            assert np.linalg.norm(away, axis=1).max() < 0.06, (newer.name, away)


@pytest.mark.real_data
def test_a_recorded_tool_centre_point_of_a_ur3e(real_data: Path, arm: Callable[[str], RobotModel]) -> None:
    """A controller's own pose of the tool beside its joint angles, wrist 3 at 12.6 rad.

    Nobody has noted the tool, so it is taken from the first row: a fixed place on the flange, not turned.
    """
    with gzip.open(real_data / "robot/ur3e_rad_rtde_L0L1.csv.gz", "rt", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))

    def table(name: str) -> Array:
        return np.array([[float(row[f"{name}_{k}"]) for k in range(6)] for row in rows])

    model, base = arm("ur3e"), screw(2, np.pi, 0.0)[:3, :3]
    q, pose = table("actual_q"), table("actual_TCP_pose")
    assert len(rows) > 20 and q[:, 5].min() > 12.0 and np.ptp(q[:, 0]) > 0.5
    tools = []
    for joints, seen in zip(q, pose, strict=True):
        rotation, place = ours(model, joints)
        angle = float(np.linalg.norm(seen[3:]))
        x, y, z = seen[3:] / angle
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turned = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
        # its own calibration: a few mrad and tenths of a millimetre
        np.testing.assert_allclose(base @ rotation, turned, atol=5e-3)
        tools.append((base @ rotation).T @ (seen[:3] - base @ place))
    assert 0.05 < tools[0][2] < 0.3
    np.testing.assert_allclose(tools, np.tile(tools[0], (len(tools), 1)), atol=3e-4)
