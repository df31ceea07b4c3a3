"""Where a COLLADA file places the points of its meshes, read independently of the library that loads it.

COLLADA 1.4.1 (Khronos, 2008): nodes of the scene, their transformations and the positions of meshes. What the
library would ignore, as another unit or axis or a skin, is refused.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np

from robots.errors import SetupError
from robots.files import shown
from robots.limits import Array

Element = ElementTree.Element

MAX_DEPTH = 50
"""Nodes inside one another, those that name others included."""
_MOST_NODES = 10_000
"""Nodes of a file, one that is named twice counted twice."""
_FACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
_LINES = ("lines", "linestrips")
_BESIDE = ("source", "vertices", "extra")
"""What else a <mesh> consists of."""
_PLACES = ("node", "instance_node", "instance_geometry")
"""What places meshes."""
_BESIDE_PLACES = ("instance_camera", "instance_light", "asset", "extra")
"""What else a <node> consists of, beside transformations."""
_NOT_APPLIED = ("ph", "channel", "instance_controller")
"""Polygons with holes, animations, skins. What else a node or geometry may not have is refused there."""
_OFFSETS = range(100)


def scene_points(content: bytes, where: str) -> tuple[Array, Array]:
    """Corners (N, 3) [m] of all faces of the scene, each where its nodes place it, and ends (M, 3) of lines.

    Positions that neither names are no part of the scene.

    Raises
    ------
    SetupError
        For what would be read as something smaller, larger or turned: another unit than the metre, another
        axis than z as up or none, a part in another file, skins, animations, skewed or projected nodes, nodes
        that the scene does not reach, names that several elements have, numbers that are none.
    """
    scene = _Scene(_parsed(content, where), where)
    with np.errstate(all="ignore"):  # what is not finite is refused, without a warning beside it
        scene.read()
    return np.vstack([np.empty((0, 3)), *scene.corners]), np.vstack([np.empty((0, 3)), *scene.line_ends])


def _parsed(content: bytes, where: str) -> Element:
    if b"<COLLADA" not in content:
        raise SetupError(f"{where}: not a COLLADA file in UTF-8")
    if b"<!DOCTYPE" in content:
        raise SetupError(f"{where}: has a DOCTYPE; export it without")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise SetupError(f"{where}: not XML ({' '.join(str(error).split())})") from None
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]
    if root.tag != "COLLADA":
        raise SetupError(f"{where}: the root element is <{root.tag}>, a COLLADA file has <COLLADA>")
    for element in root.iter():
        _require_applied(element, where)
    if root.find("asset/up_axis") is None:
        raise SetupError(f"{where}: states no up_axis, which means Y_UP in COLLADA: export it with Z_UP")
    return root


def _require_applied(element: Element, where: str) -> None:
    """Refuse an element that the reader passes over, although it says where or how large something is."""
    text = (element.text or "").strip()
    if element.tag.lower() == "unit" and _number(meter := element.get("meter", "")) != 1.0:
        raise SetupError(
            f"{where}: its <unit> is {shown(meter)} m, which is not applied here: "
            "export it in metres, or set meter to 1 and state the scale where the mesh is named"
        )
    if element.tag.lower() == "up_axis" and text != "Z_UP":
        raise SetupError(
            f"{where}: its up_axis is {shown(text)}, which is not applied here: export it with Z_UP"
        )
    if element.tag in _NOT_APPLIED:
        raise SetupError(f"{where}: has a <{element.tag}>, which is not applied here: export plain meshes")
    url = element.get("url", "#")
    if element.tag.startswith("instance_") and not url.startswith("#"):
        raise SetupError(f"{where}: its <{element.tag}> names {shown(url)}, which is not in this file")


class _Scene:
    """The elements of a file by their identifiers."""

    def __init__(self, root: Element, where: str) -> None:
        self.root, self.where = root, where
        self.named: dict[str, list[Element]] = {}
        for element in root.iter():
            self.named.setdefault(element.get("id", ""), []).append(element)
        self.nodes = 0
        self.placed: set[Element] = set()
        self.reached: set[Element] = set()
        self.corners: list[Array] = []
        self.line_ends: list[Array] = []

    def read(self) -> None:
        scenes = self.root.findall("library_visual_scenes/visual_scene")
        if len(scenes) > 1:
            raise SetupError(f"{self.where}: has {len(scenes)} scenes, of which one would be read")
        for instance in self.root.findall("scene/instance_visual_scene"):
            for node in self.target(instance, "visual_scene").findall("node"):
                self.read_node(node, np.eye(4), 1)
        meshes = list(self.root.iter("geometry"))
        if len(meshes) != len(self.placed):
            raise SetupError(
                f"{self.where}: its scene places {len(self.placed)} of its {len(meshes)} meshes: the others "
                "would be left out, export it without them"
            )
        left = [each.tag for each in self.root.iter() if each.tag in _PLACES and each not in self.reached]
        if left:
            raise SetupError(
                f"{self.where}: its scene does not reach {len(left)} elements that place meshes, the first a "
                f"<{left[0]}>: they would be left out, export it without them"
            )

    def read_node(self, node: Element, above: Array, depth: int) -> None:
        self.nodes += 1
        if depth > MAX_DEPTH or self.nodes > _MOST_NODES:
            raise SetupError(
                f"{self.where}: has more than {_MOST_NODES} nodes, or {MAX_DEPTH} inside one another"
            )
        self.reached.update([node, *(element for element in node if element.tag in _PLACES)])
        pose = above
        for element in node:
            if element.tag in _TRANSFORMATIONS:
                pose = pose @ self.transformation(element)
            elif element.tag not in (*_PLACES, *_BESIDE_PLACES):
                raise SetupError(f"{self.where}: a node has a <{element.tag}>, which is not applied here")
        for element in node:
            if element.tag == "node":
                self.read_node(element, pose, depth + 1)
            elif element.tag == "instance_node":
                self.read_node(self.target(element, "node"), pose, depth + 1)
            elif element.tag == "instance_geometry":
                self.read_geometry(self.target(element, "geometry"), pose)

    def read_geometry(self, geometry: Element, pose: Array) -> None:
        self.placed.add(geometry)
        for element in geometry:
            if element.tag not in ("mesh", "asset", "extra"):
                raise SetupError(f"{self.where}: a geometry has a <{element.tag}>, which is not read")
        for part in geometry.findall("mesh/*"):
            if part.tag not in (*_FACES, *_LINES, *_BESIDE):
                raise SetupError(
                    f"{self.where}: a mesh has a <{part.tag}>, which is not read: export triangles"
                )
            if part.tag not in _BESIDE:
                points = self.points_of(part) @ pose[:3, :3].T + pose[:3, 3]
                (self.corners if part.tag in _FACES else self.line_ends).append(points)

    def points_of(self, part: Element) -> Array:
        """Positions (N, 3) that the faces or lines of one part name, faces without area included."""
        inputs = part.findall("input")
        offsets = [self.offset(entry) for entry in inputs]
        own = [entry for entry in inputs if entry.get("semantic") == "VERTEX"]
        if len(own) != 1:
            raise SetupError(f"{self.where}: <{part.tag}> with {len(own)} inputs of vertices, not one")
        stated = self.of_vertices(self.target(own[0], "vertices", "source"))
        step, first = max(offsets) + 1, self.offset(own[0])
        named = [np.empty(0), *(self.numbers(indices)[first::step] for indices in part.findall("p"))]
        which = np.unique(np.concatenate(named))
        if not ((which >= 0) & (which < len(stated)) & (which == np.floor(which))).all():
            raise SetupError(
                f"{self.where}: <{part.tag}> names vertices beyond the {len(stated)} that there are"
            )
        return stated[which.astype(np.int64)]

    def offset(self, entry: Element) -> int:
        """Place of an input among the numbers of one corner."""
        for offset in _OFFSETS:
            if entry.get("offset", "").strip() == str(offset):
                return offset
        raise SetupError(
            f"{self.where}: an input has the offset {shown(entry.get('offset'))}; it must be from 0 to "
            f"{_OFFSETS[-1]}"
        )

    def of_vertices(self, vertices: Element) -> Array:
        sources = [
            self.target(entry, "source", "source")
            for entry in vertices.findall("input")
            if entry.get("semantic") == "POSITION"
        ]
        if len(sources) != 1:
            raise SetupError(f"{self.where}: <vertices> with {len(sources)} positions, not one")
        return self.positions(sources[0])

    def positions(self, source: Element) -> Array:
        accessor = source.find("technique_common/accessor")
        if accessor is None:
            raise SetupError(f"{self.where}: positions without an accessor")
        names = [param.get("name") for param in accessor.findall("param")]
        if names != ["X", "Y", "Z"] or accessor.get("stride") != "3" or accessor.get("offset", "0") != "0":
            raise SetupError(f"{self.where}: positions that are not rows of X, Y, Z: export it again")
        values = self.numbers(self.target(accessor, "float_array", "source"))
        if len(values) % 3 or str(len(values) // 3) != accessor.get("count", "").strip():
            raise SetupError(f"{self.where}: {len(values)} numbers are not {accessor.get('count')} positions")
        return values.reshape(-1, 3)

    def target(self, element: Element, tag: str, key: str = "url") -> Element:
        name = element.get(key, "")
        found = self.named.get(name[1:], []) if name.startswith("#") and name != "#" else []
        if len(found) > 1:
            raise SetupError(
                f"{self.where}: names the {tag} {shown(name)}, but {len(found)} elements are called so"
            )
        if not found or found[0].tag != tag:
            raise SetupError(f"{self.where}: names the {tag} {shown(name)}, which is not in this file")
        return found[0]

    def transformation(self, element: Element) -> Array:
        count, matrix = _TRANSFORMATIONS[element.tag]
        values = self.numbers(element)
        if len(values) != count:
            raise SetupError(f"{self.where}: a <{element.tag}> has {len(values)} numbers; it needs {count}")
        pose = matrix(values)
        if not np.isfinite(pose).all() or list(pose[3]) != [0.0, 0.0, 0.0, 1.0]:
            raise SetupError(f"{self.where}: the last row of a <{element.tag}> must be 0 0 0 1")
        return pose

    def numbers(self, element: Element) -> Array:
        if len(element):
            raise SetupError(
                f"{self.where}: a <{element.tag}> holds a <{element[0].tag}> where only numbers can be read"
            )
        try:
            return np.array((element.text or "").split(), dtype=np.float64)
        except ValueError as error:
            raise SetupError(f"{self.where}: in <{element.tag}>: {shown(str(error))}") from None


def _translation(values: Array) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = values
    return pose


def _scaling(values: Array) -> Array:
    return np.diag([*values, 1.0])


def _rotation(values: Array) -> Array:
    """Turn by an angle [degrees], the last number, about an axis (Rodrigues)."""
    axis = values[:3] / max(float(np.linalg.norm(values[:3])), np.finfo(float).tiny)
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(float(values[3]))
    pose = np.eye(4)
    pose[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return pose


def _look_at(values: Array) -> Array:
    """At the first point, looking along -z at the second, with the third direction up."""
    eye, at, up = values.reshape(3, 3)
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, np.cross(back, right), back, eye])
    return pose


def _matrix(values: Array) -> Array:
    return values.reshape(4, 4)


def _number(text: str) -> float:
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


_TRANSFORMATIONS = {
    "translate": (3, _translation), "scale": (3, _scaling), "rotate": (4, _rotation),
    "lookat": (9, _look_at), "matrix": (16, _matrix),
}  # fmt: skip
