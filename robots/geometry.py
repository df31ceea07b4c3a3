"""Link geometry out of URDF, mesh files and primitive shapes, in the frames of the commanded joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio

from robots.errors import SetupError
from robots.limits import Array
from robots.model import Tree
from robots.shapes import Pieces, mesh_pieces, place, primitive_pieces, sweep


def link_pieces(tree: Tree) -> dict[tuple[str, int], list[Array]]:
    """Collect the geometry of all moving links: (link, commanded joint) -> pieces in the joint's frame.

    Geometry that hangs on locked joints is swept over their range and belongs to the link that carries them.

    Raises
    ------
    SetupError
        If a file or shape cannot be used, or the range of a locked joint is endless.
    """
    moving: dict[tuple[str, int], list[Array]] = {}
    for link, joint_id, pieces in _geometry(tree):
        if tree.carrier(link) is None:
            continue
        host, host_joint, swept = _sweep_to_commanded(tree, link, joint_id, pieces)
        moving.setdefault((host, tree.ids.index(host_joint)), []).extend(swept)
    ordered = sorted(moving, key=lambda key: (key[1], tree.urdf.links.index(key[0])))
    return {key: moving[key] for key in ordered}


def read_mesh(file: Path) -> Pieces:
    """Pieces of a mesh file.

    Raises
    ------
    SetupError
        If it is not a mesh that can be read.
    """
    try:
        shape = coal.MeshLoader().load(str(file), np.ones(3))
    except (ValueError, RuntimeError) as error:
        raise SetupError(f"{file}: not a mesh that can be read: {' '.join(str(error).split())}") from None
    return _pieces(shape, str(file))


def _geometry(tree: Tree) -> list[tuple[str, int, Pieces]]:
    """(link, pinocchio joint, pieces in that joint's frame) of all collision and visual geometry."""
    found = []
    for kind in (pinocchio.GeometryType.COLLISION, pinocchio.GeometryType.VISUAL):
        try:
            geometry = pinocchio.buildGeomFromUrdfString(tree.model, tree.urdf.xml, kind)
        except (ValueError, RuntimeError) as error:
            raise SetupError(
                f"{tree.urdf.path}: unreadable geometry: {' '.join(str(error).split())}"
            ) from None
        for item in geometry.geometryObjects:
            link = str(tree.model.frames[item.parentFrame].name)
            pieces = place(_pieces(item.geometry, link), item.placement.rotation, item.placement.translation)
            found.append((link, int(item.parentJoint), pieces))
    return found


def _pieces(shape: Any, link: str) -> Pieces:
    if not hasattr(shape, "vertices"):
        try:
            return primitive_pieces(shape)
        except ValueError as error:
            raise SetupError(f"link {link}: {error}") from None
    vertices = np.array(shape.vertices(), dtype=np.float64)
    corners = (shape.tri_indices(i) for i in range(shape.num_tris))
    triangles = np.array([(corner[0], corner[1], corner[2]) for corner in corners], dtype=np.int64)
    if not len(vertices) or not np.isfinite(vertices).all():
        raise SetupError(f"link {link}: a mesh has no vertices or some that are not finite")
    return mesh_pieces(vertices, triangles.reshape(-1, 3))


def _sweep_to_commanded(tree: Tree, link: str, joint_id: int, pieces: Pieces) -> tuple[str, int, Pieces]:
    """Sweep pieces over the range of every locked joint down to the first commanded one (0: the base)."""
    while joint_id and joint_id not in tree.ids:
        name = str(tree.model.names[joint_id])
        joint = tree.urdf.joints[name]
        lower, upper = locked_range(tree, name)
        try:
            pieces = sweep(pieces, tree.axis(joint_id), lower, upper, joint.prismatic)
        except ValueError as error:
            raise SetupError(f"{tree.urdf.path}: joint {name} is not commanded: {error}") from None
        placement = tree.model.jointPlacements[joint_id]
        pieces = place(pieces, placement.rotation, placement.translation)
        link, joint_id = joint.parent, int(tree.model.parents[joint_id])
    return link, joint_id, pieces


def locked_range(tree: Tree, name: str) -> tuple[float, float]:
    """Positions [rad or m] that a joint which is not commanded may take; endless if the file does not say.

    One that mimics another may take all positions of its own range and all that follow from the other's.
    """
    joint = tree.urdf.joints[name]
    known = joint.kind != "continuous" and joint.lower is not None and joint.upper is not None
    lower, upper = (joint.lower, joint.upper) if known else (-np.inf, np.inf)
    if lower is None or upper is None or not lower <= upper:
        lower, upper = -np.inf, np.inf
    if joint.mimics is not None and joint.mimics[0] in tree.urdf.joints and joint.mimics[0] != name:
        other, multiplier, offset = joint.mimics
        ends = [multiplier * end + offset for end in locked_range(tree, other)]
        lower, upper = min(lower, *ends), max(upper, *ends)
    return float(lower), float(upper)
