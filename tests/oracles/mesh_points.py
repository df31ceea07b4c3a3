"""Reads STL and COLLADA meshes by hand and spreads points over their surfaces."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]


def read_triangles(path: Path) -> Array:
    """Triangles (N, 3, 3) [m] of a mesh file, in the file's root frame."""
    if path.suffix.lower() == ".stl":
        return _read_stl(path)
    if path.suffix.lower() == ".dae":
        return _read_collada(path)
    raise ValueError(f"{path}: this reader knows .stl and .dae")


def _read_stl(path: Path) -> Array:
    data = path.read_bytes()
    number = int.from_bytes(data[80:84], "little")
    if len(data) != 84 + 50 * number:
        raise ValueError(f"{path}: not a binary STL of {number} triangles")
    rows = np.frombuffer(
        data,
        dtype=np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]),
        offset=84,
    )
    return rows["corners"].astype(np.float64)


def _read_collada(path: Path) -> Array:
    root = ElementTree.parse(path).getroot()
    space = root.tag[: root.tag.index("}") + 1]
    axis, unit = root.find(f"{space}asset/{space}up_axis"), root.find(f"{space}asset/{space}unit")
    if axis is None or axis.text != "Z_UP" or unit is None or float(unit.get("meter", "nan")) != 1.0:
        raise ValueError(f"{path}: this reader takes Z_UP files in metres")
    geometries = {geometry.get("id"): geometry for geometry in root.iter(f"{space}geometry")}
    found: list[Array] = []
    scene = root.find(f"{space}library_visual_scenes/{space}visual_scene")
    if scene is None:
        raise ValueError(f"{path}: no visual scene")
    stack = [(node, np.eye(4)) for node in scene.findall(f"{space}node")]
    while stack:
        node, outer = stack.pop()
        pose = outer @ _node_matrix(node, space)
        for instance in node.findall(f"{space}instance_geometry"):
            corners = _geometry_triangles(geometries[instance.get("url", "")[1:]], space)
            found.append(corners @ pose[:3, :3].T + pose[:3, 3])
        stack += [(child, pose) for child in node.findall(f"{space}node")]
    return np.concatenate(found)


def _node_matrix(node: ElementTree.Element, space: str) -> Array:
    pose = np.eye(4)
    for child in node:
        kind = child.tag.removeprefix(space)
        if kind == "matrix":
            pose = pose @ np.array((child.text or "").split(), dtype=np.float64).reshape(4, 4)
        elif kind in ("translate", "rotate", "scale", "skew", "lookat"):
            raise ValueError(f"node transform {kind} is not read by this reader")
    return pose


def _geometry_triangles(geometry: ElementTree.Element, space: str) -> Array:
    mesh = geometry.find(f"{space}mesh")
    if mesh is None:
        raise ValueError("a geometry without a mesh")
    sources = {source.get("id"): source for source in mesh.findall(f"{space}source")}
    vertices = mesh.find(f"{space}vertices")
    position = next(i for i in vertices.findall(f"{space}input") if i.get("semantic") == "POSITION")
    numbers = sources[position.get("source", "")[1:]].find(f"{space}float_array")
    points = np.array((numbers.text or "").split(), dtype=np.float64).reshape(-1, 3)
    corners = [np.zeros((0, 3), dtype=np.int64)]
    for kind in ("triangles", "polylist"):
        for block in mesh.findall(f"{space}{kind}"):
            inputs = block.findall(f"{space}input")
            stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
            offset = next(int(i.get("offset", "0")) for i in inputs if i.get("semantic") == "VERTEX")
            listed = block.find(f"{space}p")
            if listed is None:
                continue
            index = np.array((listed.text or "").split(), dtype=np.int64).reshape(-1, stride)[:, offset]
            if kind == "triangles":
                corners.append(index.reshape(-1, 3))
                continue
            sizes = np.array((block.find(f"{space}vcount").text or "").split(), dtype=np.int64)
            for start, size in zip(np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes, strict=True):
                corners += [index[[[start, start + k, start + k + 1]]] for k in range(1, size - 1)]
    if mesh.find(f"{space}polygons") is not None or mesh.find(f"{space}tristrips") is not None:
        raise ValueError("polygons and tristrips are not read by this reader")
    return points[np.concatenate(corners)]


def box_triangles(size: Array) -> Array:
    """Triangles (12, 3, 3) of a box of edge lengths ``size`` (3,) around the origin."""
    sign = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    index = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return (0.5 * sign * size)[np.array(index)]


def ball_triangles(radius: float, number: int = 800) -> Array:
    """Triangles (N, 3, 3) between points on a sphere, evenly spread along a spiral."""
    at = np.arange(number) + 0.5
    polar, azimuth = np.arccos(1.0 - 2.0 * at / number), np.pi * (1.0 + np.sqrt(5.0)) * at
    ring = np.sin(polar)
    points = radius * np.stack([np.cos(azimuth) * ring, np.sin(azimuth) * ring, np.cos(polar)], axis=1)
    return points[ConvexHull(points).simplices]


def cylinder_triangles(radius: float, length: float, number: int = 60) -> Array:
    """Triangles (N, 3, 3) between points on the rings of a cylinder along z around the origin; no caps."""
    angle = 2.0 * np.pi * np.arange(number) / number
    ring = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(number)], axis=1)
    heights = np.linspace(-0.5 * length, 0.5 * length, 20)
    rings = ring + heights[:, None, None] * np.array([0.0, 0.0, 1.0])
    after = np.roll(rings, -1, axis=1)
    halves = [(rings[:-1], after[:-1], after[1:]), (rings[:-1], after[1:], rings[1:])]
    return np.concatenate([np.stack(half, axis=2).reshape(-1, 3, 3) for half in halves])


def surface_points(triangles: Array, number: int, rng: np.random.Generator) -> Array:
    """Spread ``number`` points (number, 3) evenly over the area of the triangles (N, 3, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(triangles), size=number, p=area / area.sum())
    u, v = rng.random((2, number, 1))
    flip = u + v > 1.0
    u, v = np.where(flip, 1.0 - u, u), np.where(flip, 1.0 - v, v)
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
