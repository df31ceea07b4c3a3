"""The arm of the adversary: kinematics and surface from the oracles, laid out for kernels."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.catalog import RobotSetup, load_robot
from robots.model import Mount, RobotModel
from tests.oracles.arms import MESH_ARMS, PANDA_JOINTS, UR_JOINTS
from tests.oracles.arms import arm as oracle_arm
from tests.oracles.urdf_arm import MOVABLE, Arm, Joint, _read_joint

Array = NDArray[np.float64]

ROBOTS = ("ur3", "ur5", "ur10", "panda", "lwa4p")
MAX_JOINTS, MAX_LINKS = 8, 12
CLUSTER = 32
"""Points in a cluster."""
MOUNTS = (Mount(), Mount.from_xyz_rpy((0.1, -0.2, 0.6), (0.0, 0.0, 40.0)))
ARM = np.dtype(
    [
        ("n", np.int64),
        ("links", np.int64),
        ("rotation", np.float64, (MAX_JOINTS, 3, 3)),
        ("translation", np.float64, (MAX_JOINTS, 3)),
        ("axis", np.float64, (MAX_JOINTS, 3)),
        ("reach", np.float64, (MAX_JOINTS,)),
        ("joint", np.int64, (MAX_LINKS,)),
        ("centre", np.float64, (MAX_LINKS, 3)),
        ("radius", np.float64, (MAX_LINKS,)),
        ("thickness", np.float64, (MAX_LINKS,)),
        ("first", np.int64, (MAX_LINKS + 1,)),
    ]
)
"""Serial chain: joint i stands in the frame of joint i - 1 at ``rotation`` and ``translation`` [m] and turns
about ``axis``. ``reach`` [m]: no point of the arm is farther from that axis. Link l hangs on ``joint`` l, is
in the ball ``centre``, ``radius`` [m, frame of the joint], and has the clusters ``first`` l to ``first`` l+1;
it is all that is within ``thickness`` [m] of its points."""


class Surface:
    """One arm: ARM block, and the clusters of its surface points, all in joint frames.

    ``centre`` (C, 3), ``radius`` (C,), ``points`` (C, 32, 3) [m].
    """

    def __init__(self, chain: list[tuple[Array, Array]], links: list[tuple[int, Array, float]]) -> None:
        self.block: NDArray[np.void] = np.zeros(1, dtype=ARM)
        rec = self.block[0]
        rec["n"], rec["links"] = len(chain), len(links)
        for i, (pose, axis) in enumerate(chain):
            rec["rotation"][i], rec["translation"][i] = pose[:3, :3], pose[:3, 3]
            rec["axis"][i] = axis
        clusters: list[Array] = []
        for number, (joint, points, thickness) in enumerate(links):
            rec["joint"][number], rec["thickness"][number] = joint, thickness
            rec["centre"][number], rec["radius"][number] = ball(points)
            clusters += halve(points)
            rec["first"][number + 1] = len(clusters)
        self.points = np.ascontiguousarray(
            [np.concatenate([each, np.repeat(each[:1], CLUSTER - len(each), axis=0)]) for each in clusters]
        )
        balls = [ball(each) for each in clusters]
        self.centre = np.ascontiguousarray([centre for centre, _ in balls])
        self.radius = np.array([radius for _, radius in balls])
        rec["reach"][: len(chain)] = self._reach(links)

    def _reach(self, links: list[tuple[int, Array, float]]) -> list[float]:
        """Length of the chain beyond each joint, to the farthest surface point."""
        rec = self.block[0]
        lengths = np.linalg.norm(rec["translation"], axis=1)
        found = []
        for i in range(int(rec["n"])):
            ends = [
                lengths[i + 1 : joint + 1].sum() + np.linalg.norm(points, axis=1).max() + thickness
                for joint, points, thickness in links
                if joint >= i
            ]
            found.append(float(max(ends)))
        return found


def ball(points: Array) -> tuple[Array, float]:
    """A ball around points (N, 3)."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


def halve(points: Array) -> list[Array]:
    """Halve points (N, 3) across their longest side until no group is larger than a cluster."""
    if len(points) <= CLUSTER:
        return [points]
    order = np.argsort(points[:, int(np.argmax(np.ptp(points, axis=0)))], kind="stable")
    half = len(points) // 2
    return halve(points[order[:half]]) + halve(points[order[half:]])


@cache
def surface(name: str, mounted: int, opening: float = 0.0) -> Surface:
    """An arm by its name, on one of the mounts; ``opening`` [m]: of the fingers, if it has some."""
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = MOUNTS[mounted].rotation, MOUNTS[mounted].translation
    if name in MESH_ARMS:
        return _of_meshes(oracle_arm(name), UR_JOINTS if name != "panda" else PANDA_JOINTS, base, opening)
    return _of_capsules(base)


def _of_meshes(arm: Arm, joints: tuple[str, ...], base: Array, opening: float) -> Surface:
    chain, links, before = [], [], arm._tree[joints[0]].parent
    for name in joints:
        joint = arm._tree[name]
        pose = _fixed(arm, before, joint.parent, opening) @ joint.origin
        chain.append((base @ _fixed_base(arm, before) @ pose if not chain else pose, joint.axis))
        before = joint.child
    for link, points in zip(arm.links, arm.points, strict=True):
        above = [joint.name for joint in arm._chain(link) if joint.name in joints]
        index = joints.index(above[-1])
        pose = _fixed(arm, arm._tree[above[-1]].child, link, opening)
        links.append((index, points @ pose[:3, :3].T + pose[:3, 3], 0.0))
    return Surface(chain, links)


def _fixed_base(arm: Arm, link: str) -> Array:
    pose = np.eye(4)
    for joint in arm._chain(link):
        pose = pose @ joint.origin
    return pose


def _fixed(arm: Arm, above: str, link: str, opening: float) -> Array:
    """Pose (4, 4) of a link in the frame of one above it, with only fixed joints and fingers between."""
    pose = np.eye(4)
    while link != above:
        joint: Joint = arm._above[link]
        local = joint.origin.copy()
        if joint.kind in MOVABLE:
            assert joint.kind == "prismatic", "only fingers may stand between"
            local[:3, 3] += local[:3, :3] @ joint.axis * opening
        pose, link = local @ pose, joint.parent
    return pose


def _of_capsules(base: Array) -> Surface:
    """The arm LWA 4P, of which no meshes are at hand: it fills the capsules that are published."""
    folder = Path(__file__).parents[2] / "robots" / "models"
    table = tomllib.loads((folder / "lwa4p.toml").read_text(encoding="utf-8"))
    root = ElementTree.parse(folder / "lwa4p.urdf").getroot()
    tree = {joint.name: joint for joint in map(_read_joint, root.findall("joint"))}
    chain = [(tree[name].origin, tree[name].axis) for name in table["joints"]]
    chain[0] = (base @ chain[0][0], chain[0][1])
    children = [tree[name].child for name in table["joints"]]
    links = []
    for row in table["enclosure"]:
        a, b = np.array(row["a_m"]), np.array(row["b_m"])
        points = a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a)
        links.append((children.index(row["link"]), points, float(row["radius_m"])))
    return Surface(chain, links)


@cache
def model(name: str, mounted: int) -> RobotModel:
    """The same arm as the supervisor knows it."""
    return load_robot(name, setup=RobotSetup(bare_flange=True, mount=MOUNTS[mounted]))
