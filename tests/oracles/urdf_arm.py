"""An arm as the brute-force checker sees it: a URDF read by hand, plain kinematics, points on the meshes."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tests.oracles.mesh_points import (
    ball_triangles,
    box_triangles,
    cylinder_triangles,
    read_triangles,
    surface_points,
)

Array = NDArray[np.float64]

MOVABLE = ("revolute", "continuous", "prismatic")
_PROBES = 24


@dataclass(frozen=True)
class Joint:
    """One joint: ``child`` stands in ``parent`` at ``origin`` (4, 4) and moves on ``axis`` (3,)."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float
    upper: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class Clusters:
    """Neighbouring surface points of one link each, inside balls, in link frames; and groups of such balls.

    ``points`` (C, P, 3), ``centre`` (C, 3), ``radius`` (C,) [m], ``link`` (C,); the clusters ``members[g]``
    lie within ``group_radius`` (G,) of ``group_centre`` (G, 3) on link ``group_link`` (G,).
    """

    points: Array
    centre: Array
    radius: Array
    link: NDArray[np.int64]
    members: tuple[NDArray[np.int64], ...]
    group_centre: Array
    group_radius: Array
    group_link: NDArray[np.int64]


class Arm:
    """Links that move, their surface points and where they are at given joint positions."""

    def __init__(
        self,
        urdf: Path,
        packages: Mapping[str, Path],
        joints: Sequence[str],
        rng: np.random.Generator,
        *,
        points_per_link: int = 150,
        cluster_size: int = 48,
        group_size: int = 400,
    ) -> None:
        root = ElementTree.parse(urdf).getroot()
        self.joints = tuple(joints)
        self._mount = np.eye(4)
        found = [_read_joint(each) for each in root.findall("joint") if each.find("parent") is not None]
        self._tree = {joint.name: joint for joint in found}
        self._above = {joint.child: joint for joint in found}
        missing = [name for name in joints if name not in self._tree]
        if missing:
            raise ValueError(f"{urdf}: no joint {missing}")
        self.free = tuple(
            j for j in found if j.kind in MOVABLE and j.name not in self.joints and j.mimic is None
        )
        """Joints that nobody commands; the caller says where in their range they are."""
        points = {
            link.get("name", ""): _link_points(link, packages, points_per_link, rng)
            for link in root.findall("link")
        }
        self.links = tuple(name for name in points if len(points[name]) and self._moves(name))
        self.points = tuple(points[name] for name in self.links)
        self.clusters = _clusters(self.points, cluster_size, group_size)
        self.probes = tuple(_spread(each, _PROBES) for each in self.points)

    def mounted(self, base: Array) -> Arm:
        """The same arm with its base at ``base`` (4, 4) in the world."""
        moved = copy.copy(self)
        moved._mount = base
        return moved

    def _chain(self, link: str) -> list[Joint]:
        chain: list[Joint] = []
        while link in self._above:
            chain.append(self._above[link])
            link = chain[-1].parent
        return chain[::-1]

    def carried_by(self, link: str) -> tuple[str, ...]:
        """Commanded joints that move a link, from the base on."""
        return tuple(joint.name for joint in self._chain(link) if joint.name in self.joints)

    def _moves(self, link: str) -> bool:
        return any(joint.kind in MOVABLE for joint in self._chain(link))

    def poses(self, q: Array, free: Mapping[str, float] | None = None) -> tuple[Array, Array]:
        """Rotations (L, T, 3, 3), positions (L, T, 3) [m] of the moving links at positions ``q`` (T, n)."""
        values = {name: q[:, i] for i, name in enumerate(self.joints)}
        for joint in self.free:
            values[joint.name] = np.full(len(q), (free or {}).get(joint.name, 0.0))
        known: dict[str, tuple[Array, Array]] = {}
        rotations = np.empty((len(self.links), len(q), 3, 3))
        positions = np.empty((len(self.links), len(q), 3))
        for index, link in enumerate(self.links):
            rotations[index], positions[index] = self._pose(link, values, known, len(q))
        return rotations, positions

    def _pose(
        self, link: str, values: Mapping[str, Array], known: dict[str, tuple[Array, Array]], number: int
    ) -> tuple[Array, Array]:
        if link not in self._above:
            ones = np.ones((number, 1))
            return ones[..., None] * self._mount[:3, :3], ones * self._mount[:3, 3]
        if link not in known:
            joint = self._above[link]
            rotation, position = self._pose(joint.parent, values, known, number)
            position = position + rotation @ joint.origin[:3, 3]
            rotation = rotation @ joint.origin[:3, :3]
            if joint.kind in MOVABLE:
                source, factor, offset = joint.mimic or (joint.name, 1.0, 0.0)
                value = factor * values[source] + offset
                if joint.kind == "prismatic":
                    position = position + (rotation @ joint.axis) * value[:, None]
                else:
                    rotation = rotation @ _turns(joint.axis, value)
            known[link] = rotation, position
        return known[link]


def _turns(axis: Array, angle: Array) -> Array:
    """Rotation matrices (T, 3, 3) about the unit vector ``axis`` (3,) by ``angle`` (T,), from quaternions."""
    w = np.cos(0.5 * angle)
    x, y, z = np.sin(0.5 * angle) * axis[:, None]
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def _numbers(text: str | None, default: str) -> Array:
    return np.array((text or default).split(), dtype=np.float64)


def _origin(element: ElementTree.Element | None) -> Array:
    pose = np.eye(4)
    if element is not None:
        angles = _numbers(element.get("rpy"), "0 0 0")
        roll, pitch, yaw = (_turns(np.eye(3)[i], angles[i : i + 1])[0] for i in range(3))
        pose[:3, :3] = yaw @ pitch @ roll
        pose[:3, 3] = _numbers(element.get("xyz"), "0 0 0")
    return pose


def _read_joint(element: ElementTree.Element) -> Joint:
    axis_element, limit, mimic = element.find("axis"), element.find("limit"), element.find("mimic")
    axis = _numbers(axis_element.get("xyz") if axis_element is not None else None, "1 0 0")
    kind = element.get("type", "")
    if kind not in (*MOVABLE, "fixed"):
        raise ValueError(f"joint {element.get('name')}: type {kind} is not read by this reader")
    return Joint(
        name=element.get("name", ""),
        kind=kind,
        parent=element.find("parent").get("link", ""),
        child=element.find("child").get("link", ""),
        origin=_origin(element.find("origin")),
        axis=axis / np.linalg.norm(axis),
        lower=float(limit.get("lower", "-inf")) if limit is not None else -np.inf,
        upper=float(limit.get("upper", "inf")) if limit is not None else np.inf,
        mimic=None
        if mimic is None
        else (mimic.get("joint", ""), float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))),
    )


def _link_points(
    link: ElementTree.Element, packages: Mapping[str, Path], number: int, rng: np.random.Generator
) -> Array:
    """Corners of the hull and points all over the surface of whatever the link shows or collides with."""
    shapes = [
        _shape_triangles(shape, packages)
        for kind in ("visual", "collision")
        for shape in link.findall(kind)
        if shape.find("geometry") is not None
    ]
    if not shapes:
        return np.zeros((0, 3))
    corners = np.unique(np.concatenate(shapes).reshape(-1, 3), axis=0)
    spread = [surface_points(each, number // len(shapes) + 1, rng) for each in shapes]
    return np.concatenate([corners[ConvexHull(corners).vertices], *spread])


def _shape_triangles(shape: ElementTree.Element, packages: Mapping[str, Path]) -> Array:
    geometry = shape.find("geometry")
    mesh, box, ball, cylinder = (geometry.find(kind) for kind in ("mesh", "box", "sphere", "cylinder"))
    if mesh is not None:
        uri = mesh.get("filename", "")
        package, _, inside = uri.removeprefix("package://").partition("/")
        triangles = read_triangles(packages[package] / inside) * _numbers(mesh.get("scale"), "1 1 1")
    elif box is not None:
        triangles = box_triangles(_numbers(box.get("size"), ""))
    elif ball is not None:
        triangles = ball_triangles(float(ball.get("radius", "")))
    elif cylinder is not None:
        triangles = cylinder_triangles(float(cylinder.get("radius", "")), float(cylinder.get("length", "")))
    else:
        raise ValueError(f"shape {[child.tag for child in geometry]} is not read by this reader")
    pose = _origin(shape.find("origin"))
    return triangles @ pose[:3, :3].T + pose[:3, 3]


def _halve(points: Array, size: int) -> list[Array]:
    """Halve points (N, 3) across their longest side until no group is larger than ``size``."""
    if len(points) <= size:
        return [points]
    order = np.argsort(points[:, int(np.argmax(np.ptp(points, axis=0)))], kind="stable")
    half = len(points) // 2
    return _halve(points[order[:half]], size) + _halve(points[order[half:]], size)


def _ball(points: Array) -> tuple[Array, float]:
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


def _clusters(points: Sequence[Array], size: int, group_size: int) -> Clusters:
    """Group the points (N, 3) of each link; clusters are padded to ``size`` points by repeating one."""
    groups = [(link, group) for link, each in enumerate(points) for group in _halve(each, group_size)]
    clusters = [(number, each) for number, (_, group) in enumerate(groups) for each in _halve(group, size)]
    balls = [_ball(each) for _, each in clusters]
    group_balls = [_ball(group) for _, group in groups]
    return Clusters(
        points=np.stack(
            [np.concatenate([each, np.repeat(each[:1], size - len(each), axis=0)]) for _, each in clusters]
        ),
        centre=np.stack([centre for centre, _ in balls]),
        radius=np.array([radius for _, radius in balls]),
        link=np.array([groups[number][0] for number, _ in clusters]),
        members=tuple(np.flatnonzero([number == g for number, _ in clusters]) for g in range(len(groups))),
        group_centre=np.stack([centre for centre, _ in group_balls]),
        group_radius=np.array([radius for _, radius in group_balls]),
        group_link=np.array([link for link, _ in groups]),
    )


def _spread(points: Array, number: int) -> Array:
    """Choose points far from one another, one after the other."""
    chosen = [int(np.argmax(np.linalg.norm(points, axis=1)))]
    distance = np.full(len(points), np.inf)
    while len(chosen) < min(number, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    return points[chosen]
