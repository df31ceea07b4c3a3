"""Tool and payload: capsules and meshes that hang on a link frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from robots.assumption import Certainty
from robots.capsule import LARGEST, Capsule
from robots.enclosure import NO_CORNERS, EnclosedPart, enclose_mesh
from robots.errors import SetupError
from robots.files import is_file, shown
from robots.limits import Array
from robots.model import Mount, Tree


@dataclass(frozen=True, slots=True)
class ToolMesh:
    """A mesh file and where it sits in the tool's frame."""

    file: Path
    placement: Mount


@dataclass(frozen=True)
class Tool:
    """What is mounted on ``frame`` (a link of the URDF; None: the flange that the model file names).

    Meshes are enclosed with proof; capsules, and those of a carried ``payload``, are taken as declared.

    Raises
    ------
    SetupError
        If the name is empty or does not print, or there is neither a capsule nor a mesh.
    """

    name: str
    capsules: tuple[Capsule, ...] = ()
    meshes: tuple[ToolMesh, ...] = ()
    payload: tuple[Capsule, ...] = ()
    frame: str | None = None
    source: str = "declared"
    certainty: Certainty = field(default=Certainty.DECLARED)

    def __post_init__(self) -> None:
        if not self.name or not self.name.isprintable():
            raise SetupError(f"{self.source}: name = {shown(self.name)} must be one line of text that prints")
        if not self.capsules and not self.meshes:
            raise SetupError(
                f"{self.source}: tool {self.name} has no [[capsule]] and no [[mesh]]; at least one is needed"
            )


def read_capsule(row: Mapping[str, object], where: str) -> Capsule:
    """Read ``a_m``, ``b_m`` (three numbers each) and ``radius_m`` of a TOML table.

    Raises
    ------
    SetupError
        For a missing or unknown key, what is not three numbers up to 1000 m, a radius that is not positive.
    """
    check_keys(row, ("a_m", "b_m", "radius_m"), ("a_m", "b_m", "radius_m"), where)
    radius = read_number(row["radius_m"], f"{where}.radius_m")
    if not radius > 0.0:
        raise SetupError(f"{where}.radius_m = {radius:g} must be above zero")
    return Capsule(read_vector(row["a_m"], f"{where}.a_m"), read_vector(row["b_m"], f"{where}.b_m"), radius)


def read_tool(table: Mapping[str, object], folder: Path, source: str) -> Tool:
    """Read a tool's TOML table; mesh files are relative to ``folder``.

    Raises
    ------
    SetupError
        Naming the key and what it should be.
    """
    check_keys(table, ("name",), ("name", "frame", "capsule", "mesh", "payload"), source)
    name, frame = table["name"], table.get("frame")
    if not isinstance(name, str):
        raise SetupError(f"{source}: name = {shown(name)} must be text")
    if frame is not None and not isinstance(frame, str):
        raise SetupError(f"{source}: frame = {shown(frame)} must be the name of a link")
    return Tool(
        name=name,
        capsules=_capsules(table, "capsule", source),
        meshes=tuple(
            _mesh(row, folder, f"{source}: mesh[{i}]")
            for i, row in enumerate(read_rows(table, "mesh", source))
        ),
        payload=_capsules(table, "payload", source),
        frame=frame,
        source=source,
    )


def frame_placement(tree: Tree, frame: str, where: str) -> tuple[int, Mount]:
    """Return (commanded joint, placement of link ``frame`` in that joint's frame); ``where`` names that link.

    Raises
    ------
    SetupError
        If the link does not exist, does not move, or moves with a joint that is not commanded.
    """
    if frame not in tree.urdf.links:
        raise SetupError(
            f"{where}: no link is called {shown(frame)}; there are: {', '.join(tree.urdf.links)}"
        )
    entry = tree.model.frames[tree.model.getBodyId(frame)]
    if entry.parentJoint not in tree.ids:
        kind = "a joint that is not commanded" if entry.parentJoint else "no joint"
        raise SetupError(f"{where}: link {frame} moves with {kind}; name a link that a commanded joint moves")
    return tree.ids.index(entry.parentJoint), Mount(entry.placement.rotation, entry.placement.translation)


def hangable(tree: Tree) -> tuple[str, ...]:
    """Links that a commanded joint moves and from which the tree goes on to no other such link."""
    frames = {link: tree.model.frames[tree.model.getBodyId(link)] for link in tree.urdf.links}
    moved = {link for link, frame in frames.items() if frame.parentJoint in tree.ids}
    inner = {joint.parent for joint in tree.urdf.joints.values() if joint.child in moved}
    return tuple(link for link in tree.urdf.links if link in moved and link not in inner)


def unknown_flange(tree: Tree, where: str) -> SetupError:
    """Refuse what says nowhere on which link it hangs, and name those that end the arm."""
    links = ", ".join(hangable(tree))
    return SetupError(f"{where}: no flange is known; state frame = the link it hangs on, one of: {links}")


def tool_parts(tree: Tree, tool: Tool, flange: str | None, cache_dir: Path | None) -> list[EnclosedPart]:
    """Capsules of tool and payload on the joint that carries them, named ``tool:…`` and ``payload:…``.

    Raises
    ------
    SetupError
        If the frame is not known or cannot carry a tool, or a mesh cannot be read.
    """
    frame = flange if tool.frame is None else tool.frame
    if frame is None:
        raise unknown_flange(tree, f"{tool.source}: frame")
    joint, placement = frame_placement(tree, frame, f"{tool.source}: frame")
    parts = []
    for kind, capsules in (("tool", tool.capsules), ("payload", tool.payload)):
        name = f"{kind}:{tool.name}"
        for capsule in capsules:
            moved = placed(capsule, placement)
            parts.append(EnclosedPart(name, joint, moved, NO_CORNERS, tool.certainty, tool.source))
    for mesh in tool.meshes:
        parts += enclose_mesh(f"tool:{tool.name}", mesh.file, joint, placement @ mesh.placement, cache_dir)
    return numbered(parts)


def numbered(parts: Sequence[EnclosedPart]) -> list[EnclosedPart]:
    """Give parts of the same name numbers: ``tool:gripper:1``, ``tool:gripper:2``."""
    names = [part.name for part in parts]
    return [
        replace(part, name=f"{part.name}:{names[: i + 1].count(part.name)}")
        if names.count(part.name) > 1
        else part
        for i, part in enumerate(parts)
    ]


def placed(capsule: Capsule, placement: Mount) -> Capsule:
    """Return the capsule, given in a frame, in the coordinates that the frame's placement refers to."""
    a, b = (placement.rotation @ end + placement.translation for end in (capsule.a, capsule.b))
    return Capsule(a, b, capsule.radius)


def check_keys(
    table: Mapping[str, object], required: Sequence[str], allowed: Sequence[str], where: str
) -> None:
    """Raise ValueError for a key that is missing or unknown."""
    for key in required:
        if key not in table:
            raise SetupError(f"{where}: {key} is missing")
    for key in table:
        if key not in allowed:
            raise SetupError(f"{where}: unknown key {shown(key)}; possible are: {', '.join(allowed)}")


def read_rows(table: Mapping[str, object], key: str, where: str) -> list[Mapping[str, object]]:
    """Read an array of tables; empty if it is not there."""
    rows = table.get(key, [])
    if (
        not isinstance(rows, Sequence)
        or isinstance(rows, str)
        or not all(isinstance(row, Mapping) for row in rows)
    ):
        raise SetupError(f"{where}: {key} must be written as [[{key}]] tables")
    return list(rows)


def read_number(value: object, where: str) -> float:
    """Read a number from -1000 to 1000 [m or deg]."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise SetupError(f"{where} = {shown(value)} must be a finite number from -{LARGEST:g} to {LARGEST:g}")
    return float(value)


def read_vector(value: object, where: str) -> Array:
    """Read three numbers, each as :func:`read_number` does."""
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise SetupError(f"{where} = {shown(value)} must be three numbers")
    return np.array([read_number(entry, where) for entry in value])


def _capsules(table: Mapping[str, object], key: str, where: str) -> tuple[Capsule, ...]:
    rows = read_rows(table, key, where)
    return tuple(read_capsule(row, f"{where}: {key}[{i}]") for i, row in enumerate(rows))


def _mesh(row: Mapping[str, object], folder: Path, where: str) -> ToolMesh:
    check_keys(row, ("file",), ("file", "xyz_m", "rpy_deg"), where)
    if not isinstance(row["file"], str):
        raise SetupError(f"{where}.file = {shown(row['file'])} must be text")
    file = folder / row["file"]
    if not is_file(file):
        raise SetupError(f"{where}: mesh file {shown(row['file'])} was not found in {folder}")
    xyz = read_vector(row.get("xyz_m", [0, 0, 0]), f"{where}.xyz_m")
    rpy = read_vector(row.get("rpy_deg", [0, 0, 0]), f"{where}.rpy_deg")
    return ToolMesh(file, Mount.from_xyz_rpy(xyz.tolist(), rpy.tolist()))
