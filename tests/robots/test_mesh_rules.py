"""Mesh files that would be read as smaller, larger or turned: refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.errors import SetupError
from robots.geometry import read_mesh, read_triangles
from robots.mesh_rules import StatedPlaces

TEXT = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{asset}</asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="9">0 0 0 1 0 0 0 1 2</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh>
</geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


UP = "<up_axis>Z_UP</up_axis>"


def written(path: Path, asset: str) -> Path:
    path.write_text(TEXT.format(asset=asset), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "asset", [UP, '<unit meter="1"/>' + UP, '<unit name="meter" meter="1.0"/><up_axis>Z_UP</up_axis>']
)
def test_metres_with_z_up_are_read_as_they_stand(tmp_path: Path, asset: str) -> None:
    found = read_mesh(written(tmp_path / "a.dae", asset))
    np.testing.assert_array_equal(found[:, :3].max(axis=0), [1.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("asset", "told"),
    [
        ('<unit meter="0.001" name="millimeter"/>', "its <unit> is '0.001' m, .*export it in metres"),
        ("<unit name='inch' meter = '0.0254'/>", "its <unit> is '0.0254' m"),
        ('<unit meter="x"/>', "its <unit> is 'x' m"),
        ("<up_axis>Y_UP</up_axis>", "its up_axis is 'Y_UP', .*export it with Z_UP"),
        ('<unit meter="1"/><up_axis> X_UP </up_axis>', "its up_axis is 'X_UP'"),
    ],
)
@pytest.mark.parametrize("read", [read_mesh, read_triangles])
@pytest.mark.parametrize("name", ["a.dae", "A.DAE"])
def test_another_unit_or_axis_is_refused(
    tmp_path: Path, asset: str, told: str, read: object, name: str
) -> None:
    with pytest.raises(SetupError, match=rf"{name}: {told}"):
        read(written(tmp_path / name, asset))


def test_mesh_rules_in_another_encoding_is_refused(tmp_path: Path) -> None:
    text = TEXT.format(asset='<unit meter="0.001"/>').replace("?>", ' encoding="UTF-16"?>')
    (tmp_path / "a.dae").write_text(text, encoding="utf-16")
    with pytest.raises(SetupError, match=r"a\.dae: not a COLLADA file in UTF-8"):
        read_mesh(tmp_path / "a.dae")


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5]], dtype=np.float64)
FACES = [(0, 1, 2), (0, 1, 3), (1, 2, 4), (0, 2, 4)]


def obj_text() -> bytes:
    lines = ["v {:g} {:g} {:g}".format(*corner) for corner in CORNERS]
    return "\n".join(lines + ["f {} {} {}".format(*(i + 1 for i in face)) for face in FACES]).encode()


def ascii_stl() -> bytes:
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    corners = ["".join("vertex {:g} {:g} {:g}\n".format(*CORNERS[i]) for i in face) for face in FACES]
    return ("solid a\n" + "".join(facet.format(part) for part in corners) + "endsolid a\n").encode()


def binary_stl() -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 1, *CORNERS[list(face)].ravel(), 0) for face in FACES]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def stating(triangles: int) -> bytes:
    whole = binary_stl()
    return whole[:80] + struct.pack("<I", triangles) + whole[84:]


WHOLE = {
    "a.obj": obj_text(), "a.stl": ascii_stl(), "b.STL": binary_stl(), "a.dae": TEXT.format(asset=UP).encode()
}  # fmt: skip


def places(file: Path) -> NDArray[np.float64]:
    return np.unique(read_mesh(file)[:, :3], axis=0)


@pytest.mark.parametrize("name", WHOLE)
def test_cut_off_anywhere_it_is_refused_or_read_whole(tmp_path: Path, name: str) -> None:
    file, content = tmp_path / name, WHOLE[name]
    file.write_bytes(content)
    whole = places(file)
    assert len(whole) in (len(CORNERS), 3)
    read = 0
    for end in range(len(content) - 1, -1, -1):
        file.write_bytes(content[:end])
        try:
            found = places(file)
        except SetupError as error:
            assert str(error).startswith(f"{file}: ")
            continue
        np.testing.assert_array_equal(found, whole, err_msg=f"of {len(content)} bytes {end}")
        read += 1
    assert read <= 8  # as many characters as make up the last face, whose corners others use too


def test_faces_of_an_obj_file_may_count_backwards(tmp_path: Path) -> None:
    file = tmp_path / "a.obj"
    lines = ["f " + " ".join(f"{i - len(CORNERS)}/1/1" for i in face) for face in FACES]
    file.write_bytes(obj_text().split(b"\nf")[0] + ("\n" + "\n".join(lines)).encode())
    np.testing.assert_array_equal(places(file), np.unique(CORNERS, axis=0))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.obj", obj_text().rsplit(b"\n", 2)[0], "no face uses 1 of its 5 vertices"),
        ("a.obj", obj_text() + b"\nf 1 x 2", "line 10: a face names the vertex 'x'"),
        ("a.obj", obj_text() + b"\nf 1 0 2", "line 10: a face names the vertex '0'"),
        ("a.obj", obj_text() + b"\nf 1 0_3 2", "line 10: a face names the vertex '0_3'"),
        ("a.obj", obj_text() + b"\nf 1 2 6", "a face names the vertex 6 of 5: it is cut off"),
        ("a.obj", obj_text() + b"\nf 1 2 -6", "a face names the vertex 0 of 5: it is cut off"),
        ("a.obj", obj_text() + b"\ncall b.obj", "line 10: 'call' is not read: export it again"),
        ("a.obj", obj_text() + b"\nsurf 0 1 0 1 1 2 3 4", "line 10: 'surf' is not read"),
        ("a.obj", obj_text() + b"\nV 9 9 9", "line 10: 'V' is not read"),
        ("a.obj", b"# nothing is here\n" * 9, "has no faces"),
        ("a.dae", TEXT.format(asset=UP).replace("triangles", "lines").encode(), "has no faces"),
        ("a.stl", (2 * b"solid a\nendsolid a\nendfacet\n").ljust(90) + b"endsolid", "has no faces"),
        ("a.stl", ascii_stl().rsplit(b"facet normal", 1)[0], "cut off: it does not end with endsolid"),
        ("a.stl", binary_stl()[:-50], "cut off: shorter than the 4 triangles"),
        ("a.stl", stating(3), "not whole: longer than the 3 triangles"),
        ("a.stl", b"solid" + stating(1)[5:], "not whole: longer than the 1 triangles"),
        (
            "a.stl",
            b"solid vertex endfacet endsolid".ljust(80) + stating(1)[80:],
            "neither text nor 1 triangles: it has zero",
        ),
        ("a.stl", binary_stl() + b"\0", "not whole: longer than the 4 triangles"),
        ("a.stl", ascii_stl().decode().encode("utf-16"), "cut off: shorter"),
        ("a.stl", b"", "not a mesh: it is cut off"),
        ("a.ply", b"ply\n", "of a format that is not read here; export it as one of .stl, .dae, .obj"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, name: str, content: bytes, told: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SetupError, match=rf"{name}: {told}"):
        read_mesh(tmp_path / name)


SOLID = [[(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0)], [(0, 0, 0), (0, 0.5, 0), (0, 0, 0.5)]]
FAR = [[(1, 1, 1), (2, 1, 1), (1, 2, 1)]]
TO_FAR = [(0, 0, 0), (0.5, 0, 0), (5, 5, 5)]
OBJ = "v 0 0 0\nv 0.5 0 0\nv 0 0.5 0\nv 5 5 5\nf 1 2 3\nf 1 2 4\n"

DOT = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf -3 -2 -1\nv 5 5 .5\nv 0.2 0 0\nv 0 0.2 0\nf -3 -2 -1\n"


def solid(triangles: list[list[tuple[float, float, float]]], name: str = "a") -> str:
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {:g} {:g} {:g}\n".format(*corner) for corner in corners)
        + "endloop\nendfacet\n"
        for corners in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


LOST = "places that it states would be left out or read as others, the first at "


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        (
            "a.stl",
            solid(SOLID).replace("endsolid a", "") + solid(FAR, "b").upper(),
            "3 of the 7 " + LOST + "1 1 1",
        ),
        ("a.stl", solid(SOLID) + "\0" * 10 + solid(FAR), "it has zero bytes, export it again"),
        (
            "a.stl",
            solid(SOLID).replace("vertex 0 0 0.5", "vertex 0 0 x"),
            "the coordinate 'x', which is no number",
        ),
        ("a.stl", solid(SOLID).replace("0.5\nendloop", "\nendloop"), "the coordinate 'endloop'"),
        (
            "a.stl",
            solid(SOLID).replace("vertex 0 0 0.5", "vertex0 0 0.5"),
            "a vertex without its three numbers",
        ),
        ("a.stl", solid(SOLID).replace("0.5", "nan"), "the coordinate 'nan', which is no number"),
        ("a.obj", OBJ.replace("f 1 2 4", "f 4"), "1 of the 4 " + LOST + "5 5 5"),
        ("a.obj", OBJ.replace("f 1 2 4", "f 3 4"), "1 of the 4 " + LOST + "5 5 5"),
        ("a.obj", OBJ.replace("f 1 2 4", "f 4 4 4"), "1 of the 4 " + LOST + "5 5 5"),
        ("a.obj", OBJ.replace("f 1 2 4", "f 3 4 4"), "1 of the 4 " + LOST + "5 5 5"),
        ("a.obj", DOT, "1 of the 6 " + LOST + "5 5 0.5"),
        ("a.obj", OBJ.replace("f 1 2 4", " f 1 2 4"), "line 6: starts with a blank, and would be left out"),
        ("a.obj", OBJ.replace("f 1 2 4", "\tf 1 2 4"), "line 6: starts with a blank"),
        ("a.obj", OBJ.replace("v 5 5 5", " v 5 5 5"), "line 4: starts with a blank"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 5 10"), "line 4: a vertex has the weight '10'"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 5 x"), "line 4: a vertex has the weight 'x'"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5"), "line 4: a vertex has 2 numbers"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 5 1 1 1 1"), "line 4: a vertex has 7 numbers"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 \\\n5"), "line 5: '5' is not read"),
        ("a.obj", OBJ.replace("f 1 2 4", "f 1 2 \\\n4"), "line 6: a face names the vertex '\\\\'"),
        ("a.obj", OBJ.replace("f 1 2 4", "g a\\\nf 1 2 4"), "1 of the 4 " + LOST + "5 5 5"),
        ("a.obj", OBJ.replace("5 5 5", "5 5 5\fv 6 6 6"), "line 4: a vertex has 7 numbers"),
        ("a.obj", OBJ.replace("5 5 5", "5 5 5\0v 6 6 6"), "the coordinate '5\\x00v'"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 1,5"), "the coordinate '1,5', which is no number"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 1_0"), "the coordinate '1_0'"),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 inf"), "coordinates that are not finite"),
        ("a.obj", OBJ.replace("f 1 2 4", "F 1 2 4"), "line 6: 'F' is not read: export it again"),
    ],
)
def test_vertices_that_the_reader_leaves_out_or_scales_are_refused(
    tmp_path: Path, name: str, text: str, told: str
) -> None:
    (tmp_path / name).write_bytes(text.encode())
    for read in (read_mesh, read_triangles):
        with pytest.raises(SetupError) as caught:
            read(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ") and told in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", OBJ),
        ("a.obj", OBJ.replace("\n", "\r")),
        ("a.obj", OBJ.replace("\n", "\r\n")),
        ("a.obj", OBJ.replace("v 5 5 5", "# v 9 9 9\nv 5 5 5 # far\n#")),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 5 1 0.5 0")),
        ("a.obj", OBJ.replace("v 5 5 5", "v 5 5 5 1.0")),
        ("a.obj", OBJ.replace("v 5 5 5", "v\t5e0  5.00 +5")),
        ("a.obj", OBJ.replace("f 1 2 4", "f -4 -3 -1")),
        ("a.obj", OBJ + "f 1 1 4\nf 4 4\n"),
        ("a.obj", "\ufeff" + OBJ),
        (
            "a.obj",
            OBJ.replace("v 5 5 5", "g a\no b\ns off\nmtllib c\nusemtl d\n\n  \nv 5 5 5") + "l 1 4\np 2\n",
        ),
        ("a.obj", OBJ.replace("f 1 2 4", "f 1 2 4 # far")),
        ("a.obj", OBJ.replace("f 1 2 4", "f 1//1 2//1 4//1") + "vn 0 0 1\nvt 0 0\n"),
        ("a.stl", solid([*SOLID, TO_FAR])),
        ("a.stl", solid(SOLID) + solid([TO_FAR], "b")),
        ("a.stl", solid([*SOLID, TO_FAR]).replace("endfacet", " endfacet ")),
        ("a.stl", solid([*SOLID, TO_FAR], "vertex_part of 2 vertex rows").replace("endsolid", "  ENDSOLID")),
        ("a.stl", solid([*SOLID, TO_FAR], "vertex 7 7 7").replace("\n", "\r")),
        ("a.stl", solid(SOLID, "vertex").replace("\n", "\r\n") + solid([TO_FAR], "vertex 9 9 9")),
        ("a.stl", solid([*SOLID, TO_FAR]).replace("solid a\nfacet", "solid a facet")),
    ],
)
def test_what_is_read_whole_is_accepted(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_bytes(text.encode())
    expected = [(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (5, 5, 5)]
    expected += [(0, 0, 0.5)] if name == "a.stl" else []
    np.testing.assert_array_equal(places(tmp_path / name), sorted(expected))


def stated(corners: list[list[float]], ends: list[list[float]] | None = None) -> StatedPlaces:
    return StatedPlaces("a.dae", np.array(corners), np.array(ends or np.empty((0, 3)), dtype=np.float64))


def test_rounding_to_24_bits_is_no_loss_and_more_is(rng: np.random.Generator) -> None:
    corners = rng.uniform(-3, 3, (200, 3))
    scale = np.array([1.0, 0.001, 2.0])
    stated(corners.tolist()).require_all_in(corners.astype(np.float32) * scale, scale)
    loaded = corners * scale
    loaded[7] += 1e-4
    with pytest.raises(SetupError, match=r"a\.dae: 1 of the 200 places"):
        stated(corners.tolist()).require_all_in(loaded, scale)


def test_a_line_is_held_against_the_hull_which_a_flat_mesh_has_not() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    stated(square.tolist(), [[1.0, 1, 0]]).require_all_in(square, np.ones(3))
    with pytest.raises(SetupError, match=r"1 of the 5 places .* the first at 0\.5 0\.5 0"):
        stated(square.tolist(), [[0.5, 0.5, 0]]).require_all_in(square, np.ones(3))
