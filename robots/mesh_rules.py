"""Rules of mesh files that their reader does not enforce: what it would scale, turn or leave out is refused.

The reader applies neither the unit nor the axis of a COLLADA file; it returns what comes before the cut of a
file that was cut off, passes over lines that it does not know, and reads some numbers as others. So the
places that a file states are read here a second time, independently, and each must be among what was loaded.
"""

from __future__ import annotations

import math
import re
from codecs import BOM_UTF8
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree, QhullError

from robots.collada import scene_points
from robots.errors import SetupError
from robots.files import read_bytes, shown
from robots.limits import Array

_STL_HEADER, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL: its header with the number of triangles, and each of these."""
_STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NO_LINES: Array = np.empty((0, 3))
_STL_NAME = re.compile(rb"(?<![^\r\n])[ \t]*(?:end)?solid[ \t](?![^\r\n]*facet)[^\r\n]*", re.IGNORECASE)
"""A name to the end of its line; a line with facets is none."""
_STL_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_OBJ_BESIDE = (b"vn", b"vt", b"g", b"o", b"s", b"l", b"p", b"usemtl", b"mtllib")
"""Words of lines that bound nothing beyond the vertices; others may name files, surfaces or splines."""
_ROUNDING = 2e-6
"""Share of the largest coordinate [1]; the reader has numbers of 24 bits, and multiplies those of COLLADA."""


@dataclass(frozen=True, eq=False)
class StatedPlaces:
    """What a mesh file states: corners (N, 3) of faces, and ends (M, 3) of lines, which bound no body."""

    file: str
    corners: Array
    line_ends: Array

    def require_all_in(self, loaded: Array, scale: Array) -> None:
        """Refuse vertices (K, 3), scaled by ``scale`` (3,), that are not all that the file states.

        Raises
        ------
        SetupError
            If a corner is further from all that were loaded than rounding to 24 bits explains, or an end of
            a line is neither there nor within their hull.
        """
        corners, ends = np.unique(self.corners * scale, axis=0), self.line_ends * scale
        near = KDTree(np.unique(loaded, axis=0))
        reach = _ROUNDING * float(np.abs(np.vstack([corners, ends])).max(initial=0.0))
        lost = corners[near.query(corners)[0] > reach]
        lone = ends[near.query(ends)[0] > reach]
        lost = np.vstack([lost, lone[_outside(lone, loaded, reach)]])
        if len(lost):
            first = " ".join(f"{value:g}" for value in lost[0])
            raise SetupError(
                f"{self.file}: {len(lost)} of the {len(corners) + len(ends)} places that it states would be "
                f"left out or read as others, the first at {first}: export it again, of triangles alone"
            )


def _outside(points: Array, loaded: Array, reach: float) -> NDArray[np.bool_]:
    """Which points (N, 3) are not within the hull of what was loaded; all, where it is flat."""
    try:
        planes = ConvexHull(loaded).equations if len(points) else np.empty((0, 4))
    except QhullError:
        return np.ones(len(points), dtype=np.bool_)
    return np.asarray((points @ planes[:, :3].T + planes[:, 3] > reach).any(axis=1))


def stated_places(file: Path) -> StatedPlaces:
    """Read the places that a mesh file states; refuse one that cannot be held against them.

    COLLADA: see :mod:`robots.collada`. STL: text without its end or with zero bytes, fewer or more triangles
    than it states. OBJ: vertices that no face uses, or with a weight other than 1, a vertex that is not
    there, lines of another kind. All: no face at all, a number that is none or not finite.

    Raises
    ------
    SetupError
        If it is one of these, of another format, or cannot be read.
    """
    read = _READ.get(file.suffix.lower())
    if read is None:
        raise SetupError(
            f"{file}: of a format that is not read here; export it as one of {', '.join(_READ)}, in metres"
        )
    corners, line_ends = read(read_bytes(file), str(file))
    if not len(corners):
        raise SetupError(f"{file}: has no faces")
    if not (np.isfinite(corners).all() and np.isfinite(line_ends).all()):
        raise SetupError(f"{file}: has coordinates that are not finite")
    return StatedPlaces(str(file), corners, line_ends)


def _stl_places(content: bytes, where: str) -> tuple[Array, Array]:
    if len(content) < _STL_HEADER:  # less than one triangle takes, as text too
        raise SetupError(f"{where}: not a mesh: it is cut off, or no STL file; export it again")
    count = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    needed = _STL_HEADER + _STL_TRIANGLE * count
    if len(content) == needed:
        rows = np.frombuffer(content, _STL_ROW, offset=_STL_HEADER)
        return rows["corners"].reshape(-1, 3).astype(np.float64), _NO_LINES
    words = content.lower().rsplit(b"endfacet", 1)
    if len(words) == 1:
        how = "cut off: shorter" if len(content) < needed else "not whole: longer"
        raise SetupError(f"{where}: {how} than the {count} triangles that it states need")
    if b"endsolid" not in words[1]:
        raise SetupError(f"{where}: cut off: it does not end with endsolid, export it again")
    if b"\0" in content:
        raise SetupError(f"{where}: neither text nor {count} triangles: it has zero bytes, export it again")
    text = _STL_NAME.sub(b"", content)
    vertices = _STL_VERTEX.findall(text)
    if text.lower().count(b"vertex") != len(vertices):
        raise SetupError(f"{where}: a vertex without its three numbers: it is cut off, export it again")
    return _rows(vertices, where), _NO_LINES


def _obj_places(content: bytes, where: str) -> tuple[Array, Array]:
    vertices: list[tuple[bytes, ...]] = []
    used: set[int] = set()
    for number, line in enumerate(content.removeprefix(BOM_UTF8).splitlines(), 1):
        words = line.split(b"#")[0].split()
        if not words or words[0] in _OBJ_BESIDE:
            continue
        place = f"{where}: line {number}"
        if words[0] not in (b"v", b"f"):
            word = shown(words[0].decode(errors="replace"))
            raise SetupError(f"{place}: {word} is not read: export it again, of vertices and faces alone")
        if not line.startswith(words[0]):
            raise SetupError(f"{place}: starts with a blank, and would be left out: export it again")
        if words[0] == b"v":
            vertices.append(_position(words[1:], place))
        else:
            used.update(_corner(word, len(vertices), place) for word in words[1:])
    beyond = used - set(range(1, len(vertices) + 1))
    if beyond:
        raise SetupError(f"{where}: a face names the vertex {max(beyond)} of {len(vertices)}: it is cut off")
    unused = len(vertices) - len(used)
    if unused:
        raise SetupError(
            f"{where}: no face uses {unused} of its {len(vertices)} vertices, so they would be left out: "
            "it is cut off, or must be exported without them"
        )
    return _rows(vertices, where), _NO_LINES


def _position(words: list[bytes], where: str) -> tuple[bytes, ...]:
    """Return the three numbers of a vertex; a colour may follow, or the weight 1."""
    if len(words) not in (3, 4, 6):
        raise SetupError(
            f"{where}: a vertex has {len(words)} numbers; it must have three, and may have a colour"
        )
    if len(words) == 4 and _number(words[3]) != 1.0:
        raise SetupError(
            f"{where}: a vertex has the weight {shown(words[3].decode(errors='replace'))}, by which it would "
            "be scaled: export it without weights"
        )
    return tuple(words[:3])


def _corner(word: bytes, vertices: int, where: str) -> int:
    """Return the number of a face's vertex, from 1; a negative one counts back from the last so far."""
    index = word.split(b"/")[0]
    try:
        number = 0 if b"_" in index else int(index)
    except ValueError:
        number = 0
    if number == 0:
        raise SetupError(f"{where}: a face names the vertex {shown(word.decode(errors='replace'))}")
    return number if number > 0 else vertices + 1 + number


def _rows(rows: list[tuple[bytes, ...]], where: str) -> Array:
    values = np.array([[_number(word) for word in row] for row in rows]).reshape(-1, 3)
    broken = np.argwhere(np.isnan(values))
    if len(broken):
        row, column = broken[0]
        word = rows[row][column].decode(errors="replace")
        raise SetupError(f"{where}: a vertex has the coordinate {shown(word)}, which is no number")
    return values


def _number(word: bytes) -> float:
    """Return the number that a word is, NaN where it is none; as strict as other readers are."""
    try:
        return math.nan if b"_" in word else float(word)
    except ValueError:
        return math.nan


_READ = {".stl": _stl_places, ".dae": scene_points, ".obj": _obj_places}
