"""What a URDF file says: joints, limits, mesh files; checked and made ready for pinocchio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree

from robots.errors import SetupError

_MOVING = ("revolute", "continuous", "prismatic")


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
    """A URDF file: ``xml`` has absolute mesh paths and harmless limits, for pinocchio."""

    name: str
    path: Path
    content: bytes
    xml: str
    links: tuple[str, ...]
    shaped: frozenset[str]
    """Links with visual or collision geometry."""
    joints: dict[str, UrdfJoint]
    meshes: tuple[tuple[str, Path], ...]
    """(link, mesh file), in file order."""


def parse_urdf(content: bytes, path: Path, package_dirs: Sequence[Path] = ()) -> Urdf:
    """Parse a URDF file's ``content``.

    ``package://name/rest`` is looked for in ``package_dirs`` and in every folder above ``path``; other mesh
    names are relative to the file's folder.

    Raises
    ------
    SetupError
        In one line: no XML, no robot, an unknown joint type, a number that is none, a missing mesh.
    """
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise SetupError(f"{path}: not XML ({error})") from None
    if root.tag != "robot":
        raise SetupError(f"{path}: the root element is <{root.tag}>, a URDF has <robot>")
    joints = {}
    for element in root.findall("joint"):
        joint = _joint(element, path)
        if joint.name in joints:
            raise SetupError(f"{path}: two joints are called {joint.name}")
        joints[joint.name] = joint
    links = tuple(element.get("name", "") for element in root.findall("link"))
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise SetupError(f"{path}: joint {joint.name} names link {link!r}, which does not exist")
    meshes = tuple(_resolve_meshes(root, path, package_dirs))
    return Urdf(
        name=root.get("name") or path.stem,
        path=path,
        content=content,
        xml=ElementTree.tostring(root, encoding="unicode"),
        links=links,
        shaped=frozenset(
            link.get("name", "")
            for link in root.findall("link")
            if link.find("visual/geometry") is not None or link.find("collision/geometry") is not None
        ),
        joints=joints,
        meshes=meshes,
    )


def _joint(element: ElementTree.Element, path: Path) -> UrdfJoint:
    """Read one joint and give the element a limit that every parser accepts."""
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in (*_MOVING, "fixed", "floating", "planar"):
        raise SetupError(f"{path}: joint {name} has type {kind!r}, which is no URDF joint type")
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None or not end.get("link"):
            raise SetupError(f"{path}: joint {name} has no {tag} link")
        ends.append(str(end.get("link")))
    axis = element.find("axis")
    if axis is not None and kind in _MOVING:
        _check_axis(axis.get("xyz", ""), f"{path}: joint {name}")
    limit = element.find("limit")
    numbers = {
        key: _number(limit, key, f"{path}: joint {name}") if limit is not None else None
        for key in ("lower", "upper", "velocity", "effort")
    }
    mimic = element.find("mimic")
    follows = None
    if mimic is not None:
        where = f"{path}: joint {name}, mimic"
        multiplier, offset = _number(mimic, "multiplier", where), _number(mimic, "offset", where)
        follows = (mimic.get("joint", ""), 1.0 if multiplier is None else multiplier, offset or 0.0)
    if kind in _MOVING:
        if limit is None:
            limit = ElementTree.SubElement(element, "limit")
        limit.attrib.update(lower="-1", upper="1", velocity="1", effort="1")
    return UrdfJoint(name, kind, ends[0], ends[1], mimics=follows, **numbers)


def _check_axis(text: str, where: str) -> None:
    try:
        length = math.hypot(*map(float, text.split()))
    except ValueError:
        length = math.nan
    if len(text.split()) != 3 or not 0.0 < length < math.inf:
        raise SetupError(f"{where}: axis {text!r} must be three numbers that are not all zero")


def _number(element: ElementTree.Element, key: str, where: str) -> float | None:
    text = element.get(key)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise SetupError(f"{where}: {key} = {text!r} is not a number")
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
            file = next((f for f in _candidates(uri, path, package_dirs) if f.is_file()), None)
            if file is None:
                raise SetupError(f"{path}: link {name}: mesh file {uri!r} was not found")
            mesh.set("filename", str(file.resolve()))
            found.append((name, file.resolve()))
    return found


def _candidates(uri: str, path: Path, package_dirs: Sequence[Path]) -> list[Path]:
    folder = path.resolve().parent
    parsed = urlparse(uri)
    if parsed.scheme in ("package", "model"):
        inside = unquote(parsed.netloc + parsed.path)
        return [directory / inside for directory in [*package_dirs, folder, *folder.parents]]
    if parsed.scheme == "file":
        return [Path(unquote(parsed.path))]
    return [folder / uri] if uri else []
