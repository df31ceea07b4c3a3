"""Link geometry out of URDF, mesh files and primitive shapes, in the frames of the commanded joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from robots.capsule import LARGEST
from robots.errors import SetupError
from robots.limits import Array
from robots.mesh_rules import StatedPlaces, stated_places
from robots.model import Tree
from robots.shapes import place, point_balls, primitive_balls, sweep


def moving_geometry(tree: Tree) -> dict[tuple[str, int], Array]:
    """Balls (N, 4) of every moving link with geometry: (link, commanded joint) -> balls in the joint's frame.

    Collision and visual geometry together; what hangs on locked joints is swept over their whole range.

    Raises
    ------
    SetupError
        If a file or shape cannot be used, or the range of a locked sliding joint is endless.
    """
    files = {file for link, file in tree.urdf.meshes if tree.carrier(link) is not None}
    stated = {str(file): stated_places(file) for file in sorted(files)}
    shapes: dict[tuple[str, int], list[Array]] = {}
    for link, joint_id, balls in _geometry(tree, stated):
        if tree.carrier(link) is not None:
            shapes.setdefault((link, joint_id), []).append(balls)
    found: dict[tuple[str, int], Array] = {}
    for (link, joint_id), parts in shapes.items():
        carrier, swept = _sweep_to_commanded(tree, joint_id, np.vstack(parts))
        found[link, tree.ids.index(carrier)] = swept
    ordered = sorted(found, key=lambda key: (key[1], tree.urdf.links.index(key[0])))
    return {key: found[key] for key in ordered}


def read_mesh(file: Path) -> Array:
    """Vertices of a mesh file as balls (N, 4) of radius 0.

    Raises
    ------
    SetupError
        If it is not a mesh that can be read.
    """
    return _balls(_load_mesh(file), str(file))


def read_triangles(file: Path) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (N, 3) of a mesh file, each place once, and its triangles (M, 3) as rows of vertices.

    Raises
    ------
    SetupError
        If it is not a mesh that can be read.
    """
    shape = _load_mesh(file)
    vertices, which = np.unique(_balls(shape, str(file))[:, :3], axis=0, return_inverse=True)
    corners = [[shape.tri_indices(i)[k] for k in range(3)] for i in range(shape.num_tris)]
    return vertices, np.ravel(which)[np.array(corners, dtype=np.int64).reshape(-1, 3)]


def _load_mesh(file: Path) -> Any:
    stated = stated_places(file)
    try:
        shape = coal.MeshLoader().load(str(file), np.ones(3))
    except (ValueError, RuntimeError) as error:
        raise SetupError(f"{file}: not a mesh that can be read: {_reason(error)}") from None
    stated.require_all_in(_balls(shape, str(file))[:, :3], np.ones(3))
    return shape


def locked_range(tree: Tree, name: str) -> tuple[float, float]:
    """Positions [rad or m] that a joint which is not commanded may take; endless if the file does not say.

    One that mimics another may take all positions of its own range and all that follow from the other's.
    """
    joint = tree.urdf.joints[name]
    lower, upper = -np.inf, np.inf
    if joint.kind != "continuous" and joint.lower is not None and joint.upper is not None:
        lower, upper = joint.lower, joint.upper
    if not lower <= upper:
        lower, upper = -np.inf, np.inf
    if joint.mimics is None:
        return lower, upper
    other, multiplier, offset = joint.mimics
    if other not in tree.urdf.joints or tree.urdf.joints[other].mimics is not None:
        raise SetupError(
            f"{tree.urdf.path}: joint {name} mimics {other!r}, which is no joint that moves by itself"
        )
    ends = [multiplier * end + offset for end in locked_range(tree, other)] if multiplier else [offset]
    return min(lower, *ends, offset), max(upper, *ends, offset)


def _geometry(tree: Tree, stated: dict[str, StatedPlaces]) -> Iterator[tuple[str, int, Array]]:
    """(link, pinocchio joint, balls in that joint's frame) of all collision and visual geometry.

    Meshes of moving links are held against the places that their files state.
    """
    kinds = pinocchio.GeometryType
    for name, kind in (("collision", kinds.COLLISION), ("visual", kinds.VISUAL)):
        try:
            geometry = pinocchio.buildGeomFromUrdfString(tree.model, tree.urdf.xml, kind)
        except (ValueError, RuntimeError) as error:
            raise SetupError(f"{tree.urdf.path}: geometry that cannot be read: {_reason(error)}") from None
        loaded: Counter[str] = Counter()
        for item in geometry.geometryObjects:
            link = str(tree.model.frames[item.parentFrame].name)
            loaded[link] += 1
            balls = _balls(item.geometry, f"{tree.urdf.path}: link {link}")
            if hasattr(item.geometry, "vertices") and tree.carrier(link) is not None:
                if item.meshPath not in stated:
                    raise SetupError(f"{tree.urdf.path}: link {link}: a mesh was loaded from another file")
                stated[item.meshPath].require_all_in(balls[:, :3], np.array(item.meshScale))
            balls = place(balls, item.placement.rotation, item.placement.translation)
            yield link, int(item.parentJoint), balls
        _check_none_is_missing(tree, name, loaded)


def _reason(error: Exception) -> str:
    """What a library says, on one line and without the place in its own source."""
    return " ".join(str(error).rsplit("message:", 1)[-1].split())


def _check_none_is_missing(tree: Tree, kind: str, loaded: Counter[str]) -> None:
    for link, numbers in tree.urdf.shapes.items():
        if loaded[link] != numbers[kind]:
            raise SetupError(
                f"{tree.urdf.path}: link {link}: {loaded[link]} of its {numbers[kind]} {kind} shapes could "
                "be loaded; all must be, or the link would be taken for smaller than it is"
            )


def _balls(shape: Any, owner: str) -> Array:
    if not hasattr(shape, "vertices"):
        try:
            return primitive_balls(shape)
        except SetupError as error:
            raise SetupError(f"{owner}: {error}") from None
    vertices = np.array(shape.vertices(), dtype=np.float64)
    if not len(vertices) or not (np.abs(vertices) <= LARGEST).all():
        raise SetupError(
            f"{owner}: a mesh has no vertices, or some that are not finite or beyond {LARGEST:g} m; "
            "its numbers times its scale must be metres"
        )
    return point_balls(vertices)


def _sweep_to_commanded(tree: Tree, joint_id: int, balls: Array) -> tuple[int, Array]:
    """Sweep balls over the range of every locked joint down to the first commanded one."""
    while joint_id not in tree.ids:
        name = str(tree.model.names[joint_id])
        lower, upper = locked_range(tree, name)
        try:
            balls = sweep(
                balls, tree.axis(joint_id), lower, upper, prismatic=tree.urdf.joints[name].prismatic
            )
        except SetupError as error:
            raise SetupError(f"{tree.urdf.path}: joint {name} is not commanded: {error}") from None
        placement = tree.model.jointPlacements[joint_id]
        balls = place(balls, placement.rotation, placement.translation)
        joint_id = int(tree.model.parents[joint_id])
    return joint_id, balls
