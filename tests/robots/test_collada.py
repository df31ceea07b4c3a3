"""COLLADA scenes: each way to place a mesh is read as the loading library reads it, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.collada import scene_points
from robots.errors import SetupError
from robots.geometry import read_mesh

Array = NDArray[np.float64]

CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [5, 5, 5]])
HEAD = '<?xml version="1.0" encoding="utf-8"?>'
UP = "<up_axis>Z_UP</up_axis>"
PLACED = '<instance_geometry url="#g"/>'
NODE = f"<node>{PLACED}</node>"


def part(tag: str, indices: str, count: int = 1, inside: str = "") -> str:
    vertices = '<input semantic="VERTEX" source="#gv" offset="0"/>'
    return f'<{tag} count="{count}">{vertices}{inside}<p>{indices}</p></{tag}>'


TRIANGLES = part("triangles", "0 1 2 0 1 3", 2)
ONE = part("triangles", "0 1 2")


def geometry(parts: str, name: str = "g", corners: Array = CORNERS) -> str:
    numbers = " ".join(f"{value:g}" for value in corners.ravel())
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return (
        f'<geometry id="{name}"><mesh><source id="{name}p"><float_array id="{name}a" count="{corners.size}">'
        f'{numbers}</float_array><technique_common><accessor source="#{name}a" count="{len(corners)}" '
        f'stride="3">{params}</accessor></technique_common></source><vertices id="{name}v">'
        f'<input semantic="POSITION" source="#{name}p"/></vertices>{parts.replace("#gv", f"#{name}v")}</mesh>'
        "</geometry>"
    )


def document(parts: str = TRIANGLES, nodes: str = NODE, asset: str = UP, beside: str = "") -> str:
    return (
        f'{HEAD}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<asset>{asset}</asset><library_geometries>{geometry(parts)}</library_geometries>{beside}"
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


def read(folder: Path, text: str) -> Array:
    file = folder / "a.dae"
    file.write_text(text, encoding="utf-8")
    return np.unique(read_mesh(file)[:, :3], axis=0)


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(SetupError) as caught:
        read(folder, text)
    message = str(caught.value)
    assert message.startswith(f"{folder / 'a.dae'}: ") and "\n" not in message
    return message


@pytest.mark.parametrize(
    "parts",
    [
        TRIANGLES,
        part("tristrips", "0 1 2 3"),
        part("trifans", "0 1 2 3"),
        ONE + part("polygons", "0 1 3"),
        part("polylist", "0 1 2 0 1 3", 2, "<vcount>3 3</vcount>"),
        TRIANGLES + part("lines", "0 3"),
        TRIANGLES + part("linestrips", "0 1 3"),
    ],
)
def test_faces_of_all_kinds_are_read(tmp_path: Path, parts: str) -> None:
    np.testing.assert_allclose(read(tmp_path, document(parts)), np.unique(CORNERS, axis=0), rtol=1e-6)


def test_positions_that_no_face_names_are_no_part_of_the_scene(tmp_path: Path) -> None:
    np.testing.assert_allclose(read(tmp_path, document(ONE)).max(axis=0), [0.1, 0.1, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("node", "largest"),
    [
        ("<scale>10 20 1</scale>", (1, 2, 0)),
        ("<translate>1 2 3</translate>", (1.1, 2.1, 3)),
        ("<rotate>0 0 1 90</rotate>", (0, 0.1, 0)),
        ("<rotate>0 1 0 -90</rotate>", (0, 0.1, 0.1)),
        ("<translate>1 0 0</translate><rotate>0 0 1 90</rotate><translate>2 0 0</translate>", (1, 2.1, 0)),
        ("<matrix>1 0 0 5  0 1 0 6  0 0 1 7  0 0 0 1</matrix>", (5.1, 6.1, 7)),
        ("<lookat>1 2 3  1 2 4  0 1 0</lookat>", (1, 2.1, 3)),
    ],
)
def test_transformations_of_nodes_are_applied(
    tmp_path: Path, node: str, largest: tuple[float, float, float]
) -> None:
    nodes = f"<node>{node}{PLACED}</node>"
    found = read(tmp_path, document(ONE, nodes))
    np.testing.assert_allclose(found.max(axis=0), largest, atol=1e-6)
    within = f"<node>{node}<node>{PLACED}</node></node>"
    np.testing.assert_allclose(read(tmp_path, document(ONE, within)), found, atol=1e-6)
    library = f'<library_nodes><node id="k">{PLACED}</node></library_nodes>'
    named = f'<node>{node}<instance_node url="#k"/></node>'
    np.testing.assert_allclose(read(tmp_path, document(ONE, named, beside=library)), found, atol=1e-6)


@pytest.mark.parametrize(
    ("asset", "told"),
    [
        ('<!-- <unit meter="1"/> --><unit name="m" meter="1000"/>', "its <unit> is '1000' m"),
        ('<unit name="a>b" meter="1000"/>', "its <unit> is '1000' m"),
        ('<unit meter="1_0"/>', "its <unit> is '1_0' m"),
        ('<unit meter="0_1"/>', "its <unit> is '0_1' m"),
        ('<unit name="millimeter"/>', "its <unit> is '' m"),
        ('<unit METER="0.001"/>', "its <unit> is '' m"),
        ('<Unit meter="0.001"/>', "its <unit> is '0.001' m"),
        ("<Up_Axis>Y_UP</Up_Axis>", "its up_axis is 'Y_UP'"),
        ('<unit meter="1"/><unit meter="0.0254"/>', "its <unit> is '0.0254' m"),
        ("<up_axis><!-- Z_UP --> Y_UP</up_axis>", "its up_axis is 'Y_UP'"),
        ("<!-- <up_axis>Z_UP</up_axis> --><up_axis>Y_UP</up_axis>", "its up_axis is 'Y_UP'"),
        ("<up_axis />", "its up_axis is ''"),
    ],
)
def test_comments_and_attributes_hide_no_unit_and_no_axis(tmp_path: Path, asset: str, told: str) -> None:
    assert told in refusal(tmp_path, document(asset=asset))
    beside = f"<library_nodes><asset>{asset}</asset></library_nodes>"
    assert told in refusal(tmp_path, document(beside=beside))


def test_an_attribute_and_a_comment_of_a_unit_may_say_anything(tmp_path: Path) -> None:
    asset = '<!-- <unit meter="0.001"/> --><unit name="&lt;unit meter=2>" meter="1"/><up_axis>Z_UP</up_axis>'
    assert len(read(tmp_path, document(asset=asset))) == len(CORNERS)


CONTROLLER = '<library_controllers><controller id="c"><morph source="#g"/></controller></library_controllers>'
CONVEX = (
    '<library_geometries><geometry id="h"><convex_mesh convex_hull_of="#g"/></geometry></library_geometries>'
)
LONE = f"<library_geometries>{geometry(ONE, 'h')}</library_geometries>"
FAR = f"<scale>9 9 9</scale>{PLACED}"
TWICE = f'<node id="k">{PLACED}</node><node id="k">{FAR}</node>'
HOLE = part("polygons", "").replace("<p></p>", "<ph><p>0 1 3</p><h>0 1 2</h></ph>")
ANIMATION = (
    '<library_animations><animation><channel source="#a" target="n/scale"/></animation></library_animations>'
)
OTHER_SCENE = f'{NODE}</visual_scene><visual_scene id="t"><node><translate>4 4 4</translate>{PLACED}</node>'
EXTERNAL = '<node><instance_geometry url="other.dae#g"/></node>'
DEEP = "<node>" * 60 + PLACED + "</node>" * 60
WAYS = "".join(
    f'<node id="n{i}">{2 * f"<instance_node url={chr(34)}#n{i + 1}{chr(34)}/>"}</node>' for i in range(40)
)
MANY = f'<library_nodes>{WAYS}<node id="n40"/></library_nodes>'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (document().replace("<COLLADA", "<!DOCTYPE a><COLLADA"), "has a DOCTYPE"),
        (document()[:-20], "not XML"),
        (f"{HEAD}<a><COLLADA/></a>", "the root element is <a>"),
        (
            document(nodes=f'{NODE}<node><instance_controller url="#c"/></node>', beside=CONTROLLER),
            "has a <instance_controller>, which is not applied",
        ),
        (
            document(nodes=f'{NODE}<instance_controller url="#c"/>', beside=CONTROLLER),
            "has a <instance_contr",
        ),
        (document(beside=CONVEX), "places 1 of its 2 meshes"),
        (document().replace("mesh>", "convex_mesh>"), "a geometry has a <convex_mesh>, which is not read"),
        (document(ONE + HOLE), "has a <ph>, which is not applied"),
        (document(beside=LONE), "places 1 of its 2 meshes"),
        (document(nodes=OTHER_SCENE), "has 2 scenes"),
        (document(nodes=NODE + EXTERNAL), "its <instance_geometry> names 'other.dae#g'"),
        (document(nodes=NODE + EXTERNAL.replace("other.dae", "")[:24] + "</node>"), "not XML"),
        (document(nodes=f'{NODE}<node><instance_geometry url="#h"/></node>'), "the geometry '#h'"),
        (document(nodes=f"<node><skew>45 1 0 0 0 1 0</skew>{PLACED}</node>"), "has a <skew>"),
        (document(nodes=f"<node><scale>1 1</scale>{PLACED}</node>"), "<scale> has 2 numbers; it needs 3"),
        (document(nodes=f"<node><scale>1 1 x</scale>{PLACED}</node>"), "in <scale>"),
        (
            document(nodes=f"<node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0.1</matrix>{PLACED}</node>"),
            "the last row of a <matrix> must be 0 0 0 1",
        ),
        (document(nodes=f"<node><scale>1 nan 1</scale>{PLACED}</node>"), "the last row"),
        (
            document(nodes=f"<node><lookat>1 1 1 0 0 0 0 0 1</lookat>{PLACED}</node>"),
            "left out or read as others",
        ),
        (document(asset=""), "states no up_axis, which means Y_UP"),
        (
            document(nodes=f"<node><Scale>9 9 9</Scale>{PLACED}</node>"),
            "a node has a <Scale>, which is not applied",
        ),
        (
            document(nodes=f"<node><scale>1 1 1<x/></scale>{PLACED}</node>"),
            "a <scale> holds a <x> where only",
        ),
        (document(ONE.replace("</p>", "<x/> 0 1 3</p>")), "a <p> holds a <x> where only numbers"),
        (document().replace("5 5 5<", "5 5 5<x/> 9 9 9<"), "a <float_array> holds a <x>"),
        (document(nodes=f"{NODE}<group><node>{FAR}</node></group>"), "does not reach 2 .*the first a <node>"),
        (
            document(nodes=f"<node>{PLACED}<extra><node>{FAR}</node></extra></node>"),
            "does not reach 2 elements that place meshes",
        ),
        (document(beside=f"<library_nodes><node>{FAR}</node></library_nodes>"), "does not reach 2"),
        (
            document(nodes=f'{NODE}<extra><instance_node url="#k"/></extra>'),
            "does not reach 1 .*a <instance_node>",
        ),
        (
            document(
                nodes='<node><instance_node url="#k"/></node>',
                beside=f"<library_nodes>{TWICE}</library_nodes>",
            ),
            "names the node '#k', but 2 elements are called so",
        ),
        (document().replace("</mesh>", '<source id="gp"/></mesh>'), "the source '#gp', but 2 elements"),
        (document(beside=ANIMATION), "has a <channel>, which is not applied"),
        (document().replace("mesh>", "Mesh>"), "a geometry has a <Mesh>, which is not read"),
        (document().replace("</mesh>", "</mesh><brush/>"), "a geometry has a <brush>"),
        (document(nodes=f'{NODE}<node><instance_node url="#"/></node>'), "names the node '#', which is not"),
        (document(nodes=f"<node><lookat>1 1 1 1 1 1 0 0 1</lookat>{PLACED}</node>"), "the last row"),
        (document(nodes=f"<node><scale>1e200 1 1</scale><scale>1e200 1 1</scale>{PLACED}</node>"), "finite"),
        (document().replace("5 5 5<", "1e999 5 5<"), "coordinates that are not finite"),
        (
            document(ONE + part("lines", "0 3")).replace("5 5 5<", "nan 5 5<"),
            "coordinates that are not finite",
        ),
        (document(nodes=DEEP), "50 inside one another"),
        (
            document(nodes=f'{NODE}<node><instance_node url="#n0"/></node>', beside=MANY),
            "more than 10000 nodes",
        ),
        (document(ONE + part("lines", "0 3")), "1 of the 5 places that it states"),
        (document(part("triangles", "0 1 2 0 3 3", 2)), "1 of the 4 places .*the first at 5 5 5"),
        (document(ONE + "<tubes/>"), "a mesh has a <tubes>"),
        (document(part("triangles", "0 1 4")), "names vertices beyond the 4"),
        (document(TRIANGLES.replace('offset="0"', 'offset="-1"')), "has the offset '-1'"),
        (document(TRIANGLES.replace('"VERTEX"', '"NORMAL"')), "with 0 inputs of vertices"),
        (document().replace('"POSITION"', '"NORMAL"'), "with 0 positions"),
        (document().replace("accessor", "Accessor"), "positions without an accessor"),
        (document().replace('name="X"', 'name="Z"'), "not rows of X, Y, Z"),
        (document().replace('stride="3"', 'stride="4"'), "not rows of X, Y, Z"),
        (document().replace('"#ga" count="4"', '"#ga" count="3"'), "12 numbers are not 3 positions"),
        (document().replace("5 5 5<", "nan 5 5<"), "coordinates that are not finite"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_would_be_left_out_or_misplaced_is_refused(tmp_path: Path, text: str, told: str) -> None:
    assert all(words in refusal(tmp_path, text) for words in told.split(" .*"))


def test_what_else_nodes_and_meshes_may_have(tmp_path: Path) -> None:
    """Names that nothing refers to may be given twice, as they are in published meshes."""
    beside = (
        '<instance_camera url="#c"/><instance_light url="#d"/><asset/><extra><scale>9 9 9</scale></extra>'
    )
    text = document(nodes=f'<node id="k">{PLACED}{beside}</node><node id="k"/>')
    text = text.replace("</mesh>", "<extra/></mesh><extra><page url='a.org'/></extra><asset/>")
    text = text.replace(
        "<scene>",
        '<library_cameras><camera id="c"/></library_cameras><library_lights><light id="d"/>'
        "</library_lights><scene>",
    )
    np.testing.assert_allclose(read(tmp_path, text), np.unique(CORNERS, axis=0), rtol=1e-6)


def test_ends_of_lines_within_the_hull_are_left_out(tmp_path: Path) -> None:
    """Edges that drawing programs add bound no body; outside of the faces they may mean one."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.1, 0.1, 0.1]])
    solid = part("triangles", "0 1 2 0 1 3 0 2 3 1 2 3", 4) + part("lines", "0 4")
    text = document().replace(geometry(TRIANGLES), geometry(solid, corners=corners))
    np.testing.assert_array_equal(read(tmp_path, text), np.unique(corners[:4], axis=0))
    corners[4] = 0.4
    text = document().replace(geometry(TRIANGLES), geometry(solid, corners=corners))
    assert "the first at 0.4 0.4 0.4" in refusal(tmp_path, text)


def test_points_are_those_of_the_file_to_the_last_digit() -> None:
    nodes = f"<node><translate>0.1 0 0</translate><rotate>1 0 0 90</rotate>{PLACED}</node>"
    corners, ends = scene_points(document(ONE + part("lines", "0 3"), nodes).encode(), "a.dae")
    expected = CORNERS[:3] @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) + [0.1, 0, 0]
    np.testing.assert_allclose(corners, expected, atol=1e-16)
    np.testing.assert_allclose(ends, [[0.1, 0, 0], [5.1, -5, 5]], atol=1e-14)
