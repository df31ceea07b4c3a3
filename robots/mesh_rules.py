"""Rules of mesh files that their reader does not enforce: what it would scale, turn or leave out is refused.

The reader applies neither the unit nor the axis of a COLLADA file, and of an STL or OBJ file that was cut off
it returns what comes before the cut.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from robots.errors import SetupError
from robots.files import read_bytes, shown

_UNIT = re.compile(rb"""<unit\b[^>]*\bmeter\s*=\s*["']([^"']*)["']""")
_UP_AXIS = re.compile(rb"<up_axis>\s*(\w+)")
_STL_HEADER, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL: its header with the number of triangles, and each of these."""


def require_usable(file: Path) -> None:
    """Refuse a mesh file that would be read as something smaller, larger or turned, or cannot be checked.

    COLLADA: another unit than the metre, or another axis than z as up. STL: text without its end, or fewer
    triangles than it states. OBJ: vertices that no face uses, which are not read.

    Raises
    ------
    SetupError
        If it is one of these, of another format, or cannot be read.
    """
    check = _CHECKS.get(file.suffix.lower())
    if check is None:
        raise SetupError(
            f"{file}: of a format that is not read here; export it as one of {', '.join(_CHECKS)}, in metres"
        )
    check(file, read_bytes(file))


def _require_metres(file: Path, content: bytes) -> None:
    if b"<COLLADA" not in content:
        raise SetupError(f"{file}: not a COLLADA file in UTF-8")
    unit, up = _UNIT.search(content), _UP_AXIS.search(content)
    if unit is not None and _number(unit[1]) != 1.0:
        raise SetupError(
            f"{file}: its <unit> is {shown(unit[1].decode(errors='replace'))} m, which is not applied here: "
            "export it in metres, or set meter to 1 and state the scale where the mesh is named"
        )
    if up is not None and up[1] != b"Z_UP":
        raise SetupError(
            f"{file}: its up_axis is {shown(up[1].decode(errors='replace'))}, which is not applied here: "
            "export it with Z_UP"
        )


def _require_whole_stl(file: Path, content: bytes) -> None:
    count = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    if len(content) >= _STL_HEADER and len(content) == _STL_HEADER + _STL_TRIANGLE * count:
        return
    words = content.rsplit(b"endfacet", 1)
    if len(words) == 2:
        if b"endsolid" not in words[1].lower():
            raise SetupError(f"{file}: cut off: it does not end with endsolid, export it again")
        return
    if len(content) < _STL_HEADER + _STL_TRIANGLE * count:
        raise SetupError(f"{file}: cut off: shorter than the {count} triangles that it states need")


def _require_whole_obj(file: Path, content: bytes) -> None:
    vertices = 0
    used: set[int] = set()
    for number, line in enumerate(content.splitlines(), 1):
        words = line.split()
        if words[:1] == [b"v"]:
            vertices += 1
        elif words[:1] == [b"f"]:
            used.update(_corner(word, vertices, f"{file}: line {number}") for word in words[1:])
    unused = vertices - len(used & set(range(1, vertices + 1)))
    if unused:
        raise SetupError(
            f"{file}: no face uses {unused} of its {vertices} vertices, so they would be left out: "
            "it is cut off, or must be exported without them"
        )


def _corner(word: bytes, vertices: int, where: str) -> int:
    """Return the number of a face's vertex, from 1; a negative one counts back from the last so far."""
    try:
        number = int(word.split(b"/")[0])
    except ValueError:
        raise SetupError(f"{where}: a face names the vertex {shown(word.decode(errors='replace'))}") from None
    return number if number > 0 else vertices + 1 + number


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


_CHECKS = {".stl": _require_whole_stl, ".dae": _require_metres, ".obj": _require_whole_obj}
