"""What a URDF file says: joints, limits, mesh files; checked and made ready for pinocchio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from robots.errors import SetupError
from robots.files import is_file
from robots.urdf_rules import check_attributes, check_origin, check_shapes, check_tree, number, read_xml

_MOVING = ("revolute", "continuous", "prismatic")
_PACKAGES = ("package", "model")
_LARGEST_FACTOR = 1e6
_SHORTEST_AXIS, _LONGEST_AXIS = 1e-3, 1e3


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint as written in the file; ``lower`` and ``upper`` [rad, m] are None where nothing is written."""

    name: str
    kind: str
    parent: str
    child: str
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    mimics: tuple[str, float, float] | None
    """(joint, multiplier, offset) if this joint follows another one."""

    @property
    def prismatic(self) -> bool:
        """Whether the joint slides."""
        return self.kind == "prismatic"


@dataclass(frozen=True)
class Urdf:
    """A URDF file; ``xml``, for pinocchio, has shapes and joints alone, absolute paths, harmless limits."""

    name: str
    path: Path
    content: bytes
    xml: str
    links: tuple[str, ...]
    shapes: dict[str, dict[str, int]]
    """Link -> ``visual``, ``collision`` -> how many shapes it has."""
    joints: dict[str, UrdfJoint]
    meshes: tuple[tuple[str, Path], ...]
    """(link, mesh file), in file order."""

    @property
    def shaped(self) -> frozenset[str]:
        """Links with visual or collision geometry."""
        return frozenset(link for link, numbers in self.shapes.items() if any(numbers.values()))


def parse_urdf(content: bytes, path: Path, package_dirs: Sequence[Path] = ()) -> Urdf:
    """Parse a URDF file's ``content``.

    ``package://name/rest`` is looked for in ``package_dirs`` and in every folder above ``path``; other mesh
    names are relative to the file's folder.

    Raises
    ------
    SetupError
        In one line: no XML, no robot, no tree, a shape or joint type that is not known, a number that is none
        or beyond reason, a missing mesh.
    """
    root = read_xml(content, str(path))
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = {joint.name: joint for joint in (_joint(each, path) for each in root.findall("joint"))}
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise SetupError(f"{path}: joint {joint.name} names link {link!r}, which does not exist")
    check_tree(tuple(links), [(each.name, each.parent, each.child) for each in joints.values()], str(path))
    shapes = {name: check_shapes(link, f"{path}: link {name}") for name, link in links.items()}
    meshes = tuple(_resolve_meshes(root, path, package_dirs))
    return Urdf(
        name=root.get("name") or path.stem,
        path=path,
        content=content,
        xml=ElementTree.tostring(root, encoding="unicode"),
        links=tuple(links),
        shapes=shapes,
        joints=joints,
        meshes=meshes,
    )


def _joint(element: ElementTree.Element, path: Path) -> UrdfJoint:
    """Read one joint, and leave in the element what every parser accepts and the kinematics need."""
    name, kind = element.get("name", ""), element.get("type", "")
    where = f"{path}: joint {name}"
    if kind not in (*_MOVING, "fixed", "floating", "planar"):
        raise SetupError(f"{where} has type {kind!r}, which is no URDF joint type")
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None or not end.get("link"):
            raise SetupError(f"{where} has no {tag} link")
        ends.append(str(end.get("link")))
    check_origin(element, where)
    axis, limit, mimic = (element.find(tag) for tag in ("axis", "limit", "mimic"))
    if axis is not None and kind in _MOVING:
        _check_axis(axis, where)
    limits = {
        key: None if limit is None else _number(limit, key, where)
        for key in ("lower", "upper", "velocity", "effort")
    }
    follows = None
    if mimic is not None:
        place = f"{where}, mimic"
        check_attributes(mimic, place)
        multiplier = _number(mimic, "multiplier", place, _LARGEST_FACTOR)
        offset = _number(mimic, "offset", place, _LARGEST_FACTOR)
        follows = (mimic.get("joint", ""), 1.0 if multiplier is None else multiplier, offset or 0.0)
    kept = ("origin", "parent", "child", *(("axis",) if kind in _MOVING else ()))
    element[:] = [child for child in element if child.tag in kept]
    if kind in _MOVING:
        ElementTree.SubElement(element, "limit", lower="-1", upper="1", velocity="1", effort="1")
    return UrdfJoint(name, kind, ends[0], ends[1], mimics=follows, **limits)


def _check_axis(axis: ElementTree.Element, where: str) -> None:
    text = axis.get("xyz", "")
    numbers = [number(part) for part in text.split()]
    if len(numbers) != 3 or not _SHORTEST_AXIS <= math.hypot(*numbers) <= _LONGEST_AXIS:
        raise SetupError(
            f"{where}: axis {text!r} must be three numbers that are not all zero, "
            f"of a length from {_SHORTEST_AXIS:g} to {_LONGEST_AXIS:g}"
        )


def _number(element: ElementTree.Element, key: str, where: str, largest: float = math.inf) -> float | None:
    text = element.get(key)
    if text is None:
        return None
    value = number(text)
    if not abs(value) <= largest:
        rule = (
            "is not a number" if math.isnan(value) else f"must be a number from -{largest:g} to {largest:g}"
        )
        raise SetupError(f"{where}: {key} = {text!r} {rule}")
    return value


def _resolve_meshes(
    root: ElementTree.Element, path: Path, package_dirs: Sequence[Path]
) -> list[tuple[str, Path]]:
    """Write absolute paths into all mesh elements; return (link, file) in file order."""
    found = []
    for link in root.findall("link"):
        name = link.get("name", "")
        for mesh in [*link.findall("visual/geometry/mesh"), *link.findall("collision/geometry/mesh")]:
            uri = mesh.get("filename", "")
            file = next((f for f in _candidates(uri, path, package_dirs) if is_file(f)), None)
            if file is None:
                where = f"{path}: link {name}: mesh file {uri!r}"
                raise SetupError(f"{where} was not found{_where_to_put(uri)}")
            mesh.set("filename", str(file.resolve()))
            found.append((name, file.resolve()))
    return found


def _where_to_put(uri: str) -> str:
    """What to do about a mesh of a package that was not found."""
    scheme, _, inside = uri.partition("://")
    package = unquote(inside.partition("/")[0])
    if scheme.lower() not in _PACKAGES or not package:
        return ""
    return (
        f"; put the folder {package!r} beside the URDF or above it, or name the folder that has it in "
        "robot.package_dirs of the cell (--package-dir of import and init)"
    )


def _candidates(uri: str, path: Path, package_dirs: Sequence[Path]) -> list[Path]:
    folder = path.resolve().parent
    scheme, marked, rest = uri.partition("://")
    if marked and scheme.lower() in _PACKAGES:
        inside = unquote(rest)
        if inside.startswith("/"):  # no package is named, and it would be a path from the root
            return []
        return [directory / inside for directory in [*package_dirs, folder, *folder.parents]]
    if marked and scheme.lower() == "file":
        return [Path("/", unquote(rest.partition("/")[2]))]
    return [folder / uri] if uri else []
